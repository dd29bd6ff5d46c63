#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod error;
pub mod files;
pub mod memory;
pub mod quiet;
pub mod rng;
pub mod rows;
pub mod sink;
pub mod text;
pub mod thread;

pub use error::{Error, Result};

/// Implements `Debug` by the name alone, for types with closures or trait objects.
#[macro_export]
macro_rules! opaque_debug {
    ($name:ident $(<$parameter:tt $(: $bound:path)?>)?) => {
        impl $(<$parameter $(: $bound)?>)? std::fmt::Debug for $name $(<$parameter>)? {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.debug_struct(stringify!($name)).finish_non_exhaustive()
            }
        }
    };
}
