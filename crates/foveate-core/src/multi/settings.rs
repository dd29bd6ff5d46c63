//! Thresholds of track initiation, termination, re-identification and occlusion.

use serde::{Deserialize, Serialize};

use super::attention::Attention;
use foveate_base::Result;
use foveate_base::error::within;

/// Rules for many targets. Lengths are in template units: 1 is half the target's box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Largest distance of a detection from the predicted position of its target, above 0 to 100.
    pub gate: f64,
    /// Largest ratio of the sizes of detection and target, 1 to 100.
    pub size: f64,
    /// Least score of a pair of target and detection, 0 to 1.
    pub score: f64,
    /// Weight of appearance in that score; overlap and motion share the rest, 0 to 1.
    pub looks: f64,
    /// Evidence deficit at which the template of a fully visible target is updated from its detection; never above
    /// 2, 0 to 3.
    pub renew: f64,
    /// Weight of the newest detection in the shape of a target's box, 0 to 1.
    pub shape: f64,
    /// Rank among recent scores below which a detection is weak and is assigned last (two-stage association), 0 to
    /// 1.
    pub weak: f64,
    /// Interval of the detector in frames. Frames between do not count as frames without a detection, 1 to 1000.
    pub every: usize,
    /// Whether the detector may merge targets, as motion does: a box that holds most of several targets is assigned to none.
    pub merges: bool,
    /// The targets that are updated if there are too many for every frame.
    pub attention: Attention,
    /// Initiation of targets.
    pub initiation: Initiation,
    /// Termination of targets.
    pub termination: Termination,
    /// Re-identification of terminated targets.
    pub reidentification: Reidentification,
    /// Occlusion of targets by each other.
    pub occlusion: Occlusion,
}

/// A target starts from consecutive detections.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Initiation {
    /// Detections that start a track, 1 to 1000.
    pub hits: usize,
    /// Detector frames that they may span, at least `hits`.
    pub within: usize,
    /// Least movement since the first of them, 0 to 100.
    pub moved: f64,
    /// IoU with an active target that prevents a start, 0 to 1.
    pub overlap: f64,
    /// Share of the detection covered by active targets that prevents a start, 0 to 1.
    pub covered: f64,
    /// Least mean rank of their scores, 0 to 1.
    pub rank: f64,
    /// Mean rank from which on only a target with nearly the same box prevents a start; never above 1, 0 to
    /// 2.
    pub strong: f64,
    /// Least width and height in pixels, 2 to 10000.
    pub side: f64,
    /// Largest share of the picture, 0 to 1.
    pub most: f64,
}

/// A target ends when it is gone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Termination {
    /// Consecutive frames as lost before a track ends.
    pub lost: usize,
    /// Consecutive detector frames without a detection before a track ends.
    pub unseen: usize,
    /// Detector frames without a detection after which the box counts as a guess.
    pub guess: usize,
    /// Least share of the box inside the picture, 0 to 1.
    pub inside: f64,
}

/// Terminated targets are remembered, and new tracks are compared with them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Reidentification {
    /// Frames for which a terminated target is remembered.
    pub frames: usize,
    /// Similarity at which a new track is a remembered target; 1 is that of frame 1, 0 to 2.
    pub similarity: f64,
}

/// Overlapping targets occlude each other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Occlusion {
    /// Weight of the lower edge in the depth order, similarity per box height. For objects on the ground, 0 to 100.
    pub ground: f64,
    /// Advantage of the target in front in the last frame, in similarity, 0 to 2.
    pub habit: f64,
    /// Visible share below which a target counts as hidden, 0 to 1.
    pub hidden: f64,
    /// Share of each target's template that is subtracted before the others are scored. For bright objects on dark, 0 to 1.
    pub explain: f64,
}

impl Default for Settings {
    fn default() -> Self {
        let (initiation, termination) = (Initiation::default(), Termination::default());
        let (reidentification, occlusion) = (Reidentification::default(), Occlusion::default());
        Self {
            gate: 1.0,
            size: 1.6,
            score: 0.2,
            looks: 0.3,
            renew: 0.4,
            shape: 0.3,
            weak: 0.0,
            every: 1,
            merges: true,
            attention: Attention::default(),
            initiation,
            termination,
            reidentification,
            occlusion,
        }
    }
}

impl Default for Initiation {
    fn default() -> Self {
        Self {
            hits: 3,
            within: 4,
            moved: 0.0,
            overlap: 0.3,
            covered: 0.6,
            rank: 0.0,
            strong: 2.0,
            side: 8.0,
            most: 0.5,
        }
    }
}

impl Default for Termination {
    fn default() -> Self {
        Self { lost: 10, unseen: 25, guess: 12, inside: 0.4 }
    }
}

impl Default for Reidentification {
    fn default() -> Self {
        Self { frames: 250, similarity: 0.6 }
    }
}

impl Default for Occlusion {
    fn default() -> Self {
        Self { ground: 2.0, habit: 0.2, hidden: 0.5, explain: 0.0 }
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

    /// Checks all settings.
    ///
    /// # Errors
    /// If a number is out of range; the error names it.
    pub fn check(&self) -> Result<()> {
        let Self { attention, initiation, termination, reidentification, occlusion, .. } = self;
        for (name, value, least, most) in [
            ("gate", self.gate, 1e-6, 100.0),
            ("size", self.size, 1.0, 100.0),
            ("score", self.score, 0.0, 1.0),
            ("looks", self.looks, 0.0, 1.0),
            ("renew", self.renew, 0.0, 3.0),
            ("shape", self.shape, 0.0, 1.0),
            ("weak", self.weak, 0.0, 1.0),
            ("every", self.every as f64, 1.0, 1000.0),
            ("attention.budget", attention.budget as f64, 0.0, 1e6),
            ("initiation.hits", initiation.hits as f64, 1.0, 1000.0),
            ("initiation.within", initiation.within as f64, initiation.hits as f64, 1000.0),
            ("initiation.moved", initiation.moved, 0.0, 100.0),
            ("initiation.overlap", initiation.overlap, 0.0, 1.0),
            ("initiation.covered", initiation.covered, 0.0, 1.0),
            ("initiation.rank", initiation.rank, 0.0, 1.0),
            ("initiation.strong", initiation.strong, 0.0, 2.0),
            ("initiation.side", initiation.side, 2.0, 10_000.0),
            ("initiation.most", initiation.most, 0.0, 1.0),
            ("termination.lost", termination.lost as f64, 1.0, 1e6),
            ("termination.unseen", termination.unseen as f64, 1.0, 1e6),
            ("termination.guess", termination.guess as f64, 0.0, 1e6),
            ("termination.inside", termination.inside, 0.0, 1.0),
            ("reidentification.frames", reidentification.frames as f64, 0.0, 1e6),
            ("reidentification.similarity", reidentification.similarity, 0.0, 2.0),
            ("occlusion.ground", occlusion.ground, 0.0, 100.0),
            ("occlusion.habit", occlusion.habit, 0.0, 2.0),
            ("occlusion.hidden", occlusion.hidden, 0.0, 1.0),
            ("occlusion.explain", occlusion.explain, 0.0, 1.0),
        ] {
            within(&format!("multi_target.{name}"), value, least, most)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detections_that_span_too_few_frames_are_named() {
        let base = Settings::default();
        let settings = Settings { initiation: Initiation { hits: 9, ..base.initiation }, ..base };
        let said = settings.check().expect_err("more than it may span").to_string();
        assert!(said.contains("multi_target.initiation.within"), "{said}");
    }
}
