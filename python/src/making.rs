//! The construction of a tracker, kept so that a pickle can repeat it.

use std::path::{Path, PathBuf};

use foveate::config::{Blueprint, Config};
use foveate::files::Folder;
use foveate::{Error, Profile, Result};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyString;

use crate::errors::OrRaise;
use crate::pictures::Channels;

/// A configuration from Python: TOML text, or changes of a profile.
#[derive(FromPyObject)]
pub(crate) struct Given {
    text: Option<String>,
    path: Option<PathBuf>,
    settings: Vec<String>,
}

/// A checked configuration with its seed, and the order of channels.
#[derive(Clone)]
pub(crate) struct Making {
    pub blueprint: Blueprint,
    /// The folder that its model files are relative to.
    pub folder: PathBuf,
    pub seed: u64,
    pub channels: Channels,
}

impl Making {
    /// Reads a profile or a configuration's name, and `config`, according to `foveate._config.given`.
    pub(crate) fn new(
        py: Python<'_>,
        profile: &str,
        config: Option<&Bound<'_, PyAny>>,
        seed: Option<u64>,
        channels: &str,
    ) -> PyResult<Self> {
        let channels = Channels::named(py, channels)?;
        let given =
            config.map(|config| py.import("foveate._config")?.call_method1("given", (config,))?.extract::<Given>());
        let given = given.transpose()?;
        if given.as_ref().is_none_or(|given| given.text.is_none() && given.path.is_none()) {
            known(py, profile)?;
        }
        let (config, folder) = py.detach(|| read(profile, given)).or_raise(py)?;
        Self::of(config, folder, seed, channels).or_raise(py)
    }

    /// Restores the construction from a pickle.
    pub(crate) fn again(py: Python<'_>, text: &str, folder: PathBuf, seed: u64, channels: &str) -> PyResult<Self> {
        let channels = Channels::named(py, channels)?;
        let config = Config::parse(text, "the pickle's configuration").or_raise(py)?;
        Self::of(config, folder, Some(seed), channels).or_raise(py)
    }

    fn of(config: Config, folder: PathBuf, seed: Option<u64>, channels: Channels) -> Result<Self> {
        let seed = seed.unwrap_or(config.seed);
        let blueprint = config.check(&Folder::new(&folder))?;
        Ok(Self { blueprint, folder, seed, channels })
    }

    /// Returns the configuration as TOML, with every setting.
    pub(crate) fn text(&self) -> String {
        self.blueprint.config().to_toml()
    }
}

/// Reads the argument `profile`; refuses settings with a hint to use `config`.
pub(crate) fn profile_name<'a>(given: &'a Bound<'_, PyAny>) -> PyResult<&'a str> {
    let Ok(name) = given.cast::<PyString>() else {
        let kind = given.get_type().name()?;
        return Err(PyTypeError::new_err(format!(
            "profile is a name such as \"balanced\"; it is a {kind}; settings and files go into config=, for example \
             Tracker(config={{\"particles\": 400}})"
        )));
    };
    name.to_str()
}

const PROFILES: [&str; 3] = ["fast", "balanced", "accurate"];

/// Refuses an unknown configuration name, with the nearest known one.
fn known(py: Python<'_>, profile: &str) -> PyResult<()> {
    let names: Vec<&str> = PROFILES.into_iter().chain(Config::names()).collect();
    if names.contains(&profile) {
        return Ok(());
    }
    let near: Vec<String> =
        py.import("difflib")?.call_method1("get_close_matches", (profile.to_lowercase(), &names, 1))?.extract()?;
    let meant = near.first().map_or_else(String::new, |name| format!("did you mean \"{name}\"? "));
    let error = Error::Config(format!(
        "there is no profile \"{profile}\"; {meant}Profiles are {}; a file of your own goes into config=",
        names.join(", ")
    ));
    Err(error).or_raise(py)
}

fn read(profile: &str, given: Option<Given>) -> Result<(Config, PathBuf)> {
    let here = || std::path::absolute("").or_else(|_| std::env::current_dir()).map_err(Error::io(".", "cannot find"));
    let Given { text, path, settings } = given.unwrap_or(Given { text: None, path: None, settings: vec![] });
    let (config, folder) = match (text, path) {
        (Some(text), _) => (Config::parse(&text, "config")?, here()?),
        (None, Some(path)) => {
            let path = std::path::absolute(&path).map_err(Error::io(&path, "cannot find"))?;
            let folder = path.parent().unwrap_or(Path::new("/")).to_owned();
            (Config::read(&Folder::here(), &path)?, folder)
        }
        (None, None) => {
            let name = Profile::named(profile).map_or(profile, |it| it.name());
            let shipped = Config::builtin(name).expect("its name is known");
            (shipped?, here()?)
        }
    };
    let config = settings.iter().try_fold(config, |config, setting| config.set(setting))?;
    Ok((config, folder))
}
