//! The `foveate` command.

fn main() -> std::process::ExitCode {
    foveate_cli::main_with(foveate::extend::Parts::new())
}
