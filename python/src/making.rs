//! How a tracker is made, kept so that a pickle can make it again.

use std::path::{Path, PathBuf};

use foveate::config::{Blueprint, Config};
use foveate::files::Folder;
use foveate::{Error, Profile, Result};
use pyo3::prelude::*;

use crate::errors::OrRaise;
use crate::pictures::Channels;

/// A configuration given by Python: TOML text of its own, or what is changed in a profile.
#[derive(FromPyObject)]
pub struct Given {
    text: Option<String>,
    path: Option<PathBuf>,
    settings: Vec<String>,
}

/// A checked configuration with its seed, and how pictures come.
#[derive(Clone)]
pub struct Making {
    pub blueprint: Blueprint,
    /// The folder that its model files are relative to.
    pub folder: PathBuf,
    pub seed: u64,
    pub channels: Channels,
}

impl Making {
    /// By a profile or a configuration's name, and `config`, as `foveate._config.given` understands it.
    pub fn new(
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
        let (config, folder) = py.detach(|| read(profile, given)).or_raise(py)?;
        Self::of(config, folder, seed, channels).or_raise(py)
    }

    /// What a pickle has.
    pub fn again(py: Python<'_>, text: &str, folder: PathBuf, seed: u64, channels: &str) -> PyResult<Self> {
        let channels = Channels::named(py, channels)?;
        let config = Config::parse(text, "the pickle's configuration").or_raise(py)?;
        Self::of(config, folder, Some(seed), channels).or_raise(py)
    }

    fn of(config: Config, folder: PathBuf, seed: Option<u64>, channels: Channels) -> Result<Self> {
        let seed = seed.unwrap_or(config.seed);
        let blueprint = config.check(&Folder::new(&folder))?;
        Ok(Self { blueprint, folder, seed, channels })
    }

    /// The configuration as TOML, every setting written out.
    pub fn text(&self) -> String {
        self.blueprint.config().to_toml()
    }
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
            let shipped = Config::builtin(name).unwrap_or_else(|| {
                let names = Config::names().join(", ");
                Err(Error::Config(format!(
                    "profile is \"fast\", \"balanced\", \"accurate\", or the name of a configuration that ships: {names}; it is \"{profile}\". \
                     A configuration of your own goes into config="
                )))
            });
            (shipped?, here()?)
        }
    };
    let config = settings.iter().try_fold(config, |config, setting| config.set(setting))?;
    Ok((config, folder))
}
