//! Rows of comma-separated values under a header of column names.

use std::fmt::{Display, Write as _};
use std::path::PathBuf;

use crate::columns::Column;
use foveate_base::Result;
use foveate_base::sink::Sink;

/// Rows as text.
#[derive(Debug, Default)]
pub(super) struct Rows {
    pub text: String,
    /// The number of columns, and of filled columns in the current row.
    columns: usize,
    filled: usize,
}

impl Rows {
    /// Starts the text with the header.
    pub(crate) fn new(names: impl IntoIterator<Item: Display>) -> Self {
        let mut rows = Self { columns: usize::MAX, ..Self::default() };
        names.into_iter().for_each(|name| rows.put(name));
        rows.columns = rows.filled;
        rows.end();
        rows
    }
    /// Adds a cell. Floating-point numbers get the shortest digits that read back as the same number.
    pub(crate) fn put(&mut self, value: impl Display) {
        debug_assert!(self.filled < self.columns, "a row has {} columns", self.columns);
        let comma = if self.filled > 0 { "," } else { "" };
        let _ = write!(self.text, "{comma}{value}");
        self.filled += 1;
    }
    /// Adds several cells.
    pub(crate) fn put_all<'a>(&mut self, values: impl IntoIterator<Item = &'a f64>) {
        values.into_iter().for_each(|value| self.put(value));
    }
    /// Adds a text cell.
    pub(crate) fn put_text(&mut self, text: &str) {
        self.put(quoted(text));
    }
    /// Ends the row; missing cells are empty.
    pub(crate) fn end(&mut self) {
        self.text.extend(std::iter::repeat_n(',', self.columns - self.filled));
        self.text.push('\n');
        self.filled = 0;
    }
}

/// Formats text as a cell: quoted if necessary, and with a leading apostrophe if a spreadsheet would read it as a formula.
pub fn quoted(text: &str) -> String {
    let formula = text.starts_with(['=', '+', '-', '@', '\t', '\r']);
    let text = format!("{}{text}", if formula { "'" } else { "" });
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

/// A CSV file.
#[derive(Debug)]
pub(super) struct Csv {
    file: Sink,
    rows: Rows,
}

impl Csv {
    /// Starts the file with its header. Fails if its folder cannot be written.
    pub(crate) fn create(path: impl Into<PathBuf>, columns: &[Column]) -> Result<Self> {
        Ok(Self::to(Sink::create(path)?, columns))
    }
    /// Writes rows to a sink.
    pub(crate) fn to(file: Sink, columns: &[Column]) -> Self {
        Self { file, rows: Rows::new(columns.iter().map(|c| c.name)) }
    }
    /// Adds rows, each ended with [`Rows::end`], and passes them to the operating system.
    pub(crate) fn write(&mut self, fill: impl FnOnce(&mut Rows)) -> Result<()> {
        fill(&mut self.rows);
        self.file.write(self.rows.text.as_bytes())?;
        self.rows.text.clear();
        self.file.flush()
    }
    /// Gives the file its final name.
    pub(crate) fn finish(&mut self) -> Result<()> {
        if !self.rows.text.is_empty() {
            self.write(|_| ())?;
        }
        self.file.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_filled_up_and_texts_quoted() {
        let mut rows = Rows::new(["a", "b", "c"]);
        rows.put(1);
        rows.put_all(&[0.1, -0.0]);
        rows.end();
        rows.put_text("x, \"y\"");
        rows.end();
        rows.put_text("=1+1");
        rows.put_text("@a,b");
        rows.put_text("a=b");
        rows.end();
        assert_eq!(rows.text, "a,b,c\n1,0.1,-0\n\"x, \"\"y\"\"\",,\n'=1+1,\"'@a,b\",a=b\n");
    }
}
