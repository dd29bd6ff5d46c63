//! The vector instructions of the processor, detected once, and the macro that compiles a function for each level.

use std::sync::{LazyLock, OnceLock};

/// Vector instructions the kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// What every processor of the architecture has: on aarch64 NEON with fused multiply-adds.
    Portable,
    /// x86-64 with AVX2 and FMA.
    Avx2,
    /// x86-64 with AVX-512 F, BW, CD, DQ and VL.
    Avx512,
    /// The same with the dot products of bf16 and of whole numbers (VNNI).
    Avx512Dots,
}

/// The instructions that the compiler may use in a function compiled for a level, as a const parameter `V` of its body: 0 plain
/// arithmetic, [`FUSED`] multiply-adds too, [`AVX512`] its instructions too.
pub(crate) const FUSED: u8 = 1;
/// See [`FUSED`].
pub(crate) const AVX512: u8 = 2;
/// See [`FUSED`]: and its dot products of whole numbers.
#[cfg(target_arch = "x86_64")]
pub(crate) const VNNI: u8 = 3;
/// The level without special instructions.
pub(crate) const BASE: u8 = if cfg!(any(target_arch = "aarch64", target_feature = "fma")) { FUSED } else { 0 };

/// The highest permitted level, if one was set.
static MOST: OnceLock<Level> = OnceLock::new();

static BEST: LazyLock<Level> = LazyLock::new(|| machine().min(MOST.get().copied().unwrap_or(Level::Avx512Dots)));

/// The level of this processor.
fn machine() -> Level {
    #[cfg(target_arch = "x86_64")]
    {
        use std::is_x86_feature_detected as has;
        let avx2 = has!("avx2") && has!("fma");
        let avx512 = has!("avx512f") && has!("avx512bw") && has!("avx512cd") && has!("avx512dq") && has!("avx512vl");
        match (avx2, avx512, has!("avx512bf16") && has!("avx512vnni")) {
            (true, true, true) => Level::Avx512Dots,
            (true, true, false) => Level::Avx512,
            (true, false, _) => Level::Avx2,
            _ => Level::Portable,
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    Level::Portable
}

impl Level {
    /// Levels by name.
    pub const ALL: [(&'static str, Self); 3] =
        [("portable", Self::Portable), ("avx2", Self::Avx2), ("avx512", Self::Avx512)];

    /// Limits the whole process to this level, from the first kernel on. Returns false if the processor lacks this
    /// level or a higher one is already in use.
    pub fn at_most(self) -> bool {
        self <= machine() && *MOST.get_or_init(|| self) == self && Self::best() <= self
    }

    /// The highest level of this processor, or the limit that was set.
    #[inline]
    pub fn best() -> Self {
        *BEST
    }

    /// Every level this processor has, for tests.
    #[cfg(test)]
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        [Self::Portable, Self::Avx2, Self::Avx512, Self::Avx512Dots].into_iter().filter(|&l| l <= Self::best())
    }
}

/// `a × b + c`, rounded once if fused. Without the instruction `mul_add` is a slow library call.
#[inline(always)]
pub(crate) fn multiply_add<const V: u8>(a: f32, b: f32, c: f32) -> f32 {
    if V >= FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// [`multiply_add`] in double precision.
#[inline(always)]
pub(crate) fn fused<const V: u8>(a: f64, b: f64, c: f64) -> f64 {
    if V >= FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// The greater of two; `b` if `a` is NaN. `f32::max` takes several instructions on processors that treat NaN
/// differently, and a call in WebAssembly.
#[inline(always)]
pub(crate) fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The lesser of two; `b` if `a` is NaN.
#[inline(always)]
pub(crate) fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// 1 / √x for x in [1e-37, 3e38], to 2e-7 relative; NaN stays NaN.
#[inline(always)]
pub(crate) fn reciprocal_root<const V: u8>(x: &[f32; 16]) -> [f32; 16] {
    #[cfg(target_arch = "x86_64")]
    if V >= AVX512 {
        use std::arch::x86_64::*;
        let mut y = [0.0; 16];
        // SAFETY: by `V` the caller is compiled for AVX-512, and runs only where it is there. 14 bits and one
        // step of Newton's method.
        unsafe {
            let x = _mm512_loadu_ps(x.as_ptr());
            let rough = _mm512_rsqrt14_ps(x);
            let half = _mm512_mul_ps(rough, _mm512_set1_ps(0.5));
            let miss = _mm512_fnmadd_ps(_mm512_mul_ps(x, rough), rough, _mm512_set1_ps(1.0));
            _mm512_storeu_ps(y.as_mut_ptr(), _mm512_fmadd_ps(half, miss, rough));
        }
        return y;
    }
    x.map(|x| 1.0 / x.sqrt())
}

/// Defines `pub fn $name(..)`, where named, and `fn $at(level, ..)`: `$body::<V>(..)`, an `#[inline(always)]`
/// function, compiled for every level.
macro_rules! levels {
    ($(#[$doc:meta])* pub fn $name:ident / $at:ident ($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? = $body:ident) => {
        $(#[$doc])*
        #[inline]
        pub fn $name($($arg: $ty),*) $(-> $ret)? {
            $at($crate::level::Level::best(), $($arg),*)
        }

        $crate::level::levels! { fn $at($($arg: $ty),*) $(-> $ret)? = $body }
    };
    (fn $at:ident ($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? = $body:ident) => {
        fn $at(level: $crate::level::Level, $($arg: $ty),*) $(-> $ret)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn avx2($($arg: $ty),*) $(-> $ret)? {
                    $body::<{ $crate::level::FUSED }>($($arg),*)
                }
                #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512cd,avx512dq,avx512vl")]
                fn avx512($($arg: $ty),*) $(-> $ret)? {
                    $body::<{ $crate::level::AVX512 }>($($arg),*)
                }
                assert!(level <= $crate::level::Level::best(), "this processor has no {level:?}");
                match level {
                    $crate::level::Level::Avx512 | $crate::level::Level::Avx512Dots => {
                        // SAFETY: the processor has at least `level`, so it has the instructions.
                        return unsafe { avx512($($arg),*) };
                    }
                    $crate::level::Level::Avx2 => {
                        // SAFETY: the processor has at least `level`, so it has the instructions.
                        return unsafe { avx2($($arg),*) };
                    }
                    $crate::level::Level::Portable => {}
                }
            }
            let _ = level;
            $body::<{ $crate::level::BASE }>($($arg),*)
        }
    };
}
pub(crate) use levels;
