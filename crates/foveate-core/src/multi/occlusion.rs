//! The depth order of overlapping targets, and the visible fraction of each.

use super::meeting::Meetings;
use super::settings::Occlusion;
use crate::geometry::BBox;

/// The properties of a target that determine occlusion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Body {
    pub id: u64,
    /// Its predicted box.
    pub bbox: BBox,
    /// Similarity of the picture there to the target, 0 to 1.
    pub similarity: f64,
}

/// Cells along each side of a box, to measure occlusion.
const CELLS: usize = 10;

/// The depth order: pairs (front, behind), of this frame and of the one before.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Fronts {
    pub now: Vec<(u64, u64)>,
    before: Vec<(u64, u64)>,
    /// The pairs of this frame by index, (behind, front).
    #[serde(skip)]
    covers: Vec<(usize, usize)>,
}

/// Computes the visible fraction of each body, 0 to 1. Bodies are in the order of `meetings`.
pub(super) fn visible(bodies: &[Body], meetings: &Meetings, s: &Occlusion, fronts: &mut Fronts, out: &mut Vec<f64>) {
    std::mem::swap(&mut fronts.now, &mut fronts.before);
    let Fronts { now: fronts, before, covers } = fronts;
    before.sort_unstable();
    fronts.clear();
    covers.clear();
    for (i, j) in meetings.pairs() {
        let (a, b) = (&bodies[i], &bodies[j]);
        let lower = (a.bbox.y + a.bbox.h - b.bbox.y - b.bbox.h) / (0.5 * (a.bbox.h + b.bbox.h));
        let mut a_is_before = s.ground * lower + a.similarity - b.similarity;
        a_is_before += s.habit * f64::from(u8::from(before.binary_search(&(a.id, b.id)).is_ok()));
        a_is_before -= s.habit * f64::from(u8::from(before.binary_search(&(b.id, a.id)).is_ok()));
        let (front, behind) = if a_is_before >= 0.0 { (i, j) } else { (j, i) };
        fronts.push((bodies[front].id, bodies[behind].id));
        covers.push((behind, front));
    }
    covers.sort_unstable();
    out.clear();
    let mut rest = &covers[..];
    out.extend(bodies.iter().enumerate().map(|(i, body)| {
        let (over, others) = rest.split_at(rest.partition_point(|(behind, _)| *behind == i));
        rest = others;
        match over {
            [] => 1.0,
            _ => share(&body.bbox, &|x, y| over.iter().any(|(_, front)| holds(&bodies[*front].bbox, x, y))),
        }
    }));
}

fn holds(b: &BBox, x: f64, y: f64) -> bool {
    (b.x..b.x + b.w).contains(&x) && (b.y..b.y + b.h).contains(&y)
}

/// Returns the fraction of a box's cells whose centre is not covered.
fn share(b: &BBox, covered: &dyn Fn(f64, f64) -> bool) -> f64 {
    let at = |k: usize, from: f64, side: f64| from + (k as f64 + 0.5) / CELLS as f64 * side;
    let cells = (0..CELLS * CELLS).filter(|k| !covered(at(k % CELLS, b.x, b.w), at(k / CELLS, b.y, b.h)));
    cells.count() as f64 / (CELLS * CELLS) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(id: u64, x: f64, y: f64, similarity: f64) -> Body {
        Body { id, bbox: BBox { x, y, w: 20.0, h: 40.0 }, similarity }
    }

    fn shares(bodies: &[Body], s: &Occlusion, fronts: &mut Fronts) -> Vec<f64> {
        let (mut out, mut meetings) = (vec![], Meetings::default());
        meetings.find(bodies.len(), &|i| bodies[i].bbox);
        visible(bodies, &meetings, s, fronts, &mut out);
        out
    }

    #[test]
    fn the_lower_or_more_similar_target_is_in_front() {
        let ground = Occlusion::default();
        let flat = Occlusion { ground: 0.0, ..ground };
        let far = [body(1, 0.0, 0.0, 0.5), body(2, 50.0, 0.0, 0.5)];
        assert_eq!(shares(&far, &ground, &mut Fronts::default()), [1.0, 1.0]);
        // The second box is 8 px lower and covers half of the first's width and 0.8 of its height.
        let near = [body(1, 0.0, 0.0, 0.6), body(2, 10.0, 8.0, 0.5)];
        assert_eq!(shares(&near, &ground, &mut Fronts::default()), [1.0 - 0.5 * 0.8, 1.0]);
        assert_eq!(shares(&near, &flat, &mut Fronts::default()), [1.0, 1.0 - 0.5 * 0.8]);
    }

    #[test]
    fn the_depth_order_changes_only_on_clear_evidence() {
        let flat = Occlusion { ground: 0.0, ..Occlusion::default() };
        let mut fronts = Fronts { now: vec![(1, 2)], ..Fronts::default() };
        let slight = [body(1, 0.0, 0.0, 0.5), body(2, 10.0, 0.0, 0.6)];
        assert_eq!(shares(&slight, &flat, &mut fronts), [1.0, 0.5]);
        let mut other = Fronts { now: vec![(2, 1)], ..Fronts::default() };
        assert_eq!(shares(&[body(1, 0.0, 0.0, 0.6), body(2, 10.0, 0.0, 0.5)], &flat, &mut other), [0.5, 1.0]);
        let clear = [body(1, 0.0, 0.0, 0.1), body(2, 10.0, 0.0, 0.6)];
        assert_eq!(shares(&clear, &flat, &mut fronts), [0.5, 1.0]);
        assert_eq!(fronts.now, [(2, 1)]);
    }
}
