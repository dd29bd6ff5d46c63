//! The times of pictures: how many frames were dropped between two of them.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

/// The usual interval is that of so many intervals.
const KEPT: usize = 31;
/// No frame counts as dropped until so many intervals are known.
const FEWEST: usize = 8;
/// An interval this much short of a whole number of usual ones still has that number.
const SHORT: f64 = 0.25;
/// The most frames that count as dropped: after a longer pause the prediction is of no use.
const MOST: f64 = 30.0;

/// The time of the last picture, and the intervals before it.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct Times {
    last: Option<f64>,
    intervals: VecDeque<f64>,
    /// Frames that were dropped before the next picture.
    dropped: usize,
}

impl Default for Times {
    fn default() -> Self {
        Self { last: None, intervals: VecDeque::with_capacity(KEPT), dropped: 0 }
    }
}

impl Times {
    /// Takes the time of the next picture, seconds, and counts the frames that were dropped before it: the interval in units of the usual
    /// one, in whole numbers, less 1. A time that is not finite or does not increase starts a new series. One that goes back is of another
    /// video, whose usual interval is not known.
    pub(crate) fn advance(&mut self, time: f64) {
        let interval = self.last.map_or(f64::NAN, |last| time - last);
        self.last = time.is_finite().then_some(time);
        self.dropped = 0;
        if interval < 0.0 {
            self.intervals.clear();
        }
        if !(interval > 0.0 && interval.is_finite()) {
            return;
        }
        let usual = self.interval().filter(|_| self.intervals.len() >= FEWEST);
        while self.intervals.len() >= KEPT {
            self.intervals.pop_front();
        }
        self.intervals.push_back(interval);
        self.dropped = usual.map_or(0, |usual| ((interval / usual + SHORT).floor() - 1.0).clamp(0.0, MOST) as usize);
    }

    /// Returns the number of frames that were dropped before the next picture, once.
    pub(crate) fn take_dropped(&mut self) -> usize {
        std::mem::take(&mut self.dropped).min(MOST as usize)
    }

    /// Returns the time of the last picture.
    pub(crate) fn last(&self) -> Option<f64> {
        self.last
    }

    /// Returns the usual interval, seconds: the mean of the middle half, because rates may alternate. `None` before the second picture.
    pub(crate) fn interval(&self) -> Option<f64> {
        let mut sorted = [0.0; KEPT];
        let n = self.intervals.len().min(KEPT);
        sorted.iter_mut().zip(&self.intervals).for_each(|(to, from)| *to = *from);
        sorted[..n].sort_by(f64::total_cmp);
        let middle = &sorted[n / 4..n - n / 4];
        (n > 0).then(|| middle.iter().sum::<f64>() / middle.len() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dropped(times: impl IntoIterator<Item = f64>) -> Vec<usize> {
        let mut all = Times::default();
        let count = |time| {
            all.advance(time);
            all.take_dropped()
        };
        times.into_iter().map(count).collect()
    }

    #[test]
    fn constant_and_nearly_constant_rates_drop_nothing() {
        assert!(dropped((0..99).map(|t| f64::from(t) / 29.97)).iter().all(|n| *n == 0));
        // Milliseconds, as Matroska states them; every second frame late by 40 %; two and three fields a frame.
        assert!(dropped((0..99).map(|t| (f64::from(t) / 0.06).round() / 1000.0)).iter().all(|n| *n == 0));
        assert!(dropped((0..99).map(|t| f64::from(t) + 0.4 * f64::from(t % 2))).iter().all(|n| *n == 0));
        assert!(dropped((0..99).map(|t| f64::from(5 * (t / 2) + 3 * (t % 2)))).iter().all(|n| *n == 0));
    }

    #[test]
    fn missing_frames_are_counted() {
        let kept = |t: &u32| !matches!(*t, 2 | 20 | 31..=33 | 60..=179);
        let times: Vec<u32> = (0..200).filter(kept).collect();
        let counts = dropped(times.iter().map(|t| f64::from(*t) / 25.0));
        let of = |frame: u32| counts[times.iter().position(|t| *t == frame).expect("kept")];
        assert_eq!([of(3), of(21), of(34), of(180)], [0, 1, 3, 30], "unknown, one, three, the most");
        assert_eq!(counts.iter().sum::<usize>(), 34);
    }

    #[test]
    fn times_that_go_back_or_are_no_numbers_start_again() {
        let early = (0..9).map(f64::from);
        let odd = [3.0, 4.0, f64::NAN, 90.0, 91.0, f64::INFINITY, 95.0];
        assert!(dropped(early.chain(odd)).iter().all(|n| *n == 0));
        // Another video, four times as slow.
        let slower = (0..40).map(|t| f64::from(t) / 7.5);
        assert!(dropped((0..40).map(|t| f64::from(t) / 30.0).chain(slower)).iter().all(|n| *n == 0));
    }
}
