//! The arguments of `foveate track`, and the configuration that they ask for.

use std::path::{Path, PathBuf};

use foveate::Result;
use foveate::config::{Blueprint, Config, DetectorConfig, RecogniserConfig};
use foveate::files::Folder;
use foveate::geometry::BBox;

use super::init::{Init, parse_again, parse_init, truth_file};
use super::many::ManyArgs;
use super::source::{SourceArgs, StreamTo, parse_stream};
use crate::cmd::configure::{Changes, Profile, config_name, read};

/// Its section of a configuration.
const RECOGNISER: &str = "recogniser";

/// The recogniser that ships with the program.
pub(crate) const DIGITS: &str = "builtin:digits";

/// What is said of files and of numbers in them.
const FILES: &str = "\
Results appear in --out together, when the run ends: whole, or not at all. A run that tracks nothing leaves the folder as it was. \
An earlier run in it is replaced; other files in it stay. A finished run stays, too, where a file of the new one could not be written: \
the other files are in OUT.unplaced-PID then. run.json lists the files of the run, and says how it ended.

Of a stream, a camera or a pipe, boxes.txt and track.csv (tracks.txt and tracks.csv of many targets) grow line by line in the folder
OUT.live-PID beside --out until the run ends, and stay there where it is killed. report.html, trace.jsonl and regret.csv then hold the
first 10,000 frames, and there is no annotated.mp4.

Frames count from 1 everywhere. Boxes on the command line, in boxes.txt, tracks.txt and files of detections count pixels from 1, \
as OTB and MOTChallenge do; track.csv, tracks.csv, trace.jsonl and --json count pixels from 0. A box that lies outside the picture \
stands in boxes.txt at the nearest place where it touches the picture, and in track.csv where it is believed to be.";

#[derive(clap::Args)]
#[command(after_long_help = FILES)]
pub(crate) struct Args {
    /// A video file, or a folder of images, or of tiles (foveate tiles); - or a fifo for yuv4mpeg from a pipe; rtsp://, http://, https:// or /dev/video0 for a
    /// stream or camera (through the program ffmpeg). Of several videos each has a folder in --out: finished ones are passed over,
    /// the first box of VIDEO.mp4 is in VIDEO.txt, index.html has the worst first, failures.txt those that failed
    #[arg(required = true, value_name = "SOURCE")]
    pub(super) sources: Vec<PathBuf>,
    #[command(flatten)]
    pub(super) input: SourceArgs,
    /// Write a line a frame as it happens: JSON or MOTChallenge's text to standard output, or JSON to an address. What else is said
    /// goes to standard error then
    #[arg(long, value_name = "json|mot|udp:HOST:PORT", num_args = 0..=1, default_missing_value = "json", value_parser = parse_stream)]
    pub(super) stream: Option<StreamTo>,
    /// The target's box in the first frame: left, top, width, height in pixels, counted from 1 as in boxes.txt.
    /// `motion` takes what moves between the first two frames (the camera must stand still); `motion:W,H` gives it that size.
    /// Left out, the first line of groundtruth_rect.txt in the folder is taken, or of VIDEO.txt beside VIDEO.mp4. Given several times, many targets are followed
    #[arg(long, value_name = "X,Y,W,H|motion", value_parser = parse_init, allow_hyphen_values = true)]
    pub(super) init: Vec<Init>,
    #[command(flatten)]
    pub(super) many: ManyArgs,
    /// Restart on the target at a later frame (counted from 1) with a new box; may be given several times
    #[arg(long, value_name = "FRAME:X,Y,W,H", value_parser = parse_again, allow_hyphen_values = true)]
    pub(super) reinit: Vec<(usize, BBox)>,
    /// Folder for the results: boxes.txt, track.csv, annotated.mp4, report.html, surface.png where the gaze policy learns, and
    /// run.json, which lists them; of many targets tracks.txt, tracks.csv, targets.csv, annotated.mp4, report.html
    #[arg(long, short, value_name = "DIR", default_value = "out")]
    pub(super) out: PathBuf,
    /// A configuration file, or the name of one that ships with the program (natural, digits, ...: see `foveate configs`);
    /// natural if left out
    #[arg(long, short, value_name = "FILE|NAME")]
    pub(super) config: Option<String>,
    /// How much time a frame may take, where no configuration is given
    #[arg(long, value_enum, conflicts_with = "config")]
    pub(super) profile: Option<Profile>,
    #[command(flatten)]
    pub(super) changes: Changes,
    /// Seed of all random numbers: the same seed gives the same track. Left out, the configuration's seed is taken
    #[arg(long)]
    pub(super) seed: Option<u64>,
    /// Go on from a state written by --save-state, at the frame after the last one tracked; needs the same --config and --seed
    #[arg(long, value_name = "FILE", conflicts_with = "init")]
    pub(super) load_state: Option<PathBuf>,
    /// Write the tracker's whole state after the last frame, for --load-state
    #[arg(long, value_name = "FILE")]
    pub(super) save_state: Option<PathBuf>,
    /// Stop after this frame (counted from 1)
    #[arg(long, value_name = "FRAME", value_parser = clap::value_parser!(u64).range(1..))]
    pub(super) until: Option<u64>,
    /// Print the summary as JSON
    #[arg(long)]
    pub(super) json: bool,
    /// Score nine gazes in every frame beside the policy's own, and write the regret against the best of them in
    /// hindsight: regret.csv, regret.svg and a section of the report. Takes time; the track stays the same
    #[arg(long)]
    pub(super) regret: bool,
    /// Name the target by a model of `foveate train classifier` or `train fixations`. Without MODEL by the one that ships, which knows
    /// the digits 0 to 9 alone and calls everything a digit. The class stands in track.csv, trace.jsonl, video and report; the track stays
    /// the same. MODEL takes the place of the configuration's recogniser; --set recogniser.KEY=VALUE changes its settings
    #[arg(long, visible_alias = "recognize", value_name = "MODEL", num_args = 0..=1, default_missing_value = DIGITS)]
    pub(super) recognise: Option<String>,
    /// Write trace.jsonl too: every intermediate quantity of every frame, particles included; some 100 kB a frame
    #[arg(long)]
    pub(super) trace: bool,
    /// Leave out annotated.mp4
    #[arg(long)]
    pub(super) no_video: bool,
    /// Leave out report.html and surface.png
    #[arg(long)]
    pub(super) no_report: bool,
}

impl Args {
    /// The models that are named beside the configuration: the recogniser's and the detector's.
    pub(super) fn models(&self) -> impl Iterator<Item = &Path> {
        let network = match &self.many.detect {
            Some(DetectorConfig::Onnx(settings)) => Some(Path::new(&settings.model)),
            _ => None,
        };
        self.recognise.iter().map(Path::new).chain(network)
    }

    /// The files that the run reads: its results must not replace them. A state that is taken up may be replaced: so it goes on.
    pub(super) fn inputs(&self, source: &Path) -> Vec<PathBuf> {
        let (files, model) = ([&self.many.detections, &self.many.inits], self.models());
        let config = self.config.iter().map(Path::new);
        let begins = self.init.is_empty() && self.load_state.is_none() && !self.many.asked();
        let truth = truth_file(source).filter(|_| begins || source.is_dir());
        let files = files.into_iter().flatten().map(PathBuf::as_path).chain(model).chain(config).chain([source]);
        files.map(PathBuf::from).chain(truth).collect()
    }

    /// Whether many targets are asked for.
    pub(super) fn asks_for_many(&self) -> bool {
        self.many.asked() || self.init.len() > 1
    }

    /// The configuration, the folder of its models, and what it is called.
    pub(super) fn configured(&self) -> Result<(Config, Folder, String)> {
        let name = match (&self.config, self.profile) {
            (None, None) if self.asks_for_many() => self.many.config(),
            (config, profile) => config_name(config.as_deref(), profile),
        };
        // Its settings are those of --recognise, where that takes its place.
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
        blueprint.recognising(changed.recogniser.expect("it was put there"), &Folder::here())
    }
}
