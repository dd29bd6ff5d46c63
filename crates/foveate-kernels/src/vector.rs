//! A few doubles side by side, as many as a level's registers hold, so that the compiler need not find out by itself.

use crate::level::{BASE, fused};

/// Doubles in a register. Implementations for special registers may only be used in code compiled for their level,
/// which the macro `levels` runs only if the processor has it.
pub(crate) trait Vector: Copy {
    /// How many.
    const N: usize;
    /// The first `N` of `from`.
    fn load(from: &[f64]) -> Self;
    /// Over the first `N` of `to`.
    fn store(self, to: &mut [f64]);
    /// `N` times the same.
    fn splat(x: f64) -> Self;
    /// Products.
    fn times(self, other: Self) -> Self;
    /// self + a b, rounded as [`fused`](crate::level::fused) of the level does.
    fn plus(self, a: Self, b: Self) -> Self;
    /// self − a b.
    fn minus(self, a: Self, b: Self) -> Self;
}

impl Vector for [f64; 2] {
    const N: usize = 2;
    #[inline(always)]
    fn load(from: &[f64]) -> Self {
        [from[0], from[1]]
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        to[..2].copy_from_slice(&self);
    }
    #[inline(always)]
    fn splat(x: f64) -> Self {
        [x, x]
    }
    #[inline(always)]
    fn times(self, other: Self) -> Self {
        [self[0] * other[0], self[1] * other[1]]
    }
    #[inline(always)]
    fn plus(self, a: Self, b: Self) -> Self {
        [fused::<BASE>(a[0], b[0], self[0]), fused::<BASE>(a[1], b[1], self[1])]
    }
    #[inline(always)]
    fn minus(self, a: Self, b: Self) -> Self {
        self.plus([-a[0], -a[1]], b)
    }
}

/// Implements [`Vector`] by the instructions of x86-64.
#[cfg(target_arch = "x86_64")]
macro_rules! registers {
    ($ty:ty, $n:literal, $load:ident, $store:ident, $splat:ident, $mul:ident, $fma:ident, $fnma:ident) => {
        impl Vector for $ty {
            const N: usize = $n;
            #[inline(always)]
            fn load(from: &[f64]) -> Self {
                let from: &[f64; $n] = from.first_chunk().expect("a whole register");
                // SAFETY: the processor has the instructions, as the trait demands, and `from` is as long.
                unsafe { std::arch::x86_64::$load(from.as_ptr()) }
            }
            #[inline(always)]
            fn store(self, to: &mut [f64]) {
                let to: &mut [f64; $n] = to.first_chunk_mut().expect("a whole register");
                // SAFETY: as above.
                unsafe { std::arch::x86_64::$store(to.as_mut_ptr(), self) }
            }
            #[inline(always)]
            fn splat(x: f64) -> Self {
                // SAFETY: the processor has the instructions, as the trait demands.
                unsafe { std::arch::x86_64::$splat(x) }
            }
            #[inline(always)]
            fn times(self, other: Self) -> Self {
                // SAFETY: as above.
                unsafe { std::arch::x86_64::$mul(self, other) }
            }
            #[inline(always)]
            fn plus(self, a: Self, b: Self) -> Self {
                // SAFETY: as above.
                unsafe { std::arch::x86_64::$fma(a, b, self) }
            }
            #[inline(always)]
            fn minus(self, a: Self, b: Self) -> Self {
                // SAFETY: as above.
                unsafe { std::arch::x86_64::$fnma(a, b, self) }
            }
        }
    };
}
#[cfg(target_arch = "x86_64")]
registers!(
    std::arch::x86_64::__m512d,
    8,
    _mm512_loadu_pd,
    _mm512_storeu_pd,
    _mm512_set1_pd,
    _mm512_mul_pd,
    _mm512_fmadd_pd,
    _mm512_fnmadd_pd
);
#[cfg(target_arch = "x86_64")]
registers!(
    std::arch::x86_64::__m256d,
    4,
    _mm256_loadu_pd,
    _mm256_storeu_pd,
    _mm256_set1_pd,
    _mm256_mul_pd,
    _mm256_fmadd_pd,
    _mm256_fnmadd_pd
);
