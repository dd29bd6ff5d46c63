//! Several gazes a frame, weighted by their rewards, in the whole tracker.

use foveate::files::Folder;

use crate::common::{INIT, blueprint, frame, truth};
use foveate::Seen;
use foveate::config::{Blueprint, Config};
use foveate::control::{Autoregressive, Belief, ConfidenceModel, ConsistencySettings, Prior, VarianceReduction};
use foveate::extend::SavedState;
use foveate::gaze::{Context, Grid, Plan, Policy, Pool};
use foveate::geometry::{Extent, Gaze, State};
use foveate::identity::Appearance;
use foveate::reference::ReferenceLikelihood;
use foveate::rng::{Rng, Streams};
use foveate::scene::{Image, Preprocessor};
use foveate::start::StartSpread;
use foveate::video::Frame;
use foveate::{Filter, GazeControl, Monitor, Parts, Tracker};

const N: usize = 20_000;

/// The likelihood of a place by a gaze: normal in x and y about the gaze (pixels), with the deviation `SD` of its arm.
struct Bells;

const SD: [f64; 4] = [2.0, 3.0, 5.0, 4.0];
const GAZES: [(f64, f64); 4] = [(-3.0, -3.0), (-3.0, 3.0), (3.0, -3.0), (3.0, 3.0)];

impl Appearance for Bells {
    fn init_template(&mut self, _: &Image, _: &State, _: Extent, _: Streams) -> ReferenceLikelihood {
        ReferenceLikelihood { on: 0.0, off: -10.0 }
    }
    fn prepare(&mut self, _: &Image, _: &[State], _: &[Gaze]) {}
    fn log_likelihood(&mut self, states: &[State], gaze: Gaze, out: &mut [f64]) {
        let sd = SD[gaze.arm.expect("a gaze of a grid")];
        for (state, out) in states.iter().zip(out) {
            *out = -0.5 * ((state.x - 50.0 - gaze.u).powi(2) + (state.y - 50.0 - gaze.v).powi(2)) / (sd * sd);
        }
    }
}

/// Uses all the grid's gazes, one look each.
struct All(Vec<Gaze>);

impl Policy for All {
    fn plan(&mut self, _: &Context, plan: &mut Plan, _: &mut Rng) {
        plan.clear();
        self.0.iter().for_each(|gaze| plan.weigh(*gaze, 1.0));
    }
    fn learn(&mut self, _: &Plan, _: &[f64]) {}
}

/// Particles that stay where they begin, normal about (50, 50) with a deviation of 4 pixels.
fn tracker(policy: Box<dyn Policy>) -> Tracker {
    let still = Autoregressive { damping: 0.0, velocity: 0.0, position: 0.0, log_scale: 0.0, ..Default::default() };
    let start = StartSpread { position: 0.4, velocity: 0.0, ..StartSpread::default() };
    let filter = Filter::new(Box::new(Prior::new(std::sync::Arc::new(still))), N).expect("some particles");
    let gaze = GazeControl::new(policy, Box::new(VarianceReduction::new(1.0).expect("a temperature")));
    let monitor = Monitor::new(ConsistencySettings::default(), ConfidenceModel::default());
    let parts = Parts::new(filter.with_start(start), gaze, Box::new(Bells), monitor);
    Tracker::from_parts(parts, Preprocessor::default(), 1)
}

fn first_step<T>(policy: Box<dyn Policy>, look: impl FnOnce(&Seen<'_>) -> T) -> T {
    let (mut tracker, picture) = (tracker(policy), Image::grey(100, 100, 0));
    let bbox = foveate::geometry::BBox::around(50.0, 50.0, 20.0, 20.0);
    tracker.init(&picture, bbox).expect("a box in the picture");
    let step = tracker.update(&picture).expect("a picture of the first size");
    look(&step)
}

fn grid() -> Vec<Gaze> {
    Grid { n: 2, reach: 3.0 }.gazes()
}

/// A pool whose weights, of this sum, are given by `log_weights`.
fn pool(log_weights: [f64; 4], looks: f64) -> Box<dyn Policy> {
    let mut pool = Pool::new(grid(), 1.0, 0.0, looks).expect("four gazes");
    pool.load(&SavedState::new(&serde_json::json!({ "gain": log_weights, "frames": 1 }))).expect("four gains");
    Box::new(Held(pool))
}

/// A policy that keeps its state when a target starts.
struct Held(Pool);

impl Policy for Held {
    fn plan(&mut self, context: &Context, plan: &mut Plan, rng: &mut Rng) {
        self.0.plan(context, plan, rng);
    }
    fn learn(&mut self, plan: &Plan, rewards: &[f64]) {
        self.0.learn(plan, rewards);
    }
}

/// Precisions add by their weights. 20,000 particles, one seed: the mean's deviation is below 0.03 px, the variance's below
/// 3 %; five deviations are allowed, of eight numbers, which fails a correct one less than once in 10⁵.
#[test]
fn the_pool_of_normal_laws_in_closed_form() {
    for (log_weights, looks) in
        [([0.0; 4], 4.0), ([0.0; 4], 1.0), ([1.0, 0.0, -1.0, 2.0], 4.0), ([0.0, -3.0, 3.0, 0.0], 1.5)]
    {
        let sum: f64 = log_weights.iter().map(|g: &f64| g.exp()).sum();
        let weights = log_weights.map(|g: f64| looks * g.exp() / sum);
        let precision = (0..4).map(|k| weights[k] / SD[k].powi(2)).sum::<f64>() + 1.0 / 16.0;
        let mean = |at: fn((f64, f64)) -> f64| {
            50.0 + (0..4).map(|k| weights[k] * at(GAZES[k]) / SD[k].powi(2)).sum::<f64>() / precision
        };
        let (x, y) = (mean(|g| g.0), mean(|g| g.1));
        first_step(pool(log_weights, looks), |step| {
            for (w, exact) in step.plan.weights().iter().zip(weights) {
                assert!((w - exact).abs() < 1e-12, "{w} is not {exact}");
            }
            let belief = Belief { states: step.particles, weights: step.weights };
            let (got, cov) = (belief.mean(), belief.covariance());
            assert!((got.x - x).abs() < 0.15 && (got.y - y).abs() < 0.15, "{got:?} is not {x}, {y}");
            for variance in [cov[0][0], cov[1][1]] {
                assert!((variance * precision - 1.0).abs() < 0.15, "{variance} is not {}", 1.0 / precision);
            }
        });
    }
}

/// Equal weights of sum K are the product of the likelihoods, as policies that use several gazes have always had it.
#[test]
fn equal_weights_are_the_product() {
    let bits = |step: &Seen<'_>| -> Vec<u64> {
        let numbers = step.weights.iter().chain([&step.log_evidence, &step.consistency.deficit, &step.p_lost]);
        numbers.map(|v| v.to_bits()).collect()
    };
    let (product, pooled) = (first_step(Box::new(All(grid())), bits), first_step(pool([0.0; 4], 4.0), bits));
    assert!(product == pooled);
}

/// The drifting target of [`frame`]; from frame 20 to 39 its left half is covered by a grey that has nothing.
fn covered(index: usize) -> Frame {
    let mut frame = frame(index, 1);
    let at = truth(index);
    if (20..40).contains(&index) {
        let width = frame.image.width();
        for row in at.y as usize - 2..(at.y + at.h) as usize + 2 {
            frame.image.plane_mut(0)[row * width + at.x as usize - 2..][..14].fill(60);
        }
    }
    frame
}

/// Small windows on the four quarters.
fn quarters() -> Blueprint {
    let policy = "kind = \"pool\"\ngrid = { n = 2, reach = 0.5 }\ngamma = 0.5\nforget = 0.1\n";
    let text = blueprint("{ kind = \"fixed\" }", false, 0.5, false, 300).config().to_toml();
    let text = text.replace("kind = \"fixed\"\nu = 0.0\nv = 0.0\n", policy);
    let text = text.replace("side = 28.0\nrings = [[8, 1], [16, 2], [24, 4]]", "side = 24.0\nrings = [[10, 1]]");
    Config::parse(&text, "test").and_then(|c| c.check(&Folder::here())).expect("a good configuration")
}

#[test]
fn a_covered_gaze_loses_its_weight_and_gets_it_back() {
    let blueprint = quarters();
    for seed in 0..5 {
        let mut tracker = blueprint.tracker(seed).expect("parts that fit");
        tracker.init(&covered(0).image, INIT).expect("a box in the picture");
        let mut left = vec![];
        for index in 1..66 {
            let frame = covered(index);
            let step = tracker.update(&frame.image).expect("a picture of the first size");
            let iou = step.bbox.iou(&truth(index));
            assert!(iou > 0.9, "seed {seed}, frame {index}: IoU {iou}");
            left.push((step.plan.weights()[0] + step.plan.weights()[1]) / step.plan.looks());
        }
        let [before, during, after] = [19, 39, 65].map(|t| left[t - 1]);
        assert!(before > 0.3 && during < 0.1 && after > 0.3, "seed {seed}: {before:.2} {during:.2} {after:.2}");
    }
}
