//! Some frames of a source: from one on, every so many, made smaller.

use crate::{Frame, FrameSource, Interrupt, Remarks, SourceInfo};
use foveate_base::Result;
use foveate_core::scene::Image;

/// Which frames of a video, and how large.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Selection {
    /// The first frame, counted from 0.
    pub from: usize,
    /// Every so many frames from there on; 1 takes all.
    pub every: usize,
    /// Sides of the pictures relative to the video's: above 0, at most 1.
    pub scale: f64,
}

impl Default for Selection {
    /// All frames as they are.
    fn default() -> Self {
        Self { from: 0, every: 1, scale: 1.0 }
    }
}

impl Selection {
    /// Whether a frame (from 0) is taken.
    pub fn takes(&self, index: usize) -> bool {
        index.checked_sub(self.from).is_some_and(|after| after.is_multiple_of(self.every.max(1)))
    }

    fn side(&self, side: usize) -> usize {
        ((side as f64 * self.scale).round() as usize).clamp(1, side.max(1))
    }
}

/// The frames selected. They keep the numbers and times that they have in the video.
pub fn select(source: Box<dyn FrameSource>, selection: Selection) -> Box<dyn FrameSource> {
    if selection == Selection::default() {
        return source;
    }
    let about = source.info().clone();
    let (width, height) = (selection.side(about.width), selection.side(about.height));
    let rate = about.rate / selection.every.max(1) as f64;
    Box::new(Selected { info: SourceInfo { width, height, rate, ..about }, source, selection })
}

struct Selected {
    info: SourceInfo,
    source: Box<dyn FrameSource>,
    selection: Selection,
}

impl Iterator for Selected {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            match self.source.next()? {
                Ok(frame) if !self.selection.takes(frame.index) => (),
                Ok(frame) => return Some(Ok(Frame { image: self.shrunk(frame.image), ..frame })),
                Err(error) => return Some(Err(error)),
            }
        }
    }
}

impl Selected {
    /// Each pixel is the mean over its area.
    fn shrunk(&self, image: Image) -> Image {
        let (width, height) = (self.selection.side(image.width()), self.selection.side(image.height()));
        if (width, height) == (image.width(), image.height()) {
            return image;
        }
        let (across, down) = (shares(image.width(), width), shares(image.height(), height));
        let mut data = Vec::with_capacity(width * height * image.planes());
        for p in 0..image.planes() {
            let plane = image.plane(p);
            for (top, rows) in &down {
                for (left, columns) in &across {
                    let sum: f32 = (*top..)
                        .zip(rows)
                        .map(|(y, row)| {
                            let line = &plane[y * image.width() + left..][..columns.len()];
                            row * line.iter().zip(columns).map(|(&byte, column)| f32::from(byte) * column).sum::<f32>()
                        })
                        .sum();
                    data.push((sum + 0.5) as u8);
                }
            }
        }
        Image::new(width, height, image.planes(), data).expect("as many pixels as were made")
    }
}

/// For each of `to` cells over `from` pixels, the first pixel that it covers and the share of each; shares sum to 1.
fn shares(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    let step = from as f64 / to as f64;
    let cell = |i: usize| {
        let (begin, end) = (i as f64 * step, ((i + 1) as f64 * step).min(from as f64));
        let first = begin as usize;
        let last = (end.ceil() as usize).clamp(first + 1, from);
        let share = |x: usize| ((end.min((x + 1) as f64) - begin.max(x as f64)).max(0.0) / (end - begin)) as f32;
        (first, (first..last).map(share).collect())
    };
    (0..to).map(cell).collect()
}

impl FrameSource for Selected {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
    fn interrupt(&self) -> Option<Interrupt> {
        self.source.interrupt()
    }
    fn remarks(&self) -> Remarks {
        self.source.remarks()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ImageFolder, save_png};

    #[test]
    fn frames_keep_their_numbers_and_are_means_of_areas() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        for i in 0..9u8 {
            let image = Image::new(4, 2, 1, vec![i, i + 2, 10, 20, i, i + 2, 30, 40]).expect("sizes agree");
            save_png(dir.path().join(format!("{i}.png")), &image).expect("a writable folder");
        }
        let open = || Box::new(ImageFolder::open(dir.path()).expect("a folder of images"));
        let source = select(open(), Selection { from: 2, every: 3, scale: 0.5 });
        let info = source.info().clone();
        assert_eq!((info.width, info.height, info.rate, info.frames), (2, 1, 10.0, Some(9)));
        let frames: Vec<Frame> = source.map(|frame| frame.expect("a frame")).collect();
        assert_eq!(frames.iter().map(|f| f.index).collect::<Vec<_>>(), [2, 5, 8]);
        assert_eq!(frames[1].image, Image::new(2, 1, 1, vec![6, 25]).expect("sizes agree"));
        assert_eq!(select(open(), Selection::default()).count(), 9);
        assert!(!Selection { from: 2, every: 3, scale: 1.0 }.takes(1));
    }

    #[test]
    fn shares_cover_every_pixel_once() {
        for (from, to) in [(7, 3), (100, 99), (1920, 640), (5, 1), (4, 4), (1, 1), (997, 313)] {
            let mut covered = vec![0.0; from];
            for (first, shares) in shares(from, to) {
                assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5);
                shares.iter().enumerate().for_each(|(i, share)| covered[first + i] += f64::from(*share));
            }
            let even = to as f64 / from as f64;
            assert!(covered.iter().all(|c| (c - even).abs() < 1e-4), "{from} to {to}");
        }
    }
}
