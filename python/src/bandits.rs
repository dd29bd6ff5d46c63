//! The policies as bandits on their own.

use std::sync::{Mutex, MutexGuard, PoisonError};

use foveate::gaze::{Context, Exp3, GpUcb, Hedge, Plan, Policy, PolicySnapshot, Schedule, Variant};
use foveate::geometry::Gaze;
use foveate::rng::{Purpose, Streams};
use foveate::{Error, Result};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use serde_json::Value;

use crate::errors::{OrRaise, input};

struct Working {
    policy: Box<dyn Policy>,
    plan: Plan,
    /// Times it was asked.
    asked: u64,
    /// Whether it is to be told what its last answer was worth.
    waiting: bool,
}

/// A policy; `foveate.bandits` has its Python side.
#[pyclass(frozen, module = "foveate._foveate", name = "Policy")]
pub struct PyPolicy {
    streams: Streams,
    working: Mutex<Working>,
}

fn make(kind: &str, gazes: Vec<(f64, f64)>, settings: Value) -> Result<Box<dyn Policy>> {
    let wrong = |e: serde_json::Error| Error::Config(format!("{kind}: {e}"));
    let arms = || (0..).zip(&gazes).map(|(k, &(u, v))| Gaze { u, v, arm: Some(k) }).collect::<Vec<_>>();
    let rate = |value: &Value| serde_json::from_value::<Schedule>(value["gamma"].clone()).map_err(wrong);
    Ok(match kind {
        "hedge" => Box::new(Hedge::new(arms(), rate(&settings)?)?),
        "exp3" => Box::new(Exp3::new(arms(), Variant::Unbiased, rate(&settings)?)?),
        "exp3-ix" => Box::new(Exp3::new(arms(), Variant::Implicit, rate(&settings)?)?),
        _ => Box::new(GpUcb::new(serde_json::from_value(settings).map_err(wrong)?)?),
    })
}

impl PyPolicy {
    fn working(&self) -> MutexGuard<'_, Working> {
        self.working.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl PyPolicy {
    #[new]
    fn new(py: Python<'_>, kind: &str, gazes: Vec<(f64, f64)>, settings: &str, seed: u64) -> PyResult<Self> {
        let settings = serde_json::from_str(settings).map_err(|e| input(py, format!("{kind}: {e}")))?;
        let policy = make(kind, gazes, settings).or_raise(py)?;
        let working = Working { policy, plan: Plan::new(), asked: 0, waiting: false };
        Ok(Self { streams: Streams::new(seed, 0), working: Mutex::new(working) })
    }

    /// The next gaze: its arm, where it has one, and where it is.
    fn ask(&self, py: Python<'_>) -> (Option<usize>, f64, f64) {
        py.detach(|| {
            let Working { policy, plan, asked, waiting } = &mut *self.working();
            policy.plan(&Context::default(), plan, &mut self.streams.at(*asked, Purpose::Look).rng(0));
            (*asked, *waiting) = (*asked + 1, true);
            let gaze = plan.chosen();
            (gaze.arm, gaze.u, gaze.v)
        })
    }

    /// What the gazes that were asked for are worth, in their order.
    fn tell(&self, py: Python<'_>, rewards: Vec<f64>) -> PyResult<()> {
        let learn = || {
            let Working { policy, plan, waiting, .. } = &mut *self.working();
            if !*waiting {
                return Err(Error::Invalid(
                    "tell is about what ask answered: call ask first, once for each tell".into(),
                ));
            }
            if rewards.len() != plan.gazes().len() {
                let (expected, found) = (plan.gazes().len(), rewards.len());
                return Err(Error::Invalid(format!(
                    "expected {expected} rewards, one for each gaze; there are {found}"
                )));
            }
            policy.learn(plan, &rewards);
            *waiting = false;
            Ok(())
        };
        py.detach(learn).or_raise(py)
    }

    /// What a gaze is worth, whether it was asked for or not.
    fn tell_of(&self, py: Python<'_>, u: f64, v: f64, reward: f64) {
        py.detach(|| {
            let Working { policy, plan, waiting, .. } = &mut *self.working();
            plan.only(Gaze { u, v, arm: None });
            policy.learn(plan, &[reward]);
            *waiting = false;
        });
    }

    /// How likely each arm is to be chosen next.
    fn probabilities<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        match self.working().policy.snapshot() {
            PolicySnapshot::Arms { probabilities, .. } => Some(PyArray1::from_slice(py, probabilities)),
            _ => None,
        }
    }

    /// Mean and standard deviation of the believed reward at each point.
    #[expect(clippy::type_complexity, reason = "two arrays")]
    fn predict<'py>(
        &self,
        py: Python<'py>,
        points: Vec<(f64, f64)>,
    ) -> Option<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)> {
        let all: Vec<(f64, f64)> = match self.working().policy.snapshot() {
            PolicySnapshot::Surface(surface) => points.into_iter().map(|(u, v)| surface.at(u, v)).collect(),
            _ => return None,
        };
        let (means, deviations): (Vec<f64>, Vec<f64>) = all.into_iter().unzip();
        Some((means.into_pyarray(py), deviations.into_pyarray(py)))
    }

    /// The point with the largest mean, once something was learned.
    fn best(&self) -> Option<(f64, f64)> {
        match self.working().policy.snapshot() {
            PolicySnapshot::Surface(surface) => surface.best().map(|gaze| (gaze.u, gaze.v)),
            _ => None,
        }
    }

    /// All that was learned, as JSON, and how often it was asked.
    fn save(&self) -> (String, u64) {
        let working = self.working();
        (working.policy.save().to_string(), working.asked)
    }

    /// Goes on from what `save` gave; an answer that was not told of is forgotten.
    fn load(&self, py: Python<'_>, saved: &str, asked: u64) -> PyResult<()> {
        let load = || {
            let mut working = self.working();
            working.policy.load(&crate::held::parse(saved.as_bytes())?)?;
            (working.asked, working.waiting) = (asked, false);
            Ok(())
        };
        load().or_raise(py)
    }
}
