//! The target's masks, beside its boxes: a second way to judge a track.

use std::path::Path;

use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;
use foveate_core::scene::Image;
use foveate_video::read_stack;

use super::Sequence;

/// The mask of the target in each frame, from one picture that has them below each other, first to last: a pixel is of the target where it
/// is not black.
#[derive(Debug)]
pub struct Masks {
    picture: Image,
    /// Height of one mask, pixels.
    height: usize,
}

impl Masks {
    /// Reads the masks of a video with this number of frames.
    ///
    /// # Errors
    /// The picture cannot be read, or its height is not a multiple of the number of frames.
    pub fn read(path: &Path, frames: usize) -> Result<Self> {
        let picture = read_stack(path)?;
        let height = picture.height() / frames.max(1);
        if height * frames != picture.height() || height == 0 {
            let problem =
                format!("expected {frames} masks of one height below each other, found {} rows", picture.height());
            return Err(Error::malformed(path, problem));
        }
        Ok(Self { picture, height })
    }

    /// Returns the rows of a frame's mask.
    fn rows(&self, frame: usize) -> impl Iterator<Item = &[u8]> {
        let width = self.picture.width();
        self.picture.plane(0).chunks_exact(width).skip(frame * self.height).take(self.height)
    }

    /// Returns the box around a frame's mask; `None` if the mask is empty.
    pub fn bounds(&self, frame: usize) -> Option<BBox> {
        let in_row = |(y, row): (usize, &[u8])| {
            let (left, right) = (row.iter().position(|v| *v > 0)?, row.iter().rposition(|v| *v > 0)?);
            Some([left, y, right + 1, y + 1])
        };
        let joined = |a: [usize; 4], b: [usize; 4]| [a[0].min(b[0]), a[1], a[2].max(b[2]), b[3]];
        let [x, y, right, bottom] = self.rows(frame).enumerate().filter_map(in_row).reduce(joined)?.map(|v| v as f64);
        Some(BBox { x, y, w: right - x, h: bottom - y })
    }

    /// Returns the IoU of a box with a frame's mask, 0 to 1, by the part of each pixel that the box covers.
    pub fn iou(&self, frame: usize, bbox: &BBox) -> f64 {
        let covered = |from: f64, size: f64, pixel: usize| {
            let pixel = pixel as f64;
            ((from + size).min(pixel + 1.0) - from.max(pixel)).max(0.0)
        };
        let (mut mask, mut both) = (0.0, 0.0);
        for (y, row) in self.rows(frame).enumerate() {
            let down = covered(bbox.y, bbox.h, y);
            for x in (0..row.len()).filter(|x| row[*x] > 0) {
                mask += 1.0;
                both += down * covered(bbox.x, bbox.w, x);
            }
        }
        both / (mask + bbox.w * bbox.h - both).max(f64::MIN_POSITIVE)
    }

    /// Returns the mean IoU of a track's boxes with the masks of a sequence and with the boxes around the masks, over the frames after the
    /// first that have a mask and a true box; `None` without masks. A frame without a box counts as 0.
    ///
    /// # Errors
    /// The masks cannot be read.
    pub fn judge(sequence: &Sequence, boxes: &[Option<BBox>]) -> Result<Option<[f64; 2]>> {
        let Some(path) = &sequence.masks else { return Ok(None) };
        let masks = Self::read(path, sequence.truth.len())?;
        let one = |i: usize| {
            let (around, _) = (masks.bounds(i)?, sequence.truth[i]?);
            Some(boxes[i].map_or([0.0; 2], |b| [masks.iou(i, &b), b.iou(&around)]))
        };
        let all: Vec<[f64; 2]> = (1..sequence.truth.len()).filter_map(one).collect();
        let mean = |k: usize| all.iter().map(|it| it[k]).sum::<f64>() / all.len() as f64;
        Ok((!all.is_empty()).then(|| [mean(0), mean(1)]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_video::encode_png;

    #[test]
    fn boxes_against_masks_by_hand() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("mask.png");
        // Three masks of 6 x 4: nothing, an L of 5 pixels in a box of 2 x 4 at (1, 0), and the same.
        let mut picture = Image::grey(6, 12, 0);
        for (x, y) in [(1, 0), (1, 1), (1, 2), (1, 3), (2, 3)] {
            (1..3).for_each(|frame| picture.plane_mut(0)[(4 * frame + y) * 6 + x] = 255);
        }
        std::fs::write(&path, encode_png(&picture)).expect("written");
        let around = BBox { x: 1.0, y: 0.0, w: 2.0, h: 4.0 };
        let masks = Masks::read(&path, 3).expect("three");
        assert_eq!((masks.bounds(0), masks.bounds(1)), (None, Some(around)));
        assert_eq!(masks.iou(1, &around), 5.0 / 8.0);
        // Half of the left column's lower half: two halves of a pixel.
        let part = BBox { x: 0.5, y: 2.0, w: 1.0, h: 2.0 };
        assert!((masks.iou(2, &part) - 1.0 / (5.0 + 2.0 - 1.0)).abs() < 1e-12);
        let sequence = Sequence { masks: Some(path.clone()), ..Sequence::named("s", vec![Some(around); 3]) };
        let judged = Masks::judge(&sequence, &[None, Some(around), None]).expect("read");
        assert_eq!(judged, Some([0.5 * 5.0 / 8.0, 0.5]));
        assert_eq!(Masks::judge(&Sequence { masks: None, ..sequence }, &[]).expect("none"), None);
        let problem = Masks::read(&path, 5).expect_err("12 rows are no 5 masks").to_string();
        assert!(problem.contains("expected 5 masks"), "{problem}");
    }
}
