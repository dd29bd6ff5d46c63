//! The page's tracker as native code, with the same frames and messages as the page has, to compare speeds and boxes with:
//! `follow [--portable] CONFIG x,y,w,h FRAMES FILE...` prints a line of JSON. With `--portable` before these, by portable code alone.
#![forbid(unsafe_code)]

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use foveate_kernels::Level;
use foveate_web::{App, Paths};
use serde_json::{Value, json};

fn main() {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.first().is_some_and(|first| first == "--portable") {
        arguments.remove(0);
        assert!(Level::Portable.at_most(), "no kernel was used before");
    }
    let [config, init, frames, files @ ..] = &*arguments else {
        eprintln!("usage: follow [--portable] CONFIG x,y,w,h FRAMES FILE...");
        std::process::exit(2);
    };
    let (init, frames): (Vec<f64>, usize) =
        (init.split(',').map(|n| n.parse().expect("a number")).collect(), frames.parse().expect("a number"));
    let paths: Vec<PathBuf> = files.iter().map(PathBuf::from).collect();
    let given: Vec<Value> = paths
        .iter()
        .enumerate()
        .map(|(id, path)| {
            let size = std::fs::metadata(path).expect("a file").len();
            json!({ "id": id, "name": path.file_name().map(|name| name.to_string_lossy()), "size": size })
        })
        .collect();
    println!("{}", follow(App::new(Arc::new(Paths(paths))), config, &init, frames, &given));
}

fn follow(mut app: App, config: &str, init: &[f64], frames: usize, files: &[Value]) -> Value {
    let ask = |app: &mut App, message: Value| -> Value {
        let answer: Value = serde_json::from_str(&app.ask(&message.to_string())).expect("JSON");
        assert!(answer["error"].is_null(), "{}", answer["error"]);
        answer
    };
    let opened = ask(&mut app, json!({ "op": "open", "name": "video", "files": files, "truth": null }));
    let (session, count) = (opened["session"].as_u64().expect("a number"), opened["frames"].as_u64());
    let most = frames.min(count.expect("a file knows its frames") as usize);
    let pixels: Vec<Vec<u8>> = (1..=most).map(|k| app.picture(session, k).expect("a frame")).collect();
    // Of each frame the best of five rounds: other work on the machine disturbs less.
    let (mut best, mut boxes) = (vec![f64::INFINITY; most], vec![]);
    best[0] = 0.0;
    for _ in 0..5 {
        let live =
            json!({ "op": "live", "name": "pushed", "width": opened["width"], "height": opened["height"], "rate": 30 });
        let id = ask(&mut app, live)["session"].as_u64().expect("a number");
        app.push(id, &pixels[0], 0.0, 0);
        ask(&mut app, json!({ "op": "start", "session": id, "frame": 1, "box": init, "config": config }));
        boxes = vec![json!(init)];
        for (k, pixels) in pixels.iter().enumerate().skip(1) {
            app.push(id, pixels, k as f64 / 30.0, 0);
            let began = Instant::now();
            let answer = ask(&mut app, json!({ "op": "step", "session": id, "frames": 1 }));
            best[k] = best[k].min(began.elapsed().as_secs_f64());
            boxes.push(answer["rows"][0]["box"].clone());
        }
        ask(&mut app, json!({ "op": "close", "session": id }));
    }
    json!({ "boxes": boxes, "frames": most, "tracking": best.iter().sum::<f64>() })
}
