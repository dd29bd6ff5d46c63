//! report.html: one page that replays a run in any browser, offline.
//!
//! Every frame has a row of numbers; pictures, particles and glimpses are kept for some of them, evenly spaced, so that
//! the page stays small: at most [`MOST_KEYS`] pictures and about 10 MB. The page itself is `report/*.{html,css,js}`.

mod page;

use std::path::PathBuf;

use base64::Engine as _;

use self::page::{Key, Page, Still};
use super::sink::Sink;
use super::{Observer, RunInfo};
use crate::Result;
use crate::gaze::Portrait;
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::identity::Pyramid;
use crate::identity::pyramid::Region;
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
/// How much of the first frame is shown around the target, in template units.
const MARGIN: f64 = 1.4;
/// The farthest gaze that is read on the template, in template units; as far as the appearance's own.
const FARTHEST_GAZE: f64 = 1.5;

/// Keeps what the page needs, and writes it at the end.
pub struct Report {
    info: RunInfo,
    file: Sink,
    finished: bool,
    page: Page,
    keys: Keys,
    template: Option<Template>,
}

/// The first frame, as the retina reads it.
struct Template {
    pyramid: Pyramid,
    state: State,
    extent: Extent,
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
        let page = Page::new(&info);
        let keys = Keys { kept: vec![], every: 1, bytes: 0 };
        Ok(Self { info, file, finished: false, page, keys, template: None })
    }

    /// The target at the same gaze in the first frame, cell by cell; empty where that is not known.
    fn remembered(&self, gaze: Gaze) -> Vec<f32> {
        let (Some(t), Some(retina)) = (&self.template, &self.info.retina) else { return vec![] };
        let far = gaze.u.abs().max(gaze.v.abs()) > FARTHEST_GAZE;
        let mut glimpse = vec![0.0; if far { 0 } else { retina.glimpse_len() }];
        if !far {
            retina.look(&t.pyramid, t.state.fixate(gaze, t.extent), &mut glimpse);
        }
        glimpse
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
            self.page.template = Some(around(&frame.image, &state, extent));
        }
        if let Some(retina) = &self.info.retina {
            let reach = retina.footprints().iter().map(|f| f.reach).fold(0.0, f64::max);
            let corner = Gaze { u: FARTHEST_GAZE, v: FARTHEST_GAZE, arm: None };
            let mut pyramid = Pyramid::default();
            let region = Region::covering(&frame.image, &[state], &[corner], extent, reach);
            pyramid.build(&frame.image, region, retina.footprints(), (extent.half_w, extent.half_h));
            self.template = Some(Template { pyramid, state, extent });
        }
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
        if !self.keys.wants(row) {
            return Ok(());
        }
        let (particles, weights) = particles(step);
        let (features, span) = quantised(&step.percept.features);
        self.page.features = step.percept.features.len();
        self.page.shown = weights.len();
        let looks = step.plan.gazes().iter().zip(step.plan.used()).enumerate();
        let also = looks.filter(|(k, (_, used))| **used && *k != step.plan.chosen_index());
        let policy = match step.portrait {
            Portrait::Arms { probabilities, .. } => probabilities.iter().flat_map(|p| word(*p)).collect(),
            Portrait::Blank | Portrait::Surface(_) => vec![],
        };
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
        });
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        if !std::mem::replace(&mut self.finished, true) {
            self.page.measure(self.info.clock.total());
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

fn text(bytes: &[u8]) -> String {
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// A frame as the page has it: small, JPEG, base64.
fn picture(image: &Image) -> String {
    let longest = image.width().max(image.height());
    if longest <= LONGEST {
        return text(&encode_jpeg(image, QUALITY));
    }
    let small = |side: usize| (side * LONGEST / longest).max(1);
    text(&encode_jpeg(&shrunk(image, small(image.width()), small(image.height())), QUALITY))
}

/// A picture made smaller: each new pixel is the mean of the whole old pixels under it.
fn shrunk(image: &Image, width: usize, height: usize) -> Image {
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

/// The target and what is around it; outside the picture its edge is repeated.
fn around(image: &Image, state: &State, extent: Extent) -> Still {
    let reach = |half: f64| (MARGIN * half).ceil().clamp(1.0, 4096.0) as isize;
    let (rx, ry) = (reach(extent.half_w), reach(extent.half_h));
    let (cx, cy) = (state.x.round() as isize, state.y.round() as isize);
    let at = |i: isize, side: usize| i.clamp(0, side as isize - 1) as usize;
    let mut data = vec![];
    for p in 0..image.planes() {
        for y in cy - ry..=cy + ry {
            data.extend((cx - rx..=cx + rx).map(|x| image.at(p, at(x, image.width()), at(y, image.height()))));
        }
    }
    let (width, height) = (2 * rx as usize + 1, 2 * ry as usize + 1);
    let crop = Image::new(width, height, image.planes(), data).expect("as many bytes as pixels");
    let longest = width.max(height);
    let small = |side: usize| if longest > LONGEST { (side * LONGEST / longest).max(1) } else { side };
    // Edges of the outermost pixels, in template units.
    let u = |x: f64| (x - state.x) / extent.half_w;
    let v = |y: f64| (y - state.y) / extent.half_h;
    let (cx, cy, rx, ry) = (cx as f64, cy as f64, rx as f64 + 0.5, ry as f64 + 0.5);
    Still {
        jpeg: text(&encode_jpeg(&shrunk(&crop, small(width), small(height)), 88)),
        bounds: [u(cx - rx), v(cy - ry), u(cx + rx), v(cy + ry)],
    }
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
    fn the_surroundings_reach_past_the_picture() {
        let image = Image::grey(30, 20, 50);
        let still = around(&image, &State::default(), Extent { half_w: 10.0, half_h: 5.0 });
        assert_eq!(still.bounds, [-1.45, -1.5, 1.45, 1.5]);
        let far =
            around(&image, &State { x: 1e12, y: f64::NAN, ..State::default() }, Extent { half_w: 2.0, half_h: 2.0 });
        assert!(!far.jpeg.is_empty());
    }

    #[test]
    fn activations_outside_0_to_1_say_their_span() {
        assert_eq!(quantised(&[0.0, 0.5, 1.0]), (vec![0, 128, 255], None));
        assert_eq!(quantised(&[-1.0, 1.0]), (vec![0, 255], Some([-1.0, 1.0])));
        assert_eq!(quantised(&[]), (vec![], None));
        assert_eq!(quantised(&[2.0, 2.0]).0, [0, 0]);
    }
}
