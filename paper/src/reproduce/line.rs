//! One line of an experiment: a configuration with its changes.

use crate::eval::learning::Template;
use crate::eval::policy_set;
use foveate::config::{Config, Exp3Config, PolicyConfig, RECOGNISERS, RecogniserConfig};
use foveate::files::Folder;
use foveate::gaze::Grid;
use foveate::identity::accumulate::Accumulate;
use foveate::lab::eval::experiment::digest;
use foveate::{Error, Result};
use serde::{Deserialize, Serialize};

use crate::DIGITS;
use foveate_cli::configure::{self, Changes};
use foveate_cli::runs::Entry;

/// Configurations of the paper: as printed, and with its authors' parameters.
const CONFIGS: [(&str, &str); 2] =
    [("printed", include_str!("../../configs/printed.toml")), ("authors", include_str!("../../configs/authors.toml"))];

/// The origin of a line's settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Group {
    /// This project's recommendation.
    #[default]
    Recommended,
    /// The authors' own parameters.
    Authors,
    /// The values printed in the paper.
    Printed,
    /// Another tracker.
    Peer,
}

impl Group {
    pub(super) fn title(self) -> &'static str {
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
pub(super) struct LineSpec {
    pub name: String,
    #[serde(default)]
    pub group: Group,
    /// The paper's row beside it.
    pub row: Option<String>,
    /// An earlier line: provides the missing configuration, policy and changes; given changes are merged over its changes.
    pub like: Option<String>,
    /// A shipped configuration or a file; may be omitted with `like`.
    #[serde(default)]
    pub config: String,
    /// The name of one of `policy_set::policies`; default: the configuration's own.
    pub policy: Option<String>,
    /// Changes merged over the configuration.
    #[serde(default)]
    pub change: toml::Table,
    /// Names of the scenes it runs on; default: all.
    pub scenes: Option<Vec<String>>,
    /// The line for the paired comparison; default: the fixed centre of the same configuration.
    pub against: Option<String>,
    /// The recogniser's gazes.
    pub looks: Option<Looks>,
    /// The source of the template, for learning curves.
    #[serde(default)]
    pub template: Template,
    /// Whether each of many targets has an independent tracker.
    #[serde(default)]
    pub alone: bool,
}

/// The recogniser's gazes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Looks {
    Random,
    Circular,
    /// Chosen by EXP3.
    Learned,
    Fixed,
}

impl LineSpec {
    /// Returns whether the line runs on a scene.
    pub(super) fn is_run_on(&self, scene: &str) -> bool {
        self.scenes.as_ref().is_none_or(|names| names.iter().any(|n| n == scene))
    }

    /// Copies omitted fields from another line.
    pub(super) fn follow(&mut self, other: &Self) {
        if self.config.is_empty() {
            self.config.clone_from(&other.config);
        }
        if self.policy.is_none() {
            self.policy.clone_from(&other.policy);
        }
        let own = std::mem::replace(&mut self.change, other.change.clone());
        lay(&mut self.change, &own);
    }

    /// Returns the checked configuration, with `settings` applied as in [`Config::set`].
    pub(super) fn entry(&self, settings: &[String]) -> Result<Entry> {
        let (mut config, files) = match CONFIGS.iter().find(|(name, _)| *name == self.config) {
            Some((name, text)) => (Config::parse(text, name)?, Folder::here()),
            None => configure::read(&self.config, &Changes::default())?,
        };
        if let Some(name) = &self.policy {
            let all = policy_set::policies(&config.policy);
            let found = all.iter().find(|policy| policy_set::policy_name(policy) == *name).cloned();
            config.policy = found.ok_or_else(|| {
                let names: Vec<String> = all.iter().map(policy_set::policy_name).collect();
                Error::Config(format!("line {}: there is no policy {name}; there are {}", self.name, names.join(", ")))
            })?;
        }
        let mut text = toml::Table::try_from(&config).map_err(|e| Error::Config(format!("line {}: {e}", self.name)))?;
        lay(&mut text, &self.change);
        let config = Config::parse_with(&text.to_string(), &format!("line {}", self.name), &crate::parts::parts())?;
        let in_line = |e: Error| Error::Config(format!("line {}: {e}", self.name));
        let config = settings.iter().try_fold(config, |config, setting| config.set(setting)).map_err(in_line)?;
        // The seed of each run is that of its job.
        let blueprint = Config { seed: 0, ..config }.check(&files).map_err(in_line)?;
        let Some(looks) = self.looks else { return Entry::of(blueprint, "") };
        let model = RECOGNISERS.iter().find(|model| DIGITS.ends_with(model.0)).map_or(&[][..], |model| model.1);
        Entry::of(blueprint.with_recogniser(looks.recogniser(), &Folder::here())?, &digest(&[model]))
    }
}

impl Looks {
    /// Returns the shipped recogniser of digits with these gazes.
    fn recogniser(self) -> RecogniserConfig {
        let grid = Grid { reach: 0.5, ..Grid::default() };
        let policy = match self {
            Self::Random => PolicyConfig::Random { grid },
            Self::Circular => PolicyConfig::Circular { grid },
            Self::Learned => PolicyConfig::Exp3(Exp3Config { grid, ..Exp3Config::default() }),
            Self::Fixed => policy_set::FIXED,
        };
        let (weights, accumulate, policy) = (DIGITS.into(), Accumulate::Sum, Some(policy));
        RecogniserConfig::MultiFixation { weights, accumulate, policy, alarm: false }
    }
}

/// Merges one table over another: replaces values, and merges nested tables unless their `kind` differs.
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
    fn changes_are_laid_over() {
        let mut below: toml::Table =
            toml::from_str("a = 1\n[r]\nkind = 'x'\nt = 0.5\n[s]\nu = 1\nv = 2").expect("TOML");
        let above = toml::from_str("[r]\nkind = 'y'\n[s]\nu = 3\n[n]\nw = 1").expect("TOML");
        lay(&mut below, &above);
        let wanted: toml::Table =
            toml::from_str("a = 1\n[r]\nkind = 'y'\n[s]\nu = 3\nv = 2\n[n]\nw = 1").expect("TOML");
        assert_eq!(below, wanted);
    }
}
