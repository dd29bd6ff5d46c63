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
//! Deviation: the paper's template is the first frame for ever. Correlation filters learn the same from all shifts at
//! once (Henriques et al., 2015); glimpses, foveated and turned, are no shifts of each other.

use std::sync::Arc;

use foveate_kernels as kernels;

use super::distance::{self, Distance, Kind};
use super::packed::Packed;
use crate::geometry::{Extent, Gaze, State};

mod ridge;
mod saved;
mod settings;
mod variation;

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
/// A score of features, learned online.
#[derive(Clone, Debug)]
pub struct Discriminant {
    regression: Regression,
    /// The samples of the first frame. Its sums are larger, and are computed again if memory is short.
    first_rows: Vec<f32>,
    first: Sums,
    recent: Sums,
    /// The packed triangle of the recent frames if memory is short; both triangles are then empty between frames.
    packed: Packed,
    weights: Vec<f32>,
    pub(super) learning: Learning,
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
            outer(&self.first_rows, self.weights.len(), &mut self.first.gram);
        }
    }

    /// The settings it was made with.
    pub fn settings(&self) -> &Settings {
        &self.regression.settings
    }

    /// Returns whether it was trained for this gaze: the centre only.
    pub fn is_trained_for(gaze: Gaze) -> bool {
        gaze.u == 0.0 && gaze.v == 0.0
    }

    /// Its distance: 0 at the target, about 1 elsewhere.
    pub fn distance(&self, features: &[f32]) -> f64 {
        let (bias, weights) = self.weights.split_last().expect("at least a bias");
        1.0 - f64::from(kernels::dot(features, weights) + bias)
    }

    /// A distance of features to a kept template, and this one: of all features once, for the cosine.
    pub(super) fn distances(&self, features: &[f32], to: Kind, template: &[f32]) -> (f64, f64) {
        let (bias, weights) = self.weights.split_last().expect("at least a bias");
        match to {
            Kind::Cosine => {
                let [square, along, score] = kernels::dots(features, [template, weights]);
                (distance::cosine(square, along), 1.0 - f64::from(score + bias))
            }
            _ => (to.distance(features, template), self.distance(features)),
        }
    }

    /// Chooses `places` for a target at `state`, and their labels.
    pub(super) fn look_around(&mut self, state: &State, extent: Extent, distractors: &[State]) {
        let Self { learning: Learning { places, labels, rows, .. }, regression, weights, .. } = self;
        let settings = &regression.settings;
        let (w, h) = state.half(extent);
        // Room for all that there may be.
        places.clear();
        places.reserve(MOST_PLACES);
        labels.clear();
        labels.reserve(MOST_PLACES);
        rows.reserve((MOST_PLACES * weights.len()).saturating_sub(rows.len()));
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
        rows.resize(places.len() * weights.len(), 0.0);
    }

    /// Learns from `rows` at `places`. The first frame resets everything else.
    pub(super) fn learn(&mut self, first: bool) {
        self.unpack();
        let Self { regression, first_rows, first: begun, recent, weights, learning, .. } = self;
        let n = weights.len();
        if first {
            recent.learn(learning, n, (0.0, 1.0));
            begun.clone_from(recent);
            first_rows.clone_from(&learning.rows);
            first_rows.shrink_to_fit();
            return self.fit_anew();
        }
        recent.learn(learning, n, regression.settings.fading());
        regression.solve(begun, recent, weights, learning, STEPS.1);
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
        let Self { regression, first, recent, weights, learning, .. } = self;
        weights.fill(0.0);
        regression.solve(first, recent, weights, learning, STEPS.0);
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
            it.learn(frame == 0);
        }
        it
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
            each.learn(false);
        }
        assert!(packed.weights == other.weights && packed.recent == other.recent && packed.first == other.first);
        for (a, b) in packed.weights.iter().zip(&never.weights) {
            assert!((a - b).abs() < 1e-3, "{a} {b}");
        }
        assert!(wider.load(&SavedState::new(&["?"])).is_err());
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
            it.learn(true);
            it.distance(&like) - it.distance(&target)
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
