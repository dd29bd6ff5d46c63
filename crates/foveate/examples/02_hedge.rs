//! Hedge: never much worse than the best gaze in hindsight, whatever the rewards do.
//!
//! Four worlds, two of which look at Hedge's probabilities before they pay. The theorem allows a regret of
//! √(T ln K / 2) against the best single gaze.
//! `cargo run --release -p foveate --example 02_hedge`

use foveate::gaze::{Context, Grid, Hedge, Plan, Policy, PolicySnapshot};
use foveate::rng::{Purpose, Streams};

const FRAMES: usize = 2000;
const K: usize = 9;

fn main() {
    let least = |p: &[f64]| (0..K).fold(0, |best, k| if p[k] < p[best] { k } else { best });
    let most = |p: &[f64]| (0..K).fold(0, |best, k| if p[k] > p[best] { k } else { best });
    type World<'a> = &'a dyn Fn(usize, &[f64], usize) -> f64;
    let worlds: [(&str, World<'_>); 4] = [
        ("the centre is a little better", &|t, _, k| 0.1 * ((t * (k + 3)) % 7) as f64 + f64::from(k == 4) * 0.1),
        ("the best gaze changes half-way", &|t, _, k| f64::from(k == if t < FRAMES / 2 { 0 } else { 8 })),
        ("the least likely gaze is paid", &|_, p, k| f64::from(k == least(p))),
        ("the most likely gaze is robbed", &|_, p, k| f64::from(k != most(p))),
    ];
    let bound = (FRAMES as f64 * (K as f64).ln() / 2.0).sqrt();
    println!("{FRAMES} frames, {K} gazes: regret must stay within {bound:.1}\n");
    println!("{:32} best gaze  hedge  regret", "world");
    for (name, world) in worlds {
        let gamma = Hedge::gamma_for(K, FRAMES);
        let mut hedge = Hedge::new(Grid::default().gazes(), gamma).expect("nine gazes and a positive rate");
        let (mut plan, mut gain, mut earned) = (Plan::new(), [0.0; K], 0.0);
        for t in 0..FRAMES {
            let PolicySnapshot::Arms { probabilities, .. } = hedge.snapshot() else {
                unreachable!("Hedge shows its arms")
            };
            let rewards: [f64; K] = std::array::from_fn(|k| world(t, probabilities, k));
            earned += probabilities.iter().zip(&rewards).map(|(p, r)| p * r).sum::<f64>(); // expected over the draw
            hedge.plan(&Context::default(), &mut plan, &mut Streams::new(1, 0).at(t as u64, Purpose::Look).rng(0));
            hedge.learn(&plan, &rewards);
            gain = std::array::from_fn(|k| gain[k] + rewards[k]);
        }
        let best = gain.into_iter().fold(0.0, f64::max);
        println!("{name:32} {best:9.1} {earned:6.1} {:7.1}", best - earned);
        assert!(best - earned <= bound, "{name}: the theorem is broken");
    }
}
