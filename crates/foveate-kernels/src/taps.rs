//! Bilinear reads of a plane at the cells of a template carried by an affine map: the eye of a particle.
//!
//! Cell i is at (x, y) = (cx, cy) + du\[i\] (ux, uy) + dv\[i\] (vx, vy) of the image. Its value is interpolated
//! between four samples. Outside the plane, border pixels repeat.

#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
mod wasm;

use crate::level::{levels, multiply_add};
use crate::plane::{CELLS, Plane, padded};
use crate::sums::copy_short;
#[cfg(target_arch = "x86_64")]
use crate::{level::AVX512, upright::Grid};

/// Cells whose positions are computed before any is read, because a load waits long for a store just before it (Zen
/// 4: 1.1 ns a cell block by block, 0.65 ns this way).
const BLOCKS: usize = 16;

/// Samples of a plane: as f32, every index of a column is below 2^31.
const MOST: usize = (1 << 31) - 128;
const _: () = assert!((MOST as f32) < (1u32 << 31) as f32);

levels! {
    /// `out[i]` ← the plane at the image of (`du[i]`, `dv[i]`) under `map` = \[cx, cy, ux, uy, vx, vy\].
    ///
    /// A coordinate that is not a number reads the plane's first column or row.
    ///
    /// # Panics
    /// If the plane is empty, its data too short or longer than 2^31 − 128, or `du`, `dv` and `out` differ in length.
    pub fn taps / taps_at (plane: Plane<'_>, map: [f32; 6], du: &[f32], dv: &[f32], out: &mut [f32]) = taps_body
}

levels! {
    /// [`taps`] for many maps: those of `maps[r]` are written to `out[r × stride..]`.
    ///
    /// # Panics
    /// As `taps`, and if `out` is too short or `stride` less than the number of cells.
    pub fn taps_rows / taps_rows_at (
        plane: Plane<'_>, maps: &[[f32; 6]], du: &[f32], dv: &[f32], out: &mut [f32], stride: usize
    ) = taps_rows_body
}

#[inline(always)]
fn taps_body<const V: u8>(plane: Plane<'_>, map: [f32; 6], du: &[f32], dv: &[f32], out: &mut [f32]) {
    assert!(du.len() == out.len(), "du, dv and out must be equally long");
    taps_rows_body::<V>(plane, &[map], du, dv, out, out.len());
}

#[inline(always)]
fn taps_rows_body<const V: u8>(
    plane: Plane<'_>,
    maps: &[[f32; 6]],
    du: &[f32],
    dv: &[f32],
    out: &mut [f32],
    stride: usize,
) {
    plane.check();
    assert!(du.len() == dv.len() && du.len() <= stride, "du and dv must be equally long, and fit into a row");
    let needed = maps.len().checked_sub(1).map_or(0, |last| last * stride + du.len());
    assert!(needed <= out.len(), "out is too short for {} rows", maps.len());
    #[cfg(target_arch = "x86_64")]
    if V >= AVX512
        && plane.width.min(plane.height) > 1
        && maps.iter().all(|map| map[3] == 0.0 && map[4] == 0.0)
        && let Some(grid) = Grid::of(du, dv)
    {
        for (r, map) in maps.iter().enumerate() {
            let out = &mut out[r * stride..][..du.len()];
            // SAFETY: by `V` the processor has AVX-512, and the plane has been checked.
            if !unsafe { grid.read::<V>(&plane, map, out) } {
                scattered::<V>(&plane, &[*map], du, dv, out, stride);
            }
        }
        return;
    }
    scattered::<V>(&plane, maps, du, dv, out, stride);
}

/// Cells wherever they are.
#[inline(always)]
fn scattered<const V: u8>(
    plane: &Plane<'_>,
    maps: &[[f32; 6]],
    du: &[f32],
    dv: &[f32],
    out: &mut [f32],
    stride: usize,
) {
    let mut places = [Places { at: [0; CELLS], fx: [0.0; CELLS], fy: [0.0; CELLS] }; BLOCKS];
    for (part, (du, dv)) in du.chunks(BLOCKS * CELLS).zip(dv.chunks(BLOCKS * CELLS)).enumerate() {
        let blocks = du.len().div_ceil(CELLS);
        let together = BLOCKS / blocks;
        let whole = du.len() / CELLS * CELLS;
        let last = (whole < du.len()).then(|| (padded(&du[whole..]), padded(&dv[whole..])));
        for (group, maps) in maps.chunks(together).enumerate() {
            for (map, places) in maps.iter().zip(places.chunks_exact_mut(blocks)) {
                let all = du.as_chunks().0.iter().zip(dv.as_chunks().0).chain(last.iter().map(|(du, dv)| (du, dv)));
                all.zip(places).for_each(|((du, dv), place)| place.find::<V>(plane, map, du, dv));
            }
            for (r, places) in places.chunks_exact(blocks).take(maps.len()).enumerate() {
                let row = &mut out[(group * together + r) * stride + part * BLOCKS * CELLS..][..du.len()];
                for (place, out) in places.iter().zip(row.chunks_mut(CELLS)) {
                    if let Some(out) = out.first_chunk_mut() {
                        place.read::<V>(plane, out);
                    } else {
                        let mut values = [0.0; CELLS];
                        place.read::<V>(plane, &mut values);
                        copy_short(&values[..out.len()], out);
                    }
                }
            }
        }
    }
}

impl Plane<'_> {
    #[inline(always)]
    fn check(&self) {
        let &Self { data, width, height, stride, .. } = self;
        assert!(width > 0 && height > 0 && stride >= width, "a plane of {width} x {height}, rows {stride} apart");
        assert!(data.len() <= MOST, "a plane of more than {MOST} samples");
        assert!(
            (height - 1).checked_mul(stride).is_some_and(|n| n + width <= data.len()),
            "the plane's data end too soon"
        );
    }
}

/// Where 16 cells lie.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Places {
    /// Index of the sample to the left and above: at most the last but one of a row and a column, if there are two.
    at: [i32; CELLS],
    /// Fraction of the way to the sample to the right.
    fx: [f32; CELLS],
    /// Fraction of the way to the sample below.
    fy: [f32; CELLS],
}

impl Places {
    #[cfg(not(all(target_arch = "wasm32", target_feature = "simd128")))]
    #[inline(always)]
    fn find<const V: u8>(&mut self, plane: &Plane<'_>, map: &[f32; 6], du: &[f32; CELLS], dv: &[f32; CELLS]) {
        use crate::level::{greater, lesser};
        let &[cx, cy, ux, uy, vx, vy] = map;
        let (cx, cy) = (cx - plane.x0, cy - plane.y0);
        let (right, bottom) = ((plane.width - 1) as f32, (plane.height - 1) as f32);
        let (last_x, last_y) = (plane.width.saturating_sub(2) as i32, plane.height.saturating_sub(2) as i32);
        let stride = plane.stride as i32;
        for i in 0..CELLS {
            let x = multiply_add::<V>(ux, du[i], multiply_add::<V>(vx, dv[i], cx));
            let y = multiply_add::<V>(uy, du[i], multiply_add::<V>(vy, dv[i], cy));
            let (x, y) = (lesser(greater(x, 0.0), right), lesser(greater(y, 0.0), bottom));
            // SAFETY: x and y are numbers from 0 to below 2^31: `greater` gives 0 for NaN.
            let (ix, iy) = unsafe { (x.to_int_unchecked::<i32>(), y.to_int_unchecked::<i32>()) };
            let (ix, iy) = (ix.min(last_x), iy.min(last_y));
            (self.fx[i], self.fy[i]) = (x - ix as f32, y - iy as f32);
            self.at[i] = iy * stride + ix;
        }
    }

    /// Interpolates between the samples of the plane.
    #[inline(always)]
    fn read<const V: u8>(&self, plane: &Plane<'_>, out: &mut [f32; CELLS]) {
        if plane.width < 2 || plane.height < 2 {
            return self.read_narrow::<V>(plane, out);
        }
        // SAFETY: every `at` is at most (height - 2) × stride + width - 2, and the plane has been checked.
        unsafe { self.read_corners::<V>(plane, out) }
    }

    /// Interpolates in a plane of one column or one row.
    #[cold]
    fn read_narrow<const V: u8>(&self, plane: &Plane<'_>, out: &mut [f32; CELLS]) {
        let (right, below) = ((plane.width > 1) as usize, (plane.height > 1) as usize * plane.stride);
        *out = std::array::from_fn(|i| {
            let data = &plane.data[self.at[i] as usize..];
            mix::<V>(data[0], data[right], data[below], data[below + right], self.fx[i], self.fy[i])
        });
    }

    /// Gathers are slower than loads of pairs on the processors tried (Zen 4: 2.3 ns a cell against 0.65).
    ///
    /// # Safety
    /// The samples at `at`, to the right, below, and both must lie in the plane's data.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    unsafe fn read_corners<const V: u8>(&self, plane: &Plane<'_>, out: &mut [f32; CELLS]) {
        use std::arch::x86_64::*;
        for four in (0..CELLS).step_by(4) {
            // SAFETY: the caller guarantees that pairs of samples lie in the data. SSE2 is part of x86-64, and `V` is a
            // vector with FMA only on processors with FMA.
            unsafe {
                let above = plane.data.as_ptr();
                let below = above.add(plane.stride);
                let pairs = |row: *const f32, i: usize| {
                    // `_mm_load_sd` would demand the alignment of a double.
                    let pair = |i: usize| row.add(self.at[four + i] as usize).cast::<f64>().read_unaligned();
                    _mm_castpd_ps(_mm_setr_pd(pair(i), pair(i + 1)))
                };
                let mix = |fraction: __m128, from: __m128, to: __m128| match V {
                    0 => _mm_add_ps(_mm_mul_ps(fraction, _mm_sub_ps(to, from)), from),
                    _ => _mm_fmadd_ps(fraction, _mm_sub_ps(to, from), from),
                };
                let fx = _mm_loadu_ps(self.fx[four..].as_ptr());
                let row = |row: *const f32| {
                    let (first, second) = (pairs(row, 0), pairs(row, 2));
                    let left = _mm_shuffle_ps::<0b10_00_10_00>(first, second);
                    mix(fx, left, _mm_shuffle_ps::<0b11_01_11_01>(first, second))
                };
                let value = mix(_mm_loadu_ps(self.fy[four..].as_ptr()), row(above), row(below));
                _mm_storeu_ps(out[four..].as_mut_ptr(), value);
            }
        }
    }

    /// # Safety
    /// The samples at `at`, to the right, below, and both must lie in the plane's data.
    #[cfg(not(any(target_arch = "x86_64", all(target_arch = "wasm32", target_feature = "simd128"))))]
    #[inline(always)]
    unsafe fn read_corners<const V: u8>(&self, plane: &Plane<'_>, out: &mut [f32; CELLS]) {
        *out = std::array::from_fn(|i| {
            // SAFETY: the caller's word.
            let [a, b, c, d] = unsafe {
                let above = plane.data.as_ptr().add(self.at[i] as usize);
                let below = above.add(plane.stride);
                [*above, *above.add(1), *below, *below.add(1)]
            };
            mix::<V>(a, b, c, d, self.fx[i], self.fy[i])
        });
    }
}

/// (a, b) above (c, d), at the fractions fx and fy.
#[inline(always)]
fn mix<const V: u8>(a: f32, b: f32, c: f32, d: f32, fx: f32, fy: f32) -> f32 {
    let (above, below) = (multiply_add::<V>(fx, b - a, a), multiply_add::<V>(fx, d - c, c));
    multiply_add::<V>(fy, below - above, above)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Level;
    use crate::sums::tests::values;

    /// The plain twin, in f64 from the place on.
    fn twin(plane: &Plane<'_>, map: &[f32; 6], du: f32, dv: f32) -> f64 {
        let [cx, cy, ux, uy, vx, vy] = map.map(f64::from);
        let (du, dv) = (du as f64, dv as f64);
        let at =
            |x: usize, y: usize| plane.data[y.min(plane.height - 1) * plane.stride + x.min(plane.width - 1)] as f64;
        let x = (cx - plane.x0 as f64 + ux * du + vx * dv).clamp(0.0, (plane.width - 1) as f64);
        let y = (cy - plane.y0 as f64 + uy * du + vy * dv).clamp(0.0, (plane.height - 1) as f64);
        let (ix, iy) = (x.floor(), y.floor());
        let (fx, fy, ix, iy) = (x - ix, y - iy, ix as usize, iy as usize);
        let row = |y| at(ix, y) * (1.0 - fx) + at(ix + 1, y) * fx;
        row(iy) * (1.0 - fy) + row(iy + 1) * fy
    }

    fn cells(n: usize) -> (Vec<f32>, Vec<f32>) {
        (0..n).map(|i| ((i % 12) as f32 - 5.5, (i / 12) as f32 - 5.5)).unzip()
    }

    /// Inside, across every border and far away, on planes down to one sample.
    #[test]
    fn agree_with_the_twin() {
        for (width, height, stride) in [(40, 30, 43), (2, 2, 2), (1, 5, 3), (5, 1, 5), (1, 1, 1)] {
            let data = values((height - 1) * stride + width, 1);
            let plane = Plane { data: &data, width, height, stride, x0: 100.5, y0: -20.0 };
            for n in [0, 1, 15, 16, 17, 144, 300] {
                let (du, dv) = cells(n);
                for (r, random) in values(60, 2).chunks(6).enumerate() {
                    let [a, b, c, d, e, f] = [0, 1, 2, 3, 4, 5].map(|i| random[i]);
                    let (cx, cy) = (101.0 + 40.0 * a - 2.0 * r as f32, -20.0 + 30.0 * b);
                    let map = [cx, cy, 0.5 + c, d - 0.5, e - 0.5, 0.5 + f];
                    for level in Level::all() {
                        let mut out = vec![f32::NAN; n];
                        taps_at(level, plane, map, &du, &dv, &mut out);
                        for i in 0..n {
                            let truth = twin(&plane, &map, du[i], dv[i]);
                            assert!((out[i] as f64 - truth).abs() < 5e-5, "{level:?}: {} is not {truth}", out[i]);
                        }
                    }
                }
            }
        }
    }

    /// A ramp is read exactly, up to the rounding of the place; whole places give the sample's own bits.
    #[test]
    fn ramps_and_whole_places() {
        let data: Vec<f32> = (0..50 * 60).map(|i| (i % 60) as f32 * 0.25 + (i / 60) as f32 * 2.0).collect();
        let plane = Plane { data: &data, width: 60, height: 50, stride: 60, x0: 10.0, y0: 20.0 };
        let (du, dv) = cells(144);
        for level in Level::all() {
            let mut out = [0.0; 144];
            taps_at(level, plane, [40.3, 44.6, 1.1, 0.2, -0.2, 1.1], &du, &dv, &mut out);
            for i in 0..144 {
                let (x, y) = (30.3 + 1.1 * du[i] - 0.2 * dv[i], 24.6 + 0.2 * du[i] + 1.1 * dv[i]);
                assert!((out[i] - (0.25 * x + 2.0 * y)).abs() < 3e-5, "{level:?}");
            }
            taps_at(level, plane, [40.5, 44.5, 1.0, 0.0, 0.0, 1.0], &du, &dv, &mut out);
            for i in 0..144 {
                assert_eq!(out[i], data[(24.5 + dv[i]) as usize * 60 + (30.5 + du[i]) as usize], "{level:?}");
            }
        }
    }

    /// A cell alone, and a row among rows, give the bits they give together.
    #[test]
    fn place_does_not_matter() {
        let data = values(100 * 100, 3);
        let plane = Plane { data: &data, width: 100, height: 100, stride: 100, x0: 0.0, y0: 0.0 };
        for n in [48, 144, 257, 600] {
            let (du, dv) = cells(n);
            let maps: Vec<[f32; 6]> =
                values(60, 4).chunks(6).map(|r| [99.0 * r[0], 99.0 * r[1], 1.0 + r[2], r[3], -r[3], 1.0]).collect();
            for level in Level::all() {
                let mut rows = vec![-1.0; 10 * (n + 5)];
                taps_rows_at(level, plane, &maps, &du, &dv, &mut rows, n + 5);
                for (map, row) in maps.iter().zip(rows.chunks(n + 5)) {
                    let mut together = vec![0.0; n];
                    taps_at(level, plane, *map, &du, &dv, &mut together);
                    assert_eq!((&row[..n], &row[n..]), (&together[..], &[-1.0; 5][..]), "{level:?}");
                    for i in [0, 1, n / 2, n - 1] {
                        let mut alone = [0.0];
                        taps_at(level, plane, *map, &du[i..=i], &dv[i..=i], &mut alone);
                        assert_eq!(alone[0], together[i], "{level:?}");
                    }
                }
            }
        }
    }

    /// Cells of a grid that is not turned, near each other and far apart, have the bits they have alone.
    #[test]
    fn grids_are_read_as_their_cells() {
        let data = values(700 * 90, 6);
        for (width, height) in [(700, 90), (3, 2), (2, 300), (60, 1)] {
            let plane = Plane { data: &data, width, height, stride: width, x0: -3.5, y0: 7.0 };
            for (columns, rows) in [(2, 1), (4, 4), (18, 18), (16, 3), (17, 20), (65, 2)] {
                let (du, dv): (Vec<f32>, Vec<f32>) =
                    (0..columns * rows).map(|i| ((i % columns) as f32 * 0.1, (i / columns) as f32 * 0.1)).unzip();
                for random in values(80, 7).chunks(4) {
                    let size = 100.0 * random[2] * random[2];
                    let map = [700.0 * random[0] - 20.0, 90.0 * random[1], size, 0.0, 0.0, size * (0.5 + random[3])];
                    for level in Level::all() {
                        let mut grid = vec![f32::NAN; columns * rows];
                        taps_at(level, plane, map, &du, &dv, &mut grid);
                        for (i, value) in grid.iter().enumerate() {
                            let mut alone = [0.0];
                            taps_at(level, plane, map, &du[i..=i], &dv[i..=i], &mut alone);
                            assert_eq!(alone[0], *value, "{level:?}, {columns} x {rows}: cell {i} of {map:?}");
                        }
                    }
                }
            }
        }
    }

    /// Wild maps stay inside the plane.
    #[test]
    fn wild_maps_read_the_border() {
        let data = values(12, 5);
        let plane = Plane { data: &data, width: 4, height: 3, stride: 4, x0: 0.0, y0: 0.0 };
        for level in Level::all() {
            for (x, column) in [(f32::NAN, 0), (f32::INFINITY, 3), (f32::NEG_INFINITY, 0), (1e30, 3), (-1e30, 0)] {
                let mut out = [0.0; 3];
                taps_at(level, plane, [x, 1.0, 1.0, 0.0, 0.0, 1.0], &[0.0; 3], &[0.0; 3], &mut out);
                assert_eq!(out, [data[4 + column]; 3], "{level:?}: {x}");
            }
        }
    }

    #[test]
    #[should_panic(expected = "the plane's data end too soon")]
    fn short_data_are_refused() {
        let plane = Plane { data: &[0.0; 11], width: 4, height: 3, stride: 4, x0: 0.0, y0: 0.0 };
        taps(plane, [0.0; 6], &[], &[], &mut []);
    }
}
