//! The documents are true: files, functions, commands and links that they name exist, and the generated parts equal today's
//! code.
//!
//! `FOVEATE_WRITE_DOCS=1 cargo test -p foveate --features lab --test documents` writes the generated parts anew.

#[cfg(feature = "learn")]
#[path = "documents/configuration.rs"]
mod configuration;
#[cfg(feature = "learn")]
#[path = "documents/shipped.rs"]
mod shipped;
#[cfg(feature = "learn")]
#[path = "documents/sources.rs"]
mod sources;

use std::path::{Path, PathBuf};

/// The repository's root.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The files below a folder that end so, in order.
fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder of the repository").map(|e| e.expect("readable").path());
    let mut entries: Vec<PathBuf> = entries.collect();
    entries.sort();
    let below = |path: PathBuf| match path.is_dir() {
        true => files(&path, ending),
        false => vec![path],
    };
    entries.into_iter().flat_map(below).filter(|path| path.extension().is_some_and(|e| e == ending)).collect()
}

/// All documents by name, relative to the root.
fn documents() -> Vec<(String, String)> {
    let front = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"];
    let beside = ["crates/foveate-core/models/README.md", "bench/hockey/README.md"];
    let mut paths: Vec<PathBuf> = front.iter().chain(&beside).map(|name| root().join(name)).collect();
    paths.extend(files(&root().join("docs"), "md"));
    let crates = std::fs::read_dir(root().join("crates")).expect("crates").map(|e| e.expect("readable").path());
    paths.extend(crates.map(|folder| folder.join("README.md")).filter(|path| path.is_file()));
    let name = |path: &Path| path.strip_prefix(root()).expect("below the root").to_string_lossy().replace('\\', "/");
    paths.iter().map(|path| (name(path), std::fs::read_to_string(path).expect("a document is text"))).collect()
}

/// Returns whether a document is a history, in which old names are right.
fn is_history(name: &str) -> bool {
    name == "CHANGELOG.md" || name.starts_with("docs/lab/")
}

/// The text between backticks, line by line; a line is a row of a table or of a paragraph.
fn code(line: &str) -> impl Iterator<Item = &str> + Clone {
    line.split('`').skip(1).step_by(2)
}

/// The source file that a document calls by `name`.
fn source(name: &str) -> Option<PathBuf> {
    let crates = std::fs::read_dir(root().join("crates")).expect("crates").map(|e| e.expect("readable").path());
    let mut crates: Vec<PathBuf> = crates.collect();
    crates.sort();
    let sources = crates.iter().map(|folder| folder.join("src"));
    let places: Vec<PathBuf> = sources
        .chain([
            root().join("paper/src"),
            root().join("crates/foveate/tests"),
            root().join("crates/foveate"),
            root(),
            root().join("crates"),
        ])
        .collect();
    places.into_iter().map(|place| place.join(name)).find(|path| path.is_file())
}

#[test]
fn named_files_exist() {
    for (name, text) in documents().into_iter().filter(|(name, _)| !is_history(name)) {
        for line in text.lines() {
            for file in code(line).filter(|c| c.ends_with(".rs") && c.contains('/') && !c.contains([' ', '{'])) {
                assert!(source(file).is_some(), "{name} names {file}, which is not there");
            }
        }
    }
}

/// In docs/paper.md the functions after a file's name, up to the next file's, are defined in it.
#[test]
fn functions_of_the_paper_are_where_the_table_says() {
    let mut checked = 0;
    let paper = std::fs::read_to_string(root().join("docs/paper.md")).expect("it is there");
    for line in paper.lines().filter(|line| line.starts_with('|')) {
        let mut file = None;
        for word in code(line) {
            if word.ends_with(".rs") {
                file = source(word);
            } else if let (Some((owner, name)), Some(path)) = (word.split_once("::"), &file) {
                let text = std::fs::read_to_string(path).expect("a source file can be read");
                let there = [format!("fn {name}("), format!("fn {name}<"), format!("pub {name}:")]
                    .iter()
                    .any(|form| text.contains(form));
                assert!(there && text.contains(owner), "docs/paper.md: {word} is not in {}", path.display());
                checked += 1;
            }
        }
    }
    assert!(checked >= 20, "the table must be found: {checked} names checked");
}

/// The tests that SECURITY.md names show its promises.
#[test]
fn promises_have_their_tests() {
    let text = std::fs::read_to_string(root().join("SECURITY.md")).expect("it is there");
    let tests = |line: &str| line.rsplit('|').nth(1).map(|cell| code(cell).map(str::to_owned).collect::<Vec<_>>());
    let rows = text.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| ---")).skip(1);
    let named: Vec<Vec<String>> = rows.filter_map(tests).collect();
    let sources: Vec<String> = files(&root().join("crates"), "rs")
        .iter()
        .map(|path| std::fs::read_to_string(path).expect("a source file can be read"))
        .collect();
    assert!(named.len() >= 10 && named.iter().all(|tests| !tests.is_empty()), "{named:?}");
    for test in named.iter().flatten() {
        let there = format!("fn {test}()");
        assert!(sources.iter().any(|text| text.contains(&there)), "SECURITY.md names {test}, which is no test");
    }
}

/// A heading as links name it.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().to_lowercase().replace(' ', "-");
    kept.chars().filter(|c| c.is_alphanumeric() || "-_".contains(*c)).collect()
}

#[test]
fn links_lead_somewhere() {
    let mut checked = 0;
    for (name, text) in documents() {
        let folder = root().join(&name).parent().expect("a folder").to_owned();
        let prose: Vec<&str> = text.split("```").step_by(2).collect();
        for link in prose.iter().flat_map(|part| part.split("](").skip(1)) {
            let link = link.split([')', ' ']).next().expect("one part");
            if link.contains("://") {
                continue;
            }
            let (path, place) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() { root().join(&name) } else { folder.join(path) };
            assert!(target.exists(), "{name} links to {link}, which is not there");
            if !place.is_empty() {
                let text = std::fs::read_to_string(&target).expect("a document");
                let headings = text.lines().filter(|l| l.starts_with('#')).map(|l| anchor(l.trim_start_matches('#')));
                assert!(headings.into_iter().any(|h| h == place), "{name} links to {link}: no such heading");
            }
            checked += 1;
        }
    }
    assert!(checked >= 40, "the links must be found: {checked} checked");
}

/// Each piece of code of docs/extend.md is a part of an example that is built and run.
#[test]
fn parts_of_ones_own_are_those_of_the_examples() {
    let lines = |text: &str| text.lines().map(|line| line.trim().to_owned()).collect::<Vec<_>>();
    let folder = root().join("examples/extend");
    let sources = files(&folder, "rs").into_iter().chain(files(&folder, "toml"));
    let sources: Vec<Vec<String>> = sources.map(|it| lines(&std::fs::read_to_string(it).expect("text"))).collect();
    let page = std::fs::read_to_string(root().join("docs/extend.md")).expect("the page");
    let mut compared = 0;
    for block in page.split("```").skip(1).step_by(2) {
        let (language, block) = block.split_once('\n').expect("a block has lines");
        let block = lines(block.trim_end());
        if ["rust", "toml"].contains(&language) {
            let there = sources.iter().any(|source| source.windows(block.len()).any(|part| part == block));
            assert!(there, "no example has this code of docs/extend.md:\n{}", block.join("\n"));
            compared += 1;
        }
    }
    assert!(compared >= 5, "{compared} pieces of code");
}

/// Commands and configurations that a document shows exist.
#[test]
fn commands_and_configurations_exist() {
    let commands = |file: &str| -> Vec<String> {
        let main = std::fs::read_to_string(root().join(file)).expect("the program");
        let commands =
            main.split("enum Command {").nth(1).expect("its commands").split("\n}").next().expect("one part");
        let named = |l: &str| {
            Some(l.trim().split_once('(').filter(|(n, _)| n.starts_with(char::is_uppercase))?.0.to_lowercase())
        };
        commands.lines().filter_map(named).collect()
    };
    let papers = commands("paper/src/main.rs");
    let commands = commands("crates/foveate-cli/src/lib.rs");
    assert!(commands.iter().any(|c| c == "track"), "the commands must be found: {commands:?}");
    let mut checked = 0;
    for (name, text) in documents().into_iter().filter(|(name, _)| !is_history(name)) {
        let blocks = text.split("```").skip(1).step_by(2).flat_map(str::lines);
        let shown = blocks.chain(text.lines().flat_map(code));
        for command in shown.clone().filter_map(|shown| shown.strip_prefix("cargo run --release -p paper -- ")) {
            let word = command.split_whitespace().next().expect("a word after it");
            let known = commands.iter().chain(&papers).any(|c| c == word);
            assert!(known, "{name} shows `{command}` of the crate paper: there is no such command");
        }
        for command in shown.filter(|shown| shown.starts_with("foveate ")) {
            let word = command.split_whitespace().nth(1).expect("a word after it");
            let known = commands.iter().any(|c| c == word) || word == "help" || word.starts_with(['-', '.']);
            assert!(known, "{name} shows `{command}`: there is no foveate {word}");
            let after = |flag: &str| command.split(flag).nth(1).and_then(|rest| rest.split_whitespace().next());
            for config in after("--config ").into_iter().chain(after(" -c ")) {
                let given = config.chars().all(|c| c.is_uppercase()) || config.contains(['.', '|']);
                let builtin = foveate::config::BUILTIN.iter().any(|b| b.0 == config);
                assert!(given || builtin, "{name} shows `{command}`: no configuration is called {config}");
            }
            checked += 1;
        }
        for word in text.lines().flat_map(code).filter(|w| w.starts_with("natural-") || w.starts_with("digits-")) {
            let plain = word.chars().all(|c| c.is_ascii_lowercase() || c == '-');
            let builtin = foveate::config::BUILTIN.iter().any(|b| b.0 == word);
            assert!(!plain || builtin, "{name} names the configuration `{word}`, which does not ship");
        }
    }
    assert!(checked >= 20, "the commands must be found: {checked} checked");
}

/// Puts `content` between the marks of a block, or fails where it is not there already.
#[cfg(any(feature = "learn", feature = "report"))]
fn block(document: &str, name: &str, content: &str) {
    let path = root().join(document);
    let text = std::fs::read_to_string(&path).expect("a document");
    let (begin, end) = (format!("<!-- generated:{name}:begin -->\n"), format!("<!-- generated:{name}:end -->"));
    let (before, rest) = text.split_once(&begin).unwrap_or_else(|| panic!("{document} has no {begin}"));
    let (there, after) = rest.split_once(&end).unwrap_or_else(|| panic!("{document} has no {end}"));
    if std::env::var_os("FOVEATE_WRITE_DOCS").is_some() {
        std::fs::write(&path, format!("{before}{begin}{content}{end}{after}")).expect("a writable document");
        return;
    }
    let differs = there.lines().zip(content.lines()).find(|(a, b)| a != b);
    assert!(
        there == content,
        "{document}: the block {name} is not what the code says (first difference: {differs:?}); write it anew with \
         FOVEATE_WRITE_DOCS=1 cargo test -p foveate --features lab --test documents"
    );
}

/// One test for all, because they share a document.
#[cfg(feature = "learn")]
#[test]
fn generated_parts_are_what_the_code_says() {
    let folders = ["core", "learn", "gp"].map(|name| root().join(format!("crates/foveate-{name}/src")));
    let folders: Vec<&Path> = folders.iter().map(PathBuf::as_path).collect();
    block("docs/configuration.md", "configurations", &shipped::configurations());
    block("docs/configuration.md", "keys", &configuration::reference(&folders));
}

#[cfg(feature = "report")]
#[test]
fn every_column_is_described() {
    block("docs/columns.md", "outputs", &foveate::report::columns::dictionary());
}

/// The figures of docs/why.md, each a mean with its interval, are in docs/results.md, which is made from the stored results.
#[test]
fn figures_of_the_changes_are_results() {
    let read = |name: &str| std::fs::read_to_string(root().join(name)).expect("a document");
    let (why, results) = (read("docs/why.md"), read("docs/results.md"));
    let cells = why.lines().flat_map(|line| line.split('|')).map(str::trim);
    let figures: Vec<&str> = cells.filter(|c| c.starts_with(char::is_numeric) && c.ends_with(']')).collect();
    assert!(figures.len() >= 20, "the figures must be found: {figures:?}");
    for figure in figures {
        assert!(results.contains(&format!("| {figure} |")), "docs/why.md has {figure}, docs/results.md has not");
    }
}

/// The table of dependencies names every crate that a crate of the project needs, and no other.
#[test]
fn dependencies_have_reasons() {
    let architecture = std::fs::read_to_string(root().join("ARCHITECTURE.md")).expect("it is there");
    let table = architecture.split("<!-- dependencies -->\n").nth(1).expect("a mark before the table");
    let rows = table.lines().take_while(|l| l.starts_with('|')).skip(2);
    let message: Vec<&str> =
        rows.flat_map(|l| l.split('|').nth(1).expect("a cell").split(',').map(str::trim)).collect();
    let mut needed = vec![];
    for folder in std::fs::read_dir(root().join("crates")).expect("crates").map(|e| e.expect("readable").path()) {
        let manifest = std::fs::read_to_string(folder.join("Cargo.toml")).expect("a manifest");
        let sections = manifest.split("\n[").filter_map(|section| section.split_once("]\n"));
        let own = sections.filter(|(head, _)| head.ends_with("dependencies") && *head != "dev-dependencies");
        let lines = own.flat_map(|(_, body)| body.lines());
        for line in lines.filter(|l| l.starts_with(char::is_alphabetic) && !l.starts_with("foveate")) {
            needed.push(line.chars().take_while(|c| c.is_alphanumeric() || "-_".contains(*c)).collect::<String>());
        }
    }
    for name in &needed {
        assert!(message.contains(&name.as_str()), "ARCHITECTURE.md does not say what {name} is for");
    }
    for name in message {
        assert!(needed.iter().any(|n| n == name), "ARCHITECTURE.md names {name}, which no crate needs");
    }
}
