//! The `foveate` command.

fn main() -> std::process::ExitCode {
    let program = std::env::current_exe().unwrap_or_default();
    foveate_cli::main(std::env::args_os().collect(), program).into()
}
