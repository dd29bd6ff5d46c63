//! Frames of a video in any order.

use std::sync::Arc;

use foveate_base::Result;
use foveate_video::{Frame, FrameSource, Remarks};

/// Frames before one that was asked for that are decoded, too, where a source can be opened anywhere: for steps back.
pub const BEFORE: usize = 16;

/// Frames by their number.
pub trait Frames: Send {
    /// Frame `index` (from 0); `None` where the video ends before.
    ///
    /// # Errors
    /// It cannot be read, or is gone.
    fn frame(&mut self, index: usize) -> Result<Option<Arc<Frame>>>;
    /// The frame before `index`, of the first one the next, where it can be had; and `index` itself.
    ///
    /// # Errors
    /// As [`Frames::frame`] of `index`.
    fn pair(&mut self, index: usize) -> Result<[Option<Arc<Frame>>; 2]> {
        let Some(before) = index.checked_sub(1) else {
            let frame = self.frame(index)?;
            return Ok([self.frame(1).ok().flatten(), frame]);
        };
        Ok([self.frame(before).ok().flatten(), self.frame(index)?])
    }
    /// Whether earlier frames can be had again; a camera's cannot.
    fn repeats(&self) -> bool {
        true
    }
    /// What was found in the video, such as damage.
    fn remarks(&self) -> Remarks {
        Remarks::default()
    }
}

/// Frames, of which the one read last is kept.
pub(crate) struct Kept {
    frames: Box<dyn Frames>,
    /// The frame that was read last.
    pub last: Option<Arc<Frame>>,
}

impl Kept {
    /// No frame is read yet.
    pub(crate) fn new(frames: Box<dyn Frames>) -> Self {
        Self { frames, last: None }
    }
}

impl Frames for Kept {
    fn frame(&mut self, index: usize) -> Result<Option<Arc<Frame>>> {
        let frame = self.frames.frame(index)?;
        if frame.is_some() {
            self.last.clone_from(&frame);
        }
        Ok(frame)
    }
    fn repeats(&self) -> bool {
        self.frames.repeats()
    }
}

/// A video that can be opened again and again.
pub trait Reopen: Send {
    /// Its frames, from `from` on (from 0), which is 0 but for pictures.
    ///
    /// # Errors
    /// It cannot be opened.
    fn source(&self, from: usize) -> Result<Box<dyn FrameSource>>;
    /// Of a row of pictures, which can be opened at any place: how many there are, and how many a second.
    fn pictures(&self) -> Option<(usize, f64)> {
        None
    }
}

/// Reads frames; those in a row fast, others by opening the video again.
pub struct Player<V> {
    video: V,
    source: Option<Box<dyn FrameSource>>,
    /// The number of the frame that the source gives next.
    next: usize,
    last: Option<Arc<Frame>>,
    remarks: Remarks,
}

impl<V: Reopen> Player<V> {
    /// Of a video; nothing is opened yet.
    pub fn new(video: V) -> Self {
        Self { video, source: None, next: 0, last: None, remarks: Remarks::default() }
    }

    /// [`Frames::frame`]. Frames read on the way, but not those that could be left out, come to `passed`.
    ///
    /// # Errors
    /// As there.
    pub fn passing(&mut self, index: usize, mut passed: impl FnMut(&Frame)) -> Result<Option<Arc<Frame>>> {
        if let Some(frame) = self.last.as_ref().filter(|frame| frame.index == index) {
            return Ok(Some(Arc::clone(frame)));
        }
        let (from, pictures) = (index.saturating_sub(BEFORE), self.video.pictures());
        if pictures.is_some_and(|(count, _)| index >= count) {
            return Ok(None);
        }
        if self.source.is_none() || index < self.next || (pictures.is_some() && from > self.next) {
            self.next = if pictures.is_some() { from } else { 0 };
            let source = self.video.source(self.next)?;
            self.remarks = source.remarks();
            self.source = Some(source);
        }
        while let Some(source) = &mut self.source {
            let Some(frame) = source.next().transpose().inspect_err(|_| self.source = None)? else {
                self.source = None;
                break;
            };
            let time = pictures.map_or(frame.time, |(_, rate)| self.next as f64 / rate.max(1.0));
            let frame = Arc::new(Frame { index: self.next, time, ..frame });
            self.next += 1;
            if frame.index == index {
                self.last = Some(Arc::clone(&frame));
                return Ok(Some(frame));
            }
            passed(&frame);
        }
        Ok(None)
    }
}

impl<V: Reopen> Frames for Player<V> {
    fn frame(&mut self, index: usize) -> Result<Option<Arc<Frame>>> {
        self.passing(index, |_| ())
    }
    fn remarks(&self) -> Remarks {
        self.remarks.clone()
    }
}
