//! A video whose frames the browser decodes ahead of the tracker; our own decoder provides the frames that the browser does not decode.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use foveate_base::{Error, Result};
use foveate_core::geometry::Size;
use foveate_page::{Frames, Player};
use foveate_video::{CodedVideo, Frame, Planes, SourceInfo};
use serde_json::{Value, json};

use crate::store::Video;

/// Maximum number of decoded frames that wait for the tracker.
const WAITING: usize = 2;
/// Maximum number of frames of a video for the browser to decode: nine hours at 30 per second. Their list is one message.
const MOST_CODED: usize = 1 << 20;

/// Frames decoded by the browser; clones share them.
#[derive(Clone, Default)]
struct Decoded(Arc<Mutex<VecDeque<Arc<Frame>>>>);

impl Decoded {
    fn push(&self, frame: Frame) {
        let mut waiting = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.push_back(Arc::new(frame));
        if waiting.len() > WAITING {
            waiting.pop_front();
        }
    }

    fn find(&self, index: usize) -> Option<Arc<Frame>> {
        let waiting = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.iter().find(|frame| frame.index == index).cloned()
    }
}

/// The frames of a video file, decoded by the browser or by our decoder.
struct Ahead {
    decoded: Decoded,
    player: Player<Video>,
    last: Option<Arc<Frame>>,
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

/// An open video.
pub(crate) struct Open {
    video: Video,
    player: Player<Video>,
    decoded: Decoded,
    coded: Option<CodedVideo>,
}

impl Open {
    pub(crate) fn new(video: Video) -> Self {
        Self { player: Player::new(video.clone()), video, decoded: Decoded::default(), coded: None }
    }

    /// Returns the samples of H.264 in MP4, for a decoder of the browser; `{"codec": null}` for other sources.
    pub(crate) fn coded(&mut self) -> Result<Value> {
        if self.video.pictures.is_some() {
            return Ok(json!({ "codec": null }));
        }
        let coded = self.video.coded()?;
        let frames: Vec<_> = coded.frames().take(MOST_CODED + 1).collect();
        let avcc = coded.description().to_vec();
        let Some([profile, constraints, level]) = avcc.get(1..4).filter(|_| frames.len() <= MOST_CODED) else {
            return Ok(json!({ "codec": null }));
        };
        self.coded = Some(coded);
        Ok(json!({
            "codec": format!("avc1.{profile:02x}{constraints:02x}{level:02x}"), "description": avcc,
            "offsets": frames.iter().map(|f| f.offset).collect::<Vec<_>>(),
            "sizes": frames.iter().map(|f| f.size).collect::<Vec<_>>(),
            "frames": frames.iter().map(|f| f.place.map_or(0, |place| place + 1)).collect::<Vec<_>>(),
            "keys": frames.iter().map(|f| u8::from(f.key)).collect::<Vec<_>>(),
        }))
    }

    /// Adds the planes of a frame (from 0) that the browser decoded.
    pub(crate) fn decoded(
        &self,
        place: usize,
        size: Size,
        planes: Planes,
        bytes: &[u8],
        info: &SourceInfo,
    ) -> Result<()> {
        let none = || Error::Invalid("this video is not decoded by the browser".into());
        let coded = self.coded.as_ref().ok_or_else(none)?;
        let frame = coded.picture(place, size, planes, bytes, info)?;
        self.decoded.push(frame);
        Ok(())
    }
}

impl foveate_page::Video for Open {
    fn frames(&mut self) -> &mut dyn Frames {
        &mut self.player
    }
    fn reader(&self) -> Box<dyn Frames> {
        Box::new(Player::new(self.video.clone()))
    }
    fn tracked(&self) -> Box<dyn Frames> {
        Box::new(Ahead { decoded: self.decoded.clone(), player: Player::new(self.video.clone()), last: None })
    }
}
