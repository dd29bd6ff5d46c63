//! A detector of your own in the whole program, which starts the tracks of many targets:
//!
//! ```sh
//! cargo run -- track VIDEO --config bright.toml
//! ```

mod bright;

use std::process::ExitCode;

use bright::{Bright, Settings};
use foveate::extend::Parts;

fn main() -> ExitCode {
    foveate_cli::main_with(Parts::new().with_detector("bright", |settings: Settings| Bright::new(settings)))
}
