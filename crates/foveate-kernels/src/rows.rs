//! Sums and products of rows. Nothing is fused: the bits are the same at every level, and as plain loops have them.

#[cfg(target_arch = "x86_64")]
use crate::level::AVX512;
use crate::level::levels;

#[inline(always)]
fn add_scaled_body<const V: u8>(factor: f32, x: &[f32], out: &mut [f32]) {
    for (o, &x) in out.iter_mut().zip(x) {
        *o += factor * x;
    }
}

levels! {
    /// `out` += `factor` · `x`, as far as both go.
    pub fn add_scaled / add_scaled_at (factor: f32, x: &[f32], out: &mut [f32]) = add_scaled_body
}

#[inline(always)]
fn add_scaled_bytes_body<const V: u8>(factor: f32, x: &[u8], out: &mut [f32]) {
    for (o, &x) in out.iter_mut().zip(x) {
        *o += factor * f32::from(x);
    }
}

levels! {
    /// `out` += `factor` · `x`, as far as both go.
    pub fn add_scaled_bytes / add_scaled_bytes_at (factor: f32, x: &[u8], out: &mut [f32]) = add_scaled_bytes_body
}

#[inline(always)]
fn add_product_body<const V: u8>(factor: f32, x: &[f32], y: &[f32], out: &mut [f32]) {
    for ((o, &x), &y) in out.iter_mut().zip(x).zip(y) {
        *o += factor * x * y;
    }
}

levels! {
    /// `out` += `factor` · `x` ∘ `y`, as far as all go.
    pub fn add_product / add_product_at (factor: f32, x: &[f32], y: &[f32], out: &mut [f32]) = add_product_body
}

#[inline(always)]
fn product_body<const V: u8>(x: &[f32], y: &[f32], out: &mut [f32]) {
    for ((o, &x), &y) in out.iter_mut().zip(x).zip(y) {
        *o = x * y;
    }
}

levels! {
    /// `out` = `x` ∘ `y`, as far as all go.
    pub fn product / product_at (x: &[f32], y: &[f32], out: &mut [f32]) = product_body
}

#[inline(always)]
fn blend_body<const V: u8>(above: &[f32], below: &[f32], part: f32, out: &mut [u8]) {
    /// 2²³: the last bits of a number plus this are the number, rounded to the nearest, a half to the even one.
    const WHOLE: f32 = 8_388_608.0;
    for ((o, &a), &b) in out.iter_mut().zip(above).zip(below) {
        *o = (a + part * (b - a) + WHOLE).to_bits() as u8;
    }
}

levels! {
    /// `out` = `above` + `part` · (`below` − `above`), rounded, as far as all go; `part` and both rows are such that it is 0 to 255.
    pub fn blend / blend_at (above: &[f32], below: &[f32], part: f32, out: &mut [u8]) = blend_body
}

/// Rows of which products are summed at a time, and entries of a step with AVX-512.
const ROWS: usize = 4;
#[cfg(target_arch = "x86_64")]
const ENTRIES: usize = 32;

#[inline(always)]
fn byte_products_body<const V: u8>(rows: &[i8], x: &[i8], out: &mut [i32]) {
    if x.is_empty() {
        return out.fill(0);
    }
    let n = x.len();
    for (out, rows) in out.chunks_mut(ROWS).zip(rows.chunks(ROWS * n)) {
        #[cfg(target_arch = "x86_64")]
        if V >= AVX512 && n.is_multiple_of(ENTRIES) && rows.len() == ROWS * n && out.len() == ROWS {
            use std::arch::x86_64::*;
            // SAFETY: by `V` the caller is compiled for AVX-512, and runs only where it is there.
            let mut sums = [unsafe { _mm512_setzero_si512() }; ROWS];
            for (k, x) in x.as_chunks::<ENTRIES>().0.iter().enumerate() {
                // SAFETY: as above; each read is of 32 bytes of a slice.
                unsafe {
                    let x = _mm512_cvtepi8_epi16(_mm256_loadu_si256(x.as_ptr().cast()));
                    for (sum, row) in sums.iter_mut().zip(rows.chunks_exact(n)) {
                        let row = &row[k * ENTRIES..][..ENTRIES];
                        let row = _mm512_cvtepi8_epi16(_mm256_loadu_si256(row.as_ptr().cast()));
                        *sum = _mm512_add_epi32(*sum, _mm512_madd_epi16(row, x));
                    }
                }
            }
            for (o, sum) in out.iter_mut().zip(sums) {
                // SAFETY: as above.
                *o = unsafe { _mm512_reduce_add_epi32(sum) };
            }
            continue;
        }
        for (o, row) in out.iter_mut().zip(rows.chunks_exact(n)) {
            *o = row.iter().zip(x).map(|(&a, &b)| i32::from(a) * i32::from(b)).sum();
        }
    }
}

levels! {
    /// `out`ₖ = the k-th of `rows`, each as long as `x`, times `x`; values from −127 to 127, at most 2¹⁷ in a row.
    pub fn byte_products / byte_products_at (rows: &[i8], x: &[i8], out: &mut [i32]) = byte_products_body
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Level;

    #[test]
    fn products_of_bytes_are_exact() {
        for (n, rows) in [(1, 3), (17, 2), (224, 9)] {
            let x: Vec<i8> = (0..n).map(|i| (i * 37 % 255 - 127) as i8).collect();
            let all: Vec<i8> = (0..n * rows).map(|i| (i * 53 % 255 - 127) as i8).collect();
            let plain = |row: &[i8]| row.iter().zip(&x).map(|(a, b)| i32::from(*a) * i32::from(*b)).sum::<i32>();
            let right: Vec<i32> = all.chunks_exact(x.len()).map(plain).collect();
            for level in Level::all() {
                let mut out = vec![0; rows as usize];
                byte_products_at(level, &all, &x, &mut out);
                assert_eq!(out, right, "{level:?}, {n} values");
                byte_products_at(level, &all, &[], &mut out);
                assert!(out.iter().all(|sum| *sum == 0), "{level:?}");
            }
        }
    }

    #[test]
    fn every_level_has_the_bits_of_plain_loops() {
        for n in [0, 1, 15, 16, 250, 515] {
            let x: Vec<f32> = (0..n).map(|i| (i as f32 * 0.7).sin()).collect();
            let y: Vec<f32> = (0..n).map(|i| (i as f32 * 1.3).cos() * 3.0).collect();
            for level in Level::all() {
                let (mut a, mut b, mut c) = (y.clone(), x.clone(), x.clone());
                add_scaled_at(level, 0.3, &x, &mut a);
                add_product_at(level, 0.3, &x, &y, &mut b);
                product_at(level, &x, &y, &mut c);
                let (bright, mut bytes): (Vec<f32>, _) = (y.iter().map(|y| 130.0 + 40.0 * y).collect(), vec![0; n]);
                blend_at(level, &bright, &x, 0.3, &mut bytes);
                for i in 0..n {
                    assert_eq!(bytes[i], (bright[i] + 0.3 * (x[i] - bright[i])).round_ties_even() as u8);
                    assert_eq!([a[i], b[i], c[i]], [y[i] + 0.3 * x[i], x[i] + 0.3 * x[i] * y[i], x[i] * y[i]]);
                }
            }
        }
    }
}
