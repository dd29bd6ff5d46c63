//! Files and playlists by http, from a server of this test on the loopback.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::Path;
use std::process::Output;
use std::sync::Arc;

use super::{boxes, done, run, text, video};
use foveate_testing::{ffmpeg, need};

/// How the server answers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Serves {
    /// With the length of the file, and parts of it on request.
    Ranges,
    /// With the length, always the whole file.
    Whole,
    /// Without a length: the end of the connection is the end.
    Unsized,
    /// The first answer is cut off in the middle; then as `Ranges`.
    Cut,
    /// Every answer is cut off in the middle.
    CutWhole,
}

/// Serves the files of a folder; the address.
pub(crate) fn serve(folder: &Path, how: Serves) -> String {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten().filter(|entry| entry.path().is_file());
    let files: BTreeMap<String, Vec<u8>> = entries
        .map(|entry| (entry.file_name().to_string_lossy().into_owned(), std::fs::read(entry.path()).expect("a file")))
        .collect();
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = format!("http://{}", listener.local_addr().expect("an address"));
    let (files, cut) = (Arc::new(files), Arc::new(std::sync::atomic::AtomicUsize::new(0)));
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let (files, cut) = (files.clone(), cut.clone());
            std::thread::spawn(move || {
                let mut request = vec![];
                while !request.ends_with(b"\r\n\r\n") {
                    let mut byte = [0];
                    match stream.read(&mut byte) {
                        Ok(1) => request.push(byte[0]),
                        _ => return,
                    }
                }
                let request = String::from_utf8_lossy(&request).into_owned();
                let name = request.split([' ', '?']).nth(1).unwrap_or_default().trim_start_matches('/').to_owned();
                let Some(file) = files.get(&name) else {
                    let _ =
                        stream.write_all(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
                    return;
                };
                let range = request
                    .lines()
                    .find_map(|line| line.strip_prefix("Range: bytes=")?.split('-').next()?.parse().ok());
                let from = range.unwrap_or(0usize);
                let (all, ranges) = (file.len(), matches!(how, Serves::Ranges | Serves::Cut));
                let head = match how {
                    _ if ranges && range.is_some() => format!(
                        "206 Partial Content\r\nAccept-Ranges: bytes\r\nContent-Range: bytes {from}-{}/{all}\r\nContent-Length: {}",
                        all - 1,
                        all - from
                    ),
                    Serves::Unsized => "200 OK".to_owned(),
                    _ => format!("200 OK\r\nContent-Length: {all}"),
                };
                let part = if ranges { &file[from.min(all)..] } else { &file[..] };
                // The first answers go to the stream and to ffprobe.
                let whole = match how {
                    Serves::Cut => cut.fetch_add(1, std::sync::atomic::Ordering::SeqCst) % 2 == 1,
                    how => how != Serves::CutWhole,
                };
                let part = if whole { part } else { &part[..part.len() * 2 / 3] };
                let _ = stream.write_all(format!("HTTP/1.1 {head}\r\nConnection: close\r\n\r\n").as_bytes());
                let _ = stream.write_all(part);
            });
        }
    });
    address
}

/// Writes the clip in several containers.
pub(crate) fn clips(folder: &Path, frames: usize) -> Result<(), String> {
    ffmpeg()?;
    std::fs::write(folder.join("a.y4m"), video(frames)).expect("a writable folder");
    let made = |args: &str, name: &str| {
        let mut command = std::process::Command::new("ffmpeg");
        command.current_dir(folder).args(["-v", "error"]).args(args.split_whitespace()).arg(name);
        assert!(command.status().expect("ffmpeg runs").success(), "{name}");
    };
    made("-i a.y4m -c:v libx264 -preset ultrafast -bf 2 -g 25 -pix_fmt yuv420p -movflags +faststart", "first.mp4");
    made("-i first.mp4 -c copy", "last.mp4");
    made("-i first.mp4 -c copy", "a.ts");
    made("-i first.mp4 -c copy", "a.mkv");
    // Larger than what ffmpeg keeps of a transfer.
    made("-i a.y4m -c:v mjpeg -q:v 2 -pix_fmt yuvj420p", "large.mp4");
    made("-i first.mp4 -c copy -f hls -hls_time 1 -hls_list_size 0", "list.m3u8");
    Ok(())
}

pub(crate) fn track(folder: &Path, source: &str, out: &str, more: &[&str]) -> Output {
    done(folder, &[&[source, "--out", out, "--no-video"], more].concat(), vec![])
}

/// The rows of track.csv without their times, and the times.
fn table(folder: &Path, out: &str) -> (Vec<String>, Vec<f64>) {
    let text = std::fs::read_to_string(folder.join(out).join("track.csv")).expect("a table");
    let rows = text.lines().skip(1).map(|row| {
        let (frame, rest) = row.split_once(',').expect("columns");
        let (time, rest) = rest.split_once(',').expect("columns");
        (format!("{frame},{rest}"), time.parse::<f64>().expect("a time"))
    });
    rows.unzip()
}

/// Whichever the container and the server: the same boxes, times and status in as many frames.
#[test]
fn a_finite_file_by_http_is_tracked_as_the_file_is() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    need!(clips(dir.path(), 60));
    for name in ["first.mp4", "last.mp4", "a.ts", "a.mkv"] {
        track(dir.path(), name, &format!("file-{name}"), &["--decoder", "ffmpeg"]);
        assert_eq!(boxes(dir.path(), &format!("file-{name}")).len(), 60, "{name}");
    }
    for (how, name) in [
        (Serves::Ranges, "first.mp4"),
        (Serves::Ranges, "last.mp4"),
        (Serves::Ranges, "a.ts"),
        (Serves::Whole, "first.mp4"),
        (Serves::Whole, "a.ts"),
        (Serves::Unsized, "a.mkv"),
        (Serves::Cut, "a.mkv"),
    ] {
        let output = track(dir.path(), &format!("{}/{name}", serve(dir.path(), how)), "out", &[]);
        let (found, wanted) = (table(dir.path(), "out"), table(dir.path(), &format!("file-{name}")));
        assert!(found.0 == wanted.0, "{how:?} {name}");
        assert!(found.1.iter().zip(&wanted.1).all(|(a, b)| (a - b).abs() < 1e-9), "{how:?} {name}: {:?}", found.1);
        assert!(!text(&output.stderr).contains("dropped"), "{how:?} {name}: {}", text(&output.stderr));
    }
    // Its options are those of a file, too.
    let later = &["--from", "20"];
    track(dir.path(), "first.mp4", "later", &[&["--decoder", "ffmpeg"], &later[..]].concat());
    track(dir.path(), &format!("{}/first.mp4", serve(dir.path(), Serves::Ranges)), "out", later);
    assert_eq!(table(dir.path(), "out").0, table(dir.path(), "later").0);
    // A playlist that has ended.
    track(dir.path(), &format!("{}/list.m3u8", serve(dir.path(), Serves::Ranges)), "list", &[]);
    assert_eq!(boxes(dir.path(), "list"), boxes(dir.path(), "file-a.ts"));
    // The film is that of a file, too.
    let address = format!("{}/first.mp4", serve(dir.path(), Serves::Ranges));
    let output = run(dir.path(), &[&address, "--out", "film", "--every-frame"], vec![]);
    assert!(output.status.success() && dir.path().join("film/annotated.mp4").is_file(), "{}", text(&output.stderr));
}

/// Without a known end: all frames on request, else dropped frames are counted and reported.
#[test]
fn frames_of_a_stream_by_http_are_tracked_or_counted() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    need!(clips(dir.path(), 60));
    let address = format!("{}/a.ts", serve(dir.path(), Serves::Unsized));
    track(dir.path(), "a.ts", "file", &[]);
    let output = track(dir.path(), &address, "every", &["--every-frame"]);
    assert_eq!(boxes(dir.path(), "every"), boxes(dir.path(), "file"));
    assert!(!text(&output.stderr).contains("damaged"), "its end is no damage: {}", text(&output.stderr));
    let output = track(dir.path(), &address, "newest", &["--stream"]);
    let last: serde_json::Value =
        serde_json::from_str(text(&output.stdout).lines().last().expect("lines")).expect("JSON");
    let (tracked, dropped) = (boxes(dir.path(), "newest").len() as u64, last["dropped"].as_u64().expect("a number"));
    assert_eq!((tracked + dropped, last["frame"].as_u64()), (60, Some(60)), "{}", text(&output.stderr));
    let message = text(&output.stderr);
    assert_eq!(dropped > 0, message.contains(&format!("{dropped} frame")) && message.contains("dropped"), "{message}");
}

#[test]
fn a_transfer_that_breaks_off_is_an_error() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    need!(clips(dir.path(), 60));
    for name in ["first.mp4", "a.ts", "a.mkv"] {
        let address = format!("{}/{name}", serve(dir.path(), Serves::CutWhole));
        let output = run(dir.path(), &[&address, "--out", "out", "--reconnect", "0"], vec![]);
        let message = text(&output.stderr);
        assert!(output.status.code() == Some(1) && message.contains("breaks off"), "{name}: {message}");
        let tracked = boxes(dir.path(), "out").len();
        assert!((20..60).contains(&tracked), "{name}: {tracked}");
    }
    // The index of this one is at its end, which cannot be requested alone.
    let address = format!("{}/large.mp4", serve(dir.path(), Serves::Whole));
    let output = run(dir.path(), &[&address, "--out", "none"], vec![]);
    let message = text(&output.stderr);
    assert!(output.status.code() == Some(1) && message.contains("Range") && message.contains("faststart"), "{message}");
}
