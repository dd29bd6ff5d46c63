//! A layer of a convolutional network on a small square map: filters, what is negative cut off, means over neighbouring places.
//!
//! Maps have their channels side by side: value c of place (x, y) is at (y · side + x) · channels + c.

use crate::level::{greater, levels, multiply_add};

/// Filters that are summed side by side: a layer has a multiple of them.
pub const FILTERS: usize = 16;
/// Places in a row that are summed side by side.
const PLACES: usize = 4;

/// The numbers of a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer<'a> {
    /// Places along a side of what it reads.
    pub side: usize,
    /// Channels of what it reads.
    pub channels: usize,
    /// Places along a side of a filter.
    pub size: usize,
    /// Places along a side of those whose mean is taken, 1 or 2.
    pub pool: usize,
    /// For each row, column and channel of a filter, the weights of all filters.
    pub weights: &'a [f32],
    /// One a filter.
    pub bias: &'a [f32],
}

levels! {
    /// `out` ← means over `pool` × `pool` places of max(0, bias + filter · `map`), with the filters at all places where they lie in the
    /// map: `((side - size + 1) / pool)²` places of as many channels as there are filters.
    ///
    /// # Panics
    /// If filters are no multiple of 16, places of filters along a side no multiple of 4, or a length is another.
    pub fn convolve / convolve_at (layer: &Layer<'_>, map: &[f32], out: &mut [f32]) = convolve_body
}

#[inline(always)]
fn convolve_body<const V: u8>(layer: &Layer<'_>, map: &[f32], out: &mut [f32]) {
    let Layer { side, channels, size, pool, weights, bias } = *layer;
    let across = size * channels;
    assert!((1..=2).contains(&pool), "means over 1 or 2 places along a side, not {pool}");
    let (places, filters) = ((side + 1).saturating_sub(size), bias.len());
    assert!(places > 0 && places.is_multiple_of(PLACES), "{places} places along a side, not a multiple of {PLACES}");
    assert!(filters > 0 && filters.is_multiple_of(FILTERS), "{filters} filters, not a multiple of {FILTERS}");
    assert!(map.len() == side * side * channels, "a map of {side} x {side} x {channels}");
    assert!(weights.len() == size * size * channels * filters, "weights of {filters} filters of {size} x {size}");
    assert!(out.len() == (places / pool).pow(2) * filters, "a value a filter and mean");
    let share = 1.0 / (pool * pool) as f32;
    for (above, out) in out.chunks_exact_mut(places / pool * filters).enumerate() {
        for (first, bias) in bias.as_chunks::<FILTERS>().0.iter().enumerate() {
            for left in (0..places).step_by(PLACES) {
                let mut means = [[0.0f32; FILTERS]; PLACES];
                for top in pool * above..pool * (above + 1) {
                    let mut sums = [*bias; PLACES];
                    for row in 0..size {
                        let map = &map[((top + row) * side + left) * channels..][..(PLACES + size - 1) * channels];
                        let weights = &weights[row * across * filters..][..across * filters];
                        for (i, weights) in weights.chunks_exact(filters).enumerate() {
                            let weights: &[f32; FILTERS] =
                                weights[first * FILTERS..].first_chunk().expect("whole filters");
                            for (place, sums) in sums.iter_mut().enumerate() {
                                let value = map[place * channels + i];
                                for (sum, weight) in sums.iter_mut().zip(weights) {
                                    *sum = multiply_add::<V>(value, *weight, *sum);
                                }
                            }
                        }
                    }
                    for (place, sums) in sums.iter().enumerate() {
                        for (mean, sum) in means[place / pool].iter_mut().zip(sums) {
                            *mean += share * greater(*sum, 0.0);
                        }
                    }
                }
                for (place, means) in means[..PLACES / pool].iter().enumerate() {
                    out[(left / pool + place) * filters + first * FILTERS..][..FILTERS].copy_from_slice(means);
                }
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
        for (side, channels, size, pool, filters) in
            [(18, 1, 3, 2, 16), (10, 19, 3, 1, 32), (4, 76, 1, 1, 48), (9, 2, 2, 2, 16)]
        {
            let (map, bias) = (values(side * side * channels, 1), values(filters, 2));
            let weights = values(size * size * channels * filters, 3);
            let layer = Layer { side, channels, size, pool, weights: &weights, bias: &bias };
            let places = side + 1 - size;
            let mut exact = vec![0.0f64; (places / pool).pow(2) * filters];
            for (place, f) in (0..places * places).flat_map(|place| (0..filters).map(move |f| (place, f))) {
                let (x, y) = (place % places, place / places);
                let mut sum = f64::from(bias[f]);
                for (i, c) in (0..size * size).flat_map(|i| (0..channels).map(move |c| (i, c))) {
                    let value = map[((y + i / size) * side + x + i % size) * channels + c];
                    sum += f64::from(value) * f64::from(weights[(i * channels + c) * filters + f]);
                }
                exact[(y / pool * (places / pool) + x / pool) * filters + f] += sum.max(0.0) / (pool * pool) as f64;
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

    #[test]
    #[should_panic(expected = "not a multiple of 16")]
    fn half_lanes_are_refused() {
        let layer = Layer { side: 6, channels: 1, size: 3, pool: 2, weights: &[0.0; 72], bias: &[0.0; 8] };
        convolve(&layer, &[0.0; 36], &mut [0.0; 32]);
    }
}
