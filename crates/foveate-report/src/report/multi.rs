//! report.html of many targets: a replay, a film strip, the tracks over time as bars, a table with the template of each.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Serialize;
use serde_json::json;

use super::html::{self, Template, base64, bytes_of, escape, picture};
use super::kept::{Kept, MOST_KEYS};
use crate::draw::CORNERS;
use crate::multi::{MultiAnnotator, colour, is_occluded_or_lost, name};
use crate::pictures::within;
use crate::template::Crop;
use crate::{Observer, RunInfo};
use foveate_base::Result;
use foveate_base::sink::Sink;
use foveate_base::text::counted;
use foveate_core::Seen;
use foveate_core::geometry::Gaze;
use foveate_core::multi::Phase;
use foveate_video::{Frame, encode_jpeg};

mod bars;

/// Maximum number of pictures of the film strip.
const STRIP: usize = 12;
/// Longer side of a picture of the strip, pixels.
const STRIP_SIDE: usize = 640;
/// Maximum number of targets with a bar and a row of the table; the longest tracks come first.
const MOST_TRACKS: usize = 300;

/// report.html of many targets. It collects the data during the run, and writes the page at the end.
pub struct MultiReport {
    info: RunInfo,
    file: Sink,
    finished: bool,
    keys: Kept<Key>,
    strip: Kept<Still>,
    annotator: MultiAnnotator,
    tracks: BTreeMap<u64, Track>,
    frames: usize,
    last: usize,
    size: (usize, usize),
}

/// A frame of the replay; frames count from 1.
#[derive(Serialize)]
struct Key {
    frame: usize,
    jpeg: String,
    targets: Vec<Drawn>,
}

/// A target as the replay draws it.
#[derive(Serialize)]
struct Drawn {
    name: String,
    colour: String,
    /// Whether only the corners of its box are drawn.
    corners: bool,
    /// x and y of the four corners, then of the gaze.
    at: Vec<serde_json::Value>,
}

/// A picture of the strip; frames count from 1.
struct Still {
    frame: usize,
    jpeg: String,
}

/// One target over time; frames count from 0.
struct Track {
    /// Phase, first and last frame. Initiation and re-identification are single moments: their span is a tracked one.
    spans: Vec<(Phase, usize, usize)>,
    /// The target in its first frame, as a JPEG in base64.
    template: String,
    class: Option<(usize, f64)>,
    /// Minimum and maximum size relative to the first frame.
    scale: (f64, f64),
    reidentified: usize,
}

impl MultiReport {
    /// Starts the file.
    ///
    /// # Errors
    /// Its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>, info: RunInfo) -> Result<Self> {
        Ok(Self {
            info,
            file: Sink::create(path)?,
            finished: false,
            keys: Kept::new(MOST_KEYS),
            strip: Kept::new(STRIP),
            annotator: MultiAnnotator::default(),
            tracks: BTreeMap::new(),
            frames: 0,
            last: 0,
            size: (1, 1),
        })
    }

    fn follow(&mut self, frame: &Frame, target: &Seen<'_>) {
        let (at, scale) = (frame.index, target.state.log_scale.exp());
        let track = self.tracks.entry(target.id).or_insert_with(|| Track {
            spans: vec![],
            template: Template::new(&Crop::around(&frame.image, &target.bbox).closer(1.1)).jpeg,
            class: None,
            scale: (scale, scale),
            reidentified: 0,
        });
        let again = target.phase == Phase::ReIdentified;
        track.class = target.class.or(track.class);
        track.scale = (track.scale.0.min(scale), track.scale.1.max(scale));
        track.reidentified += usize::from(again);
        let phase = if again || target.phase == Phase::Initiated { Phase::Tracked } else { target.phase };
        match track.spans.last_mut() {
            Some((last, _, to)) if *last == phase && *to + 1 == at && !again => *to = at,
            _ => track.spans.push((phase, at, at)),
        }
    }

    /// Returns the shown tracks, by id, and the number of omitted ones.
    fn shown(&self) -> (Vec<(u64, &Track)>, usize) {
        let mut all: Vec<(u64, &Track)> = self.tracks.iter().map(|(id, track)| (*id, track)).collect();
        all.sort_by_key(|(_, track)| std::cmp::Reverse(track.frames()));
        let left_out = all.len().saturating_sub(MOST_TRACKS);
        all.truncate(MOST_TRACKS);
        all.sort_by_key(|(id, _)| *id);
        (all, left_out)
    }

    fn page(&self) -> String {
        let ((tracks, left_out), info) = (self.shown(), &self.info);
        let (seconds, (width, height)) = (info.clock.total().as_secs_f64(), self.size);
        let rate = self.frames as f64 / seconds;
        let speed = if seconds > 0.0 { format!(", {rate:.0} frames a second") } else { String::new() };
        let active = |t: usize| self.tracks.values().filter(|track| track.at(t)).count();
        let most = (0..=self.last).map(active).max().unwrap_or(0);
        let reidentified: usize = self.tracks.values().map(|track| track.reidentified).sum();
        let summary = format!(
            "{} of {width} × {height} px, {}, at most {most} at a time, {reidentified} re-identified{speed}",
            counted(self.frames, "frame"),
            counted(self.tracks.len(), "target")
        );
        let about =
            format!("{} · configuration {} · seed {} · {}", info.reader, info.config_name, info.seed, html::VERSION);
        let more = if left_out > 0 { format!("{left_out} short tracks are left out.") } else { String::new() };
        let keys: Vec<&Key> = self.keys.iter().collect();
        let (size, every, frames) = (self.size, self.keys.every(), self.last + 1);
        let data = json!({ "size": size, "rate": info.rate, "every": every, "frames": frames, "keys": keys });
        let parts = [
            ("source", escape(&info.source)),
            ("summary", escape(&summary)),
            ("about", escape(&about)),
            (
                "warnings",
                info.warnings.all().iter().map(|w| format!("<p class=\"message\">{}</p>\n", escape(w))).collect(),
            ),
            ("strip", self.strip.iter().map(Still::html).collect()),
            ("bars", bars::bars(&tracks, self.last)),
            ("more", more),
            ("rows", tracks.iter().map(|(id, track)| track.row(*id)).collect()),
            ("command", escape(&info.command)),
            ("config", escape(&info.config_text)),
        ];
        html::page(include_str!("multi.html"), &info.source, &data, &[SCRIPT], &parts)
    }
}

const SCRIPT: &str = include_str!("multi.js");

impl Still {
    fn html(&self) -> String {
        let Self { frame, jpeg } = self;
        format!(
            "<figure><img src=\"data:image/jpeg;base64,{jpeg}\" alt=\"Frame {frame}\"><figcaption>frame {frame}</figcaption></figure>"
        )
    }
}

impl Track {
    fn at(&self, frame: usize) -> bool {
        self.spans.iter().any(|(_, from, to)| (*from..=*to).contains(&frame))
    }
    fn frames(&self) -> usize {
        self.spans.iter().map(|(_, from, to)| to + 1 - from).sum()
    }
    fn in_phase(&self, phase: Phase) -> usize {
        self.spans.iter().filter(|span| span.0 == phase).map(|(_, from, to)| to + 1 - from).sum()
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
            self.frames().to_string(),
            self.in_phase(Phase::Occluded).to_string(),
            self.in_phase(Phase::Lost).to_string(),
            self.reidentified.to_string(),
            format!("{:.2} to {:.2}", self.scale.0, self.scale.1),
        ];
        format!("<tr>{}</tr>\n", cells.map(|text| format!("<td>{text}</td>")).concat())
    }
}

impl Drawn {
    fn new(target: &Seen<'_>) -> Self {
        let f = target.state.fixate(Gaze::CENTRE, target.extent);
        let gaze = target.state.fixate(target.gaze, target.extent);
        let corners = CORNERS.into_iter().flat_map(|(u, v)| [f.x + u * f.ux + v * f.vx, f.y + u * f.uy + v * f.vy]);
        let [r, g, b] = colour(target.id);
        Self {
            name: name(target),
            colour: format!("rgb({r} {g} {b})"),
            corners: is_occluded_or_lost(target.phase),
            at: corners.chain([gaze.x, gaze.y]).map(html::short).collect(),
        }
    }
}

impl Observer for MultiReport {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        let number = frame.index + 1;
        self.size = (frame.image.width(), frame.image.height());
        targets.iter().for_each(|target| self.follow(frame, target));
        if self.strip.wants(self.frames) {
            let drawn = self.annotator.annotate(frame, targets);
            let jpeg = base64(&encode_jpeg(&within(&drawn, STRIP_SIDE), 80));
            self.strip.push(self.frames, bytes_of(&jpeg), Still { frame: number, jpeg });
        } else {
            self.annotator.skip(targets);
        }
        if self.keys.wants(self.frames) {
            let (jpeg, targets) = (picture(&frame.image), targets.iter().map(Drawn::new).collect());
            self.keys.push(self.frames, bytes_of(&jpeg), Key { frame: number, jpeg, targets });
        }
        self.frames += 1;
        self.last = frame.index;
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        if !std::mem::replace(&mut self.finished, true) {
            let page = self.page();
            self.file.write(page.as_bytes())?;
        }
        self.file.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::multi::tests::{frame, seen};
    use crate::report::html::words_after;

    #[test]
    fn the_page_tells_each_track() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("report.html");
        let info = RunInfo { source: "<b>.mp4".into(), ..RunInfo::default() };
        let mut report = MultiReport::create(&path, info).expect("a writable folder");
        for t in 0..40 {
            let phase = |t: usize| match t {
                0 => Phase::Initiated,
                10..15 => Phase::Occluded,
                20..26 => Phase::Lost,
                _ => Phase::Tracked,
            };
            let mut targets = vec![seen(1, 30.0, phase(t))];
            if !(15..30).contains(&t) {
                targets.push(seen(2, 80.0, if t == 30 { Phase::ReIdentified } else { Phase::Tracked }));
            }
            report.observe(&frame(t), &targets).expect("kept");
        }
        assert!(!path.exists());
        report.finish().expect("written");
        let page = std::fs::read_to_string(&path).expect("a page");
        for said in [
            "&lt;b&gt;.mp4",
            "40 frames of 120 × 60 px, 2 targets, at most 2 at a time, 1 re-identified",
            "<td>1</td><td>40</td><td>40</td><td>5</td><td>6</td><td>0</td>",
            "<td>1</td><td>40</td><td>25</td><td>0</td><td>0</td><td>1</td>",
            "class=\"again\"",
            "7 (98 %)",
        ] {
            assert!(page.contains(said), "{said}");
        }
        assert!(!page.contains("<b>.mp4") && !page.contains("{{"));
        let figures = page.matches("<figcaption>frame").count();
        assert!((STRIP / 2..=STRIP).contains(&figures), "{figures} pictures");
    }

    /// The script reads only names that the page has: the test finds a name that is changed on one side alone.
    #[test]
    fn the_script_reads_what_is_written() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let info = RunInfo::default();
        let mut report = MultiReport::create(dir.path().join("report.html"), info).expect("a writable folder");
        report.observe(&frame(0), &[seen(1, 30.0, Phase::Initiated)]).expect("kept");
        let page = report.page();
        let data = page.split("id=\"data\">").nth(1).and_then(|rest| rest.split("</script>").next()).expect("data");
        let data: serde_json::Value = serde_json::from_str(data).expect("JSON");
        let (key, target) = (&data["keys"][0], &data["keys"][0]["targets"][0]);
        for (prefix, known) in [("data.", &data), ("key.", key), ("target.", target)] {
            let words = words_after(SCRIPT, prefix);
            assert!(words.len() >= 3, "{prefix}");
            for word in words {
                assert!(known.get(word).is_some(), "the script reads {prefix}{word}, which is not written");
            }
        }
    }
}
