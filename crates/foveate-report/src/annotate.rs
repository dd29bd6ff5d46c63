//! Draws the tracker's state on a frame, for the video and for stills.
//!
//! Left: the frame, magnified if small, with box, true box if known, path, particles coloured by weight, a cross at the gaze and the
//! windows of the retina. Right: the glimpse, the gaze policy, and three gauges.

use std::collections::VecDeque;

use crate::RunInfo;
use crate::draw::{CORNERS, Colour, Drawing, Point, text_width};
use crate::eye::{Eye, windows};
use crate::heat::{Heat, ramp, span};
use foveate_core::Seen;
use foveate_core::control::Status;
use foveate_core::gaze::PolicySnapshot;
use foveate_core::geometry::{BBox, Extent, Fixation, Gaze, State};
use foveate_core::scene::Image;
use foveate_video::Frame;

/// Height to which small frames are magnified, pixels.
const TALL: usize = 480;
/// Maximum width of a magnified frame, pixels.
const WIDE: usize = 1280;
/// Points along a side of a sampled reward surface.
const POINTS: usize = 9;
/// Number of frames in the path, and of fixations on a reward surface.
const PATH: usize = 60;

const GROUND: Colour = [18, 21, 26];
const SUNKEN: Colour = [36, 41, 48];
const INK: Colour = [236, 238, 240];
const SOFT: Colour = [150, 159, 168];
const TARGET: Colour = [57, 182, 255];
const GAZE: Colour = [255, 182, 39];
const TRUTH: Colour = [63, 209, 155];
const LOST: Colour = [255, 122, 56];
const BLACK: Colour = [0, 0, 0];

/// The target's places in the most recent frames.
#[derive(Clone, Debug, Default)]
pub(super) struct Path(VecDeque<Point>);

impl Path {
    pub(crate) fn clear(&mut self) {
        self.0.clear();
    }
    pub(crate) fn push(&mut self, state: &State) {
        self.0.push_back((state.x, state.y));
        if self.0.len() > PATH {
            self.0.pop_front();
        }
    }
    /// Draws the path; older parts are fainter.
    pub(crate) fn draw(&self, page: &mut Drawing, view: View, thick: f64, colour: Colour, alpha: f64) {
        for (i, (a, b)) in self.0.iter().zip(self.0.iter().skip(1)).enumerate() {
            let fresh = (i + 1) as f64 / self.0.len() as f64;
            page.line(&[view.at(*a), view.at(*b)], thick * view.bold, colour, alpha * fresh);
        }
    }
}

/// Draws the frames of a run with one target, in order.
#[derive(Debug)]
pub struct Annotator {
    eye: Option<Eye>,
    /// Half the sides of the retina's windows, in template units, innermost first.
    windows: Vec<f64>,
    path: Path,
    truth: Vec<Option<BBox>>,
    /// Whether glimpse, policy and gauges are drawn beside the frame.
    has_panel: bool,
    /// The maximum of the current frame's reward surface.
    best: Option<Gaze>,
}

/// The frame's position on the page: `zoom` page pixels for each of its own.
#[derive(Clone, Copy)]
pub(super) struct View {
    zoom: f64,
    /// Width of lines relative to a page of 480 rows.
    pub bold: f64,
}

impl View {
    pub(crate) fn at(self, (x, y): Point) -> Point {
        // The centre of an image pixel is the centre of its block of page pixels.
        (self.zoom * (x + 0.5) - 0.5, self.zoom * (y + 0.5) - 0.5)
    }
}

impl Annotator {
    /// Creates an annotator for a run. Without a retina in `info`, its windows and the glimpse are left out.
    pub fn new(info: &RunInfo) -> Self {
        let retina = info.retina.as_deref();
        Self {
            eye: retina.and_then(Eye::new),
            windows: retina.map(windows).unwrap_or_default(),
            path: Path::default(),
            truth: info.truth.clone(),
            has_panel: true,
            best: None,
        }
    }

    /// Creates an annotator of the frame alone, without glimpse, policy and gauges.
    pub(super) fn frame_alone(info: &RunInfo) -> Self {
        Self { has_panel: false, ..Self::new(info) }
    }

    /// Draws a frame with its target. Width and height are even, at least 2 pixels, and the same for all frames.
    pub fn annotate(&mut self, frame: &Frame, seen: &Seen<'_>) -> Image {
        if seen.is_given() {
            self.path.clear();
        }
        self.path.push(&seen.state);
        if seen.is_given() {
            let (mut page, view, panel) = self.page(frame);
            outline(&mut page, view, &seen.state, seen.extent, Gaze::CENTRE, 1.0, 2.0, TARGET);
            banner(&mut page, view, frame, "box given", [0, 95, 155]);
            self.side(&mut page, panel, frame, None);
            return page.into_image();
        }
        self.best = if let PolicySnapshot::Surface(surface) = seen.snapshot { surface.best() } else { None };
        let (mut page, view, panel) = self.page(frame);
        for b in seen.detections.iter().map(|d| d.bbox) {
            let corners =
                [(b.x, b.y), (b.x + b.w - 1.0, b.y), (b.x + b.w - 1.0, b.y + b.h - 1.0), (b.x, b.y + b.h - 1.0)];
            page.outline(&corners.map(|corner| view.at(corner)), view.bold, SOFT, 0.9);
        }
        self.particles(&mut page, view, seen);
        self.path.draw(&mut page, view, 1.6, TARGET, 0.85);
        if let Some(Some(b)) = self.truth.get(frame.index) {
            dashed(&mut page, view, b);
        }
        let colour = if seen.is_usable() { TARGET } else { LOST };
        outline(&mut page, view, &seen.state, seen.extent, Gaze::CENTRE, 1.0, 2.0, colour);
        self.fixation(&mut page, view, seen);
        label(&mut page, view, seen);
        credible(&mut page, view, seen);
        match seen.status {
            Status::Tracking => (),
            status @ Status::Reacquired => banner(&mut page, view, frame, status.name(), [0, 110, 75]),
            status => banner(&mut page, view, frame, status.name(), [190, 74, 0]),
        }
        // The panel covers marks of the frame that extend into it.
        self.side(&mut page, panel, frame, Some(seen));
        page.into_image()
    }

    /// Returns the page with the frame on it, and the left edge of the panel.
    fn page(&self, frame: &Frame) -> (Drawing, View, usize) {
        let (width, height, view) = magnification(&frame.image);
        let panel = if self.has_panel { (height * 3 / 8).clamp(150, 480) } else { 0 };
        let mut page = Drawing::new(even(width + panel), even(height), GROUND);
        page.paste(&frame.image, 0, 0, width, height);
        (page, view, width)
    }

    fn particles(&self, page: &mut Drawing, view: View, seen: &Seen<'_>) {
        let most = seen.weights.iter().copied().fold(0.0, f64::max);
        let mut order: Vec<usize> = (0..seen.weights.len()).collect();
        order.sort_by(|a, b| seen.weights[*a].total_cmp(&seen.weights[*b]));
        for i in order {
            let share = (seen.weights[i] / most).sqrt();
            let at = view.at((seen.particles[i].x, seen.particles[i].y));
            page.disc(at, view.bold * (1.3 + 0.9 * share), tint(share), 0.4 + 0.5 * share);
        }
    }

    fn fixation(&self, page: &mut Drawing, view: View, seen: &Seen<'_>) {
        let chosen = seen.plan.chosen_index();
        if let Some(best) = self.best {
            let at = seen.state.fixate(best, seen.extent);
            page.ring(view.at((at.x, at.y)), 6.0 * view.bold, 4.2 * view.bold, BLACK, 0.6);
            page.ring(view.at((at.x, at.y)), 6.0 * view.bold, 2.0 * view.bold, INK, 1.0);
        }
        for (k, gaze) in seen.plan.used() {
            let at = seen.state.fixate(gaze, seen.extent);
            if k == chosen {
                for (i, reach) in self.windows.iter().enumerate().rev() {
                    let thick = if i == 0 { 1.6 } else { 0.8 };
                    outline(page, view, &seen.state, seen.extent, gaze, *reach, thick, GAZE);
                }
            }
            let (arm, colour) = if k == chosen { (7.0, INK) } else { (4.0, GAZE) };
            cross(page, view, (at.x, at.y), arm, 1.8, colour);
        }
    }

    fn side(&self, page: &mut Drawing, left: usize, frame: &Frame, seen: Option<&Seen<'_>>) {
        if !self.has_panel {
            return;
        }
        let (width, height) = (page.width() - left, page.height() as f64);
        let unit = height / TALL as f64;
        let (pad, size) = (14.0 * unit, (9.0 * unit).max(6.0));
        let (x, inner) = (left as f64 + pad, width as f64 - 2.0 * pad);
        page.fill(left as f64 - 0.5, -0.5, width as f64, height, GROUND, 1.0);
        let mut y = pad;
        page.text((x, y), &format!("frame {}", frame.index + 1), 1.35 * size, INK);
        let time = format!("{:.2} s", frame.time);
        page.text((x + inner - text_width(&time, size), y + 0.3 * size), &time, size, SOFT);
        y += 1.35 * size + 1.3 * pad;

        // Two squares and three gauges share the remaining height.
        let gauges = 3.0 * 2.7 * size;
        let square = inner.min((height - y - gauges - 0.6 * pad) / 2.0 - 2.0 * size - 0.8 * pad).max(8.0);
        page.text((x, y), "glimpse", size, SOFT);
        y += 1.9 * size;
        page.fill(x - 0.5, y - 0.5, square, square, SUNKEN, 1.0);
        if let (Some(eye), Some(seen)) = (&self.eye, seen) {
            let side = square.round() as usize;
            page.paste(&eye.picture(&seen.percept.glimpse), x.round() as usize, y.round() as usize, side, side);
        }
        y += square + 0.8 * pad;
        page.text((x, y), "gaze", size, SOFT);
        y += 1.9 * size;
        page.fill(x - 0.5, y - 0.5, square, square, SUNKEN, 1.0);
        if let Some(seen) = seen {
            policy(page, (x, y), square, seen, self.best, unit);
        }
        y += square + 0.9 * pad;
        let Some(seen) = seen else { return };
        let n = seen.weights.len() as f64;
        let reward = seen.rewards[seen.plan.chosen_index()];
        for (name, value, share, colour) in [
            ("reward", format!("{reward:.2}"), reward, GAZE),
            ("ESS", format!("{:.0} of {n}", seen.ess), seen.ess / n, TARGET),
            ("P(lost)", format!("{:.2}", seen.p_lost), seen.p_lost, LOST),
        ] {
            page.text((x, y), name, size, SOFT);
            page.text((x + inner - text_width(&value, size), y), &value, size, INK);
            y += 1.45 * size;
            let bar = 0.4 * size;
            page.fill(x, y, inner, bar, SUNKEN, 1.0);
            page.fill(x, y, inner * share.clamp(0.0, 1.0), bar, colour, 1.0);
            y += 1.25 * size;
        }
    }
}

/// Rounds to an even number, as H.264 requires.
fn even(n: usize) -> usize {
    n + n % 2
}

/// Returns width and height of a picture on the page, and its view.
fn magnification(image: &Image) -> (usize, usize, View) {
    let (w, h) = (image.width(), image.height());
    let zoom = ((TALL + h / 2) / h).min(WIDE / w).max(1);
    let (width, height) = (w * zoom, h * zoom);
    (width, height, View { zoom: zoom as f64, bold: (height as f64 / TALL as f64).clamp(0.8, 3.0) })
}

/// Returns a page with a picture, magnified if small, and nothing else.
pub(super) fn magnified(image: &Image) -> (Drawing, View) {
    let (width, height, view) = magnification(image);
    let mut page = Drawing::new(even(width), even(height), GROUND);
    page.paste(image, 0, 0, width, height);
    (page, view)
}

/// Draws the policy over the template's box, on a square of the page.
fn policy(page: &mut Drawing, (x, y): Point, side: f64, seen: &Seen<'_>, best: Option<Gaze>, unit: f64) {
    const REACH: f64 = 1.25;
    let at = |u: f64, v: f64| (x + side * (u / REACH + 1.0) / 2.0, y + side * (v / REACH + 1.0) / 2.0);
    let corners = CORNERS.map(|(u, v)| at(u, v));
    page.outline(&corners, 1.4 * unit, TARGET, 0.9);
    match seen.snapshot {
        PolicySnapshot::Blank => (),
        PolicySnapshot::Arms { gazes, probabilities } => {
            let full = side * 0.17;
            for (gaze, p) in gazes.iter().zip(probabilities) {
                page.disc(at(gaze.u, gaze.v), (full * p.sqrt()).max(1.6 * unit), TARGET, 0.75);
            }
        }
        PolicySnapshot::Surface(surface) => {
            let heat = Heat::of(surface, POINTS);
            let (low, high) = span(&heat.mean);
            page.shade(x, y, side, side, |px, py| {
                let gaze = |p: f64, from: f64| REACH * (2.0 * (p - from) / side - 1.0);
                let value = heat.read(&heat.mean, gaze(px, x), gaze(py, y))?;
                Some((ramp((value - low) / (high - low).max(f64::MIN_POSITIVE)), 0.85))
            });
            let all = surface.fixations();
            for gaze in &all[all.len().saturating_sub(PATH)..] {
                page.disc(at(gaze.u, gaze.v), 1.5 * unit, INK, 0.9);
            }
            if let Some(best) = best {
                page.ring(at(best.u, best.v), 4.5 * unit, 3.6 * unit, BLACK, 0.8);
                page.ring(at(best.u, best.v), 4.5 * unit, 1.8 * unit, INK, 1.0);
            }
        }
    }
    let gaze = seen.plan.chosen();
    let (cx, cy) = at(gaze.u, gaze.v);
    page.ring((cx, cy), 7.0 * unit, 1.8 * unit, GAZE, 1.0);
    page.disc((cx, cy), 1.8 * unit, INK, 1.0);
}

/// Draws a square of the template, `reach` around a gaze, on the frame.
#[expect(clippy::too_many_arguments, reason = "a shape, a place and a pen")]
pub(super) fn outline(
    page: &mut Drawing,
    view: View,
    state: &State,
    extent: Extent,
    gaze: Gaze,
    reach: f64,
    thick: f64,
    colour: Colour,
) {
    framed(page, view, &state.fixate(gaze, extent), reach, thick, colour);
}

/// Where (u, v) of a fixation falls on the frame.
pub(crate) fn place(f: &Fixation, u: f64, v: f64) -> Point {
    (f.x + u * f.ux + v * f.vx, f.y + u * f.uy + v * f.vy)
}

/// Draws `reach` times the square of a fixation.
pub(super) fn framed(page: &mut Drawing, view: View, f: &Fixation, reach: f64, thick: f64, colour: Colour) {
    let corners = CORNERS.map(|(u, v)| view.at(place(f, reach * u, reach * v)));
    page.outline(&corners, (thick + 1.8) * view.bold, BLACK, 0.4);
    page.outline(&corners, thick * view.bold, colour, 1.0);
}

/// Draws a cross at a place of the frame.
pub(super) fn cross(page: &mut Drawing, view: View, at: Point, arm: f64, thick: f64, colour: Colour) {
    let ((x, y), arm) = (view.at(at), arm * view.bold);
    for (thick, colour, alpha) in [(thick + 1.8, BLACK, 0.5), (thick, colour, 1.0)] {
        page.line(&[(x - arm, y), (x + arm, y)], thick * view.bold, colour, alpha);
        page.line(&[(x, y - arm), (x, y + arm)], thick * view.bold, colour, alpha);
    }
}

/// Draws the true box with dashes.
fn dashed(page: &mut Drawing, view: View, b: &BBox) {
    let (state, extent, dash) = (State::of(b), Extent::of(b), 5.0 * view.bold);
    let corners = CORNERS.map(|(u, v)| view.at((state.x + u * extent.half_w, state.y + v * extent.half_h)));
    for (from, to) in corners.iter().zip(corners.iter().cycle().skip(1)) {
        let length = (to.0 - from.0).hypot(to.1 - from.1);
        // A box is normally a few pictures wide; in any case a side has at most 1000 dashes.
        let dashes = ((length / dash) as usize).clamp(1, 1000) | 1;
        let at = |i: usize| {
            let t = i as f64 / dashes as f64;
            (from.0 + t * (to.0 - from.0), from.1 + t * (to.1 - from.1))
        };
        for i in (0..dashes).step_by(2) {
            page.line(&[at(i), at(i + 1)], 3.2 * view.bold, BLACK, 0.4);
            page.line(&[at(i), at(i + 1)], 1.6 * view.bold, TRUTH, 1.0);
        }
    }
}

/// Draws the 90 % credible region of the centre.
fn credible(page: &mut Drawing, view: View, seen: &Seen<'_>) {
    const POINTS: usize = 48;
    let (r, (sin, cos)) = (seen.region(0.9), seen.region(0.9).turn.sin_cos());
    let at = |i: usize| {
        let (s, c) = (std::f64::consts::TAU * i as f64 / POINTS as f64).sin_cos();
        let (u, v) = (r.half[0] * c, r.half[1] * s);
        view.at((r.x + cos * u - sin * v, r.y + sin * u + cos * v))
    };
    let points: [Point; POINTS] = std::array::from_fn(at);
    page.outline(&points, 2.6 * view.bold, BLACK, 0.4);
    page.outline(&points, 1.2 * view.bold, INK, 0.9);
}

/// Writes the class of the target above its box, or below if there is no room.
fn label(page: &mut Drawing, view: View, seen: &Seen<'_>) {
    let Some((class, p)) = seen.class else { return };
    let (text, size, b) = (format!("{}  {:.0} %", seen.class_name(class), 100.0 * p), 9.0 * view.bold, seen.bbox);
    let (x, top) = view.at((b.x, b.y));
    let y = if top >= 2.4 * size { top - 2.2 * size } else { view.at((b.x, b.y + b.h)).1 + 0.8 * size };
    page.fill(x - 0.4 * size, y - 0.4 * size, text_width(&text, size) + 0.8 * size, 1.8 * size, BLACK, 0.55);
    page.text((x, y), &text, size, INK);
}

fn banner(page: &mut Drawing, view: View, frame: &Frame, text: &str, ground: Colour) {
    let size = 11.0 * view.bold;
    let (middle, y) = (view.zoom * frame.image.width() as f64 / 2.0, 2.1 * size);
    let half = text_width(text, size) / 2.0;
    page.line(&[(middle - half, y), (middle + half - 0.3 * size, y)], 2.4 * size, ground, 0.92);
    page.text((middle - half, y - size / 2.0), text, size, [255; 3]);
}

/// Returns the colour of a particle: the ramp without its darkest third.
fn tint(share: f64) -> Colour {
    ramp((1.0 + 2.0 * share.clamp(0.0, 1.0)) / 3.0)
}
