//! The detections for many targets, frame by frame, from a detector or from a file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use foveate::config::{Config, DetectorConfig, DetectorParts};
use foveate::files::Folder;
use foveate::report::Warnings;
use foveate::scene::{Cuts, Detection, Detector, Image, StillCamera};
use foveate::video::mot::{TrackBox, Tracks};
use foveate::video::{Frame, SourceInfo, ahead};
use foveate::{BBox, Error, Result};

use super::args::Args;
use super::init::Frames;
use super::many::ManyArgs;
use super::source::{SourceArgs, is_endless};

/// The source of the detections: one detector at most.
pub(super) enum DetectionSource {
    Nothing,
    /// A detector run by the program, and the configuration's detector that it replaces, if any.
    Ours(DetectorConfig, Option<DetectorConfig>),
    File(PathBuf, Option<DetectorConfig>),
    /// The configuration's detector, which the tracker runs.
    Configured(DetectorConfig),
}

impl DetectionSource {
    /// Selects the detector or the file of the command line, otherwise the configuration's detector.
    pub(super) fn choose(args: &ManyArgs, config: &mut Config) -> Result<Self> {
        let chosen = match (args.detector()?, &args.detections) {
            (Some(kind), _) => Self::Ours(kind, config.detector.take()),
            (None, Some(path)) => Self::File(path.clone(), config.detector.take()),
            (None, None) => config.detector.clone().map_or(Self::Nothing, Self::Configured),
        };
        match chosen {
            Self::Nothing | Self::Configured(_) if args.save_detections.is_some() => Err(Error::Invalid(
                "--save-detections writes what --detect finds; give --detect KIND too, or leave it out".into(),
            )),
            chosen => Ok(chosen),
        }
    }

    /// Returns whether the detector assumes a static camera.
    pub(super) fn needs_still_camera(&self) -> bool {
        let (Self::Ours(kind, _) | Self::Configured(kind)) = self else { return false };
        matches!(kind, DetectorConfig::Motion | DetectorConfig::Walkers)
    }
}

impl std::fmt::Display for DetectionSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = |detector: &DetectorConfig| match detector {
            DetectorConfig::Onnx(settings) => format!("onnx:{}", settings.model),
            detector => detector.name().to_owned(),
        };
        let replaced = match self {
            Self::Nothing => return write!(f, "none, given boxes alone"),
            Self::Configured(kind) => return write!(f, "{}, the configuration's", name(kind)),
            Self::Ours(kind, replaced) => write!(f, "{} (--detect)", name(kind)).map(|()| replaced)?,
            Self::File(path, replaced) => write!(f, "{}", path.display()).map(|()| replaced)?,
        };
        match replaced {
            Some(kind) => write!(f, ", in the place of the configuration's {}", name(kind)),
            None => Ok(()),
        }
    }
}

/// Number of frames for the initial background model, and how far into the video they may lie.
const PICTURES: usize = 40;
const AHEAD: usize = 400;

/// Returns pictures from the beginning of a video, up to its first cut.
fn background(source: &Path, input: &SourceArgs) -> Result<Vec<Image>> {
    // A source that cannot be read twice starts without a background model.
    if is_endless(source) {
        return Ok(vec![]);
    }
    let frames = input.open(source)?.source;
    let selection = input.selection();
    let taken = |n: usize| n.saturating_sub(selection.from).div_ceil(selection.every.max(1));
    let every = frames.info().frames.map_or(AHEAD, |n| taken(n).min(AHEAD)).div_ceil(PICTURES).max(1);
    let (mut cuts, mut pictures) = (Cuts::default(), vec![]);
    // If the source breaks off here, tracking reports the error when it reaches the frame.
    for (i, frame) in ahead(frames).take(AHEAD).map_while(Result::ok).enumerate() {
        if cuts.cut(&frame.image) {
            break;
        }
        if i.is_multiple_of(every) {
            pictures.push(frame.image);
        }
    }
    Ok(pictures)
}

/// Returns whether a box lies entirely outside the picture.
fn is_outside(b: &BBox, about: &SourceInfo) -> bool {
    b.x >= about.width as f64 || b.y >= about.height as f64 || b.x + b.w <= 0.0 || b.y + b.h <= 0.0
}

/// Reports the number of boxes in a file that are outside the tracked frames or picture.
fn note_unused(path: &Path, count: usize, place: std::fmt::Arguments<'_>) {
    if count > 0 {
        note!("foveate: {}: {count} of its boxes lie {place}: nothing is tracked there", path.display());
    }
}

/// The detections of a run, frame by frame: from the program's detector or from a file.
#[derive(Default)]
pub(super) struct Detections {
    parts: Option<DetectorParts>,
    detector: Option<Box<dyn Detector>>,
    read: BTreeMap<usize, Vec<Detection>>,
    /// The file of --detections.
    file: Option<PathBuf>,
    /// The file of --save-detections, and its lines so far.
    kept: Option<(PathBuf, Tracks)>,
    /// Checks for camera motion, if the detector needs a static camera, until motion is found.
    still: Option<StillCamera>,
    pub warnings: Warnings,
    /// The detector runs in every so many frames of the tracker: `multi_target.every`.
    pub every: usize,
    /// Frames so far. A live run leaves out others, which have numbers too.
    frames: usize,
}

impl Detections {
    /// Fails if `needed` is true and there is no source of detections, because nothing else then starts a track.
    pub(super) fn of(
        (args, source): (&Args, &Path),
        about: &SourceInfo,
        frames: Frames,
        needed: bool,
        still: bool,
    ) -> Result<Self> {
        let (input, args) = (&args.input, &args.many);
        let parts = args.detector()?.map(|config| config.read(&Folder::here())).transpose()?;
        let least = args.least.unwrap_or(0.0);
        let mut read: BTreeMap<usize, Vec<Detection>> = BTreeMap::new();
        if let Some(path) = &args.detections {
            let tracks = Tracks::read(path)?;
            let counts = |s: &&TrackBox| {
                let sized = s.bbox.w >= 1.0 && s.bbox.h >= 1.0;
                s.confidence >= least && sized && frames.check("", s.frame).is_ok()
            };
            for s in tracks.sightings.iter().filter(counts) {
                read.entry(s.frame).or_default().push(Detection::new(s.bbox, s.confidence));
            }
            let outside = read.values().flatten().filter(|found| is_outside(&found.bbox, about)).count();
            note_unused(path, outside, format_args!("outside the {} x {} picture", about.width, about.height));
            let last = about.exact_frames().unwrap_or(usize::MAX);
            let late = tracks.sightings.iter().filter(|s| s.frame >= last).count();
            note_unused(path, late, format_args!("in frames after frame {last}, the last one"));
            if needed && read.is_empty() {
                return Err(Error::malformed(
                    path,
                    format!(
                        "none of its {} boxes counts: expected some of at least 1 x 1 pixel and a confidence of {} or more in the \
                         frames that are tracked, counted from 1; check the file, --least and --until",
                        tracks.sightings.len(),
                        least
                    ),
                ));
            }
        }
        let (file, kept) =
            (args.detections.clone(), args.save_detections.clone().map(|path| (path, Tracks::default())));
        let pictures = match args.detect {
            Some(DetectorConfig::Motion | DetectorConfig::Walkers) => background(source, input)?,
            _ => vec![],
        };
        let detector = parts.as_ref().map(|parts| parts.knowing(&pictures));
        let still = still.then(StillCamera::default);
        Ok(Self { parts, detector, read, file, kept, still, warnings: Warnings::default(), every: 1, frames: 0 })
    }

    pub(super) fn next(&mut self, frame: &Frame, cut: bool, found: &mut Vec<Detection>) -> Result<()> {
        if let (true, Some(parts)) = (cut, &self.parts) {
            self.detector = Some(parts.knowing(&[]));
        }
        if let Some(still) = &mut self.still {
            still.look(&frame.image, cut);
            if still.moves().is_some() {
                self.warnings.add(MOVING.into());
                self.still = None;
            }
        }
        let due = self.frames.is_multiple_of(self.every);
        self.frames += 1;
        match &mut self.detector {
            Some(detector) if due => detector.detect(&frame.image, found),
            Some(_) => (),
            None => found.extend_from_slice(self.read.get(&frame.index).map_or(&[], Vec::as_slice)),
        }
        if let Some((_, kept)) = &mut self.kept {
            kept.sightings.extend(found.iter().map(|d| TrackBox {
                frame: frame.index,
                id: -1,
                bbox: d.bbox,
                confidence: d.score,
            }));
        }
        Ok(())
    }

    /// Notes how many boxes of --detections lie after the last frame, for a source of unknown length.
    pub(super) fn note_late(&self, frames: usize) {
        if let Some(path) = &self.file {
            let late = self.read.range(frames..).map(|(_, found)| found.len()).sum();
            note_unused(path, late, format_args!("in frames after frame {frames}, the last one"));
        }
    }

    /// Writes the file of --save-detections.
    pub(super) fn save(&self) -> Result<()> {
        self.kept.as_ref().map_or(Ok(()), |(path, kept)| kept.write(path))
    }
}

/// The warning about camera motion with a detector that needs a static camera.
const MOVING: &str = "The camera moves: this detector finds what differs from a background that stands still, so boxes may be of \
                      nobody and targets may be missed. Give a detector's boxes with --detections, or take --detect flow.";

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use foveate::scene::Map;
    use foveate::video::save_png;

    #[derive(Parser)]
    struct Words {
        #[command(flatten)]
        input: SourceArgs,
        /// An input option that excludes loading a state.
        #[arg(long)]
        load_state: Option<PathBuf>,
    }

    #[test]
    fn the_detector_runs_in_every_so_many_frames() {
        struct Corner(Map);
        impl Detector for Corner {
            fn detect(&mut self, _: &Image, found: &mut Vec<Detection>) {
                found.push(Detection::new(BBox::new(0.0, 0.0, 2.0, 2.0), 1.0));
            }
            fn map(&self) -> &Map {
                &self.0
            }
        }
        let mut detections =
            Detections { detector: Some(Box::new(Corner(Map::default()))), every: 3, ..Detections::default() };
        // Half of the frames were dropped.
        let runs: Vec<bool> = (0..7)
            .map(|k| {
                let index = 2 * k + 1;
                let (frame, mut found) = (Frame { index, time: 0.0, image: Image::grey(16, 12, 0) }, vec![]);
                detections.next(&frame, false, &mut found).expect("a detector that finds");
                !found.is_empty()
            })
            .collect();
        assert_eq!(runs, [true, false, false, true, false, false, true]);
    }

    #[test]
    fn the_background_is_learned_from_all_over_the_frames_that_are_taken() {
        let place = tempfile::tempdir().expect("a temporary folder");
        for t in 0..100 {
            let picture = Image::grey(16, 12, 2 * t);
            save_png(place.path().join(format!("{t:02}.png")), &picture).expect("a writable folder");
        }
        for (words, frames) in [
            (&["track"][..], (0..100).step_by(3).collect::<Vec<_>>()),
            (&["track", "--every", "10"], (0..100).step_by(10).collect()),
            (&["track", "--every", "2", "--from", "2"], (1..100).step_by(4).collect()),
        ] {
            let pictures = background(place.path(), &Words::parse_from(words).input).expect("readable");
            let found: Vec<usize> = pictures.iter().map(|picture| usize::from(picture.at(0, 3, 3)) / 2).collect();
            assert_eq!(found, frames, "{words:?}");
        }
    }
}
