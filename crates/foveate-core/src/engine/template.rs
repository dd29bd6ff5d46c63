//! Changes of the target between frames (a new template, another place, the visible fraction), and similarity to the template.

use super::filter::MOST_ASPECT;
use super::target::Target;
use super::view::View;
use super::{Claim, Engine, Parts};
use crate::gaze::Context;
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::scene::{Image, Scene};
use foveate_base::Result;
use foveate_base::rng::Purpose;

/// Offsets at which a place is compared, template units: detected boxes are seldom aligned with the first box.
const ABOUT: [f64; 3] = [-0.2, 0.0, 0.2];

impl Engine {
    /// Starts on the target in `bbox`: keeps the template and draws x₀⁽ⁱ⁾ ~ p(x₀). Resets everything learned before, the frame count and
    /// the random streams.
    ///
    /// # Errors
    /// If the box has no area, is not finite, or does not touch the picture; nothing changes then.
    pub(crate) fn init(&mut self, image: &Image, bbox: BBox) -> Result<()> {
        crate::start::check(image, &bbox)?;
        self.frame = 0;
        self.set_template(image, &bbox, (0.0, 0.0))?;
        self.parts.gaze.policy.reset();
        let (target, Parts { filter, gaze, appearance, extras, .. }) = (*self.target(), &mut self.parts);
        gaze.init_prior(image, &target, &mut **appearance);
        if let Some(it) = &mut extras.recognition {
            it.reset();
        }
        self.context = Context::default();
        if let Some(search) = &mut filter.redetection {
            search.reset();
        }
        self.visibility.set_fraction(1.0);
        self.parts.monitor.reset();
        Ok(())
    }

    /// Takes a new template from this box. Velocity, policy and recogniser do not change. Panics before [`Engine::init`].
    ///
    /// # Errors
    /// If the box has no area, is not finite, or does not touch the picture; nothing changes then.
    pub(crate) fn update_template(&mut self, image: &Image, bbox: &BBox, velocity: (f64, f64)) -> Result<()> {
        assert!(self.target.is_some(), "a target is given before its template is updated");
        self.set_template(image, bbox, velocity)?;
        self.parts.monitor.forget_evidence();
        Ok(())
    }

    fn set_template(&mut self, image: &Image, bbox: &BBox, (vx, vy): (f64, f64)) -> Result<()> {
        crate::start::check(image, bbox)?;
        let (state, extent) = (State { vx, vy, ..State::of(bbox) }, Extent::of(bbox));
        let reference = self.parts.appearance.init_template(image, &state, extent, self.streams);
        self.target = Some(Target { state, extent, unit: extent.mean(), share: 1.0, moved: false, reference });
        self.parts.extras.init(image, &state, extent);
        self.init_surroundings(image, &state);
        self.parts.filter.proposal.size(extent.mean());
        self.parts.filter.spread(&state, extent, self.streams.at(self.frame, Purpose::Start));
        Ok(())
    }

    /// Initialises the surroundings of the target from this picture, with the target at `state`, as in its first frame.
    pub(super) fn init_surroundings(&mut self, image: &Image, state: &State) {
        let (target, scene, scratch) = (*self.target(), Scene { image, detections: &[] }, &mut self.record.scratch);
        let mut view = View::new(&mut *self.parts.appearance, scene, target, &self.visibility, state, scratch);
        self.parts.monitor.init_surroundings(&mut view, state);
    }

    /// Moves the target into this box: draws particles around it, keeps the template, sets P(lost) to 0 until the next frame, and the
    /// visible fraction to 1. Panics before [`Engine::init`].
    pub(crate) fn reset_at(&mut self, bbox: &BBox) {
        self.start_again_at(bbox);
        self.set_visibility(1.0);
    }

    /// Moves the target into this box as [`Engine::reset_at`] does, but keeps the visible fraction.
    pub(crate) fn start_again_at(&mut self, bbox: &BBox) {
        let state = self.state_at(bbox);
        let (half_w, half_h) = state.half(self.target().extent);
        self.restart(&state, Extent { half_w, half_h });
        self.target.as_mut().expect("it has a state").moved = true;
    }

    /// Draws particles around this state, for a target of this half size, and sets P(lost) to 0 until the next frame.
    pub(super) fn restart(&mut self, state: &State, extent: Extent) {
        self.parts.monitor.reset_consistency();
        self.parts.monitor.loss.restart(state);
        if let Some(it) = &mut self.parts.extras.box_regression {
            it.restart();
        }
        self.parts.filter.spread(state, extent, self.streams.at(self.frame, Purpose::Start));
        self.context.lost = false;
    }

    /// Sets the visible fraction of the target in the next frames, 0 to 1; the default is 1. It multiplies log-likelihoods, and below one
    /// half the frame is not judged.
    pub(crate) fn set_visibility(&mut self, visible: f64) {
        self.visibility.set_fraction(visible);
    }

    /// Sets the number of frames that were dropped before the next one: the particles move for as many frames more.
    pub(crate) fn set_dropped(&mut self, frames: usize) {
        self.parts.filter.dropped = frames;
    }

    /// Returns the number of frames that were dropped before the next one.
    #[cfg(test)]
    pub(crate) fn dropped(&self) -> usize {
        self.parts.filter.dropped
    }

    /// Sets the place where this target is expected in the next frame, and the places of the targets that overlap it.
    pub(crate) fn exclude(&mut self, own: Claim, others: impl Iterator<Item = Claim>) {
        self.visibility.begin(own);
        others.for_each(|other| self.visibility.add(other));
    }

    /// Returns the state of this box, upright and at rest, with size and shape relative to the template. Panics before [`Engine::init`].
    pub(crate) fn state_at(&self, bbox: &BBox) -> State {
        let (given, drawn) = (Extent::of(bbox), self.target().drawn());
        let log_scale = (given.mean() / drawn.mean()).ln();
        let log_aspect = (given.half_w / given.half_h * drawn.half_h / drawn.half_w).ln();
        State { log_scale, log_aspect: log_aspect.clamp(-MOST_ASPECT, MOST_ASPECT), ..State::of(bbox) }
    }

    /// Returns how similar a place, in the shape of the template, is to the target: 1 for the similarity of its own place in its first frame,
    /// 0 for that of other places. It is the best of nine places around the given one. The track does not change. Panics before [`Engine::init`].
    pub(crate) fn similarity(&mut self, image: &Image, state: &State) -> f64 {
        let extent = self.target().extent;
        let state = &State { log_aspect: 0.0, ..*state };
        let (unit, shape) = (state.log_scale.exp(), state.shaped(extent));
        let places: [State; 9] = std::array::from_fn(|i| State {
            x: state.x + ABOUT[i % 3] * unit * shape.half_w,
            y: state.y + ABOUT[i / 3] * unit * shape.half_h,
            ..*state
        });
        let appearance = &mut self.parts.appearance;
        let mut log_likelihood = [0.0; 9];
        appearance.prepare(image, &places, &[Gaze::CENTRE]);
        appearance.log_likelihood(&places, Gaze::CENTRE, &mut log_likelihood);
        let best = log_likelihood.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let reference = self.target.as_ref().expect("a target is given before it is compared").reference;
        let share = (best - reference.off) / (reference.on - reference.off).max(1e-9);
        if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::toy::{Learned, Toy, model, parts, picture, started, target, turning};
    use super::*;
    use crate::control::DistractorSettings;
    use crate::engine::Monitor;
    use crate::gaze::{Grid, Hedge};
    use crate::identity::box_regression::{BoxRegression, Settings};
    use foveate_base::files::Nowhere;
    use std::sync::Arc;

    /// A tracker of which each part learns, and that has lost its target.
    fn used() -> Engine {
        let mut it = fresh();
        (0..10).for_each(|_| step(&mut it));
        it.reset_at(&target(95.0));
        (0..20).for_each(|_| step(&mut it));
        assert!(it.is_searching());
        it
    }

    /// The same tracker on its target.
    fn fresh() -> Engine {
        let network = Settings::default().read(&Nowhere).expect("it ships");
        let boxes = BoxRegression::new(Arc::new(network), Settings::default());
        let distractors = DistractorSettings { reach: 2.0, step: 1.0, remembered: 2, first_frame: true };
        let mut parts = parts(Toy { learned: Some(Learned::default()), ..Toy::at(50.0) });
        parts.gaze = parts.gaze.with_policy(Box::new(Hedge::new(Grid::default().gazes(), 0.5).expect("gazes")));
        parts.monitor = Monitor::new(Default::default(), model()).with_distractors(Some(distractors));
        let recognition = turning(10).with_alarm().expect("two classes");
        started(parts.with_recognition(Some(recognition)).with_box_regression(Some(boxes)), 0)
    }

    fn step(it: &mut Engine) {
        it.step_on(Scene { image: &picture(), detections: &[] });
    }

    /// A tracker that starts on a new target continues as one that has never tracked another.
    #[test]
    fn a_new_target_resets_everything_that_was_learned() {
        let (mut used, mut fresh) = (used(), fresh());
        used.set_visibility(0.7);
        used.init(&picture(), target(50.0)).expect("a box in the picture");
        for frame in 0..12 {
            assert_eq!(used.save(), fresh.save(), "before frame {frame}");
            step(&mut used);
            step(&mut fresh);
        }
    }

    /// A box that is given ends the search and drops the evidence of the last frames. The visible fraction is that of a new place, or stays.
    #[test]
    fn a_given_box_ends_the_search() {
        let mut it = used();
        it.set_visibility(0.4);
        it.start_again_at(&target(50.0));
        assert!(!it.is_searching() && it.parts.monitor.consistency.last() == Default::default());
        assert_eq!(it.visibility.fraction(), 0.4);
        it.reset_at(&target(50.0));
        assert_eq!(it.visibility.fraction(), 1.0);
    }

    /// A given box has its own size and shape, which a search that follows begins with. What moved the reported box from the old one is gone.
    #[test]
    fn a_given_box_is_reported_as_it_is() {
        let mut it = used();
        let corrected = |it: &Engine| it.parts.extras.box_regression.as_ref().expect("it has one").is_corrected();
        assert!(corrected(&it));
        let given = BBox::around(60.0, 40.0, 30.0, 10.0);
        it.reset_at(&given);
        let seen = *it.parts.monitor.loss.seen().expect("a place was given");
        assert!(!corrected(&it) && seen == it.state_at(&given));
        let BBox { x, y, w, h } = seen.bbox(it.target().drawn());
        for (found, given) in [(x, given.x), (y, given.y), (w, given.w), (h, given.h)] {
            assert!((found - given).abs() < 1e-9, "{found} {given}");
        }
        let far = BBox { w: 1e6, ..given };
        assert_eq!(it.state_at(&far).log_aspect, MOST_ASPECT);
    }

    /// A new template resets the appearance learned with the old one, and the evidence under it. Policy, class and visible fraction are the
    /// target's own.
    #[test]
    fn a_new_template_resets_the_evidence_under_the_old_one() {
        let (mut used, fresh) = (used(), fresh());
        let before = used.save();
        used.update_template(&picture(), &target(50.0), (2.0, 1.0)).expect("a box in the picture");
        let after = used.save();
        for part in ["frame", "context", "visible", "policy", "recognizer"] {
            assert_eq!(after.part(part), before.part(part), "{part}");
        }
        for part in ["consistency", "surroundings", "box_regression"] {
            assert_ne!(before.part(part), fresh.save().part(part), "{part} had learned");
            assert_eq!(after.part(part), fresh.save().part(part), "{part}");
        }
        assert!(used.parts.monitor.loss.seen().is_none(), "nothing is usual yet");
        assert!(used.is_searching(), "the status is that of the track");
        let target = used.target().state;
        assert_eq!((target.x, target.vx, target.vy), (50.0, 2.0, 1.0));
        let mean = |of: fn(&State) -> f64| used.parts.filter.state.particles.iter().map(of).sum::<f64>() / 50.0;
        assert!((mean(|it| it.x) - 50.0).abs() < 2.0 && (mean(|it| it.vx) - 2.0).abs() < 1.0);
    }
}
