//! The times of the frames of a stream.

use std::time::Instant;

/// Time stamps that lie further apart than this, in seconds, do not belong together.
const GAP: f64 = 10.0;
/// Time stamps closer than this, in seconds, were made up by ffmpeg in the place of some that do not rise.
const NEAREST: f64 = 1e-6;

/// The times of frames: by time stamps as long as they rise by little, else by the clock.
#[derive(Default)]
pub(super) struct Clock {
    /// The time of the last frame, its time stamp, and when it was read.
    last: Option<(f64, Option<f64>, Instant)>,
    /// Whether the last time stamp rose by little.
    rises: bool,
}

impl Clock {
    /// The time of a frame, and whether its time stamp jumped forward, or is the first of some that do not rise.
    pub(super) fn time(&mut self, stamp: Option<f64>, now: Instant) -> (f64, bool) {
        let (mut time, mut jumped) = (0.0, false);
        if let Some((last, before, read)) = self.last {
            let step = stamp.zip(before).map(|(stamp, before)| stamp - before);
            let rise = step.filter(|step| *step > NEAREST && *step <= GAP);
            jumped = step.is_some_and(|step| step > GAP || (step <= NEAREST && self.rises));
            self.rises = rise.is_some();
            time = last + rise.unwrap_or_else(|| now.duration_since(read).as_secs_f64());
        }
        self.last = Some((time, stamp, now));
        (time, jumped)
    }

    /// The time stamps that follow have nothing to do with those before.
    pub(super) fn restart(&mut self) {
        self.rises = false;
        if let Some((_, stamp, _)) = &mut self.last {
            *stamp = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn times_follow_time_stamps_as_long_as_they_rise_by_little() {
        let (mut clock, began) = (Clock::default(), Instant::now());
        let mut at = |stamp, seconds| clock.time(stamp, began + Duration::from_secs(seconds));
        // Frames that come at once keep the distance at which they were taken.
        let times = [at(Some(100.0), 1), at(Some(100.5), 1), at(Some(101.0), 1)];
        assert_eq!(times, [(0.0, false), (0.5, false), (1.0, false)]);
        // A step back, a leap, a frame without one: by the clock.
        let times = [at(Some(3.0), 2), at(Some(300.0), 5), at(None, 6), at(Some(301.0), 8)];
        assert_eq!(times, [(2.0, true), (5.0, true), (6.0, false), (8.0, false)]);
        assert_eq!(at(Some(302.0), 9), (9.0, false));
        clock.restart();
        assert_eq!(clock.time(Some(303.0), began + Duration::from_secs(19)), (19.0, false));
    }

    /// In the place of time stamps that are smaller than an earlier one, ffmpeg gives that one and so many ticks.
    #[test]
    fn the_time_does_not_stand_still_after_a_step_back() {
        let (mut clock, began, tick) = (Clock::default(), Instant::now(), 1.0 / 1_764_000_000.0);
        let stamps = [0.0, tick, 0.5, 1.0, 1.0 + tick, 1.0 + 2.0 * tick, 1.0 + 3.0 * tick, 1.5, 1.5 + tick];
        let found = stamps.iter().zip(0..).map(|(&stamp, half): (_, u32)| {
            let (time, jumped) = clock.time(Some(stamp), began + Duration::from_millis(500) * half);
            ((2.0 * time).round(), jumped)
        });
        let (halves, jumps): (Vec<f64>, Vec<bool>) = found.unzip();
        assert_eq!(halves, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]);
        assert_eq!(jumps, [false, false, false, false, true, false, false, false, true]);
    }
}
