//! Streams, cameras and files at an address, through the program ffmpeg: `rtsp://`, `http://`, `/dev/video0`.
//!
//! A file with a known end is read like a file on disk: every frame, with its time stamps. Everything else is a
//! stream, which is opened again if it breaks off.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

use crate::address::is_timed;
use crate::child::{Interrupt, Leash};
use crate::connection::Connection;
use crate::ffmpeg::{Input, probe};
use crate::{Frame, FrameSource, LiveOptions, Remarks, SourceInfo, VideoFile};
use foveate_base::Result;

/// A stream that gives nothing for so long is opened again.
const STALL: Duration = Duration::from_secs(10);
/// How long the server may be silent while ffprobe finds out whether an address has an end.
const SILENCE: Duration = Duration::from_secs(3);
/// How long that may take in all: a busy machine starts ffprobe late, and a file taken for a stream loses frames.
const PROBE: Duration = Duration::from_secs(20);

/// What an address gives: a stream, or a file with an end.
pub struct Live {
    source: Source,
    reconnections: Arc<AtomicU64>,
}

foveate_base::opaque_debug!(Live);

enum Source {
    Stream(Box<Connection>),
    File(Box<VideoFile>),
}

impl Live {
    /// Opens an address and waits for its first frame.
    ///
    /// # Errors
    /// Fails if the address is of an unknown scheme, ffmpeg is not there, or it finds no video.
    pub fn open(address: &Path, options: LiveOptions) -> Result<Self> {
        let (program, listen, reconnect) = (options.ffmpeg.clone(), options.listen, options.reconnect);
        let mut stream = Connection::open(address, options, STALL)?;
        let reconnections = stream.reconnections();
        // Asked last: a sender may take one connection, and that is the stream's.
        let about = if stream.scheme.ends && !listen {
            About::ask(&program, &stream.scheme.input(address))
        } else {
            About::default()
        };
        if !about.finite {
            stream.timed = about.timed.unwrap_or(!stream.scheme.ends || listen);
            return Ok(Self { source: Source::Stream(Box::new(stream)), reconnections });
        }
        let (mut input, shown) = (stream.scheme.input(address), stream.shown.clone());
        drop(stream);
        let micros = |time: Duration| time.as_micros().to_string();
        input.options.extend(["-rw_timeout".to_owned(), micros(STALL)]);
        if !reconnect.is_zero() {
            // It continues at the byte at which it broke off.
            input.options.extend(["-reconnect", "1", "-reconnect_delay_max"].map(str::to_owned));
            input.options.push(reconnect.as_secs().min(4294).to_string());
        }
        let file = VideoFile::of_input(shown, input, &program)?;
        Ok(Self { source: Source::File(Box::new(file)), reconnections })
    }

    /// Whether it is a file with a known end. It waits for its reader, and no frame is dropped.
    pub fn is_finite(&self) -> bool {
        matches!(self.source, Source::File(_))
    }

    /// How often it was opened again. Counts on after this source was handed over.
    pub fn reconnections(&self) -> Arc<AtomicU64> {
        self.reconnections.clone()
    }
}

impl Iterator for Live {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        match &mut self.source {
            Source::Stream(stream) => stream.next(),
            Source::File(file) => file.next(),
        }
    }
}

impl FrameSource for Live {
    fn info(&self) -> &SourceInfo {
        match &self.source {
            Source::Stream(stream) => &stream.info,
            Source::File(file) => file.info(),
        }
    }
    fn interrupt(&self) -> Option<Interrupt> {
        match &self.source {
            Source::Stream(stream) => Some(stream.interrupt()),
            Source::File(file) => file.interrupt(),
        }
    }
    fn remarks(&self) -> Remarks {
        match &self.source {
            Source::Stream(stream) => stream.remarks.clone(),
            Source::File(file) => file.remarks(),
        }
    }
}

/// The facts of an address before its pictures are analysed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct About {
    /// It has a length: in bytes, or of a playlist in seconds.
    finite: bool,
    /// Whether its format has time stamps; `None` if unknown.
    timed: Option<bool>,
}

impl About {
    /// Runs ffprobe over a separate connection. Returns nothing if it is missing, refused or too slow.
    fn ask(program: &Path, input: &Input) -> Self {
        let child = Command::new(probe(program))
            .args(["-v", "quiet", "-nofind_stream_info", "-rw_timeout", &SILENCE.as_micros().to_string()])
            .args(input.guards())
            .args(["-show_entries", "format=format_name,size,duration", "-of", "default=noprint_wrappers=1"])
            .arg(&input.name)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let Ok(mut child) = child else { return Self::default() };
        let mut output = child.stdout.take().expect("it was asked for a pipe");
        let leash = Leash::default();
        leash.hold(child);
        let end = leash.end_after(PROBE);
        let mut text = String::new();
        let read = std::io::Read::read_to_string(&mut output, &mut text);
        drop(end);
        leash.end();
        if read.is_ok() { Self::read(&text) } else { Self::default() }
    }

    fn read(text: &str) -> Self {
        let field = |name: &str| text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix('='));
        let positive =
            |name| field(name).and_then(|text| text.parse::<f64>().ok()).is_some_and(|n| n > 0.0 && n.is_finite());
        let format = field("format_name");
        // The size of a playlist is that of its text.
        let finite = positive("duration") || (format != Some("hls") && positive("size"));
        Self { finite: finite && format.is_some(), timed: format.map(is_timed) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_with_a_length_has_an_end() {
        let about = |text: &str| About::read(text);
        let known = |finite, timed| About { finite, timed: Some(timed) };
        let mp4 = "mov,mp4,m4a,3gp,3g2,mj2";
        assert_eq!(about(&format!("format_name={mp4}\nduration=12.0\nsize=N/A\n")), known(true, true));
        assert_eq!(about("format_name=mpegts\nduration=N/A\nsize=512864\n"), known(true, true));
        assert_eq!(about("format_name=mpegts\nduration=N/A\nsize=N/A\n"), known(false, true));
        assert_eq!(about("format_name=hls\nduration=12.000000\nsize=232\n"), known(true, true));
        assert_eq!(about("format_name=hls\nduration=N/A\nsize=217\n"), known(false, true));
        assert_eq!(about("format_name=mpjpeg\nduration=N/A\nsize=N/A\n"), known(false, false));
        assert_eq!(about("format_name=h264\nduration=N/A\nsize=423392\n"), known(true, false));
        assert_eq!(about(""), About::default());
        let none =
            Input { name: "http://127.0.0.1:9/x".into(), protocols: "http,tcp", kinds: "mov".into(), options: vec![] };
        assert_eq!(About::ask(Path::new("no-such-ffmpeg"), &none), About::default());
    }
}
