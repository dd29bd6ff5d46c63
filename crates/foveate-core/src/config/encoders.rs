//! The first layers that a configuration may name, with their numbers.

use serde::{Deserialize, Serialize};

use super::own::OwnPart;
use crate::identity::onnx::Planes;
use crate::identity::oriented;
#[cfg(feature = "learn")]
use crate::identity::rbm_encoder::Precision;

/// The first layers there are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields, remote = "Self")]
#[non_exhaustive]
pub enum EncoderConfig {
    /// Hidden units of a restricted Boltzmann machine.
    #[cfg(feature = "learn")]
    Rbm {
        /// The model.
        weights: String,
        /// Precision of the weights.
        #[serde(default)]
        precision: Precision,
    },
    /// k-means filters convolved with the rings of any retina; by default that of the training.
    #[cfg(feature = "learn")]
    Kmeans {
        /// The model.
        #[serde(default = "natural_kmeans")]
        weights: String,
        /// Cells along a side of the grid over which the responses of each ring are averaged.
        #[serde(default = "two")]
        pool: usize,
        /// Threshold of a filter's response to a whitened patch.
        #[serde(default)]
        threshold: f32,
    },
    /// First output of a network in an ONNX file. It needs `--features onnx` and a retina; an input of (N, planes, side, side) needs one window.
    Onnx {
        /// The ONNX file, relative to the configuration.
        model: String,
        /// Planes of a three-plane input.
        #[serde(default)]
        planes: Planes,
        /// Mean subtracted from the input (0 to 1): none, one number, or one a plane.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        mean: Vec<f32>,
        /// Divisor of the input: none, one number, or one a plane.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        std: Vec<f32>,
    },
    /// Gradients in eight directions, grey and colour. It needs a retina of one ring.
    Oriented {
        /// The weight of each.
        #[serde(default)]
        weights: oriented::Weights,
    },
    /// Pixels of the glimpse.
    Raw {
        /// Whether the glimpse is normalised to mean 0 and contrast 1.
        #[serde(default = "yes")]
        standardise: bool,
    },
    /// A registered one.
    #[serde(skip)]
    Own(OwnPart),
}

#[cfg(feature = "learn")]
fn natural_kmeans() -> String {
    "builtin:natural-kmeans".into()
}

#[cfg(feature = "learn")]
fn two() -> usize {
    2
}

fn yes() -> bool {
    true
}
