//! A serving program, and requests of a browser.
#![allow(dead_code, missing_docs)] // each test takes what it needs

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use foveate::BBox;
use foveate::geometry::Size;

pub(crate) struct Server {
    pub child: Child,
    pub port: u16,
    pub url: String,
    /// Its standard error.
    pub said: Arc<Mutex<String>>,
}

impl Server {
    pub(crate) fn start(folder: impl AsRef<Path>, args: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
        command.current_dir(&folder).args(args).env_remove("FOVEATE_TOKEN").env("TMPDIR", folder.as_ref());
        let mut child =
            command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
        let mut lines = BufReader::new(child.stderr.take().expect("a pipe"));
        let mut first = String::new();
        lines.read_line(&mut first).expect("it says where");
        let url =
            first.split_whitespace().find(|word| word.starts_with("http://")).unwrap_or_else(|| panic!("{first}"));
        let port = url.rsplit_once(':').and_then(|(_, rest)| rest.split('/').next()).and_then(|port| port.parse().ok());
        let said = Arc::new(Mutex::new(first.clone()));
        let more = Arc::clone(&said);
        std::thread::spawn(move || {
            let mut line = String::new();
            while lines.read_line(&mut line).is_ok_and(|n| n > 0) {
                more.lock().expect("one writer").push_str(&std::mem::take(&mut line));
            }
        });
        Self { child, port: port.unwrap_or_else(|| panic!("{first}")), url: url.to_owned(), said }
    }

    /// Serves a source, for quick tracks.
    pub(crate) fn of(folder: impl AsRef<Path>, source: &str) -> Self {
        Self::start(folder, &["serve", source, "--address", "127.0.0.1:0", "--config", "natural-fast"])
    }

    /// Sends bytes as they are, and closes; what came back.
    pub(crate) fn send(&self, bytes: &[u8]) -> Vec<u8> {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).expect("it listens");
        stream.set_read_timeout(Some(Duration::from_secs(60))).expect("a socket");
        // A server that has refused already does not read on.
        let _ = stream.write_all(bytes);
        let _ = stream.shutdown(Shutdown::Write);
        let mut answer = vec![];
        let _ = stream.read_to_end(&mut answer);
        answer
    }

    /// A message of the page: the status, and the answer.
    pub(crate) fn ask(&self, message: impl std::fmt::Display) -> (u16, serde_json::Value) {
        self.ask_with(&message.to_string(), "")
    }

    /// The answer to a message that is not refused.
    pub(crate) fn answer(&self, message: impl std::fmt::Display) -> serde_json::Value {
        let (status, answer) = self.ask(&message);
        assert_eq!(status, 200, "{message}: {answer}");
        answer
    }

    /// The same with further headers, each ending in a new line.
    pub(crate) fn ask_with(&self, message: &str, headers: &str) -> (u16, serde_json::Value) {
        let (host, length) = (format!("127.0.0.1:{}", self.port), message.len());
        let request = format!(
            "POST /api HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nContent-Type: application/json\r\n\
             Content-Length: {length}\r\nConnection: close\r\n{headers}\r\n{message}"
        );
        let (status, body) = parts(&self.send(request.as_bytes()));
        (status, serde_json::from_slice(&body).unwrap_or_default())
    }

    /// A page, picture or file.
    pub(crate) fn get(&self, path: &str) -> (u16, Vec<u8>) {
        let request = format!("GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nConnection: close\r\n\r\n", self.port);
        parts(&self.send(request.as_bytes()))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Status and body of an answer; 0 where there was none.
pub(crate) fn parts(answer: &[u8]) -> (u16, Vec<u8>) {
    let status = answer.get(9..12).and_then(|s| std::str::from_utf8(s).ok()).and_then(|s| s.parse().ok()).unwrap_or(0);
    let body = answer.windows(4).position(|w| w == b"\r\n\r\n").map_or(vec![], |at| answer[at + 4..].to_vec());
    (status, body)
}

pub(crate) const SIZE: Size = Size::new(320, 240);
pub(crate) const FRAMES: usize = 36;

/// Where the target is in frame `t` (from 0): left, top, width, height.
pub(crate) fn truth(t: usize) -> [f64; 4] {
    [100.0 + 3.0 * t as f64, 90.0 + t as f64, 48.0, 48.0]
}

/// Frame `t`: a textured square over noise, in grey.
pub(crate) fn picture(t: usize) -> Vec<u8> {
    let Size { width: w, height: h } = SIZE;
    let mut picture: Vec<u8> = foveate_testing::noise(1, w * h).map(|byte| 60 + (byte >> 3)).collect();
    let [left, top, side, _] = truth(t).map(|v| v as usize);
    for i in 0..side * side {
        let (a, b) = (i % side, i / side);
        picture[(top + b) * w + left + a] = if (a / 12 + b / 12) % 2 == 0 { 230 } else { 150 - 2 * (b as u8) };
    }
    picture
}

/// Pictures of a textured square that moves over noise, and its true boxes.
pub(crate) fn clip(folder: &Path) {
    std::fs::create_dir_all(folder).expect("a writable folder");
    let Size { width: w, height: h } = SIZE;
    let mut boxes = String::new();
    for t in 0..FRAMES {
        let [left, top, side, _] = truth(t);
        let file = folder.join(format!("{t:03}.png"));
        image::save_buffer(&file, &picture(t), w as u32, h as u32, image::ExtendedColorType::L8).expect("a picture");
        boxes += &format!("{},{},{side},{side}\n", left + 1.0, top + 1.0);
    }
    std::fs::write(folder.join("groundtruth_rect.txt"), boxes).expect("a writable folder");
}

pub(crate) fn iou(a: [f64; 4], b: [f64; 4]) -> f64 {
    let [a, b] = [a, b].map(|[x, y, w, h]| BBox::new(x, y, w, h));
    a.iou(&b)
}

/// The frame of the clip that is nearest to a picture.
pub(crate) fn nearest(jpeg: &[u8]) -> usize {
    let image = foveate::video::decode_image(jpeg).expect("a picture");
    let apart =
        |t: &usize| -> u64 { picture(*t).iter().zip(image.plane(0)).map(|(a, b)| u64::from(a.abs_diff(*b))).sum() };
    (0..FRAMES).min_by_key(apart).expect("some")
}

/// The clip as a file by HTTP, with its length; its address.
pub(crate) fn by_http() -> String {
    let Size { width: w, height: h } = SIZE;
    let mut file = format!("YUV4MPEG2 W{w} H{h} F50:1 Ip A1:1 Cmono\n").into_bytes();
    (0..FRAMES).for_each(|t| file.extend([b"FRAME\n".as_slice(), &picture(t)].concat()));
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = format!("http://{}/clip.y4m", listener.local_addr().expect("an address"));
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let file = file.clone();
            std::thread::spawn(move || {
                let _ = stream.read(&mut [0; 4096]);
                let head = format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\nConnection: close\r\n\r\n", file.len());
                let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(&file));
            });
        }
    });
    address
}
