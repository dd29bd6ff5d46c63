//! `foveate tiles`: a video as pictures in tiles at several resolutions, for trackers that read regions.

use std::path::{Path, PathBuf};

use foveate::video::{Decoder, Options, ahead_until, open_with, write_tiles};
use foveate::{Error, Result, files};

use super::track::source::named;
use crate::terminal;

#[derive(clap::Args)]
pub struct Args {
    /// A video file, or a folder of images
    source: PathBuf,
    /// Folder to make: FRAME/LEVEL/COLUMN_ROW.png, level 0 the picture itself, each further level half of it
    #[arg(long, short, value_name = "DIR")]
    out: PathBuf,
    /// Side of a tile in pixels
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(8..=4096))]
    side: u32,
    /// Resolutions; the coarsest is what an overview reads
    #[arg(long, default_value_t = 7, value_parser = clap::value_parser!(u8).range(1..=16))]
    levels: u8,
    /// The last frame, counted from 1
    #[arg(long, value_name = "FRAME")]
    until: Option<usize>,
    /// What decodes a video file: auto takes the program ffmpeg where it is installed and faster
    #[arg(long, value_name = "auto|builtin|ffmpeg", default_value = "auto", value_parser = named(Decoder::ALL))]
    decoder: Decoder,
}

pub fn run(args: Args) -> Result<()> {
    if args.out.exists() {
        let out = args.out.display();
        return Err(Error::Invalid(format!("{out} exists; give --out a folder that does not, or remove it")));
    }
    // Under another name until it is whole.
    let making = files::temporary(&args.out);
    let parent = args.out.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(".".as_ref());
    std::fs::create_dir_all(parent).map_err(Error::io(parent, "cannot create"))?;
    std::fs::create_dir(&making).map_err(Error::io(&making, "cannot create"))?;
    terminal::catch_interrupts();
    let cut = cut(&args, &making);
    let done = match &cut {
        Ok(frames) if *frames > 0 && !terminal::stopping() => {
            std::fs::rename(&making, &args.out).map_err(Error::io(&args.out, "cannot make"))
        }
        Ok(_) => Err(Error::Invalid(format!("{}: no frame was cut; nothing was written", args.source.display()))),
        Err(_) => Ok(()),
    };
    if done.is_err() || cut.is_err() {
        // What went wrong is told; that its rest cannot be removed adds nothing.
        let _ = std::fs::remove_dir_all(&making);
    }
    if terminal::stopping() {
        note!("foveate: stopped; nothing was written");
        std::process::exit(terminal::stop_status());
    }
    let frames = cut?;
    done?;
    say!("{frames} frames in tiles of {0} x {0}: {1}", args.side, args.out.display());
    Ok(())
}

/// Cuts the frames into a folder; how many there were.
fn cut(args: &Args, folder: &Path) -> Result<usize> {
    let source = open_with(&args.source, &Options { decoder: args.decoder, ..Options::default() })?;
    let bar = terminal::progress(source.info().frames, "tiles");
    let mut frames = 0;
    for frame in ahead_until(source, terminal::stopping).take(args.until.unwrap_or(usize::MAX)) {
        let frame = frame?;
        let name = format!("{:06}", frame.index + 1);
        write_tiles(folder.join(name), &frame.image, args.side as usize, args.levels.into())?;
        frames += 1;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(frames)
}
