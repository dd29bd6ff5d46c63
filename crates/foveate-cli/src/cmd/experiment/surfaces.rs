//! `foveate experiment surfaces`: where it learned to look at each digit (section 6.2, the paper's figure of ten digits).

use std::path::PathBuf;

use foveate::gaze::Portrait;
use foveate::geometry::Gaze;
use foveate::identity::Retina;
use foveate::observe::first::Crop;
use foveate::observe::heat::Heat;
use foveate::observe::surface::{Column, Panel, banner, mean_picture, seen};
use foveate::scene::synthetic::{Drawn, Occlusion, Synthetic};
use foveate::scene::{Frame, Scene, encode_png};
use foveate::tracker::Tracker;
use foveate::{Error, Result, files};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::parse_digits;
use super::runner::{Entry, Job, Kept, all_runs, digits};
use crate::cmd::track::blueprint;

/// Points along a side of the surfaces.
pub const POINTS: usize = 33;

/// Where it learned to look at each digit: reward surface, best gazes of several runs, and what is seen there.
///
/// One video of each digit, followed by several trackers that differ in their randomness alone. About a minute for 100 runs.
/// Finished runs are kept in DIR/runs: the same command goes on where it was stopped or killed.
#[derive(clap::Args)]
pub struct Args {
    /// A configuration file, or the name of one that ships with the program; its policy learns a surface
    #[arg(long, short, value_name = "FILE", default_value = "digits-partial")]
    config: String,
    /// The digits to follow, such as 3 or 0-4,7
    #[arg(long, value_name = "LIST", default_value = "0-9", value_parser = parse_digits)]
    digits: ::std::vec::Vec<u8>, // spelt out, or clap would take it for an option given many times
    /// Runs on each video
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1000))]
    runs: u64,
    /// Names the videos, and the first run's randomness
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed: u64,
    /// Length of each video
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(20..=100_000))]
    frames: u32,
    /// Share of the pixels hit by noise
    #[arg(long, value_name = "SHARE", default_value_t = 0.3)]
    noise: f64,
    /// Folder with MNIST's test files (t10k-*, plain or .gz) [default: $FOVEATE_DATA or data; without them the digits are
    /// drawn by a pen]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder for surfaces.png and surfaces.json
    #[arg(long, short, value_name = "DIR", default_value = "out/surfaces")]
    out: PathBuf,
}

/// What one run learned.
#[derive(Clone, Serialize, Deserialize)]
pub struct Learned {
    pub heat: Heat,
    pub best: Gaze,
    /// Length of the video.
    frames: usize,
}

impl Kept for Learned {
    fn is_of(&self, frames: usize) -> bool {
        self.frames == frames && self.heat.mean.len() == POINTS * POINTS && self.heat.sd.len() == POINTS * POINTS
    }
}

impl Learned {
    /// Follows a video's target, and keeps what the policy believes at the end.
    pub fn follow(video: &dyn Drawn, tracker: &mut Tracker) -> Result<Self> {
        for (index, truth) in video.truth().iter().enumerate() {
            let frame = Frame { index, time: index as f64 / 30.0, image: video.render(index) };
            match index {
                0 => tracker.start(&frame, *truth)?,
                _ => drop(tracker.step(Scene { frame: &frame, detections: &[] })),
            }
        }
        let Portrait::Surface(surface) = tracker.parts().policy.portrait() else {
            return Err(Error::Config(
                "surfaces are learned by the policy gp-ucb, alone or beside an anchor; this configuration has another"
                    .into(),
            ));
        };
        let best = surface.best().ok_or_else(|| Error::Config("the video is shorter than the warm-up".into()))?;
        Ok(Self { heat: Heat::of(surface, POINTS), best, frames: video.truth().len() })
    }
}

/// What the runs on each video share with others of its kind: their key must tell them from runs of another kind.
pub fn entry(entry: Entry) -> Entry {
    Entry { key: format!("{} surfaces", entry.key), ..entry }
}

pub fn run(args: Args) -> Result<()> {
    let config = blueprint(&args.config)?.config().clone();
    let base = PathBuf::from(&args.config);
    let base = base.parent().filter(|_| base.is_file()).unwrap_or(std::path::Path::new("."));
    let entries = [entry(Entry::of(&args.config, config, base)?)];
    let (all, from) = digits(args.data.as_deref())?;
    let (seed, frames, noise) = (args.seed, args.frames as usize, args.noise);
    let settings = |&digit: &u8| Synthetic::Occlusion(Occlusion { digit, seed, frames, noise, ..Occlusion::default() });
    let settings: Vec<Synthetic> = args.digits.iter().map(settings).collect();
    let job =
        |video: &Synthetic, run: u64| Job { entry: 0, kind: 0, video: video.clone(), seed: seed.wrapping_add(run) };
    let jobs: Vec<Job> = settings.iter().flat_map(|video| (0..args.runs).map(|run| job(video, run))).collect();
    let learned = all_runs("surfaces", &args.out, &entries, &jobs, (&all, &from), &Learned::follow)?;
    let videos = settings.iter().map(|video| video.video(&all)).collect::<Result<Vec<_>>>()?;
    let title = format!("Where it learned to look: {} runs on a video of each digit ({from})", args.runs);
    let (png, rows) = picture(&title, &videos, &learned, &*entries[0].blueprint.retina());
    files::write(args.out.join("surfaces.png"), &png)?;
    let all = json!({ "digits_from": from, "seed": args.seed, "runs": args.runs, "points": POINTS, "surfaces": rows });
    let all = serde_json::to_string_pretty(&all).map_err(|e| Error::Invalid(e.to_string()))?;
    files::write(args.out.join("surfaces.json"), all.as_bytes())?;
    say!("{}: surfaces.png, surfaces.json", args.out.display());
    Ok(())
}

/// The figure as PNG, and its numbers: a column a video, from as many runs on each, which stand together.
pub fn picture(
    title: &str,
    videos: &[Box<dyn Drawn>],
    learned: &[Learned],
    retina: &dyn Retina,
) -> (Vec<u8>, Vec<Value>) {
    let runs = (learned.len() / videos.len().max(1)).max(1);
    let first: Vec<_> = videos.iter().map(|video| video.render(0)).collect();
    let templates: Vec<_> =
        videos.iter().zip(&first).map(|(video, image)| Crop::around(image, &video.truth()[0]).closer(1.2)).collect();
    let heats: Vec<_> = learned
        .chunks(runs)
        .map(|runs| Heat::average(&runs.iter().map(|run| run.heat.clone()).collect::<Vec<_>>()))
        .collect();
    let bests: Vec<Vec<Gaze>> = learned.chunks(runs).map(|runs| runs.iter().map(|run| run.best).collect()).collect();
    let columns: Vec<_> = (0..videos.len())
        .map(|i| Column {
            panel: Panel {
                map: heats[i].as_ref().map(|heat| (heat, &heat.mean[..], "mean reward")),
                best: &bests[i],
                ..Panel::of(&videos[i].label().to_string(), &templates[i])
            },
            view: mean_picture(
                &bests[i]
                    .iter()
                    .filter_map(|&gaze| seen(&first[i], &videos[i].truth()[0], retina, gaze))
                    .collect::<Vec<_>>(),
            ),
        })
        .collect();
    let row = |i: usize| {
        let best: Vec<_> = bests[i].iter().map(|gaze| [gaze.u, gaze.v]).collect();
        json!({ "digit": videos[i].label(), "best": best, "mean": heats[i].as_ref().map(|heat| &heat.mean) })
    };
    (encode_png(banner(title, &columns).image()), (0..videos.len()).map(row).collect())
}
