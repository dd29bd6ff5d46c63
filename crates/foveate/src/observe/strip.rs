//! A film strip: a few frames of a run side by side, with the true box, the estimate and the look.

use super::draw::{Colour, Drawing, text_width};
use super::{Observer, RunInfo};
use crate::Result;
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::scene::{Frame, Image};
use crate::step::Step;

const PAPER: Colour = [255; 3];
const INK: Colour = [26, 30, 34];
const BLACK: Colour = [0; 3];
const TRUTH: Colour = [63, 209, 155];
const TARGET: Colour = [57, 182, 255];
const GAZE: Colour = [255, 182, 39];
/// Width of a still, pixels.
const WIDE: f64 = 300.0;
/// Space between stills, pixels.
const GAP: f64 = 8.0;
/// Height of capitals, pixels.
const LETTER: f64 = 10.0;

/// Keeps stills at some frames of a run.
pub struct Strip {
    at: Vec<usize>,
    truth: Vec<Option<BBox>>,
    window: f64,
    stills: Vec<(usize, Image)>,
}

impl Strip {
    /// `n` stills of a run of `frames`, spread evenly, the first and the last among them. The look is drawn as the retina's
    /// innermost window, the truth where it is known.
    pub fn new(info: &RunInfo, frames: usize, n: usize) -> Self {
        let last = frames.saturating_sub(1);
        let at = (0..n).map(|i| (i * last) / n.saturating_sub(1).max(1)).collect();
        let cells = info.retina.iter().flat_map(|r| r.cells()).filter(|c| c.channel == 0);
        let finest = cells.clone().map(|c| c.half).fold(f64::INFINITY, f64::min);
        let inner = cells.filter(|c| c.half <= finest).map(|c| c.u.abs().max(c.v.abs()) + c.half);
        let truth = info.truth.iter().copied().map(Some).collect();
        Self { window: inner.fold(0.0, f64::max), ..Self::at(at, truth) }
    }

    /// Stills of the frames with these indices.
    pub fn at(mut at: Vec<usize>, truth: Vec<Option<BBox>>) -> Self {
        at.sort_unstable();
        at.dedup();
        Self { at, truth, window: 0.0, stills: vec![] }
    }

    /// The stills, each with the index of its frame.
    pub fn into_stills(self) -> Vec<(usize, Image)> {
        self.stills
    }

    fn keep(&mut self, frame: &Frame, state: &State, extent: Extent, look: Option<Gaze>) {
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
                let at = state.fixate(Gaze { u: gaze.u + reach * u, v: gaze.v + reach * v, arm: None }, extent);
                (zoom * (at.x + 0.5) - 0.5, zoom * (at.y + 0.5) - 0.5)
            };
            let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(corner);
            page.outline(&corners, thick + 1.6, BLACK, 0.5);
            page.outline(&corners, thick, colour, 1.0);
        };
        if let Some(Some(truth)) = self.truth.get(frame.index) {
            square(&State::of(truth), Gaze::CENTRE, 1.0, 3.6, TRUTH);
        }
        square(state, Gaze::CENTRE, 1.0, 1.8, TARGET);
        if let Some(look) = look {
            square(state, look, self.window, 1.4, GAZE);
        }
        self.stills.push((frame.index, page.into_image()));
    }

    /// The stills under a title, with a key of the colours.
    pub fn picture(&self, title: &str) -> Image {
        let tall = self.stills.iter().map(|s| s.1.height()).max().unwrap_or(1) as f64;
        let width = GAP + self.stills.len().max(2) as f64 * (WIDE + GAP);
        let (head, foot) = (2.6 * LETTER, 2.4 * LETTER);
        let mut page = Drawing::new(width as usize, (head + tall + foot + GAP) as usize, PAPER);
        page.text((GAP, 0.8 * LETTER), title, LETTER, INK);
        let mut x = width - GAP;
        for (name, colour) in [("look", GAZE), ("estimate", TARGET), ("truth", TRUTH)] {
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
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        self.keep(frame, &State::of(bbox), Extent::of(bbox), None);
        Ok(())
    }
    fn observe(&mut self, step: &Step<'_>) -> Result<()> {
        self.keep(step.frame, &step.estimate, step.extent, Some(step.plan.chosen()));
        Ok(())
    }
    fn finish(&mut self) -> Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stills_are_spread_evenly() {
        let mut strip = Strip::new(&RunInfo::default(), 9, 3);
        assert_eq!(strip.at, [0, 4, 8]);
        let bbox = BBox { x: 5.0, y: 5.0, w: 20.0, h: 20.0 };
        for index in [0, 1, 4] {
            let frame = Frame { index, time: 0.0, image: Image::grey(40, 30, 0) };
            strip.start(&frame, &bbox).expect("it cannot fail");
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
}
