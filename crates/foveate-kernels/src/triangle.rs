//! Cholesky factors in double precision: A = UᵀU, the inverse W = U⁻ᵀ of its transpose, and sums over A⁻¹ = WᵀW.
//!
//! A matrix is rows of `stride` numbers, as many as columns; `stride` is a multiple of [`SQUARE`]. U is the upper
//! triangle of its matrix, W the lower one; the other side of the diagonal is finite and unused.
//!
//! Each entry is one sum over k in order, however the work is cut into tiles: a factor that grew by rows ([`extend`]) has
//! the bits of one made at once ([`factor`]).
// Tiles stay in registers only where their loops run over constants and no closure hides the instructions.
#![allow(clippy::needless_range_loop)]

#[cfg(target_arch = "x86_64")]
use crate::level::{AVX512, FUSED};
use crate::level::{fused, levels};
use crate::vector::Vector;

/// Rows are multiples of this many numbers long.
pub const SQUARE: usize = 16;

/// `R` rows of `C` registers.
pub(crate) type Tile<T, const R: usize, const C: usize = 2> = [[T; C]; R];

/// acc[r][c] − Σₖ p[k][r] q[k][c] over `depth` rows, `strides` apart.
#[inline(always)]
pub(crate) fn subtract<T: Vector, const R: usize, const C: usize>(
    mut acc: Tile<T, R, C>,
    p: &[f64],
    q: &[f64],
    strides: (usize, usize),
    depth: usize,
) -> Tile<T, R, C> {
    for k in 0..depth {
        let (p, q) = (&p[k * strides.0..][..R], &q[k * strides.1..][..C * T::N]);
        let mut across = [T::splat(0.0); C];
        for c in 0..C {
            across[c] = T::load(&q[c * T::N..]);
        }
        for r in 0..R {
            let p = T::splat(p[r]);
            for c in 0..C {
                acc[r][c] = acc[r][c].minus(p, across[c]);
            }
        }
    }
    acc
}

#[inline(always)]
pub(crate) fn load<T: Vector, const R: usize, const C: usize>(
    a: &[f64],
    stride: usize,
    row: usize,
    column: usize,
) -> Tile<T, R, C> {
    let mut tile = [[T::splat(0.0); C]; R];
    for r in 0..R {
        let row = &a[(row + r) * stride + column..][..C * T::N];
        for c in 0..C {
            tile[r][c] = T::load(&row[c * T::N..]);
        }
    }
    tile
}

/// The first `rows` of the tile.
#[inline(always)]
pub(crate) fn store<T: Vector, const R: usize, const C: usize>(
    tile: &Tile<T, R, C>,
    a: &mut [f64],
    stride: usize,
    row: usize,
    rows: usize,
    column: usize,
) {
    for r in 0..R {
        if r < rows {
            let row = &mut a[(row + r) * stride + column..][..C * T::N];
            for c in 0..C {
                tile[r][c].store(&mut row[c * T::N..]);
            }
        }
    }
}

/// The rows of a block before the elimination by the rows above them in the block, times their reciprocals.
#[inline(always)]
pub(crate) fn finish<T: Vector, const R: usize, const C: usize>(
    mut acc: Tile<T, R, C>,
    taken: &[[f64; R]; R],
    reciprocal: &[f64; R],
) -> Tile<T, R, C> {
    for r in 0..R {
        let scale = T::splat(reciprocal[r]);
        for c in 0..C {
            acc[r][c] = acc[r][c].times(scale);
        }
        for below in r + 1..R {
            let p = T::splat(taken[r][below]);
            for c in 0..C {
                acc[below][c] = acc[below][c].minus(p, acc[r][c]);
            }
        }
    }
    acc
}

/// U's block of `rows` on the diagonal at `top`: the part right of the diagonal, and the reciprocals.
#[inline(always)]
pub(crate) fn corner<const R: usize>(
    u: &[f64],
    stride: usize,
    reciprocal: &[f64],
    top: usize,
    rows: usize,
) -> ([[f64; R]; R], [f64; R]) {
    let (mut taken, mut inverse) = ([[0.0; R]; R], [0.0; R]);
    for r in 0..rows {
        inverse[r] = reciprocal[top + r];
        taken[r][r + 1..rows].copy_from_slice(&u[(top + r) * stride + top..][r + 1..rows]);
    }
    (taken, inverse)
}

#[inline(always)]
fn check(matrix: &[f64], stride: usize, n: usize) {
    assert!(stride.is_multiple_of(SQUARE) && n <= stride && matrix.len() == stride * stride, "square, in whole tiles");
}

#[inline(always)]
fn factor_tiles<T: Vector, const V: u8, const R: usize>(
    a: &mut [f64],
    stride: usize,
    n: usize,
    floor: f64,
    reciprocal: &mut [f64],
) -> usize {
    for top in (0..n).step_by(R) {
        let rows = R.min(n - top);
        let left = top - top % (2 * T::N);
        let acc = subtract::<T, R, 2>(load(a, stride, top, left), &a[top..], &a[left..], (stride, stride), top);
        store(&acc, a, stride, top, rows, left);
        // The corner on the diagonal, by single numbers.
        let (mut corner, mut inverse) = ([[0.0; R]; R], [0.0; R]);
        for r in 0..rows {
            corner[r][r..rows].copy_from_slice(&a[(top + r) * stride + top..][r..rows]);
        }
        for r in 0..rows {
            let pivot = corner[r][r];
            if !(pivot > floor && pivot < f64::INFINITY) {
                return top + r;
            }
            inverse[r] = 1.0 / pivot.sqrt();
            for c in r + 1..R {
                corner[r][c] *= inverse[r];
            }
            for below in r + 1..R {
                for c in below..R {
                    corner[below][c] = fused::<V>(-corner[r][below], corner[r][c], corner[below][c]);
                }
            }
        }
        reciprocal[top..top + rows].copy_from_slice(&inverse[..rows]);
        store(&finish(acc, &corner, &inverse), a, stride, top, rows, left);
        for left in (left + 2 * T::N..n).step_by(2 * T::N) {
            let acc = subtract::<T, R, 2>(load(a, stride, top, left), &a[top..], &a[left..], (stride, stride), top);
            store(&finish(acc, &corner, &inverse), a, stride, top, rows, left);
        }
    }
    n
}

#[inline(always)]
fn factor_body<const V: u8>(a: &mut [f64], stride: usize, n: usize, floor: f64, reciprocal: &mut [f64]) -> usize {
    check(a, stride, n);
    assert!(reciprocal.len() >= n, "room for the reciprocals");
    match V {
        #[cfg(target_arch = "x86_64")]
        AVX512 => factor_tiles::<std::arch::x86_64::__m512d, V, 8>(a, stride, n, floor, reciprocal),
        #[cfg(target_arch = "x86_64")]
        FUSED => factor_tiles::<std::arch::x86_64::__m256d, V, 4>(a, stride, n, floor, reciprocal),
        _ => factor_tiles::<[f64; 2], V, 4>(a, stride, n, floor, reciprocal),
    }
}

#[inline(always)]
pub(crate) fn solve_body<const V: u8>(u: &[f64], stride: usize, reciprocal: &[f64], b: &mut [f64]) {
    let n = b.len();
    check(u, stride, n);
    for k in 0..n {
        b[k] *= reciprocal[k];
        let (solved, row) = (b[k], &u[k * stride..][..n]);
        for (b, u) in b[k + 1..].iter_mut().zip(&row[k + 1..]) {
            *b = fused::<V>(-solved, *u, *b);
        }
    }
}

#[inline(always)]
fn extend_body<const V: u8>(
    u: &mut [f64],
    stride: usize,
    floor: f64,
    reciprocal: &mut [f64],
    column: &mut [f64],
) -> bool {
    let n = column.len() - 1;
    solve_body::<V>(u, stride, reciprocal, &mut column[..n]);
    let mut pivot = column[n];
    for c in &column[..n] {
        pivot = fused::<V>(-c, *c, pivot);
    }
    let good = pivot > floor && pivot < f64::INFINITY;
    if good {
        for (k, c) in column[..n].iter().enumerate() {
            u[k * stride + n] = *c;
        }
        reciprocal[n] = 1.0 / pivot.sqrt();
        u[n * stride + n] = pivot * reciprocal[n];
    }
    good
}

#[inline(always)]
fn invert_tiles<T: Vector, const R: usize>(
    u: &[f64],
    stride: usize,
    rows: (usize, usize),
    reciprocal: &[f64],
    w: &mut [f64],
) {
    for top in (rows.0..rows.1).step_by(R) {
        let here = R.min(rows.1 - top);
        let (taken, inverse) = corner::<R>(u, stride, reciprocal, top, here);
        for left in (0..top + here).step_by(2 * T::N) {
            let mut acc = [[T::splat(0.0); 2]; R];
            if left < top {
                acc =
                    subtract(acc, &u[left * stride + top..], &w[left * stride + left..], (stride, stride), top - left);
            }
            for r in 0..here {
                if (left..left + 2 * T::N).contains(&(top + r)) {
                    let mut one = [0.0; SQUARE];
                    one[top + r - left] = 1.0;
                    let unit = T::splat(1.0);
                    acc[r] = [acc[r][0].plus(T::load(&one), unit), acc[r][1].plus(T::load(&one[T::N..]), unit)];
                }
            }
            store(&finish(acc, &taken, &inverse), w, stride, top, here, left);
        }
    }
}

#[inline(always)]
fn invert_body<const V: u8>(u: &[f64], stride: usize, rows: (usize, usize), reciprocal: &[f64], w: &mut [f64]) {
    check(u, stride, rows.1);
    check(w, stride, rows.1);
    match V {
        #[cfg(target_arch = "x86_64")]
        AVX512 => invert_tiles::<std::arch::x86_64::__m512d, 8>(u, stride, rows, reciprocal, w),
        #[cfg(target_arch = "x86_64")]
        FUSED => invert_tiles::<std::arch::x86_64::__m256d, 4>(u, stride, rows, reciprocal, w),
        _ => invert_tiles::<[f64; 2], 4>(u, stride, rows, reciprocal, w),
    }
}

#[inline(always)]
fn solve_back_body<const V: u8>(u: &[f64], stride: usize, reciprocal: &[f64], b: &mut [f64]) {
    const LANES: usize = 16;
    let n = b.len();
    check(u, stride, n);
    for i in (0..n).rev() {
        let (u, known) = (&u[i * stride..][i + 1..n], &b[i + 1..]);
        let ((u, u_rest), (x, x_rest)) = (u.as_chunks::<LANES>(), known.as_chunks::<LANES>());
        let mut lanes = [0.0; LANES];
        for (u, x) in u.iter().zip(x) {
            for l in 0..LANES {
                lanes[l] = fused::<V>(u[l], x[l], lanes[l]);
            }
        }
        for (lane, (u, x)) in lanes.iter_mut().zip(u_rest.iter().zip(x_rest)) {
            *lane = fused::<V>(*u, *x, *lane);
        }
        let mut half = LANES / 2;
        while half > 0 {
            for l in 0..half {
                lanes[l] += lanes[l + half];
            }
            half /= 2;
        }
        b[i] = (b[i] - lanes[0]) * reciprocal[i];
    }
}

levels! {
    /// A = UᵀU in place, from the upper triangle of A's leading `n` × `n` part. `reciprocal` receives 1 / U's
    /// diagonal. Returns the number of factored rows: `n`, or the first row with a pivot not above `floor`.
    ///
    /// Reads and overwrites tiles of [`SQUARE`] columns: values left of the diagonal in the same tile must be finite.
    pub fn factor / factor_at (
        a: &mut [f64], stride: usize, n: usize, floor: f64, reciprocal: &mut [f64],
    ) -> usize = factor_body
}

levels! {
    /// b ← U⁻ᵀ b, for as many rows as `b` has.
    pub fn solve / solve_at (u: &[f64], stride: usize, reciprocal: &[f64], b: &mut [f64]) = solve_body
}

levels! {
    /// Adds a row to the factor: `column` is A's next column down to the diagonal, not empty, and is overwritten with U's
    /// above the diagonal. Returns false, with the factor unchanged, if the pivot is not above `floor`.
    pub fn extend / extend_at (
        u: &mut [f64], stride: usize, floor: f64, reciprocal: &mut [f64], column: &mut [f64],
    ) -> bool = extend_body
}

levels! {
    /// Rows `rows.0..rows.1` of W = U⁻ᵀ; those above must be there.
    pub fn invert / invert_at (
        u: &[f64], stride: usize, rows: (usize, usize), reciprocal: &[f64], w: &mut [f64],
    ) = invert_body
}

levels! {
    /// b ← U⁻¹ b, for as many rows as `b` has: after [`solve`] the solution of A x = b.
    pub fn solve_back / solve_back_at (u: &[f64], stride: usize, reciprocal: &[f64], b: &mut [f64]) = solve_back_body
}

#[cfg(test)]
mod tests;
