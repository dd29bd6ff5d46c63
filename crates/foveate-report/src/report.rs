//! report.html: a page that replays a run in any browser, offline.
//!
//! Pictures and boxes, and with one target particles and glimpses, are kept for evenly spaced frames: at most 400 pictures and 9 MB. With
//! one target every frame also has a row of numbers, about 180 bytes. The page itself is `report/*.{html,css,js}`; it shows the data that
//! the run has.

mod bars;
mod document;
mod html;
mod kept;
mod page;
mod tracks;

pub use self::document::{card, document, drawing};
pub use self::html::{BRAND, SCRIPT, STYLE, escape, fill};

use std::path::PathBuf;

use self::html::{Template, base64, picture};
use self::kept::{Kept, MOST_KEYS};
use self::page::{Hills, Key, Page};
use self::tracks::Drawn;
use crate::heat::{Heat, span};
use crate::regret::RegretLog;
use crate::template::{Crop, FirstFrame};
use crate::{Observer, RunInfo};
use foveate_base::Result;
use foveate_base::sink::Sink;
use foveate_core::Seen;
use foveate_core::gaze::PolicySnapshot;
use foveate_core::geometry::Gaze;
use foveate_video::Frame;

/// Maximum number of particles drawn on a picture.
const MOST_PARTICLES: usize = 250;
/// Points along a side of a reward surface on the page.
const SURFACE: usize = 21;

/// report.html of a run, with one target or many. It collects the data during the run, and writes the page at the end.
pub struct Report {
    info: RunInfo,
    file: Sink,
    finished: bool,
    page: Page,
    keys: Kept<Key>,
    log: RegretLog,
    first: Option<FirstFrame>,
}

foveate_base::opaque_debug!(Report);

impl Report {
    /// Starts the file.
    ///
    /// # Errors
    /// Its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>, info: RunInfo) -> Result<Self> {
        Ok(Self::to(Sink::create(path)?, info))
    }

    /// Writes the page to `file`.
    pub fn to(file: Sink, info: RunInfo) -> Self {
        let (page, log) = (Page::new(&info), RegretLog::new(info.shadow.clone()));
        Self { info, file, finished: false, page, keys: Kept::new(MOST_KEYS), log, first: None }
    }

    /// Returns the template at a gaze, cell by cell; empty if unknown.
    fn template(&self, gaze: Gaze) -> Vec<f32> {
        let (Some(first), Some(retina)) = (&self.first, &self.info.retina) else { return vec![] };
        first.glimpse(&**retina, gaze)
    }

    /// Adds the only target so far in a frame whose box is given.
    fn given(&mut self, frame: &Frame, seen: &Seen<'_>, key: &mut Key) {
        let bbox = &seen.bbox;
        if self.page.template.is_none() {
            self.page.template = Some(Template::new(&Crop::around(&frame.image, bbox)));
        }
        self.first = self.info.retina.as_deref().map(|retina| FirstFrame::new(&frame.image, bbox, retina));
        key.template = base64(&levels(&self.template(Gaze::CENTRE)));
        key.glimpse = key.template.clone();
    }

    /// Adds the only target so far in a tracked frame; `wanted` is whether the page keeps the key.
    fn tracked(&mut self, frame: &Frame, seen: &Seen<'_>, wanted: bool, key: &mut Key) -> Result<()> {
        let arm = self.arm(seen.gaze, seen.snapshot);
        self.page.tracked(seen, arm);
        if seen.weights.is_empty() {
            return Ok(());
        }
        if !self.log.gazes().is_empty() {
            self.log.enter(frame, seen)?;
        }
        if !wanted {
            return Ok(());
        }
        let (particles, weights) = particles(seen);
        let (features, span) = quantised(&seen.percept.features);
        self.page.features = seen.percept.features.len();
        self.page.shown = weights.len();
        match seen.snapshot {
            PolicySnapshot::Blank => (),
            PolicySnapshot::Arms { probabilities, .. } => {
                key.policy = base64(&probabilities.iter().flat_map(|p| word(*p)).collect::<Vec<_>>());
            }
            PolicySnapshot::Surface(shown) => {
                let heat = Heat::of(shown, SURFACE);
                self.page.surface = Some([SURFACE as f64, heat.reach]);
                key.surface = Some(hills(&heat, shown.best()));
            }
        }
        let also = seen.plan.used().filter(|(k, _)| *k != seen.plan.chosen_index());
        key.also = also.map(|(_, gaze)| [gaze.u, gaze.v]).collect();
        (key.particles, key.weights) = (base64(&particles), base64(&weights));
        (key.features, key.span) = (base64(&features), span);
        key.glimpse = base64(&levels(&seen.percept.glimpse));
        key.template = base64(&levels(&self.template(seen.gaze)));
        Ok(())
    }

    /// Returns the page's arm for a gaze.
    fn arm(&mut self, gaze: Gaze, snapshot: PolicySnapshot<'_>) -> Option<usize> {
        if let (true, PolicySnapshot::Arms { gazes, .. }) = (self.page.arms.is_empty(), snapshot) {
            self.page.arms = gazes.iter().map(|g| [g.u, g.v]).collect();
            self.page.learned = true;
        }
        self.page.arms.iter().position(|at| *at == [gaze.u, gaze.v])
    }
}

impl Observer for Report {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        let row = self.page.frame(frame, targets)?;
        let wanted = self.keys.keeps(row);
        let mut key = Key { row, ..Key::default() };
        if let (true, [seen]) = (self.page.has_one(), targets) {
            self.page.only(seen);
            match seen.is_given() {
                true => self.given(frame, seen, &mut key),
                false => self.tracked(frame, seen, wanted, &mut key)?,
            }
        }
        if wanted {
            (key.jpeg, key.targets) = (picture(&frame.image), targets.iter().map(Drawn::new).collect());
            self.keys.push(row, key.bytes(), key);
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        if !std::mem::replace(&mut self.finished, true) {
            self.page.end(&self.info);
            self.page.regret(&self.log);
            self.file.write(self.page.render(&self.keys.iter().collect::<Vec<_>>()).as_bytes())?;
        }
        self.file.finish()
    }
}

/// Returns the particles to draw, evenly selected and always including the heaviest: positions as two words each over −1 to 2 pictures, and
/// weights relative to the heaviest.
pub fn particles(seen: &Seen<'_>) -> (Vec<u8>, Vec<u8>) {
    let every = seen.weights.len().div_ceil(MOST_PARTICLES);
    let heaviest = (0..seen.weights.len()).max_by(|a, b| seen.weights[*a].total_cmp(&seen.weights[*b])).unwrap_or(0);
    let most = seen.weights[heaviest];
    let picked =
        (0..seen.weights.len()).step_by(every).map(|i| if i / every == heaviest / every { heaviest } else { i });
    let (w, h) = (seen.shape[0] as f64, seen.shape[1] as f64);
    let (mut places, mut weights) = (vec![], vec![]);
    for i in picked {
        let state = &seen.particles[i];
        places.extend(word((state.x / w + 1.0) / 3.0).into_iter().chain(word((state.y / h + 1.0) / 3.0)));
        weights.push((255.0 * seen.weights[i] / most).round() as u8);
    }
    (places, weights)
}

/// Returns a reward surface for the page: each map as bytes between its minimum and maximum.
fn hills(heat: &Heat, best: Option<Gaze>) -> Hills {
    let map = |values: &[f64]| {
        let (low, high) = span(values);
        let byte = |v: &f64| (255.0 * (v - low) / (high - low).max(f64::MIN_POSITIVE)).round() as u8;
        (base64(&values.iter().map(byte).collect::<Vec<_>>()), [low, high])
    };
    let ((mean, mean_span), (sd, sd_span)) = (map(&heat.mean), map(&heat.sd));
    Hills { mean, mean_span, sd, sd_span, best: best.map(|g| [g.u, g.v]) }
}

/// Encodes 0 to 1 as two bytes, low byte first.
fn word(share: f64) -> [u8; 2] {
    ((65535.0 * share.clamp(0.0, 1.0)).round() as u16).to_le_bytes()
}

/// Encodes 0 to 1 as bytes.
pub fn levels(values: &[f32]) -> Vec<u8> {
    values.iter().map(|v| (255.0 * v).round() as u8).collect()
}

/// Encodes activations as bytes: probabilities directly, other values from their minimum to their maximum.
fn quantised(values: &[f32]) -> (Vec<u8>, Option<[f32; 2]>) {
    let low = values.iter().copied().fold(f32::INFINITY, f32::min);
    let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    if values.is_empty() || low >= 0.0 && high <= 1.0 {
        return (levels(values), None);
    }
    let range = (high - low).max(f32::MIN_POSITIVE);
    (values.iter().map(|v| (255.0 * (v - low) / range).round() as u8).collect(), Some([low, high]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::multi::tests::{frame, seen};
    use foveate_core::multi::Phase;

    /// The summary and the text of the page of a run in which `targets` returns those of each of 40 frames.
    fn page(targets: impl Fn(usize) -> Vec<Seen<'static>>) -> (serde_json::Value, String) {
        page_of(1, targets)
    }
    /// The same if only every so many frames were read.
    fn page_of(every: usize, targets: impl Fn(usize) -> Vec<Seen<'static>>) -> (serde_json::Value, String) {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("report.html");
        let info = RunInfo { source: "<b>.mp4".into(), ..RunInfo::default() };
        let mut report = Report::create(&path, info).expect("a writable folder");
        for t in 0..40 {
            report.observe(&Frame { index: every * t, ..frame(t) }, &targets(t)).expect("kept");
        }
        assert!(!path.exists());
        report.finish().expect("written");
        let page = std::fs::read_to_string(&path).expect("a page");
        let data = page.split("id=\"data\">").nth(1).and_then(|rest| rest.split("</script>").next()).expect("data");
        (serde_json::from_str(data).expect("JSON"), page)
    }

    fn phase(t: usize) -> Phase {
        match t {
            0 => Phase::Initiated,
            10..15 => Phase::Occluded,
            20..26 => Phase::Lost,
            _ => Phase::Tracked,
        }
    }

    #[test]
    fn the_page_has_each_track() {
        let (data, page) = page(|t| {
            let mut targets = vec![seen(1, 30.0, phase(t))];
            if !(15..30).contains(&t) {
                targets.push(seen(2, 80.0, if t == 30 { Phase::ReIdentified } else { Phase::Tracked }));
            }
            targets
        });
        assert_eq!(data["tracks"], serde_json::json!({ "targets": 2, "most": 2, "reidentified": 1 }));
        assert_eq!((&data["size"], &data["series"]["x"]), (&[120, 60].into(), &serde_json::json!([])));
        for part in [
            "foveate: &lt;b&gt;.mp4",
            "<td>1</td><td>40</td><td>40</td><td>5</td><td>6</td><td>0</td>",
            "<td>1</td><td>40</td><td>25</td><td>0</td><td>0</td><td>1</td>",
            "r=\"5\" class=\"again\"",
            "7 (98 %)",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("<b>.mp4") && !page.contains("{{"));
    }

    /// A live run leaves frames out: that is no re-identification, and frames are those that were read.
    #[test]
    fn dropped_frames_interrupt_no_track() {
        let two = |t| vec![seen(1, 30.0, phase(t)), seen(2, 80.0, Phase::Tracked)];
        let (data, page) = page_of(3, two);
        assert_eq!(data["tracks"], serde_json::json!({ "targets": 2, "most": 2, "reidentified": 0 }));
        assert!(
            !page.contains("r=\"5\" class=\"again\"")
                && page.contains("<td>1</td><td>118</td><td>40</td><td>5</td><td>6</td>")
        );
        // Tracked, occluded, tracked, lost, tracked; and tracked.
        assert_eq!(
            ["full", "pale", "lost"].map(|class| page.matches(&format!("class=\"{class}\"")).count()),
            [4, 1, 1]
        );
    }

    #[test]
    fn the_only_one_of_many_targets_has_numbers() {
        let (data, _) = page(|t| vec![seen(7, 30.0, phase(t))][..usize::from(t != 30)].to_vec());
        let series = |name: &str| data["series"][name].as_array().expect("a column").clone();
        let known = |name: &str| series(name).iter().filter(|value| !value.is_null()).count();
        assert_eq!(["frame", "x", "usable", "ess"].map(known), [40, 39, 38, 0]);
        assert!(series("x")[30].is_null());
    }

    #[test]
    fn activations_outside_0_to_1_say_their_span() {
        assert_eq!(quantised(&[0.0, 0.5, 1.0]), (vec![0, 128, 255], None));
        assert_eq!(quantised(&[-1.0, 1.0]), (vec![0, 255], Some([-1.0, 1.0])));
        assert_eq!(quantised(&[]), (vec![], None));
        assert_eq!(quantised(&[2.0, 2.0]).0, [0, 0]);
    }
}
