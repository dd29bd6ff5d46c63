//! A recogniser's accuracy on digits: single decisions, and decisions accumulated over many glimpses.

use super::sequences::FixationSampler;
use crate::Digits;
use crate::eval::Reliability;
use foveate_base::Result;
use foveate_core::geometry::Gaze;
use foveate_core::identity::{MultiFixation, Recognizer};

/// The results after a number of glimpses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Number of glimpses.
    pub looks: usize,
    /// Fraction of digits with a right decision from the last Δ glimpses alone.
    pub single: f64,
    /// Fraction of digits with a right decision from the sum of all log-probabilities so far, one per glimpse.
    pub gathered: f64,
}

/// Number of digits that a curve holds in memory at a time.
const TOGETHER: usize = 250;

/// Computes accuracy against the number of glimpses, 1 to the sampler's window, and the calibration of single decisions on Δ glimpses.
///
/// The sampler's window is the number of glimpses, not Δ. Fails if it has no digits, or does not fit the recogniser.
pub fn curve(
    recogniser: &MultiFixation,
    sampler: &FixationSampler,
    digits: &Digits,
) -> Result<(Vec<Point>, Reliability)> {
    let (classes, looks, n) = (recogniser.classes(), sampler.window, digits.len());
    let mut recogniser = recogniser.clone();
    let (mut single, mut gathered) = (vec![0usize; looks], vec![0usize; looks]);
    let (mut log_p, mut sum, mut all) = (vec![0.0; classes], vec![0.0; classes], vec![]);
    let right = |q: &[f64], label: u8| q.iter().all(|x| *x <= q[usize::from(label)]);
    for (part, from) in (0..n).step_by(TOGETHER).enumerate() {
        let to = (from + TOGETHER).min(n);
        let some = digits.range(from, to);
        let made = sampler.look(&some, part as u64)?;
        let (rows, gazes) = (made.sequences().glimpses(), made.gazes());
        for (i, &label) in some.labels.iter().enumerate() {
            recogniser.reset();
            sum.fill(0.0);
            for k in 0..looks {
                let [u, v] = gazes[i * looks + k];
                recogniser.recognize(rows.row(i * looks + k), Gaze { u, v, arm: None }, &mut log_p);
                sum.iter_mut().zip(&log_p).for_each(|(s, q)| *s += q);
                single[k] += usize::from(right(&log_p, label));
                gathered[k] += usize::from(right(&sum, label));
                if k + 1 == recogniser.window().min(looks) {
                    all.extend_from_slice(&log_p);
                }
            }
        }
    }
    let share = |count: usize| count as f64 / n as f64;
    let points = (0..looks).map(|k| Point { looks: k + 1, single: share(single[k]), gathered: share(gathered[k]) });
    Ok((points.collect(), Reliability::of(&all, &digits.labels, classes, 10)))
}
