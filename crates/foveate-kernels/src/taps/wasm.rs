//! Places and samples by WebAssembly's vectors.

use std::arch::wasm32::*;

use super::Places;
use crate::plane::{CELLS, Plane};

impl Places {
    /// [`Places::find`] of other processors; here the compiler does not find it out by itself.
    #[inline(always)]
    pub(super) fn find<const V: u8>(
        &mut self,
        plane: &Plane<'_>,
        map: &[f32; 6],
        du: &[f32; CELLS],
        dv: &[f32; CELLS],
    ) {
        let &[cx, cy, ux, uy, vx, vy] = map;
        let along = |origin: f32, u: f32, v: f32, du, dv, end: f32, last: usize| {
            let place = f32x4_add(f32x4_mul(f32x4_splat(v), dv), f32x4_splat(origin));
            let place = f32x4_add(f32x4_mul(f32x4_splat(u), du), place);
            // `greater` and `lesser`: the second where it is the greater, or the lesser.
            let place = f32x4_pmin(f32x4_splat(end), f32x4_pmax(f32x4_splat(0.0), place));
            let before = i32x4_min(i32x4_trunc_sat_f32x4(place), i32x4_splat(last as i32));
            (before, f32x4_sub(place, f32x4_convert_i32x4(before)))
        };
        let (cx, cy) = (cx - plane.x0, cy - plane.y0);
        let (width, height, stride) = (plane.width, plane.height, i32x4_splat(plane.stride as i32));
        for four in (0..CELLS).step_by(4) {
            // SAFETY: all of these have sixteen values.
            unsafe {
                let (du, dv) = (v128_load(du[four..].as_ptr().cast()), v128_load(dv[four..].as_ptr().cast()));
                let (ix, fx) = along(cx, ux, vx, du, dv, (width - 1) as f32, width.saturating_sub(2));
                let (iy, fy) = along(cy, uy, vy, du, dv, (height - 1) as f32, height.saturating_sub(2));
                v128_store(self.at[four..].as_mut_ptr().cast(), i32x4_add(i32x4_mul(iy, stride), ix));
                v128_store(self.fx[four..].as_mut_ptr().cast(), fx);
                v128_store(self.fy[four..].as_mut_ptr().cast(), fy);
            }
        }
    }

    /// [`Places::read_corners`] of other processors.
    ///
    /// # Safety
    /// The samples at `at`, to the right, below, and both must lie in the plane's data.
    #[inline(always)]
    pub(super) unsafe fn read_corners<const V: u8>(&self, plane: &Plane<'_>, out: &mut [f32; CELLS]) {
        for four in (0..CELLS).step_by(4) {
            // SAFETY: pairs of samples lie in the data by the caller's word, four cells in places and `out`.
            unsafe {
                let above = plane.data.as_ptr();
                let below = above.add(plane.stride);
                let pairs = |row: *const f32, i: usize| {
                    let pair = |i: usize| row.add(self.at[four + i] as usize).cast::<u64>();
                    v128_load64_lane::<1>(v128_load64_zero(pair(i)), pair(i + 1))
                };
                let mix = |fraction, from, to| f32x4_add(f32x4_mul(fraction, f32x4_sub(to, from)), from);
                let fx = v128_load(self.fx[four..].as_ptr().cast());
                let row = |row: *const f32| {
                    let (first, second) = (pairs(row, 0), pairs(row, 2));
                    mix(fx, i32x4_shuffle::<0, 2, 4, 6>(first, second), i32x4_shuffle::<1, 3, 5, 7>(first, second))
                };
                let value = mix(v128_load(self.fy[four..].as_ptr().cast()), row(above), row(below));
                v128_store(out[four..].as_mut_ptr().cast(), value);
            }
        }
    }
}
