//! The invariants of ARCHITECTURE.md that a search of the sources can keep.

use std::path::{Path, PathBuf};

/// Every source file under `src/` (or one folder of it) by its path there, without its unit tests.
fn sources(folder: &str) -> Vec<(String, String)> {
    fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).expect("a folder of sources").map(|e| e.expect("readable").path()) {
            if entry.is_dir() {
                walk(&entry, found);
            } else if entry.extension().is_some_and(|e| e == "rs") {
                found.push(entry);
            }
        }
    }
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = vec![];
    walk(&src.join(folder), &mut files);
    files.sort();
    let name = |file: &Path| file.strip_prefix(&src).expect("below src").to_string_lossy().replace('\\', "/");
    let named = files.iter().map(|file| (name(file), std::fs::read_to_string(file).expect("text")));
    let named = named.filter(|(name, _)| !name.ends_with("tests.rs"));
    named.map(|(name, text)| (name, text.split("#[cfg(test)]\nmod tests {").next().expect("one part").into())).collect()
}

/// The modules that a text takes from the crate: the words after `crate::`, also in braces.
fn imports(text: &str) -> Vec<String> {
    let code: String = text.lines().filter(|l| !l.trim_start().starts_with("//")).flat_map(|l| [l, "\n"]).collect();
    let word = |s: &str| s.trim().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let after = code.split("crate::").skip(1);
    after
        .flat_map(|s| match s.strip_prefix('{') {
            Some(group) => group.split('}').next().unwrap_or("").split(',').map(word).collect(),
            None => vec![word(s)],
        })
        .collect()
}

#[test]
fn modules_import_what_they_may() {
    const ROOT: [&str; 6] = ["config", "tracker", "step", "run", "observe", "training"];
    for (folder, never) in [
        ("identity", &["control", "gaze"][..]),
        ("gaze", &["identity", "scene", "control", "rbm"]),
        ("control", &["identity", "gaze", "rbm"]),
        ("scene", &["identity", "control", "gaze", "rbm"]),
        ("rbm", &["identity", "control", "gaze", "scene", "geometry"]),
        ("gp", &["identity", "control", "gaze", "scene", "geometry", "rbm"]),
    ] {
        for (file, text) in sources(folder) {
            for module in imports(&text) {
                let wrong = never.contains(&&*module) || ROOT.contains(&&*module);
                assert!(!wrong, "{file} imports {module}: see ARCHITECTURE.md, I1 to I5");
            }
        }
    }
    for (file, text) in sources("") {
        // Training reads a retina as configurations have it, and an experiment compares configurations; they stand
        // around the loop. Everything in it is put together by config.rs.
        let around = ["config", "training/", "eval/experiment.rs", "eval/line_up.rs", "lib.rs"];
        let may = around.iter().any(|place| file.starts_with(place));
        assert!(may || !imports(&text).contains(&"config".into()), "{file} imports config: see ARCHITECTURE.md, I4");
    }
}

#[test]
fn every_implementation_calls_its_law() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |path: PathBuf| std::fs::read_to_string(path).expect("text");
    let tests: Vec<String> = std::fs::read_dir(here.join("tests"))
        .expect("this folder")
        .map(|entry| entry.expect("readable").path())
        .filter(|path| path.is_file() && path.file_name().is_some_and(|n| n != "architecture.rs"))
        .filter(|path| path.extension().is_some_and(|e| e == "rs"))
        .map(read)
        .collect();
    let mut count = 0;
    for (file, text) in sources("") {
        for (name, law) in [
            ("Dynamics", "dynamics"),
            ("Proposal", "proposal"),
            ("Reward", "reward"),
            ("Policy", "policy"),
            ("Retina", "retina"),
            ("Encoder", "encoder"),
            ("Distance", "distance"),
            ("Appearance", "appearance"),
            ("Detector", "detector"),
            ("Recognizer", "recognizer"),
        ] {
            for line in text.lines().filter(|line| line.starts_with(&format!("impl {name} for "))) {
                let who = line[format!("impl {name} for ").len()..].trim_end_matches([' ', '{']);
                let call = format!("conformance::{law}(");
                let whole = read(here.join("src").join(&file));
                let called = whole.contains(&call) || tests.iter().any(|t| t.contains(&call) && t.contains(who));
                assert!(called, "{file}: {who} must call {call}..): see ARCHITECTURE.md, I10");
                count += 1;
            }
        }
    }
    assert!(count >= 14, "only {count} implementations were found");
}

#[test]
fn the_library_is_safe_and_silent() {
    for (file, text) in sources("") {
        let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
        for line in code.filter(|line| !line.contains("#![forbid(unsafe_code)]")) {
            for word in ["unsafe ", "unsafe{", "println!", "print!", "dbg!", "static mut"] {
                assert!(!line.contains(word), "{file}: {line}: see ARCHITECTURE.md, I11");
            }
        }
    }
    let (_, lib) = sources("").into_iter().find(|(file, _)| file == "lib.rs").expect("a library has a root");
    assert!(lib.contains("#![forbid(unsafe_code)]"));
}

#[test]
fn files_are_small() {
    for (file, text) in sources("") {
        let lines = text.lines().count();
        assert!(lines <= 400, "{file} has {lines} lines before its tests: make two of it");
    }
}
