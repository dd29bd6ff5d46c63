//! Double precision for the filter: plain products and sums in a fixed order, so that the bits are the same at every
//! level. The compiler widens the loops; nothing is fused.

/// Defines `fn $name(level, ..)`: `$body(..)`, an `#[inline(always)]` function, compiled for every level.
macro_rules! same_bits {
    (fn $name:ident ($($arg:ident: $ty:ty),*) $(-> $ret:ty)? = $body:ident) => {
        fn $name(level: $crate::Level, $($arg: $ty),*) $(-> $ret)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn avx2($($arg: $ty),*) $(-> $ret)? {
                    $body($($arg),*)
                }
                #[target_feature(enable = "avx2,avx512f,avx512bw,avx512cd,avx512dq,avx512vl")]
                fn avx512($($arg: $ty),*) $(-> $ret)? {
                    $body($($arg),*)
                }
                assert!(level <= $crate::Level::best(), "this processor has no {level:?}");
                if level >= $crate::Level::Avx512 {
                    // SAFETY: the processor has at least `level`, so it has the instructions.
                    return unsafe { avx512($($arg),*) };
                }
                if level >= $crate::Level::Avx2 {
                    // SAFETY: as above.
                    return unsafe { avx2($($arg),*) };
                }
            }
            let _ = level;
            $body($($arg),*)
        }
    };
}
pub(crate) use same_bits;
