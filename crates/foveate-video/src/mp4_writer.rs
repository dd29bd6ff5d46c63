//! Pictures to an H.264 video in MP4 that any player and browser shows.
//!
//! The video is cut into closed groups of pictures, which are coded side by side on threads of their own.
//! So it does not depend on the number of threads, and the caller rarely waits.

use std::collections::VecDeque;
use std::path::Path;
use std::thread::JoinHandle;

use rusty_h264::{Encoder, EncoderConfig, YuvFrame};

use crate::mux::{Track, UNITS, bx, file_type};
use crate::yuv::{Colour, Yuv};
use foveate_base::sink::Sink;
use foveate_base::{Error, Result, quiet, thread};
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
    /// Bits a frame to aim at; `None` takes the finest quantiser.
    aim: Option<f64>,
    /// Groups begun, and of each: its quantiser, and its bits a frame as soon as it is written.
    groups: Vec<Group>,
}

/// What became of a group of pictures.
struct Group {
    quantiser: u8,
    frames: usize,
    bits: Option<f64>,
}

/// A group that is being coded, or was: where there are no threads it is at once.
enum Coding {
    Thread(JoinHandle<Coded>),
    Done(Coded),
}

/// Coded frames with start codes, or why there are none.
type Coded = std::result::Result<Vec<Vec<u8>>, String>;

impl Mp4Writer {
    /// Starts a video that will be `path`, of `rate` frames a second. Odd sides are padded by one column or row.
    ///
    /// # Errors
    /// [`Error::Invalid`] where a side is 0, the picture is larger than H.264 allows, or the rate is not
    /// above 0 and below 4 million; [`Error::Io`] where the folder cannot be written.
    pub fn create(path: impl AsRef<Path>, width: usize, height: usize, rate: f64) -> Result<Self> {
        let path = path.as_ref();
        let timescale = Self::check(path, width, height, rate)?;
        Self::begin(Sink::create(path)?, width, height, timescale)
    }

    /// The same into something else than a file of its own; `name` stands for it in errors.
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
        let timescale = (rate * f64::from(UNITS)).round();
        if !(timescale >= 1.0 && timescale <= f64::from(u32::MAX)) {
            return Err(Error::Invalid(format!(
                "{}: expected a rate from 0.001 to 4 million frames a second, got {rate}",
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
            aim: None,
            groups: Vec::new(),
        })
    }

    /// Aims at this bit rate, bits a second: where the finest quantiser would need more, a coarser one is taken, down to a bound.
    /// Without an aim, or one that is not above 0, the finest quantiser is taken.
    #[must_use]
    pub fn aiming_at(self, bit_rate: Option<f64>) -> Self {
        let rate = f64::from(self.timescale) / f64::from(UNITS);
        Self { aim: bit_rate.filter(|bits| bits.is_finite() && *bits > 0.0).map(|bits| bits / rate), ..self }
    }

    /// Appends a picture; grey ones are shown grey.
    ///
    /// # Errors
    /// [`Error::Invalid`] where its size is not that of the video; [`Error::Io`] where an earlier one
    /// cannot be written.
    pub fn push(&mut self, image: &Image) -> Result<()> {
        if (image.width(), image.height()) != (self.width, self.height) {
            return Err(Error::Invalid(format!(
                "frame {} of a video: expected {} x {} pixels, got {} x {}",
                self.track.sizes.len() + self.busy.len() * GROUP + self.group.len() + 1,
                self.width,
                self.height,
                image.width(),
                image.height()
            )));
        }
        self.group.push(Yuv::from_image(image, self.colour));
        if self.group.len() == GROUP {
            self.start_group()?;
        }
        Ok(())
    }

    /// Writes what is left and gives the file its name. A video needs a frame: without one there is no file.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be written; nothing is left behind then.
    pub fn finish(mut self) -> Result<()> {
        self.start_group()?;
        while let Some(group) = self.busy.pop_front() {
            self.write_group(group)?;
        }
        if self.track.sizes.is_empty() {
            return Ok(());
        }
        let (width, height) = (self.width.next_multiple_of(2), self.height.next_multiple_of(2));
        self.sink.write(&self.track.index(width, height, self.timescale, self.colour))?;
        self.sink.finish()
    }

    /// Sends the group to be coded; writes the oldest where as many as there are threads are under way.
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

/// [`encode`], where a panic of the encoder is an error too.
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
mod tests {
    use super::*;
    use crate::VideoFile;

    /// A bright square on a ramp, moving.
    fn scene(width: usize, height: usize, t: usize) -> Image {
        let mut data = Vec::new();
        for plane in 0..3 {
            for y in 0..height {
                for x in 0..width {
                    let inside = x.abs_diff(10 + t) < 6 && y.abs_diff(12) < 6;
                    data.push(if inside { 220 - 60 * plane as u8 } else { (x + 2 * y + 20 * plane) as u8 / 2 + 40 });
                }
            }
        }
        Image::new(width, height, 3, data).expect("sizes agree")
    }

    #[test]
    fn a_video_comes_back() {
        for (width, height, n) in [(64, 48, 65), (51, 33, 31), (2, 2, 1)] {
            let dir = tempfile::tempdir().expect("a temporary folder");
            let path = dir.path().join("a.mp4");
            let mut writer = Mp4Writer::create(&path, width, height, 12.5).expect("a writable folder");
            for t in 0..n {
                writer.push(&scene(width, height, t)).expect("a frame of the right size");
            }
            assert!(!path.exists());
            writer.finish().expect("written");
            assert_eq!(std::fs::read_dir(dir.path()).expect("readable").count(), 1);

            let video = VideoFile::open(&path).expect("a video");
            let frames: Vec<_> = video.map(|frame| frame.expect("a good frame")).collect();
            assert_eq!(frames.len(), n);
            let mut squares = 0.0;
            for (t, frame) in frames.iter().enumerate() {
                assert!((frame.time - t as f64 / 12.5).abs() < 1e-9);
                assert_eq!(
                    (frame.image.width(), frame.image.height()),
                    (width.next_multiple_of(2), height.next_multiple_of(2))
                );
                let wanted = scene(width, height, t);
                for y in 0..height {
                    for x in 0..width {
                        let difference = f64::from(frame.image.at(1, x, y)) - f64::from(wanted.at(1, x, y));
                        squares += difference * difference / (n * width * height) as f64;
                    }
                }
            }
            assert!(squares.sqrt() < 5.0, "root mean square error {} of 255", squares.sqrt());
        }
    }

    /// Noise costs many bits: the aim is met within a quarter, or the coarsest quantiser is taken, and one thread writes what
    /// four write.
    #[test]
    fn the_bit_rate_is_near_the_aim() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let noisy = |t: usize| {
            let speck = |i: usize| ((i * 7919 + t * 104_729) % 251) as u8 / 4;
            let image = scene(96, 64, t);
            let data = image.bytes().iter().enumerate().map(|(i, v)| v.saturating_add(speck(i))).collect();
            Image::new(96, 64, 3, data).expect("sizes agree")
        };
        let write = |aim: Option<f64>, threads: usize| {
            let path = dir.path().join("a.mp4");
            let mut writer = Mp4Writer::create(&path, 96, 64, 30.0).expect("a writable folder").aiming_at(aim);
            writer.threads = threads;
            (0..300).for_each(|t| writer.push(&noisy(t)).expect("a frame of the right size"));
            writer.finish().expect("written");
            std::fs::read(&path).expect("a video")
        };
        let rate = |video: &[u8]| 8.0 * video.len() as f64 / 10.0;
        let free = write(None, 4);
        assert_eq!(write(Some(f64::NAN), 4), free);
        assert_eq!(write(Some(10.0 * rate(&free)), 4), free, "bits to spare");
        let aim = 0.5 * rate(&free);
        let half = write(Some(aim), 4);
        assert!((0.75..1.25).contains(&(rate(&half) / aim)), "{} of {aim}", rate(&half));
        assert_eq!(write(Some(aim), 1), half);
        assert!(rate(&write(Some(1.0), 4)) > 0.1 * aim, "no coarser than the coarsest");
    }

    /// A second reader of MP4 agrees on every sample.
    #[test]
    fn the_index_is_understood_by_others() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("a.mp4");
        let mut writer = Mp4Writer::create(&path, 32, 32, 29.97).expect("a writable folder");
        (0..40).for_each(|t| writer.push(&scene(32, 32, t)).expect("a frame of the right size"));
        writer.finish().expect("written");
        let (mp4, bytes) = re_mp4::Mp4::read_file(&path).expect("an MP4");
        let track = mp4.tracks().values().next().expect("a track");
        assert_eq!((track.width, track.height, track.timescale, track.samples.len()), (32, 32, 29970, 40));
        for (i, sample) in track.samples.iter().enumerate() {
            assert_eq!((sample.is_sync, sample.composition_timestamp), (i % GROUP == 0, 1000 * i as i64));
            let length = u32::from_be_bytes(bytes[sample.byte_range()][..4].try_into().expect("four bytes"));
            assert_eq!(u64::from(length) + 4, sample.size, "one slice a frame");
        }
    }

    #[test]
    fn what_cannot_be_written_is_refused_and_leaves_nothing() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("a.mp4");
        for (width, height, rate) in [(0, 4, 30.0), (1 << 40, 1 << 40, 30.0), (4, 4, 0.0), (4, 4, f64::NAN)] {
            assert!(Mp4Writer::create(&path, width, height, rate).is_err());
        }
        assert!(Mp4Writer::create(dir.path().join("no/a.mp4"), 4, 4, 30.0).is_err());
        let mut writer = Mp4Writer::create(&path, 4, 4, 30.0).expect("a writable folder");
        writer.push(&Image::grey(4, 4, 9)).expect("a frame of the right size");
        let text = writer.push(&Image::grey(5, 4, 9)).expect_err("another size").to_string();
        assert!(text.contains("frame 2") && text.contains("5 x 4"), "{text}");
        drop(writer);
        Mp4Writer::create(&path, 4, 4, 30.0).expect("a writable folder").finish().expect("nothing to write");
        assert_eq!(std::fs::read_dir(dir.path()).expect("readable").count(), 0);
    }
}
