//! Measured motion through messages equals that of `foveate measure`.

use foveate_testing::fall;
use serde_json::{Value, json};

use crate::place::{Place, printed};
use crate::served::Server;
use crate::{open, place};

/// A folder with the pictures of a fall.
fn falling() -> Place {
    let dir = place();
    let folder = dir.path("seen/fall");
    std::fs::create_dir_all(&folder).expect("a writable folder");
    let [w, h] = fall::SIZE.map(|side| side as u32);
    for t in 0..fall::FRAMES {
        let file = folder.join(format!("{t:03}.png"));
        image::save_buffer(&file, &fall::picture(t), w, h, image::ExtendedColorType::L8).expect("a picture");
    }
    dir
}

#[test]
fn the_page_measures_what_the_program_measures() {
    let dir = falling();
    let server = Server::of(dir.path(""), "seen");
    let session = open(&server, "0/fall")["session"].clone();
    let ask = |message: Value| server.answer(message);
    let options = json!({ "ruler": "61,41,61,281=200.0+-0.1cm", "origin": "201.25,41", "fps": "60+-0.1", "angle": "-0.5", "fit": "parabola:y:0.05-0.6" });
    let measure = |files: bool| json!({ "op": "measure", "session": session, "options": options, "files": files });
    let (status, none) = server.ask(measure(false));
    assert!(status == 400 && none["error"].as_str().is_some_and(|e| e.contains("draw a box")), "{none}");
    ask(
        json!({ "op": "start", "session": session, "frame": 1, "box": fall::bbox(0), "config": "natural-fast", "policy": null, "seed": 4 }),
    );
    let (status, few) = server.ask(measure(false));
    assert!(status == 400 && few["error"].as_str().is_some_and(|e| e.contains("at least 5")), "{few}");
    ask(json!({ "op": "step", "session": session, "frames": 1 }));
    // While it tracks, of the frames so far.
    while ask(json!({ "op": "step", "session": session, "frames": 5 }))["targets"][0]["ended"] != true {
        let (status, answer) = server.ask(measure(false));
        assert!(status == 200 || answer["error"].as_str().is_some_and(|e| e.contains("at least 5")), "{answer}");
    }
    let answer = ask(measure(false));
    assert_eq!((&answer["unit"], answer["frames"].as_array().map(Vec::len)), (&json!("m"), Some(fall::FRAMES)));
    let g = answer["fit"]["values"][3].as_str().expect("g");
    let value: f64 = g.split(' ').nth(2).and_then(|n| n.parse().ok()).expect("a number");
    assert!(g.starts_with("g = ") && (value - fall::G).abs() < 0.15, "{g}");
    // The files are those of the command, byte for byte; the charts have their numbers.
    let command = answer["command"].as_str().expect("a line").to_owned();
    let output = dir.done(command.split(' ').skip(1).chain(["--out", "out", "--no-video", "--no-report"]));
    assert!(printed(&output).contains(g), "{g}: {output:?}");
    let files = ask(measure(true));
    for file in files["files"].as_array().expect("files") {
        let [name, text] = ["name", "text"].map(|key| file[key].as_str().expect("text"));
        let theirs = dir.text(&format!("out/{name}"));
        assert!(text == theirs, "{name}: the page's\n{text}\nthe program's\n{theirs}");
        if name == "measure.csv" {
            let column = |k: usize| -> Vec<f64> {
                text.lines().skip(1).map(|l| l.split(',').nth(k).and_then(|n| n.parse().ok()).expect("x")).collect()
            };
            let numbers = |value: &Value| serde_json::from_value::<Vec<f64>>(value.clone()).expect("numbers");
            assert_eq!(numbers(&answer["times"]), column(1));
            for i in 0..6 {
                assert_eq!(numbers(&answer["motion"][i]["value"]), column(2 + i));
                assert_eq!(numbers(&answer["motion"][i]["sd"]), column(8 + i));
            }
        }
    }
    assert_eq!(files["files"].as_array().map(Vec::len), Some(4));
    for (name, wrong) in
        [("ruler", json!("1,1,1,1=1m")), ("fps", json!("nan")), ("angle", json!(5)), ("lens", json!("/etc/passwd"))]
    {
        let message = json!({ "op": "measure", "session": session, "options": { name: wrong } });
        let (status, answer) = server.ask(&message);
        assert!(status == 400 && answer["error"].as_str().is_some_and(|e| !e.is_empty()), "{name}: {answer}");
    }
    assert_eq!(server.ask(json!({ "op": "measure", "session": session, "target": 1 })).0, 400);
}
