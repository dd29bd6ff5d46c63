//! Many targets.

use foveate::MultiTracker;
use foveate::multi::TrackedTarget;
use numpy::ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};

use crate::errors::OrRaise;
use crate::held::{Held, Pickle};
use crate::making::{Making, profile_name};
use crate::named::read_box;
use crate::tracker::read_detections;

/// Follows many targets: those that are given, and those that detections start.
///
/// Parameters are those of :class:`Tracker`; the profile is ``"multi"`` (people and cars, with a detector of yours) unless told
/// otherwise.
///
/// Examples
/// --------
/// >>> import numpy as np, foveate
/// >>> tracker = foveate.MultiTracker()
/// >>> image = np.zeros((120, 160, 3), np.uint8)
/// >>> image[40:60, 30:50] = 200
/// >>> for _ in range(5):
/// ...     targets = tracker.update(image, [[30, 40, 20, 20, 0.9]])    # left, top, width, height, score
/// >>> targets.ids.tolist(), targets.boxes.shape
/// ([1], (1, 4))
#[pyclass(frozen, module = "foveate", name = "MultiTracker")]
pub struct PyMultiTracker(Held<MultiTracker>);

#[pymethods]
impl PyMultiTracker {
    #[new]
    #[pyo3(signature = (profile = "multi", config = None, seed = None, *, channels = "rgb"))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = profile_name)] profile: &str,
        config: Option<&Bound<'_, PyAny>>,
        seed: Option<u64>,
        channels: &str,
    ) -> PyResult<Self> {
        Held::new(Making::new(py, profile, config, seed, channels)?).or_raise(py).map(Self)
    }

    /// The next picture, and what detectors of yours found in it.
    ///
    /// Parameters
    /// ----------
    /// image : uint8 array, (height, width) or (height, width, channels)
    /// detections : array (n, 4) or (n, 5), or anything with ``xyxy`` and ``confidence``, optional
    ///     Left, top, width, height and score; or for example ``supervision.Detections``. Left out: none.
    ///
    /// Returns
    /// -------
    /// Targets
    ///     The active targets, by id.
    #[pyo3(signature = (image, detections = None))]
    fn update<'py>(
        &self,
        image: &Bound<'py, PyAny>,
        detections: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let found = detections.map(read_detections).transpose()?.unwrap_or_default();
        let targets = self.0.show(image, |tracker, image| Ok(tracker.update(image, &found)?.to_vec()))?;
        arrays(image.py(), &targets)
    }

    /// A target's box in the picture of the last update: a new target, or an active one that starts again. Answers its id, the next
    /// free one where none is given.
    #[pyo3(signature = (image, r#box, id = None))]
    fn add(&self, image: &Bound<'_, PyAny>, r#box: &Bound<'_, PyAny>, id: Option<u64>) -> PyResult<u64> {
        let bbox = read_box(r#box)?;
        self.0.show(image, |tracker, image| tracker.add(image, id, bbox))
    }

    /// A picture that is not tracked in: camera motion and detector compare pictures, and see it.
    fn skip(&self, image: &Bound<'_, PyAny>) -> PyResult<()> {
        self.0.show(image, |tracker, image| {
            tracker.skip(image);
            Ok(())
        })
    }

    /// The picture changed altogether: all targets are terminated, to be re-identified if they come back.
    fn cut(&self, py: Python<'_>) {
        py.detach(|| self.0.working().tracker.cut());
    }

    /// The active targets of the last picture, by id.
    #[getter]
    fn targets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let targets = py.detach(|| self.0.working().tracker.targets().to_vec());
        arrays(py, &targets)
    }

    /// The whole state, as JSON in UTF-8; as :meth:`Tracker.save`.
    fn save<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        self.0.save(py)
    }

    /// Takes up what :meth:`save` gave, in a tracker of the same configuration, seed and channels; nothing changes where it fails.
    fn load(&self, py: Python<'_>, saved: &[u8]) -> PyResult<()> {
        self.0.load(py, saved)
    }

    /// The configuration as TOML, every setting written out.
    #[getter]
    fn config(&self) -> String {
        self.0.making.text()
    }
    /// What names all random numbers.
    #[getter]
    fn seed(&self) -> u64 {
        self.0.making.seed
    }
    /// The order of a colour picture's bytes.
    #[getter]
    fn channels(&self) -> &'static str {
        self.0.making.channels.name
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let (py, this) = (slf.py(), slf.get());
        this.0.pickled(py, "_restore_multi", this.save(py)?)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let Making { seed, channels, .. } = &self.0.making;
        let targets = py.detach(|| self.0.working().tracker.targets().len());
        format!("<foveate.MultiTracker seed={seed} channels={} targets={targets}>", channels.name)
    }
}

/// A tracker of many from its pickle.
#[pyfunction]
#[pyo3(signature = (*pickle))]
pub fn _restore_multi(py: Python<'_>, pickle: Pickle) -> PyResult<PyMultiTracker> {
    Held::restored(py, pickle).map(PyMultiTracker)
}

/// Targets as a `Targets` of arrays.
fn arrays<'py>(py: Python<'py>, targets: &[TrackedTarget]) -> PyResult<Bound<'py, PyAny>> {
    let n = targets.len();
    let each = |value: fn(&TrackedTarget) -> f64| PyArray1::from_iter(py, targets.iter().map(value));
    let boxes = Array2::from_shape_fn((n, 4), |(i, j)| {
        let b = &targets[i].bbox;
        [b.x, b.y, b.w, b.h][j]
    });
    let states = Array2::from_shape_fn((n, 6), |(i, j)| targets[i].state.to_array()[j]);
    let gazes = Array2::from_shape_fn((n, 2), |(i, j)| [targets[i].gaze.u, targets[i].gaze.v][j]);
    let covariances = Array3::from_shape_fn((n, 6, 6), |(i, j, k)| targets[i].covariance[j][k]);
    let all = PyDict::new(py);
    all.set_item("ids", PyArray1::from_iter(py, targets.iter().map(|t| t.id as i64)))?;
    all.set_item("boxes", boxes.into_pyarray(py))?;
    all.set_item("phases", targets.iter().map(|t| t.phase.name()).collect::<Vec<_>>())?;
    all.set_item("states", states.into_pyarray(py))?;
    all.set_item("covariances", covariances.into_pyarray(py))?;
    all.set_item("gazes", gazes.into_pyarray(py))?;
    all.set_item("visible", each(|t| t.visible))?;
    all.set_item("deficit", each(|t| t.deficit))?;
    all.set_item("scores", each(|t| t.detection.map_or(f64::NAN, |d| d.score)))?;
    py.import("foveate._multi")?.getattr("Targets")?.call((), Some(&all))
}
