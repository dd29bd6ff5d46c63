#![doc = include_str!("../README.md")]
//!
//! [`Page`] holds the open videos and answers a [`Message`]; a [`Session`] is one video with its tracks. Frames are counted from 1 in
//! messages and from 0 elsewhere.
#![forbid(unsafe_code)]

mod command;
mod host;
mod lines;
mod measuring;
mod message;
mod page;
mod player;
mod propose;
mod recent;
mod row;
mod saving;
mod session;
mod texts;
mod tracking;
mod tracks;

pub use self::command::{command, word};
pub use self::host::{Host, Video, offered};
pub use self::lines::FILES;
pub use self::measuring::Options;
pub use self::message::{Asked, Message, boxed, counted_from_1, read};
pub use self::page::Page;
pub use self::player::{BEFORE, Frames, Player, Reopen};
pub use self::recent::Recent;
pub use self::row::{Row, Surface, cells, detail, surface};
pub use self::saving::Made;
pub use self::session::{Pull, Session, Source, check_size};
pub use self::tracking::Setup;

/// The page's script, for after the scripts of reports and the function `remoteTracker`, which sends the messages.
pub const SCRIPT: &str = concat!(
    include_str!("../page/common.js"),
    include_str!("../page/camera.js"),
    include_str!("../page/state.js"),
    include_str!("../page/stage.js"),
    include_str!("../page/box.js"),
    include_str!("../page/panels.js"),
    include_str!("../page/targets.js"),
    include_str!("../page/files.js"),
    include_str!("../page/plot.js"),
    include_str!("../page/ruler.js"),
    include_str!("../page/measure.js"),
    include_str!("../page/main.js"),
);
/// The page's style, for after that of reports.
pub const STYLE: &str = include_str!("../page/page.css");
/// The page's cards: the frame, the settings, glimpse, curve, measurement and results.
pub const CARDS: &str = include_str!("../page/cards.html");
