//! What the page may say.

use serde::Deserialize;

/// A message of the page.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields)]
pub enum Message {
    Hello {},
    List {
        path: String,
    },
    Open {
        path: String,
    },
    Close {
        session: u64,
    },
    Propose {
        session: u64,
        frame: usize,
        at: Option<(f64, f64)>,
    },
    Start {
        session: u64,
        frame: usize,
        #[serde(rename = "box")]
        bbox: [f64; 4],
        config: String,
        policy: Option<String>,
        seed: Option<u64>,
    },
    Step {
        session: u64,
        frames: usize,
    },
    Detail {
        session: u64,
        frame: usize,
    },
    Correct {
        session: u64,
        frame: usize,
        #[serde(rename = "box")]
        bbox: [f64; 4],
    },
    Command {
        session: u64,
    },
    Picked {
        session: u64,
        frame: usize,
        #[serde(rename = "box")]
        bbox: [f64; 4],
        config: String,
        policy: Option<String>,
    },
    Save {
        session: u64,
        film: bool,
        report: bool,
    },
    Saved {
        session: u64,
    },
}
