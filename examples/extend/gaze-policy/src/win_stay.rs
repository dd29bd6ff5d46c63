//! Win, stay; lose, shift: the policy keeps a gaze as long as it is rewarded, and moves to the next one otherwise.

use foveate::extend::{Context, Gaze, Grid, Plan, Policy, Rng, SavedState};
use foveate::{Error, Result};
use serde::{Deserialize, Serialize};

/// The keys of `[policy]` beside `kind`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// A reward above this is a win, 0 to 1.
    win: f64,
    /// The gazes.
    #[serde(default)]
    grid: Grid,
}

pub struct WinStay {
    gazes: Vec<Gaze>,
    win: f64,
    /// The index of the current gaze: all that is learned.
    at: usize,
}

impl WinStay {
    pub fn new(settings: Settings) -> Result<Self> {
        if !(0.0..=1.0).contains(&settings.win) {
            return Err(Error::Config(format!("policy.win is a number from 0 to 1; it is {}", settings.win)));
        }
        Ok(Self { gazes: settings.grid.gazes(), win: settings.win, at: 0 })
    }
}

/// The state that a saved tracker carries.
#[derive(Deserialize, Serialize)]
struct Learned {
    at: usize,
}

impl Policy for WinStay {
    fn plan(&mut self, _: &Context, plan: &mut Plan, _: &mut Rng) {
        plan.only(self.gazes[self.at]);
    }
    fn learn(&mut self, _: &Plan, rewards: &[f64]) {
        if rewards[0] <= self.win {
            self.at = (self.at + 1) % self.gazes.len();
        }
    }
    fn save(&self) -> SavedState {
        SavedState::new(&Learned { at: self.at })
    }
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        let Learned { at } = saved.read()?;
        if at >= self.gazes.len() {
            return Err(Error::Invalid(format!("win-stay: gaze {at} of {}", self.gazes.len())));
        }
        self.at = at;
        Ok(())
    }
    fn reset(&mut self) {
        self.at = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate::extend::conformance;

    #[test]
    fn the_law_of_policies_holds() {
        let new = || WinStay::new(Settings { win: 0.5, grid: Grid::default() }).expect("settings in range");
        conformance::policy(&|| Box::new(new()));
    }
}
