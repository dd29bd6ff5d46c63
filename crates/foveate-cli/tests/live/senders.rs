//! Senders that come, send, and go; and invalid pipes and raw files.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use super::http::clips;
use super::{boxes, done, run, text, track, video};
use foveate_testing::need;

/// `foveate track ADDRESS --listen`, to which ffmpeg sends 50 frames once, and then goes.
fn listened(folder: &Path, args: &[&str], target: &[&str]) -> (Output, Duration) {
    let address = target.last().expect("an address");
    let child = track(folder, &[&[address, "--listen"], args].concat()).spawn().expect("it starts");
    let send = || {
        let mut command = Command::new("ffmpeg");
        command.current_dir(folder).args(["-v", "error", "-i", "first.mp4"]);
        command.args(["-c:v", "libx264", "-preset", "ultrafast", "-bf", "0", "-g", "10"]).args(target);
        command.stdin(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
    };
    let began = Instant::now();
    // It may come before anybody listens.
    while !send() {
        assert!(began.elapsed() < Duration::from_secs(30), "nobody listens");
        std::thread::sleep(Duration::from_millis(100));
    }
    let gone = Instant::now();
    (child.wait_with_output().expect("it ends"), gone.elapsed())
}

#[test]
fn every_frame_of_a_sender_is_tracked_and_its_end_is_the_end() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    need!(clips(dir.path(), 50));
    let port = 20_000 + std::process::id() % 20_000;
    let (rtsp, http) = (format!("rtsp://127.0.0.1:{}/live", port + 1), format!("http://127.0.0.1:{}/live", port + 2));
    let by_rtsp = ["-rtsp_transport", "tcp", "-f", "rtsp", &rtsp];
    let by_http = ["-f", "mpegts", &http];
    for (args, target) in [
        (&["--every-frame", "--reconnect", "0"][..], &by_rtsp[..]),
        (&["--reconnect", "1"], &by_rtsp),
        (&["--every-frame"], &by_http),
        (&[], &by_http),
    ] {
        let (output, late) = listened(dir.path(), &[args, &["--out", "out", "--stream"]].concat(), target);
        let (message, lines) = (text(&output.stderr), text(&output.stdout));
        assert!(output.status.success(), "{args:?}: {message}");
        assert!(late < Duration::from_secs(10), "{args:?}: {late:?}");
        let last: serde_json::Value = serde_json::from_str(lines.lines().last().expect("lines")).expect("JSON");
        let (tracked, dropped) = (boxes(dir.path(), "out").len() as u64, last["dropped"].as_u64().expect("a number"));
        assert_eq!(tracked + dropped, 50, "{args:?} {target:?}: {message}");
        assert!(dropped == 0 || !args.contains(&"--every-frame"), "{args:?}: {message}");
        assert!(message.contains("waiting for a sender"), "{message}");
        let waits = message.contains("ended after frame 50; waiting for another sender")
            && message.contains("no other sender came");
        assert_eq!(waits, args.contains(&"1"), "{message}");
    }
}

#[test]
fn a_pipe_of_another_kind_says_what_it_is() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    need!(clips(dir.path(), 5));
    for (name, kind) in [("first.mp4", "MP4"), ("a.ts", "an MPEG transport stream"), ("a.mkv", "Matroska")] {
        let bytes = std::fs::read(dir.path().join(name)).expect("a file");
        let output = run(dir.path(), &["-", "--out", "out"], bytes.clone());
        let message = text(&output.stderr);
        assert!(output.status.code() == Some(1) && message.contains(&format!("found {kind}")), "{message}");
        assert!(message.trim_end().chars().all(|c| !c.is_control()) && !message.contains("\\u{"), "{message}");
        // The command in the message converts it.
        let command = message.split('`').nth(1).expect("a command").split('|').nth(1).expect("one of ffmpeg");
        let mut child = Command::new("sh")
            .args(["-c", &format!("{command} 2>/dev/null")])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("a shell");
        let mut stdin = child.stdin.take().expect("a pipe");
        let writer = std::thread::spawn(move || std::io::Write::write_all(&mut stdin, &bytes));
        let converted = child.wait_with_output().expect("it ends").stdout;
        writer.join().expect("it ends").expect("written");
        done(dir.path(), &["-", "--out", "out"], converted);
        assert_eq!(boxes(dir.path(), "out").len(), 5, "{name}");
    }
    let output = run(dir.path(), &["udp://127.0.0.1:5000", "--out", "out"], vec![]);
    assert!(text(&output.stderr).contains("`ffmpeg -i udp://127.0.0.1:5000 "), "{}", text(&output.stderr));
}

#[test]
fn a_wrong_size_of_bare_pixels_is_found_before_it_is_tracked() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let y4m = video(20);
    let head = y4m.iter().position(|byte| *byte == b'\n').expect("a line") + 1;
    // Without the noise, on a slope: neighbouring rows fit together, as in photographs.
    let slope = |i: usize, byte: u8| (byte / 100) * 50 + (i % 160 / 2) as u8 + (i / 160 / 3) as u8;
    let raw: Vec<u8> = y4m[head..]
        .chunks_exact(6 + 160 * 120)
        .flat_map(|frame| frame[6..].iter().enumerate().map(|(i, byte)| slope(i, *byte)))
        .collect();
    std::fs::write(dir.path().join("a.raw"), &raw).expect("a writable folder");
    let asked = |size: &'static str, source: &'static str| {
        [source, "--raw", size, "--pix", "gray", "--out", "out", "--no-video"]
    };
    let output = run(dir.path(), &asked("158x120", "a.raw"), vec![]);
    let message = text(&output.stderr);
    assert!(output.status.code() == Some(1) && message.contains("check --raw and --pix"), "{message}");
    assert!(message.contains("20 frames and 4800 bytes") && !dir.path().join("out").exists(), "{message}");
    // The length of a pipe is unknown: the first frame looks skewed.
    for (size, doubted) in [("158x120", true), ("160x120", false)] {
        let output = run(dir.path(), &asked(size, "-"), raw.clone());
        let message = text(&output.stderr);
        assert_eq!(
            message.contains("do not fit together") && message.contains("at 160 pixels a row"),
            doubted,
            "{message}"
        );
        assert_eq!(output.status.success(), !doubted, "{message}");
    }
    // Standard input that is a file has a length.
    let mut command = track(dir.path(), &asked("158x120", "-"));
    command.stdin(std::fs::File::open(dir.path().join("a.raw")).expect("a file"));
    let message = text(&command.output().expect("it runs").stderr);
    assert!(message.contains("20 frames and 4800 bytes"), "{message}");
}
