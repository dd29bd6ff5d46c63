//! Properties of several parts together.

use super::distractors::Distractors;
use super::monitor::Verdict;
use super::toy::{EXTENT, Learned, OFF, SLOPE, Toy, given, parts, picture, started, state, target};
use super::view::{Looks, Scratch};
use super::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::control::{
    AbsenceWeights, Autoregressive, ConfidenceModel, Consistency, DetectionLikelihood, DistractorSettings,
    FrameEvidence, LocalSearch, Prior, ReacquisitionWeights, Redetection, Resampling,
};
use crate::gaze::Policy;
use crate::geometry::Gaze;
use crate::scene::{Detection, Image};
use crate::seen::credible;
use foveate_base::rng::Rng;

/// A look at a picture with this fraction of the target visible.
pub(super) fn look<T>(toy: &mut Toy, fraction: f64, see: impl FnOnce(&mut View<'_>) -> T) -> T {
    let (image, mut visibility, mut scratch): (Image, _, _) = (picture(), Visibility::default(), Scratch::default());
    visibility.set_fraction(fraction);
    let scene = Scene { image: &image, detections: &[] };
    see(&mut View::new(toy, scene, given(), &visibility, &state(50.0), &mut scratch))
}

/// Particles in these columns with equal weights before the look, and the look at them.
pub(super) fn weighed(view: &mut View<'_>, columns: &[f64]) -> (Particles, Looks) {
    let states: Vec<State> = columns.iter().map(|x| state(*x)).collect();
    let mut belief = Particles { log_importance: vec![0.0; states.len()], states, ..Particles::default() };
    let looks = view.log_likelihoods(&belief.states, (&[Gaze::CENTRE], &[1.0], None), Looks::default());
    belief.weigh(&looks, vec![]);
    (belief, looks)
}

/// The evidence of a frame with the target at its place.
pub(super) fn evidence(monitor: &mut Monitor) -> FrameEvidence {
    look(&mut Toy::at(50.0), 1.0, |view| {
        let (belief, looks) = weighed(view, &[50.0, 80.0]);
        let found = (&Percept::default(), &Distractors::default());
        monitor.evidence(view, &belief, &looks, &estimate(50.0), found, OtherEvidence::default())
    })
}

pub(super) fn estimate(x: f64) -> Estimate {
    Estimate { mean: state(x), covariance: Default::default(), ess: 1.0, moved: [0.0; 2] }
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

/// The evidence is that of one look, lengths are in template units of the size at the estimate, and the sample size is a share.
#[test]
fn evidence_is_per_look_and_lengths_are_in_template_units() {
    let mut monitor = Monitor::new(Default::default(), toy::model());
    let mut at = Estimate { ess: 3.0, ..estimate(53.0) };
    at.mean.log_scale = 2.0f64.ln();
    (at.covariance[0][0], at.covariance[1][1]) = (1500.0, 100.0);
    let mut judge = |at: &Estimate, dropped| {
        look(&mut Toy::at(50.0), 1.0, |view| {
            let (log_importance, states) = (vec![0.25f64.ln(); 4], vec![state(53.0); 4]);
            let mut belief = Particles { log_importance, states, dropped, ..Particles::default() };
            let looked = (&[Gaze::CENTRE; 2][..], &[1.0, 2.0][..], None);
            let looks = view.log_likelihoods(&belief.states, looked, Looks::default());
            belief.weigh(&looks, vec![]);
            let found = (&Percept::default(), &Distractors::default());
            let shown = monitor.evidence(view, &belief, &looks, at, found, OtherEvidence::default());
            (shown, Verdict::default().context(&shown, &belief, at))
        })
    };
    let (shown, context) = judge(&at, 0);
    close(shown.evidence, -SLOPE * 3.0);
    close(shown.unit, 20.0);
    close(shown.spread, 800.0f64.sqrt() / 20.0);
    close(context.ess, 0.75);
    close(judge(&at, 3).0.innovation, shown.innovation / 4.0);
    at.covariance[0][0] = f64::INFINITY;
    assert_eq!(judge(&at, 0).0.spread, 1e6, "a spread is finite");
}

/// Size and shape stay within 0.25 of the given ones, in either direction.
#[test]
fn held_sizes_are_near_the_given_one() {
    let with = |log_scale: f64, log_aspect: f64| State { log_scale, log_aspect, ..State::default() };
    let mut belief = Particles { states: vec![with(2.0, 2.0), with(-2.0, -2.0)], ..Particles::default() };
    belief.hold_size(&with(0.5, -0.5));
    assert_eq!(belief.states, [with(0.75, -0.25), with(0.25, -0.75)]);
}

/// Without a look the weights are those of the prediction, and the expected state is the mean of the predicted ones.
#[test]
fn without_a_look_the_prediction_is_the_belief() {
    let mut belief = Particles { log_importance: vec![0.9f64.ln(), 0.1f64.ln()], ..Particles::default() };
    belief.weigh_without_looks();
    close(belief.weights[0], 0.9);
    close(belief.weights[1], 0.1);
    let mean = |log_weights: [f64; 2]| {
        let mut filter = Filter::new(parts(Toy::at(50.0)).filter.proposal, 2).expect("two");
        filter.state.particles = vec![state(40.0), state(80.0)];
        filter.state.log_weights = log_weights.into();
        let (image, streams) = (picture(), Streams::new(1, 0));
        let scene = Scene { image: &image, detections: &[] };
        let belief = filter.predict(scene, EXTENT, None, (streams, 1), Particles::default());
        (belief.expected.x - belief.states[0].x) / (belief.states[1].x - belief.states[0].x)
    };
    close(mean([0.5f64.ln(); 2]), 0.5);
    close(mean([0.9f64.ln(), 0.1f64.ln()]), 0.1);
    close(mean([1e19, 0.0]), 0.0);
}

/// The estimate moves from where the last one was, which is the expected place less its velocity.
#[test]
fn the_displacement_of_the_estimate_starts_at_the_last_one() {
    let expected = State { x: 10.0, vx: 3.0, y: 20.0, vy: -2.0, ..State::default() };
    let states = vec![State { x: 15.0, y: 19.0, ..State::default() }; 2];
    let belief = Particles { expected, states, weights: vec![0.5; 2], ..Particles::default() };
    assert_eq!(belief.estimate().moved, [8.0, -3.0]);
}

/// A particle that is drawn again has the weight that the prediction gives: the detection likelihood there, and the offset of all.
#[test]
fn the_detection_likelihood_of_drawn_particles_has_the_offset_of_all() {
    let (found, likelihood) = ([Detection::new(target(52.0), 1.0)], DetectionLikelihood::default());
    let mut belief = Particles {
        states: vec![state(50.0), state(55.0)],
        log_importance: vec![-1.0, -2.0],
        detection_offset: 0.7,
        drawn: vec![1],
        ..Particles::default()
    };
    look(&mut Toy::at(50.0), 1.0, |view| {
        let found: &'static [Detection] = found.to_vec().leak();
        view.scene.detections = found;
        belief.apply_detection_likelihood(Some(&likelihood), view);
    });
    assert_eq!(belief.log_importance[0], -1.0);
    close(belief.log_importance[1], -2.0 + 0.7 + likelihood.log_likelihood(&found, &state(55.0), EXTENT));
}

/// In the first frame, the places around the target are remembered and trained on, each if the settings enable it.
#[test]
fn the_surroundings_of_the_first_frame_follow_the_settings() {
    for (remembered, first_frame) in [(0, false), (0, true), (2, false), (2, true)] {
        let settings = DistractorSettings { reach: 2.0, step: 1.0, remembered, first_frame };
        let mut monitor = Monitor::new(Default::default(), toy::model()).with_distractors(Some(settings));
        let mut toy = Toy { learned: Some(Learned::default()), ..Toy::at(50.0) };
        let beside = toy.axis(70.0);
        look(&mut toy, 1.0, |view| monitor.init_surroundings(view, &state(50.0)));
        assert_eq!(toy.learned.expect("it learns").lessons.len(), usize::from(first_frame), "{remembered} remembered");
        let elsewhere = monitor.surroundings.as_mut().map(|it| it.elsewhere(&beside));
        assert_eq!(elsewhere, (remembered > 0).then_some(1.0), "trains on the first frame: {first_frame}");
    }
}

/// The estimate is compared with remembered surroundings under the committed gaze, whatever gaze the percept has.
#[test]
fn surroundings_are_compared_under_the_committed_gaze() {
    let mut monitor = beside(true);
    let mut toy = Toy::at(70.0);
    let target = Percept {
        gaze: Gaze { u: 0.3, v: 0.0, arm: Some(1) },
        features: toy.axis(50.0).to_vec(),
        ..Percept::default()
    };
    let shown = look(&mut toy, 1.0, |view| {
        let (belief, looks) = weighed(view, &[70.0]);
        let found = (&target, &Distractors::default());
        monitor.evidence(view, &belief, &looks, &estimate(70.0), found, OtherEvidence::default())
    });
    assert!(shown.elsewhere > 0.0, "{}", shown.elsewhere);
}

/// The agreement is the overlap of the boxes of both targets.
#[test]
fn the_agreement_of_two_trackers_is_the_overlap_of_their_boxes() {
    for (x, overlap) in [(50.0, 1.0), (60.0, 1.0 / 3.0), (90.0, 0.0)] {
        let mut second = started(parts(Toy::at(50.0)), 1);
        look(&mut Toy::at(50.0), 1.0, |view| {
            let agreement = second::agreement(Some(&mut second), view, &estimate(x)).expect("there are two");
            assert!((agreement - overlap).abs() < 0.1, "{agreement} at column {x}");
            assert_eq!(second::agreement(None, view, &estimate(x)), None);
        });
    }
}

/// A second tracker takes the change of shape of the first, and keeps its size.
#[test]
fn a_second_tracker_takes_the_shape_of_the_first() {
    let mut second = started(parts(Toy::at(50.0)), 1);
    let before = second.parts.filter.state.particles.clone();
    look(&mut Toy::at(50.0), 1.0, |view| {
        second::follow(Some(&mut second), view, &estimate(50.0), &Verdict::default(), [0.3, 0.2]);
    });
    for (after, before) in second.parts.filter.state.particles.iter().zip(before) {
        close(after.log_aspect, before.log_aspect + 0.2);
        close(after.log_scale, before.log_scale);
    }
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
        let confidence = TrackConfidence { p_lost, own: p_lost, ..TrackConfidence::default() };
        let verdict = Verdict { confidence, ..Verdict::default() };
        look(&mut toy, fraction, |view| {
            monitor.learn(view, &Particles::default(), &state(50.0), Distractors::default(), (&verdict, frame));
        });
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
        let shown = look(&mut Toy::at(50.0), fraction, |view| {
            let (belief, looks) = weighed(view, &[50.0]);
            // Places are 10 pixels apart; all places in the column of the target have its likelihood.
            let found = monitor.search(view, &state(47.0), Distractors::default());
            let found = (&Percept::default(), &found);
            monitor.evidence(view, &belief, &looks, &estimate(47.0), found, OtherEvidence::default())
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
    let mut engine = started(parts(Toy { row: Some(50.0), ..Toy::at(50.0) }), 0);
    let mut similarity = |x: f64, y: f64| engine.similarity(&picture(), &State { y, ..state(x) });
    for (x, y) in [(48.0, 52.0), (52.0, 52.0), (50.0, 48.0), (52.0, 48.0)] {
        close(similarity(x, y), 1.0);
    }
    close(similarity(50.0, 46.0), 1.0 - SLOPE * 2.0 / -OFF);
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
        let confidence = TrackConfidence { own, ..TrackConfidence::default() };
        let verdict = Verdict { confidence, is_searching: lost, ..Verdict::default() };
        look(&mut Toy::at(50.0), 1.0, |view| {
            second::follow(Some(&mut second), view, &estimate(80.0), &verdict, [0.0; 2]);
        });
        let x = second.parts.filter.state.particles.iter().map(|particle| particle.x).sum::<f64>() / 50.0;
        assert_eq!((x - 80.0).abs() < 2.0, led, "own P(lost) {own}, lost {lost}: at column {x}");
        assert!(!(led && second.context.lost), "it is not lost until frames say so");
    }
}

/// A policy that is committed to one gaze from the first frame on, and counts the rewards that it receives.
struct Settled(Gaze, Arc<AtomicUsize>);

impl Policy for Settled {
    fn plan(&mut self, _: &Context, plan: &mut Plan, _: &mut Rng) {
        plan.only(self.0);
    }
    fn learn(&mut self, plan: &Plan, rewards: &[f64]) {
        assert_eq!(plan.gazes().len(), rewards.len());
        self.1.fetch_add(rewards.len(), Ordering::Relaxed);
    }
    fn committed_gaze(&self) -> Option<Gaze> {
        Some(self.0)
    }
}

/// The evidence of another gaze is not comparable with the evidence under this one, and the reference is that of this one.
#[test]
fn committing_to_a_gaze_drops_the_evidence_of_the_old_one() {
    let (mut parts, rewards) = (parts(Toy::at(50.0)), Arc::<AtomicUsize>::default());
    parts.gaze = parts.gaze.with_policy(Box::new(Settled(Gaze { u: 0.3, v: 0.0, arm: Some(1) }, rewards.clone())));
    let mut engine = started(parts, 0);
    let image = picture();
    for frame in 1..4 {
        engine.step_on(Scene { image: &image, detections: &[] });
        let monitor = &engine.parts.monitor;
        assert_eq!(monitor.loss.seen().is_some(), frame > 1, "frame {frame}: usual evidence");
        assert_eq!(monitor.consistency.last() == Consistency::default(), frame == 1, "frame {frame}: last evidence");
        assert_eq!(engine.target().reference.off, 0.5 * OFF, "frame {frame}");
        assert_eq!(rewards.load(Ordering::Relaxed), frame, "the policy learns once a frame");
    }
}

/// An ellipse. Its squared half axes add up to the squared radius × trace of the covariance, which has the localisation noise.
#[test]
fn a_credible_region_includes_the_localisation_noise() {
    let with = |localisation_noise| {
        let monitor = Monitor::new(Default::default(), ConfidenceModel { localisation_noise, ..toy::model() });
        let mut engine = started(Parts { monitor, ..parts(Toy::at(50.0)) }, 0);
        let image = picture();
        let step = engine.step_on(Scene { image: &image, detections: &[] });
        for share in [0.5, 0.9] {
            let ([long, short], trace) = (step.region(share).half, step.covariance[0][0] + step.covariance[1][1]);
            let want = credible(share) * trace;
            assert!((long * long + short * short - want).abs() < 1e-6 * trace, "{long} {short}");
        }
        (step.covariance[0][0], step.unit())
    };
    let ((without, _), (noisy, unit)) = (with(0.0), with(0.2));
    assert!((noisy - without - 0.04 * unit * unit).abs() < 1e-9, "{without} {noisy}");
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
    let seen = engine.report(Scene { image: &image, detections: &[] });
    assert!(seen.consistency.deficit > 0.5, "{:?}", seen.consistency);
}

/// While the target is lost, the sizes of the particles stay near the last confident one, though the dynamics change them in every frame.
#[test]
fn a_lost_target_keeps_its_size() {
    let image = picture();
    let moves = Autoregressive { damping: 0.0, velocity: 0.0, log_scale: 0.1, ..Default::default() };
    let parts = parts(Toy::at(500.0));
    let filter = parts.filter.with_proposal(Box::new(Prior::new(Arc::new(moves))));
    let mut engine = started(Parts { filter, ..parts }, 0);
    let step = |engine: &mut Engine| _ = engine.step_on(Scene { image: &image, detections: &[] });
    (0..30).for_each(|_| step(&mut engine));
    assert!(engine.is_searching());
    let seen = engine.parts.monitor.loss.seen().expect("frames were seen").log_scale;
    for frame in 0..60 {
        step(&mut engine);
        let far = engine.parts.filter.state.particles.iter().map(|it| (it.log_scale - seen).abs()).fold(0.0, f64::max);
        assert!(far <= 0.25 + 1e-9, "{far} in frame {frame}");
    }
}

/// The second tracker's appearance is reset if the first tracker was on a wrong object.
#[test]
fn a_misled_tracker_resets_the_memory_of_its_second() {
    for misled in [false, true] {
        let (learned, verdict) = (Learned::default(), Verdict { is_misled: misled, ..Verdict::default() });
        let forgotten = learned.forgotten.clone();
        let mut second = started(parts(Toy { learned: Some(learned), ..Toy::at(50.0) }), 1);
        look(&mut Toy::at(50.0), 1.0, |view| {
            second::follow(Some(&mut second), view, &estimate(50.0), &verdict, [0.0; 2]);
        });
        assert_eq!(forgotten.load(Ordering::Relaxed) > 0, misled);
    }
}

/// A monitor, and the evidence of the target with this logit of absence by the box regression.
fn doubted(absent: f64) -> (Monitor, FrameEvidence) {
    let absence = AbsenceWeights { rate: 1.0, weight: 1.0, bias: 0.0 };
    let mut monitor = Monitor::new(Default::default(), ConfidenceModel { absence, ..toy::model() });
    let shown = FrameEvidence { absent: Some(absent), ..evidence(&mut monitor) };
    (monitor, shown)
}

/// Nothing is learned from a frame in which the box regression doubts that the target is there.
#[test]
fn a_doubtful_frame_teaches_nothing() {
    let lessons = [-6.0, 6.0].map(|absent| {
        let (mut monitor, shown) = doubted(absent);
        let verdict = monitor.judge(true, &shown, (false, 1));
        (verdict.is_searching, verdict.lesson.is_some())
    });
    assert_eq!(lessons, [(false, true), (false, false)]);
}

/// In the frame in which a misled tracker loses the target, and not in the frames of the search, its models are reset to frame 1.
#[test]
fn a_misled_tracker_forgets_once() {
    let (mut monitor, shown) = doubted(6.0);
    let mut toy = Toy { learned: Some(Learned::default()), ..Toy::at(50.0) };
    let mut was_lost = false;
    for (frame, misled) in [(1, false), (2, true), (3, false)] {
        let verdict = monitor.judge(true, &shown, (was_lost, frame));
        assert_eq!((verdict.is_misled, verdict.is_searching), (misled, frame > 1), "frame {frame}");
        was_lost = verdict.is_searching;
        look(&mut toy, 1.0, |view| {
            monitor.learn(view, &Particles::default(), &state(50.0), Distractors::default(), (&verdict, frame));
        });
    }
    let learned = toy.learned.expect("it learns");
    assert_eq!((learned.forgotten.load(Ordering::Relaxed), learned.lessons.len()), (1, 0));
}

/// Searches frame 60 for a target that is at column 70, with particles at column 50. Returns the particles, and what was found.
fn searched(monitor: &mut Monitor, fraction: f64, lost: bool, found: &'static [Detection]) -> (Particles, Distractors) {
    searched_from(50.0, monitor, fraction, lost, found)
}

/// The same with particles at another column.
fn searched_from(
    column: f64,
    monitor: &mut Monitor,
    fraction: f64,
    lost: bool,
    found: &'static [Detection],
) -> (Particles, Distractors) {
    let mut filter = parts(Toy::at(70.0)).filter.with_local_search(Some(LocalSearch::new(Default::default())));
    filter = filter.with_redetection(Some(Redetection::new(Default::default())));
    filter = filter.with_detection_likelihood(Some(DetectionLikelihood::default()));
    look(&mut Toy::at(70.0), fraction, |view| {
        let (mut belief, mut looks) = weighed(view, &[column; 10]);
        view.scene.detections = found;
        let when = (lost, Streams::new(1, 0), 60);
        let found = filter.search(view, &mut belief, &mut looks, monitor, when, Distractors::default());
        (belief, found)
    })
}

/// A monitor that searches for distractors, and remembers those of a frame with the target at column 50 if `remembers`.
pub(super) fn beside(remembers: bool) -> Monitor {
    let settings = DistractorSettings { reach: 2.0, step: 1.0, remembered: 2, first_frame: false };
    let mut monitor = Monitor::new(Default::default(), toy::model()).with_distractors(Some(settings));
    look(&mut Toy::at(70.0), 1.0, |view| {
        monitor.search(view, &state(50.0), Distractors::default());
        if remembers {
            monitor.remember(view, &state(50.0));
        }
    });
    monitor
}

/// Particles are drawn again at a better place, unless the patch there was beside the target before, or the target is mostly occluded.
#[test]
fn the_local_search_takes_a_new_place_of_a_visible_target() {
    for (remembers, fraction, leaps) in [(false, 1.0, true), (true, 1.0, false), (false, 0.3, false)] {
        let (belief, _) = searched(&mut beside(remembers), fraction, false, &[]);
        assert_eq!(!belief.drawn.is_empty(), leaps, "remembers {remembers}, {fraction} of it is visible");
    }
}

/// Both searches weigh the particles that they draw by the detections, as the prediction weighs all.
#[test]
fn particles_drawn_again_have_the_detection_likelihood() {
    let found = vec![Detection::new(target(72.0), 1.0)].leak();
    for lost in [false, true] {
        let [without, with] = [&[][..], found].map(|found| searched(&mut beside(false), 1.0, lost, found).0);
        assert!(!with.drawn.is_empty());
        for i in with.drawn {
            let weight = DetectionLikelihood::default().log_likelihood(found, &with.states[i], EXTENT);
            close(with.log_importance[i], without.log_importance[i] + weight);
        }
    }
}

/// The search for a lost target continues while another place in the picture fits best.
#[test]
fn a_search_does_not_end_beside_the_best_place() {
    for elsewhere in [false, true] {
        let mut monitor = beside(false);
        let here = evidence(&mut monitor);
        let lost = FrameEvidence { consistency: Consistency { deficit: 1.0, ..here.consistency }, ..here };
        (0..5).for_each(|_| _ = monitor.judge(true, &lost, (false, 1)));
        let search = searched(&mut monitor, 1.0, true, &[]).1.search;
        let here = FrameEvidence { search: search.filter(|_| elsewhere), ..here };
        (0..5).for_each(|_| _ = monitor.judge(true, &here, (true, 1)));
        assert_eq!(monitor.loss.is_searching(), elsewhere);
    }
    let (_, found) = searched_from(70.0, &mut beside(false), 1.0, true, &[]);
    assert!(found.search.is_some_and(|it| it.best.is_none()), "no place fits better than the estimate");
}

/// The particles are selected if the effective sample size is below the threshold; otherwise they keep their weights.
#[test]
fn selection_waits_for_a_small_sample_size() {
    for (weights, selects) in [([0.5, 0.3, 0.2], false), ([0.98, 0.01, 0.01], true)] {
        let resampling = Resampling { below: 0.5, ..Resampling::default() };
        let mut filter =
            Filter::new(parts(Toy::at(50.0)).filter.proposal, 3).expect("three").with_resampling(resampling);
        let belief =
            Particles { states: [1.0, 2.0, 3.0].map(state).into(), weights: weights.into(), ..Default::default() };
        filter.select(&belief, &belief.estimate(), Streams::new(1, 0), vec![]);
        close(filter.state.log_weights[0].exp(), if selects { 1.0 / 3.0 } else { weights[0] });
    }
}

/// While particles wait, their motion is postponed: 1.5 pixels a frame, four times as far after 16 frames.
#[test]
fn waiting_particles_catch_up() {
    let image = picture();
    let spread = |waited: usize| {
        let (mut engine, scene) = (started(parts(Toy::at(50.0)), 0), Scene { image: &image, detections: &[] });
        assert!(engine.waits());
        (0..waited).for_each(|_| _ = engine.coast(scene));
        engine.step_on(scene);
        engine.record.belief.states.iter().map(|state| (state.x - 50.0).powi(2)).sum::<f64>().sqrt()
    };
    let further = spread(15) / spread(0);
    assert!((2.5..5.0).contains(&further), "{further}");
}

/// A network that counts for returns alone runs in each frame of a search, and in no other.
#[test]
fn the_box_regression_is_asked_while_the_target_is_lost() {
    use crate::identity::box_regression::Settings;
    let box_regression = ReacquisitionWeights { weight: 1.0, bias: 0.0 };
    let model = ConfidenceModel { box_regression, ..toy::model() };
    let network = Settings::default().read(&foveate_base::files::Nowhere).expect("it ships");
    let boxes = BoxRegression::new(Arc::new(network), Settings::default());
    let mut extras = Extras { box_regression: Some(boxes), ..Extras::default() };
    extras.init(&picture(), &state(50.0), EXTENT);
    look(&mut Toy::at(50.0), 1.0, |view| {
        let asked = [false, true].map(|lost| extras.ask(view, &estimate(50.0), &model, lost).is_some());
        assert_eq!(asked, [false, true]);
    });
}

/// The expected errors of the box regression widen the covariance of the reported box: of size and shape in the estimate, of the place, in
/// half boxes, in the evidence. The particles change in confident frames only.
#[test]
fn the_expected_errors_of_the_box_regression_are_reported() {
    use crate::identity::box_regression::Settings;
    let network = Arc::new(Settings::default().read(&foveate_base::files::Nowhere).expect("it ships"));
    let mut given = Estimate { ess: 7.0, moved: [1.0, 2.0], ..estimate(50.0) };
    (given.covariance[4][4], given.covariance[6][6], given.mean.log_scale) = (0.5, 0.25, 3.0f64.ln());
    for confident in [false, true] {
        let boxes = BoxRegression::new(network.clone(), Settings { follow: 0.5, ..Settings::default() });
        let mut extras = Extras { box_regression: Some(boxes), ..Extras::default() };
        extras.init(&picture(), &state(50.0), EXTENT);
        let (reported, change) = look(&mut Toy::at(50.0), 1.0, |view| extras.regress(view, &given, None, confident));
        let errors = extras.box_regression.as_ref().expect("it has one").errors();
        assert!(errors.iter().all(|error| *error > 0.0), "{errors:?}");
        close(reported.covariance[4][4], 0.5 + errors[2] * errors[2]);
        close(reported.covariance[6][6], 0.25 + errors[3] * errors[3]);
        assert!(reported.mean.log_scale != given.mean.log_scale);
        assert_eq!(change != [0.0; 2], confident);
        let place = extras.evidence(&given, crate::geometry::Extent { half_w: 10.0, half_h: 5.0 });
        close(place.errors[0], errors[0] * 30.0);
        close(place.errors[1], errors[1] * 15.0);
        close(place.unit, 3.0 * (crate::geometry::Extent { half_w: 10.0, half_h: 5.0 }).mean());
        assert_eq!((place.ess, place.moved), (7.0, [1.0, 2.0]));
    }
}
