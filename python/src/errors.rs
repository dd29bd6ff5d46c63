//! Converts foveate's errors to Python exceptions.

use foveate::{Error, memory};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

/// Returns an exception of a class of `foveate.errors`.
fn raise(py: Python<'_>, name: &str, text: String) -> PyErr {
    static MODULE: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    let found = MODULE.get_or_try_init(py, || py.import("foveate.errors").map(Bound::unbind));
    let class = found.and_then(|module| Ok(module.bind(py).getattr(name)?.cast_into::<PyType>()?));
    match class {
        Ok(class) => PyErr::from_type(class, text),
        Err(error) => error,
    }
}

/// Returns the exception for an invalid value from the caller.
pub(crate) fn input(py: Python<'_>, text: impl Into<String>) -> PyErr {
    raise(py, "InputError", text.into())
}

/// Returns the exception for an [`Error`].
pub(crate) fn of(py: Python<'_>, error: &Error) -> PyErr {
    let class = match error {
        Error::Config(_) => "ConfigError",
        Error::Invalid(_) | Error::Memory(_) => "InputError",
        _ => "FileError",
    };
    let text = error.to_string().replace(memory::ADVICE, "allow more with foveate.set_max_memory(\"6G\")");
    raise(py, class, text)
}

/// Converts errors of results to Python exceptions.
pub(crate) trait OrRaise<T> {
    /// Returns the value, or the corresponding exception.
    fn or_raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T> OrRaise<T> for foveate::Result<T> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|error| of(py, &error))
    }
}
