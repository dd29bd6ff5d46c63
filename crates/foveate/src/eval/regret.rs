//! Regret: what looking elsewhere would have earned.
//!
//! A [`Ledger`] holds the reward of the policy's own gaze in each frame, and those of some fixed gazes in the same frames
//! ([`crate::gaze::Shadow`] has them scored). The best fixed gaze is known in hindsight only: it is the one with the
//! largest sum over all frames, argmaxₖ Σₜ rₜ(k). Regret is its reward less the policy's, frame by frame and summed
//! (section 4.2 speaks of it; theorem 2.2 of Cesa-Bianchi & Lugosi 2006 bounds it for Hedge).
//!
//! All gazes are scored under the belief that the policy's looks have led to. What the track would have been had another
//! gaze been used all the time is another question, which a run of its own with that gaze answers.

use std::fmt::Write as _;

use kuva::plot::LinePlot;
use kuva::prelude::{Figure, Layout, LegendPosition, LineStyle, Plot, SvgBackend, TickFormat};

use crate::geometry::Gaze;
use crate::step::Step;
use crate::{Error, Result};

/// Frames over which rewards are averaged in plots.
const WINDOW: usize = 20;

/// Rewards of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ledger {
    gazes: Vec<Gaze>,
    frames: Vec<usize>,
    chosen: Vec<Gaze>,
    earned: Vec<f64>,
    /// Frame after frame, a reward a gaze.
    offered: Vec<f64>,
}

/// Regret against the best fixed gaze of all frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Regret {
    /// Index of the best fixed gaze; the first of several.
    pub best: usize,
    /// Its reward less the policy's in each frame, −1 to 1.
    pub instantaneous: Vec<f64>,
    /// The same summed up to and with each frame.
    pub cumulative: Vec<f64>,
    /// The same for a policy that looks at one of the fixed gazes at random, in expectation.
    pub at_random: Vec<f64>,
    /// In each frame: the largest sum of any one gaze until then less the policy's. The last one is the last of
    /// `cumulative`.
    pub until_then: Vec<f64>,
}

impl Ledger {
    /// Against these gazes.
    pub fn new(gazes: Vec<Gaze>) -> Self {
        Self { gazes, ..Self::default() }
    }
    /// The fixed gazes.
    pub fn gazes(&self) -> &[Gaze] {
        &self.gazes
    }
    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.earned.len()
    }
    /// The policy's reward in each frame.
    pub fn earned(&self) -> &[f64] {
        &self.earned
    }
    /// The rewards of the fixed gazes in frame `t` of the ledger.
    pub fn offered(&self, t: usize) -> &[f64] {
        &self.offered[t * self.gazes.len()..][..self.gazes.len()]
    }

    /// Enters a frame: of the policy's looks the one it chose itself counts.
    ///
    /// # Errors
    /// One of the gazes was not scored.
    pub fn enter(&mut self, step: &Step<'_>) -> Result<()> {
        let offered = self.offered.len();
        for gaze in &self.gazes {
            let Some(reward) = step.reward_of(*gaze) else {
                self.offered.truncate(offered);
                return Err(Error::Invalid(format!(
                    "regret needs the reward of gaze ({}, {}) in every frame, and frame {} has none; have these gazes \
                     scored with Blueprint::shadowing",
                    gaze.u,
                    gaze.v,
                    step.frame.index + 1
                )));
            };
            self.offered.push(reward);
        }
        self.frames.push(step.frame.index + 1);
        self.chosen.push(step.plan.chosen());
        self.earned.push(step.rewards[step.plan.chosen_index()]);
        Ok(())
    }

    /// The same by plain numbers: the frame counted from 1, the policy's gaze and reward, a reward a fixed gaze.
    pub fn push(&mut self, frame: usize, chosen: Gaze, earned: f64, offered: &[f64]) {
        assert_eq!(offered.len(), self.gazes.len(), "one reward for each gaze");
        self.frames.push(frame);
        self.chosen.push(chosen);
        self.earned.push(earned);
        self.offered.extend_from_slice(offered);
    }

    /// The regret; `None` where there is no frame or no gaze.
    pub fn regret(&self) -> Option<Regret> {
        if self.gazes.is_empty() || self.earned.is_empty() {
            return None;
        }
        let mut sums = vec![0.0; self.gazes.len()];
        let (mut own, mut until_then) = (0.0, Vec::with_capacity(self.frames()));
        for (t, earned) in self.earned.iter().enumerate() {
            sums.iter_mut().zip(self.offered(t)).for_each(|(sum, r)| *sum += r);
            own += earned;
            until_then.push(sums.iter().copied().fold(f64::NEG_INFINITY, f64::max) - own);
        }
        let greatest = sums.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let best = sums.iter().position(|sum| *sum >= greatest).unwrap_or(0);
        let k = self.gazes.len() as f64;
        let behind = |t: usize, other: f64| self.offered(t)[best] - other;
        let instantaneous: Vec<f64> = (0..self.frames()).map(|t| behind(t, self.earned[t])).collect();
        let random = (0..self.frames()).map(|t| behind(t, self.offered(t).iter().sum::<f64>() / k));
        Some(Regret {
            best,
            cumulative: summed(instantaneous.iter().copied()),
            at_random: summed(random),
            instantaneous,
            until_then,
        })
    }

    /// Comma separated, a line a frame, the names first: frame, the chosen gaze and its reward, that of the best fixed
    /// gaze, regret, its sum, the sum against the best gaze until then, and the reward of each fixed gaze, `reward_U_V`.
    /// Numbers read back bit for bit.
    pub fn csv(&self) -> String {
        let mut text = "frame,gaze_u,gaze_v,reward,best_reward,regret,total_regret,total_regret_until_then".to_owned();
        for gaze in &self.gazes {
            let _ = write!(text, ",reward_{}_{}", gaze.u, gaze.v);
        }
        text.push('\n');
        let Some(regret) = self.regret() else { return text };
        for t in 0..self.frames() {
            let Gaze { u, v, .. } = self.chosen[t];
            let _ = write!(text, "{},{u},{v},{},{}", self.frames[t], self.earned[t], self.offered(t)[regret.best]);
            let more = [regret.instantaneous[t], regret.cumulative[t], regret.until_then[t]];
            for value in more.iter().chain(self.offered(t)) {
                let _ = write!(text, ",{value}");
            }
            text.push('\n');
        }
        text
    }

    /// Rewards and summed regret over the frames, as SVG text.
    pub fn plot(&self) -> String {
        let regret = self.regret().unwrap_or_default();
        let k = self.gazes.len().max(1) as f64;
        let of = |reward: &dyn Fn(usize) -> f64| smooth(&(0..self.frames()).map(reward).collect::<Vec<_>>());
        let best = self.gazes.get(regret.best).copied().unwrap_or(Gaze::CENTRE);
        let rewards = [
            (
                format!("best fixed, ({:.2}, {:.2})", best.u, best.v),
                of(&|t| self.offered(t)[regret.best]),
                LineStyle::Dashed,
            ),
            ("the policy".to_owned(), of(&|t| self.earned[t]), LineStyle::Solid),
            ("mean of all gazes".to_owned(), of(&|t| self.offered(t).iter().sum::<f64>() / k), LineStyle::Dotted),
        ];
        let sums = [
            ("the policy".to_owned(), regret.cumulative, LineStyle::Solid),
            ("a gaze at random".to_owned(), regret.at_random, LineStyle::Dotted),
        ];
        let colours = ["#D55E00", "#0072B2", "#000000"];
        let panel = |lines: &[(String, Vec<f64>, LineStyle)], colours: &[&str], title: &str, y_label: &str| {
            let line = |((name, values, style), colour): (&(String, Vec<f64>, LineStyle), &&str)| -> Plot {
                let points = self.frames.iter().zip(values).map(|(t, v)| (*t as f64, *v)).collect::<Vec<_>>();
                let line = LinePlot::new().with_data(points).with_color(*colour).with_stroke_width(2.0);
                line.with_line_style(style.clone()).with_legend(name.clone()).into()
            };
            let plots: Vec<Plot> = lines.iter().zip(colours).map(line).collect();
            let layout = Layout::auto_from_plots(&plots)
                .with_title(title)
                .with_x_label("frame")
                .with_y_label(y_label)
                .with_x_tick_format(TickFormat::Integer)
                .with_legend_position(LegendPosition::OutsideRightTop)
                .with_legend_box(true);
            (plots, layout)
        };
        let title = format!("Reward, mean of the last {WINDOW} frames");
        let (left, left_layout) = panel(&rewards, &colours, &title, "reward of a look");
        let (right, right_layout) =
            panel(&sums, &colours[1..], "Regret against the best fixed gaze in hindsight", "summed regret");
        let figure = Figure::new(1, 2)
            .with_plots(vec![left, right])
            .with_layouts(vec![left_layout, right_layout])
            .with_cell_size(640.0, 400.0);
        SvgBackend::default().render_scene(&figure.render())
    }
}

/// Sums up to and with each value.
fn summed(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sum = 0.0;
    values
        .map(|value| {
            sum += value;
            sum
        })
        .collect()
}

/// The mean of each value and those before it, [`WINDOW`] at most.
fn smooth(values: &[f64]) -> Vec<f64> {
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    (0..values.len()).map(|t| mean(&values[(t + 1).saturating_sub(WINDOW)..=t])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaze::{Context, Grid, Hedge, Plan, Policy};
    use crate::rng::{Purpose, Streams};
    use rand::RngExt;

    #[test]
    fn regret_is_what_brute_force_says() {
        let gazes = Grid::default().gazes();
        let mut rng = Streams::new(4, 0).rng(0);
        let mut ledger = Ledger::new(gazes.clone());
        assert!(ledger.regret().is_none());
        let (mut rewards, mut choices) = (vec![], vec![]);
        for t in 0..60 {
            let offered: Vec<f64> = (0..9).map(|_| rng.random()).collect();
            let chosen = rng.random_range(0..9);
            ledger.push(t + 2, gazes[chosen], offered[chosen], &offered);
            rewards.push(offered);
            choices.push(chosen);
        }
        let regret = ledger.regret().expect("sixty frames");
        let total = |k: usize, until: usize| rewards[..until].iter().map(|r| r[k]).sum::<f64>();
        let own = |until: usize| (0..until).map(|t| rewards[t][choices[t]]).sum::<f64>();
        assert!((0..9).all(|k| total(k, 60) <= total(regret.best, 60)));
        for t in 0..60 {
            let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "frame {t}: {a} {b}");
            near(regret.instantaneous[t], rewards[t][regret.best] - rewards[t][choices[t]]);
            near(regret.cumulative[t], total(regret.best, t + 1) - own(t + 1));
            near(regret.until_then[t], (0..9).map(|k| total(k, t + 1)).fold(0.0, f64::max) - own(t + 1));
            near(regret.at_random[t], total(regret.best, t + 1) - (0..9).map(|k| total(k, t + 1)).sum::<f64>() / 9.0);
        }
        assert!((regret.cumulative[59] - regret.until_then[59]).abs() < 1e-12);
        let text = ledger.csv();
        let last: Vec<f64> =
            text.lines().last().expect("a line").split(',').map(|v| v.parse().expect("a number")).collect();
        assert_eq!((text.lines().count(), last.len(), last[0]), (61, 8 + 9, 61.0));
        assert_eq!(last[6], regret.cumulative[59], "numbers read back");
        assert_eq!(last[8..], rewards[59][..]);
        let svg = ledger.plot();
        assert!(svg.contains("summed regret") && svg.contains("frame"));
    }

    /// Rewards of 0 and 1 that favour one gaze by turns of 50 frames; 20 runs of 1,000 frames, seeds 0 to 19. The bound
    /// holds for the expectation; a run's draws spread by less than √T / 2 = 16: 4 such of a mean over 20 are 14.
    #[test]
    fn hedge_keeps_its_bound_here_too() {
        let (frames, gazes) = (1000, Grid::default().gazes());
        let mut sum = 0.0;
        for seed in 0..20 {
            let mut rng = Streams::new(seed, 0).at(0, Purpose::Look).rng(0);
            let mut hedge = Hedge::new(gazes.clone(), Hedge::gamma_for(9, frames)).expect("nine gazes");
            let (mut ledger, mut plan) = (Ledger::new(gazes.clone()), Plan::new());
            for t in 0..frames {
                hedge.plan(&Context::default(), &mut plan, &mut rng);
                let rewards: Vec<f64> = (0..9).map(|k| if k == (t / 50) % 9 { 1.0 } else { 0.0 }).collect();
                ledger.push(t + 1, plan.chosen(), rewards[plan.chosen_index()], &rewards);
                hedge.learn(&plan, &rewards);
            }
            sum += ledger.regret().expect("frames").cumulative[frames - 1];
        }
        let bound = (frames as f64 * 9.0f64.ln() / 2.0).sqrt();
        assert!(sum / 20.0 < bound + 14.0, "{} is above {bound}", sum / 20.0);
    }
}
