//! What the processor can do, found once, and the macro that compiles a function for each level.

use std::sync::LazyLock;

/// Vector instructions the kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// What every processor of the architecture has.
    Portable,
    /// x86-64 with AVX2 and FMA.
    Avx2,
    /// x86-64 with AVX-512 F, BW, CD, DQ and VL.
    Avx512,
}

/// Whether multiply-adds are fused where nothing is asked of the processor.
pub(crate) const FUSED: bool = cfg!(any(target_arch = "aarch64", target_feature = "fma"));

static BEST: LazyLock<Level> = LazyLock::new(|| {
    #[cfg(target_arch = "x86_64")]
    {
        use std::is_x86_feature_detected as has;
        let avx2 = has!("avx2") && has!("fma");
        let avx512 = has!("avx512f") && has!("avx512bw") && has!("avx512cd") && has!("avx512dq") && has!("avx512vl");
        match (avx2, avx512) {
            (true, true) => Level::Avx512,
            (true, false) => Level::Avx2,
            _ => Level::Portable,
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    Level::Portable
});

impl Level {
    /// The highest level this processor has.
    #[inline]
    pub fn best() -> Self {
        *BEST
    }

    /// Every level this processor has, for tests.
    #[cfg(test)]
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        [Level::Portable, Level::Avx2, Level::Avx512].into_iter().filter(|&l| l <= Level::best())
    }
}

/// `a × b + c`, rounded once where `FUSED`: without the instruction `mul_add` is a slow library call.
#[inline(always)]
pub(crate) fn multiply_add<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// Defines `pub fn $name(..)` and `fn $at(level, ..)`: `$body::<FUSED>(..)`, an `#[inline(always)]`
/// function, compiled for every level.
macro_rules! levels {
    ($(#[$doc:meta])* pub fn $name:ident / $at:ident ($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? = $body:ident) => {
        $(#[$doc])*
        #[inline]
        pub fn $name($($arg: $ty),*) $(-> $ret)? {
            $at($crate::level::Level::best(), $($arg),*)
        }

        pub(crate) fn $at(level: $crate::level::Level, $($arg: $ty),*) $(-> $ret)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn avx2($($arg: $ty),*) $(-> $ret)? {
                    $body::<true>($($arg),*)
                }
                #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512cd,avx512dq,avx512vl")]
                fn avx512($($arg: $ty),*) $(-> $ret)? {
                    $body::<true>($($arg),*)
                }
                assert!(level <= $crate::level::Level::best(), "this processor has no {level:?}");
                // SAFETY: the processor has at least `level`, so it has the instructions.
                match level {
                    $crate::level::Level::Avx512 => return unsafe { avx512($($arg),*) },
                    $crate::level::Level::Avx2 => return unsafe { avx2($($arg),*) },
                    $crate::level::Level::Portable => {}
                }
            }
            let _ = level;
            $body::<{ $crate::level::FUSED }>($($arg),*)
        }
    };
}
pub(crate) use levels;
