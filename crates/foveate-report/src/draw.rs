//! Drawing on pictures: anti-aliased lines, boxes, discs, rings and text, by distance to the shape.
//!
//! Coverage of a pixel is ½ + r − d, held between 0 and 1, where d is the distance of its centre to the shape's
//! skeleton and r half the line's width. Coordinates are image coordinates; widths and radii are pixels.

use std::ops::Range;

use crate::font;
use foveate_core::scene::Image;

/// Red, green, blue.
pub type Colour = [u8; 3];
/// A point in pixels.
pub type Point = (f64, f64);

/// The corners of the unit square, in order along its outline.
pub const CORNERS: [Point; 4] = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];

/// A colour picture being drawn on.
#[derive(Clone, Debug)]
pub struct Drawing {
    image: Image,
}

impl Drawing {
    /// Creates a page of one colour. Panics if a side is 0.
    pub fn new(width: usize, height: usize, colour: Colour) -> Self {
        let mut bytes = Vec::with_capacity(3 * width * height);
        colour.into_iter().for_each(|value| bytes.resize(bytes.len() + width * height, value));
        Self { image: Image::new(width, height, 3, bytes).expect("three planes of a size that is not zero") }
    }

    /// Scales a picture to `width` × `height` pixels of the page, with its top-left corner at (`left`, `top`) and nearest-neighbour
    /// sampling. The part outside the page is cut off.
    pub fn paste(&mut self, image: &Image, left: usize, top: usize, width: usize, height: usize) {
        let page = (self.width(), self.height());
        let columns: Vec<usize> =
            (0..width.min(page.0.saturating_sub(left))).map(|x| x * image.width() / width).collect();
        for p in 0..3 {
            let from = image.plane(p.min(image.planes() - 1));
            let to = self.image.plane_mut(p);
            for y in 0..height.min(page.1.saturating_sub(top)) {
                let row = &from[y * image.height() / height * image.width()..][..image.width()];
                let line = &mut to[(top + y) * page.0..][..page.0];
                if width == image.width() {
                    line[left.min(page.0)..][..columns.len()].copy_from_slice(&row[..columns.len()]);
                    continue;
                }
                for (pixel, &x) in line.iter_mut().skip(left).zip(&columns) {
                    *pixel = row[x];
                }
            }
        }
    }

    /// Returns the width in pixels.
    pub fn width(&self) -> usize {
        self.image.width()
    }
    /// Returns the height in pixels.
    pub fn height(&self) -> usize {
        self.image.height()
    }
    /// Returns the picture.
    pub fn image(&self) -> &Image {
        &self.image
    }
    /// Returns the finished picture.
    pub fn into_image(self) -> Image {
        self.image
    }

    /// Returns the columns and rows that a box touches.
    fn pixels(&self, ((left, top), (right, bottom)): (Point, Point)) -> (Range<usize>, Range<usize>) {
        (touched(left, right, &(0..self.width())), touched(top, bottom, &(0..self.height())))
    }

    /// Blends a colour over the pixels of a box with the given `coverage` (0 to 1).
    fn cover(&mut self, bounds: (Point, Point), colour: Colour, coverage: impl Fn(usize, usize) -> f64) {
        let (columns, rows) = self.pixels(bounds);
        let mut alphas = vec![0; columns.len()];
        for y in rows {
            for (alpha, x) in alphas.iter_mut().zip(columns.clone()) {
                *alpha = fixed(coverage(x, y));
            }
            self.blend(columns.start, y, &alphas, colour);
        }
    }

    /// Blends a colour over the pixels from (`x`, `y`) to the right, of which each has its [`fixed`] alpha.
    fn blend(&mut self, x: usize, y: usize, alphas: &[i32], colour: Colour) {
        let at = y * self.width() + x;
        for (p, c) in colour.into_iter().enumerate() {
            for (pixel, alpha) in self.image.plane_mut(p)[at..][..alphas.len()].iter_mut().zip(alphas) {
                let step = alpha * (i32::from(c) - i32::from(*pixel));
                *pixel = (i32::from(*pixel) + ((step + OPAQUE / 2) >> 16)) as u8;
            }
        }
    }

    /// Fills a box, with edges at any position between pixels.
    pub fn fill(&mut self, left: f64, top: f64, width: f64, height: f64, colour: Colour, alpha: f64) {
        let (right, bottom) = (left + width, top + height);
        let share =
            |at: usize, from: f64, to: f64| (to.min(at as f64 + 0.5) - from.max(at as f64 - 0.5)).clamp(0.0, 1.0);
        let bounds = ((left - 1.0, top - 1.0), (right + 1.0, bottom + 1.0));
        let (columns, _) = self.pixels(bounds);
        let across: Vec<f64> = columns.clone().map(|x| share(x, left, right)).collect();
        self.cover(bounds, colour, |x, y| alpha * across[x - columns.start] * share(y, top, bottom));
    }

    /// Blends colours over the pixels whose centres lie in a box, each with its own colour and alpha (0 to 1); `None` leaves a pixel
    /// unchanged.
    pub fn shade(
        &mut self,
        left: f64,
        top: f64,
        width: f64,
        height: f64,
        colour: impl Fn(f64, f64) -> Option<(Colour, f64)>,
    ) {
        let (columns, rows) = self.pixels(((left, top), (left + width, top + height)));
        let inside = |at: f64, from: f64, long: f64| from <= at && at < from + long;
        for y in rows.filter(|&y| inside(y as f64, top, height)) {
            for x in columns.clone().filter(|&x| inside(x as f64, left, width)) {
                if let Some((colour, alpha)) = colour(x as f64, y as f64) {
                    self.blend(x, y, &[fixed(alpha)], colour);
                }
            }
        }
    }

    /// Draws a line through points, `thick` pixels wide with round ends; one point is a dot.
    ///
    /// Coverage is accumulated over all segments and blended once, so that corners are no darker than the rest.
    pub fn line(&mut self, points: &[Point], thick: f64, colour: Colour, alpha: f64) {
        let reach = thick / 2.0 + 0.5;
        let Some(whole) = bounds(points, reach) else { return };
        let (columns, rows) = self.pixels(whole);
        let (left, width) = (columns.start, columns.len());
        let mut coverage = vec![0.0f32; width * rows.len()];
        let segments = (0..points.len().max(2) - 1).map(|i| (points[i], points[(i + 1).min(points.len() - 1)]));
        for (from, to) in segments.clone() {
            for (y, columns) in near((&columns, &rows), from, to, reach) {
                let row = &mut coverage[(y - rows.start) * width..][columns.start - left..columns.end - left];
                for (x, covered) in columns.zip(row) {
                    let squared = to_segment((x as f64, y as f64), from, to);
                    if squared < reach * reach {
                        *covered = covered.max((reach - squared.sqrt()).min(1.0) as f32);
                    }
                }
            }
        }
        let mut alphas = Vec::with_capacity(width);
        for (from, to) in segments {
            for (y, columns) in near((&columns, &rows), from, to, reach) {
                let row = &mut coverage[(y - rows.start) * width..][columns.start - left..columns.end - left];
                alphas.clear();
                // What is drawn is taken away: segments that touch the same pixels find nothing left.
                alphas.extend(row.iter_mut().map(|covered| fixed(alpha * f64::from(std::mem::take(covered)))));
                self.blend(columns.start, y, &alphas, colour);
            }
        }
    }

    /// Draws a closed line.
    pub fn outline(&mut self, corners: &[Point], thick: f64, colour: Colour, alpha: f64) {
        let ring: Vec<Point> = corners.iter().chain(corners.first()).copied().collect();
        self.line(&ring, thick, colour, alpha);
    }

    /// Draws a filled disc.
    pub fn disc(&mut self, centre: Point, radius: f64, colour: Colour, alpha: f64) {
        self.line(&[centre], 2.0 * radius, colour, alpha);
    }

    /// Draws a circle.
    pub fn ring(&mut self, centre: Point, radius: f64, thick: f64, colour: Colour, alpha: f64) {
        let Some(whole) = bounds(&[centre], radius + thick + 1.0) else { return };
        self.cover(whole, colour, |x, y| {
            let (x, y) = (x as f64 - centre.0, y as f64 - centre.1);
            let off = (x * x + y * y).sqrt() - radius;
            alpha * (0.5 + thick / 2.0 - off.abs()).clamp(0.0, 1.0)
        });
    }

    /// Writes a line of text with capitals `size` pixels high, their top-left corner at `at`. Returns its width.
    pub fn text(&mut self, at: Point, text: &str, size: f64, colour: Colour) -> f64 {
        let unit = size / font::CAPITAL;
        let mut pen = at.0;
        for letter in text.chars() {
            let (strokes, advance) = font::glyph(letter);
            for stroke in strokes {
                let points: Vec<Point> = stroke.iter().map(|p| (pen + unit * p.0, at.1 + unit * p.1)).collect();
                self.line(&points, (0.15 * size).max(1.1), colour, 1.0);
            }
            pen += unit * advance;
        }
        pen - at.0
    }
}

/// Returns the width of a line of text with capitals `size` pixels high.
pub fn text_width(text: &str, size: f64) -> f64 {
    text.chars().map(|letter| font::glyph(letter).1).sum::<f64>() * size / font::CAPITAL
}

fn bounds(points: &[Point], margin: f64) -> Option<(Point, Point)> {
    let first = *points.first()?;
    let (low, high) = points
        .iter()
        .fold((first, first), |(low, high), p| ((low.0.min(p.0), low.1.min(p.1)), (high.0.max(p.0), high.1.max(p.1))));
    Some(((low.0 - margin, low.1 - margin), (high.0 + margin, high.1 + margin)))
}

/// Returns those of the given pixels that an interval touches. Casts from f64 saturate: coordinates may have any value, or be NaN.
fn touched(from: f64, to: f64, pixels: &Range<usize>) -> Range<usize> {
    let end = ((to.ceil() + 1.0).max(0.0) as usize).clamp(pixels.start, pixels.end);
    (from.floor().max(0.0) as usize).clamp(pixels.start, end)..end
}

/// Returns the rows, and the columns in each, that may lie within `reach` of a segment.
fn near(
    (columns, rows): (&Range<usize>, &Range<usize>),
    a: Point,
    b: Point,
    reach: f64,
) -> impl Iterator<Item = (usize, Range<usize>)> {
    touched(a.1.min(b.1) - reach, a.1.max(b.1) + reach, rows).map(move |y| {
        // The points of the segment that are no further above or below.
        let at = |y: f64| a.0 + ((y - a.1) / (b.1 - a.1)).clamp(0.0, 1.0) * (b.0 - a.0);
        let (from, to) = match a.1 == b.1 {
            true => (a.0, b.0),
            false => (at(y as f64 - reach), at(y as f64 + reach)),
        };
        (y, touched(from.min(to) - reach, from.max(to) + reach, columns))
    })
}

/// Returns the squared distance of a point to a segment.
fn to_segment(p: Point, a: Point, b: Point) -> f64 {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let length = dx * dx + dy * dy;
    let t = if length > 0.0 { ((p.0 - a.0) * dx + (p.1 - a.1) * dy) / length } else { 0.0 };
    let t = t.clamp(0.0, 1.0);
    let (x, y) = (a.0 + t * dx - p.0, a.1 + t * dy - p.1);
    x * x + y * y
}

/// The [`fixed`] alpha that covers a pixel.
const OPAQUE: i32 = 1 << 16;

/// Returns an alpha in whole numbers.
fn fixed(alpha: f64) -> i32 {
    (f64::from(OPAQUE) * alpha.clamp(0.0, 1.0) + 0.5) as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the amount of white drawn on a black page, in pixels.
    fn ink(draw: impl Fn(&mut Drawing)) -> f64 {
        let mut page = Drawing::new(64, 48, [0; 3]);
        draw(&mut page);
        page.image().plane(1).iter().map(|&v| f64::from(v) / 255.0).sum()
    }

    #[test]
    fn shapes_have_the_area_of_geometry() {
        let white = [255; 3];
        // Sub-pixel positions; areas in closed form, to 1.5 % (8-bit rounding and the linear edge).
        let near = |got: f64, want: f64| assert!((got / want - 1.0).abs() < 0.015, "{got} should be {want}");
        near(ink(|d| d.fill(3.25, 7.5, 20.5, 10.25, white, 1.0)), 20.5 * 10.25);
        near(ink(|d| d.disc((30.3, 20.7), 9.0, white, 1.0)), std::f64::consts::PI * 81.0);
        near(ink(|d| d.ring((30.3, 20.7), 12.0, 3.0, white, 1.0)), std::f64::consts::TAU * 12.0 * 3.0);
        near(ink(|d| d.line(&[(10.0, 10.0), (50.0, 40.0)], 4.0, white, 1.0)), 50.0 * 4.0 + std::f64::consts::PI * 4.0);
        near(ink(|d| d.fill(3.0, 7.0, 20.0, 10.0, white, 0.5)), 100.0);
    }

    /// 200 polygons, seed 3, of which some reach beyond the page.
    #[test]
    fn lines_cover_pixels_by_their_distance() {
        let mut x = 3u32;
        let mut next = |n: f64| {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(x >> 8) / f64::from(1 << 24) * n
        };
        for n in 0..200 {
            let points: Vec<Point> = (0..1 + n % 4).map(|_| (next(50.0) - 5.0, next(36.0) - 5.0)).collect();
            let thick = 0.5 + next(6.0);
            let mut page = Drawing::new(40, 26, [0; 3]);
            page.line(&points, thick, [255; 3], 1.0);
            let last = points.len() - 1;
            for (at, value) in page.image().plane(0).iter().enumerate() {
                let pixel = ((at % 40) as f64, (at / 40) as f64);
                let segments = (0..last.max(1)).map(|i| to_segment(pixel, points[i], points[(i + 1).min(last)]));
                let distance = segments.fold(f64::INFINITY, f64::min).sqrt();
                let want = 255.0 * (0.5 + thick / 2.0 - distance).clamp(0.0, 1.0);
                assert!((f64::from(*value) - want).abs() < 0.51, "{points:?} {thick} {pixel:?}: {value} for {want}");
            }
        }
    }

    #[test]
    fn anything_may_lie_outside_or_nowhere() {
        let white = [255; 3];
        for far in [-1e9, 1e9, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut page = Drawing::new(8, 8, [0; 3]);
            page.disc((far, far), 2.0, white, 1.0);
            page.ring((far, 3.0), 2.0, 1.0, white, 1.0);
            page.outline(&[(far, 2.0), (3.0, far), (far, far)], 1.0, white, 1.0);
            page.fill(far, far, 5.0, 5.0, white, 1.0);
            page.text((far, 2.0), "a!", 5.0, white);
            page.line(&[], 1.0, white, 1.0);
        }
        assert!(ink(|d| d.disc((-1.0, 20.0), 3.0, white, 1.0)) > 5.0, "the part inside is drawn");
    }

    #[test]
    fn shades_stay_in_their_box() {
        let mut page = Drawing::new(6, 5, [100; 3]);
        page.shade(1.0, 2.0, 3.0, 2.0, |x, y| (x != y).then_some(([200, 0, 100], 0.5)));
        for (i, value) in page.image().plane(0).iter().enumerate() {
            let (x, y) = (i % 6, i / 6);
            let inside = (1..4).contains(&x) && (2..4).contains(&y) && x != y;
            assert_eq!(*value, if inside { 150 } else { 100 }, "{x} {y}");
        }
        assert_eq!((page.image().at(1, 1, 2), page.image().at(2, 1, 2)), (50, 100));
    }

    #[test]
    fn text_is_as_wide_as_computed() {
        let mut page = Drawing::new(200, 20, [0; 3]);
        let width = page.text((2.0, 4.0), "frame 123", 10.0, [255; 3]);
        assert_eq!(width, text_width("frame 123", 10.0));
        let last = (0..200).rev().find(|&x| (0..20).any(|y| page.image().at(0, x, y) > 128)).expect("there is ink");
        assert!((last as f64) < 2.0 + width && (last as f64) > width - 8.0, "{last} {width}");
        assert_eq!(text_width("111", 10.0), text_width("888", 10.0), "digits are equally wide");
    }

    #[test]
    fn pasting_repeats_pixels_and_cuts() {
        let mut page = Drawing::new(5, 4, [9; 3]);
        page.paste(&Image::new(2, 2, 1, vec![1, 2, 3, 4]).expect("2 x 2"), 1, 1, 4, 4);
        page.paste(&Image::grey(1, 1, 0), 7, 7, 3, 3);
        assert_eq!(page.image().plane(2), [9, 9, 9, 9, 9, 9, 1, 1, 2, 2, 9, 1, 1, 2, 2, 9, 3, 3, 4, 4]);
    }
}
