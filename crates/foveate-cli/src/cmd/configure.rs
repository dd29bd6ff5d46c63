//! The configuration of a run: a file, or a shipped configuration by name or profile, with the changes of the command line.

use std::path::Path;

use clap::builder::PossibleValuesParser;
pub(crate) use foveate::config::POLICIES;

use foveate::config::{Blueprint, Config};
use foveate::files::Folder;
use foveate::lab::eval::catalogue::Half;
use foveate::{Error, Result};

use crate::invocation;

/// Stands for the letter of the other half in the settings of an evaluation.
pub(crate) const OTHER: &str = "{other}";

/// Configurations for real video, by speed.
#[derive(clap::ValueEnum, Clone, Copy, Debug)]
pub(crate) enum Profile {
    /// A quarter of the particles at nearly three times the speed: natural-fast
    Fast,
    /// The default: natural
    Balanced,
    /// Three natural trackers that vote, at a third of the speed on one core; fewest failures: natural-committee
    Accurate,
}

/// Returns the name given by the name or the profile; `natural` by default.
pub(crate) fn config_name(config: Option<&str>, profile: Option<Profile>) -> &str {
    let profile = match profile {
        Some(Profile::Fast) => foveate::Profile::Fast,
        Some(Profile::Balanced) | None => foveate::Profile::Balanced,
        Some(Profile::Accurate) => foveate::Profile::Accurate,
    };
    config.unwrap_or(profile.name())
}

/// Changes that the command line makes to a configuration.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct Changes {
    /// Gaze policy that replaces the configuration's, with its default settings; change them with --set policy.KEY=VALUE. A policy with a
    /// grid gets 3 x 3 gazes that reach half-way to the box's edge
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(POLICIES))]
    pub policy: Option<String>,
    /// Change one setting of the configuration, for example particles=400 or policy.grid.reach=0.3. KEY=none removes a setting. Repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

impl Changes {
    /// Returns these settings without a gaze policy.
    pub fn of(set: &[String]) -> Self {
        Self { policy: None, set: set.to_vec() }
    }

    /// Splits the changes into those of one section and all others.
    pub fn apart(&self, section: &str) -> (Self, Self) {
        let of =
            |setting: &&String| setting.trim_start().strip_prefix(section).is_some_and(|rest| rest.starts_with('.'));
        let (ours, others): (Vec<&String>, Vec<_>) = self.set.iter().partition(of);
        let some = |set: Vec<&String>| set.into_iter().cloned().collect();
        (Self { policy: None, set: some(ours) }, Self { policy: self.policy.clone(), set: some(others) })
    }

    /// Applies the changes to a configuration.
    pub fn make(&self, mut config: Config) -> Result<Config> {
        if let Some(name) = &self.policy {
            config = config.with_policy(name)?;
        }
        self.set.iter().try_fold(config, |config, setting| config.set(setting))
    }

    /// Returns the changes for the sequences of a half: the letter of the other half in place of each `{other}`.
    pub fn for_half(&self, half: Half) -> Self {
        let set = self.set.iter().map(|setting| setting.replace(OTHER, half.other().name())).collect();
        Self { policy: self.policy.clone(), set }
    }

    /// Returns the configuration's name followed by the changes.
    pub fn describe(&self, name: &str) -> String {
        let policy = self.policy.iter().map(|policy| format!("policy {policy}"));
        let all: Vec<String> = std::iter::once(name.to_owned()).chain(policy).chain(self.set.iter().cloned()).collect();
        all.join(", ")
    }
}

/// The configuration and the seed of a command that tracks.
#[derive(clap::Args)]
pub(crate) struct Choice {
    /// Configuration file, or the name of a shipped configuration; default: natural
    #[arg(long, short, value_name = "FILE|NAME")]
    pub config: Option<String>,
    /// Trade-off between speed and accuracy, if no configuration is given
    #[arg(long, value_enum, conflicts_with = "config")]
    profile: Option<Profile>,
    #[command(flatten)]
    changes: Changes,
    /// Random seed; the same seed gives the same boxes. Default: the configuration's seed
    #[arg(long)]
    seed: Option<u64>,
}

impl Choice {
    /// Returns the name or the file of the configuration.
    pub(crate) fn name(&self) -> &str {
        config_name(self.config.as_deref(), self.profile)
    }

    /// Returns the checked configuration and the seed.
    pub(crate) fn blueprint(&self) -> Result<(Blueprint, u64)> {
        let (config, folder) = read(self.name(), &self.changes)?;
        let blueprint = config.check(&folder)?;
        let seed = self.seed.unwrap_or(blueprint.config().seed);
        Ok((blueprint, seed))
    }
}

/// Reads a configuration from a file or by name and applies the changes. Also returns the folder that its model files are relative to.
pub fn read(name: &str, changes: &Changes) -> Result<(Config, Folder)> {
    let (path, parts) = (Path::new(name), invocation::parts());
    let (config, folder) = match Config::builtin(name) {
        _ if path.is_file() => (Config::read_with(&Folder::here(), path, &parts)?, Folder::of(path)),
        Some(config) => (config?.with_parts(&parts), Folder::here()),
        None => {
            return Err(Error::Config(format!(
                "there is no configuration file {name}, and none of that name ships with the program; those that do: {}",
                Config::names().join(", ")
            )));
        }
    };
    Ok((changes.make(config)?, folder))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_policy_fits_every_configuration() {
        for name in ["natural", "digits-hedge", "digits-partial"] {
            for policy in POLICIES {
                let changes = Changes { policy: Some(policy.into()), set: vec!["particles=50".into()] };
                let (config, folder) = read(name, &changes).unwrap_or_else(|e| panic!("{name}, {policy}: {e}"));
                assert_eq!(config.particles, 50);
                assert!(config.to_toml().contains(&format!("kind = \"{policy}\"")), "{}", config.to_toml());
                config.check(&folder).unwrap_or_else(|e| panic!("{name}, {policy}: {e}"));
                assert_eq!(changes.describe(name), format!("{name}, policy {policy}, particles=50"));
            }
        }
        let hedge = read("digits-hedge", &Changes { policy: Some("hedge".into()), set: vec![] }).expect("a policy").0;
        assert_eq!(hedge, Config::builtin("digits-hedge").expect("it ships").expect("it is right"), "hedge as it was");
        let changes = Changes::of(&["particles=none".into()]);
        assert!(read("natural", &changes).expect_err("no number").to_string().contains("particles=none"));
    }
}
