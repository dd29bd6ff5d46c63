//! The invariants of ARCHITECTURE.md that a search of the sources can keep.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The crates, and those that each may depend on.
const CRATES: [(&str, &[&str]); 15] = [
    ("base", &[]),
    ("kernels", &[]),
    ("gp", &["base", "kernels"]),
    ("learn", &["base", "kernels"]),
    ("core", &["base", "kernels", "gp", "learn"]),
    ("video", &["base", "kernels", "core"]),
    ("report", &["base", "core", "video"]),
    ("page", &["base", "core", "video", "report", "lab"]),
    ("lab", &["base", "kernels", "gp", "learn", "core", "video", "report"]),
    ("", &["base", "gp", "learn", "core", "video", "report", "lab"]),
    ("c", &[""]),
    ("cli", &["", "page"]),
    ("testing", &[]),
    ("paper", &["", "cli", "kernels"]),
    ("web", &["base", "kernels", "core", "video", "page", "lab"]),
];

fn folder(name: &str) -> PathBuf {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the folder of the crates");
    match name {
        "" => crates.join("foveate"),
        "paper" => crates.with_file_name("paper"),
        _ => crates.join(format!("foveate-{name}")),
    }
}

fn files(folder: &Path) -> Vec<PathBuf> {
    fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).expect("a folder of sources").map(|e| e.expect("readable").path()) {
            if entry.is_dir() {
                walk(&entry, found);
            } else if entry.extension().is_some_and(|e| e == "rs") {
                found.push(entry);
            }
        }
    }
    let mut found = vec![];
    walk(folder, &mut found);
    found.sort();
    found
}

/// Every source file of a crate by its path below `src/`, without its unit tests.
fn sources(name: &str) -> Vec<(String, String)> {
    let src = folder(name).join("src");
    let short = |file: &Path| file.strip_prefix(&src).expect("below src").to_string_lossy().replace('\\', "/");
    let named = files(&src).into_iter().map(|file| (short(&file), std::fs::read_to_string(&file).expect("text")));
    let named = named.filter(|(name, _)| !name.ends_with("tests.rs"));
    let tests = [
        "#[cfg(test)]\nmod tests {",
        "#[cfg(test)]\npub(super) mod tests {",
        "#[cfg(test)]\npub(crate) mod tests {",
        "#[cfg(all(test, feature = \"learn\"))]\nmod tests {",
    ];
    let before = |text: String| tests.iter().fold(text, |text, mark| text.split(mark).next().expect("one part").into());
    named.map(|(name, text)| (name, before(text))).collect()
}

/// The text without comments.
fn code(text: &str) -> String {
    text.lines().filter(|l| !l.trim_start().starts_with("//")).flat_map(|l| [l, "\n"]).collect()
}

/// The modules that a text takes from its crate: the words after `crate::`, also in braces.
fn imports(text: &str) -> Vec<String> {
    let code = code(text);
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
fn crates_depend_on_what_they_may() {
    for (name, may) in CRATES {
        let manifest = std::fs::read_to_string(folder(name).join("Cargo.toml")).expect("a manifest");
        let own = manifest.split("[dependencies]").nth(1).unwrap_or("").split("\n[").next().expect("a section");
        for line in own.lines().filter(|line| line.starts_with("foveate")) {
            let on: String = line.chars().take_while(|c| c.is_alphanumeric() || *c == '-').collect();
            let on = on.strip_prefix("foveate").expect("it does").trim_start_matches('-').to_owned();
            assert!(may.contains(&&*on), "foveate-{name} depends on foveate-{on}: see ARCHITECTURE.md, I4");
        }
    }
    assert_eq!(
        std::fs::read_dir(folder("").join("..")).expect("crates").count() + 1,
        CRATES.len(),
        "a crate is not listed"
    );
}

/// The names that a user finds: those of the front page and those of `extend`, one by one.
#[test]
fn the_facade_exports_listed_names() {
    let mut names = vec![];
    for path in [folder("").join("src/lib.rs"), folder("core").join("src/extend.rs")] {
        let text = code(&std::fs::read_to_string(path).expect("a source"));
        let statements = text.split(';').filter(|it| !it.contains("doc(hidden)"));
        for (_, exported) in statements.filter_map(|it| it.split_once("pub use ")) {
            assert!(!exported.contains('*'), "{exported}: list the names");
            let list = exported.split_once('{').map_or(exported, |(_, list)| list.trim_end_matches('}'));
            names.extend(list.split(',').map(|name| name.trim().rsplit([':', ' ']).next().unwrap_or("").to_owned()));
        }
    }
    names.retain(|name| !name.is_empty());
    println!("{} names: {}", names.len(), names.join(", "));
    assert!(names.len() > 40 && names.len() <= 90, "{} names: {}", names.len(), names.join(", "));
}

#[test]
fn modules_import_what_they_may() {
    const ROOT: [&str; 3] = ["config", "engine", "tracker"];
    let core = sources("core");
    for (folder, never) in [
        ("identity", &["control", "gaze", "multi"][..]),
        ("gaze", &["identity", "scene", "control", "multi"]),
        ("control", &["identity", "gaze", "multi"]),
        ("scene", &["identity", "control", "gaze", "multi"]),
    ] {
        let mut count = 0;
        for (file, text) in core.iter().filter(|(file, _)| file.starts_with(&format!("{folder}/"))) {
            for module in imports(text) {
                let wrong = never.contains(&&*module) || ROOT.contains(&&*module);
                assert!(!wrong, "{file} imports {module}: see ARCHITECTURE.md, I1 to I3");
            }
            count += 1;
        }
        assert!(count > 3, "{folder} has only {count} files");
    }
}

#[test]
fn the_core_knows_no_files_no_clock_and_no_threads_but_rayons() {
    for name in ["core", "gp", "kernels"] {
        for (file, text) in sources(name) {
            for line in code(&text).lines() {
                for word in ["std::fs", "std::time", "std::env", "std::thread", "std::process", "std::net", "File::"] {
                    let ours = file.starts_with("config/") && word == "File::";
                    assert!(ours || !line.contains(word), "foveate-{name}, {file}: {line}: see ARCHITECTURE.md, I6");
                }
            }
        }
    }
}

#[test]
fn every_implementation_calls_its_law() {
    let tests: Vec<String> = files(&folder("").join("tests"))
        .into_iter()
        .filter(|path| path.file_name().is_some_and(|n| n != "architecture.rs"))
        .map(|path| std::fs::read_to_string(path).expect("text"))
        .collect();
    let mut count = 0;
    for (file, text) in sources("core") {
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
                let whole = std::fs::read_to_string(folder("core").join("src").join(&file)).expect("text");
                let called = whole.contains(&call) || tests.iter().any(|t| t.contains(&call) && t.contains(who));
                assert!(called, "{file}: {who} must call {call}..): see ARCHITECTURE.md, I10");
                count += 1;
            }
        }
    }
    assert!(count >= 14, "only {count} implementations were found");
}

#[test]
fn libraries_are_safe_and_silent() {
    for (name, _) in CRATES.into_iter().filter(|(name, _)| !["kernels", "cli", "paper", "testing"].contains(name)) {
        let sources = sources(name);
        for (file, text) in &sources {
            let unsafe_words = match (name, &**file) {
                ("web", "exports.rs") => {
                    assert!(!code(text).contains("unsafe {"), "exports.rs has a block: see ARCHITECTURE.md, I11");
                    continue;
                }
                // The one file that reads and writes the memory of C programs.
                ("c", "exports.rs") => &[][..],
                _ => &["unsafe ", "unsafe{"],
            };
            for line in code(text).lines().filter(|line| !line.contains("(unsafe_code)]")) {
                let words = ["println!", "print!", "dbg!", "static mut", "set_hook"];
                for word in words.iter().chain(unsafe_words) {
                    assert!(!line.contains(word), "foveate-{name}, {file}: {line}: see ARCHITECTURE.md, I11");
                }
            }
        }
        let (_, lib) = sources.into_iter().find(|(file, _)| file == "lib.rs").expect("a library has a root");
        let rule = if ["c", "web"].contains(&name) { "#![deny(unsafe_code)]" } else { "#![forbid(unsafe_code)]" };
        assert!(lib.contains(rule), "foveate-{name}");
    }
}

#[test]
fn files_are_small() {
    for (name, _) in CRATES {
        for (file, text) in sources(name) {
            let lines = text.lines().count();
            assert!(lines <= 400, "foveate-{name}, {file} has {lines} lines before its tests: make two of it");
        }
    }
}

#[test]
fn the_loop_fits_on_a_screen() {
    let engine = std::fs::read_to_string(folder("core").join("src/engine.rs")).expect("a source");
    let (_, step) = engine.split_once("    pub(crate) fn step<").expect("the engine has a step");
    let (step, _) = step.split_once("\n    }\n").expect("the step ends");
    let lines = step.lines().count() + 1;
    assert!(lines <= 45, "Engine::step has {lines} lines: see ARCHITECTURE.md, I12");
}

/// The file of a path after `crate::`: the longest prefix that is a file, following `pub use` of its modules.
fn defines<'a>(names: &'a BTreeMap<String, String>, path: &[String]) -> Option<&'a str> {
    (1..=path.len()).rev().find_map(|n| names.get(&path[..n].join("::"))).map(String::as_str)
}

/// The paths in code that is no `use`: words joined by `::`.
fn written(text: &str) -> Vec<Vec<String>> {
    let code = code(text);
    let statements = code.split(';').filter(|s| !s.trim_start().trim_start_matches("pub ").starts_with("use "));
    let words = statements.flat_map(|s| s.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')));
    let path = |word: &str| word.split("::").filter(|s| !s.is_empty()).map(str::to_owned).collect::<Vec<_>>();
    words
        .filter(|word| word.contains("::") && !word.starts_with("::"))
        .map(path)
        .filter(|path| path.len() > 1)
        .collect()
}

/// The paths of one `use` tree.
fn paths(tree: &str) -> Vec<Vec<String>> {
    let tree = tree.trim();
    let Some(open) = tree.find('{') else {
        let name = tree.split(" as ").next().expect("a path");
        return vec![name.split("::").map(|s| s.trim().to_owned()).collect()];
    };
    let before: Vec<String> = tree[..open].split("::").map(|s| s.trim().to_owned()).filter(|s| !s.is_empty()).collect();
    let inner = &tree[open + 1..tree.rfind('}').expect("a closing brace")];
    let (mut depth, mut from, mut parts) = (0, 0, vec![]);
    for (i, c) in inner.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&inner[from..i]);
                from = i + 1;
            }
            _ => (),
        }
    }
    parts.push(&inner[from..]);
    let parts = parts.into_iter().filter(|p| !p.trim().is_empty()).flat_map(paths);
    parts.map(|p| before.iter().cloned().chain(p).collect()).collect()
}

/// An import is an edge to the file that defines the imported item; a re-export (`pub use`) is none. No edge leads back.
#[test]
fn no_file_imports_in_a_circle() {
    let mut found = String::new();
    for (name, _) in CRATES {
        let sources = sources(name);
        let module = |file: &str| -> Vec<String> {
            let file = file.trim_end_matches(".rs").trim_end_matches("/mod");
            let whole = !["lib", "main"].contains(&file);
            file.split('/').filter(|_| whole).map(str::to_owned).collect()
        };
        let mut names: BTreeMap<String, String> =
            sources.iter().map(|(file, _)| (module(file).join("::"), file.clone())).collect();
        let absolute = |at: &[String], path: &[String]| -> Option<Vec<String>> {
            let (mut base, mut rest) = match path[0].as_str() {
                "crate" => (vec![], &path[1..]),
                "self" => (at.to_vec(), &path[1..]),
                "super" => (at.to_vec(), path),
                _ => return None,
            };
            while rest.first().is_some_and(|s| s == "super") {
                base.pop();
                rest = &rest[1..];
            }
            base.extend(rest.iter().cloned());
            Some(base)
        };
        let uses = |text: &str, exported: bool| -> Vec<Vec<String>> {
            let code = code(text);
            let statements = code.split(';').filter_map(|s| {
                let s = s.trim_start();
                let s =
                    s.rsplit_once("]\n").map_or(s, |(before, after)| if before.starts_with('#') { after } else { s });
                let (head, tree) = s.split_once("use ")?;
                let is_export = head.starts_with("pub ") && head.trim() == "pub";
                (head.trim().is_empty() && !exported || is_export && exported).then(|| paths(tree))
            });
            statements.flatten().collect()
        };
        // A name that a module re-exports is defined where it comes from; twice, for re-exports of re-exports.
        for _ in 0..2 {
            for (file, text) in &sources {
                let at = module(file);
                for path in uses(text, true) {
                    let local = if path.len() > 1 && names.contains_key(&[&at[..], &path[..1]].concat().join("::")) {
                        Some([&at[..], &path].concat())
                    } else {
                        absolute(&at, &path)
                    };
                    let Some(to) = local else { continue };
                    if let (Some(defined), Some(last)) = (defines(&names, &to).map(str::to_owned), to.last()) {
                        names.insert([&at[..], std::slice::from_ref(last)].concat().join("::"), defined);
                    }
                }
            }
        }
        let mut edges: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for (file, text) in &sources {
            let at = module(file);
            // A module that calls its own children by their paths is above them; they may use its items.
            let below = |path: &Vec<String>| names.contains_key(&[&at[..], &path[..1]].concat().join("::"));
            let written = written(text).into_iter().filter(|path| path[0] != "self" && !below(path));
            for path in uses(text, false).into_iter().chain(written) {
                let to = match absolute(&at, &path) {
                    Some(to) => to,
                    None if names.contains_key(&[&at[..], &path[..1]].concat().join("::")) => [&at[..], &path].concat(),
                    None => continue,
                };
                if let Some(to) = defines(&names, &to).filter(|to| *to != file) {
                    edges.entry(file).or_default().push(to);
                }
            }
        }
        edges.values_mut().for_each(|to| to.dedup());
        let mut circles = vec![];
        for start in edges.keys() {
            let (mut seen, mut stack) = (vec![], edges[start].clone());
            while let Some(at) = stack.pop() {
                if at == *start {
                    circles.push(*start);
                    break;
                }
                if !seen.contains(&at) {
                    seen.push(at);
                    stack.extend(edges.get(at).into_iter().flatten());
                }
            }
        }
        found.extend(circles.iter().map(|file| format!("foveate-{name}: {file} -> {}\n", edges[file].join(" "))));
    }
    assert!(found.is_empty(), "files that refer to each other in a circle:\n{found}");
}
