//! Any video the external program ffmpeg reads, as planar colour through a pipe.
//!
//! Times come from its `showinfo` filter, one line a frame on the error channel. The program is optional
//! and runs as a separate process; of the file's own references (playlists) it may follow local ones only.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, sync_channel};

use crate::decode::MAX_SIDE;
use crate::decoded::{DecodeError, Decoded, Picture};
use foveate_core::scene::Image;

/// A running ffmpeg.
pub(super) struct Ffmpeg {
    child: Child,
    pixels: ChildStdout,
    lines: Receiver<Line>,
    rate: Option<f64>,
    length: Option<f64>,
    complaint: Option<String>,
    /// What it said of the end of the file, and of the last corrupt frame: how many frames had come.
    cut: Option<String>,
    corrupt: Option<(usize, String)>,
    /// Time stamp of the first frame, and how many frames came.
    origin: Option<f64>,
    frames: usize,
}

/// What a line of ffmpeg's says that matters.
#[derive(Debug, PartialEq)]
enum Line {
    Frame {
        time: Option<f64>,
        width: usize,
        height: usize,
    },
    Rate(f64),
    Length(f64),
    Complaint(String),
    /// The file ends before its time.
    Cut(String),
    /// A frame or a packet that is not whole; at the end of a file it is where the file was cut.
    Corrupt(String),
}

/// What ffmpeg says of a file that was cut off. It ends well all the same.
const CUT: [&str; 4] = ["ended prematurely", "Error during demuxing", "partial file", "Truncating packet"];
/// What it says of a frame that it makes up in part.
const CORRUPT: [&str; 2] = ["corrupt decoded frame", "corrupt input packet"];
/// A corrupt frame so near to the end, in frames, is the end.
const NEAR: usize = 2;

impl Ffmpeg {
    /// Starts `program` on a file; the first `skip` frames are thrown away.
    ///
    /// # Errors
    /// What is wrong and what to do, where the program is not there or does not start.
    pub fn open(program: &Path, path: &Path, skip: usize) -> Result<Self, String> {
        let passthrough = if knows_fps_mode(program)? { ["-fps_mode", "passthrough"] } else { ["-vsync", "0"] };
        let mut input = OsString::from("file:");
        input.push(path);
        let mut child = Command::new(program)
            .args([
                "-hide_banner",
                "-nostdin",
                "-nostats",
                "-loglevel",
                "level+info",
                "-protocol_whitelist",
                "file,crypto,data",
            ])
            .arg("-i")
            .arg(input)
            .args(["-map", "0:v:0", "-an", "-sn", "-dn", "-vf", "format=gbrp,showinfo=checksum=0"])
            .args(passthrough)
            .args(["-f", "rawvideo", "-pix_fmt", "gbrp", "pipe:1"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| missing(program, &error))?;
        let pixels = child.stdout.take().expect("it was asked for a pipe");
        let errors = child.stderr.take().expect("it was asked for a pipe");
        let (send, lines) = sync_channel(1 << 10);
        std::thread::spawn(move || {
            for line in BufReader::new(errors).split(b'\n').map_while(Result::ok) {
                // The receiver may be gone; the pipe is emptied all the same, so that ffmpeg can end.
                let _ = understand(&String::from_utf8_lossy(&line)).map(|line| send.send(line));
            }
        });
        let (rate, length, complaint, cut, corrupt, origin) = (None, None, None, None, None, None);
        let mut ffmpeg = Self { child, pixels, lines, rate, length, complaint, cut, corrupt, origin, frames: 0 };
        for _ in 0..skip {
            if ffmpeg.picture().is_none() {
                return Err(format!("ffmpeg found only {} of the {skip} frames read so far", ffmpeg.frames));
            }
        }
        Ok(ffmpeg)
    }

    /// Frames a second; known after the first frame.
    pub fn rate(&self) -> f64 {
        self.rate.unwrap_or(30.0)
    }

    /// An estimate of the number of frames; known after the first frame.
    pub fn frames(&self) -> Option<usize> {
        self.length.map(|length| (length * self.rate()).round() as usize)
    }

    /// The next frame and its time in seconds from the first.
    pub fn picture(&mut self) -> Option<Decoded<Picture>> {
        loop {
            match self.lines.recv() {
                Ok(Line::Frame { time, width, height }) => return Some(self.read(time, width, height)),
                Ok(Line::Rate(rate)) => self.rate = self.rate.or(Some(rate)),
                Ok(Line::Length(length)) => self.length = self.length.or(Some(length)),
                Ok(Line::Complaint(text)) => self.complaint = self.complaint.take().or(Some(text)),
                Ok(Line::Cut(text)) => self.cut = self.cut.take().or(Some(text)),
                Ok(Line::Corrupt(text)) => self.corrupt = Some((self.frames, text)),
                Err(_) => break,
            }
        }
        let ended = self.child.wait();
        if self.frames > 0 && ended.is_ok_and(|status| status.success()) {
            let corrupt = self.corrupt.take().filter(|(at, _)| at + NEAR >= self.frames).map(|(_, text)| text);
            let end = self.cut.take().or(corrupt)?;
            return Some(Err(DecodeError::damaged(format!("the video breaks off: ffmpeg says \"{end}\""))));
        }
        let text = self.complaint.take().unwrap_or_else(|| "it gave no reason".into());
        Some(Err(match self.frames {
            0 => {
                let problem = "expected a video that ffmpeg reads; it says";
                DecodeError::Damaged(format!("{problem}: {text}; check that this is a video, and whole"))
            }
            _ => DecodeError::damaged(format!("ffmpeg stopped: {text}")),
        }))
    }

    fn read(&mut self, time: Option<f64>, width: usize, height: usize) -> Decoded<Picture> {
        if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
            let problem =
                format!("expected sides from 1 to {MAX_SIDE} pixels, found {width} x {height}; make it smaller");
            return Err(DecodeError::Damaged(problem));
        }
        let mut planes = vec![0; 3 * width * height];
        self.pixels.read_exact(&mut planes).map_err(|_| {
            let text = self.complaint.take().unwrap_or_else(|| "it ended in the middle of a frame".into());
            DecodeError::damaged(format!("ffmpeg stopped: {text}"))
        })?;
        // Green, blue, red becomes red, green, blue.
        planes.rotate_right(width * height);
        let image = Image::new(width, height, 3, planes).expect("three planes of this size, which is not empty");
        let time = time.unwrap_or(self.origin.unwrap_or(0.0) + self.frames as f64 / self.rate());
        self.frames += 1;
        Ok((image, time - *self.origin.get_or_insert(time)))
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Before 5.1 the option had another name.
fn knows_fps_mode(program: &Path) -> Result<bool, String> {
    let help = Command::new(program)
        .args(["-hide_banner", "-h", "long"])
        .stdin(Stdio::null())
        .output()
        .map_err(|error| missing(program, &error))?;
    Ok(help.stdout.windows(9).any(|text| text == b"-fps_mode"))
}

fn missing(program: &Path, error: &std::io::Error) -> String {
    let found = match error.kind() {
        ErrorKind::NotFound => "which was not found".to_owned(),
        _ => format!("which does not start ({error})"),
    };
    format!(
        "only H.264 in MP4 (8 or 10 bits, 4:2:0 or 4:2:2) is read without the program {}, {found}; install it \
         (`apt install ffmpeg`, `brew install ffmpeg`, `winget install ffmpeg`, or https://ffmpeg.org), \
         or convert the video elsewhere to H.264 in MP4",
        program.display()
    )
}

fn understand(line: &str) -> Option<Line> {
    let field = |name: &str| {
        let rest = &line[line.find(name)? + name.len()..];
        rest.split_whitespace().next()
    };
    if line.contains("[Parsed_showinfo") {
        if let Some(size) = field(" s:") {
            let (width, height) = size.split_once('x')?;
            let time = field("pts_time:").and_then(|time| time.parse().ok()).filter(|time: &f64| time.is_finite());
            return Some(Line::Frame { time, width: width.parse().ok()?, height: height.parse().ok()? });
        }
        let (over, under) = field("frame_rate: ")?.split_once('/')?;
        let rate = over.parse::<f64>().ok()? / under.parse::<f64>().ok()?;
        return (rate.is_finite() && rate > 0.0).then_some(Line::Rate(rate));
    }
    if let Some(length) = field("Duration: ") {
        let seconds = length
            .trim_end_matches(',')
            .split(':')
            .try_fold(0.0, |sum, part| Some(60.0 * sum + part.parse::<f64>().ok()?));
        return seconds.map(Line::Length);
    }
    let said = |level: &str| line.split_once(level).map(|(_, text)| text.trim().to_owned());
    let error = said("[error] ").or_else(|| said("[fatal] "));
    let text = error.clone().or_else(|| said("[warning] "))?;
    if CUT.iter().any(|words| text.contains(words)) {
        return Some(Line::Cut(text));
    }
    if CORRUPT.iter().any(|words| text.contains(words)) {
        return Some(Line::Corrupt(text));
    }
    error.map(Line::Complaint)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_understood() {
        let frame = "[Parsed_showinfo_1 @ 0x55d] [info] n:   0 pts:    512 pts_time:0.04    duration:    512 \
                     duration_time:0.04    fmt:gbrp cl:unspecified sar:1/1 s:640x360 i:P iskey:1 type:I ";
        assert_eq!(understand(frame), Some(Line::Frame { time: Some(0.04), width: 640, height: 360 }));
        let rate = "[Parsed_showinfo_1 @ 0x5] [info] config in time_base: 1/12800, frame_rate: 25/2";
        assert_eq!(understand(rate), Some(Line::Rate(12.5)));
        assert_eq!(
            understand("[info]   Duration: 01:00:30.50, start: 0.000000, bitrate: 1 kb/s"),
            Some(Line::Length(3630.5))
        );
        let complaint = "[in#0 @ 0x5] [error] moov atom not found";
        assert_eq!(understand(complaint), Some(Line::Complaint("moov atom not found".into())));
        assert_eq!(understand("[info] Output #0, rawvideo, to 'pipe:1':"), None);
        let cut = "[matroska,webm @ 0x5] [error] File ended prematurely";
        assert_eq!(understand(cut), Some(Line::Cut("File ended prematurely".into())));
        let corrupt = "[warning] file:cut.avi: corrupt decoded frame in stream 0";
        assert_eq!(understand(corrupt), Some(Line::Corrupt("file:cut.avi: corrupt decoded frame in stream 0".into())));
        assert_eq!(understand("[swscaler @ 0x5] [warning] No accelerated colorspace conversion found"), None);
    }

    /// Runs where ffmpeg is installed, and says so where it is not.
    #[test]
    fn a_file_that_was_cut_ends_with_an_error() {
        if Command::new("ffmpeg").arg("-version").output().is_err() {
            eprintln!("skipped: the program ffmpeg is not installed");
            return;
        }
        let dir = tempfile::tempdir().expect("a temporary folder");
        for name in ["a.mkv", "a.avi"] {
            let whole = dir.path().join(name);
            let made = Command::new("ffmpeg")
                .args(["-v", "error", "-f", "lavfi", "-i", "testsrc=size=160x120:rate=25:duration=4"])
                .args(["-c:v", "mpeg4", "-g", "10"])
                .arg(&whole)
                .status();
            assert!(made.is_ok_and(|status| status.success()), "{name} is made");
            let bytes = std::fs::read(&whole).expect("just made");
            let cut = dir.path().join(format!("cut-{name}"));
            std::fs::write(&cut, &bytes[..bytes.len() * 3 / 5]).expect("a writable folder");
            let frames = |path: &Path| -> (usize, Option<String>) {
                let mut ffmpeg = Ffmpeg::open(Path::new("ffmpeg"), path, 0).expect("it starts");
                let mut count = 0;
                loop {
                    match ffmpeg.picture() {
                        Some(Ok(_)) => count += 1,
                        Some(Err(DecodeError::Damaged(text) | DecodeError::Unsupported(text))) => {
                            return (count, Some(text));
                        }
                        None => return (count, None),
                    }
                }
            };
            assert_eq!(frames(&whole), (100, None), "{name}");
            let (count, error) = frames(&cut);
            assert!((30..90).contains(&count), "{name}: {count} frames are kept");
            assert!(error.is_some_and(|e| e.contains("breaks off")), "{name}");
        }
    }

    #[test]
    fn a_missing_program_is_named_with_what_to_do() {
        let text = Ffmpeg::open(Path::new("no-such-ffmpeg"), Path::new("x.avi"), 0).err().expect("no program");
        assert!(text.contains("no-such-ffmpeg") && text.contains("apt install ffmpeg"), "{text}");
    }
}
