//! `foveate serve`: access, served files, and messages.

#[path = "../served/mod.rs"]
mod served;

mod measure;
mod requests;
mod streams;
mod tracks;

use serde_json::{Value, json};
use served::{Server, clip};

const SECRET: &str = "nobody-may-read-this";

/// A folder with a clip that may be seen, and secrets beside it.
fn place() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary folder");
    clip(&dir.path().join("seen/clip"));
    std::fs::write(dir.path().join("secret.mp4"), SECRET).expect("writable");
    std::fs::write(dir.path().join("seen/secret.txt"), SECRET).expect("writable");
    #[cfg(unix)]
    std::os::unix::fs::symlink(dir.path().join("secret.mp4"), dir.path().join("seen/link.mp4")).expect("a link");
    dir
}

fn open(server: &Server, name: &str) -> Value {
    let opened = server.told(json!({ "op": "open", "path": name }));
    opened
}

/// The boxes of a target's reported rows.
fn boxes_of(target: &Value) -> Vec<[f64; 4]> {
    let rows = target["rows"].as_array().expect("rows").iter();
    rows.map(|row| serde_json::from_value(row["box"].clone()).expect("a box")).collect()
}
