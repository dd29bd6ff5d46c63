//! Implements `foveate tiles`: cuts a video into tiles at several resolutions, for trackers that read regions.

use std::path::{Path, PathBuf};

use foveate::text::counted;
use foveate::video::{ahead_until, open_with, write_tiles, write_times};
use foveate::{Error, Result, files};

use super::track::init::Frames;
use super::track::source::DecoderArgs;
use crate::terminal;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Video file or folder of images
    source: PathBuf,
    /// Output folder: FRAME/LEVEL/COLUMN_ROW.png; level 0 has full resolution, and each further level half of the previous one. times.txt
    /// has the times of the frames
    #[arg(long, short, value_name = "DIR")]
    out: PathBuf,
    /// Side of a tile in pixels
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(8..=4096))]
    side: u32,
    /// Number of resolutions; an overview reads the coarsest
    #[arg(long, default_value_t = 7, value_parser = clap::value_parser!(u8).range(1..=16))]
    levels: u8,
    /// Last frame, counted from 1
    #[arg(long, value_name = "FRAME", value_parser = clap::value_parser!(u64).range(1..))]
    until: Option<u64>,
    #[command(flatten)]
    decoder: DecoderArgs,
}

pub(crate) fn run(args: Args) -> Result<()> {
    if args.out.exists() {
        let out = args.out.display();
        return Err(Error::Invalid(format!("{out} exists; give --out a folder that does not, or remove it")));
    }
    let parent = files::folder_of(&args.out);
    std::fs::create_dir_all(parent).map_err(Error::io(parent, "cannot create"))?;
    let making = Making(files::temporary(&args.out));
    files::create_dir(&making.0).map_err(Error::io(&making.0, "cannot create"))?;
    terminal::catch_interrupts();
    let frames = cut(&args, &making.0)?;
    if terminal::stopping() {
        drop(making);
        note!("foveate: stopped; nothing was written");
        std::process::exit(terminal::stop_status());
    }
    if frames == 0 {
        return Err(Error::Invalid(format!("{}: it has no frame; nothing was written", args.source.display())));
    }
    let named = files::settle(&making.0).and_then(|()| files::rename(&making.0, &args.out));
    named.map_err(Error::io(&args.out, "cannot make"))?;
    files::sync_folder(&args.out);
    say!("{} in tiles of {1} x {1}: {2}", counted(frames, "frame"), args.side, args.out.display());
    Ok(())
}

/// A folder under a temporary name until it is complete. If dropped before that, it is removed.
struct Making(PathBuf);

impl Drop for Making {
    fn drop(&mut self) {
        // A folder that cannot be removed now has a name that marks it as temporary.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Cuts the frames into a folder. Returns the number of frames.
fn cut(args: &Args, folder: &Path) -> Result<usize> {
    let source = open_with(&args.source, &args.decoder.options())?;
    let span = Frames::new(0, "the video begins", args.until, source.info())?;
    let bar = terminal::progress(span.total(source.info()), "tiles");
    let mut times = vec![];
    for frame in ahead_until(source, terminal::stopping).take(span.until.saturating_add(1)) {
        let frame = frame?;
        let name = format!("{:06}", frame.index + 1);
        write_tiles(folder.join(name), &frame.image, args.side as usize, args.levels.into())?;
        times.push(frame.time);
        bar.inc(1);
    }
    bar.finish_and_clear();
    write_times(folder, &times)?;
    Ok(times.len())
}
