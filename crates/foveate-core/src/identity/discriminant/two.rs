//! A discriminant with a short-term memory: which of the two is in use, and the frames of both.

use super::Discriminant;
use super::ridge::STEPS;

impl Discriminant {
    /// Whether it has a short-term memory.
    pub fn has_short_term(&self) -> bool {
        self.short_term.is_some()
    }

    /// Whether the short-term memory differs from the long-term one.
    pub fn is_apart(&self) -> bool {
        self.short_term.as_ref().is_some_and(|it| it.apart.is_some())
    }

    /// Resets the short-term memory.
    pub fn forget(&mut self) {
        if let Some(short_term) = &mut self.short_term {
            short_term.forget();
        }
    }

    /// Forgets all that was learned since the first frame.
    pub(in crate::identity) fn restart(&mut self) {
        self.unpack();
        self.recent.gram.clone_from(&self.first.gram);
        self.recent.cross.clone_from(&self.first.cross);
        self.fit_anew();
    }

    /// Fits the sums of the first frame from nothing on.
    pub(super) fn fit_anew(&mut self) {
        self.forget();
        let Self { regression, first, recent, weights, learning, .. } = self;
        weights.fill(0.0);
        regression.solve(first, recent, weights, learning, STEPS.0);
    }

    /// Whether distances ignore the short-term memory.
    pub(in crate::identity) fn set_aside(&mut self, aside: bool) {
        if let Some(short_term) = &mut self.short_term {
            short_term.aside = aside;
        }
    }

    /// The weights that distances are of.
    pub(super) fn in_use(&self) -> &[f32] {
        match &self.short_term {
            Some(it) if it.apart.is_some() && !it.aside => &it.weights,
            _ => &self.weights,
        }
    }

    /// Learns `rows` at `places` in the short-term memory, if there is one.
    pub(in crate::identity) fn learn_short_term(&mut self) {
        self.unpack();
        let Self { regression, first, recent, weights, short_term, learning, .. } = self;
        let Some(it) = short_term else { return };
        if it.apart.is_none() {
            it.sums.gram.clone_from(&recent.gram);
            it.sums.cross.clone_from(&recent.cross);
            it.weights.clone_from(weights);
        }
        it.apart = Some(1.0);
        it.learn(regression, first, learning);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Discriminant, Settings};
    use crate::geometry::{Extent, State};
    use foveate_base::rng::{Rng, Streams};
    use rand::RngExt;

    const N: usize = 7;
    const EXTENT: Extent = Extent { half_w: 10.0, half_h: 20.0 };

    fn fresh() -> Discriminant {
        Discriminant::new(Settings { learning_rate: 0.3, ..Settings::default() }, vec![N - 1])
    }

    /// Looks around the target in a frame of random features.
    fn look(it: &mut Discriminant, frame: u64) {
        let mut rng: Rng = Streams::new(6, 0).rng(frame);
        it.look_around(&State::default(), EXTENT, &[]);
        it.learning.rows.iter_mut().for_each(|h| *h = rng.random::<f32>() - 0.5);
        it.learning.rows.chunks_exact_mut(N).for_each(|row| row[N - 1] = 1.0);
    }

    /// Frames that a discriminant with a short-term memory learns, long-term or short-term.
    fn both(frames: &[bool]) -> Discriminant {
        let mut it = fresh().with_short_term();
        for (frame, for_good) in frames.iter().enumerate() {
            look(&mut it, frame as u64);
            if *for_good { it.learn(frame == 0) } else { it.learn_short_term() }
        }
        it
    }

    /// The same frames; a discriminant without short-term memory learns those for which `which` is true.
    fn one(frames: &[bool], which: impl Fn(bool) -> bool) -> Discriminant {
        let mut it = fresh();
        for (frame, _) in frames.iter().enumerate().filter(|(_, for_good)| which(**for_good)) {
            look(&mut it, frame as u64);
            it.learn(frame == 0);
        }
        it
    }

    const FRAMES: [bool; 7] = [true, true, false, true, false, false, true];

    /// Bit for bit: in use, it equals a discriminant that learned all frames; suspended or reset, one that learned
    /// the long-term frames only.
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
        it.learn_short_term();
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
        without.learn_short_term();
        assert!(
            !without.is_apart() && !without.has_short_term(),
            "without a short-term memory nothing is learned for now"
        );
    }

    #[test]
    fn what_was_learned_for_now_is_kept() {
        let it = both(&FRAMES);
        let mut other = fresh().with_short_term();
        other.load(&it.save()).expect("it was saved");
        assert_eq!((&other.short_term, &other.weights), (&it.short_term, &it.weights));
        let mut without = fresh();
        assert!(without.load(&it.save()).expect_err("no short-term memory").to_string().contains("short-term"));
        // A state saved without one loads, and both agree.
        other.load(&one(&FRAMES, |_| true).save()).expect("it was saved");
        assert!(!other.is_apart() && other.in_use() == one(&FRAMES, |_| true).weights);
        let mut damaged = it.clone();
        damaged.short_term.as_mut().expect("it has one").apart = Some(7.0);
        assert!(other.load(&damaged.save()).is_err());
    }
}
