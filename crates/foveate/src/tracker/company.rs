//! What a tracker needs among others: to be told that it is hidden, to say how much a place looks like its target, and to
//! be put where the target was found again.

use super::{Target, Tracker};
use crate::Result;
use crate::control::Aspect;
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::rng::Purpose;
use crate::scene::Image;

/// Least share in view at which evidence is judged: of what is hidden for the most part, looks say nothing.
const LEAST_JUDGED: f64 = 0.5;

/// Offsets, template units, at which a place is compared: its box is seldom laid as the first one was.
const ABOUT: [f64; 3] = [-0.2, 0.0, 0.2];

/// Deviation: the paper has no second target. What is seen of one that is covered in part counts for as much less.
pub(super) fn shade(log_likelihood: &mut [f64], visible: f64) {
    if visible < 1.0 {
        log_likelihood.iter_mut().for_each(|l| *l *= visible);
    }
}

/// Whether evidence of a target of which this share is in view can say that it is lost.
pub(super) fn can_be_judged(visible: f64) -> bool {
    visible >= LEAST_JUDGED
}

impl Tracker {
    /// Says which share of the target the next frames can show, 0 to 1, because something else passes before it. Its looks
    /// count for as much less, and below one half they cannot make it lost. 1 until told otherwise: then nothing changes.
    pub fn shade(&mut self, visible: f64) {
        self.visible = if visible.is_finite() { visible.clamp(0.0, 1.0) } else { 1.0 };
    }

    /// The state that has this box, upright and at rest, at this target's size. Panics before `start`.
    pub fn state_at(&self, bbox: &BBox) -> State {
        let Target { extent, .. } = self.target.expect("start is called before boxes are compared");
        let log_scale = (Extent::of(bbox).mean() / extent.mean()).ln();
        State { log_scale, ..State::of(bbox) }
    }

    /// How much a place looks like the target: 1 as much as its own did in its first frame, 0 as other places did; the best
    /// of nine places about it. The track does not change. Panics before `start`.
    pub fn likeness(&mut self, image: &Image, state: &State) -> f64 {
        let Target { extent, .. } = self.target.expect("start is called before places are compared");
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
        let promise = appearance.expectation();
        let share = (best - promise.off) / (promise.on - promise.off).max(1e-9);
        if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }
    }

    /// Puts the target into this box: particles start about it, what it looks like stays as it was. Panics before `start`.
    pub fn place(&mut self, bbox: &BBox) {
        let state = self.state_at(bbox);
        let Target { extent, .. } = self.target.expect("state_at has found one");
        let scale = state.log_scale.exp();
        let scaled = Extent { half_w: extent.half_w * scale, half_h: extent.half_h * scale };
        self.parts.vigilance.reset();
        self.parts.start.draw(&state, scaled, &mut self.particles, self.streams.at(self.frame, Purpose::Start));
        self.log_carried.fill(-(self.particles.len() as f64).ln());
        self.visible = 1.0;
    }

    /// Takes what is in this box for what the target looks like from now on. It moves on as it did, and what policy and
    /// recogniser learned stays. Panics before `start`.
    ///
    /// Fails where the box has no area, is not finite, or does not touch the picture; then nothing has changed.
    pub fn renew(&mut self, image: &Image, bbox: &BBox, velocity: (f64, f64)) -> Result<()> {
        crate::start::check(image, bbox)?;
        assert!(self.target.is_some(), "start is called before a look is renewed");
        let (state, extent) = (State::of(bbox), Extent::of(bbox));
        let state = State { vx: velocity.0, vy: velocity.1, ..state };
        self.target = Some(Target { state, extent, unit: extent.mean() });
        self.parts.appearance.imprint(image, &state, extent, self.streams);
        self.parts.aspect.iter_mut().for_each(Aspect::reset);
        self.parts.vigilance.reset();
        self.parts.proposal.size(extent.mean());
        self.parts.start.draw(&state, extent, &mut self.particles, self.streams.at(self.frame, Purpose::Start));
        self.log_carried.fill(-(self.particles.len() as f64).ln());
        Ok(())
    }

    /// The pixels a template unit has at scale 1; `None` before `start`.
    pub fn extent(&self) -> Option<Extent> {
        self.target.map(|target| target.extent)
    }
}
