//! Where it was not looked for longest: a policy that knows how sure the tracker is, and what was last seen where and how long ago.
//!
//! While the target is held it looks at the middle of it, the wider the less sure its place is:
//! ```text
//! widening = clamp(1 + zoom · (spread − calm)₊ + roam · frames since it was lost / covers, 1, widest)
//! ```
//! so that as many values cover what the target may have moved to. Once it is lost, every other look is a saccade to the place
//! of the picture with the largest
//! ```text
//! age · exp(−distance / reach),    reach = 2 + roam · frames since it was lost
//! ```
//! with age the frames since a look covered it, and distances from where the target is expected, in template units: search theory's
//! rule (Koopman 1946) for a target that diffuses and a look that nearly always finds what it covers.
//!
//! Deviation: the paper's policies choose on the target, know nothing of the belief, and never look for what was lost.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{Context, Grid, Plan, Policy, misfit};
use crate::geometry::Gaze;
use foveate_base::Result;
use foveate_base::error::within;
use foveate_base::rng::Rng;

/// Cells of the map along a side of the picture.
const SIDE: usize = 16;

/// Settings of the policy.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Contextual {
    /// Where it looks on the target, in turn: cells that fall between those of the last look make the picture finer over time.
    pub grid: Grid,
    /// Widening per template unit of spread, 0 to 100; 0: only while it is lost, by `roam`.
    pub zoom: f64,
    /// Spread up to which nothing is widened, template units, 0 to 10.
    pub calm: f64,
    /// The largest widening, 1 to 100.
    pub widest: f64,
    /// How far a look covers the picture, template units, above 0 to 50: what the sensor's fovea reaches.
    pub covers: f64,
    /// How fast a lost target may wander, template units a frame, 0 to 100.
    pub roam: f64,
    /// Of so many looks for a lost target one is a saccade, 0 to 1000; 0: none.
    pub every: u64,
}

impl Default for Contextual {
    fn default() -> Self {
        Self { grid: Grid::default(), zoom: 2.0, calm: 0.3, widest: 3.0, covers: 2.0, roam: 0.5, every: 0 }
    }
}

impl Contextual {
    /// Fails where a number is out of range, naming it.
    pub fn check(&self) -> Result<()> {
        for (name, value, least, most) in [
            ("zoom", self.zoom, 0.0, 100.0),
            ("calm", self.calm, 0.0, 10.0),
            ("widest", self.widest, 1.0, 100.0),
            ("covers", self.covers, 1e-3, 50.0),
            ("roam", self.roam, 0.0, 100.0),
            ("every", self.every as f64, 0.0, 1000.0),
        ] {
            within(&format!("policy.{name}"), value, least, most)?;
        }
        self.grid.check()
    }
}

/// Looks at the target while it is there, and where it was not looked for longest when it is gone.
#[derive(Clone, Debug)]
pub struct Forager {
    settings: Contextual,
    /// On the target.
    gazes: Vec<Gaze>,
    /// Looks so far.
    frame: u64,
    /// Look at which it was lost.
    lost_at: Option<u64>,
    /// For each cell of the picture, the look that covered it last; 0: none.
    covered: Vec<u64>,
}

impl Forager {
    /// With these settings; it has seen nothing.
    pub fn new(settings: Contextual) -> Result<Self> {
        settings.check()?;
        Ok(Self { settings, gazes: settings.grid.gazes(), frame: 0, lost_at: None, covered: vec![0; SIDE * SIDE] })
    }

    /// The gaze of a cell's middle.
    fn gaze(cell: usize, [left, top, right, bottom]: [f64; 4]) -> Gaze {
        let at = |i: usize, from: f64, to: f64| from + (i as f64 + 0.5) / SIDE as f64 * (to - from);
        Gaze { u: at(cell % SIDE, left, right), v: at(cell / SIDE, top, bottom), arm: None }
    }

    /// Where to search: the place of the picture that promises most.
    fn search(&self, around: [f64; 4], since: u64) -> Gaze {
        let reach = 2.0 + self.settings.roam * since as f64;
        let worth = |cell: usize| {
            let gaze = Self::gaze(cell, around);
            let age = (self.frame - self.covered[cell]) as f64;
            age.ln() - gaze.u.abs().max(gaze.v.abs()) / reach
        };
        let better = |best: (usize, f64), cell: usize| {
            let worth = worth(cell);
            if worth > best.1 { (cell, worth) } else { best }
        };
        Self::gaze((0..self.covered.len()).fold((0, f64::NEG_INFINITY), better).0, around)
    }
}

impl Policy for Forager {
    fn plan(&mut self, context: &Context, plan: &mut Plan, _: &mut Rng) {
        self.frame += 1;
        self.lost_at = if context.lost { self.lost_at.or(Some(self.frame)) } else { None };
        let Contextual { zoom, calm, widest, covers, roam, every, .. } = self.settings;
        let turn = self.gazes[(self.frame % self.gazes.len() as u64) as usize];
        let since = self.lost_at.map_or(0, |at| self.frame - at + 1);
        let away = since > 0 && every > 0 && since.is_multiple_of(every);
        let gaze = if away { self.search(context.around, since) } else { turn };
        let unsure = zoom * (context.spread - calm).max(0.0) + roam * since as f64 / covers;
        let wider = if away { 1.0 } else { (1.0 + unsure).min(widest) };
        plan.only(gaze);
        plan.widen(wider);
        for cell in 0..self.covered.len() {
            let at = Self::gaze(cell, context.around);
            if (at.u - gaze.u).abs().max((at.v - gaze.v).abs()) <= covers * wider {
                self.covered[cell] = self.frame;
            }
        }
    }
    fn learn(&mut self, _: &Plan, _: &[f64]) {}
    fn save(&self) -> Value {
        json!({ "frame": self.frame, "lost_at": self.lost_at, "covered": self.covered })
    }
    fn load(&mut self, saved: &Value) -> Result<()> {
        #[derive(Deserialize)]
        struct Saved {
            frame: u64,
            lost_at: Option<u64>,
            covered: Vec<u64>,
        }
        let fits = |s: &Saved| {
            let past = |look: &u64| *look <= s.frame;
            s.covered.len() == SIDE * SIDE && s.covered.iter().chain(&s.lost_at).all(past) && s.frame < 1 << 48
        };
        let Saved { frame, lost_at, covered } =
            Saved::deserialize(saved).ok().filter(fits).ok_or_else(|| misfit("when each place was covered", saved))?;
        (self.frame, self.lost_at, self.covered) = (frame, lost_at, covered);
        Ok(())
    }
    fn reset(&mut self) {
        (self.frame, self.lost_at) = (0, None);
        self.covered.fill(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use foveate_base::rng::Streams;

    fn forager(settings: Contextual) -> Forager {
        Forager::new(settings).expect("settings in range")
    }

    fn plan(policy: &mut Forager, context: &Context) -> (Gaze, f64) {
        let mut plan = Plan::new();
        policy.plan(context, &mut plan, &mut Streams::new(1, 0).rng(0));
        (plan.chosen(), plan.wider())
    }

    #[test]
    fn foragers_keep_the_law() {
        conformance::policy(&|| Box::new(forager(Contextual::default())));
        conformance::policy(&|| {
            Box::new(forager(Contextual { every: 2, grid: Grid { n: 1, reach: 0.0 }, ..Contextual::default() }))
        });
        for (settings, word) in [
            (Contextual { zoom: -1.0, ..Contextual::default() }, "zoom"),
            (Contextual { widest: 0.5, ..Contextual::default() }, "widest"),
            (Contextual { grid: Grid { n: 0, reach: 0.1 }, ..Contextual::default() }, "grid"),
        ] {
            assert!(Forager::new(settings).expect_err(word).to_string().contains(word));
        }
    }

    #[test]
    fn it_looks_wider_the_less_it_knows() {
        let mut policy =
            forager(Contextual { zoom: 2.0, calm: 0.3, widest: 3.0, roam: 0.5, covers: 2.0, ..Contextual::default() });
        let sure = Context { spread: 0.2, ..Context::default() };
        assert_eq!(plan(&mut policy, &sure).1, 1.0);
        assert!((plan(&mut policy, &Context { spread: 0.5, ..sure }).1 - 1.4).abs() < 1e-12);
        let lost = Context { lost: true, ..sure };
        let wider: Vec<f64> = (0..12).map(|_| plan(&mut policy, &lost).1).collect();
        assert!(wider[0] == 1.25 && wider[1] == 1.5 && wider[11] == 3.0, "{wider:?}");
        assert_eq!(plan(&mut policy, &sure).1, 1.0, "found again");
    }

    /// A picture of 40 × 40 template units, looks that cover 4 × 4: saccades go to places not covered lately, near ones first.
    #[test]
    fn a_lost_target_is_looked_for_where_it_was_not_looked_for_longest() {
        let grid = Grid { n: 1, reach: 0.0 };
        let mut policy = forager(Contextual { grid, every: 1, roam: 0.2, ..Contextual::default() });
        let lost = Context { lost: true, around: [-20.0, -20.0, 20.0, 20.0], ..Context::default() };
        plan(&mut policy, &Context { lost: false, ..lost });
        let far = |g: &Gaze| g.u.abs().max(g.v.abs());
        let gazes: Vec<Gaze> = (0..400).map(|_| plan(&mut policy, &lost).0).collect();
        assert!(far(&gazes[0]) < 5.0 && gazes.iter().any(|g| far(g) > 15.0), "from near to far");
        let near = |a: &Gaze, b: &Gaze| (a.u - b.u).abs().max((a.v - b.v).abs()) <= 2.0;
        assert!(gazes[10..].windows(4).all(|w| w[1..].iter().all(|g| !near(&w[0], g))), "never where it has just been");
    }
}
