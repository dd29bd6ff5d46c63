//! The discriminant: a ridge regression from features to nearness to the target, learned while tracking.
//!
//! A score w · (h, 1) is fitted to labels exp(−½ (|offset|² / σ² + Δ log-scale² / σₛ²)) of glimpses at and around the
//! target, of other sizes, and at its distractors: places that look like it but are not. The sums that the fit needs, Σ h hᵀ and
//! Σ label · h, are kept for the first frame and, fading, for those since:
//! ```text
//! A = first_frame_weight · A₁ + (1 − first_frame_weight) · Aₜ + ridge · I + variation.weight · C,   A w = b,
//! Aₜ = (1 − learning_rate) · Aₜ₋₁ + learning_rate · Σ h hᵀ
//! ```
//! and a few steps of conjugate gradients a frame, from the last w on, follow its solution. With `dropout`, sums of
//! two features of one part (gradients, grey, colour) are divided by 1 − dropout: w then minimises the expected error
//! if each part is dropped with that probability and scaled up otherwise (van der Maaten et al., 2013), so that parts
//! become independent. C is the covariance of a target's features along a track, if known ([`Variation`]).
//!
//! If the gaze may move, w has one weight for each feature of the whole template, and each gaze reads a part of it
//! (`discriminant/layout.rs`): frame 1 teaches all gazes, each later frame the committed one, and so the parts that other
//! gazes share with it.
//!
//! Deviation: the paper's template is the first frame for ever. Correlation filters learn the same from all shifts at
//! once (Henriques et al., 2015); glimpses, foveated and turned, are no shifts of each other.

use std::sync::Arc;

use foveate_kernels as kernels;

use super::distance::{self, Distance, Kind};
use super::packed::Packed;
use crate::geometry::{Extent, Gaze, State};

mod layout;
mod ridge;
mod saved;
mod settings;
mod variation;

pub(crate) use self::layout::{Layout, Place};
pub(super) use self::ridge::Learning;
use self::ridge::{Regression, STEPS, Sums, outer};
pub use self::settings::Settings;
pub use self::variation::{Covariance, Variation};

/// Radii of the rings of places around the target, template units; eight places on each.
const RINGS: [f64; 6] = [0.12, 0.2, 0.35, 0.6, 1.0, 1.7];
/// Other sizes at the target: differences of log scale.
const SIZES: [f64; 6] = [-0.2, -0.1, -0.05, 0.05, 0.1, 0.2];
/// The most distractors that are learned from.
const DISTRACTORS: usize = 6;
/// All places of the first frame, and of any.
const PLACES: usize = 1 + RINGS.len() * 8 + SIZES.len();
const MOST_PLACES: usize = PLACES + DISTRACTORS;
/// Steps of several gazes for each step of one: their features are of different rows.
const MORE: usize = 2;

/// A score of features, learned online.
#[derive(Clone, Debug)]
pub struct Discriminant {
    regression: Regression,
    /// The parts that gazes read; `None` if it serves the committed gaze only.
    layout: Option<Layout>,
    /// The samples of the first frame, of all gazes. Its sums are larger, and are computed again if memory is short.
    first_rows: Vec<f32>,
    first: Sums,
    recent: Sums,
    /// The packed triangle of the recent frames if memory is short; both triangles are then empty between frames.
    packed: Packed,
    weights: Vec<f32>,
    pub(super) learning: Learning,
}

/// A score of features under one gaze.
#[derive(Clone, Copy, Debug)]
pub struct Score<'a> {
    bias: f32,
    weights: &'a [f32],
}

impl Discriminant {
    /// Rows that are kept of the first frame, at most.
    pub(crate) const FIRST_ROWS: u64 = MOST_PLACES as u64;

    /// An untrained discriminant for features with parts of these lengths.
    pub fn new(settings: Settings, parts: Vec<usize>) -> Self {
        let n = parts.iter().sum::<usize>() + 1;
        let zeros = Sums { gram: vec![0.0; n * (n + 1) / 2], cross: vec![0.0; n] };
        Self {
            regression: Regression { settings, parts, variation: None },
            layout: None,
            first_rows: vec![],
            first: zeros.clone(),
            recent: zeros,
            packed: Packed::default(),
            weights: vec![0.0; n],
            learning: Learning::default(),
        }
    }

    /// The same, with a covariance of features that is added to the sums.
    pub(super) fn with_variation(mut self, variation: Option<Arc<[f32]>>) -> Self {
        self.regression.variation = variation;
        self
    }

    /// The same for several gazes, with features of the layout's parts; without a variation.
    pub(super) fn with_layout(mut self, layout: Layout) -> Self {
        let n = layout.count();
        for sums in [&mut self.first, &mut self.recent] {
            (sums.gram, sums.cross) = (vec![0.0; n * (n + 1) / 2], vec![0.0; n]);
        }
        self.regression.parts = layout.parts().to_vec();
        Self { layout: Some(layout), weights: vec![0.0; n], ..self }
    }

    /// The gazes that the first frame teaches beside the centre; empty if it learns at the committed gaze only.
    pub(super) fn gazes(&self) -> &[Gaze] {
        self.layout.as_ref().map_or(&[], Layout::gazes)
    }

    /// Serves this committed gaze from now on. Returns false if it was trained for the last one only.
    pub(super) fn commit(&mut self, gaze: Gaze) -> bool {
        self.layout.as_mut().is_some_and(|layout| layout.commit(gaze))
    }

    /// Keeps no triangle until it learns again, but the rows of the first frame and a packed one; leaves the room to others.
    pub(super) fn compact(&mut self) {
        let [first, recent] = &mut self.learning.triangles;
        if !self.recent.gram.is_empty() {
            self.packed.pack(self.weights.len(), &self.recent.gram);
            *recent = std::mem::take(&mut self.recent.gram);
        }
        if !self.first.gram.is_empty() {
            *first = std::mem::take(&mut self.first.gram);
        }
    }

    fn unpack(&mut self) {
        let [first, recent] = &mut self.learning.triangles;
        if self.recent.gram.is_empty() {
            self.recent.gram = std::mem::take(recent);
            self.packed.unpack(&mut self.recent.gram);
        }
        if self.first.gram.is_empty() {
            self.first.gram = std::mem::take(first);
            self.sum_first();
        }
    }

    /// Computes the triangle of the first frame from its rows.
    fn sum_first(&mut self) {
        let Self { layout, first_rows, first: Sums { gram, .. }, weights, learning: Learning { whole, .. }, .. } = self;
        let n = weights.len();
        let Some(layout) = layout else { return outer(first_rows, n, gram) };
        gram.clear();
        gram.resize(n * (n + 1) / 2, 0.0);
        for (k, rows) in first_rows.chunks_exact((first_rows.len() / layout.gazes().len()).max(1)).enumerate() {
            kernels::add_outer(layout.spread(rows, k, whole), n, 1.0, layout.mass(true), gram);
        }
    }

    /// The settings it was made with.
    pub fn settings(&self) -> &Settings {
        &self.regression.settings
    }

    /// The score under a gaze, relative to the committed one; `None` if it was not trained for this gaze.
    pub fn under(&self, gaze: Gaze) -> Option<Score<'_>> {
        let weights = match &self.layout {
            None => (gaze.u == 0.0 && gaze.v == 0.0).then_some(&self.weights[..])?,
            Some(layout) => layout.weights(gaze)?,
        };
        let (bias, weights) = weights.split_last().expect("at least a bias");
        Some(Score { bias: *bias, weights })
    }
}

impl Score<'_> {
    /// Its distance: 0 at the target, about 1 elsewhere.
    pub fn distance(&self, features: &[f32]) -> f64 {
        1.0 - f64::from(kernels::dot(features, self.weights) + self.bias)
    }

    /// A distance of features to a kept template, and this one: of all features once, for the cosine.
    pub(super) fn distances(&self, features: &[f32], to: Kind, template: &[f32]) -> (f64, f64) {
        let Self { bias, weights } = *self;
        match to {
            Kind::Cosine => {
                let [square, along, score] = kernels::dots(features, [template, weights]);
                (distance::cosine(square, along), 1.0 - f64::from(score + bias))
            }
            _ => (to.distance(features, template), self.distance(features)),
        }
    }
}

impl Discriminant {
    /// Values of a row: the features of one gaze, and a 1.
    fn width(&self) -> usize {
        self.layout.as_ref().map_or(self.weights.len(), Layout::width)
    }

    /// Chooses `places` for a target at `state`, and their labels.
    pub(super) fn look_around(&mut self, state: &State, extent: Extent, distractors: &[State]) {
        let width = self.width();
        let Self { learning: Learning { places, labels, rows, .. }, regression, .. } = self;
        let settings = &regression.settings;
        let (w, h) = state.half(extent);
        // Room for all that there may be.
        places.clear();
        places.reserve(MOST_PLACES);
        labels.clear();
        labels.reserve(MOST_PLACES);
        rows.reserve((MOST_PLACES * width).saturating_sub(rows.len()));
        places.push(*state);
        for (k, radius) in RINGS.iter().enumerate() {
            for i in 0..8 {
                let (sin, cos) = (std::f64::consts::FRAC_PI_4 * (i as f64 + 0.5 * (k % 2) as f64)).sin_cos();
                places.push(State { x: state.x + radius * cos * w, y: state.y + radius * sin * h, ..*state });
            }
        }
        places.extend(SIZES.map(|d| State { log_scale: state.log_scale + d, ..*state }));
        places.extend(distractors.iter().take(DISTRACTORS));
        labels.extend(places.iter().map(|place| {
            let (u, v) = ((place.x - state.x) / w / settings.spread, (place.y - state.y) / h / settings.spread);
            let s = (place.log_scale - state.log_scale) / settings.log_scale;
            let a = (place.log_aspect - state.log_aspect) / settings.log_scale;
            (-0.5 * (u * u + v * v + s * s + a * a)).exp() as f32
        }));
        rows.resize(places.len() * width, 0.0);
    }

    /// Learns from `rows` at `places`, under the committed gaze.
    pub(super) fn learn(&mut self) {
        self.unpack();
        let fading = self.regression.settings.fading();
        self.add(self.layout.as_ref().map_or(0, Layout::committed), false, fading);
        self.solve(STEPS.1);
    }

    /// Learns from `rows` at `places`, under the k-th gaze, in the first frame. The first gaze resets everything else.
    pub(super) fn learn_first(&mut self, k: usize) {
        self.unpack();
        if k == 0 {
            self.first_rows.clear();
        }
        self.first_rows.extend_from_slice(&self.learning.rows);
        self.add(k, true, (if k == 0 { 0.0 } else { 1.0 }, 1.0));
        if k + 1 >= self.gazes().len() {
            self.first_rows.shrink_to_fit();
            self.first.clone_from(&self.recent);
            self.fit_anew();
        }
    }

    /// Fades the recent sums, and adds a share of `rows`, which are of the k-th gaze.
    fn add(&mut self, k: usize, first: bool, (keep, share): (f32, f32)) {
        let Self { layout, recent, weights, learning: Learning { rows, labels, whole, .. }, .. } = self;
        let (rows, mass) = match layout {
            None => (&rows[..], 1.0),
            Some(layout) => (layout.spread(rows, k, whole), layout.mass(first)),
        };
        recent.learn((rows, labels), weights.len(), (keep, share * mass));
    }

    /// Resets everything that was learned since the first frame.
    pub(super) fn restart(&mut self) {
        self.unpack();
        self.recent.gram.clone_from(&self.first.gram);
        self.recent.cross.clone_from(&self.first.cross);
        self.fit_anew();
    }

    /// Fits the sums of the first frame, starting from zero weights.
    fn fit_anew(&mut self) {
        self.weights.fill(0.0);
        self.solve(STEPS.0);
    }

    /// Fits both sums by so many steps; twice as many if there are several gazes.
    fn solve(&mut self, steps: usize) {
        let Self { layout, regression, first, recent, weights, learning, .. } = self;
        let steps = if layout.is_some() { MORE * steps } else { steps };
        regression.solve(first, recent, weights, learning, steps);
        if let Some(layout) = layout {
            layout.take(weights);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::saved_state::SavedState;
    use foveate_base::rng::Streams;
    use rand::RngExt;

    const N: usize = 7;
    const PARTS: [usize; 2] = [4, 2];
    const EXTENT: Extent = Extent { half_w: 10.0, half_h: 20.0 };
    const TARGET: State = State { x: 50.0, y: 40.0, vx: 0.0, vy: 0.0, log_scale: 0.1, angle: 0.0, log_aspect: 0.0 };

    /// Of random features at the places around the target, learned on so many frames.
    fn learned(settings: Settings, frames: u64) -> Discriminant {
        expecting(None, settings, frames)
    }

    /// The same, of features that vary so.
    fn expecting(variation: Option<&Arc<[f32]>>, settings: Settings, frames: u64) -> Discriminant {
        let mut it = Discriminant::new(settings, PARTS.to_vec()).with_variation(variation.cloned());
        for frame in 0..frames {
            let mut rng = Streams::new(4, 0).rng(frame);
            // As a tracker does: of the first frame no distractors are known.
            let distractors = [State { x: 80.0, ..TARGET }];
            it.look_around(&TARGET, EXTENT, if frame == 0 { &[] } else { &distractors });
            it.learning.rows.iter_mut().for_each(|h| *h = rng.random::<f32>() - 0.5);
            it.learning.rows.chunks_exact_mut(N).for_each(|row| row[N - 1] = 1.0);
            teach(&mut it, frame == 0);
        }
        it
    }

    fn teach(it: &mut Discriminant, first: bool) {
        if first { it.learn_first(0) } else { it.learn() }
    }

    /// The solution by elimination, in f64, of sums made anew.
    fn exact(variation: Option<&Arc<[f32]>>, settings: Settings, frames: u64) -> Vec<f64> {
        let mut a = vec![[0.0; N + 1]; N];
        for frame in 0..frames {
            let now = learned(settings, frame + 1);
            let age = (frames - 1 - frame) as i32;
            let recent =
                (1.0 - settings.learning_rate).powi(age) * if frame == 0 { 1.0 } else { settings.learning_rate };
            let weight = (1.0 - settings.first_frame_weight) * recent
                + if frame == 0 { settings.first_frame_weight } else { 0.0 };
            for (row, label) in now.learning.rows.chunks_exact(N).zip(&now.learning.labels) {
                for i in 0..N {
                    a[i].iter_mut().zip(row).for_each(|(a, h)| *a += weight * f64::from(row[i]) * f64::from(*h));
                    a[i][N] += weight * f64::from(row[i]) * f64::from(*label);
                }
            }
        }
        let part = |i: usize| i / PARTS[0];
        for (i, row) in a[..N - 1].iter_mut().enumerate() {
            row[..N - 1]
                .iter_mut()
                .enumerate()
                .filter(|(j, _)| part(i) == part(*j))
                .for_each(|(_, a)| *a /= 1.0 - settings.dropout);
        }
        (0..N).for_each(|i| a[i][i] += settings.ridge);
        if let Some(variation) = variation {
            let of = |i: usize, j: usize| f64::from(variation[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)]);
            (0..N * N).for_each(|k| a[k / N][k % N] += of(k / N, k % N));
        }
        for i in 0..N {
            let pivot = a[i];
            for row in a.iter_mut().enumerate().filter(|(k, _)| *k != i).map(|(_, row)| row) {
                let factor = row[i] / pivot[i];
                row.iter_mut().zip(&pivot).for_each(|(a, p)| *a -= factor * p);
            }
        }
        (0..N).map(|i| a[i][N] / a[i][i]).collect()
    }

    /// Conjugate gradients find the ridge regression that elimination finds. Few features, so that four steps suffice.
    #[test]
    fn it_is_ridge_regression() {
        let settings = Settings { ridge: 0.5, learning_rate: 0.3, first_frame_weight: 0.4, ..Settings::default() };
        // v vᵀ, and the variance of each feature.
        let of = |i: usize, j: usize| 0.2 * (i + 1) as f32 * (j + 1) as f32 + if i == j { 0.3 } else { 0.0 };
        let varying: Arc<[f32]> = (0..N).flat_map(|i| (0..=i).map(move |j| of(i, j))).collect();
        for (frames, within, dropout, variation) in [
            (1, 1e-4, 0.0, None),
            (4, 0.02, 0.0, None),
            (1, 1e-4, 0.4, None),
            (4, 0.02, 0.4, None),
            (1, 1e-4, 0.4, Some(&varying)),
            (4, 0.02, 0.0, Some(&varying)),
        ] {
            let settings = Settings { dropout, ..settings };
            let it = expecting(variation, settings, frames);
            for (w, exact) in it.weights.iter().zip(exact(variation, settings, frames)) {
                assert!((f64::from(*w) - exact).abs() < within, "{frames} frames: {w} is not {exact}");
            }
        }
    }

    #[test]
    fn a_reset_keeps_the_first_frame_only() {
        let first = learned(Settings::default(), 1);
        let mut it = learned(Settings::default(), 6);
        it.compact();
        it.restart();
        assert_eq!((&it.weights, &it.recent, &it.first), (&first.weights, &first.first, &first.first));
    }

    #[test]
    fn labels_say_how_near_a_place_is() {
        let it = learned(Settings::default(), 2);
        assert_eq!((it.learning.places[0], it.learning.labels[0]), (TARGET, 1.0));
        let one_deviation = (-0.5f32).exp();
        let (w, h) = (EXTENT.half_w * TARGET.log_scale.exp(), EXTENT.half_h * TARGET.log_scale.exp());
        for (place, label) in it.learning.places.iter().zip(&it.learning.labels) {
            let (u, v, s) = ((place.x - TARGET.x) / w, (place.y - TARGET.y) / h, place.log_scale - TARGET.log_scale);
            assert!((u.hypot(v) - 0.2).abs() > 1e-9 || (label - one_deviation).abs() < 1e-6);
            assert!((s.abs() - 0.1).abs() > 1e-9 || (label - one_deviation).abs() < 1e-6);
        }
        assert_eq!(it.learning.places.last().map(|distractor| distractor.x), Some(80.0));
        assert!(it.learning.labels.last().is_some_and(|label| *label < 1e-9), "a distractor is not the target");
    }

    #[test]
    fn what_was_learned_is_kept() {
        let it = learned(Settings::default(), 3);
        let mut other = Discriminant::new(Settings::default(), vec![N - 1]);
        other.load(&it.save()).expect("it was saved");
        assert_eq!((&other.weights, &other.recent, &other.first), (&it.weights, &it.recent, &it.first));
        let mut wider = Discriminant::new(Settings::default(), vec![N]);
        let said = wider.load(&it.save()).expect_err("another width").to_string();
        assert!(said.contains("385 numbers where this tracker has 440"), "{said}");
        // Packed between frames it continues as its saved state does, and nearly as one that was never packed.
        let mut packed = it.clone();
        packed.compact();
        assert!(packed.first.gram.is_empty() && packed.recent.gram.is_empty());
        other.load(&packed.save()).expect("it was saved");
        let mut never = it.clone();
        for each in [&mut packed, &mut other, &mut never] {
            each.look_around(&TARGET, EXTENT, &[]);
            let mut rng = Streams::new(4, 0).rng(9);
            each.learning.rows.iter_mut().for_each(|h| *h = rng.random::<f32>() - 0.5);
            each.learn();
        }
        assert!(packed.weights == other.weights && packed.recent == other.recent && packed.first == other.first);
        for (a, b) in packed.weights.iter().zip(&never.weights) {
            assert!((a - b).abs() < 1e-3, "{a} {b}");
        }
        assert!(wider.load(&SavedState::new(&["?"])).is_err());
    }

    /// Two gazes that share two of four features. What a frame teaches one is known under the other, and stays when the gaze changes.
    #[test]
    fn gazes_learn_from_each_other() {
        let place = |quantity: usize, u: f64| Place { quantity, u, v: 0.0 };
        let places: Vec<Place> = [-0.5, 0.5].iter().flat_map(|u| [place(0, *u), place(1, *u)]).collect();
        let gazes = [Gaze::CENTRE, Gaze { u: 1.0, v: 0.0, arm: Some(1) }];
        let new = || Discriminant::new(Settings::default(), vec![4]).with_layout(Layout::new(&gazes, &[4], &places));
        let mut rng = Streams::new(4, 0).rng(0);
        let mut it = new();
        it.look_around(&TARGET, EXTENT, &[]);
        let mut fill = |it: &mut Discriminant| {
            it.learning.rows.iter_mut().for_each(|h| *h = rng.random::<f32>() - 0.5);
            it.learning.rows.chunks_exact_mut(5).for_each(|row| row[4] = 1.0);
        };
        for k in 0..2 {
            fill(&mut it);
            it.learn_first(k);
        }
        let weights = |it: &Discriminant, gaze: Gaze| it.under(gaze).expect("a gaze of it").weights.to_vec();
        let first = [gazes[0], gazes[1]].map(|gaze| weights(&it, gaze));
        assert_eq!((first[0].len(), &first[0][2..]), (4, &first[1][..2]));
        assert!(it.under(Gaze { u: 0.5, ..Gaze::CENTRE }).is_none());
        fill(&mut it);
        it.learn();
        let second = [gazes[0], gazes[1]].map(|gaze| weights(&it, gaze));
        assert!(second[1][..2] != first[1][..2], "what both read was learned");
        let saved = it.save();
        assert!(it.commit(gazes[1]));
        assert_eq!(weights(&it, Gaze::CENTRE), second[1]);
        let mut other = new();
        other.load(&saved).expect("it was saved");
        it.commit(Gaze::CENTRE);
        it.compact();
        for each in [&mut it, &mut other] {
            each.unpack();
        }
        assert!(it.first == other.first && it.weights == other.weights);
        it.restart();
        assert_eq!([gazes[0], gazes[1]].map(|gaze| weights(&it, gaze)), first);
    }

    /// What looks much like the target in frame 1 looks less so once it is known; as many rows are taken up again as were saved.
    #[test]
    fn hard_negatives_of_the_first_frame_are_learned() {
        let distractor = State { x: 80.0, ..TARGET };
        let (mut rng, mut it) = (Streams::new(4, 0).rng(0), Discriminant::new(Settings::default(), vec![N - 1]));
        let [target, like] = [[1.0f32, 0.0, 0.0, 0.3, 0.0, 0.0], [1.0, 0.0, 0.0, -0.3, 0.0, 0.0]];
        let distances = [&[][..], &[distractor]].map(|distractors| {
            it.look_around(&TARGET, EXTENT, distractors);
            for (k, row) in it.learning.rows.chunks_exact_mut(N).enumerate() {
                row.iter_mut().for_each(|h| *h = 0.2 * (rng.random::<f32>() - 0.5));
                row[N - 1] = 1.0;
                if k == 0 || k == PLACES {
                    row[..N - 1].copy_from_slice(if k == 0 { &target } else { &like });
                }
            }
            it.learn_first(0);
            let score = it.under(Gaze::CENTRE).expect("it learned there");
            score.distance(&like) - score.distance(&target)
        });
        assert!(distances[1] > distances[0] + 0.2, "{distances:?}");
        let mut other = Discriminant::new(Settings::default(), vec![N - 1]);
        other.load(&it.save()).expect("it was saved");
        assert_eq!((other.first_rows.len(), &other.first), ((PLACES + 1) * N, &it.first));
    }

    #[test]
    fn settings_are_checked() {
        assert!(Settings::default().check().is_ok());
        for (bad, name) in [
            (Settings { mixing_weight: 1.1, ..Settings::default() }, "mixing_weight"),
            (Settings { ridge: 0.0, ..Settings::default() }, "ridge"),
            (Settings { learning_rate: f64::NAN, ..Settings::default() }, "learning_rate"),
        ] {
            assert!(bad.check().expect_err("out of range").to_string().contains(name));
        }
    }
}
