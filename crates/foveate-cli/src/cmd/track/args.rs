//! The arguments of `foveate track`, and the configuration that they select.

use std::path::{Path, PathBuf};

use foveate::Result;
use foveate::config::{Blueprint, Config, DetectorConfig, RecogniserConfig};
use foveate::files::Folder;
use foveate::geometry::BBox;
use foveate::lab::measure::Settings;

use super::init::{Init, parse_again, parse_init, truth_file};
use super::many::ManyArgs;
use super::source::{SourceArgs, StreamTo, parse_stream};
use crate::cmd::configure::{Changes, Profile, config_name, read};

/// The recogniser's section of a configuration.
const RECOGNISER: &str = "recogniser";

/// The shipped recogniser.
pub(crate) const DIGITS: &str = "builtin:digits";

/// Help text on the output files and their numbering.
const FILES: &str = "\
All results appear in --out when the run ends, or none do. A run that tracks nothing leaves the folder unchanged. A new run replaces \
an earlier run in the folder; other files stay. If a file of a new run cannot be written, a finished run in the folder also stays, and \
the other new files are in OUT.unplaced-PID. run.json lists the files of the run and states how it ended.

For a stream, a camera or a pipe, boxes.txt and track.csv (with many targets tracks.txt and tracks.csv) grow line by line in the folder
OUT.live-PID beside --out until the run ends, and stay there if it is killed. report.html, trace.jsonl and regret.csv then hold the
first 10,000 frames, and there is no annotated.mp4.

Frames count from 1 everywhere. Boxes on the command line, in boxes.txt, tracks.txt and files of detections count pixels from 1, \
as in OTB and MOTChallenge; track.csv, tracks.csv, trace.jsonl and --json count pixels from 0. boxes.txt moves a box outside the \
picture to the nearest place where it touches the picture; track.csv has the estimated position.";

#[derive(clap::Args)]
#[command(after_long_help = FILES)]
pub(crate) struct Args {
    /// Video file; folder of images or of tiles (foveate tiles); - or a fifo for yuv4mpeg from a pipe; rtsp://, http://, https:// or
    /// /dev/video0 for a stream or camera (requires ffmpeg). With several videos, --out has one folder per video: finished videos are
    /// skipped, VIDEO.txt holds the first box of VIDEO.mp4, index.html lists the worst videos first, and failures.txt lists the failed ones
    #[arg(required = true, value_name = "SOURCE")]
    pub(super) sources: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) input: SourceArgs,
    /// Write one line per frame as it is tracked: JSON or MOTChallenge's text to standard output, or JSON to an address. Other messages
    /// then go to standard error
    #[arg(long, value_name = "json|mot|udp:HOST:PORT", num_args = 0..=1, default_missing_value = "json", value_parser = parse_stream)]
    pub(super) stream: Option<StreamTo>,
    /// Target's box in the first frame: left, top, width, height in pixels, counted from 1 as in boxes.txt. `motion` selects the object
    /// that moves between the first two frames (the camera must stand still); `motion:W,H` gives it that size. Default: the first line of
    /// groundtruth_rect.txt in the folder, or of VIDEO.txt beside VIDEO.mp4. Repeat the option to follow many targets
    #[arg(long, value_name = "X,Y,W,H|motion", value_parser = parse_init, allow_hyphen_values = true)]
    pub(crate) init: Vec<Init>,
    #[command(flatten)]
    pub(super) many: ManyArgs,
    /// Restart the tracker at a later frame (counted from 1) with a new box. Repeatable
    #[arg(long, value_name = "FRAME:X,Y,W,H", value_parser = parse_again, allow_hyphen_values = true)]
    pub(super) reinit: Vec<(usize, BBox)>,
    /// Output folder: boxes.txt, track.csv, annotated.mp4, report.html, surface.png if the gaze policy learns, and run.json, which lists
    /// the files. With many targets: tracks.txt, tracks.csv, targets.csv, annotated.mp4, report.html
    #[arg(long, short, value_name = "DIR", default_value = "out")]
    pub(crate) out: PathBuf,
    /// Configuration file, or the name of a shipped configuration (natural, digits, ...: see `foveate configs`); default: natural
    #[arg(long, short, value_name = "FILE|NAME")]
    pub(super) config: Option<String>,
    /// Trade-off between speed and accuracy for one target, if no configuration is given
    #[arg(long, value_enum, conflicts_with = "config")]
    pub(super) profile: Option<Profile>,
    #[command(flatten)]
    pub(super) changes: Changes,
    /// Random seed; the same seed gives the same track. Default: the configuration's seed
    #[arg(long)]
    pub(super) seed: Option<u64>,
    /// Resume from a state written by --save-state, at the frame after the last tracked one, in a stream or camera at the first that
    /// arrives, which is frame 1; requires the same --config and --seed
    #[arg(long, value_name = "FILE", conflicts_with = "init")]
    pub(super) load_state: Option<PathBuf>,
    /// Save the tracker's state after the last frame, for --load-state
    #[arg(long, value_name = "FILE")]
    pub(super) save_state: Option<PathBuf>,
    /// Stop after this frame, counted from 1
    #[arg(long, value_name = "FRAME", value_parser = clap::value_parser!(u64).range(1..))]
    pub(super) until: Option<u64>,
    /// Print the summary as JSON
    #[arg(long)]
    pub(super) json: bool,
    /// Score nine gazes in every frame beside the policy's own, and report the regret against the best of them in hindsight: regret.csv,
    /// regret.svg and a section of the report. Slower; the track stays the same
    #[arg(long)]
    pub(super) regret: bool,
    /// Recognise the target with a model of `foveate train classifier` or `train fixations`. Default model: the shipped one, whose
    /// classes are the digits 0 to 9: it assigns every target to one of them. The class appears in track.csv, trace.jsonl, the video and the
    /// report; the track stays the same. MODEL replaces the configuration's recogniser; --set recogniser.KEY=VALUE changes its settings
    #[arg(long, visible_alias = "recognize", value_name = "MODEL", num_args = 0..=1, default_missing_value = DIGITS)]
    pub(super) recognise: Option<String>,
    /// Also write trace.jsonl: every intermediate quantity of every frame, including the particles; about 100 kB per frame
    #[arg(long)]
    pub(super) trace: bool,
    /// Do not write annotated.mp4
    #[arg(long)]
    pub(super) no_video: bool,
    /// Do not write report.html and surface.png
    #[arg(long)]
    pub(super) no_report: bool,
    /// Measures the motion: set by `foveate measure`
    #[arg(skip)]
    pub(crate) measure: Option<Measure>,
}

/// What `foveate measure` adds to a run.
#[derive(Clone)]
pub(crate) struct Measure {
    pub settings: Settings,
    /// The names of the points, in the order of their boxes.
    pub names: Vec<String>,
    /// The box in the first frame of a thing at rest.
    pub reference: Option<BBox>,
    /// Further files that the results must not replace.
    pub inputs: Vec<PathBuf>,
}

impl Args {
    /// Returns the model files named beside the configuration: the recogniser's and the detector's.
    pub(super) fn models(&self) -> impl Iterator<Item = &Path> {
        let network = match &self.many.detect {
            Some(DetectorConfig::Onnx(settings)) => Some(Path::new(&settings.model)),
            _ => None,
        };
        self.recognise.iter().map(Path::new).chain(network)
    }

    /// Returns the input files of the run, which its results must not replace. A loaded state may be replaced, so that a run can resume in
    /// place.
    pub(super) fn inputs(&self, source: &Path) -> Vec<PathBuf> {
        let (files, model) = ([&self.many.detections, &self.many.inits], self.models());
        let config = self.config.iter().map(Path::new);
        let begins = self.init.is_empty() && self.load_state.is_none() && !self.many.asked();
        let truth = truth_file(source).filter(|_| begins || source.is_dir());
        let files = files.into_iter().flatten().map(PathBuf::as_path).chain(model).chain(config).chain([source]);
        let measure = self.measure.iter().flat_map(|measure| measure.inputs.iter().cloned());
        files.map(PathBuf::from).chain(truth).chain(measure).collect()
    }

    /// Returns whether the arguments select many targets. Several points of a measurement are targets of one tracker each.
    pub(super) fn asks_for_many(&self) -> bool {
        self.many.asked() || (self.init.len() > 1 && self.measure.is_none())
    }

    /// Returns the configuration, the folder of its models, and its description.
    pub(super) fn configured(&self) -> Result<(Config, Folder, String)> {
        let name = match (&self.config, self.profile) {
            (None, None) if self.asks_for_many() => self.many.config(),
            (config, profile) => config_name(config.as_deref(), profile),
        };
        // The settings of --recognise apply to it if it replaces the configuration's recogniser.
        let others = self.recognise.as_ref().map(|_| self.changes.apart(RECOGNISER).1);
        let (config, folder) = read(name, others.as_ref().unwrap_or(&self.changes))?;
        Ok((config, folder, self.changes.describe(name)))
    }

    pub(super) fn blueprint(&self, config: Config, folder: &Folder) -> Result<Blueprint> {
        let blueprint = config.check(folder)?;
        let Some(model) = &self.recognise else { return Ok(blueprint) };
        let usual = RecogniserConfig::of_model(model, &Folder::here());
        let changed = Config { recogniser: Some(usual), ..blueprint.config().clone() };
        let changed = self.changes.apart(RECOGNISER).0.make(changed)?;
        blueprint.with_recogniser(changed.recogniser.expect("it was put there"), &Folder::here())
    }
}
