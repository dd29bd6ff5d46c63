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

levels! {
    /// `rgb` ← a row of `y`, `u` and `v`, of which the latter two are as long, or half as long, rounded up.
    ///
    /// # Panics
    /// If the lengths differ in another way.
    pub fn rgb_of_yuv / rgb_of_yuv_at (y: &[u8], uv: [&[u8]; 2], law: &Decoding, rgb: [&mut [u8]; 3]) = rgb_of_yuv_body
}
levels! {
    /// `out` ← the sum of red, green and blue weighted by `weights`, and of `offset`, in units of 2⁻¹⁶.
    ///
    /// # Panics
    /// If the planes and `out` differ in length.
    pub fn weighted / weighted_at (planes: [&[u8]; 3], weights: [i32; 3], offset: i32, out: &mut [u8]) = weighted_body
}
levels! {
    /// The same of the sums over squares of 2 × 2 pixels, in units of 2⁻¹⁸: each plane is two rows. The last column is repeated if it
    /// is half a square.
    ///
    /// # Panics
    /// If the rows differ in length, or `out` is not half as long, rounded up.
    pub fn weighted_squares / weighted_squares_at
        (planes: [[&[u8]; 2]; 3], weights: [i32; 3], offset: i32, out: &mut [u8]) = weighted_squares_body
}

/// How luma and two chroma values become red, green and blue, in units of 2⁻¹⁶: `(gain y + offset + …) >> 16`, clamped to 0 to 255, where
/// chroma is centred at 128.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "the weights of v in red, u and v in green (subtracted), u in blue")]
pub struct Decoding {
    pub gain: i32,
    pub offset: i32,
    pub red_v: i32,
    pub green_u: i32,
    pub green_v: i32,
    pub blue_u: i32,
}

/// Values at a time.
const RUN: usize = 32;

#[inline(always)]
fn rgb_of_yuv_body<const V: u8>(y: &[u8], uv: [&[u8]; 2], law: &Decoding, rgb: [&mut [u8]; 3]) {
    assert!(rgb.iter().all(|plane| plane.len() == y.len()), "planes of one size");
    let across = if uv[0].len() == y.len() { 1 } else { 2 };
    assert!(uv.iter().all(|plane| plane.len() == y.len().div_ceil(across)), "chroma of full or half width");
    match across {
        1 => runs_of_yuv::<RUN, 1>(y, uv, law, rgb),
        _ => runs_of_yuv::<{ RUN / 2 }, 2>(y, uv, law, rgb),
    }
}

/// Of `N` chroma values at a time, of `ACROSS` pixels each.
#[inline(always)]
fn runs_of_yuv<const N: usize, const ACROSS: usize>(y: &[u8], uv: [&[u8]; 2], law: &Decoding, rgb: [&mut [u8]; 3]) {
    let [red, green, blue] = rgb.map(|plane| plane.chunks_mut(RUN));
    let chroma = uv[0].chunks(N).zip(uv[1].chunks(N));
    for (((red, green), blue), (y, (u, v))) in red.zip(green).zip(blue).zip(y.chunks(RUN).zip(chroma)) {
        if let Ok(y) = <&[u8; RUN]>::try_from(y) {
            let [r, g, b] = run_of_yuv::<N, ACROSS>(y, u, v, law);
            red.copy_from_slice(&r);
            green.copy_from_slice(&g);
            blue.copy_from_slice(&b);
            continue;
        }
        let (mut whole, mut us, mut vs) = ([0; RUN], [0; N], [0; N]);
        whole[..y.len()].copy_from_slice(y);
        us[..u.len()].copy_from_slice(u);
        vs[..v.len()].copy_from_slice(v);
        let [r, g, b] = run_of_yuv::<N, ACROSS>(&whole, &us, &vs, law);
        red.copy_from_slice(&r[..y.len()]);
        green.copy_from_slice(&g[..y.len()]);
        blue.copy_from_slice(&b[..y.len()]);
    }
}

#[inline(always)]
fn run_of_yuv<const N: usize, const ACROSS: usize>(
    y: &[u8; RUN],
    u: &[u8],
    v: &[u8],
    law: &Decoding,
) -> [[u8; RUN]; 3] {
    let (u, v) = (u.first_chunk::<N>().expect("a run"), v.first_chunk::<N>().expect("a run"));
    let (mut r, mut g, mut b) = ([0i32; N], [0i32; N], [0i32; N]);
    for i in 0..N {
        let (u, v) = (i32::from(u[i]) - 128, i32::from(v[i]) - 128);
        r[i] = law.offset + law.red_v * v;
        g[i] = law.offset - law.green_u * u - law.green_v * v;
        b[i] = law.offset + law.blue_u * u;
    }
    [r, g, b].map(|chroma| {
        let mut out = [0; RUN];
        for i in 0..RUN {
            out[i] = ((law.gain * i32::from(y[i]) + chroma[i / ACROSS]) >> 16).clamp(0, 255) as u8;
        }
        out
    })
}

#[inline(always)]
fn weighted_body<const V: u8>([r, g, b]: [&[u8]; 3], [wr, wg, wb]: [i32; 3], offset: i32, out: &mut [u8]) {
    assert_one_size([r, g, b], out.len());
    for (out, ((&r, &g), &b)) in out.iter_mut().zip(r.iter().zip(g).zip(b)) {
        *out = ((offset + wr * i32::from(r) + wg * i32::from(g) + wb * i32::from(b)) >> 16) as u8;
    }
}

#[inline(always)]
fn weighted_squares_body<const V: u8>(planes: [[&[u8]; 2]; 3], weights: [i32; 3], offset: i32, out: &mut [u8]) {
    let width = planes[0][0].len();
    assert!(planes.iter().flatten().all(|row| row.len() == width), "rows of one length");
    assert!(out.len() == width.div_ceil(2), "a value for two columns");
    let [r, g, b] = planes.map(|rows| rows.map(|row| row.as_chunks::<2>().0));
    let sum = |top: [u8; 2], bottom: [u8; 2]| -> i32 { [top, bottom].iter().flatten().map(|v| i32::from(*v)).sum() };
    let value = |r: i32, g: i32, b: i32| ((offset + weights[0] * r + weights[1] * g + weights[2] * b) >> 18) as u8;
    let n = width / 2;
    let (r, g, b) = (r.map(|row| &row[..n]), g.map(|row| &row[..n]), b.map(|row| &row[..n]));
    for (i, out) in out[..n].iter_mut().enumerate() {
        *out = value(sum(r[0][i], r[1][i]), sum(g[0][i], g[1][i]), sum(b[0][i], b[1][i]));
    }
    if let Some(out) = out.get_mut(n) {
        let [r, g, b] = planes.map(|[top, bottom]| sum([top[width - 1]; 2], [bottom[width - 1]; 2]));
        *out = value(r, g, b);
    }
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

    /// By a law of BT.709 with limited range, at every level and odd lengths.
    #[test]
    fn rows_of_video_agree_with_the_twins() {
        let law = Decoding {
            gain: 76309,
            offset: 32768 - 16 * 76309,
            red_v: 117_489,
            green_u: 13975,
            green_v: 34925,
            blue_u: 138_438,
        };
        let (weights, offset) = ([11966, 40254, 4064], 16 * 65536 + 32768);
        let chroma = ([-6596, -22189, 28784], (128 << 18) + (1 << 17));
        let noise = |seed: usize, n: usize| -> Vec<u8> {
            (0..n).map(|i| ((i + seed).wrapping_mul(2_654_435_761) >> 13) as u8).collect()
        };
        for (n, level) in [0, 1, 2, 31, 32, 33, 64, 1001].into_iter().flat_map(|n| Level::all().map(move |l| (n, l))) {
            for half in [1, 2] {
                let (y, u, v) = (noise(1, n), noise(2, n.div_ceil(half)), noise(3, n.div_ceil(half)));
                let mut rgb = [vec![0; n], vec![0; n], vec![0; n]];
                rgb_of_yuv_at(level, &y, [&u, &v], &law, rgb.each_mut().map(|p| &mut p[..]));
                for i in 0..n {
                    let (y, u, v) = (i32::from(y[i]), i32::from(u[i / half]) - 128, i32::from(v[i / half]) - 128);
                    let want = [law.red_v * v, -law.green_u * u - law.green_v * v, law.blue_u * u];
                    let want = want.map(|part| ((law.gain * y + law.offset + part) >> 16).clamp(0, 255) as u8);
                    assert_eq!([0, 1, 2].map(|p| rgb[p][i]), want, "{level:?} {n} {i}");
                }
            }
            let rows = [4, 5, 6, 7, 8, 9].map(|seed| noise(seed, n));
            let planes = [0, 1, 2].map(|p| &rows[p][..]);
            let mut out = vec![0; n];
            weighted_at(level, planes, weights, offset, &mut out);
            for (i, out) in out.iter().enumerate() {
                let sum: i32 = planes.iter().zip(weights).map(|(plane, w)| w * i32::from(plane[i])).sum();
                assert_eq!(i32::from(*out), (sum + offset) >> 16, "{level:?} {n} {i}");
            }
            let squares = [0, 1, 2].map(|p| [&rows[p][..], &rows[p + 3][..]]);
            let mut out = vec![0; n.div_ceil(2)];
            weighted_squares_at(level, squares, chroma.0, chroma.1, &mut out);
            for (i, out) in out.iter().enumerate() {
                let columns = [2 * i, (2 * i + 1).min(n - 1)];
                let four =
                    |rows: [&[u8]; 2]| -> i32 { rows.iter().flat_map(|r| columns.map(|x| i32::from(r[x]))).sum() };
                let sum: i32 = squares.iter().zip(chroma.0).map(|(rows, w)| w * four(*rows)).sum();
                assert_eq!(i32::from(*out), (sum + chroma.1) >> 18, "{level:?} {n} {i}");
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
