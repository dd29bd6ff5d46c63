//! Streams that were named, and frames that a page pushes.

use foveate_testing::{ffmpeg, need};
use serde_json::{Value, json};

use crate::served::{self, FRAMES, Server, iou, nearest, parts, truth};
use crate::{boxes_of, open, place};

/// Frames of the clip as yuv4mpeg over HTTP, for ever, 50 a second.
fn sender() -> String {
    use std::io::{Read, Write};
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = format!("http://user:secret@{}/live.y4m", listener.local_addr().expect("an address"));
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            std::thread::spawn(move || {
                let _ = stream.read(&mut [0; 4096]);
                let (w, h) = (served::SIZE.width, served::SIZE.height);
                let head = format!(
                    "HTTP/1.0 200 OK\r\nContent-Type: video/x-yuv4mpeg\r\n\r\nYUV4MPEG2 W{w} H{h} F50:1 Ip A1:1 Cmono\n"
                );
                let mut sent = stream.write_all(head.as_bytes());
                for t in 0.. {
                    // To and fro.
                    let k = t % (2 * FRAMES);
                    let frame = served::picture(if k < FRAMES { k } else { 2 * FRAMES - 1 - k });
                    sent = sent.and_then(|()| stream.write_all(b"FRAME\n")).and_then(|()| stream.write_all(&frame));
                    if sent.is_err() {
                        break;
                    }
                    std::thread::sleep(std::time::Duration::from_millis(20));
                }
            });
        }
    });
    address
}

#[test]
fn a_stream_that_was_named_is_followed() {
    need!(ffmpeg());
    let dir = place();
    let address = sender();
    let server = Server::of(dir.path(""), &address);
    let (_, hello) = server.ask(r#"{"op":"hello"}"#);
    assert_eq!(
        (&hello["roots"][0]["kind"], hello["roots"][0]["name"].as_str().map(|n| n.contains("secret"))),
        (&json!("stream"), Some(false))
    );
    let opened = open(&server, "0");
    let session = &opened["session"];
    assert_eq!((&opened["live"], &opened["width"], &opened["frames"]), (&json!(true), &json!(320), &Value::Null));
    let (status, jpeg) = server.get(&format!("/frame?session={session}&frame=1"));
    assert_eq!(status, 200);
    let at = nearest(&jpeg);
    let message = json!({ "op": "start", "session": session, "frame": 1, "box": truth(at), "config": "natural-fast", "policy": null, "seed": 1 });
    server.answer(&message);
    let mut overlaps = vec![];
    for frame in 2..60 {
        let answer = server.answer(json!({ "op": "step", "session": session, "frames": 1 }));
        let boxes = boxes_of(&answer["targets"][0]);
        assert_eq!(boxes.len(), 1);
        assert!(answer["missed"].is_u64());
        let (_, jpeg) = server.get(&format!("/frame?session={session}&frame={frame}"));
        overlaps.push(iou(boxes[0], truth(nearest(&jpeg))));
    }
    let mean = overlaps.iter().sum::<f64>() / overlaps.len() as f64;
    assert!(mean >= 0.7, "{mean}: {overlaps:?}");
    // A frame that has gone, a correction of the last one, results as they are.
    assert_eq!(server.get(&format!("/frame?session={session}&frame=3")).0, 404);
    let correct = json!({ "op": "correct", "session": session, "frame": 59, "box": truth(0) });
    server.answer(&correct);
    server.answer(json!({ "op": "save", "session": session, "film": true, "report": true }));
    let saved = server.answer(json!({ "op": "saved", "session": session }));
    assert_eq!(saved["files"], json!(["boxes.txt", "track.csv", "track.jsonl"]));
    let (status, text) = server.get(&format!("/file?session={session}&name=track.jsonl"));
    assert_eq!((status, String::from_utf8_lossy(&text).lines().count()), (200, 59));
    // Addresses that were not named are not opened.
    for path in ["1", &address, "0/live", "/dev/video0"] {
        assert_eq!(server.ask(json!({ "op": "open", "path": path })).0, 400, "{path}");
    }
    server.answer(json!({ "op": "close", "session": session }));
}

/// A file of the clip by HTTP, with its length: every frame is tracked, and the end is reported.
#[test]
fn a_file_by_http_is_played_to_its_end() {
    need!(ffmpeg());
    let (dir, address) = (place(), served::by_http());
    let server = Server::of(dir.path(""), &address);
    let opened = open(&server, "0");
    let session = &opened["session"];
    let (_, jpeg) = server.get(&format!("/frame?session={session}&frame=1"));
    assert_eq!(nearest(&jpeg), 0, "it begins with the first frame");
    let message = json!({ "op": "start", "session": session, "frame": 1, "box": truth(0), "config": "natural-fast", "policy": null, "seed": 1 });
    server.answer(&message);
    let (mut frame, mut overlaps) = (1, vec![]);
    loop {
        let (status, answer) = server.ask(json!({ "op": "step", "session": session, "frames": 1 }));
        assert_eq!((status, &answer["missed"]), (200, &json!(0)), "{answer}");
        let target = &answer["targets"][0];
        for found in boxes_of(target) {
            overlaps.push(iou(found, truth(frame)));
            frame += 1;
        }
        if target["ended"] == json!(true) {
            break;
        }
    }
    assert_eq!(frame, FRAMES);
    let mean = overlaps.iter().sum::<f64>() / overlaps.len() as f64;
    assert!(mean >= 0.7, "{mean}: {overlaps:?}");
    assert_eq!(server.get(&format!("/frame?session={session}&frame={}", FRAMES + 1)).0, 404);
}

/// Frames that a page pushes, as it does with the browser's camera.
#[test]
fn pushed_frames_are_followed() {
    let dir = place();
    let server = Server::start(dir.path(""), &["serve", "seen", "--address", "127.0.0.1:0"]);
    let (_, opened) = server.ask(json!({ "op": "live", "name": "camera", "width": 320, "height": 240, "rate": 30 }));
    let session = &opened["session"];
    let push = |t: usize, picture: &[u8]| {
        let host = format!("127.0.0.1:{}", server.port);
        let query = format!("session={session}&time={}&missed=1", t as f64 / 30.0);
        let head = format!(
            "POST /push?{query} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nContent-Type: image/jpeg\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
            picture.len()
        );
        parts(&server.send(&[head.as_bytes(), picture].concat()))
    };
    let jpeg = |t: usize, w: usize| {
        let image = foveate::scene::Image::from_grey8(w, 240, &served::picture(t)[..w * 240]).expect("as many pixels");
        foveate::video::encode_jpeg(&image, 92)
    };
    let mut overlaps = vec![];
    for t in 0..FRAMES {
        let (status, body) = push(t, &jpeg(t, 320));
        assert_eq!(
            (status, serde_json::from_slice::<Value>(&body).expect("JSON")["frame"].as_u64()),
            (200, Some(t as u64 + 1))
        );
        let message = match t {
            0 => {
                json!({ "op": "start", "session": session, "frame": 1, "box": truth(0), "config": "natural-fast", "policy": null, "seed": 1 })
            }
            _ => json!({ "op": "step", "session": session, "frames": 1 }),
        };
        let answer = server.answer(&message);
        if t == 1 {
            // Without a new frame there is no result, and the track goes on.
            let (status, none) = server.ask(&message);
            let target = &none["targets"][0];
            assert_eq!((status, &target["rows"], &target["ended"]), (200, &json!([]), &json!(false)), "{none}");
        }
        if t > 0 {
            overlaps.push(iou(boxes_of(&answer["targets"][0])[0], truth(t)));
        }
    }
    let mean = overlaps.iter().sum::<f64>() / overlaps.len() as f64;
    assert!(mean >= 0.7, "{mean}: {overlaps:?}");
    let (_, text) = server.get(&format!("/file?session={session}&name=track.jsonl"));
    let last: Value =
        serde_json::from_str(String::from_utf8_lossy(&text).lines().last().expect("lines")).expect("JSON");
    assert_eq!((&last["frame"], &last["dropped"]), (&json!(FRAMES), &json!(FRAMES)));
    // Of another size, no picture, too many bytes, into a video.
    assert_eq!((push(0, &jpeg(0, 160)).0, push(0, b"nothing").0, push(0, &vec![0; 3 << 20]).0), (400, 400, 413));
    open(&server, "0/clip");
}

#[test]
fn errors_do_not_tell_the_password_of_a_stream() {
    let dir = place();
    // Nobody sends there, whether ffmpeg is installed or not.
    let server =
        Server::start(dir.path(""), &["serve", "rtsp://user:secret@127.0.0.1:9/live", "--address", "127.0.0.1:0"]);
    let (status, answer) = server.ask(r#"{"op":"open","path":"0"}"#);
    let said = answer["error"].as_str().unwrap_or_default();
    assert!(status == 400 && said.contains("rtsp://127.0.0.1:9/live") && !said.contains("secret"), "{answer}");
}
