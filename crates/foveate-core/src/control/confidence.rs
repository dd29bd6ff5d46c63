//! How probable is it that the target is lost? A fitted probability, a status that follows from it, and whether the tracker searches.
//!
//! [`Cues`] of a frame, each a ratio or normalised by its own past, so that one table serves many configurations, go
//! through a logistic model: P(lost) = 1 / (1 + exp(−b − Σ wₖ cₖ)). *Lost* means that the box has an IoU below 0.1 with the
//! target, or that the target is not visible. The weights are fitted on sequences with truth by `foveate train
//! confidence`; docs/confidence.md has the figures.
//!
//! With a box regression both are at least its lower bound ([`AbsenceWeights`]). While the reference is young, the reported one is at least
//! that of [`EarlyWeights`].
//!
//! Deviation: with a second opinion there are two such probabilities. The reported one includes it; the *own* one, which starts a search and
//! decides what is learned, does not. So there are two states as well: [`LossMonitor::is_searching`] follows from the own P(lost) over several
//! frames (`search.rs`), the reported [`Status`] from the reported P(lost) alone (`status.rs`). While the reported one is large, the particles
//! do not follow the box regression.

use serde::{Deserialize, Serialize};

use super::status::ReportedStatus;
use super::{Consistency, Status};
use crate::geometry::State;
use crate::reference::ReferenceLikelihood;
use crate::saved_state::{Valid, Validate, ensure};

mod localisation;
mod model;
mod search;
mod vote;

pub use self::localisation::{Localisation, PlaceEvidence};
use self::model::MOST_ODDS;
pub use self::model::{
    ABSENCE, AGREEMENT, AbsenceWeights, CUE_NAMES, CUES, ConfidenceModel, Cues, EarlyWeights, LEAP, OWN,
    ReacquisitionWeights, SecondTrackerWeights,
};
use self::search::SearchState;
pub use self::vote::{Ballot, Vote};

/// A box that overlaps the target less (IoU) is lost.
pub const LOST: f64 = 0.1;

/// The verdict on one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrackConfidence {
    /// P(lost), 0 to 1.
    pub p_lost: f64,
    /// The same without the second tracker: by the own cues and the box regression. It decides when to search and what to learn.
    pub own: f64,
    /// The reported status. It follows from the series of `p_lost` alone: see [`ConfidenceModel::status`].
    pub status: Status,
    /// The cues of the probability.
    pub cues: Cues,
}

/// The evidence of one frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameEvidence {
    /// The evidence deficit, smoothed and of this frame.
    pub consistency: Consistency,
    /// Log evidence of a look, nats.
    pub evidence: f64,
    /// The reference likelihood of frame 1.
    pub reference: ReferenceLikelihood,
    /// Log-likelihood of the best distractor (`control/distractors.rs`); `None` without a search, −∞ if none was
    /// found.
    pub distractor: Option<f64>,
    /// Standard deviation of the belief about place, template units.
    pub spread: f64,
    /// Distance to the template at the estimate.
    pub distance: f64,
    /// How far the colours at the estimate are from the target's; 0 without a colour model.
    pub colour: f64,
    /// How much more it resembles the surroundings of the target in remembered frames than the target; 0 without
    /// memory.
    pub elsewhere: f64,
    /// Distance of the estimate from its prediction, half boxes, for each frame since the last one.
    pub innovation: f64,
    /// Overlap (IoU) with the box of the second tracker; `None` without one.
    pub agreement: Option<f64>,
    /// Logit of absence at the estimate by the box regression; `None` if it was not evaluated.
    pub absent: Option<f64>,
    /// Mean of the belief.
    pub estimate: State,
    /// Pixels per template unit there.
    pub unit: f64,
    /// A lower bound on P(lost) from another source, such as the class; 0 without one.
    pub alarm: f64,
    /// The result of a search of the whole picture in this frame; `None` without a search.
    pub search: Option<SearchResult>,
}

/// The result of a search of the whole picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchResult {
    /// The place that fits best; `None` if the estimate fits as well.
    pub best: Option<State>,
}

/// Computes P(lost) of frames by a model, relative to running means of the evidence on the target.
#[derive(Clone, Debug)]
pub struct LossMonitor {
    model: ConfidenceModel,
    pub(crate) state: LossState,
}

/// The state between frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LossState {
    /// Frames the usual values were taken from.
    frames: usize,
    /// Confident frames under this template.
    confident: usize,
    /// Mean evidence, its mean deviation, mean distance and mean innovation, on the target.
    evidence: f64,
    deviation: f64,
    distance: f64,
    innovation: f64,
    /// The last estimate, and the last confident position.
    estimate: State,
    seen: State,
    /// What fitted better than the estimate in the last search.
    best_place: Option<State>,
    /// Nothing is smoothed yet.
    is_new: bool,
    /// Smoothed drop.
    lasting: f64,
    /// Smoothed similarity to remembered surroundings.
    elsewhere: f64,
    /// Smoothed agreement with a second opinion.
    agreement: f64,
    /// Running mean of the logit of absence by the box regression.
    absence: f64,
    /// The largest innovation, less the longer ago it was.
    leap: f64,
    /// The last result: whether the tracker searches, and the reported status.
    search: SearchState,
    reported: ReportedStatus,
    p_lost: f64,
    own: f64,
    cues: Cues,
}

/// P(lost) by the own cues; with the box regression; with the second tracker as well.
struct Verdict {
    cued: f64,
    own: f64,
    reported: f64,
}

/// Share of the newest frame in the usual values, after as many frames as its inverse.
const NEWEST: f64 = 0.05;
/// Share of the newest frame in the smoothed drop.
const SMOOTH: f64 = 0.2;
/// The same for the similarity to remembered surroundings; short, so that returns are reported soon.
const SHARPER: f64 = 0.4;
/// The share of an innovation that counts a frame later.
const KEPT: f64 = 0.985;
/// ln of an innovation, relative to the mean, that is usual.
const USUAL: f64 = 0.5;
/// An innovation that is small, half boxes.
const SMALL: f64 = 0.05;
/// Own P(lost) below which a frame is confident.
const CONFIDENT: f64 = 0.05;
/// Reported P(lost) below which the particles follow the box regression.
const FOLLOWED: f64 = 0.3;
/// Logit of absence before the box regression has been evaluated: the target was given or found.
const PRESENT: f64 = -MOST_ODDS;
/// Least deviation of the evidence, as a share of the distance between the reference likelihoods on and off the
/// target.
const LEAST_DEVIATION: f64 = 0.02;

impl LossState {
    /// Nothing was seen yet.
    fn none() -> Self {
        Self { is_new: true, absence: PRESENT, ..Self::default() }
    }
}

impl LossMonitor {
    /// A monitor with this model, before the first frame.
    pub fn new(model: ConfidenceModel) -> Self {
        Self { model, state: LossState::none() }
    }

    /// The model.
    pub fn model(&self) -> &ConfidenceModel {
        &self.model
    }

    /// Resets the monitor: the target was just given.
    pub fn reset(&mut self) {
        self.state = LossState::none();
    }

    /// Resets the search after the new position `at` was given; the running means stay.
    pub(crate) fn restart(&mut self, at: &State) {
        let LossState { frames, confident, evidence, deviation, distance, innovation, .. } = self.state;
        let seen = *at;
        self.state =
            LossState { frames, confident, evidence, deviation, distance, innovation, seen, ..LossState::none() };
    }

    /// Resets the running means, because later looks are compared with another template.
    pub(crate) fn forget_usual(&mut self) {
        let m = &mut self.state;
        (m.frames, m.confident, m.evidence, m.deviation, m.distance, m.lasting) = (0, 0, 0.0, 0.0, 0.0, 0.0);
        m.absence = PRESENT;
    }

    /// Judges a frame.
    pub fn judge(&mut self, shown: &FrameEvidence) -> TrackConfidence {
        self.searched(shown.search);
        let absent = shown.absent.map(within_odds);
        let cues = self.cues(shown, absent);
        let verdict = self.verdict(&cues, shown.alarm);
        let elsewhere = self.state.best_place.is_some_and(|place| apart(&place, shown));
        // Only the last look decides whether the target is back.
        let p_lost = if self.is_searching() { self.model.returned(verdict.cued, absent) } else { verdict.own };
        let confidence = self.update_status(&verdict, p_lost, elsewhere, cues);
        self.state.estimate = shown.estimate;
        if self.state.frames < (1.0 / NEWEST) as usize / 2 || verdict.own < self.model.leave {
            self.learn(shown);
        }
        confidence
    }

    /// Judges a frame by its cues alone, as if no search had found another place.
    pub fn rejudge(&mut self, cues: &Cues) -> TrackConfidence {
        let verdict = self.verdict(cues, 0.0);
        let p_lost = if self.is_searching() { verdict.cued } else { verdict.own };
        self.update_status(&verdict, p_lost, false, *cues)
    }

    /// Keeps the verdict of a frame, and updates search and status. `p_lost` decides whether the tracker searches.
    fn update_status(&mut self, verdict: &Verdict, p_lost: f64, elsewhere: bool, cues: Cues) -> TrackConfidence {
        let m = &mut self.state;
        if m.search.update(&self.model, p_lost, elsewhere) {
            (m.best_place, m.absence) = (None, PRESENT);
        }
        m.confident = m.confident.saturating_add(usize::from(verdict.own < CONFIDENT));
        (m.p_lost, m.own, m.cues) = (verdict.reported, verdict.own, cues);
        self.report()
    }

    /// The result of a frame that is not judged: P(lost) is unchanged, and the status follows from it.
    pub fn hold(&mut self, search: Option<SearchResult>) -> TrackConfidence {
        self.searched(search);
        self.report()
    }

    /// The status that follows from P(lost).
    fn report(&mut self) -> TrackConfidence {
        let m = &mut self.state;
        m.reported.update(m.p_lost, self.model.status, self.model.patience);
        self.last()
    }

    /// Whether the tracker searches for the target. This differs from the reported status.
    pub fn is_searching(&self) -> bool {
        self.state.search.is_searching
    }

    /// P(lost) of these cues, which is not less than `alarm`.
    fn verdict(&self, cues: &Cues, alarm: f64) -> Verdict {
        let (cued, least) = (self.model.own(cues).max(alarm), self.model.by_absence(cues).max(alarm));
        let early = self.model.by_early(cues, self.state.confident);
        Verdict { cued, own: cued.max(least), reported: self.model.reported(cued, cues).max(least).max(early) }
    }

    /// The last verdict.
    pub fn last(&self) -> TrackConfidence {
        let LossState { p_lost, own, reported, cues, .. } = self.state;
        TrackConfidence { p_lost, own, status: reported.status(), cues }
    }

    fn cues(&mut self, s: &FrameEvidence, absent: Option<f64>) -> Cues {
        let m = &mut self.state;
        let gap = (s.reference.on - s.reference.off).max(1e-9);
        let (mut drop, mut distance) = (0.0, 0.0);
        if m.frames > 0 {
            let z = (m.evidence - s.evidence) / m.deviation.max(LEAST_DEVIATION * gap);
            drop = if s.evidence.is_finite() { z.max(0.0).ln_1p().min(5.0) } else { 5.0 };
            let least = 0.1 * m.distance + 1e-9;
            distance = ((s.distance + least) / (m.distance + least)).ln();
        }
        // Smoothed values of another place do not hold here.
        let anew = m.search.is_searching && apart(&m.estimate, s);
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
        let innovation = if m.search.is_searching || !s.innovation.is_finite() { 0.0 } else { s.innovation };
        m.leap = innovation.max(KEPT * m.leap);
        let ratio = if m.frames > 0 { (m.leap + SMALL) / (m.innovation + SMALL) } else { 1.0 };
        let leap = (ratio.ln() - USUAL).clamp(0.0, 4.0);
        let absence = if self.model.counts_absence() { m.absence } else { PRESENT };
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
            leap,
        ]
    }

    /// Updates the usual evidence on the target.
    fn learn(&mut self, s: &FrameEvidence) {
        let m = &mut self.state;
        if !(s.evidence.is_finite() && s.distance.is_finite() && s.innovation.is_finite()) {
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
        // A leap is unusual, except in the first frame.
        let most = if m.frames > 1 { 3.0 * m.innovation + 2.0 * SMALL } else { f64::INFINITY };
        m.innovation += share * (s.innovation.min(most) - m.innovation);
        m.seen = s.estimate;
    }

    /// Whether the box regression doubts that the target is at the estimate: then nothing is learned from the frame.
    pub(crate) fn is_doubted(&self) -> bool {
        self.model.by_absence(&self.state.cues) >= self.model.leave
    }

    /// Whether the particles may follow the box regression: outside of a search, while the reported P(lost) is small.
    pub(crate) fn follows(&self) -> bool {
        !self.is_searching() && self.state.p_lost < FOLLOWED
    }

    /// Whether only the box regression reports a loss. The appearance was then learned from another object.
    pub(crate) fn is_misled(&self) -> bool {
        let (model, cues) = (&self.model, &self.state.cues);
        model.by_absence(cues) > model.enter && model.own(cues) <= model.enter
    }

    /// Takes the place that fits better, if there was a search: it does not end at another place.
    fn searched(&mut self, search: Option<SearchResult>) {
        if let Some(search) = search {
            self.state.best_place = search.best;
        }
    }

    /// Where the target was seen last; `None` before the first frame.
    pub fn seen(&self) -> Option<&State> {
        (self.state.frames > 0).then_some(&self.state.seen)
    }
}

impl Validate for LossState {
    fn validate(&self, (): &()) -> Valid {
        ensure([self.p_lost, self.own].iter().all(|p| (0.0..=1.0).contains(p)), || {
            format!("P(lost) is 0 to 1; it is {}, and {} by the own cues", self.p_lost, self.own)
        })?;
        ensure(self.innovation >= 0.0 && self.leap >= 0.0, || {
            format!("distances are 0 or more; the usual one is {}, the largest {}", self.innovation, self.leap)
        })
    }
}

/// Log odds within ±6; log odds that are not finite count as 6.
fn within_odds(odds: f64) -> f64 {
    if odds.is_finite() { odds.clamp(-MOST_ODDS, MOST_ODDS) } else { MOST_ODDS }
}

/// Whether a place is more than a template unit from the estimate of a frame.
fn apart(place: &State, shown: &FrameEvidence) -> bool {
    (place.x - shown.estimate.x).abs().max((place.y - shown.estimate.y).abs()) > shown.unit
}

#[cfg(test)]
mod tests;
