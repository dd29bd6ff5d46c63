//! Looking around a target that may have leapt farther than the particles reach.
//!
//! The places around the estimate that look most like the target are its distractors (`distractors.rs`), or one of
//! them is the target. The search refines the best of them. If one fits well and better than the estimate, a share of
//! the predicted particles is drawn again from there, in the same frame. It is a proposal (`candidates.rs`), with p/q
//! of a target that leaps anywhere in this neighbourhood with a small `chance`. There is no leap without better
//! evidence than staying, and none onto a remembered place beside the target (`[distractors] remembered`).
//!
//! Deviation: the paper's proposal is blind to the picture but for a detector's boxes (section 5.1).

use super::candidates::{Candidates, Draw};
use crate::geometry::{Extent, State};

foveate_base::settings! {
    /// Settings of the search for a target that has leapt.
    #[derive(Copy)]
    pub struct LocalSearchSettings in "local_search" {
        /// Least fit of a place: 0 is the reference log-likelihood of frame 1 on the target, 1 that off it, 0 to 2.
        pub fit: f64 = 0.5; 0.0 to 2.0,
        /// Prior probability of a leap to anywhere in the neighbourhood, above 0 to 1.
        pub chance: f64 = 0.02; 1e-9 to 1.0,
        /// Share of the particles that restart, above 0 to 1.
        pub share: f64 = 0.2; 1e-3 to 1.0,
        /// Number of places they restart from, 1 to 6.
        pub places: usize = 3; 1.0 to 6.0,
        /// Standard deviation about a place, above 0 to 10.
        pub spread: f64 = 0.15; 1e-3 to 10.0,
    }
}

/// The search by colours for a target that is too fast for its shape.
///
/// A target that moves by about its width in a frame or more is blurred, and before other ground than in the last frame, so its shape fits
/// nowhere. If it has moved fast in the last frame or is new, and the estimate fits badly, all particles restart at the place near the last
/// one that fits best by its shape and colours, with the velocity of that leap.
#[derive(Clone, Debug)]
pub(crate) struct ByColour {
    pub(crate) candidates: Candidates,
    /// The places to be scored, their colour distances and their scores.
    pub(crate) places: Vec<State>,
    pub(crate) colours: Vec<f64>,
    pub(crate) scores: Vec<f64>,
}

impl ByColour {
    /// Frames in which the velocity of a new target is unknown.
    pub(crate) const NEW: u64 = 2;
    /// Expected velocity from which on a target is fast, template units a frame: the dynamics damp it by half.
    pub(crate) const FAST: f64 = 0.35;
    /// Share of the way from the reference log-likelihood on the target to that off it, from which on the estimate fits badly.
    pub(crate) const UNFIT: f64 = 0.5;
    /// Largest colour distance at which an estimate stays, and that of the place to which the particles move.
    pub(crate) const NEAR: f64 = 0.3;
    pub(crate) const FAR: f64 = 0.7;
    /// Largest colour distance of a place that is looked at more closely: it may be off the target by half of the step of the lattice.
    pub(crate) const WORTH: f64 = 0.95;
    /// Nats of a colour distance of 1, and nats by which the new place must be better.
    pub(crate) const NATS: f64 = 30.0;
    pub(crate) const BETTER: f64 = 3.0;

    fn new(draw: Draw) -> Self {
        let candidates = Candidates::new(Draw { share: 1.0, ..draw });
        Self { candidates, places: vec![], colours: vec![], scores: vec![] }
    }
}

/// How often places are made finer, by a third each time.
pub const CLOSER: usize = 3;

/// Nats that the best of places this coarse may be behind the estimate, to be worth a closer look.
pub const WORTH: f64 = 5.0;

/// Looks around a target that may have leapt.
#[derive(Clone, Debug)]
pub struct LocalSearch {
    settings: LocalSearchSettings,
    pub(crate) candidates: Candidates,
    pub(crate) by_colour: ByColour,
}

impl LocalSearch {
    /// With these settings.
    pub fn new(settings: LocalSearchSettings) -> Self {
        let LocalSearchSettings { places, share, spread, chance, .. } = settings;
        let draw = Draw { places, share, spread, chance };
        Self { settings, candidates: Candidates::new(draw), by_colour: ByColour::new(draw) }
    }
    /// The settings it was made with.
    pub fn settings(&self) -> &LocalSearchSettings {
        &self.settings
    }
    /// Begins with these places about an estimate, of a lattice: distance of neighbouring places and of the farthest, template units. To
    /// be scored.
    pub fn begin(&mut self, places: &[State], estimate: &State, extent: Extent, lattice: (f64, f64)) -> &[State] {
        self.candidates.begin(places, estimate.half(extent), lattice)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::{Purpose, Streams};

    const EXTENT: Extent = Extent { half_w: 10.0, half_h: 20.0 };

    /// A peak of width 0.3 template units between the places of a lattice of 0.8 is found to a fiftieth of a unit.
    #[test]
    fn a_leap_between_places_is_found() {
        let estimate = State { x: 100.0, y: 100.0, log_scale: 2f64.ln(), ..State::default() };
        let peak = State { x: 150.0, y: 61.0, ..estimate };
        let score = |places: &[State]| -> Vec<f64> {
            let off = |p: &State| ((p.x - peak.x) / 20.0).hypot((p.y - peak.y) / 40.0);
            places
                .iter()
                .map(|p| -2.0 - 0.5 * (off(p) / 0.3).powi(2) - 30.0 * (p.log_scale - peak.log_scale).abs())
                .collect()
        };
        let lattice = [(-1, 0), (1, 0), (2, -1), (3, -1), (0, 1)];
        let places = lattice.map(|(i, j)| State {
            x: estimate.x + 0.8 * 20.0 * f64::from(i),
            y: estimate.y + 0.8 * 40.0 * f64::from(j),
            ..estimate
        });
        let mut search = LocalSearch::new(LocalSearchSettings { share: 0.5, spread: 0.001, ..Default::default() });
        let mut scores = score(search.begin(&places, &estimate, EXTENT, (0.8, 6.0)));
        for _ in 0..CLOSER {
            scores = score(search.candidates.refine(&scores));
        }
        let (mut states, mut log_prior, mut which) = (vec![estimate; 10], vec![-3.0; 10], vec![]);
        let streams = Streams::new(1, 0).at(1, Purpose::LocalSearch);
        let (best, fit) = search.candidates.best(&scores).expect("a place");
        assert!((best.x - peak.x).abs() < 0.6 && fit > -2.02, "{best:?}: {fit}");
        let mut none = search.clone();
        search.candidates.draw(-2.2, &mut states, &mut log_prior, &mut which, streams);
        assert_eq!(which, [1, 3, 5, 7, 9]);
        for (i, state) in states.iter().enumerate() {
            let off = ((state.x - peak.x) / 20.0).hypot((state.y - peak.y) / 40.0);
            assert!(if which.contains(&i) { off < 0.03 } else { *state == estimate && log_prior[i] == -3.0 }, "{off}");
        }
        none.candidates.draw(-1.9, &mut states, &mut log_prior, &mut which, streams);
        assert!(which.is_empty(), "nothing fits as well as the estimate");
    }
}
