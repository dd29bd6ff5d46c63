//! The table of many targets, as cells, Markdown and CSV.

use crate::eval::multi::Line;

/// Columns of the table.
pub(super) const HEADS: [&str; 12] = [
    "",
    "videos",
    "HOTA",
    "IDF1",
    "MOTA",
    "switches",
    "crossings",
    "preserved",
    "swapped",
    "scale error",
    "angle error",
    "class right",
];

/// Explains the columns.
pub(super) const LEGEND: &str = "\
All videos pooled; boxes reported lost are left out. Crossings: half of the smaller box is covered. Preserved: afterwards both targets
have the tracks they had before; swapped: one has the other's. Scale and angle errors are medians over targets and frames, lost ones
too. Class right: decided over all frames so far.";

/// Returns the cells in the order of [`HEADS`].
pub(super) fn cells(line: &Line) -> [String; HEADS.len()] {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    [
        line.name.clone(),
        line.videos.to_string(),
        format!("{:.3}", line.hota),
        format!("{:.3}", line.idf1),
        format!("{:.3}", line.mota),
        line.switches.to_string(),
        line.crossings.to_string(),
        percent(line.preserved),
        percent(line.swapped),
        percent(line.scale_error),
        format!("{:.1}°", line.angle_error),
        line.right.map_or("-".into(), percent),
    ]
}

/// Returns the table as Markdown.
pub(super) fn markdown(lines: &[Line]) -> String {
    let row = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let rows: String = lines.iter().map(|line| row(&cells(line))).collect();
    format!("{}{}{rows}\n{LEGEND}\n", row(&HEADS.map(String::from)), row(&HEADS.map(|_| "---".into())))
}

/// Returns the table as CSV, one row per line.
pub(super) fn csv(lines: &[Line]) -> String {
    let head =
        "scene,line,videos,hota,idf1,mota,switches,crossings,preserved,swapped,scale_error,angle_error,class_right\n";
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let row = |l: &Line| {
        let numbers = [l.preserved, l.swapped, l.scale_error, l.angle_error].map(|x| x.to_string()).join(",");
        let right = l.right.map_or(String::new(), |right| right.to_string());
        let (who, scores) = ([&l.scene, &l.name].map(|text| quoted(text)).join(","), [l.hota, l.idf1, l.mota]);
        let scores = scores.map(|x| x.to_string()).join(",");
        format!("{who},{},{scores},{},{},{numbers},{right}\n", l.videos, l.switches, l.crossings)
    };
    head.to_owned() + &lines.iter().map(row).collect::<String>()
}
