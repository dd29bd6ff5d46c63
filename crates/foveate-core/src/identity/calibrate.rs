//! Calibration of the likelihood's sharpness on the first frame, from the scene itself.
//!
//! The printed likelihood exp(−d) tracks nothing, and no single sharpness fits clean and noisy videos (findings of
//! the prototype: 60 and 30). The scale of distances follows from the first frame: `on` is the distance
//! about a pixel from the target, `off` the distance to other places of the scene. The sharpness is chosen so
//! that the gap between the two is a stated number of nats.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::geometry::{Extent, State};
use crate::scene::Image;
use foveate_base::rng::{Purpose, Streams};

/// How log-likelihoods follow from distances: log p = −sharpness · d.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sharpness {
    /// Given, in nats per unit of distance.
    Fixed(f64),
    /// Chosen on the first frame from the scene itself.
    Calibrated(Calibration),
}

/// Places looked at for `off`.
const PLACES: usize = 256;
/// Places are at least this far from the target, in template units.
const APART: f64 = 1.0;
/// The quantile of the distances elsewhere that counts as `off`: the more target-like places of the scene.
const LOOKALIKE: f64 = 0.05;

/// The rule for a calibrated sharpness.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Nats between the slightly displaced target and the most similar places elsewhere.
    pub nats: f64,
    /// Least sharpness.
    pub least: f64,
    /// Largest sharpness.
    pub most: f64,
}

/// Distances on the first frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Half a template pixel to one off the target: the mean.
    pub on: f64,
    /// Elsewhere: a low quantile.
    pub off: f64,
}

impl Calibration {
    /// The sharpness for the measured distances.
    pub fn sharpness(&self, found: &Found) -> f64 {
        (self.nats / (found.off - found.on).max(1e-6)).clamp(self.least, self.most)
    }
}

/// Looks around on the first frame: `look` writes the distance of each place to the template.
pub(super) fn calibrate(
    image: &Image,
    state: &State,
    extent: Extent,
    streams: Streams,
    look: &mut dyn FnMut(&[State], &mut [f64]),
) -> Found {
    let mut rng = streams.at(0, Purpose::Calibrate).rng(0);
    let step = extent.mean() / 14.0;
    let near: Vec<State> = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]
        .map(|(dx, dy)| State { x: state.x + dx * step, y: state.y + dy * step, ..*state })
        .to_vec();
    let (w, h) = (image.width() as f64, image.height() as f64);
    let far: Vec<State> = (0..PLACES)
        .map(|_| State { x: rng.random::<f64>() * w, y: rng.random::<f64>() * h, ..*state })
        .filter(|s| ((s.x - state.x) / extent.half_w).abs().max(((s.y - state.y) / extent.half_h).abs()) > APART)
        .collect();
    let mut distances = |states: &[State]| {
        let mut out = vec![0.0; states.len()];
        if !states.is_empty() {
            look(states, &mut out);
        }
        out.sort_by(f64::total_cmp);
        out
    };
    let near = distances(&near);
    let far = distances(&far);
    let on = near.iter().sum::<f64>() / near.len() as f64;
    let off = far.get((far.len() as f64 * LOOKALIKE) as usize).copied().unwrap_or(2.0 * on);
    Found { on, off: off.max(on) }
}
