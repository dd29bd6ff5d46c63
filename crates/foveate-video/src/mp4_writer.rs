//! Pictures to an H.264 video in MP4 that any player and browser shows.
//!
//! The video is cut into closed groups of pictures, which are coded side by side on threads of their own.
//! So it does not depend on the number of threads, and the caller rarely waits.

use std::collections::VecDeque;
use std::path::Path;
use std::thread::JoinHandle;

use rusty_h264::{Encoder, EncoderConfig, YuvFrame};

use crate::mux::{Track, bx, file_type};
use crate::timing::{Timing, UNITS};
use crate::yuv::{Colour, Yuv};
use foveate_base::sink::Sink;
use foveate_base::{Error, Result, quiet, thread};
use foveate_core::geometry::Size;
use foveate_core::scene::Image;

/// Frames in a group: a second of video, so that a player finds any place fast.
const GROUP: usize = 30;
/// Finest quantiser: about 41 dB on street scenes, 2.6 Mbit a second at 640 x 480; thin lines stay clean.
const FINEST: u8 = 24;
/// Coarsest quantiser: beyond it boxes and text smear, whatever the bit rate.
const COARSEST: u8 = 36;
/// Steps of the quantiser that halve the bits.
const HALVING: f64 = 6.0;
/// Groups coded at a time at most. Also how far back the sizes lie that choose a group's quantiser, so that the choice does not
/// depend on the number of threads.
const AT_A_TIME: usize = 4;
/// The most macroblocks of 16 x 16 pixels that H.264 allows a frame (level 6.2).
const MAX_BLOCKS: usize = 139_264;

/// A video in the making; dropped before [`finish`](Self::finish), it leaves no file.
#[derive(Debug)]
pub struct Mp4Writer {
    sink: Sink,
    /// Sides as given; the video's are even.
    width: usize,
    height: usize,
    timescale: u32,
    colour: Colour,
    group: Vec<Yuv>,
    busy: VecDeque<Coding>,
    threads: usize,
    track: Track,
    written: u64,
    /// Of each frame pushed, in seconds.
    times: Vec<f64>,
    /// Bits a frame to aim at; `None` takes the finest quantiser.
    aim: Option<f64>,
    /// Groups begun, and of each: its quantiser, and its bits a frame as soon as it is written.
    groups: Vec<Group>,
}

/// What became of a group of pictures.
#[derive(Debug)]
struct Group {
    quantiser: u8,
    frames: usize,
    bits: Option<f64>,
}

/// A group that is being encoded or is done; without threads it is done at once.
#[derive(Debug)]
enum Coding {
    Thread(JoinHandle<Coded>),
    Done(Coded),
}

/// Coded frames with start codes, or why there are none.
type Coded = std::result::Result<Vec<Vec<u8>>, String>;

impl Mp4Writer {
    /// Starts a video that will be `path`, of about `rate` frames a second. Odd sides are padded by one column or row.
    ///
    /// # Errors
    /// [`Error::Invalid`] if a side is 0, the picture is larger than H.264 allows, or the rate is not above 0 and
    /// below 4 million; [`Error::Io`] if the folder is not writable.
    pub fn create(path: impl AsRef<Path>, width: usize, height: usize, rate: f64) -> Result<Self> {
        let path = path.as_ref();
        let timescale = Self::check(path, width, height, rate)?;
        Self::begin(Sink::create(path)?, width, height, timescale)
    }

    /// The same into any writer; errors call it `name`.
    ///
    /// # Errors
    /// As [`Mp4Writer::create`].
    pub fn to(sink: Sink, name: impl AsRef<Path>, width: usize, height: usize, rate: f64) -> Result<Self> {
        let timescale = Self::check(name.as_ref(), width, height, rate)?;
        Self::begin(sink, width, height, timescale)
    }

    /// Time units in a second of a video that can be written.
    fn check(path: &Path, width: usize, height: usize, rate: f64) -> Result<u32> {
        let blocks = width.div_ceil(16).saturating_mul(height.div_ceil(16));
        if blocks == 0 || blocks > MAX_BLOCKS || width.max(height) > 16384 {
            return Err(Error::Invalid(format!(
                "{}: expected a picture of 1 to {MAX_BLOCKS} blocks of 16 x 16 pixels, got {width} x {height} pixels; make it smaller",
                path.display()
            )));
        }
        // Frames that last longer have times of their own.
        let timescale = (rate * f64::from(UNITS)).round().max(1.0);
        if !(rate > 0.0 && timescale <= f64::from(u32::MAX)) {
            return Err(Error::Invalid(format!(
                "{}: expected a rate above 0, up to 4 million frames a second, got {rate}",
                path.display()
            )));
        }
        Ok(timescale as u32)
    }

    fn begin(mut sink: Sink, width: usize, height: usize, timescale: u32) -> Result<Self> {
        let head = file_type();
        sink.write(&head)?;
        Ok(Self {
            sink,
            width,
            height,
            timescale,
            colour: Colour::new(None, false, width, height),
            group: Vec::new(),
            busy: VecDeque::new(),
            threads: std::thread::available_parallelism().map_or(1, |n| n.get().min(AT_A_TIME)),
            track: Track::default(),
            written: head.len() as u64,
            times: Vec::new(),
            aim: None,
            groups: Vec::new(),
        })
    }

    /// Sets a target bit rate, bits a second: if the finest quantiser exceeds it, a coarser one is used, down to a
    /// bound. Without a positive target the finest quantiser is used.
    #[must_use]
    pub fn aiming_at(self, bit_rate: Option<f64>) -> Self {
        let rate = f64::from(self.timescale) / f64::from(UNITS);
        Self { aim: bit_rate.filter(|bits| bits.is_finite() && *bits > 0.0).map(|bits| bits / rate), ..self }
    }

    /// Appends a picture that is shown `time` seconds after any origin; the first one is shown at once. Grey ones are shown grey.
    /// Times keep a millionth of a second; a frame whose time does not rise is shown for one unit of the file's clock.
    ///
    /// # Errors
    /// [`Error::Invalid`] if its size is not that of the video or the time is NaN; [`Error::Io`] if an earlier
    /// picture cannot be written.
    pub fn push(&mut self, image: &Image, time: f64) -> Result<()> {
        let expected = Size::new(self.width, self.height);
        if image.size() != expected {
            return Err(Error::Invalid(format!(
                "frame {} of a video: expected {expected} pixels, got {}",
                self.times.len() + 1,
                image.size()
            )));
        }
        if !time.is_finite() {
            let frame = self.times.len() + 1;
            return Err(Error::Invalid(format!("frame {frame} of a video: expected a time in seconds, got {time}")));
        }
        self.times.push(time);
        self.group.push(Yuv::from_image(image, self.colour));
        if self.group.len() == GROUP {
            self.start_group()?;
        }
        Ok(())
    }

    /// Writes the remaining frames and renames the file to its final name. Without a frame there is no file.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written; no partial file is left.
    pub fn finish(mut self) -> Result<()> {
        self.start_group()?;
        while let Some(group) = self.busy.pop_front() {
            self.write_group(group)?;
        }
        if self.track.sizes.is_empty() {
            return Ok(());
        }
        let (width, height) = (self.width.next_multiple_of(2), self.height.next_multiple_of(2));
        let timing = Timing::of(&self.times, self.timescale);
        self.sink.write(&self.track.index(width, height, &timing, self.colour))?;
        self.sink.finish()
    }

    /// Submits the group for encoding, and writes the oldest one if one is in progress on every thread.
    fn start_group(&mut self) -> Result<()> {
        let frames = std::mem::take(&mut self.group);
        if frames.is_empty() {
            return Ok(());
        }
        if self.busy.len() >= self.threads
            && let Some(oldest) = self.busy.pop_front()
        {
            self.write_group(oldest)?;
        }
        let quantiser = self.quantiser(&frames)?;
        self.groups.push(Group { quantiser, frames: frames.len(), bits: None });
        self.busy.push_back(match cfg!(target_family = "wasm") {
            true => Coding::Done(coded(frames, quantiser)),
            false => Coding::Thread(thread::start("coding the film", move || coded(frames, quantiser))?),
        });
        Ok(())
    }

    /// The quantiser of the next group: the one at which groups far enough back would have met the aim. The first groups have
    /// none behind them: the very first is coded at the finest quantiser to see.
    fn quantiser(&self, frames: &[Yuv]) -> Result<u8> {
        let Some(aim) = self.aim else { return Ok(FINEST) };
        let meeting = |bits: f64, quantiser: f64| quantiser + HALVING * (bits / aim).max(f64::MIN_POSITIVE).log2();
        let known = self.groups.len().saturating_sub(AT_A_TIME - 1);
        let behind = &self.groups[known.saturating_sub(AT_A_TIME)..known];
        let wanted = match (behind, self.groups.first()) {
            ([], None) => {
                let bits = 8 * coded(frames.to_vec(), FINEST).map_err(refused)?.iter().map(Vec::len).sum::<usize>();
                meeting(bits as f64 / frames.len() as f64, f64::from(FINEST))
            }
            ([], Some(first)) => f64::from(first.quantiser),
            (behind, _) => {
                let each = behind.iter().filter_map(|g| Some(meeting(g.bits?, f64::from(g.quantiser))));
                each.sum::<f64>() / behind.len() as f64
            }
        };
        Ok(wanted.round().clamp(f64::from(FINEST), f64::from(COARSEST)) as u8)
    }

    fn write_group(&mut self, group: Coding) -> Result<()> {
        let frames = match group {
            Coding::Thread(thread) => thread.join().unwrap_or_else(|_| Err("the encoder failed".into())),
            Coding::Done(coded) => coded,
        };
        let frames = frames.map_err(refused)?;
        let mut body = Vec::new();
        self.track.keys.push(self.track.sizes.len() as u32 + 1);
        for frame in frames {
            let start = body.len();
            for unit in units(&frame) {
                let (sps, pps) = self.track.parameters.get_or_insert_default();
                match unit.first().map_or(0, |head| head & 31) {
                    7 if sps.is_empty() => *sps = unit.to_vec(),
                    8 if pps.is_empty() => *pps = unit.to_vec(),
                    1..=5 => {
                        body.extend((unit.len() as u32).to_be_bytes());
                        body.extend(unit);
                    }
                    _ => {}
                }
            }
            self.track.offsets.push(self.written + 8 + start as u64);
            self.track.sizes.push((body.len() - start) as u32);
        }
        if let Some(group) = self.groups.iter_mut().find(|group| group.bits.is_none()) {
            group.bits = Some(8.0 * body.len() as f64 / group.frames as f64);
        }
        let mdat = bx(b"mdat", &[&body]);
        self.written += mdat.len() as u64;
        self.sink.write(&mdat)
    }
}

fn refused(problem: String) -> Error {
    Error::Invalid(format!("the annotated video: {problem}"))
}

/// [`encode`] with panics of the encoder turned into errors.
fn coded(frames: Vec<Yuv>, quantiser: u8) -> Coded {
    quiet::catch(|| encode(frames, quantiser)).unwrap_or_else(|panic| Err(format!("the encoder failed ({panic})")))
}

/// One closed group of pictures.
fn encode(frames: Vec<Yuv>, quantiser: u8) -> Coded {
    // Constrained Baseline without look-ahead: each picture in gives one out, at once.
    let mut config = EncoderConfig::baseline(frames[0].width, frames[0].height);
    config.qp = quantiser;
    config.gop_size = GROUP as u32;
    let mut encoder = Encoder::new(config).map_err(|error| format!("the encoder refused: {error:?}"))?;
    let code = |yuv: Yuv| {
        let frame = YuvFrame { width: yuv.width, height: yuv.height, y: yuv.y, u: yuv.u, v: yuv.v };
        encoder.try_encode(&frame).map_err(|error| format!("the encoder refused: {error:?}"))
    };
    frames.into_iter().map(code).collect()
}

/// The NAL units between start codes.
fn units(stream: &[u8]) -> impl Iterator<Item = &[u8]> {
    let starts: Vec<usize> =
        stream.windows(3).enumerate().filter(|(_, bytes)| *bytes == [0, 0, 1]).map(|(at, _)| at + 3).collect();
    let ends = starts.iter().skip(1).map(|start| start - 3).chain([stream.len()]).collect::<Vec<_>>();
    starts.into_iter().zip(ends).map(|(start, end)| {
        let unit = &stream[start..end];
        // A NAL unit never ends in a zero byte; those before the next start code are padding.
        &unit[..unit.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1)]
    })
}

#[cfg(test)]
mod tests;
