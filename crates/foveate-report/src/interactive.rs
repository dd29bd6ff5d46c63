//! What a page needs that shows a track while it grows, draws boxes and takes corrections: `foveate serve`, and the page
//! whose tracker runs in the browser.

mod command;
mod player;
mod propose;
mod row;
mod track;
mod tracking;

pub use self::command::command;
pub use self::player::{BEFORE, Frames, Player, Reopen};
pub use self::propose::propose;
pub use self::row::{Row, Surface, cells, detail, surface};
pub use self::track::{Track, boxed, check_size, described, offered, proposed};
pub use self::tracking::{Log, Setup, Tracking};
