//! Settings of EXP3 and its relatives.

use serde::{Deserialize, Serialize};

use super::ranges::Ranges;
use crate::gaze::{Exp3, Grid, Policy, Schedule, Variant};
use foveate_base::Result;
use foveate_base::error::within;

/// EXP3.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Exp3Config {
    /// The gazes.
    pub grid: Grid,
    /// Share of frames that explore; the learning rate is γ/K, above 0 to 1.
    pub gamma: Schedule,
}

impl Default for Exp3Config {
    fn default() -> Self {
        Self { grid: Grid::default(), gamma: Schedule::Anytime }
    }
}

/// EXP3 exactly as the paper prints it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Exp3AsPrintedConfig {
    /// The gazes.
    pub grid: Grid,
    /// Share of frames that explore, and learning rate, above 0 to 1.
    pub gamma: f64,
}

impl Default for Exp3AsPrintedConfig {
    fn default() -> Self {
        Self { grid: Grid::default(), gamma: 0.1 }
    }
}

/// EXP3-IX.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Exp3IxConfig {
    /// The gazes.
    pub grid: Grid,
    /// Damping, above 0 to 1; the learning rate is 2γ.
    pub gamma: Schedule,
}

impl Default for Exp3IxConfig {
    fn default() -> Self {
        Self { grid: Grid::default(), gamma: Schedule::Anytime }
    }
}

/// EXP3.S.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Exp3SConfig {
    /// The gazes.
    pub grid: Grid,
    /// Share of frames that explore; the learning rate is γ/K, above 0 to 1.
    pub gamma: Schedule,
    /// Share of the weight that all gazes get each frame, above 0 to 1; about one over the frames between changes.
    pub share: f64,
}

impl Default for Exp3SConfig {
    fn default() -> Self {
        Self { grid: Grid::default(), gamma: Schedule::Fixed(0.1), share: 0.01 }
    }
}

impl Exp3Config {
    pub(super) fn build(&self) -> Result<Box<dyn Policy>> {
        Ok(Box::new(Exp3::new(self.grid.gazes(), Variant::Unbiased, self.gamma)?))
    }
}

impl Exp3AsPrintedConfig {
    pub(super) fn build(&self) -> Result<Box<dyn Policy>> {
        Ok(Box::new(Exp3::new(self.grid.gazes(), Variant::AsPrinted, self.gamma)?))
    }
}

impl Exp3IxConfig {
    pub(super) fn build(&self) -> Result<Box<dyn Policy>> {
        Ok(Box::new(Exp3::new(self.grid.gazes(), Variant::Implicit, self.gamma)?))
    }
}

impl Exp3SConfig {
    pub(super) fn build(&self) -> Result<Box<dyn Policy>> {
        Ok(Box::new(Exp3::new(self.grid.gazes(), Variant::Sharing(self.share), self.gamma)?))
    }
}

impl Ranges for Exp3Config {
    fn ranges(&self) -> Result<()> {
        self.gamma.check("policy.gamma", 1.0)?;
        self.grid.check()
    }
}

impl Ranges for Exp3AsPrintedConfig {
    fn ranges(&self) -> Result<()> {
        within("policy.gamma", self.gamma, 1e-9, 1.0)?;
        self.grid.check()
    }
}

impl Ranges for Exp3IxConfig {
    fn ranges(&self) -> Result<()> {
        self.gamma.check("policy.gamma", 1.0)?;
        self.grid.check()
    }
}

impl Ranges for Exp3SConfig {
    fn ranges(&self) -> Result<()> {
        self.gamma.check("policy.gamma", 1.0)?;
        within("policy.share", self.share, 1e-9, 1.0)?;
        self.grid.check()
    }
}

#[cfg(test)]
mod tests {
    use crate::config::{Parts, PolicyConfig};

    #[derive(serde::Serialize, serde::Deserialize)]
    struct Section {
        #[serde(deserialize_with = "crate::config::ranges::in_range")]
        policy: PolicyConfig,
    }

    fn read(text: &str) -> Result<Section, String> {
        toml::from_str(text).map_err(|e| e.to_string())
    }

    #[test]
    fn bandits_are_spelled_and_read_back() {
        for text in [
            "kind = \"exp3\"",
            "kind = \"exp3\"\ngamma = { frames = 300 }\ngrid = { n = 5, reach = 0.7 }",
            "kind = \"exp3-as-printed\"\ngamma = 1",
            "kind = \"exp3-ix\"\ngamma = \"anytime\"",
            "kind = \"exp3-s\"\ngamma = 0.2\nshare = 0.05",
            "kind = \"hedge\"\ngamma = \"anytime\"",
            "kind = \"hedge\"\ngamma = { frames = 300 }",
        ] {
            let section = read(&format!("[policy]\n{text}")).expect(text);
            crate::config::policy(&section.policy, &Parts::new()).map(|_| ()).expect("settings in range");
            let again = toml::to_string(&section).expect("plain data");
            assert_eq!(read(&again).expect("what was written").policy, section.policy, "{again}");
        }
    }

    #[test]
    fn mistakes_are_errors() {
        for (text, words) in [
            ("kind = \"exp4\"", &["exp4", "`exp3`", "`exp3-as-printed`", "`exp3-ix`", "`exp3-s`"][..]),
            ("kind = \"exp3\"\ngama = 0.1", &["gama", "`gamma`", "line"]),
            ("kind = \"exp3\"\ngamma = \"sometime\"", &["sometime", "\"anytime\"", "{ frames = 300 }", "line"]),
            ("kind = \"exp3\"\ngamma = { frame = 3 }", &["frame", "`frames`"]),
            ("kind = \"exp3\"\ngamma = 1.5", &["policy.gamma", "1.5", "line"]),
            ("kind = \"exp3-as-printed\"\ngamma = nan", &["policy.gamma", "NaN"]),
            ("kind = \"exp3-as-printed\"\nshare = 2", &["share", "`gamma`"]),
            ("kind = \"exp3-ix\"\ngamma = { frames = 0 }", &["policy.gamma", "frames is 0"]),
            ("kind = \"exp3-s\"\nshare = 0", &["policy.share", "0"]),
            ("kind = \"exp3-s\"\ngrid = { n = 99 }", &["grid.n", "99"]),
            ("kind = \"hedge\"\ngamma = -1", &["policy.gamma", "-1"]),
        ] {
            let error = read(&format!("[policy]\n{text}")).map(|_| ()).expect_err(text);
            assert!(words.iter().all(|word| error.contains(word)), "{text}: {error}");
        }
    }
}
