//! Fault-tolerant outputs: if a file cannot be written (a full disk, a film too large for its format), only that file is missing, and the
//! run continues.

use std::cell::RefCell;
use std::rc::Rc;

use foveate::report::Observer;
use foveate::video::Frame;
use foveate::{Error, Result, Seen};

/// The files that could not be written, each with the reason. Clones share one list.
#[derive(Clone, Default)]
pub(crate) struct FailedOutputs(Rc<RefCell<Vec<(&'static str, String)>>>);

impl FailedOutputs {
    /// The names of the files.
    pub(crate) fn names(&self) -> Vec<&'static str> {
        self.0.borrow().iter().map(|(name, _)| *name).collect()
    }

    /// Fails with the names of the files, if there are any; those in `cut` have a beginning.
    pub(crate) fn check(&self, cut: &[&str]) -> Result<()> {
        match &self.0.borrow()[..] {
            [] => Ok(()),
            failed => {
                let is_cut = |name: &str| cut.contains(&name);
                let alike = failed.chunk_by(|a, b| (is_cut(a.0), &a.1) == (is_cut(b.0), &b.1));
                let of = |alike: &[(&str, String)]| {
                    let names: Vec<&str> = alike.iter().map(|(name, _)| *name).collect();
                    let how = match (is_cut(names[0]), names.len()) {
                        (true, 1) => "ends early",
                        (true, _) => "end early",
                        (false, 1) => "was not written",
                        (false, _) => "were not written",
                    };
                    format!("{} {how}: {}", names.join(", "), alike[0].1)
                };
                let all: Vec<_> = alike.map(of).collect();
                Err(Error::Invalid(all.join("; ")))
            }
        }
    }

    /// Returns a fault-tolerant observer that writes `files` for the first frames of a run: its first failure ends only this observer.
    pub(crate) fn tolerate(
        &self,
        files: &'static [&'static str],
        observer: impl Observer + 'static,
        frames: usize,
    ) -> Box<dyn Observer> {
        Box::new(Tolerant { observer: Some(observer), files, frames, failed: self.clone() })
    }
}

/// An observer until it fails.
struct Tolerant<O> {
    observer: Option<O>,
    files: &'static [&'static str],
    /// Number of frames that the observer still receives.
    frames: usize,
    failed: FailedOutputs,
}

impl<O> Tolerant<O> {
    fn call(&mut self, call: impl FnOnce(&mut O) -> Result<()>) -> Result<()> {
        if let Some(Err(error)) = self.observer.as_mut().map(call) {
            self.observer = None;
            let why = error.to_string();
            self.failed.0.borrow_mut().extend(self.files.iter().map(|name| (*name, why.clone())));
        }
        Ok(())
    }
}

impl<O: Observer> Observer for Tolerant<O> {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        if self.frames == 0 {
            return Ok(());
        }
        self.frames -= 1;
        self.call(|observer| observer.observe(frame, targets))
    }
    fn finish(&mut self) -> Result<()> {
        self.call(Observer::finish)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reason_of_several_files_is_given_once() {
        let failed = FailedOutputs::default();
        failed.0.borrow_mut().extend([("a", "full"), ("b", "full"), ("c", "full")].map(|(n, why)| (n, why.to_owned())));
        let said = failed.check(&["c"]).expect_err("three files").to_string();
        assert_eq!(said, "a, b were not written: full; c ends early: full");
    }
}
