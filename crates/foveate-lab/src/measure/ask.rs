//! The frames at which a person should look, because the target may be lost or its position is doubtful.

use foveate_base::text::counted;
use foveate_core::seen::credible;

use super::smooth::median;
use super::track::Position;

/// A frame with a higher P(lost) is doubtful.
const P_LOST: f64 = 0.2;
/// So is one whose region is so many times the usual one.
const REGION: f64 = 3.0;
/// Doubtful frames at most so far apart are one stretch.
const NEAR: usize = 5;
/// The share of probability in a region.
const SHARE: f64 = 0.9;

/// A stretch of doubtful frames, counted from 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Ask {
    /// Its most doubtful frame.
    pub frame: usize,
    /// First and last frame.
    pub stretch: [usize; 2],
    /// P(lost) in the most doubtful frame, of the target or the reference.
    pub p_lost: f64,
    /// Radius of the 90 % region of the position there, of the target or the reference, pixels; `None` if it is unknown.
    pub region: Option<f64>,
    /// `lost`, `region` or `leap`.
    pub reason: &'static str,
}

/// Returns the doubtful stretches of a track and of the reference that it is relative to, the one with most doubt first. `leaps` are the
/// frames (by their place in the track) whose position does not fit those of the others.
pub(super) fn ask(track: &[Position], reference: Option<&[Position]>, leaps: &[usize]) -> Vec<Ask> {
    let tracks = || std::iter::once(track).chain(reference);
    let at = |k: usize| tracks().filter_map(move |track| track.get(k));
    let regions =
        |track: &[Position]| -> Vec<Option<f64>> { track.iter().map(|it| it.covariance.map(radius)).collect() };
    let regions: Vec<_> = tracks().map(regions).collect();
    let usual: Vec<f64> = regions.iter().map(|regions| median(regions.iter().flatten().copied())).collect();
    let region = |of: usize, k: usize| regions[of].get(k).copied().flatten();
    let is_wide =
        |k: usize| (0..regions.len()).any(|of| region(of, k).is_some_and(|radius| radius > REGION * usual[of]));
    let p_lost = |k: usize| at(k).map(|position| position.p_lost).fold(0.0, f64::max);
    let doubt = |k: usize| -> Option<(&'static str, f64)> {
        if at(k).count() < regions.len() || at(k).any(|position| !position.usable) || p_lost(k) > P_LOST {
            Some(("lost", p_lost(k).max(P_LOST)))
        } else if is_wide(k) {
            Some(("region", P_LOST))
        } else {
            leaps.contains(&k).then_some(("leap", P_LOST))
        }
    };
    let mut stretches: Vec<(f64, [usize; 2], Ask)> = vec![];
    for (k, position) in track.iter().enumerate() {
        let Some((reason, weight)) = doubt(k) else { continue };
        let widest = (0..regions.len()).filter_map(|of| region(of, k)).max_by(f64::total_cmp);
        let (frame, p_lost, region) = (position.frame, p_lost(k), widest);
        let found = Ask { frame, stretch: [frame; 2], p_lost, region, reason };
        match stretches.last_mut() {
            Some((sum, [_, end], ask)) if k - *end <= NEAR => {
                (*sum, *end) = (*sum + weight, k);
                let stretch = [ask.stretch[0], frame];
                if (p_lost, region) > (ask.p_lost, ask.region) {
                    *ask = found;
                }
                ask.stretch = stretch;
            }
            _ => stretches.push((weight, [k; 2], found)),
        }
    }
    stretches.sort_by(|a, b| b.0.total_cmp(&a.0));
    stretches.into_iter().map(|(_, _, ask)| ask).collect()
}

/// Returns the radius of the 90 % region of a covariance (xx, xy, yy): that of its longest axis.
fn radius([xx, xy, yy]: [f64; 3]) -> f64 {
    let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    (credible(SHARE) * (mean + half.hypot(xy)).max(0.0)).sqrt()
}

/// Returns the note on the stretches; `None` if there are none.
pub(super) fn note(asks: &[Ask]) -> Option<String> {
    let Ask { frame, stretch: [from, to], .. } = asks.first()?;
    Some(format!("Check {} (ask.csv), first frame {frame} of {from} to {to}.", counted(asks.len(), "place")))
}

/// Returns the lines of ask.csv of a point.
pub(super) fn lines(asks: &[Ask], point: &str) -> String {
    let line = |(i, ask): (usize, &Ask)| {
        let (rank, region) = (i + 1, ask.region.map_or(String::new(), |radius| format!("{radius:.2}")));
        let Ask { frame, stretch: [from, to], p_lost, reason, .. } = ask;
        format!("{rank},{frame},{from},{to},{p_lost},{region},{reason},{point}\n")
    };
    asks.iter().enumerate().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_of_doubt_are_ranked() {
        let at = |k: usize| Position {
            frame: k + 1,
            time: k as f64,
            centre: (k as f64, 0.0),
            covariance: (k > 0).then_some(if k == 50 { [0.01, 0.0, 1.0] } else { [0.04, 0.0, 0.04] }),
            p_lost: match k {
                20..=23 => 0.3 + k as f64 / 100.0,
                27 => 0.9,
                _ => 0.01,
            },
            status: String::new(),
            usable: true,
        };
        let track: Vec<Position> = (0..60).map(at).collect();
        let asks = ask(&track, None, &[10]);
        let all: Vec<_> = asks.iter().map(|ask| (ask.frame, ask.stretch, ask.reason)).collect();
        assert_eq!(all, [(28, [21, 28], "lost"), (11, [11, 11], "leap"), (51, [51, 51], "region")]);
        assert!(
            asks[2].region.is_some_and(|radius| (radius - credible(0.9).sqrt()).abs() < 1e-9),
            "the longest axis: {asks:?}"
        );
        assert_eq!(lines(&asks, "ball").lines().next(), Some("1,28,21,28,0.9,0.43,lost,ball"));
        assert!(ask(&track[..20], None, &[]).is_empty());
        // A reference that is lost, and one that ends before the track.
        let still: Vec<Position> =
            track[..20].iter().map(|position| Position { frame: position.frame, ..track[0].clone() }).collect();
        for reference in [&track[10..30], &still[..19]] {
            let asks = ask(&still, Some(reference), &[]);
            assert!(asks.len() == 1 && asks[0].reason == "lost" && asks[0].stretch[1] >= 14, "{asks:?}");
        }
    }
}
