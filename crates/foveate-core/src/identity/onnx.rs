//! Deep features: a network from an ONNX file as the first layer.
//!
//! | its input | content |
//! | --- | --- |
//! | (N, C, S, S) | the planes of a retina of one window of S × S cells, 0 to 1: grey, or red, green, blue where the retina has a window of colour of the same cells |
//! | (N, n) | the n values of a glimpse of any retina, 0 to 1, in the retina's order |
//!
//! Features are its first output, row by row. Deviation: the paper's first layer is an RBM (section 2.1).

use serde::{Deserialize, Serialize};

#[cfg(feature = "onnx")]
mod encoder;
#[cfg(feature = "onnx")]
pub use encoder::OnnxEncoder;

use foveate_base::error::within;
use foveate_base::{Error, Result};

/// Planes of a three-plane input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Planes {
    /// Red, green and blue; grey three times without colour.
    #[default]
    Rgb,
    /// Grey, red − green, blue − yellow; grey three times without colour.
    Opponent,
}

/// Fails if the offsets or divisors of the planes are not none, one for all, or one a plane.
#[cfg_attr(not(feature = "onnx"), allow(dead_code, reason = "nothing is normalised for no network"))]
pub(crate) fn check_normalisation(mean: &[f32], std: &[f32], planes: usize) -> Result<()> {
    for (key, values, least, most) in [("encoder.mean", mean, -1e6, 1e6), ("encoder.std", std, 1e-6, 1e6)] {
        if values.len() > 1 && values.len() != planes {
            let n = values.len();
            return Err(Error::Config(format!(
                "{key} has {n} numbers; give none, one, or one for each of the {planes} planes"
            )));
        }
        values.iter().try_for_each(|value| within(key, f64::from(*value), least, most))?;
    }
    Ok(())
}
