//! The conformance tests of proposals.

use super::assert_mean;
use crate::control::{CHUNK, Proposal};
use crate::geometry::{BBox, State};
use crate::scene::{Detection, Scene};
use foveate_base::rng::{Purpose, Streams};

/// Checks that children depend on their parent, the scene and the stream of their chunk only, that log p/q is finite, and that the mean of
/// p/q over q's draws is 1 for every parent (32 batches of 1,024 children). A proposal that uses no detections must give the same children
/// with and without them.
pub fn proposal(proposal: &mut dyn Proposal, scene: Scene<'_>, parent: &State) {
    const N: usize = 16 * CHUNK;
    let parents = [*parent; N];
    if !proposal.uses_detections() {
        let detected = [Detection::new(BBox::around(parent.x + 1.0, parent.y, 8.0, 8.0), 1.0)];
        let mut children = |detections: &[Detection]| {
            let (mut children, mut log_ratio) = ([State::default(); 1], [f64::NAN; 1]);
            let streams = Streams::new(0, 0).at(1, Purpose::Predict);
            proposal.propose(Scene { detections, ..scene }, &parents[..1], &mut children, &mut log_ratio, streams);
            (children, log_ratio)
        };
        assert!(children(&[]) == children(&detected), "detections must change nothing where they are not used");
    }
    let mut propose = |n: usize, streams: Streams| {
        let (mut children, mut log_ratio) = (vec![State::default(); n], vec![f64::NAN; n]);
        proposal.propose(scene, &parents[..n], &mut children, &mut log_ratio, streams);
        assert!(log_ratio.iter().all(|r| r.is_finite()), "log p/q must be finite at every child");
        (children, log_ratio)
    };
    let stream = |i| Streams::new(i, 0).at(1, Purpose::Predict);
    let (children, log_ratio) = propose(N, stream(0));
    assert!((children.clone(), log_ratio) == propose(N, stream(0)), "the same streams must give the same children");
    let fewer = propose(5 * CHUNK + 7, stream(0)).0;
    assert!(fewer == children[..fewer.len()], "a child must not depend on how many there are");
    let other = propose(N, stream(1)).0;
    assert!(other[0] == other[1] || other != children, "other streams must give other children");
    assert!(children[0] == children[1] || children[..CHUNK] != children[CHUNK..2 * CHUNK], "chunks must differ");
    let ratios: Vec<f64> = (0..32).flat_map(|i| propose(N, stream(i)).1).map(f64::exp).collect();
    assert_mean(&ratios, 1.0, "the mean of p/q over the children");
}

/// Checks that children weighted by p/q have the same means as children of p: of each component, its square, and the products with x.
///
/// `q` and `p` propose for the same parent, 64 batches of 1,024 children. Means must agree within 5.5 standard errors of their difference.
/// Of the 27 checks a correct proposal fails one less than once in 10⁶ calls.
pub fn proposal_weights(q: &mut dyn Proposal, p: &mut dyn Proposal, scene: Scene<'_>, parent: &State) {
    const N: usize = 16 * CHUNK;
    const BATCHES: u64 = 64;
    let draw = |proposal: &mut dyn Proposal, seed: u64| {
        let (mut children, mut log_ratio) = (vec![State::default(); N], vec![f64::NAN; N]);
        let streams = Streams::new(seed, 3).at(1, Purpose::Predict);
        proposal.propose(scene, &[*parent; N], &mut children, &mut log_ratio, streams);
        children.into_iter().map(|c| c.to_array()).zip(log_ratio.into_iter().map(f64::exp)).collect::<Vec<_>>()
    };
    let of_q: Vec<_> = (0..BATCHES).flat_map(|i| draw(q, i)).collect();
    let of_p: Vec<_> = (0..BATCHES).flat_map(|i| draw(p, 1000 + i)).collect();
    let n = of_p.len() as f64;
    let middle: [f64; State::N] = std::array::from_fn(|k| of_p.iter().map(|(c, _)| c[k]).sum::<f64>() / n);
    let about = |c: &[f64; State::N], k: usize| c[k] - middle[k];
    let compare = |what: &str, f: &dyn Fn(&[f64; State::N]) -> f64| {
        let moments = |of: &[([f64; State::N], f64)]| {
            let mean = of.iter().map(|(c, w)| w * f(c)).sum::<f64>() / n;
            (mean, of.iter().map(|(c, w)| (w * f(c) - mean).powi(2)).sum::<f64>() / (n - 1.0) / n)
        };
        let ((a, va), (b, vb)) = (moments(&of_q), moments(&of_p));
        let allowed = 5.5 * (va + vb).sqrt() + 1e-9;
        assert!((a - b).abs() < allowed, "weighted children must be as p's: {what}, {a} is not {b} ± {allowed}");
    };
    for k in 0..State::N {
        compare(&format!("component {k}"), &|c| about(c, k));
        compare(&format!("component {k} squared"), &|c| about(c, k).powi(2));
        compare(&format!("component {k} times x"), &|c| about(c, k) * about(c, 0));
        if k + 1 < State::N {
            compare(&format!("component {k} times the next"), &|c| about(c, k) * about(c, k + 1));
        }
    }
}
