//! Implements `foveate completions`: shell completions of commands and options.

use foveate::{Error, Result};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Shell; for bash: foveate completions bash > ~/.local/share/bash-completion/completions/foveate
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

/// Prints the completions of `program`.
pub(crate) fn run(args: Args, mut program: clap::Command) -> Result<()> {
    let name = program.get_name().to_owned();
    let mut script = vec![];
    clap_complete::generate(args.shell, &mut program, name, &mut script);
    let script = String::from_utf8(script).map_err(|e| Error::Invalid(format!("the completions are not text: {e}")))?;
    say!("{}", script.trim_end());
    Ok(())
}
