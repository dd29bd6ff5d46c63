//! `foveate track` of pipes and streams: its input, its output during the run, and its end.
#![cfg(unix)]

mod http;
mod senders;

use foveate_testing::{ffmpeg, need};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// A square of 24 pixels that moves over noise, as yuv4mpeg.
fn video(frames: usize) -> Vec<u8> {
    let (w, h) = (160, 120);
    let mut bytes = format!("YUV4MPEG2 W{w} H{h} F25:1 Ip A1:1 Cmono\n").into_bytes();
    let noise: Vec<u8> = foveate_testing::noise(1, w * h).map(|byte| 60 + (byte >> 3)).collect();
    for t in 0..frames {
        let mut picture = noise.clone();
        let (left, top) = (40 + (2 * t) % 60, 40);
        for i in 0..24 * 24 {
            picture[(top + i / 24) * w + left + i % 24] = if (i / 6 + i / 144) % 2 == 0 { 230 } else { 150 };
        }
        bytes.extend(b"FRAME\n");
        bytes.extend(picture);
    }
    bytes
}

fn track(folder: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    command
        .current_dir(folder)
        .arg("track")
        .args(args)
        .args("--init 41,41,24,24 --profile fast --no-report".split(' '));
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn run(folder: &Path, args: &[&str], input: Vec<u8>) -> Output {
    let mut child = track(folder, args).spawn().expect("the program starts");
    let mut stdin = child.stdin.take().expect("a pipe");
    let writer = std::thread::spawn(move || stdin.write_all(&input));
    let output = child.wait_with_output().expect("it ends");
    let _ = writer.join();
    output
}

/// The same for a run that must succeed.
fn done(folder: &Path, args: &[&str], input: Vec<u8>) -> Output {
    let output = run(folder, args, input);
    assert!(output.status.success(), "{args:?}: {}", text(&output.stderr));
    output
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn boxes(folder: &Path, out: &str) -> Vec<String> {
    let text = std::fs::read_to_string(folder.join(out).join("boxes.txt")).expect("boxes");
    text.lines().map(str::to_owned).collect()
}

#[test]
fn a_pipe_a_fifo_and_a_file_give_the_same_boxes() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let bytes = video(20);
    std::fs::write(dir.path().join("a.y4m"), &bytes).expect("a writable folder");
    done(dir.path(), &["a.y4m", "--out", "file", "--no-video"], vec![]);
    let piped = done(dir.path(), &["-", "--out", "pipe", "--stream"], bytes.clone());
    assert_eq!(boxes(dir.path(), "pipe"), boxes(dir.path(), "file"));
    assert_eq!(boxes(dir.path(), "file").len(), 20);
    // A line a frame, JSON, with boxes as track.csv has them; all else is on standard error.
    let lines = text(&piped.stdout);
    let lines: Vec<serde_json::Value> = lines.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(lines.len(), 20);
    assert_eq!((&lines[0]["status"], &lines[0]["bbox"]["x"]), (&"given".into(), &40.0.into()));
    for (i, line) in lines.iter().enumerate() {
        assert_eq!((&line["frame"], &line["dropped"]), (&(i + 1).into(), &0.into()));
        assert!(line["latency_ms"].as_f64().is_some_and(|ms| ms > 0.0) && line["p_lost"].is_f64(), "{line}");
    }
    assert!(text(&piped.stderr).contains("20 frames tracked"), "{}", text(&piped.stderr));
    // A fifo.
    let fifo = dir.path().join("fifo");
    if Command::new("mkfifo").arg(&fifo).status().is_ok_and(|status| status.success()) {
        let writer = std::thread::spawn(move || std::fs::write(fifo, bytes));
        let output = done(dir.path(), &["fifo", "--out", "of-fifo", "--stream", "mot"], vec![]);
        writer.join().expect("it ends").expect("written");
        assert_eq!(boxes(dir.path(), "of-fifo"), boxes(dir.path(), "file"));
        assert!(text(&output.stdout).starts_with("1,1,41.000,41.000,24.000,24.000,1.000,-1,-1,-1\n2,1,"));
    }
    // Bare pixels of the same pictures.
    let raw: Vec<u8> =
        video(20).split(|b| *b == b'\n').next().map(|head| video(20)[head.len() + 1..].to_vec()).expect("a head");
    let raw: Vec<u8> = raw.chunks_exact(6 + 160 * 120).flat_map(|frame| frame[6..].to_vec()).collect();
    done(dir.path(), &["-", "--raw", "160x120", "--pix", "gray", "--out", "raw"], raw);
    assert_eq!(boxes(dir.path(), "raw"), boxes(dir.path(), "file"));
}

#[test]
fn some_frames_of_a_file_are_tracked() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(dir.path().join("a.y4m"), video(20)).expect("a writable folder");
    let some = ["a.y4m", "--out", "some", "--no-video", "--from", "1", "--every", "3", "--until", "12", "--stream"];
    let output = done(dir.path(), &some, vec![]);
    let frames = text(&output.stdout);
    let frames: Vec<&str> = frames.lines().filter_map(|line| line.split([':', ',']).nth(1)).collect();
    assert_eq!(frames, ["1", "4", "7", "10"]);
    done(dir.path(), &["a.y4m", "--out", "small", "--scale", "0.5", "--no-video"], vec![]);
    for (args, word) in [
        (&["a.y4m", "--scale", "2"][..], "at most 1"),
        (&["a.y4m", "--every-frame"], "every frame of a file"),
        (&["a.y4m", "--listen"], "rtsp"),
        (&["a.y4m", "--every", "2", "--reinit", "4:50,50,24,24"], "leaves this frame out"),
        (&["a.y4m", "--raw", "16"], "640x480"),
        (&["-", "--from", "3"], "for files"),
        (&["a.y4m", "--stream", "smoke"], "udp:HOST:PORT"),
        (&["a.y4m", "--decoder", "magic"], "builtin"),
    ] {
        let output = run(dir.path(), args, video(1));
        assert!(!output.status.success() && text(&output.stderr).contains(word), "{args:?}: {}", text(&output.stderr));
    }
}

/// Starts a run on an endless pipe that has given ten frames and gives no more.
fn stalled(folder: &Path) -> (Child, std::process::ChildStdin, BufReader<std::process::ChildStdout>) {
    let mut child = track(folder, &["-", "--out", "out", "--stream"]).spawn().expect("the program starts");
    let mut stdin = child.stdin.take().expect("a pipe");
    stdin.write_all(&video(10)).expect("it reads");
    let mut lines = BufReader::new(child.stdout.take().expect("a pipe"));
    (0..10).for_each(|_| assert!(lines.read_line(&mut String::new()).expect("a line") > 0));
    (child, stdin, lines)
}

fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([name, &child.id().to_string()]).status();
    assert!(sent.is_ok_and(|status| status.success()));
}

#[test]
fn a_source_that_blocks_is_left_within_a_second() {
    for (name, status) in [("-TERM", 143), ("-INT", 130)] {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let (mut child, _stdin, _lines) = stalled(dir.path());
        let began = Instant::now();
        signal(&child, name);
        let ended = child.wait().expect("it ends");
        assert!(began.elapsed() < Duration::from_secs(1), "{name}: {:?}", began.elapsed());
        assert_eq!(ended.code(), Some(status), "{name}");
        assert_eq!(boxes(dir.path(), "out").len(), 10, "{name}: what was tracked is kept");
    }
}

#[test]
fn what_was_tracked_can_be_read_after_a_kill() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let (mut child, _stdin, _lines) = stalled(dir.path());
    let folder = dir.path().join(format!("out.live-{}", child.id()));
    let rows = |name: &str| std::fs::read_to_string(folder.join(name)).expect("a file that grows").lines().count();
    // A line goes out before the files have it.
    let began = Instant::now();
    while (rows("boxes.txt"), rows("track.csv")) != (10, 11) && began.elapsed() < Duration::from_secs(5) {
        std::thread::sleep(Duration::from_millis(5));
    }
    signal(&child, "-KILL");
    let _ = child.wait();
    assert_eq!((rows("boxes.txt"), rows("track.csv")), (10, 11));
    // Another run leaves it alone.
    done(dir.path(), &["-", "--out", "out"], video(3));
    assert_eq!((rows("boxes.txt"), boxes(dir.path(), "out").len()), (10, 3));
}

/// A file of this name first on the PATH; a shell script.
fn instead_of_ffmpeg(folder: &Path, script: &str) -> String {
    let bin = folder.join("bin");
    std::fs::create_dir_all(&bin).expect("a writable folder");
    let path = bin.join("ffmpeg");
    std::fs::write(&path, format!("#!/bin/sh\necho $$ >> '{}'\n{script}\n", folder.join("pids").display()))
        .expect("a file");
    let mode = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(&path, mode).expect("ours");
    format!("{}:{}", bin.display(), std::env::var("PATH").unwrap_or_default())
}

/// The processes that a script has written down are gone, within two seconds.
fn all_gone(folder: &Path) {
    let pids = std::fs::read_to_string(folder.join("pids")).expect("it was started");
    let runs =
        |pid: &str| Command::new("kill").args(["-0", pid]).stderr(Stdio::null()).status().is_ok_and(|s| s.success());
    let began = Instant::now();
    while pids.lines().any(runs) {
        assert!(began.elapsed() < Duration::from_secs(2), "a child outlives the program");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A stream whose ffmpeg hangs after ten frames: however the program ends, its ffmpeg does too.
#[test]
fn no_ffmpeg_outlives_the_program() {
    for (name, status) in [("-TERM", Some(143)), ("-KILL", None)] {
        let dir = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(dir.path().join("ten.y4m"), video(10)).expect("a writable folder");
        let file = dir.path().join("ten.y4m");
        let script = format!("[ \"$2\" = -h ] && exit 0\ncat '{}'\nexec sleep 1000", file.display());
        let path = instead_of_ffmpeg(dir.path(), &script);
        let args = ["rtsp://127.0.0.1:9/x", "--out", "out", "--stream", "--every-frame"];
        let mut child = track(dir.path(), &args).env("PATH", path).spawn().expect("the program starts");
        let mut lines = BufReader::new(child.stdout.take().expect("a pipe"));
        for _ in 0..10 {
            let mut line = String::new();
            if lines.read_line(&mut line).expect("a line") == 0 {
                let mut said = String::new();
                let _ = child.stderr.take().expect("a pipe").read_to_string(&mut said);
                panic!("{said}");
            }
        }
        let began = Instant::now();
        signal(&child, name);
        assert_eq!(child.wait().expect("it ends").code(), status, "{name}");
        assert!(began.elapsed() < Duration::from_secs(1), "{name}: {:?}", began.elapsed());
        all_gone(dir.path());
    }
}

/// A stream does not begin again: what arrives first continues the track.
#[test]
fn a_saved_state_continues_with_the_first_frame_of_a_stream() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let whole = video(20);
    let head = whole.len() - 20 * (6 + 160 * 120);
    let rest = [&whole[..head], &whole[head + 10 * (6 + 160 * 120)..]].concat();
    for (name, bytes) in [("whole", &whole), ("next", &rest)] {
        std::fs::write(dir.path().join(format!("{name}.y4m")), bytes).expect("a writable folder");
    }
    let script = format!("[ \"$2\" = -h ] && exit 0\ncat '{}'", dir.path().join("next.y4m").display());
    let path = instead_of_ffmpeg(dir.path(), &script);
    let resumed = |source: &str, out: &str, more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
        command.current_dir(dir.path()).env("PATH", &path).args(["track", source, "--load-state", "s.json"]);
        command.args(["--profile", "fast", "--no-report", "--no-video", "--out", out]).args(more);
        let output = command.output().expect("the program starts");
        assert!(output.status.success(), "{}", text(&output.stderr));
        boxes(dir.path(), out)
    };
    let stream = ["--every-frame", "--reconnect", "0"];
    for (every, frames) in [("1", 10), ("3", 4)] {
        let first = ["whole.y4m", "--no-video", "--out", "first", "--until", "10", "--every", every];
        done(dir.path(), &[&first[..], &["--save-state", "s.json"]].concat(), vec![]);
        let of_stream = resumed("rtsp://127.0.0.1:9/x", "stream", &[&stream[..], &["--every", every]].concat());
        assert_eq!(of_stream.len(), frames, "every {every}");
        let table = std::fs::read_to_string(dir.path().join("stream/track.csv")).expect("a table");
        assert!(table.lines().nth(1).is_some_and(|row| row.starts_with("1,")), "{table}");
    }
    // A file is read from its beginning.
    assert_eq!(resumed("whole.y4m", "file", &["--every", "3"]).len(), 3);
}

fn make(path: PathBuf, options: &str) -> bool {
    let source = "-v error -f lavfi -i testsrc2=size=320x240:rate=25:duration=2";
    let made = Command::new("ffmpeg").args(source.split(' ')).args(options.split(' ')).arg(path).status();
    made.is_ok_and(|status| status.success())
}

/// Same video, same boxes, whichever decoder.
#[test]
fn the_boxes_do_not_depend_on_the_decoder() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let made = make(dir.path().join("a.mp4"), "-c:v libx264 -bf 3 -pix_fmt yuv420p");
    need!(made.then_some(()).ok_or("ffmpeg with libx264"));
    for decoder in ["builtin", "ffmpeg", "auto"] {
        done(dir.path(), &["a.mp4", "--out", decoder, "--decoder", decoder, "--no-video"], vec![]);
        let table = |out: &str| std::fs::read_to_string(dir.path().join(out).join("track.csv")).expect("a table");
        assert!(table(decoder) == table("builtin"), "{decoder}");
    }
}

/// A camera that sends to us, goes, and comes back: tracking continues.
#[test]
fn a_stream_that_breaks_off_is_opened_again() {
    need!(ffmpeg());
    let dir = tempfile::tempdir().expect("a temporary folder");
    let port = 20_000 + std::process::id() % 20_000;
    let address = format!("rtsp://127.0.0.1:{port}/live");
    let camera = || {
        let mut command = Command::new("ffmpeg");
        command.args(["-v", "error", "-re", "-f", "lavfi", "-i", "testsrc2=size=320x240:rate=25"]);
        command.args("-c:v libx264 -preset ultrafast -tune zerolatency -g 25 -pix_fmt yuv420p".split(' '));
        command.args(["-rtsp_transport", "tcp", "-f", "rtsp", &address]).stdin(Stdio::null()).stderr(Stdio::null());
        command
    };
    let mut child = track(dir.path(), &[&address, "--listen", "--out", "out", "--stream"]).spawn().expect("it starts");
    let mut lines = BufReader::new(child.stdout.take().expect("a pipe"));
    let (message, mut errors) =
        (Arc::new(Mutex::new(String::new())), BufReader::new(child.stderr.take().expect("a pipe")));
    let (received, mut line) = (message.clone(), String::new());
    let listener = std::thread::spawn(move || {
        while errors.read_line(&mut line).is_ok_and(|n| n > 0) {
            received.lock().expect("one writer").push_str(&std::mem::take(&mut line));
        }
    });
    let message = || message.lock().expect("one writer").clone();
    let mut last = 0;
    for round in 0..2 {
        let (send, stop) = std::sync::mpsc::channel::<()>();
        let command = std::thread::spawn({
            let mut make = camera();
            // It may come before anybody listens: then it is started again.
            move || loop {
                let mut sender = make.spawn().expect("ffmpeg runs");
                while sender.try_wait().expect("a child").is_none() {
                    if stop.recv_timeout(Duration::from_millis(50)) != Err(std::sync::mpsc::RecvTimeoutError::Timeout) {
                        let _ = sender.kill();
                        let _ = sender.wait();
                        return;
                    }
                }
            }
        });
        // Frames of the first sender may still be on their way.
        let before = || match round {
            0 => Some(0),
            _ => message().split("after frame ").nth(1).and_then(|rest| rest.split(';').next()?.parse::<u64>().ok()),
        };
        while before().is_none_or(|before| last < before + 15) {
            let mut line = String::new();
            if lines.read_line(&mut line).expect("a line") == 0 {
                drop(send);
                panic!("round {round}: {}", message());
            }
            let line: serde_json::Value = serde_json::from_str(&line).expect("JSON");
            last = line["frame"].as_u64().expect("a number");
        }
        drop(send);
        command.join().expect("it ends");
    }
    signal(&child, "-TERM");
    assert_eq!(child.wait().expect("it ends").code(), Some(143));
    listener.join().expect("it ends");
    assert!(
        message().contains("opened again 1 time") && message().contains("waiting for another sender"),
        "{}",
        message()
    );
}
