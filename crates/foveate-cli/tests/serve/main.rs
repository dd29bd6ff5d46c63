//! `foveate serve`: access, served files, and messages.

#[path = "../served/mod.rs"]
mod served;

mod measure;
#[path = "../place/mod.rs"]
mod place;
mod requests;
mod streams;
mod tracks;

use place::Place;
use serde_json::{Value, json};
use served::{Server, clip};

const SECRET: &str = "nobody-may-read-this";

/// A folder with a clip that may be seen, and secrets beside it.
fn place() -> Place {
    let dir = Place::empty();
    clip(&dir.path("seen/clip"));
    dir.write("secret.mp4", SECRET);
    dir.write("seen/secret.txt", SECRET);
    #[cfg(unix)]
    std::os::unix::fs::symlink(dir.path("secret.mp4"), dir.path("seen/link.mp4")).expect("a link");
    dir
}

fn open(server: &Server, name: &str) -> Value {
    server.answer(json!({ "op": "open", "path": name }))
}

/// The boxes of a target's reported rows.
fn boxes_of(target: &Value) -> Vec<[f64; 4]> {
    let rows = target["rows"].as_array().expect("rows").iter();
    rows.map(|row| serde_json::from_value(row["box"].clone()).expect("a box")).collect()
}
