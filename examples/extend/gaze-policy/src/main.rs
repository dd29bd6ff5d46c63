//! A gaze policy of your own in the whole program:
//!
//! ```sh
//! cargo run -- track VIDEO --init x,y,w,h --config win-stay.toml
//! ```

mod win_stay;

use std::process::ExitCode;

use foveate::extend::Parts;
use win_stay::{Settings, WinStay};

fn main() -> ExitCode {
    foveate_cli::main_with(Parts::new().with_policy("win-stay", |settings: Settings| WinStay::new(settings)))
}
