//! Malformed requests get nothing, and other addresses need a token.

use std::io::Write;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::json;

use crate::place::{Place, failed};
use crate::served::{Server, parts};
use crate::{SECRET, place};

const TOKEN: &str = "0123456789abcdefTOKEN";

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
        // Paths outside the roots, and files that are no video, in valid messages.
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
                r#"{"op":"measure","session":1}"#,
                r#"{"op":"measure","session":1,"options":{"ruler":"1,1,1,1=0m","fps":"nan"}}"#,
                r#"{"op":"measure","session":1,"options":{"fit":"parabola:z"},"files":1}"#,
                r#"{"op":"measure","session":1,"target":1e30,"options":[]}"#,
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
    let here = Server::start(dir.path(""), &["serve", "seen", stream, "--address", "127.0.0.1:0"]);
    let all = ["serve", "seen", "--address", "0.0.0.0:0", "--allow-remote", "--token", TOKEN];
    let remote = Server::start(dir.path(""), &all);
    let mut random = Random(18);
    let mut count = [0; 6];
    for k in 0..1000 {
        let server = if k % 2 == 0 { &here } else { &remote };
        let request = malformed(&mut random, server.port, k % 2 == 1);
        let answer = server.send(&request);
        let (status, _) = parts(&answer);
        let message =
            || format!("{k}: {:?} gave {:?}", String::from_utf8_lossy(&request), String::from_utf8_lossy(&answer));
        assert!(status == 0 || (400..=505).contains(&status) && status != 500, "{}", message());
        assert!(!answer.windows(SECRET.len()).any(|w| w == SECRET.as_bytes()), "{}", message());
        assert!(!String::from_utf8_lossy(&answer).contains("root:x"), "{}", message());
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
fn half_a_request_keeps_nobody_out() {
    let dir = place();
    let server = Server::start(dir.path(""), &["serve", "seen", "--address", "127.0.0.1:0", "--token", TOKEN]);
    let half = || {
        let mut stream = TcpStream::connect(("127.0.0.1", server.port)).expect("it listens");
        stream.write_all(b"GET / HTTP/1.1\r\nHost: ").expect("it is open");
        stream
    };
    let _all: Vec<TcpStream> = (0..200).map(|_| half()).collect();
    let began = Instant::now();
    assert_eq!(server.get(&format!("/?token={TOKEN}")).0, 200);
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
}

/// A picture that becomes a link after it was opened is not followed.
#[cfg(unix)]
#[test]
fn links_that_come_later_lead_nowhere() {
    let dir = place();
    let at = |name: &str| dir.path(name);
    std::fs::copy(at("seen/clip/000.png"), at("hidden.png")).expect("a picture");
    let server = Server::start(dir.path(""), &["serve", "seen", "--address", "127.0.0.1:0"]);
    let session = crate::open(&server, "0/clip")["session"].clone();
    let frame = |n: usize| server.get(&format!("/frame?session={session}&frame={n}"));
    assert_eq!(frame(1).0, 200);
    std::fs::remove_file(at("seen/clip/030.png")).expect("it was there");
    std::os::unix::fs::symlink(at("hidden.png"), at("seen/clip/030.png")).expect("a link");
    assert_eq!(frame(29).0, 200);
    let (status, body) = frame(31);
    let said = String::from_utf8_lossy(&body);
    assert!(status == 404 && said.contains("replaced by a link"), "{status}: {said}");
}

#[test]
fn other_methods_get_the_allowed_ones() {
    let dir = place();
    let server = Server::start(dir.path(""), &["serve", "seen", "--address", "localhost:0"]);
    for (method, path, allowed) in
        [("HEAD", "/", "GET"), ("OPTIONS", "/", "GET"), ("GET", "/api", "POST"), ("DELETE", "/push", "POST")]
    {
        let host = format!("localhost:{}", server.port);
        let answer =
            server.send(format!("{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").as_bytes());
        let (status, body) = parts(&answer);
        let text = String::from_utf8_lossy(&answer);
        assert!(status == 405 && text.contains(&format!("\r\nAllow: {allowed}\r\n")), "{method}: {text}");
        assert_eq!(body.is_empty(), method == "HEAD", "{text}");
    }
}

#[test]
fn other_addresses_need_a_flag_and_a_token() {
    for args in [&["--address", "0.0.0.0:0"][..], &["--address", "0.0.0.0:0", "--allow-remote"], &["--token", "short"]]
    {
        let output = Place::empty().command(["serve"]).args(args).env_remove("FOVEATE_TOKEN").output();
        let said = failed(&output.expect("it runs"));
        assert!(said.contains("token"), "{said}");
    }
}
