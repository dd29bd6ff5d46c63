//! Tracks through messages: corrections, several targets, files; and `foveate pick`.

use serde_json::{Value, json};

use crate::place::Place;
use crate::served::{FRAMES, Server, iou, truth};
use crate::{boxes_of, open, place};

fn tracked(server: &Server, session: &Value) -> Vec<[f64; 4]> {
    let mut boxes = vec![];
    loop {
        let answer = server.answer(json!({ "op": "step", "session": session, "frames": 200 }));
        let target = &answer["targets"][0];
        boxes.extend(boxes_of(target));
        if target["ended"] == true {
            return boxes;
        }
    }
}

/// Where a video is damaged: what was tracked before it comes to the page, with the reason; then the reason alone.
#[test]
fn frames_before_damage_reach_the_page() {
    let dir = place();
    let bytes = dir.read("seen/clip/006.png");
    dir.write("seen/clip/006.png", &bytes[..bytes.len() / 2]);
    let server = Server::of(dir.path(""), "seen");
    let session = &open(&server, "0/clip")["session"];
    let start = json!({ "op": "start", "session": session, "frame": 1, "box": truth(0), "config": "natural-fast" });
    server.answer(&start);
    let step = json!({ "op": "step", "session": session, "frames": 200 });
    let mut frames = 1;
    let problem = loop {
        let answer = server.answer(&step);
        frames += boxes_of(&answer["targets"][0]).len();
        if let Some(problem) = answer["problem"].as_str() {
            break problem.to_owned();
        } else if frames == 6 {
            break String::new();
        }
    };
    assert_eq!(frames, 6);
    // Others that are opened and left close each other.
    (0..6).for_each(|_| drop(open(&server, "0/clip")));
    let (status, answer) = server.ask(&step);
    assert!(status == 400 && answer["error"].as_str().is_some_and(|error| error.contains("006.png")), "{answer}");
    assert!(problem.is_empty() || answer["error"] == problem, "{problem}");
}

#[test]
fn messages_track_correct_and_save() {
    let dir = place();
    let server = Server::of(dir.path(""), "seen");
    let opened = open(&server, "0/clip");
    assert_eq!((&opened["width"], &opened["frames"], &opened["truth"][3][0]), (&json!(320), &json!(36), &json!(109.0)));
    let session = &opened["session"];
    let (status, jpeg) = server.get(&format!("/frame?session={session}&frame=36"));
    assert!(status == 200 && jpeg.starts_with(b"\xff\xd8"));
    assert_eq!(server.get(&format!("/frame?session={session}&frame=37")).0, 404);
    // A click on the target proposes its box, in the first frame as in others.
    for frame in [1, 5] {
        let [x, y, w, h] = truth(frame - 1);
        let message = json!({ "op": "propose", "session": session, "frame": frame, "at": [x + w / 2.0, y + h / 2.0] });
        let (_, answer) = server.ask(&message);
        let bbox: [f64; 4] = serde_json::from_value(answer["box"].clone()).expect("a box");
        assert!(iou(bbox, truth(frame - 1)) > 0.3, "frame {frame}: {answer}");
    }
    let start = |config: &str, bbox: [f64; 4]| {
        server.ask(json!({ "op": "start", "session": session, "frame": 1, "box": bbox, "config": config, "policy": null, "seed": 4 }))
    };
    for message in [
        json!({ "op": "start", "session": session, "frame": 0, "box": truth(0), "config": "natural" }),
        json!({ "op": "correct", "session": session, "frame": 0, "box": truth(0) }),
        json!({ "op": "picked", "session": session, "frame": 0, "box": truth(0), "config": "natural" }),
        json!({ "op": "propose", "session": session, "frame": 0 }),
    ] {
        let (status, answer) = server.ask(&message);
        assert!(status == 400 && answer.to_string().contains("frames count from 1"), "{message}: {answer}");
    }
    for config in ["/etc/passwd", "../secret.mp4", "multi", "nothing"] {
        assert_eq!(start(config, truth(0)).0, 400, "{config}");
    }
    assert!(start("natural-fast", [0.0, 0.0, 1e9, 5.0]).1["error"].as_str().is_some_and(|e| e.contains("320 x 240")));
    assert_eq!(start("natural-fast", truth(0)).0, 200);
    let boxes = tracked(&server, session);
    assert_eq!(boxes.len(), FRAMES - 1);
    let mean = boxes.iter().enumerate().map(|(t, b)| iou(*b, truth(t + 1))).sum::<f64>() / boxes.len() as f64;
    assert!(mean >= 0.7, "{mean}");
    let [x, y, w, h] = truth(19);
    let correction = json!({ "op": "correct", "session": session, "frame": 20, "box": [x + 3.0, y, w - 3.0, h] });
    server.answer(&correction);
    let rest = tracked(&server, session);
    assert_eq!(rest.len(), FRAMES - 20);
    // The saved results equal those of the printed `foveate track` command, and those on the page.
    let (_, command) = server.ask(json!({ "op": "command", "session": session }));
    let command = command["command"].as_str().expect("a line").to_owned();
    assert_eq!(
        command,
        "foveate track seen/clip --init 101,91,48,48 --reinit 20:161,110,45,48 --config natural-fast --seed 4"
    );
    server.answer(json!({ "op": "save", "session": session, "film": true, "report": true }));
    let files = loop {
        let answer = server.answer(json!({ "op": "saved", "session": session }));
        if let Some(files) = answer["files"].as_array() {
            break files.clone();
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    };
    assert_eq!(files, ["boxes.txt", "track.csv", "annotated.mp4", "report.html"]);
    let saved = |name: &str| server.get(&format!("/file?session={session}&name={name}"));
    assert_eq!(saved("run.json").0, 404);
    dir.done(command.split(' ').skip(1).chain(["--out", "out"]));
    for name in ["boxes.txt", "annotated.mp4"] {
        let (status, bytes) = saved(name);
        assert!(status == 200 && bytes == dir.read(&format!("out/{name}")), "{name}");
    }
    let text = String::from_utf8(saved("boxes.txt").1).expect("text");
    let shown: Vec<[f64; 4]> = std::iter::once(truth(0))
        .chain(boxes[..18].iter().copied())
        .chain([[x + 3.0, y, w - 3.0, h]])
        .chain(rest)
        .collect();
    assert_eq!(text.lines().count(), FRAMES);
    for (line, [x, y, w, h]) in text.lines().zip(shown) {
        let numbers: Vec<f64> = line.split(',').map(|n| n.parse().expect("a number")).collect();
        assert!(
            numbers.iter().zip([x + 1.0, y + 1.0, w, h]).all(|(a, b)| (a - b).abs() < 0.01),
            "{line}: {x},{y},{w},{h}"
        );
    }
    // Four videos are open at most, and none leaves anything behind. Of those that are tracked the oldest is closed.
    for _ in 0..4 {
        let session = &open(&server, "0/clip")["session"];
        let start = json!({ "op": "start", "session": session, "frame": 1, "box": truth(0), "config": "natural-fast" });
        server.answer(&start);
    }
    assert_eq!(server.ask(json!({ "op": "step", "session": session, "frames": 1 })).0, 400);
    assert!(leftovers(&dir).is_empty(), "{:?}", leftovers(&dir));
}

#[test]
fn the_folder_of_a_killed_server_is_removed() {
    let dir = place();
    let save = || {
        let server = Server::of(dir.path(""), "seen");
        let session = open(&server, "0/clip")["session"].clone();
        let start = json!({ "op": "start", "session": session, "frame": 1, "box": truth(0), "config": "natural-fast", "policy": null, "seed": 4 });
        server.answer(start);
        server.answer(json!({ "op": "save", "session": session, "film": true, "report": false }));
        while leftovers(&dir).is_empty() {
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        server
    };
    drop(save());
    let killed = leftovers(&dir);
    let _server = save();
    while leftovers(&dir) == killed {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    assert!(leftovers(&dir).len() == 1 && !leftovers(&dir).contains(&killed[0]), "{killed:?}");
}

/// Writing results takes a thread for as long as the track is; the page is answered meanwhile, and may change its mind.
#[test]
fn one_thread_answers_while_results_are_written() {
    let dir = place();
    let args = ["serve", "seen", "--address", "127.0.0.1:0", "--config", "natural", "--threads", "1"];
    let server = Server::start(dir.path(""), &args);
    let session = open(&server, "0/clip")["session"].clone();
    let ask = |message: Value| server.answer(message);
    ask(
        json!({ "op": "start", "session": session, "frame": 1, "box": truth(0), "config": "natural", "policy": null, "seed": 4 }),
    );
    tracked(&server, &session);
    ask(json!({ "op": "save", "session": session, "film": true, "report": true }));
    let answer = ask(json!({ "op": "saved", "session": session }));
    assert!(answer["frames"].as_u64().is_some_and(|n| n < FRAMES as u64) && answer["files"].is_null(), "{answer}");
    ask(json!({ "op": "close", "session": session }));
    for _ in 0..200 {
        if leftovers(&dir).is_empty() {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    panic!("{:?}", leftovers(&dir));
}

/// Two boxes in the same frames: each has the same results as alone.
#[test]
fn several_targets_are_followed_at_once() {
    let dir = place();
    let server = Server::of(dir.path(""), "seen");
    let session = open(&server, "0/clip")["session"].clone();
    let ask = |message: Value| server.answer(message);
    let start = |target: usize, frame: usize, bbox: [f64; 4]| json!({ "op": "start", "session": session, "target": target, "frame": frame, "box": bbox, "config": "natural-fast", "policy": null, "seed": 4 });
    assert_eq!(server.ask(start(1, 1, truth(0))).0, 400, "the first one comes first");
    ask(start(0, 1, truth(0)));
    let alone = tracked(&server, &session);
    ask(start(0, 1, truth(0)));
    // As many as there is time for.
    let some = ask(json!({ "op": "step", "session": session, "frames": 12 }));
    // Another one, later, on something else; it catches up, and both continue together.
    let second = [40.0, 30.0, 50.0, 40.0];
    ask(start(1, 5, second));
    let mut all = [boxes_of(&some["targets"][0]), vec![]];
    for _ in 0..FRAMES {
        let answer = ask(json!({ "op": "step", "session": session, "frames": 3 }));
        (0..2).for_each(|k| all[k].extend(boxes_of(&answer["targets"][k])));
        if answer["targets"].as_array().expect("two").iter().all(|target| target["ended"] == true) {
            break;
        }
    }
    assert_eq!(all[0], alone, "another target changes nothing");
    assert_eq!(all[1].len(), FRAMES - 5);
    let correction = json!({ "op": "correct", "session": session, "target": 1, "frame": 20, "box": second });
    assert_eq!(ask(correction)["rows"][0]["frame"], 20);
    let mut rest = [0, 0];
    while rest[1] < FRAMES - 20 {
        let answer = ask(json!({ "op": "step", "session": session, "frames": 100 }));
        (0..2).for_each(|k| rest[k] += boxes_of(&answer["targets"][k]).len());
    }
    assert_eq!(rest, [0, FRAMES - 20]);
    ask(json!({ "op": "step", "session": session, "frames": 1 }));
    // The commands, and the files of each.
    let command = ask(json!({ "op": "command", "session": session }))["command"].as_str().expect("lines").to_owned();
    let lines: Vec<&str> = command.lines().collect();
    assert!(lines.len() == 2 && lines[1].contains("--from 5 --init 41,31,50,40 --reinit 20:41,31,50,40"), "{command}");
    ask(json!({ "op": "save", "session": session, "film": false, "report": true }));
    let files = loop {
        if let Some(files) = ask(json!({ "op": "saved", "session": session }))["files"].as_array() {
            break files.clone();
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    };
    let names =
        ["boxes.txt", "track.csv", "report.html", "target-2-boxes.txt", "target-2-track.csv", "target-2-report.html"];
    assert_eq!(files, names);
    for (name, lines) in [("boxes.txt", FRAMES), ("target-2-boxes.txt", FRAMES - 4)] {
        let (status, bytes) = server.get(&format!("/file?session={session}&name={name}"));
        assert_eq!((status, String::from_utf8_lossy(&bytes).lines().count()), (200, lines), "{name}");
    }
    assert_eq!(server.get(&format!("/file?session={session}&name=target-3-boxes.txt")).0, 404);
    ask(json!({ "op": "remove", "session": session, "target": 0 }));
    assert_eq!(
        ask(json!({ "op": "command", "session": session }))["command"].as_str().map(|c| c.lines().count()),
        Some(1)
    );
    (1..8).for_each(|target| drop(ask(start(target, 1, truth(0)))));
    assert_eq!(server.ask(start(8, 1, truth(0))).0, 400, "eight at most");
}

/// Folders of results that were not removed.
fn leftovers(dir: &Place) -> Vec<String> {
    dir.names("").into_iter().filter(|name| name.starts_with(".foveate-serve.")).collect()
}

#[test]
fn pick_prints_the_command_and_ends() {
    let dir = place();
    let mut server = Server::start(dir.path(""), &["pick", "seen/clip"]);
    let session = open(&server, "0")["session"].clone();
    let message = json!({ "op": "picked", "session": session, "frame": 4, "box": truth(3), "config": "natural", "policy": "hedge" });
    let (status, answer) = server.ask(&message);
    let line = "foveate track seen/clip --from 4 --init 110,94,48,48 --policy hedge";
    assert_eq!((status, answer["command"].as_str()), (200, Some(line)));
    let mut printed = String::new();
    std::io::Read::read_to_string(&mut server.child.stdout.take().expect("a pipe"), &mut printed).expect("text");
    assert_eq!(printed.trim_end(), line);
    assert!(server.child.wait().expect("it ends").success());
    // Interrupted before it has printed a command, it has failed.
    let mut server = Server::start(dir.path(""), &["pick", "seen/clip"]);
    let interrupt = std::process::Command::new("kill").args(["-INT", &server.child.id().to_string()]).status();
    assert!(interrupt.is_ok_and(|status| status.success()));
    assert_eq!(server.child.wait().expect("it ends").code(), Some(130));
}

#[test]
fn pick_is_for_files() {
    Place::empty().refuses(["pick", "rtsp://127.0.0.1:9/live"], "foveate serve");
}
