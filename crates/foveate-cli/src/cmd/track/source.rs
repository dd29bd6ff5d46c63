//! The frame source of the command line: a file, a pipe, a stream or a camera; the selected frames and their scale.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use foveate::geometry::{BBox, Size};
use foveate::text::counted;
use foveate::video::{
    Decoder, FrameSource, Live, LiveOptions, Meter, Options, Pace, Pixels, Raw, Remarks, Selection, SourceInfo,
    TileFolder, ahead_until, is_live, newest, open_with, select,
};
use foveate::{Error, Result};

use crate::terminal;

/// How a video is decoded.
#[derive(clap::Args)]
pub(crate) struct DecoderArgs {
    /// Video decoder; auto uses ffmpeg if it is installed and faster. The results do not depend on it
    #[arg(long, value_name = "auto|builtin|ffmpeg", default_value = "auto", value_parser = named(Decoder::ALL))]
    decoder: Decoder,
    #[command(flatten)]
    sandbox: SandboxArg,
}

#[derive(clap::Args, Clone, Copy)]
pub(crate) struct SandboxArg {
    /// Decode H.264 and pictures in a child process without access to files and network; refuse other sources (Linux)
    #[arg(long)]
    sandbox: bool,
}

impl DecoderArgs {
    pub(crate) fn options(&self) -> Options {
        Options { decoder: self.decoder, ..self.sandbox.options() }
    }
}

impl SandboxArg {
    pub(crate) fn options(self) -> Options {
        Options { sandbox: self.sandbox.then(crate::invocation::sandbox), ..Options::default() }
    }
}

#[derive(clap::Args)]
pub(crate) struct SourceArgs {
    #[command(flatten)]
    decoder: DecoderArgs,
    /// Read raw pixels of this size, frame after frame; see --pix
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = parse_size)]
    raw: Option<Size>,
    /// Pixel format of raw pixels; default: rgb24
    #[arg(long, value_name = "rgb24|bgr24|gray", requires = "raw", value_parser = named(Pixels::ALL))]
    pix: Option<Pixels>,
    /// Start at this frame of a file, counted from 1; --init is the box in it
    #[arg(long, value_name = "FRAME", value_parser = clap::value_parser!(u64).range(1..), conflicts_with = "load_state")]
    from: Option<u64>,
    /// Track only every N-th frame, starting with the first. Frames keep their numbers
    #[arg(long, value_name = "N", default_value_t = 1, hide_default_value = true, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Reduce the pictures by this factor, above 0 and at most 1. All input and output boxes are in pixels of the reduced pictures
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, hide_default_value = true, value_parser = parse_scale)]
    scale: f64,
    /// Drop no frame of a stream or camera: the source waits for the tracker
    #[arg(long)]
    every_frame: bool,
    /// Drop frames that waited for the tracker longer than this, in milliseconds since they were read. A pipe, which otherwise drops no
    /// frame, then also yields only its newest frame
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u64).range(1..))]
    max_latency: Option<u64>,
    /// Wait at the address for a sender (rtsp and http) instead of connecting to it
    #[arg(long)]
    listen: bool,
    /// Time limit for reopening an interrupted stream, in seconds, 60 by default; 0 disables reopening
    #[arg(long, value_name = "SECONDS")]
    reconnect: Option<u64>,
}

/// Returns a value by its name.
pub(crate) fn named<T: Copy + Send + Sync + 'static, const N: usize>(
    all: [(&'static str, T); N],
) -> impl TypedValueParser<Value = T> {
    let find = move |name: String| all.into_iter().find(|(n, _)| *n == name).expect("it is one of them").1;
    PossibleValuesParser::new(all.map(|(name, _)| name)).map(find)
}

pub(crate) fn parse_size(text: &str) -> std::result::Result<Size, String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some(Size::new(w.parse().ok()?, h.parse().ok()?)));
    sides
        .filter(|size| size.width > 0 && size.height > 0)
        .ok_or_else(|| format!("expected WIDTHxHEIGHT such as 640x480, got \"{text}\""))
}

fn parse_scale(text: &str) -> std::result::Result<f64, String> {
    let factor = text.parse().ok().filter(|factor| *factor > 0.0 && *factor <= 1.0);
    factor.ok_or_else(|| format!("expected a factor above 0 and at most 1, such as 0.5, got \"{text}\""))
}

/// Returns whether a source has no known end: a stream, a camera, standard input or a fifo.
pub(crate) fn is_endless(source: &Path) -> bool {
    let piped = std::fs::metadata(source).is_ok_and(|about| !about.is_file() && !about.is_dir());
    is_live(source) || source == Path::new("-") || piped
}

/// An opened source that has not been read yet.
pub(crate) struct Opened {
    pub source: Box<dyn FrameSource>,
    /// Whether its end is unknown.
    pub endless: bool,
    /// Whether it is a stream or a camera: its frames are counted from the first that arrives.
    pub joined: bool,
    /// The tile folder, if the pictures are in tiles; the source then yields only their numbers.
    pub tiles: Option<TileFolder>,
    pace: Pace,
    reconnected: Option<Arc<AtomicU64>>,
}

/// A source in use, and its counters.
pub(crate) struct Started {
    pub source: Box<dyn FrameSource>,
    pub counts: SourceCounts,
}

/// The numbers of dropped frames and of reconnections, updated while the source is read.
pub(crate) struct SourceCounts {
    /// The meter of a source that can drop frames.
    pub meter: Option<Meter>,
    reconnected: Option<Arc<AtomicU64>>,
}

impl SourceArgs {
    pub(crate) fn selection(&self) -> Selection {
        let from = self.from.map_or(0, |from| usize::try_from(from - 1).unwrap_or(usize::MAX));
        Selection { from, every: self.every as usize, scale: self.scale }
    }

    /// Starts at a frame, counted from 0.
    pub(super) fn start_at(&mut self, frame: usize) {
        self.from = Some(frame as u64 + 1);
    }

    /// Converts a box of the video to the pixels of the scaled pictures.
    pub(crate) fn scaled(&self, b: &BBox) -> BBox {
        let s = self.scale;
        BBox { x: s * b.x, y: s * b.y, w: s * b.w, h: s * b.h }
    }

    pub(crate) fn options(&self) -> Options {
        let raw = self.raw.map(|Size { width, height }| Raw { width, height, pixels: self.pix.unwrap_or_default() });
        Options { raw, notify: note_line, ..self.decoder.options() }
    }

    /// Opens a source.
    pub(crate) fn open(&self, path: &Path) -> Result<Opened> {
        self.open_selected(path, self.selection())
    }

    /// Opens a source of these frames; a stream or a camera begins with the first frame that arrives.
    pub(super) fn open_selected(&self, path: &Path, selection: Selection) -> Result<Opened> {
        let (live, mut endless, mut joined) = (is_live(path), is_endless(path), false);
        let wrong = |what: &str| Error::Invalid(format!("{}: {what}", path.display()));
        if self.listen && !live {
            return Err(wrong("--listen is for rtsp:// and http://; leave it out"));
        }
        if !endless && (self.every_frame || self.max_latency.is_some()) {
            return Err(wrong("every frame of a file is tracked in; leave out --every-frame and --max-latency"));
        }
        if self.reconnect.is_some() && !live {
            return Err(wrong("--reconnect is for streams and cameras; leave it out"));
        }
        if (live || path.is_dir()) && self.raw.is_some() {
            return Err(wrong("--raw is for files and pipes; leave it out"));
        }
        if self.decoder.sandbox.sandbox && (live || TileFolder::is_at(path)) {
            return Err(wrong("--sandbox is for video files and folders of images; leave it out"));
        }
        let tiles = TileFolder::is_at(path).then(|| TileFolder::open(path)).transpose()?;
        let halvings = -self.scale.log2();
        if tiles.is_some() && halvings.fract() != 0.0 {
            return Err(wrong("of tiles --scale may be 0.5, 0.25, 0.125 and so on"));
        }
        let tiles = tiles.map(|tiles| tiles.halved(halvings as usize));
        let max_latency = self.max_latency.map(Duration::from_millis);
        let (source, reconnected): (Box<dyn FrameSource>, _) = if let Some(tiles) = &tiles {
            (Box::new(tiles.frames()), None)
        } else if live {
            let usual = LiveOptions::default();
            let reconnect = self.reconnect.map_or(usual.reconnect, Duration::from_secs);
            let options = LiveOptions { listen: self.listen, reconnect, notify: note_line, ..usual };
            let source = Live::open(path, options)?;
            // The source waits for the tracker unless only new frames are wanted.
            joined = !source.is_finite();
            endless = joined || max_latency.is_some();
            let reconnected = source.reconnections();
            (Box::new(source), Some(reconnected))
        } else {
            (open_with(path, &self.options())?, None)
        };
        if endless && self.from.is_some() {
            return Err(wrong("--from is for files; leave it out"));
        }
        let pace = Pace { every_frame: self.every_frame || (!live && max_latency.is_none()), max_latency };
        // Tiles are already scaled.
        let scale = if tiles.is_some() { 1.0 } else { self.scale };
        let from = if joined { 0 } else { selection.from };
        let source = select(source, Selection { from, scale, ..selection });
        self.check_from(source.info())?;
        Ok(Opened { source, endless, joined, tiles, pace, reconnected })
    }

    fn check_from(&self, about: &SourceInfo) -> Result<()> {
        match (self.from, about.exact_frames()) {
            (Some(from), Some(n)) if from > n as u64 => {
                Err(Error::Invalid(format!("--from {from}: the video has {}; give at most that", counted(n, "frame"))))
            }
            _ => Ok(()),
        }
    }
}

impl Opened {
    /// Starts reading ahead, or reading the newest frame, until the program is stopped.
    pub(crate) fn start(self) -> Started {
        if let Some(shape) = self.source.remarks().shape() {
            note!("foveate: {shape}");
        }
        let (source, meter) = if self.endless {
            let (source, meter) = newest(self.source, self.pace, terminal::stopping);
            (source, Some(meter))
        } else {
            (ahead_until(self.source, terminal::stopping), None)
        };
        Started { source, counts: SourceCounts { meter, reconnected: self.reconnected } }
    }
}

impl SourceCounts {
    /// Prints the counts at the end of the run.
    pub(crate) fn note(&self) {
        let dropped = self.meter.as_ref().map_or(0, Meter::dropped);
        let again = self.reconnected.as_ref().map_or(0, |n| n.load(Ordering::Relaxed));
        if dropped > 0 {
            let frames = counted(dropped as usize, "frame");
            note!(
                "foveate: {frames} dropped that came while the tracker was busy; --every-frame without --max-latency tracks in all"
            );
        }
        if again > 0 {
            note!("foveate: the stream was opened again {}", counted(again as usize, "time"));
        }
    }
}

/// Prints a message of the source immediately.
fn note_line(text: &str) {
    note!("foveate: {text}");
}

/// The destination of lines that are written while frames are tracked.
#[derive(Clone, Debug)]
pub(crate) enum StreamTo {
    Json,
    Mot,
    Udp(String),
}

pub(crate) fn parse_stream(text: &str) -> std::result::Result<StreamTo, String> {
    match (text, text.strip_prefix("udp:")) {
        ("json", _) => Ok(StreamTo::Json),
        ("mot", _) => Ok(StreamTo::Mot),
        (_, Some(address)) if address.contains(':') => Ok(StreamTo::Udp(address.to_owned())),
        _ => Err(format!("expected json, mot or udp:HOST:PORT, got \"{text}\"")),
    }
}

impl StreamTo {
    /// Returns the observer that writes the lines. Standard output is then reserved for them.
    pub(crate) fn observer(&self, meter: Option<Meter>, remarks: Remarks) -> Result<foveate::report::Stream> {
        use foveate::report::{Stream, stream::Format};
        match self {
            Self::Json => Ok(Stream::new(std::io::stdout(), Format::Json, meter, remarks)),
            Self::Mot => Ok(Stream::new(std::io::stdout(), Format::Mot, meter, remarks)),
            Self::Udp(address) => Stream::udp(address, Format::Json, meter, remarks),
        }
    }

    /// Returns whether the lines go to standard output.
    pub(crate) fn takes_output(&self) -> bool {
        !matches!(self, Self::Udp(_))
    }
}
