//! Scores of many targets, as aligned text and as JSON.

use foveate_base::text::visible;
use serde_json::{Value, json};

use super::{Evaluation, Score};
use crate::eval::table::aligned;

/// Formats as aligned text: for each tracker one line per sequence and one for all pooled. Sequences without a result are named below.
pub fn text(evaluations: &[Evaluation]) -> String {
    let one = |e: &Evaluation| {
        let mut lines = vec![HEADS.map(String::from).to_vec()];
        lines.extend(e.rows.iter().map(|row| figures(&row.sequence, &row.score)));
        lines.push(figures(&format!("pooled, {}", e.rows.len()), &e.pooled()));
        let mut out = format!("{}\n{}", visible(&e.tracker), aligned(&lines));
        if !e.missing.is_empty() {
            let (tracker, missing) = (visible(&e.tracker), e.missing.join(", "));
            out += &format!("{tracker} has no result for {}: its pool leaves them out\n", visible(&missing));
        }
        out
    };
    evaluations.iter().map(one).collect::<Vec<_>>().join("\n")
}

/// Returns all scores, including HOTA's at each threshold, as JSON.
pub fn json(evaluations: &[Evaluation]) -> Value {
    let one = |e: &Evaluation| json!({ "tracker": e.tracker, "pooled": e.pooled(), "sequences": e.rows, "missing": e.missing });
    json!({ "trackers": evaluations.iter().map(one).collect::<Vec<_>>() })
}

const HEADS: [&str; 17] = [
    "sequence",
    "frames",
    "HOTA",
    "DetA",
    "AssA",
    "LocA",
    "MOTA",
    "MOTP",
    "IDF1",
    "IDP",
    "IDR",
    "FP",
    "FN",
    "IDSW",
    "Frag",
    "MT/PT/ML",
    "tracks/true",
];

fn figures(name: &str, s: &Score) -> Vec<String> {
    let (h, c, i) = (&s.hota, &s.clear, &s.identity);
    let mut cells = vec![name.to_string(), s.frames.to_string()];
    let shares = [h.hota, h.det_a, h.ass_a, h.loc_a, c.mota, c.motp, i.idf1, i.idp, i.idr];
    cells.extend(shares.map(|share| format!("{share:.3}")));
    cells.extend([c.false_positives, c.misses, c.switches, c.fragmentations].map(|count| count.to_string()));
    cells.push(format!("{}/{}/{}", c.mostly_tracked, c.partly_tracked, c.mostly_lost));
    cells.push(format!("{}/{}", s.result_ids, s.truth_ids));
    cells
}
