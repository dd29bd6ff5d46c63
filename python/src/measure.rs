//! Motion in metres and seconds, from tracks.

use std::path::PathBuf;

use foveate::lab::measure::{
    self, Axes, Clock, FitRequest, Lens, Measurement, Position, Ruler, Settings, Track, Value,
};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{OrRaise, input};

/// A frame of a track: index, seconds, centre, covariance (xx, xy, yy) unless the box was given, P(lost), status, and whether the position
/// is a result.
type Frame = (usize, f64, (f64, f64), Option<[f64; 3]>, f64, String, bool);

/// Lengths in the picture, metres and their error.
type Length = ([f64; 4], f64, f64);

/// Measures the motion of points: one dictionary of the fields of `foveate.Measurement` for each. With the lens comes the size of the pictures.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the settings of a measurement, by name in Python")]
pub(crate) fn measure_tracks<'py>(
    py: Python<'py>,
    points: Vec<(String, Vec<Frame>)>,
    reference: Option<Vec<Frame>>,
    ruler: Option<Length>,
    origin: Option<(f64, f64)>,
    angle: f64,
    clock: Option<(f64, f64)>,
    fits: Vec<String>,
    lens: Option<(PathBuf, [usize; 2])>,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let ruler = ruler.map(|([x1, y1, x2, y2], length, error)| Ruler { ends: [(x1, y1), (x2, y2)], length, error });
    if ruler.is_some_and(|ruler| ruler.scale().is_none()) {
        return Err(input(
            py,
            "ruler is (x1, y1, x2, y2, metres) or with its error: two points apart and a length above 0",
        ));
    }
    let clock = clock.map(|(rate, error)| Clock { rate, error });
    if clock.is_some_and(|clock| {
        !(clock.rate > 0.0 && clock.rate.is_finite() && (0.0..f64::INFINITY).contains(&clock.error))
    }) {
        return Err(input(py, "fps is a rate above 0, or such a rate and its error"));
    }
    if ![angle].into_iter().chain(origin.into_iter().flat_map(|(x, y)| [x, y])).all(f64::is_finite) {
        return Err(input(py, "origin and angle are finite numbers"));
    }
    let fits: Vec<FitRequest> =
        fits.iter().map(|fit| fit.parse()).collect::<Result<_, String>>().map_err(|problem| input(py, problem))?;
    let (lens, picture) = lens.unzip();
    let lens = lens.as_deref().map(Lens::read).transpose().or_raise(py)?;
    let settings = Settings { axes: Axes { ruler, origin, angle }, lens, picture, clock, fits };
    let position = |(frame, time, centre, covariance, p_lost, status, usable): Frame| Position {
        frame: frame + 1,
        time,
        centre,
        covariance,
        p_lost,
        status,
        usable,
    };
    let positions = |frames: Vec<Frame>| -> Vec<Position> { frames.into_iter().map(position).collect() };
    let points: Vec<Track> =
        points.into_iter().map(|(name, frames)| Track { name, positions: positions(frames) }).collect();
    let reference = reference.map(positions);
    let measured = py.detach(|| measure::measure(&points, reference.as_deref(), &settings)).or_raise(py)?;
    measured.iter().map(|point| fields(py, point)).collect()
}

/// Returns the fields of a measurement.
fn fields<'py>(py: Python<'py>, measured: &Measurement) -> PyResult<Bound<'py, PyDict>> {
    let rows = &measured.rows;
    let pairs = |of: &dyn Fn(&measure::Row) -> [f64; 2]| -> Bound<'py, PyArray2<f64>> {
        let values: Vec<f64> = rows.iter().flat_map(of).collect();
        Array2::from_shape_vec((rows.len(), 2), values).expect("two numbers a row").into_pyarray(py)
    };
    let dict = PyDict::new(py);
    dict.set_item("unit", measured.unit)?;
    dict.set_item("frame", rows.iter().map(|row| (row.frame - 1) as i64).collect::<Vec<_>>().into_pyarray(py))?;
    dict.set_item("time", rows.iter().map(|row| row.time).collect::<Vec<_>>().into_pyarray(py))?;
    for (i, name) in ["position", "velocity", "acceleration"].into_iter().enumerate() {
        dict.set_item(name, pairs(&|row| [0, 1].map(|axis| row.smoothed[axis].value[i])))?;
        dict.set_item(format!("sd_{name}"), pairs(&|row| [0, 1].map(|axis| row.smoothed[axis].sd[i])))?;
    }
    dict.set_item("tracked", pairs(&|row| row.measured.unwrap_or([f64::NAN; 2])))?;
    dict.set_item("p_lost", rows.iter().map(|row| row.p_lost).collect::<Vec<_>>().into_pyarray(py))?;
    dict.set_item("status", rows.iter().map(|row| row.status.as_str()).collect::<Vec<_>>())?;
    let fits = measured.fits.iter().map(|fit| {
        let values = fit.values.iter().map(|Value { name, value, error, interval: [low, high], unit }| {
            (name.as_str(), *value, *error, (*low, *high), unit.as_str())
        });
        (&fit.fit, fit.formula, fit.t0, values.collect::<Vec<_>>(), fit.points, fit.rms, fit.correlation)
    });
    dict.set_item("fits", fits.collect::<Vec<_>>())?;
    let ask = measured.ask.iter().map(|ask| {
        let [from, to] = ask.stretch.map(|frame| frame - 1);
        (ask.frame - 1, (from, to), ask.p_lost, ask.region, ask.reason)
    });
    dict.set_item("ask", ask.collect::<Vec<_>>())?;
    dict.set_item("notes", &measured.fit_notes)?;
    Ok(dict)
}
