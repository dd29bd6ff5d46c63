//! The tracks for fitting P(lost). Videos are tracked in parallel, and each result is kept in a file until the fit is done, so that an
//! interrupted command resumes.

use std::path::PathBuf;

use clap::ValueEnum;
use foveate::Result;
use foveate::config::Blueprint;
use foveate::lab::eval::confidence::Judgement;
use foveate::lab::eval::confidence_fit::follow;
use foveate::lab::eval::{Sequence, experiment, find_sequences};
use foveate::lab::hide::{Hide, WAYS, Way};
use foveate::lab::synthetic::{Clutter, NOISE, Occlusion, Synthetic};
use foveate::lab::{Digits, Split};

use crate::cmd::eval::record::program;
use crate::cmd::videos::{self, Video, of_scene, of_sequence};
use crate::runs::{self, Entry, Finished, Store};

/// The videos to track, as arguments.
#[derive(clap::Args)]
pub(super) struct Tracked {
    /// Sequences in OTB layout, or folders of sequences
    #[arg(long, value_name = "DIR", num_args = 1.., required_unless_present = "scene")]
    seqs: Vec<PathBuf>,
    /// Also track each sequence backwards: the same target with another first frame
    #[arg(long, conflicts_with = "scene")]
    backwards: bool,
    /// Use drawn scenes instead: ten digits, 300 frames, 30 % noise
    #[arg(long, value_enum, conflicts_with = "seqs")]
    scene: Option<SceneName>,
    /// Side of the digit in the partial scene, pixels
    #[arg(long, default_value_t = 28, requires = "scene")]
    side: usize,
    /// Folder with MNIST's test files, for scenes. If omitted, digits are drawn with pen strokes
    #[arg(long, value_name = "DIR", requires = "scene")]
    data: Option<PathBuf>,
    /// Number of tracker seeds, counting up from --seed
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// First seed
    #[arg(long, default_value_t = 101)]
    seed: u64,
    /// Number of inserted occlusions for each video, seed and kind of occlusion
    #[arg(long, value_name = "N", default_value_t = 1)]
    occlusions: u64,
}

#[derive(Clone, Copy, ValueEnum)]
enum SceneName {
    /// A digit among static ones
    Clutter,
    /// A digit on black that passes behind bars
    Partial,
}

impl Finished for Vec<Judgement> {
    fn is_of(&self, frames: usize) -> bool {
        !self.is_empty() && self.iter().all(|track| track.frames.len() + 1 == frames)
    }
}

/// The videos.
pub(super) enum Videos {
    /// Sequences, each with a digest of its pictures and truth.
    Sequences(Vec<(Sequence, String)>),
    /// Drawn scenes, their digits, and a digest of the digits. Their camera is static.
    Scenes(Vec<Synthetic>, Digits, String),
}

/// One video with one seed of the tracker, unchanged and with inserted occlusions.
struct Job {
    video: usize,
    backwards: bool,
    seed: u64,
}

impl Videos {
    /// Creates the videos selected by the arguments.
    pub(super) fn of(args: &Tracked) -> Result<Self> {
        let Some(name) = args.scene else {
            let named = |sequence: Sequence| videos::digest(&sequence).map(|digest| (sequence, digest));
            return Ok(Self::Sequences(find_sequences(&args.seqs)?.into_iter().map(named).collect::<Result<_>>()?));
        };
        let digits = match &args.data {
            Some(dir) => Digits::load(dir, Split::Test)?,
            None => Digits::drawn(1, 20),
        };
        let (seed, side) = (args.seed, args.side);
        let scene = |digit| match name {
            SceneName::Clutter => Synthetic::Clutter(Clutter { digit, seed, noise: NOISE, ..Clutter::default() }),
            SceneName::Partial => Synthetic::Occlusion(Occlusion { digit, side, seed, ..Occlusion::default() }),
        };
        let pixels = runs::pixels(&digits);
        Ok(Self::Scenes((0..10).map(scene).collect(), digits, pixels))
    }

    /// Creates jobs for a tracker, one for each half of the videos: each video with each seed, and each backwards after its forward run.
    pub(super) fn jobs(&self, args: &Tracked, blueprints: Vec<Blueprint>) -> Result<Jobs<'_>> {
        let seeds = || (0..args.seeds).map(|i| args.seed.wrapping_add(i));
        let ways = if args.backwards { &[false, true][..] } else { &[false] };
        let all = (0..self.len())
            .flat_map(|video| ways.iter().map(move |backwards| (video, *backwards)))
            .flat_map(|(video, backwards)| seeds().map(move |seed| Job { video, backwards, seed }))
            .collect();
        let program = program()?;
        let entries = blueprints.into_iter().map(|it| Entry::of(it, &program)).collect::<Result<_>>()?;
        Ok(Jobs { videos: self, entries, occlusions: args.occlusions, all })
    }

    fn len(&self) -> usize {
        match self {
            Self::Sequences(all) => all.len(),
            Self::Scenes(all, ..) => all.len(),
        }
    }

    fn frames(&self, video: usize) -> usize {
        match self {
            Self::Sequences(all) => all[video].0.truth.len(),
            Self::Scenes(all, ..) => all[video].frames(),
        }
    }

    /// Returns a digest of everything that a video depends on.
    fn name(&self, video: usize) -> String {
        match self {
            Self::Sequences(all) => format!("{} {}", all[video].0.name, all[video].1),
            Self::Scenes(all, _, pixels) => format!("{:?} {pixels}", all[video]),
        }
    }
}

/// The jobs of one tracker on all videos.
pub(super) struct Jobs<'a> {
    videos: &'a Videos,
    /// For each half.
    entries: Vec<Entry>,
    occlusions: u64,
    all: Vec<Job>,
}

impl Jobs<'_> {
    /// Returns the names of the files.
    pub(super) fn keys(&self) -> Vec<String> {
        self.all.iter().map(|job| self.key(job)).collect()
    }

    /// Returns all tracks in the order of the videos; `None` if the program was stopped.
    pub(super) fn tracks(&self, store: &Store, label: &str) -> Result<Option<Vec<Judgement>>> {
        let make = |job: &Job| {
            let tracks = self.made(job)?;
            let text = runs::text(&tracks)?;
            Ok((tracks, text))
        };
        let frames = |job: &Job| self.videos.frames(job.video);
        let runs: Vec<Option<Vec<Judgement>>> =
            store.finished(label, &self.all, &frames, &|job| self.key(job), &make)?;
        Ok(runs.into_iter().collect::<Option<Vec<_>>>().map(|runs| runs.concat()))
    }

    fn key(&self, job: &Job) -> String {
        let Job { video, backwards, seed } = job;
        let how = format!("confidence {} {backwards} {seed} {}", self.videos.name(*video), self.occlusions);
        experiment::digest(&[self.entry(*video).key.as_bytes(), how.as_bytes()])
    }

    /// Returns the configuration for a video.
    fn entry(&self, video: usize) -> &Entry {
        match self.videos {
            Videos::Sequences(all) => &self.entries[all[video].0.origin.half as usize],
            Videos::Scenes(..) => &self.entries[0],
        }
    }

    fn made(&self, job: &Job) -> Result<Vec<Judgement>> {
        match self.videos {
            Videos::Sequences(all) => {
                let video = of_sequence(&all[job.video].0)?;
                let way = if job.backwards { video.backwards() } else { video };
                self.followed(&way, &WAYS, job)
            }
            Videos::Scenes(all, digits, _) => self.followed(&of_scene(&all[job.video], digits)?, &[Way::Behind], job),
        }
    }

    /// Tracks a video unchanged and, if it is long enough, with inserted occlusions.
    fn followed(&self, video: &Video<'_>, ways: &[Way], job: &Job) -> Result<Vec<Judgement>> {
        let (seed, blueprint) = (job.seed, &self.entry(job.video).blueprint);
        let clips = ways
            .iter()
            .flat_map(|way| (0..self.occlusions).map(move |k| (*way, seed.wrapping_mul(1000).wrapping_add(k))));
        let hidden = clips.filter_map(|(way, seed)| Hide::choose(way, &video.truth, video.size, (30, 90), seed).ok());
        let all = std::iter::once(None).chain(hidden.map(Some));
        all.map(|hide| {
            let (picture, mut tracker) = (&*video.picture, blueprint.tracker(seed)?);
            let frames = follow(&video.truth, video.truth.len(), hide.as_ref(), picture, &mut tracker)?;
            Ok(Judgement { video: video.name.clone(), origin: video.origin.clone(), occluded: hide.is_some(), frames })
        })
        .collect()
    }
}
