//! report.html of many targets: a replay, a film strip, the lives of all targets as bars, a table with what each looked like.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use serde_json::{Value, json};

use super::super::RunInfo;
use super::super::crowd::{CrowdAnnotator, colour};
use super::super::crowd_film::smaller;
use super::super::first::Crop;
use super::super::many::{ManyObserver, Phase, Seen};
use super::super::sink::Sink;
use super::page::{escape, fill, short};
use super::{MOST_BYTES, MOST_KEYS, picture, still, text};
use crate::Result;
use crate::geometry::Gaze;
use crate::scene::{Frame, Image, encode_jpeg};

/// Pictures of the film strip, at most.
const STRIP: usize = 12;
/// Longer side of a picture of the strip, pixels.
const STRIP_SIDE: usize = 640;
/// Targets with a bar and a row of the table; the longest lives go first.
const MOST_LIVES: usize = 300;

/// Keeps what the page needs, and writes it at the end.
pub struct CrowdReport {
    info: RunInfo,
    file: Sink,
    finished: bool,
    keys: Kept<Key>,
    strip: Kept<Picture>,
    annotator: CrowdAnnotator,
    lives: BTreeMap<u64, Life>,
    frames: usize,
    last: usize,
    size: (usize, usize),
}

/// A frame of the replay.
struct Key {
    frame: usize,
    jpeg: String,
    targets: Vec<Value>,
}

/// A picture of the strip.
struct Picture {
    frame: usize,
    jpeg: String,
}

/// Some of the frames, evenly spaced: every `every`-th.
struct Kept<T> {
    all: Vec<(usize, T)>,
    every: usize,
    most: usize,
    bytes: usize,
}

impl<T> Kept<T> {
    fn new(most: usize) -> Self {
        Self { all: vec![], every: 1, most, bytes: 0 }
    }
    fn wants(&self, row: usize) -> bool {
        row.is_multiple_of(self.every)
    }
    /// Every second one goes while there are too many, or too many bytes.
    fn push(&mut self, row: usize, what: T, bytes: usize) {
        self.all.push((row, what));
        self.bytes += bytes;
        while self.all.len() > 2 && (self.all.len() > self.most || self.bytes > MOST_BYTES) {
            self.every *= 2;
            let (every, before) = (self.every, self.all.len());
            self.all.retain(|(row, _)| row.is_multiple_of(every));
            self.bytes = self.bytes * self.all.len() / before;
        }
    }
}

/// One target's life.
struct Life {
    born: usize,
    /// What it fared like, first and last frame.
    spans: Vec<(Phase, usize, usize)>,
    /// A picture of what it looked like when it was born.
    template: String,
    class: Option<(usize, f64)>,
    /// Least and largest size relative to the first.
    scale: (f64, f64),
    found: usize,
}

impl CrowdReport {
    /// Starts the file. Fails where its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>, info: RunInfo) -> Result<Self> {
        Ok(Self {
            info,
            file: Sink::create(path)?,
            finished: false,
            keys: Kept::new(MOST_KEYS),
            strip: Kept::new(STRIP),
            annotator: CrowdAnnotator::default(),
            lives: BTreeMap::new(),
            frames: 0,
            last: 0,
            size: (1, 1),
        })
    }

    fn live(&mut self, frame: &Frame, seen: &Seen) {
        let (at, scale) = (frame.index, seen.state.log_scale.exp());
        let life = self.lives.entry(seen.id).or_insert_with(|| Life {
            born: at,
            spans: vec![],
            template: still(&Crop::around(&frame.image, &seen.bbox).closer(1.1)).jpeg,
            class: None,
            scale: (scale, scale),
            found: 0,
        });
        life.class = seen.class.or(life.class);
        life.scale = (life.scale.0.min(scale), life.scale.1.max(scale));
        life.found += usize::from(seen.phase == Phase::Found);
        // Born and found are moments; what follows them is a span of its own.
        let phase = if matches!(seen.phase, Phase::Born | Phase::Found) { Phase::Followed } else { seen.phase };
        match life.spans.last_mut() {
            Some((last, _, to)) if *last == phase && *to + 1 == at && seen.phase != Phase::Found => *to = at,
            _ => life.spans.push((phase, at, at)),
        }
    }

    /// Those who are shown, by id, and how many are left out.
    fn shown(&self) -> (Vec<(u64, &Life)>, usize) {
        let mut all: Vec<(u64, &Life)> = self.lives.iter().map(|(id, life)| (*id, life)).collect();
        all.sort_by_key(|(_, life)| std::cmp::Reverse(life.frames()));
        let left_out = all.len().saturating_sub(MOST_LIVES);
        all.truncate(MOST_LIVES);
        all.sort_by_key(|(id, _)| *id);
        (all, left_out)
    }

    fn page(&self) -> String {
        let (lives, left_out) = self.shown();
        let seconds = self.info.clock.total().as_secs_f64();
        let speed = if seconds > 0.0 {
            format!(", {:.0} frames a second", self.frames as f64 / seconds)
        } else {
            String::new()
        };
        let most = (0..=self.last).map(|t| self.lives.values().filter(|life| life.at(t)).count()).max().unwrap_or(0);
        let found: usize = self.lives.values().map(|life| life.found).sum();
        let summary = format!(
            "{} frames of {} × {} px, {} targets, at most {most} at a time, {found} found again{speed}",
            self.frames,
            self.size.0,
            self.size.1,
            self.lives.len()
        );
        let about = format!(
            "{} · configuration {} · seed {} · {}",
            self.info.reader,
            self.info.config_name,
            self.info.seed,
            concat!("foveate ", env!("CARGO_PKG_VERSION"))
        );
        let more = if left_out > 0 { format!("{left_out} short lives are left out.") } else { String::new() };
        let keys: Vec<Value> = self
            .keys
            .all
            .iter()
            .map(|(_, k)| json!({ "frame": k.frame + 1, "jpeg": k.jpeg, "targets": k.targets }))
            .collect();
        let data = json!({ "size": self.size, "rate": self.info.rate, "every": self.keys.every, "keys": keys });
        // No "<" is left in it, so nothing in it can end the script element or begin a comment.
        let data = data.to_string().replace('<', "\\u003c");
        let parts = [
            ("title", format!("foveate: {}", escape(&self.info.source))),
            ("source", escape(&self.info.source)),
            ("summary", escape(&summary)),
            ("about", escape(&about)),
            ("style", include_str!("style.css").into()),
            ("strip", self.film()),
            ("lives", bars(&lives, self.last)),
            ("more", more),
            ("rows", lives.iter().map(|(id, life)| row(*id, life)).collect()),
            ("command", escape(&self.info.command)),
            ("config", escape(&self.info.config_text)),
            ("data", data),
            ("script", include_str!("crowd.js").into()),
        ];
        fill(include_str!("crowd.html"), &parts)
    }

    fn film(&self) -> String {
        let one = |(_, p): &(usize, Picture)| {
            let n = p.frame + 1;
            format!(
                "<figure><img src=\"data:image/jpeg;base64,{}\" alt=\"Frame {n}\"><figcaption>frame {n}</figcaption></figure>",
                p.jpeg
            )
        };
        self.strip.all.iter().map(one).collect()
    }
}

impl Life {
    fn at(&self, frame: usize) -> bool {
        self.spans.iter().any(|(_, from, to)| (*from..=*to).contains(&frame))
    }
    fn frames(&self) -> usize {
        self.spans.iter().map(|(_, from, to)| to + 1 - from).sum()
    }
    fn in_phase(&self, phase: Phase) -> usize {
        self.spans.iter().filter(|span| span.0 == phase).map(|(_, from, to)| to + 1 - from).sum()
    }
    fn last(&self) -> usize {
        self.spans.last().map_or(self.born, |span| span.2)
    }
}

impl ManyObserver for CrowdReport {
    fn observe(&mut self, frame: &Frame, targets: &[Seen]) -> Result<()> {
        self.size = (frame.image.width(), frame.image.height());
        targets.iter().for_each(|seen| self.live(frame, seen));
        if self.strip.wants(self.frames) {
            let drawn = thumbnail(&self.annotator.annotate(frame, targets));
            let jpeg = text(&encode_jpeg(&drawn, 80));
            let bytes = jpeg.len();
            self.strip.push(self.frames, Picture { frame: frame.index, jpeg }, bytes);
        } else {
            self.annotator.walk(targets);
        }
        if self.keys.wants(self.frames) {
            let (jpeg, targets) = (picture(&frame.image), targets.iter().map(target).collect());
            let bytes = jpeg.len();
            self.keys.push(self.frames, Key { frame: frame.index, jpeg, targets }, bytes);
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

/// A target as the replay draws it: id, phase, four corners, gaze, name.
fn target(seen: &Seen) -> Value {
    let f = seen.state.fixate(Gaze::CENTRE, seen.extent);
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let at = |(u, v): (f64, f64)| [f.x + u * f.ux + v * f.vx, f.y + u * f.uy + v * f.vy];
    let look = seen.state.fixate(seen.gaze, seen.extent);
    let numbers = corners.into_iter().flat_map(at).chain([look.x, look.y]);
    let [r, g, b] = colour(seen.id);
    json!({
        "name": super::super::crowd::name(seen), "colour": format!("rgb({r} {g} {b})"),
        "guess": matches!(seen.phase, Phase::Hidden | Phase::Lost), "at": numbers.map(short).collect::<Vec<_>>(),
    })
}

fn thumbnail(image: &Image) -> Image {
    let longest = image.width().max(image.height());
    if longest <= STRIP_SIDE {
        return image.clone();
    }
    let small = |side: usize| (side * STRIP_SIDE / longest).max(1);
    smaller(image, small(image.width()), small(image.height()))
}

/// The lives as bars over time, as SVG: filled where followed, pale where hidden, a line where lost; a dot at each return.
fn bars(lives: &[(u64, &Life)], last: usize) -> String {
    const LEFT: f64 = 56.0;
    const WIDE: f64 = 1000.0;
    const ROW: f64 = 22.0;
    let x = |frame: f64| LEFT + (WIDE - LEFT - 12.0) * frame / (last + 1) as f64;
    let height = ROW * lives.len() as f64 + 30.0;
    let mut svg = format!("<svg viewBox=\"0 0 {WIDE} {height}\" role=\"img\" aria-label=\"When each target lived\">");
    let step = tick(last + 1);
    for frame in (0..=last + 1).step_by(step) {
        let (at, foot) = (x(frame as f64), height - 24.0);
        let _ = write!(
            svg,
            "<path d=\"M{at:.1} 0V{foot}\" class=\"grid\"/><text x=\"{at:.1}\" y=\"{}\">{frame}</text>",
            height - 6.0
        );
    }
    for (i, (id, life)) in lives.iter().enumerate() {
        let (y, [r, g, b]) = (ROW * i as f64, colour(*id));
        let _ = write!(svg, "<text x=\"{}\" y=\"{}\" class=\"id\">no {id}</text>", LEFT - 8.0, y + 15.5);
        for (n, (phase, from, to)) in life.spans.iter().enumerate() {
            let (from, to) = (x(*from as f64), x(*to as f64 + 1.0));
            let (class, top, tall) = match phase {
                Phase::Lost => ("lost", y + 9.5, 3.0),
                Phase::Hidden => ("pale", y + 4.0, 14.0),
                _ => ("full", y + 4.0, 14.0),
            };
            let _ = write!(
                svg,
                "<rect x=\"{from:.1}\" y=\"{top}\" width=\"{:.1}\" height=\"{tall}\" rx=\"1.5\" fill=\"rgb({r} {g} {b})\" class=\"{class}\"/>",
                (to - from).max(0.6)
            );
            if n > 0 && life.spans[n - 1].2 + 1 < life.spans[n].1 {
                let _ = write!(svg, "<circle cx=\"{from:.1}\" cy=\"{}\" r=\"5\" class=\"back\"/>", y + 11.0);
            }
        }
    }
    svg + "</svg>"
}

/// A round number of frames between two marks: 1, 2, 5, 10 ..., so that there are at most 13.
fn tick(frames: usize) -> usize {
    let round = (0..18).flat_map(|power| [1, 2, 5].map(|first| first * 10_usize.pow(power)));
    round.into_iter().find(|step| frames / step <= 12).unwrap_or(usize::MAX)
}

fn row(id: u64, life: &Life) -> String {
    let [r, g, b] = colour(id);
    let class = life.class.map_or("–".into(), |(class, p)| format!("{class} ({:.0} %)", 100.0 * p));
    let cell = |text: String| format!("<td>{text}</td>");
    let picture =
        format!("<img src=\"data:image/jpeg;base64,{}\" alt=\"Target {id} when it was born\">", life.template);
    let cells = [
        format!("<i class=\"dot\" style=\"background:rgb({r} {g} {b})\"></i>no {id}"),
        picture,
        class,
        (life.born + 1).to_string(),
        (life.last() + 1).to_string(),
        life.frames().to_string(),
        life.in_phase(Phase::Hidden).to_string(),
        life.in_phase(Phase::Lost).to_string(),
        life.found.to_string(),
        format!("{:.2} to {:.2}", life.scale.0, life.scale.1),
    ];
    format!("<tr>{}</tr>\n", cells.map(cell).concat())
}

#[cfg(test)]
mod tests {
    use super::super::super::crowd::tests::{frame, seen};
    use super::*;

    #[test]
    fn the_page_tells_each_life() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("report.html");
        let info = RunInfo { source: "<b>.mp4".into(), ..RunInfo::default() };
        let mut report = CrowdReport::create(&path, info).expect("a writable folder");
        for t in 0..40 {
            let phase = |t: usize| match t {
                0 => Phase::Born,
                10..15 => Phase::Hidden,
                20..26 => Phase::Lost,
                _ => Phase::Followed,
            };
            let mut targets = vec![seen(1, 30.0, phase(t))];
            if !(15..30).contains(&t) {
                targets.push(seen(2, 80.0, if t == 30 { Phase::Found } else { Phase::Followed }));
            }
            report.observe(&frame(t), &targets).expect("kept");
        }
        assert!(!path.exists());
        report.finish().expect("written");
        let page = std::fs::read_to_string(&path).expect("a page");
        for said in [
            "&lt;b&gt;.mp4",
            "40 frames of 120 × 60 px, 2 targets, at most 2 at a time, 1 found again",
            "<td>1</td><td>40</td><td>40</td><td>5</td><td>6</td><td>0</td>",
            "<td>1</td><td>40</td><td>25</td><td>0</td><td>0</td><td>1</td>",
            "class=\"back\"",
            "7 (98 %)",
        ] {
            assert!(page.contains(said), "{said}");
        }
        assert!(!page.contains("<b>.mp4") && !page.contains("{{"));
        let figures = page.matches("<figcaption>frame").count();
        assert!((STRIP / 2..=STRIP).contains(&figures), "{figures} pictures");
    }

    #[test]
    fn marks_are_round_and_few() {
        for (frames, step) in [(1, 1), (12, 1), (20, 2), (71, 10), (300, 50), (795, 100), (10_000, 1000)] {
            assert_eq!(tick(frames), step, "{frames}");
        }
        assert!((1..100_000).step_by(7).all(|n| n / tick(n) <= 12));
    }
}
