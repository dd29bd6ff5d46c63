//! The process against direct solves, finite differences, refactoring and fine grids.

use super::*;
use foveate_base::rng::{Purpose, Rng, Streams};
use rand::RngExt;

const KERNELS: [Kernel; 2] = [Kernel::SquaredExponential, Kernel::Matern52];

fn rng(seed: u64) -> Rng {
    Streams::new(seed, 0).at(0, Purpose::Look).rng(0)
}

fn hyper() -> Hyper<2> {
    Hyper { length_scales: [0.3, 0.2], signal_variance: 1.3, noise_variance: 0.05 }
}

fn priors() -> Priors<2> {
    let t = StudentT::new(4.0, 0.3, 0.2, (0.02, 7.0)).expect("a proper prior");
    Priors::new([t; 2], (3e-3, 300.0), (2e-4, 7.0)).expect("proper bounds")
}

/// Two bumps and noise.
fn reward(x: [f64; 2], rng: &mut Rng) -> f64 {
    let bump = |a: f64, b: f64, v: f64, w: f64| (-(x[0] - a).powi(2) / v - (x[1] - b).powi(2) / w).exp();
    bump(0.35, 0.6, 0.04, 0.02) + 0.6 * bump(0.8, 0.2, 0.02, 0.02) + 0.1 * (rng.random::<f64>() - 0.5) - 0.2
}

fn filled(kernel: Kernel, n: usize, window: usize, seed: u64) -> Gp<2> {
    let (mut gp, mut rng) = (Gp::new(kernel, hyper(), window), rng(seed));
    for _ in 0..n {
        let x = [rng.random(), rng.random()];
        gp.push(x, reward(x, &mut rng));
    }
    gp
}

/// The kernels as the paper and the book print them.
fn covariance(kernel: Kernel, h: &Hyper<2>, a: [f64; 2], b: [f64; 2]) -> f64 {
    let r2: f64 = (0..2).map(|d| ((a[d] - b[d]) / h.length_scales[d]).powi(2)).sum();
    let r5 = (5.0 * r2).sqrt();
    match kernel {
        Kernel::SquaredExponential => h.signal_variance * (-0.5 * r2).exp(),
        Kernel::Matern52 => h.signal_variance * (1.0 + r5 + 5.0 * r2 / 3.0) * (-r5).exp(),
    }
}

/// Gauss–Jordan with pivoting: A⁻¹ b for every column of b, and ln |A|.
fn dense(mut a: Vec<Vec<f64>>, mut b: Vec<Vec<f64>>) -> (Vec<Vec<f64>>, f64) {
    let (n, mut log_det) = (a.len(), 0.0);
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs())).expect("a row");
        a.swap(k, pivot);
        b.swap(k, pivot);
        log_det += a[k][k].abs().ln();
        let inverse = 1.0 / a[k][k];
        a[k].iter_mut().chain(&mut b[k]).for_each(|x| *x *= inverse);
        let (row, target) = (a[k].clone(), b[k].clone());
        for i in (0..n).filter(|&i| i != k) {
            let f = a[i][k];
            a[i].iter_mut().zip(&row).for_each(|(x, r)| *x -= f * r);
            b[i].iter_mut().zip(&target).for_each(|(x, r)| *x -= f * r);
        }
    }
    (b, log_det)
}

#[test]
fn posterior_is_that_of_a_direct_solve() {
    for kernel in KERNELS {
        for n in [1, 2, 7, 8, 9, 16, 17, 40] {
            let mut gp = filled(kernel, n, 64, 3);
            let h = *gp.hyper();
            let matrix: Vec<Vec<f64>> = (0..n)
                .map(|i| {
                    let own = |j| if i == j { h.noise_variance + gp.jitter() } else { 0.0 };
                    (0..n).map(|j| covariance(kernel, &h, gp.points()[i], gp.points()[j]) + own(j)).collect()
                })
                .collect();
            let places: Vec<[f64; 2]> = (0..37).map(|i| [f64::from(i % 7) / 5.0, f64::from(i / 7) / 5.0]).collect();
            let k = |point| places.iter().map(move |&p| covariance(kernel, &h, point, p));
            let right: Vec<Vec<f64>> =
                gp.points().iter().zip(gp.values()).map(|(&p, &y)| k(p).chain([y]).collect()).collect();
            let (solved, log_det) = dense(matrix, right.clone());
            let y = |i: usize| right[i][places.len()];
            for (p, place) in places.iter().enumerate() {
                let mean: f64 = (0..n).map(|i| y(i) * solved[i][p]).sum();
                let variance = h.signal_variance - (0..n).map(|i| right[i][p] * solved[i][p]).sum::<f64>();
                let (m, v) = gp.predict(place);
                assert!((m - mean).abs() < 1e-9 && (v - variance).abs() < 1e-9, "{m} {mean} {v} {variance}");
            }
            let fit: f64 = (0..n).map(|i| y(i) * solved[i][places.len()]).sum();
            let lml = -0.5 * fit - 0.5 * log_det - 0.5 * n as f64 * std::f64::consts::TAU.ln();
            assert!((gp.log_marginal_likelihood() - lml).abs() < 1e-9 * (1.0 + lml.abs()));
            let (mut means, mut variances) = (vec![0.0; 37], vec![0.0; 37]);
            for many in [1, 2, 3, 5, 8, 9, 16, 17, 25, 37] {
                gp.predict_many(&places[..many], &mut means[..many], &mut variances[..many]);
                for i in 0..many {
                    assert_eq!((means[i], variances[i]), gp.predict(&places[i]), "{i} of {many}");
                }
            }
        }
    }
}

#[test]
fn one_observation_has_a_closed_form() {
    for kernel in KERNELS {
        let mut gp = Gp::new(kernel, hyper(), 10);
        assert_eq!(gp.predict(&[0.5, 0.5]), (0.0, 1.3));
        assert_eq!(gp.log_marginal_likelihood(), 0.0);
        gp.push([0.5, 0.5], 2.0);
        let (x, all) = ([0.6, 0.4], 1.3 + 0.05 + gp.jitter());
        let k = covariance(kernel, &hyper(), [0.5, 0.5], x);
        let (mean, variance) = gp.predict(&x);
        assert!((mean - k * 2.0 / all).abs() < 1e-14);
        assert!((variance - (1.3 - k * k / all)).abs() < 1e-14);
        let normal = -0.5 * (4.0 / all + (std::f64::consts::TAU * all).ln());
        assert!((gp.log_marginal_likelihood() - normal).abs() < 1e-14);
    }
}

#[test]
fn gradient_is_that_of_differences() {
    for kernel in KERNELS {
        for n in [1, 3, 16, 33] {
            let mut gp = filled(kernel, n, 48, 5);
            let (start, mut g) = (*gp.hyper(), [0.0; 4]);
            gp.log_marginal_likelihood_gradient(&mut g);
            for (i, g) in g.into_iter().enumerate() {
                const STEP: f64 = 1e-5;
                let mut at = |step: f64| {
                    let mut h = start;
                    match i {
                        0 | 1 => h.length_scales[i] *= step.exp(),
                        2 => h.signal_variance *= step.exp(),
                        _ => h.noise_variance *= step.exp(),
                    }
                    gp.set_hyper(h);
                    gp.log_marginal_likelihood()
                };
                let difference = (at(STEP) - at(-STEP)) / (2.0 * STEP);
                assert!((g - difference).abs() < 1e-6 * (1.0 + g.abs()), "{kernel:?}, {n}, {i}: {g} {difference}");
            }
        }
    }
}

/// 300 observations through a window of 45, the values changed and the hyper-parameters fitted on the way.
#[test]
fn growing_and_sliding_leave_the_bits_of_a_process_made_anew() {
    for kernel in KERNELS {
        let (mut gp, mut rng) = (Gp::new(kernel, hyper(), 45), rng(8));
        for t in 0..300 {
            let x = [rng.random(), rng.random()];
            gp.push(x, reward(x, &mut rng));
            if t % 7 == 3 {
                let values: Vec<f64> = gp.values().iter().map(|y| 1.1 * y - 0.01).collect();
                gp.set_values(&values);
            }
            if t % 50 == 20 {
                gp.fit(&priors(), 3);
            }
            if t % 10 == 9 {
                let saved = serde_json::to_string(&gp.save()).expect("numbers");
                let mut anew = Gp::new(kernel, hyper(), 45);
                anew.restore(&serde_json::from_str(&saved).expect("as saved")).expect("as saved");
                assert_eq!(anew.save(), gp.save());
                assert_eq!(anew.log_marginal_likelihood(), gp.log_marginal_likelihood());
                for _ in 0..5 {
                    let x = [rng.random(), rng.random()];
                    assert_eq!(anew.predict(&x), gp.predict(&x), "frame {t}");
                }
                assert_eq!(anew.fit(&priors(), 5), gp.clone().fit(&priors(), 5));
            }
        }
    }
}

#[test]
fn the_fit_is_a_mode_no_worse_than_a_fine_grid() {
    for kernel in KERNELS {
        for (n, seed) in [(6, 1), (15, 2), (30, 3)] {
            let mut gp = filled(kernel, n, 32, seed);
            let start = gp.log_marginal_likelihood() + priors().log_density(gp.hyper());
            let fit = gp.fit(&priors(), 60);
            let found = gp.log_marginal_likelihood() + priors().log_density(gp.hyper());
            assert!(fit.converged && fit.log_posterior >= start, "{fit:?}");
            assert!((found - fit.log_posterior).abs() < 1e-9 * (1.0 + found.abs()));
            // 9⁴ places, evenly spaced in the logarithms, around the mode found and over all of the bounds.
            let (mode, mut other) = (*gp.hyper(), gp.clone());
            let mut best = f64::NEG_INFINITY;
            for i in 0..9usize.pow(4) {
                let step = |axis: u32| ((i / 9usize.pow(axis)) % 9) as f64 - 4.0;
                let near = |x: f64, axis: u32| x * (0.1 * step(axis)).exp();
                let h = Hyper {
                    length_scales: [near(mode.length_scales[0], 0), near(mode.length_scales[1], 1)],
                    signal_variance: near(mode.signal_variance, 2),
                    noise_variance: near(mode.noise_variance, 3),
                };
                let density = priors().log_density(&h);
                if density.is_finite() {
                    other.set_hyper(h);
                    best = best.max(density + other.log_marginal_likelihood());
                }
            }
            assert!(found >= best - 1e-5, "{kernel:?}, {n}: {found} below {best}");
        }
    }
}

#[test]
fn nothing_observed_makes_a_number_that_is_none() {
    let t = StudentT::new(4.0, 0.3, 0.2, (0.02, 7.0)).expect("a proper prior");
    let narrow = priors();
    let wide = Priors::new([t; 2], (1e-12, 1e12), (1e-12, 1e12)).expect("proper bounds");
    type Law = fn(usize, &mut Rng) -> ([f64; 2], f64);
    let laws: [(&str, Law); 8] = [
        ("duplicates", |_, _| ([0.5, 0.5], 1.0)),
        ("duplicates that disagree", |t, _| ([0.5, 0.5], if t % 2 == 0 { 1e6 } else { -1e6 })),
        ("nothing but zeros", |_, rng| ([rng.random(), rng.random()], 0.0)),
        ("constant", |_, rng| ([rng.random(), rng.random()], 3.0)),
        ("huge", |t, rng| ([rng.random(), rng.random()], if t % 3 == 0 { 1e300 } else { -1e300 })),
        ("tiny", |_, rng| ([rng.random(), rng.random()], 1e-300 * rng.random::<f64>())),
        ("far apart", |t, _| ([1e300 * (t as f64 - 5.0), -1e300], t as f64)),
        ("very near", |t, rng| ([1e-14 * t as f64, 0.0], rng.random())),
    ];
    for kernel in KERNELS {
        for (name, law) in laws {
            for noise in [0.0, 1e-300, 1.0, f64::NAN] {
                let (mut gp, mut rng) = (Gp::new(kernel, Hyper { noise_variance: noise, ..hyper() }, 24), rng(12));
                for t in 0..40 {
                    let (x, y) = law(t, &mut rng);
                    assert!(gp.push(x, y));
                    if t % 8 == 7 {
                        gp.fit(if t % 16 == 7 { &wide } else { &narrow }, 10);
                    }
                    for x in [[0.5, 0.5], x, [f64::NAN, 0.0], [f64::INFINITY, -1e300]] {
                        let (mean, variance) = gp.predict(&x);
                        assert!(mean.is_finite() && variance.is_finite() && variance >= 0.0, "{kernel:?}, {name}");
                    }
                    let mut g = [0.0; 4];
                    gp.log_marginal_likelihood_gradient(&mut g);
                    assert!(gp.log_marginal_likelihood().is_finite() && g.iter().all(|g| g.is_finite()), "{name}");
                    let Hyper { length_scales: [a, b], signal_variance, noise_variance } = *gp.hyper();
                    assert!([a, b, signal_variance, noise_variance].iter().all(|h| h.is_finite()), "{name}");
                }
            }
        }
        let mut gp = filled(kernel, 5, 8, 1);
        let before = gp.save();
        assert!(!gp.push([f64::NAN, 0.0], 1.0) && !gp.push([0.0, 0.0], f64::INFINITY));
        assert_eq!(gp.save(), before);
    }
}

#[test]
fn priors_integrate_to_one() {
    for (nu, location, scale, bounds) in
        [(4.0, 0.3, 0.2, (0.02, 7.0)), (1.0, 3.5, 1.2, (0.7, 17.5)), (30.0, -2.0, 0.1, (0.5, 0.6))]
    {
        let prior = StudentT::new(nu, location, scale, bounds).expect("a proper prior");
        const STEPS: usize = 100_000;
        let step = (bounds.1 - bounds.0) / STEPS as f64;
        let mass: f64 = (0..STEPS).map(|i| step * prior.log_density(bounds.0 + (i as f64 + 0.5) * step).exp()).sum();
        assert!((mass - 1.0).abs() < 1e-6, "{mass}");
        for l in [bounds.0 * 1.05, 0.5 * (bounds.0 + bounds.1)] {
            let at = |step: f64| prior.log_density(l * step.exp());
            let (first, second) = prior.derivatives(l);
            assert!((first - (at(1e-5) - at(-1e-5)) / 2e-5).abs() < 1e-6 * (1.0 + first.abs()));
            let bend = (at(1e-3) - 2.0 * at(0.0) + at(-1e-3)) / 1e-6;
            assert!((second - bend).abs() < 1e-3 * (1.0 + second.abs()), "{second} {bend}");
        }
        assert_eq!(prior.log_density(bounds.1 * 1.01), f64::NEG_INFINITY);
    }
    assert!(StudentT::new(0.0, 1.0, 1.0, (0.1, 1.0)).is_err());
    assert!(StudentT::new(4.0, f64::NAN, 1.0, (0.1, 1.0)).is_err());
    assert!(StudentT::new(4.0, 1.0, 1.0, (0.0, 1.0)).is_err());
    assert!(Priors::new([], (1.0, 1.0), (0.1, 1.0)).is_err());
}

/// Seed 4, 60 observations: the surface at unobserved places; 1 in 10⁴ predictions lies beyond 4 deviations.
#[test]
fn the_fitted_surface_predicts_unseen_points() {
    let (mut gp, mut rng) = (filled(Kernel::SquaredExponential, 60, 60, 4), rng(4));
    gp.fit(&priors(), 50);
    let (mut wrong, mut spread) = (0.0, 0.0);
    for _ in 0..200 {
        let x = [rng.random(), rng.random()];
        let (y, (mean, _)) = (reward(x, &mut rng), gp.predict(&x));
        wrong += (y - mean).powi(2);
        spread += (y + 0.05f64).powi(2);
    }
    assert!(wrong < 0.2 * spread, "{wrong} of {spread}");
}
