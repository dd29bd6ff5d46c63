//! Values of a register side by side, and what one instruction does with them: eight with AVX and FMA, four with NEON. What both name
//! alike is written once. All may be called only in code compiled for the instructions, which the macro `levels` runs only where they are.

#[cfg(target_arch = "x86_64")]
pub(crate) use avx::*;
#[cfg(target_arch = "aarch64")]
pub(crate) use neon::*;

/// How many values.
pub(crate) const N: usize = size_of::<Lanes>() / size_of::<f32>();

#[cfg(target_arch = "aarch64")]
mod neon {
    pub(crate) use std::arch::aarch64::{
        float32x4_t as Lanes, vaddq_f32 as add, vdupq_n_f32 as splat, vfmaq_f32 as add_product,
        vfmsq_f32 as subtract_product, vld1q_f32 as load, vmaxnmq_f32 as max, vmulq_f32 as times, vpaddq_f32 as pairs,
        vsqrtq_f32 as root, vst1q_f32 as store, vsubq_f32 as subtract, vuzp1q_f32 as even, vuzp2q_f32 as odd,
    };
    use std::arch::aarch64::{vget_low_f32, vst1_f32};

    /// # Safety
    /// There is room for four values at `to`; all processors have the instructions.
    #[inline(always)]
    pub(crate) unsafe fn put(values: Lanes, to: *mut f32, _: usize) {
        // SAFETY: the caller's word.
        unsafe { store(to, values) }
    }

    /// # Safety
    /// There is room for two values at `to`; all processors have the instructions.
    #[inline(always)]
    pub(crate) unsafe fn put_even(values: Lanes, to: *mut f32) {
        // SAFETY: the caller's word.
        unsafe { vst1_f32(to, vget_low_f32(even(values, values))) }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx {
    use std::arch::x86_64::*;
    pub(crate) use std::arch::x86_64::{
        __m256 as Lanes, _mm256_add_ps as add, _mm256_hadd_ps as pairs, _mm256_loadu_ps as load, _mm256_max_ps as max,
        _mm256_mul_ps as times, _mm256_set1_ps as splat, _mm256_sqrt_ps as root, _mm256_storeu_ps as store,
        _mm256_sub_ps as subtract,
    };

    /// Defines functions of lanes that one instruction computes.
    macro_rules! lanes {
        ($(fn $name:ident($($arg:ident),*) = $value:expr;)*) => {$(
            /// # Safety
            /// The processor has AVX and FMA.
            #[inline(always)]
            pub(crate) unsafe fn $name($($arg: Lanes),*) -> Lanes {
                // SAFETY: the caller's word.
                unsafe { $value }
            }
        )*};
    }
    lanes! {
        fn add_product(sum, a, b) = _mm256_fmadd_ps(a, b, sum);
        fn subtract_product(sum, a, b) = _mm256_fnmadd_ps(a, b, sum);
        fn even(a, b) = _mm256_shuffle_ps::<0b10_00_10_00>(a, b);
        fn odd(a, b) = _mm256_shuffle_ps::<0b11_01_11_01>(a, b);
    }

    /// # Safety
    /// The processor has AVX, and there is room for four values at `to` and `next` values further.
    #[inline(always)]
    pub(crate) unsafe fn put(values: Lanes, to: *mut f32, next: usize) {
        // SAFETY: the caller's word.
        unsafe {
            _mm_storeu_ps(to, _mm256_castps256_ps128(values));
            _mm_storeu_ps(to.add(next), _mm256_extractf128_ps::<1>(values));
        }
    }

    /// # Safety
    /// The processor has AVX, and there is room for four values at `to`.
    #[inline(always)]
    pub(crate) unsafe fn put_even(values: Lanes, to: *mut f32) {
        // SAFETY: the caller's word.
        unsafe {
            let (low, high) = (_mm256_castps256_ps128(values), _mm256_extractf128_ps::<1>(values));
            _mm_storeu_ps(to, _mm_shuffle_ps::<0b10_00_10_00>(low, high));
        }
    }
}
