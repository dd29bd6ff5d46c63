//! The target's first box: reads it and checks it against the video before tracking starts.

use std::path::{Path, PathBuf};

use foveate::geometry::BBox;
use foveate::report::run::{Given, check_box};
use foveate::scene::motion;
use foveate::text::{counted, visible};
use foveate::video::{SourceInfo, TileFolder, annotation};
use foveate::{Error, Result};

use super::source::{SourceArgs, is_endless};

/// The source of the first box.
#[derive(Clone, Copy)]
pub(crate) enum Init {
    /// The given box.
    Given(BBox),
    /// The moving object, in its own bounding box or in one of a given size.
    Motion(Option<(f64, f64)>),
}

pub(crate) fn parse_init(text: &str) -> std::result::Result<Init, String> {
    let Some(size) = text.strip_prefix("motion") else { return parse_box(text).map(Init::Given) };
    let sides = size.strip_prefix(':').and_then(|s| s.split_once(','));
    let sides = sides.and_then(|(w, h)| Some((w.trim().parse().ok()?, h.trim().parse().ok()?)));
    match sides {
        None if size.is_empty() => Ok(Init::Motion(None)),
        Some((w, h)) if (1.0..1e5).contains(&w) && (1.0..1e5).contains(&h) => Ok(Init::Motion(Some((w, h)))),
        _ => Err(format!("expected motion, or motion:w,h such as motion:28,28, got \"{text}\"")),
    }
}

/// Parses `x,y,w,h` counted from 1 into a box counted from 0.
pub(crate) fn parse_box(text: &str) -> std::result::Result<BBox, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|n| n.trim().parse())
        .collect::<std::result::Result<_, _>>()
        .map_err(|_| format!("expected four numbers x,y,w,h such as 120,80,40,60, got \"{text}\""))?;
    match numbers[..] {
        [x, y, w, h] if numbers.iter().all(|n| n.is_finite()) => Ok(BBox::counted_from_1(x, y, w, h)),
        _ => Err(format!("expected four finite numbers x,y,w,h such as 120,80,40,60, got \"{text}\"")),
    }
}

pub(crate) fn parse_again(text: &str) -> std::result::Result<(usize, BBox), String> {
    let (frame, bbox) = text.split_once(':').ok_or_else(|| format!("expected FRAME:x,y,w,h, got \"{text}\""))?;
    let frame = frame.parse().ok().filter(|f| *f > 1);
    Ok((frame.ok_or_else(|| format!("expected a frame number from 2 on, got \"{text}\""))?, parse_box(bbox)?))
}

/// Returns the file beside a source that holds its first box: groundtruth_rect.txt in a folder, VIDEO.txt beside VIDEO.mp4.
pub(crate) fn truth_file(source: &Path) -> Option<PathBuf> {
    let truth = if source.is_file() { source.with_extension("txt") } else { source.join("groundtruth_rect.txt") };
    (truth.is_file() && truth != source).then_some(truth)
}

/// Returns the given box, that of the moving object, or the first line of groundtruth_rect.txt or of VIDEO.txt beside VIDEO.mp4.
pub(crate) fn first_box(source: &Path, init: Option<Init>, input: &SourceArgs) -> Result<BBox> {
    match init {
        Some(Init::Given(bbox)) => return Ok(bbox),
        Some(Init::Motion(size)) => return moving(source, size, input),
        None => {}
    }
    let first = input.selection().from;
    let unknown = || {
        let todo = "give --init x,y,w,h (left, top, width, height in pixels, counted from 1)";
        let draw = match is_endless(source) || TileFolder::is_at(source) {
            true => String::new(),
            false => format!("draw one with `foveate pick {}`, or ", visible(&source.to_string_lossy())),
        };
        Error::malformed(source, format!("no box to start from; {draw}{todo}"))
    };
    let truth = truth_file(source).ok_or_else(unknown)?;
    let none = || Error::malformed(&truth, format!("its line {} has no box; give --init x,y,w,h", first + 1));
    let bbox = annotation::read_truth(&truth)?.get(first).copied().flatten().ok_or_else(none)?;
    Ok(input.scaled(&bbox))
}

/// Returns the box of the object that moves between the first two frames.
fn moving(source: &Path, size: Option<(f64, f64)>, input: &SourceArgs) -> Result<BBox> {
    if TileFolder::is_at(source) {
        return Err(Error::malformed(source, "--init motion needs whole pictures, not tiles; give --init x,y,w,h"));
    }
    if is_endless(source) {
        return Err(Error::malformed(source, "--init motion needs a file, which is read twice; give --init x,y,w,h"));
    }
    let mut frames = input.open(source)?.source.take(2);
    let pair = (frames.next().transpose()?, frames.next().transpose()?);
    let (Some(a), Some(b)) = pair else {
        return Err(Error::malformed(source, "--init motion needs two frames; give --init x,y,w,h"));
    };
    let found = motion::first_box(&a.image, &b.image, size);
    let problem = "nothing moves between the first two frames; give --init x,y,w,h";
    found.ok_or_else(|| Error::malformed(source, problem))
}

/// Returns the ground truth, if the source has one, for comparison in the report; the tracker never uses it.
pub(crate) fn known_truth(source: &Path) -> Vec<Option<BBox>> {
    annotation::read_truth(source.join("groundtruth_rect.txt")).unwrap_or_default()
}

/// The range of tracked frames, counted from 0. Refuses frames that the video does not have, if its length is known.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frames {
    /// The first frame.
    pub from: usize,
    /// The last frame; a very large number if the run continues to the end.
    pub until: usize,
    /// The exact number of frames of the video, if known.
    count: Option<usize>,
}

impl Frames {
    /// Creates the range from frame `from` (counted from 0) until frame `until` (counted from 1). `start` gives the reason for the first
    /// frame in errors, as in "the saved state continues".
    pub(crate) fn new(from: usize, start: &str, until: Option<u64>, info: &SourceInfo) -> Result<Self> {
        let until = until.map_or(usize::MAX, |until| usize::try_from(until).unwrap_or(usize::MAX) - 1);
        let count = info.exact_frames();
        if let Some(n) = count.filter(|n| until != usize::MAX && until >= *n) {
            return Err(Error::Invalid(format!(
                "--until {}: the video has {}; give at most that, or leave it out",
                until + 1,
                counted(n, "frame")
            )));
        }
        if let Some(n) = count.filter(|n| from >= *n) {
            return Err(Error::Invalid(format!(
                "{start} at frame {}, the video has {}: nothing is left to track",
                from + 1,
                counted(n, "frame")
            )));
        }
        if until < from {
            return Err(Error::Invalid(format!(
                "--until {}: {start} at frame {}; give at least that",
                until + 1,
                from + 1
            )));
        }
        Ok(Self { from, until, count })
    }

    /// Returns the exact or estimated number of frames; `None` if it is unknown.
    pub(crate) fn total(&self, info: &SourceInfo) -> Option<usize> {
        let end = self.until.saturating_add(1);
        info.frames.map(|n| n.min(end)).or((end < usize::MAX).then_some(end)).map(|end| end.saturating_sub(self.from))
    }

    /// Refuses a frame (counted from 0) that is not tracked; `what` describes its purpose in the error.
    pub(crate) fn check(&self, what: &str, frame: usize) -> Result<()> {
        let last = self.count.map_or(self.until, |n| self.until.min(n - 1));
        if (self.from..=last).contains(&frame) {
            return Ok(());
        }
        let until = if last == usize::MAX { "on".to_owned() } else { format!("to {}", last + 1) };
        let from = self.from + 1;
        Err(Error::Invalid(format!("{what}: frames {from} {until} are tracked; give one of these, counted from 1")))
    }
}

/// Checks the boxes of later restarts, counted from 0: each must touch the picture, and have its own tracked frame.
pub(crate) fn check_again(again: &[(usize, BBox)], frames: Frames, info: &SourceInfo) -> Result<Vec<Given>> {
    let mut from_0: Vec<Given> = vec![];
    for (frame, bbox) in again {
        let what = format!("--reinit {frame}");
        frames.check(&what, frame - 1)?;
        check_box(&format!("the box of {what}"), bbox, info)?;
        if from_0.iter().any(|given| given.frame + 1 == *frame) {
            return Err(Error::Invalid(format!("{what}: this frame is given two boxes; give one")));
        }
        from_0.push(Given { frame: frame - 1, id: None, bbox: *bbox });
    }
    Ok(from_0)
}
