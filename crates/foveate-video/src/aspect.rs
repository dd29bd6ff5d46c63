//! Pixels that are not square (DV, DVD, surveillance): pictures as players show them.

use crate::decode::MAX_SIDE;
use foveate_base::{Error, Result, memory};
use foveate_core::geometry::Size;
use foveate_core::scene::Image;

/// The width of a pixel over its height, in lowest terms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Aspect {
    across: u32,
    down: u32,
}

/// The most that one side of a pixel is longer than the other; a file that states more is damaged. Real ones stay below 3.
const MOST: u32 = 16;

impl Default for Aspect {
    fn default() -> Self {
        Self { across: 1, down: 1 }
    }
}

impl Aspect {
    /// `None` if a side is 0, which means "unknown" in files, or if the ratio is implausible.
    pub(crate) fn new(across: u32, down: u32) -> Option<Self> {
        let (mut n, mut rest) = (across, down);
        while rest > 0 {
            (n, rest) = (rest, n % rest);
        }
        let sensible = across > 0 && down > 0 && across.div_ceil(down).max(down.div_ceil(across)) <= MOST;
        sensible.then(|| Self { across: across / n, down: down / n })
    }

    /// The size of a picture of so many stored pixels as players show it: one of them grows, so that no pixel is lost.
    pub(crate) fn shown(self, Size { width, height }: Size) -> Size {
        let grown = |side: usize, by: u32, over: u32| {
            ((side as u64 * u64::from(by) + u64::from(over) / 2) / u64::from(over)) as usize
        };
        match self.across >= self.down {
            true => Size::new(grown(width, self.across, self.down), height),
            false => Size::new(width, grown(height, self.down, self.across)),
        }
    }

    /// A picture of stored pixels in square pixels, interpolated linearly. One of square pixels stays as it is.
    ///
    /// # Errors
    /// The picture would be larger than [`MAX_SIDE`], or take more memory than there may be.
    pub(crate) fn square(self, image: Image) -> Result<Image> {
        let size @ Size { width, height } = self.shown(image.size());
        if size == image.size() {
            return Ok(image);
        }
        if width.max(height) > MAX_SIDE {
            return Err(Error::Invalid(format!(
                "expected sides up to {MAX_SIDE} pixels, found {size} in square pixels; make the video smaller"
            )));
        }
        memory::check_picture(width, height)?;
        let (stored, mut data) = (image.width(), Vec::with_capacity(width * height * image.planes()));
        let (columns, rows) = (weights(stored, width), weights(image.height(), height));
        for p in 0..image.planes() {
            let plane = image.plane(p);
            for &(y, by) in &rows {
                let line = &plane[y * stored..][..stored];
                // Only one side grows: either the columns are those of the picture, or the rows.
                if width != stored {
                    data.extend(columns.iter().map(|&(x, by)| between(line[x], line[(x + 1).min(stored - 1)], by)));
                } else {
                    let below = &plane[(y + 1).min(image.height() - 1) * stored..][..stored];
                    data.extend(line.iter().zip(below).map(|(&a, &b)| between(a, b, by)));
                }
            }
        }
        Image::new(width, height, image.planes(), data)
    }
}

/// For each of `to` pixels over the length of `from`, the stored pixel before its centre, and the weight of the one after it, of 256.
fn weights(from: usize, to: usize) -> Vec<(usize, u32)> {
    let last = (from - 1) as f64;
    let at = |i: usize| ((i as f64 + 0.5) * from as f64 / to as f64 - 0.5).clamp(0.0, last);
    (0..to).map(|i| (at(i) as usize, (at(i).fract() * 256.0).round() as u32)).collect()
}

fn between(a: u8, b: u8, by: u32) -> u8 {
    ((u32::from(a) * (256 - by) + u32::from(b) * by + 128) >> 8) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(across: u32, down: u32) -> Aspect {
        Aspect::new(across, down).expect("a sensible ratio")
    }

    /// Sizes that players show: PAL and NTSC of DVD and DV, HDV.
    #[test]
    fn one_side_grows() {
        for ((across, down), stored, shown) in [
            ((64, 45), (720, 576), (1024, 576)),
            ((16, 15), (720, 576), (768, 576)),
            ((8, 9), (720, 480), (720, 540)),
            ((32, 27), (720, 480), (853, 480)),
            ((4, 3), (1440, 1080), (1920, 1080)),
            ((10, 11), (704, 480), (704, 528)),
            ((7, 7), (5, 3), (5, 3)),
        ] {
            assert_eq!(of(across, down).shown(stored.into()), shown.into(), "{across}:{down}");
        }
        assert_eq!(of(40, 30), of(4, 3));
        assert!([(0, 1), (1, 0), (17, 1), (1, 17), (u32::MAX, 1)].iter().all(|&(a, b)| Aspect::new(a, b).is_none()));
    }

    /// A ramp stays the ramp, at the places that the stored pixels have in the wider picture.
    #[test]
    fn a_ramp_stays_a_ramp() {
        let ramp = Image::new(20, 2, 1, (0..40).map(|i| (i % 20 * 12) as u8).collect()).expect("sizes agree");
        let wide = of(2, 1).square(ramp.clone()).expect("small");
        assert_eq!(wide.size(), Size::new(40, 2));
        for x in 1..39 {
            let wanted = 12.0 * ((x as f64 + 0.5) / 2.0 - 0.5);
            assert!((f64::from(wide.at(0, x, 1)) - wanted).abs() <= 0.5, "{x}: {}", wide.at(0, x, 1));
        }
        let tall = Image::new(2, 20, 3, (0..120).map(|i| (i % 40 / 2 * 12) as u8).collect()).expect("sizes agree");
        let tall = of(1, 2).square(tall).expect("small");
        assert_eq!((tall.width(), tall.height(), tall.planes()), (2, 40, 3));
        for y in 1..39 {
            let wanted = 12.0 * ((y as f64 + 0.5) / 2.0 - 0.5);
            assert!((f64::from(tall.at(2, 1, y)) - wanted).abs() <= 0.5, "{y}: {}", tall.at(2, 1, y));
        }
        assert_eq!(Aspect::default().square(ramp.clone()).expect("as it was"), ramp);
        let error = of(16, 1).square(Image::grey(2000, 2, 0)).expect_err("32000 pixels").to_string();
        assert!(error.contains("32000 x 2"), "{error}");
    }
}
