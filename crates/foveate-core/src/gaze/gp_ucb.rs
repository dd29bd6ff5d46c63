//! Bayesian optimisation of the gaze (section 4.4): partial information over a continuous square of gazes.
//!
//! The reward of looking at (u, v) is a Gaussian process; its hyper-parameters are MAP estimates; the next gaze maximises m(a) + √βₜ s(a)
//! (GP-UCB), βₜ = 2 ln(t³π²/3δ), found by DIRECT. The cost of a frame is constant: the process uses the newest `window` rewards only, and
//! so also adapts to changes.
//!
//! Deviation: rewards are standardised over the window ([`Bayes::standardise`]). √βₜ is 4 to 7 in units of the process' deviation; as
//! printed, on rewards of 0.01, the policy never exploits.
//! Deviation: the first gazes are drawn near the centre ([`Bayes::start`]), not over the whole square.
//! Beyond the paper (its future work): [`Bayes::guard`], [`Bayes::caution`], [`Bayes::saliency`] and [`Bayes::rehearsal`].

use super::bayes::{Bayes, EVALUATIONS, FLOOR};
use super::prior::Prior;
use super::{Context, Expectation, Plan, Policy, PolicySnapshot, Surface};
use crate::geometry::Gaze;
use crate::saved_state::{SavedState, Valid, Validate};
use foveate_base::Result;
use foveate_base::rng::Rng;
use foveate_gp::direct::{Direct, Form};
use foveate_gp::{Gp, Kernel, Priors, Saved};
use rand::RngExt;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::f64::consts::PI;

/// The GP-UCB policy.
#[derive(Debug)]
pub struct GpUcb {
    settings: Bayes,
    priors: Priors<2>,
    process: Gp<2>,
    direct: Direct<2>,
    /// Number of rewards received; t of βₜ.
    seen: u64,
    /// The raw rewards of the window, oldest first, and their gazes.
    rewards: Vec<f64>,
    fixations: Vec<Gaze>,
    /// Whether the last reward was poor, by `guard`.
    poor: bool,
    prior: Prior,
    means: Vec<f64>,
    variances: Vec<f64>,
}

impl GpUcb {
    /// Creates the policy.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(settings: Bayes) -> Result<Self> {
        settings.check()?;
        let window = settings.window;
        Ok(Self {
            priors: settings.priors()?,
            process: Gp::new(Kernel::SquaredExponential, settings.first(), window),
            direct: Direct::new(Form::LocallyBiased),
            seen: 0,
            rewards: Vec::with_capacity(window),
            fixations: Vec::with_capacity(window),
            poor: false,
            prior: Prior::default(),
            means: Vec::with_capacity(EVALUATIONS),
            variances: Vec::with_capacity(EVALUATIONS),
            settings,
        })
    }
    /// Returns √βₜ, reduced by the guard and by the context.
    fn exploration(&self, context: &Context) -> f64 {
        if self.poor {
            return 0.0;
        }
        let t = self.seen.max(1) as f64;
        let beta = 2.0 * (t.powi(3) * PI * PI / (3.0 * self.settings.delta)).ln();
        let held = 1.0 - self.settings.caution * context.frame_deficit.max(context.deficit).min(1.0);
        self.settings.exploration * held * beta.max(0.0).sqrt()
    }
    /// Returns mean and standard deviation of the window's rewards.
    fn moments(&self) -> (f64, f64) {
        if self.rewards.is_empty() {
            return (0.0, 1.0);
        }
        let n = self.rewards.len() as f64;
        let mean = self.rewards.iter().sum::<f64>() / n;
        let sd = (self.rewards.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / n).sqrt();
        (mean, sd.max(FLOOR))
    }
    /// Returns the mean and the divisor that standardise the window's rewards.
    fn units(&self) -> (f64, f64) {
        if self.settings.standardise { self.moments() } else { (0.0, 1.0) }
    }
    /// Returns the prior mean of the process at a gaze.
    fn expected(&self, u: f64, v: f64) -> f64 {
        self.settings.prior_weight() * self.prior.at(self.settings.reach, u, v)
    }
    /// Computes the targets of the process from the window's rewards.
    fn standardise(&mut self) {
        let (mean, sd) = self.units();
        let Self { settings, process, rewards, fixations, prior, means, .. } = self;
        let (weight, reach) = (settings.prior_weight(), settings.reach);
        means.clear();
        means.extend(rewards.iter().zip(fixations).map(|(r, g)| (r - mean) / sd - weight * prior.at(reach, g.u, g.v)));
        process.set_values(means);
    }
}

/// The saved state of [`GpUcb`].
#[derive(Serialize, Deserialize)]
struct Memory<'a> {
    seen: u64,
    poor: bool,
    rewards: Cow<'a, [f64]>,
    process: Saved<2>,
    prior: Cow<'a, Prior>,
}

impl Validate<Bayes> for Memory<'_> {
    fn validate(&self, settings: &Bayes) -> Valid {
        let (n, points) = (self.rewards.len(), &self.process.points);
        let inside = |x: &f64| x.abs() <= settings.reach;
        let frames = (n as u64..=1 << 48).contains(&self.seen);
        match frames && points.len() == n && points.as_flattened().iter().all(inside) {
            true => self.prior.validate(&()),
            false => Err(format!("it is not what gp-ucb learned from {} rewards at most", settings.window)),
        }
    }
}

impl Policy for GpUcb {
    fn plan(&mut self, context: &Context, plan: &mut Plan, rng: &mut Rng) {
        let s = &self.settings;
        if self.seen < s.warm_up as u64 {
            if let Some(gaze) = self.prior.draw(s.reach, s.prior(), rng) {
                return plan.only(gaze);
            }
            let [u, v] = std::array::from_fn(|_| s.start * (2.0 * rng.random::<f64>() - 1.0));
            return plan.only(Gaze { u, v, arm: None });
        }
        let (root_beta, reach) = (self.exploration(context), s.reach);
        let weight = s.prior_weight();
        let Self { process, direct, prior, means, variances, .. } = self;
        let ([u, v], _) = direct.maximise_batches([-reach; 2], [reach; 2], EVALUATIONS, |gazes, values| {
            means.resize(gazes.len(), 0.0);
            variances.resize(gazes.len(), 0.0);
            process.predict_many(gazes, means, variances);
            for (((value, mean), variance), [u, v]) in values.iter_mut().zip(&*means).zip(&*variances).zip(gazes) {
                *value = mean + weight * prior.at(reach, *u, *v) + root_beta * variance.sqrt();
            }
        });
        plan.only(Gaze { u, v, arm: None });
    }
    fn learn(&mut self, plan: &Plan, rewards: &[f64]) {
        let (gaze, reward) = (plan.chosen(), rewards[plan.chosen_index()]);
        let (mean, sd) = self.moments();
        self.poor = self.settings.guard.is_some_and(|guard| (reward - mean) / sd < -guard);
        if self.rewards.len() == self.settings.window {
            self.rewards.remove(0);
            self.fixations.remove(0);
        }
        self.rewards.push(reward);
        self.fixations.push(gaze);
        self.seen += 1;
        self.process.push([gaze.u, gaze.v], 0.0);
        self.standardise();
        let warm = self.seen >= self.settings.warm_up as u64;
        if warm && (self.seen - self.settings.warm_up as u64).is_multiple_of(self.settings.refit as u64) {
            self.process.fit(&self.priors, MOST_ITERATIONS);
        }
    }
    fn snapshot(&self) -> PolicySnapshot<'_> {
        PolicySnapshot::Surface(self)
    }
    fn save(&self) -> SavedState {
        let (rewards, prior) = (Cow::Borrowed(&self.rewards[..]), Cow::Borrowed(&self.prior));
        SavedState::new(&Memory { seen: self.seen, poor: self.poor, rewards, process: self.process.save(), prior })
    }
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        let Memory { seen, poor, rewards, process, prior } = saved.state("policy", &self.settings)?;
        self.process.restore(&process)?;
        (self.seen, self.poor, self.prior) = (seen, poor, prior.into_owned());
        self.fixations.clear();
        self.fixations.extend(process.points.iter().map(|&[u, v]| Gaze { u, v, arm: None }));
        self.rewards.clear();
        self.rewards.extend_from_slice(&rewards);
        Ok(())
    }
    fn reset(&mut self) {
        self.process.clear();
        self.process.set_hyper(self.settings.first());
        self.rewards.clear();
        self.fixations.clear();
        (self.seen, self.poor, self.prior) = (0, false, Prior::default());
    }
    fn expectation(&self) -> Option<Expectation> {
        self.settings.expectation()
    }
    fn init_prior(&mut self, worth: &mut dyn FnMut(Gaze) -> f64) {
        self.prior = Prior::of(self.settings.reach, worth);
    }
}

/// Quasi-Newton steps of one fit, which starts at the last result.
const MOST_ITERATIONS: usize = 15;

impl Surface for GpUcb {
    fn reach(&self) -> f64 {
        self.settings.reach
    }
    fn at(&self, u: f64, v: f64) -> (f64, f64) {
        let ((mean, variance), (centre, unit)) = (self.process.predict(&[u, v]), self.units());
        (centre + unit * (mean + self.expected(u, v)), unit * variance.sqrt())
    }
    fn fixations(&self) -> &[Gaze] {
        &self.fixations
    }
    fn best(&self) -> Option<Gaze> {
        let mut direct = Direct::new(Form::LocallyBiased);
        let reach = self.settings.reach;
        let mean = |gaze: &[f64; 2]| self.process.predict(gaze).0 + self.expected(gaze[0], gaze[1]);
        (self.seen >= self.settings.warm_up as u64).then(|| {
            let ([u, v], _) = direct.maximise([-reach; 2], [reach; 2], 300, mean);
            Gaze { u, v, arm: None }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use foveate_base::rng::{Purpose, Streams};

    fn policy(settings: Bayes) -> GpUcb {
        GpUcb::new(settings).expect("settings in range")
    }

    #[test]
    fn gp_ucb_conforms() {
        conformance::policy(&|| Box::new(policy(Bayes::default())));
        let printed = Bayes { standardise: false, refit: 1, start: 0.5, window: 20, ..Bayes::default() };
        conformance::policy(&|| Box::new(policy(printed.clone())));
        let careful = Bayes { guard: Some(0.7), caution: 1.0, ..Bayes::default() };
        conformance::policy(&|| Box::new(policy(careful.clone())));
        let salient = Bayes { saliency: 1.0, ..Bayes::default() };
        conformance::policy(&|| Box::new(policy(salient.clone())));
    }

    #[test]
    fn without_saliency_the_first_gaze_is_the_first_two_numbers_drawn() {
        let (stream, mut plan) = (|| Streams::new(3, 0).at(0, Purpose::Look).rng(0), Plan::new());
        policy(Bayes::default()).plan(&Context::default(), &mut plan, &mut stream());
        let mut rng = stream();
        let [u, v] = std::array::from_fn(|_| Bayes::default().start * (2.0 * rng.random::<f64>() - 1.0));
        assert_eq!((plan.chosen().u, plan.chosen().v), (u, v));
    }

    /// A noisy hill: after 100 looks the best gaze lies on it, and so do most late looks. 10 seeds, one may miss.
    #[test]
    fn it_finds_the_hill_and_stays_there() {
        let hill = |u: f64, v: f64| 0.8 * (-((u - 0.3).powi(2) + (v + 0.2).powi(2)) / 0.08).exp();
        let mut found = 0;
        for seed in 0..10 {
            let (mut gp, mut plan) = (policy(Bayes::default()), Plan::new());
            let mut noise = Streams::new(seed, 1).at(0, Purpose::Look).rng(0);
            let mut late = 0;
            for t in 0..100 {
                gp.plan(&Context::default(), &mut plan, &mut Streams::new(seed, 0).at(t, Purpose::Look).rng(0));
                let Gaze { u, v, .. } = plan.chosen();
                gp.learn(&plan, &[(hill(u, v) + 0.1 * noise.random::<f64>()).min(1.0)]);
                late += usize::from(t >= 50 && hill(u, v) > 0.4);
            }
            let Gaze { u, v, .. } = gp.best().expect("100 rewards were seen");
            found += usize::from(hill(u, v) > 0.7 && late > 25);
        }
        assert!(found >= 9, "{found} of 10 found the hill");
    }

    #[test]
    fn guard_and_caution_reduce_exploration() {
        // The guard uses the deviation of the window, with and without standardisation.
        for standardise in [true, false] {
            guarded(policy(Bayes { guard: Some(1.0), caution: 0.5, standardise, ..Bayes::default() }));
        }
    }

    fn guarded(mut gp: GpUcb) {
        let mut plan = Plan::new();
        let mut rng = Streams::new(3, 0).at(0, Purpose::Look).rng(0);
        let doubtful = Context { deficit: 1.0, ..Context::default() };
        let mut look = |gp: &mut GpUcb, reward: f64| {
            gp.plan(&Context::default(), &mut plan, &mut rng);
            gp.learn(&plan, &[reward]);
        };
        (0..20).for_each(|t| look(&mut gp, 0.5 + 0.01 * f64::from(t % 3)));
        let (sure, unsure) = (gp.exploration(&Context::default()), gp.exploration(&doubtful));
        let beta = 2.0 * (20f64.powi(3) * PI * PI / 0.003).ln();
        assert!((sure - beta.sqrt()).abs() < 1e-12 && (unsure - 0.5 * sure).abs() < 1e-12);
        look(&mut gp, 0.1);
        assert_eq!(gp.exploration(&Context::default()), 0.0, "after a poor look the best one is taken");
        look(&mut gp, 0.5);
        assert!(gp.exploration(&Context::default()) > 0.0);
    }
}
