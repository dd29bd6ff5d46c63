//! Trackers by attribute of the sequences, and the first tracker against each of the others: wins, losses, and the worst difference.

use std::collections::BTreeSet;

use serde::Serialize;
use serde_json::{Value, json};

use super::attributes::{Attribute, keeps_aspect};
use super::table::aligned;
use super::{Evaluation, Score, Sequence, catalogue};
use foveate_base::text::visible;
use foveate_report::escape;

/// The name of the group with the mean over kinds of targets, each with equal weight.
pub const KINDS: &str = "mean of kinds";

/// The mean scores of trackers over some sequences.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// The common property of the sequences: an attribute, a half or a kind.
    pub name: String,
    /// The names of the sequences for which every tracker has a result.
    pub sequences: Vec<String>,
    /// Each tracker's mean, in the order of the evaluations.
    pub means: Vec<Score>,
}

/// The first tracker against another, by AUC, on the sequences that both have.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Against {
    /// The other tracker.
    pub tracker: String,
    /// Number of sequences with results of both.
    pub sequences: usize,
    /// Number of these sequences on which the first tracker has the greater AUC.
    pub won: usize,
    /// Number of these sequences on which the first tracker has the smaller AUC.
    pub lost: usize,
    /// The sequence with the worst difference.
    pub worst: String,
    /// The first tracker's AUC there minus the other's, −1 to 1.
    pub worst_difference: f64,
}

/// Groups the sequences by attribute, in the order of [`Attribute::ALL`], then sequences with listed origins ([`catalogue`]) by half and by
/// kind. The last group has all kinds, each with equal weight. Empty groups are left out.
pub fn groups(sequences: &[Sequence], evaluations: &[Evaluation]) -> Vec<Group> {
    let known: Vec<(&Sequence, Vec<Attribute>)> = (sequences.iter())
        .filter(|s| evaluations.iter().all(|e| e.rows.iter().any(|row| row.sequence == s.name)))
        .map(|s| (s, catalogue::attributes(&s.name, &s.truth)))
        .collect();
    let group = |name: String, such: &dyn Fn(&Sequence, &[Attribute]) -> bool| {
        let such = known.iter().filter(|(s, attributes)| such(s, attributes));
        let sequences: Vec<String> = such.map(|(s, _)| s.name.clone()).collect();
        let mean = |e: &Evaluation| {
            let each: Vec<Score> = sequences.iter().filter_map(|name| e.of_sequence(name)).collect();
            Score::mean(each.iter())
        };
        let means = evaluations.iter().filter_map(mean).collect();
        (!sequences.is_empty()).then_some(Group { name, sequences, means })
    };
    let by_attribute = Attribute::ALL.map(|a| group(a.name().into(), &|_, found| found.contains(&a)));
    let aspect_stays = group("aspect stays".into(), &|s, _| keeps_aspect(&s.truth));
    let kinds: BTreeSet<&str> = known.iter().filter_map(|(s, _)| s.origin.kind.as_deref()).collect();
    let by_half = catalogue::Half::BOTH
        .map(|half| group(format!("half {}", half.name()), &|s, _| s.origin.half == half))
        .into_iter()
        .filter(|_| !kinds.is_empty());
    let by_kind: Vec<Group> = (kinds.iter())
        .filter_map(|kind| group(format!("kind {kind}"), &|s, _| s.origin.kind.as_deref() == Some(*kind)))
        .collect();
    let mean = |e: usize| Score::mean(by_kind.iter().filter_map(|g| g.means.get(e)));
    let alike = (by_kind.len() > 1).then(|| Group {
        name: KINDS.into(),
        sequences: by_kind.iter().flat_map(|g| g.sequences.clone()).collect(),
        means: (0..evaluations.len()).filter_map(mean).collect(),
    });
    let first = by_attribute.into_iter().chain([aspect_stays]).chain(by_half).flatten();
    first.chain(by_kind).chain(alike).collect()
}

/// Compares the first tracker with each other tracker that shares a sequence with it.
pub fn against(evaluations: &[Evaluation]) -> Vec<Against> {
    let [ours, others @ ..] = evaluations else { return vec![] };
    let names: BTreeSet<&str> = ours.rows.iter().map(|row| row.sequence.as_str()).collect();
    let one = |other: &Evaluation| {
        let auc = |e: &Evaluation, name| e.of_sequence(name).map(|s| s.auc);
        let apart: Vec<(&str, f64)> =
            names.iter().filter_map(|name| Some((*name, auc(ours, name)? - auc(other, name)?))).collect();
        let (worst, worst_difference) = *apart.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let count = |such: fn(f64) -> bool| apart.iter().filter(|(_, d)| such(*d)).count();
        Some(Against {
            tracker: other.tracker.clone(),
            sequences: apart.len(),
            won: count(|d| d > 0.0),
            lost: count(|d| d < 0.0),
            worst: worst.into(),
            worst_difference,
        })
    };
    others.iter().filter_map(one).collect()
}

fn lines(groups: &[Group], evaluations: &[Evaluation]) -> Vec<Vec<String>> {
    let heads = evaluations.iter().flat_map(|e| [format!("{} AUC", e.tracker), "failure %".into()]);
    let head = ["attribute".into(), "sequences".into()].into_iter().chain(heads).collect();
    let line = |group: &Group| {
        let figures = group.means.iter().flat_map(|s| [format!("{:.3}", s.auc), format!("{:.1}", s.failure_pct)]);
        [group.name.clone(), group.sequences.len().to_string()].into_iter().chain(figures).collect()
    };
    std::iter::once(head).chain(groups.iter().map(line)).collect()
}

fn sentence(a: &Against) -> String {
    let (won, of, worst, by) = (a.won, a.sequences, &a.worst, a.worst_difference);
    format!("won against {}: {won} of {of}; worst difference: {worst} {by:+.2}", a.tracker)
}

/// Returns the explanation of the rows of halves, if there are any.
fn legend(groups: &[Group]) -> Option<&'static str> {
    let halves = groups.iter().any(|g| g.name.starts_with("half "));
    halves.then_some(
        "Halves: settings and models of one half are evaluated on the other. Mean of kinds: kinds with equal weight.",
    )
}

/// Formats the groups as text: the table by attribute, then a line for each other tracker. Empty without a group.
pub fn text(groups: &[Group], evaluations: &[Evaluation]) -> String {
    let mut table = if groups.is_empty() { String::new() } else { aligned(&lines(groups, evaluations)) + "\n" };
    table += legend(groups).map(|legend| format!("{legend}\n\n")).as_deref().unwrap_or_default();
    against(evaluations).iter().fold(table, |text, a| text + &visible(&sentence(a)) + "\n")
}

/// Formats the groups as HTML for `report.html`.
pub fn html(groups: &[Group], evaluations: &[Evaluation]) -> String {
    let row = |(i, cells): (usize, &Vec<String>)| {
        let tag = if i == 0 { "th" } else { "td" };
        let cells: String = cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let rows: String = lines(groups, evaluations).iter().enumerate().map(row).collect();
    let legend = legend(groups).map_or(String::new(), |legend| format!("<p>{}</p>\n", escape(legend)));
    let table = format!("<div class=\"scroll\"><table>\n{rows}</table></div>\n{legend}");
    let said = against(evaluations).iter().map(|a| format!("<p>{}.</p>\n", escape(&sentence(a)))).collect();
    if groups.is_empty() { said } else { table + &said }
}

/// Returns the groups as JSON: `attributes`, `against` and, for each sequence, `sources` in `scores.json`.
pub fn json(sequences: &[Sequence], groups: &[Group], evaluations: &[Evaluation]) -> [(&'static str, Value); 3] {
    let group = |g: &Group| {
        let figures = |(e, s): (&Evaluation, &Score)| json!({ "tracker": e.tracker, "auc": s.auc, "p20": s.p20, "failure_pct": s.failure_pct });
        let trackers: Vec<Value> = evaluations.iter().zip(&g.means).map(figures).collect();
        json!({ "attribute": g.name, "sequences": g.sequences, "trackers": trackers })
    };
    let source = |s: &Sequence| {
        let catalogue::Origin { source, half, kind } = &s.origin;
        let attributes: Vec<&str> = catalogue::attributes(&s.name, &s.truth).iter().map(|a| a.name()).collect();
        json!({ "sequence": s.name, "source": source, "half": half, "kind": kind, "attributes": attributes })
    };
    [
        ("attributes", groups.iter().map(group).collect()),
        ("against", json!(against(evaluations))),
        ("sources", sequences.iter().map(source).collect()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::{Curves, Row, score};
    use foveate_core::geometry::BBox;

    /// Two frames; the second box is `off` pixels beside a box ten wide, so its IoU is (10 − off) / (10 + off).
    fn row(sequence: &str, off: f64) -> Row {
        let at = |x| Some(BBox { x, y: 0.0, w: 10.0, h: 10.0 });
        let (score, curves): (_, Curves) = score(&[at(0.0), at(off)], &[at(0.0), at(0.0)]).expect("two frames");
        Row { sequence: sequence.into(), origin: catalogue::origin(sequence), seed: None, score, curves }
    }

    fn tracker(name: &str, offs: &[(&str, f64)]) -> Evaluation {
        let rows = offs.iter().map(|(sequence, off)| row(sequence, *off)).collect();
        Evaluation { tracker: name.into(), rows, missing: vec![] }
    }

    fn sequence(name: &str) -> Sequence {
        let big = Some(BBox { x: 0.0, y: 0.0, w: 50.0, h: 50.0 });
        Sequence::named(name, vec![big; 2])
    }

    #[test]
    fn halves_are_rows_of_listed_sequences_alone() {
        let names = |sequences: &[&str]| {
            let offs: Vec<(&str, f64)> = sequences.iter().map(|name| (*name, 0.0)).collect();
            let all = [tracker("ours", &offs)];
            let sequences: Vec<Sequence> = sequences.iter().map(|name| sequence(name)).collect();
            let found = groups(&sequences, &all);
            (found.iter().map(|g| g.name.clone()).collect::<Vec<_>>(), text(&found, &all))
        };
        let (rows, text) = names(&["my street", "my dog"]);
        assert!(rows == ["aspect stays"] && !text.contains("half"), "{rows:?} {text}");
        let (rows, text) = names(&["Biker", "Bolt2"]);
        assert!(rows.contains(&"half b".into()) && text.contains("Halves: settings"), "{text}");
    }

    #[test]
    fn attributes_and_wins_by_hand() {
        let sequences = ["Biker", "Bolt2", "FaceOcc1", "Woman"].map(sequence);
        // Ours: always right except on FaceOcc1. Theirs: always wrong except there, with no result for Woman.
        let all = [
            tracker("ours", &[("Biker", 0.0), ("Bolt2", 0.0), ("FaceOcc1", 10.0), ("Woman", 0.0)]),
            tracker("theirs", &[("Biker", 20.0), ("Bolt2", 0.0), ("FaceOcc1", 0.0)]),
        ];
        let found = groups(&sequences, &all);
        let names: Vec<&str> = found.iter().map(|g| g.name.as_str()).collect();
        let attributes = ["deformation", "occlusion", "rotation", "look-alikes", "camera motion", "aspect stays"];
        let expected = [&attributes[..], &["half a", "half b", "kind face", "kind person", "mean of kinds"]].concat();
        assert_eq!(names, expected);
        let occlusion = &found[1];
        assert_eq!(occlusion.sequences, ["FaceOcc1"], "Woman is left out: not every tracker has it");
        assert_eq!(occlusion.means.iter().map(|s| s.failure_pct).collect::<Vec<_>>(), [50.0, 0.0]);
        let b = &found[7];
        assert_eq!((b.sequences.len(), b.means[1].failure_pct), (2, 25.0));
        // Of the faces (Biker, FaceOcc1) ours fails in a quarter of the frames, of the one person in none.
        assert_eq!((found[10].sequences.len(), found[10].means[0].failure_pct), (3, 12.5));

        let wins = against(&all);
        // A wrong second frame loses the 20 thresholds that a right one passes: 20/42 of AUC.
        let [one] = &wins[..] else { panic!("one other: {wins:?}") };
        assert_eq!((one.sequences, one.won, one.lost, one.worst.as_str()), (3, 1, 1, "FaceOcc1"));
        assert!((one.worst_difference + 20.0 / 42.0).abs() < 1e-12);
        let text = text(&found, &all);
        assert!(text.contains("won against theirs: 1 of 3; worst difference: FaceOcc1 -0.48"), "{text}");
        assert!(
            text.lines().any(|l| l == "occlusion              1     0.476       50.0       0.952        0.0"),
            "{text}"
        );
        assert!(html(&found, &all).contains("<td>occlusion</td><td>1</td><td>0.476</td>"));
        let [(_, by), (_, won), (_, sources)] = json(&sequences, &found, &all);
        assert_eq!((&by[1]["sequences"][0], &won[0]["won"]), (&"FaceOcc1".into(), &1.into()));
        assert_eq!(sources[1]["attributes"], json!(["deformation", "look-alikes", "camera motion"]));
        assert_eq!((&sources[0]["half"], &sources[1]["source"]), (&"b".into(), &"Bolt".into()));
        assert!(text_of_none(), "nothing to say, nothing said");
    }

    fn text_of_none() -> bool {
        text(&[], &[tracker("alone", &[("Biker", 0.0)])]).is_empty() && against(&[]).is_empty()
    }
}
