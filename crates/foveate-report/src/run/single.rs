//! One target: from a source, through a [`Tracker`], to observers.

use std::time::Duration;

use super::{Follower, Frames, Span, each_frame};
use crate::Observer;
use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;
use foveate_core::scene::Image;
use foveate_core::{Status, Tracker};
use foveate_video::{Frame, FrameSource, SourceInfo, TileFolder};

/// What to follow.
#[derive(Default)]
pub struct SingleRun<'a> {
    /// The target's box in the first frame of the span; `None` goes on from a loaded state.
    pub init: Option<BBox>,
    /// Boxes given again at later frames (counted from 0).
    pub again: &'a [(usize, BBox)],
    /// Which frames.
    pub span: Span<'a>,
}

/// What became of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Its frames.
    pub frames: Frames,
    /// Frames that were tracked: those whose box was given are none.
    pub tracked: usize,
    /// Values read from the tracked frames: the sum of [`Step::values`](foveate_core::Seen::values).
    pub values: usize,
    /// Frames whose status is occluded.
    pub occluded: usize,
    /// Frames whose status is lost.
    pub lost: usize,
    /// Frames whose box lies outside the picture.
    pub outside: usize,
    /// The target's box in every frame, as boxes.txt has it: [`touching`] the picture. Empty in a run without an end.
    pub boxes: Vec<BBox>,
    /// The box of the last frame; `None` where it lies outside the picture, or there was no frame.
    pub last: Option<BBox>,
    /// The likeliest class after the last frame, and its probability; `None` without a recogniser.
    pub class: Option<(usize, f64)>,
    /// What it is called, where the recogniser's classes have names.
    pub class_name: Option<String>,
}

/// Whether a box shows at least a part of itself in the picture.
pub fn touches(b: &BBox, image: &Image) -> bool {
    b.x < image.width() as f64 && b.y < image.height() as f64 && b.x + b.w > 0.0 && b.y + b.h > 0.0
}

/// Refuses a box that no target of this video can have; `what` says which box it is.
///
/// # Errors
/// [`Error::Invalid`], with the box and what was expected.
pub fn check_box(what: &str, b: &BBox, info: &SourceInfo) -> Result<()> {
    let (w, h) = (info.width as f64, info.height as f64);
    let numbers = [b.x, b.y, b.w, b.h];
    let inside = b.x < w && b.y < h && b.x + b.w > 0.0 && b.y + b.h > 0.0;
    let sized = b.w >= 2.0 && b.h >= 2.0 && b.w <= 4.0 * w && b.h <= 4.0 * h;
    if inside && sized && numbers.iter().all(|n| n.is_finite()) {
        return Ok(());
    }
    Err(Error::Invalid(format!(
        "{what} is x={}, y={}, w={}, h={}; expected a box of at least 2 x 2 pixels and at most {} x {}, touching the {w} x {h} \
         picture, x,y being its top-left corner in pixels, counted from 1",
        b.x + 1.0,
        b.y + 1.0,
        b.w,
        b.h,
        4.0 * w,
        4.0 * h
    )))
}

/// The box as results have it: one that lies outside the picture is moved to the nearest place where it touches it, and keeps
/// its size. So it comes no farther from any target that is to be seen, and no score of it is worse.
pub fn touching(b: &BBox, image: &Image) -> BBox {
    if touches(b, image) {
        return *b;
    }
    let moved = |at: f64, side: f64, picture: usize| {
        let overlap = side.min(1.0);
        at.min(picture as f64 - overlap).max(overlap - side)
    };
    BBox { x: moved(b.x, b.w, image.width()), y: moved(b.y, b.h, image.height()), ..*b }
}

struct Single<'a> {
    tracker: &'a mut Tracker,
    observer: &'a mut dyn Observer,
    tiles: Option<&'a TileFolder>,
    init: Option<BBox>,
    again: &'a [(usize, BBox)],
    endless: bool,
    outcome: Outcome,
}

/// Follows one target through a source.
///
/// Where the source breaks half-way, what was tracked until then is finished and kept, and the error is returned beside it.
pub fn follow(
    source: &mut dyn FrameSource,
    tracker: &mut Tracker,
    observer: &mut dyn Observer,
    run: SingleRun<'_>,
) -> (Outcome, Result<()>) {
    through(source, None, tracker, observer, run)
}

/// The same through frames in tiles, of which only those are decoded that the tracker looks at; it needs a configuration with
/// `[sensor]`. `source` are the frames' numbers: [`TileFolder::frames`]. Observers get what was read, painted into a picture of
/// its own.
pub fn follow_tiles(
    tiles: &TileFolder,
    source: &mut dyn FrameSource,
    tracker: &mut Tracker,
    observer: &mut dyn Observer,
    run: SingleRun<'_>,
) -> (Outcome, Result<()>) {
    through(source, Some(tiles), tracker, observer, run)
}

fn through(
    source: &mut dyn FrameSource,
    tiles: Option<&TileFolder>,
    tracker: &mut Tracker,
    observer: &mut dyn Observer,
    SingleRun { init, again, span }: SingleRun<'_>,
) -> (Outcome, Result<()>) {
    let mut frames = Frames::default();
    let (endless, outcome) = (span.endless, Outcome::default());
    let mut single = Single { tracker, observer, tiles, init, again, endless, outcome };
    let result = each_frame(source, &mut single, span, &mut frames);
    let finished = single.observer.finish();
    (Outcome { frames, ..single.outcome }, result.and(finished))
}

impl Follower for Single<'_> {
    fn skip(&mut self, frame: &Frame) -> Result<()> {
        match self.tiles.and_then(|tiles| tiles.frame(frame.index)) {
            Some(tiles) => self.tracker.skip(&tiles),
            None => self.tracker.skip(&frame.image),
        }
    }
    fn track(&mut self, frame: &Frame, spent: &mut dyn FnMut(Duration)) -> Result<()> {
        let tiles = self.tiles.and_then(|tiles| tiles.frame(frame.index));
        let decoding = || tiles.as_ref().map_or(Duration::ZERO, |tiles| tiles.decoding());
        let given = self.again.iter().find(|(at, _)| *at == frame.index).map(|(_, bbox)| *bbox);
        if let Some(bbox) = given.or(self.init.take()) {
            match &tiles {
                Some(tiles) => self.tracker.init(tiles, bbox)?,
                None => self.tracker.init(&frame.image, bbox)?,
            }
            spent(decoding());
            if !self.endless {
                self.outcome.boxes.push(bbox);
            }
            self.outcome.last = Some(bbox);
            let shown = tiles.and(self.tracker.sensed()).map(|seen| of(frame, seen));
            return self.observer.start(shown.as_ref().unwrap_or(frame), &bbox);
        }
        if !self.tracker.has_target() {
            return Err(Error::Invalid(
                "the tracker has no target: give --init, or a state saved after a start".into(),
            ));
        }
        let seen = match &tiles {
            Some(tiles) => self.tracker.update(tiles)?,
            None => self.tracker.update(&frame.image)?,
        };
        spent(decoding());
        let shown = tiles.as_ref().and(seen.picture).map(|picture| of(frame, picture));
        let frame = shown.as_ref().unwrap_or(frame);
        if !self.endless {
            self.outcome.boxes.push(touching(&seen.bbox, &frame.image));
        }
        let o = &mut self.outcome;
        o.tracked += 1;
        o.values += seen.values;
        let inside = touches(&seen.bbox, &frame.image);
        o.last = inside.then_some(seen.bbox);
        o.outside += usize::from(!inside);
        o.occluded += usize::from(seen.status == Status::Occluded);
        o.lost += usize::from(seen.is_lost());
        o.class = seen.class;
        o.class_name = o.class.and_then(|(class, _)| seen.class_names.get(class).cloned());
        self.observer.observe(frame, &seen)
    }
}

/// A frame with another picture.
fn of(frame: &Frame, image: &Image) -> Frame {
    Frame { index: frame.index, time: frame.time, image: image.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_outside_is_moved_to_the_nearest_edge() {
        let image = Image::grey(100, 50, 0);
        let moved = |x, y, w, h| touching(&BBox { x, y, w, h }, &image);
        for (inside, why) in [((90.0, 40.0, 20.0, 20.0), "partly"), ((-19.5, 0.0, 20.0, 9.0), "hardly")] {
            let (x, y, w, h) = inside;
            assert_eq!(moved(x, y, w, h), BBox { x, y, w, h }, "{why} inside: it stays");
        }
        assert_eq!(moved(-1208.0, 10.0, 20.0, 30.0), BBox { x: -19.0, y: 10.0, w: 20.0, h: 30.0 });
        assert_eq!(moved(100.0, 900.0, 20.0, 0.5), BBox { x: 99.0, y: 49.5, w: 20.0, h: 0.5 });
        for odd in [f64::NAN, f64::INFINITY, -1e300] {
            let b = moved(odd, odd, 4.0, 4.0);
            assert!(b.x.is_finite() && b.y.is_finite() && touches(&b, &image), "{b:?}");
        }
    }
}
