//! The best of nine slot machines changes three times: EXP3 trusts the past, EXP3.S lets a little of it go.
//!
//! Against the best machine of each quarter, EXP3.S stays within its theorem, and loses much less than EXP3, whose
//! theorem compares with the best single machine only.
//! `cargo run --release -p foveate --example 06_adversarial_bandit`

use foveate::gaze::{Context, Exp3, Grid, Plan, Policy, PolicySnapshot, Variant};
use foveate::rng::{Purpose, Streams};

const K: usize = 9;
const ROUNDS: usize = 20_000;
const BEST: [usize; 4] = [2, 6, 0, 5];
const RUNS: u64 = 5;

/// What machine `k` pays in round `t`: the best 0.8 on average, the others 0.2, none by chance.
fn pays(t: usize, k: usize) -> f64 {
    let often = if k == BEST[t * BEST.len() / ROUNDS] { 4 } else { 1 };
    f64::from((t * 3 + k) % 5 < often)
}

fn main() {
    let changes = BEST.len() - 1;
    let (gamma, share) = Exp3::sharing_for(K, ROUNDS, changes);
    let (k, t) = (K as f64, ROUNDS as f64);
    let e = std::f64::consts::E;
    let bound = 2.0 * ((e - 1.0) * k * t * ((changes + 1) as f64 * (k * t).ln() + e)).sqrt();
    println!("share of the plays on the best machine, by eighths of {ROUNDS} rounds; mean of {RUNS} runs\n");
    let exp3 = play("EXP3", Variant::Unbiased, (k * k.ln() / ((e - 1.0) * t)).sqrt());
    let sharing = play("EXP3.S", Variant::Sharing(share), gamma);
    println!(
        "\nregret against the best machine of each quarter: EXP3 {exp3:.0}, EXP3.S {sharing:.0} (theorem: {bound:.0})"
    );
    assert!(sharing <= bound, "EXP3.S: the theorem is broken");
    assert!(sharing < 0.8 * exp3, "EXP3.S must lose less than EXP3 where the best changes");
}

/// Mean expected regret against the best machine of each quarter.
fn play(name: &str, variant: Variant, gamma: f64) -> f64 {
    let (mut regret, mut on_best) = (0.0, [0.0; 8]);
    for run in 0..RUNS {
        let mut policy = Exp3::new(Grid::default().gazes(), variant, gamma).expect("nine machines and a rate");
        let mut plan = Plan::new();
        for t in 0..ROUNDS {
            let PolicySnapshot::Arms { probabilities, .. } = policy.snapshot() else {
                unreachable!("EXP3 shows its arms")
            };
            let best = BEST[t * BEST.len() / ROUNDS];
            on_best[8 * t / ROUNDS] += probabilities[best] * 8.0 / (ROUNDS as f64 * RUNS as f64);
            regret += pays(t, best) - (0..K).map(|k| probabilities[k] * pays(t, k)).sum::<f64>();
            policy.plan(&Context::default(), &mut plan, &mut Streams::new(run, 0).at(t as u64, Purpose::Look).rng(0));
            let reward = pays(t, plan.chosen().arm.expect("machines have numbers"));
            policy.learn(&plan, &[reward]);
        }
    }
    println!("{name:8}{}", on_best.map(|p| format!("{:6.0} %", 100.0 * p)).concat());
    regret / RUNS as f64
}
