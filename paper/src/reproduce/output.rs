//! The output of an experiment: a table or a figure, with pictures.

use std::path::Path;

use foveate::{Error, Result, files};
use serde_json::Value;

use super::results::Results;

/// One experiment on the page.
pub(super) struct Section {
    pub name: String,
    pub title: String,
    pub about: String,
    pub content: Content,
}

pub(super) enum Content {
    Table(Box<Table>),
    Figure(Figure),
}

/// A table with its pictures, and the machine-dependent frames per second of each line, if known.
pub(super) struct Table {
    pub results: Results,
    pub speeds: Vec<Option<f64>>,
    pub pictures: Vec<Picture>,
}

/// Pictures, the numbers behind them, and remarks.
#[derive(Default)]
pub(super) struct Figure {
    pub pictures: Vec<Picture>,
    pub numbers: Vec<Value>,
    /// Aligned text; may be empty.
    pub text: String,
    /// Missing parts, with the reasons.
    pub missing: Vec<String>,
}

/// A picture of the page.
pub(super) struct Picture {
    /// Its file's name: `.png` or `.svg`.
    pub file: String,
    pub caption: String,
    pub bytes: Vec<u8>,
}

impl Section {
    pub(super) fn results(&self) -> Option<&Results> {
        match &self.content {
            Content::Table(table) => Some(&table.results),
            Content::Figure(_) => None,
        }
    }

    /// Writes the files: results and pictures.
    pub(super) fn write(&self, out: &Path) -> Result<()> {
        let (pictures, json) = match &self.content {
            Content::Table(table) => {
                files::write_inside(out.join(format!("{}.csv", self.name)), table.results.csv().as_bytes())?;
                (&table.pictures, table.results.json()?)
            }
            Content::Figure(figure) => {
                if !figure.text.is_empty() {
                    files::write_inside(out.join(format!("{}.txt", self.name)), figure.text.as_bytes())?;
                }
                (&figure.pictures, serde_json::to_string(&figure.numbers).map_err(|e| Error::Invalid(e.to_string()))?)
            }
        };
        files::write_inside(out.join(format!("{}.json", self.name)), json.as_bytes())?;
        pictures.iter().try_for_each(|picture| files::write_inside(out.join(&picture.file), &picture.bytes))
    }
}

impl Picture {
    /// Creates the picture of a file that was just written into a folder.
    pub(super) fn read(out: &Path, file: String, caption: String) -> Result<Self> {
        let path = out.join(&file);
        let bytes = std::fs::read(&path).map_err(Error::io(&path, "cannot read the picture just written"))?;
        Ok(Self { file, caption, bytes })
    }
}
