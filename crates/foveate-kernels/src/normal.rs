//! Standard normal numbers by the row: Box & Muller (1958) over eight xoshiro256++ generators side by side.
//!
//! A pair is √(−2 ln u) · (cos φ, sin φ). The angle is one within ±π/4, where a short series does, turned
//! to one of four sides by two random bits. No branch, no table: eight pairs at a time. The series end where
//! 2e-11 is left, which no sample could show.

use crate::Level;
use crate::wide::same_bits;
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, LN_2};

/// Generators side by side.
const LANES: usize = 8;
/// Normal numbers that come at once.
const BLOCK: usize = 2 * LANES;
const ONE: u64 = 1.0f64.to_bits();

type Generators = [[u64; LANES]; 4];

/// A stream of independent standard normal numbers. The seed alone determines their bits, on every processor.
#[derive(Clone, Debug)]
pub struct Normals {
    generators: Generators,
}

impl Normals {
    /// The stream of this seed.
    pub fn new(seed: u64) -> Self {
        Self { generators: seeded(Level::best(), seed) }
    }
    /// Fills `out` with the next numbers. They are computed in groups of sixteen, and the rest of the last group is
    /// dropped, so a shorter `out` gets the first numbers of a longer one.
    pub fn fill(&mut self, out: &mut [f64]) {
        fill(Level::best(), &mut self.generators, out);
    }
}

/// The first 32 numbers of SplitMix64, as the authors of xoshiro seed theirs.
#[inline(always)]
fn seeded_body(seed: u64) -> Generators {
    let mut state = [[0; LANES]; 4];
    for (row, lanes) in state.iter_mut().enumerate() {
        for (i, lane) in lanes.iter_mut().enumerate() {
            let count = (row * LANES + i) as u64 + 1;
            let z = seed.wrapping_add(count.wrapping_mul(0x9e37_79b9_7f4a_7c15));
            let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            *lane = z ^ (z >> 31);
        }
    }
    state
}

/// Eight numbers of xoshiro256++ (Blackman & Vigna 2019).
#[inline(always)]
fn step(s: &mut Generators) -> [u64; LANES] {
    let mut out = [0; LANES];
    for i in 0..LANES {
        out[i] = s[0][i].wrapping_add(s[3][i]).rotate_left(23).wrapping_add(s[0][i]);
        let t = s[1][i] << 17;
        s[2][i] ^= s[0][i];
        s[3][i] ^= s[1][i];
        s[1][i] ^= s[2][i];
        s[0][i] ^= s[3][i];
        s[2][i] ^= t;
        s[3][i] = s[3][i].rotate_left(45);
    }
    out
}

/// ln u for a normal u > 0: k ln 2 + 2 atanh((m − 1) / (m + 1)) with m from √½ to √2, by its series.
#[inline(always)]
fn ln(u: f64) -> f64 {
    const LOW: u64 = FRAC_1_SQRT_2.to_bits();
    const TWO_52: f64 = (1u64 << 52) as f64;
    let bits = u.to_bits() + (ONE - LOW);
    let k = f64::from_bits((bits >> 52) | TWO_52.to_bits()) - (TWO_52 + 1023.0);
    let m = f64::from_bits((bits & ((1 << 52) - 1)) + LOW);
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let mut p = 2.0 / 11.0;
    for odd in [9.0, 7.0, 5.0, 3.0] {
        p = p * z + 2.0 / odd;
    }
    k * LN_2 + (p * z * s + 2.0 * s)
}

/// (sin φ, cos φ) for |φ| ≤ π/4, by their series.
#[inline(always)]
fn sin_cos(phi: f64) -> (f64, f64) {
    let z = phi * phi;
    let mut sin = -1.0 / 39_916_800.0; // 11!
    for factorial in [362_880.0, -5040.0, 120.0, -6.0] {
        sin = sin * z + 1.0 / factorial;
    }
    let mut cos = 1.0 / 479_001_600.0; // 12!
    for factorial in [-3_628_800.0, 40_320.0, -720.0, 24.0, -2.0, 1.0] {
        cos = cos * z + 1.0 / factorial;
    }
    (sin * z * phi + phi, cos)
}

/// Two normal numbers from 128 random bits.
#[inline(always)]
fn pair(a: u64, b: u64) -> (f64, f64) {
    let u = 2.0 - f64::from_bits(ONE | (a >> 12)); // (0, 1]
    let r = (-2.0 * ln(u)).sqrt();
    let quarters = f64::from_bits(ONE | (b >> 12)) - 1.5; // [−½, ½)
    let (sin, cos) = sin_cos(quarters * FRAC_PI_2);
    let (x, y) = if b & 1 == 0 { (cos, sin) } else { (sin, cos) };
    let sign = (b & 2) << 62;
    (f64::from_bits((r * x).to_bits() ^ sign), f64::from_bits((r * y).to_bits() ^ sign))
}

#[inline(always)]
fn block(generators: &mut Generators, out: &mut [f64; BLOCK]) {
    let (a, b) = (step(generators), step(generators));
    for i in 0..LANES {
        (out[i], out[LANES + i]) = pair(a[i], b[i]);
    }
}

#[inline(always)]
fn fill_body(generators: &mut Generators, out: &mut [f64]) {
    let mut local = *generators;
    let (blocks, rest) = out.as_chunks_mut::<BLOCK>();
    for out in blocks {
        block(&mut local, out);
    }
    if !rest.is_empty() {
        let mut last = [0.0; BLOCK];
        block(&mut local, &mut last);
        rest.copy_from_slice(&last[..rest.len()]);
    }
    *generators = local;
}

same_bits! {
    fn seeded(seed: u64) -> Generators = seeded_body
}

same_bits! {
    fn fill(generators: &mut Generators, out: &mut [f64]) = fill_body
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_series_agree_with_the_library() {
        for i in 1..=100_000u32 {
            let u = f64::from(i) * 1e-5;
            for u in [u, u * u * u, u.powi(12)] {
                assert!((ln(u) - u.ln()).abs() < 2e-11, "ln {u}: {} {}", ln(u), u.ln());
            }
            let phi = (2.0 * u - 1.0) * std::f64::consts::FRAC_PI_4;
            let ((sin, cos), exact) = (sin_cos(phi), phi.sin_cos());
            assert!((sin - exact.0).abs() < 1e-11 && (cos - exact.1).abs() < 1e-11, "sin, cos {phi}");
        }
        assert_eq!(ln(1.0), 0.0);
    }

    #[test]
    fn the_same_bits_at_every_level_and_length() {
        let mut exact = vec![0.0; 1000];
        fill(Level::Portable, &mut Normals::new(5).generators, &mut exact);
        for level in Level::all() {
            for n in [0, 1, 15, 16, 17, 1000] {
                let mut out = vec![f64::NAN; n];
                fill(level, &mut Normals::new(5).generators, &mut out);
                assert!(out == exact[..n], "{level:?}, {n} numbers");
            }
        }
        let (mut stream, mut first, mut second) = (Normals::new(5), [0.0; 32], [0.0; 16]);
        stream.fill(&mut first);
        stream.fill(&mut second);
        assert!(first == exact[..32] && second == exact[32..48], "calls go on in the stream");
        let mut other = [0.0; 16];
        Normals::new(6).fill(&mut other);
        assert!(other != exact[..16]);
    }

    /// SplitMix64 and xoshiro256++ in their plain forms.
    #[test]
    fn eight_generators_side_by_side() {
        let mut name = 9u64;
        let mut splitmix = || {
            name = name.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (name ^ (name >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^ (z >> 31)
        };
        let first: Generators = std::array::from_fn(|_| std::array::from_fn(|_| splitmix()));
        Level::all().for_each(|level| assert_eq!(seeded(level, 9), first));
        let mut state = Normals::new(9).generators;
        let mut alone: [[u64; 4]; LANES] = std::array::from_fn(|i| std::array::from_fn(|j| state[j][i]));
        for _ in 0..100 {
            for (s, got) in alone.iter_mut().zip(step(&mut state)) {
                assert_eq!(got, s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]));
                let t = s[1] << 17;
                s[2] ^= s[0];
                s[3] ^= s[1];
                s[1] ^= s[2];
                s[0] ^= s[3];
                s[2] ^= t;
                s[3] = s[3].rotate_left(45);
            }
        }
    }

    /// 4,000,000 numbers, seed 1. Shares beyond quantiles, moments, and products of neighbours at many distances, each
    /// within 5 deviations: 45 checks fail less than 3 times in 10⁵.
    #[test]
    fn they_are_normal_and_independent() {
        let mut z = vec![0.0; 4_000_000];
        Normals::new(1).fill(&mut z);
        let n = z.len() as f64;
        let quantiles = [
            (0.0, 0.5),
            (0.253_347_103_135_799_7, 0.4),
            (0.524_400_512_708_040_7, 0.3),
            (0.841_621_233_572_914_2, 0.2),
            (1.281_551_565_544_600_4, 0.1),
            (2.326_347_874_040_841, 0.01),
            (3.090_232_306_167_813_5, 0.001),
            (4.264_890_793_922_825, 1e-5),
        ];
        for (quantile, p) in quantiles {
            for side in [1.0, -1.0] {
                let share = z.iter().filter(|&&z| side * z > quantile).count() as f64 / n;
                let sd = f64::sqrt(p * (1.0 - p) / n);
                assert!(
                    (share - p).abs() < 5.0 * sd,
                    "{share} of the numbers lie beyond {quantile}, not {p} ± 5 × {sd}"
                );
            }
        }
        for (power, moment, variance) in
            [(1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0), (6, 15.0, 10170.0)]
        {
            let mean = z.iter().map(|z| z.powi(power)).sum::<f64>() / n;
            let sd = f64::sqrt(variance / n);
            assert!((mean - moment).abs() < 5.0 * sd, "mean of z^{power} is {mean}, not {moment} ± 5 × {sd}");
        }
        for lag in [1, 2, 3, 7, 8, 9, 15, 16, 17, 32, 64, 128] {
            let products = |f: fn(f64) -> f64| z.iter().zip(&z[lag..]).map(|(&a, &b)| f(a) * f(b)).sum::<f64>() / n;
            let (plain, squares) = (products(|z| z), products(|z| z * z - 1.0));
            assert!(plain.abs() < 5.0 / n.sqrt() && squares.abs() < 10.0 / n.sqrt(), "lag {lag}: {plain}, {squares}");
        }
    }
}
