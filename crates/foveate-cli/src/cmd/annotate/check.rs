//! The frames to check first: those whose correction is expected to raise the IoU most.

use super::join::Joined;

/// A correction repairs frames beside it: half of their error at this distance, in frames.
const HALF: f64 = 15.0;

/// The frames of a target that lie between two key frames; a correction changes no others.
#[derive(Clone, Debug)]
pub(super) struct Span {
    pub target: usize,
    /// The frame of the first box, from 0.
    pub from: usize,
    pub boxes: Vec<Joined>,
}

/// A frame to check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Check {
    pub target: usize,
    /// The frame, from 0.
    pub frame: usize,
    /// Expected IoU of the box before any correction.
    pub iou: f64,
    /// By how much the correction is expected to raise the sum of IoU over all frames.
    pub gain: f64,
    /// Expected mean IoU of all boxes after this and all earlier corrections.
    pub mean: f64,
    /// Least expected IoU of a box after them.
    pub least: f64,
}

/// 1 − IoU in the frames of a span.
struct Missing<'a> {
    span: &'a Span,
    missing: Vec<f64>,
}

impl Missing<'_> {
    /// The frame whose correction repairs most, by its position in the span, and how much.
    fn best(&self) -> (usize, f64) {
        // The gain of a frame is a sum of exponentials to both sides: one pass each way gives all gains.
        let step = 0.5_f64.powf(1.0 / HALF);
        let (mut gains, n) = (self.missing.clone(), self.missing.len());
        let mut add = |order: &mut dyn Iterator<Item = usize>| {
            let mut sum = 0.0;
            for t in order {
                gains[t] += sum;
                sum = (sum + self.missing[t]) * step;
            }
        };
        add(&mut (0..n));
        add(&mut (0..n).rev());
        let best = (0..n).max_by(|a, b| gains[*a].total_cmp(&gains[*b]).then(b.cmp(a))).expect("a span has frames");
        (best, gains[best])
    }

    fn correct(&mut self, at: usize) {
        self.missing.iter_mut().enumerate().for_each(|(t, m)| *m *= 1.0 - repaired(at, t));
    }
}

/// The share of a frame's error that the correction of another frame repairs.
fn repaired(at: usize, frame: usize) -> f64 {
    0.5_f64.powf(at.abs_diff(frame) as f64 / HALF)
}

/// Lists at most so many frames, the most rewarding first, each after the corrections before it.
pub(super) fn check_first(spans: &[Span], most: usize) -> Vec<Check> {
    let missing = |span| Missing { span, missing: Vec::from_iter(Span::missing(span)) };
    let mut all: Vec<Missing<'_>> = spans.iter().filter(|span| !span.boxes.is_empty()).map(missing).collect();
    let mut best: Vec<(usize, f64)> = all.iter().map(Missing::best).collect();
    let frames = all.iter().map(|span| span.missing.len()).sum::<usize>() as f64;
    let mut checks = vec![];
    while checks.len() < most {
        let gains = || best.iter().map(|(_, gain)| *gain).enumerate();
        let Some((k, gain)) = gains().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0))) else { break };
        if gain <= 0.0 {
            break;
        }
        let (at, span) = (best[k].0, all[k].span);
        all[k].correct(at);
        best[k] = all[k].best();
        let left = || all.iter().flat_map(|span| span.missing.iter());
        let (mean, least) = (1.0 - left().sum::<f64>() / frames, 1.0 - left().fold(0.0, |most: f64, m| most.max(*m)));
        let (target, frame, iou) = (span.target, span.from + at, span.boxes[at].iou);
        checks.push(Check { target, frame, iou, gain, mean, least });
    }
    checks
}

impl Span {
    fn missing(&self) -> impl Iterator<Item = f64> + '_ {
        self.boxes.iter().map(|joined| 1.0 - joined.iou)
    }
}

/// Returns how many of the corrections are needed until the expected mean IoU is `mean` and no box has less than `least`: `None` if all
/// are too few.
pub(super) fn needed(spans: &[Span], checks: &[Check], mean: f64, least: f64) -> Option<usize> {
    let ious = || spans.iter().flat_map(|span| &span.boxes).map(|joined| joined.iou);
    let (count, sum) = ious().fold((0, 0.0), |(n, sum), iou| (n + 1, sum + iou));
    if count == 0 || (sum / f64::from(count) >= mean && ious().all(|iou| iou >= least)) {
        return Some(0);
    }
    checks.iter().position(|check| check.mean >= mean && check.least >= least).map(|at| at + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate::BBox;

    fn span(target: usize, from: usize, ious: &[f64]) -> Span {
        let bbox = BBox::new(0.0, 0.0, 10.0, 10.0);
        Span { target, from, boxes: ious.iter().map(|iou| Joined { bbox, iou: *iou }).collect() }
    }

    #[test]
    fn the_middle_of_the_worst_stretch_comes_first() {
        let mut ious = vec![0.9; 60];
        ious[40..50].fill(0.2);
        let checks = check_first(&[span(0, 100, &[0.8; 30]), span(1, 7, &ious)], 2);
        assert_eq!((checks[0].target, checks[0].iou), (1, 0.2));
        assert!((7 + 43..7 + 47).contains(&checks[0].frame), "{}", checks[0].frame);
        assert_eq!(checks[1].target, 0, "what the first correction repairs counts no more");
        assert!(checks[0].gain > checks[1].gain && checks[0].mean < checks[1].mean);
    }

    #[test]
    fn gains_are_those_of_the_definition() {
        let ious: Vec<f64> = (0..50).map(|t| 0.5 + 0.4 * f64::from(t * t * t % 11) / 11.0).collect();
        let check = check_first(&[span(0, 0, &ious)], 1)[0];
        let gain = |at: usize| ious.iter().enumerate().map(|(t, iou)| (1.0 - iou) * repaired(at, t)).sum::<f64>();
        let best = (0..50).max_by(|a, b| gain(*a).total_cmp(&gain(*b))).expect("some");
        assert_eq!(check.frame, best);
        assert!((check.gain - gain(best)).abs() < 1e-9);
        let mean = 1.0 - (ious.iter().map(|iou| 1.0 - iou).sum::<f64>() - gain(best)) / 50.0;
        assert!((check.mean - mean).abs() < 1e-9);
    }

    #[test]
    fn corrections_are_counted_until_all_is_well() {
        let spans = [span(0, 0, &[0.9; 20]), span(1, 0, &[0.9, 0.3, 0.9])];
        let checks = check_first(&spans, 10);
        assert_eq!(needed(&spans, &checks, 0.8, 0.2), Some(0));
        assert_eq!(needed(&spans, &checks, 0.8, 0.5), checks.iter().position(|c| c.target == 1).map(|at| at + 1));
        assert_eq!(needed(&spans, &checks, 1.0, 1.0), None);
        assert_eq!(needed(&[], &[], 0.8, 0.5), Some(0));
        assert!(check_first(&[span(0, 0, &[1.0, 1.0])], 5).is_empty(), "nothing to gain");
    }
}
