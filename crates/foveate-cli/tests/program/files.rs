//! Video files as users have them: times, the shape of pixels, damage, folders of a camera. Oracle: the programs ffmpeg and ffprobe.

use foveate_testing::need;
use std::path::Path;
use std::process::Command;

use crate::place::{Place, errors, json, printed};

/// Makes a short video of the test picture.
fn make(path: &Path, options: &[&str]) -> Result<(), String> {
    let source = "-v error -y -f lavfi -i testsrc2=size=96x72:rate=25:duration=1.2";
    let made = Command::new("ffmpeg").args(source.split(' ')).args(options).arg(path).status();
    let made = made.is_ok_and(|status| status.success());
    made.then_some(()).ok_or_else(|| format!("ffmpeg that writes {}", path.display()))
}

/// A field of each frame, or of the stream, as ffprobe reports it.
fn probed(path: &Path, field: &str) -> Vec<String> {
    let args = ["-v", "error", "-select_streams", "v:0", "-show_entries", field, "-of", "csv=p=0"];
    let run = Command::new("ffprobe").args(args).arg(path).output().expect("it lies beside ffmpeg");
    let text = String::from_utf8_lossy(&run.stdout);
    text.lines().map(|line| line.trim_end_matches(',').to_owned()).filter(|line| !line.is_empty()).collect()
}

/// Seconds from the first.
fn from_first(stamps: Vec<String>) -> Vec<f64> {
    let all: Vec<f64> = stamps.iter().map(|stamp| stamp.parse().expect("seconds")).collect();
    all.iter().map(|time| time - all[0]).collect()
}

#[test]
fn times_and_pixels_are_those_that_players_show() {
    let place = Place::new();
    let path = place.path("a.mkv");
    let filter = "setsar=4/3,select='not(eq(mod(n,7),2)+eq(mod(n,7),3))'";
    need!(make(&path, &["-vf", filter, "-vsync", "vfr", "-c:v", "mpeg4", "-q:v", "3"]));
    let run = place.done("track a.mkv -c c.toml --init 30,20,30,30 --no-report -o out".split(' '));
    let first = errors(&run).lines().next().unwrap_or_default().to_owned();
    assert!(first.contains("96 x 72") && first.contains("128 x 72") && first.contains("1.3333"), "{first}");
    let table = place.text("out/track.csv");
    let column = table.lines().next().expect("names").split(',').position(|name| name == "time").expect("a column");
    let times: Vec<f64> =
        table.lines().skip(1).map(|row| row.split(',').nth(column).expect("it").parse().expect("seconds")).collect();
    let near = |found: &[f64], wanted: &[f64]| {
        found.len() == wanted.len() && found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 2e-6)
    };
    let stamps = "frame=best_effort_timestamp_time";
    let wanted = from_first(probed(&path, stamps));
    assert!(wanted.len() > 15 && near(&times, &wanted), "{times:?}, expected {wanted:?}");
    let film = place.path("out/annotated.mp4");
    let played = from_first(probed(&film, stamps));
    assert!(near(&played, &wanted), "annotated.mp4: {played:?}, expected {wanted:?}");
    // The picture, and a map of the same size beside it.
    place.done(["look", "a.mkv", "--map", "saliency", "--frame", "1", "--out", "look.png"]);
    let png = place.read("look.png");
    assert_eq!(png[16..24], [256u32.to_be_bytes(), 72u32.to_be_bytes()].concat());
}

#[test]
fn damage_is_reported_wherever_frames_are_counted() {
    let place = Place::new();
    let path = place.path("a.mkv");
    need!(make(&path, &["-c:v", "mpeg4", "-q:v", "2", "-g", "10"]));
    let args = ["a.mkv", "--init", "30,20,30,30", "--json"];
    let sound = place.tracked("sound", &args);
    assert_eq!(json(&sound)["damaged_frames"], 0);
    assert!(place.json("sound/run.json")["damaged"].is_null());
    let mut bytes = place.read("a.mkv");
    let at = bytes.len() / 2;
    bytes[at..at + 100].fill(0);
    std::fs::write(&path, bytes).expect("a writable folder");
    let summary = json(&place.track("out", &args));
    let damaged = summary["damaged_frames"].as_u64().expect("a number");
    assert!(damaged > 0 && summary["error"].is_null(), "{summary}");
    assert!(summary["warnings"][0].as_str().is_some_and(|text| text.contains("damaged")), "{summary}");
    assert!(place.json("out/run.json")["damaged"].as_u64() > Some(0));
    let plain = place.track("plain", &args[..3]);
    assert!(printed(&plain).contains("Warning: The video is damaged"), "{}", errors(&plain));
    let lines = place.track("lines", &[&args[..3], &["--stream"]].concat());
    let last = printed(&lines).lines().last().and_then(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    assert!(last.expect("a line")["damaged"].as_u64() > Some(0));
}

/// What lies beside pictures or in their place is named, with what to give.
#[test]
fn folders_of_videos_differ_from_folders_of_frames() {
    let place = Place::new();
    place.write("video/img/MVI_1.MP4", "x");
    let text = place.failure(&["video"]);
    assert!(text.contains("pictures and 1 video") && text.contains("give video/") && text.contains("/*.MP4"), "{text}");
    place.write("clips/a.mp4", "x");
    let text = place.failure(&["clips", "--init", "1,1,9,9"]);
    assert!(text.contains("found 1 video") && text.contains("give clips/*.mp4"), "{text}");
    std::fs::remove_file(place.path("video/img/MVI_1.MP4")).expect("ours");
    std::fs::remove_file(place.path("video/groundtruth_rect.txt")).expect("ours");
    let text = place.failure(&["video"]);
    assert!(text.contains("foveate pick video") && text.contains("--init x,y,w,h"), "{text}");
}

/// TIFF of 16 bits, one picture a file and one file of all pictures, and BMP: the boxes of the same pictures as PNG. Of other kinds the error
/// has the command that converts them.
#[test]
fn pictures_of_every_kind_give_the_same_boxes() {
    let place = Place::new();
    let ffmpeg = |args: &[&str]| {
        let made = Command::new("ffmpeg").args(["-v", "error"]).args(args).current_dir(place.path("")).status();
        made.is_ok_and(|status| status.success()).then_some(()).ok_or("ffmpeg that writes TIFF")
    };
    for folder in ["grey", "tiff", "bmp", "ppm"] {
        std::fs::create_dir(place.path(folder)).expect("a writable folder");
    }
    let frames = ["-i", "video/img/%04d.png", "-pix_fmt", "gray"];
    need!(ffmpeg(&[&frames[..], &["grey/%04d.png"]].concat()));
    need!(ffmpeg(&["-i", "grey/%04d.png", "-pix_fmt", "gray16le", "tiff/%04d.tif"]));
    need!(ffmpeg(&["-i", "grey/%04d.png", "-pix_fmt", "gray", "bmp/%04d.bmp"]));
    need!(ffmpeg(&["-i", "grey/%04d.png", "ppm/%04d.ppm"]));
    let init = ["--init", "41,31,24,24"];
    let boxes = place.boxes("grey-boxes", &[&["grey"][..], &init].concat());
    assert_eq!(place.boxes("bmp-boxes", &[&["bmp"][..], &init].concat()), boxes);
    // Its values are stretched, and rounded once more than those of 8 bits.
    let close = |other: &[u8]| {
        let numbers = |text: &[u8]| {
            String::from_utf8_lossy(text).split([',', '\n']).filter_map(|n| n.parse::<f64>().ok()).collect::<Vec<_>>()
        };
        let (a, b) = (numbers(&boxes), numbers(other));
        assert_eq!(a.len(), b.len());
        a.iter().zip(&b).for_each(|(a, b)| assert!((a - b).abs() < 3.0, "{a} {b}"));
    };
    close(&place.boxes("tiff-boxes", &[&["tiff"][..], &init].concat()));
    let text = place.failure(&[&["ppm"][..], &init].concat());
    let command = text.trim().rsplit_once("ffmpeg ").expect("a command").1.replace('\'', "");
    let words: Vec<&str> = command.split(' ').collect();
    let done = Command::new("ffmpeg").args(["-v", "error"]).args(words).current_dir(place.path("ppm")).status();
    assert!(done.is_ok_and(|status| status.success()), "{command}");
}
