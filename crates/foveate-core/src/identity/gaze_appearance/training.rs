//! Looks to train the first layer by, while it tracks.

use super::{GazeAppearance, looks};
use crate::geometry::{Gaze, State};
use crate::identity::online::{LOOKS, Settings, Training};
use crate::identity::{Appearance, RbmEncoder};
use crate::scene::Image;
use foveate_base::{Error, Result};

impl GazeAppearance {
    /// Trains the first layer while tracking. Fails if it is not an RBM.
    pub fn training(self, settings: Option<Settings>) -> Result<Self> {
        let Some(settings) = settings else { return Ok(self) };
        let rbm = self
            .encoder
            .downcast::<RbmEncoder>()
            .ok_or_else(|| Error::Config("online_training: it trains an RBM, and the first layer is none".into()))?;
        Ok(Self { training: Some(Training::new(settings, rbm)), ..self })
    }

    /// Reads the target at the estimate, the template, and places beside the target, and takes a training step. The
    /// prepared frame may be dropped.
    pub(super) fn train(&mut self, image: &Image, state: &State, frame_deficit: f64) {
        let Some(mut training) = self.training.take() else { return };
        if frame_deficit <= training.settings().gate {
            let (extent, n_v) = (self.extent(), self.retina.glimpse_len());
            let (scale, shape) = (state.log_scale.exp(), state.shaped(extent));
            let at = |(u, v): (f64, f64)| State {
                x: state.x + u * scale * shape.half_w,
                y: state.y + v * scale * shape.half_h,
                ..*state
            };
            let offsets: Vec<(f64, f64)> = training.offsets().collect();
            let places: Vec<State> = offsets.iter().copied().map(at).collect();
            self.extend(image, &places, &[Gaze::CENTRE]);
            let rows = &mut training.looks;
            rows.resize((places.len() + LOOKS) * n_v, 0.0);
            let (target, rest) = rows.split_at_mut(LOOKS * n_v);
            let (first, beside) = rest.split_at_mut(LOOKS * n_v);
            let views = &self.buffers.views;
            for (place, row) in places.iter().zip(target.chunks_exact_mut(n_v).chain(beside.chunks_exact_mut(n_v))) {
                let view = views.of(place, Gaze::CENTRE, looks(&*self.retina, extent), self.colour.is_some());
                self.retina.look(&views.get(view).pyramid, place.fixate(Gaze::CENTRE, extent), row);
            }
            let kept = self.kept.as_ref().expect("a template is kept before the first look");
            let pyramid = self.template.get_or_insert_with(|| kept.pyramid(&*self.retina));
            for ((u, v), row) in offsets.iter().zip(first.chunks_exact_mut(n_v)) {
                self.retina.look(pyramid, kept.state.fixate(Gaze { u: *u, v: *v, arm: None }, extent), row);
            }
            rows.chunks_exact_mut(n_v).for_each(|row| self.encoder.condition(row));
            self.encoder = training.learn();
            self.scratch.template_gaze = None;
        }
        self.training = Some(training);
    }
}
