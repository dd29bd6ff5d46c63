//! Implements `foveate annotate`: boxes of all frames from those of a few, and a list of the frames to check first.

mod check;
mod join;
mod page;
mod passes;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use foveate::config::Blueprint;
use foveate::geometry::Size;
use foveate::report::run::check_box;
use foveate::text::counted;
use foveate::video::annotation::ABSENCE;
use foveate::video::mot::TrackBox;
use foveate::video::{Options, SourceInfo, open_with};
use foveate::{BBox, Error, Result, files};
use rayon::prelude::*;

use super::configure::Choice;
use super::convert::{Boxes, Format, KeyFrames};
use super::of_file;
use super::results::{Ended, Results};
use super::track::source::DecoderArgs;
use crate::terminal;
use check::{Check, Span, check_first, needed};
use join::join;
use page::Shown;
use passes::{Stretch, Video, room};

/// Files of the results.
const CHECKS: &str = "check.csv";
const PAGE: &str = "check.html";
/// The frames that `check.csv` lists, and those that the page shows, at most.
const LISTED: usize = 200;
const PICTURES: usize = 24;
/// A box with less expected IoU is left out: no box is better than a wrong one.
const LEAST: f64 = 0.3;
/// The quality up to which corrections are counted: mean expected IoU, and that of the worst box.
const GOOD: [f64; 2] = [0.8, 0.5];

/// Annotate a video: from boxes in a few frames, make the boxes of all frames
///
/// Give boxes in any frames of the video (key frames). Each target is tracked from key frame to key frame, forwards and backwards, and the
/// two tracks are joined; boxes of key frames stay as they are. A corrected or an added key frame changes only the frames up to its
/// neighbours. check.csv and check.html list the frames whose correction is expected to help most. Boxes that are probably wrong are left
/// out.
#[derive(clap::Args)]
#[command(after_help = "Example: foveate annotate video.mp4 --keyframes task.xml --format cvat --out annotated")]
pub(crate) struct Args {
    /// Video file or folder of images
    source: PathBuf,
    /// File of boxes: key frames. Of CVAT and Label Studio, only boxes that a person set count
    #[arg(long, value_name = "FILE")]
    keyframes: PathBuf,
    /// Format of that file
    #[arg(long, value_enum)]
    format: Format,
    /// Format of the result; default: that of the key frames
    #[arg(long, value_enum, value_name = "FORMAT")]
    to: Option<Format>,
    /// Output folder: the boxes, check.csv, check.html, and run.json, which lists the files
    #[arg(long, short, value_name = "DIR", default_value = "annotated")]
    out: PathBuf,
    #[command(flatten)]
    choice: Choice,
    #[command(flatten)]
    decoder: DecoderArgs,
}

/// A target: its id, and its boxes in key frames.
struct Target {
    id: i64,
    keys: KeyFrames,
    stretches: Vec<Stretch>,
}

/// Runs the command.
pub(crate) fn run(args: Args) -> Result<()> {
    let options = args.decoder.options();
    let about = open_with(&args.source, &options)?.info().clone();
    let mut boxes = Boxes::read_of_size(args.format, &args.keyframes, Some(about.size()))?;
    boxes.take_notes().iter().for_each(|lost| note!("foveate: {}: {lost}", args.keyframes.display()));
    check_size(&args, &boxes, about.size())?;
    let (blueprint, seed) = args.choice.blueprint()?;
    if blueprint.config().multi_target.is_some() {
        return Err(Error::Config(format!(
            "{} tracks many targets together; give a configuration of one target",
            args.choice.name()
        )));
    }
    let keys = boxes.key_frames();
    let frames = frames(&args, &options, &about, &keys)?;
    // A target may end in the frame after the last one, which is no frame of the video.
    let after = keys.values().any(|keys| keys.contains_key(&frames));
    if boxes.frames() > frames + usize::from(after) {
        let (stated, frames) = (counted(boxes.frames(), "frame"), counted(frames, "frame"));
        note!("foveate: {}: it is for {stated}, and the video has {frames}", args.keyframes.display());
    }
    let targets = targets(&args.keyframes, keys, frames, &about)?;
    let format = args.to.unwrap_or(args.format);
    if let (true, [_, _, ..]) = (format.is_of_one(), &targets[..]) {
        let ids: Vec<String> = targets.iter().take(20).map(|target| target.id.to_string()).collect();
        let (n, ids) = (targets.len(), ids.join(", "));
        return Err(Error::malformed(
            &args.keyframes,
            format!(
                "it has {n} targets ({ids}), and the format of the result holds one; give --to a format of several, such as mot"
            ),
        ));
    }
    let file = file_name(format);
    let mut files = vec![file, CHECKS, PAGE];
    if format == Format::Got10k {
        files.push(ABSENCE);
    }
    // Absence is read beside GOT-10k's boxes.
    let absence = args.keyframes.with_file_name(ABSENCE);
    let inputs: Vec<&Path> = [&args.source, &args.keyframes]
        .into_iter()
        .chain(Some(&absence).filter(|path| path.is_file()))
        .map(PathBuf::as_path)
        .chain(args.choice.config.as_deref().map(Path::new))
        .collect();
    let results = Results::begin(&args.out, &files, &inputs)?;
    terminal::catch_interrupts();
    let spans = track(&args, &options, &about, (&blueprint, seed), &targets)?;
    let checks = check_first(&spans, LISTED);
    let names = names(&boxes, &targets);
    let needed = needed(&spans, &checks, GOOD[0], GOOD[1]);
    let verdict = verdict(&spans, &checks, needed);
    let tracks = tracks(&spans, &targets, format);
    let left_out = spans.iter().map(|span| span.boxes.len()).sum::<usize>() - tracks.len();
    let first = needed.unwrap_or(checks.len()).min(PICTURES);
    let shown = pictures(&args, &options, &checks[..first], &spans)?;
    let keys: Vec<(usize, usize)> =
        targets.iter().enumerate().flat_map(|(k, target)| target.keys.keys().map(move |frame| (k, *frame))).collect();
    let title = args.source.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let page = page::page(&title, &verdict, &names, &spans, &keys, &shown);
    let written =
        write_results(&args, results.folder(), boxes.with_tracks(tracks, frames, &about)?, &targets, &checks, &page);
    let lost = written.map_err(|error| results.with_final_path(&error))?;
    let paths = results.keep(Ended::Finished, frames, None)?;
    lost.iter().for_each(|lost| note!("foveate: {file}: {lost}"));
    if left_out > 0 {
        note!("foveate: {} left out: their expected IoU is below {LEAST}", counted(left_out, "box"));
    }
    say!("{verdict}");
    paths.iter().for_each(|path| say!("{}", path.display()));
    Ok(())
}

/// Refuses boxes in pixels of pictures that have another size than the video's. Label Studio's are in per cent: notes the other size.
fn check_size(args: &Args, boxes: &Boxes, size: Size) -> Result<()> {
    let Some(stated) = boxes.stated_size().filter(|stated| *stated != size) else { return Ok(()) };
    let problem = format!("it is for pictures of {stated}, and {} has {size}", args.source.display());
    if args.format == Format::LabelStudio {
        note!("foveate: {}: {problem}", args.keyframes.display());
        return Ok(());
    }
    Err(Error::malformed(&args.keyframes, problem + "; give the video for which the boxes were drawn"))
}

/// The number of frames of the video: as its container or folder states it, or else counted.
fn frames(args: &Args, options: &Options, about: &SourceInfo, keys: &BTreeMap<i64, KeyFrames>) -> Result<usize> {
    let frames = match about.exact_frames() {
        Some(frames) => frames,
        None => {
            let mut source = open_with(&args.source, options)?;
            source.try_fold(0, |count, frame| frame.map(|_| count + 1))?
        }
    };
    // A target may end in the frame after the last one.
    let late = |(frame, bbox): &(&usize, &Option<BBox>)| **frame > frames || (**frame == frames && bbox.is_some());
    match keys.values().flatten().filter(late).map(|(frame, _)| *frame).max() {
        Some(last) => Err(Error::malformed(
            &args.keyframes,
            format!("a box is in frame {}, and {} has {}", last + 1, args.source.display(), counted(frames, "frame")),
        )),
        None => Ok(frames),
    }
}

/// Checks the key frames, and cuts the life of each target into stretches between them.
fn targets(path: &Path, keys: BTreeMap<i64, KeyFrames>, frames: usize, about: &SourceInfo) -> Result<Vec<Target>> {
    let mut targets = vec![];
    for (id, mut keys) in keys {
        if id < 0 {
            return Err(Error::malformed(path, "a box has no id (-1); annotate needs tracks, not detections"));
        }
        for (frame, bbox) in &keys {
            if let Some(bbox) = bbox {
                check_box(&format!("the box of target {id} in frame {}", frame + 1), bbox, about)
                    .map_err(of_file(path))?;
            }
        }
        keys.retain(|frame, _| *frame < frames);
        let stretches = stretches(&keys, frames);
        if !stretches.is_empty() {
            targets.push(Target { id, keys, stretches });
        }
    }
    if targets.is_empty() {
        return Err(Error::malformed(path, "it has no box that a person set; expected at least one key frame"));
    }
    Ok(targets)
}

/// The stretches between key frames, before the first and after the last; none while the target is out of the picture.
fn stretches(keys: &KeyFrames, frames: usize) -> Vec<Stretch> {
    let mut stretches = vec![];
    let mut open: Option<(usize, Option<BBox>)> = Some((0, None));
    for (&frame, &bbox) in keys {
        match (open, bbox) {
            // The same frame ends one stretch and begins the next.
            (Some((from, first)), Some(_)) if frame > from => {
                stretches.push(Stretch { from, to: frame, first, last: bbox });
            }
            (Some((from, first @ Some(_))), None) if frame > from => {
                stretches.push(Stretch { from, to: frame - 1, first, last: None });
            }
            _ => {}
        }
        open = bbox.map(|bbox| (frame, Some(bbox)));
    }
    if let Some((from, first @ Some(_))) = open {
        stretches.push(Stretch { from, to: frames - 1, first, last: None });
    }
    stretches
}

/// Tracks and joins; one span per stretch, without the key frame that the next stretch begins with.
fn track(
    args: &Args,
    options: &Options,
    about: &SourceInfo,
    (blueprint, seed): (&Blueprint, u64),
    targets: &[Target],
) -> Result<Vec<Span>> {
    let all = || targets.iter().flat_map(|target| &target.stretches);
    let steps = all().map(|s| (s.to - s.from) * (usize::from(s.first.is_some()) + usize::from(s.last.is_some()))).sum();
    let bar = terminal::progress(Some(steps), "annotating");
    let video = Video {
        path: &args.source,
        options: options.clone(),
        blueprint,
        seed,
        room: room(about.width, about.height, targets.len().min(rayon::current_num_threads())),
        progress: &|| bar.inc(1),
    };
    let passes: Vec<_> = targets
        .par_iter()
        .map(|target| video.passes(&target.stretches))
        .collect::<Result<_>>()
        .map_err(of_file(&args.source))?;
    bar.finish_and_clear();
    let mut spans = vec![];
    for (k, (target, passes)) in targets.iter().zip(passes).enumerate() {
        for (i, (stretch, passes)) in target.stretches.iter().zip(&passes).enumerate() {
            let mut boxes = join(stretch, passes);
            let next = target.stretches.get(i + 1);
            if next.is_some_and(|next| next.from == stretch.to) {
                boxes.pop();
            }
            spans.push(Span { target: k, from: stretch.from, boxes });
        }
    }
    Ok(spans)
}

/// The boxes that are probably right; those of key frames unchanged, others to a thousandth of a pixel.
fn tracks(spans: &[Span], targets: &[Target], format: Format) -> Vec<TrackBox> {
    let rounded = |value: f64| (value * 1e3).round() / 1e3;
    let mut tracks = vec![];
    for span in spans {
        let target = &targets[span.target];
        for (i, joined) in span.boxes.iter().enumerate().filter(|(_, joined)| joined.iou >= LEAST) {
            let (frame, BBox { x, y, w, h }) = (span.from + i, joined.bbox);
            let bbox = match target.keys.get(&frame) {
                Some(_) => joined.bbox,
                None => BBox::new(rounded(x), rounded(y), rounded(w), rounded(h)),
            };
            let confidence = if format.has_confidence() { rounded(joined.iou) } else { 1.0 };
            tracks.push(TrackBox { frame, id: target.id, bbox, confidence });
        }
    }
    tracks
}

fn verdict(spans: &[Span], checks: &[Check], needed: Option<usize>) -> String {
    let ious: Vec<f64> = spans.iter().flat_map(|span| &span.boxes).map(|joined| joined.iou).collect();
    let mean = ious.iter().sum::<f64>() / ious.len().max(1) as f64;
    let weak = ious.iter().filter(|iou| **iou < GOOD[1]).count();
    let after = match needed {
        Some(0) => "No correction is needed for a mean of 0.8 with no box below 0.5.".into(),
        Some(n) => {
            let first = if n == 1 { "correction".into() } else { counted(n, "correction") };
            format!("After the first {first} of the list a mean of 0.8 is expected, and no box below 0.5.")
        }
        None => {
            format!("After the {} of the list a box below 0.5 is still expected.", counted(checks.len(), "correction"))
        }
    };
    format!("Expected mean IoU {mean:.3}, {} below 0.5. {after}", counted(weak, "box"))
}

fn names(boxes: &Boxes, targets: &[Target]) -> Vec<String> {
    targets
        .iter()
        .map(|target| {
            boxes
                .known_label(target.id)
                .map_or_else(|| format!("target {}", target.id), |label| format!("{label} {}", target.id))
        })
        .collect()
}

/// Reads the frames to show once more.
fn pictures(args: &Args, options: &Options, shown: &[Check], spans: &[Span]) -> Result<Vec<Shown>> {
    let Some(last) = shown.iter().map(|check| check.frame).max() else { return Ok(vec![]) };
    let mut pictures: Vec<Option<Vec<u8>>> = vec![None; shown.len()];
    for frame in open_with(&args.source, options)?.take(last + 1) {
        let frame = frame?;
        if terminal::stopping() {
            return Err(Error::Stopped);
        }
        for (check, picture) in shown.iter().zip(&mut pictures).filter(|(check, _)| check.frame == frame.index) {
            let of = |span: &&Span| {
                span.target == check.target && (span.from..span.from + span.boxes.len()).contains(&check.frame)
            };
            let span = spans.iter().find(of).expect("a frame to check lies in a span");
            *picture = Some(page::part(&frame.image, &span.boxes[check.frame - span.from].bbox));
        }
    }
    Ok(shown.iter().zip(pictures).filter_map(|(check, jpeg)| Some(Shown { check: *check, jpeg: jpeg? })).collect())
}

fn write_results(
    args: &Args,
    folder: &Path,
    boxes: Boxes,
    targets: &[Target],
    checks: &[Check],
    page: &str,
) -> Result<Vec<String>> {
    let format = args.to.unwrap_or(args.format);
    let lost = boxes.write(format, &folder.join(file_name(format)))?;
    let mut table = String::from("rank,frame,id,expected_iou,gain,mean_after,least_after\n");
    for (rank, c) in checks.iter().enumerate() {
        let (rank, frame, id) = (rank + 1, c.frame + 1, targets[c.target].id);
        let _ = writeln!(table, "{rank},{frame},{id},{:.4},{:.4},{:.4},{:.4}", c.iou, c.gain, c.mean, c.least);
    }
    files::write(folder.join(CHECKS), table.as_bytes())?;
    files::write(folder.join(PAGE), page.as_bytes())?;
    Ok(lost)
}

/// The name of the result in the output folder.
fn file_name(format: Format) -> &'static str {
    match format {
        Format::Cvat => "boxes.xml",
        Format::Coco | Format::LabelStudio => "boxes.json",
        Format::Viame | Format::Trackmate | Format::Napari => "boxes.csv",
        Format::Otb | Format::Vot | Format::Got10k | Format::Mot => "boxes.txt",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(of: &[(usize, bool)]) -> KeyFrames {
        of.iter().map(|(frame, inside)| (*frame, inside.then(|| BBox::new(*frame as f64, 0.0, 9.0, 9.0)))).collect()
    }

    /// First and last frame, and which of them are key frames.
    fn cut(of: &[(usize, bool)]) -> Vec<(usize, usize, bool, bool)> {
        stretches(&keys(of), 100).iter().map(|s| (s.from, s.to, s.first.is_some(), s.last.is_some())).collect()
    }

    #[test]
    fn stretches_lie_between_key_frames() {
        assert_eq!(cut(&[(0, true), (10, true)]), [(0, 10, true, true), (10, 99, true, false)][..]);
        assert_eq!(cut(&[(5, true)]), [(0, 5, false, true), (5, 99, true, false)]);
        assert_eq!(cut(&[(99, true)]), [(0, 99, false, true), (99, 99, true, false)]);
    }

    #[test]
    fn nothing_is_tracked_while_the_target_is_out_of_the_picture() {
        let gone = [(0, true), (10, false), (20, true), (30, false)];
        assert_eq!(cut(&gone), [(0, 9, true, false), (20, 29, true, false)]);
        assert_eq!(cut(&[(0, false), (20, true)]), [(20, 99, true, false)]);
        assert_eq!(cut(&[(0, false)]), []);
    }
}
