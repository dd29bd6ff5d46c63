//! Many targets.

use foveate::MultiTracker;
use foveate::Seen;
use foveate::geometry::State;
use numpy::ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray1};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};

use crate::errors::OrRaise;
use crate::held::{Held, Pickle};
use crate::making::{Making, profile_name};
use crate::named::read_box;
use crate::tracker::{detections_of, found};

/// Follows many targets, started by given boxes or by detections.
///
/// The parameters are those of :class:`Tracker`; the default profile is ``"multi"`` (people and cars, with your own
/// detector).
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
pub struct PyMultiTracker {
    held: Held<MultiTracker>,
    /// Names of the classes of detections so far, by number.
    names: Py<PyDict>,
}

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
        let held = Held::new(Making::new(py, profile, config, seed, channels)?).or_raise(py)?;
        Ok(Self { held, names: PyDict::new(py).unbind() })
    }

    /// Tracks all targets in the next picture, given the detections of your detector.
    ///
    /// Parameters
    /// ----------
    /// image : uint8 array, (height, width) or (height, width, channels)
    /// detections : array (n, 4) or (n, 5), or anything with ``xyxy`` and ``confidence``, optional
    ///     Left, top, width, height and score; or for example ``supervision.Detections`` with classes and data, which are copied to the
    ///     targets. Default: none. Give scores if available: without them no track starts beside another target.
    /// lost : bool
    ///     Whether to return targets in the phase "lost" too; their boxes are guesses.
    ///
    /// Returns
    /// -------
    /// Targets
    ///     The targets, by id; ``detection_index`` has the index of the detection of each target.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     A detection is not finite, or has no width or height; the message names it.
    #[pyo3(signature = (image, detections = None, *, lost = false))]
    fn update<'py>(
        &self,
        image: &Bound<'py, PyAny>,
        detections: Option<&Bound<'py, PyAny>>,
        lost: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = image.py();
        let given = detections.map(found).transpose()?;
        let rows = given.as_ref().map(detections_of).transpose()?.unwrap_or_default();
        let targets = self.held.show(image, |tracker, image| {
            let results = tracker.update(image, &rows)?.to_vec();
            Ok(if lost { tracker.targets().to_vec() } else { results })
        })?;
        let names = self.names.bind(py);
        let data = match &given {
            Some(given) => {
                names.update(given.getattr("names")?.cast::<PyDict>()?.as_mapping())?;
                given.getattr("data")?.cast_into::<PyDict>()?
            }
            None => PyDict::new(py),
        };
        arrays(py, &targets, names, &data)
    }

    /// Sets a target's box in the picture of the last update: starts a new target, or restarts an active one. Returns its id, by default
    /// the next free one.
    #[pyo3(signature = (image, r#box, id = None))]
    fn add(&self, image: &Bound<'_, PyAny>, r#box: &Bound<'_, PyAny>, id: Option<u64>) -> PyResult<u64> {
        let bbox = read_box(r#box)?;
        self.held.show(image, |tracker, image| tracker.add(image, id, bbox))
    }

    /// Ends the track of the target with this id permanently: it is not re-identified later. Raises KeyError if no active target has it.
    fn remove(&self, py: Python<'_>, id: u64) -> PyResult<()> {
        match py.detach(|| self.held.working().tracker.remove(id)) {
            true => Ok(()),
            false => Err(PyKeyError::new_err(format!("no target {id} is active"))),
        }
    }

    /// Observes a picture without tracking in it: camera motion and detector compare pictures.
    fn skip(&self, image: &Bound<'_, PyAny>) -> PyResult<()> {
        self.held.show(image, |tracker, image| {
            tracker.skip(image);
            Ok(())
        })
    }

    /// Marks a cut before the next picture: all targets are terminated, and re-identified if they return.
    fn cut(&self, py: Python<'_>) {
        py.detach(|| {
            let mut working = self.held.working();
            working.tracker.cut();
            working.image = None;
        });
    }

    /// All active targets of the last picture, by id, including those in the phase "lost", whose boxes are guesses.
    #[getter]
    fn targets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let targets = py.detach(|| self.held.working().tracker.targets().to_vec());
        arrays(py, &targets, self.names.bind(py), &PyDict::new(py))
    }

    /// Returns the whole state, as JSON in UTF-8; see :meth:`Tracker.save`. It lacks the names of classes; a pickle contains them.
    fn save<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        self.held.save(py)
    }

    /// Restores a state from :meth:`save`, in a tracker of the same configuration, seed and channels, and clears the names of classes; after
    /// an error nothing has changed.
    fn load(&self, py: Python<'_>, saved: &[u8]) -> PyResult<()> {
        self.held.load(py, saved)?;
        self.names.bind(py).clear();
        Ok(())
    }

    /// The configuration as TOML, with every setting.
    #[getter]
    fn config(&self) -> String {
        self.held.making.text()
    }
    /// The seed of all random numbers.
    #[getter]
    fn seed(&self) -> u64 {
        self.held.making.seed
    }
    /// The order of a colour picture's bytes.
    #[getter]
    fn channels(&self) -> &'static str {
        self.held.making.channels.name
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let (py, this) = (slf.py(), slf.get());
        let pickled = this.held.pickled(py, "_restore_multi", this.save(py)?)?;
        let names = this.names.bind(py).copy()?;
        PyTuple::new(py, [pickled.get_item(0)?, pickled.get_item(1)?, names.into_any()])
    }

    fn __setstate__(&self, py: Python<'_>, names: &Bound<'_, PyDict>) -> PyResult<()> {
        self.names.bind(py).update(names.as_mapping())
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let Making { seed, channels, .. } = &self.held.making;
        let targets = py.detach(|| self.held.working().tracker.targets().len());
        format!("<foveate.MultiTracker seed={seed} channels={} targets={targets}>", channels.name)
    }
}

/// A tracker of many from its pickle.
#[pyfunction]
#[pyo3(signature = (*pickle))]
pub(crate) fn _restore_multi(py: Python<'_>, pickle: Pickle) -> PyResult<PyMultiTracker> {
    let held = Held::restored(py, pickle)?;
    Ok(PyMultiTracker { held, names: PyDict::new(py).unbind() })
}

/// Returns targets as a `Targets` of arrays, with the names of classes, and the data of the detections.
fn arrays<'py>(
    py: Python<'py>,
    targets: &[Seen<'_>],
    names: &Bound<'py, PyDict>,
    data: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyAny>> {
    let n = targets.len();
    let each = |value: fn(&Seen<'_>) -> f64| PyArray1::from_iter(py, targets.iter().map(value));
    let boxes = Array2::from_shape_fn((n, 4), |(i, j)| {
        let b = &targets[i].bbox;
        [b.x, b.y, b.w, b.h][j]
    });
    let states = Array2::from_shape_fn((n, State::N), |(i, j)| targets[i].state.to_array()[j]);
    let gazes = Array2::from_shape_fn((n, 2), |(i, j)| [targets[i].gaze.u, targets[i].gaze.v][j]);
    let covariances = Array3::from_shape_fn((n, State::N, State::N), |(i, j, k)| targets[i].covariance[j][k]);
    let all = PyDict::new(py);
    all.set_item("ids", PyArray1::from_iter(py, targets.iter().map(|t| t.id as i64)))?;
    all.set_item("boxes", boxes.into_pyarray(py))?;
    all.set_item("phases", targets.iter().map(|t| t.phase.name()).collect::<Vec<_>>())?;
    all.set_item("states", states.into_pyarray(py))?;
    all.set_item("covariances", covariances.into_pyarray(py))?;
    all.set_item("gazes", gazes.into_pyarray(py))?;
    all.set_item("visible", each(|t| t.visible))?;
    all.set_item("deficit", each(|t| t.consistency.deficit))?;
    all.set_item("scores", each(|t| t.detection.map_or(f64::NAN, |d| d.score)))?;
    all.set_item("class_ids", PyArray1::from_iter(py, targets.iter().map(|t| number(t.detected_class))))?;
    all.set_item("detection_index", PyArray1::from_iter(py, targets.iter().map(|t| number(t.detection_index))))?;
    py.import("foveate._multi")?.getattr("targets")?.call1((all, names, data))
}

/// A number, -1 where there is none.
fn number(number: Option<usize>) -> i64 {
    number.map_or(-1, |number| number as i64)
}
