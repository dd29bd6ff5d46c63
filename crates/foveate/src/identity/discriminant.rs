//! What tells the target from what is around it, learned while tracking: ridge regression from features to nearness.
//!
//! A score w · (h, 1) is fitted to labels exp(−½ (|offset|² / σ² + Δ log-scale² / σₛ²)) of glimpses at and around the
//! target, of other sizes, and at its rivals: places that look like it but are not. The sums that the fit needs, Σ h hᵀ and
//! Σ label · h, are kept for the first frame and, fading, for those since:
//! ```text
//! A = first · A₁ + (1 − first) · Aₜ + ridge · I,   Aₜ = (1 − rate) · Aₜ₋₁ + rate · Σ h hᵀ,   A w = b
//! ```
//! and a few steps of conjugate gradients a frame, from the last w on, follow its solution.
//!
//! Not in the paper, whose template is the first frame for ever. Correlation filters learn the same from all shifts at
//! once (Henriques et al., 2015); glimpses have no shifts to exploit, and need no windows and no resizing either.

use base64::Engine as _;
use foveate_kernels as kernels;
use serde::{Deserialize, Serialize};

use crate::geometry::{Extent, State};
use crate::{Error, Result};

/// Settings of the discriminant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Its share of the likelihood, the template having the rest; 0 to 1.
    pub share: f64,
    /// Weight of the newest frame among those since the first, 0 to 1.
    pub rate: f64,
    /// Weight of the first frame, 0 to 1.
    pub first: f64,
    /// What is added to the diagonal, 1e-6 to 1e3; features have a length of about 1.
    pub ridge: f64,
    /// Standard deviation of the labels along u and v, template units, 0.01 to 10.
    pub spread: f64,
    /// Standard deviation of the labels in the logarithm of scale, 0.01 to 10.
    pub log_scale: f64,
    /// Nothing is learned from frames of more surprise than this, 0 to 2.
    pub surprise: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { share: 0.5, rate: 0.05, first: 0.3, ridge: 0.003, spread: 0.2, log_scale: 0.1, surprise: 0.5 }
    }
}

impl Settings {
    /// Fails where a number is out of range, naming it.
    pub fn check(&self) -> Result<()> {
        for (name, value, least, most) in [
            ("share", self.share, 0.0, 1.0),
            ("rate", self.rate, 0.0, 1.0),
            ("first", self.first, 0.0, 1.0),
            ("ridge", self.ridge, 1e-6, 1e3),
            ("spread", self.spread, 0.01, 10.0),
            ("log_scale", self.log_scale, 0.01, 10.0),
            ("surprise", self.surprise, 0.0, 2.0),
        ] {
            if !(least..=most).contains(&value) {
                return Err(Error::Config(format!(
                    "discriminant.{name} is a number from {least} to {most}; it is {value}"
                )));
            }
        }
        Ok(())
    }
}

/// Radii of the rings of places around the target, template units; eight places on each.
const RINGS: [f64; 6] = [0.12, 0.2, 0.35, 0.6, 1.0, 1.7];
/// Other sizes at the target: differences of log scale.
const SIZES: [f64; 6] = [-0.2, -0.1, -0.05, 0.05, 0.1, 0.2];
/// Steps of conjugate gradients on the first frame, and on each other.
const STEPS: (usize, usize) = (30, 4);

/// Σ h hᵀ (its lower triangle) and Σ label · h.
#[derive(Clone, Debug, Default, PartialEq)]
struct Sums {
    gram: Vec<f32>,
    cross: Vec<f32>,
}

/// A score of features, learned online.
#[derive(Clone, Debug)]
pub struct Discriminant {
    settings: Settings,
    first: Sums,
    recent: Sums,
    weights: Vec<f32>,
    /// Where to look to learn.
    pub(super) places: Vec<State>,
    /// The features there, each followed by a 1.
    pub(super) rows: Vec<f32>,
    labels: Vec<f32>,
    system: Sums,
    work: [Vec<f32>; 2],
}

impl Discriminant {
    /// Of features of length `n_h`. It knows nothing yet.
    pub fn new(settings: Settings, n_h: usize) -> Self {
        let n = n_h + 1;
        let zeros = Sums { gram: vec![0.0; n * (n + 1) / 2], cross: vec![0.0; n] };
        Self {
            settings,
            first: zeros.clone(),
            recent: zeros.clone(),
            weights: vec![0.0; n],
            places: vec![],
            rows: vec![],
            labels: vec![],
            system: zeros,
            work: [vec![0.0; n], vec![0.0; n]],
        }
    }

    /// The settings it was made with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The distance that counts, of features whose distance from the template is given: 0 at the target, about 1 elsewhere.
    pub fn mixed(&self, template: f64, features: &[f32]) -> f64 {
        let (bias, weights) = self.weights.split_last().expect("at least a bias");
        let score = f64::from(kernels::dot(features, weights) + bias);
        (1.0 - self.settings.share) * template + self.settings.share * (1.0 - score)
    }

    /// Chooses `places` for a target at `state`, and their labels.
    pub(super) fn look_around(&mut self, state: &State, extent: Extent, rivals: &[State]) {
        let Self { places, labels, settings, .. } = self;
        let (w, h) = (state.log_scale.exp() * extent.half_w, state.log_scale.exp() * extent.half_h);
        places.clear();
        places.push(*state);
        for (k, radius) in RINGS.iter().enumerate() {
            for i in 0..8 {
                let (sin, cos) = (std::f64::consts::FRAC_PI_4 * (i as f64 + 0.5 * (k % 2) as f64)).sin_cos();
                places.push(State { x: state.x + radius * cos * w, y: state.y + radius * sin * h, ..*state });
            }
        }
        places.extend(SIZES.map(|d| State { log_scale: state.log_scale + d, ..*state }));
        places.extend(rivals);
        labels.clear();
        labels.extend(places.iter().map(|place| {
            let (u, v) = ((place.x - state.x) / w / settings.spread, (place.y - state.y) / h / settings.spread);
            let s = (place.log_scale - state.log_scale) / settings.log_scale;
            (-0.5 * (u * u + v * v + s * s)).exp() as f32
        }));
        self.rows.resize(self.places.len() * self.weights.len(), 0.0);
    }

    /// Learns from `rows` at `places`. On the first frame it forgets all else.
    pub(super) fn learn(&mut self, first: bool) {
        let Self { settings, first: begun, recent, weights, rows, labels, system, work: [step, image], .. } = self;
        let (keep, share) = if first { (0.0, 1.0) } else { (1.0 - settings.rate as f32, settings.rate as f32) };
        let n = weights.len();
        kernels::add_outer(rows, n, keep, share, &mut recent.gram);
        recent.cross.iter_mut().for_each(|b| *b *= keep);
        for (row, label) in rows.chunks_exact(n).zip(labels) {
            recent.cross.iter_mut().zip(row).for_each(|(b, h)| *b += share * *label * h);
        }
        if first {
            begun.clone_from(recent);
            weights.fill(0.0);
        }
        let old = settings.first as f32;
        let mix = |out: &mut [f32], a: &[f32], b: &[f32]| {
            out.iter_mut().zip(a).zip(b).for_each(|((out, a), b)| *out = old * a + (1.0 - old) * b);
        };
        mix(&mut system.gram, &begun.gram, &recent.gram);
        mix(&mut system.cross, &begun.cross, &recent.cross);
        for i in 0..n {
            system.gram[i * (i + 3) / 2] += settings.ridge as f32;
        }
        // Conjugate gradients; `cross` becomes what is left of the right-hand side.
        let rest = &mut system.cross;
        kernels::symmetric_times(&system.gram, weights, image);
        rest.iter_mut().zip(&*image).for_each(|(rest, image)| *rest -= image);
        step.copy_from_slice(rest);
        let mut left = kernels::dot(rest, rest);
        for _ in 0..if first { STEPS.0 } else { STEPS.1 } {
            if left < 1e-12 {
                break;
            }
            kernels::symmetric_times(&system.gram, step, image);
            let length = left / kernels::dot(step, image);
            weights.iter_mut().zip(&*step).for_each(|(w, step)| *w += length * step);
            rest.iter_mut().zip(&*image).for_each(|(rest, image)| *rest -= length * image);
            let before = std::mem::replace(&mut left, kernels::dot(rest, rest));
            step.iter_mut().zip(&*rest).for_each(|(step, rest)| *step = rest + left / before * *step);
        }
    }

    /// Everything learned, to resume from.
    pub fn save(&self) -> serde_json::Value {
        let parts = [&self.first.gram, &self.first.cross, &self.recent.gram, &self.recent.cross, &self.weights];
        serde_json::to_value(parts.map(|values| encode(values))).expect("plain data is JSON")
    }

    /// Takes up what `save` gave. Fails where it does not fit.
    pub fn load(&mut self, saved: &serde_json::Value) -> Result<()> {
        let bad = |what: String| Error::Invalid(format!("the saved discriminant cannot be used: {what}"));
        let saved = <[String; 5]>::deserialize(saved).map_err(|e| bad(e.to_string()))?;
        let Self { first, recent, weights, .. } = self;
        let parts = [&mut first.gram, &mut first.cross, &mut recent.gram, &mut recent.cross, weights];
        for (to, saved) in parts.into_iter().zip(saved) {
            let values = decode(&saved).ok_or_else(|| bad("it is not base64 of finite numbers".into()))?;
            if values.len() != to.len() {
                let (found, expected) = (values.len(), to.len());
                return Err(bad(format!(
                    "it has {found} numbers where this tracker has {expected}; use the configuration it was saved with"
                )));
            }
            *to = values;
        }
        Ok(())
    }
}

fn encode(values: &[f32]) -> String {
    let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

fn decode(text: &str) -> Option<Vec<f32>> {
    let bytes = base64::engine::general_purpose::STANDARD.decode(text).ok()?;
    let (values, rest) = bytes.as_chunks::<4>();
    let values: Vec<f32> = values.iter().map(|x| f32::from_le_bytes(*x)).collect();
    (rest.is_empty() && values.iter().all(|x| x.is_finite())).then_some(values)
}
