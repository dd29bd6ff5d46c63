//! The named tuples of `foveate._types`, and boxes from any four numbers.

use foveate::BBox;
use foveate::geometry::State;
use foveate::seen::Region;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyTuple;

fn make<'py>(py: Python<'py>, name: &str, values: &Bound<'py, PyTuple>) -> PyResult<Bound<'py, PyAny>> {
    static MODULE: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    let module = MODULE.get_or_try_init(py, || py.import("foveate._types").map(Bound::unbind))?;
    module.bind(py).getattr(name)?.call1(values.clone())
}

/// Returns a `Box`.
pub(crate) fn bbox<'py>(py: Python<'py>, b: &BBox) -> PyResult<Bound<'py, PyAny>> {
    make(py, "Box", &PyTuple::new(py, [b.x, b.y, b.w, b.h])?)
}

/// Returns a `State`.
pub(crate) fn state<'py>(py: Python<'py>, state: &State) -> PyResult<Bound<'py, PyAny>> {
    make(py, "State", &PyTuple::new(py, state.to_array())?)
}

/// Returns a `Region`.
pub(crate) fn region<'py>(py: Python<'py>, r: &Region) -> PyResult<Bound<'py, PyAny>> {
    make(py, "Region", &PyTuple::new(py, [r.x, r.y, r.half[0], r.half[1], r.turn])?)
}

/// Reads four numbers: left, top, width, height.
pub(crate) fn read_box(given: &Bound<'_, PyAny>) -> PyResult<BBox> {
    let wrong = |found: String| {
        PyTypeError::new_err(format!(
            "a box is four numbers, left, top, width and height in pixels from 0; it is {found}"
        ))
    };
    let kind = || given.get_type().name().map_or_else(|_| "something else".into(), |name| format!("of type {name}"));
    // Shorten long values, such as pictures, in the message.
    let short = |text: &String| text.chars().count() <= 100;
    let shown = || given.repr().ok().map(|text| text.to_string()).filter(short).unwrap_or_else(kind);
    let numbers: Vec<f64> = given
        .try_iter()
        .and_then(|all| all.take(5).map(|n| n?.extract::<f64>()).collect())
        .map_err(|_| wrong(shown()))?;
    let [x, y, w, h] = numbers[..] else { return Err(wrong(shown())) };
    Ok(BBox::new(x, y, w, h))
}
