//! The table of P(lost): its cues, their weights, and the rules of the search and of the status.

use serde::Deserialize;

use super::Localisation;
use crate::control::StatusThresholds;
use foveate_base::error::within;
use foveate_base::{Error, Result};

/// Number of cues.
pub const CUES: usize = OWN + 3;
/// Number of those that are the tracker's own, the first.
pub const OWN: usize = 10;
/// Position of the cue *agreement*.
pub const AGREEMENT: usize = OWN;
/// Position of the cue *absence*.
pub const ABSENCE: usize = OWN + 1;
/// Position of the cue *leap*.
pub const LEAP: usize = OWN + 2;
/// Positions of the cues *margin* and *colour*.
const MARGIN: usize = 7;
const COLOUR: usize = 8;
/// Their names, in order.
pub const CUE_NAMES: [&str; CUES] = [
    "deficit",
    "frame_deficit",
    "drop",
    "lasting",
    "flat",
    "spread",
    "distance",
    "margin",
    "colour",
    "elsewhere",
    "agreement",
    "absence",
    "leap",
];

/// The cues of one frame that the target is lost:
/// *deficit* and *frame_deficit* as [`Consistency`](super::super::Consistency) has them, 0 to 2;
/// *drop*: ln(1 + z), where the frame's evidence lies z mean deviations below the usual one, 0 to 5;
/// *lasting*: the same, smoothed over about five frames;
/// *flat*: the tempered effective sample size, 0 to 1;
/// *spread*: ln of the belief's standard deviation about place in template units, from 1/50 of one, −4 to 4;
/// *distance*: ln of the distance to the template at the estimate, relative to the usual one, −3 to 3;
/// *margin*: how far the evidence lies above the best distractor's, as a share of the difference between the reference likelihoods on and off the target, −1 to 1;
/// 0 where distractors are not searched for;
/// *colour*: how far the colours at the estimate are from the target's, −0.2 to 1.2; 0 without a colour model;
/// *elsewhere*: how much more the estimate resembles the surroundings of the target in remembered frames than the target in them,
/// smoothed over two or three frames, −2 to 2; 0 where nothing is remembered (`[distractors] remembered`);
/// *agreement*: the overlap (IoU) with the box of the second opinion, smoothed over about five frames, 0 to 1; −1 without one
/// (`second_opinion`);
/// *absence*: log odds by the box regression that the target is not at the estimate, a running mean over its last looks, −6 to 6; −6 without one
/// (`[confidence] absence`);
/// *leap*: ln of the farthest that the estimate was from its prediction, relative to the usual distance, each plus 1/20 of half a box, less
/// 1/2, 0 to 4. A distance counts less the longer ago it was, half after 46 frames; those of a search do not count. A box that leaps may be
/// on another object, which fits as well as the target did.
pub type Cues = [f64; CUES];

/// The most that log odds by the box regression count, either way.
pub(super) const MOST_ODDS: f64 = 6.0;

foveate_base::settings! {
    /// The model, and the rules of the search and of the status.
    pub struct ConfidenceModel in "confidence" and rules {
        /// Weights wₖ, nats per unit of cue k; missing ones are 0.
        #[serde(deserialize_with = "padded")]
        pub weights: [f64; OWN] = [1.5, 0.5, 0.5, 0.5, 0.5, 0.3, 0.3, 0.0, 0.0, 0.0],
        /// Bias b, nats.
        pub bias: f64 = -4.0; -1e3 to 1e3,
        /// Weights of the second opinion in the reported P(lost); none without one.
        pub second_opinion: SecondTrackerWeights = Default::default(),
        /// Weights of the box regression in the decision to end a search; none without one.
        pub box_regression: ReacquisitionWeights = Default::default(),
        /// Weights of the box regression in the P(lost) of a tracked target; none without one.
        pub absence: AbsenceWeights = Default::default(),
        /// Weights of the colours and the box regression in the first frames.
        pub early: EarlyWeights = Default::default(),
        /// Own P(lost) above which a frame counts towards a search, 0 to 1.
        pub enter: f64 = 0.5; 0.0 to 1.0,
        /// Own P(lost) below which a frame counts towards the end of a search, 0 to `enter`.
        pub leave: f64 = 0.3,
        /// Consecutive frames above `enter` that start a search, 1 to 1000.
        pub notice: usize = 2; 1.0 to 1000.0,
        /// Consecutive frames below `leave` that end a search, 1 to 1000.
        pub confirm: usize = 3; 1.0 to 1000.0,
        /// A frame below `leave` counts as its logit divided by that of `leave`, at most this much, 1 to 10.
        pub surest: f64 = 1.0; 1.0 to 10.0,
        /// Thresholds of the reported P(lost) at which the reported status changes. They change no box.
        pub status: StatusThresholds = Default::default(),
        /// Frames until occluded becomes lost and reacquired becomes tracking.
        pub patience: usize = 15; 0.0 to 1e5,
        /// Additional standard deviation of the place, template units, for an inexact first box and a changing target, 0 to
        /// 10.
        pub localisation_noise: f64 = 0.0; 0.0 to 10.0,
        /// How the covariance of the place follows from that of the particles and from the box regression. It changes no box.
        pub localisation: Localisation = Default::default(),
    }

    /// The reported P(lost) with a second tracker: logit P = `own` · logit P° + `agreement` · cue + `leap` · cue + `absence` · cue + `bias`,
    /// with P° by the tracker's own cues.
    #[derive(Copy)]
    pub struct SecondTrackerWeights in "confidence.second_opinion" {
        /// Weight of the logit by the first tracker's cues.
        pub own: f64 = 1.0; -1e3 to 1e3,
        /// Weight of the agreement of both boxes, negative.
        pub agreement: f64 = 0.0; -1e3 to 1e3,
        /// Weight of the cue *leap*, positive.
        pub leap: f64 = 0.0; -1e3 to 1e3,
        /// Weight of the cue *absence*, positive.
        pub absence: f64 = 0.0; -1e3 to 1e3,
        /// Bias of this logit.
        pub bias: f64 = 0.0; -1e3 to 1e3,
    }

    /// While the tracker searches for the target, `leave` is compared with another probability than P° by the own cues:
    /// log P / (1 − P) = log P° / (1 − P°) + `weight` · log odds by the box regression that the target is not there, −6 to 6, + `bias`.
    #[derive(Copy)]
    pub struct ReacquisitionWeights in "confidence.box_regression" {
        /// During a search, the own logit plus this weight times the network's newest logit of absence is compared with `leave`.
        pub weight: f64 = 0.0; -1e3 to 1e3,
        /// Bias of this sum.
        pub bias: f64 = 0.0; -1e3 to 1e3,
    }

    /// A lower bound on P(lost): logit `weight` · cue + `bias`, with the cue *absence*, a mean over many looks.
    #[derive(Copy)]
    pub struct AbsenceWeights in "confidence.absence" {
        /// Weight of the newest evaluation in the running mean *absence*, above 0 to 1.
        pub rate: f64 = 0.25; 1e-3 to 1.0,
        /// Weight of *absence* in the logit of a lower bound of P(lost); 0 is off.
        pub weight: f64 = 0.0; 0.0 to 1e3,
        /// Bias of the bound.
        pub bias: f64 = 0.0; -1e3 to 1e3,
    }

    /// A lower bound on the reported P(lost) while the reference is young: the logit is `bias` + `change` · max(0, *colour* − *margin*) +
    /// `absence` · *absence*. In the first frames nothing is usual yet, and two trackers that have lost the target may agree on the ground
    /// below it. If the colours have changed and other places fit as well as the estimate, the target has probably gone.
    #[derive(Copy)]
    pub struct EarlyWeights in "confidence.early" {
        /// A lower bound of the reported P(lost) ends after this number of frames with an own P(lost) below 5 %; 0 is off.
        pub frames: usize = 0; 0.0 to 1000.0,
        /// Weight of the cue *colour* minus the cue *margin*, if positive.
        pub change: f64 = 0.0; 0.0 to 1e3,
        /// Weight of the cue *absence*.
        pub absence: f64 = 0.0; 0.0 to 1e3,
        /// Bias of the bound.
        pub bias: f64 = 0.0; -1e3 to 1e3,
    }
}

impl AbsenceWeights {
    /// Whether the box regression counts.
    pub fn counts(&self) -> bool {
        self.weight != 0.0
    }
}

impl ConfidenceModel {
    /// Checks the weights, the parts, and what `leave` may be.
    fn rules(&self) -> Result<()> {
        self.weights.iter().try_for_each(|weight| within("a number of confidence.weights", *weight, -1e3, 1e3))?;
        self.second_opinion.check()?;
        self.box_regression.check()?;
        self.absence.check()?;
        self.early.check()?;
        self.status.check()?;
        self.localisation.check()?;
        match self.leave {
            leave if (0.0..=self.enter).contains(&leave) => Ok(()),
            leave => Err(Error::Config(format!("confidence.leave is 0 to confidence.enter; it is {leave}"))),
        }
    }
    /// P(lost) of a frame by the tracker's own cues.
    pub(super) fn own(&self, cues: &Cues) -> f64 {
        logistic(self.own_logit(cues))
    }

    /// The same during a search, with the logit of the box regression.
    pub(super) fn returned(&self, own: f64, absent: Option<f64>) -> f64 {
        let ReacquisitionWeights { weight, bias } = self.box_regression;
        absent.map_or(own, |absent| logistic(weight * absent + bias - tracking_logit(own)))
    }

    /// The lower bound of P(lost) by the box regression.
    pub(super) fn by_absence(&self, cues: &Cues) -> f64 {
        let AbsenceWeights { weight, bias, .. } = self.absence;
        if self.absence.counts() { logistic(weight * cues[ABSENCE] + bias) } else { 0.0 }
    }

    /// Whether anything depends on the running mean of absence.
    pub(crate) fn counts_absence(&self) -> bool {
        self.absence.counts() || self.early.absence != 0.0 || self.second_opinion.absence != 0.0
    }

    /// The lower bound of the reported P(lost) after so many confident frames.
    pub(super) fn by_early(&self, cues: &Cues, confident: usize) -> f64 {
        let EarlyWeights { frames, change, absence, bias } = self.early;
        let changed = (cues[COLOUR] - cues[MARGIN]).max(0.0);
        if confident < frames { logistic(change * changed + absence * cues[ABSENCE] + bias) } else { 0.0 }
    }

    /// ln(P / (1 − P)) of the same P.
    pub fn own_logit(&self, cues: &Cues) -> f64 {
        self.bias + self.weights.iter().zip(cues).map(|(w, c)| w * c).sum::<f64>()
    }

    /// The reported P(lost) for the own one, `own`.
    pub(super) fn reported(&self, own: f64, cues: &Cues) -> f64 {
        let (weights, agreement) = (&self.second_opinion, cues[AGREEMENT]);
        if agreement < 0.0 {
            return own;
        }
        let logit = weights.bias - weights.own * tracking_logit(own) + weights.agreement * agreement;
        logistic(logit + weights.leap * cues[LEAP] + weights.absence * cues[ABSENCE])
    }

    /// The count of a frame towards the end or the start of a search; 0 if it is between.
    pub(super) fn weight_of_frame(&self, searching: bool, p_lost: f64) -> f64 {
        match searching {
            // The logit of the threshold is 0 or less: a ratio to it has no meaning.
            true if p_lost < self.leave && self.leave >= 0.5 => 1.0,
            true if p_lost < self.leave => {
                (tracking_logit(p_lost) / tracking_logit(self.leave)).clamp(1.0, self.surest)
            }
            false if p_lost > self.enter => 1.0,
            _ => 0.0,
        }
    }
}

/// Weights of all cues, from those of the first so many.
fn padded<'de, D: serde::Deserializer<'de>>(from: D) -> std::result::Result<[f64; OWN], D::Error> {
    let given = Vec::<f64>::deserialize(from)?;
    let mut weights = [0.0; OWN];
    match weights.get_mut(..given.len()) {
        Some(first) => first.copy_from_slice(&given),
        None => {
            return Err(serde::de::Error::invalid_length(
                given.len(),
                &"a weight a cue, at most ten: what agreement counts for is confidence.second_opinion.agreement",
            ));
        }
    }
    Ok(weights)
}

fn logistic(z: f64) -> f64 {
    1.0 / (1.0 + (-z).exp())
}

/// ln((1 − P) / P), finite.
fn tracking_logit(p: f64) -> f64 {
    ((1.0 - p).max(1e-12) / p.max(1e-12)).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A surer frame counts more towards the end of a search, up to `surest`; each counts once if the threshold is even odds or more.
    #[test]
    fn surer_frames_count_more() {
        let weights = |leave: f64| {
            let model = ConfidenceModel { enter: 0.9, leave, surest: 2.0, ..ConfidenceModel::default() };
            [0.49, 0.1, 1e-9].map(|p_lost| model.weight_of_frame(true, p_lost))
        };
        let [_, sure, surest] = weights(0.3);
        assert!(sure > 1.0 && surest == 2.0, "{sure}, {surest}");
        assert_eq!([weights(0.5), weights(0.7)], [[1.0; 3]; 2]);
    }

    #[test]
    fn weights_of_the_last_cues_may_be_left_out() {
        let read = |weights: &str| toml::from_str::<ConfidenceModel>(&format!("weights = [{weights}]"));
        let few = read("0.5, -1.0").expect("two weights");
        assert_eq!((few.weights[..2].to_vec(), few.weights[2..].to_vec()), (vec![0.5, -1.0], vec![0.0; OWN - 2]));
        let said = read(&["1.0"; OWN + 1].join(", ")).expect_err("a weight too many").to_string();
        assert!(said.contains("at most ten"), "{said}");
    }

    #[test]
    fn thresholds_in_the_wrong_order_are_named() {
        let usual = ConfidenceModel::default();
        for (c, said) in [
            (ConfidenceModel { leave: 0.7, ..usual }, "leave"),
            (
                ConfidenceModel { status: StatusThresholds { enter: 0.5, leave: 0.6 }, ..usual },
                "confidence.status.leave",
            ),
        ] {
            assert!(c.check().expect_err(said).to_string().contains(said));
        }
    }
}
