//! A frame with all its targets: rotated boxes, paths, gazes, ids and classes, each target in its own colour.

use foveate_base::text::counted;
use std::collections::BTreeMap;

use crate::annotate::{Path, View, cross, framed, magnified, place};
use crate::draw::{CORNERS, Colour, Drawing, text_width};
use foveate_core::Seen;
use foveate_core::geometry::{Extent, Fixation, Gaze, State};
use foveate_core::multi::Phase;
use foveate_core::scene::Image;
use foveate_video::Frame;

const BLACK: Colour = [0; 3];
const INK: Colour = [236, 238, 240];
/// Distinct colours that are visible on dark and bright pictures; ids take them in turn.
const COLOURS: [Colour; 10] = [
    [57, 182, 255],
    [255, 182, 39],
    [63, 209, 155],
    [244, 114, 182],
    [167, 139, 250],
    [255, 122, 56],
    [163, 230, 53],
    [45, 212, 235],
    [248, 113, 113],
    [214, 211, 209],
];

/// Returns the colour of a target on all pictures; ten consecutive ids have ten colours.
pub fn colour(id: u64) -> Colour {
    COLOURS[(id.wrapping_sub(1) % COLOURS.len() as u64) as usize]
}

/// Returns `id 3` or, with a recogniser, `id 3: 7 98 %`: id, class, probability.
pub fn name(target: &Seen<'_>) -> String {
    let class = target.class.map(|(class, p)| format!(": {class} {:.0} %", 100.0 * p));
    format!("id {}{}", target.id, class.unwrap_or_default())
}

/// Returns whether only the corners of the box are drawn: the target is occluded, or the box is a guess.
pub fn is_occluded_or_lost(phase: Phase) -> bool {
    matches!(phase, Phase::Occluded | Phase::Lost)
}

/// Draws the frames of a run with many targets, in order.
#[derive(Clone, Debug, Default)]
pub struct MultiAnnotator {
    paths: BTreeMap<u64, Path>,
}

impl MultiAnnotator {
    /// Draws a frame with its active targets. Small frames are magnified to about 480 rows, by a whole number.
    pub fn annotate(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Image {
        self.skip(targets);
        let (mut page, view) = magnified(&frame.image);
        for target in targets {
            self.paths[&target.id].draw(&mut page, view, 1.4, colour(target.id), 0.7);
        }
        targets.iter().for_each(|target| body(&mut page, view, target));
        targets.iter().for_each(|target| label(&mut page, view, target));
        let size = 9.0 * view.bold;
        let text = format!("frame {} · {}", frame.index + 1, counted(targets.len(), "target"));
        page.fill(-0.5, -0.5, text_width(&text, size) + 1.6 * size, 2.2 * size, BLACK, 0.55);
        page.text((0.8 * size, 0.6 * size), &text, size, INK);
        page.into_image()
    }

    /// Skips a frame that is not drawn: only the paths are updated.
    pub fn skip(&mut self, targets: &[Seen<'_>]) {
        self.paths.retain(|id, _| targets.iter().any(|target| target.id == *id));
        for target in targets {
            let path = self.paths.entry(target.id).or_default();
            if target.phase == Phase::ReIdentified {
                path.clear();
            }
            path.push(&target.state);
        }
    }
}

/// Returns the centre and the half sides of the reported box, turned by the target's angle. The box of a target that was detected is not that
/// of its state.
pub(crate) fn turned_box(target: &Seen<'_>) -> Fixation {
    let state = State { angle: target.state.angle, ..State::of(&target.bbox) };
    state.fixate(Gaze::CENTRE, Extent::of(&target.bbox))
}

/// Draws the rotated box, only corners if it is occluded or lost, and a cross at the gaze.
fn body(page: &mut Drawing, view: View, target: &Seen<'_>) {
    let ink = colour(target.id);
    if is_occluded_or_lost(target.phase) {
        corners(page, view, target, ink);
    } else {
        framed(page, view, &turned_box(target), 1.0, 2.0, ink);
    }
    let at = target.state.fixate(target.gaze, target.extent);
    cross(page, view, (at.x, at.y), 5.0, 1.6, ink);
}

fn corners(page: &mut Drawing, view: View, target: &Seen<'_>, ink: Colour) {
    const LONG: f64 = 0.4;
    let f = turned_box(target);
    let at = |u: f64, v: f64| view.at(place(&f, u, v));
    for (u, v) in CORNERS {
        let bent = [at(u * (1.0 - LONG), v), at(u, v), at(u, v * (1.0 - LONG))];
        page.line(&bent, 3.8 * view.bold, BLACK, 0.4);
        page.line(&bent, 2.0 * view.bold, ink, 1.0);
    }
}

/// Writes name and phase above the box, or below if there is no room.
fn label(page: &mut Drawing, view: View, target: &Seen<'_>) {
    let note = match target.phase {
        Phase::Initiated | Phase::Tracked => String::new(),
        phase => format!(" {}", phase.name()),
    };
    let (text, size) = (name(target) + &note, 8.0 * view.bold);
    let f = turned_box(target);
    let (reach, left) = (f.uy.abs() + f.vy.abs(), f.ux.abs() + f.vx.abs());
    let (x, top) = view.at((f.x - left, f.y - reach));
    let y = if top >= 2.4 * size { top - 2.1 * size } else { view.at((f.x, f.y + reach)).1 + 0.7 * size };
    let (width, wide) = (text_width(&text, size) + 0.8 * size, page.width() as f64);
    let x = x.min(wide - width).max(0.0);
    page.fill(x, y - 0.4 * size, width, 1.8 * size, BLACK, 0.6);
    page.text((x + 0.4 * size, y), &text, size, colour(target.id));
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use foveate_core::geometry::BBox;

    /// Returns a target of 20 px around (x, 20), turned by half a right angle.
    pub(crate) fn seen(id: u64, x: f64, phase: Phase) -> Seen<'static> {
        let bbox = BBox::around(x, 20.0, 20.0, 20.0);
        let state = State { angle: std::f64::consts::FRAC_PI_4, ..State::of(&bbox) };
        let mut seen = Seen::given([120, 60, 1], &bbox).in_phase(phase);
        (seen.id, seen.state, seen.class) = (id, state, Some((7, 0.98)));
        seen
    }

    pub(crate) fn frame(index: usize) -> Frame {
        Frame { index, time: index as f64 / 30.0, image: Image::grey(120, 60, 0) }
    }

    #[test]
    fn every_target_has_its_colour_and_its_turned_box() {
        let picture =
            MultiAnnotator::default().annotate(&frame(3), &[seen(1, 30.0, Phase::Tracked), seen(2, 80.0, Phase::Lost)]);
        assert_eq!((picture.width(), picture.height()), (960, 480), "8 times as large");
        let shows = |x: f64, y: f64, id: u64| {
            let (x, y) = ((8.0 * (x + 0.5)) as usize, (8.0 * (y + 0.5)) as usize);
            let near = |k: usize| (0..3).all(|p| picture.at(p, x + k % 9 - 4, y + k / 9 - 4) == colour(id)[p]);
            (0..81).any(near)
        };
        let corner = 10.0 * 2f64.sqrt();
        assert!(shows(30.0, 20.0 + corner, 1) && shows(80.0, 20.0 + corner, 2), "corners of turned squares");
        let side = corner / 2.0;
        assert!(shows(30.0 - side, 20.0 + side, 1) && !shows(80.0 - side, 20.0 + side, 2), "a guess has no sides");
        assert_eq!(name(&seen(2, 0.0, Phase::Initiated)), "id 2: 7 98 %");
        assert_ne!(colour(1), colour(2));
        assert_eq!(colour(0), colour(6));
    }

    /// A detection gives a box that is not that of the state.
    #[test]
    fn the_reported_box_is_drawn() {
        let mut detected = seen(1, 30.0, Phase::Tracked);
        detected.bbox = BBox::around(90.0, 40.0, 12.0, 24.0);
        (detected.state.angle, detected.state.log_scale) = (0.0, 1.0);
        let Fixation { x, y, ux, vy, .. } = turned_box(&detected);
        assert_eq!((x, y, ux, vy), (90.0, 40.0, 6.0, 12.0));
        detected.state.angle = std::f64::consts::FRAC_PI_2;
        let Fixation { uy, vx, .. } = turned_box(&detected);
        assert_eq!((uy, vx), (6.0, -12.0));
    }

    #[test]
    fn whatever_a_state_is_it_is_drawn() {
        let mut drawn = MultiAnnotator::default();
        for x in [f64::NAN, 1e300, -1e9, f64::INFINITY] {
            let mut odd = seen(u64::MAX, x, Phase::Lost);
            odd.state.log_scale = 300.0;
            drawn.annotate(&frame(0), &[odd]);
        }
    }
}
