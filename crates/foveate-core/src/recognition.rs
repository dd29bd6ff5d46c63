//! WHAT is it called? Looks at the estimate, through a recogniser, to classes over time (section 2.2).
//!
//! Recognition stands beside the filter: it looks at the frame anew, at the estimate, through a retina and first layer of
//! its own and where a policy of its own says. It never moves the belief; with an alarm ([`Recognition::with_alarm`]) it has a
//! word in whether the target is lost.

use std::sync::Arc;

use crate::alarm::Alarm;
use crate::gaze::{Context, Plan, Policy};
use crate::geometry::{Extent, Gaze, State};
use crate::identity::accumulate::{Accumulate, Accumulator};
use crate::identity::pyramid::Region;
use crate::identity::{Encoder, Pyramid, Recognizer, Retina};
use crate::saved_state::SavedState;
use crate::scene::{Image, Meter};
use foveate_base::rng::Rng;
use foveate_base::rows::{Rows, RowsMut};
use foveate_base::{Error, Result};
use serde_json::{Value, json};

/// The farthest gaze the pyramid is made for unless a plan asks for more, template units: a region of nearly one size.
const USUAL_GAZE: f64 = 1.0;

/// A recogniser, what it looks with and where, and what it has made of all frames.
pub struct Recognition {
    retina: Arc<dyn Retina>,
    encoder: Option<Arc<dyn Encoder>>,
    recognizer: Box<dyn Recognizer>,
    policy: Box<dyn Policy>,
    accumulator: Accumulator,
    alarm: Option<Alarm>,
    pyramid: Pyramid,
    is_new: bool,
    plan: Plan,
    rewards: Vec<f64>,
    glimpse: Vec<f32>,
    features: Vec<f32>,
    log_p: Vec<f64>,
    own: Vec<f64>,
    classes: Vec<f64>,
}

/// What was recognised, as [`crate::seen::Seen`] shows it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Recognized<'a> {
    /// p(c | all frames so far), after accumulation; empty without a recogniser.
    pub classes: &'a [f64],
    /// What they are called; empty where they have numbers alone.
    pub names: &'a [String],
    /// p(c | the last Δ looks), this frame's own decision.
    pub own: &'a [f64],
    /// Where it looked in this frame.
    pub gazes: &'a [Gaze],
}

impl Recognition {
    /// Puts the parts together; without an encoder the recogniser reads glimpses.
    ///
    /// Fails where one part's values are not as many as the next one takes, or the rule's number is out of range.
    pub fn new(
        retina: Arc<dyn Retina>,
        encoder: Option<Arc<dyn Encoder>>,
        recognizer: Box<dyn Recognizer>,
        policy: Box<dyn Policy>,
        accumulate: Accumulate,
    ) -> Result<Self> {
        let n_v = retina.glimpse_len();
        let (takes, gives) = encoder.as_ref().map_or((n_v, n_v), |e| e.shape());
        if takes != n_v || gives != recognizer.width() {
            return Err(Error::Config(format!(
                "the recogniser reads {} values, its first layer gives {gives} and takes {takes}, its retina gives {n_v}; \
                 use the model with the first layer it was trained on, or train it again with `foveate train fixations`",
                recognizer.width()
            )));
        }
        let n = recognizer.classes();
        let alike = 1.0 / n as f64;
        Ok(Self {
            accumulator: Accumulator::new(accumulate, n)?,
            alarm: None,
            glimpse: vec![0.0; n_v],
            features: vec![0.0; gives],
            log_p: vec![0.0; n],
            own: vec![alike; n],
            classes: vec![alike; n],
            retina,
            encoder,
            recognizer,
            policy,
            pyramid: Pyramid::default(),
            is_new: true,
            plan: Plan::new(),
            rewards: vec![],
        })
    }

    /// The same, with an alarm: a class that is no longer seen counts as an evidence deficit.
    pub fn with_alarm(mut self) -> Result<Self> {
        self.alarm = Some(Alarm::new(self.classes())?);
        Ok(self)
    }
    /// Evidence deficit of the class, 0 to 1: how much it speaks against the target being there; 0 without an alarm.
    pub fn alarm(&self) -> f64 {
        self.alarm.as_ref().map_or(0.0, Alarm::deficit)
    }

    /// Counts what the last look used of its picture.
    pub fn measure(&self, meter: &mut Meter) {
        meter.add(self.pyramid.used());
    }

    /// Looks at every gaze that its policy plans for this frame, at `estimate`, and takes in what that says.
    ///
    /// A look's reward is how sure it leaves the last Δ looks: 1 − H/log n_c, 0 to 1. Allocates nothing after the first frames.
    pub fn look(&mut self, image: &Image, estimate: &State, extent: Extent, context: &Context, rng: &mut Rng) {
        self.policy.plan(context, &mut self.plan, rng);
        let far = self.plan.gazes().iter().map(|g| g.u.abs().max(g.v.abs())).fold(USUAL_GAZE, f64::max);
        let reach = self.retina.footprints().iter().map(|f| f.reach).fold(far, f64::max);
        let unit = estimate.half(extent);
        if self.is_new {
            // Memory for twice the sides: a target that grows or turns needs no more of it.
            let side = |unit: f64, most: usize| ((4.0 * (far + reach) * unit) as usize + 8).min(most);
            let (width, height) = (side(unit.0, image.width()), side(unit.1, image.height()));
            self.pyramid.build(image, Region { x: 0, y: 0, width, height }, self.retina.footprints(), unit);
            self.is_new = false;
        }
        let region = Region::covering(image, &[*estimate], &[Gaze { u: far, v: far, arm: None }], extent, reach);
        self.pyramid.build(image, region, self.retina.footprints(), unit);
        self.rewards.clear();
        for &gaze in self.plan.gazes() {
            self.retina.look(&self.pyramid, estimate.fixate(gaze, extent), &mut self.glimpse);
            self.glimpse.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
            match &self.encoder {
                Some(encoder) => {
                    encoder.condition(&mut self.glimpse);
                    let rows = Rows::new(&self.glimpse, self.retina.glimpse_len());
                    let width = self.features.len();
                    encoder.encode(rows, RowsMut::new(&mut self.features, width));
                    self.features.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
                }
                None => self.features.copy_from_slice(&self.glimpse),
            }
            self.recognizer.recognize(&self.features, gaze, &mut self.log_p);
            self.rewards.push(certainty(&self.log_p));
        }
        self.policy.learn(&self.plan, &self.rewards);
        self.own.iter_mut().zip(&self.log_p).for_each(|(p, q)| *p = q.exp());
        self.accumulator.add(&self.log_p);
        self.accumulator.posterior(&mut self.classes);
        self.alarm.iter_mut().for_each(|alarm| alarm.hear(&self.log_p, context));
    }

    /// What was recognised up to the last look.
    pub fn recognized(&self) -> Recognized<'_> {
        Recognized { classes: &self.classes, names: self.recognizer.names(), own: &self.own, gazes: self.plan.gazes() }
    }
    /// n_c.
    pub fn classes(&self) -> usize {
        self.classes.len()
    }
    /// Forgets all frames: another target.
    pub fn reset(&mut self) {
        self.recognizer.reset();
        self.policy.reset();
        self.accumulator.reset();
        self.alarm.iter_mut().for_each(Alarm::reset);
        let alike = 1.0 / self.classes.len() as f64;
        self.classes.fill(alike);
        self.own.fill(alike);
        self.plan.clear();
    }
    /// All that was taken in and learned.
    pub fn save(&self) -> Value {
        let (looks, policy) = (self.recognizer.save(), self.policy.save());
        let mut saved = json!({ "looks": looks, "policy": policy, "evidence": self.accumulator.save() });
        if let Some(alarm) = &self.alarm {
            saved["alarm"] = alarm.save();
        }
        saved
    }
    /// Takes up what `save` gave. Fails where it does not fit; it has to be reset then.
    pub fn load(&mut self, saved: &Value) -> Result<()> {
        self.reset();
        let part = |key: &str| SavedState::new(&saved[key]);
        self.recognizer.load(&part("looks"))?;
        self.policy.load(&part("policy"))?;
        self.accumulator.load(&saved["evidence"])?;
        self.accumulator.posterior(&mut self.classes);
        match (&mut self.alarm, saved.get("alarm")) {
            (Some(alarm), Some(saved)) => alarm.load(saved),
            _ => Ok(()),
        }
    }
}

/// 1 − H/log n of log-probabilities: 0 where all are alike, 1 where one is certain.
fn certainty(log_p: &[f64]) -> f64 {
    let entropy: f64 = log_p.iter().filter(|q| q.is_finite()).map(|q| -q * q.exp()).sum();
    (1.0 - entropy / (log_p.len() as f64).ln()).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn certainty_is_one_minus_the_share_of_entropy() {
        assert!(certainty(&[(0.25f64).ln(); 4]).abs() < 1e-12);
        assert_eq!(certainty(&[0.0, f64::NEG_INFINITY]), 1.0);
        // One of two is out: half of the four's entropy is left.
        let half = [0.5f64.ln(), 0.5f64.ln(), f64::NEG_INFINITY, f64::NEG_INFINITY];
        assert!((certainty(&half) - 0.5).abs() < 1e-12);
    }
}
