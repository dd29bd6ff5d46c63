//! An encoder of your own in the whole program:
//!
//! ```sh
//! cargo run -- track VIDEO --init x,y,w,h --config soft-sign.toml
//! ```

mod soft_sign;

use std::process::ExitCode;

use foveate::extend::Parts;
use soft_sign::{Settings, SoftSign};

fn main() -> ExitCode {
    foveate_cli::main_with(Parts::new().with_encoder("soft-sign", |settings: Settings, site| {
        // It reads the glimpses of any retina, so it takes that of the configuration.
        let retina = site.retina()?;
        let encoder = SoftSign::new(settings, &retina)?;
        Ok((retina, encoder))
    }))
}
