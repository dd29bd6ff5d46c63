//! An observation model of your own in the whole program:
//!
//! ```sh
//! cargo run -- track VIDEO --init x,y,w,h --config patch.toml
//! ```

mod patch;

use std::process::ExitCode;

use foveate::extend::Parts;
use patch::{Patch, Settings};

fn main() -> ExitCode {
    // It reads the picture itself: retina and encoder of the configuration, which the site has, are not used.
    foveate_cli::main_with(
        Parts::new().with_observation_model("patch", |settings: Settings, _site| Patch::new(settings)),
    )
}
