//! `foveate trax`: a client over pipes.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Stdio};

use crate::place::{FRAMES, Place};

/// The program at the other end of two pipes.
struct Client {
    child: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Client {
    fn new(place: &Place, args: &[&str]) -> Self {
        let mut command = place.command([&["trax", "-c", "c.toml"][..], args].concat());
        let command = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("it starts");
        let (input, output) = (child.stdin.take(), BufReader::new(child.stdout.take().expect("a pipe")));
        Self { child, input, output }
    }
    fn send(&mut self, text: &str) {
        // It may have gone already.
        let _ = self.input.as_mut().expect("open").write_all(text.as_bytes());
    }
    fn line(&mut self) -> String {
        let mut line = String::new();
        self.output.read_line(&mut line).expect("a line");
        line
    }
    /// The four numbers and the confidence of a state.
    fn state(&mut self) -> ([f64; 4], f64) {
        let line = self.line();
        let words: Vec<&str> = line.trim().split('"').collect();
        assert_eq!(words[0], "@@TRAX:state ", "{line}");
        let numbers: Vec<f64> = words[1].split(',').map(|n| n.parse().expect("a number")).collect();
        let confidence = words[3].strip_prefix("confidence=").expect("a property").parse().expect("a number");
        (numbers.try_into().expect("four"), confidence)
    }
    /// Whether it ended well, and its standard error.
    fn end(mut self) -> (bool, String) {
        drop(self.input.take());
        let output = self.child.wait_with_output().expect("it ends");
        (output.status.success(), crate::place::errors(&output))
    }
}

fn image(place: &Place, frame: usize) -> String {
    format!("\"file://{}\"", place.path(&format!("video/img/{frame:04}.png")).display())
}

/// The first true box, counted from 0, as numbers in a line.
fn first(place: &Place) -> [f64; 4] {
    let text = place.text("video/groundtruth_rect.txt");
    let numbers = text.lines().next().expect("a line").split(',').map(|n| n.parse().expect("a number"));
    let [x, y, w, h]: [f64; 4] = numbers.collect::<Vec<_>>().try_into().expect("four");
    [x - 1.0, y - 1.0, w, h]
}

fn rectangle([x, y, w, h]: [f64; 4]) -> String {
    format!("\"{x},{y},{w},{h}\"")
}

#[test]
fn a_client_sees_the_boxes_of_track() {
    let place = Place::new();
    let boxes = String::from_utf8(place.boxes("out", &["video"])).expect("text");
    let boxes: Vec<Vec<f64>> =
        boxes.lines().map(|line| line.split(',').map(|n| n.parse().expect("a number")).collect()).collect();
    let [x, y, w, h] = first(&place);
    let polygon = format!("\"{x},{y},{},{y},{},{},{x},{}\"", x + w, x + w, y + h, y + h);
    assert!([x, y, w, h].iter().all(|n| n.fract() == 0.0), "a mask has whole pixels");
    let mask = format!("\"mask:{x},{y},{w},{h},0,{}\"", w * h);
    for region in [rectangle([x, y, w, h]), polygon, mask] {
        let mut client = Client::new(&place, &[]);
        let hello = client.line();
        for part in
            ["@@TRAX:hello ", "\"trax.version=3\"", "\"trax.region=rectangle;polygon;mask;\"", "\"trax.image=path;\""]
        {
            assert!(hello.contains(part), "{hello}");
        }
        // Twice: a second initialize resets everything.
        for _ in 0..2 {
            client.send("nobody's line\n");
            client.send(&format!("@@TRAX:initialize {} {region} \"label=3\"\n", image(&place, 1)));
            assert_eq!(client.state(), ([x, y, w, h], 1.0));
            for frame in 2..=FRAMES {
                client.send(&format!("@@TRAX:frame {}\n", image(&place, frame)));
                let ([x, y, w, h], confidence) = client.state();
                let found = [x + 1.0, y + 1.0, w, h];
                assert!(found.iter().zip(&boxes[frame - 1]).all(|(a, b)| (a - b).abs() < 1e-3), "{frame}: {found:?}");
                assert!((0.0..=1.0).contains(&confidence));
            }
        }
        client.send("@@TRAX:quit\n");
        assert_eq!(client.end(), (true, String::new()));
    }
}

#[test]
fn several_objects_have_a_tracker_each() {
    let place = Place::new();
    let mut client = Client::new(&place, &["--objects"]);
    assert!(client.line().contains("\"trax.multiobject=1\""));
    let own = first(&place);
    let other = [5.0, 5.0, 20.0, 20.0];
    let track = |client: &mut Client, several: bool| {
        let mut seen = vec![];
        client.send(&format!("@@TRAX:initialize\n@@TRAX:initialize {}\n", rectangle(own)));
        for frame in 1..=4 {
            // The second one comes later.
            if several && frame == 2 {
                client.send(&format!("@@TRAX:initialize {}\n", rectangle(other)));
            }
            client.send(&format!("@@TRAX:frame {}\n", image(&place, frame)));
            seen.push(client.state());
            if several && frame >= 2 {
                let (bbox, confidence) = client.state();
                assert!(frame > 2 || (bbox, confidence) == (other, 1.0));
            }
        }
        seen
    };
    let (both, alone) = (track(&mut client, true), track(&mut client, false));
    assert_eq!(both, alone, "trackers know nothing of each other");
    // The end of the stream is the end of the session.
    assert_eq!(client.end(), (true, String::new()));
}

#[test]
fn damage_is_reported_and_ends_the_session() {
    let place = Place::new();
    let (good, own) = (image(&place, 1), rectangle(first(&place)));
    let begin = format!("@@TRAX:initialize {good} {own}\n");
    let long = format!("@@TRAX:frame {}", "a".repeat(2 << 20));
    let several = "@@TRAX:initialize \"1,1,20,20\"\n".repeat(257);
    let large = format!("{}@@TRAX:frame {good}\n", &several[..several.len() / 257 * 200]);
    for (args, text, said) in [
        (&[][..], "@@TRAX:frame \"a.png\"\n".to_owned(), "a frame before any object"),
        (&[], format!("@@TRAX:initialize {good}\n"), "expected initialize IMAGE REGION, frame IMAGE or quit"),
        (&[], "@@TRAX:dance\n".into(), "found \"dance\" with 0 arguments"),
        (&[], format!("@@TRAX:initialize {good} \"1,2,3\"\n"), "expected a rectangle x,y,w,h, a polygon"),
        (&[], format!("@@TRAX:initialize {good} \"nan,2,3,4\"\n"), "is no box"),
        (&[], format!("@@TRAX:initialize {good} \"9000,2,30,40\"\n"), "9000"),
        (&[], format!("@@TRAX:initialize {good} \"mask:0,0,9,9,82\"\n"), "run 1 (82) goes beyond"),
        (&[], format!("@@TRAX:initialize {good} \"mask:0,0,9,9,81\"\n"), "is no box"),
        (&[], format!("@@TRAX:initialize \"http://a/1.jpg\" {own}\n"), "an image as http:"),
        (&[], format!("{begin}@@TRAX:frame \"file:///none.png\"\n"), "none.png: cannot read"),
        (&[], format!("{begin}@@TRAX:frame \"{}\"\n", place.path("c.toml").display()), "expected a PNG, JPEG"),
        (&[], format!("{begin}@@TRAX:frame \"\n"), "quotation mark"),
        (&[], long, "more than 1048576 bytes"),
        (&[], "x".repeat(2 << 20), "more than 1048576 bytes"),
        (&["--objects"], several, "more than 256 objects"),
        (&["--objects", "--max-memory", "100M"], large, "200 objects would take about"),
        (&["--objects"], format!("@@TRAX:initialize {good} {own}\n"), "expected initialize REGION"),
    ] {
        let mut client = Client::new(&place, args);
        client.line();
        client.send(&text);
        let mut last = client.line();
        if last.starts_with("@@TRAX:state") {
            last = client.line();
        }
        assert!(last.starts_with("@@TRAX:quit \"trax.reason="), "{said}: {last}");
        let (well, errors) = client.end();
        assert!(!well && errors.contains(said) && !errors.contains("panicked"), "{said}: {errors}");
    }
    // A configuration that is none ends before hello.
    let output = place.run(["trax", "-c", "none"]);
    assert!(!output.status.success() && output.stdout.is_empty());
}
