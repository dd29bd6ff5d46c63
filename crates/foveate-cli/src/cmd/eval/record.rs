//! The record of an evaluation: stored in `scores.json` as `run` and shown in `report.html`, so that two folders of results can be
//! distinguished.

use std::path::{Path, PathBuf};

use foveate::lab::eval::{Sequence, experiment, mot};
use foveate::report::escape;
use foveate::{Error, Result, files};
use rayon::prelude::*;
use serde::Serialize;

use crate::cmd::configs::rings;
use crate::runs::Entry;

/// The program, its arguments, and the data.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Record {
    program: &'static str,
    /// A digest of the program's file: two builds of one version differ.
    build: String,
    command: String,
    /// The tracker that was run; `None` if only results of other trackers were scored.
    tracker: Option<Ran>,
    /// The folders and files of scored results.
    results: Vec<PathBuf>,
    data: Vec<Data>,
}

/// A resolved configuration, and its number of runs.
#[derive(Clone, Debug, Serialize)]
struct Ran {
    /// The configuration's name and changes.
    configuration: String,
    policy: String,
    /// Windows and cells in the format of `foveate configs`.
    retina: String,
    seeds: Vec<u64>,
    /// A digest of its boxes on a small fixed video: differs if a model file differs.
    fingerprint: String,
    /// The whole configuration as TOML.
    text: String,
    /// The settings that --choose varied.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    choose: Vec<String>,
}

/// A sequence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Data {
    pub sequence: String,
    truth: PathBuf,
    /// A digest of the true boxes.
    boxes: String,
    /// A digest of the names and of all bytes of the pictures; `None` if no picture was read.
    pictures: Option<String>,
}

impl Data {
    /// Describes a sequence without reading its pictures.
    pub(crate) fn without_pictures(sequence: &Sequence) -> Self {
        Self {
            sequence: sequence.name.clone(),
            truth: sequence.truth_file.clone(),
            boxes: experiment::digest(&[format!("{:?}", sequence.truth).as_bytes()]),
            pictures: None,
        }
    }

    /// Describes a sequence that a tracker runs on.
    ///
    /// # Errors
    /// It has no pictures, or one cannot be read.
    pub(crate) fn with_pictures(sequence: &Sequence) -> Result<Self> {
        let one = |path: &PathBuf| {
            let bytes = files::read(path, files::PICTURE)?;
            Ok(experiment::digest(&[path.file_name().unwrap_or_default().as_encoded_bytes(), &bytes]))
        };
        let each: Vec<String> = sequence.files()?.par_iter().map(one).collect::<Result<_>>()?;
        let pictures = experiment::digest(&each.iter().map(String::as_bytes).collect::<Vec<_>>());
        Ok(Self { pictures: Some(pictures), ..Self::without_pictures(sequence) })
    }

    /// Describes the truth of many targets.
    ///
    /// # Errors
    /// The file cannot be read.
    pub(crate) fn of_many(sequence: &mot::Sequence) -> Result<Self> {
        let truth = sequence.truth_file.clone();
        let bytes = files::read(&truth, files::TEXT)?;
        Ok(Self { sequence: sequence.name.clone(), truth, boxes: experiment::digest(&[&bytes]), pictures: None })
    }

    /// Returns a digest of the true boxes and the pictures.
    pub(crate) fn digest(&self) -> String {
        experiment::digest(&[&self.boxes, self.pictures.as_deref().unwrap_or_default()].map(str::as_bytes))
    }
}

impl Record {
    /// Creates the record of an evaluation that runs no tracker, and scores the results in these folders and files.
    ///
    /// # Errors
    /// The program's file cannot be read.
    pub(crate) fn of(results: Vec<PathBuf>, data: Vec<Data>) -> Result<Self> {
        Ok(Self {
            program: concat!("foveate ", env!("CARGO_PKG_VERSION")),
            build: program()?,
            command: crate::invocation::command(),
            tracker: None,
            results,
            data,
        })
    }

    /// Adds the tracker that is run; `configuration` is its name and changes.
    pub(crate) fn running(mut self, entries: &[Entry], configuration: &str, seeds: &[u64], choose: &[String]) -> Self {
        let (blueprint, config) = (&entries[0].blueprint, entries[0].blueprint.config());
        self.tracker = Some(Ran {
            configuration: configuration.into(),
            policy: config.policy_kind(),
            retina: rings(&*blueprint.retina()),
            seeds: seeds.to_vec(),
            fingerprint: fingerprint(entries),
            text: text(entries),
            choose: choose.to_vec(),
        });
        self
    }

    /// Returns the configuration's name and changes; empty if no tracker is run.
    pub(crate) fn configuration(&self) -> &str {
        self.tracker.as_ref().map_or("", |ran| &ran.configuration)
    }

    /// Returns the record for `scores.json`.
    pub(crate) fn json(&self) -> serde_json::Value {
        serde_json::to_value(self).expect("it is plain data")
    }

    /// Returns the record as a section of `report.html`.
    pub(crate) fn html(&self) -> String {
        let code = |text: &str| format!("<code>{}</code>", escape(text));
        let mut facts = vec![("Command", code(&self.command))];
        if let Some(ran) = &self.tracker {
            let seeds: Vec<String> = ran.seeds.iter().map(u64::to_string).collect();
            facts.push(("Configuration", escape(&ran.configuration)));
            facts.push(("Gaze policy", escape(&ran.policy)));
            facts.push(("Retina, window/cell", escape(&ran.retina)));
            facts.push(("Seeds", seeds.join(", ")));
        }
        if !self.results.is_empty() {
            let all: Vec<String> = self.results.iter().map(|path| code(&path.display().to_string())).collect();
            facts.push(("Other results", all.join(" ")));
        }
        facts.push(("Program", format!("{}, build {}", escape(self.program), code(&self.build))));
        let facts: String = facts.iter().map(|(what, text)| format!("<dt>{what}</dt><dd>{text}</dd>")).collect();
        let row = |data: &Data| {
            let [name, boxes] = [&data.sequence, &data.boxes].map(|text| escape(text));
            let pictures = data.pictures.as_deref().unwrap_or("not read");
            format!("<tr><td>{name}</td><td>{boxes}</td><td>{pictures}</td></tr>\n")
        };
        let rows: String = self.data.iter().map(row).collect();
        let config = self.tracker.as_ref().map_or(String::new(), |ran| {
            format!("<details><summary>The whole configuration</summary><pre>{}</pre></details>\n", escape(&ran.text))
        });
        format!(
            "<section class=\"card details\" id=\"run\"><h2>What was run</h2>\n<dl>{facts}</dl>\n{config}<details><summary>Checksums of the data (SHA-256, \
             the first 32 digits)</summary><div class=\"scroll\"><table>\n<tr><th>sequence</th><th>true boxes</th><th>pictures</th></tr>\n\
             {rows}</table></div></details></section>\n"
        )
    }
}

/// Returns the fingerprints of the configuration, or of those of half a and half b.
fn fingerprint(entries: &[Entry]) -> String {
    entries.iter().map(|entry| entry.fingerprint.as_str()).collect::<Vec<_>>().join(" ")
}

/// Returns the configuration as TOML, or those of half a and half b.
fn text(entries: &[Entry]) -> String {
    entries.iter().map(|entry| entry.blueprint.config().to_toml()).collect::<Vec<_>>().join("\n# Half b\n")
}

/// Returns a digest of the program itself: a rebuilt one may give other tracks.
pub(crate) fn program() -> Result<String> {
    let path = crate::invocation::program();
    Ok(experiment::digest(&[&files::read(path, files::MODEL)?]))
}

/// The common settings of finished runs: a file beside their folder.
#[derive(PartialEq, serde::Deserialize, Serialize)]
pub(crate) struct Settings {
    build: String,
    fingerprint: String,
    configuration: String,
}

impl Settings {
    pub(crate) fn of(entries: &[Entry]) -> Result<Self> {
        Ok(Self { build: program()?, fingerprint: fingerprint(entries), configuration: text(entries) })
    }

    /// Returns the file for a folder of finished runs.
    pub(crate) fn file(runs: &Path) -> PathBuf {
        runs.with_extension("settings.json")
    }

    /// Describes the difference from other settings; `None` if there is none.
    fn differs(&self, other: &Self) -> Option<String> {
        let (ours, theirs) = (self.configuration.lines(), other.configuration.lines());
        let lines = |text: &Self| text.configuration.lines().map(str::to_owned).collect::<Vec<_>>();
        if self == other {
            return None;
        }
        if ours.eq(theirs) {
            let what = if self.build == other.build { "other model files" } else { "another build of the program" };
            return Some(what.into());
        }
        let (ours, theirs) = (lines(self), lines(other));
        let only = |all: &[String], others: &[String]| all.iter().find(|line| !others.contains(line)).cloned();
        let [here, there] = [only(&ours, &theirs), only(&theirs, &ours)].map(|line| line.unwrap_or("nothing".into()));
        Some(format!("another configuration ({there}; this command has {here})"))
    }

    /// Writes the settings beside the folder `runs`. Fails if this folder, or one of the `others` that runs are taken from, was made with
    /// other settings.
    pub(crate) fn claim(&self, runs: &Path, others: &[PathBuf]) -> Result<()> {
        for folder in others.iter().map(PathBuf::as_path).chain([runs]).filter(|folder| folder.is_dir()) {
            let Ok(text) = files::read(Self::file(folder), files::TEXT) else { continue };
            let Ok(theirs) = serde_json::from_slice::<Self>(&text) else { continue };
            if let Some(what) = self.differs(&theirs) {
                let problem = format!(
                    "the runs kept here were made with {what}; repeat the command that made them, give another --out, or \
                     remove this folder"
                );
                return Err(Error::malformed(folder, problem));
            }
        }
        std::fs::create_dir_all(runs).map_err(Error::io(runs, "cannot create"))?;
        let text = serde_json::to_vec_pretty(self).map_err(|e| Error::Invalid(e.to_string()))?;
        files::write_inside(Self::file(runs), &text)
    }
}
