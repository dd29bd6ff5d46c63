//! Generates docs/results.md.

use super::line::Group;
use super::multi_table;
use super::plan::Measure;
use super::results::{Line, Results};

/// Returns the text of docs/results.md.
pub(super) fn document(all: &[Results]) -> String {
    let mut out = String::from(
        "# Results\n\n`cargo run --release -p paper -- reproduce all --data data --write-docs .` writes this page; do not edit it.\n\n",
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
        "{}, {} frames a video. Cells are means over videos with 95 % bootstrap intervals. *Off at end*, *off*: share of videos whose mean\n\
         error in the last 20 frames exceeds 15 px. *Difference*: paired by video, from the line of the same settings that has no\n\
         difference, unless another is named. The command always gives the same figures. The files in `paper/experiments/results/` also\n\
         have medians and the figures of each digit.",
        first.digits_from, first.frames
    )
}

/// Returns the paper's rows beside the same rows of ours, with each group of settings.
fn summary(all: &[Results]) -> String {
    let mut out = String::from(
        "| table | policy | the paper | as recommended | median | off, % | authors' parameters: mean, off | as printed: mean, off |\n\
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
                "| {name} | {shown} | {paper} | {:.2} {unit} [{:.2}, {:.2}] | {:.2} | {:.0} | {} | {} |\n",
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
    format!("{:.2} {unit}, {:.0} %", line.tally.mean, 100.0 * line.tally.off_at_end)
}

/// Returns the tables of the scenes: means, videos off at end, and paired differences, which experiments on single changes omit; or the
/// table of many targets. Scenes with the same lines share a table.
fn table(results: &Results) -> String {
    if !results.multi.is_empty() {
        return multi_table::markdown(&results.multi);
    }
    let mut groups: Vec<Vec<Scene>> = vec![];
    for name in results.scenes() {
        let lines = results.lines.iter().filter(|l| l.scene == name).collect();
        let scene = Scene { name, lines };
        match groups.last_mut().filter(|group| group[0].has_lines_of(&scene)) {
            Some(group) => group.push(scene),
            None => groups.push(vec![scene]),
        }
    }
    groups.iter().map(|scenes| joined(scenes, unit(results), !results.experiment.starts_with("why-"))).collect()
}

/// The lines of a table that were run in one scene.
struct Scene<'a> {
    name: &'a str,
    lines: Vec<&'a Line>,
}

impl Scene<'_> {
    fn has_lines_of(&self, other: &Scene<'_>) -> bool {
        let same = |(a, b): (&&Line, &&Line)| a.name == b.name && a.tally.videos == b.tally.videos;
        self.lines.len() == other.lines.len() && self.lines.iter().zip(&other.lines).all(same)
    }

    /// Returns the paired difference of line `at`, and its reference if that is not the line of the same settings.
    fn difference(&self, at: usize) -> String {
        let line = self.lines[at];
        let (Some(d), Some(other)) = (line.tally.against, &line.other) else { return String::new() };
        let usual = self.lines.iter().find(|l| l.group == line.group && l.tally.against.is_none());
        let settings = |name: &str| name.split_once(": ").map(|(settings, _)| settings.to_owned());
        let same = settings(other).is_some_and(|s| Some(s) == settings(&line.name));
        let from =
            if same || usual.is_some_and(|l| l.name == *other) { String::new() } else { format!(" from {other}") };
        format!("{:+.2} [{:+.2}, {:+.2}]{from}", d.mean, d.low, d.high)
    }
}

/// Returns one table of scenes that have the same lines: three columns for each scene, or two without differences.
fn joined(scenes: &[Scene<'_>], unit: &str, paired: bool) -> String {
    let [first, ..] = scenes else { return String::new() };
    let videos = first.lines.first().map_or(0, |l| l.tally.videos);
    let (mut head, mut rule) = ("| line |".to_owned(), "| --- |".to_owned());
    for scene in scenes {
        let name = if scenes.len() > 1 { format!("{}: ", scene.name) } else { String::new() };
        head += &format!(" {name}mean {unit} | off at end, % |{}", if paired { " difference |" } else { "" });
        rule += if paired { " --- | --- | --- |" } else { " --- | --- |" };
    }
    let caption = if scenes.len() > 1 { String::new() } else { format!("{}, ", first.name) };
    let mut out = format!("{caption}{videos} videos a line:\n\n{head}\n{rule}\n");
    for (at, line) in first.lines.iter().enumerate() {
        out += &format!("| {} |", line.name);
        for scene in scenes {
            let t = &scene.lines[at].tally;
            out +=
                &format!(" {:.2} [{:.2}, {:.2}] | {:.0} |", t.mean, t.interval[0], t.interval[1], 100.0 * t.off_at_end);
            out += &if paired { format!(" {} |", scene.difference(at)) } else { String::new() };
        }
        out.push('\n');
    }
    out + "\n"
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
