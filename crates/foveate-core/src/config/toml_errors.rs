//! The errors of the parser of configurations, without the names of Rust's types.

/// The parser's name of a type, and the expected text. A name that ends in a space includes the next word.
const WORDS: [(&str, &str); 9] = [
    ("internally tagged enum ", "a section with `kind`"),
    ("struct ", "a section"),
    ("enum ", "a name"),
    ("usize", "a whole number, 0 or more"),
    ("u64", "a whole number, 0 or more"),
    ("u32", "a whole number, 0 or more"),
    ("f64", "a number"),
    ("f32", "a number"),
    ("a sequence", "a list: [ ... ]"),
];

/// The same error without Rust's terms.
pub(super) fn without_types(error: &str) -> String {
    const EXPECTED: &str = ", expected ";
    let Some((before, found)) = error.rsplit_once(EXPECTED) else { return error.into() };
    for (rust, plain) in WORDS {
        if let Some(rest) = found.strip_prefix(rust) {
            let name =
                if rust.ends_with(' ') { rest.find(|c: char| !c.is_alphanumeric()).unwrap_or(rest.len()) } else { 0 };
            return format!("{before}{EXPECTED}{plain}{}", &rest[name..]);
        }
    }
    error.into()
}

#[cfg(test)]
mod tests {
    use crate::config::Config;

    #[test]
    fn no_type_of_rust_is_named() {
        let natural = Config::builtin("natural").expect("it ships").expect("it is right");
        for (setting, said) in [
            ("particles=x", "invalid type: string \"x\", expected a whole number, 0 or more"),
            ("seed=1.5", "invalid type: floating point `1.5`, expected a whole number, 0 or more"),
            ("redetection.every=-1", "invalid value: integer `-1`, expected a whole number, 0 or more"),
            ("confidence.weights=[\"a\"]", "invalid type: string \"a\", expected a number"),
            ("confidence.weights=3", "invalid type: integer `3`, expected a list: [ ... ]"),
            ("colour=3", "invalid type: integer `3`, expected a section"),
            ("policy=3", "invalid type: integer `3`, expected a section with `kind`"),
            ("clamp_to_frame=3", "invalid type: integer `3`, expected a boolean"),
            ("retina.rings=[3]", "invalid type: integer `3`, expected an array of length 2"),
        ] {
            let error = natural.set(setting).expect_err(setting).to_string();
            assert!(error.trim_end().ends_with(said), "{setting}: {error}");
        }
    }
}
