//! Algorithm 1 of Denil et al. (2012): particle filtering with gaze control.

use serde::{Deserialize, Serialize};

use crate::control::{
    Around, Aspect, Belief, Confidence, Guide, Promise, Proposal, Resampling, Reward, Search, Shown, Sighting,
    Vigilance, normalize, rivals,
};
use crate::gaze::{Context, Plan, Policy};
use crate::geometry::{BBox, Extent, State};
use crate::identity::{Appearance, Percept};
use crate::recognition::{Recognition, Recognized};
use crate::rng::Purpose::{self, Look, Predict, Recognize, Select, Start};
use crate::rng::Streams;
use crate::scene::{Flow, Frame, Scene};
use crate::start::StartSpread;
use crate::step::Step;
use crate::{Error, Result};

mod company;
mod looks;
mod saved;

/// The replaceable parts of a tracker, one for each box of Algorithm 1.
pub struct Parts {
    /// q(xₜ | xₜ₋₁, scene).
    pub proposal: Box<dyn Proposal>,
    /// How states move with the picture before they are predicted.
    pub guide: Option<Guide>,
    /// p(detections | xₜ): what a detector says of where the target is.
    pub sighting: Option<Sighting>,
    /// πₜ: where to look.
    pub policy: Box<dyn Policy>,
    /// p(hₜ | xₜ, aₜ).
    pub appearance: Box<dyn Appearance>,
    /// How the shape of the target's box follows it; `None` for never.
    pub aspect: Option<Aspect>,
    /// rₜ, from the belief.
    pub reward: Box<dyn Reward>,
    /// The selection step.
    pub resampling: Resampling,
    /// Compares the evidence with what was promised.
    pub vigilance: Vigilance,
    /// Says how probably the target is lost.
    pub confidence: Confidence,
    /// Where what the target could be mistaken for is looked for; `None` for among the particles only.
    pub rivals: Option<Around>,
    /// Looks for it then.
    pub search: Option<Search>,
    /// p(x₀): how far from the given box the first particles are.
    pub start: StartSpread,
    /// p(cₜ | all looks at the estimate): what the target is called. It never changes the track, unless it has an alarm.
    pub recognizer: Option<Recognition>,
}

/// One target being followed.
pub struct Tracker {
    parts: Parts,
    streams: Streams,
    target: Option<Target>,
    frame: u64,
    particles: Vec<State>,
    log_carried: Vec<f64>,
    context: Context,
    visible: f64,
    work: Work,
}

/// What was given to follow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Target {
    state: State,
    /// Its shape, which may follow it; its area is that of frame 1.
    extent: Extent,
    /// Pixels per template unit at scale 1.
    unit: f64,
}

/// Buffers of one step, grown once.
#[derive(Default)]
pub(crate) struct Work {
    pub predicted: Vec<State>,
    pub log_prior: Vec<f64>,
    pub plan: Plan,
    pub log_likelihood: Vec<f64>,
    pub log_posterior: Vec<f64>,
    pub weights: Vec<f64>,
    pub log_evidence: Vec<f64>,
    pub rewards: Vec<f64>,
    pub recorded: Vec<f64>,
    pub ancestors: Vec<usize>,
    pub percept: Percept,
    pub search: Vec<f64>,
    pub drawn: Vec<usize>,
    pub fresh: Vec<State>,
    pub rivals: Vec<State>,
}

impl Tracker {
    /// A tracker of `n_particles`, with its own streams of randomness named by `seed` and `target`.
    pub fn new(parts: Parts, n_particles: usize, seed: u64, target: u64) -> Result<Self> {
        if n_particles == 0 {
            return Err(Error::Config("particles must be at least 1, got 0; 100 to 1000 are usual".into()));
        }
        Ok(Self {
            parts,
            streams: Streams::new(seed, target),
            target: None,
            frame: 0,
            particles: vec![State::default(); n_particles],
            log_carried: vec![-(n_particles as f64).ln(); n_particles],
            context: Context::default(),
            visible: 1.0,
            work: Work::default(),
        })
    }

    /// Starts, or starts again, on the target in `bbox` of this frame: imprints the template and draws x₀⁽ⁱ⁾ ~ p(x₀).
    ///
    /// Fails where the box has no area, is not finite, or does not touch the picture.
    pub fn start(&mut self, frame: &Frame, bbox: BBox) -> Result<()> {
        crate::start::check(&frame.image, &bbox)?;
        let (state, extent) = (State::of(&bbox), Extent::of(&bbox));
        let streams = self.streams.at(self.frame, Start);
        self.target = Some(Target { state, extent, unit: extent.mean() });
        self.parts.appearance.imprint(&frame.image, &state, extent, self.streams);
        self.parts.aspect.iter_mut().for_each(Aspect::reset);
        self.parts.policy.reset();
        self.parts.recognizer.iter_mut().for_each(Recognition::reset);
        self.context = Context::default();
        self.parts.vigilance.reset();
        self.parts.confidence.reset();
        self.parts.proposal.reset();
        self.parts.proposal.size(extent.mean());
        self.parts.start.draw(&state, extent, &mut self.particles, streams);
        self.log_carried.fill(-(self.particles.len() as f64).ln());
        Ok(())
    }

    /// Tells how the picture moved since the last frame, before [`Tracker::step`] with the one it moved to; without
    /// `Parts::guide` nothing happens.
    pub fn guide(&mut self, flow: &Flow) {
        if let Some(guide) = &self.parts.guide {
            guide.shift(flow, &mut self.particles);
        }
    }

    /// One frame of Algorithm 1. Panics if `start` was never called.
    pub fn step<'a>(&'a mut self, scene: Scene<'a>) -> Step<'a> {
        let Self { parts, streams, target, particles, log_carried, context, frame, visible, work: w } = self;
        let target = target.as_mut().expect("start is called before the first step");
        let (image, n) = (&scene.frame.image, particles.len());
        *frame += 1;

        // Predict. x̃ ~ q(x | x'), and log p/q, which the weights owe for not sampling from p.
        w.predicted.resize(n, State::default());
        w.log_prior.resize(n, 0.0);
        parts.proposal.propose(scene, particles, &mut w.predicted, &mut w.log_prior, streams.at(*frame, Predict));
        add(&mut w.log_prior, log_carried);

        // Weigh also by what was seen of it, where detections are taken to be the target's.
        if let Some(sighting) = &parts.sighting {
            sighting.weigh(scene.detections, &w.predicted, target.extent, &mut w.log_prior);
        }

        // Choose where to look. Some policies ask about every gaze, some about one.
        parts.policy.plan(context, &mut w.plan, &mut streams.at(*frame, Look).rng(0));
        parts.appearance.see(image, &w.predicted, w.plan.gazes());

        // Deviation: where the paper samples anew for each action, all gazes of a frame weigh the same particles.
        // Weigh and reward: once for each gaze in the plan, all particles at a time.
        w.log_likelihood.resize(w.plan.gazes().len() * n, 0.0);
        w.weights.resize(n, 0.0);
        w.log_evidence.clear();
        w.rewards.clear();
        for (&gaze, log_likelihood) in w.plan.gazes().iter().zip(w.log_likelihood.chunks_exact_mut(n)) {
            parts.appearance.log_likelihood(&w.predicted, gaze, log_likelihood);
            company::shade(log_likelihood, *visible);
            w.log_posterior.clone_from(&w.log_prior);
            add(&mut w.log_posterior, log_likelihood);
            w.log_evidence.push(normalize(&w.log_posterior, &mut w.weights));
            w.rewards.push(parts.reward.reward(&w.predicted, &w.log_prior, log_likelihood));
        }

        // Learn where to look next.
        parts.policy.learn(&w.plan, &w.rewards);

        // Only the gazes the plan uses move the belief; their log-likelihoods add, as much of each as it weighs.
        w.log_posterior.clone_from(&w.log_prior);
        let weights = w.plan.weights().iter();
        for (weight, log_likelihood) in
            weights.zip(w.log_likelihood.chunks_exact(n)).filter(|(weight, _)| **weight > 0.0)
        {
            w.log_posterior.iter_mut().zip(log_likelihood).for_each(|(a, l)| *a += weight * l);
        }
        let mut log_evidence = normalize(&w.log_posterior, &mut w.weights);
        let expected = parts.appearance.expectation();
        let promise = Promise { on: expected.on, off: expected.off };
        let judged = company::can_be_judged(*visible);

        // Look again. A lost target may be anywhere: some particles are drawn from where the picture looks most like it.
        if parts.search.as_ref().is_some_and(|search| search.is_due(context.lost, *frame)) {
            let predicted = || Belief { states: &w.predicted, weights: &w.weights }.mean();
            let seen = parts.confidence.seen().copied().unwrap_or_else(predicted);
            let streams = streams.at(*frame, Purpose::Search);
            if looks::search(parts, (image, &seen, target), (promise, *visible), w, streams) {
                log_evidence = normalize(&w.log_posterior, &mut w.weights);
            }
        }

        let evidence = log_evidence / w.plan.looks();
        let belief = Belief { states: &w.predicted, weights: &w.weights };
        let (estimate, covariance, ess) = (belief.mean(), belief.covariance(), belief.ess());
        let watch = match judged {
            true => parts.vigilance.judge(evidence, &w.log_posterior, promise),
            false => parts.vigilance.watch(),
        };
        let unit = target.unit * estimate.log_scale.exp();
        let spread = spread(&covariance, unit);

        // Recognize: perceive once more, at the estimate.
        parts.appearance.perceive(&estimate, w.plan.chosen(), &mut w.percept);
        let distance = w.percept.distance;
        let alarm = parts.recognizer.as_ref().map_or(0.0, Recognition::alarm);
        let rival = if judged { looks::around(parts, (image, &estimate, target.extent), w) } else { None };
        let shown = Shown { watch, evidence, rival, promise, spread, distance, estimate, unit, alarm };
        let trust = if judged { parts.confidence.judge(&shown) } else { parts.confidence.held() };
        let lost = trust.standing.is_out();
        let doubt = watch.doubt.max(alarm);
        let searched = context.lost;
        *context = Context { ess: ess / n as f64, doubt, surprise: watch.surprise, spread, lost };
        if let Some(recognizer) = &mut parts.recognizer {
            recognizer.look(image, &estimate, target.extent, context, &mut streams.at(*frame, Recognize).rng(0));
        }

        // Adapt: its shape, and what tells the target from what is around it, while there is no doubt that this is it.
        if judged && !lost && !watch.lost {
            looks::reshape(parts, image, &estimate, target);
        }
        if parts.appearance.adapts() && judged && !watch.lost {
            if rival.is_none() {
                rivals(&w.predicted, &w.log_posterior, &estimate, target.extent, &mut w.rivals);
            }
            parts.appearance.adapt(image, &estimate, &w.rivals, watch.surprise);
        }

        // Adapt to how the target moves, where neither the search nor anything but the dynamics made the children.
        if judged && !lost && !searched {
            parts.proposal.learn(particles, &w.predicted, &w.weights);
        }

        // Select. Children of heavy particles start the next frame.
        w.ancestors.resize(n, 0);
        if parts.resampling.is_due(ess, n) {
            parts.resampling.select(&w.weights, &mut w.ancestors, &mut streams.at(*frame, Select).rng(0));
            log_carried.fill(-(n as f64).ln());
        } else {
            w.ancestors.iter_mut().enumerate().for_each(|(i, a)| *a = i);
            log_carried.iter_mut().zip(&w.weights).for_each(|(carried, weight)| *carried = weight.ln());
        }
        for (particle, &ancestor) in particles.iter_mut().zip(&w.ancestors) {
            *particle = w.predicted[ancestor];
        }

        // For the record: what other gazes would have earned. It comes last, so that nothing above depends on it.
        w.recorded.clear();
        if !w.plan.recorded().is_empty() {
            parts.appearance.see(image, &w.predicted, w.plan.recorded());
            for &gaze in w.plan.recorded() {
                parts.appearance.log_likelihood(&w.predicted, gaze, &mut w.log_posterior);
                w.recorded.push(parts.reward.reward(&w.predicted, &w.log_prior, &w.log_posterior));
            }
        }

        let recognized = parts.recognizer.as_ref().map_or(Recognized::default(), Recognition::recognized);
        let trust = (watch, trust, parts.confidence.blur);
        Step::of(scene, w, target.extent, estimate, covariance, ess, log_evidence, trust, &*parts.policy, recognized)
    }

    /// Whether there is a target: `start` was called, or the state of a started tracker was loaded.
    pub fn is_started(&self) -> bool {
        self.target.is_some()
    }

    /// The box of a state, at this target's size. `None` before `start`.
    pub fn bbox(&self, state: &State) -> Option<BBox> {
        self.target.as_ref().map(|t| state.bbox(t.extent))
    }

    /// The parts, to look at.
    pub fn parts(&self) -> &Parts {
        &self.parts
    }
}

/// Standard deviation of place in template units; a million stands for what is not finite.
fn spread(covariance: &[[f64; 6]; 6], unit: f64) -> f64 {
    ((0.5 * (covariance[0][0] + covariance[1][1])).sqrt() / unit).min(1e6)
}

fn add(to: &mut [f64], what: &[f64]) {
    to.iter_mut().zip(what).for_each(|(a, b)| *a += b);
}
