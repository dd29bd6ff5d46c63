//! Requested fits, their results with errors, and notes on those that say little.

use std::str::FromStr;

use serde::Serialize;

use super::fit::{CHANCE, Fitted, Point, fit, student};
use super::models::Curve;
use super::smooth::{Sample, Smoothing};
use super::units::{unit, with_digits, with_error};

/// A requested fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitRequest {
    /// The curve.
    pub curve: Curve,
    /// The coordinate: 0 for x, 1 for y.
    pub axis: usize,
    /// First and last time, seconds; `None` for all.
    pub range: Option<(f64, f64)>,
}

impl FitRequest {
    /// Returns the request as on the command line.
    pub fn name(&self) -> String {
        let range = self.range.map_or(String::new(), |(from, to)| format!(":{from}-{to}"));
        format!("{}:{}{range}", self.curve.name(), AXES[self.axis])
    }
}

impl FromStr for FitRequest {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let numbers = |range: &str| {
            let (from, to) = range.split_once('-')?;
            let number = |n: &str| n.trim().parse().ok().filter(|n: &f64| n.is_finite());
            number(from).zip(number(to)).filter(|(from, to)| from < to)
        };
        let parsed = || {
            let mut parts = text.split(':');
            let (name, axis, range) = (parts.next()?, parts.next()?, parts.next());
            let (_, curve) = *Curve::ALL.iter().find(|(known, _)| *known == name)?;
            let axis = AXES.iter().position(|known| *known == axis)?;
            let range = range.map(|range| numbers(range).ok_or(())).transpose().ok()?;
            parts.next().is_none().then_some(Self { curve, axis, range })
        };
        let known = Curve::ALL.map(|(name, _)| name).join(", ");
        parsed().ok_or_else(|| {
            format!("expected CURVE:x or CURVE:y, with :FROM-TO for the seconds FROM to a later TO; the curves are {known}; got \"{text}\"")
        })
    }
}

/// The names of the coordinates.
pub const AXES: [&str; 2] = ["x", "y"];

/// A parameter with its standard error.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Value {
    /// Its name in the formula.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its standard error, with those of scale and clock.
    pub error: f64,
    /// The 95 % interval; an end may be infinite, which is null in JSON.
    pub interval: [f64; 2],
    /// Its unit.
    pub unit: String,
}

/// The result of a fit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fit {
    /// The name of the point.
    pub point: String,
    /// The request as on the command line.
    pub fit: String,
    /// The formula.
    pub formula: &'static str,
    /// The time at which t of the formula is 0, seconds.
    pub t0: f64,
    /// The parameters, then the quantities derived from them.
    pub values: Vec<Value>,
    /// Number of points.
    pub points: usize,
    /// Root mean square of the residuals.
    pub rms: f64,
    /// Unit of the residuals.
    pub unit: &'static str,
    /// The correlation of the residuals from one frame to the next.
    pub correlation: f64,
    /// The coordinate, 0 or 1, and the curve.
    #[serde(skip)]
    pub curve: (usize, Curve),
    /// Times, data and residuals of the points.
    #[serde(skip)]
    pub data: Vec<(f64, f64, f64)>,
}

impl Fit {
    /// Returns the value of the curve at a time.
    pub fn at(&self, time: f64) -> f64 {
        let values: Vec<f64> = self.values.iter().map(|value| value.value).collect();
        self.curve.1.at(&values, time - self.t0)
    }

    /// Returns the number of steps in which to draw the curve over `span` seconds: 16 a period T, at least 300, at most 20,000.
    pub fn steps(&self, span: f64) -> usize {
        let period =
            self.values.iter().find(|value| value.name == "T").map_or(f64::INFINITY, |value| value.value.abs());
        ((16.0 * span / period).ceil() as usize).clamp(300, 20_000)
    }
}

/// What all fits of a point have in common.
pub(super) struct Fitting<'a> {
    /// The name of the point.
    pub point: &'a str,
    /// Unit of length: m or px.
    pub length: &'static str,
    /// Relative standard errors of all lengths and of all times.
    pub relative: [f64; 2],
}

impl Fitting<'_> {
    /// Fits the samples of x and y, with variances inflated by the smoothing. Returns the results, and a sentence for each fit that failed,
    /// that is no better than a constant, or whose decay is none.
    pub(super) fn fits(
        &self,
        requests: &[FitRequest],
        samples: &[Vec<Sample>; 2],
        smoothing: &[Smoothing; 2],
    ) -> (Vec<Fit>, Vec<String>) {
        let (mut fits, mut notes) = (vec![], vec![]);
        for request in requests {
            let inside = |t: f64| request.range.is_none_or(|(from, to)| (from..=to).contains(&t));
            let (samples, smoothing) = (&samples[request.axis], &smoothing[request.axis]);
            let of = samples.iter().zip(&smoothing.inflation).filter(|(sample, _)| inside(sample.time));
            let points: Vec<Point> =
                of.filter_map(|(s, factor)| s.measured.map(|(y, variance)| (s.time, y, factor * variance))).collect();
            match fit(request.curve, &points) {
                Ok(fitted) => {
                    if let Some(chance) = fitted.by_chance.filter(|chance| *chance >= CHANCE) {
                        notes.push(format!(
                            "No oscillation {}: errors about a constant fit as well with a probability of up to {chance:.2}.",
                            request.name()
                        ));
                    }
                    if let Some((tau, simpler)) = undamped(request.curve, &fitted) {
                        notes.push(format!(
                            "No decay {}: the 95 % interval of tau ({tau:.3} s) has no upper end. Fit {simpler}.",
                            request.name()
                        ));
                    }
                    fits.push(self.result(request, &points, &fitted));
                }
                Err(problem) => notes.push(format!("No fit {}: {problem}.", request.name())),
            }
        }
        (fits, notes)
    }

    fn result(&self, request: &FitRequest, points: &[Point], fitted: &Fitted) -> Fit {
        let (curve, quantile) = (request.curve, student(fitted.freedom));
        // Standard error and 95 % half width: the data have a t distribution, scale and clock a normal one.
        let value = |name: &str, value: f64, variance: f64, exponents: (i32, i32)| {
            let common = (value * f64::from(exponents.0) * self.relative[0])
                .hypot(value * f64::from(exponents.1) * self.relative[1]);
            let half = (quantile * variance.sqrt()).hypot(1.96 * common);
            let error = variance.sqrt().hypot(common);
            Value {
                name: name.into(),
                value,
                error,
                interval: [value - half, value + half],
                unit: unit(self.length, exponents),
            }
        };
        let (p, c) = (&fitted.values, &fitted.covariance);
        let of = |(i, (name, length, time)): (usize, &(&str, i32, i32))| {
            let mut value = value(name, p[i], c[i][i], (*length, *time));
            if *name == "tau" {
                value.interval = reciprocal(value.value, value.interval[1] - value.value);
            }
            value
        };
        let mut values: Vec<Value> = curve.parameters().iter().enumerate().map(of).collect();
        match (curve, request.axis) {
            (Curve::Parabola, 1) => values.push(value("g", -p[2], c[2][2], (1, -2))),
            // The acceleration at rest is v_end / tau.
            (Curve::Drag, 1) => {
                let slope = [1.0 / p[3], -p[2] / (p[3] * p[3])];
                let both = 2.0 * slope[0] * slope[1] * c[2][3];
                let variance = slope[0] * slope[0] * c[2][2] + slope[1] * slope[1] * c[3][3] + both;
                values.push(value("g", -p[2] / p[3], variance, (1, -2)));
            }
            _ => {}
        }
        let data: Vec<_> = points.iter().zip(&fitted.residuals).map(|(p, r)| (p.0, p.1, *r)).collect();
        let rms = (fitted.residuals.iter().map(|r| r * r).sum::<f64>() / points.len() as f64).sqrt();
        Fit {
            point: self.point.to_owned(),
            fit: request.name(),
            formula: curve.formula(),
            t0: fitted.t0,
            values,
            points: points.len(),
            rms,
            unit: self.length,
            correlation: fitted.correlation,
            curve: (request.axis, curve),
            data,
        }
    }
}

/// Returns the time constant of a curve whose points are compatible with an infinite one, by the interval of 1 / tau, and the curve without.
fn undamped(curve: Curve, fitted: &Fitted) -> Option<(f64, &'static str)> {
    let simpler = match curve {
        Curve::Drag => Curve::Parabola,
        Curve::Damped => Curve::Sine,
        Curve::Exponential => Curve::Line,
        Curve::Line | Curve::Parabola | Curve::Sine => return None,
    };
    let k = curve.parameters().iter().position(|(name, ..)| *name == "tau")?;
    let (tau, error) = (fitted.values[k], fitted.covariance[k][k].sqrt());
    (student(fitted.freedom) * error >= tau.abs()).then_some((tau, simpler.name()))
}

/// Returns the interval of a time constant, from that of its reciprocal, whose errors are normal: a decay that may be none has no upper end.
fn reciprocal(tau: f64, half: f64) -> [f64; 2] {
    let (rate, half) = (1.0 / tau, half / (tau * tau));
    match [rate - half, rate + half] {
        [low, high] if low > 0.0 || high < 0.0 => [1.0 / high, 1.0 / low],
        [_, high] if tau > 0.0 => [1.0 / high, f64::INFINITY],
        [low, _] => [f64::NEG_INFINITY, 1.0 / low],
    }
}

impl Value {
    /// Returns the value with its standard error, unit and 95 % interval.
    pub fn text(&self) -> String {
        let [low, high] = self.interval;
        let Self { name, value, error, unit, .. } = self;
        let (value, rounded) = (with_error(*value, *error), |end| with_digits(end, *error));
        let interval = match (low.is_finite(), high.is_finite()) {
            (true, true) => format!("{} to {}", rounded(low), rounded(high)),
            (true, false) => format!("{} or more", rounded(low)),
            _ => format!("{} or less", rounded(high)),
        };
        format!("{name} = {value} {unit} (95 %: {interval})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_read_or_refused() {
        for text in ["parabola:y:0.1-0.45", "sine:x"] {
            assert_eq!(text.parse::<FitRequest>().map(|fit| fit.name()), Ok(text.to_owned()));
        }
        for wrong in ["cubic:y", "line", "line:z", "line:x:2-1", "line:x:1-2:3"] {
            assert!(wrong.parse::<FitRequest>().is_err_and(|problem| problem.contains("parabola")), "{wrong}");
        }
    }

    #[test]
    fn a_drawn_curve_has_enough_steps_a_period() {
        let fitting = Fitting { point: "1", length: "m", relative: [0.0; 2] };
        let steps = |curve: Curve, period: f64, span: f64| {
            let points: Vec<Point> =
                (0..60).map(|k| f64::from(k) / 20.0).map(|t| (t, (6.0 * t / period).sin(), 1e-4)).collect();
            let fitted = fit(curve, &points).expect("enough points");
            let fit = fitting.result(&FitRequest { curve, axis: 0, range: None }, &points, &fitted);
            let period = fit.values.iter().find(|value| value.name == "T").map(|value| value.value);
            (fit.steps(span), period)
        };
        let (many, period) = steps(Curve::Sine, 1.0, 150.0);
        assert!(many as f64 >= 16.0 * 150.0 / period.expect("a period") && many < 3000, "{many}");
        assert_eq!(steps(Curve::Sine, 1.0, 1.0).0, 300);
        assert_eq!(steps(Curve::Sine, 1.0, 1e6).0, 20_000);
        assert_eq!(steps(Curve::Line, 1.0, 1e6).0, 300);
    }

    /// A fall without drag has no time constant, a fall in syrup has one.
    #[test]
    fn a_fall_without_drag_has_no_time_constant() {
        for (tau, simpler) in [(1e6, Some("parabola")), (0.2, None)] {
            let point = |k: u32| {
                let (t, error) = (f64::from(k) / 30.0, 0.003 * f64::from(k * 7919 % 13) - 0.018);
                (t, Curve::Drag.at(&[1.0, 0.0, -9.81 * tau, tau], t) + error, 1e-4)
            };
            let points: Vec<Point> = (0..30).map(point).collect();
            let fitted = fit(Curve::Drag, &points).expect("enough points");
            assert_eq!(undamped(Curve::Drag, &fitted).map(|found| found.1), simpler, "{fitted:?}");
            let request = FitRequest { curve: Curve::Drag, axis: 1, range: None };
            let fitting = Fitting { point: "1", length: "m", relative: [0.0; 2] };
            let values = fitting.result(&request, &points, &fitted).values;
            let it = values.iter().find(|value| value.name == "tau").expect("a time constant");
            let [low, high] = it.interval;
            assert!(0.0 < low && low < it.value && it.value < high, "{it:?}");
            assert_eq!(
                (high.is_infinite(), it.text().contains("or more")),
                (simpler.is_some(), simpler.is_some()),
                "{it:?}"
            );
        }
    }
}
