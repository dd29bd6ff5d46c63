//! What is known of the target in one picture, kept for Python.

use foveate::geometry::State;
use foveate::step::Region;
use foveate::{BBox, Output, Status};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyTuple};

use crate::errors::input;
use crate::named;

/// Credible regions of a normal belief are all this one, larger or smaller: it is the one of one standard deviation.
const ONE_SD: f64 = 0.393_469_340_287_366_6; // 1 − e^(−1/2)

/// A copy of an [`Output`], without what is for observers of the algorithm alone.
pub struct Seen {
    bbox: BBox,
    status: Status,
    p_lost: f64,
    state: State,
    covariance: [[f64; 6]; 6],
    one_sd: Region,
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
    /// Takes what Python may ask for.
    pub fn of(output: &Output<'_>) -> Self {
        let step = &output.step;
        let gaze = step.plan.chosen();
        let names = (0..step.classes.len()).map(|c| step.class_name(c).into_owned());
        Self {
            bbox: output.bbox,
            status: output.status,
            p_lost: output.p_lost,
            state: output.state,
            covariance: output.covariance,
            one_sd: output.region(ONE_SD),
            ess: step.ess,
            log_evidence: step.log_evidence,
            gaze: (gaze.u, gaze.v),
            gazes: step.plan.gazes().iter().flat_map(|g| [g.u, g.v]).collect(),
            rewards: step.rewards.to_vec(),
            particles: step.predicted.iter().flat_map(State::to_array).collect(),
            weights: step.weights.to_vec(),
            classes: names.zip(step.classes.iter().copied()).collect(),
        }
    }
}

/// Numbers that become an array when they are asked for, without a copy, once.
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

/// What a pickle has: the status; box, P(lost), effective sample size, log evidence, gaze, region, state and covariance in one row; gazes,
/// rewards, particles and weights; and the classes.
type Pickle<'py> = (String, Vec<f64>, [PyReadonlyArrayDyn<'py, f64>; 4], Vec<(String, f64)>);

/// A result from its pickle.
#[pyfunction]
#[pyo3(signature = (*pickle))]
pub fn _restore_result(py: Python<'_>, pickle: Pickle<'_>) -> PyResult<TrackResult> {
    let (status, numbers, arrays, classes) = pickle;
    let known = [Status::Tracking, Status::Occluded, Status::Lost, Status::Reacquired];
    let status = known.into_iter().find(|known| known.name() == status);
    let [gazes, rewards, particles, weights] = arrays.map(|array| array.as_array().iter().copied().collect::<Vec<_>>());
    let (Some(status), Ok(numbers)) = (status, <[f64; 56]>::try_from(numbers)) else {
        return Err(input(py, "this is no pickle of a result"));
    };
    let [x, y, w, h, p_lost, ess, log_evidence, u, v, cx, cy, major, minor, turn, rest @ ..] = numbers;
    let covariance = std::array::from_fn(|i| std::array::from_fn(|j| rest[6 + 6 * i + j]));
    let state = State::from_array(std::array::from_fn(|i| rest[i]));
    let one_sd = Region { x: cx, y: cy, half: [major, minor], turn };
    if gazes.len() % 2 + particles.len() % 6 > 0 {
        return Err(input(py, "this is no pickle of a result"));
    }
    let (bbox, gaze) = (BBox::new(x, y, w, h), (u, v));
    let seen = Seen {
        bbox,
        status,
        p_lost,
        state,
        covariance,
        one_sd,
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

/// What is known of the target in one picture; made by :meth:`Tracker.update`.
///
/// It can be unpacked as OpenCV's answer: ``ok, box = tracker.update(image)``. Arrays are read-only, made without a copy where
/// they are asked for, and stay valid after the next update.
#[pyclass(frozen, module = "foveate", name = "Result")]
pub struct TrackResult {
    seen: Seen,
    gazes: Lazy<PyArray2<f64>>,
    rewards: Lazy<PyArray1<f64>>,
    particles: Lazy<PyArray2<f64>>,
    weights: Lazy<PyArray1<f64>>,
}

impl From<Seen> for TrackResult {
    fn from(mut seen: Seen) -> Self {
        let take = std::mem::take::<Vec<f64>>;
        Self {
            gazes: Lazy::new(take(&mut seen.gazes)),
            rewards: Lazy::new(take(&mut seen.rewards)),
            particles: Lazy::new(take(&mut seen.particles)),
            weights: Lazy::new(take(&mut seen.weights)),
            seen,
        }
    }
}

#[pymethods]
impl TrackResult {
    /// Whether the box is a result: false where the target is believed occluded or lost.
    #[getter]
    fn ok(&self) -> bool {
        !self.seen.status.is_occluded_or_lost()
    }
    /// The target's upright box: left, top, width, height; pixels from 0. A guess where ``ok`` is false.
    #[getter(r#box)]
    fn bbox<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        named::bbox(py, &self.seen.bbox)
    }
    /// The probability, 0 to 1, that the box is not on the target (IoU below 0.1) or the target not to be seen.
    #[getter]
    fn p_lost(&self) -> f64 {
        self.seen.p_lost
    }
    /// What is believed of the track: ``"tracking"``, ``"occluded"``, ``"lost"`` or ``"reacquired"``.
    #[getter]
    fn status(&self) -> &'static str {
        self.seen.status.name()
    }
    /// Mean of the belief, moved by the box regression where there is one: x, y (centre, pixels), vx, vy (pixels a frame), log_scale (relative to the first frame), angle (radians).
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        named::state(py, &self.seen.state)
    }
    /// Covariance of the belief over x, y, vx, vy, log scale, angle; float64, shape (6, 6).
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let rows = Array2::from_shape_fn((6, 6), |(i, j)| self.seen.covariance[i][j]);
        rows.into_pyarray(py)
    }
    /// Effective sample size 1 / Σ w², from 1 to the number of particles.
    #[getter]
    fn ess(&self) -> f64 {
        self.seen.ess
    }
    /// Log evidence of the picture, nats, up to the likelihood's constant.
    #[getter]
    fn log_evidence(&self) -> f64 {
        self.seen.log_evidence
    }
    /// The predicted particles; float64, shape (n, 6): x, y, vx, vy, log scale, angle.
    #[getter]
    fn particles<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.particles.get(py, 6)
    }
    /// Weights of the particles, which sum to 1; float64, shape (n,).
    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.weights.get(py)
    }
    /// The policy's own gaze (u, v) in template units: the box is the square from -1 to 1.
    #[getter]
    fn gaze(&self) -> (f64, f64) {
        self.seen.gaze
    }
    /// All gazes that were scored, template units; float64, shape (k, 2).
    #[getter]
    fn gazes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.gazes.get(py, 2)
    }
    /// The reward, 0 to 1, of each of ``gazes``; float64, shape (k,).
    #[getter]
    fn rewards<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.rewards.get(py)
    }
    /// Probability of each class over all pictures so far, by name; empty without a recogniser.
    #[getter]
    fn classes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        self.seen.classes.iter().try_for_each(|(name, p)| all.set_item(name, p))?;
        Ok(all)
    }
    /// The credible region of the target's centre that holds this share (0 to below 1) of the probability: an ellipse.
    #[pyo3(signature = (p = 0.9))]
    fn region<'py>(&self, py: Python<'py>, p: f64) -> PyResult<Bound<'py, PyAny>> {
        if !(0.0..1.0).contains(&p) {
            return Err(input(py, format!("a region holds a share of the probability, 0 to below 1; it is {p}")));
        }
        let size = (-2.0 * (1.0 - p).ln()).sqrt();
        let one = self.seen.one_sd;
        named::region(py, &Region { half: one.half.map(|half| size * half), ..one })
    }
    /// Box, particles, region and gaze as a picture, for notebooks.
    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("foveate._show")?.call_method1("result_html", (slf,))
    }
    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let pair = PyTuple::new(py, [self.ok().into_pyobject(py)?.to_owned().into_any(), self.bbox(py)?])?;
        Ok(pair.try_iter()?.into_any())
    }
    fn __bool__(&self) -> bool {
        self.ok()
    }
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let Seen { bbox: b, status, p_lost, state, covariance, one_sd, ess, log_evidence, gaze, classes, .. } =
            &self.seen;
        let Region { x, y, half, turn } = one_sd;
        let first = [b.x, b.y, b.w, b.h, *p_lost, *ess, *log_evidence, gaze.0, gaze.1, *x, *y, half[0], half[1], *turn];
        let numbers = first.into_iter().chain(state.to_array()).chain(covariance.as_flattened().iter().copied());
        let arrays = (self.gazes(py), self.rewards(py), self.particles(py), self.weights(py));
        let kept = (status.name(), numbers.collect::<Vec<_>>(), arrays, classes).into_pyobject(py)?;
        PyTuple::new(py, [py.import("foveate._foveate")?.getattr("_restore_result")?, kept.into_any()])
    }
    fn __repr__(&self) -> String {
        let BBox { x, y, w, h } = self.seen.bbox;
        format!(
            "<Result {} box=({x:.1}, {y:.1}, {w:.1}, {h:.1}) p_lost={:.3}>",
            self.seen.status.name(),
            self.seen.p_lost
        )
    }
}
