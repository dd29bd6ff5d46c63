//! One step of Adam (Kingma & Ba 2015), with weight decay apart from it and a running mean of the parameters.

use crate::level::{levels, multiply_add};

/// The numbers of a step of [`adam`] beside the arrays.
#[derive(Clone, Copy, Debug)]
pub struct Adam {
    /// Shares of the past in the two moments.
    pub past: (f32, f32),
    /// Multiplies the gradient.
    pub scale: f32,
    /// The step size over 1 − β₁ᵗ.
    pub step: f32,
    /// 1 / √(1 − β₂ᵗ).
    pub widen: f32,
    /// Keeps the divisor from 0.
    pub least: f32,
    /// Pull of the parameters towards 0.
    pub pull: f32,
    /// The weight of the parameters in the running mean.
    pub share: f32,
}

#[inline(always)]
fn adam_body<const V: u8>(a: Adam, x: &mut [f32], gradient: &[f32], moments: [&mut [f32]; 2], mean: &mut [f32]) {
    let [first, second] = moments;
    let n = x.len();
    assert!([gradient.len(), first.len(), second.len(), mean.len()] == [n; 4], "as many of each");
    let (keep, take) = (a.past, (1.0 - a.past.0, 1.0 - a.past.1));
    for i in 0..n {
        let g = gradient[i] * a.scale;
        first[i] = multiply_add::<V>(keep.0, first[i], take.0 * g);
        second[i] = multiply_add::<V>(keep.1, second[i], take.1 * g * g);
        let root = multiply_add::<V>(second[i].sqrt(), a.widen, a.least);
        let moved = a.step * first[i] / root;
        x[i] = multiply_add::<V>(-a.pull, x[i], x[i]) + moved;
        mean[i] = multiply_add::<V>(a.share, x[i] - mean[i], mean[i]);
    }
}

levels! {
    /// Moves `x` up its `gradient`: m ← β₁ m + (1 − β₁) g, v ← β₂ v + (1 − β₂) g², x ← (1 − pull) x + step m / (√v widen + least),
    /// mean ← mean + share (x − mean), with `moments` m and v, and g = scale × gradient.
    ///
    /// # Panics
    /// If the slices are not equally long.
    pub fn adam / adam_at (a: Adam, x: &mut [f32], gradient: &[f32], moments: [&mut [f32]; 2], mean: &mut [f32]) = adam_body
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Level;

    #[test]
    fn every_level_takes_the_step_of_the_formula() {
        let a = Adam { past: (0.9, 0.999), scale: 0.01, step: 0.02, widen: 3.0, least: 1e-8, pull: 1e-3, share: 0.25 };
        let wave = |n: usize, w: f32| (0..n).map(|i| (i as f32 * w).sin()).collect::<Vec<f32>>();
        for level in Level::all() {
            for n in [0, 1, 7, 16, 33, 100] {
                let (mut x, g, mut m, mut mean) = (wave(n, 0.3), wave(n, 1.7), wave(n, 0.9), wave(n, 0.1));
                let mut v: Vec<f32> = wave(n, 2.3).iter().map(|v| v * v).collect();
                let before = (x.clone(), m.clone(), v.clone(), mean.clone());
                adam_at(level, a, &mut x, &g, [&mut m, &mut v], &mut mean);
                for i in 0..n {
                    let g = f64::from(g[i]) * 0.01;
                    let first = 0.9 * f64::from(before.1[i]) + 0.1 * g;
                    let second = 0.999 * f64::from(before.2[i]) + 0.001 * g * g;
                    let there = 0.999 * f64::from(before.0[i]) + 0.02 * first / (second.sqrt() * 3.0 + 1e-8);
                    let kept = 0.75 * f64::from(before.3[i]) + 0.25 * there;
                    for (found, exact) in [(m[i], first), (v[i], second), (x[i], there), (mean[i], kept)] {
                        assert!((f64::from(found) - exact).abs() < 1e-5 * (1.0 + exact.abs()), "{level:?} {i}");
                    }
                }
            }
        }
    }
}
