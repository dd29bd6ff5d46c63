//! A picture within the input of a network: scaled in proportion, in the middle, grey around it.

use crate::geometry::{BBox, Size};
use crate::scene::Image;

/// The grey around the picture, as detectors are trained with it.
const AROUND: f32 = 114.0 / 255.0;

/// The position of a picture in a network's input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Letterbox {
    picture: Size,
    /// Left, top, width and height of the scaled picture.
    place: [usize; 4],
}

impl Letterbox {
    /// For a picture and an input of these widths and heights.
    pub(super) fn new(picture: Size, input: Size) -> Self {
        let scale = (input.width as f64 / picture.width as f64).min(input.height as f64 / picture.height as f64);
        let side = |of: usize, most: usize| ((of as f64 * scale).round() as usize).clamp(1, most);
        let (width, height) = (side(picture.width, input.width), side(picture.height, input.height));
        Self { picture, place: [(input.width - width) / 2, (input.height - height) / 2, width, height] }
    }

    /// Writes the planes of an input of this width, 0 to 1; red, green and blue, or grey.
    pub(super) fn fill(&self, image: &Image, width: usize, planes: &mut [&mut [f32]]) {
        let [left, top, columns, rows] = self.place;
        let taps = |n: usize, of: usize| -> Vec<(usize, usize, f32)> {
            let scale = of as f64 / n as f64;
            let tap = |i: usize| {
                let at = ((i as f64 + 0.5) * scale - 0.5).clamp(0.0, (of - 1) as f64);
                (at as usize, (at as usize + 1).min(of - 1), at.fract() as f32)
            };
            (0..n).map(tap).collect()
        };
        let (across, down) = (taps(columns, self.picture.width), taps(rows, self.picture.height));
        for (p, plane) in planes.iter_mut().enumerate() {
            plane.fill(AROUND);
            let bytes = image.plane(p.min(image.planes() - 1));
            for (row, (y0, y1, v)) in plane.chunks_exact_mut(width).skip(top).zip(&down) {
                let line = |y: usize| &bytes[y * self.picture.width..][..self.picture.width];
                let (upper, lower) = (line(*y0), line(*y1));
                for (out, (x0, x1, u)) in row[left..].iter_mut().zip(&across) {
                    let mean = |line: &[u8]| {
                        let (a, b) = (f32::from(line[*x0]), f32::from(line[*x1]));
                        a + u * (b - a)
                    };
                    let (above, below) = (mean(upper), mean(lower));
                    *out = (above + v * (below - above)) / 255.0;
                }
            }
        }
    }

    /// The box of the picture for these edges in the input (left, top, right, bottom), clipped to the picture; `None`
    /// if less than a pixel remains.
    pub(super) fn back(&self, [left, top, right, bottom]: [f64; 4]) -> Option<BBox> {
        let [x, y, columns, rows] = self.place.map(|n| n as f64);
        let (width, height) = (self.picture.width as f64, self.picture.height as f64);
        let along = |at: f64, from: f64, n: f64, of: f64| ((at - from) * of / n).clamp(0.0, of);
        let (x0, x1) = (along(left, x, columns, width), along(right, x, columns, width));
        let (y0, y1) = (along(top, y, rows, height), along(bottom, y, rows, height));
        let bbox = BBox { x: x0, y: y0, w: x1 - x0, h: y1 - y0 };
        // Not `<`: a number that is none is no box.
        (bbox.w >= 1.0 && bbox.h >= 1.0 && x0 + bbox.w <= width && y0 + bbox.h <= height).then_some(bbox)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_in_the_middle() {
        let image = Image::new(4, 2, 1, vec![0, 255, 0, 255, 0, 255, 0, 255]).expect("eight bytes");
        let letterbox = Letterbox::new(Size::new(4, 2), Size::new(8, 8));
        let (mut r, mut g) = (vec![0.0; 64], vec![0.0; 64]);
        letterbox.fill(&image, 8, &mut [&mut r, &mut g]);
        assert_eq!(r, g);
        let row = [0.0, 0.25, 0.75, 0.75, 0.25, 0.25, 0.75, 1.0];
        for (y, found) in r.chunks_exact(8).enumerate() {
            let wanted = if (2..6).contains(&y) { row } else { [AROUND; 8] };
            assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6), "{y}: {found:?}");
        }
    }

    #[test]
    fn boxes_come_back() {
        let letterbox = Letterbox::new(Size::new(100, 40), Size::new(64, 64));
        // 64 x 26 at (0, 19).
        assert_eq!(letterbox.place, [0, 19, 64, 26]);
        let back = letterbox.back([16.0, 32.0, 48.0, 45.0]).expect("within");
        assert!((back.x - 25.0).abs() < 1e-9 && (back.w - 50.0).abs() < 1e-9, "{back:?}");
        assert!((back.y - 20.0).abs() < 1e-9 && (back.h - 20.0).abs() < 1e-9, "{back:?}");
        assert_eq!(letterbox.back([-9.0, 0.0, 999.0, 64.0]), Some(BBox { x: 0.0, y: 0.0, w: 100.0, h: 40.0 }));
        for none in [[0.0, 0.0, 64.0, 19.0], [f64::NAN, 20.0, 30.0, 30.0], [30.0, 20.0, 10.0, 40.0]] {
            assert_eq!(letterbox.back(none), None, "{none:?}");
        }
        for (w, h) in [(1, 1), (1, 9000), (9000, 1), (640, 640)] {
            let tiny = Letterbox::new(Size::new(w, h), Size::new(32, 32));
            let whole = BBox { x: 0.0, y: 0.0, w: w as f64, h: h as f64 };
            assert_eq!(tiny.back([0.0, 0.0, 32.0, 32.0]), Some(whole));
        }
    }
}
