//! Experiments as data: `experiments/NAME/experiment.toml`, which are part of the program, or the user's own files.

use std::path::Path;

use foveate::lab::synthetic::{Multi, Synthetic};
use foveate::{Error, Result, files};
use serde::{Deserialize, Serialize};

use super::line::LineSpec;
use super::seeds::Seeds;

macro_rules! experiments {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_str!(concat!("../../experiments/", $name, "/experiment.toml")))),*]
    };
}

/// Names and texts, in the order of the page.
pub(super) const EXPERIMENTS: [(&str, &str); 22] = experiments![
    "table1",
    "table2",
    "table3",
    "closeup",
    "budget",
    "saliency",
    "online-rbm",
    "fig-policy",
    "fig-hedge",
    "fig-multi",
    "objects",
    "fig-digits",
    "fig-face",
    "why-likelihood",
    "why-features",
    "why-reward",
    "why-motion",
    "why-exp3",
    "why-gp",
    "why-looks",
    "why-alarm",
    "recovery",
];

/// One table or figure.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Experiment {
    /// Its folder, or the name of its file.
    #[serde(skip)]
    pub name: String,
    #[serde(default)]
    pub kind: Kind,
    pub title: String,
    /// A description of the content, in a few sentences.
    pub about: String,
    #[serde(default)]
    pub measure: Measure,
    /// The digits to follow.
    #[serde(default = "all_digits")]
    pub digits: Vec<u8>,
    /// Seeds of videos and trackers: a video of each digit, or a run on each video, for each of them.
    pub seeds: Seeds,
    /// Length of each video.
    #[serde(default = "usual_length")]
    pub frames: usize,
    #[serde(default)]
    quick: Quick,
    /// Names of sequences below `tracking/` of the data; default: all.
    #[serde(default)]
    pub sequences: Vec<String>,
    /// Minimum and maximum number of frames of an occlusion of a target of a real sequence.
    #[serde(default = "usual_occlusion")]
    pub occluded: (usize, usize),
    #[serde(default, rename = "scene")]
    pub scenes: Vec<Scene<Synthetic>>,
    /// The scene of many targets.
    pub multi: Option<Scene<Multi>>,
    #[serde(rename = "line")]
    pub lines: Vec<LineSpec>,
    #[serde(default)]
    pub paper: Vec<Printed>,
    #[serde(default)]
    pub expect: Vec<Expect>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Kind {
    #[default]
    Table,
    /// One run over time.
    Policy,
    /// Reward surfaces of digits.
    Digits,
    /// How fast the policy learns to look at the centre.
    Curve,
    /// Real sequences.
    Face,
    /// Many targets: a table, and pictures of the first video.
    Multi,
    /// Re-detection after occlusions inserted into real sequences.
    Recovery,
}

/// The measurement of a video.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Measure {
    /// The mean distance of centres, pixels; lower is better.
    #[default]
    Error,
    /// The percentage of frames recognised; higher is better.
    Accuracy,
}

/// The small variant of an experiment.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Quick {
    digits: Vec<u8>,
    seeds: Seeds,
    frames: usize,
}

impl Default for Quick {
    fn default() -> Self {
        Self { digits: vec![3], seeds: Seeds::up_to(1), frames: 30 }
    }
}

/// A kind of video.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Scene<V> {
    pub name: String,
    /// The video; the experiment sets its digit, seed and length.
    pub video: V,
}

/// A row of the paper's table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Printed {
    pub row: String,
    pub digits: Vec<f64>,
    /// The figures in brackets.
    #[serde(default)]
    pub spread: Vec<f64>,
    pub average: f64,
}

/// The expected range of a value.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Expect {
    pub line: String,
    pub scene: String,
    pub figure: Metric,
    at_most: Option<f64>,
    at_least: Option<f64>,
    quick_at_most: Option<f64>,
    quick_at_least: Option<f64>,
    /// Whether the range applies only with MNIST, not with drawn digits.
    #[serde(default)]
    pub mnist_only: bool,
    /// Whether it is a goal: missing it is reported but is no failure.
    #[serde(default)]
    pub goal: bool,
}

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Metric {
    Mean,
    Median,
    /// Fraction of videos that end off the target, 0 to 1.
    OffAtEnd,
    /// Of many targets.
    Hota,
    /// Of many targets.
    Idf1,
    /// Fraction of the crossings that preserve both identities, 0 to 1.
    Preserved,
}

impl Expect {
    /// Returns the minimum and the maximum allowed value.
    pub(super) fn range(&self, quick: bool) -> (Option<f64>, Option<f64>) {
        if quick { (self.quick_at_least, self.quick_at_most) } else { (self.at_least, self.at_most) }
    }
}

/// Returns the name of a scene in this text that sets a value reserved for the experiment, and the key.
fn put_in(text: &str) -> Option<(String, &'static str)> {
    let all: toml::Table = toml::from_str(text).ok()?;
    let scenes = all.get("scene").and_then(toml::Value::as_array).into_iter().flatten().chain(all.get("multi"));
    let given = |scene: &toml::Value| {
        let key = ["digit", "seed", "frames"]
            .into_iter()
            .find(|key| scene.get("video").and_then(|v| v.get(key)).is_some())?;
        Some((scene.get("name")?.as_str()?.to_owned(), key))
    };
    scenes.filter_map(given).next()
}

fn all_digits() -> Vec<u8> {
    (0..10).collect()
}

fn usual_length() -> usize {
    300
}

fn usual_occlusion() -> (usize, usize) {
    (30, 90)
}

impl Experiment {
    /// Reads an experiment of the program by name, or a file.
    pub(super) fn named(name: &str) -> Result<Self> {
        if let Some((_, text)) = EXPERIMENTS.iter().find(|e| e.0 == name) {
            return Self::parse(name, text, &format!("experiments/{name}/experiment.toml"));
        }
        let path = Path::new(name);
        if !path.is_file() {
            let names = EXPERIMENTS.map(|e| e.0).join(", ");
            return Err(Error::Config(format!(
                "there is no experiment {name}; expected all, tables, figures, why, an experiment's TOML file, or some of {names}"
            )));
        }
        let text = files::read_text(path, files::TEXT)?;
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        if EXPERIMENTS.iter().any(|e| e.0 == stem) {
            return Err(Error::Config(format!(
                "{name}: an experiment of the program is called {stem}; rename the file"
            )));
        }
        Self::parse(&stem, &text, name)
    }

    fn parse(name: &str, text: &str, file: &str) -> Result<Self> {
        let wrong = |what: String| Error::Config(format!("{file}: {what}"));
        let mut all: Self = toml::from_str(text).map_err(|e| wrong(e.to_string()))?;
        if let Some((scene, key)) = put_in(text) {
            return Err(wrong(format!(
                "scene {scene}: video.{key} is put in by the experiment, from its `digits`, `seeds` and `frames`; leave it out there"
            )));
        }
        all.name = name.into();
        all.complete().map_err(wrong)?;
        let (least, most) = all.occluded;
        if !(1..=most).contains(&least) || most > 100_000 {
            return Err(wrong("occluded: expected two numbers of frames from 1 to 100000, the less first".into()));
        }
        let of_digits = matches!(all.kind, Kind::Table | Kind::Policy | Kind::Digits | Kind::Curve);
        let wrong_digits = |digits: &[u8]| digits.iter().any(|d| *d > 9) || of_digits && digits.is_empty();
        if wrong_digits(&all.digits) || wrong_digits(&all.quick.digits) {
            return Err(wrong("digits: expected some from 0 to 9".into()));
        }
        if all.lines.is_empty() || ![all.frames, all.quick.frames].iter().all(|n| (2..=100_000).contains(n)) {
            return Err(wrong("expected a line at least, and 2 to 100000 frames".into()));
        }
        let twice =
            |names: Vec<&str>| (1..names.len()).find(|i| names[..*i].contains(&names[*i])).map(|i| names[i].to_owned());
        for (what, names) in [
            ("line", all.lines.iter().map(|l| l.name.as_str()).collect()),
            ("scene", all.scenes.iter().map(|s| s.name.as_str()).collect()),
        ] {
            if let Some(name) = twice(names) {
                return Err(wrong(format!("two {what}s are called {name}; give each a name of its own")));
            }
        }
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
        let scenes = || all.scenes.iter().map(|s| &s.name).chain(all.multi.iter().map(|s| &s.name));
        for expect in &all.expect {
            if all.index(&expect.line).is_none() {
                return Err(wrong(format!("a figure of a line {} is expected, which is not there", expect.line)));
            }
            if !scenes().any(|name| *name == expect.scene) {
                return Err(wrong(format!("a figure of a scene {} is expected, which is not there", expect.scene)));
            }
        }
        Ok(all)
    }

    /// Fills in the omitted fields of each line. Fails with the reason.
    fn complete(&mut self) -> std::result::Result<(), String> {
        for i in 0..self.lines.len() {
            let (earlier, line) = self.lines.split_at_mut(i);
            let line = &mut line[0];
            match line.like.clone() {
                Some(like) => match earlier.iter().find(|other| other.name == like) {
                    Some(other) => line.follow(other),
                    None => return Err(format!("line {} is like {like}, which is not a line before it", line.name)),
                },
                None if line.config.is_empty() => {
                    return Err(format!("line {}: expected a `config`, or the line it is `like`", line.name));
                }
                None => {}
            }
        }
        Ok(())
    }

    /// Returns the first scene.
    pub(super) fn scene(&self) -> Result<&Scene<Synthetic>> {
        self.scenes.first().ok_or_else(|| Error::Config(format!("{}: no [[scene]]", self.name)))
    }

    /// Changes the experiment to the small variant.
    pub(super) fn make_quick(&mut self) {
        let Quick { digits, seeds, frames } = self.quick.clone();
        (self.digits, self.seeds, self.frames) = (digits, seeds, frames);
        self.sequences.truncate(1);
    }

    fn index(&self, line: &str) -> Option<usize> {
        self.lines.iter().position(|l| l.name == line)
    }

    /// Returns the line for the paired comparison: the given one, or else the fixed centre of the same configuration.
    pub(super) fn against(&self, line: usize) -> Option<usize> {
        let this = &self.lines[line];
        let fixed =
            |l: &LineSpec| l.config == this.config && l.policy.as_deref() == Some("fixed") && l.change.is_empty();
        let found = match &this.against {
            Some(name) => self.index(name),
            None => self.lines.iter().position(fixed).filter(|_| this.change.is_empty()),
        };
        found.filter(|&other| other != line)
    }
}

#[cfg(test)]
mod tests;
