//! WHAT is it? Recognition of the target's class from looks at the estimate, over time (section 2.2).
//!
//! Recognition runs beside the filter. It looks at each frame again, at the estimate, with its own retina, first layer and policy. It
//! never moves the belief; with an alarm ([`Recognition::with_alarm`]) it contributes to P(lost).

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
use serde_json::json;

/// The farthest gaze that the pyramid covers unless a plan needs more, template units: the size of the region stays nearly constant.
const USUAL_GAZE: f64 = 1.0;

/// A recogniser with its retina, encoder and policy, and the class probabilities over all frames.
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

foveate_base::opaque_debug!(Recognition);

/// The recognised class, as in [`crate::seen::Seen`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Recognized<'a> {
    /// p(c | all frames so far), after accumulation; empty without a recogniser.
    pub classes: &'a [f64],
    /// The names of the classes; empty if they have numbers only.
    pub names: &'a [String],
    /// p(c | the last Δ looks): the decision of this frame alone.
    pub own: &'a [f64],
    /// The gazes of this frame.
    pub gazes: &'a [Gaze],
}

impl Recognition {
    /// Combines the parts; without an encoder the recogniser reads glimpses.
    ///
    /// # Errors
    /// If the number of values from one part is not the number that the next one takes, or if the number of `accumulate` is out of range.
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

    /// Adds an alarm: a class that is no longer recognised counts as an evidence deficit.
    pub fn with_alarm(mut self) -> Result<Self> {
        self.alarm = Some(Alarm::new(self.classes())?);
        Ok(self)
    }
    /// Returns the evidence deficit of the class, 0 to 1; 0 without an alarm.
    pub fn alarm(&self) -> f64 {
        self.alarm.as_ref().map_or(0.0, Alarm::deficit)
    }

    /// Adds the pixels that the last look used to the meter.
    pub fn measure(&self, meter: &mut Meter) {
        meter.add(self.pyramid.used());
    }

    /// Classifies every gaze that the policy plans for this frame, at `estimate`, and updates the class probabilities.
    ///
    /// The reward of a look is the certainty of the decision over the last Δ looks: 1 − H/log n_c, 0 to 1. Allocates nothing after the
    /// first frames.
    pub fn look(&mut self, image: &Image, estimate: &State, extent: Extent, context: &Context, rng: &mut Rng) {
        self.policy.plan(context, &mut self.plan, rng);
        let far = self.plan.gazes().iter().map(|g| g.u.abs().max(g.v.abs())).fold(USUAL_GAZE, f64::max);
        let reach = self.retina.footprints().iter().map(|f| f.reach).fold(far, f64::max);
        let unit = estimate.half(extent);
        if self.is_new {
            // Memory for twice the sides suffices for a target that grows or turns.
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
        if let Some(alarm) = &mut self.alarm {
            alarm.update(&self.log_p, context);
        }
    }

    /// Returns the result of all looks so far.
    pub fn recognized(&self) -> Recognized<'_> {
        Recognized { classes: &self.classes, names: self.recognizer.names(), own: &self.own, gazes: self.plan.gazes() }
    }
    /// Returns the number of classes n_c.
    pub fn classes(&self) -> usize {
        self.classes.len()
    }
    /// Resets everything for another target.
    pub fn reset(&mut self) {
        self.recognizer.reset();
        self.policy.reset();
        self.accumulator.reset();
        if let Some(alarm) = &mut self.alarm {
            alarm.reset();
        }
        let alike = 1.0 / self.classes.len() as f64;
        self.classes.fill(alike);
        self.own.fill(alike);
        self.plan.clear();
    }
    /// Returns the whole state.
    pub fn save(&self) -> SavedState {
        let (looks, policy) = (self.recognizer.save(), self.policy.save());
        SavedState::new(&json!({ "looks": looks, "policy": policy, "evidence": self.accumulator, "alarm": self.alarm }))
    }
    /// Restores a state that `save` returned. After an error, call [`Recognition::reset`].
    pub fn load(&mut self, saved: &SavedState) -> Result<()> {
        self.reset();
        self.recognizer.load(&saved.part("looks"))?;
        self.policy.load(&saved.part("policy"))?;
        self.accumulator = saved.part_state("evidence", &self.accumulator)?;
        self.accumulator.posterior(&mut self.classes);
        self.alarm.as_mut().map_or(Ok(()), |alarm| alarm.load(&saved.part("alarm")))
    }
}

/// Returns 1 − H/log n of log-probabilities: 0 if all are equal, 1 if one is certain.
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
        // Two of four classes are excluded: half of the entropy is left.
        let half = [0.5f64.ln(), 0.5f64.ln(), f64::NEG_INFINITY, f64::NEG_INFINITY];
        assert!((certainty(&half) - 0.5).abs() < 1e-12);
    }
}
