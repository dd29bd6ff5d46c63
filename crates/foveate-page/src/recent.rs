//! The most recent frames of a source that yields each frame once: a camera, a stream, or a video that only the browser can decode.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::player::Frames;
use foveate_base::{Error, Result};
use foveate_core::geometry::Size;
use foveate_core::scene::Image;
use foveate_video::{Frame, Meter, Remarks};

/// Number of frames kept for steps back and corrections.
pub(crate) const RECENT: usize = 8;

/// The most recent frames; clones share them.
#[derive(Clone, Debug)]
pub struct Recent {
    shared: Arc<Mutex<Kept>>,
    size: Size,
    /// Counts frames of the source that never arrived.
    pub meter: Meter,
    /// The source's remarks, such as damage.
    pub remarks: Remarks,
}

#[derive(Debug, Default)]
struct Kept {
    frames: VecDeque<Arc<Frame>>,
    count: usize,
}

impl Recent {
    /// Creates an empty store for frames of this size.
    pub fn new(size: Size) -> Self {
        Self { shared: Arc::default(), size, meter: Meter::default(), remarks: Remarks::default() }
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns width and height in pixels.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Returns the number of frames so far.
    pub fn count(&self) -> usize {
        self.kept().count
    }

    /// Adds the next frame, with its time in seconds and the number of frames before it that never arrived. Returns its number, from 0.
    ///
    /// # Errors
    /// Its size differs from that of the first frame.
    pub fn push(&self, image: Image, time: f64, missed: u64) -> Result<usize> {
        if image.size() != self.size {
            let (size, found) = (self.size, image.size());
            let problem = format!("expected a frame of {size} pixels as the first one, found {found}");
            return Err(Error::Invalid(problem + "; open it again"));
        }
        self.meter.drop_frames(missed);
        let mut kept = self.kept();
        let index = kept.count;
        kept.count += 1;
        kept.frames.push_back(Arc::new(Frame { index, time, image }));
        if kept.frames.len() > RECENT {
            kept.frames.pop_front();
        }
        Ok(index)
    }
}

impl Frames for Recent {
    fn frame(&mut self, index: usize) -> Result<Option<Arc<Frame>>> {
        let kept = self.kept();
        if index >= kept.count {
            return Ok(None);
        }
        let gone = || Error::Invalid(format!("frame {} is gone: a camera's frames do not come again", index + 1));
        let found = kept.frames.iter().find(|frame| frame.index == index).ok_or_else(gone)?;
        Ok(Some(Arc::clone(found)))
    }
    fn repeats(&self) -> bool {
        false
    }
    fn remarks(&self) -> Remarks {
        self.remarks.clone()
    }
}
