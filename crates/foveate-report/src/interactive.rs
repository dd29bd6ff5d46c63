//! What a page needs that shows a track while it grows, draws boxes and takes corrections: `foveate serve`, and the page
//! whose tracker runs in the browser.

mod command;
mod lines;
mod player;
mod propose;
mod recent;
mod row;
mod texts;
mod track;
mod tracking;

pub use self::command::command;
pub use self::lines::{FILES, LineLog, Lines, named, target_of};
pub use self::player::{BEFORE, Frames, Player, Reopen, Shared};
pub use self::propose::propose;
pub use self::recent::{RECENT, Recent};
pub use self::row::{Row, Surface, cells, detail, surface};
pub use self::track::{MOST_TARGETS, Results, Tracks, boxed, check_size, described, offered, proposed};
pub use self::tracking::{Log, MOST_FRAMES, Setup, Tracking};
