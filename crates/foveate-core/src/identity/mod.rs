//! WHAT is it? The identity (ventral) pathway: glimpses, features, distance to a template, class.
//!
//! As the control pathway sees it, an [`Appearance`] says how well the target, as it looked in the
//! first frame, explains what is seen at a state: log p(hₜ | xₜ, aₜ) = −sharpness · d(h(xₜ, aₜ), h(x₁, aₜ))
//! (section 3.1 of the paper).

pub mod accumulate;
pub mod box_regression;
mod buffers;
pub mod calibrate;
#[cfg(feature = "learn")]
pub mod classifier;
pub mod colour;
#[cfg(feature = "learn")]
pub mod convolution;
mod dense;
pub mod discriminant;
pub mod distance;
pub mod encoder;
mod footprint;
pub mod fusion;
pub mod gaze_appearance;
mod integral;
#[cfg(feature = "learn")]
pub mod multi_fixation;
#[cfg(feature = "learn")]
mod numbers;
#[cfg(feature = "learn")]
pub mod online;
pub mod onnx;
pub mod oriented;
mod packed;
pub mod pyramid;
#[cfg(feature = "learn")]
pub mod rbm_encoder;
pub mod retina;
pub(crate) mod surroundings;
mod views;

pub use buffers::Buffers;
#[cfg(feature = "learn")]
pub use classifier::Classifier;
pub use distance::Distance;
pub use encoder::Encoder;
pub use footprint::Footprint;
pub use gaze_appearance::GazeAppearance;
#[cfg(feature = "learn")]
pub use multi_fixation::MultiFixation;
pub use pyramid::Pyramid;
#[cfg(feature = "learn")]
pub use rbm_encoder::RbmEncoder;
pub use retina::{Foveal, Retina};

use crate::geometry::{Extent, Gaze, State};
use crate::reference::ReferenceLikelihood;
use crate::saved_state::SavedState;
use crate::scene::{Image, Meter};
use foveate_base::Result;
use foveate_base::rng::Streams;

/// One look, kept: what the fovea saw and what the first layer made of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Percept {
    /// Where it looked.
    pub gaze: Gaze,
    /// vₜ: the values of the retina's cells, 0 to 1, as the retina lists them.
    pub glimpse: Vec<f32>,
    /// hₜ: the activations of the first layer.
    pub features: Vec<f32>,
    /// Distance of the features to the template's at the same gaze (no sharpness).
    pub distance: f64,
    /// How far the colours are from the target's, as it counts in the distance that weighs particles: 0 at the target, 1 in
    /// colours of the surroundings; 0 without a colour model.
    pub colour: f64,
}

/// What may be learned from a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lesson {
    /// Its evidence deficit: 0 where the evidence is what the target gives, 1 where it is what other places give. `None` where nothing
    /// is to be learned for good.
    pub deficit: Option<f64>,
    /// Where nothing is learned for good, whether something is for now: by a short-term memory, if there is one.
    pub for_now: bool,
}

/// A picture of the target, and where in it the target is.
#[derive(Clone, Copy)]
pub struct TemplateSource<'a> {
    /// The picture, or a part of it.
    pub image: &'a Image,
    /// Column and row of the whole picture that its first pixel is.
    pub origin: (usize, usize),
    /// Where the target was in the whole picture.
    pub state: &'a State,
    /// Its box at scale 1.
    pub extent: Extent,
}

/// How the target looks, as the control pathway sees it.
///
/// `see` is called once a frame, before any `log_likelihood` or `perceive` of that frame, with every state
/// and gaze they may ask about; what else they ask about is told to `see_more` first. A log-likelihood must depend on its own state and gaze
/// alone: if it does not, results change with the number of threads, and `conformance::appearance` fails.
pub trait Appearance: Send + Sync {
    /// Keeps the template τ: how the target looks at `state`, whose box has `extent` at scale 1.
    fn init_template(&mut self, image: &Image, state: &State, extent: Extent, streams: Streams);
    /// Takes in what `states` and `gazes` of this frame need.
    fn see(&mut self, image: &Image, states: &[State], gazes: &[Gaze]);
    /// Takes in what more states of the frame that was seen last need, where it is not there. What was seen of it before may
    /// be forgotten.
    fn see_more(&mut self, image: &Image, states: &[State], gazes: &[Gaze]) {
        self.see(image, states, gazes);
    }
    /// Counts what was read of pictures since it was asked last.
    fn measure(&mut self, _meter: &mut Meter) {}
    /// log p(hₜ | xₜ, aₜ) in nats, up to a constant, for each state.
    fn log_likelihood(&mut self, states: &[State], gaze: Gaze, out: &mut [f64]);
    /// Looks once and keeps what was seen.
    fn perceive(&mut self, state: &State, gaze: Gaze, percept: &mut Percept);
    /// Length of its features; 0 where it has none.
    fn width(&self) -> usize {
        0
    }
    /// Fills `rows` with the features of states of the frame that was seen last, under the centre gaze, row by row;
    /// no rows where it has none.
    fn features(&mut self, _states: &[State], rows: &mut Vec<f32>) {
        rows.clear();
    }
    /// The gaze that it has settled on: its centre, from which the gazes it is told of are counted.
    fn home(&self) -> Gaze {
        Gaze::CENTRE
    }
    /// Makes this gaze the centre, from which all gazes it is told of later are counted: what was learned of another is learned anew
    /// from the first frame. Says false, and does nothing, where it cannot.
    fn settle(&mut self, _gaze: Gaze, _streams: Streams) -> bool {
        false
    }
    /// Whether [`Appearance::adapt`] does anything.
    fn adapts(&self) -> bool {
        false
    }
    /// Learns from the target, believed to be at `state` of this frame, which must be the one that was seen last, and not at
    /// the `distractors`, as much as the `lesson` says. What was seen of the frame is forgotten.
    fn adapt(&mut self, _image: &Image, _state: &State, _distractors: &[State], _lesson: Lesson) {}
    /// Log-likelihoods as [`Appearance::log_likelihood`] has them at the centre gaze, but without what was learned for now; `false`,
    /// with `out` as it was, where nothing was.
    fn long_term_log_likelihood(&mut self, states: &[State], out: &mut [f64]) -> bool {
        if !self.set_short_term_aside(true) {
            return false;
        }
        self.log_likelihood(states, Gaze::CENTRE, out);
        self.set_short_term_aside(false)
    }
    /// Leaves out what was learned for now, or takes it in again. Answers whether there is any.
    fn set_short_term_aside(&mut self, _aside: bool) -> bool {
        false
    }
    /// Resets the short-term memory.
    fn forget_short_term(&mut self) {}
    /// Forgets all that was learned since the first frame: it was learned of something else. The frame is to be seen again before more looks.
    fn forget_learned(&mut self) {}
    /// The picture `init_template` was given, or the part of it that has the target; none where that is not kept.
    fn template_source(&self) -> Option<TemplateSource<'_>> {
        None
    }
    /// Exchanges what it needs only while it looks at a frame with `buffers`. Who holds many targets gives each the same buffers for
    /// as long as it is looked at, and takes them back by a second call. Nothing that is told of a frame may depend on it.
    fn exchange(&mut self, _buffers: &mut Buffers) {}
    /// Frees what is not needed until the next look, and can be made again from what is kept. It is called before buffers are taken
    /// back, so that what it frees may be left in them.
    fn compact(&mut self) {}
    /// Learns the first frame once more, with what looks like the target there and is not: hard negatives, which are not forgotten.
    /// To be called after [`Appearance::init_template`], with the same picture and state.
    fn init_distractors(&mut self, _image: &Image, _state: &State, _distractors: &[State]) {}
    /// What the first frame says of evidence to come.
    fn reference(&self) -> ReferenceLikelihood;
    /// Everything `init_template` learned, to resume from.
    fn save(&self) -> serde_json::Value;
    /// Takes up what `save` gave.
    fn load(&mut self, saved: &serde_json::Value) -> Result<()>;
}

/// What is it called? From looks at the target to the probabilities of classes (section 2.2).
///
/// It remembers a few looks, and what it says must depend on these alone. It takes any gaze: continuous policies can
/// recognise too. `conformance::recognizer` is its law.
pub trait Recognizer: Send + Sync {
    /// n_c, at least 2.
    fn classes(&self) -> usize;
    /// What the classes are called, in their order; empty where they have numbers alone.
    fn names(&self) -> &[String] {
        &[]
    }
    /// Length of the features it reads.
    fn width(&self) -> usize;
    /// Takes in one look more, and writes log p(c | the looks it remembers), nats, one a class.
    fn recognize(&mut self, features: &[f32], gaze: Gaze, log_p: &mut [f64]);
    /// Forgets all looks.
    fn reset(&mut self);
    /// The looks it remembers.
    fn save(&self) -> SavedState;
    /// Takes up what `save` gave. Fails where it does not fit.
    fn load(&mut self, saved: &SavedState) -> Result<()>;
}
