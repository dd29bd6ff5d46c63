//! The dictionary of all files and their columns.

use std::fmt::Write as _;

use super::{Column, FILES, OutputFile};

/// The dictionary of all files, as Markdown: a heading, a sentence and a table for each file. The covariances are one row. Columns that
/// an earlier file has, with the same unit and meaning, perhaps inside another key, are named in a sentence.
pub fn dictionary() -> String {
    let mut text = String::new();
    for (at, file) in FILES.iter().enumerate() {
        let has = |other: &OutputFile, column: &Column| other.columns.iter().any(|o| o.is_inside(column));
        let earlier = |column: &&Column| FILES[..at].iter().find(|other| has(other, column));
        let _ = write!(text, "## `{}`\n\n{}\n\n", file.name, file.line);
        for other in &FILES[..at] {
            let shared = file.columns.iter().filter(|column| earlier(column).is_some_and(|o| o.name == other.name));
            let names: Vec<String> = shared.map(|column| format!("`{}`", column.name)).collect();
            if !names.is_empty() {
                let _ = write!(text, "As in `{}`: {}.\n\n", other.name, names.join(", "));
            }
        }
        text.push_str("| column | unit | meaning |\n| --- | --- | --- |\n");
        for column in file.columns.iter().filter(|column| earlier(column).is_none()) {
            let from = column.from.map(|n| format!(", from {n}")).unwrap_or_default();
            let cells = match column.name.strip_prefix("cov_") {
                None => [
                    format!("`{}`", column.name),
                    format!("{}{from}", column.unit).trim_start_matches(", ").to_owned(),
                    column.meaning.to_owned(),
                ],
                Some("x_x") => [
                    "`cov_x_x` to `cov_log_aspect_log_aspect`".to_owned(),
                    "product of theirs".to_owned(),
                    "Covariances of x, y, vx, vy, log_scale, angle and log_aspect: the upper triangle, row by row. Those of the particles; with box regression plus the squares of its expected errors of size and shape; of x and y those of the [error of the centre](confidence.md#where-is-the-target)."
                        .to_owned(),
                ],
                Some(_) => continue,
            };
            let _ = writeln!(text, "| {} |", cells.map(|cell| cell.replace('|', "\\|")).join(" | "));
        }
        text.push('\n');
    }
    text
}
