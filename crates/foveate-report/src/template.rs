//! The template as shown in results: the target in the first frame, with its surroundings, and its glimpses.

use crate::eye::Eye;
use foveate_core::geometry::{BBox, Extent, Gaze, State};
use foveate_core::identity::pyramid::Region;
use foveate_core::identity::{Pyramid, Retina};
use foveate_core::scene::Image;

/// Extent of the first frame shown around the target's centre, in template units.
const MARGIN: f64 = 1.4;
/// Maximum distance of a gaze read on the template, in template units; equals the appearance model's limit.
const FARTHEST_GAZE: f64 = 1.5;

/// The target in the first frame with its surroundings.
#[derive(Clone, Debug, PartialEq)]
pub struct Crop {
    /// The pixels.
    pub image: Image,
    /// Left, top, right, bottom in template units: the edges of the outermost pixels.
    pub bounds: [f64; 4],
    /// Width of the target's box relative to its height.
    pub aspect: f64,
}

impl Crop {
    /// Cuts out the target and 0.4 template units around its box; outside the picture its edge is repeated.
    pub fn around(image: &Image, bbox: &BBox) -> Self {
        let (state, extent) = (State::of(bbox), Extent::of(bbox));
        let reach = |half: f64| (MARGIN * half).ceil().clamp(1.0, 4096.0) as isize;
        let (rx, ry) = (reach(extent.half_w), reach(extent.half_h));
        let (cx, cy) = (state.x.round() as isize, state.y.round() as isize);
        let at = |i: isize, side: usize| i.clamp(0, side as isize - 1) as usize;
        let mut data = vec![];
        for p in 0..image.planes() {
            for y in cy - ry..=cy + ry {
                data.extend((cx - rx..=cx + rx).map(|x| image.at(p, at(x, image.width()), at(y, image.height()))));
            }
        }
        let (width, height) = (2 * rx as usize + 1, 2 * ry as usize + 1);
        let image = Image::new(width, height, image.planes(), data).expect("as many bytes as pixels");
        let u = |x: f64| (x - state.x) / extent.half_w;
        let v = |y: f64| (y - state.y) / extent.half_h;
        let (cx, cy, rx, ry) = (cx as f64, cy as f64, rx as f64 + 0.5, ry as f64 + 0.5);
        Self { image, bounds: [u(cx - rx), v(cy - ry), u(cx + rx), v(cy + ry)], aspect: extent.half_w / extent.half_h }
    }

    /// Returns the part of whole pixels that extends to about `reach` template units from the target's centre, at least one pixel.
    pub fn closer(&self, reach: f64) -> Self {
        let [left, top, right, bottom] = self.bounds;
        let (w, h) = (self.image.width(), self.image.height());
        let part = |low: f64, high: f64, n: usize| {
            let at = |x: f64| ((x - low) / (high - low) * n as f64).round().clamp(0.0, n as f64) as usize;
            let from = at(-reach).min(n - 1);
            (from, at(reach).max(from + 1))
        };
        let ((x0, x1), (y0, y1)) = (part(left, right, w), part(top, bottom, h));
        let planes = (0..self.image.planes()).map(|p| self.image.plane(p));
        let row = |plane: &[u8], y: usize| plane[y * w + x0..y * w + x1].to_vec();
        let data = planes.flat_map(|plane| (y0..y1).flat_map(move |y| row(plane, y))).collect();
        let image = Image::new(x1 - x0, y1 - y0, self.image.planes(), data).expect("as many bytes as pixels");
        let (u, v) = (
            |x: usize| left + x as f64 * (right - left) / w as f64,
            |y: usize| top + y as f64 * (bottom - top) / h as f64,
        );
        Self { image, bounds: [u(x0), v(y0), u(x1), v(y1)], aspect: self.aspect }
    }
}

/// The first frame, as a retina reads it.
#[derive(Debug)]
pub(super) struct FirstFrame {
    pyramid: Pyramid,
    state: State,
    extent: Extent,
}

impl FirstFrame {
    pub(crate) fn new(image: &Image, bbox: &BBox, retina: &dyn Retina) -> Self {
        let (state, extent) = (State::of(bbox), Extent::of(bbox));
        let reach = retina.footprints().iter().map(|f| f.reach).fold(0.0, f64::max);
        let corner = Gaze { u: FARTHEST_GAZE, v: FARTHEST_GAZE, arm: None };
        let mut pyramid = Pyramid::default();
        let region = Region::covering(image, &[state], &[corner], extent, reach);
        pyramid.build(image, region, retina.footprints(), (extent.half_w, extent.half_h));
        Self { pyramid, state, extent }
    }

    /// Returns the target at a gaze, cell by cell; empty if the gaze is too far off.
    pub(crate) fn glimpse(&self, retina: &dyn Retina, gaze: Gaze) -> Vec<f32> {
        let far = gaze.u.abs().max(gaze.v.abs()) > FARTHEST_GAZE;
        let mut glimpse = vec![0.0; if far { 0 } else { retina.glimpse_len() }];
        if !far {
            retina.look(&self.pyramid, self.state.fixate(gaze, self.extent), &mut glimpse);
        }
        glimpse
    }

    /// Returns the target at a gaze as a picture; `None` if it is empty, or the retina has no cell.
    pub(crate) fn picture(&self, retina: &dyn Retina, gaze: Gaze) -> Option<Image> {
        let glimpse = self.glimpse(retina, gaze);
        Eye::new(retina).filter(|_| !glimpse.is_empty()).map(|eye| eye.picture(&glimpse))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_surroundings_reach_past_the_picture() {
        let image = Image::grey(30, 20, 50);
        let crop = Crop::around(&image, &BBox { x: -9.5, y: -4.5, w: 20.0, h: 10.0 });
        assert_eq!((crop.image.width(), crop.image.height(), crop.aspect), (29, 15, 2.0));
        let middle = (crop.bounds[0] + crop.bounds[2]) / 2.0;
        assert!(middle.abs() <= 0.05, "{:?}", crop.bounds);
        let ramp = Image::new(30, 30, 1, (0..900).map(|i| (i % 30) as u8).collect()).expect("30 x 30");
        let whole = Crop::around(&ramp, &BBox { x: 5.5, y: 5.5, w: 20.0, h: 20.0 });
        let closer = whole.closer(1.0);
        assert_eq!((closer.image.width(), closer.image.height()), (21, 21), "{:?}", closer.bounds);
        assert!(
            closer.bounds.iter().zip([-1.0, -1.0, 1.0, 1.0]).all(|(b, want): (&f64, f64)| (b - want).abs() < 0.051)
        );
        let at = |crop: &Crop, x: usize| {
            let share = (x as f64 + 0.5) / crop.image.width() as f64;
            crop.bounds[0] + share * (crop.bounds[2] - crop.bounds[0])
        };
        let (near, far) = (closer.image.at(0, 3, 3), (0..29).find(|&x| (at(&whole, x) - at(&closer, 3)).abs() < 1e-9));
        assert_eq!(far.map(|x| whole.image.at(0, x, 3)), Some(near), "pixels stay where they are");
        assert_eq!(whole.closer(0.0).image.width(), 1);
        let far = Crop::around(&image, &BBox { x: 1e12, y: f64::NAN, w: 4.0, h: 4.0 });
        assert_eq!(far.image.width(), 7);
    }
}
