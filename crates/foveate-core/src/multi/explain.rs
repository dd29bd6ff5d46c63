//! Explaining away: the evidence of one target is not evidence of another.
//!
//! Each target is scored on the picture from which the first-frame templates of the others, at their predicted places, are subtracted. A
//! small target then cannot settle on the strokes of a large one, which would fit it nearly as well as itself. Use it for bright objects
//! on a dark background that occlude each other little; a lost target is not subtracted.

use crate::geometry::{BBox, Extent, State};
use crate::identity::TemplateSource;
use crate::scene::Image;

/// Subtracts from `image` the share (0 to 1) of the values that a target at `state` contributes there.
pub(super) fn take_off(image: &mut Image, look: TemplateSource<'_>, state: &State, share: f64) {
    if look.image.planes() != image.planes() {
        return;
    }
    let (Extent { half_w, half_h }, (left, top)) = (look.extent, look.origin);
    let shape = state.shaped(look.extent);
    let narrower = (half_w / shape.half_w, half_h / shape.half_h);
    let unit = state.log_scale.exp();
    let (sin, cos) = state.angle.sin_cos();
    let (w, h) = state.half(look.extent);
    let reach = w.hypot(h);
    let BBox { x, y, .. } = BBox::around(state.x, state.y, 2.0 * reach, 2.0 * reach);
    let end = |v: f64, side: usize| v.clamp(0.0, side as f64) as usize;
    let width = image.width();
    let (columns, rows) =
        (end(x, width)..end(x + 2.0 * reach, width), end(y, image.height())..end(y + 2.0 * reach, image.height()));
    for p in 0..image.planes() {
        let plane = image.plane_mut(p);
        for (row, column) in rows.clone().flat_map(|row| columns.clone().map(move |column| (row, column))) {
            let (dx, dy) = ((column as f64 - state.x) / unit, (row as f64 - state.y) / unit);
            let (u, v) = (narrower.0 * (cos * dx + sin * dy), narrower.1 * (cos * dy - sin * dx));
            if u.abs() <= half_w && v.abs() <= half_h {
                let (x, y) = (look.state.x + u - left as f64, look.state.y + v - top as f64);
                let shown = share * value(look.image, p, x, y);
                let pixel = &mut plane[row * width + column];
                *pixel = (f64::from(*pixel) - shown).max(0.0) as u8;
            }
        }
    }
}

/// The value between pixels, by interpolation; black outside.
fn value(image: &Image, p: usize, x: f64, y: f64) -> f64 {
    let (i, j) = (x.floor(), y.floor());
    let at = |i: f64, j: f64| {
        let inside = i >= 0.0 && j >= 0.0 && i < image.width() as f64 && j < image.height() as f64;
        if inside { f64::from(image.at(p, i as usize, j as usize)) } else { 0.0 }
    };
    let row = |j: f64| (1.0 - (x - i)) * at(i, j) + (x - i) * at(i + 1.0, j);
    (1.0 - (y - j)) * row(j) + (y - j) * row(j + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_template_is_subtracted_at_its_place() {
        // A square of 4 px in the first frame; later twice as large, elsewhere, on a stripe that is not part of it.
        let paint = |side: usize, at: std::ops::Range<usize>, stripe: bool| {
            let white = |k: usize| at.contains(&(k % side)) && at.contains(&(k / side)) || stripe && k / side == 35;
            Image::new(side, side, 1, (0..side * side).map(|k| if white(k) { 200 } else { 0 }).collect())
                .expect("whole")
        };
        let first = paint(30, 8..12, false);
        let (was, extent) = (State { x: 9.5, y: 9.5, ..State::default() }, Extent { half_w: 4.0, half_h: 4.0 });
        let look = TemplateSource { image: &first, origin: (0, 0), state: &was, extent };
        let now = State { x: 23.5, y: 23.5, log_scale: 2f64.ln(), ..State::default() };
        let mut image = paint(50, 20..28, true);
        take_off(&mut image, look, &now, 1.0);
        let left = |rows: std::ops::Range<usize>| {
            rows.flat_map(|y| (0..50).map(move |x| (x, y))).map(|(x, y)| f64::from(image.at(0, x, y))).sum::<f64>()
        };
        assert!(left(0..35) < 0.15 * 64.0 * 200.0, "{}", left(0..35));
        assert_eq!(left(35..36), 50.0 * 200.0);
        // Of a white picture, a box of 8 x 2 px that is turned by a quarter takes 2 x 8 px.
        let (template, mut white) = (Image::grey(30, 30, 200), Image::grey(30, 30, 200));
        let extent = Extent { half_w: 4.0, half_h: 1.0 };
        let turned = State { angle: std::f64::consts::FRAC_PI_2, ..was };
        take_off(&mut white, TemplateSource { image: &template, extent, ..look }, &turned, 1.0);
        for (k, left) in white.plane(0).iter().enumerate() {
            let taken = (9..11).contains(&(k % 30)) && (6..14).contains(&(k / 30));
            assert!(if taken { *left == 0 } else { *left == 200 }, "{left} at {}, {}", k % 30, k / 30);
        }
        let mut half = paint(50, 20..28, true);
        take_off(&mut half, look, &now, 0.5);
        assert_eq!(half.at(0, 23, 23), 100);
    }
}
