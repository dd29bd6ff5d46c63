//! Colours of the target and of its surroundings: the probability that a cell of a glimpse belongs to the target.
//!
//! Two histograms over 8 × 8 × 8 bins, of the cells inside the box and of those around it, give
//! ```text
//! p(target | bin) = (f + ε/2) / (f + b + ε)
//! ```
//! as `identity/colour.rs` has it for particles. A cell counts in the eight bins around its colour, and reads them, by trilinear weights.
//! Half of each histogram is that of frame 1, the other half a running mean over the confident evaluations since.

use super::glimpse::{CHANNELS, COARSE, place};
use crate::identity::numbers::floats;
use serde::{Deserialize, Serialize};

/// Bins of a channel, and of a histogram.
const BINS: usize = 8;
const ALL: usize = BINS * BINS * BINS;
/// Cells up to this far from the centre are the target's, and those from here on its surroundings', in half sides of the box.
const INSIDE: f64 = 0.8;
const AROUND: f64 = 1.1;
/// A bin with a smaller share of the cells is not informative.
const EMPTY: f32 = 0.004;
/// Weight of frame 1, and that of the newest evaluation in the running mean.
const FIRST: f32 = 0.5;
const RATE: f32 = 0.04;

/// Shares of the bins: those in the target, then those around it, each of sum 1; of frame 1, and the running mean.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Histograms {
    #[serde(with = "floats")]
    first: Vec<f32>,
    #[serde(with = "floats")]
    recent: Vec<f32>,
}

/// p(target | bin) of all bins.
#[derive(Clone, Debug, Default)]
pub(super) struct Colours(Vec<f32>);

/// Calls `of` with each of the eight bins around a colour, and with its weight; the weights sum to 1.
fn bins(pixel: &[f32; CHANNELS], mut of: impl FnMut(usize, f32)) {
    let at = pixel.map(|x| (x * (BINS as f32 / 256.0) - 0.5).clamp(0.0, BINS as f32 - 1.001));
    for corner in 0..8 {
        let (mut bin, mut weight) = (0, 1.0);
        for (c, at) in at.iter().enumerate() {
            let (low, part) = (*at as usize, at.fract());
            let up = corner >> c & 1;
            (bin, weight) = (bin * BINS + low + up, weight * if up == 1 { part } else { 1.0 - part });
        }
        of(bin, weight);
    }
}

impl Histograms {
    /// Of the coarse cells of frame 1: `COARSE` × `COARSE` × `CHANNELS`, grey levels.
    pub(super) fn of(cells: &[f32]) -> Self {
        let mut first = vec![0.0; 2 * ALL];
        count(cells, 1.0, &mut first);
        Self { recent: first.clone(), first }
    }

    /// Learns a later glimpse of the target.
    pub(super) fn learn(&mut self, cells: &[f32]) {
        self.recent.iter_mut().for_each(|share| *share *= 1.0 - RATE);
        count(cells, RATE, &mut self.recent);
    }

    /// Whether they are complete, or empty without a target.
    pub(super) fn are_of(&self, target: bool) -> bool {
        let bins = if target { 2 * ALL } else { 0 };
        [&self.first, &self.recent].iter().all(|h| h.len() == bins && h.iter().all(|x| (0.0..=1.01).contains(x)))
    }
}

/// Adds `rate` times the shares of these cells.
fn count(cells: &[f32], rate: f32, to: &mut [f32]) {
    let (pixels, _) = cells.as_chunks::<CHANNELS>();
    let zone = |i: usize| {
        let far = place(i % COARSE).abs().max(place(i / COARSE).abs());
        (!(INSIDE..=AROUND).contains(&far)).then_some(usize::from(far > AROUND))
    };
    let mut counts = [0.0_f32; 2];
    (0..pixels.len()).filter_map(zone).for_each(|zone| counts[zone] += 1.0);
    for (i, pixel) in pixels.iter().enumerate() {
        let Some(zone) = zone(i) else { continue };
        bins(pixel, |bin, weight| to[zone * ALL + bin] += rate * weight / counts[zone]);
    }
}

impl Colours {
    /// Computes the probabilities from these histograms; those of empty ones are none.
    pub(super) fn update(&mut self, histograms: &Histograms) {
        let Histograms { first, recent } = histograms;
        let mixed = |bin: usize| FIRST * first[bin] + (1.0 - FIRST) * recent[bin];
        self.0.clear();
        self.0.extend((0..first.len() / 2).map(|bin| {
            let (target, around) = (mixed(bin), mixed(ALL + bin));
            (target + 0.5 * EMPTY) / (target + around + EMPTY)
        }));
    }

    /// Writes the network's input for coarse cells in grey levels: 4 (p − ½) of each, with the probability p of its colour.
    pub(super) fn input(&self, coarse: &[f32], to: &mut Vec<f32>) {
        to.clear();
        to.extend(coarse.as_chunks().0.iter().map(|cell| 4.0 * (self.probability(cell) - 0.5)));
    }

    /// The probability that a cell of this colour belongs to the target, 0 to 1.
    pub(super) fn probability(&self, pixel: &[f32; CHANNELS]) -> f32 {
        let mut sum = 0.0;
        bins(pixel, |bin, weight| sum += weight * self.0[bin]);
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A target of one colour before another.
    fn two(target: [f32; 3], around: [f32; 3]) -> Vec<f32> {
        let inside = |i: usize| place(i % COARSE).abs() < 1.0 && place(i / COARSE).abs() < 1.0;
        (0..COARSE * COARSE).flat_map(|i| if inside(i) { target } else { around }).collect()
    }

    #[test]
    fn each_colour_belongs_to_where_it_was_seen() {
        let (red, green, blue) = ([208.0, 16.0, 16.0], [16.0, 208.0, 16.0], [16.0, 16.0, 208.0]);
        let (mut histograms, mut colours) = (Histograms::of(&two(red, green)), Colours::default());
        colours.update(&histograms);
        // In the middle of a bin a colour counts in that bin alone: (1 + ε/2) / (1 + ε), the reverse, and ½ for a colour that was never seen.
        let exact = (1.0 + 0.5 * EMPTY) / (1.0 + EMPTY);
        for (colour, exact) in [(red, exact), (green, 1.0 - exact), (blue, 0.5)] {
            assert!((colours.probability(&colour) - exact).abs() < 1e-5);
        }
        // Later frames count half at most.
        (0..200).for_each(|_| histograms.learn(&two(blue, green)));
        colours.update(&histograms);
        let half = (0.5 + 0.5 * EMPTY) / (0.5 + EMPTY);
        assert!((colours.probability(&blue) - half).abs() < 1e-4 && (colours.probability(&red) - half).abs() < 1e-4);
    }

    #[test]
    fn shares_and_weights_sum_to_one() {
        for pixel in [[0.0, 255.0, 128.0], [-50.0, 300.0, 3.0], [16.0, 17.5, 239.9]] {
            let (mut sum, mut most) = (0.0, 0);
            bins(&pixel, |bin, weight| (sum, most) = (sum + weight, most.max(bin)));
            assert!((sum - 1.0).abs() < 1e-5 && most < ALL, "{sum}, {most}");
            let mut histograms = Histograms::of(&two(pixel, [3.0, 90.0, 200.0]));
            histograms.learn(&two([1.0, 2.0, 3.0], pixel));
            assert!(histograms.are_of(true) && !histograms.are_of(false));
            for part in [&histograms.first, &histograms.recent] {
                part.chunks(ALL).for_each(|h| assert!((h.iter().sum::<f32>() - 1.0).abs() < 1e-4));
            }
        }
        assert!(Histograms::default().are_of(false));
    }
}
