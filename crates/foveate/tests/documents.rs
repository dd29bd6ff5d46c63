//! What the documents say of the tree is true: files they name exist, and functions they name are in those files.

use std::path::{Path, PathBuf};

/// The repository's root.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn document(name: &str) -> String {
    std::fs::read_to_string(root().join(name)).expect("the document is in the repository")
}

/// What stands between backticks, line by line; a line is a row of a table or of a paragraph.
fn code(line: &str) -> impl Iterator<Item = &str> {
    line.split('`').skip(1).step_by(2)
}

/// The source file that a document calls by `name`.
fn source(name: &str) -> Option<PathBuf> {
    let places = ["", "crates/foveate", "crates/foveate/src", "crates/foveate/tests", "crates"];
    places.iter().map(|place| root().join(place).join(name)).find(|path| path.is_file())
}

#[test]
fn named_files_exist() {
    for name in ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "docs/paper.md"] {
        for line in document(name).lines() {
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
    for line in document("docs/paper.md").lines().filter(|line| line.starts_with('|')) {
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
