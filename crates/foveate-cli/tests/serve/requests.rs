//! `foveate serve`: whom it answers, what it gives away, and what its messages do.

mod served;

use std::path::Path;

use serde_json::{Value, json};
use served::{FRAMES, Server, clip, iou, parts, truth};

const SECRET: &str = "nobody-may-read-this";
const TOKEN: &str = "0123456789abcdefTOKEN";

/// A folder with a clip that may be seen, and secrets beside it.
fn place() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary folder");
    clip(&dir.path().join("seen/clip"));
    std::fs::write(dir.path().join("secret.mp4"), SECRET).expect("writable");
    std::fs::write(dir.path().join("seen/secret.txt"), SECRET).expect("writable");
    #[cfg(unix)]
    std::os::unix::fs::symlink(dir.path().join("secret.mp4"), dir.path().join("seen/link.mp4")).expect("a link");
    dir
}

struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % n
    }
    fn of<'a>(&mut self, all: &[&'a str]) -> &'a str {
        all[self.below(all.len())]
    }
    fn bytes(&mut self, most: usize) -> Vec<u8> {
        let n = self.below(most);
        (0..n).map(|_| self.below(256) as u8).collect()
    }
}

/// A request that must not be answered with anything but a refusal.
fn malformed(random: &mut Random, port: u16, token: bool) -> Vec<u8> {
    let host = format!("127.0.0.1:{port}");
    let outside = [
        "0/../secret.mp4",
        "0/..",
        "..",
        "0/link.mp4",
        "0/secret.txt",
        "/etc/passwd",
        "0//etc/passwd",
        "0/clip/../../secret.mp4",
        "0/%2e%2e/secret.mp4",
        "0/..%2fsecret.mp4",
        "0/..\\secret.mp4",
        "1/secret.mp4",
        "-1",
        "0/clip/\u{0}",
        "99999999999999999999",
        "0/./../secret.mp4",
        "~",
        "file:///etc/passwd",
        "http://localhost/",
        "rtsp://localhost/",
        "/dev/zero",
        "concat:0/secret.mp4",
        "-",
        "1/",
        "1/..",
        "1/secret.mp4",
        "http://127.0.0.1:9/else",
        "/dev/video0",
        "camera",
    ];
    let path = random.of(&outside).to_owned();
    let good_token = if token { format!("X-Foveate-Token: {TOKEN}\r\n") } else { String::new() };
    let post = |host: &str, more: &str, body: &str| {
        let n = body.len();
        format!(
            "POST /api HTTP/1.1\r\nHost: {host}\r\n{more}Content-Type: application/json\r\nContent-Length: {n}\r\nConnection: close\r\n\r\n{body}"
        )
    };
    let ours = format!("Origin: http://{host}\r\n{good_token}");
    match random.below(15) {
        // Places outside the roots, and what is no video, by messages that are right.
        0 | 1 => post(&host, &ours, &json!({ "op": "open", "path": path }).to_string()).into_bytes(),
        2 => post(&host, &ours, &json!({ "op": "list", "path": path }).to_string()).into_bytes(),
        // In the place of the page.
        3 => {
            let at = random.of(&[
                "/../secret.mp4",
                "/..%2f..%2fsecret.mp4",
                "//etc/passwd",
                "/seen/secret.txt",
                "/%2e%2e/secret.mp4",
                "/file?session=1&name=../secret.mp4",
                "/frame?session=1&frame=-1",
                "/frame?session=99999999999999999999&frame=1",
                "/file?name=%00",
                "/api",
                "*",
                "/frame",
            ]);
            format!("GET {at} HTTP/1.1\r\nHost: {host}\r\n{good_token}Connection: close\r\n\r\n").into_bytes()
        }
        // Another name for this machine: DNS rebinding.
        4 => {
            let other = random.of(&[
                "evil.example",
                "evil.example:80",
                "127.0.0.1.nip.io",
                "localhost.evil.example",
                "",
                "[::1",
                "127.0.0.1@evil.example",
                "127.0.0.1:1",
            ]);
            post(
                &format!("{other}:{port}"),
                &format!("Origin: http://{other}:{port}\r\n{good_token}"),
                r#"{"op":"hello"}"#,
            )
            .into_bytes()
        }
        // Another page.
        5 => {
            let origin = random.of(&[
                "null",
                "http://evil.example",
                "https://127.0.0.1",
                "http://localhost:1",
                "",
                "http://127.0.0.1:1",
            ]);
            post(&host, &format!("Origin: {origin}\r\n{good_token}"), r#"{"op":"hello"}"#).into_bytes()
        }
        6 => post(&host, &good_token, r#"{"op":"hello"}"#).into_bytes(),
        // Large headers and bodies.
        7 => {
            let many = "X-Filler: abc\r\n".repeat(random.below(3000) + 70);
            format!("GET / HTTP/1.1\r\nHost: {host}\r\n{good_token}{many}\r\n").into_bytes()
        }
        8 => {
            let length = random.of(&[
                "65537",
                "99999999",
                "99999999999999999999999",
                "-5",
                "0x10",
                "1, 1",
                "",
                "1\r\nContent-Length: 2",
            ]);
            format!(
                "POST /api HTTP/1.1\r\nHost: {host}\r\n{ours}Content-Length: {length}\r\n\r\n{}",
                "x".repeat(100_000)
            )
            .into_bytes()
        }
        // Messages that are none.
        9 => {
            let body = random.of(&[
                "",
                "{",
                "null",
                "[]",
                "[[[[[[[[[[[[",
                r#"{"op":"nothing"}"#,
                r#"{"op":"step","session":-1,"frames":1}"#,
                r#"{"op":"step","session":1e999,"frames":1}"#,
                r#"{"op":"start","session":7,"frame":1,"box":[1,2,3,4],"config":"natural"}"#,
                r#"{"op":"open","path":5}"#,
                r#"{"op":"hello","more":1}"#,
                r#"{"op":"save","session":1,"film":true,"report":true}"#,
                "\u{0}\u{1}",
                r#"{"op":"propose","session":1,"frame":0,"at":[1e400,2]}"#,
            ]);
            post(&host, &ours, body).into_bytes()
        }
        // Another kind of body, another method, a body in pieces.
        10 => {
            let body = r#"{"op":"hello"}"#;
            match random.below(3) {
                0 => format!("POST /api HTTP/1.1\r\nHost: {host}\r\n{ours}Content-Type: text/plain\r\nContent-Length: 14\r\n\r\n{body}"),
                1 => format!("{} /api HTTP/1.1\r\nHost: {host}\r\n{ours}Content-Length: 0\r\nConnection: close\r\n\r\n", random.of(&["PUT", "DELETE", "OPTIONS", "TRACE", "GET"])),
                _ => format!("POST /api HTTP/1.1\r\nHost: {host}\r\n{ours}Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\ne\r\n{body}\r\n0\r\n\r\n"),
            }
            .into_bytes()
        }
        // Pictures of a camera that is not there, that are none, that are too large, that come from elsewhere.
        11 | 12 => {
            let query = random.of(&[
                "session=1&time=0&missed=0",
                "session=99999999999999999999&time=0&missed=0",
                "session=1&time=NaN&missed=0",
                "session=1&time=0&missed=-1",
                "time=0",
                "",
            ]);
            let kind = random.of(&["image/jpeg", "image/svg+xml", "application/json"]);
            let whose = random.of(&[&*ours, "Origin: http://evil.example\r\n", ""]);
            let length = [0, 700, 70_000, 3_000_000][random.below(4)];
            let head = format!(
                "POST /push?{query} HTTP/1.1\r\nHost: {host}\r\n{whose}Content-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
            );
            let mut bytes = head.into_bytes();
            bytes.extend(b"\xff\xd8\xff\xe0".iter().cycle().take(length.min(200_000)));
            bytes
        }
        // Messages about targets and cameras that are wrong.
        13 => {
            let body = random.of(&[
                r#"{"op":"live","name":"c","width":0,"height":0,"rate":30}"#,
                r#"{"op":"live","name":"c","width":99999999,"height":99999999,"rate":30}"#,
                r#"{"op":"live","name":"c","width":-1,"height":1,"rate":30}"#,
                r#"{"op":"remove","session":1,"target":0}"#,
                r#"{"op":"detail","session":1,"target":99999999999,"frame":1}"#,
                r#"{"op":"start","session":1,"target":7,"frame":1,"box":[1,2,30,40],"config":"natural"}"#,
                r#"{"op":"correct","session":1,"target":-1,"frame":1,"box":[1,2,30,40]}"#,
            ]);
            post(&host, &ours, body).into_bytes()
        }
        // Noise, and a good request that was damaged at its front.
        14 => random.bytes(30_000),
        _ => {
            let mut bytes = post(&host, &ours, r#"{"op":"list","path":"0/.."}"#).into_bytes();
            for _ in 0..3 {
                let at = random.below(bytes.len());
                bytes[at] = random.below(256) as u8;
            }
            bytes
        }
    }
}

#[test]
fn a_thousand_malformed_requests_get_nothing() {
    let dir = place();
    // Nobody is at the other end of the stream.
    let stream = "http://127.0.0.1:9/nothing";
    let here = Server::start(dir.path(), &["serve", "seen", stream, "--address", "127.0.0.1:0"]);
    let all = ["serve", "seen", "--address", "0.0.0.0:0", "--allow-remote", "--token", TOKEN];
    let remote = Server::start(dir.path(), &all);
    let mut random = Random(18);
    let mut count = [0; 6];
    for k in 0..1000 {
        let server = if k % 2 == 0 { &here } else { &remote };
        let request = malformed(&mut random, server.port, k % 2 == 1);
        let answer = server.send(&request);
        let (status, _) = parts(&answer);
        let told =
            || format!("{k}: {:?} gave {:?}", String::from_utf8_lossy(&request), String::from_utf8_lossy(&answer));
        assert!(status == 0 || (400..=505).contains(&status) && status != 500, "{}", told());
        assert!(!answer.windows(SECRET.len()).any(|w| w == SECRET.as_bytes()), "{}", told());
        assert!(!String::from_utf8_lossy(&answer).contains("root:x"), "{}", told());
        count[usize::from(status / 100)] += 1;
    }
    assert!(count[4] > 700, "most are refused in words: {count:?}");
    // Nothing is accepted without the token, were it right otherwise.
    let wrong = [
        "",
        "X-Foveate-Token: \r\n",
        "X-Foveate-Token: 0123456789abcdefTOKEX\r\n",
        "Cookie: token=0123456789abcdefTOKEN\r\n",
    ];
    for headers in wrong.into_iter().chain([&*format!("X-Foveate-Token: {TOKEN}\r\nX-Foveate-Token: x\r\n")]) {
        assert_eq!(remote.ask_with(r#"{"op":"hello"}"#, headers).0, 401, "{headers}");
    }
    for path in
        ["/", "/?token=", "/?token=wrong", "/frame?session=1&frame=1", "/file?session=1&name=boxes.txt", "/nothing"]
    {
        assert_eq!(remote.get(path).0, 401, "{path}");
    }
    assert_eq!(remote.get(&format!("/?token={TOKEN}")).0, 200);
    assert_eq!(remote.ask_with(r#"{"op":"hello"}"#, &format!("X-Foveate-Token: {TOKEN}\r\n")).0, 200);
    assert_eq!(here.ask(r#"{"op":"hello"}"#).0, 200, "it still answers");
    for server in [&here, &remote] {
        let said = server.said.lock().expect("one writer").clone();
        assert!(!said.contains("panicked"), "{said}");
        #[cfg(target_os = "linux")]
        {
            let status = std::fs::read_to_string(format!("/proc/{}/status", server.child.id())).expect("it runs");
            let peak = status
                .lines()
                .find_map(|l| l.strip_prefix("VmHWM:"))
                .and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok());
            assert!(peak.is_some_and(|kib| kib < 128 << 10), "{peak:?} KiB at most");
        }
    }
}

#[test]
fn other_addresses_need_a_flag_and_a_token() {
    for args in [&["--address", "0.0.0.0:0"][..], &["--address", "0.0.0.0:0", "--allow-remote"], &["--token", "short"]]
    {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_foveate"))
            .arg("serve")
            .args(args)
            .env_remove("FOVEATE_TOKEN")
            .output();
        let output = output.expect("it runs");
        assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("token"), "{output:?}");
    }
}

#[test]
fn pick_is_for_files() {
    let output =
        std::process::Command::new(env!("CARGO_BIN_EXE_foveate")).args(["pick", "rtsp://127.0.0.1:9/live"]).output();
    let output = output.expect("it runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("foveate serve"), "{said}");
}

fn open(server: &Server, name: &str) -> Value {
    let (status, opened) = server.ask(&json!({ "op": "open", "path": name }).to_string());
    assert_eq!(status, 200, "{opened}");
    opened
}

/// The boxes of rows that were told of a target.
fn boxes_of(target: &Value) -> Vec<[f64; 4]> {
    let rows = target["rows"].as_array().expect("rows").iter();
    rows.map(|row| serde_json::from_value(row["box"].clone()).expect("a box")).collect()
}

fn tracked(server: &Server, session: &Value) -> Vec<[f64; 4]> {
    let mut boxes = vec![];
    loop {
        let (status, answer) = server.ask(&json!({ "op": "step", "session": session, "frames": 200 }).to_string());
        assert_eq!(status, 200, "{answer}");
        let target = &answer["targets"][0];
        boxes.extend(boxes_of(target));
        if target["ended"] == true {
            return boxes;
        }
    }
}

#[test]
fn messages_track_correct_and_save() {
    let dir = place();
    let server = Server::start(dir.path(), &["serve", "seen", "--address", "127.0.0.1:0", "--config", "natural-fast"]);
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
        let (_, answer) = server.ask(&message.to_string());
        let bbox: [f64; 4] = serde_json::from_value(answer["box"].clone()).expect("a box");
        assert!(iou(bbox, truth(frame - 1)) > 0.3, "frame {frame}: {answer}");
    }
    let start = |config: &str, bbox: [f64; 4]| {
        server.ask(&json!({ "op": "start", "session": session, "frame": 1, "box": bbox, "config": config, "policy": null, "seed": 4 }).to_string())
    };
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
    assert_eq!(server.ask(&correction.to_string()).0, 200);
    let rest = tracked(&server, session);
    assert_eq!(rest.len(), FRAMES - 20);
    // What is saved is what `foveate track` gives by the command that is told, and what the page showed.
    let (_, command) = server.ask(&json!({ "op": "command", "session": session }).to_string());
    let command = command["command"].as_str().expect("a line").to_owned();
    assert_eq!(
        command,
        "foveate track seen/clip --init 101,91,48,48 --reinit 20:161,110,45,48 --config natural-fast --seed 4"
    );
    assert_eq!(
        server.ask(&json!({ "op": "save", "session": session, "film": true, "report": true }).to_string()).0,
        200
    );
    let files = loop {
        let (status, answer) = server.ask(&json!({ "op": "saved", "session": session }).to_string());
        assert_eq!(status, 200, "{answer}");
        if let Some(files) = answer["files"].as_array() {
            break files.clone();
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    };
    assert_eq!(files, ["boxes.txt", "track.csv", "annotated.mp4", "report.html"]);
    let saved = |name: &str| server.get(&format!("/file?session={session}&name={name}"));
    assert_eq!(saved("run.json").0, 404);
    let words: Vec<&str> = command.split(' ').skip(1).collect();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_foveate"))
        .current_dir(dir.path())
        .args(words)
        .args(["--out", "out"])
        .output();
    assert!(output.as_ref().is_ok_and(|o| o.status.success()), "{output:?}");
    for name in ["boxes.txt", "annotated.mp4"] {
        let (status, bytes) = saved(name);
        assert!(status == 200 && bytes == std::fs::read(dir.path().join("out").join(name)).expect("written"), "{name}");
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
    // Four videos are open at most, and none leaves anything behind.
    (0..4).for_each(|_| drop(open(&server, "0/clip")));
    assert_eq!(server.ask(&json!({ "op": "step", "session": session, "frames": 1 }).to_string()).0, 400);
    assert!(leftovers(dir.path()).is_empty(), "{:?}", leftovers(dir.path()));
}

/// Two boxes in the same frames: each gives what it gives alone, and has results of its own.
#[test]
fn several_targets_are_followed_at_once() {
    let dir = place();
    let server = Server::start(dir.path(), &["serve", "seen", "--address", "127.0.0.1:0", "--config", "natural-fast"]);
    let session = open(&server, "0/clip")["session"].clone();
    let ask = |message: Value| {
        let (status, answer) = server.ask(&message.to_string());
        assert_eq!(status, 200, "{message}: {answer}");
        answer
    };
    let start = |target: usize, frame: usize, bbox: [f64; 4]| json!({ "op": "start", "session": session, "target": target, "frame": frame, "box": bbox, "config": "natural-fast", "policy": null, "seed": 4 });
    assert_eq!(server.ask(&start(1, 1, truth(0)).to_string()).0, 400, "the first one comes first");
    ask(start(0, 1, truth(0)));
    let alone = tracked(&server, &session);
    ask(start(0, 1, truth(0)));
    // As many as there is time for.
    let some = ask(json!({ "op": "step", "session": session, "frames": 12 }));
    // Another one, later, on something else; it catches up, and both go on together.
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
    assert_eq!(server.ask(&start(8, 1, truth(0)).to_string()).0, 400, "eight at most");
}

/// Frames of the clip as yuv4mpeg over HTTP, for ever, 50 a second.
fn sender() -> String {
    use std::io::{Read, Write};
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = format!("http://user:secret@{}/live.y4m", listener.local_addr().expect("an address"));
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            std::thread::spawn(move || {
                let _ = stream.read(&mut [0; 4096]);
                let (w, h) = served::SIZE;
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

/// The frame of the clip that is nearest to a picture.
fn nearest(jpeg: &[u8]) -> usize {
    let image = foveate::video::decode_image(jpeg).expect("a picture");
    let apart = |t: &usize| -> u64 {
        served::picture(*t).iter().zip(image.plane(0)).map(|(a, b)| u64::from(a.abs_diff(*b))).sum()
    };
    (0..FRAMES).min_by_key(apart).expect("some")
}

#[test]
fn a_stream_that_was_named_is_followed() {
    if !std::process::Command::new("ffmpeg").arg("-version").output().is_ok_and(|o| o.status.success()) {
        eprintln!("skipped: no ffmpeg");
        return;
    }
    let dir = place();
    let address = sender();
    let server =
        Server::start(dir.path(), &["serve", &address, "--address", "127.0.0.1:0", "--config", "natural-fast"]);
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
    assert_eq!(server.ask(&message.to_string()).0, 200);
    let mut overlaps = vec![];
    for frame in 2..60 {
        let (status, answer) = server.ask(&json!({ "op": "step", "session": session, "frames": 1 }).to_string());
        assert_eq!(status, 200, "{answer}");
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
    assert_eq!(server.ask(&correct.to_string()).0, 200);
    assert_eq!(
        server.ask(&json!({ "op": "save", "session": session, "film": true, "report": true }).to_string()).0,
        200
    );
    let (_, saved) = server.ask(&json!({ "op": "saved", "session": session }).to_string());
    assert_eq!(saved["files"], json!(["boxes.txt", "track.csv", "track.jsonl"]));
    let (status, text) = server.get(&format!("/file?session={session}&name=track.jsonl"));
    assert_eq!((status, String::from_utf8_lossy(&text).lines().count()), (200, 59));
    // What was not named is not opened.
    for path in ["1", &address, "0/live", "/dev/video0"] {
        assert_eq!(server.ask(&json!({ "op": "open", "path": path }).to_string()).0, 400, "{path}");
    }
    assert_eq!(server.ask(&json!({ "op": "close", "session": session }).to_string()).0, 200);
}

/// Frames that a page pushes, as it does with the browser's camera.
#[test]
fn pushed_frames_are_followed() {
    let dir = place();
    let server = Server::start(dir.path(), &["serve", "seen", "--address", "127.0.0.1:0"]);
    let (_, opened) =
        server.ask(&json!({ "op": "live", "name": "camera", "width": 320, "height": 240, "rate": 30 }).to_string());
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
        let (status, answer) = server.ask(&message.to_string());
        assert_eq!(status, 200, "{answer}");
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

/// Folders of results that were not removed.
fn leftovers(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("readable").flatten();
    entries
        .map(|e| e.file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with("foveate-serve"))
        .collect()
}

#[test]
fn pick_prints_the_command_and_ends() {
    let dir = place();
    let mut server = Server::start(dir.path(), &["pick", "seen/clip"]);
    let session = open(&server, "0")["session"].clone();
    let message = json!({ "op": "picked", "session": session, "frame": 4, "box": truth(3), "config": "natural", "policy": "hedge" });
    let (status, answer) = server.ask(&message.to_string());
    let line = "foveate track seen/clip --from 4 --init 110,94,48,48 --policy hedge";
    assert_eq!((status, answer["command"].as_str()), (200, Some(line)));
    let mut printed = String::new();
    std::io::Read::read_to_string(&mut server.child.stdout.take().expect("a pipe"), &mut printed).expect("text");
    assert_eq!(printed.trim_end(), line);
    assert!(server.child.wait().expect("it ends").success());
}
