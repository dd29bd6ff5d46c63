//! Implements `foveate convert`: converts boxes from one format to another.

mod coco;
mod cvat;
mod label_studio;
mod napari;
mod single;
mod trackmate;
mod viame;
mod yolo;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{Display, Write};
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use foveate::geometry::Size;
use foveate::text::counted;
use foveate::video::SourceInfo;
use foveate::video::mot::{TrackBox, Tracks};
use foveate::{BBox, Error, Result, files, memory};

use super::results::spare;
use super::track::source::parse_size;
pub use yolo::write as write_yolo;

/// Maximum length of a video in frames; a larger frame number indicates a damaged file.
const MOST: usize = 1_000_000;

/// Estimated bytes per box: its entry in a growing list, its visibility flag, and one line of text.
const BOX: u64 = 400;

/// Boxes that a person set, by frame (from 0): `None` where the target leaves the picture.
pub(crate) type KeyFrames = BTreeMap<usize, Option<BBox>>;

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

/// The boxes of a video and the information lost in conversion.
#[derive(Debug, Default, PartialEq)]
pub struct Boxes {
    /// The boxes; ids as in the file, or 1 if the file has none.
    tracks: Vec<TrackBox>,
    /// Number of frames of the video, as far as the file states it.
    frames: usize,
    /// Labels of the targets, by id, as far as the file has them.
    labels: BTreeMap<i64, String>,
    /// The boxes that a person set, by target; empty if the format does not mark them.
    keys: BTreeMap<i64, KeyFrames>,
    /// Number of boxes between key frames that the file does not state, by target.
    filled: BTreeMap<i64, usize>,
    /// The boxes, by frame and target, of which a part is hidden, as far as the file has it.
    occluded: BTreeSet<(usize, i64)>,
    /// Size of the pictures, which Label Studio's format needs.
    size: Option<Size>,
    /// Frames per second, if known.
    rate: Option<f64>,
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
        let mut boxes = Self { tracks, frames, ..Self::default() };
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

    /// The same boxes of a video whose pictures have this size, which some formats need.
    #[must_use]
    pub fn of_size(self, size: Option<Size>) -> Self {
        Self { size: size.or(self.size), ..self }
    }

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
        let mut boxes = read(format, path, size)?.of_size(size);
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

    /// Takes the notes on the file that was read: one sentence for each kind of information that is left out.
    pub(crate) fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.lost)
    }

    /// Returns the boxes that a person set, by target: all boxes if the format does not mark them.
    pub(crate) fn key_frames(&self) -> BTreeMap<i64, KeyFrames> {
        if !self.keys.is_empty() {
            return self.keys.clone();
        }
        let mut keys: BTreeMap<i64, KeyFrames> = BTreeMap::new();
        for b in &self.tracks {
            keys.entry(b.id).or_default().insert(b.frame, Some(b.bbox));
        }
        keys
    }

    /// Replaces the boxes by others of the same targets; labels and occlusion stay.
    pub(crate) fn with_tracks(self, tracks: Vec<TrackBox>, frames: usize, about: &SourceInfo) -> Result<Self> {
        let boxes = Self::new(tracks, frames)?;
        let (size, rate) = (Some(about.size()), Some(about.rate));
        Ok(Self { labels: self.labels, occluded: self.occluded, size, rate, ..boxes })
    }

    /// Adds the boxes of a target: each holds, or moves linearly, up to the next one, and the last one holds up to the end of the video, as
    /// in CVAT and Label Studio.
    fn fill(&mut self, path: &Path, id: i64, shapes: &KeyFrames) -> Result<()> {
        let end = match shapes.iter().next_back() {
            Some((last, Some(_))) => self.frames.max(last + 1),
            Some((last, None)) => last + 1,
            None => 0,
        };
        self.frames = self.frames.max(end);
        // Each box applies up to the next key frame, which may be a million frames away.
        let next = shapes.iter().skip(1).map(|(frame, bbox)| (*frame, bbox)).chain([(end, &None)]);
        let stretches = shapes.iter().zip(next).filter_map(|((from, a), (to, b))| Some((*from..to, (*a)?, *b)));
        let count = self.tracks.len() + stretches.clone().map(|(frames, ..)| frames.len()).sum::<usize>();
        memory::check(format_args!("{}: {count} boxes", path.display()), count as u64 * BOX)?;
        let mut filled = 0;
        for (frames, a, b) in stretches {
            filled += frames.len() - 1;
            let (from, length) = (frames.start, frames.len() as f64);
            self.tracks.extend(frames.map(|frame| {
                let bbox = between(&a, b.as_ref().unwrap_or(&a), (frame - from) as f64 / length);
                TrackBox { frame, id, bbox, confidence: 1.0 }
            }));
        }
        *self.filled.entry(id).or_default() += filled;
        Ok(())
    }

    /// Refuses boxes without an id, for a format of tracks.
    fn check_ids(&self, format: &str) -> Result<()> {
        match self.tracks.iter().filter(|b| b.id < 0).count() {
            0 => Ok(()),
            unknown => {
                let unknown = counted(unknown, "box");
                Err(Error::Invalid(format!("no id (-1) for {unknown}; {format} holds tracks, not detections")))
            }
        }
    }

    /// Returns the label of a target, if the file has one.
    pub(crate) fn known_label(&self, id: i64) -> Option<&str> {
        self.labels.get(&id).map(String::as_str)
    }

    /// Returns the label of a target, and records that the format needs one if there is none.
    fn label(&mut self, id: i64) -> String {
        const NONE: &str = "the label is \"object\": the format needs one; name yours in the task or in the file";
        self.labels.get(&id).cloned().unwrap_or_else(|| {
            if !self.lost.iter().any(|lost| lost == NONE) {
                self.lost.push(NONE.into());
            }
            "object".into()
        })
    }

    /// Records boxes that the file does not state.
    fn lose_filled(&mut self) {
        self.lose(self.filled.values().sum(), "boxes between key frames are interpolated");
    }

    /// Records labels, which the output format does not hold.
    fn lose_labels(&mut self) {
        let different = self.labels.values().collect::<BTreeSet<_>>().len();
        self.lose(if different > 1 { different } else { 0 }, "labels are left out");
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

    /// Returns the boxes sorted by target, then by frame.
    fn by_target(&self) -> Vec<TrackBox> {
        let mut boxes = self.tracks.clone();
        boxes.sort_by_key(|b| (b.id, b.frame));
        boxes
    }

    /// Records confidences other than 1, which the output format does not hold.
    fn lose_confidence(&mut self) {
        let unsure = self.tracks.iter().filter(|b| b.confidence != 1.0).count();
        self.lose(unsure, "confidences other than 1 are left out");
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

fn between(a: &BBox, b: &BBox, share: f64) -> BBox {
    let mix = |a: f64, b: f64| if share == 0.0 { a } else { a + share * (b - a) };
    BBox::new(mix(a.x, b.x), mix(a.y, b.y), mix(a.w, b.w), mix(a.h, b.h))
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
