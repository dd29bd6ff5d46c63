//! Sources that give each frame but once: streams and cameras that the user named, and frames that the page pushes.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use foveate::report::interactive::{Frames, Recent, check_size};
use foveate::video::{FrameSource, Live as Stream, LiveOptions, Meter, Pace, SourceInfo, decode_image, newest};
use foveate::{Error, Result};

use super::video::jpeg;

/// How long a frame of a stream is waited for.
const PATIENCE: Duration = Duration::from_secs(15);

/// A source, and its last frames.
pub struct Live {
    pub recent: Recent,
    /// `None` where the page pushes the frames.
    stream: Option<Pulled>,
}

struct Pulled {
    source: Box<dyn FrameSource>,
    meter: Meter,
    /// Frames of its meter that were counted already.
    counted: u64,
    /// Until when a frame is waited for.
    until: Arc<Mutex<Instant>>,
}

impl Live {
    /// Opens a stream or a camera as `foveate track` does: its newest frame is kept, others are dropped. A file with an end waits.
    pub fn open(address: &Path) -> Result<(Self, SourceInfo)> {
        let notify = |text: &str| note!("foveate: {text}");
        let source = Stream::open(address, LiveOptions { notify, ..LiveOptions::default() })?;
        check_size(source.info(), address)?;
        let until = Arc::new(Mutex::new(Instant::now()));
        let deadline = Arc::clone(&until);
        let late = move || Instant::now() > *deadline.lock().unwrap_or_else(PoisonError::into_inner);
        let pace = Pace { every_frame: source.is_finite(), ..Pace::default() };
        let (source, meter) = newest(Box::new(source), pace, late);
        // The number of frames of a file is an estimate; here it goes on until it ends.
        let info = SourceInfo { frames: None, ..source.info().clone() };
        let recent = Recent::new(info.width, info.height);
        Ok((Self { recent, stream: Some(Pulled { source, meter, counted: 0, until }) }, info))
    }

    /// Frames of this size will be pushed.
    pub fn pushed(width: usize, height: usize, rate: f64) -> Result<(Self, SourceInfo)> {
        let rate = if rate.is_finite() && (1.0..=1000.0).contains(&rate) { rate } else { 30.0 };
        let info = SourceInfo { width, height, frames: None, rate, reader: "the browser".into() };
        if width == 0 || height == 0 {
            return Err(Error::Invalid("the camera has no picture; choose it again".into()));
        }
        check_size(&info, Path::new("camera"))?;
        Ok((Self { recent: Recent::new(width, height), stream: None }, info))
    }

    /// Waits for a frame newer than all before, where a stream has one; of one that has ended there is none.
    pub fn pull(&mut self) -> Result<()> {
        let Some(stream) = &mut self.stream else { return Ok(()) };
        let until = Instant::now() + PATIENCE;
        *stream.until.lock().unwrap_or_else(PoisonError::into_inner) = until;
        match stream.source.next() {
            Some(frame) => {
                let frame = frame?;
                let missed = stream.meter.dropped() - stream.counted;
                stream.counted += missed;
                self.recent.push(frame.image, frame.time, missed).map(drop)
            }
            None if Instant::now() > until => {
                let seconds = PATIENCE.as_secs();
                Err(Error::Invalid(format!("no frame came for {seconds} s; check the source, and press play to go on")))
            }
            None => Ok(()),
        }
    }

    /// Takes a frame of the page, a JPEG; its number, from 1.
    pub fn push(&self, picture: &[u8], time: f64, missed: u64) -> Result<usize> {
        if self.stream.is_some() {
            return Err(Error::Invalid("this source takes no frames of the page".into()));
        }
        let image =
            decode_image(picture).map_err(|problem| Error::Invalid(format!("the camera's frame: {problem}")))?;
        self.recent.push(image.with_planes(3), time, missed).map(|index| index + 1)
    }

    /// A frame that is kept, as a picture for the page.
    pub fn picture(&self, index: usize) -> Result<Option<Arc<[u8]>>> {
        let frame = self.recent.clone().frame(index)?;
        Ok(frame.map(|frame| jpeg(&frame.image).into()))
    }

    /// Whether frame `index` (from 0) is the next that this source has to give.
    pub fn is_due(&self, index: usize) -> bool {
        self.stream.is_some() && index == self.recent.count()
    }
}
