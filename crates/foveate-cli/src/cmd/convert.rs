//! Implements `foveate convert`: converts boxes from one format to another.

mod boxes;
mod coco;
mod cvat;
mod label_studio;
mod napari;
mod single;
mod trackmate;
mod viame;
mod yolo;

use std::fmt::{Display, Write};
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use foveate::geometry::Size;
use foveate::text::counted;
use foveate::video::mot::Tracks;
use foveate::{Error, Result, files};

use super::results::spare;
use super::track::source::parse_size;
pub use boxes::Boxes;
pub(crate) use boxes::KeyFrames;
use boxes::{BOX, MOST};
pub use yolo::write as write_yolo;

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
    /// Label Studio's JSON of a video; boxes are in per cent: `convert` needs --size
    LabelStudio,
    /// Tracks of DIVE and VIAME, CSV
    Viame,
    /// Spots of TrackMate, CSV: centres and areas, in pixels
    Trackmate,
    /// A layer of shapes of napari, CSV: one target
    Napari,
}

impl Format {
    /// Returns whether files hold a single target.
    pub(crate) fn is_of_one(self) -> bool {
        matches!(self, Self::Otb | Self::Vot | Self::Got10k | Self::Napari)
    }

    /// Returns whether files hold confidences.
    pub(crate) fn has_confidence(self) -> bool {
        matches!(self, Self::Mot | Self::Coco | Self::Viame | Self::Trackmate)
    }

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
    /// Size of the video's pictures in pixels; label-studio needs it, and some readers of CVAT's format
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = parse_size)]
    size: Option<Size>,
}

impl Boxes {
    /// Reads the boxes of a file.
    ///
    /// # Errors
    /// The file cannot be read, is not of this format, has neither frames nor boxes, too many frames, or two boxes of one target in one
    /// frame.
    pub fn read(format: Format, path: &Path) -> Result<Self> {
        Self::read_of_size(format, path, None)
    }

    /// [`Boxes::read`] of a format that may need the size of the pictures: Label Studio's.
    ///
    /// # Errors
    /// As [`Boxes::read`], and if such a format has no size.
    pub fn read_of_size(format: Format, path: &Path, size: Option<Size>) -> Result<Self> {
        let boxes = read(format, path, size)?;
        let stated = boxes.size;
        let mut boxes = Self { stated, ..boxes.of_size(size) };
        if boxes.frames == 0 && boxes.tracks.is_empty() {
            return Err(Error::malformed(path, "it has neither frames nor boxes; expected some"));
        }
        if boxes.frames > MOST {
            let problem = format!("it has a frame {}; expected at most {MOST}", boxes.frames);
            return Err(Error::malformed(path, problem));
        }
        boxes.put_in_order().map_err(|problem| Error::malformed(path, problem))?;
        Ok(boxes)
    }

    /// Writes the boxes. Returns one sentence for each kind of information that the format does not hold.
    ///
    /// # Errors
    /// The format cannot hold these boxes, or the file cannot be written.
    pub fn write(mut self, format: Format, path: &Path) -> Result<Vec<String>> {
        self.lose_filled();
        write(format, &mut self, path)?;
        Ok(self.lost)
    }
}

pub(crate) fn run(args: Args) -> Result<()> {
    spare(&args.output, &[&args.input])?;
    let mut boxes = Boxes::read_of_size(args.from, &args.input, args.size)?;
    if let Some(id) = args.id {
        boxes.tracks.retain(|b| b.id == id);
        boxes.labels.retain(|of, _| *of == id);
        boxes.filled.retain(|of, _| *of == id);
        if boxes.tracks.is_empty() {
            return Err(Error::malformed(&args.input, format!("it has no box of --id {id}")));
        }
    }
    boxes.lose_filled();
    let all = boxes.tracks.len();
    boxes.tracks.retain(|b| b.bbox.check().is_ok());
    boxes.lose(all - boxes.tracks.len(), "boxes without area are left out");
    write(args.to, &mut boxes, &args.output)?;
    let (count, frames) = (boxes.tracks.len(), boxes.frames);
    boxes.lost.iter().for_each(|lost| note!("foveate: {}: {lost}", args.input.display()));
    let [count, targets, frames] =
        [(count, "box"), (boxes.ids().len(), "target"), (frames, "frame")].map(|(n, noun)| counted(n, noun));
    say!("{}: {count} of {targets} in {frames}", args.output.display());
    Ok(())
}

/// Returns a list in JSON. One value of all would take ten times the memory of the text.
fn list(items: impl Iterator<Item = impl Display>) -> String {
    let mut text = String::from("[");
    for (i, item) in items.enumerate() {
        let _ = write!(text, "{}{item}", if i == 0 { "" } else { "," });
    }
    text + "]"
}

fn read(format: Format, path: &Path, size: Option<Size>) -> Result<Boxes> {
    match format {
        Format::Otb | Format::Vot | Format::Got10k => single::read(format, path),
        Format::Mot => {
            let text = files::read_text(path, files::TEXT)?;
            let tracks = Tracks::parse(&text, path)?;
            let mut boxes = Boxes { frames: tracks.frames(), tracks: tracks.sightings, ..Boxes::default() };
            // Class and visibility, or a place in the world, after the confidence; -1 where there is none.
            let is_known = |word: &str| word.trim().parse() != Ok(-1.0);
            let known =
                |line: &&str| line.split([',', ';', '\t', ' ']).filter(|word| !word.is_empty()).skip(7).any(is_known);
            boxes.lose(
                text.lines().filter(known).count(),
                "boxes have a class, a visibility or a place; it is left out",
            );
            Ok(boxes)
        }
        Format::Coco => coco::read(path),
        Format::Cvat => cvat::read(path),
        Format::LabelStudio => label_studio::read(path, size),
        Format::Viame => viame::read(path),
        Format::Trackmate => trackmate::read(path),
        Format::Napari => napari::read(path),
    }
}

fn write(format: Format, boxes: &mut Boxes, path: &Path) -> Result<()> {
    if !matches!(format, Format::Coco | Format::Cvat | Format::LabelStudio | Format::Viame) {
        boxes.lose_labels();
    }
    if format != Format::Cvat {
        let hidden = boxes.tracks.iter().filter(|b| boxes.occluded.contains(&(b.frame, b.id))).count();
        boxes.lose(hidden, "boxes are occluded; that is left out");
    }
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
        Format::LabelStudio => label_studio::write(boxes, path),
        Format::Viame => viame::write(boxes, path),
        Format::Trackmate => trackmate::write(boxes, path),
        Format::Napari => napari::write(boxes, path),
    }
}
