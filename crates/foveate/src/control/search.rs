//! Looking for a target believed lost (the paper: "no ability to recover from a tracking failure").
//!
//! Every few frames while the target is lost, places all over the picture are scored at once, and a share of the particles
//! starts again from the places that fit best. They win or lose against the others by the likelihood alone, frame by frame:
//! a place that fitted once by chance does not last.

use rand::RngExt;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use super::Promise;
use crate::geometry::{Extent, State};
use crate::rng::Streams;
use crate::{Error, Result};

/// Settings of the search; lengths are in template units (1 = half the target's box).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Search {
    /// Frames between two searches, at least 1.
    pub every: u64,
    /// Distance of neighbouring places, above 0 to 10; it grows where there would be more than 10,000.
    pub step: f64,
    /// Share of the particles that start again, 0 to 1.
    pub share: f64,
    /// Places they start from, 1 to 1000.
    pub places: usize,
    /// A place counts only if its log-likelihood lies at most this share below what the first frame promised on the
    /// target, towards what it promised elsewhere; 0 to 2.
    pub fit: f64,
    /// Standard deviation about a place, 0 to 10; the velocity's too.
    pub spread: f64,
    #[serde(skip)]
    states: Vec<State>,
    #[serde(skip)]
    found: Vec<Found>,
    #[serde(skip)]
    best: Option<State>,
    /// Distances of neighbouring places, and halves of the box, across and down, pixels.
    #[serde(skip)]
    apart: (f64, f64),
    #[serde(skip)]
    half: (f64, f64),
}

/// One of the best places, and its log-likelihood.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Found {
    state: State,
    log_likelihood: f64,
}

impl Default for Search {
    fn default() -> Self {
        let (states, found, best, apart, half) = (vec![], vec![], None, (0.0, 0.0), (0.0, 0.0));
        let (every, step, share, places, fit, spread) = (4, 0.3, 0.3, 8, 0.2, 0.15);
        Self { every, step, share, places, fit, spread, states, found, best, apart, half }
    }
}

/// How often the best places are made finer, by a third each time.
pub const REFINEMENTS: usize = 2;

/// The most places that are scored at once.
const MOST: f64 = 10_000.0;

/// Places nearer to each other than this, in template units, are one.
const NEAR: f64 = 0.5;

/// How far two places are apart, across or down, in template units.
fn apart(a: &State, b: &State, half: (f64, f64)) -> f64 {
    ((a.x - b.x).abs() / half.0).max((a.y - b.y).abs() / half.1)
}

impl Search {
    /// Fails where a number is out of range, naming it.
    pub fn check(&self) -> Result<()> {
        let wrong = |name: &str, expected: &str, found: f64| {
            Err(Error::Config(format!("search.{name} is {expected}; it is {found}")))
        };
        match self {
            s if !(1..=1_000_000).contains(&s.every) => wrong("every", "1 to 1000000 frames", s.every as f64),
            s if !(s.step > 0.0 && s.step <= 10.0) => wrong("step", "above 0 to 10 template units", s.step),
            s if !(0.0..=1.0).contains(&s.share) => wrong("share", "0 to 1", s.share),
            s if !(1..=1000).contains(&s.places) => wrong("places", "1 to 1000", s.places as f64),
            s if !(0.0..=2.0).contains(&s.fit) => wrong("fit", "0 to 2", s.fit),
            s if !(0.0..=10.0).contains(&s.spread) => wrong("spread", "0 to 10 template units", s.spread),
            _ => Ok(()),
        }
    }
    /// Whether to search in this frame.
    pub fn is_due(&self, lost: bool, frame: u64) -> bool {
        lost && self.share > 0.0 && frame.is_multiple_of(self.every)
    }
    /// Places all over a picture, of the scale and angle with which the target was `seen` last, at rest, row by row.
    pub fn places(&mut self, size: (usize, usize), seen: &State, extent: Extent) -> &[State] {
        let (width, height) = (size.0 as f64, size.1 as f64);
        let scale = seen.log_scale.exp();
        self.half = (extent.half_w * scale, extent.half_h * scale);
        let (dx, dy) = ((self.step * self.half.0).max(1.0), (self.step * self.half.1).max(1.0));
        let coarser = (width * height / (dx * dy) / MOST).sqrt().max(1.0);
        self.apart = (dx * coarser, dy * coarser);
        let (dx, dy) = self.apart;
        let (columns, rows) = ((width / dx).ceil() as usize, (height / dy).ceil() as usize);
        self.states.clear();
        self.found.clear();
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let place = State { x: (column as f64 + 0.5) * dx, y: (row as f64 + 0.5) * dy, vx: 0.0, vy: 0.0, ..*seen };
            self.states.push(place);
        }
        &self.states
    }
    /// Keeps the best of the places scored last, and gives places about these, three times as close to each other. To be
    /// called [`REFINEMENTS`] times, each followed by scoring, before [`Search::restart`].
    pub fn refine(&mut self, log_likelihood: &[f64]) -> &[State] {
        self.keep_best(log_likelihood);
        self.apart = (self.apart.0 / 3.0, self.apart.1 / 3.0);
        self.states.clear();
        for found in &self.found {
            for (row, column) in [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)] {
                let (dx, dy) = (f64::from(column) * self.apart.0, f64::from(row) * self.apart.1);
                self.states.push(State { x: found.state.x + dx, y: found.state.y + dy, ..found.state });
            }
        }
        &self.states
    }
    /// The best of what was found and scored, none of which is near a better one.
    fn keep_best(&mut self, log_likelihood: &[f64]) {
        let scored = self.states.iter().zip(log_likelihood).filter(|(_, l)| l.is_finite());
        self.found.extend(scored.map(|(&state, &log_likelihood)| Found { state, log_likelihood }));
        let order = |a: &Found, b: &Found| {
            let places = || (a.state.y.total_cmp(&b.state.y)).then(a.state.x.total_cmp(&b.state.x));
            b.log_likelihood.total_cmp(&a.log_likelihood).then_with(places)
        };
        self.found.sort_unstable_by(order);
        let mut kept = 0;
        for i in 0..self.found.len() {
            let it = self.found[i];
            if kept < self.places && self.found[..kept].iter().all(|f| apart(&f.state, &it.state, self.half) >= NEAR) {
                self.found[kept] = it;
                kept += 1;
            }
        }
        self.found.truncate(kept);
    }
    /// The place that fits best of all that were scored, however well; after [`Search::restart`].
    pub fn best(&self) -> Option<&State> {
        self.best.as_ref()
    }
    /// Lets the last of `particles` start again from the best places, given the log-likelihood of those scored last; none
    /// where nothing fits.
    pub fn restart(
        &mut self,
        log_likelihood: &[f64],
        promise: Promise,
        extent: Extent,
        particles: &mut [State],
        streams: Streams,
    ) {
        self.keep_best(log_likelihood);
        self.best = self.found.first().map(|found| found.state);
        let least = promise.on - self.fit * (promise.on - promise.off);
        self.found.retain(|found| found.log_likelihood >= least);
        let Some(best) = self.found.first().copied() else { return };
        let weight = |found: &Found| (found.log_likelihood - best.log_likelihood).exp();
        let total: f64 = self.found.iter().map(weight).sum();
        let kept = particles.len() - (self.share * particles.len() as f64).round() as usize;
        for (i, particle) in particles[kept..].iter_mut().enumerate() {
            let mut rng = streams.rng(i as u64);
            let mut left = total * rng.random::<f64>();
            let drawn = self.found.iter().find(|found| {
                left -= weight(found);
                left < 0.0
            });
            let place = drawn.unwrap_or(&best).state;
            let unit = self.spread * extent.mean() * place.log_scale.exp();
            let [dx, dy, vx, vy] = std::array::from_fn(|_| unit * rng.sample::<f64, _>(StandardNormal));
            *particle = State { x: place.x + dx, y: place.y + dy, vx, vy, ..place };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Purpose;

    const EXTENT: Extent = Extent { half_w: 10.0, half_h: 10.0 };
    const PROMISE: Promise = Promise { on: -2.0, off: -12.0 };

    #[test]
    fn places_cover_the_picture() {
        let mut search = Search::default();
        let estimate = State { log_scale: 0.5, angle: 0.2, vx: 3.0, ..State::default() };
        let step = 0.5 * 10.0 * 0.5f64.exp();
        let places = search.places((100, 60), &estimate, EXTENT).to_vec();
        for (x, y) in [(0.0, 0.0), (99.0, 0.0), (0.0, 59.0), (99.0, 59.0), (50.0, 30.0)] {
            let near = |p: &State| (p.x - x).abs() <= step && (p.y - y).abs() <= step;
            assert!(places.iter().any(near), "no place near ({x}, {y})");
        }
        assert!(places.iter().all(|p| (p.log_scale, p.angle, p.vx) == (0.5, 0.2, 0.0)));
        let tiny = State { log_scale: -8.0, ..State::default() };
        assert!(search.places((4000, 3000), &tiny, EXTENT).len() <= 10_300, "a small target does not make it endless");
    }

    #[test]
    fn a_share_starts_again_where_it_fits() {
        let mut search = Search { places: 2, ..Search::default() };
        let n = search.places((100, 60), &State::default(), EXTENT).len();
        let at = search.states[7];
        let fresh = search.clone();
        let streams = Streams::new(1, 0).at(8, Purpose::Search);
        let mut particles = vec![State { x: -1.0, ..State::default() }; 10];
        let mut log_likelihood = vec![-11.0; n];
        search.restart(&log_likelihood, PROMISE, EXTENT, &mut particles, streams);
        assert!(particles.iter().all(|p| p.x == -1.0), "nothing fits, nothing starts again");
        search = fresh;
        log_likelihood[7] = -2.5;
        log_likelihood[8] = f64::NAN;
        search.restart(&log_likelihood, PROMISE, EXTENT, &mut particles, streams);
        assert!(particles[..7].iter().all(|p| p.x == -1.0));
        // 1.5 px of spread: three draws beyond 5 deviations have a probability below 1e-5, and the seed is fixed.
        assert!(particles[7..].iter().all(|p| (p.x - at.x).hypot(p.y - at.y) < 7.5 * 2f64.sqrt()));
    }

    #[test]
    fn it_is_due_while_lost() {
        let search = Search::default();
        assert!(search.is_due(true, 8) && !search.is_due(true, 9) && !search.is_due(false, 8));
        for (search, said) in [
            (Search { every: 0, ..Search::default() }, "every"),
            (Search { step: f64::NAN, ..Search::default() }, "step"),
            (Search { share: 1.1, ..Search::default() }, "share"),
            (Search { fit: -1.0, ..Search::default() }, "fit"),
        ] {
            assert!(search.check().expect_err(said).to_string().contains(said));
        }
    }
}
