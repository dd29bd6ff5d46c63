//! Generates docs/results.md.

use super::line::Group;
use super::multi_table;
use super::plan::Measure;
use super::results::{Line, Results};

/// Returns the text of docs/results.md.
pub(super) fn document(all: &[Results]) -> String {
    let mut out = String::from(
        "# Results\n\nWritten by `cargo run --release -p paper -- reproduce all --data data --write-docs .`; what is changed here by hand is lost.\n\n",
    );
    out += &conditions(all);
    out += "\n\n## The paper beside ours\n\n";
    out += &summary(all);
    for results in all {
        out += &format!("\n## {}\n\n{}\n\n{}", results.title, results.about, table(results));
        let checks: Vec<String> = results.checks.iter().map(|c| format!("- {}\n", c.text())).collect();
        out += &if checks.is_empty() { String::new() } else { format!("\n{}", checks.concat()) };
        out.truncate(out.trim_end().len());
        out.push('\n');
    }
    out
}

/// Describes the conditions of the results.
fn conditions(all: &[Results]) -> String {
    let Some(first) = all.first() else { return "Nothing was run.".into() };
    format!(
        "{}, {} frames a video. Cells are means over videos with 95 % bootstrap intervals. *Off at end*: the mean error of the last 20\n\
         frames exceeds 15 px. *Difference*: paired by video, from the line of the same settings without a difference, unless another is\n\
         named. The same command gives the same figures. The files in `paper/experiments/results/` also have medians and each digit.",
        first.digits_from, first.frames
    )
}

/// Returns the paper's rows beside the same rows of ours, with each group of settings.
fn summary(all: &[Results]) -> String {
    let mut out = String::from(
        "| table | policy | the paper | as recommended | median | off at end | authors' parameters | as printed |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for results in all.iter().filter(|r| !r.paper.is_empty()) {
        let scene = results.scenes().first().copied().unwrap_or("").to_owned();
        let unit = unit(results);
        let first = |group: Group, row: Option<&str>| {
            let same = |line: &Line| row.map_or(line.policy == "fixed", |row| line.row.as_deref() == Some(row));
            results.lines.iter().find(|line| line.group == group && line.scene == scene && same(line))
        };
        let short = |group, row| first(group, row).map_or("-".into(), |line| short(line, unit));
        let name = results.title.split(':').next().unwrap_or("");
        let rows =
            results.paper.iter().map(|p| (Some(p.row.as_str()), p.row.clone(), format!("{:.2} {unit}", p.average)));
        for (row, shown, paper) in rows.chain([(None, "fixed centre".to_owned(), "-".to_owned())]) {
            let Some(ours) = first(Group::Recommended, row) else { continue };
            let shown = if row.is_some() { format!("{shown}: {}", ours.name) } else { shown };
            out += &format!(
                "| {name} | {shown} | {paper} | {:.2} {unit} [{:.2}, {:.2}] | {:.2} | {:.0} % | {} | {} |\n",
                ours.tally.mean,
                ours.tally.interval[0],
                ours.tally.interval[1],
                ours.tally.median,
                100.0 * ours.tally.off_at_end,
                short(Group::Authors, row),
                short(Group::Printed, row),
            );
        }
    }
    out
}

fn unit(results: &Results) -> &'static str {
    match results.measure {
        Measure::Error => "px",
        Measure::Accuracy => "%",
    }
}

fn short(line: &Line, unit: &str) -> String {
    format!("{:.2} {unit}, {:.0} % off at end", line.tally.mean, 100.0 * line.tally.off_at_end)
}

/// Returns one table for each scene: means, videos off at end, and paired differences, which experiments on single changes omit; or the
/// table of many targets.
fn table(results: &Results) -> String {
    if !results.multi.is_empty() {
        return multi_table::markdown(&results.multi);
    }
    let unit = unit(results);
    let paired = |text: &str| if results.experiment.starts_with("why-") { String::new() } else { format!(" {text} |") };
    let mut out = String::new();
    for scene in results.scenes() {
        let lines: Vec<&Line> = results.lines.iter().filter(|l| l.scene == scene).collect();
        out += &format!(
            "{scene}, {} videos a line:\n\n| line | mean {unit} | off at end |{}\n| --- | --- | --- |{}\n",
            lines.first().map_or(0, |l| l.tally.videos),
            paired("difference"),
            paired("---"),
        );
        for line in &lines {
            let t = &line.tally;
            let usual = lines.iter().find(|l| l.group == line.group && l.tally.against.is_none());
            let difference = match (t.against, &line.other) {
                (Some(d), Some(other)) => {
                    let from =
                        if usual.is_some_and(|l| l.name == *other) { String::new() } else { format!(" from {other}") };
                    format!("{:+.2} [{:+.2}, {:+.2}]{from}", d.mean, d.low, d.high)
                }
                _ => String::new(),
            };
            out += &format!(
                "| {} | {:.2} [{:.2}, {:.2}] | {:.0} % |{}\n",
                line.name,
                t.mean,
                t.interval[0],
                t.interval[1],
                100.0 * t.off_at_end,
                paired(&difference),
            );
        }
        out += "\n";
    }
    out
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::docs;
    use super::*;

    /// docs/results.md agrees with the stored results; with `FOVEATE_WRITE_DOCS` set, the test regenerates it.
    #[test]
    fn documents_agree_with_the_results() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        if std::env::var_os("FOVEATE_WRITE_DOCS").is_some() {
            docs::write(&root, &[]).expect("a checkout");
        }
        let all = docs::stored(&root).expect("results are readable");
        assert!(all.iter().any(|r| r.experiment == "table1"), "results are kept in experiments/results");
        let read = |name: &str| std::fs::read_to_string(root.join(name)).expect("a document");
        let again = "write it anew: FOVEATE_WRITE_DOCS=1 cargo test -p paper documents_agree";
        assert!(read("docs/results.md") == document(&all), "docs/results.md is not of the stored results; {again}");
    }
}
