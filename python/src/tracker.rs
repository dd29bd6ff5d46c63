//! One target.

use foveate::{BBox, Detection, Status, Tracker};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyTuple};
use std::sync::{Mutex, PoisonError};

use crate::errors::{OrRaise, input};
use crate::held::{Held, Pickle};
use crate::making::{Making, profile_name};
use crate::named::read_box;
use crate::result::Seen;

/// Follows one target through video.
///
/// Parameters
/// ----------
/// profile : str
///     ``"balanced"``, ``"fast"`` (nearly three times the speed), ``"accurate"`` (three trackers that vote: fewest failures, a third of the
///     speed), or the name of any shipped configuration: :func:`foveate.configurations` lists them.
/// config : dict, path or str, optional
///     A dict changes settings of the profile: ``{"particles": 400, "policy.kind": "hedge"}``. A path (``str`` or
///     ``os.PathLike``) is a TOML file that replaces the profile; a ``str`` of more than one line is the TOML itself.
/// seed : int, optional
///     Seed of all random numbers: the same seed gives the same track, bit for bit. Default: the configuration's seed, which is 1 in
///     the shipped ones.
/// channels : str
///     The order of a colour picture's bytes: ``"rgb"`` (PIL, imageio), ``"bgr"`` (OpenCV), ``"rgba"`` or ``"bgra"``. Pictures of
///     shape (height, width) are always grey.
///
/// Raises
/// ------
/// foveate.ConfigError
///     There is no such profile, a setting is misspelled or out of range.
/// foveate.FileError
///     A configuration or a model file cannot be read.
///
/// Examples
/// --------
/// >>> import numpy as np, foveate
/// >>> def picture(t):
/// ...     image = np.arange(160 * 120, dtype=np.uint8).reshape(120, 160) % 7
/// ...     image[40:64, 50 + 4 * t : 74 + 4 * t] = 200
/// ...     return image
/// >>> tracker = foveate.Tracker("fast")
/// >>> seen = tracker.init(picture(0), (46, 36, 32, 32))
/// >>> for t in range(1, 8):
/// ...     ok, box = tracker.update(picture(t))
/// >>> ok, abs(box.x - 74) < 4
/// (True, True)
#[pyclass(frozen, module = "foveate", name = "Tracker")]
pub struct PyTracker(Held<Tracker>, Mutex<Option<Status>>);

impl PyTracker {
    fn of(held: Held<Tracker>) -> Self {
        Self(held, Mutex::default())
    }

    /// Converts the result for Python; logs a change of status.
    fn result(&self, py: Python<'_>, seen: Seen) -> PyResult<Py<PyAny>> {
        let status = seen.status();
        let before = self.1.lock().unwrap_or_else(PoisonError::into_inner).replace(status);
        let result = seen.into_result(py, self.0.making.channels.name)?;
        if before.is_some_and(|before| before != status) {
            py.import("foveate._result")?.call_method1("log_status", (&result,))?;
        }
        Ok(result)
    }
}

#[pymethods]
impl PyTracker {
    #[new]
    #[pyo3(signature = (profile = "balanced", config = None, seed = None, *, channels = "rgb"))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = profile_name)] profile: &str,
        config: Option<&Bound<'_, PyAny>>,
        seed: Option<u64>,
        channels: &str,
    ) -> PyResult<Self> {
        Held::new(Making::new(py, profile, config, seed, channels)?).or_raise(py).map(Self::of)
    }

    /// Starts or restarts on the target in this box. A restart resets all learned models and the random streams, so that the tracker
    /// continues as a new one would, bit for bit. It keeps only the earlier pictures used by the detector and the camera motion.
    ///
    /// Parameters
    /// ----------
    /// image : uint8 array, (height, width) or (height, width, channels)
    ///     Any strides; read in place. Colour and grey pictures cannot be mixed.
    /// box : four numbers
    ///     Left, top, width, height; pixels from 0. At least 2 x 2 pixels, touching the picture.
    ///
    /// Returns
    /// -------
    /// Result
    ///     The result of the picture with the given box: the box itself, P(lost) 0, no particles.
    ///
    /// Raises
    /// ------
    /// TypeError
    ///     The picture is not an array of uint8, or the box is not four numbers.
    /// foveate.InputError
    ///     The shape of the picture does not match its channels, or the box is empty, not finite or outside; nothing has changed.
    #[pyo3(signature = (image, r#box))]
    fn init(&self, image: &Bound<'_, PyAny>, r#box: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
        let bbox = read_box(r#box)?;
        self.0.show(image, |tracker, image| tracker.init(image, bbox))?;
        self.result(image.py(), Seen::given(bbox))
    }

    /// Tracks the target in the next picture of the video.
    ///
    /// Parameters
    /// ----------
    /// image : uint8 array
    ///     As in :meth:`init`, of the same size.
    ///
    /// Returns
    /// -------
    /// Result
    ///     Unpacks to ``ok, box``.
    ///
    /// Raises
    /// ------
    /// foveate.InputError
    ///     There is no target yet, or the picture has another size than the first.
    fn update(&self, image: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
        let seen = self.0.show(image, |tracker, image| Ok(Seen::of(&tracker.update(image)?)))?;
        self.result(image.py(), seen)
    }

    /// Tracks the target in the next picture with the detections of your detector, which replace those of the configuration's detector.
    ///
    /// Parameters
    /// ----------
    /// image : uint8 array
    ///     As in :meth:`update`.
    /// detections : array (n, 4) or (n, 5), or anything with ``xyxy`` and ``confidence``
    ///     Left, top, width, height and, in a fifth column, score; or for example ``supervision.Detections``.
    ///
    /// Raises
    /// ------
    /// foveate.InputError
    ///     As :meth:`update`; or the configuration uses no detections. ``config={"detection_likelihood.place": 0.2}`` makes them weight
    ///     particles; ``config={"proposal.kind": "mixture", "dynamics.tail_probability": 0}`` makes them move particles.
    fn update_with(&self, image: &Bound<'_, PyAny>, detections: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
        let found = detections_of(&found(detections)?)?;
        let seen = self.0.show(image, |tracker, image| Ok(Seen::of(&tracker.update_with(image, &found)?)))?;
        self.result(image.py(), seen)
    }

    /// Follows the target through a video, picture by picture: an iterator of results, which holds one picture at a time.
    ///
    /// Parameters
    /// ----------
    /// video : Video, path, camera index, or iterable of pictures
    ///     A path, an address or a camera's number is opened as :class:`Video` and closed at the end.
    /// box : four numbers, optional
    ///     The target in the first picture, as in :meth:`init`. Omit it to continue with the current target.
    /// progress : bool, optional
    ///     Whether to show progress on standard error. Default: only if it is a terminal.
    ///
    /// Yields
    /// ------
    /// Result
    ///     One for each picture, including the first. ``image`` is the picture until the next one is read; ``frame`` and ``time``
    ///     give its place in the video.
    ///
    /// Raises
    /// ------
    /// foveate.InputError
    ///     There is no target and no box.
    ///
    /// Examples
    /// --------
    /// >>> import foveate
    /// >>> tracker = foveate.Tracker("fast")
    /// >>> for seen in tracker.track("walk.mp4", (40, 30, 24, 24)):  # doctest: +SKIP
    /// ...     print(seen.frame, seen.time, seen.box.rounded(), seen.p_lost)
    #[pyo3(signature = (video, r#box = None, *, progress = None))]
    fn track<'py>(
        slf: &Bound<'py, Self>,
        video: &Bound<'py, PyAny>,
        r#box: Option<&Bound<'py, PyAny>>,
        progress: Option<bool>,
    ) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("foveate._track")?.call_method1("track", (slf, video, r#box, progress))
    }

    /// Observes a picture without tracking: before the target is given, or before the first update after :meth:`load`. Camera motion and
    /// detector compare pictures.
    fn skip(&self, image: &Bound<'_, PyAny>) -> PyResult<()> {
        self.0.show(image, |tracker, image| tracker.skip(image))
    }

    /// Moves the target to this box: particles start around it, and P(lost) is 0 until the next picture. Everything else stays: the
    /// template, the learned models, and the random streams, which continue.
    #[pyo3(signature = (r#box))]
    fn reset_at(&self, py: Python<'_>, r#box: &Bound<'_, PyAny>) -> PyResult<()> {
        let bbox: BBox = read_box(r#box)?;
        py.detach(|| self.0.working().tracker.reset_at(bbox)).or_raise(py)
    }

    /// Predicts the box and its covariance ``dt`` frames after the last picture, from the dynamics. The tracker does not change; status and
    /// P(lost) are those of the last picture.
    ///
    /// Parameters
    /// ----------
    /// dt : float
    ///     Frames, 0 or more; multiply seconds by the frame rate. Between whole frames mean and covariance are interpolated.
    ///
    /// Returns
    /// -------
    /// Result
    ///     Without particles. The box may lie outside the picture.
    ///
    /// Raises
    /// ------
    /// foveate.InputError
    ///     There is no result yet, also after :meth:`load`, and in a copy or from a pickle, until the next update; or ``dt`` is out
    ///     of range.
    fn predict(&self, py: Python<'_>, dt: f64) -> PyResult<Py<PyAny>> {
        let seen = py.detach(|| self.0.working().tracker.predict(dt).map(|seen| Seen::of(&seen))).or_raise(py)?;
        seen.into_result(py, self.0.making.channels.name)
    }

    /// Predicts as :meth:`predict` does, for a time in seconds on the clock of :meth:`set_time`: that of the motor's action.
    ///
    /// Raises
    /// ------
    /// foveate.InputError
    ///     As :meth:`predict`; or fewer than two pictures have a time, or it lies before the last picture.
    fn predict_at(&self, py: Python<'_>, seconds: f64) -> PyResult<Py<PyAny>> {
        let seen =
            py.detach(|| self.0.working().tracker.predict_at(seconds).map(|seen| Seen::of(&seen))).or_raise(py)?;
        seen.into_result(py, self.0.making.channels.name)
    }

    /// Sets the time of the next picture, seconds from any origin. If frames were dropped before it, the particles move for as many frames
    /// more, 30 at most; at a constant rate nothing changes. :meth:`track` calls it for videos.
    fn set_time(&self, py: Python<'_>, seconds: f64) -> PyResult<()> {
        if !seconds.is_finite() {
            return Err(input(py, format!("a time is a finite number of seconds; it is {seconds}")));
        }
        py.detach(|| self.0.working().tracker.set_time(seconds));
        Ok(())
    }

    /// Sets the fraction of the target that the next pictures can show, 0 to 1, if something covers it; 1 by default.
    fn set_visibility(&self, py: Python<'_>, visible: f64) -> PyResult<()> {
        if !(0.0..=1.0).contains(&visible) {
            return Err(input(py, format!("visibility is a share, 0 to 1; it is {visible}")));
        }
        py.detach(|| self.0.working().tracker.set_visibility(visible));
        Ok(())
    }

    /// Returns the whole state during a video, as JSON in UTF-8, for :meth:`load` in a tracker of the same configuration and seed.
    ///
    /// It lacks the last picture, which detector and camera motion need: call :meth:`skip` with it before the next update. A pickle
    /// contains that picture. Neither contains the background model of a detector (``kind = "motion"``, ``"walkers"``), which is learned
    /// again.
    fn save<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        self.0.save(py)
    }

    /// Restores a state from :meth:`save` in a tracker of the same configuration, seed and channels. After an error the tracker needs a
    /// new :meth:`init`.
    ///
    /// Raises
    /// ------
    /// foveate.InputError
    ///     The state is invalid, of another version, or of another configuration, seed or order of channels: the message names
    ///     the difference. The contents of model files are not compared.
    fn load(&self, py: Python<'_>, saved: &[u8]) -> PyResult<()> {
        self.0.load(py, saved)
    }

    /// Whether there is a target: it was given, or loaded.
    #[getter]
    fn has_target(&self, py: Python<'_>) -> bool {
        py.detach(|| self.0.working().tracker.has_target())
    }
    /// The configuration as TOML, with every setting.
    #[getter]
    fn config(&self) -> String {
        self.0.making.text()
    }
    /// The seed of all random numbers.
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
        this.0.pickled(py, "_restore_tracker", this.save(py)?)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let Making { seed, channels, .. } = &self.0.making;
        let target = if self.has_target(py) { "" } else { ", no target yet" };
        format!("<foveate.Tracker seed={seed} channels={}{target}>", channels.name)
    }
}

/// A tracker from its pickle.
#[pyfunction]
#[pyo3(signature = (*pickle))]
pub(crate) fn _restore_tracker(py: Python<'_>, pickle: Pickle) -> PyResult<PyTracker> {
    Held::restored(py, pickle).map(PyTracker::of)
}

/// Converts the detections of a frame from any form to a `foveate._detections.Found`.
pub(crate) fn found<'py>(given: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    given.py().import("foveate._detections")?.call_method1("read", (given,))
}

/// Converts a `Found` to the tracker's detections.
pub(crate) fn detections_of(found: &Bound<'_, PyAny>) -> PyResult<Vec<Detection>> {
    let rows: PyReadonlyArray2<'_, f64> = found.getattr("rows")?.extract()?;
    let classes: PyReadonlyArray1<'_, i64> = found.getattr("classes")?.extract()?;
    debug_assert_eq!(rows.shape()[1], 5, "it has five columns");
    let one = |(row, class): (numpy::ndarray::ArrayView1<'_, f64>, &i64)| Detection {
        class: usize::try_from(*class).ok(),
        ..Detection::new(BBox::new(row[0], row[1], row[2], row[3]), row[4])
    };
    Ok(rows.as_array().rows().into_iter().zip(classes.as_array()).map(one).collect())
}
