//! Digits drawn by a pen, for where there is no MNIST: strokes with random slant, width and wobble.
//!
//! A digit is a few strokes (smooth curves through points of the unit square, y down) in one of two or
//! three ways of writing it. Slant, turn, aspect and a slow wave bend all its strokes together, so they
//! stay joined. As MNIST does, it is then scaled to 20 pixels, and its centre of mass put in the middle of 28 × 28.

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use crate::idx::{Digits, SIDE};
use crate::spline::Spline;
use foveate_base::rng::{Purpose, Rng, Streams};

/// A stroke: points it passes through.
type Stroke = &'static [[f64; 2]];

/// The ways of writing each digit, by class.
const WAYS: [&[&[Stroke]]; 10] = [
    &[
        &[&[
            [0.52, 0.0],
            [0.2, 0.16],
            [0.05, 0.52],
            [0.2, 0.88],
            [0.52, 1.0],
            [0.85, 0.8],
            [0.95, 0.45],
            [0.8, 0.12],
            [0.48, 0.0],
        ]],
        &[&[
            [0.7, 0.06],
            [0.4, 0.02],
            [0.14, 0.3],
            [0.1, 0.66],
            [0.34, 0.97],
            [0.68, 0.9],
            [0.9, 0.56],
            [0.86, 0.2],
            [0.56, 0.02],
            [0.42, 0.12],
        ]],
    ],
    &[
        &[&[[0.5, 0.0], [0.5, 0.5], [0.5, 1.0]]],
        &[&[[0.32, 0.22], [0.54, 0.0]], &[[0.54, 0.0], [0.53, 0.5], [0.52, 1.0]]],
        &[&[[0.56, 0.0], [0.52, 0.5], [0.46, 1.0]]],
    ],
    &[
        &[
            &[[0.12, 0.24], [0.36, 0.02], [0.72, 0.06], [0.8, 0.34], [0.52, 0.68], [0.08, 0.98]],
            &[[0.08, 0.98], [0.5, 0.95], [0.94, 0.97]],
        ],
        &[&[
            [0.14, 0.2],
            [0.42, 0.0],
            [0.76, 0.14],
            [0.72, 0.46],
            [0.4, 0.82],
            [0.14, 0.96],
            [0.1, 0.8],
            [0.32, 0.78],
            [0.6, 0.94],
            [0.96, 0.92],
        ]],
    ],
    &[
        &[
            &[[0.14, 0.12], [0.45, 0.0], [0.78, 0.12], [0.72, 0.36], [0.38, 0.47]],
            &[[0.38, 0.47], [0.74, 0.54], [0.86, 0.76], [0.56, 0.98], [0.1, 0.9]],
        ],
        &[
            &[[0.16, 0.08], [0.56, 0.0], [0.8, 0.2], [0.56, 0.42], [0.36, 0.48]],
            &[[0.36, 0.48], [0.66, 0.52], [0.84, 0.72], [0.66, 0.94], [0.3, 1.0], [0.08, 0.86]],
        ],
    ],
    &[
        &[
            &[[0.16, 0.04], [0.12, 0.3], [0.1, 0.56]],
            &[[0.1, 0.56], [0.45, 0.58], [0.88, 0.52]],
            &[[0.8, 0.0], [0.76, 0.4], [0.7, 1.0]],
        ],
        &[
            &[[0.66, 0.0], [0.36, 0.32], [0.06, 0.62]],
            &[[0.06, 0.62], [0.5, 0.64], [0.96, 0.62]],
            &[[0.66, 0.0], [0.67, 0.5], [0.64, 1.0]],
        ],
        &[
            &[[0.22, 0.0], [0.1, 0.34], [0.24, 0.52], [0.6, 0.5], [0.84, 0.36]],
            &[[0.86, 0.06], [0.82, 0.5], [0.74, 1.0]],
        ],
    ],
    &[
        &[
            &[[0.9, 0.02], [0.55, 0.04], [0.28, 0.05]],
            &[[0.28, 0.05], [0.22, 0.24], [0.18, 0.45]],
            &[[0.18, 0.45], [0.5, 0.38], [0.8, 0.56], [0.78, 0.84], [0.46, 1.0], [0.08, 0.9]],
        ],
        &[
            &[[0.3, 0.08], [0.22, 0.26], [0.24, 0.44]],
            &[[0.24, 0.44], [0.58, 0.44], [0.78, 0.66], [0.62, 0.92], [0.3, 1.0], [0.06, 0.94]],
            &[[0.3, 0.08], [0.62, 0.06], [0.96, 0.0]],
        ],
    ],
    &[
        &[&[
            [0.68, 0.0],
            [0.36, 0.24],
            [0.14, 0.56],
            [0.16, 0.86],
            [0.46, 1.0],
            [0.78, 0.84],
            [0.72, 0.6],
            [0.44, 0.56],
            [0.18, 0.76],
        ]],
        &[&[
            [0.46, 0.0],
            [0.24, 0.3],
            [0.14, 0.66],
            [0.28, 0.95],
            [0.62, 0.98],
            [0.84, 0.76],
            [0.62, 0.6],
            [0.34, 0.7],
            [0.24, 0.86],
        ]],
    ],
    &[
        &[&[[0.06, 0.08], [0.45, 0.05], [0.88, 0.04]], &[[0.88, 0.04], [0.66, 0.36], [0.48, 0.68], [0.4, 1.0]]],
        &[
            &[[0.08, 0.16], [0.2, 0.04], [0.55, 0.08], [0.9, 0.04]],
            &[[0.9, 0.04], [0.74, 0.34], [0.6, 0.66], [0.52, 1.0]],
        ],
        &[
            &[[0.08, 0.06], [0.45, 0.05], [0.86, 0.05]],
            &[[0.86, 0.05], [0.62, 0.36], [0.44, 0.7], [0.34, 1.0]],
            &[[0.32, 0.5], [0.54, 0.48], [0.8, 0.48]],
        ],
    ],
    &[
        &[&[
            [0.78, 0.14],
            [0.5, 0.0],
            [0.24, 0.16],
            [0.36, 0.38],
            [0.62, 0.54],
            [0.78, 0.76],
            [0.54, 0.99],
            [0.22, 0.86],
            [0.32, 0.62],
            [0.62, 0.42],
            [0.8, 0.2],
            [0.74, 0.08],
        ]],
        &[&[
            [0.5, 0.48],
            [0.22, 0.3],
            [0.34, 0.04],
            [0.66, 0.03],
            [0.8, 0.24],
            [0.5, 0.48],
            [0.2, 0.7],
            [0.3, 0.97],
            [0.68, 0.97],
            [0.82, 0.72],
            [0.5, 0.48],
        ]],
    ],
    &[
        &[
            &[[0.8, 0.18], [0.52, 0.0], [0.22, 0.14], [0.2, 0.4], [0.48, 0.48], [0.76, 0.3], [0.8, 0.18]],
            &[[0.8, 0.16], [0.78, 0.58], [0.66, 1.0]],
        ],
        &[
            &[[0.74, 0.08], [0.42, 0.02], [0.18, 0.24], [0.32, 0.46], [0.62, 0.38], [0.76, 0.1]],
            &[[0.76, 0.06], [0.72, 0.4], [0.6, 0.72], [0.5, 1.0]],
        ],
        &[
            &[[0.8, 0.2], [0.54, 0.0], [0.24, 0.16], [0.24, 0.4], [0.54, 0.46], [0.8, 0.2]],
            &[[0.8, 0.16], [0.82, 0.54], [0.68, 0.86], [0.42, 1.0], [0.26, 0.94]],
        ],
    ],
];

impl Digits {
    /// Draws `per_class` digits of each class; digit `i` is of class `i mod 10` and follows from `seed` and `i`.
    pub fn drawn(seed: u64, per_class: usize) -> Self {
        let streams = Streams::new(seed, 10).at(0, Purpose::Scene);
        let labels: Vec<u8> = (0..10 * per_class).map(|i| (i % 10) as u8).collect();
        let images =
            labels.iter().enumerate().flat_map(|(i, &class)| draw(class, &mut streams.rng(i as u64))).collect();
        Self { images, labels }
    }
}

/// Draws one digit.
fn draw(class: u8, rng: &mut Rng) -> Vec<u8> {
    let mut lines = bend(write(class, rng), rng);

    let (low, high) = bounds(&lines);
    let size = 20.0 / (high[0] - low[0]).max(high[1] - low[1]);
    let width = rng.random_range(1.8..3.6);
    let size = size * (1.0 - width / 24.0); // the pen's own width belongs to the 20 pixels
    lines.iter_mut().flatten().for_each(|p| *p = [0, 1].map(|k| (p[k] - (low[k] + high[k]) / 2.0) * size));

    let middle = (SIDE - 1) as f64 / 2.0;
    let centre = centre_of_mass(&ink(&lines, width, [middle; 2]));
    ink(&lines, width, [0, 1].map(|k| 2.0 * middle - centre[k])).iter().map(|v| (255.0 * v).round() as u8).collect()
}

/// The strokes of one way of writing a digit, as short straight pieces.
fn write(class: u8, rng: &mut Rng) -> Vec<Vec<[f64; 2]>> {
    const PIECES: usize = 10; // a point: a piece is then about a third of a pixel
    let ways = WAYS[usize::from(class)];
    let way = ways[rng.random_range(0..ways.len())];
    let pieces = |stroke: &Stroke| {
        let curve = Spline::through(stroke.to_vec());
        (0..=(stroke.len() - 1) * PIECES).map(|i| curve.at(i as f64 / PIECES as f64)).collect()
    };
    way.iter().map(pieces).collect()
}

/// Bends a digit: two slow waves, aspect, slant, turn.
fn bend(mut lines: Vec<Vec<[f64; 2]>>, rng: &mut Rng) -> Vec<Vec<[f64; 2]>> {
    let mut normal = |sd: f64| -> f64 { sd * Distribution::<f64>::sample(&StandardNormal, rng).clamp(-2.5, 2.5) };
    let waves: [[f64; 4]; 4] = std::array::from_fn(|_| [normal(0.05), normal(3.0), normal(3.0), normal(9.0)]);
    let (aspect, slant, turn) = (0.72 * normal(0.14).exp(), 0.16 + normal(0.22), normal(0.1));
    let (sin, cos) = turn.sin_cos();
    for p in lines.iter_mut().flatten() {
        let wave = |w: &[f64; 4]| w[0] * (w[1] * p[0] + w[2] * p[1] + w[3]).sin();
        let x = aspect * (p[0] - 0.5 + wave(&waves[0]) + wave(&waves[1]));
        let y = p[1] - 0.5 + wave(&waves[2]) + wave(&waves[3]);
        let x = x - slant * y;
        *p = [cos * x - sin * y, sin * x + cos * y];
    }
    lines
}

/// Corners of the smallest upright box around all points.
fn bounds(lines: &[Vec<[f64; 2]>]) -> ([f64; 2], [f64; 2]) {
    let ends = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    lines
        .iter()
        .flatten()
        .fold(ends, |(low, high), p| ([0, 1].map(|k| low[k].min(p[k])), [0, 1].map(|k| high[k].max(p[k]))))
}

/// Ink, 0 to 1, of lines drawn around `middle` with a pen of `width` pixels and soft edges.
fn ink(lines: &[Vec<[f64; 2]>], width: f64, middle: [f64; 2]) -> Vec<f64> {
    const SOFT: f64 = 1.3; // pixels from full ink to none, as scanned and shrunk digits have
    let pixel = |i: usize| {
        let at = [(i % SIDE) as f64 - middle[0], (i / SIDE) as f64 - middle[1]];
        let near =
            |line: &Vec<[f64; 2]>| line.windows(2).map(|p| from_piece(at, p[0], p[1])).fold(f64::INFINITY, f64::min);
        let d = lines.iter().map(near).fold(f64::INFINITY, f64::min);
        (0.5 + (width / 2.0 - d) / SOFT).clamp(0.0, 1.0)
    };
    (0..SIDE * SIDE).map(pixel).collect()
}

/// Distance of a point from a straight piece.
fn from_piece(at: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [at[0] - a[0], at[1] - a[1]]);
    let length = (along[0] * along[0] + along[1] * along[1]).max(f64::MIN_POSITIVE);
    let t = ((along[0] * to[0] + along[1] * to[1]) / length).clamp(0.0, 1.0);
    (to[0] - t * along[0]).hypot(to[1] - t * along[1])
}

/// Where the ink balances, in pixels.
fn centre_of_mass(ink: &[f64]) -> [f64; 2] {
    let mut sums = [0.0; 3];
    for (i, v) in ink.iter().enumerate() {
        let terms = [v * (i % SIDE) as f64, v * (i / SIDE) as f64, *v];
        sums = [0, 1, 2].map(|k| sums[k] + terms[k]);
    }
    [sums[0] / sums[2], sums[1] / sums[2]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_testing::{data, need};

    #[test]
    fn digits_fill_the_square_as_mnist_does() {
        let set = Digits::drawn(1, 20);
        assert_eq!((set.len(), set.of_class(4).len()), (200, 20));
        for i in 0..set.len() {
            let ink: Vec<f64> = set.digit(i).iter().map(|&v| f64::from(v) / 255.0).collect();
            let c = centre_of_mass(&ink);
            assert!((0..2).all(|k| (c[k] - 13.5).abs() < 0.5), "digit {i} is centred at {c:?}");
            let rows = (0..SIDE).filter(|y| ink[y * SIDE..][..SIDE].iter().any(|&v| v > 0.5)).count();
            let columns = (0..SIDE).filter(|x| (0..SIDE).any(|y| ink[y * SIDE + x] > 0.5)).count();
            assert!((17..=22).contains(&rows.max(columns)), "digit {i} is {columns} x {rows}");
            // MNIST's mean grey is 33 of 255, from 15 (thin ones) to 60 or so.
            let mean = 255.0 * ink.iter().sum::<f64>() / ink.len() as f64;
            assert!((10.0..75.0).contains(&mean), "digit {i} has a mean grey of {mean}");
        }
        assert_eq!(set, Digits::drawn(1, 20));
        assert_ne!(set, Digits::drawn(2, 20));
        assert_eq!(Digits::drawn(1, 1).digit(7), set.digit(7));
    }

    #[test]
    fn strokes_are_recognised() {
        // The nearest of 6,000 MNIST digits (Euclidean) has the drawn digit's class 94 times in 100; chance is 10.
        let mnist = need!(data("mnist"));
        let known = Digits::load(mnist.parent().expect("the data"), super::super::Split::Train).expect("MNIST");
        let drawn = Digits::drawn(3, 20);
        let far =
            |a: &[u8], b: &[u8]| -> i32 { a.iter().zip(b).map(|(&a, &b)| (i32::from(a) - i32::from(b)).pow(2)).sum() };
        let right = |i: &usize| {
            let nearest = (0..6000).min_by_key(|&k| far(known.digit(k), drawn.digit(*i))).expect("some digit");
            known.labels[nearest] == drawn.labels[*i]
        };
        let right = (0..drawn.len()).filter(right).count();
        assert!(right > 175, "{right} of 200");
    }
}
