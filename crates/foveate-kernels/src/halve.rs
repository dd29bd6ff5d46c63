//! Pictures of intensity, and the same at half the size: the pyramids of optical flow and saliency.

use crate::colour::assert_one_size;
use crate::level::levels;

levels! {
    /// `out` ← (r + g + b) / 765: the mean of three planes of bytes, as 0 to 1.
    ///
    /// # Panics
    /// If the planes and `out` differ in length.
    pub fn intensity / intensity_at (planes: [&[u8]; 3], out: &mut [f32]) = intensity_body
}

levels! {
    /// `out` ← a plane of `width` columns at half the resolution: [1 3 3 1] / 8 across and down, then every second one; the
    /// plane's border is repeated outside. `across` (as many rows as the plane, of half as many columns) is room.
    ///
    /// # Panics
    /// If `plane` is not whole rows of at least one value, or `across` and `out` are not `⌈width / 2⌉` × the rows, and × half of them, rounded up.
    pub fn halve / halve_at (plane: &[f32], width: usize, across: &mut [f32], out: &mut [f32]) = halve_body
}

levels! {
    /// `out` ← [`halve`] of the [`intensity`] of planes of `width` columns, in integers up to the final rounding.
    /// `sums` (one a column) is a scratch buffer.
    ///
    /// # Panics
    /// If the planes differ in length or are not whole rows of at least one value, if `sums` is not `width`, or if
    /// `out` is not half the columns and rows, rounded up.
    pub fn half_intensity / half_intensity_at (planes: [&[u8]; 3], width: usize, sums: &mut [u16], out: &mut [f32]) =
        half_intensity_body
}

levels! {
    /// `out` ← means of the intensity (as [`intensity`] has it) of planes of `width` columns over squares of `side` pixels, of which
    /// at most `most` rows (1 to 64) are read, evenly spaced: large squares cost less a pixel. The last squares may reach past the
    /// planes. `sums` (as many as columns) is room.
    ///
    /// # Panics
    /// If the planes differ in length or are not whole rows of at least one value, if `sums` is not `width`, or if
    /// `out` is not one value a square.
    pub fn square_intensity / square_intensity_at
        (planes: [&[u8]; 3], width: usize, side: usize, most: usize, sums: &mut [u16], out: &mut [f32]) = square_intensity_body
}

levels! {
    /// `out` ← rounded means over squares of `step` (1 to 16) pixels of a plane of `width` columns, of which at most `most` rows (1
    /// and more) are read, evenly spaced; `squares` is both. As many rows as it has, of a value for each `step` of the room `sums`,
    /// from the square `from` (column, row) on. Past the plane's last column and row these are repeated.
    ///
    /// # Panics
    /// If `plane` is not whole rows of at least one value, `step` or `most` out of range, or `sums` not one or more steps.
    pub fn shrink / shrink_at (
        plane: &[u8], width: usize, squares: (usize, usize), from: (usize, usize), sums: &mut [u16], out: &mut [u8]
    ) = shrink_body
}

/// Which rows of a square are read: the first, and how many further the next is. At most `most`, with their mean in the middle of the
/// square to half a pixel.
fn rows_of(side: usize, most: usize) -> (usize, usize) {
    let nth = side.div_ceil(most);
    ((side - 1) % nth / 2, nth)
}

#[inline(always)]
fn shrink_body<const V: u8>(
    plane: &[u8],
    width: usize,
    (step, most): (usize, usize),
    from: (usize, usize),
    sums: &mut [u16],
    out: &mut [u8],
) {
    assert!(width > 0 && !plane.is_empty() && plane.len().is_multiple_of(width), "whole rows of {width} values");
    assert!(
        (1..=16).contains(&step) && most > 0,
        "steps of 1 to 16 pixels, and some rows of them, not {step} and {most}"
    );
    assert!(!sums.is_empty() && sums.len().is_multiple_of(step), "room of whole steps of {step}");
    let columns = sums.len() / step;
    let (height, left) = (plane.len() / width, (from.0 * step).min(width - 1));
    let (first, nth) = rows_of(step, most);
    let rows = (step - first).div_ceil(nth);
    for (j, out) in out.chunks_mut(columns).enumerate() {
        for i in (first..step).step_by(nth) {
            let row = &plane[((from.1 + j) * step + i).min(height - 1) * width..][..width];
            let within = row[left..].len().min(sums.len());
            let (inside, beyond) = sums.split_at_mut(within);
            let pixels = inside.iter_mut().zip(&row[left..]);
            // Of 16 bytes at most.
            if i == first {
                pixels.for_each(|(sum, pixel)| *sum = u16::from(*pixel));
            } else {
                pixels.for_each(|(sum, pixel)| *sum += u16::from(*pixel));
            }
            let last = u16::from(row[width - 1]);
            beyond.iter_mut().for_each(|sum| *sum = if i == first { last } else { *sum + last });
        }
        macro_rules! means {
            ($($n:literal)*) => {
                match step {
                    $($n => means_of_bytes::<$n>(sums, rows, out),)*
                    _ => unreachable!("steps of 1 to 16 pixels"),
                }
            };
        }
        means!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16);
    }
}

/// `out` ← the rounded means of chunks of sums of so many rows: of 16 × 16 bytes at most, below 2^16 with half of their number.
#[inline(always)]
fn means_of_bytes<const N: usize>(sums: &[u16], rows: usize, out: &mut [u8]) {
    let area = (rows * N) as u16;
    let chunks = sums.as_chunks::<N>().0.iter().zip(out);
    let rounded = |chunk: &[u16; N]| chunk.iter().fold(area / 2, |sum, x| sum + x);
    if N == 2 {
        chunks.for_each(|(chunk, out)| *out = (rounded(chunk) >> rows) as u8);
    } else {
        // x / area, exact for x below 256 area, of area up to 256.
        let one = (1u32 << 24).div_ceil(u32::from(area));
        chunks.for_each(|(chunk, out)| *out = ((u32::from(rounded(chunk)) * one) >> 24) as u8);
    }
}

#[inline(always)]
fn square_intensity_body<const V: u8>(
    planes: [&[u8]; 3],
    width: usize,
    side: usize,
    most: usize,
    sums: &mut [u16],
    out: &mut [f32],
) {
    assert!(side > 0 && (1..=64).contains(&most), "squares of some pixels, and 1 to 64 rows of them");
    let count = planes[0].len();
    assert_one_size(planes, count);
    assert!(width > 0 && count > 0 && count.is_multiple_of(width), "whole rows of {width} values");
    let (height, columns) = (count / width, width.div_ceil(side));
    assert!(sums.len() == width, "room of {width}");
    assert!(out.len() == columns * height.div_ceil(side), "out must be {columns} x {}", height.div_ceil(side));
    let (first, nth) = rows_of(side, most);
    for (top, out) in (0..height).step_by(side).zip(out.chunks_exact_mut(columns)) {
        let rows = ((top + first).min(height - 1)..height.min(top + side)).step_by(nth);
        let n = rows.len();
        for (k, y) in rows.enumerate() {
            let [r, g, b] = planes.map(|plane| &plane[y * width..][..width]);
            let all = sums.iter_mut().zip(r.iter().zip(g).zip(b));
            // Of 64 rows and three bytes: below 2^16.
            let of = |((r, g), b): ((&u8, &u8), &u8)| u16::from(*r) + u16::from(*g) + u16::from(*b);
            match k {
                0 => all.for_each(|(sum, rgb)| *sum = of(rgb)),
                _ => all.for_each(|(sum, rgb)| *sum += of(rgb)),
            }
        }
        // All squares but a last one that reaches past the planes.
        let whole = width / side;
        let (squares, rest) = sums.split_at(whole * side);
        let one = (765 * n * side) as f32;
        match side {
            4 => means_of(squares.as_chunks::<4>().0, one, out),
            8 => means_of(squares.as_chunks::<8>().0, one, out),
            16 => means_of(squares.as_chunks::<16>().0, one, out),
            _ => means_of(squares.chunks_exact(side), one, out),
        }
        if !rest.is_empty() {
            out[whole] = total(rest) as f32 / (765 * n * rest.len()) as f32;
        }
    }
}

/// `out` ← the sums of these squares over `one`.
#[inline(always)]
fn means_of<'a, S: AsRef<[u16]> + ?Sized + 'a>(squares: impl IntoIterator<Item = &'a S>, one: f32, out: &mut [f32]) {
    squares.into_iter().zip(out).for_each(|(square, out)| *out = total(square.as_ref()) as f32 / one);
}

#[inline(always)]
fn total(sums: &[u16]) -> u32 {
    sums.iter().map(|sum| u32::from(*sum)).sum()
}

#[inline(always)]
fn half_intensity_body<const V: u8>(planes: [&[u8]; 3], width: usize, sums: &mut [u16], out: &mut [f32]) {
    let count = planes[0].len();
    assert_one_size(planes, count);
    assert!(width > 0 && count > 0 && count.is_multiple_of(width), "whole rows of {width} values");
    let (height, half) = (count / width, width.div_ceil(2));
    assert!(sums.len() == width, "room of {width}");
    assert!(out.len() == half * height.div_ceil(2), "out must be {half} x {}", height.div_ceil(2));
    // Of three bytes and weights of 8 × 8 in all: below 2^16.
    let one = 1.0 / (765.0 * 64.0);
    for (j, out) in out.chunks_exact_mut(half).enumerate() {
        for (k, i) in [2 * j, 2 * j + 1, (2 * j).saturating_sub(1), 2 * j + 2].into_iter().enumerate() {
            let [r, g, b] = planes.map(|plane| &plane[i.min(height - 1) * width..][..width]);
            let all = sums.iter_mut().zip(r.iter().zip(g).zip(b));
            let of = |((r, g), b): ((&u8, &u8), &u8)| u16::from(*r) + u16::from(*g) + u16::from(*b);
            match k {
                0 => all.for_each(|(sum, rgb)| *sum = 3 * of(rgb)),
                1 => all.for_each(|(sum, rgb)| *sum += 3 * of(rgb)),
                _ => all.for_each(|(sum, rgb)| *sum += of(rgb)),
            }
        }
        let wide = |i: usize| u32::from(sums[i.min(width - 1)]);
        let mean = |a: u32, b: u32, c: u32, d: u32| ((a + d) + 3 * (b + c)) as i32 as f32 * one;
        out[0] = mean(wide(0), wide(0), wide(1), wide(2));
        let inside = (width - 1) / 2;
        let (before, after) = (sums[1..].as_chunks::<2>().0, sums[width.min(3)..].as_chunks::<2>().0);
        for ((out, &[a, b]), &[c, d]) in out[1..].iter_mut().zip(before).zip(after) {
            *out = mean(a.into(), b.into(), c.into(), d.into());
        }
        for (i, out) in out.iter_mut().enumerate().skip(inside.max(1)) {
            *out = mean(wide(2 * i - 1), wide(2 * i), wide(2 * i + 1), wide(2 * i + 2));
        }
    }
}

#[inline(always)]
fn intensity_body<const V: u8>([r, g, b]: [&[u8]; 3], out: &mut [f32]) {
    assert_one_size([r, g, b], out.len());
    for (out, ((&r, &g), &b)) in out.iter_mut().zip(r.iter().zip(g).zip(b)) {
        *out = f32::from(u16::from(r) + u16::from(g) + u16::from(b)) / 765.0;
    }
}

#[inline(always)]
fn mean(a: f32, b: f32, c: f32, d: f32) -> f32 {
    0.125 * (a + d) + 0.375 * (b + c)
}

#[inline(always)]
fn halve_body<const V: u8>(plane: &[f32], width: usize, across: &mut [f32], out: &mut [f32]) {
    assert!(width > 0 && !plane.is_empty() && plane.len().is_multiple_of(width), "whole rows of {width} values");
    let (height, half) = (plane.len() / width, width.div_ceil(2));
    assert!(across.len() == half * height, "room of {half} x {height}");
    assert!(out.len() == half * height.div_ceil(2), "out must be {half} x {}", height.div_ceil(2));
    for (row, out) in plane.chunks_exact(width).zip(across.chunks_exact_mut(half)) {
        let at = |i: usize| row[i.min(width - 1)];
        out[0] = mean(at(0), at(0), at(1), at(2));
        // Inside, pairs of values: the columns 2 i − 1 and 2 i, and the two after them.
        let inside = (width - 1) / 2;
        let (before, after) = (row[1..].as_chunks::<2>().0, row[width.min(3)..].as_chunks::<2>().0);
        for ((out, &[a, b]), &[c, d]) in out[1..].iter_mut().zip(before).zip(after) {
            *out = mean(a, b, c, d);
        }
        for (i, out) in out.iter_mut().enumerate().skip(inside.max(1)) {
            *out = mean(at(2 * i - 1), at(2 * i), at(2 * i + 1), at(2 * i + 2));
        }
    }
    for (j, out) in out.chunks_exact_mut(half).enumerate() {
        let row = |i: usize| &across[i.min(height - 1) * half..][..half];
        let (a, b, c, d) = (row((2 * j).saturating_sub(1)), row(2 * j), row(2 * j + 1), row(2 * j + 2));
        for i in 0..half {
            out[i] = mean(a[i], b[i], c[i], d[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Level;
    use crate::sums::tests::values;

    #[test]
    fn agree_with_the_twins() {
        for (width, height) in [(1, 1), (2, 3), (3, 2), (4, 4), (5, 1), (33, 20), (64, 7), (101, 2)] {
            let plane = values(width * height, 1);
            let (w, h) = (width.div_ceil(2), height.div_ceil(2));
            let at = |x: i64, y: i64| {
                let (x, y) = (x.clamp(0, width as i64 - 1) as usize, y.clamp(0, height as i64 - 1) as usize);
                f64::from(plane[y * width + x])
            };
            let kernel = [1.0, 3.0, 3.0, 1.0];
            for level in Level::all() {
                let (mut across, mut out) = (vec![f32::NAN; w * height], vec![f32::NAN; w * h]);
                halve_at(level, &plane, width, &mut across, &mut out);
                for (k, out) in out.iter().enumerate() {
                    let (x, y) = (2 * (k % w) as i64 - 1, 2 * (k / w) as i64 - 1);
                    let exact: f64 = (0..16)
                        .map(|i| kernel[i % 4] * kernel[i / 4] * at(x + (i % 4) as i64, y + (i / 4) as i64))
                        .sum();
                    assert!((f64::from(*out) - exact / 64.0).abs() < 1e-6, "{level:?}, {width} x {height}: {out}");
                }
            }
        }
    }

    #[test]
    fn half_intensities_are_halved_intensities() {
        for (width, height) in [(1, 1), (2, 3), (3, 2), (4, 4), (5, 1), (33, 20), (64, 7), (101, 2)] {
            let plane = |p: u32| {
                values(width * height, p).iter().map(|v| if *v > 0.9 { 255 } else { (v * 256.0) as u8 }).collect()
            };
            let planes: [Vec<u8>; 3] = [1, 2, 3].map(plane);
            let planes = planes.each_ref().map(|p| &p[..]);
            let (w, h) = (width.div_ceil(2), height.div_ceil(2));
            let (mut whole, mut across, mut exact) =
                (vec![0.0; width * height], vec![0.0; w * height], vec![0.0; w * h]);
            intensity(planes, &mut whole);
            halve(&whole, width, &mut across, &mut exact);
            for level in Level::all() {
                let (mut sums, mut out) = (vec![0; width], vec![f32::NAN; w * h]);
                half_intensity_at(level, planes, width, &mut sums, &mut out);
                for (out, exact) in out.iter().zip(&exact) {
                    assert!((out - exact).abs() < 1e-6, "{level:?}, {width} x {height}: {out} is not {exact}");
                }
            }
        }
    }

    #[test]
    fn shrunk_planes_are_means() {
        for (width, height, (step, most), from, columns, rows) in [
            (40, 24, (2, 2), (3, 1), 9, 5),
            (40, 24, (2, 1), (3, 1), 9, 5),
            (41, 25, (3, 3), (10, 2), 4, 7),
            (41, 25, (3, 2), (10, 2), 4, 7),
            (50, 37, (4, 4), (0, 0), 13, 10),
            (50, 37, (4, 2), (0, 0), 13, 10),
            (33, 20, (5, 16), (2, 1), 5, 3),
            (99, 70, (9, 3), (1, 1), 10, 6),
            (99, 70, (15, 15), (1, 1), 6, 4),
            (3, 2, (16, 16), (0, 0), 1, 1),
            (70, 50, (16, 4), (1, 0), 4, 4),
            (5, 5, (1, 1), (1, 1), 4, 4),
        ] {
            let plane: Vec<u8> = values(width * height, 4).iter().map(|v| (v * 255.0).abs() as u8).collect();
            for level in Level::all() {
                let (mut sums, mut out) = (vec![7; columns * step], vec![0; columns * rows]);
                shrink_at(level, &plane, width, (step, most), from, &mut sums, &mut out);
                for (k, out) in out.iter().enumerate() {
                    let (left, top) = ((from.0 + k % columns) * step, (from.1 + k / columns) * step);
                    let at = |i: usize| {
                        let (x, y) = ((left + i % step).min(width - 1), (top + i / step).min(height - 1));
                        usize::from(plane[y * width + x])
                    };
                    let nth = step.div_ceil(most);
                    let read = |i: &usize| i / step % nth == (step - 1) % nth / 2;
                    let sum: usize = (0..step * step).filter(read).map(at).sum();
                    let count = (0..step * step).filter(read).count();
                    assert_eq!(usize::from(*out), (sum + count / 2) / count, "{level:?}, step {step}, {most} rows");
                }
            }
        }
    }

    #[test]
    fn squares_have_the_means_of_their_rows() {
        for (width, height, side, most) in
            [(1, 1, 4, 4), (9, 7, 4, 4), (40, 24, 4, 2), (50, 37, 8, 4), (33, 20, 16, 4), (3, 2, 2, 64)]
        {
            let plane = |p: u32| values(width * height, p).iter().map(|v| (v * 255.0).abs() as u8).collect();
            let planes: [Vec<u8>; 3] = [1, 2, 3].map(plane);
            let (columns, rows, step) = (width.div_ceil(side), height.div_ceil(side), side.div_ceil(most));
            for level in Level::all() {
                let (mut sums, mut out) = (vec![0; width], vec![f32::NAN; columns * rows]);
                let planes = planes.each_ref().map(|p| &p[..]);
                square_intensity_at(level, planes, width, side, most, &mut sums, &mut out);
                for (k, out) in out.iter().enumerate() {
                    let (left, top) = (k % columns * side, k / columns * side);
                    let first = (top + (step - 1) / 2).min(height - 1);
                    let places = || {
                        let across = left..width.min(left + side);
                        (first..height.min(top + side))
                            .step_by(step)
                            .flat_map(move |y| across.clone().map(move |x| (x, y)))
                    };
                    let sum: f64 = places().flat_map(|(x, y)| planes.map(|p| f64::from(p[y * width + x]))).sum();
                    let exact = sum / 765.0 / places().count() as f64;
                    assert!((f64::from(*out) - exact).abs() < 1e-6, "{level:?}: {out} is not {exact}");
                }
            }
        }
    }

    #[test]
    fn intensities_are_means() {
        let planes: [Vec<u8>; 3] = std::array::from_fn(|p| (0..256).map(|i| (i * (p + 1)) as u8).collect());
        for level in Level::all() {
            let mut out = [f32::NAN; 256];
            intensity_at(level, planes.each_ref().map(|p| &p[..]), &mut out);
            for (i, out) in out.iter().enumerate() {
                let sum: f32 = planes.iter().map(|p| f32::from(p[i])).sum();
                assert_eq!(*out, sum / 765.0, "{level:?}");
            }
        }
    }
}
