//! The tracks of a page: as bars over time, as a table with the template of each, and as the replay draws them.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Value, json};

use super::bars::{Span, bars};
use super::html::{self, Template};
use crate::annotate::place;
use crate::draw::CORNERS;
use crate::multi::{colour, is_occluded_or_lost, name, turned_box};
use crate::template::Crop;
use foveate_core::Seen;
use foveate_core::multi::Phase;
use foveate_video::Frame;

/// Maximum number of targets with a bar and a row of the table; the longest tracks come first.
const MOST_TRACKS: usize = 300;

/// All targets of a run, by id.
#[derive(Default)]
pub(super) struct Tracks(BTreeMap<u64, Track>);

/// One target over time; frames count from 0.
pub(super) struct Track {
    /// Phase, first and last frame. Initiation is a single moment: its span is a tracked one. So is that of a re-identification, which
    /// keeps its name.
    spans: Vec<Span>,
    /// Number of frames, of those occluded, and of those lost.
    frames: [usize; 3],
    /// The target in its first frame, as a JPEG in base64.
    template: String,
    class: Option<(usize, f64)>,
    /// Size in its first frame, pixels.
    first: f64,
    /// Minimum and maximum size relative to that.
    scale: (f64, f64),
    reidentified: usize,
}

/// A target as the replay draws it.
#[derive(Serialize)]
pub(super) struct Drawn {
    id: u64,
    name: String,
    colour: String,
    /// Whether only the corners of its box are drawn.
    corners: bool,
    /// x and y of the four corners, then of the gaze.
    at: Vec<Value>,
}

impl Tracks {
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    /// Adds a target of a frame; `before` is the index of the frame that was read before it: a live run drops those between.
    pub(super) fn add(&mut self, frame: &Frame, before: usize, target: &Seen<'_>) {
        let (at, size) = (frame.index, (target.bbox.w * target.bbox.h).sqrt());
        let track = self.0.entry(target.id).or_insert_with(|| Track {
            spans: vec![],
            frames: [0; 3],
            template: Template::new(&Crop::around(&frame.image, &target.bbox).closer(1.1)).jpeg,
            class: None,
            first: size,
            scale: (1.0, 1.0),
            reidentified: 0,
        });
        let scale = size / track.first;
        let again = target.phase == Phase::ReIdentified;
        track.class = target.class.or(track.class);
        track.scale = (track.scale.0.min(scale), track.scale.1.max(scale));
        track.reidentified += usize::from(again);
        let counted = [true, target.phase == Phase::Occluded, target.phase == Phase::Lost];
        track.frames.iter_mut().zip(counted).for_each(|(n, counted)| *n += usize::from(counted));
        let phase = if target.phase == Phase::Initiated { Phase::Tracked } else { target.phase };
        let goes_on = |last| last == phase || (last, phase) == (Phase::ReIdentified, Phase::Tracked);
        match track.spans.last_mut() {
            Some((last, _, to)) if goes_on(*last) && *to == before && !again => *to = at,
            _ => track.spans.push((phase, at, at)),
        }
    }

    /// Returns the numbers of targets, of the most active at a time, and of re-identifications.
    pub(super) fn summary(&self, last: usize) -> Value {
        let active = |t: usize| self.0.values().filter(|track| track.at(t)).count();
        let most = (0..=last).map(active).max().unwrap_or(0);
        let reidentified: usize = self.0.values().map(|track| track.reidentified).sum();
        json!({ "targets": self.0.len(), "most": most, "reidentified": reidentified })
    }

    /// Returns the bars and the table, for frames 0 to `last`.
    pub(super) fn sections(&self, last: usize) -> String {
        let mut all: Vec<(u64, &Track)> = self.0.iter().map(|(id, track)| (*id, track)).collect();
        all.sort_by_key(|(_, track)| std::cmp::Reverse(track.frames[0]));
        let left_out = all.len().saturating_sub(MOST_TRACKS);
        all.truncate(MOST_TRACKS);
        all.sort_by_key(|(id, _)| *id);
        let more = if left_out > 0 { format!("{left_out} short tracks are left out.") } else { String::new() };
        let spans: Vec<(u64, &[Span])> = all.iter().map(|(id, track)| (*id, &*track.spans)).collect();
        let rows = all.iter().map(|(id, track)| track.row(*id)).collect();
        html::fill(include_str!("tracks.html"), &[("more", more), ("bars", bars(&spans, last)), ("rows", rows)])
    }
}

impl Track {
    fn at(&self, frame: usize) -> bool {
        self.spans.iter().any(|(_, from, to)| (*from..=*to).contains(&frame))
    }
    /// Returns the target's row of the table.
    fn row(&self, id: u64) -> String {
        let [r, g, b] = colour(id);
        let (first, last) = (self.spans.first().map_or(0, |span| span.1), self.spans.last().map_or(0, |span| span.2));
        let cells = [
            format!("<i class=\"dot\" style=\"background:rgb({r} {g} {b})\"></i>id {id}"),
            format!("<img src=\"data:image/jpeg;base64,{}\" alt=\"Template of target {id}\">", self.template),
            self.class.map_or("–".into(), |(class, p)| format!("{class} ({:.0} %)", 100.0 * p)),
            (first + 1).to_string(),
            (last + 1).to_string(),
            self.frames[0].to_string(),
            self.frames[1].to_string(),
            self.frames[2].to_string(),
            self.reidentified.to_string(),
            format!("{:.2} to {:.2}", self.scale.0, self.scale.1),
        ];
        format!("<tr>{}</tr>\n", cells.map(|text| format!("<td>{text}</td>")).concat())
    }
}

impl Drawn {
    pub(super) fn new(target: &Seen<'_>) -> Self {
        let f = turned_box(target);
        let gaze = target.state.fixate(target.gaze, target.extent);
        let corners = CORNERS.into_iter().flat_map(|(u, v)| <[f64; 2]>::from(place(&f, u, v)));
        let [r, g, b] = colour(target.id);
        Self {
            id: target.id,
            name: name(target),
            colour: format!("rgb({r} {g} {b})"),
            corners: is_occluded_or_lost(target.phase),
            at: corners.chain([gaze.x, gaze.y]).map(html::short).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::geometry::BBox;
    use foveate_core::scene::Image;

    /// A new template has scale 1, whatever its size.
    #[test]
    fn sizes_are_those_of_boxes() {
        let mut tracks = Tracks::default();
        let frame = Frame { index: 0, time: 0.0, image: Image::grey(64, 48, 0) };
        for side in [10.0, 20.0, 5.0] {
            tracks.add(&frame, 0, &Seen::given([64, 48, 1], &BBox::new(4.0, 6.0, side, side)));
        }
        let track = tracks.0.values().next().expect("one");
        assert_eq!(track.scale, (0.5, 2.0));
    }
}
