//! Learners as functions of arrays: a kind, its recipe as JSON, and tensors as model files have them. `foveate.learn` has their protocols.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use foveate::learn::autoencoder::{self, Autoencoder};
use foveate::learn::filters::{self, PatchFilters};
use foveate::learn::rbm::factored::{self, FactoredRbm, Units};
use foveate::learn::rbm::io::{Tensor, Tensors};
use foveate::learn::rbm::{self, Rbm};
use foveate::learn::softmax::{Fit, Softmax};
use foveate::rows::{Rows, RowsMut};
use foveate::{Error, Result};
use numpy::ndarray::{Array2, ArrayD};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayDyn, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::errors::OrRaise;

type Singles<'py> = PyReadonlyArray2<'py, f32>;

enum Model {
    Autoencoder(Autoencoder),
    Factored(FactoredRbm),
    Filters(PatchFilters),
    Rbm(Rbm),
}

fn wrong(e: serde_json::Error) -> Error {
    Error::Config(format!("training: {e}"))
}

fn owned(tensors: Vec<Tensor<'_>>) -> Tensors {
    tensors.into_iter().map(|(name, shape, values)| (name.to_string(), (shape, values.to_vec()))).collect()
}

fn no(kind: &str) -> Error {
    Error::Invalid(format!("expected autoencoder, factored, filters or rbm, got {kind}"))
}

/// How long a learner works before Python is asked whether to go on.
const STRETCH: Duration = Duration::from_millis(100);

/// A learner at work.
enum Training {
    Autoencoder(autoencoder::Trainer),
    Factored(factored::Trainer),
    Filters(filters::Trainer),
    Rbm(rbm::Trainer),
}

impl Training {
    fn new(kind: &str, recipe: &str, rows: Rows<'_>) -> Result<Self> {
        Ok(match kind {
            "autoencoder" => {
                Self::Autoencoder(autoencoder::Trainer::new(serde_json::from_str(recipe).map_err(wrong)?, rows)?)
            }
            "factored" => Self::Factored(factored::Trainer::new(serde_json::from_str(recipe).map_err(wrong)?, rows)?),
            "filters" => Self::Filters(filters::Trainer::new(serde_json::from_str(recipe).map_err(wrong)?, rows)?),
            "rbm" => Self::Rbm(rbm::Trainer::new(serde_json::from_str(recipe).map_err(wrong)?, rows)?),
            other => return Err(no(other)),
        })
    }
    /// Learns for a while; whether that is all.
    fn go_on(&mut self, rows: Rows<'_>) -> bool {
        let until = Instant::now() + STRETCH;
        while Instant::now() < until {
            match self {
                Self::Autoencoder(trainer) if !trainer.is_done() => trainer.step(rows),
                Self::Factored(trainer) if !trainer.is_done() => trainer.step(),
                Self::Filters(trainer) if !trainer.is_done() => trainer.step(),
                Self::Rbm(trainer) if !trainer.is_done() => trainer.step(rows),
                _ => return true,
            }
        }
        false
    }
    /// What was learned; of filters with their cost.
    fn learned(&self) -> Result<Tensors> {
        Ok(match self {
            Self::Autoencoder(trainer) => trainer.check().map(|()| owned(trainer.learned().tensors()))?,
            Self::Factored(trainer) => trainer.check().map(|()| owned(trainer.learned().tensors()))?,
            Self::Filters(trainer) => {
                let mut tensors = owned(trainer.learned().tensors());
                tensors.insert("cost".into(), (vec![], vec![trainer.cost() as f32]));
                tensors
            }
            Self::Rbm(trainer) => trainer.check().map(|()| owned(trainer.learned().tensors()))?,
        })
    }
}

impl Model {
    fn new(kind: &str, recipe: &str, mut tensors: Tensors) -> Result<Self> {
        let tensors = &mut tensors;
        let model = match kind {
            "autoencoder" => Autoencoder::of_tensors(tensors).map(Self::Autoencoder),
            "factored" => FactoredRbm::of_tensors(tensors).map(Self::Factored),
            "filters" => {
                let filters::Recipe { method, softening, .. } = serde_json::from_str(recipe).map_err(wrong)?;
                PatchFilters::of_tensors(method, softening, tensors).map(Self::Filters)
            }
            "rbm" => Rbm::of_tensors(serde_json::from_str::<rbm::Recipe>(recipe).map_err(wrong)?.visible, tensors)
                .map(Self::Rbm),
            other => return Err(no(other)),
        };
        model.map_err(Error::Invalid)
    }
    /// What the model makes of every row, and how many numbers a row that is.
    fn codes(&self, rows: Rows<'_>) -> (usize, Vec<f32>) {
        let filled = |width: usize, fill: &dyn Fn(RowsMut<'_>)| {
            let mut codes = vec![0.0; rows.len() * width];
            fill(RowsMut::new(&mut codes, width));
            (width, codes)
        };
        match self {
            Self::Autoencoder(model) => filled(model.layer().shape().1, &|h| model.layer().h_from_v(rows, h)),
            Self::Factored(model) => filled(model.width(Units::Both), &|h| model.features(rows, Units::Both, h)),
            Self::Filters(model) => (model.shape().2, model.codes(rows)),
            Self::Rbm(model) => filled(model.shape().1, &|h| model.h_from_v(rows, h)),
        }
    }
    /// −F(v), nats, of every row.
    fn scores(&self, rows: Rows<'_>) -> Result<Vec<f64>> {
        match self {
            Self::Factored(model) => Ok(rows.iter().map(|v| -model.free_energy(v)).collect()),
            Self::Rbm(model) => Ok(rows.iter().map(|v| -model.free_energy(v)).collect()),
            _ => Err(Error::Invalid("this model has no free energy".into())),
        }
    }
    /// How wide rows are.
    fn width(&self) -> usize {
        match self {
            Self::Autoencoder(model) => model.layer().shape().0,
            Self::Factored(model) => model.glimpse_len(),
            Self::Filters(model) => model.shape().0,
            Self::Rbm(model) => model.shape().0,
        }
    }
}

/// Works on the threads of this process, without the interpreter's lock.
fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> Result<T> + Send) -> PyResult<T> {
    py.detach(|| crate::threads::run(work).and_then(|result| result)).or_raise(py)
}

/// The values of an array, row by row.
fn values(x: &Singles<'_>) -> Vec<f32> {
    x.as_array().iter().copied().collect()
}

fn rows<'a>(data: &'a [f32], x: &Singles<'_>) -> Result<Rows<'a>> {
    match x.shape()[1] {
        0 => Err(Error::Invalid("rows have at least one value, these have none".into())),
        width => Ok(Rows::new(data, width)),
    }
}

/// Calls with the rows of an array.
fn on_rows<T: Send>(py: Python<'_>, x: &Singles<'_>, work: impl FnOnce(Rows<'_>) -> Result<T> + Send) -> PyResult<T> {
    let data = values(x);
    let rows = rows(&data, x).or_raise(py)?;
    detached(py, || work(rows))
}

fn fits(expected: usize, rows: Rows<'_>) -> Result<()> {
    match rows.width() {
        found if found == expected => Ok(()),
        found => Err(Error::Invalid(format!("the model is of rows of {expected} values, these have {found}"))),
    }
}

/// Makes the model, calls it with the rows.
fn of_model<T: Send>(
    py: Python<'_>,
    (kind, recipe): (&str, &str),
    tensors: HashMap<String, PyReadonlyArrayDyn<'_, f32>>,
    x: &Singles<'_>,
    work: impl FnOnce(Model, Rows<'_>) -> Result<T> + Send,
) -> PyResult<T> {
    let own = |t: PyReadonlyArrayDyn<'_, f32>| (t.shape().to_vec(), t.as_array().iter().copied().collect());
    let tensors: Tensors = tensors.into_iter().map(|(name, t)| (name, own(t))).collect();
    on_rows(py, x, |rows| {
        let model = Model::new(kind, recipe, tensors)?;
        fits(model.width(), rows)?;
        work(model, rows)
    })
}

/// Learns from the rows of `x`; of filters with their cost. Ctrl-C ends it.
#[pyfunction]
pub fn learn_fit<'py>(
    py: Python<'py>,
    kind: &str,
    recipe: &str,
    x: Singles<'py>,
) -> PyResult<HashMap<String, Bound<'py, PyArrayDyn<f32>>>> {
    let data = values(&x);
    let rows = rows(&data, &x).or_raise(py)?;
    let mut training = detached(py, || Training::new(kind, recipe, rows))?;
    while !detached(py, || Ok(training.go_on(rows)))? {
        py.check_signals()?;
    }
    let tensors = detached(py, || training.learned())?;
    let array = |(shape, values): (Vec<usize>, Vec<f32>)| {
        ArrayD::from_shape_vec(shape, values).expect("values fill their shape")
    };
    Ok(tensors.into_iter().map(|(name, tensor)| (name, array(tensor).into_pyarray(py))).collect())
}

/// What the model makes of each row of `x`.
#[pyfunction]
pub fn learn_codes<'py>(
    py: Python<'py>,
    kind: &str,
    recipe: &str,
    tensors: HashMap<String, PyReadonlyArrayDyn<'py, f32>>,
    x: Singles<'py>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (width, codes) = of_model(py, (kind, recipe), tensors, &x, |model, rows| Ok(model.codes(rows)))?;
    Ok(Array2::from_shape_vec((x.shape()[0], width), codes).expect("whole rows").into_pyarray(py))
}

/// log p(v) of each row of `x`, nats, up to a constant.
#[pyfunction]
pub fn learn_scores<'py>(
    py: Python<'py>,
    kind: &str,
    recipe: &str,
    tensors: HashMap<String, PyReadonlyArrayDyn<'py, f32>>,
    x: Singles<'py>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    Ok(of_model(py, (kind, recipe), tensors, &x, |model, rows| model.scores(rows))?.into_pyarray(py))
}

type Fitted<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray1<f32>>, usize);

/// Fits softmax regression to rows and their labels (0 to `classes` − 1): weights (n_in × classes), bias, and the steps that it took.
#[pyfunction]
#[pyo3(signature = (x, labels, classes, l2, steps, tolerance))]
pub fn softmax_fit<'py>(
    py: Python<'py>,
    x: Singles<'py>,
    labels: PyReadonlyArray1<'py, u8>,
    classes: usize,
    l2: f64,
    steps: usize,
    tolerance: f64,
) -> PyResult<Fitted<'py>> {
    let labels = labels.as_array().to_vec();
    let fit = Fit { l2, steps, tolerance };
    let (model, steps) = on_rows(py, &x, |rows| Softmax::fit(rows, &labels, classes, fit))?;
    let [(_, shape, weights), (_, _, bias)] = model.tensors();
    let weights = Array2::from_shape_vec((shape[0], shape[1]), weights.to_vec()).expect("whole rows");
    Ok((weights.into_pyarray(py), PyArray1::from_slice(py, bias), steps))
}

/// log p(y | x), nats, for each row of `x` and class.
#[pyfunction]
pub fn softmax_log_probabilities<'py>(
    py: Python<'py>,
    weights: Singles<'py>,
    bias: PyReadonlyArray1<'py, f32>,
    x: Singles<'py>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (weights, bias) = (weights.as_array().iter().copied().collect(), bias.as_array().to_vec());
    let classes = bias.len();
    let log_p = on_rows(py, &x, |rows| {
        let model = Softmax::new(weights, bias, 1.0)?;
        fits(model.width(), rows)?;
        let mut log_p = vec![0.0; rows.len() * classes];
        model.log_probabilities(rows, &mut log_p);
        Ok(log_p)
    })?;
    Ok(Array2::from_shape_vec((x.shape()[0], classes), log_p).expect("whole rows").into_pyarray(py))
}
