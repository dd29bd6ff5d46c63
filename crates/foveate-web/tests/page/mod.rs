//! Shared parts of the tests of the page: the folder that `web/build` made, a server of it, and videos with known truth.
#![allow(dead_code, missing_docs)] // each test takes what it needs

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};

use foveate_core::geometry::{BBox, Size};
use foveate_core::scene::Image;
use foveate_testing::fall;
use foveate_video::Mp4Writer;

/// The folder that `web/build` made.
pub(crate) fn folder() -> Result<PathBuf, String> {
    let usual = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../web/dist");
    let folder = std::env::var_os("FOVEATE_WEB").map_or_else(usual, PathBuf::from);
    if folder.join("foveate.wasm").is_file() {
        return Ok(folder);
    }
    Err("page without a server: web/build makes it, FOVEATE_WEB names its folder".into())
}

/// Serves the files of a folder, as any host does; the address.
pub(crate) fn serve(folder: PathBuf) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = format!("http://{}/", listener.local_addr().expect("an address"));
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let folder = folder.clone();
            std::thread::spawn(move || answer(&folder, stream));
        }
    });
    address
}

fn answer(folder: &Path, mut stream: TcpStream) -> Option<()> {
    let mut lines = BufReader::new(stream.try_clone().ok()?).lines();
    let first = lines.next()?.ok()?;
    while !lines.next()?.ok()?.is_empty() {}
    let name = first.split_whitespace().nth(1)?.trim_start_matches('/').split(['?', '#']).next()?.to_owned();
    let name = if name.is_empty() { "index.html" } else { &name };
    let kind = match name.rsplit('.').next() {
        Some("html") => "text/html",
        Some("js") => "text/javascript",
        Some("css") => "text/css",
        _ => "application/octet-stream",
    };
    let (status, body) = match std::fs::read(folder.join(name)).ok().filter(|_| !name.contains("..")) {
        Some(body) => ("200 OK", body),
        None => ("404 Not Found", vec![]),
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(&body)).ok()
}

pub(crate) const SIZE: Size = Size::new(320, 240);
/// Frames until all begins again.
pub(crate) const FRAMES: usize = 64;
/// Side of a square of the number in the picture, pixels.
const BIT: usize = 16;

/// Where the target is in frame `t` (from 0): left, top, width, height. It goes round and round.
pub(crate) fn truth(t: usize) -> [f64; 4] {
    let turn = std::f64::consts::TAU * (t % FRAMES) as f64 / FRAMES as f64;
    [(136.0 + 60.0 * turn.cos()).round(), (104.0 + 40.0 * turn.sin()).round(), 48.0, 40.0]
}

/// Frame `t`: a textured square over noise; in the upper left corner stands its number, a square a bit.
pub(crate) fn frame(t: usize) -> Vec<u8> {
    let Size { width: w, height: h } = SIZE;
    // Noise of 4 x 4 pixels, which a video keeps.
    let coarse: Vec<u8> = foveate_testing::noise(1, (w / 4) * (h / 4)).map(|byte| 60 + (byte >> 3)).collect();
    let mut picture: Vec<u8> = (0..w * h).map(|i| coarse[i / w / 4 * (w / 4) + i % w / 4]).collect();
    let [left, top, wide, high] = truth(t).map(|v| v as usize);
    for i in 0..wide * high {
        let (a, b) = (i % wide, i / wide);
        picture[(top + b) * w + left + a] = if (a / 12 + b / 10) % 2 == 0 { 230 } else { 150 - 2 * (b as u8) };
    }
    for bit in 0..6 {
        let shade = if ((t % FRAMES) >> bit) & 1 == 1 { 235 } else { 16 };
        (0..BIT).for_each(|y| picture[y * w + bit * BIT..][..BIT].fill(shade));
    }
    picture
}

/// In the page: the number in a picture.
pub(crate) const NUMBER: &str = "(picture => { const c = new OffscreenCanvas(96, 16).getContext('2d'); c.drawImage(picture, 0, 0); \
    let n = 0; for (let b = 0; b < 6; b++) n |= (c.getImageData(16 * b + 8, 8, 1, 1).data[1] > 128) << b; return n; })";

/// One turn as H.264 in MP4.
pub(crate) fn mp4(path: &Path) {
    let mut writer = Mp4Writer::create(path, SIZE.width, SIZE.height, 30.0).expect("a writable folder");
    for t in 0..FRAMES {
        let image = Image::from_grey8(SIZE.width, SIZE.height, &frame(t)).expect("as many pixels").with_planes(3);
        writer.push(&image, t as f64 / 30.0).expect("a frame");
    }
    writer.finish().expect("a whole file");
}

/// A ball that falls, as H.264 in MP4.
pub(crate) fn falling(path: &Path) {
    let [w, h] = fall::SIZE;
    let mut writer = Mp4Writer::create(path, w, h, fall::RATE).expect("a writable folder");
    for t in 0..fall::FRAMES {
        let image = Image::from_grey8(w, h, &fall::picture(t)).expect("as many pixels").with_planes(3);
        writer.push(&image, t as f64 / fall::RATE).expect("a frame");
    }
    writer.finish().expect("a whole file");
}

/// One turn as yuv4mpeg, for a browser's pretended camera.
pub(crate) fn y4m(path: &Path, rate: usize) {
    let Size { width: w, height: h } = SIZE;
    let mut bytes = format!("YUV4MPEG2 W{w} H{h} F{rate}:1 Ip A1:1 C420jpeg\n").into_bytes();
    for t in 0..FRAMES {
        bytes.extend_from_slice(b"FRAME\n");
        bytes.extend_from_slice(&frame(t));
        bytes.resize(bytes.len() + w * h / 2, 128);
    }
    std::fs::write(path, bytes).expect("a writable folder");
}

pub(crate) fn iou(a: [f64; 4], b: [f64; 4]) -> f64 {
    let [a, b] = [a, b].map(|[x, y, w, h]| BBox::new(x, y, w, h));
    a.iou(&b)
}
