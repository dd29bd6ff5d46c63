//! Template matching: the box is sampled at 8 × 8 places, standardised, and compared with the first frame.

use foveate::extend::{
    Appearance, Extent, Gaze, Purpose, ReferenceLikelihood, SavedState, State, Streams, standardise,
};
use foveate::{Error, Image, Result};
use serde::{Deserialize, Serialize};

/// Places along a side of the box.
const SIDE: usize = 8;
type Samples = [f32; SIDE * SIDE];

/// The keys of `[observation_model]` beside `kind`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Nats by which two unrelated patches differ, above 0 to 1000.
    sharpness: f64,
}

/// A grey picture.
#[derive(Clone, Default, PartialEq, Serialize, Deserialize)]
struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl Picture {
    fn copy(&mut self, image: &Image) {
        (self.width, self.height) = (image.width(), image.height());
        self.pixels.clear();
        self.pixels.extend_from_slice(image.plane(0));
    }
    /// The samples of a box with its centre at a gaze, nearest pixels.
    fn sample(&self, state: &State, gaze: Gaze, extent: Extent) -> Samples {
        let (half_w, half_h) = state.half(extent);
        let step = |k: usize| (k as f64 + 0.5) / (SIDE as f64 / 2.0) - 1.0;
        let pixel = |at: f64, side: usize| at.round().clamp(0.0, (side - 1) as f64) as usize;
        let mut samples = std::array::from_fn(|k| {
            let x = pixel(state.x + (gaze.u + step(k % SIDE)) * half_w, self.width);
            let y = pixel(state.y + (gaze.v + step(k / SIDE)) * half_h, self.height);
            f32::from(self.pixels[y * self.width + x]) / 255.0
        });
        standardise(&mut samples);
        samples
    }
}

/// The target in the first frame: all that is learned.
#[derive(Clone, PartialEq, Serialize, Deserialize)]
struct Template {
    picture: Picture,
    state: [f64; State::N],
    half: [f64; 2],
}

pub struct Patch {
    sharpness: f64,
    template: Option<Template>,
    now: Picture,
}

impl Patch {
    pub fn new(settings: Settings) -> Result<Self> {
        if !(settings.sharpness > 0.0 && settings.sharpness <= 1000.0) {
            let why = format!("observation_model.sharpness is above 0 to 1000; it is {}", settings.sharpness);
            return Err(Error::Config(why));
        }
        Ok(Self { sharpness: settings.sharpness, template: None, now: Picture::default() })
    }
}

impl Appearance for Patch {
    fn init_template(&mut self, image: &Image, state: &State, extent: Extent, streams: Streams) -> ReferenceLikelihood {
        self.now.copy(image);
        let half = [extent.half_w, extent.half_h];
        self.template = Some(Template { picture: self.now.clone(), state: state.to_array(), half });
        // About a pixel off the target, and at the most similar of 100 other places: P(lost) compares later evidence with these.
        let mut rng = streams.at(0, Purpose::Calibrate).rng(0);
        let near = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)];
        let near = near.map(|(x, y)| State { x: state.x + x, y: state.y + y, ..*state });
        let (w, h) = (image.width() as f64, image.height() as f64);
        let far: Vec<State> = (0..100)
            .map(|_| State { x: w * rng.uniform(), y: h * rng.uniform(), ..*state })
            .filter(|it| (it.x - state.x).abs() > half[0] || (it.y - state.y).abs() > half[1])
            .collect();
        let (mut on, mut off) = ([0.0; 4], vec![0.0; far.len()]);
        self.log_likelihood(&near, Gaze::CENTRE, &mut on);
        self.log_likelihood(&far, Gaze::CENTRE, &mut off);
        let on = on.iter().sum::<f64>() / 4.0;
        let off = off.into_iter().fold(-2.0 * self.sharpness, f64::max);
        ReferenceLikelihood { on, off: off.min(on) }
    }
    fn prepare(&mut self, image: &Image, _: &[State], _: &[Gaze]) {
        self.now.copy(image);
    }
    fn log_likelihood(&mut self, states: &[State], gaze: Gaze, out: &mut [f64]) {
        let template = self.template.as_ref().expect("a template is kept before any look");
        let extent = Extent { half_w: template.half[0], half_h: template.half[1] };
        let kept = template.picture.sample(&State::from_array(template.state), gaze, extent);
        for (state, out) in states.iter().zip(out) {
            let seen = self.now.sample(state, gaze, extent);
            let square: f32 = seen.iter().zip(&kept).map(|(a, b)| (a - b).powi(2)).sum();
            *out = -self.sharpness * f64::from(square) / (2.0 * kept.len() as f64);
        }
    }
    fn save(&self) -> SavedState {
        SavedState::new(&self.template)
    }
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        let template: Option<Template> = saved.read()?;
        let whole =
            |t: &Template| !t.picture.pixels.is_empty() && t.picture.pixels.len() == t.picture.width * t.picture.height;
        if !template.as_ref().is_none_or(whole) {
            return Err(Error::Invalid("patch: the saved template is not a whole picture".into()));
        }
        self.template = template;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate::extend::conformance;

    #[test]
    fn the_law_of_observation_models_holds() {
        conformance::appearance(&|| Box::new(Patch::new(Settings { sharpness: 20.0 }).expect("settings in range")));
    }
}
