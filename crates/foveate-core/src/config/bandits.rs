//! Settings of EXP3 and its relatives.

use crate::gaze::{Exp3, Grid, Policy, Schedule, Variant};
use foveate_base::Result;

foveate_base::settings! {
    /// EXP3.
    pub struct Exp3Config in "policy" and rules {
        /// The gazes.
        pub grid: Grid = Grid::default(),
        /// Share of frames that explore; the learning rate is γ/K, above 0 to 1.
        pub gamma: Schedule = Schedule::Anytime,
    }

    /// EXP3 exactly as the paper prints it.
    pub struct Exp3AsPrintedConfig in "policy" and rules {
        /// The gazes.
        pub grid: Grid = Grid::default(),
        /// Share of frames that explore, and learning rate, above 0 to 1.
        pub gamma: f64 = 0.1; 1e-9 to 1.0,
    }

    /// EXP3-IX.
    pub struct Exp3IxConfig in "policy" and rules {
        /// The gazes.
        pub grid: Grid = Grid::default(),
        /// Damping, above 0 to 1; the learning rate is 2γ.
        pub gamma: Schedule = Schedule::Anytime,
    }

    /// EXP3.S.
    pub struct Exp3SConfig in "policy" and rules {
        /// The gazes.
        pub grid: Grid = Grid::default(),
        /// Share of frames that explore; the learning rate is γ/K, above 0 to 1.
        pub gamma: Schedule = Schedule::Fixed(0.1),
        /// Share of the weight that all gazes get each frame, above 0 to 1; about one over the frames between changes.
        pub share: f64 = 0.01; 1e-9 to 1.0,
    }
}

macro_rules! bandits {
    ($($config:ident: $variant:expr;)*) => {$(
        impl $config {
            fn rules(&self) -> Result<()> {
                Schedule::from(self.gamma).check("policy.gamma", 1.0)?;
                self.grid.check()
            }
            pub(super) fn build(&self) -> Result<Box<dyn Policy>> {
                let variant: fn(&Self) -> Variant = $variant;
                Ok(Box::new(Exp3::new(self.grid.gazes(), variant(self), self.gamma)?))
            }
        }
    )*};
}

bandits! {
    Exp3Config: |_| Variant::Unbiased;
    Exp3AsPrintedConfig: |_| Variant::AsPrinted;
    Exp3IxConfig: |_| Variant::Implicit;
    Exp3SConfig: |config| Variant::Sharing(config.share);
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
