//! Implements `foveate convert`: converts boxes from one format to another.

mod coco;
mod cvat;
mod single;
mod yolo;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use foveate::text::counted;
use foveate::video::mot::{TrackBox, Tracks};
use foveate::{Error, Result};

use super::results::spare;
pub use yolo::write as write_yolo;

/// Maximum length of a video in frames; a larger frame number indicates a damaged file.
const MOST: usize = 1_000_000;

/// A file format for boxes.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq)]
pub enum Format {
    /// OTB's groundtruth_rect.txt and boxes.txt of `foveate track`: x,y,w,h per frame, counted from 1; NaN for no box
    Otb,
    /// VOT's groundtruth.txt: x,y,w,h or a polygon per frame, counted from 0
    Vot,
    /// GOT-10k's groundtruth.txt, as OTB's, with absence.label beside it
    Got10k,
    /// MOTChallenge's gt.txt, and tracks.txt of `foveate track`: frame,id,x,y,w,h,conf,... counted from 1
    Mot,
    /// COCO's JSON; the annotation's track_id identifies the target
    Coco,
    /// CVAT for video 1.1, XML
    Cvat,
}

impl Format {
    /// Returns the format with this command-line name.
    pub fn named(name: &str) -> Option<Self> {
        Self::from_str(name, false).ok()
    }

    /// Returns the names of all formats.
    pub fn names() -> Vec<String> {
        Self::value_variants().iter().filter_map(|f| Some(f.to_possible_value()?.get_name().to_owned())).collect()
    }
}

/// Convert boxes from one format to another.
///
/// Print one line for each kind of information that the output format cannot hold. If the output format holds one target and the input has
/// several, select one with --id.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Input file
    input: PathBuf,
    /// Output file; an existing file is replaced
    output: PathBuf,
    /// Format of the input file
    #[arg(long, value_enum)]
    from: Format,
    /// Format of the output file
    #[arg(long, value_enum)]
    to: Format,
    /// Convert only the target with this id
    #[arg(long, allow_hyphen_values = true)]
    id: Option<i64>,
}

/// The boxes of a video and the information lost in conversion.
#[derive(Debug, Default, PartialEq)]
pub struct Boxes {
    /// The boxes; ids as in the file, or 1 if the file has none.
    tracks: Vec<TrackBox>,
    /// Number of frames of the video, as far as the file states it.
    frames: usize,
    /// Descriptions of the information that the input or output format does not hold.
    lost: Vec<String>,
}

impl Boxes {
    /// Creates the boxes of a video with this number of frames.
    ///
    /// # Errors
    /// [`Error::Invalid`] if a box has no area, is not finite or lies beyond the last frame, or if two boxes belong to one target in one
    /// frame.
    pub fn new(tracks: Vec<TrackBox>, frames: usize) -> Result<Self> {
        let mut boxes = Self { tracks, frames, lost: vec![] };
        if frames > MOST {
            return Err(Error::Invalid(format!("there are {frames} frames; expected at most {MOST}")));
        }
        for b in &boxes.tracks {
            b.bbox.check()?;
            if b.frame >= frames {
                return Err(Error::Invalid(format!("a box is in frame {} of {frames}", b.frame + 1)));
            }
        }
        boxes.put_in_order().map_err(Error::Invalid)?;
        Ok(boxes)
    }

    /// Reads the boxes of a file.
    ///
    /// # Errors
    /// The file cannot be read, is not of this format, has neither frames nor boxes, or has too many frames.
    pub fn read(format: Format, path: &Path) -> Result<Self> {
        let boxes = read(format, path)?;
        if boxes.frames == 0 && boxes.tracks.is_empty() {
            return Err(Error::malformed(path, "it has neither frames nor boxes; expected some"));
        }
        if boxes.frames > MOST {
            let problem = format!("it has a frame {}; expected at most {MOST}", boxes.frames);
            return Err(Error::malformed(path, problem));
        }
        Ok(boxes)
    }

    /// Writes the boxes. Returns one sentence for each kind of information that the format does not hold.
    ///
    /// # Errors
    /// The format cannot hold these boxes, or the file cannot be written.
    pub fn write(mut self, format: Format, path: &Path) -> Result<Vec<String>> {
        write(format, &mut self, path)?;
        Ok(self.lost)
    }

    /// Sorts the boxes by frame, then by target.
    fn put_in_order(&mut self) -> std::result::Result<(), String> {
        let mut seen = BTreeSet::new();
        if let Some(b) = self.tracks.iter().find(|b| b.id >= 0 && !seen.insert((b.frame, b.id))) {
            return Err(format!("frame {} has two boxes of the target {}; expected one", b.frame + 1, b.id));
        }
        self.tracks.sort_by_key(|b| (b.frame, b.id));
        Ok(())
    }

    /// Records that `count` boxes lose information.
    fn lose(&mut self, count: usize, what: &str) {
        if count > 0 {
            self.lost.push(format!("{count} {what}"));
        }
    }

    /// Returns the target ids in ascending order.
    fn ids(&self) -> BTreeSet<i64> {
        self.tracks.iter().map(|b| b.id).collect()
    }

    /// Records confidences other than 1, which the output format does not hold.
    fn lose_confidence(&mut self) {
        let unsure = self.tracks.iter().filter(|b| b.confidence != 1.0).count();
        self.lose(unsure, "confidences other than 1 are left out");
    }
}

pub(crate) fn run(args: Args) -> Result<()> {
    spare(&args.output, &[&args.input])?;
    let mut boxes = Boxes::read(args.from, &args.input)?;
    if let Some(id) = args.id {
        boxes.tracks.retain(|b| b.id == id);
        if boxes.tracks.is_empty() {
            return Err(Error::malformed(&args.input, format!("it has no box of --id {id}")));
        }
    }
    boxes.put_in_order().map_err(|problem| Error::malformed(&args.input, problem))?;
    write(args.to, &mut boxes, &args.output)?;
    let (count, frames) = (boxes.tracks.len(), boxes.frames);
    boxes.lost.iter().for_each(|lost| note!("foveate: {}: {lost}", args.input.display()));
    let [count, targets, frames] =
        [(count, "box"), (boxes.ids().len(), "target"), (frames, "frame")].map(|(n, noun)| counted(n, noun));
    say!("{}: {count} of {targets} in {frames}", args.output.display());
    Ok(())
}

fn read(format: Format, path: &Path) -> Result<Boxes> {
    match format {
        Format::Otb | Format::Vot | Format::Got10k => single::read(format, path),
        Format::Mot => {
            let tracks = Tracks::read(path)?;
            Ok(Boxes { frames: tracks.frames(), tracks: tracks.sightings, lost: vec![] })
        }
        Format::Coco => coco::read(path),
        Format::Cvat => cvat::read(path),
    }
}

fn write(format: Format, boxes: &mut Boxes, path: &Path) -> Result<()> {
    match format {
        Format::Otb | Format::Vot | Format::Got10k => single::write(format, boxes, path),
        Format::Mot => {
            let tracks = Tracks { sightings: boxes.tracks.clone() };
            let end = tracks.frames();
            boxes.lose(boxes.frames - end.min(boxes.frames), "frames after the last box are left out");
            tracks.write(path)
        }
        Format::Coco => coco::write(boxes, path),
        Format::Cvat => cvat::write(boxes, path),
    }
}
