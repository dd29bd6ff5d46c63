//! Layers of a convolutional network on a small square map: filters, rectification, mean pooling; and the correlation
//! of two maps.
//!
//! Maps have their channels side by side: value c of place (x, y) is at (y · side + x) · channels + c.

use crate::level::{AVX512, greater, levels, multiply_add};

/// Filters that are summed side by side: a layer has a multiple of them.
pub const FILTERS: usize = 16;
/// Places in a row that are summed side by side; twice as many where there are registers for them.
const PLACES: usize = 4;
const MANY: usize = 8;

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
    /// Side of the pooling window, 1 or 2.
    pub pool: usize,
    /// Whether negative values become 0.
    pub cut: bool,
    /// For each row, column and channel of a filter, the weights of all filters.
    pub weights: &'a [f32],
    /// One a filter, or one a place and filter.
    pub bias: &'a [f32],
}

levels! {
    /// `out` ← means over `pool` × `pool` places of bias + filter · `map`, rectified if configured, at all places
    /// where the filters lie inside the map: `(((side - size) / stride + 1) / pool)²` places with one channel a
    /// filter.
    ///
    /// # Panics
    /// If the number of filters is not a multiple of 16, the places of filters along a side are not a multiple of 4
    /// with pooling, or a length is wrong.
    pub fn convolve / convolve_at (layer: &Layer<'_>, map: &[f32], out: &mut [f32]) = convolve_body
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
fn convolve_body<const V: u8>(layer: &Layer<'_>, map: &[f32], out: &mut [f32]) {
    let Layer { side, channels, size, stride, pool, weights, bias, .. } = *layer;
    assert!((1..=2).contains(&pool), "means over 1 or 2 places along a side, not {pool}");
    assert!(size > 0 && stride > 0 && channels > 0, "a filter has a size, a stride and channels");
    let places = if side < size { 0 } else { (side - size) / stride + 1 };
    let filters = weights.len() / (size * size * channels);
    assert!(
        places > 0 && (pool == 1 || places.is_multiple_of(PLACES)),
        "{places} places along a side, not a multiple of {PLACES}"
    );
    assert!(filters > 0 && filters.is_multiple_of(FILTERS), "{filters} filters, not a multiple of {FILTERS}");
    assert!(map.len() == side * side * channels, "a map of {side} x {side} x {channels}");
    assert!(weights.len() == size * size * channels * filters, "weights of {filters} filters of {size} x {size}");
    assert!([filters, places * places * filters].contains(&bias.len()), "a bias a filter, or a place and filter");
    assert!(out.len() == (places / pool).pow(2) * filters, "a value a filter and mean");
    for (above, out) in out.chunks_exact_mut(places / pool * filters).enumerate() {
        for first in 0..filters / FILTERS {
            let mut left = 0;
            while V == AVX512 && left + MANY <= places {
                some::<V, MANY>(layer, map, (filters, places), (above, left, first), out);
                left += MANY;
            }
            while left + PLACES <= places {
                some::<V, PLACES>(layer, map, (filters, places), (above, left, first), out);
                left += PLACES;
            }
            while left < places {
                some::<V, 1>(layer, map, (filters, places), (above, left, first), out);
                left += 1;
            }
        }
    }
}

/// Sixteen filters at `P` places in a row.
#[inline(always)]
fn some<const V: u8, const P: usize>(
    layer: &Layer<'_>,
    map: &[f32],
    (filters, places): (usize, usize),
    (above, left, first): (usize, usize, usize),
    out: &mut [f32],
) {
    let Layer { side, channels, size, stride, pool, cut, weights, bias } = *layer;
    let (across, share) = (size * channels, 1.0 / (pool * pool) as f32);
    let mut means = [[0.0f32; FILTERS]; P];
    for top in pool * above..pool * (above + 1) {
        let mut sums = [[0.0f32; FILTERS]; P];
        for (place, sums) in sums.iter_mut().enumerate() {
            let at = if bias.len() == filters { 0 } else { (top * places + left + place) * filters };
            sums.copy_from_slice(&bias[at + first * FILTERS..][..FILTERS]);
        }
        for row in 0..size {
            let from = ((top * stride + row) * side + left * stride) * channels;
            let rows: [&[f32]; P] = std::array::from_fn(|place| &map[from + place * stride * channels..][..across]);
            let weights = &weights[row * across * filters..][..across * filters];
            for (i, weights) in (0..across).zip(weights.chunks_exact(filters)) {
                let weights: &[f32; FILTERS] = weights[first * FILTERS..].first_chunk().expect("whole filters");
                for (row, sums) in rows.iter().zip(&mut sums) {
                    let value = row[i];
                    for (sum, weight) in sums.iter_mut().zip(weights) {
                        *sum = multiply_add::<V>(value, *weight, *sum);
                    }
                }
            }
        }
        for (place, sums) in sums.iter().enumerate() {
            for (mean, sum) in means[place / pool].iter_mut().zip(sums) {
                *mean += share * if cut { greater(*sum, 0.0) } else { *sum };
            }
        }
    }
    for (place, means) in means[..P.div_ceil(pool)].iter().enumerate() {
        out[(left / pool + place) * filters + first * FILTERS..][..FILTERS].copy_from_slice(means);
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
    use crate::Level;
    use crate::sums::tests::values;

    /// The definition, by plain loops in f64.
    #[test]
    fn agree_with_the_twin() {
        for (side, channels, size, stride, pool, filters, each) in [
            (18, 1, 3, 1, 2, 16, false),
            (10, 19, 3, 1, 1, 32, false),
            (4, 76, 1, 1, 1, 48, true),
            (9, 2, 2, 1, 2, 16, false),
            (36, 3, 5, 2, 1, 16, false),
            (10, 16, 3, 2, 1, 32, true),
            (8, 5, 3, 1, 1, 16, true),
            (4, 7, 4, 1, 1, 64, false),
        ] {
            let places = (side - size) / stride + 1;
            let map = values(side * side * channels, 1);
            let bias = values(if each { places * places * filters } else { filters }, 2);
            let weights = values(size * size * channels * filters, 3);
            for cut in [true, false] {
                let layer = Layer { side, channels, size, stride, pool, cut, weights: &weights, bias: &bias };
                let mut exact = vec![0.0f64; (places / pool).pow(2) * filters];
                for (place, f) in (0..places * places).flat_map(|place| (0..filters).map(move |f| (place, f))) {
                    let (x, y) = (place % places, place / places);
                    let mut sum = f64::from(bias[if each { place * filters + f } else { f }]);
                    for (i, c) in (0..size * size).flat_map(|i| (0..channels).map(move |c| (i, c))) {
                        let value = map[((y * stride + i / size) * side + x * stride + i % size) * channels + c];
                        sum += f64::from(value) * f64::from(weights[(i * channels + c) * filters + f]);
                    }
                    let sum = if cut { sum.max(0.0) } else { sum };
                    exact[(y / pool * (places / pool) + x / pool) * filters + f] += sum / (pool * pool) as f64;
                }
                for level in Level::all() {
                    let mut out = vec![f32::NAN; exact.len()];
                    convolve_at(level, &layer, &map, &mut out);
                    for (out, exact) in out.iter().zip(&exact) {
                        assert!((f64::from(*out) - exact).abs() < 1e-4, "{level:?}: {out} is not {exact}");
                    }
                }
            }
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
        let layer = Layer {
            side: 6,
            channels: 1,
            size: 3,
            stride: 1,
            pool: 2,
            cut: true,
            weights: &[0.0; 72],
            bias: &[0.0; 8],
        };
        convolve(&layer, &[0.0; 36], &mut [0.0; 32]);
    }
}
