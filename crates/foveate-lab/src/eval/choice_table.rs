//! Candidates on both halves and the choices between them, as aligned text and as JSON.

use foveate_base::text::counted;
use serde_json::{Value, json};

use super::Evaluation;
use super::catalogue::Origin;
use super::choice::{Chosen, Figures, Judgement, Trials, by_half, by_source};
use super::table::aligned;

/// The results of a choice among candidates.
#[derive(Clone, Debug)]
pub struct Choice {
    /// Scores on halves a and b, and on all sequences; one entry per candidate.
    pub figures: Vec<[Figures; 3]>,
    /// The candidates' names.
    pub names: Vec<String>,
    /// The index of the unchanged configuration, if it is a candidate.
    pub present: Option<usize>,
    /// The index of the best candidate on all sequences.
    pub best: usize,
    /// Each half tested with the candidate that is best on the other half.
    pub halves: Judgement,
    /// Each source tested with the candidate that is best on all other sources.
    pub sources: Judgement,
    /// The sequences, in the order of [`Judgement::with`].
    pub sequences: Vec<(String, Origin)>,
}

impl Choice {
    /// Computes the choice among evaluations, one per candidate; `None` if a half has no sequence.
    pub fn of(candidates: &[Evaluation], present: Option<usize>) -> Option<Self> {
        let trials = Trials::of(candidates);
        let on = |i| {
            let half = |letter: &str| trials.figures(i, &|origin| by_half(origin) == letter);
            Some([half("a")?, half("b")?, trials.figures(i, &|_| true)?])
        };
        Some(Self {
            figures: (0..candidates.len()).map(on).collect::<Option<_>>()?,
            names: candidates.iter().map(|e| e.tracker.clone()).collect(),
            present,
            best: trials.best(&|_| true)?.0,
            halves: trials.judge(by_half)?,
            sources: trials.judge(by_source)?,
            sequences: trials.sequences().to_vec(),
        })
    }

    /// Returns the rows of each sequence from the candidate that was chosen on the other half: a tracker that was not tuned on its test
    /// data.
    pub fn cross_validated(&self, tracker: &str, candidates: &[Evaluation]) -> Evaluation {
        let rows = self.sequences.iter().zip(&self.halves.with);
        let rows = rows.flat_map(|((name, _), i)| candidates[*i].rows.iter().filter(move |row| row.sequence == *name));
        // Sorted by seed, then by name, as for a tracker that is run.
        let mut rows: Vec<_> = rows.cloned().collect();
        rows.sort_by(|a, b| (a.seed, &a.sequence).cmp(&(b.seed, &b.sequence)));
        Evaluation { tracker: tracker.into(), rows, missing: vec![] }
    }

    /// Returns the quoted scores with their descriptions.
    fn summary(&self) -> Vec<(&'static str, Figures)> {
        let present = self.present.map(|i| ("the configuration as it is, on all", self.figures[i][2]));
        let rest = [
            ("best on all, judged on all", self.figures[self.best][2]),
            ("each half judged with the best of the other half", self.halves.mean),
            ("each source judged with the best of all other sources", self.sources.mean),
        ];
        present.into_iter().chain(rest).collect()
    }
}

fn cells(f: &Figures) -> [String; 3] {
    [format!("{:.3}", f.auc), format!("{:.3}", f.p20), format!("{:.1}", f.failure_pct)]
}

fn line(first: &str, figures: &[&Figures]) -> Vec<String> {
    std::iter::once(first.to_owned()).chain(figures.iter().flat_map(|f| cells(f))).collect()
}

fn heads(first: &str, groups: &[&str]) -> Vec<String> {
    let of =
        |group: &&str| ["AUC", "P@20", "failure %"].map(|figure| format!("{figure} {group}").trim_end().to_owned());
    std::iter::once(first.to_owned()).chain(groups.iter().flat_map(of)).collect()
}

/// Formats as aligned text: the candidates, the choice of each half, and the summary. Chosen by mean AUC.
pub fn text(c: &Choice) -> String {
    let count =
        |letter: &str| counted(c.sequences.iter().filter(|(_, origin)| by_half(origin) == letter).count(), "sequence");
    let mut candidates = vec![heads("candidate", &["a", "b", "all"])];
    for (i, (name, figures)) in c.names.iter().zip(&c.figures).enumerate() {
        let name = if c.present == Some(i) { format!("{name} *") } else { name.clone() };
        candidates.push(line(&name, &figures.each_ref()));
    }
    let mut choices = vec![heads("chosen on", &["there", "on the other half"])];
    choices[0].insert(1, "candidate".into());
    for chosen in &c.halves.choices {
        let mut cells = line(if chosen.left_out == "a" { "half b" } else { "half a" }, &[&chosen.there, &chosen.left]);
        cells.insert(1, chosen.candidate.clone());
        choices.push(cells);
    }
    let mut summary = vec![heads("judged", &[""])];
    summary.extend(c.summary().iter().map(|(name, figures)| line(name, &[figures])));
    format!(
        "Chosen by mean AUC. Half a: {}, half b: {}; no source is in both. *: the configuration as it is.\n{}\n{}\n{}\n{}",
        count("a"),
        count("b"),
        aligned(&candidates),
        aligned(&choices),
        aligned(&summary),
        sources(&c.sources.choices)
    )
}

/// Formats how often each candidate was chosen with one source left out.
fn sources(choices: &[Chosen]) -> String {
    let mut names: Vec<&str> = choices.iter().map(|c| c.candidate.as_str()).collect();
    names.sort();
    let times = |same: &[&str]| format!("{} {}", same[0], counted(same.len(), "time"));
    let said: Vec<String> = names.chunk_by(|a, b| a == b).map(times).collect();
    format!("Leaving out one of {} sources chose {}.\n", choices.len(), said.join(", "))
}

/// Returns all scores as JSON.
pub fn json(c: &Choice) -> Value {
    let candidate = |(i, (name, [a, b, all])): (usize, (&String, &[Figures; 3]))| json!({ "candidate": name, "as_it_is": c.present == Some(i), "a": a, "b": b, "all": all });
    let sequence = |(i, (name, origin)): (usize, &(String, Origin))| {
        let with = |j: &Judgement| c.names[j.with[i]].clone();
        json!({ "sequence": name, "half": by_half(origin), "source": by_source(origin),
            "chosen_on_the_other_half": with(&c.halves), "chosen_on_other_sources": with(&c.sources) })
    };
    json!({
        "chosen_by": "mean AUC",
        "candidates": c.names.iter().zip(&c.figures).enumerate().map(candidate).collect::<Vec<_>>(),
        "best_on_all": c.names[c.best],
        "summary": c.summary().iter().map(|(name, f)| json!({ "judged": name, "figures": f })).collect::<Vec<_>>(),
        "halves": c.halves,
        "sources": c.sources,
        "sequences": c.sequences.iter().enumerate().map(sequence).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::choice::tests::{candidate, three};

    #[test]
    fn a_choice_is_described() {
        let candidates = three();
        let choice = Choice::of(&candidates, Some(1)).expect("both halves");
        let text = text(&choice);
        for line in [
            "x=2 *      0.400   0.600         60.0  0.500   0.500         50.0    0.433     0.567           56.7",
            "each half judged with the best of the other half       0.100  0.900       90.0",
            "Leaving out one of 4 sources chose x=1 2 times, x=2 2 times.",
        ] {
            assert!(text.lines().any(|l| l == line), "{line}\n{text}");
        }
        assert!(text.lines().any(|l| l.starts_with("half b") && l.contains("x=3")), "{text}");
        let json = json(&choice);
        assert_eq!(
            (&json["halves"]["choices"][1]["candidate"], &json["candidates"][1]["as_it_is"]),
            (&"x=1".into(), &true.into())
        );
        // Bag is of half a, for which half b chose x=3: it has 0 there.
        let cross = choice.cross_validated("ours", &candidates);
        assert_eq!(cross.rows.iter().map(|row| row.score.auc).collect::<Vec<_>>(), [0.0, 0.2, 0.4, 0.0, 0.0, 0.0]);
        assert!(Choice::of(&[candidate("x=1", &[("Bolt", 0.5)])], None).is_none(), "half a has none");
    }
}
