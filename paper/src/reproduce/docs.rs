//! Results that are part of the repository, and docs/results.md, which is generated from them.

use std::path::Path;

use foveate::{Error, Result, files};

use super::markdown;
use super::plan::EXPERIMENTS;
use super::results::Results;

/// Returns the results in `experiments/results` of a checkout, in the order of the page.
pub(super) fn stored(root: &Path) -> Result<Vec<Results>> {
    let mut all = vec![];
    for (name, _) in EXPERIMENTS {
        let path = root.join("paper/experiments/results").join(format!("{name}.json"));
        if path.is_file() {
            let text = std::fs::read_to_string(&path).map_err(Error::io(&path, "cannot read the results"))?;
            all.push(Results::read(&text, &path.display().to_string())?);
        }
    }
    Ok(all)
}

/// Writes results into a checkout, and regenerates docs/results.md.
pub(super) fn write(root: &Path, fresh: &[&Results]) -> Result<()> {
    let folder = root.join("paper/experiments/results");
    if !root.join("docs").is_dir() || !folder.is_dir() {
        return Err(Error::Invalid(format!(
            "{}: expected a checkout of the project, with docs/ and paper/experiments/results/, for --write-docs",
            root.display()
        )));
    }
    for results in fresh {
        files::write(folder.join(format!("{}.json", results.experiment)), results.json()?.as_bytes())?;
    }
    let all = stored(root)?;
    files::write(root.join("docs/results.md"), markdown::document(&all).as_bytes())
}
