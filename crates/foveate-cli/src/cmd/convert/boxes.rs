//! The boxes of a video, and what a format does not hold of them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use foveate::geometry::Size;
use foveate::text::counted;
use foveate::video::SourceInfo;
use foveate::video::mot::TrackBox;
use foveate::{BBox, Error, Result, memory};
use serde::Deserialize;
use serde::de::IgnoredAny;

/// Maximum length of a video in frames; a larger frame number indicates a damaged file.
pub(super) const MOST: usize = 1_000_000;

/// Estimated bytes per box: its entry in a growing list, its visibility flag, and one line of text.
pub(super) const BOX: u64 = 400;

/// Boxes that a person set, by frame (from 0): `None` where the target leaves the picture.
pub(crate) type KeyFrames = BTreeMap<usize, Option<BBox>>;

/// The boxes of a video and the information lost in conversion.
#[derive(Debug, Default, PartialEq)]
pub struct Boxes {
    /// The boxes; ids as in the file, or 1 if the file has none.
    pub(super) tracks: Vec<TrackBox>,
    /// Number of frames of the video, as far as the file states it.
    pub(super) frames: usize,
    /// Labels of the targets, by id, as far as the file has them.
    pub(super) labels: BTreeMap<i64, String>,
    /// The boxes that a person set, by target; empty if the format does not mark them.
    pub(super) keys: BTreeMap<i64, KeyFrames>,
    /// Number of boxes between key frames that the file does not state, by target.
    pub(super) filled: BTreeMap<i64, usize>,
    /// The boxes, by frame and target, of which a part is hidden, as far as the file has it.
    pub(super) occluded: BTreeSet<(usize, i64)>,
    /// Size of the pictures, which Label Studio's format needs.
    pub(super) size: Option<Size>,
    /// Size of the pictures that the file states.
    pub(super) stated: Option<Size>,
    /// Frames per second, if known.
    pub(super) rate: Option<f64>,
    /// Descriptions of the information that the input or output format does not hold.
    pub(super) lost: Vec<String>,
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

    /// Returns the size of the pictures that the file states.
    pub(crate) fn stated_size(&self) -> Option<Size> {
        self.stated
    }

    /// Returns the number of frames of the video, as far as the file states it.
    pub(crate) fn frames(&self) -> usize {
        self.frames
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
    pub(super) fn fill(&mut self, path: &Path, id: i64, shapes: &KeyFrames) -> Result<()> {
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
    pub(super) fn check_ids(&self, format: &str) -> Result<()> {
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
    pub(super) fn label(&mut self, id: i64) -> String {
        const NONE: &str = "the label is \"object\": the format needs one; name yours in the task or in the file";
        self.labels.get(&id).cloned().unwrap_or_else(|| {
            if !self.lost.iter().any(|lost| lost == NONE) {
                self.lost.push(NONE.into());
            }
            "object".into()
        })
    }

    /// Records boxes that the file does not state.
    pub(super) fn lose_filled(&mut self) {
        self.lose(self.filled.values().sum(), "boxes between key frames are interpolated");
    }

    /// Records labels, which the output format does not hold.
    pub(super) fn lose_labels(&mut self) {
        let different = self.labels.values().collect::<BTreeSet<_>>().len();
        self.lose(if different > 1 { different } else { 0 }, "labels are left out");
    }

    /// Sorts the boxes by frame, then by target.
    pub(super) fn put_in_order(&mut self) -> std::result::Result<(), String> {
        let mut seen = BTreeSet::new();
        if let Some(b) = self.tracks.iter().find(|b| b.id >= 0 && !seen.insert((b.frame, b.id))) {
            return Err(twice(b.frame, b.id));
        }
        self.tracks.sort_by_key(|b| (b.frame, b.id));
        Ok(())
    }

    /// Records that `count` boxes lose information.
    pub(super) fn lose(&mut self, count: usize, what: &str) {
        if count > 0 {
            self.lost.push(format!("{count} {what}"));
        }
    }

    /// Returns the target ids in ascending order.
    pub(super) fn ids(&self) -> BTreeSet<i64> {
        self.tracks.iter().map(|b| b.id).collect()
    }

    /// Returns the boxes sorted by target, then by frame.
    pub(super) fn by_target(&self) -> Vec<TrackBox> {
        let mut boxes = self.tracks.clone();
        boxes.sort_by_key(|b| (b.id, b.frame));
        boxes
    }

    /// Records confidences other than 1, which the output format does not hold.
    pub(super) fn lose_confidence(&mut self) {
        let unsure = self.tracks.iter().filter(|b| b.confidence != 1.0).count();
        self.lose(unsure, "confidences other than 1 are left out");
    }
}

/// The problem with two boxes of one target in a frame (from 0).
pub(super) fn twice(frame: usize, id: i64) -> String {
    format!("frame {} has two boxes of the target {id}; expected one", frame + 1)
}

/// A side of a picture in JSON; other values than numbers are ignored.
#[derive(Deserialize, Clone, Copy)]
#[serde(untagged)]
pub(super) enum Side {
    Pixels(f64),
    Other(IgnoredAny),
}

/// Returns the size of a picture whose sides are known.
pub(super) fn size_of(width: Option<Side>, height: Option<Side>) -> Option<Size> {
    let pixels = |side| match side {
        Some(Side::Pixels(pixels)) if pixels >= 1.0 => Some(pixels as usize),
        Some(Side::Pixels(_) | Side::Other(_)) | None => None,
    };
    Some(Size { width: pixels(width)?, height: pixels(height)? })
}

fn between(a: &BBox, b: &BBox, share: f64) -> BBox {
    let mix = |a: f64, b: f64| if share == 0.0 { a } else { a + share * (b - a) };
    BBox::new(mix(a.x, b.x), mix(a.y, b.y), mix(a.w, b.w), mix(a.h, b.h))
}
