//! Frames that the page hands over: of a camera, or of a video that only the browser can decode.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foveate_base::{Error, Result};
use foveate_core::scene::{Image, Pixels};
use foveate_report::interactive::Frames;
use foveate_video::{Frame, Meter};

/// Frames that are kept.
const KEPT: usize = 8;

/// Frames that came last; clones share them.
#[derive(Clone)]
pub struct Live {
    shared: Arc<Mutex<Kept>>,
    size: (usize, usize),
    /// Counts frames of the source that never came.
    pub meter: Meter,
    last: Option<Arc<Frame>>,
}

#[derive(Default)]
struct Kept {
    frames: VecDeque<Arc<Frame>>,
    count: usize,
}

impl Live {
    pub fn new(width: usize, height: usize) -> Self {
        Self { shared: Arc::default(), size: (width, height), meter: Meter::default(), last: None }
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the next frame: red, green, blue and a byte of no meaning, pixel by pixel; its time in seconds; and how many
    /// frames before it never came. Answers its number, from 0.
    pub fn push(&self, rgba: &[u8], time: f64, missed: u64) -> Result<usize> {
        let image = Image::from_pixels(Pixels::Rgba, self.size, 4 * self.size.0, rgba)?;
        self.meter.drop_frames(missed);
        let mut kept = self.kept();
        let index = kept.count;
        kept.count += 1;
        kept.frames.push_back(Arc::new(Frame { index, time, image }));
        if kept.frames.len() > KEPT {
            kept.frames.pop_front();
        }
        Ok(index)
    }
}

impl Frames for Live {
    fn frame(&mut self, index: usize) -> Result<Option<Arc<Frame>>> {
        let found = {
            let kept = self.kept();
            if index >= kept.count {
                return Ok(None);
            }
            kept.frames.iter().find(|frame| frame.index == index).cloned()
        };
        let gone = || Error::Invalid(format!("frame {} is gone: a camera's frames do not come again", index + 1));
        self.last = Some(found.ok_or_else(gone)?);
        Ok(self.last.clone())
    }
    fn last(&self) -> Option<&Arc<Frame>> {
        self.last.as_ref()
    }
    fn repeats(&self) -> bool {
        false
    }
}
