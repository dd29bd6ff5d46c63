//! WHAT is it? The identity (ventral) pathway: glimpses, features, distance to a template, class.
//!
//! For the control pathway, an [`Appearance`] measures how well the target, as it looked in the
//! first frame, explains the picture at a state: log p(hₜ | xₜ, aₜ) = −sharpness · d(h(xₜ, aₜ), h(x₁, aₜ))
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
pub mod gaze_appearance;
mod integral;
#[cfg(feature = "learn")]
pub mod multi_fixation;
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
use foveate_base::rng::Streams;
use foveate_base::{Error, Result};

/// A stored look: the glimpse and its features.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Percept {
    /// Its gaze.
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
    /// The evidence deficit of the frame: 0 if the evidence is as on the target, 1 if it is as elsewhere.
    pub deficit: f64,
}

/// A picture of the target, and where in it the target is.
#[derive(Clone, Copy, Debug)]
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

/// How the target looks: the likelihoods that the control pathway uses.
///
/// `prepare` is called once a frame, before any `log_likelihood` or `glimpse` of that frame, with the states and
/// gazes of that frame; other states and gazes are given to `extend` first. A log-likelihood must depend on its own state and gaze
/// alone: if it does not, results change with the number of threads, and `conformance::appearance` fails.
pub trait Appearance: Send + Sync {
    /// Keeps the template τ: how the target looks at `state`, whose box has `extent` at scale 1. Returns the log-likelihoods to expect on
    /// the target and elsewhere: P(lost) compares later evidence with them.
    fn init_template(&mut self, image: &Image, state: &State, extent: Extent, streams: Streams) -> ReferenceLikelihood;
    /// Prepares the parts of this frame that `states` and `gazes` need.
    fn prepare(&mut self, image: &Image, states: &[State], gazes: &[Gaze]);
    /// log p(hₜ | xₜ, aₜ) in nats, up to a constant, for each state.
    fn log_likelihood(&mut self, states: &[State], gaze: Gaze, out: &mut [f64]);
    /// Prepares the parts of the last prepared frame that more states need. Parts prepared before may be discarded.
    fn extend(&mut self, image: &Image, states: &[State], gazes: &[Gaze]) {
        self.prepare(image, states, gazes);
    }
    /// Looks at one state, and keeps the glimpse, its features and their distance to the template. By default there are no features, and the
    /// distance is the negative log-likelihood.
    fn glimpse(&mut self, state: &State, gaze: Gaze, percept: &mut Percept) {
        let mut log_likelihood = [0.0];
        self.log_likelihood(&[*state], gaze, &mut log_likelihood);
        *percept = Percept { gaze, distance: -log_likelihood[0], ..Percept::default() };
    }
    /// Writes how far the colours at each of these states are from those of the target in frame 1, robust to blur: 0 on the target, 1 in
    /// colours of the surroundings. Returns false, and writes nothing, if colours do not separate the target from its surroundings.
    fn colour_distances(&mut self, _image: &Image, _states: &[State], _out: &mut [f64]) -> bool {
        false
    }
    /// Length of its features; 0 if it has none.
    fn width(&self) -> usize {
        0
    }
    /// Fills `rows` with the features of prepared states under the centre gaze, row by row; no rows if it has none.
    fn features(&mut self, _states: &[State], rows: &mut Vec<f32>) {
        rows.clear();
    }
    /// The gaze that the appearance is committed to: all other gazes are relative to it.
    fn committed_gaze(&self) -> Gaze {
        Gaze::CENTRE
    }
    /// Commits to this gaze, and is trained on the first frame again if it was not trained for this gaze. Returns the log-likelihoods to expect under
    /// this gaze; `None`, and nothing happens, if it cannot.
    fn commit_gaze(&mut self, _gaze: Gaze, _streams: Streams) -> Option<ReferenceLikelihood> {
        None
    }
    /// The part that learns while tracking; `None` if nothing is learned after the first frame.
    fn memory(&mut self) -> Option<&mut dyn Memory> {
        None
    }
    /// The picture that `init_template` was given, or the part of it with the target; `None` if that is not kept.
    fn template_source(&self) -> Option<TemplateSource<'_>> {
        None
    }
    /// Adds the rectangles of pictures that were read since the last call.
    fn measure(&mut self, _meter: &mut Meter) {}
    /// Exchanges buffers that are needed only while a frame is looked at. A tracker of many targets lends each the same buffers and takes
    /// them back by a second call. No result may depend on them.
    fn exchange(&mut self, _buffers: &mut Buffers) {}
    /// Frees memory that is not needed until the next look and can be computed again. It is called before buffers are taken back, so that
    /// freed memory may be left in them.
    fn compact(&mut self) {}
    /// The state to resume from; empty without a template. By default the state cannot be saved.
    fn save(&self) -> SavedState {
        SavedState::empty()
    }
    /// Resumes from what `save` returned.
    ///
    /// # Errors
    /// If the state does not fit.
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        if saved.is_empty() {
            return Ok(());
        }
        Err(Error::Invalid("the saved appearance cannot be used: this appearance model saves nothing".into()))
    }
}

/// What an appearance learns while tracking.
pub trait Memory {
    /// Learns the target at `state` of the prepared frame, and not at the `distractors`, as far as the lesson permits. The frame has to be
    /// prepared again before more looks.
    fn learn(&mut self, image: &Image, state: &State, distractors: &[State], lesson: Lesson);
    /// Resets all that was learned since the first frame, because it was learned from another object. The frame has to be prepared again
    /// before more looks.
    fn forget(&mut self);
    /// Learns the first frame again, with places that look like the target there and are not: hard negatives, which stay in the training set.
    /// Called after [`Appearance::init_template`], with the same picture and state.
    fn init_distractors(&mut self, _image: &Image, _state: &State, _distractors: &[State]) {}
}

/// Computes probabilities of classes from looks at the target (section 2.2).
///
/// It remembers a few looks, and the probabilities must depend on these alone. It takes any gaze, so that continuous policies can
/// recognise too. `conformance::recognizer` is its law.
pub trait Recognizer: Send + Sync {
    /// n_c, at least 2.
    fn classes(&self) -> usize;
    /// Names of the classes, in their order; empty if they have numbers only.
    fn names(&self) -> &[String] {
        &[]
    }
    /// Length of the features it reads.
    fn width(&self) -> usize;
    /// Takes in one look more, and writes log p(c | the looks it remembers), nats, one a class.
    fn recognize(&mut self, features: &[f32], gaze: Gaze, log_p: &mut [f64]);
    /// Discards all looks.
    fn reset(&mut self);
    /// The looks it remembers.
    fn save(&self) -> SavedState;
    /// Restores a state of `save`. Fails if it does not fit.
    fn load(&mut self, saved: &SavedState) -> Result<()>;
}
