//! Means over boxes around every pixel of a region: the levels of the pyramid that glimpses are read from.
//!
//! Sums of columns slide down the image, adding the row that enters the box and subtracting the one that leaves;
//! sums of 1, 2, 4, … neighbouring columns give those of any width. All sums are of whole numbers and exact, so
//! the time grows with the logarithm of the width and not with the height, and only the last step rounds.

use crate::Plane;
use crate::level::{Level, levels};

/// A plane of an 8-bit image, row after row.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a> {
    /// `width` × `height` values.
    pub data: &'a [u8],
    /// Pixels in a row, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
}

/// The pixels (x, y) to (x + width, y + height), not included, of an image; they may lie outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x: i32,
    /// First row.
    pub y: i32,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// Room for the sums of [`box_means`], to be used again.
#[derive(Clone, Debug, Default)]
pub struct BoxScratch {
    narrow: Vec<u16>,
    wide: Vec<u32>,
}

/// `out` (`region.height` × `region.width`) ← means in [0, 1] over boxes of `size` = (width, height) pixels of
/// `image`, with repeated border pixels outside. Returns `out` with its position.
///
/// The box of pixel (x, y) begins at (x - (width - 1) / 2, y - (height - 1) / 2), rounded down: an even box has its middle
/// half a pixel on, and so has the plane. Exact but for the rounding of the result, 1.2e-7 relative. Allocates only
/// when `scratch` has not been used for as wide a region and box before.
///
/// # Panics
/// If the image is empty or its data are not `width` × `height`, a side of the box is 0, the box has more than 2^23 pixels,
/// `out` has not the region's size, or the region or the image reach beyond ± 2^30.
pub fn box_means<'a>(
    image: Pixels<'_>,
    size: (usize, usize),
    region: Region,
    scratch: &mut BoxScratch,
    out: &'a mut [f32],
) -> Plane<'a> {
    let ((width, height), limit) = (size, 1 << 30);
    assert!(image.width > 0 && image.height > 0, "an empty image");
    assert_eq!(image.data.len(), image.width * image.height, "the image must be {} x {}", image.width, image.height);
    assert!(image.width < limit && image.height < limit, "the image is too large");
    assert!(width > 0 && height > 0 && width.saturating_mul(height) <= 1 << 23, "a box of {width} x {height}");
    assert!(region.width < limit && region.height < limit, "the region is too large");
    assert!(
        region.x.unsigned_abs() < limit as u32 && region.y.unsigned_abs() < limit as u32,
        "the region is too far away"
    );
    assert_eq!(out.len(), region.width * region.height, "out must be {} x {}", region.width, region.height);
    if !out.is_empty() {
        // 16 bits hold the sum of 257 pixels, and are twice as fast.
        if width * height <= 257 {
            means_narrow_at(Level::best(), image, size, region, &mut scratch.narrow, out);
        } else {
            means_wide_at(Level::best(), image, size, region, &mut scratch.wide, out);
        }
    }
    let middle = |first: i32, side: usize| first as f32 + if side.is_multiple_of(2) { 0.5 } else { 0.0 };
    let (x0, y0) = (middle(region.x, width), middle(region.y, height));
    Plane { data: out, width: region.width, height: region.height, stride: region.width, x0, y0 }
}

/// Whole numbers that hold a sum of pixels.
trait Sum: Copy + Default {
    fn of(pixel: u8) -> Self;
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    fn to_f32(self) -> f32;
}

macro_rules! sums {
    ($($sum:ident)*) => {$(
        impl Sum for $sum {
            #[inline(always)]
            fn of(pixel: u8) -> Self {
                pixel.into()
            }
            #[inline(always)]
            fn plus(self, other: Self) -> Self {
                self.wrapping_add(other)
            }
            #[inline(always)]
            fn minus(self, other: Self) -> Self {
                self.wrapping_sub(other)
            }
            #[inline(always)]
            fn to_f32(self) -> f32 {
                // Below 2^31, where the conversion of signed numbers, which more processors have, gives the same.
                self as i32 as f32
            }
        }
    )*};
}

sums!(u16 u32);

levels! {
    fn means_narrow_at (
        image: Pixels<'_>, size: (usize, usize), region: Region, scratch: &mut Vec<u16>, out: &mut [f32]
    ) = means_u16
}

levels! {
    fn means_wide_at (
        image: Pixels<'_>, size: (usize, usize), region: Region, scratch: &mut Vec<u32>, out: &mut [f32]
    ) = means_u32
}

#[inline(always)]
fn means_u16<const V: u8>(
    image: Pixels<'_>,
    size: (usize, usize),
    region: Region,
    scratch: &mut Vec<u16>,
    out: &mut [f32],
) {
    means(image, size, region, scratch, out);
}

#[inline(always)]
fn means_u32<const V: u8>(
    image: Pixels<'_>,
    size: (usize, usize),
    region: Region,
    scratch: &mut Vec<u32>,
    out: &mut [f32],
) {
    means(image, size, region, scratch, out);
}

#[inline(always)]
fn means<S: Sum>(
    image: Pixels<'_>,
    (box_width, box_height): (usize, usize),
    region: Region,
    scratch: &mut Vec<S>,
    out: &mut [f32],
) {
    // Columns `left..left + reach` enter the boxes; those of the image among them are `inside`.
    let (left, top) = (region.x as i64 - (box_width as i64 - 1) / 2, region.y as i64 - (box_height as i64 - 1) / 2);
    let reach = region.width + box_width - 1;
    let column = |x: i64| x.clamp(0, image.width as i64 - 1) as usize;
    let inside = column(left)..column(left + reach as i64 - 1) + 1;
    let before = (inside.start as i64 - left).clamp(0, reach as i64 - 1) as usize;
    let row = |y: i64| &image.data[y.clamp(0, image.height as i64 - 1) as usize * image.width..][inside.clone()];

    if scratch.len() < 4 * reach {
        scratch.resize(4 * reach, S::default());
    }
    let (sums, room) = scratch[..4 * reach].split_at_mut(reach);
    let scale = 1.0 / (255.0 * (box_width * box_height) as f32);

    sums.fill(S::default());
    for y in 0..box_height as i64 {
        for (sum, &pixel) in sums[before..].iter_mut().zip(row(top + y)) {
            *sum = sum.plus(S::of(pixel));
        }
    }
    for (y, out) in (top..).zip(out.chunks_exact_mut(region.width)) {
        if y > top {
            let (enters, leaves) = (row(y + box_height as i64 - 1), row(y - 1));
            for ((sum, &enters), &leaves) in sums[before..].iter_mut().zip(enters).zip(leaves) {
                *sum = sum.plus(S::of(enters)).minus(S::of(leaves));
            }
        }
        let after = before + inside.len();
        let (first, last) = (sums[before], sums[after - 1]);
        sums[..before].fill(first);
        sums[after..].fill(last);
        mean_columns(box_width, sums, room, scale, out);
    }
}

/// `out[i]` ← `scale` × the sum of `columns[i..i + width]`. `room` is three times as long as `columns`.
#[inline(always)]
fn mean_columns<S: Sum>(width: usize, columns: &[S], room: &mut [S], scale: f32, out: &mut [f32]) {
    let write = |out: &mut [f32], a: &[S], b: &[S]| {
        for ((out, &a), &b) in out.iter_mut().zip(a).zip(b) {
            *out = a.plus(b).to_f32() * scale;
        }
    };
    if width == 1 {
        for (out, &sum) in out.iter_mut().zip(columns) {
            *out = sum.to_f32() * scale;
        }
        return;
    }
    // The width is `most` + `rest`: sums of `power` columns, doubled until `most`, and those of `rest` on the way.
    let most = 1 << width.ilog2();
    let rest = width - most;
    let (mut now, room) = room.split_at_mut(columns.len());
    let (mut next, rests) = room.split_at_mut(columns.len());
    let (mut power, mut rests_hold) = (1, 0);
    while power < if rest > 0 { most } else { most / 2 } {
        let from = if power == 1 { columns } else { &*now };
        if rest & power != 0 && rest > 1 {
            for (sum, &from) in rests.iter_mut().zip(&from[rests_hold..]) {
                *sum = if rests_hold == 0 { from } else { sum.plus(from) };
            }
            rests_hold += power;
        }
        for ((sum, &a), &b) in next.iter_mut().zip(from).zip(&from[power..]) {
            *sum = a.plus(b);
        }
        std::mem::swap(&mut now, &mut next);
        power *= 2;
    }
    match (rest, power) {
        (0, 1) => write(out, columns, &columns[1..]),
        (0, _) => write(out, now, &now[power..]),
        (1, _) => write(out, columns, &now[1..]),
        _ => write(out, rests, &now[rest..]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sums::tests::values;

    /// The mean of one box, pixel by pixel.
    fn twin(image: Pixels<'_>, (w, h): (usize, usize), x: i64, y: i64) -> f64 {
        let (x, y) = (x - (w as i64 - 1) / 2, y - (h as i64 - 1) / 2);
        let at = |x: i64, y: i64| {
            let (x, y) = (x.clamp(0, image.width as i64 - 1), y.clamp(0, image.height as i64 - 1));
            image.data[y as usize * image.width + x as usize] as f64
        };
        let sum: f64 =
            (y..y + h as i64).flat_map(|y| (x..x + w as i64).map(move |x| (x, y))).map(|(x, y)| at(x, y)).sum();
        sum / (255 * w * h) as f64
    }

    fn means_at(level: Level, image: Pixels<'_>, size: (usize, usize), region: Region, wide: bool) -> Vec<f32> {
        let mut out = vec![f32::NAN; region.width * region.height];
        if wide {
            means_wide_at(level, image, size, region, &mut vec![7; 3], &mut out);
        } else {
            means_narrow_at(level, image, size, region, &mut vec![7; 3], &mut out);
        }
        out
    }

    #[test]
    fn agree_with_the_twin() {
        let data: Vec<u8> = values(37 * 23, 1).iter().map(|x| (x * 256.0) as u8).collect();
        for image in [Pixels { data: &data, width: 37, height: 23 }, Pixels { data: &data[..9], width: 9, height: 1 }] {
            let sizes = (1..=17).map(|w| (w, 18 - w)).chain([(1, 1), (1, 257), (40, 60), (64, 3), (31, 33)]);
            for size in sizes {
                for region in [(0, 0, 37, 23), (5, 7, 20, 9), (-10, -11, 60, 50), (100, 50, 3, 4), (-90, -70, 18, 2)] {
                    let region = Region { x: region.0, y: region.1, width: region.2, height: region.3 };
                    for (level, wide) in Level::all().flat_map(|l| [(l, true), (l, false)]) {
                        if !wide && size.0 * size.1 > 257 {
                            continue;
                        }
                        let out = means_at(level, image, size, region, wide);
                        for (i, &mean) in out.iter().enumerate() {
                            let (x, y) = (
                                region.x as i64 + (i % region.width) as i64,
                                region.y as i64 + (i / region.width) as i64,
                            );
                            let truth = twin(image, size, x, y);
                            assert!(
                                (mean as f64 - truth).abs() <= 1.3e-7 * truth,
                                "{level:?} {size:?}: {mean} is not {truth}"
                            );
                        }
                    }
                }
            }
        }
    }

    /// The middle of an even box is half a pixel on: a ramp, read at whole places through the plane, stays a ramp.
    #[test]
    fn planes_lie_where_their_boxes_do() {
        let data: Vec<u8> = (0..80 * 60).map(|i| (i % 80 + 2 * (i / 80)) as u8).collect();
        let (image, region) =
            (Pixels { data: &data, width: 80, height: 60 }, Region { x: 20, y: 20, width: 30, height: 20 });
        let (mut scratch, mut out) = (BoxScratch::default(), vec![0.0; 600]);
        for size in [(1, 1), (2, 3), (3, 2), (6, 6), (8, 5)] {
            let plane = box_means(image, size, region, &mut scratch, &mut out);
            let mut read = [0.0; 3];
            crate::taps(plane, [30.0, 30.0, 1.0, 0.0, 0.0, 1.0], &[0.0, 1.5, -3.25], &[0.0, 2.25, 4.0], &mut read);
            for (read, truth) in read.iter().zip([90.0, 96.0, 94.75]) {
                assert!((read * 255.0 - truth).abs() < 1e-4, "{size:?}: {} is not {truth}", read * 255.0);
            }
        }
    }

    #[test]
    fn white_is_one_and_extremes_fit() {
        let data = [255; 300 * 3];
        let image = Pixels { data: &data, width: 300, height: 3 };
        let mut scratch = BoxScratch::default();
        for size in [(257, 1), (1, 257), (258, 1), (2048, 4096)] {
            let mut out = [0.0; 12];
            box_means(image, size, Region { x: 1, y: 0, width: 4, height: 3 }, &mut scratch, &mut out);
            assert!(out.iter().all(|x| (x - 1.0).abs() < 2e-7), "{size:?}: {out:?}");
        }
        box_means(image, (3, 3), Region { x: 0, y: 0, width: 0, height: 3 }, &mut scratch, &mut []);
    }
}
