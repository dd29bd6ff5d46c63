//! Film strips: a few frames of a run side by side, of one target or of many.

use std::path::PathBuf;

use crate::draw::{CORNERS, Colour, Drawing, text_width};
use crate::eye::windows;
use crate::film::writable;
use crate::pictures::resized;
use crate::{MultiAnnotator, Observer, RunInfo};
use foveate_base::{Error, Result, files};
use foveate_core::Seen;
use foveate_core::geometry::{BBox, Gaze, State};
use foveate_core::scene::Image;
use foveate_video::{Frame, encode_png};

const PAPER: Colour = [255; 3];
const INK: Colour = [26, 30, 34];
const BLACK: Colour = [0; 3];
const TRUTH: Colour = [63, 209, 155];
const TARGET: Colour = [57, 182, 255];
const GAZE: Colour = [255, 182, 39];
/// Width of a still of one target, pixels.
const WIDE: f64 = 300.0;
/// Width of a still of many targets, pixels.
const WIDTH: usize = 480;
/// Space between stills, pixels.
const GAP: f64 = 8.0;
/// Height of capitals, pixels.
const LETTER: f64 = 10.0;

/// A film strip of one target: stills of some frames with the true box, the estimate and the gaze. It writes no file.
#[derive(Debug)]
pub struct Strip {
    at: Vec<usize>,
    truth: Vec<Option<BBox>>,
    window: f64,
    stills: Vec<(usize, Image)>,
}

impl Strip {
    /// Takes `n` stills of a run of `frames`, evenly spaced, including the first and the last. The gaze is drawn as the retina's innermost
    /// window, with the true box if known.
    pub fn new(info: &RunInfo, frames: usize, n: usize) -> Self {
        let last = frames.saturating_sub(1);
        let at = (0..n).map(|i| (i * last) / n.saturating_sub(1).max(1)).collect();
        let window = info.retina.as_deref().and_then(|retina| windows(retina).first().copied()).unwrap_or(0.0);
        Self { window, ..Self::at(at, info.truth.clone()) }
    }

    /// Takes stills of the frames with these indices, counted from 0; `truth` has one box per frame if known.
    pub fn at(mut at: Vec<usize>, truth: Vec<Option<BBox>>) -> Self {
        at.sort_unstable();
        at.dedup();
        Self { at, truth, window: 0.0, stills: vec![] }
    }

    /// Returns the stills, 300 pixels wide, each with the index of its frame.
    pub fn into_stills(self) -> Vec<(usize, Image)> {
        self.stills
    }

    fn keep(&mut self, frame: &Frame, seen: &Seen<'_>) {
        if !self.at.contains(&frame.index) {
            return;
        }
        let (w, h) = (frame.image.width() as f64, frame.image.height() as f64);
        let zoom = WIDE / w;
        let mut page = Drawing::new(WIDE as usize, (h * zoom).round().max(1.0) as usize, BLACK);
        let (width, height) = (page.width(), page.height());
        page.paste(&frame.image, 0, 0, width, height);
        let mut square = |state: &State, gaze: Gaze, reach: f64, thick: f64, colour: Colour| {
            let corner = |(u, v): (f64, f64)| {
                let at = state.fixate(Gaze { u: gaze.u + reach * u, v: gaze.v + reach * v, arm: None }, seen.extent);
                (zoom * (at.x + 0.5) - 0.5, zoom * (at.y + 0.5) - 0.5)
            };
            let corners = CORNERS.map(corner);
            page.outline(&corners, thick + 1.6, BLACK, 0.5);
            page.outline(&corners, thick, colour, 1.0);
        };
        if let Some(Some(truth)) = self.truth.get(frame.index) {
            square(&State::of(truth), Gaze::CENTRE, 1.0, 3.6, TRUTH);
        }
        square(&seen.state, Gaze::CENTRE, 1.0, 1.8, TARGET);
        if !seen.is_given() {
            square(&seen.state, seen.gaze, self.window, 1.4, GAZE);
        }
        self.stills.push((frame.index, page.into_image()));
    }

    /// Draws the stills side by side under a title, with a legend.
    pub fn picture(&self, title: &str) -> Image {
        let tall = self.stills.iter().map(|s| s.1.height()).max().unwrap_or(1) as f64;
        let width = GAP + self.stills.len().max(2) as f64 * (WIDE + GAP);
        let (head, foot) = (2.6 * LETTER, 2.4 * LETTER);
        let mut page = Drawing::new(width as usize, (head + tall + foot + GAP) as usize, PAPER);
        page.text((GAP, 0.8 * LETTER), title, LETTER, INK);
        let mut x = width - GAP;
        for (name, colour) in [("gaze", GAZE), ("estimate", TARGET), ("truth", TRUTH)] {
            x -= text_width(name, LETTER);
            page.text((x, 0.8 * LETTER), name, LETTER, INK);
            x -= 2.0 * LETTER;
            page.fill(x, 0.8 * LETTER, 1.4 * LETTER, LETTER, colour, 1.0);
            x -= 2.0 * LETTER;
        }
        for (i, (index, still)) in self.stills.iter().enumerate() {
            let x = GAP + i as f64 * (WIDE + GAP);
            page.paste(still, x.round() as usize, head.round() as usize, still.width(), still.height());
            page.text((x, head + tall + 0.7 * LETTER), &format!("frame {}", index + 1), LETTER, INK);
        }
        page.into_image()
    }
}

impl Observer for Strip {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        targets.iter().take(1).for_each(|seen| self.keep(frame, seen));
        Ok(())
    }
}

/// A film strip of many targets: chosen frames as [`MultiAnnotator`] draws them, in rows below a title, as a PNG.
#[derive(Debug)]
pub struct MultiStrip {
    path: PathBuf,
    title: String,
    frames: Vec<usize>,
    columns: usize,
    annotator: MultiAnnotator,
    pictures: Vec<Image>,
    finished: bool,
}

impl MultiStrip {
    /// Creates an observer that writes the `frames` (counted from 0) to `path`, a PNG, in rows of `columns`, at least 1.
    ///
    /// # Errors
    /// Its folder does not exist. [`Observer::finish`] fails if none of the frames was observed.
    pub fn create(path: impl Into<PathBuf>, title: &str, frames: Vec<usize>, columns: usize) -> Result<Self> {
        let path = path.into();
        writable(&path)?;
        let (annotator, columns) = (MultiAnnotator::default(), columns.max(1));
        Ok(Self { path, title: title.into(), frames, columns, annotator, pictures: vec![], finished: false })
    }

    fn picture(&self) -> Option<Image> {
        let first = self.pictures.first()?;
        let height = (WIDTH * first.height()).div_ceil(first.width());
        let (columns, gap) = (self.columns.min(self.pictures.len()), GAP as usize);
        let rows = self.pictures.len().div_ceil(columns);
        let (size, head) = (13.0, 40);
        let wide = (columns * (WIDTH + gap) + gap).max(text_width(&self.title, size) as usize + 2 * gap);
        let mut page = Drawing::new(wide, head + rows * (height + gap), PAPER);
        page.text((GAP, 13.0), &self.title, size, INK);
        for (i, picture) in self.pictures.iter().enumerate() {
            let (left, top) = (gap + i % columns * (WIDTH + gap), head + i / columns * (height + gap));
            page.paste(&resized(picture, WIDTH, height), left, top, WIDTH, height);
        }
        Some(page.into_image())
    }
}

impl Observer for MultiStrip {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        if self.frames.contains(&frame.index) {
            self.pictures.push(self.annotator.annotate(frame, targets));
        } else {
            self.annotator.skip(targets);
        }
        Ok(())
    }
    fn finish(&mut self) -> Result<()> {
        if std::mem::replace(&mut self.finished, true) {
            return Ok(());
        }
        let picture = self.picture().ok_or_else(|| {
            Error::Invalid(format!("{}: none of the frames to be shown was there", self.path.display()))
        })?;
        files::write(&self.path, &encode_png(&picture))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Film;
    use crate::multi::tests::{frame, seen};
    use foveate_core::multi::Phase;

    #[test]
    fn stills_are_spread_evenly() {
        let mut strip = Strip::new(&RunInfo::default(), 9, 3);
        assert_eq!(strip.at, [0, 4, 8]);
        let bbox = BBox { x: 5.0, y: 5.0, w: 20.0, h: 20.0 };
        for index in [0, 1, 4] {
            let frame = Frame { index, time: 0.0, image: Image::grey(40, 30, 0) };
            strip.observe(&frame, &[Seen::given(frame.image.shape(), &bbox)]).expect("it cannot fail");
        }
        assert_eq!(strip.stills.iter().map(|s| s.0).collect::<Vec<_>>(), [0, 4]);
        let picture = strip.picture("two of three");
        // The left edge of the box: half a pixel left of pixel 5, magnified 7.5 times.
        let (x, y) = (8 + (7.5 * 5.0) as usize, 26 + (7.5 * 15.0) as usize);
        let colours: Vec<[u8; 3]> = (x - 3..x + 3).map(|x| [0, 1, 2].map(|p| picture.at(p, x, y))).collect();
        assert!(colours.contains(&TARGET), "{colours:?}");
        assert_eq!(Strip::new(&RunInfo::default(), 1, 5).at, [0]);
        assert!(Strip::new(&RunInfo::default(), 0, 0).picture("none").width() > 0);
    }

    #[test]
    fn film_and_strip_are_whole_or_not_there() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let (mp4, png) = (dir.path().join("a.mp4"), dir.path().join("a.png"));
        let mut all: Vec<Box<dyn Observer>> = vec![
            Box::new(Film::of_many(&mp4, &RunInfo::default()).expect("a writable folder")),
            Box::new(MultiStrip::create(&png, "two of four", vec![0, 3], 4).expect("a writable folder")),
        ];
        for t in 0..4 {
            let targets = [seen(1, 20.0 + t as f64, Phase::Tracked), seen(2, 90.0, Phase::Occluded)];
            all.observe(&frame(t), &targets[..1 + t % 2]).expect("drawn");
        }
        assert!(!mp4.exists() && !png.exists());
        all.finish().expect("written");
        let strip = foveate_video::read_image(&png).expect("a PNG");
        assert_eq!((strip.width(), strip.height()), (2 * 488 + 8, 40 + 240 + 8));
        assert_eq!(foveate_video::open(&mp4).expect("a video").count(), 4);
        assert!(MultiStrip::create(dir.path().join("none/a.png"), "", vec![0], 1).is_err());
        let empty = MultiStrip::create(dir.path().join("b.png"), "", vec![9], 1).expect("a writable folder").finish();
        assert!(empty.expect_err("no frame 9").to_string().contains("none of the frames"));
    }
}
