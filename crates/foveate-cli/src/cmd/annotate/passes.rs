//! Tracks of a target from key frame to key frame, forwards and backwards.

use std::collections::VecDeque;
use std::path::Path;

use foveate::config::Blueprint;
use foveate::scene::Image;
use foveate::video::{FrameSource, Options, Selection, open_with, select};
use foveate::{BBox, Error, Result, Tracker, memory};

use crate::terminal;

/// The share of the memory limit that the pictures of all stretches may take.
const SHARE: u64 = 4;

/// A tracker's result in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sight {
    pub bbox: BBox,
    pub p_lost: f64,
}

/// Frames `from` to `to` (from 0, both included), of which no other has a key frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stretch {
    pub from: usize,
    pub to: usize,
    /// The box in frame `from`, if it is a key frame.
    pub first: Option<BBox>,
    /// The box in frame `to`, if it is a key frame.
    pub last: Option<BBox>,
}

/// The tracks through a stretch; a track that the stretch does not have is empty.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Passes {
    /// From the first box: frames `from + 1` to `to`.
    pub forward: Vec<Sight>,
    /// From the last box, in the order of the video: frames `from` to `to - 1`.
    pub backward: Vec<Sight>,
}

/// The video, and the tracker that every pass starts with.
pub(super) struct Video<'a> {
    pub path: &'a Path,
    pub options: Options,
    pub blueprint: &'a Blueprint,
    pub seed: u64,
    /// The number of pictures that a pass may keep in memory.
    pub room: usize,
    pub progress: &'a (dyn Fn() + Sync),
}

/// The number of pictures of this size that each of so many passes may keep: at least 2.
pub(super) fn room(width: usize, height: usize, passes: usize) -> usize {
    let one = memory::of_picture(width, height).max(1);
    ((memory::limit() / SHARE / passes.max(1) as u64 / one) as usize).max(2)
}

impl Video<'_> {
    /// Opens the video at a frame, from 0.
    fn at(&self, from: usize) -> Result<Reader> {
        let source = select(open_with(self.path, &self.options)?, Selection { from, ..Selection::default() });
        Ok(Reader { source, next: from, last: None })
    }

    /// Tracks through stretches in the order of the video.
    pub(super) fn passes(&self, stretches: &[Stretch]) -> Result<Vec<Passes>> {
        let Some(first) = stretches.first() else { return Ok(vec![]) };
        let mut reader = self.at(first.from)?;
        stretches.iter().map(|stretch| self.through(stretch, &mut reader)).collect()
    }

    fn through(&self, stretch: &Stretch, reader: &mut Reader) -> Result<Passes> {
        let mut passes = Passes::default();
        let mut tracker = None;
        let mut kept: VecDeque<Image> = VecDeque::new();
        for index in stretch.from..=stretch.to {
            let image = reader.frame(index)?;
            match &mut tracker {
                None if index == stretch.from => tracker = self.started(&image, stretch.first)?,
                None => {}
                Some(tracker) => passes.forward.push(self.step(tracker, &image)?),
            }
            if index == stretch.to {
                reader.last = Some((index, image.clone()));
            }
            if stretch.last.is_some() {
                if kept.len() == self.room {
                    kept.pop_front();
                }
                kept.push_back(image);
            }
        }
        let Some(last) = kept.pop_back() else { return Ok(passes) };
        let mut tracker = self.started(&last, stretch.last)?.expect("only stretches with a last box keep pictures");
        let mut index = stretch.to;
        loop {
            while let Some(image) = kept.pop_back() {
                index -= 1;
                passes.backward.push(self.step(&mut tracker, &image)?);
            }
            if index == stretch.from {
                break;
            }
            // Pictures that did not fit into memory are read once more, block by block.
            let from = index.saturating_sub(self.room).max(stretch.from);
            let mut reader = self.at(from)?;
            for earlier in from..index {
                kept.push_back(reader.frame(earlier)?);
            }
        }
        passes.backward.reverse();
        Ok(passes)
    }

    fn started(&self, image: &Image, bbox: Option<BBox>) -> Result<Option<Tracker>> {
        let Some(bbox) = bbox else { return Ok(None) };
        let mut tracker = self.blueprint.tracker(self.seed)?;
        tracker.init(image, bbox)?;
        Ok(Some(tracker))
    }

    fn step(&self, tracker: &mut Tracker, image: &Image) -> Result<Sight> {
        if terminal::stopping() {
            return Err(Error::Stopped);
        }
        (self.progress)();
        let seen = tracker.update(image)?;
        Ok(Sight { bbox: seen.bbox, p_lost: seen.p_lost })
    }
}

/// The frames of the video in order.
struct Reader {
    source: Box<dyn FrameSource>,
    next: usize,
    /// The end of the last stretch, where the next one may begin.
    last: Option<(usize, Image)>,
}

impl Reader {
    fn frame(&mut self, index: usize) -> Result<Image> {
        if let Some((_, image)) = self.last.as_ref().filter(|(last, _)| *last == index) {
            return Ok(image.clone());
        }
        self.source.pass_over(index - self.next)?;
        self.next = index + 1;
        let Some(frame) = self.source.next() else {
            return Err(Error::Invalid(format!("the video ends before frame {}", index + 1)));
        };
        Ok(frame?.image)
    }
}
