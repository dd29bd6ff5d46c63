//! Frames that the browser decoded ahead of the tracker; those that it did not our own decoder gives.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use foveate_base::Result;
use foveate_report::interactive::{Frames, Player};
use foveate_video::{CodedVideo, Frame, Planes, SourceInfo};

use crate::store::Video;

/// Frames that wait to be tracked in, at most.
const WAITING: usize = 2;

/// What the browser decoded; clones share it.
#[derive(Clone, Default)]
pub struct Decoded(Arc<Mutex<VecDeque<Arc<Frame>>>>);

impl Decoded {
    /// Takes the planes of a frame.
    pub fn push(
        &self,
        coded: &CodedVideo,
        place: usize,
        size: (usize, usize),
        planes: Planes,
        bytes: &[u8],
        info: &SourceInfo,
    ) -> Result<()> {
        let frame = coded.picture(place, size, planes, bytes, info)?;
        let mut waiting = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.push_back(Arc::new(frame));
        if waiting.len() > WAITING {
            waiting.pop_front();
        }
        Ok(())
    }

    fn find(&self, index: usize) -> Option<Arc<Frame>> {
        let waiting = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.iter().find(|frame| frame.index == index).cloned()
    }
}

/// The frames of a video file, decoded by the browser or by us.
pub struct Ahead {
    decoded: Decoded,
    player: Player<Video>,
    last: Option<Arc<Frame>>,
}

impl Ahead {
    pub fn new(decoded: Decoded, video: Video) -> Self {
        Self { decoded, player: Player::new(video), last: None }
    }
}

impl Frames for Ahead {
    fn frame(&mut self, index: usize) -> Result<Option<Arc<Frame>>> {
        let known = self.last.as_ref().filter(|frame| frame.index == index).cloned();
        let frame = match known.or_else(|| self.decoded.find(index)) {
            Some(frame) => Some(frame),
            None => self.player.frame(index)?,
        };
        if frame.is_some() {
            self.last.clone_from(&frame);
        }
        Ok(frame)
    }
}
