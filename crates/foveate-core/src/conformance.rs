//! Conformance tests of the extension points, as functions that the tests of every implementation call.
//!
//! Each panics with the rule that does not hold. Random checks state how often they would fail a correct implementation.

mod detector;
mod dynamics;
mod proposal;
mod regions;

pub use self::detector::detector;
pub use self::dynamics::dynamics;
pub use self::proposal::{proposal, proposal_weights};
pub use self::regions::regions;

use crate::control::{Resampling, Reward};
use crate::gaze::{Context, Plan, Policy, PolicySnapshot};
use crate::geometry::{Extent, Gaze, State};
use crate::identity::pyramid::Region;
use crate::identity::{Appearance, Distance, Encoder, Percept, Pyramid, Retina};
use crate::scene::Image;
use foveate_base::rng::{Purpose, Rng, Streams};
use foveate_base::rows::{Rows, RowsMut};
use rand::RngExt;
use rand_distr::StandardNormal;

mod recognizer;
pub use self::recognizer::recognizer;

/// Random streams for checks, with a fixed name.
fn checks() -> Streams {
    Streams::new(0, 0).at(0, Purpose::Scene)
}

fn normal(rng: &mut Rng) -> f64 {
    rng.sample(StandardNormal)
}

/// Panics if the mean of `values` is further than 5 standard errors from `exact` (less than 1 in 10⁶ is).
fn assert_mean(values: &[f64], exact: f64, what: &str) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let allowed = 5.0 * (variance / n).sqrt() + 1e-9;
    assert!((mean - exact).abs() < allowed, "{what}: {mean} is not {exact} ± {allowed}");
}

/// Returns an empty scene, for proposals and other components that do not read it.
pub fn blank_image() -> Image {
    Image::grey(1, 1, 0)
}

/// Checks that particle i gets m·wᵢ places on average, that ancestors ascend, and that weight 0 gets none.
///
/// Runs 4,000 rounds. For every scheme the variance of a count is at most the multinomial one; a correct scheme deviates by more than 5
/// standard deviations less than once in 10⁶.
pub fn resampling(resampling: &Resampling, weights: &[f64], places: usize) {
    const ROUNDS: usize = 4000;
    let (mut rng, mut ancestors, mut counts) = (checks().rng(3), vec![0; places], vec![0usize; weights.len()]);
    for _ in 0..ROUNDS {
        resampling.select(weights, &mut ancestors, &mut rng);
        assert!(ancestors.is_sorted(), "ancestors must ascend");
        ancestors.iter().for_each(|&a| counts[a] += 1);
    }
    let total: f64 = weights.iter().sum();
    for (i, (&count, w)) in counts.iter().zip(weights).enumerate() {
        let w = w / total;
        assert!(w > 0.0 || count == 0, "particle {i} has no weight, but {count} children");
        let n = (ROUNDS * places) as f64;
        let (mean, sd) = (n * w, (n * w * (1.0 - w)).sqrt());
        let slack = 5.0 * sd + if mean < 30.0 { 10.0 } else { 1e-6 }; // too few for a normal distribution
        assert!((count as f64 - mean).abs() <= slack, "particle {i} has {count} children, not {mean} ± {slack}");
    }
}

/// Checks that rewards are in [0, 1], depend neither on the order of the particles nor on constants added to logarithms, and are the same
/// for the same weights.
pub fn reward(reward: &mut dyn Reward) {
    let mut rng = checks().rng(4);
    let (believed, extent) = (State { x: 3.0, ..State::default() }, Extent { half_w: 20.0, half_h: 15.0 });
    for (n, sharpness) in [(1, 1.0), (2, 0.0), (2, 5.0), (50, 0.1), (50, 3.0), (1000, 1.0), (1000, 300.0)] {
        let mut states: Vec<State> =
            (0..n).map(|_| State::from_array(std::array::from_fn(|_| 10.0 * normal(&mut rng)))).collect();
        let mut prior: Vec<f64> = (0..n).map(|_| normal(&mut rng)).collect();
        let mut likelihood: Vec<f64> = (0..n).map(|_| sharpness * normal(&mut rng)).collect();
        let first = reward.reward(&states, &prior, &likelihood, (&believed, extent));
        assert!((0.0..=1.0).contains(&first), "a reward is from 0 to 1, not {first} (n = {n})");
        assert_eq!(
            first,
            reward.reward(&states, &prior, &likelihood, (&believed, extent)),
            "a reward must not remember"
        );

        let mut agrees = |what: &str, s: &[State], p: &[f64], l: &[f64]| {
            let second = reward.reward(s, p, l, (&believed, extent));
            assert!((first - second).abs() < 1e-9, "a reward must not depend on {what}: {first}, {second}");
        };
        let shifted = |values: &[f64], by: f64| -> Vec<f64> { values.iter().map(|v| v + by).collect() };
        agrees("a constant in the prior", &states, &shifted(&prior, 7.5), &likelihood);
        agrees("a constant in the likelihood", &states, &prior, &shifted(&likelihood, -60.5));
        states.reverse();
        prior.reverse();
        likelihood.reverse();
        agrees("the particles' order", &states, &prior, &likelihood);

        likelihood[0] = f64::NEG_INFINITY;
        let one_out = reward.reward(&states, &prior, &likelihood, (&believed, extent));
        likelihood.fill(f64::NEG_INFINITY);
        let all_out = reward.reward(&states, &prior, &likelihood, (&believed, extent));
        for r in [one_out, all_out] {
            assert!((0.0..=1.0).contains(&r), "a reward is from 0 to 1, not {r}, where particles explain nothing");
        }
    }
}

/// Checks that plans are not empty and use a gaze, and that the same randomness gives the same plan. A policy that loads a saved state
/// from JSON text must continue bit for bit; a state that does not fit must be an error and change nothing; `reset` must reset everything.
///
/// `make` returns new policies of the same settings.
pub fn policy(make: &dyn Fn() -> Box<dyn Policy>) {
    let (mut a, mut b) = (make(), make());
    let untouched = a.save();
    play(&mut *a, &mut *b, 0..40);

    let saved = a.save();
    let text = serde_json::to_string(&saved).expect("a JSON value is text");
    let mut resumed = make();
    resumed.load(&serde_json::from_str(&text).expect("what was written can be read")).expect("what was saved fits");
    assert_eq!(resumed.save(), saved, "what was loaded must be what was saved");
    play(&mut *a, &mut *resumed, 40..80);

    let saved = a.save();
    for rubbish in ["{\"rubbish\": 1}", "[]", "\"a\"", "7"] {
        let rubbish = serde_json::from_str(rubbish).expect("valid JSON");
        assert!(a.load(&rubbish).is_err(), "{rubbish} must be refused");
        assert_eq!(a.save(), saved, "a refused load must change nothing");
    }
    a.reset();
    assert_eq!(a.save(), untouched, "reset must forget all that was learned");
    play(&mut *a, &mut *make(), 0..10);
}

/// Runs two policies side by side on the same randomness and rewards, and checks that their plans are equal.
fn play(a: &mut dyn Policy, b: &mut dyn Policy, frames: std::ops::Range<u64>) {
    let (mut plan, mut other) = (Plan::new(), Plan::new());
    for t in frames {
        let context = if t == 0 { Context::default() } else { context(&mut checks().rng(2000 + t)) };
        a.plan(&context, &mut plan, &mut checks().rng(t));
        b.plan(&context, &mut other, &mut checks().rng(t));
        assert_eq!(plan, other, "the same past and randomness must give the same plan (frame {t})");
        assert!(plan.used().next().is_some(), "a plan must use one gaze at least");
        assert!(plan.gazes().iter().all(|g| g.u.is_finite() && g.v.is_finite()), "a gaze is a place");
        let mut rng = checks().rng(1000 + t);
        let rewards: Vec<f64> = plan.gazes().iter().map(|_| rng.random()).collect();
        a.learn(&plan, &rewards);
        b.learn(&other, &rewards);
        assert_eq!(a.save(), b.save(), "the same past must leave the same memory (frame {t})");
        match a.snapshot() {
            PolicySnapshot::Blank => {}
            PolicySnapshot::Arms { gazes, probabilities } => {
                assert_eq!(gazes.len(), probabilities.len(), "one probability for each gaze");
                let sum: f64 = probabilities.iter().sum();
                let one = (sum - 1.0).abs() < 1e-9 && probabilities.iter().all(|&p| p >= 0.0);
                assert!(one, "probabilities sum to {sum}");
            }
            PolicySnapshot::Surface(surface) => {
                let inside = |g: &Gaze| g.u.abs().max(g.v.abs()) <= surface.reach() + 1e-12;
                assert!(surface.fixations().iter().all(inside), "a surface is learned from gazes within its reach");
                assert!(surface.best().iter().all(inside), "the best gaze is within reach");
                for (u, v) in [(0.0, 0.0), (surface.reach(), -surface.reach())] {
                    let (mean, sd) = surface.at(u, v);
                    assert!(mean.is_finite() && sd >= 0.0 && sd.is_finite(), "at ({u}, {v}): {mean} ± {sd}");
                }
            }
        }
    }
}

/// Returns a random context.
fn context(rng: &mut Rng) -> Context {
    let [ess, deficit, frame_deficit, spread] = std::array::from_fn(|_| rng.random());
    Context { ess, deficit, frame_deficit, spread, lost: deficit > 0.6 }
}

/// Checks that every feature is finite and depends on its own row alone, bit for bit, for any number of rows at once, and that the groups
/// of features cover all features.
///
/// `glimpses` are conditioned rows, at least three.
pub fn encoder(encoder: &dyn Encoder, glimpses: &[f32]) {
    let (n_v, n_h) = encoder.shape();
    assert_eq!(encoder.parts().iter().sum::<usize>(), n_h, "the parts of a feature vector are all of it");
    let encode = |glimpses: &[f32]| {
        let mut features = vec![f32::NAN; glimpses.len() / n_v * n_h];
        encoder.encode(Rows::new(glimpses, n_v), RowsMut::new(&mut features, n_h));
        features
    };
    let together = encode(glimpses);
    assert!(together.iter().all(|h| h.is_finite()), "features must be finite");
    for rows in [1, 2, 3] {
        for (v, h) in glimpses.chunks_exact(rows * n_v).zip(together.chunks_exact(rows * n_h)) {
            assert!(h == encode(v), "a row's features must not depend on its neighbours ({rows} rows)");
        }
    }
    let (mut once, mut again) = (glimpses[..n_v].to_vec(), glimpses[..n_v].to_vec());
    encoder.condition(&mut once);
    encoder.condition(&mut again);
    assert!(once == again && once.iter().all(|v| v.is_finite()), "conditioning must not remember");
}

/// Checks that the distance is finite, at least 0, the same on each call, and near 0 from a vector to itself.
///
/// `features` are rows of `width` values that suit the distance.
pub fn distance(distance: &dyn Distance, features: &[f32], width: usize) {
    for template in features.chunks_exact(width) {
        let mut kept = template.to_vec();
        distance.keep(&mut kept);
        for row in features.chunks_exact(width) {
            let d = distance.distance(row, &kept);
            assert!(d >= 0.0 && d.is_finite(), "a distance is at least 0 and finite, not {d}");
            assert_eq!(d, distance.distance(row, &kept), "a distance must not remember");
        }
        let own = distance.distance(template, &kept);
        // Rounding of a sum of squares leaves 1e-7, and its root 3e-4. The distance of zero vectors is arbitrary.
        assert!(own < 1e-3 || template.iter().all(|&t| t == 0.0), "{own} from a vector to itself");
    }
}

/// Checks that all cells are written, with values in [0, 1], and that on a uniform grey picture every grey cell has that grey.
pub fn retina(retina: &dyn Retina) {
    let n = retina.glimpse_len();
    assert_eq!(n, retina.cells().len(), "one cell for each value");
    let reach = retina.footprints().iter().map(|f| f.reach).fold(0.0, f64::max);
    assert!(retina.cells().iter().all(|c| c.u.abs().max(c.v.abs()) <= reach + 1e-9), "cells lie within the reach");
    let mut rng = checks().rng(5);
    let noise: Vec<u8> = (0..40 * 30 * 3).map(|_| rng.random()).collect();
    let noise = Image::new(40, 30, 3, noise).expect("40 x 30 x 3 bytes");
    let extent = Extent { half_w: 7.0, half_h: 5.0 };
    for i in 0..20 {
        let mut at = || 3.0 * normal(&mut rng);
        let state = State {
            x: 20.0 + at(),
            y: 15.0 + at(),
            log_scale: 0.1 * at(),
            angle: at(),
            log_aspect: 0.1 * at(),
            ..State::default()
        };
        let gaze = Gaze { u: 0.1 * at(), v: 0.1 * at(), arm: None };
        let look = |image: &Image, dirt: f32| {
            let region = Region::covering(image, &[state], &[gaze], extent, reach);
            let mut pyramid = Pyramid::default();
            pyramid.build(image, region, retina.footprints(), (extent.half_w, extent.half_h));
            let mut glimpse = vec![dirt; n];
            retina.look(&pyramid, state.fixate(gaze, extent), &mut glimpse);
            glimpse
        };
        let glimpse = look(&noise, f32::NAN);
        assert!(glimpse.iter().all(|v| (-1e-6..=1.0 + 1e-6).contains(v)), "values are from 0 to 1 (look {i})");
        assert!(glimpse == look(&noise, 7.0), "a glimpse must not depend on what the buffer held");
        for (cell, value) in retina.cells().iter().zip(look(&Image::grey(40, 30, 51), 0.0)) {
            assert!(cell.channel != 0 || (value - 0.2).abs() < 1e-5, "one grey is seen as itself, not {value}");
        }
    }
}

/// Checks that a log-likelihood is not NaN, and depends on its own state and gaze alone: not on the other states of the call, on their
/// order, or on the number of threads. An appearance that loads a saved state from JSON text must give the same values, bit for bit; a
/// state that does not fit must be an error.
///
/// `make` returns new appearances of the same settings.
pub fn appearance(make: &dyn Fn() -> Box<dyn Appearance>) {
    const N: usize = 150;
    let mut rng = checks().rng(6);
    let mut picture = || Image::new(60, 50, 1, (0..3000).map(|_| rng.random()).collect()).expect("60 x 50 bytes");
    let (first, second) = (picture(), picture());
    let (target, extent) = (State { x: 30.0, y: 25.0, ..State::default() }, Extent { half_w: 8.0, half_h: 8.0 });
    let states: Vec<State> = (0..N)
        .map(|_| State { x: 30.0 + 3.0 * normal(&mut rng), y: 25.0 + 3.0 * normal(&mut rng), ..target })
        .collect();
    let gazes = [Gaze::CENTRE, Gaze { u: 0.5, v: -0.5, arm: Some(1) }];
    let weigh = |appearance: &mut dyn Appearance, states: &[State], gaze| {
        let mut out = vec![f64::NAN; states.len()];
        appearance.log_likelihood(states, gaze, &mut out);
        assert!(out.iter().all(|l| !l.is_nan()), "a log-likelihood is a number");
        out
    };
    let mut a = make();
    let reference = a.init_template(&first, &target, extent, Streams::new(3, 0));
    assert!(reference.on >= reference.off, "the target fits better than other places");
    a.prepare(&second, &states, &gazes);
    let mut resumed = make();
    let text = serde_json::to_string(&a.save()).expect("a JSON value is text");
    resumed.load(&serde_json::from_str(&text).expect("what was written can be read")).expect("what was saved fits");
    assert_eq!(resumed.save(), a.save(), "what was loaded must be what was saved");
    resumed.prepare(&second, &states, &gazes);
    for gaze in gazes {
        let all = weigh(&mut *a, &states, gaze);
        assert!(all == weigh(&mut *resumed, &states, gaze), "what was loaded must see the same");
        for i in [0, 1, 63, 64, N - 1] {
            assert_eq!(weigh(&mut *a, &states[i..=i], gaze), all[i..=i], "a state must not depend on the others");
        }
        let reversed: Vec<State> = states.iter().rev().copied().collect();
        assert!(weigh(&mut *a, &reversed, gaze).iter().rev().eq(&all), "the order of states must not matter");
        for threads in [1, 3] {
            assert!(
                crate::threads::with(threads, || weigh(&mut *a, &states, gaze)) == all,
                "{threads} threads must see the same"
            );
        }
    }
    for rubbish in ["{\"rubbish\": 1}", "[]", "\"a\"", "7"] {
        let rubbish = serde_json::from_str(rubbish).expect("valid JSON");
        assert!(resumed.load(&rubbish).is_err(), "{rubbish} must be refused");
    }
    a.prepare(&first, &[target], &gazes);
    let mut percept = Percept::default();
    a.glimpse(&target, gazes[1], &mut percept);
    assert!(percept.gaze == gazes[1] && percept.distance < 1e-3, "the template is at no distance from itself");
}
