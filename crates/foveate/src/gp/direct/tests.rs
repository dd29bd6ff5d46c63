//! Published counts of evaluations, exhaustive search, and what may never happen.

use super::*;
use crate::rng::Streams;
use rand::RngExt;
use std::f64::consts::PI;

fn branin([x, y]: &[f64; 2]) -> f64 {
    (y - 5.1 / (4.0 * PI * PI) * x * x + 5.0 / PI * x - 6.0).powi(2) + 10.0 * (1.0 - 0.125 / PI) * x.cos() + 10.0
}

fn goldstein_price([x, y]: &[f64; 2]) -> f64 {
    let a = 19.0 - 14.0 * x + 3.0 * x * x - 14.0 * y + 6.0 * x * y + 3.0 * y * y;
    let b = 18.0 - 32.0 * x + 12.0 * x * x + 48.0 * y - 36.0 * x * y + 27.0 * y * y;
    (1.0 + (x + y + 1.0).powi(2) * a) * (30.0 + (2.0 * x - 3.0 * y).powi(2) * b)
}

fn six_hump_camel([x, y]: &[f64; 2]) -> f64 {
    (4.0 - 2.1 * x * x + x.powi(4) / 3.0) * x * x + x * y + 4.0 * (y * y - 1.0) * y * y
}

fn shubert(x: &[f64; 2]) -> f64 {
    x.iter().map(|x| (1..=5).map(|j| f64::from(j) * (f64::from(j + 1) * x + f64::from(j)).cos()).sum::<f64>()).product()
}

const HEIGHT: [f64; 4] = [1.0, 1.2, 3.0, 3.2];

fn hartmann<const D: usize>(x: &[f64; D], rate: &[[f64; D]; 4], at: &[[f64; D]; 4]) -> f64 {
    let hill = |k: usize| -> f64 {
        let d: f64 = (0..D).map(|i| rate[k][i] * (x[i] - 1e-4 * at[k][i]).powi(2)).sum();
        HEIGHT[k] * (-d).exp()
    };
    -(0..4).map(hill).sum::<f64>()
}

fn hartmann3(x: &[f64; 3]) -> f64 {
    const RATE: [[f64; 3]; 4] = [[3.0, 10.0, 30.0], [0.1, 10.0, 35.0], [3.0, 10.0, 30.0], [0.1, 10.0, 35.0]];
    const AT: [[f64; 3]; 4] =
        [[3689.0, 1170.0, 2673.0], [4699.0, 4387.0, 7470.0], [1091.0, 8732.0, 5547.0], [381.5, 5743.0, 8828.0]];
    hartmann(x, &RATE, &AT)
}

fn hartmann6(x: &[f64; 6]) -> f64 {
    const RATE: [[f64; 6]; 4] = [
        [10.0, 3.0, 17.0, 3.5, 1.7, 8.0],
        [0.05, 10.0, 17.0, 0.1, 8.0, 14.0],
        [3.0, 3.5, 1.7, 10.0, 17.0, 8.0],
        [17.0, 8.0, 0.05, 10.0, 0.1, 14.0],
    ];
    const AT: [[f64; 6]; 4] = [
        [1312.0, 1696.0, 5569.0, 124.0, 8283.0, 5886.0],
        [2329.0, 4135.0, 8307.0, 3736.0, 1004.0, 9991.0],
        [2348.0, 1451.0, 3522.0, 2883.0, 3047.0, 6650.0],
        [4047.0, 8828.0, 8732.0, 5743.0, 1091.0, 381.0],
    ];
    hartmann(x, &RATE, &AT)
}

fn shekel(hills: usize) -> impl Fn(&[f64; 4]) -> f64 {
    const AT: [([f64; 4], f64); 10] = [
        ([4.0, 4.0, 4.0, 4.0], 0.1),
        ([1.0, 1.0, 1.0, 1.0], 0.2),
        ([8.0, 8.0, 8.0, 8.0], 0.2),
        ([6.0, 6.0, 6.0, 6.0], 0.4),
        ([3.0, 7.0, 3.0, 7.0], 0.4),
        ([2.0, 9.0, 2.0, 9.0], 0.6),
        ([5.0, 5.0, 3.0, 3.0], 0.3),
        ([8.0, 1.0, 8.0, 1.0], 0.7),
        ([6.0, 2.0, 6.0, 2.0], 0.5),
        ([7.0, 3.6, 7.0, 3.6], 0.5),
    ];
    move |x| {
        let hill = |(at, c): &([f64; 4], f64)| 1.0 / (x.iter().zip(at).map(|(x, a)| (x - a).powi(2)).sum::<f64>() + c);
        -AT[..hills].iter().map(hill).sum::<f64>()
    }
}

/// Evaluations until the least value `f` of `function` is known to 0.01 %: point by point, and in whole sweeps.
fn count<const D: usize>(
    form: Form,
    lower: [f64; D],
    upper: [f64; D],
    f: f64,
    function: impl Fn(&[f64; D]) -> f64,
) -> (usize, usize) {
    let mut direct = Direct::new(form).until(-(f + 1e-4 * f.abs()));
    let (_, value) = direct.maximise(lower, upper, 20_000, |x| -function(x));
    let points = direct.evaluations();
    let all = |x: &[[f64; D]], y: &mut [f64]| y.iter_mut().zip(x).for_each(|(y, x)| *y = -function(x));
    let (_, again) = direct.maximise_batches(lower, upper, 20_000, all);
    assert!(value >= direct.target && again >= direct.target, "the target was not reached: {value}");
    (points, direct.evaluations())
}

#[test]
fn published_counts() {
    for form in [Form::Original, Form::LocallyBiased] {
    println!("{form:?}");
    println!("S5 155 {:?}", count(form, [0.0; 4], [10.0; 4], -10.15319967905823, shekel(5)));
    println!("S7 145 {:?}", count(form, [0.0; 4], [10.0; 4], -10.40294056681866, shekel(7)));
    println!("S10 145 {:?}", count(form, [0.0; 4], [10.0; 4], -10.53640981669205, shekel(10)));
    println!("H3 199 {:?}", count(form, [0.0; 3], [1.0; 3], -3.86278214782076, hartmann3));
    println!("H6 571 {:?}", count(form, [0.0; 6], [1.0; 6], -3.322368011415515, hartmann6));
    println!("BR 195 {:?}", count(form, [-5.0, 0.0], [10.0, 15.0], 0.39788735772973816, branin));
    println!("GP 191 {:?}", count(form, [-2.0; 2], [2.0; 2], 3.0, goldstein_price));
    println!("C6 285 {:?}", count(form, [-3.0, -2.0], [3.0, 2.0], -1.031628453489877, six_hump_camel));
    println!("SHU 2967 {:?}", count(form, [-10.0; 2], [10.0; 2], -186.7309088310239, shubert));
    }
}
