//! The curves that a fit can have.

use super::linear::{invert, times};

/// A curve over time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Curve {
    /// y0 + v t: uniform motion.
    Line,
    /// y0 + v0 t + ½ a t²: free fall.
    Parabola,
    /// c + A sin(2π t / T + phase): pendulum, spring.
    Sine,
    /// c + A exp(−t / tau) sin(2π t / T + phase): an oscillation that dies away.
    Damped,
    /// c + A exp(−t / tau); a negative tau is growth.
    Exponential,
    /// y0 + v_end t + (v0 − v_end) tau (1 − exp(−t / tau)): a fall with drag proportional to the speed.
    Drag,
}

/// A parameter of a curve: name, and the exponents of length and time in its unit.
pub type Parameter = (&'static str, i32, i32);

impl Curve {
    /// All curves by name.
    pub const ALL: [(&'static str, Self); 6] = [
        ("line", Self::Line),
        ("parabola", Self::Parabola),
        ("sine", Self::Sine),
        ("damped", Self::Damped),
        ("exponential", Self::Exponential),
        ("drag", Self::Drag),
    ];

    /// Returns the name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, curve)| *curve == self).expect("all are listed").0
    }

    /// Returns the formula.
    pub fn formula(self) -> &'static str {
        match self {
            Self::Line => "y0 + v t",
            Self::Parabola => "y0 + v0 t + a t² / 2",
            Self::Sine => "c + A sin(2π t / T + phase)",
            Self::Damped => "c + A exp(−t / tau) sin(2π t / T + phase)",
            Self::Exponential => "c + A exp(−t / tau)",
            Self::Drag => "y0 + v_end t + (v0 − v_end) tau (1 − exp(−t / tau))",
        }
    }

    /// Returns the parameters, in the order of [`Curve::at`].
    pub fn parameters(self) -> &'static [Parameter] {
        match self {
            Self::Line => &[("y0", 1, 0), ("v", 1, -1)],
            Self::Parabola => &[("y0", 1, 0), ("v0", 1, -1), ("a", 1, -2)],
            Self::Sine => &[("c", 1, 0), ("A", 1, 0), ("phase", 0, 0), ("T", 0, 1)],
            Self::Damped => &[("c", 1, 0), ("A", 1, 0), ("phase", 0, 0), ("T", 0, 1), ("tau", 0, 1)],
            Self::Exponential => &[("c", 1, 0), ("A", 1, 0), ("tau", 0, 1)],
            Self::Drag => &[("y0", 1, 0), ("v0", 1, -1), ("v_end", 1, -1), ("tau", 0, 1)],
        }
    }

    /// Returns the value at a time for these parameters.
    pub fn at(self, p: &[f64], t: f64) -> f64 {
        let wave = |phase: f64, period: f64| (std::f64::consts::TAU * t / period + phase).sin();
        match self {
            Self::Line => p[0] + p[1] * t,
            Self::Parabola => p[0] + p[1] * t + 0.5 * p[2] * t * t,
            Self::Sine => p[0] + p[1] * wave(p[2], p[3]),
            Self::Damped => p[0] + p[1] * (-t / p[4]).exp() * wave(p[2], p[3]),
            Self::Exponential => p[0] + p[1] * (-t / p[2]).exp(),
            Self::Drag => p[0] + p[2] * t - (p[1] - p[2]) * p[3] * (-t / p[3]).exp_m1(),
        }
    }

    /// Returns starting values: linear least squares of the linear parameters, at the best of a grid of periods and time constants. `t`
    /// starts at 0; `weights` are reciprocal variances. `None` if the times determine no curve.
    pub(super) fn start(self, t: &[f64], y: &[f64], weights: &[f64]) -> Option<Vec<f64>> {
        let span = *t.last()?;
        let step = span / (t.len() - 1) as f64;
        let grid = |low: f64, high: f64, n: usize| -> Vec<f64> {
            (0..n).map(|k| low * (high / low).powf(k as f64 / (n - 1) as f64)).collect()
        };
        let one = [f64::INFINITY];
        let (periods, constants) = match self {
            Self::Line | Self::Parabola => (one.to_vec(), one.to_vec()),
            Self::Sine => {
                ([grid(3.0 * step, 4.0 * span, 160), vec![main_period(t, y, weights)]].concat(), one.to_vec())
            }
            Self::Damped => {
                let periods = [grid(3.0 * step, 2.0 * span, 120), vec![main_period(t, y, weights)]].concat();
                (periods, grid(0.3 * span, 30.0 * span, 6))
            }
            Self::Exponential => {
                let constants = grid(2.0 * step, 10.0 * span, 40);
                (one.to_vec(), constants.iter().flat_map(|tau| [*tau, -tau]).collect())
            }
            Self::Drag => (one.to_vec(), grid(2.0 * step, 10.0 * span, 40)),
        };
        let mut best: Option<(f64, Vec<f64>)> = None;
        for &period in &periods {
            for &tau in &constants {
                let rows: Vec<Vec<f64>> = t.iter().map(|t| self.basis(*t, period, tau)).collect();
                let Some((coefficients, error)) = least_squares(&rows, y, weights) else { continue };
                if best.as_ref().is_none_or(|(least, _)| error < *least) {
                    best = Some((error, self.parameters_of(&coefficients, period, tau)));
                }
            }
        }
        best.map(|(_, parameters)| parameters)
    }

    /// Returns the functions of which the curve is a linear combination, at a time.
    fn basis(self, t: f64, period: f64, tau: f64) -> Vec<f64> {
        let (sin, cos) = (std::f64::consts::TAU * t / period).sin_cos();
        let fall = (-t / tau).exp();
        match self {
            Self::Line => vec![1.0, t],
            Self::Parabola => vec![1.0, t, 0.5 * t * t],
            Self::Sine | Self::Damped => vec![1.0, fall * sin, fall * cos],
            Self::Exponential => vec![1.0, fall],
            Self::Drag => vec![1.0, t, fall],
        }
    }

    fn parameters_of(self, c: &[f64], period: f64, tau: f64) -> Vec<f64> {
        match self {
            Self::Line | Self::Parabola => c.to_vec(),
            Self::Sine => vec![c[0], c[1].hypot(c[2]), c[2].atan2(c[1]), period],
            Self::Damped => vec![c[0], c[1].hypot(c[2]), c[2].atan2(c[1]), period, tau],
            Self::Exponential => vec![c[0], c[1], tau],
            Self::Drag => vec![c[0] + c[2], c[1] - c[2] / tau, c[1], tau],
        }
    }
}

/// Returns the period at the highest peak of the periodogram: of many oscillations, a period from a coarse grid is not near enough. The
/// frequencies are half a peak's width apart, up to a period of three points.
fn main_period(t: &[f64], y: &[f64], weights: &[f64]) -> f64 {
    let span = t[t.len() - 1];
    let mean = y.iter().zip(weights).map(|(y, w)| y * w).sum::<f64>() / weights.iter().sum::<f64>();
    // Each point's phase grows by the same angle from one frequency to the next.
    let turn = |t: &f64| (std::f64::consts::PI * t / span).sin_cos();
    let mut points: Vec<_> =
        t.iter().zip(y).zip(weights).map(|((t, y), w)| (w * (y - mean), turn(t), (0.0, 1.0))).collect();
    let mut next_power = || {
        let (mut a, mut b) = (0.0, 0.0);
        for (y, (sin, cos), phase) in &mut points {
            *phase = (phase.0 * *cos + phase.1 * *sin, phase.1 * *cos - phase.0 * *sin);
            (a, b) = (a + *y * phase.0, b + *y * phase.1);
        }
        a * a + b * b
    };
    let powers = (1..=2 * (t.len() - 1) / 3).map(|k| (k, next_power()));
    let (k, _) = powers.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((1, 0.0));
    2.0 * span / k as f64
}

/// Returns the coefficients of weighted linear least squares and the sum of squared errors.
fn least_squares(rows: &[Vec<f64>], y: &[f64], weights: &[f64]) -> Option<(Vec<f64>, f64)> {
    let n = rows.first()?.len();
    let (mut normal, mut right) = (vec![vec![0.0; n]; n], vec![0.0; n]);
    for ((row, y), w) in rows.iter().zip(y).zip(weights) {
        for i in 0..n {
            right[i] += w * row[i] * y;
            (0..n).for_each(|j| normal[i][j] += w * row[i] * row[j]);
        }
    }
    let coefficients = times(&invert(&normal)?.matrix, &right);
    let error = |((row, y), w): ((&Vec<f64>, &f64), &f64)| {
        w * (y - row.iter().zip(&coefficients).map(|(a, b)| a * b).sum::<f64>()).powi(2)
    };
    let error = rows.iter().zip(y).zip(weights).map(error).sum();
    Some((coefficients, error))
}
