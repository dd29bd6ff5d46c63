//! Properties of several parts together.

use super::distractors::Distractors;
use super::toy::{EXTENT, OFF, SLOPE, Toy, given, parts, picture, started, state, target};
use super::view::{Looks, Scratch};
use super::*;
use crate::control::{Consistency, DistractorSettings};
use crate::gaze::Policy;
use crate::geometry::Gaze;
use crate::scene::Image;
use foveate_base::rng::Rng;

/// A look at a picture with this fraction of the target visible.
fn look<T>(toy: &mut Toy, fraction: f64, see: impl FnOnce(&mut View<'_>) -> T) -> T {
    let (image, mut visibility, mut scratch): (Image, _, _) = (picture(), Visibility::default(), Scratch::default());
    visibility.set_fraction(fraction);
    let scene = Scene { image: &image, detections: &[] };
    see(&mut View::new(toy, scene, given(), &visibility, &state(50.0), &mut scratch))
}

fn estimate(x: f64) -> Estimate {
    Estimate { mean: state(x), covariance: Default::default(), ess: 1.0 }
}

fn close(found: f64, exact: f64) {
    assert!((found - exact).abs() < 1e-9, "{found} is not {exact}");
}

/// p(h | a) = Σ wₜ₋₁ p/q · p(h | x, a) for each gaze on its own, whichever gaze moves the belief.
#[test]
fn the_evidence_of_a_gaze_is_its_likelihood_under_the_prior() {
    let gazes = [Gaze::CENTRE, Gaze { u: 0.1, v: 0.0, arm: None }];
    let mut belief = Particles {
        states: vec![state(50.0), state(53.0)],
        log_importance: vec![0.9f64.ln(), 0.1f64.ln()],
        ..Particles::default()
    };
    let looks = look(&mut Toy::at(50.0), 1.0, |view| {
        view.log_likelihoods(&belief.states, (&gazes, &[1.0, 0.0], None), Looks::default())
    });
    let evidence = belief.weigh(&looks, vec![]);
    let likelihood = |pixels: f64| (-SLOPE * pixels).exp();
    close(evidence[0].exp(), 0.9 * likelihood(0.0) + 0.1 * likelihood(3.0));
    close(evidence[1].exp(), 0.9 * likelihood(1.0) + 0.1 * likelihood(4.0));
    close(belief.log_evidence, evidence[0]);
    close(belief.weights[1], 0.1 * likelihood(3.0) / evidence[0].exp());
}

/// The surroundings are remembered in every eighth frame, with P(lost) below 0.05 and enough of the target visible.
#[test]
fn surroundings_are_remembered_in_confident_frames_only() {
    let settings = DistractorSettings { reach: 2.0, step: 1.0, remembered: 2, first_frame: false };
    for (p_lost, frame, fraction, remembers) in
        [(0.01, 8, 1.0, true), (0.2, 8, 1.0, false), (0.01, 9, 1.0, false), (0.01, 8, 0.3, false)]
    {
        let mut monitor = Monitor::new(Default::default(), toy::model()).with_distractors(Some(settings.clone()));
        let mut toy = Toy::at(50.0);
        let beside = toy.axis(70.0);
        look(&mut toy, 1.0, |view| monitor.search(view, &state(50.0), Distractors::default()));
        let verdict = TrackConfidence { p_lost, own: p_lost, ..TrackConfidence::default() };
        let misled = look(&mut toy, fraction, |view| monitor.revise(view, &verdict, &estimate(50.0), (false, frame)));
        assert!(!misled);
        let elsewhere = monitor.surroundings.as_mut().expect("it remembers").elsewhere(&beside);
        assert_eq!(elsewhere, f64::from(u8::from(remembers)), "P(lost) {p_lost}, frame {frame}, {fraction} visible");
    }
}

/// Half of a target gives half of the evidence, and so does half of a distractor: their margin is independent of the visible fraction.
#[test]
fn the_visible_fraction_scales_distractors_and_target_alike() {
    let settings = DistractorSettings { reach: 2.0, step: 1.0, ..DistractorSettings::default() };
    for fraction in [1.0, 0.8, 0.5] {
        let mut monitor = Monitor::new(Default::default(), toy::model()).with_distractors(Some(settings.clone()));
        let mut belief = Particles { states: vec![state(50.0)], log_importance: vec![0.0], ..Particles::default() };
        let shown = look(&mut Toy::at(50.0), fraction, |view| {
            let looks = view.log_likelihoods(&belief.states, (&[Gaze::CENTRE], &[1.0], None), Looks::default());
            belief.weigh(&looks, vec![]);
            // Places are 10 pixels apart; all places in the column of the target have its likelihood.
            let found = monitor.search(view, &state(47.0), Distractors::default());
            monitor.evidence(view, &belief, &looks, &estimate(47.0), (&Percept::default(), &found))
        });
        close(shown.distractor.expect("there was a search"), fraction * -SLOPE * 3.0);
    }
}

/// The best of nine places within a fifth of the box counts, for a place of another size or a shifted box.
#[test]
fn similarity_is_the_best_of_nine_places() {
    let mut engine = started(parts(Toy::at(50.0)), 0);
    let mut similarity = |x: f64| engine.similarity(&picture(), &state(x));
    close(similarity(50.0), 1.0);
    close(similarity(52.0), 1.0);
    close(similarity(48.0), 1.0);
    close(similarity(54.0), 1.0 - SLOPE * 2.0 / -OFF);
    close(similarity(90.0), 0.0);
}

/// A lost second tracker restarts at the estimate of a first one that is sure; otherwise it does not move.
#[test]
fn a_lost_second_tracker_restarts_at_a_sure_first() {
    for (own, lost, second_lost, led) in [
        (0.001, false, true, true),
        (0.01, false, true, false),
        (0.001, true, true, false),
        (0.001, false, false, false),
    ] {
        let mut second = started(parts(Toy::at(50.0)), 1);
        second.context.lost = second_lost;
        let verdict = TrackConfidence { own, ..TrackConfidence::default() };
        look(&mut Toy::at(50.0), 1.0, |view| {
            second::follow(Some(&mut second), view, &estimate(80.0), &verdict, (lost, false));
        });
        let x = second.parts.filter.particles.iter().map(|particle| particle.x).sum::<f64>() / 50.0;
        assert_eq!((x - 80.0).abs() < 2.0, led, "own P(lost) {own}, lost {lost}: at column {x}");
        assert!(!(led && second.context.lost), "it is not lost until frames say so");
    }
}

/// A policy that is committed to one gaze from the first frame on.
struct Settled(Gaze);

impl Policy for Settled {
    fn plan(&mut self, _: &Context, plan: &mut Plan, _: &mut Rng) {
        plan.only(self.0);
    }
    fn learn(&mut self, _: &Plan, _: &[f64]) {}
    fn committed_gaze(&self) -> Option<Gaze> {
        Some(self.0)
    }
}

/// The evidence of another gaze is not comparable with the evidence under this one.
#[test]
fn committing_to_a_gaze_drops_the_evidence_of_the_old_one() {
    let mut parts = parts(Toy::at(50.0));
    parts.gaze = parts.gaze.with_policy(Box::new(Settled(Gaze { u: 0.3, v: 0.0, arm: Some(1) })));
    let mut engine = started(parts, 0);
    let image = picture();
    for frame in 1..4 {
        engine.step_on(Scene { image: &image, detections: &[] });
        let monitor = &engine.parts.monitor;
        assert_eq!(monitor.loss.seen().is_some(), frame > 1, "frame {frame}: usual evidence");
        assert_eq!(monitor.consistency.last() == Consistency::default(), frame == 1, "frame {frame}: last evidence");
    }
}

/// An ellipse. Its squared half axes add up to χ² quantile × trace of (covariance + noise² I).
#[test]
fn a_credible_region_includes_the_localisation_noise() {
    let mut engine = started(parts(Toy::at(50.0)), 0);
    let (image, noise) = (picture(), engine.parts.monitor.model().localisation_noise * EXTENT.mean());
    let step = engine.step_on(Scene { image: &image, detections: &[] });
    for share in [0.5, 0.9] {
        let [long, short] = step.region(share).half;
        let trace = step.covariance[0][0] + step.covariance[1][1] + 2.0 * noise * noise;
        assert!(
            (long * long + short * short + 2.0 * (1.0 - share).ln() * trace).abs() < 1e-6 * trace,
            "{long} {short}"
        );
    }
    assert!(noise > 0.5, "a pixel");
}

/// The first estimate is the given box, up to the spread of the particles.
#[test]
fn a_step_follows_the_target() {
    let mut engine = started(parts(Toy::at(50.0)), 0);
    let image = picture();
    let step = engine.step_on(Scene { image: &image, detections: &[] });
    assert!(step.bbox.iou(&target(50.0)) > 0.8 && !step.is_lost());
}

/// If the target is not at its place, the tracker searches, and the policy's context reports the loss in the next frame.
#[test]
fn the_policy_context_reports_a_lost_target() {
    let mut engine = started(parts(Toy::at(90.0)), 0);
    let image = picture();
    assert!(!engine.context.lost);
    for _ in 0..10 {
        engine.step_on(Scene { image: &image, detections: &[] });
    }
    assert!(engine.is_searching() && engine.context.lost);
}
