//! Dense optical flow from one frame to the next, and regions that move differently from the camera.
//!
//! Patches of 8 × 8 pixels on a grid of 4, from coarse pictures to fine, each moved by inverse compositional Gauss-Newton
//! steps (Baker and Matthews 2004) from where the coarser level put it; between patches the flow is their mean, weighed by
//! how well each explains the pixel: the dense inverse search of Kroeger et al. (2016).
//! Deviation: no variational smoothing afterwards, and brightness may change by a constant within a patch.
//!
//! Flow is in pixels a frame: the point `(x, y)` of the first picture is at `(x + u, y + v)` in the second.

use foveate_kernels::PATCH;

use crate::geometry::{BBox, Size};
use crate::scene::camera::Affine;
use crate::scene::detect::{Blobs, Detector, Score};
use crate::scene::{Detection, Image, Map};

mod patch;

use self::patch::Patch;

/// Distance between two patches, in pixels of a level.
const STRIDE: usize = 4;
/// Levels are halved while both sides have this many pixels.
const COARSEST: usize = 12;
/// Level from which on the flow is the camera's alone, and pixels of the shorter side that are too many for that.
const CAMERA: usize = 3;
const COARSE_SIDE: usize = 60;

/// Dense optical flow between successive frames. As a detector it finds regions that move differently from the
/// camera: the map has the length of the flow minus the camera's, pixels a frame.
#[derive(Clone, Debug)]
pub struct Flow {
    /// Level at which the search ends: 0 is the picture itself, 1 half its size (four times as fast). From 3 on,
    /// which suffices for the camera's motion, large pictures end at a coarser level, with fewer than 60 pixels along
    /// the shorter side.
    pub finest: usize,
    /// Pixels a frame above which a place moves otherwise than the camera.
    pub threshold: f32,
    before: Vec<Map>,
    now: Vec<Map>,
    u: Map,
    v: Map,
    coarse: [Map; 2],
    weight: Vec<f32>,
    across: Vec<f32>,
    sums: Vec<u16>,
    /// Of the last picture.
    size: Option<Size>,
    camera: Affine,
    places: Vec<[f64; 4]>,
    map: Map,
    blobs: Blobs,
}

impl Default for Flow {
    fn default() -> Self {
        Self {
            finest: 1,
            threshold: 0.75,
            before: vec![],
            now: vec![],
            u: Map::default(),
            v: Map::default(),
            coarse: [Map::default(), Map::default()],
            weight: vec![],
            across: vec![],
            sums: vec![],
            size: None,
            camera: Affine::default(),
            places: vec![],
            map: Map::default(),
            blobs: Blobs::new(64, Score::Mass),
        }
    }
}

impl Detector for Flow {
    fn detect(&mut self, image: &Image, found: &mut Vec<Detection>) {
        found.clear();
        self.look(image);
        self.map.like(&self.u);
        let (w, cell) = (self.u.width(), self.u.cell() as f64);
        for (k, value) in self.map.values_mut().iter_mut().enumerate() {
            let centre = |i: usize| cell * (i as f64 + 0.5) - 0.5;
            let (cu, cv) = self.camera.at(centre(k % w), centre(k / w));
            *value = (self.u.values()[k] - cu as f32).hypot(self.v.values()[k] - cv as f32);
        }
        self.blobs.find(&self.map, self.threshold, image.size(), found);
        // A patch at an edge moves with what moves in it: boxes reach about half a stride too far on each side.
        let smear = (STRIDE << self.finest) as f64 / 2.0;
        for Detection { bbox: b, .. } in found.iter_mut() {
            let (dx, dy) = (smear.min(b.w / 4.0), smear.min(b.h / 4.0));
            // No narrower than a pixel.
            let (w, h) = ((b.w - 2.0 * dx).max(1.0), (b.h - 2.0 * dy).max(1.0));
            *b = BBox { x: b.x + dx, y: b.y + dy, w, h };
        }
    }
    fn map(&self) -> &Map {
        &self.map
    }
}

impl Flow {
    /// Flow with a search that ends at this level.
    pub fn down_to(finest: usize) -> Self {
        Self { finest, ..Self::default() }
    }
    /// Adds the next picture and fills [`Flow::field`] with the flow from the previous one; zeros if that had another
    /// size.
    pub fn next(&mut self, image: &Image) {
        std::mem::swap(&mut self.before, &mut self.now);
        let finest = self.finest_of(image);
        let levels = build(&mut self.now, image, (&mut self.sums, &mut self.across), finest);
        let finest = finest.min(levels - 1);
        let size = Some(image.size());
        if std::mem::replace(&mut self.size, size) != size || self.before.len() < levels {
            self.u.like(&self.now[finest]);
            self.v.like(&self.now[finest]);
            return;
        }
        for level in (finest..levels).rev() {
            let (before, now) = (&self.before[level], &self.now[level]);
            let [cu, cv] = &mut self.coarse;
            std::mem::swap(cu, &mut self.u);
            std::mem::swap(cv, &mut self.v);
            self.u.like(before);
            self.v.like(before);
            self.weight.clear();
            self.weight.resize(before.values().len(), 0.0);
            for y in starts(before.height()) {
                for x in starts(before.width()) {
                    let patch = Patch::cut(before, x, y);
                    let from = if level + 1 == levels { (0.0, 0.0) } else { around(cu, cv, x, y) };
                    let flow = patch.search(before, now, from);
                    patch.spread(before, now, flow, (&mut self.u, &mut self.v), &mut self.weight);
                }
            }
            let all = self.u.values_mut().iter_mut().zip(self.v.values_mut()).zip(&self.weight);
            all.for_each(|((u, v), w)| (*u, *v) = (*u / w, *v / w));
        }
        // From pixels of the finest level to those of the picture.
        let scale = (1 << finest) as f32;
        self.u.values_mut().iter_mut().chain(self.v.values_mut()).for_each(|f| *f *= scale);
    }
    fn finest_of(&self, image: &Image) -> usize {
        let side = image.width().min(image.height());
        let large = |level: &usize| self.finest >= CAMERA && side >> level >= COARSE_SIDE;
        (self.finest..).find(|level| !large(level)).unwrap_or(self.finest)
    }
    /// The flow of the last two pictures: across and down, pixels of the picture a frame.
    pub fn field(&self) -> (&Map, &Map) {
        (&self.u, &self.v)
    }
    /// Takes the next picture as [`Flow::next`] does, and fits the camera's motion to the flow.
    pub fn look(&mut self, image: &Image) {
        self.next(image);
        self.camera = Affine::fit(&self.u, &self.v, &mut self.places);
    }
    /// How the camera moved between the last two pictures of [`Flow::look`], as most of the flow has it.
    pub fn camera(&self) -> Affine {
        self.camera
    }
}

/// The pyramid of a picture's intensity, without levels below the end of the search. Returns the number of levels.
fn build(levels: &mut Vec<Map>, image: &Image, (sums, across): (&mut Vec<u16>, &mut Vec<f32>), finest: usize) -> usize {
    let mut count = 1;
    while (image.width().min(image.height()) >> count) >= COARSEST {
        count += 1;
    }
    let count = count.max(finest.min(2) + 1);
    levels.resize_with(count.max(levels.len()), Map::default);
    if finest == 0 || count == 1 {
        levels[0].intensity(image);
    }
    // A search in a large picture, which ends at a coarse level, needs none finer than the one that this is made of.
    let first = if finest > CAMERA { finest - 1 } else { 1 };
    for l in first..count {
        let (fine, coarse) = levels.split_at_mut(l);
        match l {
            _ if l == first && l > 1 => coarse[0].square_intensity(image, 1 << l, sums),
            1 if finest > 0 => coarse[0].half_intensity(image, sums),
            _ => fine[l - 1].halve(across, &mut coarse[0]),
        }
    }
    count
}

/// First pixels of the patches along a side: every fourth, and the last that fits.
fn starts(side: usize) -> impl Iterator<Item = usize> {
    let last = side.saturating_sub(PATCH);
    (0..last).step_by(STRIDE).chain(std::iter::once(last))
}

/// The coarser level's flow at the middle of a patch, in pixels of this one.
fn around(cu: &Map, cv: &Map, x: usize, y: usize) -> (f32, f32) {
    let middle = |start: usize| (start as f32 + PATCH as f32 / 2.0) / 2.0 - 0.5;
    (2.0 * cu.between(middle(x), middle(y)), 2.0 * cv.between(middle(x), middle(y)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use foveate_base::rng::{Purpose, Streams};
    use rand::RngExt;

    #[test]
    fn it_is_a_detector() {
        conformance::detector(&|| Box::<Flow>::default());
    }

    /// A texture known at every place: forty waves of 6 to 120 pixels.
    fn texture(seed: u64) -> impl Fn(f64, f64) -> f64 {
        let mut rng = Streams::new(seed, 0).at(0, Purpose::Scene).rng(0);
        let waves: Vec<[f64; 3]> = (0..40)
            .map(|_| {
                let (angle, length) = (rng.random_range(0.0..std::f64::consts::PI), 6.0 * 20f64.powf(rng.random()));
                let k = std::f64::consts::TAU / length;
                [k * angle.cos(), k * angle.sin(), rng.random_range(0.0..6.3)]
            })
            .collect();
        move |x, y| 128.0 + 14.0 * waves.iter().map(|w| (w[0] * x + w[1] * y + w[2]).sin()).sum::<f64>()
    }

    const SIZE: Size = Size::new(240, 180);

    fn picture(at: impl Fn(f64, f64) -> f64) -> Image {
        let pixel = |k: usize| at((k % SIZE.width) as f64, (k / SIZE.width) as f64).round().clamp(0.0, 255.0) as u8;
        Image::new(SIZE.width, SIZE.height, 1, (0..SIZE.width * SIZE.height).map(pixel).collect())
            .expect("as many bytes")
    }

    /// Mean end-point error of the flow between two pictures, against a known one; places that leave the picture do not
    /// count.
    fn error(first: &Image, second: &Image, finest: usize, truth: impl Fn(f64, f64) -> (f64, f64)) -> f64 {
        let mut flow = Flow { finest, ..Flow::default() };
        flow.next(first);
        flow.next(second);
        let (u, v) = flow.field();
        let (mut sum, mut count) = (0.0, 0);
        for y in 0..SIZE.height {
            for x in 0..SIZE.width {
                let (a, b) = truth(x as f64, y as f64);
                let to = (x as f64 + a, y as f64 + b);
                if to.0 >= 4.0 && to.1 >= 4.0 && to.0 < SIZE.width as f64 - 5.0 && to.1 < SIZE.height as f64 - 5.0 {
                    let at = (u.at_pixel(x as f32, y as f32), v.at_pixel(x as f32, y as f32));
                    (sum, count) = (sum + (f64::from(at.0) - a).hypot(f64::from(at.1) - b), count + 1);
                }
            }
        }
        sum / f64::from(count)
    }

    #[test]
    fn known_flows_are_found() {
        // The second picture is the texture at the place each pixel came from: p = A q + t about the middle, inverted.
        let (cx, cy) = (120.0, 90.0);
        let turned = |degrees: f64, zoom: f64| (zoom * degrees.to_radians().cos(), zoom * degrees.to_radians().sin());
        // Within a patch the flow is one shift: where it varies by 0.07 a pixel, so does the error over half a patch.
        for (name, (c, s), (tx, ty), allowed) in [
            ("identity", (1.0, 0.0), (0.0, 0.0), 0.001),
            ("translation", (1.0, 0.0), (3.3, -2.1), 0.1),
            ("far", (1.0, 0.0), (8.0, -5.4), 0.1),
            ("turn", turned(4.0, 1.0), (0.0, 0.0), 0.25),
            ("zoom", turned(0.0, 1.06), (0.0, 0.0), 0.2),
            ("all", turned(-3.0, 0.95), (4.0, 2.5), 0.25),
        ] {
            let forth = |x: f64, y: f64| {
                let (x, y) = (x - cx, y - cy);
                (c * x - s * y + cx + tx, s * x + c * y + cy + ty)
            };
            let back = |x: f64, y: f64| {
                let (x, y, n) = (x - cx - tx, y - cy - ty, c * c + s * s);
                ((c * x + s * y) / n + cx, (c * y - s * x) / n + cy)
            };
            for seed in 0..2 {
                let world = texture(seed);
                let first = picture(&world);
                let second = picture(|x, y| {
                    let (x, y) = back(x, y);
                    world(x, y)
                });
                for finest in [0, 1] {
                    let e = error(&first, &second, finest, |x, y| (forth(x, y).0 - x, forth(x, y).1 - y));
                    assert!(e < allowed, "{name}, finest level {finest}: end-point error {e} pixels");
                }
                let mut flow = Flow::default();
                let mut found = vec![];
                for image in [&first, &second] {
                    flow.detect(&image.clone(), &mut found);
                }
                let (u, v) = flow.camera().at(30.0, 140.0);
                let (x, y) = forth(30.0, 140.0);
                assert!((u + 30.0 - x).hypot(v + 140.0 - y) < 0.35, "{name}: the camera moved by {u}, {v}");
            }
        }
    }

    /// In a large picture, of which some rows are read: to a sixteenth of the 16 px of the level at which the search ends.
    #[test]
    fn the_camera_of_large_pictures_is_found() {
        let (world, size, moved) = (texture(5), Size::new(640, 480), (7.0, -4.0));
        let picture = |t: f64| {
            let at = |k: usize| ((k % size.width) as f64 - t * moved.0, (k / size.width) as f64 - t * moved.1);
            let grey = |(x, y): (f64, f64)| world(0.2 * x, 0.2 * y).round().clamp(0.0, 255.0) as u8;
            Image::new(size.width, size.height, 1, (0..size.width * size.height).map(|k| grey(at(k))).collect())
                .expect("as many bytes")
        };
        let mut flow = Flow::down_to(CAMERA);
        [0.0, 1.0].map(picture).iter().for_each(|image| flow.look(image));
        assert_eq!(flow.finest_of(&picture(0.0)), CAMERA + 1);
        for (x, y) in [(60.0, 50.0), (320.0, 240.0), (600.0, 400.0)] {
            let (u, v) = flow.camera().at(x, y);
            assert!((u - moved.0).hypot(v - moved.1) < 1.0, "the camera moved by {u}, {v}");
        }
    }

    #[test]
    fn what_moves_otherwise_than_the_camera_is_found() {
        let (world, thing) = (texture(3), texture(4));
        let scene = |t: f64| {
            picture(|x, y| {
                let (left, top) = (100.0 + 4.0 * t, 60.0 - 2.0 * t);
                let on = x >= left && x < left + 50.0 && y >= top && y < top + 40.0;
                if on { thing(x - left, y - top) } else { world(x + 2.0 * t, y + t) }
            })
        };
        let (mut flow, mut found) = (Flow::default(), vec![]);
        for t in 0..2 {
            flow.detect(&scene(t as f64), &mut found);
        }
        let truth = crate::geometry::BBox { x: 100.0, y: 60.0, w: 50.0, h: 40.0 };
        let best = found[0].bbox;
        assert!(best.iou(&truth) > 0.6, "{best:?}");
        let (u, v) = flow.field();
        let (u, v) = (u.at_pixel(125.0, 80.0), v.at_pixel(125.0, 80.0));
        assert!((u - 4.0).hypot(v + 2.0) < 0.1, "{u}, {v}");
    }
}
