//! Layers of a convolutional network on a small square map, in whole numbers; and the correlation of two maps.
//!
//! Maps have their channels side by side: value c of place (x, y) is at (y · side + x) · channels + c. A layer reads steps of 15 bits and
//! weights of 8, so sums are exact: every processor has the same bits.

use crate::level::{AVX512, Level, greater, levels, multiply_add};
#[cfg(target_arch = "x86_64")]
use crate::level::{BASE, FUSED, VNNI};

/// Filters that are summed side by side: a layer has a multiple of them.
pub const FILTERS: usize = 16;
/// Places in a row that are summed side by side; twice as many where there are registers for them.
const PLACES: usize = 4;
const MANY: usize = 8;
/// The largest step of a map.
const STEPS: f32 = 16383.0;
/// The most values under a filter: their sum fits in 32 bits.
const MOST: usize = 1000;

/// The numbers of a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer<'a> {
    /// Side of the input map.
    pub side: usize,
    /// Channels of the input map.
    pub channels: usize,
    /// Places along a side of a filter.
    pub size: usize,
    /// Places from a filter to the next.
    pub stride: usize,
    /// Whether negative values become 0.
    pub cut: bool,
    /// The weights as [`paired`] returns them, each in the unit of its filter.
    pub weights: &'a [i16],
    /// The unit of each filter.
    pub scales: &'a [f32],
    /// One a filter, or one a place and filter.
    pub bias: &'a [f32],
}

/// Returns the weights of filters with rows of `across` values, which have those of all filters for each value, with two values side by
/// side. A last value without a partner has a weight of 0 beside it.
pub fn paired(weights: &[i8], across: usize, filters: usize) -> Vec<i16> {
    let row = |row: &[i8]| -> Vec<i16> {
        let weight = |i: usize, f: usize| row.get(i * filters + f).map_or(0, |weight| i16::from(*weight));
        let pairs = (0..across).step_by(2).flat_map(|i| (0..filters).map(move |f| (i, f)));
        pairs.flat_map(|(i, f)| [weight(i, f), weight(i + 1, f)]).collect()
    };
    weights.chunks_exact(across * filters).flat_map(row).collect()
}

/// `out` ← a map of `side` × `side` × `channels` in steps, with `margin` places of zeros around it, and a zero behind it. Returns the step.
pub fn to_steps(map: &[f32], (side, channels, margin): (usize, usize, usize), out: &mut Vec<i16>) -> f32 {
    let most = largest_magnitude_at(Level::best(), map);
    let (step, gain) = if most > 0.0 && most.is_finite() { (most / STEPS, STEPS / most) } else { (0.0, 0.0) };
    let across = (side + 2 * margin) * channels;
    out.clear();
    out.resize(across * (side + 2 * margin) + 1, 0);
    for (y, row) in map.chunks_exact(side * channels).enumerate() {
        round_steps_at(Level::best(), row, gain, &mut out[(y + margin) * across + margin * channels..][..row.len()]);
    }
    step
}

levels! {
    fn largest_magnitude_at (values: &[f32]) -> f32 = largest_magnitude_body
}

/// The largest magnitude of these values, 0 if there are none; a NaN may be ignored.
#[inline(always)]
fn largest_magnitude_body<const V: u8>(values: &[f32]) -> f32 {
    let mut most = [0.0f32; 16];
    let (chunks, rest) = values.as_chunks::<16>();
    for chunk in chunks {
        most.iter_mut().zip(chunk).for_each(|(most, x)| *most = greater(x.abs(), *most));
    }
    rest.iter().chain(&most).fold(0.0, |most, x| greater(x.abs(), most))
}

levels! {
    fn round_steps_at (values: &[f32], gain: f32, out: &mut [i16]) = round_steps_body
}

/// `out` ← the nearest whole numbers to `gain` times these values, which are at most [`STEPS`].
#[inline(always)]
fn round_steps_body<const V: u8>(values: &[f32], gain: f32, out: &mut [i16]) {
    /// The steps of floats there are 1: their last bits are the whole number.
    const ROUND: f32 = 12_582_912.0;
    for (out, x) in out.iter_mut().zip(values) {
        *out = (x * gain + ROUND).to_bits() as i16;
    }
}

/// `out` ← bias + filter · `map`, rectified if configured, at all places where the filters lie inside the map: `((side - size) / stride +
/// 1)²` places with one channel a filter. `map` is in steps of `step`, as [`to_steps`] returns them.
///
/// # Panics
/// If the number of filters is not a multiple of 16, a filter has over 1000 values, or a length is wrong.
pub fn convolve(layer: &Layer<'_>, map: &[i16], step: f32, out: &mut [f32]) {
    convolve_on(Level::best(), layer, map, step, out);
}

fn convolve_on(level: Level, layer: &Layer<'_>, map: &[i16], step: f32, out: &mut [f32]) {
    #[cfg(target_arch = "x86_64")]
    if level == Level::Avx512Dots {
        #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx512vnni")]
        fn dots(layer: &Layer<'_>, map: &[i16], step: f32, out: &mut [f32]) {
            convolve_body::<VNNI>(layer, map, step, out);
        }
        assert!(level <= Level::best(), "this processor has no {level:?}");
        // SAFETY: the processor has at least `level`, so it has the instructions.
        return unsafe { dots(layer, map, step, out) };
    }
    convolve_at(level, layer, map, step, out);
}

levels! {
    fn convolve_at (layer: &Layer<'_>, map: &[i16], step: f32, out: &mut [f32]) = convolve_body
}

levels! {
    /// Of each place of `a`, the means over channels of its products with the places of `b` up to `reach` places away, row by row, 0 outside:
    /// (2 reach + 1)² numbers, the first of those of place p at `out[p × stride]`. `shape` is \[side, channels, reach\].
    ///
    /// # Panics
    /// If channels are no multiple of 16, or a length is another.
    pub fn correlate / correlate_at (
        shape: [usize; 3], a: &[f32], b: &[f32], out: &mut [f32], stride: usize
    ) = correlate_body
}

#[inline(always)]
fn convolve_body<const V: u8>(layer: &Layer<'_>, map: &[i16], step: f32, out: &mut [f32]) {
    let Layer { side, channels, size, stride, weights, scales, bias, .. } = *layer;
    assert!(size > 0 && stride > 0 && channels > 0, "a filter has a size, a stride and channels");
    let (filters, pairs) = (scales.len(), (size * channels).div_ceil(2));
    let places = if side < size { 0 } else { (side - size) / stride + 1 };
    assert!(places > 0 && size * size * channels <= MOST, "filters of {size} x {size} x {channels}");
    assert!(filters > 0 && filters.is_multiple_of(FILTERS), "{filters} filters, not a multiple of {FILTERS}");
    assert!(map.len() == side * side * channels + 1, "a map of {side} x {side} x {channels}, and a zero");
    assert!(weights.len() == 2 * size * pairs * filters, "weights of {filters} filters of {size} x {size}");
    assert!([filters, places * places * filters].contains(&bias.len()), "a bias a filter, or a place and filter");
    assert!(out.len() == places * places * filters, "a value a filter and place");
    for (top, out) in out.chunks_exact_mut(places * filters).enumerate() {
        for first in (0..filters).step_by(FILTERS) {
            let mut left = 0;
            while V >= AVX512 && left + MANY <= places {
                some::<V, MANY>(layer, map, (step, places), (top, left, first), out);
                left += MANY;
            }
            while left + PLACES <= places {
                some::<V, PLACES>(layer, map, (step, places), (top, left, first), out);
                left += PLACES;
            }
            while left < places {
                some::<V, 1>(layer, map, (step, places), (top, left, first), out);
                left += 1;
            }
        }
    }
}

/// Sixteen filters at `P` places in a row.
#[inline(always)]
fn some<const V: u8, const P: usize>(
    layer: &Layer<'_>,
    map: &[i16],
    (step, places): (f32, usize),
    (top, left, first): (usize, usize, usize),
    out: &mut [f32],
) {
    let Layer { side, channels, size, stride, cut, weights, scales, bias } = *layer;
    let (filters, pairs) = (scales.len(), (size * channels).div_ceil(2));
    let mut sums = [[0i32; FILTERS]; P];
    for row in 0..size {
        let from = ((top * stride + row) * side + left * stride) * channels;
        let rows: [&[[i16; 2]]; P] =
            std::array::from_fn(|place| map[from + place * stride * channels..][..2 * pairs].as_chunks().0);
        let weights = &weights[2 * row * pairs * filters..][..2 * pairs * filters];
        for (i, weights) in (0..pairs).zip(weights.chunks_exact(2 * filters)) {
            let weights = weights[2 * first..].first_chunk().expect("whole filters");
            for (row, sums) in rows.iter().zip(&mut sums) {
                add_pairs::<V>(sums, row[i], weights);
            }
        }
    }
    for (place, sums) in sums.iter().enumerate() {
        let at = if bias.len() == filters { 0 } else { (top * places + left + place) * filters };
        let numbers = bias[at + first..].iter().zip(&scales[first..]);
        for ((out, sum), (bias, scale)) in out[(left + place) * filters + first..].iter_mut().zip(sums).zip(numbers) {
            let sum = bias + step * scale * *sum as f32;
            *out = if cut { greater(sum, 0.0) } else { sum };
        }
    }
}

/// Adds the products of two values with their weights of each filter.
#[inline(always)]
fn add_pairs<const V: u8>(sums: &mut [i32; FILTERS], [a, b]: [i16; 2], weights: &[i16; 2 * FILTERS]) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::*;
        let both = i32::from(a) & 0xffff | i32::from(b) << 16;
        if V >= AVX512 {
            // SAFETY: by `V` the caller is compiled for AVX-512 (and its whole dot products), and runs only where it is there.
            unsafe {
                let (sum, weights) =
                    (_mm512_loadu_si512(sums.as_ptr().cast()), _mm512_loadu_si512(weights.as_ptr().cast()));
                let both = _mm512_set1_epi32(both);
                let sum = if V >= VNNI {
                    _mm512_dpwssd_epi32(sum, weights, both)
                } else {
                    _mm512_add_epi32(sum, _mm512_madd_epi16(weights, both))
                };
                _mm512_storeu_si512(sums.as_mut_ptr().cast(), sum);
            }
            return;
        }
        // A level that is the base of this build need not have AVX2.
        if V == FUSED && BASE != FUSED {
            for (sums, weights) in sums.as_chunks_mut::<8>().0.iter_mut().zip(weights.as_chunks::<16>().0) {
                // SAFETY: by `V` the caller is compiled for AVX2, and runs only where it is there; reads and writes are of 32 bytes of an array.
                unsafe {
                    let products =
                        _mm256_madd_epi16(_mm256_loadu_si256(weights.as_ptr().cast()), _mm256_set1_epi32(both));
                    let sum = _mm256_add_epi32(_mm256_loadu_si256(sums.as_ptr().cast()), products);
                    _mm256_storeu_si256(sums.as_mut_ptr().cast(), sum);
                }
            }
            return;
        }
        for (sums, weights) in sums.as_chunks_mut::<4>().0.iter_mut().zip(weights.as_chunks::<8>().0) {
            // SAFETY: every processor of x86-64 has SSE2; reads and writes are of 16 bytes of an array.
            unsafe {
                let products = _mm_madd_epi16(_mm_loadu_si128(weights.as_ptr().cast()), _mm_set1_epi32(both));
                let sum = _mm_add_epi32(_mm_loadu_si128(sums.as_ptr().cast()), products);
                _mm_storeu_si128(sums.as_mut_ptr().cast(), sum);
            }
        }
    }
    #[cfg(target_arch = "wasm32")]
    {
        use std::arch::wasm32::*;
        let both = i16x8(a, b, a, b, a, b, a, b);
        for (sums, weights) in sums.as_chunks_mut::<4>().0.iter_mut().zip(weights.as_chunks::<8>().0) {
            // SAFETY: reads and writes are of 16 bytes of an array.
            unsafe {
                let products = i32x4_dot_i16x8(v128_load(weights.as_ptr().cast()), both);
                let sum = i32x4_add(v128_load(sums.as_ptr().cast()), products);
                v128_store(sums.as_mut_ptr().cast(), sum);
            }
        }
    }
    #[cfg(target_arch = "aarch64")]
    {
        use std::arch::aarch64::*;
        for (sums, weights) in sums.as_chunks_mut::<8>().0.iter_mut().zip(weights.as_chunks::<16>().0) {
            let (low, high) = sums.split_at_mut(4);
            // SAFETY: every processor of this architecture has NEON; reads and writes are of 16 and 32 bytes of arrays.
            unsafe {
                let values = vcreate_s16(u64::from(a as u16) | u64::from(b as u16) << 16);
                let int16x8x2_t(first, second) = vld2q_s16(weights.as_ptr());
                let sum = vmlal_lane_s16::<0>(vld1q_s32(low.as_ptr()), vget_low_s16(first), values);
                vst1q_s32(low.as_mut_ptr(), vmlal_lane_s16::<1>(sum, vget_low_s16(second), values));
                let sum = vmlal_high_lane_s16::<0>(vld1q_s32(high.as_ptr()), first, values);
                vst1q_s32(high.as_mut_ptr(), vmlal_high_lane_s16::<1>(sum, second, values));
            }
        }
    }
    #[cfg(not(any(target_arch = "x86_64", target_arch = "wasm32", target_arch = "aarch64")))]
    for (sum, weights) in sums.iter_mut().zip(weights.as_chunks::<2>().0) {
        // As the instructions above do if a map has values that are not finite.
        *sum = sum.wrapping_add(i32::from(a) * i32::from(weights[0]) + i32::from(b) * i32::from(weights[1]));
    }
}

#[inline(always)]
fn correlate_body<const V: u8>(
    [side, channels, reach]: [usize; 3],
    a: &[f32],
    b: &[f32],
    out: &mut [f32],
    stride: usize,
) {
    let (n, across) = (side * side * channels, 2 * reach + 1);
    assert!(channels > 0 && channels.is_multiple_of(FILTERS), "{channels} channels, not a multiple of {FILTERS}");
    assert!(a.len() == n && b.len() == n, "maps of {side} x {side} x {channels}");
    assert!(stride >= across * across && out.len() == side * side * stride, "a row of {stride} a place");
    for (place, out) in out.chunks_exact_mut(stride).enumerate() {
        let (x, y) = (place % side, place / side);
        let here = &a[place * channels..][..channels];
        for (k, out) in out[..across * across].iter_mut().enumerate() {
            let (to_x, to_y) = ((x + k % across).wrapping_sub(reach), (y + k / across).wrapping_sub(reach));
            *out = 0.0;
            if to_x < side && to_y < side {
                let there = &b[(to_y * side + to_x) * channels..][..channels];
                let mut sums = [0.0f32; FILTERS];
                for (a, b) in here.as_chunks::<FILTERS>().0.iter().zip(there.as_chunks::<FILTERS>().0) {
                    for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
                        *sum = multiply_add::<V>(*a, *b, *sum);
                    }
                }
                *out = crate::sums::fold(sums) / channels as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sums::tests::values;

    /// The definition, by plain loops in f64; and the same bits at every level.
    #[test]
    fn agree_with_the_twin() {
        for (side, channels, size, stride, filters, each) in [
            (18, 1, 3, 1, 16, false),
            (10, 19, 3, 1, 32, false),
            (4, 76, 1, 1, 48, true),
            (9, 2, 2, 1, 16, false),
            (36, 3, 5, 2, 16, false),
            (10, 16, 3, 2, 32, true),
            (8, 5, 3, 1, 16, true),
            (4, 7, 4, 1, 64, false),
        ] {
            let places = (side - size) / stride + 1;
            let (map, scales) = (values(side * side * channels, 1), values(filters, 4));
            let bias = values(if each { places * places * filters } else { filters }, 2);
            let weights: Vec<i8> = values(size * size * channels * filters, 3)
                .iter()
                .map(|x| (x * 127.0).clamp(-128.0, 127.0) as i8)
                .collect();
            let pairs = paired(&weights, size * channels, filters);
            let mut steps = vec![];
            let step = to_steps(&map, (side, channels, 0), &mut steps);
            for cut in [true, false] {
                let layer = Layer { side, channels, size, stride, cut, weights: &pairs, scales: &scales, bias: &bias };
                let mut same = vec![0.0; places * places * filters];
                convolve_on(Level::Portable, &layer, &steps, step, &mut same);
                for (place, f) in (0..places * places).flat_map(|place| (0..filters).map(move |f| (place, f))) {
                    let (x, y) = (place % places, place / places);
                    let mut sum = f64::from(bias[if each { place * filters + f } else { f }]);
                    let mut whole = 0.0;
                    for (i, c) in (0..size * size).flat_map(|i| (0..channels).map(move |c| (i, c))) {
                        let value = map[((y * stride + i / size) * side + x * stride + i % size) * channels + c];
                        let weight = f64::from(scales[f]) * f64::from(weights[(i * channels + c) * filters + f]);
                        sum += f64::from(value) * weight;
                        whole += weight.abs();
                    }
                    let (exact, found) = (if cut { sum.max(0.0) } else { sum }, f64::from(same[place * filters + f]));
                    // Each value is at most half a step off.
                    let most = 0.5 * f64::from(step) * whole + 1e-5 * (1.0 + whole);
                    assert!((found - exact).abs() < most, "{found} is not {exact}");
                }
                for level in Level::all() {
                    let mut out = vec![f32::NAN; same.len()];
                    convolve_on(level, &layer, &steps, step, &mut out);
                    assert_eq!(out, same, "{level:?}");
                }
            }
        }
    }

    /// Steps are rounded to the nearest, stand in their margin, and are the same at every level; what is not finite has none.
    #[test]
    fn a_map_in_steps() {
        let mut out = vec![7; 3];
        let step = to_steps(&[1.0, -2.0, 0.5, 0.0], (2, 1, 1), &mut out);
        assert_eq!(step, 2.0 / STEPS);
        assert_eq!(out, [0, 0, 0, 0, 0, 8192, -16383, 0, 0, 4096, 0, 0, 0, 0, 0, 0, 0]);
        let map = values(100, 5);
        let most = map.iter().fold(0.0f32, |most, x| most.max(x.abs()));
        for level in Level::all() {
            let mut steps = vec![0; map.len()];
            round_steps_at(level, &map, STEPS / most, &mut steps);
            assert_eq!(largest_magnitude_at(level, &map), most);
            for (step, x) in steps.iter().zip(&map) {
                assert!((f32::from(*step) - x * STEPS / most).abs() < 0.51, "{level:?}: {step}");
            }
        }
        for odd in [0.0, f32::INFINITY] {
            assert_eq!(to_steps(&[odd; 4], (2, 1, 0), &mut out), 0.0);
        }
    }

    #[test]
    fn correlations_agree_with_the_twin() {
        let (side, channels, reach, stride) = (5usize, 32, 2usize, 29);
        let (a, b) = (values(side * side * channels, 4), values(side * side * channels, 5));
        for level in Level::all() {
            let mut out = vec![7.0; side * side * stride];
            correlate_at(level, [side, channels, reach], &a, &b, &mut out, stride);
            for (place, out) in out.chunks_exact(stride).enumerate() {
                for (k, found) in out[..25].iter().enumerate() {
                    let (x, y) = ((place % side + k % 5).wrapping_sub(2), (place / side + k / 5).wrapping_sub(2));
                    let inside = x < side && y < side;
                    let product = |c: usize| {
                        f64::from(a[place * channels + c]) * f64::from(b[(y * side + x) * channels + c]) / 32.0
                    };
                    let exact = if inside { (0..channels).map(product).sum::<f64>() } else { 0.0 };
                    assert!((f64::from(*found) - exact).abs() < 1e-5, "{level:?}: {found} is not {exact}");
                }
                assert!(out[25..].iter().all(|x| *x == 7.0), "what is beside them stays");
            }
        }
    }

    #[test]
    #[should_panic(expected = "not a multiple of 16")]
    fn half_lanes_are_refused() {
        let (weights, scales) = (&[0; 96], &[0.0; 8]);
        let layer = Layer { side: 6, channels: 1, size: 3, stride: 1, cut: true, weights, scales, bias: scales };
        convolve(&layer, &[0; 37], 1.0, &mut [0.0; 128]);
    }
}
