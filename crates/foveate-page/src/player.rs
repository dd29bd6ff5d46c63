//! Random access to the frames of a video.

use std::sync::Arc;

use foveate_base::Result;
use foveate_video::{Frame, FrameSource, Remarks};

/// Number of frames before a requested one that are also decoded, for steps back, if the source can be opened anywhere.
pub const BEFORE: usize = 16;

/// Frames by their number.
pub trait Frames: Send {
    /// Returns frame `index` (from 0); `None` if the video ends before it.
    ///
    /// # Errors
    /// It cannot be read, or is no longer available.
    fn frame(&mut self, index: usize) -> Result<Option<Arc<Frame>>>;
    /// Returns the frame before `index` (for the first frame, the next one) if available, and `index` itself.
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
    /// Returns whether earlier frames can be read again; a camera's cannot.
    fn repeats(&self) -> bool {
        true
    }
    /// Returns remarks on the video, such as damage.
    fn remarks(&self) -> Remarks {
        Remarks::default()
    }
}

/// Frames, with a cache of the last one.
pub(crate) struct Kept {
    frames: Box<dyn Frames>,
    /// The frame that was read last.
    pub last: Option<Arc<Frame>>,
}

impl Kept {
    /// Creates a reader that has read no frame.
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
    fn remarks(&self) -> Remarks {
        self.frames.remarks()
    }
}

/// A video that can be opened repeatedly.
pub trait Reopen: Send {
    /// Returns its frames from `from` on (from 0), which is 0 except for pictures.
    ///
    /// # Errors
    /// It cannot be opened.
    fn source(&self, from: usize) -> Result<Box<dyn FrameSource>>;
    /// Returns the number and the frame rate of a sequence of pictures, which can be opened at any place.
    fn pictures(&self) -> Option<(usize, f64)> {
        None
    }
}

/// Reads frames: consecutive ones quickly, others by opening the video again.
pub struct Player<V> {
    video: V,
    source: Option<Box<dyn FrameSource>>,
    /// The number of the next frame of the source.
    next: usize,
    last: Option<Arc<Frame>>,
    remarks: Remarks,
}

foveate_base::opaque_debug!(Player<V>);

impl<V: Reopen> Player<V> {
    /// Creates a player of a video, which is not opened yet.
    pub fn new(video: V) -> Self {
        Self { video, source: None, next: 0, last: None, remarks: Remarks::default() }
    }

    /// Returns frame `index` as [`Frames::frame`] does. Passes frames read on the way to `passed`, except those that could be skipped.
    ///
    /// # Errors
    /// As [`Frames::frame`].
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
