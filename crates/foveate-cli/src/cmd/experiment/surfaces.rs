//! `foveate experiment surfaces`: where it learned to look at each digit (section 6.2, the paper's figure of ten digits).

use std::path::{Path, PathBuf};

use foveate::config::Blueprint;
use foveate::gaze::Portrait;
use foveate::geometry::Gaze;
use foveate::observe::first::Crop;
use foveate::observe::heat::Heat;
use foveate::observe::surface::{Column, Panel, banner, mean_picture, seen};
use foveate::scene::synthetic::{Drawn, Occlusion, OcclusionVideo};
use foveate::scene::{Frame, Scene, encode_png};
use foveate::{Error, Result, files};
use rayon::prelude::*;
use serde_json::json;

use super::{digits, parse_digits};
use crate::cmd::track::blueprint;
use crate::terminal;

/// Points along a side of the surfaces.
const POINTS: usize = 33;

/// Where it learned to look at each digit: reward surface, best gazes of several runs, and what is seen there.
///
/// One video of each digit, followed by several trackers that differ in their randomness alone. About a minute for 100 runs.
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
struct Learned {
    heat: Heat,
    best: Gaze,
}

pub fn run(args: Args) -> Result<()> {
    let blueprint = blueprint(&args.config)?;
    let (all, from) = digits(args.data.as_deref())?;
    std::fs::create_dir_all(&args.out).map_err(Error::io(&args.out, "cannot create the folder"))?;
    let video = |&digit: &u8| {
        let (seed, frames, noise) = (args.seed, args.frames as usize, args.noise);
        Occlusion { digit, seed, frames, noise, ..Occlusion::default() }.video(&all)
    };
    let videos = args.digits.iter().map(video).collect::<Result<Vec<_>>>()?;
    terminal::catch_interrupts();
    let bar = terminal::progress(Some(videos.len() * args.runs as usize), "surfaces");
    let jobs: Vec<_> = videos.iter().flat_map(|video| (0..args.runs).map(move |run| (video, run))).collect();
    let learned: Vec<Option<Learned>> = jobs
        .par_iter()
        .map(|(video, run)| {
            if terminal::stopping() {
                return Ok(None);
            }
            let learned = learn(&blueprint, video, args.seed.wrapping_add(*run))?;
            bar.inc(1);
            Ok(Some(learned))
        })
        .collect::<Result<_>>()?;
    bar.finish_and_clear();
    let Some(learned) = learned.into_iter().collect::<Option<Vec<_>>>() else {
        println!("stopped; nothing is written before all runs are done");
        std::process::exit(130);
    };
    write(&args, &blueprint, &videos, &learned, &from)
}

fn learn(blueprint: &Blueprint, video: &OcclusionVideo, seed: u64) -> Result<Learned> {
    let mut tracker = blueprint.tracker(seed, u64::from(video.label()))?;
    for (index, truth) in video.truth().iter().enumerate() {
        let frame = Frame { index, time: index as f64 / 30.0, image: video.render(index) };
        match index {
            0 => tracker.start(&frame, *truth)?,
            _ => drop(tracker.step(Scene { frame: &frame, detections: &[] })),
        }
    }
    match tracker.parts().policy.portrait() {
        Portrait::Surface(surface) => {
            let best = surface.best().ok_or_else(|| Error::Config("the video is shorter than the warm-up".into()))?;
            Ok(Learned { heat: Heat::of(surface, POINTS), best })
        }
        _ => Err(Error::Config(
            "surfaces are learned by the policy gp-ucb, alone or beside an anchor; this configuration has another"
                .into(),
        )),
    }
}

fn write(args: &Args, blueprint: &Blueprint, videos: &[OcclusionVideo], learned: &[Learned], from: &str) -> Result<()> {
    let runs = args.runs as usize;
    let first: Vec<_> = videos.iter().map(|video| video.render(0)).collect();
    let templates: Vec<_> =
        videos.iter().zip(&first).map(|(video, image)| Crop::around(image, &video.truth()[0]).closer(1.2)).collect();
    let heats: Vec<_> = learned
        .chunks(runs)
        .map(|runs| Heat::average(&runs.iter().map(|run| run.heat.clone()).collect::<Vec<_>>()))
        .collect();
    let bests: Vec<Vec<Gaze>> = learned.chunks(runs).map(|runs| runs.iter().map(|run| run.best).collect()).collect();
    let retina = blueprint.retina();
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
                    .filter_map(|&gaze| seen(&first[i], &videos[i].truth()[0], &*retina, gaze))
                    .collect::<Vec<_>>(),
            ),
        })
        .collect();
    let title = format!("Where it learned to look: {runs} runs on a video of each digit ({from})");
    files::write(args.out.join("surfaces.png"), &encode_png(banner(&title, &columns).image()))?;
    let rows: Vec<_> = (0..videos.len())
        .map(|i| {
            let best: Vec<_> = bests[i].iter().map(|gaze| [gaze.u, gaze.v]).collect();
            json!({ "digit": videos[i].label(), "best": best, "mean": heats[i].as_ref().map(|heat| &heat.mean) })
        })
        .collect();
    let all = json!({ "digits_from": from, "seed": args.seed, "runs": runs, "points": POINTS, "surfaces": rows });
    let all = serde_json::to_string_pretty(&all).map_err(|e| Error::Invalid(e.to_string()))?;
    files::write(args.out.join("surfaces.json"), all.as_bytes())?;
    println!("{}: surfaces.png, surfaces.json", Path::new(&args.out).display());
    Ok(())
}
