use super::*;
use crate::saved_state::SavedState;

const REFERENCE: ReferenceLikelihood = ReferenceLikelihood { on: -2.0, off: -12.0 };

fn shown(evidence: f64, deficit: f64) -> FrameEvidence {
    let consistency =
        Consistency { deficit, frame_deficit: deficit, tempered_ess: 0.3, holds: true, is_informative: true };
    let estimate = State::default();
    FrameEvidence {
        consistency,
        evidence,
        reference: REFERENCE,
        distractor: None,
        spread: 0.1,
        distance: 0.1 - 0.02 * evidence,
        colour: 0.0,
        elsewhere: 0.0,
        innovation: 0.0,
        agreement: None,
        absent: None,
        estimate,
        unit: 10.0,
        alarm: 0.0,
        search: None,
    }
}

/// On the target for a while, then hidden for `hidden` frames, then back: the statuses.
fn statuses(hidden: usize) -> Vec<Status> {
    let mut c = LossMonitor::new(ConfidenceModel::default());
    let frame = |t: usize| {
        let on = !(30..30 + hidden).contains(&t);
        shown(if on { -3.0 - 0.1 * (t % 3) as f64 } else { -12.0 }, if on { 0.0 } else { 1.0 })
    };
    (0..60 + hidden).map(|t| c.judge(&frame(t)).status).collect()
}

#[test]
fn a_moment_is_an_occlusion_and_long_is_lost_until_found() {
    let short = statuses(8);
    assert!(short[..30].iter().all(|s| *s == Status::Tracking) && short[36] == Status::Occluded, "{short:?}");
    assert!(!short.contains(&Status::Lost) && !short.contains(&Status::Reacquired), "{short:?}");
    let long = statuses(40);
    let first = |s: Status| long.iter().position(|x| *x == s).expect("it comes");
    let order = [Status::Tracking, Status::Occluded, Status::Lost, Status::Reacquired].map(first);
    assert!(order.is_sorted() && order[2] == order[1] + 15 && (70..75).contains(&order[3]), "{order:?}");
    assert_eq!(long.last(), Some(&Status::Tracking));
}

/// Placed by a user, the target is not lost; with another reference, usual values are unset.
#[test]
fn what_is_given_again_begins_again() {
    let mut c = LossMonitor::new(ConfidenceModel::default());
    (0..30).for_each(|_| _ = c.judge(&shown(-3.0, 0.0)));
    (0..20).for_each(|_| _ = c.judge(&shown(-12.0, 1.0)));
    assert!(!c.last().status.is_usable());
    c.restart(&State::default());
    let TrackConfidence { status, p_lost, own, .. } = c.last();
    assert_eq!((status, p_lost, own), (Status::Tracking, 0.0, 0.0), "nothing is known of it yet");
    let first = c.judge(&FrameEvidence { agreement: Some(0.9), elsewhere: 0.2, ..shown(-3.0, 0.0) });
    assert_eq!((first.status, first.cues[AGREEMENT], first.cues[9]), (Status::Tracking, 0.9, 0.2));
    let drop = |c: &mut LossMonitor| c.judge(&shown(-6.0, 0.0)).cues[2];
    assert!(drop(&mut c.clone()) > 0.5, "less than usual");
    c.forget_usual();
    assert_eq!(drop(&mut c), 0.0, "nothing is usual yet");
}

#[test]
fn one_frame_that_fits_by_chance_finds_nothing() {
    let mut c = LossMonitor::new(ConfidenceModel::default());
    for _ in 0..30 {
        c.judge(&shown(-3.0, 0.0));
    }
    for t in 0..60 {
        let chance = t > 20 && t % 3 == 0;
        let confidence = c.judge(&shown(if chance { -3.0 } else { -12.0 }, if chance { 0.0 } else { 1.0 }));
        assert!(t < 4 || c.is_searching(), "frame {t}: {confidence:?}");
    }
}

/// The smoothed cues of a lost target start anew where the estimate leaps, and only there.
#[test]
fn what_was_seen_elsewhere_does_not_last_after_a_leap() {
    let cues_after = |moved: f64| {
        let mut c = LossMonitor::new(ConfidenceModel::default());
        for _ in 0..30 {
            c.judge(&shown(-3.0, 0.0));
        }
        for _ in 0..20 {
            c.judge(&FrameEvidence { elsewhere: 0.5, ..shown(-12.0, 1.0) });
        }
        assert!(!c.last().status.is_usable());
        let mut back = shown(-3.0, 0.5);
        back.estimate.x += moved * back.unit;
        let cues = c.judge(&back).cues;
        (cues[3], cues[9])
    };
    let (lasting, elsewhere) = cues_after(0.9);
    assert!(lasting > 1.0 && elsewhere > 0.2, "{lasting} {elsewhere}");
    let (lasting, elsewhere) = cues_after(1.1);
    assert!(lasting < 0.1 && elsewhere == 0.0, "{lasting} {elsewhere}");
}

/// Away, frames that fit half: P(lost) stays above `leave`, and they find nothing. They do where the target is seen there, and never where it is
/// not. While the target is tracked, this answer is not used.
#[test]
fn what_is_seen_there_decides_whether_it_is_found() {
    let box_regression = ReacquisitionWeights { weight: 0.5, bias: 0.5 };
    let model = ConfidenceModel { box_regression, leave: 0.05, ..ConfidenceModel::default() };
    let found = |model: &ConfidenceModel, absent: f64| {
        let mut c = LossMonitor::new(model.clone());
        let mut judge =
            |evidence, deficit| c.judge(&FrameEvidence { absent: Some(absent), ..shown(evidence, deficit) });
        (0..30).for_each(|_| assert_eq!(judge(-3.0, 0.0).status, Status::Tracking));
        (0..20).for_each(|_| _ = judge(-12.0, 1.0));
        let last = (0..20).map(|_| judge(-4.2, 0.5)).last().expect("there were some");
        assert!(last.own > model.leave, "{last:?}");
        !c.is_searching()
    };
    assert_eq!(
        [-8.0, -1.0, 0.0, 8.0, f64::NAN].map(|absent| found(&model, absent)),
        [true, false, false, false, false]
    );
    assert!(
        !found(&ConfidenceModel { leave: 0.05, ..ConfidenceModel::default() }, -8.0),
        "without weight it is not used"
    );
    let logit = |p: f64| (p / (1.0 - p)).ln();
    assert!((logit(model.returned(0.3, Some(-2.0))) - (logit(0.3) - 0.5)).abs() < 1e-9);
    assert_eq!(model.returned(0.3, None), 0.3);
}

/// The own cues are content and so is a second opinion; the box regression looks in every third frame, and in each of a lost target.
#[test]
fn many_looks_that_miss_the_target_make_it_lost_and_one_does_not() {
    let absence = AbsenceWeights { rate: 0.25, weight: 3.0, bias: 1.0 };
    let second_opinion = SecondTrackerWeights { own: 1.0, agreement: -4.0, leap: 0.0, absence: 0.0, bias: 0.0 };
    let run = |absence: AbsenceWeights, misses: std::ops::Range<usize>| -> Vec<TrackConfidence> {
        let box_regression = ReacquisitionWeights { weight: 0.5, bias: 0.5 };
        let model = ConfidenceModel { absence, second_opinion, box_regression, leave: 0.05, ..Default::default() };
        let mut c = LossMonitor::new(model);
        let looks = |t: usize, c: &LossMonitor| t.is_multiple_of(3) || c.is_searching();
        let judge = |t: usize| {
            let absent = looks(t, &c).then(|| if misses.contains(&t) { 2.0 } else { -4.0 });
            c.judge(&FrameEvidence { absent, agreement: Some(1.0), ..shown(-3.0, 0.0) })
        };
        (0..60).map(judge).collect()
    };
    let tracked = |c: &TrackConfidence| c.status == Status::Tracking && c.p_lost < 0.1;
    assert!(run(absence, 30..33).iter().all(tracked), "one look");
    assert!(run(AbsenceWeights::default(), 30..60).iter().all(tracked), "it does not count");
    let many = run(absence, 30..60);
    let lost = many.iter().position(|c| !tracked(c)).expect("ten looks");
    assert!((36..45).contains(&lost), "{lost}");
    let last = many[59];
    assert!(last.p_lost > 0.9 && last.own > 0.9, "whatever the others say: {last:?}");
    assert!(run(absence, 0..0).iter().all(|c| c.cues[ABSENCE] < -1.0), "it begins with a target that is there");
    let odd = [f64::NAN, f64::INFINITY, -1e300].map(within_odds);
    assert_eq!(odd, [MOST_ODDS, MOST_ODDS, -MOST_ODDS]);
}

/// The own cues indicate a loss. The second opinion changes the reported P(lost) only.
#[test]
fn a_loss_is_reported_where_the_second_opinion_agrees() {
    let second_opinion = SecondTrackerWeights { own: 0.2, agreement: -8.0, leap: 0.0, absence: 0.0, bias: 4.0 };
    let run = |sees: &dyn Fn(usize) -> bool| -> Vec<(bool, TrackConfidence)> {
        let mut c = LossMonitor::new(ConfidenceModel { second_opinion, ..ConfidenceModel::default() });
        let judge = |t: usize| {
            let off = (30..60).contains(&t);
            let frame = shown(if off { -12.0 } else { -3.0 - 0.1 * (t % 3) as f64 }, if off { 1.0 } else { 0.0 });
            let confidence = c.judge(&FrameEvidence { agreement: Some(if sees(t) { 1.0 } else { 0.0 }), ..frame });
            (c.is_searching(), confidence)
        };
        (0..90).map(judge).collect()
    };
    let never = run(&|_| true);
    assert!(
        never[35..58].iter().all(|(searching, _)| *searching)
            && never.iter().all(|(_, c)| c.status == Status::Tracking && c.p_lost < 0.3),
        "{never:?}"
    );
    let later = run(&|t| !(40..50).contains(&t));
    let reported: Vec<usize> = (0..90).filter(|t| !later[*t].1.status.is_usable()).collect();
    assert!((40..45).contains(&reported[0]) && (50..60).contains(reported.last().expect("some")), "{reported:?}");
    let agrees = |c: &TrackConfidence| if c.status.is_usable() { c.p_lost < 0.5 } else { c.p_lost >= 0.3 };
    assert!(later.iter().all(|(_, c)| agrees(c)), "{later:?}");
    let searched = |run: &[(bool, TrackConfidence)]| run.iter().map(|(searching, _)| *searching).collect::<Vec<_>>();
    assert_eq!(searched(&never), searched(&later), "it acts on nothing of it");
}

/// A frame that is not judged keeps P(lost), and its status follows from that.
#[test]
fn a_frame_that_is_not_judged_goes_on_with_its_p_lost() {
    let mut c = LossMonitor::new(ConfidenceModel { patience: 3, ..ConfidenceModel::default() });
    (0..30).for_each(|_| _ = c.judge(&shown(-3.0, 0.0)));
    let first = std::iter::repeat_with(|| c.judge(&shown(-12.0, 1.0))).find(|it| it.p_lost >= 0.5).expect("soon");
    assert_eq!(first.status, Status::Occluded);
    let held: Vec<_> = (0..4).map(|_| c.hold(None)).collect();
    assert!(held.iter().all(|it| it.p_lost == first.p_lost));
    use Status::{Lost, Occluded};
    assert_eq!(held.iter().map(|it| it.status).collect::<Vec<_>>(), [Occluded, Occluded, Lost, Lost]);
}

/// If the second tracker is elsewhere, P(lost) rises by the model. The tracker acts on its own cues alone.
#[test]
fn a_second_opinion_is_reported_and_not_acted_on() {
    let second_opinion = SecondTrackerWeights { own: 0.5, agreement: -4.0, leap: 0.0, absence: 0.0, bias: 1.0 };
    let model = ConfidenceModel { second_opinion, ..ConfidenceModel::default() };
    let (mut alone, mut pair) = (LossMonitor::new(ConfidenceModel::default()), LossMonitor::new(model));
    for t in 0..80 {
        let off = (40..60).contains(&t);
        let frame = shown(if off { -12.0 } else { -3.0 - 0.1 * (t % 3) as f64 }, if off { 1.0 } else { 0.0 });
        let agreement = Some(if t < 20 { 0.8 } else { 0.0 });
        let (without, with) = (alone.judge(&frame), pair.judge(&FrameEvidence { agreement, ..frame }));
        assert_eq!((without.own, alone.is_searching()), (with.own, pair.is_searching()), "frame {t}");
        assert_eq!((without.p_lost, without.cues[OWN]), (without.own, -1.0), "frame {t}");
        let odds = 0.5 * (with.own / (1.0 - with.own)).ln() - 4.0 * with.cues[OWN] + 1.0;
        assert!((with.p_lost - 1.0 / (1.0 + (-odds).exp())).abs() < 1e-9, "frame {t}: {with:?}");
    }
}

/// Other colours at a place that fits no better than its surroundings: the target has gone, though the second opinion agrees. A change of
/// colours alone is not enough. The bound ends after some confident frames, and only the reported P(lost) takes it in.
#[test]
fn a_loss_in_the_first_frames_is_reported_where_the_second_opinion_agrees() {
    let early = EarlyWeights { frames: 5, change: 6.0, absence: 1.0, bias: 3.0 };
    let absence = AbsenceWeights { rate: 1.0, weight: 1.0, bias: -9.0 };
    let second_opinion = SecondTrackerWeights { own: 1.0, agreement: -6.0, leap: 0.0, absence: 0.0, bias: 0.0 };
    let model = ConfidenceModel { early, absence, second_opinion, ..ConfidenceModel::default() };
    let frame = |colour: f64, margin: f64| {
        let distractor = Some(-7.0 - 10.0 * margin);
        let agreement = Some(1.0);
        FrameEvidence { colour, distractor, agreement, absent: Some(-6.0), ..shown(-7.0, 0.0) }
    };
    for (confident, colour, margin, expected) in
        [(0, 1.0, 0.0, true), (0, 1.0, 0.9, false), (0, 0.1, 0.0, false), (4, 1.0, 0.0, true), (5, 1.0, 0.0, false)]
    {
        let mut c = LossMonitor::new(model.clone());
        (0..confident).for_each(|_| assert!(c.judge(&frame(0.0, 0.9)).own < 0.05));
        let mut off = c.clone();
        off.model.early.frames = 0;
        let [with, without] = [&mut c, &mut off].map(|c| c.judge(&frame(colour, margin)));
        assert_eq!(with.own, without.own, "the tracker acts as without the bound");
        assert!(without.p_lost < 0.1, "{without:?}");
        let by_hand = 1.0 / (1.0 + (-6.0 * (colour - margin).max(0.0) + 6.0 - 3.0f64).exp());
        let bound = if confident < 5 { by_hand } else { 0.0 };
        assert!((with.p_lost - without.p_lost.max(bound)).abs() < 1e-12, "{with:?}");
        assert_eq!(!with.status.is_usable(), expected, "{confident} frames, colour {colour}, margin {margin}");
    }
    let mut c = LossMonitor::new(model);
    (0..5).for_each(|_| _ = c.judge(&frame(0.0, 0.9)));
    c.restart(&State::default());
    assert!(c.judge(&frame(1.0, 0.0)).status.is_usable(), "another place, the same template");
    c.forget_usual();
    assert!(!c.judge(&frame(1.0, 0.0)).status.is_usable(), "a new template is young");
}

#[test]
fn a_saved_monitor_continues() {
    let frames: Vec<_> = (0..50).map(|t| shown(-3.0 - (t % 7) as f64, 0.02 * t as f64)).collect();
    let mut c = LossMonitor::new(ConfidenceModel::default());
    for f in &frames[..25] {
        c.judge(f);
    }
    let mut other = LossMonitor::new(ConfidenceModel::default());
    other.state = SavedState::new(&c.state).state("confidence", &()).expect("it was saved");
    assert!(frames[25..].iter().all(|f| c.judge(f) == other.judge(f)));
    let damaged = LossState { p_lost: 1.5, ..c.state.clone() };
    assert!(damaged.validate(&()).expect_err("no probability").contains("1.5"));
    for damaged in [LossState { innovation: -0.5, ..c.state.clone() }, LossState { leap: -0.5, ..c.state }] {
        assert!(damaged.validate(&()).expect_err("no distance").contains("-0.5"));
    }
}

/// An alarm is a lower bound of P(lost), own and reported, whatever the cues, the second tracker and the box regression indicate. A search
/// begins under an alarm and does not end under one.
#[test]
fn an_alarm_is_a_lower_bound_of_p_lost() {
    let second_opinion = SecondTrackerWeights { own: 1.0, agreement: -8.0, leap: 0.0, absence: 0.0, bias: 0.0 };
    let absence = AbsenceWeights { rate: 1.0, weight: 1.0, bias: 0.0 };
    for model in [
        ConfidenceModel::default(),
        ConfidenceModel { second_opinion, ..ConfidenceModel::default() },
        ConfidenceModel { absence, second_opinion, ..ConfidenceModel::default() },
    ] {
        let mut c = LossMonitor::new(model);
        let frame =
            |alarm: f64| FrameEvidence { alarm, agreement: Some(1.0), absent: Some(-MOST_ODDS), ..shown(-3.0, 0.0) };
        (0..30).for_each(|_| _ = c.judge(&frame(0.0)));
        for alarm in [0.4, 0.9] {
            let it = c.clone().judge(&frame(alarm));
            assert_eq!((it.own, it.p_lost), (alarm, alarm), "the rest is sure: {:?}", c.last());
        }
        (0..10).for_each(|_| _ = c.judge(&frame(0.9)));
        assert!(c.is_searching() && !c.last().status.is_usable());
        (0..10).for_each(|_| _ = c.judge(&frame(0.0)));
        assert!(!c.is_searching() && c.last().status.is_usable());
    }
}

/// The logit of absence starts anew where the estimate of a lost target leaps, and after the target was found.
#[test]
fn the_running_mean_of_absence_starts_anew() {
    let absence = AbsenceWeights { rate: 0.25, weight: 1.0, bias: 0.0 };
    let mut c = LossMonitor::new(ConfidenceModel { absence, ..ConfidenceModel::default() });
    (0..30).for_each(|_| _ = c.judge(&shown(-3.0, 0.0)));
    (0..20).for_each(|_| _ = c.judge(&FrameEvidence { absent: Some(5.0), ..shown(-12.0, 1.0) }));
    assert!(c.is_searching());
    let mut there = FrameEvidence { absent: Some(-4.0), ..shown(-3.0, 0.0) };
    there.estimate.x += 2.0 * there.unit;
    assert_eq!(c.judge(&there).cues[ABSENCE], -4.0);
    let found = std::iter::repeat_with(|| {
        c.judge(&FrameEvidence { absent: Some(-4.0), ..there });
        c.is_searching()
    });
    assert!(found.take(20).any(|searching| !searching));
    assert_eq!(c.judge(&FrameEvidence { absent: None, ..there }).cues[ABSENCE], PRESENT);
}

/// The usual values survive a restart, which is at the same target, and nothing else does. A new template resets them.
#[test]
fn a_restart_keeps_the_usual_values() {
    let absence = AbsenceWeights { rate: 0.25, weight: 1.0, bias: 0.0 };
    let mut c = LossMonitor::new(ConfidenceModel { absence, ..ConfidenceModel::default() });
    let estimate = State { x: 5.0, ..State::default() };
    let frame = |t: usize| FrameEvidence { absent: Some(-2.0), estimate, ..shown(-3.0 - 0.1 * (t % 3) as f64, 0.0) };
    (0..30).for_each(|t| _ = c.judge(&frame(t)));
    let after = |reset: fn(&mut LossMonitor)| {
        let mut c = c.clone();
        reset(&mut c);
        let cues = c.judge(&shown(-6.0, 0.0)).cues;
        (cues[2] > 0.5, cues[ABSENCE] > -3.0)
    };
    let usual =
        |c: &LossMonitor| (c.state.evidence, c.state.deviation, c.state.distance, c.state.innovation, c.state.frames);
    let (mut restarted, given) = (c.clone(), State { x: 70.0, ..State::default() });
    restarted.restart(&given);
    assert_eq!(usual(&restarted), usual(&c));
    assert_eq!(restarted.seen(), Some(&given), "the given place is the last that is known");
    assert_eq!(after(|_| ()), (true, true));
    assert_eq!(after(|c| c.restart(&State::default())), (true, false));
    assert_eq!(after(LossMonitor::forget_usual), (false, false));
}

/// The particles follow the box regression unless the reported P(lost) is large, by the own cues, in the first frames, or by the second
/// tracker alone; nor do they in a search.
#[test]
fn the_particles_follow_the_box_regression_while_p_lost_is_small() {
    let second_opinion = SecondTrackerWeights { own: 1.0, agreement: -8.0, leap: 0.0, absence: 0.0, bias: 8.0 };
    let early = EarlyWeights { frames: 3, change: 8.0, absence: 0.0, bias: -4.0 };
    let mut c = LossMonitor::new(ConfidenceModel { second_opinion, early, ..ConfidenceModel::default() });
    let mut follows = |agreement, frame: FrameEvidence| {
        let frame = FrameEvidence { agreement: Some(agreement), distractor: Some(frame.evidence), ..frame };
        let own = c.judge(&frame).own;
        (c.follows(), c.is_searching(), own < 0.3)
    };
    let (good, bad) = (shown(-3.0, 0.0), shown(-12.0, 1.0));
    assert_eq!(follows(1.0, FrameEvidence { colour: 1.0, ..good }), (false, false, true), "the first frame");
    (0..30).for_each(|_| _ = follows(1.0, good));
    assert_eq!(follows(1.0, FrameEvidence { colour: 1.0, ..good }), (true, false, true));
    (0..9).for_each(|_| _ = follows(0.0, good));
    assert_eq!(follows(0.0, good), (false, false, true), "the second tracker is elsewhere");
    (0..30).for_each(|_| _ = follows(1.0, good));
    assert_eq!(follows(1.0, bad), (false, false, false), "the own P(lost)");
    (0..5).for_each(|_| _ = follows(1.0, bad));
    assert_eq!(follows(1.0, good), (false, true, true), "a search");
}

/// A leap of the box raises the reported P(lost) of the frames after it, less and less, and the more unusual it is; the own P(lost) is that
/// without it. What the estimate does during a search is no leap.
#[test]
fn a_leap_is_remembered() {
    let second_opinion = SecondTrackerWeights { own: 1.0, agreement: -4.0, leap: 1.0, absence: 0.0, bias: 0.0 };
    let run = |usual: f64, leap: f64| {
        let mut c = LossMonitor::new(ConfidenceModel { second_opinion, ..ConfidenceModel::default() });
        let mut judge = |innovation| c.judge(&FrameEvidence { innovation, agreement: Some(1.0), ..shown(-3.0, 0.0) });
        (0..30).for_each(|_| _ = judge(usual));
        let first = judge(leap);
        (0..45).for_each(|_| _ = judge(usual));
        (first, judge(usual))
    };
    let logit = |p: f64| (p / (1.0 - p)).ln();
    let (none, _) = run(0.1, 0.1);
    let (first, later) = run(0.1, 2.0);
    assert!(
        (first.cues[LEAP] - (2.05f64 / 0.15).ln() + 0.5).abs() < 1e-9 && none.cues[LEAP] < 1e-9,
        "{first:?} {none:?}"
    );
    assert!((logit(first.p_lost) - logit(none.p_lost) - first.cues[LEAP]).abs() < 1e-9 && first.own == none.own);
    // Half after 46 frames.
    let kept = 2.0 * KEPT.powi(46);
    assert!(
        (0.99..1.01).contains(&kept) && (later.cues[LEAP] - ((kept + 0.05) / 0.15f64).ln() + 0.5).abs() < 0.03,
        "{later:?}"
    );
    assert!(run(1.0, 2.0).0.cues[LEAP] < 0.2, "it often leaps");
    let mut lost = LossMonitor::new(ConfidenceModel::default());
    let judge = |c: &mut LossMonitor, t: usize| {
        let (fit, deficit) = if t < 30 { (-3.0, 0.0) } else { (-12.0, 1.0) };
        c.judge(&FrameEvidence { innovation: if t < 40 { 0.1 } else { 9.0 }, ..shown(fit, deficit) }).cues[LEAP]
    };
    assert!((0..60).all(|t| judge(&mut lost, t) < 1e-9) && lost.is_searching());
}

/// The tracker was misled if only the box regression reports the loss. The first frames are usual, however they fit.
#[test]
fn only_the_box_regression_reports_that_the_tracker_was_misled() {
    let absence = AbsenceWeights { rate: 1.0, weight: 1.0, bias: 0.0 };
    let mut weights = [0.0; OWN];
    weights[0] = 20.0;
    for (deficit, absent, misled) in [(0.0, 6.0, true), (1.0, 6.0, false), (0.0, -6.0, false)] {
        let mut c = LossMonitor::new(ConfidenceModel { absence, weights, bias: -10.0, ..ConfidenceModel::default() });
        (0..8).for_each(|_| _ = c.judge(&FrameEvidence { absent: Some(absent), ..shown(-3.0, deficit) }));
        assert_eq!((c.is_misled(), c.state.frames), (misled, 8), "deficit {deficit}, absent {absent}");
    }
}

/// Whatever comes in: a probability, and finite cues.
#[test]
fn nothing_is_too_strange() {
    let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -1e300, 1e300];
    let mut c = LossMonitor::new(ConfidenceModel::default());
    for (a, b) in odd.iter().flat_map(|a| odd.iter().map(move |b| (*a, *b))) {
        let strange = FrameEvidence { evidence: a, spread: b.abs().min(1e6), distance: b, ..shown(-3.0, 0.5) };
        let confidence = c.judge(&strange);
        assert!((0.0..=1.0).contains(&confidence.p_lost), "{confidence:?}");
        assert!(confidence.cues.iter().all(|c| c.is_finite()), "{confidence:?}");
    }
}

/// The usual values of the first frames are means: of the evidence, of the distance, and of how far the evidence is from the mean before.
#[test]
fn usual_values_are_means_over_the_frames_on_the_target() {
    let mut c = LossMonitor::new(ConfidenceModel::default());
    let evidence = [-3.0, -5.0, -4.0, -8.0, -3.5, -2.0];
    for n in 1..=evidence.len() {
        c.judge(&shown(evidence[n - 1], 0.0));
        let mean = |n: usize| evidence[..n].iter().sum::<f64>() / n as f64;
        let off: f64 = (1..n).map(|k| (evidence[k] - mean(k)).abs()).sum();
        let expected = [mean(n), 0.1 - 0.02 * mean(n), if n > 1 { off / (n - 1) as f64 } else { 0.0 }];
        let found = [c.state.evidence, c.state.distance, c.state.deviation];
        found.iter().zip(expected).for_each(|(a, b)| assert!((a - b).abs() < 1e-12, "{found:?}, not {expected:?}"));
    }
}

/// After the first frames only those with a P(lost) below `leave` are usual, and a frame without a distance never is.
#[test]
fn doubtful_frames_are_not_usual() {
    let mut c = LossMonitor::new(ConfidenceModel::default());
    (0..20).for_each(|_| _ = c.judge(&shown(-3.0, 0.0)));
    assert_eq!(c.state.frames, 20);
    c.judge(&FrameEvidence { distance: f64::NAN, ..shown(-3.0, 0.0) });
    assert!(c.judge(&shown(-12.0, 2.0)).own >= c.model.leave);
    assert_eq!(c.state.frames, 20);
}

/// The cues *spread* and *distance* by their formulas.
#[test]
fn cues_are_logarithms() {
    let mut c = LossMonitor::new(ConfidenceModel::default());
    (0..5).for_each(|_| _ = c.judge(&shown(-3.0, 0.0)));
    let cues = c.judge(&FrameEvidence { spread: 0.3, distance: 0.08, ..shown(-3.0, 0.0) }).cues;
    assert!((cues[5] - 0.32f64.ln()).abs() < 1e-9, "{cues:?}");
    assert!((cues[6] - (0.096f64 / 0.176).ln()).abs() < 1e-6, "{cues:?}");
}

/// The cues of a series give its P(lost) and status again.
#[test]
fn a_series_is_judged_again_by_its_cues() {
    let [mut judged, mut again] = [(); 2].map(|()| LossMonitor::new(ConfidenceModel::default()));
    for t in 0..90 {
        let off = (30..60).contains(&t);
        let confidence = judged.judge(&shown(if off { -12.0 } else { -3.0 }, if off { 1.0 } else { 0.0 }));
        assert_eq!(again.rejudge(&confidence.cues), confidence, "frame {t}");
    }
}

/// A place is apart if it is more than a template unit from the estimate along either axis.
#[test]
fn places_are_apart_along_either_axis() {
    let frame = FrameEvidence { estimate: State { x: 20.0, y: 40.0, ..State::default() }, ..shown(-3.0, 0.0) };
    for (x, y, exact) in [
        (20.0, 40.0, false),
        (29.0, 31.0, false),
        (11.0, 49.0, false),
        (9.0, 40.0, true),
        (31.0, 40.0, true),
        (20.0, 29.0, true),
        (20.0, 51.0, true),
    ] {
        assert_eq!(apart(&State { x, y, ..State::default() }, &frame), exact, "{x}, {y}");
    }
}
