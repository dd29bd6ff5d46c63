//! Bayesian optimisation: the largest value of an expensive function of 1 to [`MOST`] variables, in tens to hundreds of evaluations.
//!
//! Points are scaled to the unit cube, values to mean 0 and deviation 1. The process has a Matérn 5/2 kernel and a length scale for each
//! variable; the hyper-parameters are fitted (MAP) as values arrive. The first points are a Latin hypercube. Each later point maximises the
//! upper confidence bound m(x) + κ s(x) (GP-UCB; Srinivas et al. 2010): DIRECT searches the whole cube, then quasi-Newton steps continue
//! from its point and from the best points observed.
//!
//! Deviation: κ cycles through 2, 1 and 0.1 instead of growing with √(ln t). The bound of the theory explores for ever; here every third
//! point lies close to the largest mean, which gives the last digits of a smooth function.

mod climb;
mod cube;
mod search;
mod settings;
#[cfg(test)]
mod tests;

use self::cube::{Cube, moments};
use self::search::Search;
pub use self::settings::Settings;
use foveate_base::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// The most variables.
pub const MOST: usize = 14;
/// Larger values cannot be squared and summed.
const LARGEST: f64 = 1e100;

/// Proposes points of a box, and learns from their values.
///
/// ```
/// use foveate_gp::optimiser::{Optimiser, Settings};
/// let mut search = Optimiser::new(&[(-1.0, 1.0); 3], Settings::default(), 1)?;
/// for _ in 0..40 {
///     let x = search.ask();
///     let value = -(x[0] - 0.3).powi(2) - (x[1] + 0.2).powi(2) - x[2].powi(2);
///     search.tell(&x, value)?;
/// }
/// let best = search.best().expect("values were seen");
/// assert!((best[0] - 0.3).abs() < 0.01 && (best[1] + 0.2).abs() < 0.01 && best[2].abs() < 0.01);
/// # Ok::<_, foveate_base::Error>(())
/// ```
#[derive(Debug)]
pub struct Optimiser {
    /// Smallest and largest value of each variable.
    bounds: Vec<(f64, f64)>,
    search: Box<dyn Cube>,
    /// Observed points and values, oldest first.
    points: Vec<Vec<f64>>,
    values: Vec<f64>,
    window: usize,
    asked: u64,
    seen: u64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Memory {
    points: Vec<Vec<f64>>,
    values: Vec<f64>,
    asked: u64,
    seen: u64,
    process: Value,
}

impl Optimiser {
    /// Nothing observed yet. `bounds` are the smallest and largest value of each variable; `seed` names all draws.
    ///
    /// # Errors
    /// [`Error::Config`] if a setting is out of range, the number of variables is 0 or above [`MOST`], or bounds are
    /// not finite or not in order; [`Error::Memory`] if the window does not fit.
    pub fn new(bounds: &[(f64, f64)], settings: Settings, seed: u64) -> Result<Self> {
        settings.check()?;
        if let Some((i, (lower, upper))) = bounds.iter().enumerate().find(|(_, (l, u))| !(l < u && (u - l).is_finite()))
        {
            return Err(Error::Config(format!(
                "optimiser: bounds are finite numbers, the lower before the upper; those of variable {i} are {lower} and {upper}"
            )));
        }
        let window = settings.window;
        foveate_base::memory::check(format_args!("a window of {window} values"), 24 * (window * window) as u64)?;
        macro_rules! of_dimensions {
            ($($d:literal)*) => {
                match bounds.len() {
                    $($d => Box::new(Search::<$d>::new(settings, seed)?) as Box<dyn Cube>,)*
                    n => return Err(Error::Config(format!("optimiser: there are 1 to {MOST} variables, with bounds each; found {n}"))),
                }
            };
        }
        let search = of_dimensions!(1 2 3 4 5 6 7 8 9 10 11 12 13 14);
        let (points, values) = (vec![], vec![]);
        Ok(Self { bounds: bounds.to_vec(), search, points, values, window, asked: 0, seen: 0 })
    }

    /// Returns the next point to evaluate. Until the next call of `tell`, repeated calls after the warm-up return the
    /// same point.
    pub fn ask(&mut self) -> Vec<f64> {
        let unit = self.search.ask(self.asked, self.seen);
        self.asked += 1;
        let place = |(u, (lower, upper)): (f64, &(f64, f64))| (lower + u * (upper - lower)).clamp(*lower, *upper);
        unit.into_iter().zip(&self.bounds).map(place).collect()
    }

    /// Records the value of a point, suggested or not; larger is better. Values may be noisy.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the point is outside the bounds or the value outside ±1e100.
    pub fn tell(&mut self, point: &[f64], value: f64) -> Result<()> {
        let inside = |(x, (lower, upper)): (&f64, &(f64, f64))| (lower..=upper).contains(&x);
        if point.len() != self.bounds.len() || !point.iter().zip(&self.bounds).all(inside) {
            return Err(Error::Invalid(format!(
                "a point has {} numbers, within the bounds {:?}; it is {point:?}",
                self.bounds.len(),
                self.bounds
            )));
        }
        if value.is_nan() || value.abs() > LARGEST {
            return Err(Error::Invalid(format!("a value is a number from -1e100 to 1e100; it is {value}")));
        }
        if self.values.len() == self.window {
            self.values.remove(0);
            self.points.remove(0);
        }
        self.values.push(value);
        self.points.push(point.to_vec());
        self.seen += 1;
        let unit = self.unit(point);
        self.search.tell(&unit, &self.values);
        Ok(())
    }

    /// Of the points observed, the one with the largest posterior mean; none before the first value. Without noise it is the best one
    /// observed, with noise it is not the luckiest.
    pub fn best(&self) -> Option<&[f64]> {
        let mean = |point: &Vec<f64>| self.search.predict(&self.unit(point)).0;
        let means: Vec<f64> = self.points.iter().map(mean).collect();
        (0..means.len()).max_by(|&a, &b| means[a].total_cmp(&means[b])).map(|i| &*self.points[i])
    }

    /// Posterior mean and standard deviation of the function at a point, in the units of the values.
    ///
    /// # Panics
    /// If the point does not have a number for each variable.
    pub fn predict(&self, point: &[f64]) -> (f64, f64) {
        assert_eq!(point.len(), self.bounds.len(), "a number for each variable");
        let ((mean, variance), (centre, unit)) = (self.search.predict(&self.unit(point)), moments(&self.values));
        (centre + unit * mean, unit * variance.sqrt())
    }

    /// All that was learned, for [`restore`](Self::restore).
    pub fn save(&self) -> Value {
        let Self { points, values, asked, seen, .. } = self;
        serde_json::json!({
            "points": points, "values": values, "asked": asked, "seen": seen, "process": self.search.save(),
        })
    }

    /// Restores a state of [`save`](Self::save). The points that follow are the same to the last bit if bounds,
    /// settings and seed are.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the state does not fit these bounds and settings; the optimiser is then unchanged.
    pub fn restore(&mut self, saved: &Value) -> Result<()> {
        let wrong = || {
            let (n, window) = (self.bounds.len(), self.window);
            Error::Invalid(format!(
                "a saved optimiser: expected at most {window} points of {n} variables within the bounds, and their values; found others; \
                 give the bounds and settings it was saved with"
            ))
        };
        let memory = Memory::deserialize(saved).map_err(|_| wrong())?;
        let n = memory.points.len();
        let inside = |x: &f64, (lower, upper): &(f64, f64)| (lower..=upper).contains(&x);
        let fits = n == memory.values.len()
            && n <= self.window
            && memory.seen >= n as u64
            && memory.values.iter().all(|v| v.abs() <= LARGEST)
            && memory
                .points
                .iter()
                .all(|p| p.len() == self.bounds.len() && p.iter().zip(&self.bounds).all(|(x, b)| inside(x, b)));
        if !fits {
            return Err(wrong());
        }
        let units: Vec<Vec<f64>> = memory.points.iter().map(|p| self.unit(p)).collect();
        if self.search.restore(&memory.process, &units, &memory.values).is_none() {
            return Err(wrong());
        }
        (self.points, self.values, self.asked, self.seen) = (memory.points, memory.values, memory.asked, memory.seen);
        Ok(())
    }

    fn unit(&self, point: &[f64]) -> Vec<f64> {
        point.iter().zip(&self.bounds).map(|(x, (lower, upper))| (x - lower) / (upper - lower)).collect()
    }
}
