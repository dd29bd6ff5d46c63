//! The search in the unit cube, of any number of variables.

use serde_json::Value;

/// A search of the unit cube, for any number of variables.
pub(super) trait Cube: std::fmt::Debug + Send {
    /// The point of call number `asked`, counted from 0, after `seen` values.
    fn ask(&mut self, asked: u64, seen: u64) -> Vec<f64>;
    /// Another point and its value, and all values of the window with that one last.
    fn tell(&mut self, point: &[f64], values: &[f64]);
    /// Mean and variance of the scaled function.
    fn predict(&self, point: &[f64]) -> (f64, f64);
    /// Hyper-parameters, and how many values they were fitted to.
    fn save(&self) -> Value;
    /// Restores a saved state with its points and values; `None` if it does not fit.
    fn restore(&mut self, saved: &Value, points: &[Vec<f64>], values: &[f64]) -> Option<()>;
}

/// Mean and standard deviation; the deviation is 1 if all values are equal.
pub(super) fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    let sd = (values.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / n).sqrt();
    (mean, if sd > 1e-12 * mean.abs() && sd > 0.0 { sd } else { 1.0 })
}
