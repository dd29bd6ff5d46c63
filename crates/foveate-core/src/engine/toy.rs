//! An appearance in closed form, and a tracker with it, for tests of rules without video.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::target::Target;
use super::{Engine, Filter, GazeControl, Monitor, Parts};
use crate::control::{Autoregressive, Concentration, ConfidenceModel, ConsistencySettings, OWN, Prior};
use crate::gaze::Fixed;
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::identity::accumulate::Accumulate;
use crate::identity::retina::FovealConfig;
use crate::identity::{Appearance, Foveal, Lesson, Memory, Percept, Recognizer, Retina};
use crate::recognition::Recognition;
use crate::reference::ReferenceLikelihood;
use crate::saved_state::SavedState;
use crate::scene::Image;
use foveate_base::Result;
use foveate_base::rng::Streams;

/// Half the size of the target's box, pixels.
pub(crate) const EXTENT: Extent = Extent { half_w: 10.0, half_h: 10.0 };
/// Decrease of the log-likelihood for each pixel between a state and the target, and the log-likelihood far from it, nats.
pub(crate) const SLOPE: f64 = 4.0;
pub(crate) const OFF: f64 = -40.0;
const REFERENCE: ReferenceLikelihood = ReferenceLikelihood { on: 0.0, off: OFF };

/// log p(h | x, a) falls with the distance from `at`, and from `row` if there is one, for any picture. A gaze adds its offset to the
/// place.
pub(crate) struct Toy {
    /// Column of the target.
    pub at: f64,
    /// Row of the target; `None` if all are alike.
    pub row: Option<f64>,
    /// Column of the colours of the target, 20 pixels wide; `None` if its surroundings have them too.
    pub colours: Option<f64>,
    pub committed: Gaze,
    /// The number of templates it has received.
    pub templates: Arc<AtomicUsize>,
    pub learned: Option<Learned>,
}

/// A memory that counts what it receives.
#[derive(Default)]
pub(crate) struct Learned {
    /// Number of resets.
    pub forgotten: Arc<AtomicUsize>,
    /// The number of distractors in each lesson.
    pub lessons: Vec<usize>,
}

impl Memory for Learned {
    fn learn(&mut self, _: &Image, _: &State, distractors: &[State], _: Lesson) {
        self.lessons.push(distractors.len());
    }
    fn init_distractors(&mut self, _: &Image, _: &State, distractors: &[State]) {
        self.lessons.push(distractors.len());
    }
    fn forget(&mut self) {
        self.forgotten.fetch_add(1, Ordering::Relaxed);
    }
}

impl Toy {
    pub(crate) fn at(at: f64) -> Self {
        Self { at, row: None, colours: None, committed: Gaze::CENTRE, templates: Arc::default(), learned: None }
    }

    /// The features of a column: one axis for each 10 pixels.
    pub(crate) fn axis(&self, x: f64) -> [f32; 6] {
        let axis = ((x - self.at) / 10.0).round().clamp(-2.0, 3.0) + 2.0;
        std::array::from_fn(|k| f32::from(u8::from(k == axis as usize)))
    }
}

impl Appearance for Toy {
    fn init_template(&mut self, _: &Image, _: &State, _: Extent, _: Streams) -> ReferenceLikelihood {
        self.templates.fetch_add(1, Ordering::Relaxed);
        REFERENCE
    }
    fn prepare(&mut self, _: &Image, _: &[State], _: &[Gaze]) {}
    fn log_likelihood(&mut self, states: &[State], gaze: Gaze, out: &mut [f64]) {
        let fit = |state: &State| {
            let across = (state.x + gaze.u * EXTENT.half_w - self.at).abs();
            let down = self.row.map_or(0.0, |row| (state.y + gaze.v * EXTENT.half_h - row).abs());
            (-SLOPE * (across + down)).max(OFF)
        };
        out.iter_mut().zip(states).for_each(|(out, state)| *out = fit(state));
    }
    fn glimpse(&mut self, state: &State, gaze: Gaze, percept: &mut Percept) {
        percept.gaze = gaze;
        percept.features = self.axis(state.x).to_vec();
    }
    fn colour_distances(&mut self, _: &Image, states: &[State], out: &mut [f64]) -> bool {
        let Some(at) = self.colours else { return false };
        out.iter_mut().zip(states).for_each(|(out, state)| *out = ((state.x - at).abs() / 20.0).min(1.0));
        true
    }
    fn width(&self) -> usize {
        6
    }
    fn features(&mut self, states: &[State], rows: &mut Vec<f32>) {
        rows.clear();
        rows.extend(states.iter().flat_map(|state| self.axis(state.x)));
    }
    fn committed_gaze(&self) -> Gaze {
        self.committed
    }
    fn commit_gaze(&mut self, gaze: Gaze, _: Streams) -> Option<ReferenceLikelihood> {
        self.committed = gaze;
        Some(ReferenceLikelihood { off: 0.5 * OFF, ..REFERENCE })
    }
    fn memory(&mut self) -> Option<&mut dyn Memory> {
        self.learned.as_mut().map(|it| it as &mut dyn Memory)
    }
}

/// Recognises class 0 in so many looks, and class 1 later.
struct Turning {
    looks: usize,
    after: usize,
}

impl Recognizer for Turning {
    fn classes(&self) -> usize {
        2
    }
    fn width(&self) -> usize {
        foveal().glimpse_len()
    }
    fn recognize(&mut self, _: &[f32], _: Gaze, log_p: &mut [f64]) {
        let class = usize::from(self.looks >= self.after);
        self.looks += 1;
        log_p.fill(0.01f64.ln());
        log_p[class] = 0.99f64.ln();
    }
    fn reset(&mut self) {
        self.looks = 0;
    }
    fn save(&self) -> SavedState {
        SavedState::new(&(self.looks, self.after))
    }
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        (self.looks, self.after) = saved.read()?;
        Ok(())
    }
}

fn foveal() -> Foveal {
    Foveal::new(FovealConfig::authors()).expect("a retina of the authors")
}

/// A recogniser that recognises another class after so many looks.
pub(crate) fn turning(after: usize) -> Recognition {
    let (retina, policy) = (Arc::new(foveal()), Box::new(Fixed::new(Gaze::CENTRE)));
    let recognizer = Box::new(Turning { looks: 0, after });
    Recognition::new(retina, None, recognizer, policy, Accumulate::Sum).expect("parts that fit")
}

/// A grey picture of 100 x 100 pixels.
pub(crate) fn picture() -> Image {
    Image::grey(100, 100, 90)
}

/// The box of the target at this column.
pub(crate) fn target(x: f64) -> BBox {
    BBox::around(x, 50.0, 2.0 * EXTENT.half_w, 2.0 * EXTENT.half_h)
}

pub(super) fn given() -> Target {
    Target { state: state(50.0), extent: EXTENT, unit: EXTENT.mean(), share: 1.0, moved: false, reference: REFERENCE }
}

pub(crate) fn state(x: f64) -> State {
    State { x, y: 50.0, ..State::default() }
}

/// A model whose P(lost) is near 0 for the evidence of the target, and near 1 for that of other places.
pub(crate) fn model() -> ConfidenceModel {
    let mut weights = [0.0; OWN];
    weights[0] = 20.0;
    ConfidenceModel { weights, bias: -10.0, ..ConfidenceModel::default() }
}

/// 50 particles that move by a pixel or two per frame, one gaze, and this appearance.
pub(crate) fn parts(appearance: Toy) -> Parts {
    let still = Autoregressive { damping: 0.0, velocity: 0.0, position: 0.15, log_scale: 0.0, ..Default::default() };
    let filter = Filter::new(Box::new(Prior::new(Arc::new(still))), 50).expect("some particles");
    let reward = Concentration::new(1.0).expect("a temperature");
    let gaze = GazeControl::new(Box::new(Fixed::new(Gaze::CENTRE)), Box::new(reward));
    Parts::new(filter, gaze, Box::new(appearance), Monitor::new(ConsistencySettings::default(), model()))
}

/// An engine of these parts, with the target set at column 50.
pub(crate) fn started(parts: Parts, number: u64) -> Engine {
    let mut engine = Engine::new(parts, 1, number);
    engine.init(&picture(), target(50.0)).expect("a box in the picture");
    engine
}

#[test]
fn the_toys_conform() {
    crate::conformance::appearance(&|| Box::new(Toy::at(30.0)));
    crate::conformance::recognizer(&|| Box::new(Turning { looks: 0, after: 3 }));
}
