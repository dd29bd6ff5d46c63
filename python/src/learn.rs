//! Learners as functions of arrays: a kind, its recipe as JSON, and tensors as in model files. `foveate.learn` has the Python interface.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

use foveate::learn::Stop;
use foveate::learn::filters::{self, PatchFilters};
use foveate::learn::rbm::io::{Tensor, Tensors};
use foveate::learn::rbm::{self, Rbm};
use foveate::learn::softmax::{self, Examples, Fit};
use foveate::learn::training::Training as _;
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
    Error::Invalid(format!("expected filters or rbm, got {kind}"))
}

/// A learner in training.
enum Training {
    Filters(filters::Trainer),
    Rbm(Box<rbm::Trainer>),
}

impl Training {
    fn new(kind: &str, recipe: &str, rows: Rows<'_>) -> Result<Self> {
        Ok(match kind {
            "filters" => Self::Filters(filters::Trainer::new(serde_json::from_str(recipe).map_err(wrong)?, rows)?),
            "rbm" => Self::Rbm(Box::new(rbm::Trainer::new(serde_json::from_str(recipe).map_err(wrong)?, rows)?)),
            other => return Err(no(other)),
        })
    }
    /// Trains to the end.
    fn finish(&mut self, rows: Rows<'_>, stop: Stop<'_>) -> Result<()> {
        while !stop() {
            match self {
                Self::Filters(trainer) if !trainer.is_done() => trainer.step_until(stop)?,
                Self::Rbm(trainer) if !trainer.is_done() => trainer.step(rows),
                _ => return Ok(()),
            }
        }
        Err(Error::Stopped)
    }
    /// Returns the learned tensors; for filters with their cost.
    fn learned(&mut self) -> Result<Tensors> {
        Ok(match self {
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
            "filters" => {
                let filters::Recipe { softening, .. } = serde_json::from_str(recipe).map_err(wrong)?;
                PatchFilters::of_tensors(softening, tensors).map(Self::Filters)
            }
            "rbm" => Rbm::of_tensors(serde_json::from_str::<rbm::Recipe>(recipe).map_err(wrong)?.visible, tensors)
                .map(Self::Rbm),
            other => return Err(no(other)),
        };
        model.map_err(Error::Invalid)
    }
    /// Returns the model's codes of every row. A row's codes depend on that row alone, so rows can be processed in pieces.
    fn codes(&self, rows: Rows<'_>, stop: Stop<'_>) -> Result<Vec<f32>> {
        let (width, units) = (rows.width(), self.units());
        let mut codes = Vec::with_capacity(rows.len() * units);
        for some in rows.data().chunks(width * (PIECE / (width * units)).max(1)) {
            if stop() {
                return Err(Error::Stopped);
            }
            let (some, from) = (Rows::new(some, width), codes.len());
            if let Self::Filters(model) = self {
                codes.extend(model.codes(some));
                continue;
            }
            codes.resize(from + some.len() * units, 0.0);
            let h = RowsMut::new(&mut codes[from..], units);
            match self {
                Self::Rbm(model) => model.h_from_v(some, h),
                Self::Filters(_) => {}
            }
        }
        Ok(codes)
    }
    /// Returns −F(v), nats, of every row.
    fn scores(&self, rows: Rows<'_>, stop: Stop<'_>) -> Result<Vec<f64>> {
        let energy: &dyn Fn(&[f32]) -> f64 = match self {
            Self::Rbm(model) => &|v| model.free_energy(v),
            _ => return Err(Error::Invalid("this model has no free energy".into())),
        };
        rows.iter().map(|v| if stop() { Err(Error::Stopped) } else { Ok(-energy(v)) }).collect()
    }
    /// Returns the number of codes per row.
    fn units(&self) -> usize {
        match self {
            Self::Filters(model) => model.shape().2,
            Self::Rbm(model) => model.shape().1,
        }
    }
    /// Returns the number of values per row.
    fn width(&self) -> usize {
        match self {
            Self::Filters(model) => model.shape().0,
            Self::Rbm(model) => model.shape().0,
        }
    }
}

/// Size of a piece of work between two checks for a stop: input numbers times outputs per number.
const PIECE: usize = 1 << 26;
/// Interval between checks for Ctrl-C in Python.
const LOOK: Duration = Duration::from_millis(50);

/// Runs work on its own thread, without the interpreter's lock. Ctrl-C ends the call within [`LOOK`]: the thread is left behind, and ends
/// when it next calls `stop`.
fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(Stop<'_>) -> Result<T> + Send + 'static,
) -> PyResult<T> {
    let (done, mut results) = mpsc::sync_channel(1);
    let stopped = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stopped);
    let thread = foveate::thread::start("learning", move || {
        let result = crate::threads::run(|| work(&|| flag.load(Ordering::Relaxed))).and_then(|result| result);
        // After Ctrl-C there is no receiver of the result.
        let _ = done.send(result);
    });
    let thread = thread.or_raise(py)?;
    loop {
        let found;
        (found, results) = py.detach(move || (results.recv_timeout(LOOK), results));
        match found {
            Ok(result) => return result.or_raise(py),
            Err(RecvTimeoutError::Timeout) => {
                py.check_signals().inspect_err(|_| stopped.store(true, Ordering::Relaxed))?
            }
            Err(RecvTimeoutError::Disconnected) => match thread.join() {
                Err(panic) => std::panic::resume_unwind(panic),
                Ok(()) => unreachable!("a thread sends its result before it ends"),
            },
        }
    }
}

/// Returns the values of an array, row by row, and the number of values per row.
fn owned_rows<T: numpy::Element + Copy>(py: Python<'_>, x: &PyReadonlyArray2<'_, T>) -> PyResult<(Vec<T>, usize)> {
    match x.shape()[1] {
        0 => Err(Error::Invalid("rows have at least one value, these have none".into())).or_raise(py),
        width => Ok((x.as_array().iter().copied().collect(), width)),
    }
}

fn fits(expected: usize, rows: Rows<'_>) -> Result<()> {
    match rows.width() {
        found if found == expected => Ok(()),
        found => Err(Error::Invalid(format!("the model is of rows of {expected} values, these have {found}"))),
    }
}

/// Creates the model and calls it with the rows; also returns the number of codes per row.
fn of_model<T: Send + 'static>(
    py: Python<'_>,
    (kind, recipe): (&str, &str),
    tensors: HashMap<String, PyReadonlyArrayDyn<'_, f32>>,
    x: &Singles<'_>,
    work: impl FnOnce(&Model, Rows<'_>, Stop<'_>) -> Result<T> + Send + 'static,
) -> PyResult<(usize, T)> {
    let own = |t: PyReadonlyArrayDyn<'_, f32>| (t.shape().to_vec(), t.as_array().iter().copied().collect());
    let tensors: Tensors = tensors.into_iter().map(|(name, t)| (name, own(t))).collect();
    let (kind, recipe) = (kind.to_string(), recipe.to_string());
    let (data, width) = owned_rows(py, x)?;
    interruptible(py, move |stop| {
        let (model, rows) = (Model::new(&kind, &recipe, tensors)?, Rows::new(&data, width));
        fits(model.width(), rows)?;
        Ok((model.units(), work(&model, rows, stop)?))
    })
}

/// Trains on the rows of `x`; for filters also returns their cost. Ctrl-C ends it.
#[pyfunction]
pub(crate) fn learn_fit<'py>(
    py: Python<'py>,
    kind: String,
    recipe: String,
    x: Singles<'py>,
) -> PyResult<HashMap<String, Bound<'py, PyArrayDyn<f32>>>> {
    let (data, width) = owned_rows(py, &x)?;
    let tensors = interruptible(py, move |stop| {
        let rows = Rows::new(&data, width);
        let mut training = Training::new(&kind, &recipe, rows)?;
        training.finish(rows, stop)?;
        training.learned()
    })?;
    let array = |(shape, values): (Vec<usize>, Vec<f32>)| {
        ArrayD::from_shape_vec(shape, values).expect("values fill their shape")
    };
    Ok(tensors.into_iter().map(|(name, tensor)| (name, array(tensor).into_pyarray(py))).collect())
}

/// Returns the model's codes of each row of `x`.
#[pyfunction]
pub(crate) fn learn_codes<'py>(
    py: Python<'py>,
    kind: &str,
    recipe: &str,
    tensors: HashMap<String, PyReadonlyArrayDyn<'py, f32>>,
    x: Singles<'py>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (units, codes) = of_model(py, (kind, recipe), tensors, &x, |model, rows, stop| model.codes(rows, stop))?;
    Ok(Array2::from_shape_vec((x.shape()[0], units), codes).expect("whole rows").into_pyarray(py))
}

/// Returns log p(v) of each row of `x`, nats, up to a constant.
#[pyfunction]
pub(crate) fn learn_scores<'py>(
    py: Python<'py>,
    kind: &str,
    recipe: &str,
    tensors: HashMap<String, PyReadonlyArrayDyn<'py, f32>>,
    x: Singles<'py>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (_, scores) = of_model(py, (kind, recipe), tensors, &x, |model, rows, stop| model.scores(rows, stop))?;
    Ok(scores.into_pyarray(py))
}

type Fitted<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, usize, bool);

/// Fits softmax regression to rows, their labels (0 to `classes` − 1) and weights: weights (n_in × classes), bias, the steps that it
/// took, and whether it converged. Ctrl-C ends it.
#[pyfunction]
#[pyo3(signature = (x, labels, weights, classes, l2, steps, tolerance))]
#[expect(clippy::too_many_arguments, reason = "as Python calls it")]
pub(crate) fn softmax_fit<'py>(
    py: Python<'py>,
    x: PyReadonlyArray2<'py, f64>,
    labels: PyReadonlyArray1<'py, u8>,
    weights: Option<PyReadonlyArray1<'py, f64>>,
    classes: usize,
    l2: f64,
    steps: usize,
    tolerance: f64,
) -> PyResult<Fitted<'py>> {
    let (values, width) = owned_rows(py, &x)?;
    let labels = labels.as_array().to_vec();
    let weights = weights.map(|weights| weights.as_array().to_vec());
    let found = interruptible(py, move |stop| {
        let examples = Examples { values: &values, width, labels: &labels, weights: weights.as_deref(), classes };
        softmax::solve(examples, Fit { l2, steps, tolerance }, stop)
    })?;
    let weights = Array2::from_shape_vec((x.shape()[1], classes), found.weights).expect("whole rows");
    Ok((weights.into_pyarray(py), found.bias.into_pyarray(py), found.steps, found.converged))
}
