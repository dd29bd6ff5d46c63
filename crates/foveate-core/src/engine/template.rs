//! The target's template and place, changed from outside the loop: given, given again, renewed, compared, covered.

use super::{Claim, Engine, Target};
use crate::gaze::Context;
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::recognition::Recognition;
use crate::scene::Image;
use foveate_base::Result;
use foveate_base::rng::Purpose;

/// Offsets, template units, at which a place is compared: its box is seldom laid as the first one was.
const ABOUT: [f64; 3] = [-0.2, 0.0, 0.2];

/// Deviation: the paper has no second target. What is seen of one that is covered in part counts for as much less.
pub(super) fn attenuate(log_likelihood: &mut [f64], visible: f64) {
    if visible < 1.0 {
        log_likelihood.iter_mut().for_each(|l| *l *= visible);
    }
}

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
        self.foretell(image);
        self.parts.recognition.iter_mut().for_each(Recognition::reset);
        (self.context, self.visible) = (Context::default(), 1.0);
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
        self.target = Some(Target { state, extent, unit: extent.mean() });
        self.parts.appearance.init_template(image, &state, extent, self.streams);
        self.parts.box_regression.iter_mut().for_each(|it| it.imprint(image, &state, extent));
        self.look_around_first(image, &state);
        self.parts.filter.proposal.size(extent.mean());
        self.parts.filter.spread(&state, extent, self.streams.at(self.frame, Purpose::Start));
        Ok(())
    }

    /// Puts the target into this box: particles start about it, its template stays, and it is not lost until frames say so. Panics
    /// before [`Engine::init`].
    pub fn reset_at(&mut self, bbox: &BBox) {
        self.begin_again_at(bbox);
        self.set_visibility(1.0);
    }

    /// The same where it is fetched, not given: as much of it can be seen as before.
    pub fn begin_again_at(&mut self, bbox: &BBox) {
        let state = self.state_at(bbox);
        let (half_w, half_h) = state.half(self.target().extent);
        self.parts.monitor.reset_consistency();
        self.parts.monitor.loss.begin_again();
        self.parts.filter.spread(&state, Extent { half_w, half_h }, self.streams.at(self.frame, Purpose::Start));
        self.context.lost = false;
        self.second.iter_mut().for_each(|second| second.begin_again_at(bbox));
    }

    /// Says which share of the target the next frames can show, 0 to 1, because something else covers it. Its looks count for
    /// as much less, and below one half they cannot make it lost. 1 until told otherwise: then nothing changes.
    pub fn set_visibility(&mut self, visible: f64) {
        self.visible = if visible.is_finite() { visible.clamp(0.0, 1.0) } else { 1.0 };
        self.second.iter_mut().for_each(|second| second.set_visibility(visible));
    }

    /// Where this target is expected in the next frame, and where those are that it meets: places at which they may be what is seen.
    pub fn exclude(&mut self, own: Claim, others: impl Iterator<Item = Claim> + Clone) {
        self.exclusion.begin(own);
        others.clone().for_each(|other| self.exclusion.add(other));
        self.second.iter_mut().for_each(|second| second.exclude(own, others.clone()));
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
        appearance.see(image, &places, &[Gaze::CENTRE]);
        appearance.log_likelihood(&places, Gaze::CENTRE, &mut log_likelihood);
        let best = log_likelihood.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let reference = appearance.reference();
        let share = (best - reference.off) / (reference.on - reference.off).max(1e-9);
        if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }
    }
}
