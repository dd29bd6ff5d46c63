//! The saliency of Itti, Koch and Niebur (1998), from one picture.
//!
//! Intensity, two opponent colours and four orientations are read from a pyramid that halves at each level.
//! Differences between a fine centre c ∈ {2, 3, 4} and a coarse surround c + δ, δ ∈ {3, 4}, measure how much a place
//! differs from its surroundings. N(·) scales a map to 0 to 1 and multiplies it by (1 − m̄)², with m̄ the mean of its
//! other local maxima: a map with one peak is kept, one with many similar peaks vanishes. Maps of a feature are
//! added, features are weighted.
//!
//! Deviation: maps are added at the finest centre (cells of 4 pixels), not the coarsest, so that boxes are sharp; opponency
//! keeps its sign, so that green on red stands out as red on green does; orientation is the energy of an even and an odd
//! Gabor filter, not an even one's response, so that edges count where they are.

use crate::scene::detect::{Blobs, Detector, Score};
use crate::scene::{Detection, Image, Map};

/// Finest centre; the map's cells are 2² pixels.
const FINEST: usize = 2;
/// Levels of a pyramid.
const LEVELS: usize = 9;
/// Angles of the Gabor filters, of 180° in all.
const ANGLES: usize = 4;
/// Reach of a Gabor filter from its centre: 9 × 9 taps.
const REACH: usize = 4;
const SIDE: usize = 2 * REACH + 1;
/// Contrast (of 1) that a map must reach somewhere to count: one grey level of 255. Below it is rounding.
const CONTRAST: f32 = 1.0 / 255.0;

/// Itti and Koch's saliency. The map has cells of 4 pixels and values from 0 to 1, the largest being 1 unless the picture
/// is even.
#[derive(Clone, Debug)]
pub struct Saliency {
    /// Weights of intensity, colour and orientation.
    pub weights: [f32; 3],
    /// Share of the largest value above which a place is part of a candidate.
    pub threshold: f32,
    map: Map,
    blobs: Blobs,
    /// Intensity, red against green, blue against yellow.
    channels: [Vec<Map>; 3],
    oriented: [Vec<Map>; ANGLES],
    gabors: [[[f32; SIDE * SIDE]; 2]; ANGLES],
    feature: Map,
    part: Map,
    difference: Map,
    across: Vec<f32>,
}

impl Default for Saliency {
    fn default() -> Self {
        let levels = || vec![Map::default(); LEVELS];
        Self {
            weights: [0.3, 0.3, 0.2],
            threshold: 0.5,
            map: Map::default(),
            blobs: Blobs::new(32, Score::Peak),
            channels: std::array::from_fn(|_| levels()),
            oriented: std::array::from_fn(|_| levels()),
            gabors: std::array::from_fn(gabor),
            feature: Map::default(),
            part: Map::default(),
            difference: Map::default(),
            across: vec![],
        }
    }
}

impl Detector for Saliency {
    fn detect(&mut self, image: &Image, found: &mut Vec<Detection>) {
        self.look(image);
        let threshold = self.threshold * self.map.max();
        self.blobs.find(&self.map, threshold, image.size(), found);
    }
    fn map(&self) -> &Map {
        &self.map
    }
}

impl Saliency {
    /// Fills the map for a picture.
    pub fn look(&mut self, image: &Image) {
        self.read(image);
        self.map.cover(image.width(), image.height(), 1 << FINEST);
        let Self { channels, oriented, feature, part, difference, map, .. } = self;
        let [intensity, red, blue] = channels;
        let groups: [&[&[Map]]; 3] =
            [&[&**intensity], &[&**red, &**blue], &[&oriented[0], &oriented[1], &oriented[2], &oriented[3]]];
        for (pyramids, weight) in groups.iter().zip(self.weights) {
            feature.like(map);
            for pyramid in *pyramids {
                part.like(feature);
                for centre in FINEST..FINEST + 3 {
                    for delta in [3, 4] {
                        contrast(&pyramid[centre], &pyramid[centre + delta], difference);
                        normalise(difference, CONTRAST);
                        add(part, difference, 1.0);
                    }
                }
                normalise(part, 0.0);
                add(feature, part, 1.0);
            }
            // A feature that is one pyramid has been through N already.
            if pyramids.len() > 1 {
                normalise(feature, 0.0);
            }
            add(map, feature, weight);
        }
        let largest = map.max();
        if largest > 0.0 {
            map.values_mut().iter_mut().for_each(|v| *v = (*v / largest).max(0.0));
        }
    }
    /// The pyramids of a picture.
    fn read(&mut self, image: &Image) {
        let colour = image.planes() == 3;
        self.channels[0][0].intensity(image);
        for (k, channel) in self.channels.iter_mut().enumerate() {
            if k > 0 {
                channel[0].cover(image.width(), image.height(), 1);
                if colour {
                    opponents(image, k == 1, &mut channel[0]);
                }
            }
            for l in 1..LEVELS {
                let (fine, coarse) = channel.split_at_mut(l);
                fine[l - 1].halve(&mut self.across, &mut coarse[0]);
            }
        }
        for (oriented, gabor) in self.oriented.iter_mut().zip(&self.gabors) {
            for (from, to) in self.channels[0].iter().zip(oriented).skip(FINEST) {
                energy(from, gabor, to);
            }
        }
    }
}

/// (r − g) or (b − min(r, g)), over max(r, g, b); 0 in pixels too dark for a hue (below a tenth of white).
fn opponents(image: &Image, red: bool, to: &mut Map) {
    let planes = image.plane(0).iter().zip(image.plane(1)).zip(image.plane(2));
    for (value, ((&r, &g), &b)) in to.values_mut().iter_mut().zip(planes) {
        let most = r.max(g).max(b);
        let difference = if red { i16::from(r) - i16::from(g) } else { i16::from(b) - i16::from(r.min(g)) };
        *value = if most < 26 { 0.0 } else { f32::from(difference) / f32::from(most) };
    }
}

/// An even and an odd Gabor filter at `k` · 45°: wavelength 5 cells, deviation 2, without a mean, each of unit absolute sum.
fn gabor(k: usize) -> [[f32; SIDE * SIDE]; 2] {
    let (sin, cos) = (std::f32::consts::PI * k as f32 / ANGLES as f32).sin_cos();
    let place = |i: usize| {
        let (x, y) = ((i % SIDE) as f32 - REACH as f32, (i / SIDE) as f32 - REACH as f32);
        let envelope = (-(x * x + y * y) / 8.0).exp();
        (envelope, std::f32::consts::TAU / 5.0 * (x * cos + y * sin))
    };
    [f32::cos as fn(f32) -> f32, f32::sin].map(|wave| {
        let mut taps: [f32; SIDE * SIDE] = std::array::from_fn(|i| place(i).0 * wave(place(i).1));
        let whole: f32 = (0..taps.len()).map(|i| place(i).0).sum();
        let mean = taps.iter().sum::<f32>() / whole;
        taps.iter_mut().enumerate().for_each(|(i, tap)| *tap -= mean * place(i).0);
        let sum: f32 = taps.iter().map(|tap| tap.abs()).sum();
        taps.map(|tap| tap / sum)
    })
}

/// The root of the summed squares of two filters' responses; past the edges the edge's values are repeated.
fn energy(from: &Map, gabor: &[[f32; SIDE * SIDE]; 2], to: &mut Map) {
    let (w, h) = (from.width(), from.height());
    to.like(from);
    for (j, out) in to.values_mut().chunks_exact_mut(w).enumerate() {
        for (i, value) in out.iter_mut().enumerate() {
            let mut sums = [0.0_f32; 2];
            for v in 0..SIDE {
                let row = &from.values()[(j + v).saturating_sub(REACH).min(h - 1) * w..][..w];
                let taps = [&gabor[0][v * SIDE..][..SIDE], &gabor[1][v * SIDE..][..SIDE]];
                let mut tap = |u: usize, pixel: f32| {
                    sums[0] += taps[0][u] * pixel;
                    sums[1] += taps[1][u] * pixel;
                };
                if i >= REACH && i + REACH < w {
                    row[i - REACH..][..SIDE].iter().enumerate().for_each(|(u, &pixel)| tap(u, pixel));
                } else {
                    (0..SIDE).for_each(|u| tap(u, row[(i + u).saturating_sub(REACH).min(w - 1)]));
                }
            }
            *value = sums[0].hypot(sums[1]);
        }
    }
}

/// |centre − surround| on the centre's grid.
fn contrast(centre: &Map, surround: &Map, to: &mut Map) {
    let ratio = centre.cell() as f32 / surround.cell() as f32;
    let w = centre.width();
    to.like(centre);
    for (k, (value, here)) in to.values_mut().iter_mut().zip(centre.values()).enumerate() {
        let place = |i: usize| (i as f32 + 0.5) * ratio - 0.5;
        *value = (here - surround.between(place(k % w), place(k / w))).abs();
    }
}

/// N(·): to the range 0 to 1, times (1 − m̄)², m̄ the mean of the local maxima above a tenth, the largest one left out.
/// A map that nowhere exceeds `least` becomes one of zeros.
fn normalise(map: &mut Map, least: f32) {
    let (w, h) = (map.width(), map.height());
    let largest = map.max();
    if largest <= least {
        return map.values_mut().fill(0.0);
    }
    map.values_mut().iter_mut().for_each(|v| *v /= largest);
    let (mut sum, mut count) = (0.0, 0);
    for k in 0..w * h {
        let (i, j, value) = (k % w, k / w, map.values()[k]);
        let near = (j.saturating_sub(1)..=(j + 1).min(h - 1))
            .flat_map(|y| (i.saturating_sub(1)..=(i + 1).min(w - 1)).map(move |x| y * w + x));
        // Of a plateau the last cell is its maximum.
        let peak = value > 0.1
            && near.filter(|n| *n != k).all(|n| map.values()[n] < value || (n < k && map.values()[n] <= value));
        if peak {
            (sum, count) = (sum + value, count + 1);
        }
    }
    let mean = if count > 1 { (sum - 1.0) / (count - 1) as f32 } else { 0.0 };
    let promote = (1.0 - mean.clamp(0.0, 1.0)).powi(2);
    map.values_mut().iter_mut().for_each(|v| *v *= promote);
}

/// Adds `weight` times a map of any resolution to another one.
fn add(to: &mut Map, from: &Map, weight: f32) {
    let ratio = to.cell() as f32 / from.cell() as f32;
    let w = to.width();
    for (k, value) in to.values_mut().iter_mut().enumerate() {
        let place = |i: usize| (i as f32 + 0.5) * ratio - 0.5;
        *value += weight * from.between(place(k % w), place(k / w));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;

    #[test]
    fn it_is_a_detector() {
        conformance::detector(&|| Box::<Saliency>::default());
    }

    type Bar = (bool, [u8; 3]);

    /// 6 × 5 bars (upright or lying, a colour) on dark grey; one of them is odd. Jitter keeps them from being a lattice.
    fn bars(usual: Bar, odd: Bar, at: (usize, usize), planes: usize) -> Image {
        let (w, h) = (320, 256);
        let mut image = Image::new(w, h, planes, vec![60; w * h * planes]).expect("as many bytes");
        for k in 0..30 {
            let (i, j) = (k % 6, k / 6);
            let (upright, colour) = if (i, j) == at { odd } else { usual };
            let (cx, cy) = (30 + 52 * i + (7 * k) % 5, 28 + 50 * j + (11 * k) % 5);
            let (rx, ry) = if upright { (3, 12) } else { (12, 3) };
            for (p, &value) in colour.iter().take(planes).enumerate() {
                for y in cy - ry..cy + ry {
                    image.plane_mut(p)[y * w + cx - rx..y * w + cx + rx].fill(value);
                }
            }
        }
        image
    }

    #[test]
    fn the_odd_one_pops_out() {
        // Treisman and Gelade (1980): one odd in a single feature is seen at once, whatever the number of others.
        let (red, green, grey, bright) = ([200, 60, 60], [60, 200, 60], [120; 3], [240; 3]);
        for at in [(1, 1), (4, 3), (2, 2), (0, 4), (5, 0)] {
            for (name, usual, odd) in [
                ("bright", (true, grey), (true, bright)),
                ("colour", (true, red), (true, green)),
                ("colour", (false, green), (false, red)),
                ("orientation", (true, grey), (false, grey)),
                ("orientation", (false, bright), (true, bright)),
            ] {
                for planes in [1, 3] {
                    if name == "colour" && planes == 1 {
                        continue;
                    }
                    let image = bars(usual, odd, at, planes);
                    let (mut saliency, mut found) = (Saliency::default(), vec![]);
                    saliency.detect(&image, &mut found);
                    let (x, y) = saliency.map().peak();
                    let k = 6 * at.1 + at.0;
                    let (cx, cy) = ((30 + 52 * at.0 + (7 * k) % 5) as f64, (28 + 50 * at.1 + (11 * k) % 5) as f64);
                    let off = (x - cx).hypot(y - cy);
                    assert!(off < 20.0, "{name} {planes} at {at:?}: the peak is {off:.0} pixels away, at {x}, {y}");
                    let b = found[0].bbox;
                    assert!(b.x <= cx && cx <= b.x + b.w && b.y <= cy && cy <= b.y + b.h, "{name} at {at:?}: {b:?}");
                }
            }
        }
    }

    #[test]
    fn one_peak_is_kept_and_many_vanish() {
        let mut map = Map::over(40, 40, 1);
        map.values_mut()[820] = 3.0;
        let mut many = map.clone();
        [205, 210, 430, 1215].into_iter().for_each(|k| many.values_mut()[k] = 2.7);
        normalise(&mut map, 0.0);
        normalise(&mut many, 0.0);
        assert!((map.max() - 1.0).abs() < 1e-6 && (many.max() - 0.01).abs() < 1e-5, "{} {}", map.max(), many.max());
        normalise(&mut many, 0.5);
        assert_eq!(many.max(), 0.0);
    }

    #[test]
    fn filters_answer_to_their_own_orientation() {
        for k in 0..ANGLES {
            let mut wave = Map::over(40, 40, 1);
            let (sin, cos) = (std::f32::consts::PI * k as f32 / 4.0).sin_cos();
            for (i, v) in wave.values_mut().iter_mut().enumerate() {
                *v = 0.5 + 0.5 * (std::f32::consts::TAU / 5.0 * ((i % 40) as f32 * cos + (i / 40) as f32 * sin)).sin();
            }
            let mut out = Map::default();
            let answers: Vec<f32> = (0..ANGLES)
                .map(|other| {
                    energy(&wave, &gabor(other), &mut out);
                    out.at(20, 20)
                })
                .collect();
            let others = (0..ANGLES).filter(|o| *o != k).map(|o| answers[o]).fold(0.0, f32::max);
            assert!(answers[k] > 3.0 * others, "{k}: {answers:?}");
        }
    }
}
