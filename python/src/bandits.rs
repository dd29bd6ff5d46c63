//! The policies with arms as standalone bandits, and Bayesian optimisation over a box.

use std::sync::{Mutex, MutexGuard, PoisonError};

use foveate::extend::SavedState;
use foveate::gaze::{Context, Exp3, Hedge, Plan, Policy, PolicySnapshot, Schedule, Variant};
use foveate::geometry::Gaze;
use foveate::gp::optimiser::{Optimiser, Settings};
use foveate::rng::{Purpose, Streams};
use foveate::{Error, Result};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use serde_json::Value;

use crate::errors::{OrRaise, input};

struct Working {
    policy: Box<dyn Policy>,
    plan: Plan,
    /// Number of calls of `ask`.
    asked: u64,
    /// Whether the reward of the last arm is missing.
    waiting: bool,
}

/// A policy; the Python interface is in `foveate.bandits`.
#[pyclass(frozen, module = "foveate._foveate", name = "Policy")]
pub struct PyPolicy {
    streams: Streams,
    working: Mutex<Working>,
}

fn make(kind: &str, arms: usize, rate: Schedule) -> Result<Box<dyn Policy>> {
    let arms = (0..arms).map(|k| Gaze { u: k as f64, v: 0.0, arm: Some(k) }).collect::<Vec<_>>();
    Ok(match kind {
        "hedge" => Box::new(Hedge::new(arms, rate)?),
        "exp3" => Box::new(Exp3::new(arms, Variant::Unbiased, rate)?),
        _ => Box::new(Exp3::new(arms, Variant::Implicit, rate)?),
    })
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[pymethods]
impl PyPolicy {
    #[new]
    fn new(py: Python<'_>, kind: &str, arms: usize, rate: &str, seed: u64) -> PyResult<Self> {
        let rate = serde_json::from_str(rate).map_err(|e| Error::Config(format!("{kind}: gamma: {e}"))).or_raise(py)?;
        let policy = make(kind, arms, rate).or_raise(py)?;
        let working = Working { policy, plan: Plan::new(), asked: 0, waiting: false };
        Ok(Self { streams: Streams::new(seed, 0), working: Mutex::new(working) })
    }

    /// Returns the next arm.
    fn ask(&self, py: Python<'_>) -> usize {
        py.detach(|| {
            let Working { policy, plan, asked, waiting } = &mut *lock(&self.working);
            policy.plan(&Context::default(), plan, &mut self.streams.at(*asked, Purpose::Look).rng(0));
            (*asked, *waiting) = (*asked + 1, true);
            plan.chosen().arm.expect("the gazes of these policies are arms")
        })
    }

    /// Sets the rewards of the arms of the last plan, in their order.
    fn tell(&self, py: Python<'_>, rewards: Vec<f64>) -> PyResult<()> {
        let learn = || {
            let Working { policy, plan, waiting, .. } = &mut *lock(&self.working);
            if !*waiting {
                return Err(Error::Invalid("call ask once before each tell".into()));
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

    /// Returns the probability of each arm for the next choice.
    fn probabilities<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        match lock(&self.working).policy.snapshot() {
            PolicySnapshot::Arms { probabilities, .. } => Some(PyArray1::from_slice(py, probabilities)),
            _ => None,
        }
    }

    /// Returns the whole state as JSON, and the number of calls of `ask`.
    fn save(&self) -> (String, u64) {
        let working = lock(&self.working);
        (working.policy.save().to_string(), working.asked)
    }

    /// Restores a state from `save`; drops an arm without a reward.
    fn load(&self, py: Python<'_>, saved: &str, asked: u64) -> PyResult<()> {
        let load = || {
            let mut working = lock(&self.working);
            working.policy.load(&SavedState::new(&crate::held::parse(saved.as_bytes())?))?;
            (working.asked, working.waiting) = (asked, false);
            Ok(())
        };
        load().or_raise(py)
    }
}

/// Bayesian optimisation; the Python interface is `foveate.bandits.GpUcb`.
#[pyclass(frozen, module = "foveate._foveate", name = "Optimiser")]
pub struct PyOptimiser {
    dimensions: usize,
    optimiser: Mutex<Optimiser>,
}

#[pymethods]
impl PyOptimiser {
    #[new]
    fn new(py: Python<'_>, bounds: Vec<(f64, f64)>, settings: &str, seed: u64) -> PyResult<Self> {
        let wrong = |e: serde_json::Error| Error::Config(format!("optimiser: {e}"));
        let settings: Result<Settings> = serde_json::from_str(settings).map_err(wrong);
        let optimiser = settings.and_then(|settings| Optimiser::new(&bounds, settings, seed)).or_raise(py)?;
        Ok(Self { dimensions: bounds.len(), optimiser: Mutex::new(optimiser) })
    }

    /// Returns the next point.
    fn ask(&self, py: Python<'_>) -> Vec<f64> {
        py.detach(|| lock(&self.optimiser).ask())
    }

    /// Sets the value of a point.
    fn tell(&self, py: Python<'_>, point: Vec<f64>, value: f64) -> PyResult<()> {
        py.detach(|| lock(&self.optimiser).tell(&point, value)).or_raise(py)
    }

    /// Returns the observed point with the largest mean.
    fn best(&self, py: Python<'_>) -> Option<Vec<f64>> {
        py.detach(|| lock(&self.optimiser).best().map(<[f64]>::to_vec))
    }

    /// Returns mean and standard deviation at each point.
    #[expect(clippy::type_complexity, reason = "two arrays")]
    fn predict<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)> {
        let points = points.as_array();
        if points.ncols() != self.dimensions {
            let (expected, found) = (self.dimensions, points.ncols());
            return Err(input(py, format!("points have {expected} numbers each; these have {found}")));
        }
        let points: Vec<Vec<f64>> = points.rows().into_iter().map(|point| point.to_vec()).collect();
        let (means, deviations): (Vec<f64>, Vec<f64>) = py.detach(|| {
            let optimiser = lock(&self.optimiser);
            points.iter().map(|point| optimiser.predict(point)).unzip()
        });
        Ok((means.into_pyarray(py), deviations.into_pyarray(py)))
    }

    /// Returns the whole state as JSON.
    fn save(&self) -> String {
        lock(&self.optimiser).save().to_string()
    }

    /// Restores a state from `save`.
    fn load(&self, py: Python<'_>, saved: &str) -> PyResult<()> {
        let parsed: Result<Value> = crate::held::parse(saved.as_bytes());
        parsed.and_then(|saved| lock(&self.optimiser).restore(&saved)).or_raise(py)
    }
}
