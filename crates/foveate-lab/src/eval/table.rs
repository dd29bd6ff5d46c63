//! Trackers side by side, as aligned text and as JSON.

use std::borrow::Cow;
use std::collections::BTreeSet;

use foveate_base::text::visible;
use serde_json::{Value, json};

use super::compare::{Evaluation, Spread};
use super::metrics::Score;

/// A percentage read above this counts as whole pictures.
const WHOLE: f64 = 99.995;

/// Formats as aligned text. One tracker: one line per sequence. Several: success AUC and precision of each, sequence by sequence, then one
/// line per tracker, then the first against each of the others. Sequences without a result show `-` and are named below.
pub fn text(evaluations: &[Evaluation]) -> String {
    let mut names: Vec<&str> = evaluations.iter().flat_map(|e| &e.rows).map(|row| row.sequence.as_str()).collect();
    names.sort();
    names.dedup();
    let mut out = if let [one] = evaluations {
        let mut lines: Vec<(String, Score)> =
            names.iter().filter_map(|name| Some((name.to_string(), one.of_sequence(name)?))).collect();
        lines.extend(one.mean().map(|mean| (format!("mean of {}", names.len()), mean)));
        format!("{}\n{}", visible(&one.tracker), figures("sequence", &lines))
    } else {
        let mut lines = vec![vec![String::from("AUC / P@20")]];
        lines[0].extend(evaluations.iter().map(|e| e.tracker.clone()));
        lines.extend(names.iter().map(|name| {
            let cell =
                |e: &Evaluation| e.of_sequence(name).map_or("-".into(), |s| format!("{:.3} / {:.3}", s.auc, s.p20));
            std::iter::once(name.to_string()).chain(evaluations.iter().map(cell)).collect()
        }));
        let means: Vec<(String, Score)> =
            evaluations.iter().filter_map(|e| Some((e.tracker.clone(), e.mean()?))).collect();
        format!("{}\n{}\n{}", aligned(&lines), figures("mean", &means), aligned(&against(evaluations)))
    };
    for e in evaluations {
        if let (Some(auc), Some(p20)) = (e.spread(|s| s.auc), e.spread(|s| s.p20))
            && let (Some(auc_sd), Some(p20_sd)) = (auc.sd, p20.sd)
        {
            let (auc, p20) = (auc.mean, p20.mean);
            let tracker = visible(&e.tracker);
            out +=
                &format!("{tracker} over seeds: AUC {auc:.3} ± {auc_sd:.3}, P@20 {p20:.3} ± {p20_sd:.3} (mean ± sd)\n");
        }
        if !e.missing.is_empty() {
            let (tracker, missing) = (visible(&e.tracker), e.missing.join(", "));
            out += &format!("{tracker} has no result for {}: its means leave them out\n", visible(&missing));
        }
    }
    out
}

/// Compares the first tracker with each of the others, on the sequences of both: the mean difference of AUC, and the numbers of sequences
/// with better and with worse AUC.
fn against(evaluations: &[Evaluation]) -> Vec<Vec<String>> {
    let [ours, others @ ..] = evaluations else { return vec![] };
    let first = format!("{} against", ours.tracker);
    let mut lines = vec![[first.as_str(), "sequences", "AUC", "better on", "worse on"].map(String::from).to_vec()];
    for other in others {
        let names: BTreeSet<&str> = ours.rows.iter().map(|row| row.sequence.as_str()).collect();
        let auc = |e: &Evaluation, name| e.of_sequence(name).map(|s| s.auc);
        let differences: Vec<f64> =
            names.into_iter().filter_map(|name| Some(auc(ours, name)? - auc(other, name)?)).collect();
        let (n, count) = (differences.len(), |such: fn(&f64) -> bool| differences.iter().copied().filter(such).count());
        let mean = differences.iter().sum::<f64>() / n.max(1) as f64;
        let counts = [count(|d| *d > 0.0), count(|d| *d < 0.0)].map(|c| c.to_string());
        lines.push([vec![other.tracker.clone(), n.to_string(), format!("{mean:+.3}")], counts.to_vec()].concat());
    }
    lines
}

/// Returns all scores, and the mean curves, as JSON. Infinite numbers become null.
pub fn json(evaluations: &[Evaluation]) -> Value {
    let spread = |s: Option<Spread>| json!(s);
    let one = |e: &Evaluation| {
        json!({
            "tracker": e.tracker,
            "mean": e.mean(),
            "over_seeds": { "auc": spread(e.spread(|s| s.auc)), "p20": spread(e.spread(|s| s.p20)) },
            "curves": e.curves(),
            "sequences": e.rows,
            "missing": e.missing,
        })
    };
    json!({ "trackers": evaluations.iter().map(one).collect::<Vec<_>>() })
}

/// Formats the scores of trackers, one line each. Leaves out columns with the same value for all, and explains the others below.
fn figures(first: &str, lines: &[(String, Score)]) -> String {
    let any = |such: &dyn Fn(&Score) -> bool| lines.iter().any(|(_, score)| such(score));
    let timed = any(&|s| s.fps.is_some());
    // A tracker of whole pictures reads 100 % of the values.
    let reads = any(&|s| s.read_pct.is_some_and(|read| read < WHOLE));
    let masks = any(&|s| s.mask_iou.is_some());
    let mut heads = vec![first, "frames", "AUC", "P@20", "SR@0.5", "error px", "failures", "failure %"];
    heads.extend(timed.then_some("fps"));
    heads.extend(if reads { &["values", "read %"][..] } else { &[] });
    heads.extend(if masks { &["mask IoU", "its box"][..] } else { &[] });
    let line = |(name, s): &(String, Score)| {
        let mut cells = vec![
            name.clone(),
            s.frames.to_string(),
            format!("{:.3}", s.auc),
            format!("{:.3}", s.p20),
            format!("{:.3}", s.sr50),
            format!("{:.1}", s.centre_error),
            s.failures.to_string(),
            format!("{:.1}", s.failure_pct),
        ];
        let some = |value: Option<f64>, places: usize| value.map_or("-".into(), |v| format!("{v:.places$}"));
        cells.extend(timed.then(|| some(s.fps, 0)));
        cells.extend(if reads { vec![some(s.values, 0), some(s.read_pct, 2)] } else { vec![] });
        cells.extend(if masks { vec![some(s.mask_iou, 3), some(s.mask_box_iou, 3)] } else { vec![] });
        cells
    };
    let all: Vec<Vec<String>> =
        std::iter::once(heads.into_iter().map(String::from).collect()).chain(lines.iter().map(line)).collect();
    let reads = if reads { "values, read %: pixel values read a frame, and their share of the picture\n" } else { "" };
    let masks = if masks { "mask IoU, its box: mean overlap with the mask, and with the box around it\n" } else { "" };
    format!(
        "{}AUC: area under the success curve; P@20: frames within 20 px; SR@0.5: frames with IoU above 0.5; failure: IoU 0\n{reads}{masks}",
        aligned(&all)
    )
}

/// Aligns columns two spaces apart; the first to the left, the others to the right.
pub fn aligned(lines: &[Vec<String>]) -> String {
    let lines: Vec<Vec<_>> = lines.iter().map(|line| line.iter().map(|cell| visible(cell)).collect()).collect();
    let columns = lines.iter().map(Vec::len).max().unwrap_or(0);
    let width =
        |c: usize| lines.iter().filter_map(|line| line.get(c)).map(|cell| cell.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |cells: &Vec<Cow<'_, str>>| {
        let cell = |(c, cell): (usize, &Cow<'_, str>)| match c {
            0 => format!("{cell:<0$}", widths[0]),
            _ => format!("  {cell:>0$}", widths[c]),
        };
        cells.iter().enumerate().map(cell).collect::<String>().trim_end().to_string() + "\n"
    };
    lines.iter().map(line).collect()
}
