//! report.html: one page that replays a run in any browser, offline.
//!
//! Every frame has a row of numbers; pictures, particles and glimpses are kept for some of them, evenly spaced, so that
//! the page stays small: at most [`MOST_KEYS`] pictures and about 10 MB. The page itself is `report/*.{html,css,js}`.

mod crowd;
mod page;

pub use self::crowd::CrowdReport;
pub(crate) use self::page::{escape, fill};

use std::path::PathBuf;

use base64::Engine as _;

use self::page::{Hills, Key, Page, Still};
use super::first::{Crop, First};
use super::heat::{Heat, span};
use super::sink::Sink;
use super::{Observer, RunInfo};
use crate::Result;
use crate::eval::regret::Ledger;
use crate::gaze::Portrait;
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::scene::{Frame, Image, encode_jpeg};
use crate::step::Step;

/// Pictures on a page; one more, and every second one goes.
const MOST_KEYS: usize = 400;
/// Bytes of pictures on a page before base64; more, and every second one goes.
const MOST_BYTES: usize = 6_500_000;
/// Longer side of a picture on the page, pixels.
const LONGEST: usize = 480;
/// JPEG quality of the frames.
const QUALITY: u8 = 62;
/// Particles drawn on a picture.
const MOST_PARTICLES: usize = 250;
/// Points along a side of a reward surface on the page.
const SURFACE: usize = 21;

/// Keeps what the page needs, and writes it at the end.
pub struct Report {
    info: RunInfo,
    file: Sink,
    finished: bool,
    page: Page,
    keys: Keys,
    ledger: Ledger,
    first: Option<First>,
}

/// Some of the rows, evenly spaced: every `every`-th.
struct Keys {
    kept: Vec<Key>,
    every: usize,
    bytes: usize,
}

impl Keys {
    fn wants(&self, row: usize) -> bool {
        row.is_multiple_of(self.every)
    }
    fn push(&mut self, key: Key) {
        self.bytes += key.bytes();
        self.kept.push(key);
        while self.kept.len() > 2 && (self.kept.len() > MOST_KEYS || self.bytes > MOST_BYTES) {
            self.every *= 2;
            let every = self.every;
            self.kept.retain(|key| key.row.is_multiple_of(every));
            self.bytes = self.kept.iter().map(Key::bytes).sum();
        }
    }
}

impl Report {
    /// Starts the file. Fails where its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>, info: RunInfo) -> Result<Self> {
        let file = Sink::create(path)?;
        let (page, ledger) = (Page::new(&info), Ledger::new(info.shadow.clone()));
        let keys = Keys { kept: vec![], every: 1, bytes: 0 };
        Ok(Self { info, file, finished: false, page, keys, ledger, first: None })
    }

    /// The target at the same gaze in the first frame, cell by cell; empty where that is not known.
    fn remembered(&self, gaze: Gaze) -> Vec<f32> {
        let (Some(first), Some(retina)) = (&self.first, &self.info.retina) else { return vec![] };
        first.glimpse(&**retina, gaze)
    }

    /// Which of the page's arms a gaze is.
    fn arm(&mut self, gaze: Gaze, portrait: Portrait<'_>) -> Option<usize> {
        if let (true, Portrait::Arms { gazes, .. }) = (self.page.arms.is_empty(), portrait) {
            self.page.arms = gazes.iter().map(|g| [g.u, g.v]).collect();
            self.page.learned = true;
        }
        self.page.arms.iter().position(|at| *at == [gaze.u, gaze.v])
    }
}

impl Observer for Report {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        let (state, extent) = (State::of(bbox), Extent::of(bbox));
        if self.page.template.is_none() {
            self.page.template = Some(still(&Crop::around(&frame.image, bbox)));
        }
        self.first = self.info.retina.as_deref().map(|retina| First::new(&frame.image, bbox, retina));
        let row = self.page.given(frame, &state, extent);
        if self.keys.wants(row) {
            let template = text(&levels(&self.remembered(Gaze::CENTRE)));
            let jpeg = picture(&frame.image);
            self.keys.push(Key { row, jpeg, glimpse: template.clone(), remembered: template, ..Key::default() });
        }
        Ok(())
    }

    fn observe(&mut self, step: &Step<'_>) -> Result<()> {
        let gaze = step.plan.chosen();
        let arm = self.arm(gaze, step.portrait);
        let row = self.page.tracked(step, arm);
        if !self.ledger.gazes().is_empty() {
            self.ledger.enter(step)?;
        }
        if !self.keys.wants(row) {
            return Ok(());
        }
        let (particles, weights) = particles(step);
        let (features, span) = quantised(&step.percept.features);
        self.page.features = step.percept.features.len();
        self.page.shown = weights.len();
        let looks = step.plan.gazes().iter().zip(step.plan.used()).enumerate();
        let also = looks.filter(|(k, (_, used))| **used && *k != step.plan.chosen_index());
        let (mut policy, mut surface) = (vec![], None);
        match step.portrait {
            Portrait::Blank => (),
            Portrait::Arms { probabilities, .. } => policy = probabilities.iter().flat_map(|p| word(*p)).collect(),
            Portrait::Surface(shown) => {
                let heat = Heat::of(shown, SURFACE);
                self.page.surface = Some([SURFACE as f64, heat.reach]);
                surface = Some(hills(&heat, shown.best()));
            }
        }
        self.keys.push(Key {
            row,
            jpeg: picture(&step.frame.image),
            particles: text(&particles),
            weights: text(&weights),
            glimpse: text(&levels(&step.percept.glimpse)),
            remembered: text(&levels(&self.remembered(gaze))),
            features: text(&features),
            span,
            policy: text(&policy),
            also: also.map(|(_, (gaze, _))| [gaze.u, gaze.v]).collect(),
            surface,
        });
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        if !std::mem::replace(&mut self.finished, true) {
            self.page.measure(self.info.clock.total());
            self.page.regret(&self.ledger);
            self.file.write(self.page.render(&self.keys.kept).as_bytes())?;
        }
        self.file.finish()
    }
}

/// The particles that are drawn, evenly picked and always with the heaviest: places as two words each over −1 to 2
/// pictures, and weights relative to the heaviest.
fn particles(step: &Step<'_>) -> (Vec<u8>, Vec<u8>) {
    let every = step.weights.len().div_ceil(MOST_PARTICLES);
    let heaviest = (0..step.weights.len()).max_by(|a, b| step.weights[*a].total_cmp(&step.weights[*b])).unwrap_or(0);
    let most = step.weights[heaviest];
    let picked =
        (0..step.weights.len()).step_by(every).map(|i| if i / every == heaviest / every { heaviest } else { i });
    let (w, h) = (step.frame.image.width() as f64, step.frame.image.height() as f64);
    let (mut places, mut weights) = (vec![], vec![]);
    for i in picked {
        let state = &step.predicted[i];
        places.extend(word((state.x / w + 1.0) / 3.0).into_iter().chain(word((state.y / h + 1.0) / 3.0)));
        weights.push((255.0 * step.weights[i] / most).round() as u8);
    }
    (places, weights)
}

/// A reward surface as the page has it: each map as bytes between its own least and greatest value.
fn hills(heat: &Heat, best: Option<Gaze>) -> Hills {
    let map = |values: &[f64]| {
        let (low, high) = span(values);
        let byte = |v: &f64| (255.0 * (v - low) / (high - low).max(f64::MIN_POSITIVE)).round() as u8;
        (text(&values.iter().map(byte).collect::<Vec<_>>()), [low, high])
    };
    let ((mean, mean_span), (sd, sd_span)) = (map(&heat.mean), map(&heat.sd));
    Hills { mean, mean_span, sd, sd_span, best: best.map(|g| [g.u, g.v]) }
}

/// 0 to 1 as two bytes, the low one first.
fn word(share: f64) -> [u8; 2] {
    ((65535.0 * share.clamp(0.0, 1.0)).round() as u16).to_le_bytes()
}

/// 0 to 1 as bytes.
fn levels(values: &[f32]) -> Vec<u8> {
    values.iter().map(|v| (255.0 * v).round() as u8).collect()
}

/// Activations as bytes: probabilities as they are, anything else from its least to its greatest value.
fn quantised(values: &[f32]) -> (Vec<u8>, Option<[f32; 2]>) {
    let low = values.iter().copied().fold(f32::INFINITY, f32::min);
    let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    if values.is_empty() || low >= 0.0 && high <= 1.0 {
        return (levels(values), None);
    }
    let range = (high - low).max(f32::MIN_POSITIVE);
    (values.iter().map(|v| (255.0 * (v - low) / range).round() as u8).collect(), Some([low, high]))
}

pub(super) fn text(bytes: &[u8]) -> String {
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// A frame as the page has it: small, JPEG, base64.
pub(super) fn picture(image: &Image) -> String {
    let longest = image.width().max(image.height());
    if longest <= LONGEST {
        return text(&encode_jpeg(image, QUALITY));
    }
    let small = |side: usize| (side * LONGEST / longest).max(1);
    text(&encode_jpeg(&shrunk(image, small(image.width()), small(image.height())), QUALITY))
}

/// A picture made smaller: each new pixel is the mean of the whole old pixels under it.
pub(super) fn shrunk(image: &Image, width: usize, height: usize) -> Image {
    let mut data = Vec::with_capacity(width * height * image.planes());
    let span = |i: usize, old: usize, new: usize| i * old / new..((i + 1) * old / new).max(i * old / new + 1);
    for plane in (0..image.planes()).map(|p| image.plane(p)) {
        for y in 0..height {
            let rows = span(y, image.height(), height);
            for x in 0..width {
                let columns = span(x, image.width(), width);
                let line = |row: usize| &plane[row * image.width()..][columns.clone()];
                let sum: u32 = rows.clone().flat_map(line).map(|&v| u32::from(v)).sum();
                let count = (rows.len() * columns.len()) as u32;
                data.push(((sum + count / 2) / count) as u8);
            }
        }
    }
    Image::new(width, height, image.planes(), data).expect("as many bytes as pixels")
}

/// The cut-out as the page has it.
pub(super) fn still(crop: &Crop) -> Still {
    let (width, height) = (crop.image.width(), crop.image.height());
    let longest = width.max(height);
    let small = |side: usize| if longest > LONGEST { (side * LONGEST / longest).max(1) } else { side };
    Still { jpeg: text(&encode_jpeg(&shrunk(&crop.image, small(width), small(height)), 88)), bounds: crop.bounds }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_runs_keep_evenly_spaced_pictures() {
        let mut keys = Keys { kept: vec![], every: 1, bytes: 0 };
        for row in 0..5000 {
            if keys.wants(row) {
                keys.push(Key { row, jpeg: "x".repeat(16_000), ..Key::default() });
            }
            assert!(keys.kept.len() <= MOST_KEYS && keys.bytes <= MOST_BYTES);
        }
        let rows: Vec<usize> = keys.kept.iter().map(|k| k.row).collect();
        assert_eq!(rows, (0..5000).step_by(keys.every).collect::<Vec<_>>());
        assert!(rows.len() > MOST_KEYS / 2, "{}", rows.len());
        let mut keys = Keys { kept: vec![], every: 1, bytes: 0 };
        for row in (0..100).filter(|r| *r < 60 || r % 2 == 0) {
            keys.push(Key { row, jpeg: "x".repeat(200_000), ..Key::default() });
        }
        assert!(keys.bytes <= MOST_BYTES && keys.every == 4, "{} {}", keys.bytes, keys.every);
    }

    #[test]
    fn shrinking_keeps_the_mean_and_the_place() {
        let ramp: Vec<u8> = (0..60 * 40).map(|i| (3 * (i % 60)) as u8).collect();
        let small = shrunk(&Image::new(60, 40, 1, ramp).expect("60 x 40"), 20, 10);
        assert!((0..20).all(|x| small.at(0, x, 3) == (9 * x + 3) as u8), "means of three columns");
        let odd = shrunk(&Image::grey(7, 5, 99), 3, 2);
        assert!(odd.bytes().iter().all(|v| *v == 99));
    }

    #[test]
    fn activations_outside_0_to_1_say_their_span() {
        assert_eq!(quantised(&[0.0, 0.5, 1.0]), (vec![0, 128, 255], None));
        assert_eq!(quantised(&[-1.0, 1.0]), (vec![0, 255], Some([-1.0, 1.0])));
        assert_eq!(quantised(&[]), (vec![], None));
        assert_eq!(quantised(&[2.0, 2.0]).0, [0, 0]);
    }
}
