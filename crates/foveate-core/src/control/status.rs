//! The reported status of a track: a function of the series of P(lost) alone, with hysteresis.
//!
//! While the box is usable, the status changes if P(lost) is `enter` or more; while it is not, if P(lost) is below
//! `leave`. So no frame with P(lost) below `leave` is occluded or lost, and no frame with P(lost) of `enter` or more
//! is tracking or reacquired.

use serde::{Deserialize, Serialize};

use foveate_base::{Error, Result};

/// Status of the track.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// The box is usable.
    #[default]
    Tracking,
    /// The target is probably lost, for a few frames: it may return at the same place.
    Occluded,
    /// The target is probably lost, for long: it may be anywhere.
    Lost,
    /// The box is usable again, since a few frames, after the target was lost.
    Reacquired,
}

impl Status {
    /// In words, for people and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tracking => "tracking",
            Self::Occluded => "occluded",
            Self::Lost => "lost",
            Self::Reacquired => "reacquired",
        }
    }

    /// Whether the box is a result: the status is tracking or reacquired. Else the box is a guess.
    pub fn is_usable(self) -> bool {
        matches!(self, Self::Tracking | Self::Reacquired)
    }

    /// Whether the status is lost: false while the target is occluded.
    pub fn is_lost(self) -> bool {
        self == Self::Lost
    }
}

foveate_base::settings! {
    /// Thresholds of P(lost) at which the reported status changes.
    #[derive(Copy)]
    pub struct StatusThresholds in "confidence.status" and rules {
        /// Reported P(lost) from which on the status is occluded, or lost after reacquired, 0 to 1.
        pub enter: f64 = 0.5; 0.0 to 1.0,
        /// Reported P(lost) below which the status is tracking, or reacquired after lost, 0 to `enter`.
        pub leave: f64 = 0.3,
    }
}

impl StatusThresholds {
    /// Checks what `leave` may be.
    fn rules(&self) -> Result<()> {
        match self.leave {
            leave if (0.0..=self.enter).contains(&leave) => Ok(()),
            leave => {
                Err(Error::Config(format!("confidence.status.leave is 0 to confidence.status.enter; it is {leave}")))
            }
        }
    }
}

/// The reported status, frame after frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ReportedStatus {
    status: Status,
    /// Frames since the box became usable, or ceased to be, this one included.
    frames: usize,
}

impl ReportedStatus {
    /// The status of the last frame.
    pub(super) fn status(&self) -> Status {
        self.status
    }

    /// The status of the next frame, by its P(lost). It is occluded in the first `patience` frames of a loss, and lost after them; after
    /// lost it is reacquired in the first `patience` frames, and tracking after them.
    pub(super) fn update(&mut self, p_lost: f64, thresholds: StatusThresholds, patience: usize) -> Status {
        let was_usable = self.status.is_usable();
        let usable = if was_usable { p_lost < thresholds.enter } else { p_lost < thresholds.leave };
        self.frames = if usable == was_usable { self.frames.saturating_add(1) } else { 1 };
        let is_recent = self.frames <= patience;
        self.status = match (self.status, usable) {
            (Status::Tracking | Status::Occluded, false) if is_recent => Status::Occluded,
            (_, false) => Status::Lost,
            (Status::Lost | Status::Reacquired, true) if is_recent => Status::Reacquired,
            (_, true) => Status::Tracking,
        };
        self.status
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::{Purpose, Streams};
    use rand::RngExt;

    /// The status of the last of these frames, from the definition alone: no state is kept from one frame to the next.
    fn by_definition(p: &[f64], at: StatusThresholds, patience: usize) -> Status {
        // The last frame that decides by itself: below `leave` the box is usable, from `enter` on it is not. Before any it is.
        let usable =
            |t: usize| p[..=t].iter().rev().find(|p| **p < at.leave || **p >= at.enter).is_none_or(|p| *p < at.leave);
        let last = p.len() - 1;
        // The frames in a row, up to this one, that are as it.
        let run = |end: usize| (0..=end).rev().take_while(|t| usable(*t) == usable(end)).count();
        // Whether the loss that ends in this frame is reported as lost there: it is long, or the status before it was reacquired.
        fn is_lost(end: usize, run: &dyn Fn(usize) -> usize, patience: usize) -> bool {
            let before = end + 1 - run(end);
            run(end) > patience || (before > 0 && is_reacquired(before - 1, run, patience))
        }
        fn is_reacquired(end: usize, run: &dyn Fn(usize) -> usize, patience: usize) -> bool {
            let before = end + 1 - run(end);
            run(end) <= patience && before > 0 && is_lost(before - 1, run, patience)
        }
        match usable(last) {
            true if is_reacquired(last, &run, patience) => Status::Reacquired,
            true => Status::Tracking,
            false if is_lost(last, &run, patience) => Status::Lost,
            false => Status::Occluded,
        }
    }

    fn series(p: &[f64], at: StatusThresholds, patience: usize) -> Vec<Status> {
        let mut reported = ReportedStatus::default();
        p.iter().map(|p| reported.update(*p, at, patience)).collect()
    }

    /// 400 random walks of 60 frames over random thresholds, which P(lost) meets exactly now and then; seed 1. Nothing in it is left to chance.
    #[test]
    fn the_status_follows_its_definition() {
        let mut rng = Streams::new(1, 0).at(0, Purpose::Scene).rng(0);
        let mut met = [0; 4];
        for _ in 0..400 {
            let enter = rng.random_range(0..=10) as f64 / 10.0;
            let at = StatusThresholds { enter, leave: (rng.random_range(0..=10) as f64 / 10.0).min(enter) };
            let patience = rng.random_range(0..8);
            let mut p: f64 = 0.0;
            let walk = |_| {
                p = (p + rng.random_range(-3..=3) as f64 / 10.0).clamp(0.0, 1.0);
                (10.0 * p).round() / 10.0
            };
            let p: Vec<f64> = (0..60).map(walk).collect();
            for (t, status) in series(&p, at, patience).into_iter().enumerate() {
                let expected = by_definition(&p[..=t], at, patience);
                assert_eq!(status, expected, "{at:?}, patience {patience}, frame {t} of {p:?}");
                assert!(status.is_usable() || p[t] >= at.leave, "{status:?} with P(lost) {}", p[t]);
                assert!(!status.is_usable() || p[t] < at.enter, "{status:?} with P(lost) {}", p[t]);
                met[status as usize] += 1;
            }
        }
        assert!(met.iter().all(|frames| *frames > 100), "the walks meet each status: {met:?}");
    }

    #[test]
    fn an_occlusion_by_hand() {
        use Status::{Lost as L, Occluded as O, Reacquired as R, Tracking as T};
        let p = [0.1, 0.4, 0.5, 0.4, 0.3, 0.2, 0.6, 0.6, 0.6, 0.6, 0.1, 0.4, 0.5, 0.2, 0.2, 0.2, 0.2];
        let expected = [T, T, O, O, O, T, O, O, O, L, R, R, L, R, R, R, T];
        assert_eq!(series(&p, StatusThresholds::default(), 3), expected);
        assert_eq!(series(&[0.6, 0.1, 0.1], StatusThresholds::default(), 0), [L, T, T], "without patience");
        assert_eq!(series(&[f64::NAN], StatusThresholds::default(), 3), [O], "what is no probability is no result");
    }

    #[test]
    fn is_lost_is_true_for_lost_only() {
        let all = [Status::Tracking, Status::Occluded, Status::Lost, Status::Reacquired];
        assert_eq!(all.map(Status::is_lost), [false, false, true, false]);
        assert_eq!(all.map(Status::is_usable), [true, false, false, true]);
    }
}
