//! The target's template and place, changed from outside the loop: given, given again, renewed, compared, covered.

use super::view::View;
use super::{Claim, Engine, Parts, Target};
use crate::gaze::Context;
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::scene::{Image, Scene};
use foveate_base::Result;
use foveate_base::rng::Purpose;

/// Offsets, template units, at which a place is compared: its box is seldom laid as the first one was.
const ABOUT: [f64; 3] = [-0.2, 0.0, 0.2];

impl Engine {
    /// Starts, or starts again, on the target in `bbox`: keeps the template and draws x₀⁽ⁱ⁾ ~ p(x₀). All that was learned is
    /// forgotten, and frames are counted anew, so that the random streams start again.
    ///
    /// Fails where the box has no area, is not finite, or does not touch the picture; then nothing has changed.
    pub fn init(&mut self, image: &Image, bbox: BBox) -> Result<()> {
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
        self.second.as_mut().map_or(Ok(()), |second| second.init(image, bbox))
    }

    /// Takes what is in this box for what the target looks like from now on. It moves on as it did, and what policy and
    /// recogniser learned stays. Panics before [`Engine::init`].
    ///
    /// Fails where the box has no area, is not finite, or does not touch the picture; then nothing has changed.
    pub fn update_template(&mut self, image: &Image, bbox: &BBox, velocity: (f64, f64)) -> Result<()> {
        assert!(self.target.is_some(), "a target is given before its template is updated");
        self.set_template(image, bbox, velocity)?;
        self.parts.monitor.forget_evidence();
        self.second.as_mut().map_or(Ok(()), |second| second.update_template(image, bbox, velocity))
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

    /// Learns the surroundings of the target, at `state` of this picture, as those of its first frame.
    pub(super) fn init_surroundings(&mut self, image: &Image, state: &State) {
        let (target, scene, scratch) = (*self.target(), Scene { image, detections: &[] }, &mut self.record.scratch);
        let mut view = View::new(&mut *self.parts.appearance, scene, target, &self.visibility, state, scratch);
        self.parts.monitor.init_surroundings(&mut view, state);
    }

    /// Puts the target into this box: particles start about it, its template stays, and it is not lost until frames say so. Panics
    /// before [`Engine::init`].
    pub fn reset_at(&mut self, bbox: &BBox) {
        self.start_again_at(bbox);
        self.set_visibility(1.0);
    }

    /// The same where it is fetched, not given: as much of it can be seen as before.
    pub fn start_again_at(&mut self, bbox: &BBox) {
        let state = self.state_at(bbox);
        let (half_w, half_h) = state.half(self.target().extent);
        self.parts.monitor.reset_consistency();
        self.parts.monitor.loss.restart();
        self.parts.filter.spread(&state, Extent { half_w, half_h }, self.streams.at(self.frame, Purpose::Start));
        self.context.lost = false;
        if let Some(second) = &mut self.second {
            second.start_again_at(bbox);
        }
    }

    /// Says which share of the target the next frames can show, 0 to 1, because something else covers it. Its looks count for
    /// as much less, and below one half they cannot make it lost. 1 until told otherwise: then nothing changes.
    pub fn set_visibility(&mut self, visible: f64) {
        self.visibility.set_fraction(visible);
        if let Some(second) = &mut self.second {
            second.set_visibility(visible);
        }
    }

    /// Where this target is expected in the next frame, and where those are that it meets: places at which they may be what is seen.
    pub fn exclude(&mut self, own: Claim, others: impl Iterator<Item = Claim> + Clone) {
        self.visibility.begin(own);
        others.clone().for_each(|other| self.visibility.add(other));
        if let Some(second) = &mut self.second {
            second.exclude(own, others);
        }
    }

    /// The state that has this box, upright and at rest, at this target's size. Panics before [`Engine::init`].
    pub fn state_at(&self, bbox: &BBox) -> State {
        let log_scale = (Extent::of(bbox).mean() / self.target().extent.mean()).ln();
        State { log_scale, ..State::of(bbox) }
    }

    /// How similar a place is to the target: 1 as much as its own was in its first frame, 0 as other places were; the best of
    /// nine places about it. The track does not change. Panics before [`Engine::init`].
    pub fn similarity(&mut self, image: &Image, state: &State) -> f64 {
        let extent = self.target().extent;
        let unit = state.log_scale.exp();
        let places: [State; 9] = std::array::from_fn(|i| State {
            x: state.x + ABOUT[i % 3] * unit * extent.half_w,
            y: state.y + ABOUT[i / 3] * unit * extent.half_h,
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
