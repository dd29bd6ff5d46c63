//! Bounding-box regression: a small convolutional network compares the estimated box and its surroundings with those
//! of frame 1, and predicts the offset and size of the target. The reported box moves part of the way.
//!
//! Particle weights find the most likely place, but have no model of how targets change and where their borders are.
//! Their error changes slowly, so one evaluation in a few frames is enough. The network learns borders once, from
//! annotated tracks and from photographs composed onto others (`bench/train_box_regression.py`), for targets of all
//! kinds (Girshick et al., 2014; Held et al., *Learning to track at 100 FPS with deep regression networks*, 2016). It
//! compares both pictures as Dosovitskiy et al. do (*FlowNet*, 2015).
//!
//! It also predicts whether the target is there. While the target is occluded or lost, this helps to decide whether
//! it is found (`confidence.box_regression`). While it is tracked, the mean over many evaluations is a lower bound of
//! P(lost) (`confidence.absence`): the network does not learn while tracking, so a wrong object cannot mislead it.
//!
//! Particles find the place well, and the size and shape badly: a target that turns or deforms keeps frame 1's shape
//! for them. So they follow a share of the correction of size and width / height at each evaluation of a confident
//! frame: the gain of a Kalman filter whose variance is the square of the correction less that of the expected error
//! (adaptive process noise; Mehra, 1972). The rest of the correction, and that of the place, is for output only
//! (docs/lab/real-video.md).
//!
//! Deviation: the paper reports the mean of the belief, and has no network that changes it.

mod colours;
mod file;
mod glimpse;
mod network;

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use self::colours::{Colours, Histograms};
use self::glimpse::Glimpse;
use self::network::{Scratch, Template};
use super::numbers;
use crate::geometry::{Extent, State};
use crate::saved_state::{Valid, Validate, ensure};
use crate::scene::{Image, Meter};
use foveate_base::files::Files;
use foveate_base::{Error, Result};

pub use network::{Answer, Network};

/// The largest expected error, half sides and log scale.
const MOST_ERROR: f64 = 1.0;
/// The farthest that a box goes, half sides and log scale: the network was trained on boxes that are farther off, and errs there.
const FARTHEST: f64 = 0.5;

/// The largest share of a correction that the particles take, unless `follow` is larger.
const MOST_SHARE: f64 = 0.5;

/// The largest feature that is taken of a saved tracker, and more frames than any video has.
const MOST: f32 = 1e4;
const MOST_FRAMES: u64 = 1 << 48;

foveate_base::settings! {
    /// Settings of the box regression.
    pub struct Settings in "box_regression" {
        /// A file of `bench/train_box_regression.py`, or `builtin:natural-boxes`.
        pub weights: String = "builtin:natural-boxes".into(),
        /// Frames between two evaluations, 1 to 100.
        pub every: usize = 3; 1.0 to 100.0,
        /// Weight of the newest correction in the running mean, above 0 to 1.
        pub rate: f64 = 0.7; 1e-3 to 1.0,
        /// Least share of the correction of size and width / height that the particles take at an evaluation, 0 to 1; they take up to
        /// a half if it exceeds its expected error. 0 is off.
        pub follow: f64 = 0.0; 0.0 to 1.0,
    }
}

impl Settings {
    /// The network.
    ///
    /// # Errors
    /// Fails if the file cannot be read, or is none of `bench/train_box_regression.py`.
    pub fn read(&self, files: &dyn Files) -> Result<Network> {
        let path = Path::new(&self.weights);
        match self.weights.strip_prefix("builtin:") {
            None => Network::parse(&files.read(path)?, path),
            Some("natural-boxes") => Network::parse(include_bytes!("../../models/natural-boxes.json"), path),
            Some(name) => Err(Error::Config(format!(
                "box_regression.weights: there is no builtin:{name}; there is builtin:natural-boxes, or the name of a file of \
                 `bench/train_box_regression.py`"
            ))),
        }
    }
}

/// The network, its template, and its last input.
#[derive(Debug)]
pub struct BoxRegression {
    network: Arc<Network>,
    settings: Settings,
    template: Option<Template>,
    pub(crate) state: BoxState,
    colours: Colours,
    glimpse: Glimpse,
    /// The network's second input: of each coarse cell, the probability of its colour.
    colour: Vec<f32>,
    scratch: Scratch,
}

/// Where the target is from the estimate, by the evaluations until now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Correction {
    /// Frames since the target was given.
    frames: u64,
    /// The running mean: right and down, half sides; log size; half the log of width / height.
    mean: [f64; 4],
    /// The network's expected errors of the four, of the last evaluation.
    errors: [f64; 4],
}

/// The state of a box regression between frames.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct BoxState {
    /// The features of the target's own picture; empty without a target.
    #[serde(with = "numbers::floats")]
    template: Vec<f32>,
    histograms: Histograms,
    correction: Correction,
}

impl Validate<bool> for BoxState {
    /// The setting is whether there is a target.
    fn validate(&self, has_target: &bool) -> Valid {
        let Self { template, histograms, correction: Correction { frames, mean, errors } } = self;
        let expected = if *has_target { network::KEPT } else { 0 };
        if template.len() != expected || template.iter().any(|x| x.abs() > MOST) {
            return Err(format!("its template is not {expected} features"));
        }
        ensure(histograms.are_of(*has_target), || "its colours are not two pairs of histograms".into())?;
        let expected = errors.iter().all(|x| (0.0..=MOST_ERROR).contains(x));
        ensure(mean.iter().all(|x| x.abs() <= FARTHEST) && expected && *frames <= MOST_FRAMES, || {
            format!("it moves the box by {mean:?} with errors of {errors:?} after {frames} frames")
        })
    }
}

impl BoxRegression {
    /// Of a network.
    pub fn new(network: Arc<Network>, settings: Settings) -> Self {
        let (state, colours, glimpse, colour, scratch) = Default::default();
        Self { network, settings, template: None, state, colours, glimpse, colour, scratch }
    }

    /// Sets the template to the content of this box.
    pub fn init_template(&mut self, image: &Image, state: &State, extent: Extent) {
        self.glimpse.take(image, state, extent);
        let histograms = Histograms::of(&self.glimpse.coarse);
        self.colours.update(&histograms);
        self.read();
        self.resume(BoxState {
            template: self.scratch.features().to_vec(),
            histograms,
            correction: Correction::default(),
        });
        self.glimpse.read = None;
    }

    /// The network's prediction for this box. Panics without a template.
    pub fn answer(&mut self, image: &Image, state: &State, extent: Extent) -> Answer {
        self.look(image, state, extent);
        let template = self.template.as_ref().expect("the template is taken before the first answer");
        self.network.answer(template, &mut self.scratch)
    }

    /// Whether it looks in this frame.
    pub fn is_due(&self) -> bool {
        self.state.correction.frames.is_multiple_of(self.settings.every as u64)
    }

    /// The reported state for this estimate; call it once a frame. `answer` is the network's prediction, if already
    /// computed.
    pub fn moved(&mut self, image: &Image, state: &State, extent: Extent, answer: Option<Answer>) -> State {
        let rate = self.settings.rate;
        if self.is_due() {
            let answer = answer.unwrap_or_else(|| self.answer(image, state, extent));
            let Answer { offset: [u, v], log_scale, half_log_aspect, log_spread, lost } = answer;
            self.state.correction.errors = log_spread.map(|x| f64::from(x).exp().min(MOST_ERROR));
            let there = 1.0 / (1.0 + f64::from(lost).exp());
            // A network from elsewhere may return any numbers.
            let found = [u, v, log_scale, half_log_aspect].map(|x| {
                if x.is_finite() && there.is_finite() { there * f64::from(x).clamp(-FARTHEST, FARTHEST) } else { 0.0 }
            });
            for (mean, found) in self.state.correction.mean.iter_mut().zip(found) {
                *mean += rate * (found - *mean);
            }
        }
        self.state.correction.frames += 1;
        let ([u, v, log_scale, half_aspect], (half_w, half_h)) = (self.state.correction.mean, state.half(extent));
        State {
            x: state.x + u * half_w,
            y: state.y + v * half_h,
            log_scale: state.log_scale + log_scale,
            log_aspect: state.log_aspect + 2.0 * half_aspect,
            ..*state
        }
    }

    /// Returns the network's expected errors of the box at the last evaluation: right and down, half sides; log size; log of width / height.
    pub fn errors(&self) -> [f64; 4] {
        let [u, v, log_scale, half_aspect] = self.state.correction.errors;
        [u, v, log_scale, 2.0 * half_aspect]
    }

    /// Learns the colours of the last evaluation and takes a share of the correction for the particles: log size, and log of
    /// width / height. Call it after [`BoxRegression::moved`], in confident frames alone; `None` in frames without an evaluation.
    pub fn follow(&mut self) -> Option<[f64; 2]> {
        let Self { settings, state: BoxState { correction, histograms, .. }, colours, glimpse, .. } = self;
        if settings.follow == 0.0 || !(correction.frames - 1).is_multiple_of(settings.every as u64) {
            return None;
        }
        histograms.learn(&glimpse.coarse);
        colours.update(histograms);
        let mut take = |k: usize| {
            let (mean, error) = (&mut correction.mean[k], correction.errors[k]);
            let share = share(settings.follow, *mean, error) * *mean;
            *mean -= share;
            share
        };
        Some([take(2), 2.0 * take(3)])
    }

    /// Drops the correction: the target was moved into another box. It looks in the next frame.
    pub(crate) fn restart(&mut self) {
        self.state.correction = Correction::default();
    }

    /// Whether the box was moved.
    #[cfg(test)]
    pub(crate) fn is_corrected(&self) -> bool {
        self.state.correction != Correction::default()
    }

    /// Adds the values read since the last call.
    pub fn measure(&mut self, meter: &mut Meter) {
        if let Some(read) = self.glimpse.read.take() {
            meter.add(read);
        }
    }

    /// Continues from a valid state.
    pub(crate) fn resume(&mut self, state: BoxState) {
        self.template = (!state.template.is_empty()).then(|| self.network.template(&state.template));
        self.colours.update(&state.histograms);
        self.state = state;
    }

    /// Frees buffers that are not needed until the next evaluation.
    pub(crate) fn compact(&mut self) {
        (self.glimpse, self.colour, self.scratch) = Default::default();
    }

    fn look(&mut self, image: &Image, state: &State, extent: Extent) {
        self.glimpse.take(image, state, extent);
        self.read();
    }

    /// Computes the features of the last glimpse.
    fn read(&mut self) {
        self.colours.input(&self.glimpse.coarse, &mut self.colour);
        self.network.look(&self.glimpse.values, &self.colour, &mut self.scratch);
    }
}

/// The share of a correction that the particles take, with this expected error: at least `least`.
fn share(least: f64, correction: f64, error: f64) -> f64 {
    let excess = 1.0 - (error / correction).powi(2);
    if excess > 0.0 { least + (MOST_SHARE - least).max(0.0) * excess } else { least }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::files::Nowhere;

    /// A correction c with the expected error e: 1 − e² / c² is the gain of a filter with the variance c² − e².
    #[test]
    fn the_particles_take_more_of_a_correction_that_exceeds_its_error() {
        for (correction, error, exact) in
            [(0.1, 0.2, 0.1), (0.1, 0.1, 0.1), (-0.2, 0.1, 0.4), (0.2, 0.0, 0.5), (0.0, 0.0, 0.1), (0.0, 0.1, 0.1)]
        {
            assert!((share(0.1, correction, error) - exact).abs() < 1e-12, "{correction} with an error of {error}");
        }
        assert_eq!(share(0.7, 0.2, 0.0), 0.7, "no less than the setting");
    }

    /// Reads pixels in every `every`-th frame alone; between them the box is moved by the answers until then.
    #[test]
    fn it_looks_in_every_few_frames() {
        let settings = Settings { every: 3, ..Settings::default() };
        let network = Arc::new(settings.read(&Nowhere).expect("it ships"));
        let mut it = BoxRegression::new(network, settings);
        let bytes = (0..80 * 60).map(|i| (i * 7 % 251) as u8).collect();
        let (image, extent) = (Image::new(80, 60, 1, bytes).expect("80 x 60"), Extent { half_w: 8.0, half_h: 10.0 });
        let state = State { x: 40.0, y: 30.0, ..State::default() };
        it.init_template(&image, &state, extent);
        let mut before = None;
        for frame in 0..7 {
            let mut meter = Meter::default();
            let moved = it.moved(&image, &state, extent, None);
            it.measure(&mut meter);
            assert_eq!(meter.pixels() > 0, frame % 3 == 0, "frame {frame}");
            assert!(frame % 3 == 0 || before == Some(moved), "frame {frame}");
            before = Some(moved);
        }
    }
}
