//! What moves: each frame against a background that is learned as the video goes.
//!
//! Each pixel has a running mean and variance of its grey (after a 3 × 3 median against salt and pepper). A pixel
//! that is several deviations off is in motion; opening removes specks, closing joins the parts of one object. Moving
//! pixels do not update the background until they stay unchanged for a while. So an object that left, or that came
//! and stopped, becomes background again; edges also reveal objects that left (`ghosts.rs`). Each frame is compared
//! at the background's brightness. The camera must be fixed; for a moving camera see [`Flow`](super::flow::Flow).
//!
//! [`first_box`] is how the paper's authors found their target: by the difference of the first two frames.

use foveate_kernels as kernels;

use crate::geometry::{BBox, Size};
use crate::scene::detect::{Blobs, Detector, Score};
use crate::scene::ghosts::{Ghosts, Marked};
use crate::scene::morphology::{Mask, Rows, median};
use crate::scene::{Detection, Image, Map};

/// Frame differencing against a running background. The map has one value a pixel: deviations from the background in
/// moving regions, 0 elsewhere.
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
        let size @ Size { width, height } = image.size();
        let same = Size::new(self.map.width(), self.map.height()) == size;
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
        self.remove_ghosts(width);
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
        let size @ Size { width, height } = first.size();
        let mut stack: Vec<Vec<u8>> = vec![];
        for image in frames.iter().filter(|image| image.size() == size) {
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
    /// Ratio of the brightness of the frame to that of the background, because cameras adapt their exposure.
    fn expose(&mut self) {
        /// Least grey level for a ratio; sampling interval in pixels; sufficient number of samples.
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
    /// Marks pixels that differ from the background, cleans the marks, and fills the map.
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
    fn remove_ghosts(&mut self, width: usize) {
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

/// Parts of a smaller share of the largest one's area are not the target.
const LEAST: f64 = 0.25;
/// From this share of the contrast on a part is a place that was left; below the rest, one that was come to. A square that moved
/// by its own side is at 3/4.
const LEFT: f64 = 0.75;

/// Difference of the two shares from which on the old and the new position within one part are distinguished. A
/// square that moved by a quarter of its side has 0.2; for a textured object both shares are a half.
const APART: f64 = 0.15;

/// A target's box in the first frame from the motion to the second one (the start of the authors' program): absolute
/// difference, 3 × 3 median, opening and dilation by a disc of radius 2, the largest connected part in the first
/// frame. `size` is that of the box around the part's centre, clamped to the picture; `None` uses the part's own.
///
/// An object that moved by more than its size makes two parts: its old and its new position. At the edge of the old
/// part the first picture has contrast, at the edge of the new one the second picture, which distinguishes them. A
/// uniform object that moved by less makes one part behind it and one before it, with contrast in both pictures; the
/// box then begins with the first and ends before the second.
///
/// Returns `None` if nothing moved or the pictures differ in size. Deviations: the authors' program takes the largest
/// part even if it is the target's position in the second frame. If opening leaves nothing, because a thin object
/// moved a little, the difference is dilated directly.
pub fn first_box(first: &Image, second: &Image, size: Option<(f64, f64)>) -> Option<BBox> {
    let picture @ Size { width, height } = first.size();
    if second.size() != picture {
        return None;
    }
    let (mut greys, mut pictures, mut smooth) = ([vec![], vec![]], [vec![], vec![]], vec![]);
    for ((image, grey_of), smooth) in [first, second].into_iter().zip(&mut greys).zip(&mut pictures) {
        grey(image, grey_of);
        median(grey_of, width, &mut Rows::default(), smooth);
    }
    let [mut a, b] = greys;
    a.iter_mut().zip(&b).for_each(|(a, b)| *a = a.abs_diff(*b));
    median(&a, width, &mut Rows::default(), &mut smooth);
    let marks: Vec<bool> = smooth.iter().map(|d| *d > DIFFERENCE).collect();
    let mut mask = Mask::default();
    mask.marks.clone_from(&marks);
    mask.open(width, 2);
    if !mask.marks.contains(&true) {
        mask.marks = marks;
    }
    let changed = mask.marks.clone();
    mask.dilate(width, 2);
    let mut map = Map::over(width, height, 1);
    map.values_mut().iter_mut().zip(&mask.marks).for_each(|(value, &mark)| *value = f32::from(u8::from(mark)));
    let mut found = vec![];
    Blobs::new(1, Score::Mass).find(&map, 0.5, picture, &mut found);
    let least = LEAST * found.first()?.score;
    found.retain(|part| part.score >= least);
    let parts: Vec<BBox> = found.iter().map(|part| part.bbox).collect();
    let part = Difference { changed, pictures, width }.before(&parts);
    let Some((w, h)) = size.map(|(w, h)| (w.clamp(1.0, width as f64), h.clamp(1.0, height as f64))) else {
        return Some(part);
    };
    let (x, y) = part.centre();
    let around = BBox::around(x, y, w, h);
    let within = |from: f64, long: f64, side: usize| from.clamp(0.0, side as f64 - long);
    Some(BBox { x: within(around.x, w, width), y: within(around.y, h, height), ..around })
}

/// What differs between two pictures.
struct Difference {
    changed: Vec<bool>,
    pictures: [Vec<u8>; 2],
    width: usize,
}

impl Difference {
    /// Where the target was, of these parts, the largest first.
    fn before(&self, parts: &[BBox]) -> BBox {
        let shares: Vec<f64> = parts.iter().map(|part| self.left(part, &self.changed)).collect();
        let first = shares.iter().position(|share| *share > 1.0 - LEFT).unwrap_or(0);
        let (whole, both) = (parts[first], |share: f64| (1.0 - LEFT..LEFT).contains(&share));
        if !both(shares[first]) {
            return whole;
        }
        // A uniform object is lighter or darker than the background on both sides: the sign of the difference separates the two.
        let [a, b] = &self.pictures;
        let signs = [true, false].map(|lighter| -> Vec<bool> {
            self.changed.iter().zip(a).zip(b).map(|((changed, a), b)| *changed && (a > b) == lighter).collect()
        });
        let evenness = |part: &BBox| {
            let [one, other] = signs.each_ref().map(|marks| self.pixels(part).filter(|k| marks[*k]).count() as f64);
            (one - other) / (one + other)
        };
        let opposite = |part: &BBox| {
            let all = whole.union(part);
            let (x, y) = (all.w - whole.w - part.w, all.h - whole.h - part.h);
            let (gap, across, side) = if x > y { (x, -y, whole.h.max(part.h)) } else { (y, -x, whole.w.max(part.w)) };
            2.0 * across > side && gap <= side && evenness(&whole) * evenness(part) < -0.5
        };
        let mut others = parts.iter().zip(&shares).filter(|(part, share)| both(**share) && opposite(part));
        let strip = others.next().map(|(part, _)| *part);
        let whole = strip.map_or(whole, |strip| whole.union(&strip));
        let [one, other] = signs.each_ref().map(|marks| Some((self.left(&whole, marks), self.bounds(&whole, marks)?)));
        let (Some(one), Some(other)) = (one, other) else { return whole };
        let ((left, from), (came, to)) = if one.0 >= other.0 { (one, other) } else { (other, one) };
        if strip.is_none() && left - came < APART {
            return whole;
        }
        let all = from.union(&to);
        let (x, w) = reach((all.x, all.w), (from.x, from.w), (to.x, to.w));
        let (y, h) = reach((all.y, all.h), (from.y, from.h), (to.y, to.h));
        BBox { x, y, w, h }
    }

    /// How much of the contrast at the edge of the marks in a box the first picture has, 0 to 1.
    fn left(&self, bbox: &BBox, marks: &[bool]) -> f64 {
        let mut sums = [0.0; 2];
        for at in self.pixels(bbox) {
            let right = Some(at + 1).filter(|right| right % self.width > 0);
            for beside in right.into_iter().chain([at + self.width]).filter(|k| marks.get(*k) == Some(&!marks[at])) {
                for (sum, picture) in sums.iter_mut().zip(&self.pictures) {
                    *sum += f64::from(picture[at].abs_diff(picture[beside]));
                }
            }
        }
        if sums == [0.0; 2] { 0.5 } else { sums[0] / (sums[0] + sums[1]) }
    }

    /// The box round the marks in a box.
    fn bounds(&self, bbox: &BBox, marks: &[bool]) -> Option<BBox> {
        let pixel = |k: usize| BBox::new((k % self.width) as f64, (k / self.width) as f64, 1.0, 1.0);
        self.pixels(bbox).filter(|k| marks[*k]).map(pixel).reduce(|all, pixel| all.union(&pixel))
    }

    fn pixels(&self, bbox: &BBox) -> impl Iterator<Item = usize> {
        let ([x, y, w, h], width) = ([bbox.x, bbox.y, bbox.w, bbox.h].map(|side| side as usize), self.width);
        (y..y + h).flat_map(move |y| (x..x + w).map(move |x| y * width + x))
    }
}

/// The old position of an object along a side of `all`, as start and length: the part that it left, or, if that is a
/// strip behind it, from there to the strip at the new position.
fn reach(all: (f64, f64), from: (f64, f64), to: (f64, f64)) -> (f64, f64) {
    if 2.0 * from.1 >= all.1 {
        return from;
    }
    let strip = 2.0 * to.1 <= all.1 + 1.0;
    match to.0 > from.0 {
        true if strip => (from.0, to.0 - from.0),
        false if strip => (to.0 + to.1, from.0 + from.1 - to.0 - to.1),
        _ => all,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;

    #[test]
    fn it_is_a_detector() {
        conformance::detector(&|| Box::<Motion>::default());
    }

    /// A block that is darker or lighter than its surroundings moves by less than its size, by about that, and by more.
    #[test]
    fn the_first_box_is_where_it_was() {
        let mut few = 0;
        for (inside, by) in
            [220u8, 20].into_iter().flat_map(|inside| [2isize, 3, 8, 16, 25, 40, 70].map(|by| (inside, by)))
        {
            for (dx, dy) in [(by, 0), (-by, 0), (0, by), (0, -by), (by, -by), (-by, by / 2)] {
                // Opening takes thin strips away, but for the corners where two meet.
                if dx * dy != 0 && by == 3 {
                    continue;
                }
                let picture = |x: isize, y: isize| {
                    let block = |k: isize| (x..x + 24).contains(&(k % 240)) && (y..y + 24).contains(&(k / 240));
                    let grey = |k: isize| if block(k) { inside } else { 90 + (k % 240 / 8) as u8 };
                    Image::new(240, 240, 1, (0..57_600).map(grey).collect()).expect("bytes")
                };
                let found = first_box(&picture(108, 108), &picture(108 + dx, 108 + dy), None).expect("it moved");
                let iou = found.iou(&BBox::new(108.0, 108.0, 24.0, 24.0));
                // The dilation makes a block of 28 pixels of 24, which is 0.73.
                few += usize::from(iou < 0.5);
            }
        }
        assert_eq!(few, 0);
    }

    /// A block stands where the background was learned, leaves, and another comes in while the camera darkens all.
    #[test]
    fn objects_that_left_become_background_and_exposure_is_no_motion() {
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
