//! What the page may say.

use serde::{Deserialize, Deserializer};

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
        #[serde(deserialize_with = "counted_from_1")]
        frame: usize,
        at: Option<(f64, f64)>,
    },
    /// Frames of the browser's camera will be pushed.
    Live {
        name: String,
        width: usize,
        height: usize,
        rate: f64,
    },
    Start {
        session: u64,
        /// From 0; one that is not there yet is added.
        #[serde(default)]
        target: usize,
        #[serde(deserialize_with = "counted_from_1")]
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
    Remove {
        session: u64,
        target: usize,
    },
    Detail {
        session: u64,
        #[serde(default)]
        target: usize,
        frame: usize,
    },
    Correct {
        session: u64,
        #[serde(default)]
        target: usize,
        #[serde(deserialize_with = "counted_from_1")]
        frame: usize,
        #[serde(rename = "box")]
        bbox: [f64; 4],
    },
    Command {
        session: u64,
    },
    Picked {
        session: u64,
        #[serde(deserialize_with = "counted_from_1")]
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

/// A frame's number.
fn counted_from_1<'de, D: Deserializer<'de>>(number: D) -> Result<usize, D::Error> {
    match usize::deserialize(number)? {
        0 => Err(serde::de::Error::custom("frame 0; frames count from 1")),
        frame => Ok(frame),
    }
}
