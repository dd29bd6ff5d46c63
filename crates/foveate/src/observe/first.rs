//! The target in the first frame, as results show it: cut out with its surroundings, and as the retina reads it.

use crate::geometry::{BBox, Extent, Gaze, State};
use crate::identity::pyramid::Region;
use crate::identity::{Pyramid, Retina};
use crate::scene::Image;

/// How much of the first frame is shown around the target, in template units.
const MARGIN: f64 = 1.4;
/// The farthest gaze that is read on the template, in template units; as far as the appearance's own.
const FARTHEST_GAZE: f64 = 1.5;

/// A part of the first frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Crop {
    /// Its pixels.
    pub image: Image,
    /// Left, top, right, bottom in template units: the edges of the outermost pixels.
    pub bounds: [f64; 4],
    /// Width of the target's box relative to its height.
    pub aspect: f64,
}

impl Crop {
    /// The target and what is around it; outside the picture its edge is repeated.
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
}

/// The first frame, as a retina reads it.
pub(super) struct First {
    pyramid: Pyramid,
    state: State,
    extent: Extent,
}

impl First {
    pub fn new(image: &Image, bbox: &BBox, retina: &dyn Retina) -> Self {
        let (state, extent) = (State::of(bbox), Extent::of(bbox));
        let reach = retina.footprints().iter().map(|f| f.reach).fold(0.0, f64::max);
        let corner = Gaze { u: FARTHEST_GAZE, v: FARTHEST_GAZE, arm: None };
        let mut pyramid = Pyramid::default();
        let region = Region::covering(image, &[state], &[corner], extent, reach);
        pyramid.build(image, region, retina.footprints(), (extent.half_w, extent.half_h));
        Self { pyramid, state, extent }
    }

    /// The target at a gaze, cell by cell; empty where the gaze is too far off to be read.
    pub fn glimpse(&self, retina: &dyn Retina, gaze: Gaze) -> Vec<f32> {
        let far = gaze.u.abs().max(gaze.v.abs()) > FARTHEST_GAZE;
        let mut glimpse = vec![0.0; if far { 0 } else { retina.glimpse_len() }];
        if !far {
            retina.look(&self.pyramid, self.state.fixate(gaze, self.extent), &mut glimpse);
        }
        glimpse
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
        let far = Crop::around(&image, &BBox { x: 1e12, y: f64::NAN, w: 4.0, h: 4.0 });
        assert_eq!(far.image.width(), 7);
    }
}
