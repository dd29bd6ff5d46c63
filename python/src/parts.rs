//! Selection, restricted Boltzmann machines and metrics, as functions of arrays; the Python modules beside have their protocols.

use foveate::control::Resampling;
use foveate::learn::rbm::{Negative, Rbm, Recipe, Trainer, Visible};
use foveate::rng::{Purpose, Streams};
use foveate::rows::{Rows, RowsMut};
use foveate::video::mot::{TrackBox, Tracks};
use foveate::{BBox, Error, Result};
use numpy::ndarray::{Array2, ArrayView2};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use serde_json::json;

use crate::errors::{OrRaise, input};

/// For each of `count` places of the next step, the index of the particle that takes it; ascending.
#[pyfunction]
pub fn select<'py>(
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
    let mut ancestors = vec![0; count];
    let mut rng = Streams::new(seed, 0).at(step, Purpose::Select).rng(0);
    py.detach(|| Resampling { scheme, below: 1.0 }.select(&weights, &mut ancestors, &mut rng));
    Ok(PyArray1::from_iter(py, ancestors.into_iter().map(|i| i as i64)))
}

fn kind(py: Python<'_>, visible: &str) -> PyResult<Visible> {
    serde_json::from_value(json!(visible)).map_err(|e| input(py, format!("visible: {e}")))
}

type Machine<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<f32>>);

/// Trains a machine on the rows of `x`: weights (visible x hidden), visible bias, hidden bias.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "a recipe")]
#[pyo3(signature = (x, visible, hidden, epochs, batch, rate, momentum, l2, chains, steps, seed))]
pub fn rbm_fit<'py>(
    py: Python<'py>,
    x: PyReadonlyArray2<'py, f32>,
    visible: &str,
    hidden: usize,
    epochs: usize,
    batch: usize,
    rate: f32,
    momentum: f32,
    l2: f32,
    chains: usize,
    steps: usize,
    seed: u64,
) -> PyResult<Machine<'py>> {
    let visible = kind(py, visible)?;
    let negative = if chains == 0 { Negative::Contrastive { steps } } else { Negative::Persistent { chains, steps } };
    let recipe = Recipe { epochs, batch, rate, momentum, l2, negative, seed, ..Recipe::new(visible, hidden) };
    let width = x.shape()[1];
    let data: Vec<f32> = x.as_array().iter().copied().collect();
    let train = || -> Result<Rbm> {
        let rows = Rows::new(&data, width);
        let mut trainer = Trainer::new(recipe, rows)?;
        while !trainer.is_done() {
            trainer.step(rows);
        }
        trainer.check()?;
        Ok(trainer.learned())
    };
    let rbm = py.detach(|| crate::threads::run(train).and_then(|r| r)).or_raise(py)?;
    let (weights, bias) = (rbm.weights().data().to_vec(), rbm.visible_bias().to_vec());
    let weights = Array2::from_shape_vec(rbm.shape(), weights).expect("whole rows");
    Ok((weights.into_pyarray(py), bias.into_pyarray(py), rbm.hidden_bias().to_vec().into_pyarray(py)))
}

fn machine(
    py: Python<'_>,
    visible: &str,
    weights: &PyReadonlyArray2<'_, f32>,
    visible_bias: &PyReadonlyArray1<'_, f32>,
    hidden_bias: &PyReadonlyArray1<'_, f32>,
) -> PyResult<Rbm> {
    let all = |values: ArrayView2<'_, f32>| values.iter().copied().collect();
    let (b, c) = (visible_bias.as_array().to_vec(), hidden_bias.as_array().to_vec());
    Rbm::new(kind(py, visible)?, all(weights.as_array()), b, c).or_raise(py)
}

/// p(h = 1 | v) for each row of `x`.
#[pyfunction]
pub fn rbm_hidden<'py>(
    py: Python<'py>,
    x: PyReadonlyArray2<'py, f32>,
    visible: &str,
    weights: PyReadonlyArray2<'py, f32>,
    visible_bias: PyReadonlyArray1<'py, f32>,
    hidden_bias: PyReadonlyArray1<'py, f32>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let rbm = machine(py, visible, &weights, &visible_bias, &hidden_bias)?;
    let (n_v, n_h) = rbm.shape();
    let data: Vec<f32> = x.as_array().iter().copied().collect();
    let n = x.shape()[0];
    let hidden = py.detach(|| {
        let mut hidden = vec![0.0; n * n_h];
        rbm.h_from_v(Rows::new(&data, n_v), RowsMut::new(&mut hidden, n_h));
        hidden
    });
    Ok(Array2::from_shape_vec((n, n_h), hidden).expect("whole rows").into_pyarray(py))
}

/// F(v), nats, for each row of `x`.
#[pyfunction]
pub fn rbm_free_energy<'py>(
    py: Python<'py>,
    x: PyReadonlyArray2<'py, f32>,
    visible: &str,
    weights: PyReadonlyArray2<'py, f32>,
    visible_bias: PyReadonlyArray1<'py, f32>,
    hidden_bias: PyReadonlyArray1<'py, f32>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let rbm = machine(py, visible, &weights, &visible_bias, &hidden_bias)?;
    let data: Vec<f32> = x.as_array().iter().copied().collect();
    let energies: Vec<f64> =
        py.detach(|| Rows::new(&data, rbm.shape().0).iter().map(|row| rbm.free_energy(row)).collect());
    Ok(energies.into_pyarray(py))
}

fn boxes(rows: ArrayView2<'_, f64>) -> Vec<Option<BBox>> {
    let one = |r: numpy::ndarray::ArrayView1<'_, f64>| {
        r.iter().all(|v| v.is_finite()).then(|| BBox::new(r[0], r[1], r[2], r[3]))
    };
    rows.rows().into_iter().map(one).collect()
}

/// The figures and curves of one track, as JSON.
#[pyfunction]
pub fn score_ope(
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

/// The figures of many targets, as JSON. Rows: frame, id, left, top, width, height, confidence.
#[pyfunction]
pub fn score_mot(
    py: Python<'_>,
    found: PyReadonlyArray2<'_, f64>,
    truth: PyReadonlyArray2<'_, f64>,
) -> PyResult<String> {
    let (truth, found) = (tracks(truth.as_array()), tracks(found.as_array()));
    let score = py.detach(|| foveate::lab::eval::mot::score(&truth, &found)).or_raise(py)?;
    serde_json::to_string(&score).map_err(|e| crate::errors::of(py, &Error::Invalid(e.to_string())))
}
