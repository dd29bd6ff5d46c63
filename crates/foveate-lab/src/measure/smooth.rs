//! Position, velocity and acceleration at every frame, from all frames: a fixed-interval smoother.
//!
//! The model of one coordinate is constant acceleration with white jerk; the error e of the tracked position is correlated from frame to
//! frame, because a tracker carries its state on:
//! ```text
//! p' = v,  v' = a,  a' = white noise of density q
//! eₖ = ρ^(Δt/τ) eₖ₋₁ + noise,  variance 1          τ: the median interval
//! yₖ = p(tₖ) + s cₖ eₖ                              cₖ: the reported standard deviation
//! ```
//! The scale s maximises the likelihood of the innovations (Schweppe 1965). Results are averaged over correlations ρ and jerks q, weighted by
//! their likelihood, so that the errors include the uncertainty of both. The smoother is that of Rauch, Tung and Striebel (Maximum likelihood estimates of linear dynamic systems, AIAA Journal 3, 1965), in the form of
//! de Jong (1989), which inverts no covariance. A measurement that deviates from the prediction of all others by more than
//! [`FAR`] standard deviations gets its squared deviation as additional variance.

use foveate_base::text::counted;
use foveate_base::{Error, Result};

/// A measurement this many standard deviations away is down-weighted: one normal measurement of 2000.
pub const FAR: f64 = 3.5;
/// Robust standard deviations of a spike.
const SPIKE: f64 = 6.0;
/// The largest number of times that the down-weighted measurements are chosen.
const ROUNDS: usize = 5;
/// Fewest measurements.
pub const FEWEST: usize = 5;
/// Prior variance of position, velocity and acceleration: noise variances per frame.
const PRIOR: f64 = 1e6;
/// Range of log₁₀ of the jerk density relative to the noise, per frame.
const JERK: [f64; 2] = [-14.0, 5.0];
/// Models less likely than the best by this factor are left out.
const NEGLIGIBLE: f64 = 1e-3;
/// Correlations of the error from one frame to the next.
const CORRELATIONS: [f64; 7] = [0.0, 0.3, 0.5, 0.65, 0.8, 0.9, 0.95];

/// One frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Seconds.
    pub time: f64,
    /// The measured coordinate and its reported variance; `None` if there is none.
    pub measured: Option<(f64, f64)>,
}

/// One frame of a smoothed track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Smoothed {
    /// Position, velocity, acceleration.
    pub value: [f64; 3],
    /// Their standard errors.
    pub sd: [f64; 3],
}

/// A smoothed track.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoothing {
    /// One per sample.
    pub frames: Vec<Smoothed>,
    /// The standard deviation of the measurement error relative to the reported one.
    pub noise: f64,
    /// The correlation of the measurement error from one frame to the next, 0 to below 1.
    pub correlation: f64,
    /// The factor of each measurement's variance from its deviation: 1, or more if it was down-weighted.
    pub inflation: Vec<f64>,
}

/// Smooths a track.
///
/// # Errors
/// Fewer than [`FEWEST`] measurements, times that do not increase, or a variance that is not above 0.
pub fn smooth(samples: &[Sample]) -> Result<Smoothing> {
    let data = Data::new(samples)?;
    let mut extra = data.spikes();
    for round in 1.. {
        let average = data.average(&extra);
        let far = |(off, sd): &(f64, f64)| if off.abs() > FAR * sd { off * off } else { 0.0 };
        let next: Vec<f64> = average.deletion.iter().map(far).collect();
        let settled = next.iter().zip(&extra).all(|(a, b)| (*a > 0.0) == (*b > 0.0));
        if settled || round == ROUNDS {
            return Ok(data.in_units(&average, &extra));
        }
        extra = next;
    }
    unreachable!("the last round returns")
}

/// Jerk density relative to the noise, and correlation of the errors, per median interval.
#[derive(Clone, Copy, Debug)]
struct Model {
    jerk: f64,
    correlation: f64,
    /// Prior variance of position, velocity and acceleration.
    prior: f64,
}

/// Position, velocity, acceleration, relative error of the measurement.
type Vector = [f64; 4];
type Square = [[f64; 4]; 4];

/// A frame in units of the median interval and the median reported standard deviation.
struct Step {
    /// Since the frame before; 0 for the first.
    interval: f64,
    /// Position, and standard deviation.
    measured: Option<(f64, f64)>,
}

/// Sums over models, weighted by their likelihood.
#[derive(Default)]
struct Average {
    weight: f64,
    /// Of each component its first and second moment.
    states: Vec<[[f64; 2]; 3]>,
    variance: f64,
    correlation: f64,
    /// Of the likeliest model: deviations relative to the noise, and their standard deviations.
    deletion: Vec<(f64, f64)>,
}

struct Data {
    steps: Vec<Step>,
    start: f64,
    unit: f64,
    interval: f64,
}

/// The forward pass.
struct Filtered {
    /// Prediction of each frame and its covariance, relative to the noise.
    predicted: Vec<(Vector, Square)>,
    /// Innovation and its variance.
    innovations: Vec<Option<(f64, f64)>>,
    /// s²: variance of the noise.
    variance: f64,
    log_likelihood: f64,
}

/// The backward pass.
struct Backward {
    /// State and variances of its components.
    states: Vec<(Vector, Vector)>,
    /// Deviation of each measurement from the prediction by all others, and its standard deviation relative to the noise.
    deletion: Vec<(f64, f64)>,
}

impl Data {
    fn new(samples: &[Sample]) -> Result<Self> {
        let known: Vec<(f64, f64)> = samples.iter().filter_map(|sample| sample.measured).collect();
        if known.len() < FEWEST {
            let found = counted(known.len(), "frame");
            return Err(Error::Invalid(format!("the target was found in {found}; measuring needs at least {FEWEST}")));
        }
        if let Some((value, variance)) = known.iter().find(|(y, v)| !(y.is_finite() && v.is_finite() && *v > 0.0)) {
            return Err(Error::Invalid(format!(
                "a measurement is {value} with variance {variance}; expected a variance above 0"
            )));
        }
        let intervals: Vec<f64> = samples.windows(2).map(|pair| pair[1].time - pair[0].time).collect();
        if let Some(k) = intervals.iter().position(|dt| !(*dt > 0.0 && dt.is_finite())) {
            return Err(Error::Invalid(format!(
                "the time of row {} is not after that of the row before; give the frame rate with --fps",
                k + 2
            )));
        }
        let interval = median(intervals.iter().copied());
        let unit = median(known.iter().map(|(_, variance)| *variance)).sqrt();
        let start = known[0].0;
        let step = |(k, sample): (usize, &Sample)| Step {
            interval: if k == 0 { 0.0 } else { intervals[k - 1] / interval },
            measured: sample.measured.map(|(y, variance)| ((y - start) / unit, variance.sqrt() / unit)),
        };
        Ok(Self { steps: samples.iter().enumerate().map(step).collect(), start, unit, interval })
    }

    /// Returns the additional variances with which the smoothing starts: those of spikes, which a large jerk would explain otherwise. A
    /// spike deviates from the cubic through its four neighbours more than these do, and by more than [`SPIKE`] robust standard deviations. The first and last two frames are left out.
    fn spikes(&self) -> Vec<f64> {
        let mut time = 0.0;
        let mut known: Vec<(usize, f64, f64)> = vec![];
        for (k, step) in self.steps.iter().enumerate() {
            time += step.interval;
            known.extend(step.measured.map(|(y, _)| (k, time, y)));
        }
        let off = |five: &[(usize, f64, f64)]| {
            let others = [five[0], five[1], five[3], five[4]];
            let factor = |i: usize| {
                let rest = others.iter().enumerate().filter(|(j, _)| *j != i);
                rest.map(|(_, other)| (five[2].1 - other.1) / (others[i].1 - other.1)).product::<f64>()
            };
            five[2].2 - (0..4).map(|i| factor(i) * others[i].2).sum::<f64>()
        };
        let offs: Vec<f64> = known.windows(5).map(off).collect();
        let robust = 1.4826 * median(offs.iter().map(|off| off.abs()));
        let mut extra = vec![0.0; self.steps.len()];
        for (i, off) in offs.iter().enumerate() {
            let around = &offs[i.saturating_sub(2)..(i + 3).min(offs.len())];
            if off.abs() > SPIKE * robust && robust > 0.0 && around.iter().all(|other| other.abs() <= off.abs()) {
                extra[known[i + 2].0] = (off / robust).powi(2);
            }
        }
        extra
    }

    /// Returns the smoothed track, averaged over all models.
    fn average(&self, extra: &[f64]) -> Average {
        let jerks = (0..=2 * (JERK[1] - JERK[0]) as usize).map(|k| 10_f64.powf(JERK[0] + 0.5 * k as f64));
        let models = jerks.flat_map(|jerk| CORRELATIONS.map(|correlation| Model { jerk, correlation, prior: PRIOR }));
        let likely: Vec<(Model, f64)> = models.map(|model| (model, self.filter(model, extra).log_likelihood)).collect();
        let most = likely.iter().map(|(_, log)| *log).fold(f64::NEG_INFINITY, f64::max);
        let n = self.steps.len();
        let mut average =
            Average { states: vec![Default::default(); n], deletion: vec![(0.0, 1.0); n], ..Average::default() };
        let (mut best, back) = (0.0, self.reversed());
        for (model, log_likelihood) in likely {
            let weight = (log_likelihood - most).exp();
            if weight.is_nan() || weight <= NEGLIGIBLE {
                continue;
            }
            let pass = self.filter(model, extra);
            let smoothed = self.smooth_both_ways(&pass, model, &back, extra);
            for (sum, (value, variance)) in average.states.iter_mut().zip(&smoothed.states) {
                for i in 0..3 {
                    let second = pass.variance * variance[i].max(0.0) + value[i] * value[i];
                    sum[i] = [sum[i][0] + weight * value[i], sum[i][1] + weight * second];
                }
            }
            average.weight += weight;
            average.variance += weight * pass.variance;
            average.correlation += weight * model.correlation;
            if weight > best {
                best = weight;
                let scale = pass.variance.sqrt();
                // Without the additional variance of the measurement itself.
                let own = |((off, sd), extra): (&(f64, f64), &f64)| (off / scale, (sd * sd - extra).max(0.0).sqrt());
                average.deletion = smoothed.deletion.iter().zip(extra).map(own).collect();
            }
        }
        average
    }

    /// Returns the data in the reverse order of time, and the position from which they count: that of the last measurement.
    fn reversed(&self) -> (Self, f64) {
        let from = self.steps.iter().rev().find_map(|step| step.measured).map_or(0.0, |(y, _)| y);
        let intervals = std::iter::once(0.0).chain(self.steps.iter().skip(1).rev().map(|step| step.interval));
        let step =
            |(step, interval): (&Step, f64)| Step { interval, measured: step.measured.map(|(y, c)| (y - from, c)) };
        let steps = self.steps.iter().rev().zip(intervals).map(step).collect();
        (Self { steps, ..*self }, from)
    }

    /// Smooths with a model. In the first frames of a pass almost all of the prior variance cancels, and the rounding errors would exceed
    /// the variances of velocity and acceleration: the states of the first half are those of a pass from the end.
    fn smooth_both_ways(&self, pass: &Filtered, model: Model, (back, from): &(Self, f64), extra: &[f64]) -> Backward {
        let mut smoothed = self.smooth(pass, model);
        let extra: Vec<f64> = extra.iter().rev().copied().collect();
        let others = back.smooth(&back.filter(model, &extra), model).states.into_iter().rev();
        let half = smoothed.states.len() / 2;
        for (state, (value, variances)) in smoothed.states[..half].iter_mut().zip(others) {
            *state = ([value[0] + from, -value[1], value[2], value[3]], variances);
        }
        smoothed
    }

    fn in_units(&self, average: &Average, extra: &[f64]) -> Smoothing {
        let (position, time, total) = (self.unit, self.interval, average.weight);
        let units = [position, position / time, position / (time * time)];
        let frames = average.states.iter().map(|sums| {
            let mean = sums.map(|[first, _]| first / total);
            let start = [self.start, 0.0, 0.0];
            let sd = |i: usize| (sums[i][1] / total - mean[i] * mean[i]).max(0.0).sqrt();
            Smoothed {
                value: std::array::from_fn(|i| mean[i] * units[i] + start[i]),
                sd: std::array::from_fn(|i| sd(i) * units[i]),
            }
        });
        let inflation =
            self.steps.iter().zip(extra).map(|(step, extra)| step.measured.map_or(1.0, |(_, c)| 1.0 + extra / (c * c)));
        Smoothing {
            frames: frames.collect(),
            noise: (average.variance / total).sqrt(),
            correlation: average.correlation / total,
            inflation: inflation.collect(),
        }
    }

    fn filter(&self, model: Model, extra: &[f64]) -> Filtered {
        let n = self.steps.len();
        let (mut predicted, mut innovations) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let (mut x, mut p): (Vector, Square) = ([0.0; 4], [[0.0; 4]; 4]);
        (0..3).for_each(|i| p[i][i] = model.prior);
        p[3][3] = 1.0;
        let (mut squares, mut log_det, mut count) = (0.0, 0.0, 0.0);
        for (step, extra) in self.steps.iter().zip(extra) {
            if step.interval > 0.0 {
                let f = transition(step.interval, model);
                x = apply(&f, &x);
                p = sandwich(&f, &p);
                add_noise(&mut p, step.interval, model);
            }
            predicted.push((x, p));
            innovations.push(step.measured.map(|(y, c)| {
                let ph: Vector = std::array::from_fn(|i| p[i][0] + c * p[i][3]);
                let (v, s) = (y - x[0] - c * x[3], ph[0] + c * ph[3] + extra);
                x = std::array::from_fn(|i| x[i] + ph[i] / s * v);
                p = std::array::from_fn(|i| std::array::from_fn(|j| p[i][j] - ph[i] * ph[j] / s));
                squares += v * v / s;
                log_det += s.ln();
                count += 1.0;
                (v, s)
            }));
        }
        // The first three measurements determine the start.
        let freedom = count - 3.0;
        let variance = (squares / freedom).max(1e-12);
        let log_likelihood = -0.5 * (freedom * variance.ln() + log_det);
        Filtered { predicted, innovations, variance, log_likelihood }
    }

    fn smooth(&self, pass: &Filtered, model: Model) -> Backward {
        let n = self.steps.len();
        let (mut states, mut deletion) = (vec![([0.0; 4], [0.0; 4]); n], vec![(0.0, 1.0); n]);
        // Of the frames after k, as seen from the end of frame k.
        let (mut r, mut m): (Vector, Square) = ([0.0; 4], [[0.0; 4]; 4]);
        for k in (0..n).rev() {
            let (step, (x, p)) = (&self.steps[k], &pass.predicted[k]);
            if let (Some((v, s)), Some((_, c))) = (pass.innovations[k], step.measured) {
                let gain: Vector = std::array::from_fn(|i| (p[i][0] + c * p[i][3]) / s);
                let h = [1.0, 0.0, 0.0, c];
                let ahead = apply(&m, &gain);
                let (u, precision) = (v / s - dot(&gain, &r), 1.0 / s + dot(&gain, &ahead));
                deletion[k] = (u / precision, precision.sqrt().recip());
                // (I − K H)ᵀ m (I − K H) + Hᵀ H / s, and r likewise.
                let next = std::array::from_fn(|i| {
                    std::array::from_fn(|j| m[i][j] - h[i] * ahead[j] - ahead[i] * h[j] + h[i] * h[j] * precision)
                });
                r = std::array::from_fn(|i| r[i] + h[i] * u);
                m = next;
            }
            let pr = apply(p, &r);
            let pm = std::array::from_fn::<Vector, 4, _>(|i| {
                let row = apply(&m, &p[i]);
                std::array::from_fn(|j| if i == j { p[i][i] - dot(&p[i], &row) } else { 0.0 })
            });
            states[k] = (std::array::from_fn(|i| x[i] + pr[i]), std::array::from_fn(|i| pm[i][i]));
            if step.interval > 0.0 {
                let f = transposed(&transition(step.interval, model));
                r = apply(&f, &r);
                m = sandwich(&f, &m);
            }
        }
        Backward { states, deletion }
    }
}

fn transition(dt: f64, model: Model) -> Square {
    let kept = if model.correlation > 0.0 { model.correlation.powf(dt) } else { 0.0 };
    [[1.0, dt, 0.5 * dt * dt, 0.0], [0.0, 1.0, dt, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, kept]]
}

/// Adds the covariance of white jerk over an interval, and of the new part of the error.
fn add_noise(p: &mut Square, dt: f64, model: Model) {
    let q = model.jerk;
    let power = |n: i32, by: f64| q * dt.powi(n) / by;
    let noise = [
        [power(5, 20.0), power(4, 8.0), power(3, 6.0)],
        [power(4, 8.0), power(3, 3.0), power(2, 2.0)],
        [power(3, 6.0), power(2, 2.0), power(1, 1.0)],
    ];
    for (row, noise) in p.iter_mut().zip(noise) {
        row.iter_mut().zip(noise).for_each(|(p, q)| *p += q);
    }
    p[3][3] += 1.0 - if model.correlation > 0.0 { model.correlation.powf(2.0 * dt) } else { 0.0 };
}

fn dot(a: &Vector, b: &Vector) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn apply(a: &Square, x: &Vector) -> Vector {
    std::array::from_fn(|i| dot(&a[i], x))
}

fn transposed(a: &Square) -> Square {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// Returns A P Aᵀ.
fn sandwich(a: &Square, p: &Square) -> Square {
    // The rows of P are its columns.
    let ap: Square = transposed(&std::array::from_fn(|j| apply(a, &p[j])));
    std::array::from_fn(|i| std::array::from_fn(|j| dot(&a[j], &ap[i])))
}

/// Returns the median of numbers; 1 if there are none.
pub(super) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(1.0)
}

#[cfg(test)]
mod tests {
    use super::super::linear::{Matrix, invert, times};
    use super::*;
    use foveate_base::rng::Streams;
    use rand::RngExt;
    use rand_distr::StandardNormal;

    /// Irregular times, a gap, unequal errors, one down-weighted measurement.
    fn data() -> (Data, Vec<f64>) {
        let times = [0.0, 0.9, 2.1, 3.0, 4.4, 5.0, 6.0, 7.2];
        let values = [3.0, 4.5, 9.0, 11.0, f64::NAN, 30.0, 37.0, 60.0];
        let sample = |(k, (time, y)): (usize, (f64, f64))| Sample {
            time,
            measured: (!y.is_nan()).then_some((y, [1.0, 0.5, 2.0][k % 3])),
        };
        let samples: Vec<Sample> = times.into_iter().zip(values).enumerate().map(sample).collect();
        (Data::new(&samples).expect("enough"), vec![0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    }

    /// Smoothed states, their variances, the likelihood and the deletion residuals against the joint normal distribution of all states and
    /// measurements, built by brute force.
    #[test]
    fn the_smoother_is_the_joint_normal_distribution() {
        let (data, extra) = data();
        for (jerk, correlation) in [(0.3, 0.0), (1e-3, 0.7)] {
            let model = Model { jerk, correlation, prior: 10.0 };
            let pass = data.filter(model, &extra);
            let smoothed = data.smooth(&pass, model);
            // Cov(xᵢ, xⱼ) for i ≥ j is F(i ← j) Pⱼ.
            let n = data.steps.len();
            let mut p: Square = [[0.0; 4]; 4];
            (0..3).for_each(|i| p[i][i] = model.prior);
            p[3][3] = 1.0;
            let mut joint = std::collections::BTreeMap::new();
            for (j, step) in data.steps.iter().enumerate() {
                if j > 0 {
                    p = sandwich(&transition(step.interval, model), &p);
                    add_noise(&mut p, step.interval, model);
                }
                let mut across = p;
                for (i, later) in data.steps.iter().enumerate().skip(j) {
                    if i > j {
                        let f = transition(later.interval, model);
                        across = std::array::from_fn(|a| std::array::from_fn(|b| dot(&f[a], &transposed(&across)[b])));
                    }
                    joint.insert((j, i), transposed(&across));
                    joint.insert((i, j), across);
                }
            }
            let known: Vec<usize> = (0..n).filter(|k| data.steps[*k].measured.is_some()).collect();
            let (y, c): (Vec<f64>, Vec<f64>) = known.iter().filter_map(|k| data.steps[*k].measured).unzip();
            // Cov(x component a of frame i, measurement m), and between measurements.
            let with = |i: usize, a: usize, m: usize| {
                let row = joint[&(i, known[m])][a];
                row[0] + c[m] * row[3]
            };
            let between = |m: usize, o: usize| {
                let own = if m == o { extra[known[m]] } else { 0.0 };
                with(known[m], 0, o) + c[m] * with(known[m], 3, o) + own
            };
            let all: Matrix = (0..y.len()).map(|m| (0..y.len()).map(|o| between(m, o)).collect()).collect();
            let inverse = invert(&all).expect("positive definite");
            let weights = times(&inverse.matrix, &y);
            for (i, (values, variances)) in smoothed.states.iter().enumerate() {
                for (a, (value, var)) in values.iter().zip(variances).take(3).enumerate() {
                    let row: Vec<f64> = (0..y.len()).map(|m| with(i, a, m)).collect();
                    let mean: f64 = row.iter().zip(&weights).map(|(r, w)| r * w).sum();
                    let variance = joint[&(i, i)][a][a]
                        - row.iter().zip(times(&inverse.matrix, &row)).map(|(r, w)| r * w).sum::<f64>();
                    assert!((value - mean).abs() < 1e-7, "frame {i}, {a}: {value}, {mean}");
                    assert!((var - variance).abs() < 1e-7 * variance, "frame {i}, {a}: {var}, {variance}");
                }
            }
            let square: f64 = y.iter().zip(&weights).map(|(y, w)| y * w).sum();
            let freedom = y.len() as f64 - 3.0;
            assert!((pass.variance - square / freedom).abs() < 1e-8 * pass.variance);
            let log_likelihood = -0.5 * (freedom * pass.variance.ln() + inverse.log_det);
            assert!((pass.log_likelihood - log_likelihood).abs() < 1e-8);
            for (m, k) in known.iter().enumerate() {
                let precision = inverse.matrix[m][m];
                let (off, sd) = smoothed.deletion[*k];
                assert!((off - weights[m] / precision).abs() < 1e-7 && (sd - precision.sqrt().recip()).abs() < 1e-7);
            }
        }
    }

    /// Tracks of the model itself: white jerk, correlated errors of twice the reported deviation, three wild measurements, and a gap.
    fn simulated(seed: u64, wild: bool) -> (Vec<Sample>, Vec<[f64; 3]>) {
        let mut rng = Streams::new(seed, 0).rng(0);
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let (mut state, mut error, mut time) = ([0.0, 1.0, 0.0], normal(), 0.0);
        let (mut samples, mut truth) = (vec![], vec![]);
        for k in 0..120 {
            let dt = if k % 7 == 0 { 0.05 } else { 0.04 };
            time += dt;
            // Many small steps of white jerk of density 4.
            for _ in 0..20 {
                let h: f64 = dt / 20.0;
                state[0] += h * state[1];
                state[1] += h * state[2];
                state[2] += 2.0 * h.sqrt() * normal();
            }
            error = 0.5 * error + 0.75_f64.sqrt() * normal();
            let off = if wild && k % 33 == 20 && k < 100 { 1.0 } else { 0.0 };
            let y = state[0] + 2.0 * 0.01 * error + off;
            samples.push(Sample { time, measured: (!(70..80).contains(&k)).then_some((y, 1e-4)) });
            truth.push(state);
        }
        (samples, truth)
    }

    /// A film that runs backwards has the same errors: those of the first frames are those of the last ones.
    #[test]
    fn time_has_no_direction() {
        let (samples, _) = simulated(3, false);
        let end = samples[samples.len() - 1].time;
        let back: Vec<Sample> =
            samples.iter().rev().map(|sample| Sample { time: end - sample.time, ..*sample }).collect();
        let [there, mut back] = [&samples, &back].map(|samples| smooth(samples).expect("smooth").frames);
        back.reverse();
        for (k, (a, b)) in there.iter().zip(&back).enumerate() {
            for i in 0..3 {
                assert!((a.sd[i] / b.sd[i] - 1.0).abs() < 1e-3, "frame {k}, {i}: {} {}", a.sd[i], b.sd[i]);
                assert!((a.value[i].abs() - b.value[i].abs()).abs() < 0.01 * b.sd[i], "frame {k}, {i}");
            }
        }
    }

    /// 40 tracks with fixed seeds, 4800 frames: the 95 % intervals hold the truth in 90 to 99 % of the frames. Neighbouring frames agree,
    /// so that a track counts as about ten: a share of 0.95 has a standard error of 0.011, and a false alarm a probability below 2e-3 for
    /// each of the six shares.
    #[test]
    fn intervals_hold_the_truth() {
        for wild in [false, true] {
            let (mut inside, mut frames, mut better) = ([0; 3], 0, 0);
            for seed in 0..40 {
                let (samples, truth) = simulated(seed, wild);
                let smoothing = smooth(&samples).expect("smooth");
                let (mut rough, mut fine) = (0.0, 0.0);
                for ((smoothed, truth), sample) in smoothing.frames.iter().zip(&truth).zip(&samples) {
                    frames += 1;
                    for i in 0..3 {
                        inside[i] += usize::from((smoothed.value[i] - truth[i]).abs() < 1.96 * smoothed.sd[i]);
                    }
                    if let Some((y, _)) = sample.measured {
                        rough += (y - truth[0]).powi(2);
                        fine += (smoothed.value[0] - truth[0]).powi(2);
                    }
                }
                better += usize::from(fine < rough);
            }
            let shares = inside.map(|n| n as f64 / frames as f64);
            assert!(shares.iter().all(|share| (0.90..0.99).contains(share)), "wild {wild}: {shares:?}");
            assert!(better >= 38, "wild {wild}: smoothing helped in {better} of 40");
        }
    }

    #[test]
    fn gaps_have_larger_errors_and_wild_measurements_little_weight() {
        let (samples, _) = simulated(3, true);
        let smoothing = smooth(&samples).expect("smooth");
        let sd = |k: usize| smoothing.frames[k].sd[0];
        assert!(sd(75) > 1.2 * sd(60), "{} {}", sd(60), sd(75));
        for k in [20, 53, 86] {
            assert!(smoothing.inflation[k] > 100.0, "{k}: {}", smoothing.inflation[k]);
        }
        assert!(smoothing.inflation.iter().filter(|f| **f > 1.0).count() <= 6);
    }

    #[test]
    fn unusable_samples_are_refused() {
        let sample = |time: f64, y: f64, variance: f64| Sample { time, measured: Some((y, variance)) };
        let line = |n: usize| (0..n).map(|k| sample(k as f64, k as f64, 1.0)).collect::<Vec<_>>();
        assert!(smooth(&line(4)).expect_err("few").to_string().contains("4 frames"));
        let mut still = line(6);
        still[3].time = 2.0;
        assert!(smooth(&still).expect_err("time").to_string().contains("row 4"));
        still[3] = sample(3.0, 1.0, 0.0);
        assert!(smooth(&still).expect_err("variance").to_string().contains("variance 0"));
        // Exact data are smoothed without a division by zero.
        assert!(smooth(&line(9)).expect("a line").frames.iter().all(|f| f.sd.iter().all(|sd| sd.is_finite())));
    }
}
