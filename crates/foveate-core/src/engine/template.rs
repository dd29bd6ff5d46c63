//! Changes of the target between frames (a new template, another place, the visible fraction), and similarity to the template.

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
        let (target, Parts { gaze, appearance, extras, .. }) = (*self.target(), &mut self.parts);
        gaze.init_prior(image, &target, &mut **appearance);
        if let Some(it) = &mut extras.recognition {
            it.reset();
        }
        self.context = Context::default();
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
        self.target = Some(Target { state, extent, unit: extent.mean(), reference });
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
        self.parts.monitor.reset_consistency();
        self.parts.monitor.loss.restart();
        self.parts.filter.spread(&state, Extent { half_w, half_h }, self.streams.at(self.frame, Purpose::Start));
        self.context.lost = false;
    }

    /// Sets the visible fraction of the target in the next frames, 0 to 1; the default is 1. It multiplies log-likelihoods, and below one
    /// half the frame is not judged.
    pub(crate) fn set_visibility(&mut self, visible: f64) {
        self.visibility.set_fraction(visible);
    }

    /// Sets the place where this target is expected in the next frame, and the places of the targets that overlap it.
    pub(crate) fn exclude(&mut self, own: Claim, others: impl Iterator<Item = Claim>) {
        self.visibility.begin(own);
        others.for_each(|other| self.visibility.add(other));
    }

    /// Returns the state of this box, upright and at rest, with a scale relative to the template. Panics before [`Engine::init`].
    pub(crate) fn state_at(&self, bbox: &BBox) -> State {
        let log_scale = (Extent::of(bbox).mean() / self.target().extent.mean()).ln();
        State { log_scale, ..State::of(bbox) }
    }

    /// Returns how similar a place is to the target: 1 for the similarity of its own place in its first frame, 0 for that of other places.
    /// It is the best of nine places around the given one. The track does not change. Panics before [`Engine::init`].
    pub(crate) fn similarity(&mut self, image: &Image, state: &State) -> f64 {
        let extent = self.target().extent;
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
