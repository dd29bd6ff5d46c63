//! `foveate track`: follow a target through a video file or a folder of images.

use std::path::{Path, PathBuf};

use foveate::config::{Blueprint, Config};
use foveate::geometry::BBox;
use foveate::run::{Follow, follow};
use foveate::scene::open;
use foveate::{Error, Result};

use crate::terminal;

#[derive(clap::Args)]
pub struct Args {
    /// A video file, or a folder of images
    source: PathBuf,
    /// The target's box in the first frame: left, top, width, height in pixels, counted from 1 as in boxes.txt.
    /// Left out, the first line of groundtruth_rect.txt in the folder is taken
    #[arg(long, value_name = "X,Y,W,H", value_parser = parse_box, allow_hyphen_values = true)]
    init: Option<BBox>,
    /// Give the target's box again at a later frame (counted from 1): FRAME:X,Y,W,H
    #[arg(long, value_name = "FRAME:X,Y,W,H", value_parser = parse_again, allow_hyphen_values = true)]
    reinit: Vec<(usize, BBox)>,
    /// Where results go
    #[arg(long, short, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// A configuration file, or the name of one that ships with the program
    #[arg(long, short, value_name = "FILE")]
    config: Option<String>,
    /// Names all randomness: same seed, same track. Stands above the configuration's
    #[arg(long)]
    seed: Option<u64>,
    /// Go on from a state written by --save-state: the source's frames after it are tracked
    #[arg(long, value_name = "FILE", conflicts_with = "init")]
    load_state: Option<PathBuf>,
    /// Write the tracker's whole state after the last frame
    #[arg(long, value_name = "FILE")]
    save_state: Option<PathBuf>,
    /// Stop after this frame (counted from 1)
    #[arg(long, value_name = "FRAME")]
    until: Option<usize>,
    /// Print a summary as JSON on standard output
    #[arg(long)]
    json: bool,
    /// Leave out annotated.mp4
    #[arg(long)]
    no_video: bool,
    /// Leave out report.html
    #[arg(long)]
    no_report: bool,
    /// Leave out trace.jsonl
    #[arg(long)]
    no_trace: bool,
}

/// `x,y,w,h` counted from 1, to a box counted from 0.
fn parse_box(text: &str) -> std::result::Result<BBox, String> {
    let numbers: Vec<f64> = text.split(',').map(|n| n.trim().parse()).collect::<std::result::Result<_, _>>().map_err(
        |_| format!("expected four numbers x,y,w,h such as 120,80,40,60, got \"{text}\""),
    )?;
    match numbers[..] {
        [x, y, w, h] if numbers.iter().all(|n| n.is_finite()) => Ok(BBox { x: x - 1.0, y: y - 1.0, w, h }),
        _ => Err(format!("expected four finite numbers x,y,w,h such as 120,80,40,60, got \"{text}\"")),
    }
}

fn parse_again(text: &str) -> std::result::Result<(usize, BBox), String> {
    let (frame, bbox) = text.split_once(':').ok_or_else(|| format!("expected FRAME:x,y,w,h, got \"{text}\""))?;
    let frame = frame.parse().ok().filter(|f| *f > 1);
    Ok((frame.ok_or_else(|| format!("expected a frame number from 2 on, got \"{text}\""))?, parse_box(bbox)?))
}

/// A configuration by file or by name.
pub fn blueprint(name: Option<&str>, default: &str) -> Result<(String, Blueprint)> {
    let name = name.unwrap_or(default);
    let path = Path::new(name);
    if path.is_file() {
        let base = path.parent().unwrap_or(Path::new("."));
        return Ok((name.to_owned(), Config::read(path)?.check(base)?));
    }
    match Config::builtin(name) {
        Some(config) => Ok((name.to_owned(), config?.check(Path::new("."))?)),
        None => {
            let names: Vec<&str> = foveate::config::BUILTIN.iter().map(|b| b.0).collect();
            Err(Error::Config(format!(
                "there is no configuration file {name}, and none of that name ships with the program; those that do: {}",
                names.join(", ")
            )))
        }
    }
}

pub fn run(args: Args) -> Result<()> {
    todo!()
}
