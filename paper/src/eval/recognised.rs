//! Recognition along real tracks (the paper's table 2): the accuracy of the decision, frame by frame.

use serde::{Deserialize, Serialize};

use foveate::Tracker;
use foveate::lab::eval::metrics::centre_error;
use foveate::lab::synthetic::Drawn;
use foveate::video::Frame;
use foveate::{Error, Result};

/// One tracker with a recogniser on one video, from the second frame on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Recognised {
    /// The true class of the target.
    pub digit: u8,
    /// Distance of the estimated centre from the true one, pixels.
    pub errors: Vec<f64>,
    /// The most likely class over all frames so far.
    pub decided: Vec<u8>,
    /// The most likely class of each frame's own decision.
    pub own: Vec<u8>,
    /// The probability of the true class over all frames so far.
    pub probability: Vec<f32>,
}

impl Recognised {
    /// Follows a video's target from its true first box.
    ///
    /// # Errors
    /// The tracker has no recogniser of ten classes, or refuses the first box.
    pub(crate) fn follow(video: &dyn Drawn, tracker: &mut Tracker) -> Result<Self> {
        let digit = video.label();
        let mut run = Self { digit, ..Self::default() };
        for (index, truth) in video.truth().iter().enumerate() {
            let frame = Frame { index, time: index as f64 / 30.0, image: video.render(index) };
            if index == 0 {
                tracker.init(&frame.image, *truth)?;
                continue;
            }
            let seen = tracker.update(&frame.image)?;
            let (Some((decided, _)), Some((own, _)), true) = (seen.class, seen.own_class(), seen.classes.len() == 10)
            else {
                return Err(Error::Config(
                    "to recognise digits the configuration needs a recogniser of ten classes".into(),
                ));
            };
            run.errors.push(centre_error(&seen.bbox, truth));
            run.decided.push(decided as u8);
            run.own.push(own as u8);
            run.probability.push(seen.classes[usize::from(digit)] as f32);
        }
        Ok(run)
    }

    /// Returns whether the results can belong to a video with this number of frames: a check of a file's content.
    pub(crate) fn is_of(&self, frames: usize) -> bool {
        let n = self.errors.len();
        n + 1 == frames && [self.decided.len(), self.own.len(), self.probability.len()] == [n; 3]
    }

    /// Returns the fraction of frames with the right decision over all frames so far.
    pub(crate) fn accuracy(&self) -> f64 {
        self.share(&self.decided)
    }
    /// Returns the fraction of frames with the right decision on the last glimpses.
    pub(crate) fn single(&self) -> f64 {
        self.share(&self.own)
    }
    /// Returns whether the last decision is right.
    pub(crate) fn right_at_end(&self) -> bool {
        self.decided.last() == Some(&self.digit)
    }
    fn share(&self, classes: &[u8]) -> f64 {
        classes.iter().filter(|c| **c == self.digit).count() as f64 / classes.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decisions_are_counted() {
        let run = Recognised {
            digit: 5,
            errors: vec![1.0, 2.0, 20.0, 30.0],
            decided: vec![1, 5, 5, 1],
            own: vec![1, 5, 1, 1],
            probability: vec![0.5; 4],
        };
        assert!(run.is_of(5) && !run.is_of(4));
        assert_eq!((run.accuracy(), run.single(), run.right_at_end()), (0.5, 0.25, false));
    }
}
