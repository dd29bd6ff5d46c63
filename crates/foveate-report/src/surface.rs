//! Pictures of a gaze policy's learned rewards, over the template (the paper's figures of digits and of a face).
//!
//! [`row`] shows one run: the template with the best gaze's window, the mean reward with the fixations, its uncertainty, and the glimpse at
//! the best gaze. [`banner`] shows many runs: one column per target, with its reward surface and the best gaze of each run above, and the
//! mean glimpse at these gazes below. Gazes are in template units: half the target's box.

use crate::draw::{CORNERS, Colour, Drawing, Point, text_width};
use crate::heat::{Heat, ramp, span};
use crate::template::{Crop, FirstFrame};
use foveate_core::geometry::{BBox, Gaze};
use foveate_core::identity::Retina;
use foveate_core::scene::Image;

const PAPER: Colour = [255; 3];
const INK: Colour = [26, 30, 34];
const SOFT: Colour = [95, 104, 112];
const WHITE: Colour = [255; 3];
const BLACK: Colour = [0; 3];
const TARGET: Colour = [57, 182, 255];
const GAZE: Colour = [255, 182, 39];
/// Opacity of a surface over the template.
const COVER: f64 = 0.7;
/// Height of capitals, pixels.
const LETTER: f64 = 9.0;
/// Space around panels, pixels.
const PAD: f64 = 18.0;
/// The longer side of a panel, pixels.
const SIDE: f64 = 300.0;

/// One square of a picture: the template with its overlays.
#[derive(Clone, Debug)]
pub struct Panel<'a> {
    /// The text above it.
    pub title: String,
    /// The target in the first frame.
    pub template: &'a Crop,
    /// A map: its surface, its values (n², row by row: the mean or the sd), and their name.
    pub map: Option<(&'a Heat, &'a [f64], &'a str)>,
    /// Gazes with probabilities, 0 to 1, drawn as the areas of discs.
    pub arms: Vec<(Gaze, f64)>,
    /// Past gazes, drawn as small white dots.
    pub fixations: &'a [Gaze],
    /// The best gaze, or that of each run, drawn as white rings with a black edge.
    pub best: &'a [Gaze],
    /// Half the side of the window around the first best gaze, template units.
    pub window: Option<f64>,
}

impl<'a> Panel<'a> {
    /// Creates a panel with the template alone.
    pub fn of(title: &str, template: &'a Crop) -> Self {
        let (arms, fixations, best) = (vec![], &[][..], &[][..]);
        Self { title: title.into(), template, map: None, arms, fixations, best, window: None }
    }
    /// Returns width and height in pixels; the longer one is `side`.
    fn size(&self, side: f64) -> (f64, f64) {
        let [left, top, right, bottom] = self.template.bounds;
        let (w, h) = ((right - left) * self.template.aspect.clamp(0.45, 2.2), bottom - top);
        (side * w / w.max(h), side * h / w.max(h))
    }
    /// Draws the panel with its top-left corner at `corner`.
    fn draw(&self, page: &mut Drawing, (x0, y0): Point, side: f64) {
        let ((w, h), bounds) = (self.size(side), self.template.bounds);
        let unit = (w / (bounds[2] - bounds[0]), h / (bounds[3] - bounds[1]));
        let at = |u: f64, v: f64| (x0 + unit.0 * (u - bounds[0]), y0 + unit.1 * (v - bounds[1]));
        let place = |v: f64| v.round().max(0.0) as usize;
        page.paste(&self.template.image, place(x0), place(y0), place(w), place(h));
        if let Some((heat, values, _)) = self.map {
            let (low, high) = span(values);
            page.shade(x0, y0, w, h, |x, y| {
                let gaze = ((x - x0) / unit.0 + bounds[0], (y - y0) / unit.1 + bounds[1]);
                let value = heat.read(values, gaze.0, gaze.1)?;
                Some((ramp((value - low) / (high - low).max(f64::MIN_POSITIVE)), COVER))
            });
        }
        let square = |u: f64, v: f64, reach: f64| CORNERS.map(|(du, dv)| at(u + reach * du, v + reach * dv));
        page.outline(&square(0.0, 0.0, 1.0), 1.4, TARGET, 0.9);
        for (gaze, p) in &self.arms {
            let most = 0.13 * side;
            page.disc(at(gaze.u, gaze.v), (most * p.max(0.0).sqrt()).max(2.0) + 1.0, BLACK, 0.6);
            page.disc(at(gaze.u, gaze.v), (most * p.max(0.0).sqrt()).max(2.0), TARGET, 0.9);
        }
        for gaze in self.fixations {
            page.disc(at(gaze.u, gaze.v), 0.0085 * side + 1.0, BLACK, 0.55);
            page.disc(at(gaze.u, gaze.v), 0.0085 * side, WHITE, 1.0);
        }
        if let (Some(reach), Some(gaze)) = (self.window, self.best.first()) {
            page.outline(&square(gaze.u, gaze.v, reach), 4.0, BLACK, 0.5);
            page.outline(&square(gaze.u, gaze.v, reach), 2.2, GAZE, 1.0);
        }
        for gaze in self.best {
            let r = 0.026 * side;
            page.ring(at(gaze.u, gaze.v), r, 4.4, BLACK, 0.9);
            page.ring(at(gaze.u, gaze.v), r, 2.2, WHITE, 1.0);
        }
    }
    /// Draws the colour scale of the map, with the values at both ends.
    fn scale(&self, page: &mut Drawing, (x, y): Point, width: f64) {
        let Some((_, values, name)) = self.map else { return };
        let (low, high) = span(values);
        page.shade(x, y, width, 10.0, |at, _| Some((ramp((at - x) / width), 1.0)));
        let (low, high) = (format!("{low:.3}"), format!("{high:.3}"));
        let size = 0.9 * LETTER;
        page.text((x, y + 16.0), &low, size, INK);
        page.text((x + width - text_width(&high, size), y + 16.0), &high, size, INK);
        page.text((x + (width - text_width(name, size)) / 2.0, y + 16.0), name, size, SOFT);
    }
}

/// Draws panels side by side under a title, followed by a picture with its title, such as the glimpse at the best gaze.
pub fn row(title: &str, panels: &[Panel<'_>], last: Option<(&str, &Image)>) -> Drawing {
    let widths: Vec<f64> = panels.iter().map(|p| p.size(SIDE).0).collect();
    let tall = panels.iter().map(|p| p.size(SIDE).1).fold(SIDE * 0.8, f64::max);
    // The glimpse is as wide as the target.
    let wide = tall * panels.first().map_or(1.0, |p| p.template.aspect.clamp(0.45, 2.2));
    let extra = last.map_or(0.0, |_| wide + PAD);
    let width = widths.iter().map(|w| w + PAD).sum::<f64>() + PAD + extra;
    let top = 2.0 * PAD + 3.4 * LETTER;
    let mut page = Drawing::new(width.ceil() as usize, (top + tall + 2.6 * PAD).ceil() as usize, PAPER);
    page.text((PAD, PAD * 0.8), title, 1.15 * LETTER, INK);
    let mut x = PAD;
    for (panel, width) in panels.iter().zip(widths) {
        page.text((x, top - 1.9 * LETTER), &panel.title, LETTER, SOFT);
        panel.draw(&mut page, (x, top), SIDE);
        panel.scale(&mut page, (x, top + panel.size(SIDE).1 + 8.0), width);
        x += width + PAD;
    }
    if let Some((name, image)) = last {
        page.text((x, top - 1.9 * LETTER), name, LETTER, SOFT);
        page.paste(image, x.round() as usize, top.round() as usize, wide.round() as usize, tall.round() as usize);
    }
    page
}

/// A target of a [`banner`].
#[derive(Clone, Debug)]
pub struct Column<'a> {
    /// The upper square: template, mean reward surface of the runs, best gaze of each.
    pub panel: Panel<'a>,
    /// The lower square: the mean glimpse at the best gazes ([`mean_picture`]).
    pub view: Option<Image>,
}

/// Draws several targets in a row, each with a reward surface above and a glimpse below. Each map has its own colour scale.
pub fn banner(title: &str, columns: &[Column<'_>]) -> Drawing {
    const SMALL: f64 = 150.0;
    const GAP: f64 = 8.0;
    let tall = columns.iter().map(|c| c.panel.size(SMALL).1).fold(0.0, f64::max);
    let top = 2.0 * PAD + 3.4 * LETTER;
    let width = 2.0 * PAD + columns.len() as f64 * (SMALL + GAP) - GAP;
    let width = width.max(text_width(title, 1.15 * LETTER) + 2.0 * PAD);
    let mut page = Drawing::new(width.ceil() as usize, (top + tall + GAP + SMALL + PAD).ceil() as usize, PAPER);
    page.text((PAD, PAD * 0.8), title, 1.15 * LETTER, INK);
    for (i, column) in columns.iter().enumerate() {
        let x = PAD + i as f64 * (SMALL + GAP);
        page.text((x, top - 1.9 * LETTER), &column.panel.title, LETTER, SOFT);
        column.panel.draw(&mut page, (x, top), SMALL);
        if let Some(view) = &column.view {
            let side = SMALL.round() as usize;
            page.paste(view, x.round() as usize, (top + tall + GAP).round() as usize, side, side);
        }
    }
    page
}

/// Returns the glimpse of a target at a gaze, given a frame and its box, for the lower row of a [`banner`]. `None` if the gaze is more than
/// 1.5 template units from the centre, or the retina has no cell.
pub fn glimpse_picture(image: &Image, bbox: &BBox, retina: &dyn Retina, gaze: Gaze) -> Option<Image> {
    FirstFrame::new(image, bbox, retina).picture(retina, gaze)
}

/// Returns the mean of pictures of the same shape, pixel by pixel; `None` without one, or if the shapes differ.
pub fn mean_picture(all: &[Image]) -> Option<Image> {
    let first = all.first()?;
    if all.iter().any(|image| image.shape() != first.shape()) {
        return None;
    }
    let n = all.len() as f64;
    let sum = |i: usize| all.iter().map(|image| f64::from(image.bytes()[i])).sum::<f64>();
    let data = (0..first.bytes().len()).map(|i| (sum(i) / n).round() as u8).collect();
    Image::new(first.width(), first.height(), first.planes(), data).ok()
}

#[cfg(test)]
mod tests {
    use super::super::heat::tests::Hill;
    use super::*;

    fn crop() -> Crop {
        let ramp = (0..40 * 40).map(|i| (i % 40 * 6) as u8).collect();
        let image = Image::new(40, 40, 1, ramp).expect("40 x 40");
        Crop::around(&image, &BBox { x: 6.0, y: 6.0, w: 28.0, h: 28.0 })
    }

    #[test]
    fn the_best_gaze_lies_where_the_surface_is_brightest() {
        let (crop, heat) = (crop(), Heat::of(&Hill(vec![]), 21));
        let best = [heat.best().expect("a hill")];
        let plain = Panel { map: Some((&heat, &heat.mean, "reward")), ..Panel::of("t", &crop) };
        let page = row("title", std::slice::from_ref(&plain), None);
        let marked = row("title", &[Panel { best: &best, ..plain.clone() }], None);
        // The centre of the ring, where the pictures differ.
        let (w, h) = (page.width(), page.height());
        let differ: Vec<(usize, usize)> = (0..w * h)
            .map(|i| (i % w, i / w))
            .filter(|&(x, y)| page.image().at(0, x, y) != marked.image().at(0, x, y))
            .collect();
        let mean = |of: fn(&(usize, usize)) -> usize| differ.iter().map(of).sum::<usize>() as f64 / differ.len() as f64;
        let (cx, cy) = (mean(|p| p.0), mean(|p| p.1));
        let unit = SIDE / (crop.bounds[2] - crop.bounds[0]);
        let top = 2.0 * PAD + 3.4 * LETTER;
        assert!((cx - (PAD + unit * (best[0].u - crop.bounds[0]))).abs() < 1.0, "{cx}");
        assert!((cy - (top + unit * (best[0].v - crop.bounds[1]))).abs() < 1.0, "{cy}");
        // Reds grow with the ramp; below the ring the map is redder than at the far corner of the surface.
        let red = |u: f64, v: f64| {
            let x = (PAD + unit * (u - crop.bounds[0])).round() as usize;
            let y = (top + unit * (v - crop.bounds[1])).round() as usize;
            i32::from(page.image().at(0, x, y)) - i32::from(page.image().at(2, x, y))
        };
        assert!(red(0.4, -0.2) > red(-0.95, 0.9) + 40, "{} {}", red(0.4, -0.2), red(-0.95, 0.9));
    }

    #[test]
    fn banners_have_a_column_a_target() {
        let (crop, heat) = (crop(), Heat::of(&Hill(vec![]), 11));
        let best = [Gaze::CENTRE; 10];
        let panel = Panel { map: Some((&heat, &heat.mean, "")), best: &best, ..Panel::of("3", &crop) };
        let view = mean_picture(&[Image::grey(4, 4, 10), Image::grey(4, 4, 20)]);
        assert_eq!(view.as_ref().map(|v| v.at(0, 1, 1)), Some(15));
        let two = banner("t", &[Column { panel: panel.clone(), view: view.clone() }, Column { panel, view }]);
        assert_eq!(two.width(), (2.0 * PAD + 2.0 * 150.0 + 8.0) as usize);
        assert!(mean_picture(&[]).is_none() && mean_picture(&[Image::grey(1, 1, 0), Image::grey(2, 1, 0)]).is_none());
        assert!(banner("nothing", &[]).width() > 0);
    }
}
