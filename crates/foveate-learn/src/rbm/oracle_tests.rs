//! Small machines against full enumeration of their states.

use super::likelihood::{ais, exact_log_z, mean_log_likelihood};
use super::monitor::{mean_free_energy, pseudo_log_likelihood};
use super::*;
use crate::training::Training;
use foveate_base::rng::Streams;
use foveate_base::rows::{Rows, RowsMut};
use rand::RngExt;

fn small(visible: Visible, n_v: usize, n_h: usize, scale: f32) -> Rbm {
    let mut rng = Streams::new(11, 0).rng(0);
    let mut draw = |n: usize| (0..n).map(|_| scale * (2.0 * rng.random::<f32>() - 1.0)).collect::<Vec<_>>();
    Rbm::new(visible, draw(n_v * n_h), draw(n_v), draw(n_h)).expect("finite and of the right shape")
}

fn bits(state: usize, n: usize) -> Vec<f32> {
    (0..n).map(|i| (state >> i & 1) as f32).collect()
}

fn h_from_v(rbm: &Rbm, v: &[f32]) -> Vec<f32> {
    let mut h = vec![0.0; rbm.shape().1];
    rbm.h_from_v(Rows::new(v, v.len()), RowsMut::new(&mut h, rbm.shape().1));
    h
}

fn v_from_h(rbm: &Rbm, h: &[f32]) -> Vec<f32> {
    let mut v = vec![0.0; rbm.shape().0];
    rbm.v_from_h(Rows::new(h, h.len()), RowsMut::new(&mut v, rbm.shape().0));
    v
}

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() < tolerance, "{a} is not {b}");
}

#[test]
fn binary_conditionals_and_free_energies_are_those_of_the_joint() {
    let (n_v, n_h) = (5, 4);
    let rbm = small(Visible::Bernoulli, n_v, n_h, 1.5);
    let p = |v: usize, h: usize| (-rbm.energy(&bits(v, n_v), &bits(h, n_h))).exp();
    let p_v = |v: usize| (0..1 << n_h).map(|h| p(v, h)).sum::<f64>();
    let p_h = |h: usize| (0..1 << n_v).map(|v| p(v, h)).sum::<f64>();
    let z: f64 = (0..1 << n_v).map(p_v).sum();
    close(exact_log_z(&rbm).expect("few units"), z.ln(), 1e-9);
    let mut sum = 0.0;
    for v in 0..1 << n_v {
        close(rbm.free_energy(&bits(v, n_v)), -p_v(v).ln(), 1e-9);
        for (j, got) in h_from_v(&rbm, &bits(v, n_v)).into_iter().enumerate() {
            let on: f64 = (0..1 << n_h).filter(|h| h >> j & 1 == 1).map(|h| p(v, h)).sum();
            close(got.into(), on / p_v(v), 1e-6);
        }
        let row = bits(v, n_v);
        let pseudo: f64 = (0..n_v).map(|i| (p_v(v) / (p_v(v) + p_v(v ^ 1 << i))).ln()).sum();
        close(pseudo_log_likelihood(&rbm, Rows::new(&row, n_v)).expect("binary units"), pseudo, 1e-5);
        close(mean_free_energy(&rbm, Rows::new(&row, n_v)), -p_v(v).ln(), 1e-5);
        sum += mean_log_likelihood(&rbm, Rows::new(&row, n_v), z.ln()).exp();
    }
    close(sum, 1.0, 1e-9);
    for h in 0..1 << n_h {
        for (i, got) in v_from_h(&rbm, &bits(h, n_h)).into_iter().enumerate() {
            let on: f64 = (0..1 << n_v).filter(|v| v >> i & 1 == 1).map(|v| p(v, h)).sum();
            close(got.into(), on / p_h(h), 1e-6);
        }
    }
}

/// Between 0 and 1 the pseudo-likelihood weighs the two free energies of the flipped unit.
#[test]
fn soft_pseudo_likelihood_is_its_definition() {
    let rbm = small(Visible::Bernoulli, 4, 6, 1.5);
    let v = [0.25, 1.0, 0.0, 0.7];
    let expected: f64 = (0..4)
        .map(|i| {
            let with = |x: f32| {
                let mut v = v;
                v[i] = x;
                (-rbm.free_energy(&v)).exp()
            };
            let p = with(1.0) / (with(0.0) + with(1.0));
            f64::from(v[i]) * p.ln() + (1.0 - f64::from(v[i])) * (1.0 - p).ln()
        })
        .sum();
    close(pseudo_log_likelihood(&rbm, Rows::new(&v, 4)).expect("binary units"), expected, 1e-5);
}

#[test]
fn gaussian_conditionals_free_energies_and_partition() {
    let (n_v, n_h) = (3, 4);
    let rbm = small(Visible::Gaussian, n_v, n_h, 1.0);
    let v = [0.3, -1.2, 2.0];
    let p = |h: usize| (-rbm.energy(&v, &bits(h, n_h))).exp();
    let total: f64 = (0..1 << n_h).map(p).sum();
    close(rbm.free_energy(&v), -total.ln(), 1e-9);
    for (j, got) in h_from_v(&rbm, &v).into_iter().enumerate() {
        close(got.into(), (0..1 << n_h).filter(|h| h >> j & 1 == 1).map(p).sum::<f64>() / total, 1e-6);
    }
    // Given h the energy is ½‖v − mean‖² and a constant.
    for h in (0..1 << n_h).map(|h| bits(h, n_h)) {
        let mean = v_from_h(&rbm, &h);
        let d: f64 = mean.iter().zip(v).map(|(m, v)| f64::from(m - v).powi(2)).sum();
        close(rbm.energy(&v, &h) - rbm.energy(&mean, &h), 0.5 * d, 1e-5);
    }
    // With one visible unit, Z is an integral over a line.
    let line = small(Visible::Gaussian, 1, 4, 1.5);
    let sum: f64 = (-2000..2000).map(|i| (-line.free_energy(&[i as f32 * 0.01])).exp() * 0.01).sum();
    close(exact_log_z(&line).expect("few units"), sum.ln(), 1e-5);
}

/// Data for learning: rows near two prototypes.
fn data(visible: Visible, n_v: usize, rows: usize) -> Vec<f32> {
    let mut rng = Streams::new(12, 0).rng(0);
    (0..rows * n_v)
        .map(|e| {
            let on = (e / n_v).is_multiple_of(2) == (e % n_v < n_v / 2);
            match visible {
                Visible::Bernoulli => f32::from(u8::from(rng.random::<f32>() < if on { 0.8 } else { 0.3 })),
                Visible::Gaussian => f32::from(i8::from(on)) + rng.random::<f32>() - 0.8,
            }
        })
        .collect()
}

/// (weights, visible biases, hidden biases) of a gradient, all in one row.
fn flat(rbm: &Rbm) -> Vec<f64> {
    [rbm.weights().data(), rbm.visible_bias(), rbm.hidden_bias()].concat().into_iter().map(f64::from).collect()
}

/// Adds `p` times the statistics (v hᵀ, v, h).
fn add_statistics(out: &mut [f64], p: f64, v: &[f32], h: &[f32]) {
    let (n_v, n_h) = (v.len(), h.len());
    for (i, v) in v.iter().enumerate() {
        (0..n_h).for_each(|j| out[i * n_h + j] += p * f64::from(v * h[j]));
        out[n_v * n_h + i] += p * f64::from(*v);
    }
    (0..n_h).for_each(|j| out[n_v * n_h + n_v + j] += p * f64::from(h[j]));
}

/// The exact gradient of the mean log-likelihood: the data's statistics minus the model's.
fn exact_gradient(rbm: &Rbm, rows: Rows<'_>) -> Vec<f64> {
    let (n_v, n_h) = rbm.shape();
    let mut g = vec![0.0; n_v * n_h + n_v + n_h];
    rows.iter().for_each(|v| add_statistics(&mut g, 1.0 / rows.len() as f64, v, &h_from_v(rbm, v)));
    let log_z = exact_log_z(rbm).expect("few units");
    for h in (0..1 << n_h).map(|h| bits(h, n_h)) {
        match rbm.visible() {
            Visible::Bernoulli => (0..1 << n_v).map(|v| bits(v, n_v)).for_each(|v| {
                add_statistics(&mut g, -(-rbm.energy(&v, &h) - log_z).exp(), &v, &h);
            }),
            // p(h) = exp(−E(mean, h)) (2π)^(n_v / 2) / Z, and E[v | h] is the mean.
            Visible::Gaussian => {
                let mean = v_from_h(rbm, &h);
                let p = -rbm.energy(&mean, &h) + 0.5 * n_v as f64 * std::f64::consts::TAU.ln() - log_z;
                add_statistics(&mut g, -p.exp(), &mean, &h);
            }
        }
    }
    g
}

fn with_parameter(rbm: &Rbm, k: usize, change: f32) -> Rbm {
    let mut rbm = rbm.clone();
    let (w, b) = (rbm.weights.len(), rbm.visible_bias.len());
    let x = if k < w {
        &mut rbm.weights[k]
    } else if k < w + b {
        &mut rbm.visible_bias[k - w]
    } else {
        &mut rbm.hidden_bias[k - w - b]
    };
    *x += change;
    rbm
}

#[test]
fn the_gradient_is_the_slope_of_the_exact_log_likelihood() {
    for visible in [Visible::Bernoulli, Visible::Gaussian] {
        let (rbm, data) = (small(visible, 5, 3, 0.7), data(visible, 5, 10));
        let rows = Rows::new(&data, 5);
        let at = |rbm: &Rbm| mean_log_likelihood(rbm, rows, exact_log_z(rbm).expect("few units"));
        for (k, slope) in exact_gradient(&rbm, rows).into_iter().enumerate() {
            let (up, down) = (with_parameter(&rbm, k, 0.004), with_parameter(&rbm, k, -0.004));
            close((at(&up) - at(&down)) / 0.008, slope, 2e-4);
        }
    }
}

/// One step of rate 1 from the same machine, many times with other seeds: mean and standard error of the change.
fn mean_step(rbm: &Rbm, rows: Rows<'_>, negative: Negative, trials: u64) -> Vec<(f64, f64)> {
    let before = flat(rbm);
    let mut sums = vec![(0.0, 0.0); before.len()];
    for seed in 0..trials {
        let recipe = Recipe {
            rate: 1.0,
            momentum: 0.0,
            l2: 0.0,
            batch: rows.len(),
            negative,
            seed,
            ..Recipe::new(rbm.visible(), rbm.shape().1)
        };
        let mut trainer = Trainer::from_rbm(recipe, rbm.clone(), rows).expect("a recipe in range");
        trainer.step(rows);
        for ((s, after), before) in sums.iter_mut().zip(flat(&trainer.learned())).zip(&before) {
            *s = (s.0 + (after - before), s.1 + (after - before).powi(2));
        }
    }
    let n = trials as f64;
    sums.into_iter().map(|(s, q)| (s / n, ((q / n - (s / n).powi(2)).max(0.0) / n).sqrt())).collect()
}

/// CD-1 against its own expectation: every first hidden state, weighted. 5 sd for 30 numbers: a false alarm in 10⁵ seeds.
#[test]
fn cd_1_has_the_expectation_of_cd_1() {
    for visible in [Visible::Bernoulli, Visible::Gaussian] {
        let (n_v, n_h) = (5, 4);
        let (rbm, data) = (small(visible, n_v, n_h, 0.7), data(visible, n_v, 6));
        let rows = Rows::new(&data, n_v);
        let mut expected = vec![0.0; n_v * n_h + n_v + n_h];
        for v in rows.iter() {
            let p = h_from_v(&rbm, v);
            add_statistics(&mut expected, 1.0 / 6.0, v, &p);
            for h in (0..1 << n_h).map(|h| bits(h, n_h)) {
                let p: f64 = h.iter().zip(&p).map(|(&h, &p)| f64::from(if h > 0.0 { p } else { 1.0 - p })).product();
                let back = v_from_h(&rbm, &h);
                add_statistics(&mut expected, -p / 6.0, &back, &h_from_v(&rbm, &back));
            }
        }
        let got = mean_step(&rbm, rows, Negative::Contrastive { steps: 1 }, 2000);
        for ((mean, se), expected) in got.into_iter().zip(expected) {
            assert!((mean - expected).abs() < 5.0 * se + 1e-6, "{mean} ± {se} is not {expected}");
        }
    }
}

/// Chains run long before their first use are at equilibrium, where SML's step is the gradient of the log-likelihood.
#[test]
fn sml_has_the_expectation_of_the_gradient() {
    for visible in [Visible::Bernoulli, Visible::Gaussian] {
        let (rbm, data) = (small(visible, 5, 4, 0.7), data(visible, 5, 6));
        let rows = Rows::new(&data, 5);
        let got = mean_step(&rbm, rows, Negative::Persistent { chains: 40, steps: 50 }, 100);
        for ((mean, se), expected) in got.into_iter().zip(exact_gradient(&rbm, rows)) {
            assert!((mean - expected).abs() < 5.0 * se + 1e-6, "{mean} ± {se} is not {expected}");
        }
    }
}

/// 5 standard errors, which AIS itself reports: a false alarm in 10⁶ seeds, were the weights normal; they are close.
#[test]
fn ais_finds_the_exact_partition_function() {
    for visible in [Visible::Bernoulli, Visible::Gaussian] {
        let rbm = small(visible, 30, 10, 0.6);
        let exact = exact_log_z(&rbm).expect("few units");
        let base = vec![0.1; 30];
        let found = ais(&rbm, &base, 200, 400, 3).expect("binary units");
        assert!(found.effective_chains > 60.0 && found.standard_error < 0.1, "{found:?}");
        assert!((found.log_z - exact).abs() < 5.0 * found.standard_error, "{found:?} is not {exact}");
    }
}

#[test]
fn learning_raises_the_exact_log_likelihood_and_does_not_depend_on_threads() {
    for (visible, negative) in [
        (Visible::Bernoulli, Negative::Contrastive { steps: 1 }),
        (Visible::Bernoulli, Negative::Persistent { chains: 20, steps: 1 }),
        (Visible::Gaussian, Negative::Contrastive { steps: 2 }),
        (Visible::Gaussian, Negative::Persistent { chains: 20, steps: 1 }),
    ] {
        let data = data(visible, 12, 205);
        let rows = Rows::new(&data, 12);
        let recipe = Recipe {
            epochs: 60,
            batch: 20,
            rate: 0.2,
            negative,
            l1: 1e-5,
            average_from: Some(40),
            initial_sd: 0.1,
            ..Recipe::new(visible, 8)
        };
        let train = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                let mut trainer = Trainer::new(recipe.clone(), rows).expect("a recipe in range");
                let begun = trainer.learned();
                while !trainer.is_done() {
                    trainer.epoch(rows);
                }
                (begun, trainer.learned())
            })
        };
        let (begun, learned) = train(1);
        let at = |rbm: &Rbm| mean_log_likelihood(rbm, rows, exact_log_z(rbm).expect("few units"));
        assert!(at(&learned) > at(&begun) + 0.3, "{visible:?} {negative:?}: from {} to {}", at(&begun), at(&learned));
        assert_eq!(learned, train(2).1);
        assert_eq!(learned, train(8).1);
    }
}

#[test]
fn sparsity_brings_activity_to_its_target() {
    let data = data(Visible::Gaussian, 12, 200);
    let rows = Rows::new(&data, 12);
    let sparsity = Some(Sparsity { target: 0.1, cost: 3.0 });
    let recipe = Recipe { epochs: 30, batch: 20, rate: 0.05, sparsity, ..Recipe::new(Visible::Gaussian, 8) };
    let mut trainer = Trainer::new(recipe, rows).expect("a recipe in range");
    while !trainer.is_done() {
        trainer.epoch(rows);
    }
    let mut h = vec![0.0; 200 * 8];
    trainer.learned().h_from_v(rows, RowsMut::new(&mut h, 8));
    let mean = h.iter().sum::<f32>() / h.len() as f32;
    assert!((mean - 0.1).abs() < 0.03, "{mean}");
}

#[test]
fn bad_recipes_and_data_are_refused() {
    let rows = [0.5; 12];
    let rows = Rows::new(&rows, 4);
    let good = Recipe::new(Visible::Bernoulli, 3);
    assert!(Trainer::new(good.clone(), rows).is_ok());
    for bad in [
        Recipe { hidden: 0, ..good.clone() },
        Recipe { hidden: 1 << 30, ..good.clone() },
        Recipe { batch: 0, ..good.clone() },
        Recipe { momentum: 1.0, ..good.clone() },
        Recipe { rate: f32::NAN, ..good.clone() },
        Recipe { l2: -1.0, ..good.clone() },
        Recipe { sparsity: Some(Sparsity { target: 1.0, cost: 1.0 }), ..good.clone() },
        Recipe { negative: Negative::Persistent { chains: 0, steps: 1 }, ..good.clone() },
    ] {
        assert!(Trainer::new(bad.clone(), rows).is_err(), "{bad:?}");
    }
    assert!(Trainer::new(good.clone(), Rows::new(&[], 4)).is_err());
    let message = Trainer::new(good, Rows::new(&[0.0, 0.5, 1.0, 2.0], 2)).unwrap_err().to_string();
    assert!(message.contains("row 1, value 1 of the training data is 2"), "{message}");
}

/// The tracker's requirement of an encoder: any split of a batch gives the same features.
#[test]
fn a_row_does_not_depend_on_its_neighbours() {
    for visible in [Visible::Bernoulli, Visible::Gaussian] {
        let rbm = small(visible, 132, 77, 0.5);
        let (data, n_h) = (data(visible, 132, 105), 77);
        let all = Rows::new(&data, 132);
        let (mut h, mut v) = (vec![0.0; 105 * n_h], vec![0.0; 105 * 132]);
        rbm.h_from_v(all, RowsMut::new(&mut h, n_h));
        rbm.v_from_h(Rows::new(&h, n_h), RowsMut::new(&mut v, 132));
        for i in 0..105 {
            assert_eq!(h_from_v(&rbm, all.row(i)), h[i * n_h..][..n_h]);
            assert_eq!(v_from_h(&rbm, &h[i * n_h..][..n_h]), v[i * 132..][..132]);
        }
    }
}
