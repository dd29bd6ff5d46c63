//! Implements `foveate synth`: makes videos with ground truth.

use std::path::PathBuf;

use clap::{Subcommand, ValueEnum};
use foveate::geometry::{BBox, Size};
use foveate::lab::eval::find_sequences;
use foveate::lab::hide::{Hide, Way};
use foveate::lab::synthetic::{Clutter, Corruption, Drawn, Ink, Multi, NOISE, Occlusion, Synthetic};
use foveate::lab::{Digits, Split};
use foveate::text::counted;
use foveate::video::annotation::format_boxes;
use foveate::video::otb::{write_folder, write_otb};
use foveate::video::{Frame, Mp4Writer};
use foveate::{Error, Result};

use super::videos::of_sequence;

/// Digits drawn of each class if MNIST is not available.
const DRAWN: usize = 20;

/// Make videos with ground truth, as folders in OTB's layout (and MOTChallenge's for many targets).
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    #[command(subcommand)]
    kind: Kind,
}

#[derive(Subcommand, Debug)]
enum Kind {
    /// One moving digit among static ones (the paper's first experiment)
    Clutter(ClutterArgs),
    /// One digit on black that passes behind bars, with noise (the paper's partial-information experiment)
    Partial(PartialArgs),
    /// Several digits that change size, turn and pass over each other (the paper's second experiment)
    Multi(MultiArgs),
    /// A real sequence with an inserted occlusion of the target
    Hide(HideArgs),
}

#[derive(clap::Args, Debug)]
struct HideArgs {
    /// Sequence in OTB layout
    #[arg(long, value_name = "DIR")]
    seq: PathBuf,
    /// Kind of occlusion
    #[arg(long, value_enum)]
    way: WayArg,
    /// Minimum and maximum length of the occlusion, frames
    #[arg(long, value_name = "LEAST,MOST", default_value = "30,90", value_parser = range)]
    hidden: (usize, usize),
    /// Random seed; the same seed gives the same frames
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Output folder in OTB layout; the truth is NaN during the occlusion
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

#[derive(ValueEnum, Clone, Copy, Debug)]
enum WayArg {
    /// The image beside the target is mirrored over it
    Behind,
    /// The camera moves away from the target and back
    Away,
    /// The camera moves away from the target, then to another place
    Elsewhere,
}

/// Options of all scenes.
#[derive(clap::Args, Debug)]
struct Common {
    /// Class of the moving digit
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=9))]
    digit: u8,
    /// Random seed; the same seed gives the same video
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// Output folder: img/0001.png ..., groundtruth_rect.txt (x,y,w,h, 1-based), label.txt, scene.toml
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Length of the video in frames
    #[arg(long, default_value_t = 300)]
    frames: usize,
    /// Folder with MNIST's test files (t10k-*, plain or .gz). If omitted, digits are drawn with pen strokes
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
}

#[derive(clap::Args, Debug)]
struct PartialArgs {
    #[command(flatten)]
    common: Common,
    /// Fraction of pixels with noise, 0 to 1
    #[arg(long, default_value_t = NOISE)]
    noise: f64,
    /// Invert the noisy pixels instead of replacing them with black or white
    #[arg(long)]
    inverted: bool,
    /// Number of bars across the path
    #[arg(long, default_value_t = 2)]
    bars: usize,
}

#[derive(clap::Args, Debug)]
struct ClutterArgs {
    #[command(flatten)]
    common: Common,
    /// Add salt-and-pepper noise to 30 % of the black pixels (half of them stay black), new in every frame
    #[arg(long)]
    noise: bool,
    /// Number of static digits, taken in turn from the nine other classes
    #[arg(long, value_name = "N", default_value_t = 18)]
    distractors: usize,
    /// How a digit covers the pixels below it
    #[arg(long, value_enum, default_value_t = InkArg::Replace)]
    ink: InkArg,
    /// Draw the target at subpixel positions instead of whole pixels
    #[arg(long)]
    subpixel: bool,
}

#[derive(ValueEnum, Clone, Copy, Debug)]
pub enum InkArg {
    /// Ink replaces the pixels below; black is transparent (as in the authors' program)
    Replace,
    /// The brighter pixel stays
    Brighter,
    /// The whole 28 x 28 square replaces the pixels below
    Opaque,
}

impl From<InkArg> for Ink {
    fn from(arg: InkArg) -> Self {
        match arg {
            InkArg::Replace => Self::Replace,
            InkArg::Brighter => Self::Brighter,
            InkArg::Opaque => Self::Opaque,
        }
    }
}

#[derive(clap::Args, Debug)]
struct MultiArgs {
    /// Number of moving digits, 1 to 10000; up to 10 are of different classes
    #[arg(long, value_name = "N", default_value_t = 5)]
    targets: usize,
    /// Minimum and maximum size, in units of 28 px
    #[arg(long, value_name = "LEAST,LARGEST", default_value = "1,3", value_parser = pair)]
    scale: [f64; 2],
    /// Maximum angle from upright, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 90.0)]
    turn: f64,
    /// Minimum number of times that one digit passes over another. Default: 4; 0 for a single digit
    #[arg(long, value_name = "N")]
    crossings: Option<usize>,
    /// Number of static digits in the background
    #[arg(long, value_name = "N", default_value_t = 0)]
    clutter: usize,
    /// Fraction of pixels replaced with black or white, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    noise: f64,
    /// How a digit covers the pixels below it
    #[arg(long, value_enum, default_value_t = InkArg::Replace)]
    ink: InkArg,
    /// Random seed; the same seed gives the same video
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// Length of the video in frames
    #[arg(long, default_value_t = 300)]
    frames: usize,
    /// Output folder: img1/000001.png ..., gt/gt.txt and seqinfo.ini (MOTChallenge), groundtruth_rect.1.txt ... (OTB), truth.csv (scale,
    /// angle, visible fraction), scene.toml
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Also write the video to this file, as H.264 in MP4
    #[arg(long, value_name = "FILE")]
    video: Option<PathBuf>,
    /// Folder with MNIST's test files (t10k-*, plain or .gz). If omitted, digits are drawn with pen strokes
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
}

fn range(text: &str) -> std::result::Result<(usize, usize), String> {
    let parsed = text.split_once(',').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    parsed.filter(|(least, most)| (1..=100_000).contains(least) && (least..=&100_000).contains(&most)).ok_or_else(
        || format!("expected two numbers of frames such as 30,90, the first not above the second, got {text}"),
    )
}

fn pair(text: &str) -> std::result::Result<[f64; 2], String> {
    let wrong = || format!("expected two numbers such as 1,3, got {text}");
    let (low, high) = text.split_once(',').ok_or_else(wrong)?;
    let number = |word: &str| word.trim().parse().map_err(|_| wrong());
    Ok([number(low)?, number(high)?])
}

/// Runs the command.
pub(crate) fn run(args: Args) -> Result<()> {
    match args.kind {
        Kind::Clutter(args) => {
            let Common { digit, seed, frames, .. } = args.common;
            let ink = args.ink.into();
            let noise = if args.noise { NOISE } else { 0.0 };
            let (distractors, subpixel) = (args.distractors, args.subpixel);
            let settings = Clutter { digit, seed, frames, noise, distractors, ink, subpixel, ..Clutter::default() };
            make(&args.common, Synthetic::Clutter(settings))
        }
        Kind::Partial(args) => {
            let Common { digit, seed, frames, .. } = args.common;
            let corruption = if args.inverted { Corruption::Inverted } else { Corruption::Replaced };
            let (noise, bars) = (args.noise, args.bars);
            let settings = Occlusion { digit, seed, frames, noise, bars, corruption, ..Occlusion::default() };
            make(&args.common, Synthetic::Occlusion(settings))
        }
        Kind::Multi(args) => many(&args),
        Kind::Hide(args) => hide(&args),
    }
}

fn many(args: &MultiArgs) -> Result<()> {
    let &MultiArgs { targets, scale, turn, crossings, clutter, noise, seed, frames, .. } = args;
    let ink = args.ink.into();
    let crossings = crossings.unwrap_or(if targets == 1 { 0 } else { Multi::default().crossings });
    let settings = Multi { seed, targets, frames, scale, turn, crossings, clutter, noise, ink, ..Multi::default() };
    let (digits, from) = digits(args.data.as_deref(), args.seed)?;
    let video = settings.video(&digits)?;
    let name = args.out.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let Size { width, height } = video.size();
    let scene = toml::to_string(&settings).map_err(|e| Error::Invalid(e.to_string()))?;
    let mut notes = vec![
        ("gt/gt.txt".to_string(), video.gt_txt()),
        (
            "seqinfo.ini".into(),
            format!(
                "[Sequence]\nname={name}\nimDir=img1\nframeRate=30\nseqLength={}\nimWidth={width}\nimHeight={height}\nimExt=.png\n",
                video.frames()
            ),
        ),
        ("truth.csv".into(), video.truth_csv()),
        ("scene.toml".into(), format!("# {from}\n{scene}")),
    ];
    for (i, mover) in video.movers().iter().enumerate() {
        let boxes: Vec<BBox> = (0..video.frames()).map(|t| mover.bbox(t)).collect();
        notes.push((format!("groundtruth_rect.{}.txt", i + 1), format_boxes(&boxes)));
    }
    let classes: Vec<u8> = video.movers().iter().map(|mover| mover.class).collect();
    let frames = video.frames();
    write_folder(&args.out, "img1", 6, video.clone().source(), frames, &notes)?;
    // After the folder, which may be refused.
    if let Some(path) = &args.video {
        let mut film = Mp4Writer::create(path, width, height, 30.0)?;
        (0..frames).try_for_each(|t| film.push(&video.render(t), t as f64 / 30.0))?;
        film.finish()?;
    }
    say!("{}: {} of digits {classes:?} ({from})", args.out.display(), counted(frames, "frame"));
    Ok(())
}

fn hide(args: &HideArgs) -> Result<()> {
    let way = match args.way {
        WayArg::Behind => Way::Behind,
        WayArg::Away => Way::Away,
        WayArg::Elsewhere => Way::Elsewhere,
    };
    let sequences = find_sequences(std::slice::from_ref(&args.seq))?;
    let [sequence] = &sequences[..] else {
        let problem = format!("it has {}; give one of them", counted(sequences.len(), "sequence"));
        return Err(Error::malformed(&args.seq, problem));
    };
    let video = of_sequence(sequence)?;
    let hide = Hide::choose(way, &video.truth, video.size, args.hidden, args.seed)?;
    let truth: Vec<_> = video.truth.iter().enumerate().map(|(t, b)| hide.truth(t, *b)).collect();
    let frames = video.truth.iter().enumerate().map(|(index, b)| {
        let image = hide.apply(index, &(video.picture)(index)?, *b);
        Ok(Frame { index, time: index as f64 / 30.0, image })
    });
    let settings = toml::to_string(&hide).map_err(|e| Error::Invalid(e.to_string()))?;
    let note = format!("# {}, frames counted from 0\n{settings}", video.name);
    write_otb(&args.out, frames, &truth, &[("hide.toml", note)])?;
    let (from, until) = (hide.from + 1, hide.until);
    let (out, frames) = (args.out.display(), counted(truth.len(), "frame"));
    say!("{out}: {frames}, the target out of sight in frames {from} to {until}");
    Ok(())
}

fn digits(data: Option<&std::path::Path>, seed: u64) -> Result<(Digits, &'static str)> {
    Ok(match data {
        Some(dir) => (Digits::load(dir, Split::Test)?, "MNIST test digits"),
        None => (Digits::drawn(seed, DRAWN), "drawn digits"),
    })
}

fn make(args: &Common, settings: Synthetic) -> Result<()> {
    let (digits, from) = digits(args.data.as_deref(), args.seed)?;
    let video = settings.video(&digits)?;
    let scene = toml::to_string(&settings).map_err(|e| Error::Invalid(e.to_string()))?;
    let notes = [("label.txt", format!("{}\n", video.label())), ("scene.toml", format!("# {from}\n{scene}"))];
    let truth: Vec<_> = video.truth().iter().copied().map(Some).collect();
    let (frames, label) = (truth.len(), video.label());
    write_otb(&args.out, video.source(), &truth, &notes)?;
    say!("{}: {} of digit {label} ({from})", args.out.display(), counted(frames, "frame"));
    Ok(())
}
