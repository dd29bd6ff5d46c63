//! Videos whose target vanishes and comes back: real ones, changed so that the truth is still known.
//!
//! *Behind*: the surroundings of the target are mirrored over it, frame by frame, as if a thing of the background's texture
//! stood before it. *Away*: the camera looks elsewhere, so that the target leaves the picture at the nearer side, and looks
//! back. *Elsewhere*: the same, and afterwards the camera points to another place than before, so that the target is back
//! somewhere else in the picture. Beyond the old picture's edge a moved camera sees the mirrored picture with the
//! target covered: a second target there would rightly be found.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use foveate_base::rng::Streams;
use foveate_base::{Error, Result};
use foveate_core::geometry::{BBox, Size};
use foveate_core::scene::Image;

/// How a target vanishes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Way {
    /// Something of the background's texture covers it.
    Behind,
    /// The camera looks elsewhere, and back.
    Away,
    /// The camera looks elsewhere, and then not quite back.
    Elsewhere,
}

/// All ways.
pub const WAYS: [Way; 3] = [Way::Behind, Way::Away, Way::Elsewhere];

/// Which frames are changed, and how.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hide {
    /// How it vanishes.
    pub way: Way,
    /// The first frame without the target, counted from 0.
    pub from: usize,
    /// The first frame with it again.
    pub until: usize,
    /// How far the camera looks aside from then on, pixels; 0 but for [`Way::Elsewhere`].
    pub aside: (isize, isize),
}

/// Margin around the target that is covered as well, as a share of its sides.
const MARGIN: f64 = 0.25;
/// Frames that are left before and after.
const BEFORE: usize = 15;
const AFTER: usize = 30;

impl Hide {
    /// Chooses when, for how long (`least` to `most` frames, fewer where the video is short), and whereto; by the seed.
    ///
    /// # Errors
    /// The video is shorter than 15 frames before, `least` and 30 after, or the target is absent near the cut.
    pub fn choose(
        way: Way,
        truth: &[Option<BBox>],
        size: Size,
        (least, most): (usize, usize),
        seed: u64,
    ) -> Result<Self> {
        let mut rng = Streams::new(seed, way as u64).rng(0);
        let room = truth.len().saturating_sub(BEFORE + AFTER);
        if least == 0 || room < least {
            let problem = format!(
                "a target that vanishes for {least} frames needs a video of {BEFORE} more before and {AFTER} after; this one has {}",
                truth.len()
            );
            return Err(Error::Invalid(problem));
        }
        let hidden = rng.random_range(least..=most.max(least).min(room));
        let from = BEFORE + rng.random_range(0..=room - hidden);
        let until = from + hidden;
        let Some(there) = truth[until] else {
            return Err(Error::Invalid(format!(
                "the target is absent in frame {}, where it should be back",
                until + 1
            )));
        };
        // Anywhere in the picture with the whole target, at least two of its sizes from where it would have been.
        let mut aside = (0, 0);
        if way == Way::Elsewhere {
            let free = |side: usize, length: f64| (side as f64 - length - 2.0).max(1.0);
            for _ in 0..100 {
                let (x, y) =
                    (rng.random::<f64>() * free(size.width, there.w), rng.random::<f64>() * free(size.height, there.h));
                aside = ((x - there.x) as isize, (y - there.y) as isize);
                if (x - there.x).hypot(y - there.y) > 2.0 * (there.w * there.h).sqrt() {
                    break;
                }
            }
        }
        Ok(Self { way, from, until, aside })
    }

    /// Whether the target is out of sight in this frame.
    pub fn hides(&self, index: usize) -> bool {
        (self.from..self.until).contains(&index)
    }

    /// Where the target truly is then; `None` while it is out of sight, or where it is anyway.
    pub fn truth(&self, index: usize, truth: Option<BBox>) -> Option<BBox> {
        let (dx, dy) = if index >= self.until { self.aside } else { (0, 0) };
        truth.filter(|_| !self.hides(index)).map(|b| BBox { x: b.x + dx as f64, y: b.y + dy as f64, ..b })
    }

    /// The frame as it is seen then.
    pub fn apply(&self, index: usize, image: &Image, truth: Option<BBox>) -> Image {
        match (self.hides(index), self.way, truth) {
            (false, _, _) if index >= self.until && self.aside != (0, 0) => shifted(image, truth, self.aside),
            (true, Way::Behind, Some(b)) => covered(image, &b),
            (true, Way::Away | Way::Elsewhere, Some(b)) => {
                // Out at the side that takes the smaller shift.
                let (w, h) = (image.width() as f64, image.height() as f64);
                let ways = [(-(b.x + b.w), 0.0), (w - b.x, 0.0), (0.0, -(b.y + b.h)), (0.0, h - b.y)];
                let near = |a: &(f64, f64)| a.0.abs() + a.1.abs();
                let least = ways.iter().copied().min_by(|a, b| near(a).total_cmp(&near(b))).expect("four ways");
                let whole = |v: f64| (v + 2.0 * v.signum() * f64::from(u8::from(v != 0.0))) as isize;
                shifted(image, truth, (whole(least.0), whole(least.1)))
            }
            _ => image.clone(),
        }
    }
}

/// The picture moved by whole pixels; empty parts mirrored without the target.
fn shifted(image: &Image, target: Option<BBox>, (dx, dy): (isize, isize)) -> Image {
    let (w, h) = (image.width(), image.height());
    let beyond = target.map_or_else(|| image.clone(), |target| covered(image, &target));
    let columns: Vec<(usize, bool)> = (0..w)
        .map(|x| {
            let x = x as isize - dx;
            (mirrored(x, w), (0..w as isize).contains(&x))
        })
        .collect();
    let mut out = image.clone();
    for p in 0..image.planes() {
        for (y, row) in out.plane_mut(p).chunks_exact_mut(w).enumerate() {
            let y = y as isize - dy;
            let (inside, at) = ((0..h as isize).contains(&y), mirrored(y, h) * w);
            let (here, beyond) = (&image.plane(p)[at..][..w], &beyond.plane(p)[at..][..w]);
            for (out, &(x, within)) in row.iter_mut().zip(&columns) {
                *out = if inside && within { here[x] } else { beyond[x] };
            }
        }
    }
    out
}

/// An index of 0 to n − 1, mirrored at both ends as often as needed.
fn mirrored(i: isize, n: usize) -> usize {
    let n = n as isize;
    let i = i.rem_euclid(2 * n);
    (if i < n { i } else { 2 * n - 1 - i }) as usize
}

/// The picture with a box, and a margin, covered by its surroundings: mirrored at the box's left or right side, whichever
/// has more room, over and over where there is little.
fn covered(image: &Image, b: &BBox) -> Image {
    let (w, h) = (image.width() as isize, image.height() as isize);
    let (mx, my) = (MARGIN * b.w, MARGIN * b.h);
    let left = ((b.x - mx).floor() as isize).clamp(0, w);
    let right = ((b.x + b.w + mx).ceil() as isize).clamp(left, w);
    let top = ((b.y - my).floor() as isize).clamp(0, h);
    let bottom = ((b.y + b.h + my).ceil() as isize).clamp(top, h);
    let mut out = image.clone();
    let (rooms, after) = ((left, w - right), w - right >= left);
    let room = if after { rooms.1 } else { rooms.0 };
    if room == 0 {
        return out;
    }
    let source = |x: isize| {
        let depth = if after { right - 1 - x } else { x - left };
        let depth = mirrored(depth, room as usize) as isize;
        (if after { right + depth } else { left - 1 - depth }) as usize
    };
    let columns: Vec<usize> = (left..right).map(source).collect();
    for p in 0..image.planes() {
        for y in top..bottom {
            let row = &image.plane(p)[(y * w) as usize..][..w as usize];
            let line = &mut out.plane_mut(p)[(y * w) as usize..][left as usize..right as usize];
            line.iter_mut().zip(&columns).for_each(|(out, &x)| *out = row[x]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size::new(80, 60);

    /// A gradient with a white target, and where it is.
    fn scene() -> (Image, BBox) {
        let mut image = Image::grey(SIZE.width, SIZE.height, 0);
        let b = BBox { x: 50.0, y: 20.0, w: 10.0, h: 12.0 };
        for (i, value) in image.plane_mut(0).iter_mut().enumerate() {
            let (x, y) = (i % SIZE.width, i / SIZE.width);
            let inside = (50..60).contains(&x) && (20..32).contains(&y);
            *value = if inside { 255 } else { (x + y) as u8 };
        }
        (image, b)
    }

    fn white(image: &Image) -> Vec<(usize, usize)> {
        let found = image.plane(0).iter().enumerate().filter(|(_, v)| **v == 255);
        found.map(|(i, _)| (i % image.width(), i / image.width())).collect()
    }

    #[test]
    fn the_target_disappears_and_returns_at_its_true_box() {
        let (image, b) = scene();
        let truth = vec![Some(b); 120];
        for (way, seed) in WAYS.iter().flat_map(|way| (0..20).map(move |seed| (*way, seed))) {
            let hide = Hide::choose(way, &truth, SIZE, (30, 90), seed).expect("long enough");
            assert!(hide.from >= BEFORE && hide.until - hide.from >= 30 && hide.until + AFTER <= 120, "{hide:?}");
            for t in [0, hide.from - 1, hide.from, hide.until - 1, hide.until, 119] {
                let (seen, truth) = (hide.apply(t, &image, Some(b)), hide.truth(t, Some(b)));
                let Some(at) = truth else {
                    assert!(hide.hides(t) && white(&seen).is_empty(), "{hide:?}, frame {t}");
                    continue;
                };
                let inside = |&&(x, y): &&(usize, usize)| {
                    let (x, y) = (x as f64, y as f64);
                    x >= at.x && x < at.x + at.w && y >= at.y && y < at.y + at.h
                };
                assert_eq!(white(&seen).iter().filter(inside).count(), 120, "{hide:?}, frame {t}");
                assert_eq!(white(&seen).len(), 120, "there is one target: {hide:?}, frame {t}");
                assert!(at.x >= 0.0 && at.y >= 0.0 && at.x + at.w <= 80.0 && at.y + at.h <= 60.0);
                let moved = (at.x - b.x).hypot(at.y - b.y);
                assert!(if way == Way::Elsewhere && t >= hide.until { moved > 20.0 } else { moved == 0.0 });
            }
        }
    }

    #[test]
    fn short_videos_and_absent_targets_are_refused() {
        let (_, b) = scene();
        let problem = Hide::choose(Way::Away, &[Some(b); 60], SIZE, (30, 90), 1).expect_err("too short").to_string();
        assert!(problem.contains("30 frames") && problem.contains("has 60"), "{problem}");
        assert!(Hide::choose(Way::Away, &[None; 120], SIZE, (30, 90), 1).is_err());
    }

    #[test]
    fn pictures_without_room_stay_as_they_are() {
        let (image, _) = scene();
        let whole = BBox { x: -10.0, y: -10.0, w: 100.0, h: 80.0 };
        assert_eq!(covered(&image, &whole), image);
        assert_eq!((mirrored(-1, 5), mirrored(5, 5), mirrored(9, 5), mirrored(10, 5)), (0, 4, 0, 0));
    }
}
