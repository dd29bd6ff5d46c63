//! The paper's experiments as data: `experiments/NAME/experiment.toml`, which are part of the program.

use std::path::Path;

use foveate::config::{Config, Exp3Config, PolicyConfig, RECOGNISERS, RecogniserConfig};
use foveate::eval::experiment::digest;
use foveate::eval::line_up;
use foveate::gaze::Grid;
use foveate::identity::accumulate::Accumulate;
use foveate::scene::synthetic::{Multi, Synthetic};
use foveate::{Error, Result};
use serde::{Deserialize, Serialize};

use crate::cmd::experiment::runner::Entry;
use crate::cmd::track::{DIGITS, blueprint};

macro_rules! experiments {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_str!(concat!("../../../../../experiments/", $name, "/experiment.toml")))),*]
    };
}

/// Names and texts, in the order of the page.
pub const EXPERIMENTS: [(&str, &str); 14] = experiments![
    "table1",
    "table2",
    "table3",
    "fig-policy",
    "fig-multi",
    "fig-digits",
    "fig-face",
    "why-likelihood",
    "why-features",
    "why-reward",
    "why-motion",
    "why-exp3",
    "why-gp",
    "why-looks",
];

/// One table or figure.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// Its folder.
    #[serde(skip)]
    pub name: String,
    #[serde(default)]
    pub kind: Kind,
    pub title: String,
    /// What is shown, in a few sentences.
    pub about: String,
    #[serde(default)]
    pub measure: Measure,
    /// The digits to follow.
    #[serde(default = "all_digits")]
    pub digits: Vec<u8>,
    /// Videos of each digit, or runs on each video.
    pub seeds: u64,
    /// Length of each video.
    pub frames: usize,
    quick: Quick,
    /// Names of sequences below `tracking/` of the data.
    #[serde(default)]
    pub sequences: Vec<String>,
    #[serde(default, rename = "scene")]
    pub scenes: Vec<Scene<Synthetic>>,
    /// The scene of many targets.
    pub crowd: Option<Scene<Multi>>,
    #[serde(rename = "line")]
    pub lines: Vec<LineOf>,
    #[serde(default)]
    pub paper: Vec<Printed>,
    #[serde(default)]
    pub expect: Vec<Expect>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    #[default]
    Table,
    /// One run over time.
    Policy,
    /// Reward surfaces of digits.
    Digits,
    /// Real sequences.
    Face,
    /// Many targets: a table and a film strip.
    Crowd,
}

/// What is measured of a video.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Measure {
    /// The mean distance of centres, pixels: less is better.
    #[default]
    Error,
    /// The share of frames recognised, per cent: more is better.
    Accuracy,
}

/// The small variant of an experiment.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Quick {
    digits: Vec<u8>,
    seeds: u64,
    frames: usize,
}

/// A kind of video.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene<V> {
    pub name: String,
    /// Its digit, seed and length are put in.
    pub video: V,
}

/// Which settings a line shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Group {
    /// As this project recommends.
    #[default]
    Recommended,
    /// The authors' own parameters.
    Authors,
    /// As the paper prints it.
    Printed,
    /// Another tracker.
    Peer,
}

impl Group {
    pub fn title(self) -> &'static str {
        match self {
            Self::Recommended => "as recommended",
            Self::Authors => "authors' parameters",
            Self::Printed => "as printed",
            Self::Peer => "other trackers",
        }
    }
}

/// One line of a table: a configuration with a policy.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineOf {
    pub name: String,
    #[serde(default)]
    pub group: Group,
    /// The paper's row that it stands beside.
    pub row: Option<String>,
    /// One that ships with the program.
    config: String,
    /// By its name in the line-up of `foveate experiment --policies`; the configuration's own if left out.
    policy: Option<String>,
    /// Laid over the configuration.
    #[serde(default)]
    change: toml::Table,
    /// Names of the scenes it is run on; all if left out.
    scenes: Option<Vec<String>>,
    /// The line it is compared with, video by video; the fixed centre of the same configuration if left out.
    against: Option<String>,
    /// Where a recogniser looks.
    pub looks: Option<Looks>,
    /// Each of many targets has a tracker that knows nothing of the others.
    #[serde(default)]
    pub alone: bool,
}

/// Where a recogniser looks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Looks {
    Random,
    Circular,
    /// EXP3.
    Learned,
    Fixed,
}

/// A row of the paper's table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Printed {
    pub row: String,
    pub digits: Vec<f64>,
    /// The figures in brackets.
    #[serde(default)]
    pub spread: Vec<f64>,
    pub average: f64,
}

/// A range that a figure has to lie in.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    pub line: String,
    pub scene: String,
    pub figure: Figure,
    at_most: Option<f64>,
    at_least: Option<f64>,
    quick_at_most: Option<f64>,
    quick_at_least: Option<f64>,
    /// It says nothing of digits drawn by a pen.
    #[serde(default)]
    pub mnist_only: bool,
    /// What is wanted: missing it is said, and is no failure.
    #[serde(default)]
    pub goal: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Figure {
    Mean,
    Median,
    /// Share of videos lost, 0 to 1.
    Lost,
    /// Of many targets.
    Hota,
    /// Of many targets.
    Idf1,
    /// Share of the crossings after which both targets have their tracks, 0 to 1.
    Kept,
}

impl Expect {
    /// Least and greatest value that is allowed.
    pub fn range(&self, quick: bool) -> (Option<f64>, Option<f64>) {
        if quick { (self.quick_at_least, self.quick_at_most) } else { (self.at_least, self.at_most) }
    }
}

fn all_digits() -> Vec<u8> {
    (0..10).collect()
}

impl Experiment {
    /// One that is part of the program, by name.
    pub fn builtin(name: &str) -> Result<Self> {
        let text = EXPERIMENTS.iter().find(|e| e.0 == name).map(|e| e.1).ok_or_else(|| {
            let names = EXPERIMENTS.map(|e| e.0).join(", ");
            Error::Config(format!(
                "there is no experiment {name}; expected all, tables, figures, why, or some of {names}"
            ))
        })?;
        Self::parse(name, text)
    }

    fn parse(name: &str, text: &str) -> Result<Self> {
        let wrong = |what: String| Error::Config(format!("experiments/{name}/experiment.toml: {what}"));
        let all: Self = toml::from_str(text).map_err(|e| wrong(e.to_string()))?;
        let all = Self { name: name.into(), ..all };
        for line in &all.lines {
            for scene in line.scenes.iter().flatten() {
                if !all.scenes.iter().any(|s| s.name == *scene) {
                    return Err(wrong(format!("line {} is run on a scene {scene}, which is not there", line.name)));
                }
            }
            if let Some(other) = line.against.as_ref().filter(|other| all.index(other).is_none()) {
                return Err(wrong(format!("line {} is compared with {other}, which is not there", line.name)));
            }
        }
        match all.expect.iter().find(|e| all.index(&e.line).is_none()) {
            Some(e) => Err(wrong(format!("a figure of a line {} is expected, which is not there", e.line))),
            None => Ok(all),
        }
    }

    /// Makes it the small variant.
    pub fn make_quick(&mut self) {
        (self.digits, self.seeds, self.frames) = (self.quick.digits.clone(), self.quick.seeds, self.quick.frames);
        self.sequences.truncate(1);
    }

    fn index(&self, line: &str) -> Option<usize> {
        self.lines.iter().position(|l| l.name == line)
    }

    /// The line that a line is compared with: as it says, or else the fixed centre of the same configuration.
    pub fn against(&self, line: usize) -> Option<usize> {
        let this = &self.lines[line];
        let fixed = |l: &LineOf| l.config == this.config && l.policy.as_deref() == Some("fixed") && l.change.is_empty();
        let found = match &this.against {
            Some(name) => self.index(name),
            None => self.lines.iter().position(fixed).filter(|_| this.change.is_empty()),
        };
        found.filter(|&other| other != line)
    }
}

impl LineOf {
    /// Whether it is run on a scene.
    pub fn is_run_on(&self, scene: &str) -> bool {
        self.scenes.as_ref().is_none_or(|names| names.iter().any(|n| n == scene))
    }

    /// What is run.
    pub fn entry(&self) -> Result<Entry> {
        let mut config = blueprint(&self.config)?.config().clone();
        if let Some(name) = &self.policy {
            let all = line_up::policies(&config.policy);
            let found = all.iter().find(|policy| line_up::policy_name(policy) == *name).cloned();
            config.policy = found.ok_or_else(|| {
                let names: Vec<String> = all.iter().map(line_up::policy_name).collect();
                Error::Config(format!("line {}: there is no policy {name}; there are {}", self.name, names.join(", ")))
            })?;
        }
        let mut text = toml::Table::try_from(&config).map_err(|e| Error::Config(format!("line {}: {e}", self.name)))?;
        lay(&mut text, &self.change);
        let config = Config::parse(&text.to_string(), &format!("line {}", self.name))?;
        let entry = Entry::of(&self.name, config, Path::new("."))?;
        match self.looks {
            Some(looks) => recognising(entry, looks),
            None => Ok(entry),
        }
    }

    pub fn config(&self) -> &str {
        &self.config
    }
}

/// The entry with the shipped recogniser of digits, as `foveate experiment recognise` has it.
fn recognising(entry: Entry, looks: Looks) -> Result<Entry> {
    let grid = Grid { reach: 0.5, ..Grid::default() };
    let policy = match looks {
        Looks::Random => PolicyConfig::Random { grid },
        Looks::Circular => PolicyConfig::Circular { grid },
        Looks::Learned => PolicyConfig::Exp3(Exp3Config { grid, ..Exp3Config::default() }),
        Looks::Fixed => line_up::FIXED,
    };
    let model = RECOGNISERS.iter().find(|model| DIGITS.ends_with(model.0)).map_or(&[][..], |model| model.1);
    let key = format!("{} recognise {policy:?} {}", entry.key, digest(&[model]));
    let recogniser = RecogniserConfig::MultiFixation {
        weights: DIGITS.into(),
        accumulate: Accumulate::Sum,
        policy: Some(policy),
        alarm: false,
    };
    Ok(Entry { blueprint: entry.blueprint.recognising(recogniser, Path::new("."))?, key, ..entry })
}

/// Lays one table over another: values take the place of values, tables are laid over tables unless they are of another
/// `kind`.
fn lay(below: &mut toml::Table, above: &toml::Table) {
    for (key, value) in above {
        match (below.get_mut(key), value) {
            (Some(toml::Value::Table(old)), toml::Value::Table(new))
                if new.get("kind").is_none_or(|kind| old.get("kind") == Some(kind)) =>
            {
                lay(old, new);
            }
            _ => drop(below.insert(key.clone(), value.clone())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_experiments_can_be_made() {
        for (name, _) in EXPERIMENTS {
            let experiment = Experiment::builtin(name).expect(name);
            for (i, line) in experiment.lines.iter().enumerate() {
                let entry = line.entry().expect(name);
                assert_eq!(entry.name, line.name);
                assert!(experiment.lines[..i].iter().all(|l| l.name != line.name), "{name}: {} twice", line.name);
            }
            for row in &experiment.paper {
                // The paper's averages are means of its digits, rounded: checks the copying.
                let mean = row.digits.iter().sum::<f64>() / row.digits.len() as f64;
                assert!((mean - row.average).abs() < 0.06, "{name} {}: {mean}", row.row);
                assert!(experiment.lines.iter().any(|l| l.row.as_ref() == Some(&row.row)), "{name} {}", row.row);
            }
        }
        assert!(Experiment::builtin("table9").is_err_and(|e| e.to_string().contains("table1")));
    }

    #[test]
    fn changes_are_laid_over() {
        let mut below: toml::Table =
            toml::from_str("a = 1\n[r]\nkind = 'x'\nt = 0.5\n[s]\nu = 1\nv = 2").expect("TOML");
        let above = toml::from_str("[r]\nkind = 'y'\n[s]\nu = 3\n[n]\nw = 1").expect("TOML");
        lay(&mut below, &above);
        let wanted: toml::Table =
            toml::from_str("a = 1\n[r]\nkind = 'y'\n[s]\nu = 3\nv = 2\n[n]\nw = 1").expect("TOML");
        assert_eq!(below, wanted);
    }

    #[test]
    fn lines_are_compared_with_the_fixed_centre() {
        let table = Experiment::builtin("table3").expect("it is there");
        let other = |name: &str| {
            let line = table.lines.iter().position(|l| l.name == name).expect(name);
            table.against(line).map(|i| table.lines[i].name.as_str())
        };
        assert_eq!(other("GP-UCB"), Some("fixed centre"));
        assert_eq!(other("EXP3, as printed"), Some("fixed centre, as printed"));
        assert_eq!(other("fixed centre"), None);
    }
}
