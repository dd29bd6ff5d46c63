//! How probable is it that the target is lost, and since when? A probability that was fitted, and a state with hysteresis.
//!
//! [`Cues`] of a frame, each a ratio or normalised by its own past, so that one table serves many configurations, go
//! through a logistic model: P(lost) = 1 / (1 + exp(−b − Σ wₖ cₖ)). *Lost* means that the box has an IoU below 0.1 with the
//! target, or that the target is not to be seen. The weights are fitted on sequences with truth by `foveate train
//! confidence`; docs/confidence.md has the figures.
//!
//! With a box regression neither is less than what that saw in many looks ([`Absence`]).
//!
//! Deviation: with a second opinion there are two such probabilities. The one that is reported hears it; the one that the tracker acts on
//! does not, so that a second opinion changes no box. A loss is reported once both say so.

use serde::{Deserialize, Serialize};

use super::{Consistency, Status};
use crate::geometry::State;
use crate::reference::ReferenceLikelihood;
use foveate_base::{Error, Result};

mod model;
mod state;

use self::model::MOST_ODDS;
pub use self::model::{AGREEMENT, Absence, CUE_NAMES, CUES, ConfidenceModel, Cues, Heard, OWN, Seen};
use self::state::TrackState;

/// The verdict on one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrackConfidence {
    /// P(lost), 0 to 1.
    pub p_lost: f64,
    /// The same without the second opinion, which is what the tracker acts on: by its own cues and the box regression.
    pub own: f64,
    /// What is reported of the track: occluded or lost from where the tracker acts so and `p_lost` is `leave` or more, until it is found.
    pub status: Status,
    /// What the probability was made of.
    pub cues: Cues,
}

/// What a frame showed.
#[derive(Clone, Copy, Debug)]
pub struct FrameEvidence {
    /// The evidence deficit, smoothed and of this frame.
    pub consistency: Consistency,
    /// Log evidence of a look, nats.
    pub evidence: f64,
    /// The reference likelihood of frame 1.
    pub reference: ReferenceLikelihood,
    /// Log-likelihood of the best distractor (`control/distractors.rs`); `None` where none was searched for, −∞ where none was found.
    pub distractor: Option<f64>,
    /// Standard deviation of the belief about place, template units.
    pub spread: f64,
    /// Distance to the template at the estimate.
    pub distance: f64,
    /// How far the colours at the estimate are from the target's; 0 without a colour model.
    pub colour: f64,
    /// How much more it looks like what was around the target in remembered frames than like the target; 0 where none is.
    pub elsewhere: f64,
    /// Overlap with the box of a second opinion; `None` without one.
    pub agreement: Option<f64>,
    /// Log odds by the box regression that the target is not at the estimate; `None` where it did not look.
    pub absent: Option<f64>,
    /// Mean of the belief.
    pub estimate: State,
    /// Pixels per template unit there.
    pub unit: f64,
    /// A lower bound on P(lost) from elsewhere: the class, say; 0 without one.
    pub alarm: f64,
}

/// Judges frames by a model, and remembers what is usual on the target.
#[derive(Clone, Debug)]
pub struct LossMonitor {
    model: ConfidenceModel,
    past: Past,
}

/// What is remembered between frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Past {
    /// Frames the usual values were taken from.
    frames: usize,
    /// Mean evidence, its mean deviation, and mean distance, on the target.
    evidence: f64,
    deviation: f64,
    distance: f64,
    /// The last estimate, and where it was seen last.
    estimate: State,
    seen: State,
    /// What fitted best in the whole picture, by the last search since it went out.
    best_place: Option<State>,
    /// Nothing is smoothed yet.
    is_new: bool,
    /// Smoothed drop.
    lasting: f64,
    /// Smoothed likeness to what was elsewhere.
    elsewhere: f64,
    /// Smoothed agreement with a second opinion.
    agreement: f64,
    /// What the box regression said lately.
    absence: f64,
    /// The last verdict: the state that the tracker acts on, and whether this loss is reported.
    state: TrackState,
    is_reported: bool,
    p_lost: f64,
    own: f64,
    cues: Cues,
}

/// P(lost) by the own cues, with what the box regression saw in many looks, and with what the second opinion says as well.
struct Verdict {
    cued: f64,
    own: f64,
    reported: f64,
}

/// Share of the newest frame in the usual values, after as many frames as its inverse.
const NEWEST: f64 = 0.05;
/// Share of the newest frame in the smoothed drop.
const SMOOTH: f64 = 0.2;
/// The same, in the likeness to what was elsewhere: a target that returns has to be seen soon.
const SHARPER: f64 = 0.4;
/// Log odds that a target is not there, where the box regression has not looked yet: it was given, or found.
const PRESENT: f64 = -MOST_ODDS;
/// The least deviation of the evidence, as a share of what was promised between on and off.
const LEAST_DEVIATION: f64 = 0.02;

impl Past {
    /// Nothing was seen yet.
    fn none() -> Self {
        Self { is_new: true, absence: PRESENT, ..Self::default() }
    }
}

impl LossMonitor {
    /// A monitor with this model, which has seen nothing yet.
    pub fn new(model: ConfidenceModel) -> Self {
        Self { model, past: Past::none() }
    }

    /// The model.
    pub fn model(&self) -> &ConfidenceModel {
        &self.model
    }

    /// Forgets the past: the target was just given.
    pub fn reset(&mut self) {
        self.past = Past::none();
    }

    /// The target was put somewhere: it is not out until frames say so; what is usual on it stays.
    pub(crate) fn begin_again(&mut self) {
        let Past { frames, evidence, deviation, distance, seen, .. } = self.past;
        self.past = Past { frames, evidence, deviation, distance, seen, ..Past::none() };
    }

    /// Forgets what is usual on the target: looks are compared with something else from now on.
    pub(crate) fn forget_usual(&mut self) {
        let m = &mut self.past;
        (m.frames, m.evidence, m.deviation, m.distance, m.lasting) = (0, 0.0, 0.0, 0.0, 0.0);
        m.absence = PRESENT;
    }

    /// Judges a frame.
    pub fn judge(&mut self, shown: &FrameEvidence) -> TrackConfidence {
        let absent = shown.absent.map(within_odds);
        let cues = self.cues(shown, absent);
        let verdict = self.verdict(&cues, shown.alarm);
        let elsewhere = self.past.best_place.is_some_and(|place| apart(&place, shown));
        // Whether it is back is asked of the last look, not of those before.
        let tells = if self.is_out() { self.model.returned(verdict.cued, absent) } else { verdict.own };
        let confidence = self.conclude(&verdict, tells, elsewhere, cues);
        self.past.estimate = shown.estimate;
        if self.past.frames < (1.0 / NEWEST) as usize / 2 || verdict.own < self.model.leave {
            self.learn(shown);
        }
        confidence
    }

    /// Judges a frame of which only the cues were kept, as if no search had ever found anything elsewhere.
    pub fn rejudge(&mut self, cues: &Cues) -> TrackConfidence {
        let verdict = self.verdict(cues, 0.0);
        let tells = if self.is_out() { verdict.cued } else { verdict.own };
        self.conclude(&verdict, tells, false, *cues)
    }

    /// Keeps a frame's verdict. `tells`: the probability by which the state goes on.
    fn conclude(&mut self, verdict: &Verdict, tells: f64, elsewhere: bool, cues: Cues) -> TrackConfidence {
        let (m, model) = (&mut self.past, &self.model);
        if m.state.stand(model, tells, elsewhere) {
            (m.best_place, m.absence) = (None, PRESENT);
        }
        if m.state.is_out() {
            m.is_reported |= cues[AGREEMENT] < 0.0 || verdict.reported >= model.leave;
        } else if m.state.status == Status::Tracking {
            m.is_reported = false;
        }
        (m.p_lost, m.own, m.cues) = (verdict.reported, verdict.own, cues);
        self.last()
    }

    /// Whether the tracker acts as for an occluded or lost target: by its own cues, reported or not.
    pub fn is_out(&self) -> bool {
        self.past.state.is_out()
    }

    /// P(lost) of these cues, which is not less than `alarm`.
    fn verdict(&self, cues: &Cues, alarm: f64) -> Verdict {
        let (cued, least) = (self.model.own(cues).max(alarm), self.model.by_absence(cues).max(alarm));
        Verdict { cued, own: cued.max(least), reported: self.model.reported(cued, cues).max(least) }
    }

    /// The last verdict, for a frame that tells nothing of the target.
    pub fn last(&self) -> TrackConfidence {
        let past = &self.past;
        let status = if past.is_reported { past.state.status } else { Status::Tracking };
        TrackConfidence { p_lost: past.p_lost, own: past.own, status, cues: past.cues }
    }

    fn cues(&mut self, s: &FrameEvidence, absent: Option<f64>) -> Cues {
        let m = &mut self.past;
        let gap = (s.reference.on - s.reference.off).max(1e-9);
        let (mut drop, mut distance) = (0.0, 0.0);
        if m.frames > 0 {
            let z = (m.evidence - s.evidence) / m.deviation.max(LEAST_DEVIATION * gap);
            drop = if s.evidence.is_finite() { z.max(0.0).ln_1p().min(5.0) } else { 5.0 };
            let least = 0.1 * m.distance + 1e-9;
            distance = ((s.distance + least) / (m.distance + least)).ln();
        }
        // How it looked where it was searched before says nothing of another place.
        let anew = m.state.is_out() && apart(&m.estimate, s);
        let first = std::mem::take(&mut m.is_new) || anew;
        m.lasting += if anew { 1.0 } else { SMOOTH } * (drop - m.lasting);
        m.elsewhere += if first { 1.0 } else { SHARPER } * (s.elsewhere - m.elsewhere);
        let agreement = s.agreement.map(|overlap| if overlap.is_finite() { overlap } else { 0.0 });
        let agreement = agreement.map_or(-1.0, |overlap| {
            m.agreement += if first { 1.0 } else { SMOOTH } * (overlap - m.agreement);
            m.agreement
        });
        if let Some(absent) = absent {
            m.absence += if anew { 1.0 } else { self.model.absence.rate } * (absent - m.absence);
        }
        let absence = if self.model.absence.counts() { m.absence } else { PRESENT };
        let spread = ((s.spread + 0.02).ln()).clamp(-4.0, 4.0);
        let distance = if distance.is_finite() { distance.clamp(-3.0, 3.0) } else { 3.0 };
        let margin = s.distractor.map_or(0.0, |distractor| (s.evidence - distractor) / gap);
        let margin = if margin.is_nan() { 0.0 } else { margin.clamp(-1.0, 1.0) };
        [
            s.consistency.deficit,
            s.consistency.frame_deficit,
            drop,
            m.lasting,
            s.consistency.tempered_ess,
            spread,
            distance,
            margin,
            s.colour,
            m.elsewhere,
            agreement,
            absence,
        ]
    }

    /// What is usual on the target.
    fn learn(&mut self, s: &FrameEvidence) {
        let m = &mut self.past;
        if !(s.evidence.is_finite() && s.distance.is_finite()) {
            return;
        }
        m.frames = m.frames.saturating_add(1);
        let share = NEWEST.max(1.0 / m.frames as f64);
        let off = s.evidence - m.evidence;
        if m.frames > 1 {
            m.deviation += NEWEST.max(1.0 / (m.frames - 1) as f64) * (off.abs() - m.deviation);
        }
        m.evidence += share * off;
        m.distance += share * (s.distance - m.distance);
        m.seen = s.estimate;
    }

    /// Whether the box regression doubts that the target is there, so that nothing is to be learned from it.
    pub(crate) fn is_doubted(&self) -> bool {
        self.model.by_absence(&self.past.cues) >= self.model.leave
    }

    /// Whether the box regression alone says that the target is lost: then the own cues believe what was learned of something else.
    pub(crate) fn is_misled(&self) -> bool {
        let (model, cues) = (&self.model, &self.past.cues);
        model.by_absence(cues) > model.enter && model.own(cues) <= model.enter
    }

    /// What fits best in the whole picture: nothing else is found while it lies elsewhere.
    pub fn searched(&mut self, best: Option<&State>) {
        self.past.best_place = best.copied();
    }

    /// Where the target was seen last; none before the first frame.
    pub fn seen(&self) -> Option<&State> {
        (self.past.frames > 0).then_some(&self.past.seen)
    }

    /// The state to resume from.
    pub fn save(&self) -> serde_json::Value {
        serde_json::to_value(&self.past).expect("plain data is JSON")
    }

    /// Takes up what `save` gave.
    pub fn load(&mut self, saved: &serde_json::Value) -> Result<()> {
        self.past = Past::deserialize(saved)
            .map_err(|e| Error::Invalid(format!("the saved confidence cannot be used: {e}")))?;
        Ok(())
    }
}

/// Log odds as they count.
fn within_odds(odds: f64) -> f64 {
    if odds.is_finite() { odds.clamp(-MOST_ODDS, MOST_ODDS) } else { MOST_ODDS }
}

/// Whether a place is more than a template unit from what a frame shows.
fn apart(place: &State, shown: &FrameEvidence) -> bool {
    (place.x - shown.estimate.x).abs().max((place.y - shown.estimate.y).abs()) > shown.unit
}

#[cfg(test)]
mod tests {
    use super::*;

    const REFERENCE: ReferenceLikelihood = ReferenceLikelihood { on: -2.0, off: -12.0 };

    fn shown(evidence: f64, deficit: f64) -> FrameEvidence {
        let consistency = Consistency { deficit, frame_deficit: deficit, tempered_ess: 0.3, holds: true };
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
            agreement: None,
            absent: None,
            estimate,
            unit: 10.0,
            alarm: 0.0,
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
        assert!(order.is_sorted() && order[3] >= 70 + 3 - 1 && order[3] < 80, "{order:?}");
        assert_eq!(long.last(), Some(&Status::Tracking));
    }

    /// Put somewhere it is not out; compared with something else, what was usual is none.
    #[test]
    fn what_is_given_again_begins_again() {
        let mut c = LossMonitor::new(ConfidenceModel::default());
        (0..30).for_each(|_| _ = c.judge(&shown(-3.0, 0.0)));
        (0..20).for_each(|_| _ = c.judge(&shown(-12.0, 1.0)));
        assert!(c.last().status.is_occluded_or_lost());
        c.begin_again();
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
            assert!(t < 4 || confidence.status.is_occluded_or_lost(), "frame {t}: {confidence:?}");
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
            assert!(c.last().status.is_occluded_or_lost());
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
    /// not. While it is tracked, nothing is heard of that.
    #[test]
    fn what_is_seen_there_decides_whether_it_is_found() {
        let box_regression = Seen { weight: 0.5, bias: 0.5 };
        let model = ConfidenceModel { box_regression, leave: 0.05, ..ConfidenceModel::default() };
        let found = |model: &ConfidenceModel, absent: f64| {
            let mut c = LossMonitor::new(model.clone());
            let mut judge =
                |evidence, deficit| c.judge(&FrameEvidence { absent: Some(absent), ..shown(evidence, deficit) });
            (0..30).for_each(|_| assert_eq!(judge(-3.0, 0.0).status, Status::Tracking));
            (0..20).for_each(|_| _ = judge(-12.0, 1.0));
            let last = (0..20).map(|_| judge(-4.2, 0.5)).last().expect("there were some");
            assert!(last.own > model.leave, "{last:?}");
            !last.status.is_occluded_or_lost()
        };
        assert_eq!(
            [-8.0, -1.0, 0.0, 8.0, f64::NAN].map(|absent| found(&model, absent)),
            [true, false, false, false, false]
        );
        assert!(
            !found(&ConfidenceModel { leave: 0.05, ..ConfidenceModel::default() }, -8.0),
            "without weight it is not heard"
        );
        let odds = |p: f64| (p / (1.0 - p)).ln();
        assert!((odds(model.returned(0.3, Some(-2.0))) - (odds(0.3) - 0.5)).abs() < 1e-9);
        assert_eq!(model.returned(0.3, None), 0.3);
    }

    /// The own cues are content and so is a second opinion; the box regression looks in every third frame, and in each of a lost target.
    #[test]
    fn many_looks_that_miss_the_target_make_it_lost_and_one_does_not() {
        let absence = Absence { rate: 0.25, weight: 3.0, bias: 1.0 };
        let second_opinion = Heard { own: 1.0, agreement: -4.0, bias: 0.0 };
        let run = |absence: Absence, misses: std::ops::Range<usize>| -> Vec<TrackConfidence> {
            let box_regression = Seen { weight: 0.5, bias: 0.5 };
            let model = ConfidenceModel { absence, second_opinion, box_regression, leave: 0.05, ..Default::default() };
            let mut c = LossMonitor::new(model);
            let looks = |t: usize, c: &LossMonitor| t.is_multiple_of(3) || c.last().status.is_occluded_or_lost();
            let judge = |t: usize| {
                let absent = looks(t, &c).then(|| if misses.contains(&t) { 2.0 } else { -4.0 });
                c.judge(&FrameEvidence { absent, agreement: Some(1.0), ..shown(-3.0, 0.0) })
            };
            (0..60).map(judge).collect()
        };
        let tracked = |c: &TrackConfidence| c.status == Status::Tracking && c.p_lost < 0.1;
        assert!(run(absence, 30..33).iter().all(tracked), "one look");
        assert!(run(Absence::default(), 30..60).iter().all(tracked), "it does not count");
        let many = run(absence, 30..60);
        let lost = many.iter().position(|c| !tracked(c)).expect("ten looks");
        assert!((36..45).contains(&lost), "{lost}");
        let last = many[59];
        assert!(last.p_lost > 0.9 && last.own > 0.9, "whatever the others say: {last:?}");
        assert!(run(absence, 0..0).iter().all(|c| c.cues[CUES - 1] < -1.0), "it begins with a target that is there");
        let odd = [f64::NAN, f64::INFINITY, -1e300].map(within_odds);
        assert_eq!(odd, [MOST_ODDS, MOST_ODDS, -MOST_ODDS]);
    }

    /// The own cues say lost. Where the second opinion sees the target it is not reported; where it does not, it is, and stays so until found.
    #[test]
    fn a_loss_is_reported_once_the_second_opinion_agrees() {
        let second_opinion = Heard { own: 0.2, agreement: -8.0, bias: 4.0 };
        let run = |sees: &dyn Fn(usize) -> bool| -> Vec<(bool, Status)> {
            let mut c = LossMonitor::new(ConfidenceModel { second_opinion, ..ConfidenceModel::default() });
            let judge = |t: usize| {
                let off = (30..60).contains(&t);
                let frame = shown(if off { -12.0 } else { -3.0 - 0.1 * (t % 3) as f64 }, if off { 1.0 } else { 0.0 });
                let status =
                    c.judge(&FrameEvidence { agreement: Some(if sees(t) { 1.0 } else { 0.0 }), ..frame }).status;
                (c.is_out(), status)
            };
            (0..90).map(judge).collect()
        };
        let never = run(&|_| true);
        assert!(
            never[35..58].iter().all(|(out, _)| *out) && never.iter().all(|(_, s)| *s == Status::Tracking),
            "{never:?}"
        );
        let later = run(&|t| !(40..50).contains(&t));
        let reported: Vec<usize> = (0..90).filter(|t| later[*t].1.is_occluded_or_lost()).collect();
        let out: Vec<usize> = (0..90).filter(|t| later[*t].0).collect();
        assert!((40..45).contains(&reported[0]) && reported.last() == out.last(), "{reported:?} {out:?}");
        assert!(later.iter().any(|(_, s)| *s == Status::Reacquired));
        let boxes = |run: &[(bool, Status)]| run.iter().map(|(out, _)| *out).collect::<Vec<_>>();
        assert_eq!(boxes(&never), boxes(&later), "it acts on nothing of it");
    }

    /// Where a second opinion is elsewhere P(lost) rises, as the model says; what is acted on goes by the own cues.
    #[test]
    fn a_second_opinion_is_heard_and_not_acted_on() {
        let second_opinion = Heard { own: 0.5, agreement: -4.0, bias: 1.0 };
        let model = ConfidenceModel { second_opinion, ..ConfidenceModel::default() };
        let (mut alone, mut pair) = (LossMonitor::new(ConfidenceModel::default()), LossMonitor::new(model));
        for t in 0..80 {
            let off = (40..60).contains(&t);
            let frame = shown(if off { -12.0 } else { -3.0 - 0.1 * (t % 3) as f64 }, if off { 1.0 } else { 0.0 });
            let agreement = Some(if t < 20 { 0.8 } else { 0.0 });
            let (without, with) = (alone.judge(&frame), pair.judge(&FrameEvidence { agreement, ..frame }));
            assert_eq!((without.own, without.status), (with.own, with.status), "frame {t}");
            assert_eq!((without.p_lost, without.cues[OWN]), (without.own, -1.0), "frame {t}");
            let odds = 0.5 * (with.own / (1.0 - with.own)).ln() - 4.0 * with.cues[OWN] + 1.0;
            assert!((with.p_lost - 1.0 / (1.0 + (-odds).exp())).abs() < 1e-9, "frame {t}: {with:?}");
        }
    }

    #[test]
    fn it_goes_on_from_what_was_saved() {
        let frames: Vec<_> = (0..50).map(|t| shown(-3.0 - (t % 7) as f64, 0.02 * t as f64)).collect();
        let mut c = LossMonitor::new(ConfidenceModel::default());
        for f in &frames[..25] {
            c.judge(f);
        }
        let mut other = LossMonitor::new(ConfidenceModel::default());
        other.load(&c.save()).expect("it was saved");
        assert!(frames[25..].iter().all(|f| c.judge(f) == other.judge(f)));
        assert!(other.load(&serde_json::json!({ "frames": "many" })).is_err());
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
}
