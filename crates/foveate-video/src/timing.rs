//! How long each frame of a video that is written lasts, in whole time units.

/// Time units a frame of constant rate; the timescale is this many times the rate.
pub(super) const UNITS: u32 = 1000;

/// When frames are shown: time units a second, and runs of frames that last equally long, as (frames, units).
#[derive(Debug, PartialEq)]
pub(super) struct Timing {
    pub scale: u32,
    pub runs: Vec<(u32, u32)>,
}

/// Units a second for frames of varying duration: the usual one, in which milliseconds are integers, otherwise
/// microseconds.
const SCALES: [u32; 2] = [90_000, 1_000_000];
/// Times that are nearer than this, in seconds, are equal.
const NEAR: f64 = 1e-6;

impl Timing {
    /// Of frames at these times in seconds, which should rise: a frame lasts one unit at least. `constant` is the scale in which a frame
    /// of a constant rate lasts [`UNITS`]; the last frame lasts as long.
    pub(crate) fn of(times: &[f64], constant: u32) -> Self {
        let lasts = f64::from(UNITS) / f64::from(constant);
        let first = times.first().copied().unwrap_or(0.0);
        let near = |(i, time): (usize, &f64)| ((time - first) - i as f64 * lasts).abs() < NEAR;
        if times.iter().enumerate().all(near) {
            return Self { scale: constant, runs: vec![(times.len() as u32, UNITS)] };
        }
        let whole = |units: f64| (units - units.round()).abs() < 0.01;
        let fits = |scale: &u32| times.iter().all(|time| whole((time - first) * f64::from(*scale)));
        let scale = SCALES.into_iter().find(fits).unwrap_or(SCALES[1]);
        let units = |seconds: f64| (seconds * f64::from(scale)).round();
        let end = times.last().map(|last| last + lasts);
        let mut runs: Vec<(u32, u32)> = vec![];
        let mut now = 0.0;
        for time in times.iter().skip(1).copied().chain(end) {
            // From where the file is, not from frame to frame: so that rounding does not accumulate.
            let each = (units(time - first) - now).clamp(1.0, f64::from(u32::MAX)) as u32;
            now += f64::from(each);
            match runs.last_mut() {
                Some((count, same)) if *same == each => *count += 1,
                _ => runs.push((1, each)),
            }
        }
        Self { scale, runs }
    }

    /// Units in all.
    pub(crate) fn length(&self) -> u64 {
        self.runs.iter().map(|(count, each)| u64::from(*count) * u64::from(*each)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn runs(times: &[f64], constant: u32) -> (u32, Vec<(u32, u32)>) {
        let timing = Timing::of(times, constant);
        (timing.scale, timing.runs)
    }

    #[test]
    fn times_are_kept() {
        let constant: Vec<f64> = (0..50).map(|i| 3.0 + i as f64 / 12.5).collect();
        assert_eq!(runs(&constant, 12500), (12500, vec![(50, 1000)]));
        // A rate that the usual scale rounds.
        let ntsc: Vec<f64> = (0..50).map(|i| i as f64 * 1001.0 / 30000.0).collect();
        assert_eq!(runs(&ntsc, 29970), (90000, vec![(50, 3003)]));
        // Milliseconds of Matroska at 30 a second, and a pause.
        assert_eq!(
            runs(&[0.0, 0.033, 0.067, 0.1, 5.0], 30000),
            (90000, vec![(1, 2970), (1, 3060), (1, 2970), (1, 441_000), (1, 3000)])
        );
        // Of 1/12800, which 90000 does not hold: within half a microsecond.
        let odd: Vec<f64> = [0, 512, 1536, 1537, 4000].iter().map(|i| f64::from(*i) / 12800.0).collect();
        let timing = Timing::of(&odd, 25000);
        assert_eq!(timing.scale, 1_000_000);
        let mut at = 0;
        for (time, (_, each)) in odd.iter().zip(&timing.runs) {
            assert!((f64::from(at) / 1e6 - time).abs() < 0.5e-6);
            at += each;
        }
        assert_eq!(timing.length(), 352_500);
        // Times that do not rise.
        assert_eq!(runs(&[0.0, 0.0, 0.0], 30000), (90000, vec![(2, 1), (1, 2998)]));
        assert_eq!(runs(&[7.0], 30000), (30000, vec![(1, 1000)]));
    }
}
