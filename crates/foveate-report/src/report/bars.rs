//! The tracks as bars over time, as SVG.

use std::fmt::Write as _;

use crate::multi::colour;
use foveate_core::multi::Phase;

/// Width of the drawing, and estimated width of a letter, in its own units; actual letters are narrower.
const WIDE: f64 = 1000.0;
const LETTER: f64 = 7.0;
/// Height of a row, and of the axis below.
const ROW: f64 = 22.0;
const AXIS: f64 = 30.0;

/// A phase of a track, its first and its last frame, from 0.
pub(super) type Span = (Phase, usize, usize);

/// Draws one row per track: filled if tracked, pale if occluded, a thin line if lost; a ring at each re-identification.
pub(super) fn bars(tracks: &[(u64, &[Span])], last: usize) -> String {
    let name = |id: u64| format!("id {id}");
    let longest = tracks.iter().map(|(id, _)| name(*id).len()).max().unwrap_or(0);
    let left = 20.0 + LETTER * longest.max(5) as f64;
    let x = |frame: f64| left + (WIDE - left - 12.0) * frame / (last + 1) as f64;
    let height = ROW * tracks.len() as f64 + AXIS;
    let mut svg = format!(
        "<svg class=\"bars\" viewBox=\"0 0 {WIDE} {height}\" role=\"img\" aria-label=\"The phases of each track over time\">"
    );
    let (foot, base) = (height - 24.0, height - 6.0);
    for frame in marks(last + 1, x(1.0) - x(0.0)) {
        // The middle of frame number `frame`, counted from 1.
        let at = x(frame as f64 - 0.5);
        let _ = write!(
            svg,
            "<path d=\"M{at:.1} 0V{foot}\" class=\"grid\"/><text x=\"{at:.1}\" y=\"{base}\">{frame}</text>"
        );
    }
    let _ = write!(svg, "<text x=\"{}\" y=\"{base}\" class=\"end\">frame {}</text>", WIDE - 12.0, last + 1);
    for (i, (id, spans)) in tracks.iter().enumerate() {
        let (y, [r, g, b]) = (ROW * i as f64, colour(*id));
        let _ = write!(svg, "<text x=\"{}\" y=\"{}\" class=\"id\">{}</text>", left - 8.0, y + 15.5, name(*id));
        for (phase, from, to) in *spans {
            let (from, to) = (x(*from as f64), x(*to as f64 + 1.0));
            let (class, top, tall) = match phase {
                Phase::Lost => ("lost", y + 9.5, 3.0),
                Phase::Occluded => ("pale", y + 4.0, 14.0),
                _ => ("full", y + 4.0, 14.0),
            };
            let _ = write!(
                svg,
                "<rect x=\"{from:.1}\" y=\"{top}\" width=\"{:.1}\" height=\"{tall}\" rx=\"1.5\" fill=\"rgb({r} {g} {b})\" class=\"{class}\"/>",
                (to - from).max(0.6)
            );
            if *phase == Phase::ReIdentified {
                let _ = write!(svg, "<circle cx=\"{from:.1}\" cy=\"{}\" r=\"5\" class=\"again\"/>", y + 11.0);
            }
        }
    }
    svg + "</svg>"
}

/// Returns the frame numbers for the axis, counted from 1, with `unit` as the width of a frame: multiples of 1, 2, 5, 10 ... farther apart
/// than the width of their labels, at most 13, and none under the label of the last frame.
fn marks(frames: usize, unit: f64) -> Vec<usize> {
    let letters = frames.to_string().len() as f64;
    let apart = (LETTER * (letters + 2.0)).max((WIDE - 80.0) / 13.0);
    let round = (0..18).flat_map(|power| [1, 2, 5].map(|first| first * 10_usize.pow(power)));
    let step = round.into_iter().find(|step| *step as f64 * unit >= apart).unwrap_or(usize::MAX);
    let end = LETTER * ("frame ".len() as f64 + 1.5 * letters + 2.0);
    (step..frames).step_by(step).filter(|frame| (frames - frame) as f64 * unit > end).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_round_few_and_apart() {
        let marks_of = |frames: usize| marks(frames, 920.0 / frames as f64);
        assert_eq!(marks_of(300), [50, 100, 150, 200, 250]);
        assert_eq!(marks_of(10), [1, 2, 3, 4, 5, 6, 7, 8, 9]);
        assert_eq!(marks_of(20_000), [2000, 4000, 6000, 8000, 10_000, 12_000, 14_000, 16_000]);
        for frames in (1..2_000_000).step_by(997) {
            let (marks, unit) = (marks_of(frames), 920.0 / frames as f64);
            let wide = |n: usize| LETTER * n.to_string().len() as f64;
            assert!(marks.len() <= 13);
            assert!(marks.windows(2).all(|pair| (pair[1] - pair[0]) as f64 * unit > wide(pair[1])), "{frames}");
            let room = |mark: &usize| 920.0 - (*mark as f64 - 0.5) * unit - wide(*mark) / 2.0;
            assert!(marks.last().is_none_or(|mark| room(mark) > LETTER * 6.0 + wide(frames)), "{frames}");
        }
    }
}
