//! Implements `foveate man`: manual pages, one for the program and one for each command.

use std::path::{Path, PathBuf};

use foveate::{Error, Result, files};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Output folder for foveate.1, foveate-track.1, ...; use ~/.local/share/man/man1 so that `man` finds them
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Writes the pages of `program`.
pub(crate) fn run(args: Args, program: clap::Command) -> Result<()> {
    let mut program = program.disable_help_subcommand(true);
    program.build();
    let folder = &args.folder;
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "cannot make the folder for manual pages"))?;
    let pages = write(&program, folder)?;
    say!("{}: {pages} manual pages", folder.display());
    Ok(())
}

/// Writes the pages of a command and its subcommands. Returns the number of pages.
fn write(command: &clap::Command, folder: &Path) -> Result<usize> {
    let page = clap_mangen::Man::new(command.clone());
    let (path, mut text) = (folder.join(page.get_filename()), vec![]);
    page.render(&mut text).map_err(Error::io(&path, "cannot write"))?;
    files::write(path, &text)?;
    command.get_subcommands().filter(|c| !c.is_hide_set()).try_fold(1, |pages, c| Ok(pages + write(c, folder)?))
}
