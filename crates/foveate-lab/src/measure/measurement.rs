//! A measurement: smoothed motion in units, and fits.

use foveate_base::{Error, Result};

use super::ask::{self, Ask};
use super::lens::Lens;
use super::requested::{Fit, FitRequest, Fitting};
use super::smooth::{Sample, Smoothed, Smoothing, median, smooth};
use super::track::{Position, Track};
use super::units::{Axes, Clock};

/// The smallest standard deviation of a position, pixels.
const FINEST: f64 = 1e-3;

/// The part of the reported standard deviation that persists over many frames: a tracker follows a point beside the centre. It looks like
/// motion, or is constant, so that no smoothing removes it; it enters the error of the position alone. In 50 simulated films of balls
/// (`bench/measure.py`) it makes the 50, 90 and 95 % bands hold the truth in about that share of the frames.
const PERSISTENT: f64 = 0.28;

/// Units, axes, clock and fits of a measurement.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settings {
    /// The coordinate system.
    pub axes: Axes,
    /// The lens, whose distortion is removed from all positions and points.
    pub lens: Option<Lens>,
    /// Width and height of the tracked pictures, if they are known.
    pub picture: Option<[usize; 2]>,
    /// A frame rate that replaces the times of the source.
    pub clock: Option<Clock>,
    /// The fits.
    pub fits: Vec<FitRequest>,
}

impl Settings {
    /// Checks that the lens was calibrated with pictures of this size.
    ///
    /// # Errors
    /// The sizes are known, and differ.
    pub fn check(&self) -> Result<()> {
        self.lens.as_ref().zip(self.picture).map_or(Ok(()), |(lens, picture)| lens.check(picture))
    }
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
    /// Whether positions are relative to a reference.
    pub referenced: bool,
    /// Width and height of the tracked pictures, if they are known.
    pub picture: Option<[usize; 2]>,
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
/// There is no point; a track has too few positions, or times that do not increase; the lens was calibrated with pictures of another size; or
/// it shows no point at an end of the ruler or at the origin.
pub fn measure(points: &[Track], reference: Option<&[Position]>, settings: &Settings) -> Result<Vec<Measurement>> {
    settings.check()?;
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
    // Relative to the reference, which stays at its first position: the same one for all points.
    let start = reference.and_then(|other| other.iter().find(|position| position.usable)).map(|first| first.centre);
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
    let fitting = Fitting { point: name, length: axes.unit(), relative };
    let (fits, fit_notes) = fitting.fits(&settings.fits, &samples, &smoothing);
    let leaps = |k: &usize| smoothing.iter().any(|smoothing| smoothing.inflation[*k] > 1.0);
    let leaps: Vec<usize> = (0..frames.len()).filter(leaps).map(|k| first + k).collect();
    let ask = ask::ask(track, reference, &leaps);
    let notes = ask::note(&ask).into_iter().collect();
    let (point, straightened, clock) = (name.to_owned(), settings.lens.is_some(), settings.clock);
    let (axes, unit) = (*axes, axes.unit());
    Ok(Measurement {
        point,
        axes,
        straightened,
        unit,
        clock,
        referenced: reference.is_some(),
        picture: settings.picture,
        relative,
        rows,
        smoothing,
        fits,
        fit_notes,
        ask,
        notes,
    })
}

/// Returns the usual covariance of a track, for frames whose box was given.
fn usual(track: &[Position]) -> [f64; 3] {
    let known = |i: usize| median(track.iter().filter_map(|position| position.covariance.map(|c| c[i])));
    [known(0), 0.0, known(2)]
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::models::Curve;
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
            picture: None,
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
