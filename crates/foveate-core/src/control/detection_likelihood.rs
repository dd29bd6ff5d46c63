//! log p(detection | x): the evidence of a detector's boxes about the position of the target.
//!
//! For detections d₁..ₖ of which one belongs to the target (its own, after data association),
//! ```text
//! p(d | x) ∝ (1 − outlier)/k Σ exp(−½ |centre of d − place|² / place² − ½ (log size of d − log_scale)² / size²) + outlier
//! ```
//! with positions in half boxes of d along each axis. The units are d's, not x's, because otherwise larger states
//! would fit better. The uniform part bounds the effect of a false detection to log(1/outlier) nats a frame, so that
//! appearance outweighs it.
//!
//! Deviation: the paper has no such term; detections enter its proposal alone, and the weights undo them.

use crate::geometry::{Extent, State};
use crate::scene::Detection;

foveate_base::settings! {
    /// The error model of detections.
    #[derive(Copy)]
    pub struct DetectionLikelihood in "detection_likelihood" {
        /// Standard deviation of a detection's centre, in half sides of its box, 0.01 to 10.
        pub place: f64 = 0.2; 0.01 to 10.0,
        /// Standard deviation of its log size; large for unreliable sizes, 0.01 to 100.
        pub size: f64 = 0.1; 0.01 to 100.0,
        /// Lower bound of the likelihood far from all detections, relative to the peak, 1e-9 to 1.
        pub outlier: f64 = 0.02; 1e-9 to 1.0,
    }
}

/// A detection as a measurement of x, y and log scale.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Measurement {
    /// Measured values: pixels, pixels, and a logarithm.
    pub values: [f64; 3],
    /// Standard deviations of their errors.
    pub sd: [f64; 3],
}

impl DetectionLikelihood {
    /// The detections that have an area, as measurements of a target with this extent.
    pub(crate) fn measurements(&self, detections: &[Detection], extent: Extent) -> impl Iterator<Item = Measurement> {
        let log_unit = (2.0 * extent.mean()).ln();
        detections.iter().map(|d| d.bbox).filter(|b| b.w > 0.0 && b.h > 0.0).map(move |b| {
            let (x, y) = b.centre();
            let sd = [0.5 * b.w * self.place, 0.5 * b.h * self.place, self.size];
            Measurement { values: [x, y, 0.5 * (b.w * b.h).ln() - log_unit], sd }
        })
    }

    /// log p(d | x) less that of a state in the middle of the only detection, from log(outlier) to 0; 0 without detections.
    pub fn log_likelihood(&self, detections: &[Detection], state: &State, extent: Extent) -> f64 {
        let mut likelihood = [0.0];
        self.likelihoods(detections, std::slice::from_ref(state), extent, &mut likelihood);
        likelihood[0].ln()
    }

    /// Writes the exponential of that of each state.
    fn likelihoods(&self, detections: &[Detection], states: &[State], extent: Extent, out: &mut [f64]) {
        out.fill(0.0);
        let mut count = 0;
        for Measurement { values: [x, y, log_scale], sd } in self.measurements(detections, extent) {
            for (sum, state) in out.iter_mut().zip(states) {
                let off = [(x - state.x) / sd[0], (y - state.y) / sd[1], (log_scale - state.log_scale) / sd[2]];
                let off = off[0] * off[0] + off[1] * off[1] + off[2] * off[2];
                *sum += if off.is_nan() { 0.0 } else { (-0.5 * off).exp() };
            }
            count += 1;
        }
        let of = |sum: f64| self.outlier + (1.0 - self.outlier) * sum / f64::from(count);
        out.iter_mut().for_each(|sum| *sum = if count == 0 { 1.0 } else { of(*sum) });
    }

    /// Adds it to the log weights of states without changing their sum, so that the evidence remains that of
    /// appearance, which `ConsistencyMonitor` compares with frame 1. Returns the constant that was added to each.
    pub fn weigh(&self, detections: &[Detection], states: &[State], extent: Extent, log_weights: &mut [f64]) -> f64 {
        if detections.is_empty() {
            return 0.0;
        }
        let most = log_weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if !most.is_finite() {
            return 0.0;
        }
        const BATCH: usize = 64;
        let (mut before, mut after, mut batch) = (0.0, 0.0, [0.0; BATCH]);
        for (states, log_weights) in states.chunks(BATCH).zip(log_weights.chunks_mut(BATCH)) {
            let likelihoods = &mut batch[..states.len()];
            self.likelihoods(detections, states, extent, likelihoods);
            for (log_w, likelihood) in log_weights.iter_mut().zip(likelihoods) {
                let weight = (*log_w - most).exp();
                before += weight;
                *log_w += likelihood.ln();
                after += weight * *likelihood;
            }
        }
        let same = (before / after).ln();
        log_weights.iter_mut().for_each(|log_w| *log_w += same);
        same
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::normalize;
    use crate::geometry::BBox;

    const EXTENT: Extent = Extent { half_w: 10.0, half_h: 20.0 };
    const LIKELIHOOD: DetectionLikelihood = DetectionLikelihood { place: 0.2, size: 0.1, outlier: 0.01 };

    fn seen(x: f64, y: f64, scale: f64) -> Detection {
        Detection::new(BBox::around(x, y, 20.0 * scale, 40.0 * scale), 1.0)
    }

    #[test]
    fn in_closed_form() {
        let state = State { x: 50.0, y: 60.0, log_scale: 0.3, ..State::default() };
        let scale = 0.3f64.exp();
        let close = |found: &[Detection], exact: f64| {
            let got = LIKELIHOOD.log_likelihood(found, &state, EXTENT);
            assert!((got - exact).abs() < 1e-12, "{got} is not {exact}");
        };
        close(&[], 0.0);
        close(&[seen(50.0, 60.0, scale)], 0.0);
        // One deviation across, two down.
        let off = seen(50.0 + 0.2 * 10.0 * scale, 60.0 - 0.4 * 20.0 * scale, scale);
        close(&[off], (0.01 + 0.99 * (-2.5f64).exp()).ln());
        close(&[seen(50.0, 60.0, scale * 0.1f64.exp())], (0.01 + 0.99 * (-0.5f64).exp()).ln());
        close(&[off, seen(50.0, 60.0, scale)], (0.01 + 0.495 * (1.0 + (-2.5f64).exp())).ln());
        close(&[seen(900.0, 60.0, scale)], 0.01f64.ln());
        for bad in [seen(f64::NAN, 60.0, 1.0), seen(f64::INFINITY, 60.0, 1.0)] {
            close(&[bad], 0.01f64.ln());
        }
        close(&[seen(50.0, 60.0, f64::NAN), seen(50.0, 60.0, -1.0)], 0.0);
    }

    #[test]
    fn weights_move_and_their_sum_stays() {
        let states = [State { x: 50.0, ..State::default() }, State { x: 58.0, ..State::default() }];
        let given = [-3.0, -3.5];
        let (mut log_w, mut w) = (given, [0.0; 2]);
        LIKELIHOOD.weigh(&[], &states, EXTENT, &mut log_w);
        assert_eq!(log_w, given, "nothing seen, nothing changed");
        let before = normalize(&log_w, &mut w);
        let odds = w[1] / w[0];
        LIKELIHOOD.weigh(&[seen(58.0, 0.0, 1.0)], &states, EXTENT, &mut log_w);
        let after = normalize(&log_w, &mut w);
        assert!((before - after).abs() < 1e-12, "{before} {after}");
        let gain = 1.0 / (0.01 + 0.99 * (-8.0f64).exp());
        assert!((w[1] / w[0] / odds / gain - 1.0).abs() < 1e-9);
        let mut none = [f64::NEG_INFINITY; 2];
        LIKELIHOOD.weigh(&[seen(58.0, 0.0, 1.0)], &states, EXTENT, &mut none);
        assert_eq!(none, [f64::NEG_INFINITY; 2]);
    }
}
