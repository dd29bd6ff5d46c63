//! Settings of the discriminant, and their ranges.

use foveate_base::Result;
use foveate_base::error::within;
use serde::{Deserialize, Serialize};

/// Settings of the discriminant. It needs a gaze at the centre; other gazes are compared with the template alone. With the encoder
/// `oriented`, the policy `explore-then-commit` and no `[variation]` it learns all gazes of the grid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Mixing weight of its score in the distance; the template has the rest, 0 to 1.
    pub mixing_weight: f64,
    /// Weight of the newest frame, 0 to 1.
    pub learning_rate: f64,
    /// Weight of frame 1, 0 to 1.
    pub first_frame_weight: f64,
    /// Ridge added to the diagonal; features have a length of about 1.
    pub ridge: f64,
    /// Probability of dropping each part of the features (gradients, grey, colour), in expectation, 0 to 0.9.
    pub dropout: f64,
    /// Standard deviation of the labels in position, template units, 0.01 to 10.
    pub spread: f64,
    /// Standard deviation of the labels in log scale, 0.01 to 10.
    pub log_scale: f64,
    /// Evidence deficit above which a frame is not learned, 0 to 2.
    pub gate: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            mixing_weight: 0.5,
            learning_rate: 0.1,
            first_frame_weight: 0.5,
            ridge: 0.003,
            dropout: 0.0,
            spread: 0.2,
            log_scale: 0.1,
            gate: 0.5,
        }
    }
}

impl Settings {
    /// The factor of the frames since the first, and the weight of the newest.
    pub(super) fn fading(&self) -> (f32, f32) {
        (1.0 - self.learning_rate as f32, self.learning_rate as f32)
    }
    /// Fails with the key if a number is out of range.
    pub fn check(&self) -> Result<()> {
        for (name, value, least, most) in [
            ("mixing_weight", self.mixing_weight, 0.0, 1.0),
            ("learning_rate", self.learning_rate, 0.0, 1.0),
            ("first_frame_weight", self.first_frame_weight, 0.0, 1.0),
            ("ridge", self.ridge, 1e-6, 1e3),
            ("dropout", self.dropout, 0.0, 0.9),
            ("spread", self.spread, 0.01, 10.0),
            ("log_scale", self.log_scale, 0.01, 10.0),
            ("gate", self.gate, 0.0, 2.0),
        ] {
            within(&format!("discriminant.{name}"), value, least, most)?;
        }
        Ok(())
    }
}
