//! The header is that of the sources.

use foveate_testing::{need, program};
use std::mem::offset_of;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::types::{FoveateBox, FoveateDetection, FoveatePicture, FoveateResult};

fn folder() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(name: &str) -> String {
    std::fs::read_to_string(folder().join(name)).expect("a file of the crate")
}

/// The text between single spaces, none of them beside brackets.
fn squeezed(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace("( ", "(").replace(", )", ")")
}

/// `FoveateTracker` as `foveate_tracker`.
fn snake(name: &str) -> String {
    let letters = name.chars().flat_map(|c| [Some('_').filter(|_| c.is_uppercase()), Some(c.to_ascii_lowercase())]);
    letters.flatten().skip(1).collect()
}

/// A type of a signature in C, before the name.
fn in_c(rust: &str) -> String {
    let named = |pointee: &str| match pointee {
        "c_char" => "char ".to_owned(),
        "usize" => "size_t ".to_owned(),
        "u64" => "uint64_t ".to_owned(),
        // A pointer in a pointer.
        pointee if pointee.starts_with("*mut ") => in_c(pointee),
        pointee => format!("struct {} ", snake(pointee)),
    };
    let inside = |outer: &str| rust.strip_prefix(outer).map(|rest| rest.trim_end_matches('>'));
    if let Some(pointee) = inside("Option<&mut MaybeUninit<").or(inside("Option<&mut ")).or(inside("*mut ")) {
        return format!("{}*", named(pointee));
    }
    match inside("Option<&").or(inside("*const ")) {
        Some(pointee) => format!("const {}*", named(pointee)),
        None if rust == "FoveateCode" => "foveate_code ".into(),
        None if rust == "f64" => "double ".into(),
        None => named(rust),
    }
}

#[test]
fn it_declares_the_functions_with_their_types() {
    let (sources, header) = (squeezed(&read("src/exports.rs")), squeezed(&read("include/foveate.h")));
    let mut count = 0;
    for function in sources.split("#[unsafe(no_mangle)] pub extern \"C\" fn ").skip(1) {
        let (name, rest) = function.split_once('(').expect("arguments");
        let (arguments, rest) = rest.split_once(") -> ").expect("a result");
        let result = in_c(rest.split(" {").next().expect("a body"));
        let declared = arguments.split(", ").filter_map(|argument| argument.split_once(": "));
        let mut arguments: Vec<String> = declared.map(|(name, rust)| format!("{}{name}", in_c(rust))).collect();
        if arguments.is_empty() {
            arguments.push("void".into());
        }
        let declaration = format!("{result}{name}({});", arguments.join(", "));
        assert!(header.contains(&declaration), "include/foveate.h does not declare {declaration}");
        count += 1;
    }
    assert_eq!(count, header.matches(");").count(), "functions");
    let sources = squeezed(&read("src/types.rs")) + &squeezed(&read("src/errors.rs"));
    for list in sources.split("#[repr(i32)] pub(crate) enum ").skip(1) {
        let (name, list) = list.split_once(" {").expect("a list");
        let words: Vec<&str> = list.split('}').next().expect("its end").split_whitespace().collect();
        let values = words.windows(3).filter(|words| words[1] == "=");
        for words in values {
            let value = format!("{}_{} = {}", snake(name), words[0], words[2]).to_uppercase();
            assert!(header.contains(&value), "include/foveate.h does not have {value}");
            count += 1;
        }
    }
    assert_eq!(count, 22 + 8 + 4 + 5, "functions and values");
}

/// A C compiler finds the offsets and sizes of this build.
#[test]
fn its_structures_have_the_layout_of_this_build() {
    macro_rules! fields {
        ($name:ident: $($field:ident)*) => {
            [$((stringify!($field), offset_of!($name, $field))),*].map(|(field, offset)| {
                let name = snake(stringify!($name));
                format!("_Static_assert(offsetof({name}, {field}) == {offset}, \"{name}.{field}\");\n")
            }).concat() + &format!("_Static_assert(sizeof({}) == {}, \"\");\n", snake(stringify!($name)), size_of::<$name>())
        };
    }
    need!(program("cc", "--version"));
    let dir = tempfile::tempdir().expect("a temporary folder");
    let source: PathBuf = dir.path().join("layout.c");
    let text = "#include <foveate.h>\n".to_owned()
        + &fields!(FoveateBox: x y width height)
        + &fields!(FoveatePicture: pixels width height stride format)
        + &fields!(FoveateDetection: bbox score)
        + &fields!(FoveateResult: id bbox p_lost covariance detection status usable);
    std::fs::write(&source, text).expect("a writable folder");
    let cc = Command::new("cc").arg("-I").arg(folder().join("include")).arg("-fsyntax-only").arg(source).output();
    let cc = cc.expect("it is installed");
    assert!(cc.status.success(), "{}", String::from_utf8_lossy(&cc.stderr));
}

/// Where cbindgen is installed, it makes the same header.
#[test]
fn it_is_what_cbindgen_makes() {
    let version = Command::new("cbindgen").arg("--version").output();
    let right = version.is_ok_and(|output| output.stdout.starts_with(b"cbindgen 0.29."));
    need!(if right { Ok(()) } else { Err("program cbindgen 0.29") });
    let dir = tempfile::tempdir().expect("a temporary folder");
    let made = dir.path().join("foveate.h");
    let config = folder().join("cbindgen.toml");
    let output = Command::new("cbindgen").arg("--config").arg(config).arg("--output").arg(&made).arg(folder()).output();
    assert!(output.is_ok_and(|output| output.status.success()), "cbindgen failed");
    let made = std::fs::read_to_string(made).expect("it was made");
    assert!(made == read("include/foveate.h"), "include/foveate.h is not up to date: cbindgen.toml has the command");
}
