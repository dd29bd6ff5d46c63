//! The Python package's extension module: `python/foveate` is what users import.
//!
//! It adds no algorithm: arguments are read, errors become exceptions, and the work is the crate `foveate`'s, without the
//! interpreter's lock.
#![forbid(unsafe_code)]
#![allow(missing_debug_implementations)] // Rust code never holds these types; Python reads their `__repr__`

mod bandits;
mod draw;
mod errors;
mod export;
mod held;
mod learn;
mod making;
mod measure;
mod multi;
mod named;
mod parts;
mod pictures;
mod result;
mod threads;
mod tracker;
mod video;

/// The extension module.
#[pyo3::pymodule]
mod _foveate {
    use crate::errors::OrRaise;
    use pyo3::prelude::*;
    use std::ffi::OsString;
    use std::path::PathBuf;

    #[pymodule_export]
    use crate::bandits::{PyOptimiser, PyPolicy};
    #[pymodule_export]
    use crate::draw::draw_marks;
    #[pymodule_export]
    use crate::export::export_boxes;
    #[pymodule_export]
    use crate::learn::{learn_codes, learn_fit, learn_scores, softmax_fit};
    #[pymodule_export]
    use crate::measure::measure_tracks;
    #[pymodule_export]
    use crate::multi::{_restore_multi, PyMultiTracker};
    #[pymodule_export]
    use crate::parts::{score_mot, score_ope, select};
    #[pymodule_export]
    use crate::result::{_restore_result, Estimate};
    #[pymodule_export]
    use crate::tracker::{_restore_tracker, PyTracker};
    #[pymodule_export]
    use crate::video::PyVideo;

    #[pymodule_export]
    const __VERSION__: &str = env!("CARGO_PKG_VERSION");

    /// Runs the program with these arguments, its name first; `program` is the file that has its code.
    #[pyfunction]
    fn run_program(py: Python<'_>, arguments: Vec<OsString>, program: PathBuf) -> u8 {
        py.detach(|| foveate_cli::main(arguments, program))
    }

    /// Sets the number of threads of every update from now on, 0 for all processors; results do not depend on it.
    #[pyfunction]
    fn set_threads(py: Python<'_>, threads: usize) -> PyResult<()> {
        crate::threads::set(threads).or_raise(py)
    }

    /// Sets the memory limit for pictures, targets and settings, such as ``"6G"`` or ``"512M"``; exceeding it is an error.
    /// ``None`` is the default, a quarter of the machine's memory. Results do not depend on it.
    ///
    /// Raises
    /// ------
    /// foveate.InputError
    ///     The size is invalid or less than 16M.
    #[pyfunction]
    fn set_max_memory(py: Python<'_>, size: Option<&str>) -> PyResult<()> {
        let bytes = size.map(foveate::memory::parse).transpose().map_err(foveate::Error::Invalid).or_raise(py)?;
        foveate::memory::set_limit(bytes.unwrap_or(0));
        Ok(())
    }

    /// Returns a page in the style of the reports. `title` is text; the first sentence, one more line, and the body are HTML.
    #[pyfunction]
    fn document(title: &str, verdict: &str, about: &str, body: &str) -> String {
        foveate::report::document(title, verdict, about, body)
    }

    /// Returns the names of the shipped configurations: each is a profile.
    #[pyfunction]
    fn configurations() -> Vec<&'static str> {
        foveate::Config::names()
    }
}
