//! Selection and metrics, as functions of arrays; the Python modules have their interfaces.

use foveate::control::Resampling;
use foveate::rng::{Purpose, Streams};
use foveate::video::mot::{TrackBox, Tracks};
use foveate::{BBox, Error, memory};
use numpy::ndarray::ArrayView2;
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use serde_json::json;

use crate::errors::{OrRaise, input};

/// For each of `count` places of the next step, the index of the particle that takes it; ascending.
#[pyfunction]
pub(crate) fn select<'py>(
    py: Python<'py>,
    weights: PyReadonlyArray1<'py, f64>,
    count: usize,
    scheme: &str,
    seed: u64,
    step: u64,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let scheme = serde_json::from_value(json!(scheme)).map_err(|e| input(py, format!("resampling: {e}")))?;
    let weights = weights.as_array().to_vec();
    let sum: f64 = weights.iter().sum();
    if weights.iter().any(|w| !(w.is_finite() && *w >= 0.0)) || !(sum > 0.0 && sum.is_finite()) || count == 0 {
        return Err(input(py, "weights to select from are finite, at least 0, not all 0, for one place at least"));
    }
    // Counts this array and the returned one.
    memory::check(format_args!("{count} places"), (count as u64).saturating_mul(16)).or_raise(py)?;
    let mut ancestors = vec![0; count];
    let mut rng = Streams::new(seed, 0).at(step, Purpose::Select).rng(0);
    py.detach(|| Resampling { scheme, below: 1.0 }.select(&weights, &mut ancestors, &mut rng));
    Ok(PyArray1::from_iter(py, ancestors.into_iter().map(|i| i as i64)))
}

fn boxes(rows: ArrayView2<'_, f64>) -> Vec<Option<BBox>> {
    let one = |r: numpy::ndarray::ArrayView1<'_, f64>| {
        r.iter().all(|v| v.is_finite()).then(|| BBox::new(r[0], r[1], r[2], r[3]))
    };
    rows.rows().into_iter().map(one).collect()
}

/// Returns the scores and curves of one track, as JSON.
#[pyfunction]
pub(crate) fn score_ope(
    py: Python<'_>,
    found: PyReadonlyArray2<'_, f64>,
    truth: PyReadonlyArray2<'_, f64>,
) -> PyResult<String> {
    let (score, curves) =
        foveate::lab::eval::metrics::score(&boxes(found.as_array()), &boxes(truth.as_array())).or_raise(py)?;
    Ok(json!({ "score": score, "curves": curves }).to_string())
}

fn tracks(rows: ArrayView2<'_, f64>) -> Tracks {
    let one = |r: numpy::ndarray::ArrayView1<'_, f64>| TrackBox {
        frame: r[0] as usize,
        id: r[1] as i64,
        bbox: BBox::new(r[2], r[3], r[4], r[5]),
        confidence: r[6],
    };
    Tracks { sightings: rows.rows().into_iter().map(one).collect() }
}

/// Returns the scores of many targets, as JSON. Rows: frame, id, left, top, width, height, confidence.
#[pyfunction]
pub(crate) fn score_mot(
    py: Python<'_>,
    found: PyReadonlyArray2<'_, f64>,
    truth: PyReadonlyArray2<'_, f64>,
) -> PyResult<String> {
    let (truth, found) = (tracks(truth.as_array()), tracks(found.as_array()));
    let score = py.detach(|| foveate::lab::eval::mot::score(&truth, &found)).or_raise(py)?;
    serde_json::to_string(&score).map_err(|e| crate::errors::of(py, &Error::Invalid(e.to_string())))
}
