//! Thresholds of track initiation, termination, re-identification and occlusion.

use super::attention::Attention;
use foveate_base::Result;
use foveate_base::error::within;

foveate_base::settings! {
    /// Rules for many targets. Lengths are in template units: 1 is half the target's box.
    #[derive(Copy)]
    pub struct Settings in "multi_target" and rules {
        /// Largest distance of a detection from the predicted position of its target, above 0 to 100.
        pub gate: f64 = 1.0; 1e-6 to 100.0,
        /// Largest ratio of the sizes of detection and target, 1 to 100.
        pub size: f64 = 1.6; 1.0 to 100.0,
        /// Least score of a pair of target and detection, 0 to 1.
        pub score: f64 = 0.2; 0.0 to 1.0,
        /// Weight of appearance in that score; overlap and motion share the rest, 0 to 1.
        pub looks: f64 = 0.3; 0.0 to 1.0,
        /// Evidence deficit above which the template of a fully visible target is updated from its detection; from 2 on: never, 0 to 3.
        pub renew: f64 = 0.4; 0.0 to 3.0,
        /// Weight of the newest detection in the shape of a target's box, 0 to 1.
        pub shape: f64 = 0.3; 0.0 to 1.0,
        /// Rank among recent scores below which a detection is weak and is assigned last (two-stage association), 0 to 1.
        pub weak: f64 = 0.0; 0.0 to 1.0,
        /// Interval of the detector in frames. Frames between do not count as frames without a detection, 1 to 1000.
        pub every: usize = 1; 1.0 to 1000.0,
        /// Whether the detector may merge targets, as motion does: a box that holds most of several targets is assigned to none.
        pub merges: bool = true,
        /// The targets that are updated if there are too many for every frame.
        pub attention: Attention = Default::default(),
        /// Initiation of targets.
        pub initiation: Initiation = Default::default(),
        /// Termination of targets.
        pub termination: Termination = Default::default(),
        /// Re-identification of terminated targets.
        pub reidentification: Reidentification = Default::default(),
        /// Occlusion of targets by each other.
        pub occlusion: Occlusion = Default::default(),
    }

    /// A target starts from consecutive detections.
    #[derive(Copy)]
    pub struct Initiation in "multi_target.initiation" and rules {
        /// Detections that start a track, 1 to 1000.
        pub hits: usize = 3; 1.0 to 1000.0,
        /// Detector frames that they may span, at least `hits`.
        pub within: usize = 4,
        /// Least movement since the first of them, 0 to 100.
        pub moved: f64 = 0.0; 0.0 to 100.0,
        /// IoU with an active target that prevents a start, 0 to 1.
        pub overlap: f64 = 0.3; 0.0 to 1.0,
        /// Share of the detection covered by active targets that prevents a start, 0 to 1.
        pub covered: f64 = 0.6; 0.0 to 1.0,
        /// Least mean rank of their scores, 0 to 1.
        pub rank: f64 = 0.0; 0.0 to 1.0,
        /// Mean rank from which on only a target with nearly the same box prevents a start; above 1: none, 0 to 2.
        pub strong: f64 = 2.0; 0.0 to 2.0,
        /// Least width and height in pixels, 2 to 10000.
        pub side: f64 = 8.0; 2.0 to 10_000.0,
        /// Largest share of the picture, 0 to 1.
        pub most: f64 = 0.5; 0.0 to 1.0,
    }

    /// A target ends when it is gone.
    #[derive(Copy)]
    pub struct Termination in "multi_target.termination" {
        /// Consecutive frames as lost before a track ends.
        pub lost: usize = 10; 1.0 to 1e6,
        /// Consecutive detector frames without a detection before a track ends.
        pub unseen: usize = 25; 1.0 to 1e6,
        /// Detector frames without a detection after which the box counts as a guess.
        pub guess: usize = 12; 0.0 to 1e6,
        /// Least share of the box inside the picture, 0 to 1.
        pub inside: f64 = 0.4; 0.0 to 1.0,
    }

    /// Terminated targets are remembered, and new tracks are compared with them.
    #[derive(Copy)]
    pub struct Reidentification in "multi_target.reidentification" {
        /// Frames for which a terminated target is remembered.
        pub frames: usize = 250; 0.0 to 1e6,
        /// Similarity at which a new track is a remembered target; 1 is that of frame 1, 0 to 2.
        pub similarity: f64 = 0.6; 0.0 to 2.0,
    }

    /// Overlapping targets occlude each other.
    #[derive(Copy)]
    pub struct Occlusion in "multi_target.occlusion" {
        /// Weight of the lower edge in the depth order, similarity per box height. For objects on the ground, 0 to 100.
        pub ground: f64 = 2.0; 0.0 to 100.0,
        /// Advantage of the target in front in the last frame, in similarity, 0 to 2.
        pub habit: f64 = 0.2; 0.0 to 2.0,
        /// Visible share below which a target counts as hidden, 0 to 1.
        pub hidden: f64 = 0.5; 0.0 to 1.0,
        /// Share of each target's template that is subtracted before the others are scored. For bright objects on dark, 0 to 1.
        pub explain: f64 = 0.0; 0.0 to 1.0,
    }
}

impl Settings {
    /// Returns how many of these frames run the detector.
    pub(super) fn asked(&self, frames: usize) -> usize {
        frames / self.every
    }

    /// Returns the rank of a detection without a score: high enough to be assigned and to start a track, not high enough to start one
    /// beside another target.
    pub(super) fn unknown_rank(&self) -> f64 {
        let least = self.initiation.rank.max(self.weak);
        0.5 * (least + self.initiation.strong.min(1.0).max(least))
    }

    /// Returns whether a box counts as a guess after this number of frames without a detection.
    pub(super) fn guesses(&self, unseen: usize) -> bool {
        self.asked(unseen) > self.termination.guess
    }

    /// Checks the parts.
    fn rules(&self) -> Result<()> {
        within("multi_target.attention.budget", self.attention.budget as f64, 0.0, 1e6)?;
        self.initiation.check()?;
        self.termination.check()?;
        self.reidentification.check()?;
        self.occlusion.check()
    }
}

impl Initiation {
    /// Checks what `within` may be.
    fn rules(&self) -> Result<()> {
        within("multi_target.initiation.within", self.within as f64, self.hits as f64, 1000.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// It is strong enough to start a track, and too weak to start one beside another target.
    #[test]
    fn the_rank_of_a_detection_without_a_score_is_between_weak_and_strong() {
        for (rank, weak, strong) in [(0.0, 0.0, 0.9), (0.3, 0.5, 0.9), (0.6, 0.2, 0.8), (0.5, 0.0, 2.0)] {
            let base = Settings::default();
            let settings = Settings { weak, initiation: Initiation { rank, strong, ..base.initiation }, ..base };
            let unknown = settings.unknown_rank();
            assert!(rank.max(weak) < unknown && unknown < strong.min(1.0), "{rank} {weak} {strong}: {unknown}");
        }
    }

    #[test]
    fn detections_that_span_too_few_frames_are_named() {
        let base = Settings::default();
        let settings = Settings { initiation: Initiation { hits: 9, ..base.initiation }, ..base };
        let said = settings.check().expect_err("more than it may span").to_string();
        assert!(said.contains("multi_target.initiation.within"), "{said}");
    }
}
