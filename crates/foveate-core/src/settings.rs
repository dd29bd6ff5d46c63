//! Settings of a section of a configuration, each key with its default and its range.

/// Declares structs of settings: `pub KEY: TYPE = DEFAULT; LEAST to MOST,` for each key, with the key of the section after `in`.
/// The range may be left out. `check` fails if a number is out of its range, then as the method after `and` does.
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
            pub fn check(&self) -> foveate_base::Result<()> {
                $($(
                    let key = concat!($section, ".", stringify!($key));
                    foveate_base::error::within(key, self.$key as f64, $least, $most)?;
                )?)*
                $( self.$rules()?; )?
                Ok(())
            }
        }
    )*};
}
