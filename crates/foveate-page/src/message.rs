//! The messages of a page.

use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer};
use serde_json::Value;

use crate::measuring::Options;

/// A message that every host answers. Boxes are left, top, width and height in pixels.
#[derive(Debug, Deserialize)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields)]
#[allow(missing_docs)] // each field is explained by its variant
pub enum Message {
    /// Requests the initial settings of the page.
    Hello {},
    /// Opens a camera of the page, which pushes its frames.
    Live { name: String, width: usize, height: usize, rate: f64 },
    /// Closes a video.
    Close { session: u64 },
    /// Proposes a box around a place, or the most salient box without one.
    Propose {
        session: u64,
        #[serde(deserialize_with = "counted_from_1")]
        frame: usize,
        at: Option<(f64, f64)>,
    },
    /// Starts a target (from 0), or adds a new one.
    Start {
        session: u64,
        #[serde(default)]
        target: usize,
        #[serde(deserialize_with = "counted_from_1")]
        frame: usize,
        #[serde(rename = "box", deserialize_with = "boxed")]
        bbox: BBox,
        config: String,
        policy: Option<String>,
        seed: Option<u64>,
    },
    /// Tracks some frames.
    Step { session: u64, frames: usize },
    /// Requests the number of the frame that is tracked next.
    Next { session: u64 },
    /// Removes a target.
    Remove { session: u64, target: usize },
    /// Requests particles, glimpse and gazes of a frame.
    Detail {
        session: u64,
        #[serde(default)]
        target: usize,
        frame: usize,
    },
    /// Gives a box by hand in a tracked frame.
    Correct {
        session: u64,
        #[serde(default)]
        target: usize,
        #[serde(deserialize_with = "counted_from_1")]
        frame: usize,
        #[serde(rename = "box", deserialize_with = "boxed")]
        bbox: BBox,
    },
    /// Requests the commands that reproduce the tracks.
    Command { session: u64 },
    /// Measures the motion of a target, or writes the files of its measurement.
    Measure {
        session: u64,
        #[serde(default)]
        target: usize,
        #[serde(default)]
        options: Options,
        #[serde(default)]
        files: bool,
    },
    /// Starts writing results.
    Save {
        session: u64,
        #[serde(default)]
        film: bool,
        report: bool,
    },
    /// Requests the progress of writing results.
    Saved { session: u64 },
}

/// Deserializes a frame number, from 1.
///
/// # Errors
/// It is 0, or not a number.
pub fn counted_from_1<'de, D: Deserializer<'de>>(number: D) -> std::result::Result<usize, D::Error> {
    match usize::deserialize(number)? {
        0 => Err(serde::de::Error::custom("frame 0; frames count from 1")),
        frame => Ok(frame),
    }
}

/// Deserializes a box: left, top, width, height.
///
/// # Errors
/// It is not four numbers.
pub fn boxed<'de, D: Deserializer<'de>>(numbers: D) -> std::result::Result<BBox, D::Error> {
    <[f64; 4]>::deserialize(numbers).map(|[x, y, w, h]| BBox { x, y, w, h })
}

/// A message of every host's page, or a message `O` of one host.
#[derive(Debug)]
pub enum Asked<O> {
    /// Answered by [`Page::act`](crate::Page::act).
    Page(Message),
    /// Answered by the host.
    Own(O),
}

/// Reads a message from JSON. `own` names the operations of `O`.
///
/// # Errors
/// It is not JSON, or not a message.
pub fn read<O: DeserializeOwned>(json: &[u8], own: &[&str]) -> Result<Asked<O>> {
    let wrong = |error: serde_json::Error| Error::Invalid(format!("not a message: {error}"));
    let value: Value = serde_json::from_slice(json).map_err(wrong)?;
    let read = match value["op"].as_str().is_some_and(|op| own.contains(&op)) {
        true => serde_json::from_value(value).map(Asked::Own),
        false => serde_json::from_value(value).map(Asked::Page),
    };
    read.map_err(|error| match error.to_string() {
        text if text.starts_with("unknown variant") => {
            Error::Invalid(format!("not a message: {text}, `{}`", own.join("`, `")))
        }
        _ => wrong(error),
    })
}
