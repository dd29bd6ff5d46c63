//! What the page may say: the messages of `foveate serve`, files by number in the place of paths, frames that are pushed, and
//! the digit scenes.

use serde::Deserialize;

use crate::lesson::Scene;
use crate::store::Given;

#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields)]
pub enum Message {
    Hello {},
    /// A video file, or pictures in order.
    Open {
        name: String,
        files: Vec<Given>,
        /// A file of true boxes.
        truth: Option<Given>,
    },
    /// Frames will be pushed.
    Live {
        name: String,
        width: usize,
        height: usize,
        rate: f64,
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
        /// From 0; one that is not there yet is added.
        #[serde(default)]
        target: usize,
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
    /// The frame that will be tracked next.
    Next {
        session: u64,
    },
    /// What a decoder of the browser needs.
    Coded {
        session: u64,
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
        frame: usize,
        #[serde(rename = "box")]
        bbox: [f64; 4],
    },
    Command {
        session: u64,
    },
    Save {
        session: u64,
        report: bool,
        #[serde(default)]
        film: bool,
    },
    Saved {
        session: u64,
    },
    /// Draws a digit scene and starts to track in it.
    Lesson {
        scene: Scene,
        policy: String,
    },
    /// The next frame of it.
    LessonStep {},
}
