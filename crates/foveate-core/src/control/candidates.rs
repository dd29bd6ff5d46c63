//! Candidate places of a target, from coarse to fine, and particles redrawn from the best of them.
//!
//! It is a proposal: with q a mixture of normals about those places and p a `chance` spread uniformly over the
//! searched area, these particles get the weight log p/q. They compete with the others by that and by the likelihood,
//! frame by frame, so a place that fitted once by chance does not last.

use rand::RngExt;
use rand_distr::StandardNormal;

use super::evenly;
use crate::geometry::State;
use foveate_base::rng::Streams;

/// Other sizes that are tried at the best places: differences of log scale.
const SIZES: [f64; 2] = [-0.15, 0.15];

/// Places nearer to each other than this, in template units, are one.
const NEAR: f64 = 0.5;

/// Exponent of the likelihoods in the draw of places, so that the second best is drawn too.
const SOFT: f64 = 0.25;

/// The number of candidates and the draws from them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Draw {
    /// How many of the best places are kept.
    pub places: usize,
    /// Share of the particles that restart, 0 to 1.
    pub share: f64,
    /// Standard deviation about a place, template units.
    pub spread: f64,
    /// Prior probability that the target is anywhere in the area.
    pub chance: f64,
}

/// The places to be scored next, and the best of those that were.
#[derive(Clone, Debug, Default)]
pub(crate) struct Candidates {
    draw: Draw,
    /// To be scored.
    pub(super) states: Vec<State>,
    found: Vec<Found>,
    /// Distances of neighbouring places, and halves of the box, across and down, pixels.
    pub(super) apart: (f64, f64),
    pub(super) half: (f64, f64),
    /// The searched area, template units².
    pub(super) area: f64,
}

/// One of the best places, and its log-likelihood.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Found {
    state: State,
    log_likelihood: f64,
}

/// How far two places are apart, across or down, in template units.
fn apart(a: &State, b: &State, half: (f64, f64)) -> f64 {
    ((a.x - b.x).abs() / half.0).max((a.y - b.y).abs() / half.1)
}

impl Candidates {
    /// None yet.
    pub(super) fn new(draw: Draw) -> Self {
        Self { draw, ..Self::default() }
    }
    /// The best places so far.
    pub(super) fn found(&self) -> impl Iterator<Item = State> {
        self.found.iter().map(|found| found.state)
    }
    /// Begins with these places, of a lattice: distance of neighbouring places and of the farthest, template units, for a box of these half
    /// sides. To be scored.
    pub(crate) fn begin(&mut self, places: &[State], half: (f64, f64), (step, reach): (f64, f64)) -> &[State] {
        (self.half, self.apart, self.area) = (half, (step * half.0, step * half.1), (2.0 * reach).powi(2));
        self.resume([]);
        self.states.clear();
        self.states.extend_from_slice(places);
        &self.states
    }
    /// Takes places for the best so far; they will have to be scored again to be drawn from.
    pub(super) fn resume(&mut self, states: impl IntoIterator<Item = State>) {
        self.found.clear();
        self.found.extend(states.into_iter().map(|state| Found { state, log_likelihood: f64::NEG_INFINITY }));
    }
    /// Takes the best places so far out.
    pub(super) fn take(&mut self) -> impl Iterator<Item = State> {
        self.found.drain(..).map(|found| found.state)
    }
    /// Of the places found and of those that were to be scored, and have these log-likelihoods, keeps the best, none of which is near a
    /// better one.
    pub(super) fn keep_best(&mut self, log_likelihood: &[f64]) {
        let scored = self.states.iter().zip(log_likelihood).filter(|(_, l)| l.is_finite());
        self.found.extend(scored.map(|(&state, &log_likelihood)| Found { state, log_likelihood }));
        let order = |a: &Found, b: &Found| {
            let places = || (a.state.y.total_cmp(&b.state.y)).then(a.state.x.total_cmp(&b.state.x));
            b.log_likelihood.total_cmp(&a.log_likelihood).then_with(places)
        };
        let apart_from =
            |kept: &[Found], it: &Found| kept.iter().all(|f| apart(&f.state, &it.state, self.half) >= NEAR);
        let mut kept = 0;
        // Few are kept of many: looking for each is faster than to sort all.
        while kept < self.draw.places {
            let (chosen, rest) = self.found.split_at(kept);
            let better = |best: Option<usize>, i: usize| match best {
                Some(best) if order(&rest[i], &rest[best]).is_ge() => Some(best),
                _ if apart_from(chosen, &rest[i]) => Some(i),
                best => best,
            };
            let Some(best) = (0..rest.len()).fold(None, better) else { break };
            self.found.swap(kept, kept + best);
            kept += 1;
        }
        self.found.truncate(kept);
        self.states.clear();
    }
    /// Keeps the best of the places scored last, and gives places about these, three times as close to each other, and these in other
    /// sizes. To be scored.
    pub(crate) fn refine(&mut self, log_likelihood: &[f64]) -> &[State] {
        self.keep_best(log_likelihood);
        self.apart = (self.apart.0 / 3.0, self.apart.1 / 3.0);
        self.states.clear();
        for found in &self.found {
            for (row, column) in [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)] {
                let (dx, dy) = (f64::from(column) * self.apart.0, f64::from(row) * self.apart.1);
                self.states.push(State { x: found.state.x + dx, y: found.state.y + dy, ..found.state });
            }
            let log_scale = found.state.log_scale;
            self.states.extend(SIZES.map(|d| State { log_scale: log_scale + d, ..found.state }));
        }
        &self.states
    }
    /// The place that fits best of all that were scored, however well, and its log-likelihood.
    pub(crate) fn best(&mut self, log_likelihood: &[f64]) -> Option<(State, f64)> {
        self.keep_best(log_likelihood);
        self.found.first().map(|found| (found.state, found.log_likelihood))
    }
    /// After [`Candidates::best`]: draws a share of `states`, every so many, again from the best places whose log-likelihood is at least `least`, each
    /// from a stream of its own. `which` gets their indices, none if nothing fits, and `log_prior` the log p/q of these.
    /// The state keeps its speed and angle, and takes size and shape of the place.
    pub(crate) fn draw(
        &mut self,
        least: f64,
        states: &mut [State],
        log_prior: &mut [f64],
        which: &mut Vec<usize>,
        streams: Streams,
    ) {
        let how = self.draw;
        self.found.retain(|found| found.log_likelihood >= least);
        which.clear();
        let Some(best) = self.found.first().copied() else { return };
        which.extend(evenly(states.len(), how.share));
        let weight = |found: &Found| (SOFT * (found.log_likelihood - best.log_likelihood)).exp();
        let total: f64 = self.found.iter().map(weight).sum();
        let p = how.chance / self.area / which.len() as f64;
        for &i in &*which {
            let mut rng = streams.rng(i as u64);
            let mut left = total * rng.random::<f64>();
            let drawn = self.found.iter().find(|found| {
                left -= weight(found);
                left < 0.0
            });
            let place = drawn.unwrap_or(&best).state;
            let [dx, dy] = std::array::from_fn(|_| how.spread * rng.sample::<f64, _>(StandardNormal));
            let (x, y) = (place.x + dx * self.half.0, place.y + dy * self.half.1);
            let state = State { x, y, log_scale: place.log_scale, log_aspect: place.log_aspect, ..states[i] };
            let density = |found: &Found| weight(found) / total * self.density(how.spread, &state, &found.state);
            let q: f64 = self.found.iter().map(density).sum();
            (states[i], log_prior[i]) = (state, (p / q).ln());
        }
    }
    /// Of a normal about a place, per template unit².
    fn density(&self, spread: f64, at: &State, place: &State) -> f64 {
        let (u, v) = ((at.x - place.x) / self.half.0, (at.y - place.y) / self.half.1);
        let variance = spread * spread;
        (-0.5 * (u * u + v * v) / variance).exp() / (std::f64::consts::TAU * variance)
    }
}
