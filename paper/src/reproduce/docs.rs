//! Results that are part of the repository, and docs/results.md, which is generated from them.

use std::path::Path;

use foveate::{Error, Result, files};

use super::markdown;
use super::plan::EXPERIMENTS;
use super::results::Results;
use super::setup::Setup;

/// The results in a checkout.
const RESULTS: &str = "paper/experiments/results";

/// Returns the results in `experiments/results` of a checkout, in the order of the page.
pub(super) fn stored(root: &Path) -> Result<Vec<Results>> {
    let mut all = vec![];
    for (name, _) in EXPERIMENTS {
        let path = root.join(RESULTS).join(format!("{name}.json"));
        if path.is_file() {
            let text = std::fs::read_to_string(&path).map_err(Error::io(&path, "cannot read the results"))?;
            all.push(Results::read(&text, &path.display().to_string())?);
        }
    }
    Ok(all)
}

/// Checks before the runs that their results can be written into a checkout.
pub(super) fn check(root: &Path, setup: &Setup) -> Result<()> {
    if !setup.mnist {
        return Err(Error::Invalid(format!(
            "{}: --write-docs expects MNIST's test files there, found none; name their folder with --data DIR",
            setup.data.display()
        )));
    }
    if !root.join("docs").is_dir() || !root.join(RESULTS).is_dir() {
        return Err(Error::Invalid(format!(
            "{}: expected a checkout of the project, with docs/ and paper/experiments/results/, for --write-docs",
            root.display()
        )));
    }
    Ok(())
}

/// Writes results into a checkout, and regenerates docs/results.md.
pub(super) fn write(root: &Path, fresh: &[&Results]) -> Result<()> {
    for results in fresh {
        files::write(root.join(RESULTS).join(format!("{}.json", results.experiment)), results.json()?.as_bytes())?;
    }
    let all = stored(root)?;
    files::write(root.join("docs/results.md"), markdown::document(&all).as_bytes())
}
