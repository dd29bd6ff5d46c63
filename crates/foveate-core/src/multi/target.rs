//! One target among several: its filter, its detection, the shape of its box.

use super::attention::Candidate;
use super::edge;
use super::pool::Pool;
use super::settings::Settings;
use crate::engine::Engine;
use crate::geometry::{BBox, Extent, State};
use crate::scene::{Detection, Image, Scene};
use crate::seen::{Phase, Seen};

/// Weight of the newest look in the mean surprise.
const NEWEST: f64 = 0.3;

/// Frames in a row that another target hides it, after which its box is a guess: no occlusion that passes takes much longer.
const LONGEST_HIDDEN: usize = 30;

/// [`Target::shape`] is from minus this to this.
pub(super) const SHAPE: f64 = 20.0;

/// One target.
pub(super) struct Target {
    pub engine: Engine,
    pub track: Seen<'static>,
    /// Frames in a row it was lost, and without a detection.
    pub lost: usize,
    pub unseen: usize,
    /// Frames in a row another target hid it, or may have been what was seen in its place.
    pub hidden: usize,
    pub terminated: usize,
    /// Logarithm of its box's width over height, less that of its template's.
    pub shape: f64,
    /// Whether it is looked at in this frame, and how far looks moved its estimate a frame, template units, on average.
    pub looked_at: bool,
    pub surprise: f64,
    /// How much what is there looks like it, 0 to 1, where another is in its way.
    pub similarity: f64,
}

impl Target {
    /// The data of a target of which only the id is known.
    pub(super) fn unknown(id: u64) -> Seen<'static> {
        Seen { id, ..Seen::given([1; 3], &BBox { x: 0.0, y: 0.0, w: 1.0, h: 1.0 }) }
    }

    /// Sets the detection of this frame, and its place among those of the caller.
    pub(super) fn set_detection(&mut self, detection: Option<Detection>, index: Option<usize>) {
        (self.track.detection, self.track.detection_index) = (detection, index);
        self.track.detected_class = detection.and_then(|d| d.class).or(self.track.detected_class);
    }

    /// As yet without a box.
    pub(super) fn new(engine: Engine, track: Seen<'static>) -> Self {
        Self {
            engine,
            track,
            lost: 0,
            unseen: 0,
            hidden: 0,
            terminated: 0,
            shape: 0.0,
            looked_at: true,
            surprise: 1.0,
            similarity: 1.0,
        }
    }

    /// The values that the order of attention depends on.
    pub(super) fn candidate(&self) -> Candidate {
        Candidate { waited: self.track.waited, surprise: self.surprise }
    }

    /// Where it is expected in the next frame.
    pub(super) fn next(&self) -> State {
        let s = self.track.state;
        State { x: s.x + s.vx, y: s.y + s.vy, ..s }
    }

    /// Looks at a picture, in a room of the pool. What was there before does not count.
    pub(super) fn looking<T>(&mut self, pool: &Pool, look: impl FnOnce(&mut Self) -> T) -> T {
        let mut room = pool.take();
        self.engine.exchange(&mut room);
        let seen = look(self);
        // First, so that what it frees is left in the room.
        self.engine.compact();
        self.engine.exchange(&mut room);
        pool.put(room);
        seen
    }

    /// How much what is there looks like it, 0 to 1.
    pub(super) fn similarity_ahead(&mut self, image: &Image, pool: &Pool) -> f64 {
        let next = self.next();
        self.looking(pool, |target| target.engine.similarity(image, &next))
    }

    /// The same box in the target's present shape.
    pub(super) fn shaped(&self, b: BBox) -> BBox {
        let ((x, y), wider) = (b.centre(), (self.shape / 2.0).exp());
        BBox::around(x, y, b.w * wider, b.h / wider)
    }

    /// A box that was given, or found.
    pub(super) fn begin(&mut self, born: usize, bbox: BBox, phase: Phase) {
        let extent = self.engine.extent().expect("it was started");
        let state = self.engine.state_at(&bbox);
        let Seen { id, gaze, class, detected_class, shape: size, .. } = self.track;
        let given = Seen::given(size, &bbox).in_phase(phase);
        self.track = Seen { id, born, state, extent, gaze, class, detected_class, ..given };
        (self.lost, self.unseen, self.hidden, self.shape, self.surprise) = (0, 0, 0, shape(&bbox, extent), 1.0);
    }

    pub(super) fn step(&mut self, image: &Image, s: &Settings, detecting: bool) {
        if !self.looked_at {
            return self.coast(image, s, detecting);
        }
        let (next, waited) = (self.next(), std::mem::take(&mut self.track.waited));
        let detections = self.track.detection.as_slice();
        let step = self.engine.step_on(Scene { image, detections });
        let (estimate, covariance, deficit, class) =
            (step.state, step.covariance, step.consistency.deficit, step.class);
        let (gaze, bbox, p_lost) = (step.gaze, step.bbox, step.p_lost);
        let lost = self.engine.is_searching() && detections.is_empty();
        self.unseen = if detections.is_empty() { self.unseen + 1 } else { 0 };
        // While another is in its way, looks cannot show that it is gone; it counts as lost once an occlusion has lasted too long.
        self.lost = if lost { self.lost + usize::from(!self.engine.meets_another()) } else { 0 };
        let visible = self.track.visible;
        let hidden = visible < s.occlusion.hidden || (visible < 1.0 && self.engine.is_contested());
        self.hidden = if hidden { self.hidden + 1 } else { 0 };
        let guessed = if detecting { s.guesses(self.unseen) } else { lost || self.hidden > LONGEST_HIDDEN };
        let phase = match guessed {
            true => Phase::Lost,
            false if visible < s.occlusion.hidden => Phase::Occluded,
            false => Phase::Tracked,
        };
        let extent = self.engine.extent().expect("it was started");
        let moved = (estimate.x - next.x).hypot(estimate.y - next.y) / longer_half(&estimate, extent);
        let moved = moved / (1 + waited) as f64;
        self.surprise += NEWEST * (moved - self.surprise);
        self.track = Seen { p_lost, state: estimate, covariance, extent, gaze, class, ..self.track }.in_phase(phase);
        self.track.consistency.deficit = deficit;
        if let Some(Detection { bbox: b, .. }) = self.track.detection {
            self.shape += s.shape * (shape(&b, extent) - self.shape);
        }
        self.track.bbox = self.shaped(bbox);
        if let Some(Detection { bbox: b, .. }) = self.track.detection {
            let comes_in = edge::comes_in(&self.track.bbox, &b, image, s.initiation.most);
            if comes_in {
                self.track.bbox = b;
            }
            if comes_in || (deficit > s.renew && self.track.visible >= 1.0) {
                self.update_template(image);
            }
        }
    }

    /// A frame without a look: it is where it was expected, or where its detection says.
    fn coast(&mut self, image: &Image, s: &Settings, detecting: bool) {
        let detections = self.track.detection.as_slice();
        let (state, covariance) = self.engine.coast(Scene { image, detections });
        self.unseen = if detections.is_empty() { self.unseen + 1 } else { 0 };
        let phase = match self.track.phase {
            _ if !detections.is_empty() => Phase::Tracked,
            _ if detecting && s.guesses(self.unseen) => Phase::Lost,
            Phase::Initiated | Phase::ReIdentified => Phase::Tracked,
            phase => phase,
        };
        let waited = self.track.waited + 1;
        self.track = Seen { state, covariance, waited, ..self.track }.in_phase(phase);
        self.track.bbox = self.shaped(state.bbox(self.track.extent));
    }

    /// Takes a new template where it is, in its present shape; the old one stays where the box is no good.
    fn update_template(&mut self, image: &Image) {
        let State { vx, vy, .. } = self.track.state;
        if self.engine.update_template(image, &self.track.bbox, (vx, vy)).is_ok() {
            self.track.extent = self.engine.extent().expect("it was started");
            (self.track.state.log_scale, self.shape, self.track.consistency.deficit) = (0.0, 0.0, 0.0);
        }
    }
}

/// The shape of a box, against that of a template.
fn shape(b: &BBox, extent: Extent) -> f64 {
    (b.w / b.h / extent.half_w * extent.half_h).ln().clamp(-SHAPE, SHAPE)
}

/// The longer half of a target's box, pixels.
fn longer_half(state: &State, extent: Extent) -> f64 {
    state.log_scale.exp() * extent.half_w.max(extent.half_h)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::engine::toy::{Toy, parts, picture, started, target};

    /// A target at column 50 whose looks say that it is at column `at`, and how often it was given a template.
    fn given(at: f64) -> (Target, Arc<AtomicUsize>) {
        let toy = Toy::at(at);
        let templates = toy.templates.clone();
        let mut it = Target::new(started(parts(toy), 1), Target::unknown(1));
        it.begin(0, target(50.0), Phase::Initiated);
        (it, templates)
    }

    /// A target that waited for four frames was moved by five frames of motion.
    #[test]
    fn surprise_is_counted_for_each_frame_of_waiting() {
        let surprise = |waited: usize| {
            let mut it = given(50.0).0;
            it.track.waited = waited;
            it.step(&picture(), &Settings::default(), false);
            assert_eq!(it.track.waited, 0);
            it.surprise - (1.0 - NEWEST)
        };
        assert!(surprise(0) > 0.0 && (surprise(0) / surprise(4) - 5.0).abs() < 1e-9, "{} {}", surprise(0), surprise(4));
    }

    /// While another target covers a part of it, that part would become its template.
    #[test]
    fn a_template_is_not_renewed_while_the_target_is_covered() {
        for (visible, renews) in [(1.0, true), (0.9, false)] {
            let (mut it, templates) = given(90.0);
            for _ in 0..10 {
                it.track.visible = visible;
                it.set_detection(Some(Detection::new(it.track.bbox, 1.0)), None);
                it.step(&picture(), &Settings::default(), true);
            }
            assert_eq!(templates.load(Ordering::Relaxed) > 1, renews, "{visible} of it is visible");
        }
    }
}
