//! Five biased coins, one throw a round: the loss from seeing one coin only, and from not knowing the best one.
//!
//! Hedge receives the rewards of all coins and bets on one; EXP3 and EXP3-IX receive that of the coin they throw. Regret, against always throwing the
//! best coin, stays within each theorem, and far below what throwing at random costs.
//! `cargo run --release -p foveate --example 05_bernoulli_bandit`

use foveate::gaze::{Context, Exp3, Hedge, Plan, Policy, Random, Schedule, Variant};
use foveate::geometry::Gaze;
use foveate::rng::{Purpose, Streams};
use rand::RngExt;

const HEADS: [f64; 5] = [0.2, 0.4, 0.5, 0.3, 0.7];
const ROUNDS: u64 = 5000;
const RUNS: u64 = 20;

fn main() {
    let coins: Vec<Gaze> = (0..HEADS.len()).map(|k| Gaze { u: k as f64, v: 0.0, arm: Some(k) }).collect();
    let exp3 = |variant, gamma| Box::new(Exp3::new(coins.clone(), variant, gamma).expect("coins and a rate"));
    let hedge = |gamma: Schedule| Box::new(Hedge::new(coins.clone(), gamma).expect("coins and a rate"));
    let known = Schedule::Frames(ROUNDS);
    let (t, k) = (ROUNDS as f64, HEADS.len() as f64);
    let log_k = k.ln();
    let (e1, delta) = (std::f64::consts::E - 1.0, 0.01);
    let likely = 2.0 * (2.0 * t * k * log_k).sqrt() + ((2.0 * t * k / log_k).sqrt() + 1.0) * (2.0f64 / delta).ln();

    type Make<'a> = &'a dyn Fn() -> Box<dyn Policy>;
    let players: [(&str, f64, Make<'_>); 6] = [
        ("Hedge, all coins seen", (t * log_k / 2.0).sqrt(), &|| hedge(known)),
        ("  without knowing T", (t * log_k).sqrt(), &|| hedge(Schedule::Anytime)),
        ("EXP3, one coin seen", 2.0 * (e1 * t * k * log_k).sqrt(), &|| exp3(Variant::Unbiased, known)),
        ("  without knowing T", 2.0 * (2.0 * e1 * t * k * log_k).sqrt(), &|| {
            exp3(Variant::Unbiased, Schedule::Anytime)
        }),
        ("EXP3-IX, one coin seen", likely, &|| exp3(Variant::Implicit, known)),
        ("random", f64::INFINITY, &|| Box::new(Random::new(coins.clone()))),
    ];
    println!("{ROUNDS} rounds, {RUNS} runs     mean regret   largest    theorem");
    let mut regrets = vec![];
    for (name, bound, make) in players {
        let runs: Vec<f64> = (0..RUNS).map(|run| regret(&mut *make(), Streams::new(run, 0))).collect();
        let (mean, largest) = (runs.iter().sum::<f64>() / RUNS as f64, runs.iter().copied().fold(f64::MIN, f64::max));
        println!("{name:26} {mean:12.1} {largest:9.1} {bound:10.1}");
        assert!(mean <= bound, "{name}: the theorem is broken");
        regrets.push(mean);
    }
    assert!(regrets[0] < regrets[2].min(regrets[4]), "seeing all coins must help");
    assert!(regrets[2].max(regrets[3]).max(regrets[4]) < 0.5 * regrets[5], "learning must halve the regret of chance");
}

/// What always throwing the best coin is expected to win more than this policy's throws are.
fn regret(policy: &mut dyn Policy, streams: Streams) -> f64 {
    let best = HEADS.iter().copied().fold(0.0, f64::max);
    let (mut plan, mut rewards, mut regret) = (Plan::new(), vec![], 0.0);
    for round in 0..ROUNDS {
        policy.plan(&Context::default(), &mut plan, &mut streams.at(round, Purpose::Look).rng(0));
        regret += best - HEADS[plan.chosen().arm.expect("coins have numbers")];
        let mut throw = streams.at(round, Purpose::Scene).rng(0);
        let heads = HEADS.map(|p| f64::from(throw.random_bool(p)));
        rewards.clear();
        rewards.extend(plan.gazes().iter().map(|gaze| heads[gaze.arm.expect("coins have numbers")]));
        policy.learn(&plan, &rewards);
    }
    regret
}
