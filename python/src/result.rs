//! The estimate of the target in one picture, kept for Python.

use foveate::geometry::{Covariance, State};
use foveate::seen::{Region, credible};
use foveate::{BBox, Status};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyTuple};

use crate::errors::input;
use crate::named;

/// Share of the kept region. All credible regions are scaled versions of it.
const KEPT: f64 = 0.9;

/// A copy of a [`foveate::Seen`], without the data for observers of the algorithm.
pub struct Seen {
    bbox: BBox,
    status: Status,
    p_lost: f64,
    state: State,
    covariance: Covariance,
    kept: Region,
    ess: f64,
    log_evidence: f64,
    gaze: (f64, f64),
    gazes: Vec<f64>,
    rewards: Vec<f64>,
    particles: Vec<f64>,
    weights: Vec<f64>,
    classes: Vec<(String, f64)>,
}

impl Seen {
    /// Creates the result of a picture with a given box: nothing was estimated.
    pub fn given(bbox: BBox) -> Self {
        Self::of(&foveate::Seen::given([1; 3], &bbox))
    }

    /// Copies the data that Python can access.
    pub fn of(seen: &foveate::Seen<'_>) -> Self {
        let names = (0..seen.classes.len()).map(|c| seen.class_name(c).into_owned());
        Self {
            bbox: seen.bbox,
            status: seen.status,
            p_lost: seen.p_lost,
            state: seen.state,
            covariance: seen.covariance,
            kept: seen.region(KEPT),
            ess: seen.ess,
            log_evidence: seen.log_evidence,
            gaze: (seen.gaze.u, seen.gaze.v),
            gazes: seen.plan.gazes().iter().flat_map(|g| [g.u, g.v]).collect(),
            rewards: seen.rewards.to_vec(),
            particles: seen.particles.iter().flat_map(State::to_array).collect(),
            weights: seen.weights.to_vec(),
            classes: names.zip(seen.classes.iter().copied()).collect(),
        }
    }
}

/// Numbers that become an array on first access, without a copy.
struct Lazy<A> {
    values: std::sync::Mutex<Vec<f64>>,
    array: PyOnceLock<Py<A>>,
}

impl<A> Lazy<A> {
    fn new(values: Vec<f64>) -> Self {
        Self { values: values.into(), array: PyOnceLock::new() }
    }
    fn take(&self) -> Vec<f64> {
        std::mem::take(&mut self.values.lock().unwrap_or_else(std::sync::PoisonError::into_inner))
    }
}

impl Lazy<PyArray1<f64>> {
    fn get<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let make = || read_only(self.take().into_pyarray(py)).unbind();
        self.array.get_or_init(py, make).bind(py).clone()
    }
}

impl Lazy<PyArray2<f64>> {
    fn get<'py>(&self, py: Python<'py>, width: usize) -> Bound<'py, PyArray2<f64>> {
        let make = || {
            let values = self.take();
            let rows = Array2::from_shape_vec((values.len() / width, width), values).expect("whole rows");
            read_only(rows.into_pyarray(py)).unbind()
        };
        self.array.get_or_init(py, make).bind(py).clone()
    }
}

fn read_only<'py, D: numpy::ndarray::Dimension>(
    array: Bound<'py, numpy::PyArray<f64, D>>,
) -> Bound<'py, numpy::PyArray<f64, D>> {
    array.readwrite().make_nonwriteable();
    array
}

/// The contents of a pickle: the status; box, P(lost), effective sample size, log evidence, gaze, region, state and covariance in one row;
/// gazes, rewards, particles and weights; and the classes.
type Pickle<'py> = (String, Vec<f64>, [PyReadonlyArrayDyn<'py, f64>; 4], Vec<(String, f64)>);

/// A result from its pickle.
#[pyfunction]
#[pyo3(signature = (*pickle))]
pub(crate) fn _restore_result(py: Python<'_>, pickle: Pickle<'_>) -> PyResult<Estimate> {
    let (status, numbers, arrays, classes) = pickle;
    let known = [Status::Tracking, Status::Occluded, Status::Lost, Status::Reacquired];
    let status = known.into_iter().find(|known| known.name() == status);
    let [gazes, rewards, particles, weights] = arrays.map(|array| array.as_array().iter().copied().collect::<Vec<_>>());
    let (Some(status), Ok(numbers)) = (status, <[f64; 14 + State::N + State::N * State::N]>::try_from(numbers)) else {
        return Err(input(py, "this is no pickle of a result"));
    };
    let [x, y, w, h, p_lost, ess, log_evidence, u, v, cx, cy, major, minor, turn, rest @ ..] = numbers;
    let covariance = std::array::from_fn(|i| std::array::from_fn(|j| rest[State::N * (i + 1) + j]));
    let state = State::from_array(std::array::from_fn(|i| rest[i]));
    let kept = Region { x: cx, y: cy, half: [major, minor], turn };
    if gazes.len() % 2 > 0 || particles.len() != State::N * weights.len() {
        return Err(input(py, "this is no pickle of a result"));
    }
    let (bbox, gaze) = (BBox::new(x, y, w, h), (u, v));
    let seen = Seen {
        bbox,
        status,
        p_lost,
        state,
        covariance,
        kept,
        ess,
        log_evidence,
        gaze,
        gazes,
        rewards,
        particles,
        weights,
        classes,
    };
    Ok(seen.into())
}

/// The values of a `foveate.Result`, which documents them.
#[pyclass(frozen, module = "foveate._foveate", name = "_Estimate")]
pub struct Estimate {
    seen: Seen,
    covariance: Lazy<PyArray2<f64>>,
    gazes: Lazy<PyArray2<f64>>,
    rewards: Lazy<PyArray1<f64>>,
    particles: Lazy<PyArray2<f64>>,
    weights: Lazy<PyArray1<f64>>,
}

impl Seen {
    /// Returns the status of the track.
    pub fn status(&self) -> Status {
        self.status
    }

    /// Converts to a `foveate.Result`.
    pub fn into_result(self, py: Python<'_>, channels: &str) -> PyResult<Py<PyAny>> {
        static CLASS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
        let class = CLASS.get_or_try_init(py, || py.import("foveate._result")?.getattr("Result").map(Bound::unbind))?;
        class.call1(py, (Estimate::from(self), channels))
    }
}

impl From<Seen> for Estimate {
    fn from(mut seen: Seen) -> Self {
        let take = std::mem::take::<Vec<f64>>;
        Self {
            covariance: Lazy::new(seen.covariance.as_flattened().to_vec()),
            gazes: Lazy::new(take(&mut seen.gazes)),
            rewards: Lazy::new(take(&mut seen.rewards)),
            particles: Lazy::new(take(&mut seen.particles)),
            weights: Lazy::new(take(&mut seen.weights)),
            seen,
        }
    }
}

#[pymethods]
impl Estimate {
    #[getter]
    fn ok(&self) -> bool {
        self.seen.status.is_usable()
    }
    #[getter(r#box)]
    fn bbox<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        named::bbox(py, &self.seen.bbox)
    }
    #[getter]
    fn p_lost(&self) -> f64 {
        self.seen.p_lost
    }
    #[getter]
    fn status(&self) -> &'static str {
        self.seen.status.name()
    }
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        named::state(py, &self.seen.state)
    }
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.covariance.get(py, State::N)
    }
    #[getter]
    fn ess(&self) -> f64 {
        self.seen.ess
    }
    #[getter]
    fn log_evidence(&self) -> f64 {
        self.seen.log_evidence
    }
    #[getter]
    fn particles<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.particles.get(py, State::N)
    }
    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.weights.get(py)
    }
    #[getter]
    fn gaze(&self) -> (f64, f64) {
        self.seen.gaze
    }
    #[getter]
    fn gazes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.gazes.get(py, 2)
    }
    #[getter]
    fn rewards<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.rewards.get(py)
    }
    #[getter]
    fn classes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        self.seen.classes.iter().try_for_each(|(name, p)| all.set_item(name, p))?;
        Ok(all)
    }
    #[pyo3(signature = (p = 0.9))]
    fn region<'py>(&self, py: Python<'py>, p: f64) -> PyResult<Bound<'py, PyAny>> {
        if !(0.0..1.0).contains(&p) {
            return Err(input(py, format!("a region holds a share of the probability, 0 to below 1; it is {p}")));
        }
        let (kept, size) = (self.seen.kept, (credible(p) / credible(KEPT)).sqrt());
        named::region(py, &Region { half: kept.half.map(|half| size * half), ..kept })
    }
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let Seen { bbox: b, status, p_lost, state, covariance, kept, ess, log_evidence, gaze, classes, .. } =
            &self.seen;
        let Region { x, y, half, turn } = kept;
        let first = [b.x, b.y, b.w, b.h, *p_lost, *ess, *log_evidence, gaze.0, gaze.1, *x, *y, half[0], half[1], *turn];
        let numbers = first.into_iter().chain(state.to_array()).chain(covariance.as_flattened().iter().copied());
        let arrays = (self.gazes(py), self.rewards(py), self.particles(py), self.weights(py));
        let kept = (status.name(), numbers.collect::<Vec<_>>(), arrays, classes).into_pyobject(py)?;
        PyTuple::new(py, [py.import("foveate._foveate")?.getattr("_restore_result")?, kept.into_any()])
    }
}
