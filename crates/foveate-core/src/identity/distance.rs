//! Distances between feature vectors: how unlike the target does this look?
//!
//! The likelihood is exp(−sharpness · d(h, τ)) (section 3.1), so sharpness · d is in nats: 0 means
//! identical, and ln 2 more halves the likelihood. `a` and `b` have length n_h; the two Bhattacharyya distances
//! expect activation probabilities.

use foveate_kernels as kernels;
use serde::{Deserialize, Serialize};

/// How unlike two feature vectors are: at least 0, and 0 for equal ones.
pub trait Distance: Send + Sync {
    /// Transforms a template's features in place to the form that `distance` uses: terms of the template alone are
    /// computed once a batch.
    fn keep(&self, template: &mut [f32]);
    /// The distance of `features` from a kept template.
    fn distance(&self, features: &[f32], kept: &[f32]) -> f64;
}

/// The distances there are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// √(1 − Σ √(âᵢ b̂ᵢ)) of activations normalised to sum 1, as in the authors' code (Hellinger).
    Bhattacharyya,
    /// 1 − Σ √(âᵢ b̂ᵢ), its square.
    BhattacharyyaSquared,
    /// Mean over units of −ln(√(aᵢbᵢ) + √((1−aᵢ)(1−bᵢ))): units as Bernoulli variables.
    Bernoulli,
    /// 1 − cosine of the angle between the vectors.
    Cosine,
    /// Root mean square difference.
    Euclidean,
    /// Mean over cells of min(e², cap²) / cap², with e = τ − v where the template τ is brighter and `extra` · (v −
    /// τ) elsewhere. For pixels of bright objects on dark.
    Presence {
        /// Weight of additional brightness, 0 to 1.
        extra: f32,
        /// Upper bound of a difference, above 0.
        cap: f32,
    },
}

impl Distance for Kind {
    fn keep(&self, template: &mut [f32]) {
        match self {
            Self::Bhattacharyya | Self::BhattacharyyaSquared => {
                let norm = kernels::sum(template);
                let gain = if norm > 0.0 { 1.0 / norm } else { 0.0 };
                template.iter_mut().for_each(|t| *t = (*t * gain).sqrt());
            }
            Self::Cosine => {
                let norm = kernels::dot(template, template).sqrt();
                let gain = if norm > 0.0 { 1.0 / norm } else { 0.0 };
                template.iter_mut().for_each(|t| *t *= gain);
            }
            Self::Bernoulli | Self::Euclidean | Self::Presence { .. } => {}
        }
    }

    fn distance(&self, features: &[f32], kept: &[f32]) -> f64 {
        assert_eq!(features.len(), kept.len(), "feature vectors of one length");
        match self {
            Self::Bhattacharyya => overlap_gap(features, kept).sqrt(),
            Self::BhattacharyyaSquared => overlap_gap(features, kept),
            Self::Bernoulli => bernoulli(features, kept),
            Self::Cosine => cosine(kernels::dot(features, features), kernels::dot(features, kept)),
            Self::Presence { extra, cap } => {
                f64::from(kernels::presence(features, kept, *extra, *cap)) / f64::from(cap * cap) / kept.len() as f64
            }
            Self::Euclidean => (f64::from(kernels::squared_distance(features, kept)) / kept.len() as f64).sqrt(),
        }
    }
}

impl Kind {
    /// The distance, if it follows from Σ h and Σ √h · kept alone. An encoder may compute these without writing the
    /// features h ([`super::Encoder::overlaps`]).
    pub fn of_overlap(&self) -> Option<fn(f32, f32) -> f64> {
        match self {
            Self::Bhattacharyya => Some(|sum, overlap| gap(sum, overlap).sqrt()),
            Self::BhattacharyyaSquared => Some(gap),
            _ => None,
        }
    }
}

/// 1 − cosine, from the squared length `square` of features and their product `along` with a kept template.
pub(super) fn cosine(square: f32, along: f32) -> f64 {
    let norm = f64::from(square).sqrt();
    if norm > 0.0 { (1.0 - f64::from(along) / norm).max(0.0) } else { 1.0 }
}

fn overlap_gap(a: &[f32], kept: &[f32]) -> f64 {
    let (sum, overlap) = kernels::root_overlap(a, kept);
    gap(sum, overlap)
}

/// 1 − Σ √h · kept / √Σh, at least 0; 1 if no unit is active.
fn gap(sum: f32, overlap: f32) -> f64 {
    if sum > 0.0 { (1.0 - f64::from(overlap) / f64::from(sum).sqrt()).max(0.0) } else { 1.0 }
}

fn bernoulli(a: &[f32], b: &[f32]) -> f64 {
    let unit = |(&p, &q): (&f32, &f32)| f64::from(-((p * q).sqrt() + ((1.0 - p) * (1.0 - q)).sqrt()).max(1e-12).ln());
    a.iter().zip(b).map(unit).sum::<f64>().max(0.0) / a.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Kind; 5] =
        [Kind::Bhattacharyya, Kind::BhattacharyyaSquared, Kind::Bernoulli, Kind::Cosine, Kind::Euclidean];

    fn between(kind: Kind, a: &[f32], b: &[f32]) -> f64 {
        let mut kept = b.to_vec();
        kind.keep(&mut kept);
        kind.distance(a, &kept)
    }

    #[test]
    fn equal_vectors_are_at_zero_and_others_are_not() {
        let (a, b) = ([0.1, 0.9, 0.4, 0.3], [0.8, 0.2, 0.4, 0.3]);
        for kind in ALL {
            assert!(between(kind, &a, &a) < 1e-3, "{kind:?} {}", between(kind, &a, &a));
            assert!(between(kind, &a, &b) > 1e-2, "{kind:?}");
            assert!((between(kind, &a, &b) - between(kind, &b, &a)).abs() < 1e-7, "{kind:?} is symmetric");
        }
    }

    #[test]
    fn closed_forms() {
        // Two coins: BC = √(.5 · 1) + 0, after normalising (1, 1) and (2, 0) to (.5, .5) and (1, 0).
        let d = between(Kind::Bhattacharyya, &[1.0, 1.0], &[2.0, 0.0]);
        assert!((d - (1.0 - 0.5f64.sqrt()).sqrt()).abs() < 1e-6);
        let presence = Kind::Presence { extra: 0.5, cap: 0.5 };
        let d = between(presence, &[0.0, 0.9, 0.5, 0.2], &[1.0, 0.8, 0.5, 0.4]);
        assert!((d - (1.0 + 0.01 + 0.0 + 0.16) / 4.0).abs() < 1e-6);
        let d = between(Kind::Bernoulli, &[0.5], &[0.5]);
        assert!(d.abs() < 1e-6);
        let d = between(Kind::Bernoulli, &[0.25], &[1.0]);
        assert!((d - 2f64.ln()).abs() < 1e-6);
        assert!((between(Kind::Cosine, &[1.0, 0.0], &[1.0, 1.0]) - (1.0 - 0.5f64.sqrt())).abs() < 1e-6);
        assert!((between(Kind::Euclidean, &[1.0, 2.0], &[4.0, 6.0]) - 12.5f64.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn empty_activations_are_far_not_nan() {
        for kind in ALL {
            assert!(between(kind, &[0.0, 0.0], &[1.0, 0.5]).is_finite(), "{kind:?}");
        }
    }
}
