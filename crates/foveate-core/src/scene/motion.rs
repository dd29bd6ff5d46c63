//! What moves: each frame against a background that is learned as the video goes.
//!
//! Each pixel keeps the mean and variance of its grey (after a 3 × 3 median, which takes away salt and pepper). A pixel that
//! is several deviations off is in motion; opening takes away specks, closing joins the parts of one thing. Pixels in motion
//! do not teach the background, unless they stay as they are for a while: so what was there at first and left, and what
//! came and stopped, becomes background again; what left is told by its edges, too (`ghosts.rs`). Each frame is compared at
//! the background's brightness. The camera must stand still; where it moves, see [`Flow`](super::flow::Flow).
//!
//! [`first_box`] is how the paper's authors found their target: by the difference of the first two frames.

use foveate_kernels as kernels;

use crate::geometry::BBox;
use crate::scene::detect::{Blobs, Detector, Score};
use crate::scene::ghosts::{Ghosts, Marked};
use crate::scene::morphology::{Mask, Rows, median};
use crate::scene::{Detection, Image, Map};

/// Frame differencing against a running background. The map has a value a pixel: deviations from the background where
/// something moves, 0 elsewhere.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Deviations from the mean at which a pixel is in motion.
    pub threshold: f32,
    /// Least deviation a pixel is taken to have, grey levels of 255: coding noise.
    pub least_deviation: f32,
    /// Share of a frame in the running mean and variance, once there were enough frames.
    pub rate: f32,
    /// Frames after which a pixel in motion that did not change is background.
    pub patience: u8,
    /// Radius of the opening, pixels.
    pub open: usize,
    /// Radius of the closing, pixels.
    pub close: usize,
    map: Map,
    blobs: Blobs,
    frames: u32,
    grey: Vec<u8>,
    now: Vec<u8>,
    before: Vec<u8>,
    mean: Vec<f32>,
    variance: Vec<f32>,
    still: Vec<u8>,
    /// Brightness of the frame, as a factor of the background's.
    gain: f32,
    ratios: Vec<f32>,
    rows: Rows,
    mask: Mask,
    ghosts: Ghosts,
}

impl Default for Motion {
    fn default() -> Self {
        Self {
            threshold: 4.0,
            least_deviation: 6.0,
            rate: 0.05,
            patience: 12,
            open: 1,
            close: 3,
            map: Map::default(),
            blobs: Blobs::new(40, Score::Mass),
            frames: 0,
            grey: vec![],
            now: vec![],
            before: vec![],
            mean: vec![],
            variance: vec![],
            still: vec![],
            gain: 1.0,
            ratios: vec![],
            rows: Rows::default(),
            mask: Mask::default(),
            ghosts: Ghosts::default(),
        }
    }
}

impl Detector for Motion {
    fn detect(&mut self, image: &Image, found: &mut Vec<Detection>) {
        found.clear();
        let size @ (width, height) = (image.width(), image.height());
        let same = (self.map.width(), self.map.height()) == size;
        std::mem::swap(&mut self.now, &mut self.before);
        grey(image, &mut self.grey);
        median(&self.grey, width, &mut self.rows, &mut self.now);
        self.map.cover(width, height, 1);
        if !same {
            return self.begin();
        }
        self.frames = self.frames.saturating_add(1);
        self.expose();
        self.compare(width);
        self.exorcise(width);
        self.learn();
        self.blobs.find(&self.map, 0.0, size, found);
    }
    fn map(&self) -> &Map {
        &self.map
    }
}

impl Motion {
    /// Takes the median of these pictures, pixel by pixel, for the background: frames from all over a video, in which each
    /// pixel shows the background more often than not. Then even the first frame has things that move, and those that stand
    /// still stay in motion for as long as `patience`, 255 frames at most, allows. Pictures of another size than the first
    /// do not count.
    pub fn learn_background(&mut self, frames: &[Image]) {
        let Some(first) = frames.first() else { return };
        let (width, height) = (first.width(), first.height());
        let mut stack: Vec<Vec<u8>> = vec![];
        for image in frames.iter().filter(|image| (image.width(), image.height()) == (width, height)) {
            let mut smooth = vec![];
            grey(image, &mut self.grey);
            median(&self.grey, width, &mut self.rows, &mut smooth);
            stack.push(smooth);
        }
        self.now.clear();
        let mut values = vec![0; stack.len()];
        for k in 0..width * height {
            values.iter_mut().zip(&stack).for_each(|(value, smooth)| *value = smooth[k]);
            values.sort_unstable();
            self.now.push(values[values.len() / 2]);
        }
        self.map.cover(width, height, 1);
        self.begin();
        self.frames = u32::try_from(stack.len()).unwrap_or(u32::MAX);
    }
    fn begin(&mut self) {
        self.frames = 1;
        self.mean.clear();
        self.mean.extend(self.now.iter().map(|&v| f32::from(v)));
        self.variance.clear();
        self.variance.resize(self.now.len(), 0.0);
        self.still.clear();
        self.still.resize(self.now.len(), 0);
    }
    fn deviation(&self, k: usize) -> f32 {
        (self.variance[k] + self.least_deviation * self.least_deviation).sqrt()
    }
    /// How much brighter or darker the frame is than the background, most of which is in view: cameras adapt to what comes.
    fn expose(&mut self) {
        /// Grey levels from which on a ratio means something; one pixel in so many is asked; so many are enough.
        const DARK: f32 = 16.0;
        const EVERY: usize = 7;
        const ENOUGH: usize = 100;
        let Self { now, mean, ratios, .. } = self;
        ratios.clear();
        let pixels = now.iter().zip(&*mean).step_by(EVERY).filter(|(_, mean)| **mean > DARK);
        ratios.extend(pixels.map(|(now, mean)| f32::from(*now) / mean));
        let middle = ratios.len() / 2;
        self.gain = 1.0;
        if ratios.len() > ENOUGH {
            self.gain = ratios.select_nth_unstable_by(middle, f32::total_cmp).1.clamp(0.25, 4.0);
        }
    }
    /// Marks what is off the background, cleans the marks, and fills the map.
    fn compare(&mut self, width: usize) {
        for k in 0..self.now.len() {
            let off = (f32::from(self.now[k]) / self.gain - self.mean[k]).abs() / self.deviation(k);
            self.map.values_mut()[k] = off;
        }
        self.mask.marks.clear();
        self.mask.marks.extend(self.map.values().iter().map(|off| *off > self.threshold));
        self.mask.open(width, self.open);
        self.mask.close(width, self.close);
        for (value, &mark) in self.map.values_mut().iter_mut().zip(&self.mask.marks) {
            *value = if mark { value.max(1.0) } else { 0.0 }; // gaps that were closed count as one deviation
        }
    }
    /// What left the background is taken out of it, and out of the marks.
    fn exorcise(&mut self, width: usize) {
        let Self { ghosts, mask, mean, variance, still, now, map, gain, .. } = self;
        for &k in ghosts.find(Marked { marks: &mask.marks, width, now, mean, still }) {
            (mean[k], variance[k], still[k]) = (f32::from(now[k]) / *gain, 0.0, 0);
            mask.marks[k] = false;
            map.values_mut()[k] = 0.0;
        }
    }
    /// Background pixels move their mean and variance; those in motion wait.
    fn learn(&mut self) {
        let share = self.rate.max(1.0 / self.frames as f32);
        for k in 0..self.now.len() {
            let now = f32::from(self.now[k]) / self.gain;
            if !self.mask.marks[k] {
                let off = now - self.mean[k];
                self.mean[k] += share * off;
                self.variance[k] += share * (off * off - self.variance[k]);
                self.still[k] = 0;
                continue;
            }
            let changed = f32::from(self.now[k].abs_diff(self.before[k])) > self.threshold * self.least_deviation;
            self.still[k] = if changed { 0 } else { self.still[k] + 1 };
            if self.still[k] >= self.patience.max(1) {
                (self.mean[k], self.still[k]) = (now, 0);
            }
        }
    }
}

/// The luma of a picture into a buffer.
fn grey(image: &Image, to: &mut Vec<u8>) {
    to.clear();
    if image.planes() == 1 {
        return to.extend_from_slice(image.plane(0));
    }
    to.resize(image.plane(0).len(), 0);
    kernels::luma([0, 1, 2].map(|p| image.plane(p)), to);
}

/// Grey levels by which a pixel of [`first_box`] must differ.
const DIFFERENCE: u8 = 25;

/// A target's box in the first frame, by what moved between it and the second one (the start of the authors' published
/// program): absolute difference, 3 × 3 median, opening and dilation by a disc of radius 2, the largest connected part.
/// `size` is that of the box round the part's centre, which keeps within the picture; `None` takes the part's own.
///
/// Answers `None` where nothing moved, or the pictures differ in size. Deviation: where opening leaves nothing, because a
/// thin thing moved a little, the difference is dilated as it is.
pub fn first_box(first: &Image, second: &Image, size: Option<(f64, f64)>) -> Option<BBox> {
    let (width, height) = (first.width(), first.height());
    if (second.width(), second.height()) != (width, height) {
        return None;
    }
    let (mut a, mut b, mut smooth) = (vec![], vec![], vec![]);
    grey(first, &mut a);
    grey(second, &mut b);
    a.iter_mut().zip(&b).for_each(|(a, b)| *a = a.abs_diff(*b));
    median(&a, width, &mut Rows::default(), &mut smooth);
    let marks: Vec<bool> = smooth.iter().map(|d| *d > DIFFERENCE).collect();
    let mut mask = Mask::default();
    mask.marks.clone_from(&marks);
    mask.open(width, 2);
    if !mask.marks.contains(&true) {
        mask.marks = marks;
    }
    mask.dilate(width, 2);
    let mut map = Map::over(width, height, 1);
    map.values_mut().iter_mut().zip(&mask.marks).for_each(|(value, &mark)| *value = f32::from(u8::from(mark)));
    let mut found = vec![];
    Blobs::new(1, Score::Mass).find(&map, 0.5, (width, height), &mut found);
    let part = found.first()?.bbox;
    let Some((w, h)) = size.map(|(w, h)| (w.clamp(1.0, width as f64), h.clamp(1.0, height as f64))) else {
        return Some(part);
    };
    let (x, y) = part.centre();
    let around = BBox::around(x, y, w, h);
    let within = |from: f64, long: f64, side: usize| from.clamp(0.0, side as f64 - long);
    Some(BBox { x: within(around.x, w, width), y: within(around.y, h, height), ..around })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;

    #[test]
    fn it_is_a_detector() {
        conformance::detector(&|| Box::<Motion>::default());
    }

    /// A block stands where the background was learned, leaves, and another comes in while the camera darkens all.
    #[test]
    fn what_left_is_forgotten_and_exposure_is_no_motion() {
        let picture = |x: usize, gain: f32| {
            let block = |k: usize| (x..x + 20).contains(&(k % 120)) && (30..70).contains(&(k / 120));
            let grey = |k: usize| if block(k) { 220.0 } else { 90.0 + (k % 7) as f32 };
            Image::new(120, 100, 1, (0..12_000).map(|k| (gain * grey(k)) as u8).collect()).expect("bytes")
        };
        let mut motion = Motion { patience: u8::MAX, ..Motion::default() };
        motion.learn_background(&[picture(20, 1.0), picture(20, 1.0), picture(20, 1.0)]);
        let mut found = vec![];
        for index in 0..20 {
            let gain = if index < 10 { 1.0 } else { 0.6 };
            motion.detect(&picture(80, gain), &mut found);
            let near = |x: f64| found.iter().filter(|d| (d.bbox.x - x).abs() <= 2.0 && d.bbox.w <= 24.0).count();
            assert_eq!(near(80.0), 1, "frame {index}: {found:?}");
            assert_eq!(near(20.0), usize::from(index < 6), "frame {index}: {found:?}");
            assert!(found.len() <= 2, "frame {index}: {found:?}");
        }
    }
}
