//! The stored results of an experiment: small, and independent of the clock and of the machine.

use std::collections::BTreeMap;

use crate::eval::multi;
use crate::eval::tally::Tally;
use foveate::{Error, Result};
use serde::{Deserialize, Serialize};

use super::line::Group;
use super::multi_table;
use super::plan::{Expect, Experiment, Measure, Metric, Printed};
use super::setup::Setup;

/// A table of results.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Results {
    /// Its name.
    pub experiment: String,
    pub title: String,
    pub about: String,
    pub measure: Measure,
    pub digits_from: String,
    pub digits: Vec<u8>,
    /// Number of seeds.
    pub seeds: u64,
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub first_seed: u64,
    pub frames: usize,
    /// Settings that replace those of every configuration.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set: Vec<String>,
    /// The program's version.
    pub version: String,
    pub lines: Vec<Line>,
    /// The lines of many targets.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub multi: Vec<multi::Line>,
    pub paper: Vec<Printed>,
    pub checks: Vec<Check>,
}

/// A configuration with a policy, on all videos of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Line {
    pub name: String,
    pub group: Group,
    pub row: Option<String>,
    pub configuration: String,
    pub policy: String,
    pub scene: String,
    /// The line that the differences refer to.
    pub other: Option<String>,
    #[serde(flatten)]
    pub tally: Tally,
    /// Other percentages, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub details: BTreeMap<String, f64>,
}

/// An expected range, and whether the value lies in it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Check {
    pub line: String,
    pub scene: String,
    pub figure: Metric,
    pub value: f64,
    pub at_least: Option<f64>,
    pub at_most: Option<f64>,
    pub met: bool,
    /// Whether it is a goal: missing it is no failure.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub goal: bool,
    /// Whether it belongs to the small variant of --quick, which has wider ranges: it tests that the program works, not that it reproduces
    /// the paper.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub quick: bool,
}

fn one() -> u64 {
    1
}

fn is_one(seed: &u64) -> bool {
    *seed == 1
}

impl Results {
    /// Creates results without lines.
    pub(super) fn empty(experiment: &Experiment, setup: &Setup) -> Self {
        Self {
            experiment: experiment.name.clone(),
            title: experiment.title.clone(),
            about: experiment.about.trim().into(),
            measure: experiment.measure,
            digits_from: setup.from.clone(),
            digits: experiment.digits.clone(),
            seeds: experiment.seeds.count,
            first_seed: experiment.seeds.first,
            frames: experiment.frames,
            set: setup.settings.clone(),
            version: env!("CARGO_PKG_VERSION").into(),
            lines: vec![],
            multi: vec![],
            paper: experiment.paper.clone(),
            checks: vec![],
        }
    }

    /// Compares the lines with the expected ranges of the experiment's own settings.
    pub(super) fn check(&mut self, experiment: &Experiment, setup: &Setup) {
        let holds = |e: &&Expect| self.set.is_empty() && (setup.mnist || !e.mnist_only);
        for expect in experiment.expect.iter().filter(holds) {
            let (at_least, at_most) = expect.range(setup.quick);
            let value = self.figure(expect).filter(|_| at_least.is_some() || at_most.is_some());
            let Some(value) = value else { continue };
            let met = at_least.is_none_or(|low| value >= low) && at_most.is_none_or(|high| value <= high);
            let (line, scene) = (expect.line.clone(), expect.scene.clone());
            let (figure, goal, quick) = (expect.figure, expect.goal, setup.quick);
            self.checks.push(Check { line, scene, figure, value, at_least, at_most, met, goal, quick });
        }
    }

    /// Returns the value of a line; `None` if there is no such line.
    fn figure(&self, expect: &Expect) -> Option<f64> {
        let tally = || self.lines.iter().find(|l| l.name == expect.line && l.scene == expect.scene).map(|l| &l.tally);
        let multi = || self.multi.iter().find(|l| l.name == expect.line && l.scene == expect.scene);
        match expect.figure {
            Metric::Mean => tally().map(|t| t.mean),
            Metric::Median => tally().map(|t| t.median),
            Metric::OffAtEnd => tally().map(|t| t.off_at_end),
            Metric::Hota => multi().map(|l| l.hota),
            Metric::Idf1 => multi().map(|l| l.idf1),
            Metric::Preserved => multi().map(|l| l.preserved),
        }
    }

    /// Returns the scenes, each once, in the order of the lines.
    pub(super) fn scenes(&self) -> Vec<&str> {
        let mut scenes: Vec<&str> = vec![];
        for line in &self.lines {
            if !scenes.contains(&line.scene.as_str()) {
                scenes.push(&line.scene);
            }
        }
        scenes
    }

    pub(super) fn json(&self) -> Result<String> {
        let text = serde_json::to_string_pretty(self).map_err(|e| Error::Invalid(e.to_string()))?;
        Ok(text + "\n")
    }

    pub(super) fn read(text: &str, name: &str) -> Result<Self> {
        serde_json::from_str(text)
            .map_err(|e| Error::Invalid(format!("{name}: not results of foveate reproduce: {e}; write them again")))
    }

    /// Returns a CSV row for each line and digit, and one for all digits; or a row for each line of many targets.
    pub(super) fn csv(&self) -> String {
        if !self.multi.is_empty() {
            return multi_table::csv(&self.multi);
        }
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        let mut out = String::from(
            "scene,group,line,digit,videos,mean,spread,low,high,median,off_at_end,difference,difference_low,difference_high\n",
        );
        for line in &self.lines {
            let (t, who) = (&line.tally, [&line.scene, line.group.title(), &line.name].map(quoted).join(","));
            let against = t.against.map_or(",,".into(), |d| format!("{},{},{}", d.mean, d.low, d.high));
            let [low, high] = t.interval;
            let off = t.off_at_end;
            out += &format!("{who},all,{},{},{},{low},{high},{},{off},{against}\n", t.videos, t.mean, t.sd, t.median);
            for d in &t.digits {
                out += &format!("{who},{},{},{},{},,,,,,,\n", d.digit, t.videos / t.digits.len(), d.mean, d.spread);
            }
        }
        for row in &self.paper {
            let who = ["", "the paper", &row.row].map(quoted).join(",");
            out += &format!("{who},all,,{},,,,,,,,\n", row.average);
            for (digit, mean) in row.digits.iter().enumerate() {
                let spread = row.spread.get(digit).map(f64::to_string).unwrap_or_default();
                out += &format!("{who},{digit},,{mean},{spread},,,,,,,\n");
            }
        }
        out
    }
}

impl Check {
    /// Formats the results as text.
    pub(super) fn text(&self) -> String {
        let percent = |x: f64| match self.figure {
            Metric::OffAtEnd | Metric::Preserved => format!("{:.1} %", 100.0 * x),
            Metric::Hota | Metric::Idf1 => format!("{x:.3}"),
            Metric::Mean | Metric::Median => format!("{x:.2}"),
        };
        let what = match self.figure {
            Metric::Mean => "mean",
            Metric::Median => "median",
            Metric::OffAtEnd => "off at end",
            Metric::Hota => "HOTA",
            Metric::Idf1 => "IDF1",
            Metric::Preserved => "identities preserved",
        };
        let bound = match (self.at_least, self.at_most) {
            (Some(low), Some(high)) => format!("{} to {}", percent(low), percent(high)),
            (Some(low), None) => format!("at least {}", percent(low)),
            (_, high) => format!("at most {}", percent(high.unwrap_or(f64::INFINITY))),
        };
        let verdict = if self.met { "met" } else { "NOT met" };
        let of = if self.quick { " by the small variant (--quick)" } else { "" };
        let wish = if self.goal { "goal" } else { "expected" };
        format!("{} ({}), {what}: {}, {wish} {bound}: {verdict}{of}", self.line, self.scene, percent(self.value))
    }
}
