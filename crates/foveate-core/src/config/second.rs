//! The configuration of the second tracker: it follows one target, in the same pictures as the first.

use std::path::Path;

use super::{Blueprint, Config, Configure};
use foveate_base::files::Files;
use foveate_base::{Error, Result};

impl Config {
    /// The second opinion that the configuration names, if any.
    pub(super) fn second(&self, files: &dyn Files) -> Result<Option<Blueprint>> {
        let Some(named) = &self.second_opinion else { return Ok(None) };
        let wrong = |why: String| Error::Config(format!("second_opinion: {named}: {why}"));
        if self.multi_target.is_some() {
            return Err(wrong(
                "a second opinion is of one target; leave it out (--set second_opinion=none), or [multi_target]".into(),
            ));
        }
        let config = match named.strip_prefix("builtin:") {
            Some(name) => name.config().map_err(|error| wrong(error.to_string()))?.with_parts(&self.parts),
            None => Self::read_with(files, Path::new(named), &self.parts)?,
        };
        let without = [
            ("committee", config.committee > 1),
            ("second_opinion", config.second_opinion.is_some()),
            ("[sensor]", config.sensor.is_some()),
            ("[multi_target]", config.multi_target.is_some()),
            ("[detector]", config.detector.is_some()),
            ("[recogniser]", config.recogniser.is_some()),
        ];
        if let Some((section, _)) = without.iter().find(|(_, has)| *has) {
            return Err(wrong(format!("it has {section}, which a second opinion may not have; leave it out")));
        }
        config.check(files).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::files::Nowhere;

    #[test]
    fn none_is_no_second_opinion() {
        let natural = "natural".config().expect("it ships");
        let second = |config: Config| config.second(&Nowhere).expect("it is right").is_some();
        assert!(second(natural.clone()) && !second(natural.set("second_opinion=none").expect("it may be left out")));
    }

    #[test]
    fn a_second_opinion_that_cannot_be_is_refused_by_name() {
        let natural = Config::builtin("natural").expect("it ships").expect("it is right");
        let natural = Config { box_regression: None, ..natural };
        for (settings, said) in [
            (&["second_opinion=builtin:natrual"][..], "natural-middle"),
            (&["second_opinion=builtin:natural"], "it has second_opinion"),
            (&["second_opinion=builtin:natural-committee"], "it has committee"),
            (&["second_opinion=builtin:multi"], "it has [multi_target]"),
            (&["second_opinion=builtin:narrow"], "it has [sensor]"),
            (&["second_opinion=nowhere.toml"], "nowhere.toml"),
            (&["second_opinion=builtin:natural-middle", "multi_target={}"], "a second opinion is of one target"),
        ] {
            let config = settings.iter().try_fold(natural.clone(), |config, setting| config.set(setting));
            let error = config.and_then(|config| config.check(&Nowhere)).map(|_| ()).expect_err(said).to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
