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

/// Declares structs of settings: `pub KEY: TYPE = DEFAULT; LEAST to MOST,` for each key, with the key of the section after `in`.
/// The range may be left out. `check` fails if a number is out of its range, then as the method after `and` does.
#[macro_export]
macro_rules! settings {
    ($(
        $(#[$about:meta])*
        pub struct $name:ident in $section:literal $(and $rules:ident)? {
            $( $(#[$doc:meta])* pub $key:ident: $kind:ty = $default:expr $(; $least:literal to $most:expr)?, )*
        }
    )*) => {$(
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name {
            $( $(#[$doc])* pub $key: $kind, )*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $( $key: $default, )* }
            }
        }

        impl $name {
            /// Fails with the key if a number is out of range.
            pub fn check(&self) -> $crate::Result<()> {
                $($(
                    let key = concat!($section, ".", stringify!($key));
                    $crate::error::within(key, self.$key as f64, $least, $most)?;
                )?)*
                $( self.$rules()?; )?
                Ok(())
            }
        }
    )*};
}
