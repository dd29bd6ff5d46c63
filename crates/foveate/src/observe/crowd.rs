//! A frame with all targets in it as a picture: turned boxes, paths, gazes, names and classes, each in a colour of its own.

use std::collections::{BTreeMap, VecDeque};

use super::annotate::{View, magnified, outline};
use super::draw::{Colour, Drawing, Point, text_width};
use super::many::{Phase, Seen};
use crate::geometry::Gaze;
use crate::scene::{Frame, Image};

/// Frames of path that are shown.
const PATH: usize = 60;
const BLACK: Colour = [0; 3];
const INK: Colour = [236, 238, 240];
/// Colours that differ from each other and show on dark and bright pictures; ids take them in turn.
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

/// The colour of a target on all pictures.
pub fn colour(id: u64) -> Colour {
    COLOURS[(id.wrapping_sub(1) % COLOURS.len() as u64) as usize]
}

/// `no 3` and, where a recogniser has spoken, `no 3: 7 98 %`: number, class, probability.
pub fn name(seen: &Seen) -> String {
    let class = seen.class.map(|(class, p)| format!(": {class} {:.0} %", 100.0 * p));
    format!("no {}{}", seen.id, class.unwrap_or_default())
}

/// Draws frames of one run, in order.
#[derive(Clone, Debug, Default)]
pub struct CrowdAnnotator {
    paths: BTreeMap<u64, VecDeque<Point>>,
}

impl CrowdAnnotator {
    /// A frame and who lives in it. Small frames are magnified.
    pub fn annotate(&mut self, frame: &Frame, targets: &[Seen]) -> Image {
        self.walk(targets);
        let (mut page, view) = magnified(&frame.image);
        for seen in targets {
            let path = &self.paths[&seen.id];
            for (i, (a, b)) in path.iter().zip(path.iter().skip(1)).enumerate() {
                let fresh = (i + 1) as f64 / path.len() as f64;
                page.line(&[view.at(*a), view.at(*b)], 1.4 * view.bold, colour(seen.id), 0.7 * fresh);
            }
        }
        targets.iter().for_each(|seen| body(&mut page, view, seen));
        targets.iter().for_each(|seen| label(&mut page, view, seen));
        let size = 9.0 * view.bold;
        let text = format!("frame {} · {} targets", frame.index + 1, targets.len());
        page.fill(-0.5, -0.5, text_width(&text, size) + 1.6 * size, 2.2 * size, BLACK, 0.55);
        page.text((0.8 * size, 0.6 * size), &text, size, INK);
        page.into_image()
    }

    /// Takes in where targets are without drawing them.
    pub fn walk(&mut self, targets: &[Seen]) {
        self.paths.retain(|id, _| targets.iter().any(|seen| seen.id == *id));
        for seen in targets {
            let path = self.paths.entry(seen.id).or_default();
            if seen.phase == Phase::Found {
                path.clear();
            }
            path.push_back((seen.state.x, seen.state.y));
            if path.len() > PATH {
                path.pop_front();
            }
        }
    }
}

/// The turned box: whole lines where it is seen, corners where it is hidden or a guess; and the gaze.
fn body(page: &mut Drawing, view: View, seen: &Seen) {
    let ink = colour(seen.id);
    match seen.phase {
        Phase::Hidden | Phase::Lost => corners(page, view, seen, ink),
        _ => outline(page, view, &seen.state, seen.extent, Gaze::CENTRE, 1.0, 2.0, ink),
    }
    let at = seen.state.fixate(seen.gaze, seen.extent);
    let ((x, y), arm) = (view.at((at.x, at.y)), 5.0 * view.bold);
    for (thick, colour, alpha) in [(3.4, BLACK, 0.5), (1.6, ink, 1.0)] {
        page.line(&[(x - arm, y), (x + arm, y)], thick * view.bold, colour, alpha);
        page.line(&[(x, y - arm), (x, y + arm)], thick * view.bold, colour, alpha);
    }
}

fn corners(page: &mut Drawing, view: View, seen: &Seen, ink: Colour) {
    const LONG: f64 = 0.4;
    let f = seen.state.fixate(Gaze::CENTRE, seen.extent);
    let at = |u: f64, v: f64| view.at((f.x + u * f.ux + v * f.vx, f.y + u * f.uy + v * f.vy));
    for (u, v) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        let bent = [at(u * (1.0 - LONG), v), at(u, v), at(u, v * (1.0 - LONG))];
        page.line(&bent, 3.8 * view.bold, BLACK, 0.4);
        page.line(&bent, 2.0 * view.bold, ink, 1.0);
    }
}

/// Its name above its box, or below where there is no room.
fn label(page: &mut Drawing, view: View, seen: &Seen) {
    let note = match seen.phase {
        Phase::Lost => " lost",
        Phase::Hidden => " hidden",
        Phase::Found => " found again",
        Phase::Born | Phase::Followed => "",
    };
    let (text, size) = (name(seen) + note, 8.0 * view.bold);
    let f = seen.state.fixate(Gaze::CENTRE, seen.extent);
    let (reach, left) = (f.uy.abs() + f.vy.abs(), f.ux.abs() + f.vx.abs());
    let (x, top) = view.at((f.x - left, f.y - reach));
    let y = if top >= 2.4 * size { top - 2.1 * size } else { view.at((f.x, f.y + reach)).1 + 0.7 * size };
    let (width, wide) = (text_width(&text, size) + 0.8 * size, page.width() as f64);
    let x = x.min(wide - width).max(0.0);
    page.fill(x, y - 0.4 * size, width, 1.8 * size, BLACK, 0.6);
    page.text((x + 0.4 * size, y), &text, size, colour(seen.id));
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::{BBox, Extent, State};

    /// A target of 20 px about (x, 20), turned by half a right angle.
    pub fn seen(id: u64, x: f64, phase: Phase) -> Seen {
        let bbox = BBox::around(x, 20.0, 20.0, 20.0);
        let state = State { angle: std::f64::consts::FRAC_PI_4, ..State::of(&bbox) };
        Seen {
            id,
            born: 0,
            phase,
            bbox,
            state,
            extent: Extent::of(&bbox),
            covariance: [[0.0; 6]; 6],
            gaze: Gaze::CENTRE,
            visible: 1.0,
            doubt: 0.0,
            detection: None,
            class: Some((7, 0.98)),
        }
    }

    pub fn frame(index: usize) -> Frame {
        Frame { index, time: index as f64 / 30.0, image: Image::grey(120, 60, 0) }
    }

    #[test]
    fn every_target_has_its_colour_and_its_turned_box() {
        let picture = CrowdAnnotator::default()
            .annotate(&frame(3), &[seen(1, 30.0, Phase::Followed), seen(2, 80.0, Phase::Lost)]);
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
        assert_eq!(name(&seen(2, 0.0, Phase::Born)), "no 2: 7 98 %");
        assert_ne!(colour(1), colour(2));
        assert_eq!(colour(0), colour(6));
    }

    #[test]
    fn whatever_a_state_is_it_is_drawn() {
        let mut drawn = CrowdAnnotator::default();
        for x in [f64::NAN, 1e300, -1e9, f64::INFINITY] {
            let mut odd = seen(u64::MAX, x, Phase::Lost);
            odd.state.log_scale = 300.0;
            drawn.annotate(&frame(0), &[odd]);
        }
    }
}
