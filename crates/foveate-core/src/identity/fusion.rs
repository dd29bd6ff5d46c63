//! Which cue to trust: Hedge over the template, the discriminant and the colour model.
//!
//! Each cue gives a distance, 0 at the target and about 1 elsewhere. A cue's margin in a frame is how much farther the
//! distractors are by it than the estimate, on average; its reward is the mean margin m so far, the newest frames counting most.
//! The weights that the configuration gives, w, become
//! ```text
//! w'ₖ ∝ wₖ exp(gain · mₖ),   Σ w' = 1:
//! ```
//! exponential weights (Hedge; Freund and Schapire, 1997), as the paper has them for gazes, from a prior w that is not even.
//!
//! Deviation: the paper has one cue.

use serde::{Deserialize, Serialize};

use foveate_base::error::within;
use foveate_base::{Error, Result};

/// Settings of the fusion of cues. It needs a discriminant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// How strongly a cue's weight follows its margin: times e for each 1 / `gain` of it; 0 to 100. At 0 weights stay.
    pub gain: f64,
    /// Learning rate: weight of the newest frame in the mean margin, 0 to 1.
    pub learning_rate: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { gain: 2.0, learning_rate: 0.01 }
    }
}

impl Settings {
    /// Fails with the key if a number is out of range.
    pub fn check(&self) -> Result<()> {
        within("fusion.gain", self.gain, 0.0, 100.0)?;
        within("fusion.learning_rate", self.learning_rate, 0.0, 1.0)
    }
}

/// What template, discriminant and colour have been worth on one target.
#[derive(Clone, Debug)]
pub struct Fusion {
    settings: Settings,
    margins: [f64; 3],
}

impl Fusion {
    /// Knows nothing yet: all cues are worth the same.
    pub fn new(settings: Settings) -> Self {
        Self { settings, margins: [0.0; 3] }
    }

    /// Forgets all.
    pub fn reset(&mut self) {
        self.margins = [0.0; 3];
    }

    /// Learns from a frame: how much farther the distractors are than the estimate, by each cue; at most 1 counts.
    pub fn learn(&mut self, margins: [f64; 3]) {
        for (mean, margin) in self.margins.iter_mut().zip(margins) {
            *mean += self.settings.learning_rate * (margin.clamp(-1.0, 1.0) - *mean);
        }
    }

    /// From the mixing weights of the configuration to those in use: of the discriminant beside the template, and of colour
    /// beside both.
    pub fn mixed(&self, discriminant: f64, colour: f64) -> (f64, f64) {
        let shape = 1.0 - colour;
        let prior = [shape * (1.0 - discriminant), shape * discriminant, colour];
        let most = self.margins.iter().copied().fold(f64::MIN, f64::max);
        let of = |k: usize| prior[k] * (self.settings.gain * (self.margins[k] - most)).exp();
        let [template, discriminant, colour] = [of(0), of(1), of(2)];
        let shape = (template + discriminant).max(f64::MIN_POSITIVE);
        (discriminant / shape, colour / (shape + colour))
    }

    /// The mean margins.
    pub fn save(&self) -> [f64; 3] {
        self.margins
    }

    /// Restores a state of `save`. Fails without change if it is invalid.
    pub fn load(&mut self, margins: [f64; 3]) -> Result<()> {
        if margins.iter().any(|m| !(-1.0..=1.0).contains(m)) {
            return Err(Error::Invalid(format!(
                "the saved fusion of cues cannot be used: margins are -1 to 1, they are {margins:?}"
            )));
        }
        self.margins = margins;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(settings: Settings, margins: [f64; 3], frames: usize) -> Fusion {
        let mut it = Fusion::new(settings);
        (0..frames).for_each(|_| it.learn(margins));
        it
    }

    #[test]
    fn weights_are_exponential_in_the_mean_margin() {
        let settings = Settings { gain: 3.0, learning_rate: 0.1 };
        assert_eq!(after(settings, [0.7, 0.1, 0.3], 0).mixed(0.5, 0.2), (0.5, 0.2), "nothing learned yet");
        let margins = [0.7, 0.1, 0.3];
        let mean = margins.map(|m| m * (1.0 - 0.9f64.powi(20)));
        let raw: [f64; 3] = std::array::from_fn(|k| [0.4, 0.4, 0.2][k] * (3.0 * mean[k]).exp());
        let (discriminant, colour) = after(settings, margins, 20).mixed(0.5, 0.2);
        assert!((discriminant - raw[1] / (raw[0] + raw[1])).abs() < 1e-12);
        assert!((colour - raw[2] / raw.iter().sum::<f64>()).abs() < 1e-12);
    }

    #[test]
    fn a_cue_of_no_weight_stays_without_and_equals_stay_equal() {
        let it = after(Settings { gain: 100.0, learning_rate: 1.0 }, [-1.0, -1.0, 1.0], 5);
        assert_eq!(it.mixed(0.5, 0.0).1, 0.0);
        let (discriminant, colour) = it.mixed(0.5, 0.2);
        assert!((discriminant - 0.5).abs() < 1e-12 && colour > 0.999);
    }

    #[test]
    fn regret_against_the_best_cue_is_that_of_hedge() {
        // Without forgetting, at the rate sqrt(8 ln 3 / T): at most sqrt(T ln 3 / 2) over T frames (Cesa-Bianchi and Lugosi, theorem 2.2).
        let frames = 2000usize;
        let reward = |t: usize, k: usize| f64::from((t * 7919 + k * 104_729) % 10 < [3, 5, 6][k]);
        let (mut earned, mut each) = (0.0, [0.0; 3]);
        for t in 0..frames {
            // The mean over t frames, with a gain of eta t, is the sum at eta.
            let eta = (8.0 * 3f64.ln() / frames as f64).sqrt();
            let mut it = Fusion::new(Settings { gain: eta * t as f64, learning_rate: 1.0 });
            it.learn(each.map(|sum: f64| if t == 0 { 0.0 } else { sum / t as f64 }));
            let (discriminant, colour) = it.mixed(0.5, 1.0 / 3.0);
            let weights = [(1.0 - colour) * (1.0 - discriminant), (1.0 - colour) * discriminant, colour];
            earned += (0..3).map(|k| weights[k] * reward(t, k)).sum::<f64>();
            (0..3).for_each(|k| each[k] += reward(t, k));
        }
        let best = each.iter().copied().fold(0.0, f64::max);
        assert!(best - earned <= (frames as f64 * 3f64.ln() / 2.0).sqrt(), "{earned} of {best}");
    }

    #[test]
    fn what_is_saved_is_taken_up_and_damage_refused() {
        let it = after(Settings::default(), [0.2, 0.4, -0.1], 9);
        let mut other = Fusion::new(Settings::default());
        other.load(it.save()).expect("its own");
        assert_eq!(other.mixed(0.5, 0.2), it.mixed(0.5, 0.2));
        let before = other.save();
        other.load([0.0, f64::NAN, 0.0]).expect_err("no number");
        assert_eq!(other.save(), before);
    }

    #[test]
    fn settings_are_checked() {
        assert!(Settings::default().check().is_ok());
        for (bad, name) in [
            (Settings { gain: -1.0, ..Settings::default() }, "fusion.gain"),
            (Settings { learning_rate: f64::NAN, ..Settings::default() }, "fusion.learning_rate"),
        ] {
            assert!(bad.check().expect_err(name).to_string().contains(name));
        }
    }
}
