//! Pixels taken apart into planes, and from red, green and blue to grey and two opponent channels.

use crate::level::levels;

levels! {
    /// `planes` ← the first, second and third bytes of pixels of `depth` bytes each, 3 or 4.
    ///
    /// # Panics
    /// If the depth is another, or a plane has not as many values as there are pixels.
    pub fn take_apart / take_apart_at (pixels: &[u8], depth: usize, planes: [&mut [u8]; 3]) = take_apart_body
}
levels! {
    /// `out` ← BT.601 luma, rounded.
    ///
    /// # Panics
    /// If the planes and `out` differ in length, as in all functions here.
    pub fn luma / luma_at (planes: [&[u8]; 3], out: &mut [u8]) = luma_body
}
levels! {
    /// `out` ← (red − green) / 2 + 128; the half is rounded towards 128.
    pub fn red_green / red_green_at (planes: [&[u8]; 3], out: &mut [u8]) = red_green_body
}
levels! {
    /// `out` ← (2 blue − red − green) / 4 + 128, rounded towards 128.
    pub fn blue_yellow / blue_yellow_at (planes: [&[u8]; 3], out: &mut [u8]) = blue_yellow_body
}

pub(crate) fn assert_one_size(planes: [&[u8]; 3], size: usize) {
    assert!(planes.iter().all(|plane| plane.len() == size), "planes of one size");
}

#[inline(always)]
fn take_apart_body<const V: u8>(pixels: &[u8], depth: usize, planes: [&mut [u8]; 3]) {
    match depth {
        3 => of_depth::<3>(pixels, planes),
        4 => of_depth::<4>(pixels, planes),
        _ => panic!("pixels of 3 or 4 bytes, not {depth}"),
    }
}

#[inline(always)]
fn of_depth<const DEPTH: usize>(pixels: &[u8], [a, b, c]: [&mut [u8]; 3]) {
    let (pixels, rest) = pixels.as_chunks::<DEPTH>();
    assert!(rest.is_empty() && [&a, &b, &c].iter().all(|plane| plane.len() == pixels.len()), "a value a pixel");
    for (((a, b), c), pixel) in a.iter_mut().zip(b).zip(c).zip(pixels) {
        (*a, *b, *c) = (pixel[0], pixel[1], pixel[2]);
    }
}

#[inline(always)]
fn luma_body<const V: u8>([r, g, b]: [&[u8]; 3], out: &mut [u8]) {
    assert_one_size([r, g, b], out.len());
    for (out, ((&r, &g), &b)) in out.iter_mut().zip(r.iter().zip(g).zip(b)) {
        *out = ((u32::from(r) * 19595 + u32::from(g) * 38470 + u32::from(b) * 7471 + 32768) >> 16) as u8;
    }
}

#[inline(always)]
fn red_green_body<const V: u8>([r, g, b]: [&[u8]; 3], out: &mut [u8]) {
    assert_one_size([r, g, b], out.len());
    for (out, (&r, &g)) in out.iter_mut().zip(r.iter().zip(g)) {
        *out = ((i16::from(r) - i16::from(g)) / 2 + 128) as u8;
    }
}

#[inline(always)]
fn blue_yellow_body<const V: u8>([r, g, b]: [&[u8]; 3], out: &mut [u8]) {
    assert_one_size([r, g, b], out.len());
    for (out, ((&r, &g), &b)) in out.iter_mut().zip(r.iter().zip(g).zip(b)) {
        *out = ((2 * i16::from(b) - i16::from(r) - i16::from(g)) / 4 + 128) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Level;

    #[test]
    fn pixels_are_taken_apart() {
        for n in [0, 1, 15, 64, 333] {
            for (depth, level) in [3, 4].into_iter().flat_map(|depth| Level::all().map(move |level| (depth, level))) {
                let pixels: Vec<u8> = (0..n * depth).map(|i| (i * 7 + i / 256) as u8).collect();
                let mut planes = [vec![0; n], vec![0; n], vec![0; n]];
                let out = planes.each_mut().map(|plane| &mut plane[..]);
                take_apart_at(level, &pixels, depth, out);
                for (byte, plane) in planes.iter().enumerate() {
                    assert!(plane.iter().enumerate().all(|(i, v)| *v == pixels[depth * i + byte]), "{level:?} {depth}");
                }
            }
        }
    }

    /// Of every fifth red and green and every third blue, extremes among them.
    #[test]
    fn agree_with_the_twins() {
        let (mut planes, step) = ([vec![], vec![], vec![]], |n: usize| (0..=255u8).step_by(n));
        for (r, g, b) in step(5).flat_map(|r| step(5).flat_map(move |g| step(3).map(move |b| (r, g, b)))) {
            planes.iter_mut().zip([r, g, b]).for_each(|(plane, value)| plane.push(value));
        }
        let (planes, n) = (planes.each_ref().map(|p| &p[..]), planes[0].len());
        for level in Level::all() {
            let mut out = [vec![0; n], vec![0; n], vec![0; n]];
            luma_at(level, planes, &mut out[0]);
            red_green_at(level, planes, &mut out[1]);
            blue_yellow_at(level, planes, &mut out[2]);
            for i in 0..n {
                let [r, g, b] = planes.map(|p| f64::from(p[i]));
                let grey = 0.299 * r + 0.587 * g + 0.114 * b;
                assert!((f64::from(out[0][i]) - grey).abs() < 0.502, "{level:?}: {r} {g} {b}");
                let opponents = [((r - g) / 2.0).trunc() + 128.0, ((2.0 * b - r - g) / 4.0).trunc() + 128.0];
                assert_eq!([out[1][i], out[2][i]].map(f64::from), opponents, "{level:?}: {r} {g} {b}");
            }
        }
    }
}
