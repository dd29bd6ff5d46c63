//! Search for a lost target (the paper: "no ability to recover from a tracking failure").
//!
//! Every few frames while the target is lost, places all over the picture are scored, and a share of the predicted
//! particles is drawn again from the best places. If the picture has more places than the `budget` of a frame, it is
//! searched in parts, one a search, from the last confident position outwards. Places of other parts that fit are kept
//! and scored again in every search; those that do not would find look-alikes. It is a proposal (`candidates.rs`),
//! with p/q of a target that may be anywhere in the picture.

use serde::{Deserialize, Serialize};
use std::ops::Range;

use super::candidates::{Candidates, Draw};
use crate::geometry::{Extent, Size, State};
use crate::saved_state::{Valid, Validate, ensure};

mod settings;

pub use self::settings::RedetectionSettings;

/// Searches the whole picture for a lost target.
#[derive(Clone, Debug)]
pub struct Redetection {
    settings: RedetectionSettings,
    pub(crate) candidates: Candidates,
    /// Searches since the target was lost, and the best places of the parts before.
    searches: u64,
    remembered: Vec<State>,
    /// Parts of the picture, by distance from the last confident position.
    parts: Vec<(f64, usize)>,
}

/// How often the best places are made finer, by a third each time.
pub const REFINEMENTS: usize = 2;

/// The most places that are scored at once.
const MOST: f64 = 16_000.0;

/// Places farther apart than this, template units, count as up to two, because pixels between them are read too.
const WIDEST: f64 = 0.5;

impl Redetection {
    /// With these settings; nothing was looked for yet.
    pub fn new(settings: RedetectionSettings) -> Self {
        let RedetectionSettings { places, share, spread, chance, .. } = settings;
        let candidates = Candidates::new(Draw { places, share, spread, chance });
        Self { settings, candidates, searches: 0, remembered: vec![], parts: vec![] }
    }
    /// The settings it was made with.
    pub fn settings(&self) -> &RedetectionSettings {
        &self.settings
    }
    /// Forgets all places.
    pub(crate) fn reset(&mut self) {
        self.searches = 0;
        self.candidates.resume([]);
    }
    /// Whether to search in this frame. Clears the candidates if the target is not lost.
    pub fn is_due(&mut self, lost: bool, frame: u64) -> bool {
        if !lost {
            self.reset();
        }
        lost && self.settings.share > 0.0 && frame.is_multiple_of(self.settings.every)
    }
    /// Places all over a part of a picture, or all of it, of the scale and angle with which the target was `seen` last, at
    /// rest, row by row.
    pub fn places(&mut self, size: Size, seen: &State, extent: Extent) -> &[State] {
        let (width, height) = (size.width as f64, size.height as f64);
        let half = seen.half(extent);
        self.candidates.half = half;
        self.candidates.area = width * height / (half.0 * half.1);
        // Whole numbers of steps: places of a lattice of some steps share their cells.
        let (dx, dy) = (self.settings.step * half.0, self.settings.step * half.1);
        let count = |(i, j): (f64, f64)| width * height / (dx * i * dy * j);
        let least = (count((1.0, 1.0)) / MOST).sqrt().floor().max((1.0 / dx.min(dy)).ceil()).max(1.0);
        let next = least + 1.0;
        let few = [(least, least), (next, least)].into_iter().find(|steps| count(*steps) <= MOST);
        let (i, j) = few.unwrap_or((next, next));
        let (dx, dy) = (dx * i, dy * j);
        self.candidates.apart = (dx, dy);
        let (columns, rows) = ((width / dx).ceil() as usize, (height / dy).ceil() as usize);
        self.remembered.clear();
        self.remembered.extend(self.candidates.take());
        let [columns, rows] = self.part(columns, rows, seen);
        self.searches += 1;
        let states = &mut self.candidates.states;
        states.clear();
        for (row, column) in rows.flat_map(|row| columns.clone().map(move |column| (row, column))) {
            let place = State { x: (column as f64 + 0.5) * dx, y: (row as f64 + 0.5) * dy, vx: 0.0, vy: 0.0, ..*seen };
            states.push(place);
        }
        states
    }
    /// Columns and rows of the part of the lattice that this search is about.
    fn part(&mut self, columns: usize, rows: usize, seen: &State) -> [Range<usize>; 2] {
        let places = ((self.candidates.area / (WIDEST * WIDEST)) as usize).clamp(columns * rows, 2 * columns * rows);
        let count = if self.settings.budget >= MOST as usize { 1 } else { places.div_ceil(self.settings.budget) };
        if count == 1 {
            self.remembered.clear();
            return [0..columns, 0..rows];
        }
        // As square as may be.
        let apart = self.candidates.apart;
        let (width, height) = (columns as f64 * apart.0, rows as f64 * apart.1);
        let down = ((count as f64 * height / width).sqrt().round() as usize).clamp(1, count.min(rows));
        let across = count.div_ceil(down).min(columns);
        let cut = |k: usize, parts: usize, n: usize| k * n / parts..(k + 1) * n / parts;
        let of = |k: usize| [cut(k % across, across, columns), cut(k / across, down, rows)];
        let off = |range: &Range<usize>, apart: f64, at: f64| {
            let (from, to) = (range.start as f64 * apart, range.end as f64 * apart);
            (from - at).max(at - to).max(0.0).powi(2) + 1e-3 * (0.5 * (from + to) - at).powi(2)
        };
        self.parts.clear();
        self.parts.extend((0..across * down).map(|k| {
            let [columns, rows] = of(k);
            (off(&columns, apart.0, seen.x) + off(&rows, apart.1, seen.y), k)
        }));
        self.parts.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        of(self.parts[(self.searches % (across * down) as u64) as usize].1)
    }
    /// Keeps the best of the places scored last, and returns those kept from other parts with places around them,
    /// because objects may have moved; none if the whole picture was searched. Score them before the refinement.
    pub fn recall(&mut self, log_likelihood: &[f64]) -> &[State] {
        self.candidates.keep_best(log_likelihood);
        let (apart, states) = (self.candidates.apart, &mut self.candidates.states);
        let about = (0..9).map(|k| (f64::from(k % 3 - 1) * apart.0, f64::from(k / 3 - 1) * apart.1));
        for (place, (dx, dy)) in self.remembered.iter().flat_map(|place| about.clone().map(move |d| (place, d))) {
            states.push(State { x: place.x + dx, y: place.y + dy, ..*place });
        }
        states
    }
    /// Returns the state between frames.
    pub(crate) fn state(&self) -> SearchState {
        SearchState { searches: self.searches, found: self.candidates.found().collect() }
    }
    /// Continues from a valid state.
    pub(crate) fn resume(&mut self, SearchState { searches, found }: SearchState) {
        self.searches = searches;
        self.candidates.resume(found);
    }
}

/// The state of a search between frames.
#[derive(Serialize, Deserialize)]
pub(crate) struct SearchState {
    searches: u64,
    found: Vec<State>,
}

impl Validate<RedetectionSettings> for SearchState {
    fn validate(&self, settings: &RedetectionSettings) -> Valid {
        ensure(self.found.len() <= settings.places && self.searches <= 1 << 48, || {
            format!("it keeps {} places after {} searches", self.found.len(), self.searches)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::{Purpose, Streams};

    const EXTENT: Extent = Extent { half_w: 10.0, half_h: 10.0 };

    #[test]
    fn places_cover_the_picture() {
        let mut search = Redetection::new(RedetectionSettings::default());
        let estimate = State { log_scale: 0.5, angle: 0.2, vx: 3.0, ..State::default() };
        let step = 0.5 * 10.0 * 0.5f64.exp();
        let places = search.places(Size::new(100, 60), &estimate, EXTENT).to_vec();
        for (x, y) in [(0.0, 0.0), (99.0, 0.0), (0.0, 59.0), (99.0, 59.0), (50.0, 30.0)] {
            let near = |p: &State| (p.x - x).abs() <= step && (p.y - y).abs() <= step;
            assert!(places.iter().any(near), "no place near ({x}, {y})");
        }
        assert!(places.iter().all(|p| (p.log_scale, p.angle, p.vx) == (0.5, 0.2, 0.0)));
        let tiny = State { log_scale: -8.0, ..State::default() };
        assert!(
            search.places(Size::new(4000, 3000), &tiny, EXTENT).len() <= 16_500,
            "a small target does not make it endless"
        );
    }

    /// For pictures and targets of many sizes: the parts of so many searches are, together, the places of the whole picture,
    /// each once; the part where the target was seen comes first; no part has many more places than it may.
    #[test]
    fn parts_are_the_whole_picture() {
        let key = |p: &State| (p.x.to_bits(), p.y.to_bits());
        for (size, half, budget) in
            [(Size::new(320, 240), 12.0, 1000), (Size::new(1280, 720), 24.0, 2000), (Size::new(64, 2000), 9.0, 64)]
        {
            let extent = Extent { half_w: half, half_h: 1.5 * half };
            let seen = State { x: 0.7 * size.width as f64, y: 0.4 * size.height as f64, ..State::default() };
            let whole = Redetection::new(RedetectionSettings::default()).places(size, &seen, extent).to_vec();
            let mut search = Redetection::new(RedetectionSettings { budget, ..RedetectionSettings::default() });
            let (mut all, mut most, mut searches) = (vec![], 0, 0);
            while all.len() < whole.len() {
                let places = search.places(size, &seen, extent);
                (most, searches) = (most.max(places.len()), searches + 1);
                if searches == 1 {
                    let apart = places.iter().map(|p| (p.x - seen.x).abs().max((p.y - seen.y).abs()));
                    assert!(apart.fold(f64::MAX, f64::min) < half, "the first is where it was seen");
                }
                all.extend(places.iter().map(key));
            }
            assert!(most as f64 <= 1.5 * budget as f64, "{most} places where {budget} are asked for");
            assert!(4 * searches <= 5 * whole.len().div_ceil(budget) + 12, "{searches} searches of {budget} places");
            let mut exact: Vec<_> = whole.iter().map(key).collect();
            all.sort_unstable();
            exact.sort_unstable();
            assert_eq!(all, exact);
        }
    }

    /// What one part had is scored again in the next search, though it is about another part, and after a stop.
    #[test]
    fn the_best_places_of_other_parts_are_remembered() {
        let mut search = Redetection::new(RedetectionSettings { budget: 64, ..RedetectionSettings::default() });
        let seen = State { x: 20.0, y: 20.0, ..State::default() };
        let (mut states, mut log_prior, mut which) = (vec![seen; 10], vec![0.0; 10], vec![]);
        assert!(search.is_due(true, 4));
        let places = search.places(Size::new(200, 100), &seen, EXTENT);
        let best = places[5];
        let scores: Vec<f64> = places.iter().map(|p| if *p == best { -1.0 } else { -20.0 }).collect();
        assert!(search.recall(&scores).is_empty(), "nothing was found before");
        let mut scores = vec![];
        for _ in 0..REFINEMENTS {
            let n = search.candidates.refine(&scores).len();
            scores = vec![-30.0; n];
        }
        search.candidates.best(&scores);
        search.candidates.draw(-4.0, &mut states, &mut log_prior, &mut which, Streams::new(1, 0));
        assert_eq!(search.candidates.best(&[]).map(|(place, _)| place), Some(best));
        let mut resumed = Redetection::new(search.settings().clone());
        resumed.resume(search.state());
        for search in [&mut search, &mut resumed] {
            let n = search.places(Size::new(200, 100), &seen, EXTENT).len();
            assert!(!search.candidates.states.contains(&best), "another part");
            assert!(search.recall(&vec![-20.0; n]).contains(&best));
        }
        assert!(!search.is_due(false, 8), "what was found is forgotten");
        let n = search.places(Size::new(200, 100), &seen, EXTENT).len();
        assert!(search.recall(&vec![-20.0; n]).is_empty());
        let found = vec![seen; search.settings().places + 1];
        assert!(SearchState { searches: 1, found }.validate(search.settings()).is_err(), "more places than it keeps");
    }

    #[test]
    fn a_share_is_drawn_again_where_it_fits() {
        let mut search = Redetection::new(RedetectionSettings { places: 2, ..RedetectionSettings::default() });
        let n = search.places(Size::new(100, 60), &State::default(), EXTENT).len();
        let at = search.candidates.states[7];
        let fresh = search.clone();
        let streams = Streams::new(1, 0).at(8, Purpose::Redetection);
        let (mut states, mut log_prior) = (vec![State { x: -1.0, vx: 2.0, ..State::default() }; 10], vec![-1.0; 10]);
        let (mut log_likelihood, mut which) = (vec![-11.0; n], vec![]);
        search.candidates.best(&log_likelihood);
        search.candidates.draw(-4.0, &mut states, &mut log_prior, &mut which, streams);
        assert!(states.iter().all(|s| s.x == -1.0) && which.is_empty(), "nothing fits, nothing is drawn");
        search = fresh;
        log_likelihood[7] = -2.5;
        log_likelihood[8] = f64::NAN;
        search.candidates.best(&log_likelihood);
        search.candidates.draw(-4.0, &mut states, &mut log_prior, &mut which, streams);
        assert_eq!(which, [3, 6, 9], "a share of 0.3 of ten, evenly");
        for (i, state) in states.iter().enumerate() {
            // 1.5 px of spread: three draws beyond 5 deviations have a probability below 1e-5, and the seed is fixed.
            let near = (state.x - at.x).hypot(state.y - at.y) < 7.5 * 2f64.sqrt();
            assert!(state.vx == 2.0 && if which.contains(&i) { near } else { state.x == -1.0 && log_prior[i] == -1.0 });
        }
    }

    /// Σ over the new particles of p/q estimates the integral of p about the places: their share of the picture.
    /// 20,000 draws with one seed; the estimate's deviation is below 1 % of it, and 5 % would be five of them.
    #[test]
    fn redrawn_particles_have_the_weight_of_the_prior() {
        let mut search = Redetection::new(RedetectionSettings {
            share: 1.0,
            places: 2,
            spread: 0.3,
            chance: 0.5,
            ..RedetectionSettings::default()
        });
        let n = search.places(Size::new(200, 100), &State::default(), EXTENT).len();
        let at = search.candidates.states[150];
        let mut log_likelihood = vec![-50.0; n];
        (log_likelihood[150], log_likelihood[160]) = (-2.0, -4.0);
        let (mut states, mut log_prior, mut which) = (vec![State::default(); 20_000], vec![0.0; 20_000], vec![]);
        search.candidates.best(&log_likelihood);
        search.candidates.draw(-10.0, &mut states, &mut log_prior, &mut which, Streams::new(2, 0));
        // Within half a unit of the better place: a square of one unit².
        let inside = |s: &State| (s.x - at.x).abs() < 5.0 && (s.y - at.y).abs() < 5.0;
        let mass: f64 = states.iter().zip(&log_prior).filter(|(s, _)| inside(s)).map(|(_, l)| l.exp()).sum();
        let exact = 0.5 / (20.0 * 10.0);
        assert!((mass / exact - 1.0).abs() < 0.05, "{mass} is not {exact}");
    }

    #[test]
    fn it_is_due_while_lost() {
        let mut search = Redetection::new(RedetectionSettings::default());
        assert!(search.is_due(true, 8) && !search.is_due(true, 9) && !search.is_due(false, 8));
    }
}
