//! A measurement: smoothed motion in units, and fits.

use std::str::FromStr;

use foveate_base::{Error, Result};
use serde::Serialize;

use super::ask::{self, Ask};
use super::fit::{CHANCE, Fitted, Point, fit, student};
use super::lens::Lens;
use super::models::Curve;
use super::smooth::{Sample, Smoothed, Smoothing, median, smooth};
use super::track::{Position, Track};
use super::units::{Axes, Clock, unit, with_digits, with_error};

/// The smallest standard deviation of a position, pixels.
const FINEST: f64 = 1e-3;

/// The part of the reported standard deviation that persists over many frames: a tracker follows a point beside the centre. It looks like
/// motion, or is constant, so that no smoothing removes it; it enters the error of the position alone. In 50 simulated films of balls
/// (`bench/measure.py`) it makes the 50, 90 and 95 % bands hold the truth in about that share of the frames.
const PERSISTENT: f64 = 0.28;

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
            format!("expected CURVE:x or CURVE:y, with :FROM-TO for a range; the curves are {known}; got \"{text}\"")
        })
    }
}

/// The names of the coordinates.
pub const AXES: [&str; 2] = ["x", "y"];

/// Units, axes, clock and fits of a measurement.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settings {
    /// The coordinate system.
    pub axes: Axes,
    /// The lens, whose distortion is removed from all positions and points.
    pub lens: Option<Lens>,
    /// A frame rate that replaces the times of the source.
    pub clock: Option<Clock>,
    /// The fits.
    pub fits: Vec<FitRequest>,
}

/// One frame of a measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// From 1.
    pub frame: usize,
    /// Seconds.
    pub time: f64,
    /// The tracked coordinates; `None` if the target was lost or occluded.
    pub measured: Option<[f64; 2]>,
    /// The tracked centre and the origin in this frame, pixels from 0, without the distortion of the lens.
    pub pixels: [(f64, f64); 2],
    /// Smoothed x and y.
    pub smoothed: [Smoothed; 2],
    /// Probability that the target is lost, 0 to 1.
    pub p_lost: f64,
    /// Track status.
    pub status: String,
}

/// A parameter with its standard error.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Value {
    /// Its name in the formula.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its standard error, with those of scale and clock.
    pub error: f64,
    /// The 95 % interval.
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
}

/// The measurement of a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// The name of the point.
    pub point: String,
    /// The coordinate system, without the distortion of the lens; its origin is known.
    pub axes: Axes,
    /// Whether the distortion of a lens was removed.
    pub straightened: bool,
    /// Unit of length: m or px.
    pub unit: &'static str,
    /// The frame rate that replaced the times of the source.
    pub clock: Option<Clock>,
    /// Relative standard errors of all lengths and of all times.
    pub relative: [f64; 2],
    /// From the first to the last frame with a position.
    pub rows: Vec<Row>,
    /// The smoothing of x and y.
    pub smoothing: [Smoothing; 2],
    /// The fits.
    pub fits: Vec<Fit>,
    /// The frames to look at, most doubtful first.
    pub ask: Vec<Ask>,
    /// Fits that failed, that are no better than a constant, or whose decay is none: whole sentences.
    pub fit_notes: Vec<String>,
    /// Other notes: whole sentences.
    pub notes: Vec<String>,
}

/// Measures the motion of points in common coordinates. Positions are relative to the reference track, if there is one. All tracks have
/// the same frames. The first position of the first point is the origin, if none is given.
///
/// # Errors
/// There is no point; a track has too few positions, or times that do not increase; or the lens shows no point at an end of the ruler or at
/// the origin.
pub fn measure(points: &[Track], reference: Option<&[Position]>, settings: &Settings) -> Result<Vec<Measurement>> {
    let lens = settings.lens.as_ref();
    let straight = |track: &[Position]| match lens {
        Some(lens) => track.iter().map(|p| lens.straighten(p)).collect(),
        None => track.to_vec(),
    };
    let axes = lens.map_or(Ok(settings.axes), |lens| settings.axes.straighten(lens))?;
    let mut settings = Settings { axes, ..settings.clone() };
    let reference = reference.map(straight);
    let mut all: Vec<Measurement> = vec![];
    for Track { name, positions } in points {
        let measured = measure_point(name, &straight(positions), reference.as_deref(), &settings);
        let measured = measured.map_err(|error| match points.len() {
            1 => error,
            _ => Error::Invalid(format!("point {name}: {error}")),
        })?;
        settings.axes = measured.axes;
        all.push(measured);
    }
    if all.is_empty() {
        return Err(Error::Invalid("there is no point; there is nothing to measure".into()));
    }
    Ok(all)
}

/// Measures a track whose lens has no distortion, like that of the ruler and the origin.
fn measure_point(
    name: &str,
    track: &[Position],
    reference: Option<&[Position]>,
    settings: &Settings,
) -> Result<Measurement> {
    let usable = |k: usize| track[k].usable && reference.is_none_or(|other| other.get(k).is_some_and(|p| p.usable));
    let all: Vec<usize> = (0..track.len()).filter(|k| usable(*k)).collect();
    let (Some(&first), Some(&last)) = (all.first(), all.last()) else {
        return Err(Error::Invalid("the target was found in no frame; there is nothing to measure".into()));
    };
    let given = usual(track);
    let given_reference = reference.map_or([0.0; 3], usual);
    // Relative to the reference, which stays at its first position.
    let start = reference.map(|other| other[first].centre);
    let place = |k: usize| {
        let (mut centre, mut covariance) = (track[k].centre, track[k].covariance.unwrap_or(given));
        if let (Some(other), Some(start)) = (reference, start) {
            let moved = other[k].centre;
            centre = (centre.0 - moved.0 + start.0, centre.1 - moved.1 + start.1);
            let theirs = other[k].covariance.unwrap_or(given_reference);
            covariance = std::array::from_fn(|i| covariance[i] + theirs[i]);
        }
        covariance[0] = covariance[0].max(FINEST * FINEST);
        covariance[2] = covariance[2].max(FINEST * FINEST);
        (centre, covariance)
    };
    let origin = settings.axes.origin.unwrap_or(place(first).0);
    let axes = &Axes { origin: Some(origin), ..settings.axes };
    let time = |position: &Position| match settings.clock {
        Some(clock) => (position.frame as f64 - 1.0) / clock.rate,
        None => position.time,
    };
    let frames = &track[first..=last];
    let mut samples: [Vec<Sample>; 2] = Default::default();
    let mut measured = vec![];
    for (k, position) in (first..).zip(frames) {
        let found = usable(k).then(|| {
            let (centre, covariance) = place(k);
            axes.apply((centre.0 - origin.0, centre.1 - origin.1), covariance)
        });
        measured.push(found.map(|(value, _)| value));
        for (i, samples) in samples.iter_mut().enumerate() {
            let measured = found.map(|(value, variance)| (value[i], variance[i]));
            samples.push(Sample { time: time(position), measured });
        }
    }
    let smoothing = [smooth(&samples[0])?, smooth(&samples[1])?];
    let persistent = [0, 1].map(|i| {
        let variances = samples[i].iter().filter_map(|sample| sample.measured.map(|(_, variance)| variance));
        PERSISTENT * median(variances).sqrt()
    });
    let smoothed = |i: usize, k: usize| {
        let Smoothed { value, sd: [position, velocity, acceleration] } = smoothing[i].frames[k];
        Smoothed { value, sd: [position.hypot(persistent[i]), velocity, acceleration] }
    };
    let moved = |k: usize| match (reference.and_then(|other| other.get(k)), start) {
        (Some(position), Some(start)) => {
            (origin.0 + position.centre.0 - start.0, origin.1 + position.centre.1 - start.1)
        }
        _ => origin,
    };
    let row = |(k, position): (usize, &Position)| Row {
        frame: position.frame,
        time: time(position),
        measured: measured[k],
        pixels: [position.centre, moved(first + k)],
        smoothed: [0, 1].map(|i| smoothed(i, k)),
        p_lost: position.p_lost,
        status: position.status.clone(),
    };
    let rows: Vec<Row> = frames.iter().enumerate().map(row).collect();
    let relative = [axes.error(), settings.clock.map_or(0.0, |clock| clock.error / clock.rate)];
    let (mut fits, mut fit_notes) = (vec![], vec![]);
    for request in &settings.fits {
        let inside = |t: f64| request.range.is_none_or(|(from, to)| (from..=to).contains(&t));
        let (samples, smoothing) = (&samples[request.axis], &smoothing[request.axis]);
        let of = samples.iter().zip(&smoothing.inflation).filter(|(sample, _)| inside(sample.time));
        let points: Vec<Point> =
            of.filter_map(|(s, factor)| s.measured.map(|(y, variance)| (s.time, y, factor * variance))).collect();
        match fit(request.curve, &points) {
            Ok(fitted) => {
                if let Some(chance) = fitted.by_chance.filter(|chance| *chance >= CHANCE) {
                    fit_notes.push(format!(
                        "No oscillation {}: errors about a constant fit as well with a probability of up to {chance:.2}.",
                        request.name()
                    ));
                }
                if let Some((tau, simpler)) = undamped(request.curve, &fitted) {
                    fit_notes.push(format!(
                        "No decay {}: the 95 % interval of tau ({tau:.3} s) has no upper end. Fit {simpler}.",
                        request.name()
                    ));
                }
                fits.push(result(name, request, &points, &fitted, (axes.unit(), relative)));
            }
            Err(problem) => fit_notes.push(format!("No fit {}: {problem}.", request.name())),
        }
    }
    let leaps = |k: &usize| smoothing.iter().any(|smoothing| smoothing.inflation[*k] > 1.0);
    let leaps: Vec<usize> = (0..frames.len()).filter(leaps).map(|k| first + k).collect();
    let ask = ask::ask(track, &leaps);
    let notes = ask::note(&ask).into_iter().collect();
    let (point, straightened, clock) = (name.to_owned(), settings.lens.is_some(), settings.clock);
    let (axes, unit) = (*axes, axes.unit());
    Ok(Measurement { point, axes, straightened, unit, clock, relative, rows, smoothing, fits, fit_notes, ask, notes })
}

/// Returns the usual covariance of a track, for frames whose box was given.
fn usual(track: &[Position]) -> [f64; 3] {
    let known = |i: usize| median(track.iter().filter_map(|position| position.covariance.map(|c| c[i])));
    [known(0), 0.0, known(2)]
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

fn result(
    point: &str,
    request: &FitRequest,
    points: &[Point],
    fitted: &Fitted,
    (length, relative): (&'static str, [f64; 2]),
) -> Fit {
    let (curve, quantile) = (request.curve, student(fitted.freedom));
    // Standard error and 95 % half width: the data have a t distribution, scale and clock a normal one.
    let value = |name: &str, value: f64, variance: f64, exponents: (i32, i32)| {
        let common = (value * f64::from(exponents.0) * relative[0]).hypot(value * f64::from(exponents.1) * relative[1]);
        let half = (quantile * variance.sqrt()).hypot(1.96 * common);
        let error = variance.sqrt().hypot(common);
        Value { name: name.into(), value, error, interval: [value - half, value + half], unit: unit(length, exponents) }
    };
    let (p, c) = (&fitted.values, &fitted.covariance);
    let of = |(i, (name, length, time)): (usize, &(&str, i32, i32))| value(name, p[i], c[i][i], (*length, *time));
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
        point: point.to_owned(),
        fit: request.name(),
        formula: curve.formula(),
        t0: fitted.t0,
        values,
        points: points.len(),
        rms,
        unit: length,
        correlation: fitted.correlation,
        curve: (request.axis, curve),
        data,
    }
}

impl Value {
    /// Returns the value with its standard error, unit and 95 % interval.
    pub fn text(&self) -> String {
        let [low, high] = self.interval;
        let Self { name, value, error, unit, .. } = self;
        let (value, rounded) = (with_error(*value, *error), |end| with_digits(end, *error));
        format!("{name} = {value} {unit} (95 %: {} to {})", rounded(low), rounded(high))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::units::Ruler;
    use super::*;
    use foveate_base::rng::Streams;
    use rand::RngExt;
    use rand_distr::StandardNormal;

    /// A ball that falls from rest with 9.81 m/s² at 100 px/m and 50 frames/s; lost in two frames.
    pub(in super::super) fn falling(angle: f64) -> Vec<Position> {
        let (sin, cos) = f64::to_radians(angle).sin_cos();
        let at = |k: usize| {
            let t = k as f64 / 50.0;
            let fallen = 100.0 * 4.905 * t * t + 0.02 * [1.0, -1.0, 0.5, -0.5][k % 4];
            let lost = (12..14).contains(&k);
            Position {
                frame: k + 1,
                time: t,
                centre: (80.0 + fallen * sin, 40.0 + fallen * cos),
                covariance: (k > 0).then_some([0.04, 0.0, 0.04]),
                p_lost: if lost { 0.9 } else { 0.01 },
                status: if lost { "lost" } else { "tracking" }.into(),
                usable: !lost,
            }
        };
        (0..30).map(at).collect()
    }

    /// The measurement of one point.
    pub(in super::super) fn measured(
        track: &[Position],
        reference: Option<&[Position]>,
        settings: &Settings,
    ) -> Result<Measurement> {
        let point = Track { name: "1".into(), positions: track.to_vec() };
        measure(&[point], reference, settings).map(|mut all| all.remove(0))
    }

    pub(in super::super) fn settings() -> Settings {
        let ruler = Some(Ruler { ends: [(0.0, 0.0), (0.0, 400.0)], length: 4.0, error: 0.0 });
        let range = Some((0.1, 0.5));
        Settings {
            axes: Axes { ruler, ..Axes::default() },
            lens: None,
            clock: None,
            fits: vec![
                FitRequest { curve: Curve::Parabola, axis: 1, range: None },
                FitRequest { curve: Curve::Drag, axis: 0, range },
            ],
        }
    }

    #[test]
    fn free_fall_gives_g_in_any_direction() {
        for angle in [0.0, 30.0] {
            let mut settings = settings();
            settings.axes.angle = angle;
            let measured = measured(&falling(angle), None, &settings).expect("a measurement");
            let g = measured.fits[0].values.last().expect("g");
            assert_eq!((g.name.as_str(), g.unit.as_str()), ("g", "m/s²"));
            assert!((g.value - 9.81).abs() < 0.02 && g.interval[0] < 9.81 && 9.81 < g.interval[1], "{g:?}");
            // Two points half a pixel off 400 px apart: 0.18 % of g at least.
            assert!(g.error > 0.017 && g.error < 0.03, "{g:?}");
            assert!((measured.rows[20].smoothed[1].value[2] + 9.81).abs() < 0.5);
            assert!(measured.rows[12].measured.is_none());
        }
    }

    /// A fall without drag has no time constant, a fall in syrup has one.
    #[test]
    fn a_fall_without_drag_has_no_time_constant() {
        for (tau, simpler) in [(1e6, Some("parabola")), (0.2, None)] {
            let point = |k: u32| {
                let (t, error) = (f64::from(k) / 30.0, 0.003 * f64::from(k * 7919 % 13) - 0.018);
                (t, Curve::Drag.at(&[1.0, 0.0, -9.81 * tau, tau], t) + error, 1e-4)
            };
            let fitted = fit(Curve::Drag, &(0..30).map(point).collect::<Vec<_>>()).expect("enough points");
            assert_eq!(undamped(Curve::Drag, &fitted).map(|found| found.1), simpler, "{fitted:?}");
        }
    }

    #[test]
    fn a_clock_scales_times_and_its_error_counts_twice_in_g() {
        let clock = Some(Clock { rate: 100.0, error: 1.0 });
        let measured = measured(&falling(0.0), None, &Settings { clock, ..settings() }).expect("a measurement");
        let g = measured.fits[0].values.last().expect("g");
        assert!((g.value - 4.0 * 9.81).abs() < 0.1, "twice the rate, four times g: {g:?}");
        assert!((g.error / g.value - 0.02).abs() < 0.001, "{g:?}");
    }

    /// A camera that pans moves the target and the reference alike.
    #[test]
    fn a_reference_removes_the_motion_of_the_camera() {
        let still = falling(0.0);
        let pan = |k: usize| (3.0 * k as f64, 20.0 * (k as f64 / 5.0).sin());
        let moved = |(k, p): (usize, &Position)| {
            let by = pan(k);
            Position { centre: (p.centre.0 + by.0, p.centre.1 + by.1), ..p.clone() }
        };
        let track: Vec<Position> = still.iter().enumerate().map(moved).collect();
        let fixed = |p: &Position| Position { centre: (200.0, 50.0), usable: true, ..p.clone() };
        let reference: Vec<Position> = still.iter().map(fixed).enumerate().map(|(k, p)| moved((k, &p))).collect();
        let [plain, relative] = [measured(&still, None, &settings()), measured(&track, Some(&reference), &settings())]
            .map(|measured| measured.expect("a measurement"));
        for (a, b) in plain.rows.iter().zip(&relative.rows) {
            assert!((a.smoothed[1].value[0] - b.smoothed[1].value[0]).abs() < 1e-3);
        }
        let g = relative.fits[0].values.last().expect("g");
        assert!((g.value - 9.81).abs() < 0.02, "{g:?}");
    }

    /// The pictures of a lens that bends give, with its calibration, the fall without it; without, g is off.
    #[test]
    fn a_lens_is_taken_out_of_positions_and_ruler() {
        let lens = Lens::simple([300.0, 300.0], [80.0, 40.0], -0.2);
        let bent = |p: &(f64, f64)| {
            let (x, y) = ((p.0 - 80.0) / 300.0, (p.1 - 40.0) / 300.0);
            let factor = 1.0 - 0.2 * (x * x + y * y);
            (80.0 + 300.0 * x * factor, 40.0 + 300.0 * y * factor)
        };
        let shown = |p: Position| Position { centre: bent(&p.centre), ..p };
        let track: Vec<Position> = falling(0.0).into_iter().map(shown).collect();
        let mut settings = settings();
        settings.axes.ruler =
            settings.axes.ruler.map(|ruler| Ruler { ends: [bent(&(0.0, 0.0)), bent(&(0.0, 400.0))], ..ruler });
        let g = |lens: Option<Lens>| {
            let measured = measured(&track, None, &Settings { lens, ..settings.clone() }).expect("a measurement");
            measured.fits[0].values.last().expect("g").value
        };
        assert!((g(Some(lens)) - 9.81).abs() < 0.02, "{}", g(Some(lens)));
        assert!((g(None) - 9.81).abs() > 0.3, "{}", g(None));
    }

    #[test]
    fn lost_frames_are_asked_for() {
        let measured = measured(&falling(0.0), None, &settings()).expect("a measurement");
        assert_eq!((measured.ask[0].stretch, measured.ask[0].reason), ([13, 14], "lost"));
        assert!(measured.notes.iter().any(|note| note.contains("first frame 13 of 13 to 14")), "{:?}", measured.notes);
    }

    /// The frames of a drawn film can be exact: there is no error to give the digits.
    #[test]
    fn values_without_an_error_have_short_texts() {
        let still: Vec<Position> = falling(0.0).into_iter().map(|p| Position { centre: (5.0, 5.0), ..p }).collect();
        let measured = measured(&still, None, &settings()).expect("a measurement");
        assert!(measured.fits[0].values.iter().all(|value| value.text().len() < 40), "{:?}", measured.text());
    }

    #[test]
    fn requests_are_read_or_refused() {
        for text in ["parabola:y:0.1-0.45", "sine:x"] {
            assert_eq!(text.parse::<FitRequest>().map(|fit| fit.name()), Ok(text.to_owned()));
        }
        for wrong in ["cubic:y", "line", "line:z", "line:x:2-1", "line:x:1-2:3"] {
            assert!(wrong.parse::<FitRequest>().is_err_and(|problem| problem.contains("parabola")), "{wrong}");
        }
    }

    /// The errors of a thing at rest are no oscillation; a fit that is better than a constant has no such note.
    #[test]
    fn an_oscillation_of_errors_is_a_note() {
        let fits = vec![FitRequest { curve: Curve::Sine, axis: 0, range: None }];
        let notes = |swing: f64| {
            let mut rng = Streams::new(8, 0).rng(1);
            let mut error = || 0.1 * rng.sample::<f64, _>(StandardNormal);
            let mut centre = |k: usize| (80.0 + swing * (k as f64 / 3.0).sin() + error(), 40.0);
            let at = |(k, p): (usize, Position)| Position { centre: centre(k), ..p };
            let track: Vec<Position> = falling(0.0).into_iter().enumerate().map(at).collect();
            let measured = measured(&track, None, &Settings { fits: fits.clone(), ..settings() });
            measured.expect("a measurement").fit_notes
        };
        let is_doubted = |notes: Vec<String>| notes.iter().any(|note| note.starts_with("No oscillation sine:x:"));
        assert!(is_doubted(notes(0.0)) && !is_doubted(notes(20.0)), "{:?} {:?}", notes(0.0), notes(20.0));
    }

    #[test]
    fn a_fit_that_fails_is_a_note() {
        let fits = vec![FitRequest { curve: Curve::Sine, axis: 0, range: Some((0.1, 0.12)) }];
        let failed = measured(&falling(0.0), None, &Settings { fits, ..settings() }).expect("a measurement");
        assert!(
            failed.fits.is_empty() && failed.fit_notes[0].contains("No fit sine:x:0.1-0.12"),
            "{:?}",
            failed.fit_notes
        );
        assert!(measured(&[], None, &settings()).expect_err("empty").to_string().contains("no frame"));
    }
}
