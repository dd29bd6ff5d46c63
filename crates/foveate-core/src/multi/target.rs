//! One target of several: its trackers, its detection, and the shape of its box.

use super::attention::Candidate;
use super::edge;
use super::pool::BufferPool;
use super::settings::Settings;
use crate::ensemble::Ensemble;
use crate::geometry::{BBox, Extent, State};
use crate::scene::{Detection, Image, Scene};
use crate::seen::{Phase, Seen};

/// Weight of the newest look in the mean surprise.
const NEWEST: f64 = 0.3;

/// Consecutive frames behind another target after which the box is a guess: a passing occlusion seldom lasts longer.
const LONGEST_HIDDEN: usize = 30;

/// Bound on the absolute value of [`Target::shape`].
pub(super) const SHAPE: f64 = 20.0;

/// One target.
pub(super) struct Target {
    pub ensemble: Ensemble,
    pub track: Seen<'static>,
    /// Consecutive frames as lost, and without a detection.
    pub lost: usize,
    pub unseen: usize,
    /// Consecutive frames in which another target occluded it or may have been mistaken for it.
    pub hidden: usize,
    pub terminated: usize,
    /// Logarithm of the aspect ratio (width over height) of its box, less that of its template.
    pub shape: f64,
    /// Whether it is updated in this frame, and the mean distance by which a look moves its estimate, per frame, template units.
    pub looked_at: bool,
    pub surprise: f64,
    /// Similarity of the picture at its place to it, 0 to 1, if it overlaps another target.
    pub similarity: f64,
}

impl Target {
    /// Returns the data of a target of which only the id is known.
    pub(super) fn unknown(id: u64) -> Seen<'static> {
        Seen { id, ..Seen::given([1; 3], &BBox { x: 0.0, y: 0.0, w: 1.0, h: 1.0 }) }
    }

    /// Sets the detection of this frame, and its index among those of the caller.
    pub(super) fn set_detection(&mut self, detection: Option<Detection>, index: Option<usize>) {
        (self.track.detection, self.track.detection_index) = (detection, index);
        self.track.detected_class = detection.and_then(|d| d.class).or(self.track.detected_class);
    }

    /// Creates a target without a box.
    pub(super) fn new(ensemble: Ensemble, track: Seen<'static>) -> Self {
        Self {
            ensemble,
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

    /// Returns the values from which its priority follows.
    pub(super) fn candidate(&self) -> Candidate {
        Candidate { waited: self.track.waited, surprise: self.surprise }
    }

    /// Returns its predicted state in the next frame.
    pub(super) fn next(&self) -> State {
        let s = self.track.state;
        State { x: s.x + s.vx, y: s.y + s.vy, ..s }
    }

    /// Runs `look` with buffers of the pool, whose contents do not matter.
    pub(super) fn with_buffers<T>(&mut self, pool: &BufferPool, look: impl FnOnce(&mut Self) -> T) -> T {
        let mut room = pool.take();
        self.ensemble.first_mut().exchange(&mut room);
        let seen = look(self);
        // Compact before the exchange, so that the freed memory stays in the pool.
        self.ensemble.compact();
        self.ensemble.first_mut().exchange(&mut room);
        pool.put(room);
        seen
    }

    /// Returns the similarity of the picture at the predicted place to the target, 0 to 1.
    pub(super) fn similarity_ahead(&mut self, image: &Image, pool: &BufferPool) -> f64 {
        let next = self.next();
        self.with_buffers(pool, |target| target.ensemble.first_mut().similarity(image, &next))
    }

    /// Returns the same box in the target's present shape.
    pub(super) fn shaped(&self, b: BBox) -> BBox {
        let ((x, y), wider) = (b.centre(), (self.shape / 2.0).exp());
        BBox::around(x, y, b.w * wider, b.h / wider)
    }

    /// Starts its trackers in a box that [`crate::start::check`] accepts.
    pub(super) fn start(&mut self, image: &Image, born: usize, bbox: BBox, pool: &BufferPool) {
        self.with_buffers(pool, |target| target.ensemble.init(image, bbox)).expect("the box was checked");
        self.begin(born, bbox, Phase::Initiated);
    }

    /// Puts the target at a box that was given or detected.
    pub(super) fn begin(&mut self, born: usize, bbox: BBox, phase: Phase) {
        let extent = self.ensemble.first().extent().expect("it was started");
        let state = self.ensemble.first().state_at(&bbox);
        let Seen { id, gaze, class, detected_class, shape: size, .. } = self.track;
        let given = Seen::given(size, &bbox).in_phase(phase);
        self.track = Seen { id, born, state, extent, gaze, class, detected_class, ..given };
        (self.lost, self.unseen, self.hidden, self.shape, self.surprise) = (0, 0, 0, shape(&bbox, &state, extent), 1.0);
    }

    pub(super) fn step(&mut self, image: &Image, s: &Settings, detecting: bool) {
        if !self.looked_at {
            return self.coast(image, s, detecting);
        }
        let (next, waited) = (self.next(), std::mem::take(&mut self.track.waited));
        let detections = self.track.detection.as_slice();
        let step = self.ensemble.step_on(Scene { image, detections });
        let (estimate, covariance, consistency, class) = (step.state, step.covariance, step.consistency, step.class);
        let (gaze, bbox, p_lost, own_p_lost, cues) = (step.gaze, step.bbox, step.p_lost, step.own_p_lost, step.cues);
        let lost = self.ensemble.first().is_searching() && detections.is_empty();
        self.unseen = if detections.is_empty() { self.unseen + 1 } else { 0 };
        // Looks cannot show a loss while another target overlaps it; after too long an occlusion the box counts as a guess.
        self.lost = if lost { self.lost + usize::from(!self.ensemble.first().meets_another()) } else { 0 };
        let visible = self.track.visible;
        let hidden = visible < s.occlusion.hidden || (visible < 1.0 && self.ensemble.first().is_contested());
        self.hidden = if hidden { self.hidden + 1 } else { 0 };
        let guessed = if detecting { s.guesses(self.unseen) } else { lost || self.hidden > LONGEST_HIDDEN };
        let phase = match guessed {
            true => Phase::Lost,
            false if visible < s.occlusion.hidden => Phase::Occluded,
            false => Phase::Tracked,
        };
        let extent = self.ensemble.first().extent().expect("it was started");
        let moved = (estimate.x - next.x).hypot(estimate.y - next.y) / longer_half(&estimate, extent);
        let moved = moved / (1 + waited) as f64;
        self.surprise += NEWEST * (moved - self.surprise);
        let track = Seen { p_lost, own_p_lost, cues, state: estimate, covariance, extent, gaze, class, ..self.track };
        self.track = Seen { consistency, ..track }.in_phase(phase);
        if let Some(Detection { bbox: b, .. }) = self.track.detection {
            self.shape += s.shape * (shape(&b, &estimate, extent) - self.shape);
        }
        self.track.bbox = self.shaped(bbox);
        if let Some(Detection { bbox: b, .. }) = self.track.detection {
            let comes_in = edge::comes_in(&self.track.bbox, &b, image, s.initiation.most);
            if comes_in {
                self.track.bbox = b;
                (self.track.state.x, self.track.state.y) = b.centre();
            }
            if comes_in || (consistency.deficit > s.renew && self.track.visible >= 1.0) {
                self.update_template(image);
            }
        }
    }

    /// Runs a frame without a look: the prediction and the detection determine the box.
    fn coast(&mut self, image: &Image, s: &Settings, detecting: bool) {
        let detections = self.track.detection.as_slice();
        let (state, covariance) = self.ensemble.first_mut().coast(Scene { image, detections });
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

    /// Takes a new template at its present box; keeps the old one if the box is invalid.
    fn update_template(&mut self, image: &Image) {
        let State { vx, vy, .. } = self.track.state;
        if self.ensemble.update_template(image, &self.track.bbox, (vx, vy)).is_ok() {
            self.track.extent = self.ensemble.first().extent().expect("it was started");
            (self.track.state.log_scale, self.track.state.log_aspect) = (0.0, 0.0);
            (self.shape, self.track.consistency.deficit) = (0.0, 0.0);
        }
    }
}

/// Returns the shape of a box relative to that of a state of a target.
fn shape(b: &BBox, state: &State, extent: Extent) -> f64 {
    ((b.w / b.h / extent.half_w * extent.half_h).ln() - state.log_aspect).clamp(-SHAPE, SHAPE)
}

/// Returns the longer half of a target's box, pixels.
fn longer_half(state: &State, extent: Extent) -> f64 {
    let Extent { half_w, half_h } = state.shaped(extent);
    state.log_scale.exp() * half_w.max(half_h)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::engine::toy::{Toy, parts, picture, target};
    use crate::geometry::Gaze;

    /// Returns a target at column 50 whose likelihood has its maximum at column `at`, and the number of templates that it has received.
    fn given(at: f64) -> (Target, Arc<AtomicUsize>) {
        let toy = Toy::at(at);
        let templates = toy.templates.clone();
        let mut it = Target::new(Ensemble::new(vec![parts(toy)], 1, 1), Target::unknown(1));
        it.ensemble.init(&picture(), target(50.0)).expect("a box in the picture");
        it.begin(0, target(50.0), Phase::Initiated);
        (it, templates)
    }

    /// After four frames of waiting, the displacement is that of five frames.
    #[test]
    fn surprise_is_per_frame_of_waiting() {
        let surprise = |waited: usize| {
            let mut it = given(50.0).0;
            it.track.waited = waited;
            it.step(&picture(), &Settings::default(), false);
            assert_eq!(it.track.waited, 0);
            it.surprise - (1.0 - NEWEST)
        };
        assert!(surprise(0) > 0.0 && (surprise(0) / surprise(4) - 5.0).abs() < 1e-9, "{} {}", surprise(0), surprise(4));
    }

    /// A detection ends a loss, with and without a look; without one, a box is a guess after some frames, or after a long occlusion.
    #[test]
    fn a_detection_ends_a_loss() {
        let settings = Settings::default();
        for looked_at in [false, true] {
            for (unseen, detected, detecting, phase) in
                [(100, true, true, Phase::Tracked), (100, false, true, Phase::Lost), (0, false, true, Phase::Tracked)]
            {
                let mut it = given(50.0).0;
                (it.unseen, it.looked_at, it.track.phase) = (unseen, looked_at, Phase::Tracked);
                it.set_detection(detected.then(|| Detection::new(target(50.0), 1.0)), None);
                it.step(&picture(), &settings, detecting);
                let expected = (phase, if detected { 0 } else { unseen + 1 });
                assert_eq!((it.track.phase, it.unseen), expected, "looked at {looked_at}, unseen for {unseen}");
                it.begin(0, target(50.0), Phase::Initiated);
                assert_eq!((it.unseen, it.hidden), (0, 0));
            }
        }
        for (hidden, phase) in [(0, Phase::Occluded), (LONGEST_HIDDEN, Phase::Lost)] {
            let mut it = given(50.0).0;
            (it.hidden, it.track.visible) = (hidden, 0.0);
            it.step(&picture(), &settings, false);
            assert_eq!(it.track.phase, phase, "hidden for {hidden} frames");
        }
    }

    /// A frame counts as hidden if less than half of the target is visible, or if a part is covered and another target may be at its place.
    #[test]
    fn hidden_frames_are_counted() {
        use crate::engine::Claim;
        let here = Claim { centre: (50.0, 50.0), variance: (4.0, 4.0) };
        for (visible, met, hidden) in
            [(1.0, false, 0), (1.0, true, 0), (0.9, false, 0), (0.9, true, 4), (0.4, false, 4), (0.4, true, 4)]
        {
            let mut it = given(50.0).0;
            (it.hidden, it.track.visible) = (3, visible);
            it.ensemble.exclude(here, met.then_some(here).into_iter());
            it.step(&picture(), &Settings::default(), false);
            assert_eq!(it.hidden, hidden, "{visible} is visible, another one is there: {met}");
            let (bbox, confidence) = it.ensemble.first().reported();
            assert_eq!((it.track.bbox, it.track.p_lost), (bbox, confidence.p_lost), "as the tracker reports");
        }
    }

    /// The shape of the box approaches that of the detections, by the weight of the newest one; the area stays.
    #[test]
    fn the_shape_follows_the_detections() {
        let settings = Settings::default();
        let mut it = given(50.0).0;
        let wide = BBox::around(50.0, 50.0, 40.0, 10.0);
        for k in 1..4 {
            it.set_detection(Some(Detection::new(wide, 1.0)), None);
            it.step(&picture(), &settings, true);
            let shape = (1.0 - (1.0 - settings.shape).powi(k)) * 4.0f64.ln();
            let BBox { w, h, .. } = it.track.bbox;
            assert!((it.shape - shape).abs() < 1e-9 && (it.shape - (w / h).ln()).abs() < 1e-9, "{k}: {w} x {h}");
            let reported = it.ensemble.first().reported().0;
            assert!((w * h / (reported.w * reported.h) - 1.0).abs() < 1e-9);
        }
    }

    /// A target that enters the picture has the box of its detection, and its state is the centre of that box.
    #[test]
    fn the_state_is_the_centre_of_the_box() {
        let (mut it, templates) = given(50.0);
        let entering = BBox::new(36.0, 0.0, 24.0, 60.0);
        it.set_detection(Some(Detection::new(entering, 1.0)), None);
        it.step(&picture(), &Settings::default(), true);
        let centre = (it.track.state.x, it.track.state.y);
        assert_eq!((it.track.bbox, centre, templates.load(Ordering::Relaxed)), (entering, entering.centre(), 2));
    }

    /// A target that is set again keeps its id and its class.
    #[test]
    fn a_target_that_is_set_again_is_the_same() {
        let mut it = given(50.0).0;
        let gaze = Gaze { u: 0.25, v: 0.5, arm: None };
        (it.track.class, it.track.detected_class, it.track.gaze) = (Some((1, 0.9)), Some(2), gaze);
        it.begin(7, target(60.0), Phase::ReIdentified);
        let Seen { id, born, phase, bbox, class, detected_class, .. } = it.track;
        assert_eq!((id, born, phase, bbox), (1, 7, Phase::ReIdentified, target(60.0)));
        assert_eq!((class, detected_class, it.track.gaze), (Some((1, 0.9)), Some(2), gaze));
    }

    /// A template that is taken while another target covers a part of it would contain that part.
    #[test]
    fn an_occluded_target_keeps_its_template() {
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
