//! A short-term memory: what was learned for now, from frames that are not consistent enough to be learned from for good.
//!
//! A target that turns looks less like itself for a while, and so does one that is being covered. A discriminant that learns from
//! both follows the first and is led astray by the second; one that learns from neither loses the first. So there are two: the
//! short-term one learns from more frames and moves the box, the other, which learned from consistent frames alone, judges whether
//! the target is lost: what is learned in doubt does not vouch for itself. Once the target is reported as occluded or lost, what was
//! learned for now is forgotten. While both have learned the same there is one.
//!
//! Deviation: the paper has one template. Short-term and long-term stores: Hong et al., MUSTer (2015); filters of two rates: Ma et
//! al. (2015).

use serde::{Deserialize, Serialize};

use super::{Discriminant, Learning, STEPS, Settings, Sums, solve};
use foveate_base::Result;
use foveate_base::error::within;

/// Settings of the short-term memory: from which frames it learns.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ShortTerm {
    /// Smoothed deficit above which nothing is learned, by the evidence as it has what was learned for now; 0 to 100.
    pub threshold: f64,
    /// The same of one frame, 0 to 2.
    pub gate: f64,
}

impl Default for ShortTerm {
    fn default() -> Self {
        Self { threshold: 0.7, gate: 1.5 }
    }
}

impl ShortTerm {
    /// Fails where a number is out of range, naming it.
    pub fn check(&self) -> Result<()> {
        within("short_term.threshold", self.threshold, 0.0, 100.0)?;
        within("short_term.gate", self.gate, 0.0, 2.0)
    }
}

/// Share of what was learned apart at which both are taken to be the same again.
const SAME: f64 = 0.01;

/// The sums of more frames, and the weights they give.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Recent {
    pub sums: Sums,
    pub weights: Vec<f32>,
    /// How much of what was learned apart still counts; `None` while both are the same.
    pub apart: Option<f64>,
    /// It is not to be used for now: the other one judges.
    aside: bool,
}

impl Recent {
    /// With room for as much as there is.
    pub fn new(sums: &Sums, weights: &[f32]) -> Self {
        Self { sums: sums.clone(), weights: weights.to_vec(), apart: None, aside: false }
    }

    pub fn forget(&mut self) {
        self.apart = None;
    }

    /// Learns what the other one just learned.
    pub fn learn_too(&mut self, settings: &Settings, begun: &Sums, learning: &mut Learning) {
        let Some(apart) = self.apart else { return };
        self.learn(settings, begun, learning);
        let left = apart * (1.0 - settings.learning_rate);
        self.apart = (left > SAME).then_some(left);
    }

    fn learn(&mut self, settings: &Settings, begun: &Sums, learning: &mut Learning) {
        self.sums.learn(learning, self.weights.len(), settings.fading());
        solve(settings, begun, &self.sums, &mut self.weights, learning, STEPS.1);
    }
}

impl Discriminant {
    /// Whether it can learn for now.
    pub fn has_short_term(&self) -> bool {
        self.short_term.is_some()
    }

    /// Whether something was learned for now, and is not forgotten.
    pub fn is_apart(&self) -> bool {
        self.short_term.as_ref().is_some_and(|it| it.apart.is_some())
    }

    /// Forgets what was learned for now.
    pub fn forget(&mut self) {
        self.short_term.iter_mut().for_each(Recent::forget);
    }

    /// Whether what was learned for now is left out of distances.
    pub(in crate::identity) fn set_aside(&mut self, aside: bool) {
        self.short_term.iter_mut().for_each(|it| it.aside = aside);
    }

    /// The weights that distances are of.
    pub(super) fn in_use(&self) -> &[f32] {
        match &self.short_term {
            Some(it) if it.apart.is_some() && !it.aside => &it.weights,
            _ => &self.weights,
        }
    }

    /// Learns from `rows` at `places` for now; nothing without a short-term memory.
    pub(in crate::identity) fn learn_for_now(&mut self) {
        self.unpack();
        let Self { settings, first, recent, weights, short_term, learning, .. } = self;
        let Some(it) = short_term else { return };
        if it.apart.is_none() {
            it.sums.gram.clone_from(&recent.gram);
            it.sums.cross.clone_from(&recent.cross);
            it.weights.clone_from(weights);
        }
        it.apart = Some(1.0);
        it.learn(settings, first, learning);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Extent, State};
    use foveate_base::rng::{Rng, Streams};
    use rand::RngExt;

    const N: usize = 7;
    const EXTENT: Extent = Extent { half_w: 10.0, half_h: 20.0 };

    fn fresh() -> Discriminant {
        Discriminant::new(Settings { learning_rate: 0.3, ..Settings::default() }, N - 1)
    }

    /// Looks around the target in a frame of random features.
    fn look(it: &mut Discriminant, frame: u64) {
        let mut rng: Rng = Streams::new(6, 0).rng(frame);
        it.look_around(&State::default(), EXTENT, &[]);
        it.learning.rows.iter_mut().for_each(|h| *h = rng.random::<f32>() - 0.5);
        it.learning.rows.chunks_exact_mut(N).for_each(|row| row[N - 1] = 1.0);
    }

    /// Frames of which each is learned from for good or for now, by one with a short-term memory.
    fn both(frames: &[bool]) -> Discriminant {
        let mut it = fresh().remembering();
        for (frame, for_good) in frames.iter().enumerate() {
            look(&mut it, frame as u64);
            if *for_good { it.learn(frame == 0) } else { it.learn_for_now() }
        }
        it
    }

    /// The same frames, all those for which `which` is true learned from for good by one without.
    fn one(frames: &[bool], which: impl Fn(bool) -> bool) -> Discriminant {
        let mut it = fresh();
        for (frame, _) in frames.iter().enumerate().filter(|(_, for_good)| which(**for_good)) {
            look(&mut it, frame as u64);
            it.learn(frame == 0);
        }
        it
    }

    const FRAMES: [bool; 7] = [true, true, false, true, false, false, true];

    /// To the bit: in use is one that learned from all frames; set aside, one that learned from those alone that are learned from for
    /// good; forgotten, too.
    #[test]
    fn there_are_two() {
        let mut it = both(&FRAMES);
        assert!(it.is_apart());
        assert_eq!(it.in_use(), one(&FRAMES, |_| true).weights);
        let long = one(&FRAMES, |for_good| for_good).weights;
        assert_ne!(it.in_use(), long);
        it.set_aside(true);
        assert_eq!(it.in_use(), long);
        it.set_aside(false);
        it.forget();
        assert!(!it.is_apart() && it.in_use() == long);
        // The next one begins from there.
        look(&mut it, 9);
        it.learn_for_now();
        let mut other = one(&FRAMES, |for_good| for_good);
        look(&mut other, 9);
        other.learn(false);
        assert!(it.is_apart() && it.in_use() == other.weights);
    }

    /// 0.7 to the 13th is below a hundredth.
    #[test]
    fn they_are_one_again_where_both_learned_the_same() {
        let frames = |n: usize| [vec![true, false], vec![true; n]].concat();
        assert!(both(&frames(12)).is_apart() && !both(&frames(13)).is_apart());
        assert!(!both(&[true; 5]).is_apart());
        let mut without = fresh();
        look(&mut without, 0);
        without.learn_for_now();
        assert!(
            !without.is_apart() && !without.has_short_term(),
            "without a short-term memory nothing is learned for now"
        );
    }

    #[test]
    fn what_was_learned_for_now_is_kept() {
        let it = both(&FRAMES);
        let mut other = fresh().remembering();
        other.load(&it.save()).expect("it was saved");
        assert_eq!((&other.short_term, &other.weights), (&it.short_term, &it.weights));
        let mut without = fresh();
        assert!(without.load(&it.save()).expect_err("no short-term memory").to_string().contains("short-term"));
        // What was saved without one is taken up, and nothing is apart.
        other.load(&one(&FRAMES, |_| true).save()).expect("it was saved");
        assert!(!other.is_apart() && other.in_use() == one(&FRAMES, |_| true).weights);
        let mut damaged = it.save();
        damaged["apart"] = 7.into();
        assert!(other.load(&damaged).is_err());
    }

    #[test]
    fn settings_are_checked() {
        assert!(ShortTerm::default().check().is_ok());
        let wrong = ShortTerm { gate: 3.0, ..ShortTerm::default() };
        assert!(wrong.check().expect_err("out of range").to_string().contains("short_term.gate"));
    }
}
