//! The default appearance: retina → encoder → distance to the first frame (section 3.1).
//!
//! The template is a frame and a state, not a table: τ(a) is one more row of every batch, so that a continuous
//! gaze costs nothing more. All particles of a gaze are encoded as one batch, in fixed chunks of rows that
//! threads share out; a row's result does not depend on its chunk.

#[cfg(feature = "threads")]
use rayon::prelude::*;
use std::sync::Arc;

use self::dim::dim;
use super::colour::Colour;
use super::dense::Dense;
use super::discriminant::Discriminant;
use super::distance::{Distance, Kind};
use super::encoder::Encoder;
use super::numbers;
#[cfg(feature = "learn")]
use super::online::Training;
use super::pyramid::Pyramid;
use super::retina::Retina;
use super::views::Looks;
use super::{Appearance, Buffers, Lesson, Memory, Percept, ReferenceLikelihood, TemplateSource};
use crate::geometry::{Extent, Fixation, Gaze, Size, State};
use crate::saved_state::SavedState;
use crate::scene::{Image, Meter};
use foveate_base::rng::Streams;
use foveate_base::rows::{Rows, RowsMut};
use foveate_base::{Error, Result};
use serde::{Deserialize, Serialize};

mod apart;
mod cues;
mod dim;
mod reference;
mod saved;
mod shared;
#[cfg(feature = "learn")]
mod training;

pub use super::calibrate::Sharpness;

/// Rows encoded at a time: whole blocks of the matrix product, few enough to stay in the second-level cache.
const CHUNK: usize = 48;

/// Retina, encoder, distance and a template.
pub struct GazeAppearance {
    /// The retina about the committed gaze.
    retina: Arc<dyn Retina>,
    /// The retina of the configuration.
    centred: Arc<dyn Retina>,
    /// The gaze that it is committed to: the centre at first.
    committed: Gaze,
    encoder: Arc<dyn Encoder>,
    distance: Kind,
    setting: Sharpness,
    discounting_background: f32,
    kept: Option<Template>,
    /// Of the kept picture, after a gaze other than the centre, or until it is compacted.
    template: Option<Pyramid>,
    moves: bool,
    scratch: Scratch,
    buffers: Buffers,
    dense: Option<Dense>,
    discriminant: Option<Discriminant>,
    colour: Option<Colour>,
    #[cfg(feature = "learn")]
    training: Option<Training>,
    /// Gazes move the sensor's window, and the retina stays at the centre.
    steady: bool,
}

foveate_base::opaque_debug!(GazeAppearance);

/// What `init_template` learned.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Template {
    /// The picture, or a part of it: from which pixel on, of a picture of which size.
    #[serde(with = "numbers::picture")]
    image: Image,
    origin: (usize, usize),
    size: Size,
    state: State,
    extent: Extent,
    sharpness: f64,
}

#[derive(Debug, Default)]
struct Scratch {
    template_glimpse: Vec<f32>,
    template: Vec<f32>,
    /// Of which gaze they are.
    template_gaze: Option<Gaze>,
}

impl GazeAppearance {
    /// Joins the parts. Fails if the encoder does not fit the retina.
    pub fn new(
        retina: Arc<dyn Retina>,
        encoder: Arc<dyn Encoder>,
        distance: Kind,
        sharpness: Sharpness,
    ) -> Result<Self> {
        let (n_v, n_h) = encoder.shape();
        if n_v != retina.glimpse_len() {
            return Err(Error::Config(format!(
                "the encoder takes {n_v} values, but the retina gives {}; use the retina the model was trained with \
                 (it is in the model file), or retrain with `foveate train`",
                retina.glimpse_len()
            )));
        }
        let scratch = Scratch { template_glimpse: vec![0.0; n_v], template: vec![0.0; n_h], ..Scratch::default() };
        Ok(Self {
            dense: Dense::new(&*retina, &*encoder),
            centred: retina.clone(),
            committed: Gaze::CENTRE,
            retina,
            encoder,
            distance,
            setting: sharpness,
            discounting_background: 0.0,
            kept: None,
            template: None,
            moves: false,
            scratch,
            buffers: Buffers::default(),
            discriminant: None,
            colour: None,
            #[cfg(feature = "learn")]
            training: None,
            steady: false,
        })
    }

    /// Takes this share (0 to 1) off whatever was already there in the first frame, pixel by pixel, before looking: for a
    /// fixed camera, what has not changed since then cannot be the target that has moved.
    ///
    /// Not in the paper, which finds its targets by motion but does not use the motion later. Without it a static thing
    /// beneath the target in the first frame, part of the template, holds the tracker back.
    pub fn with_background_discount(self, share: f32) -> Self {
        Self { discounting_background: share, ..self }
    }

    /// Nats per unit of distance in use; `None` before there is a template.
    pub fn sharpness(&self) -> Option<f64> {
        self.kept.as_ref().map(|k| k.sharpness)
    }

    fn kept(&self) -> &Template {
        self.kept.as_ref().expect("a template is kept before the first look")
    }

    fn extent(&self) -> Extent {
        self.kept.as_ref().map_or(Extent { half_w: 1.0, half_h: 1.0 }, |kept| kept.extent)
    }

    fn shape_distances(&mut self, view: usize, states: &[State], gaze: Gaze, out: &mut [f64]) {
        assert_eq!(states.len(), out.len(), "one distance a state");
        let (n_v, n_h) = self.encoder.shape();
        self.template_features(gaze);
        let (retina, encoder) = (&*self.retina, &*self.encoder);
        let (extent, weight) = (self.extent(), self.mixing().0);
        let distance = self.distance;
        let discriminant = self.discriminant.as_ref().and_then(|it| it.under(gaze));
        let Buffers { views, glimpses, features, .. } = &mut self.buffers;
        let pyramid = &views.get(view).pyramid;
        let template = &self.scratch.template[..];
        let judge = |h: &[f32]| match discriminant {
            Some(score) => {
                let (from_template, from_discriminant) = score.distances(h, distance, template);
                (1.0 - weight) * from_template + weight * from_discriminant
            }
            None => distance.distance(h, template),
        };
        if let Some(dense) = self.dense.as_mut().filter(|_| gaze == Gaze::CENTRE)
            && dense.look(pyramid, states, extent)
        {
            features.resize(features.len().max(n_h), 0.0);
            for (k, d) in out.iter_mut().enumerate() {
                dense.features(k, &mut features[..n_h]);
                *d = judge(&features[..n_h]);
            }
            return;
        }
        let one = |states: &[State], out: &mut [f64], glimpses: &mut [f32], features: &mut [f32]| {
            let glimpses = &mut glimpses[..states.len() * n_v];
            let features = &mut features[..states.len() * n_h];
            let mut at = [Fixation::default(); CHUNK];
            let at = &mut at[..states.len()];
            at.iter_mut().zip(states).for_each(|(at, state)| *at = state.fixate(gaze, extent));
            retina.look_each(pyramid, at, RowsMut::new(glimpses, n_v));
            glimpses.chunks_exact_mut(n_v).for_each(|glimpse| encoder.condition(glimpse));
            let glimpses = Rows::new(glimpses, n_v);
            if let Some(of_overlap) = distance.of_overlap().filter(|_| discriminant.is_none()) {
                let (mut totals, mut overlaps) = ([0.0; CHUNK], [0.0; CHUNK]);
                let (totals, overlaps) = (&mut totals[..states.len()], &mut overlaps[..states.len()]);
                if encoder.overlaps(glimpses, template, totals, overlaps) {
                    for ((total, overlap), d) in totals.iter().zip(&*overlaps).zip(out) {
                        *d = of_overlap(*total, *overlap);
                    }
                    return;
                }
            }
            encoder.encode(glimpses, RowsMut::new(features, n_h));
            features.chunks_exact(n_h).zip(out).for_each(|(h, d)| *d = judge(h));
        };
        #[cfg(feature = "threads")]
        if crate::threads::count() > 1 && states.len() > CHUNK {
            let all = states.len().div_ceil(CHUNK) * CHUNK;
            glimpses.resize(all * n_v, 0.0);
            features.resize(all * n_h, 0.0);
            states
                .par_chunks(CHUNK)
                .zip(out.par_chunks_mut(CHUNK))
                .zip(glimpses.par_chunks_mut(CHUNK * n_v))
                .zip(features.par_chunks_mut(CHUNK * n_h))
                .for_each(|(((states, out), glimpses), features)| one(states, out, glimpses, features));
            return;
        }
        glimpses.resize(CHUNK * n_v, 0.0);
        features.resize(CHUNK * n_h, 0.0);
        for (states, out) in states.chunks(CHUNK).zip(out.chunks_mut(CHUNK)) {
            one(states, out, glimpses, features);
        }
    }

    /// τ(a): encodes the template at a gaze into the scratch, unless it is there.
    fn template_features(&mut self, gaze: Gaze) {
        if self.scratch.template_gaze == Some(gaze) {
            return;
        }
        self.scratch.template_gaze = Some(gaze);
        self.moves |= gaze != Gaze::CENTRE;
        let kept = self.kept.as_ref().expect("a template is kept before the first look");
        let pyramid = self.template.get_or_insert_with(|| kept.pyramid(&*self.retina));
        let Scratch { template_glimpse, template, .. } = &mut self.scratch;
        self.retina.look(pyramid, kept.state.fixate(gaze, kept.extent), template_glimpse);
        self.encoder.condition(template_glimpse);
        let (n_v, n_h) = self.encoder.shape();
        self.encoder.encode(Rows::new(template_glimpse, n_v), RowsMut::new(template, n_h));
        self.distance.keep(template);
    }
}

fn looks(retina: &dyn Retina, extent: Extent) -> Looks<'_> {
    let footprints = retina.footprints();
    Looks { footprints, extent, reach: footprints.iter().map(|f| f.reach).fold(0.0, f64::max) }
}

impl Appearance for GazeAppearance {
    fn init_template(&mut self, image: &Image, state: &State, extent: Extent, streams: Streams) -> ReferenceLikelihood {
        #[cfg(feature = "learn")]
        if let Some(training) = &mut self.training {
            self.encoder = training.reset(streams);
        }
        self.recenter(Gaze::CENTRE);
        let (origin, size) = ((0, 0), image.size());
        self.keep(Template { image: image.clone(), origin, size, state: *state, extent, sharpness: 1.0 });
        if let Some(colour) = &mut self.colour {
            colour.init(image, state, extent);
        }
        self.init_reference(image, state, extent, streams, false)
    }

    fn prepare(&mut self, image: &Image, states: &[State], gazes: &[Gaze]) {
        let gazes = if self.steady { &[Gaze::CENTRE] } else { gazes };
        let looks = looks(&*self.retina, self.extent());
        if let Some(dense) = &mut self.dense {
            dense.of = None;
        }
        let kept = self.kept.as_ref().expect("a template is kept before the first look");
        let Buffers { views, dimmed, .. } = &mut self.buffers;
        let image = dim(image, &kept.image, self.discounting_background, dimmed);
        views.see(image, states, gazes, looks, self.colour.as_mut());
    }

    fn measure(&mut self, meter: &mut Meter) {
        self.buffers.views.measure(meter);
    }

    fn extend(&mut self, image: &Image, states: &[State], gazes: &[Gaze]) {
        let gazes = if self.steady { &[Gaze::CENTRE] } else { gazes };
        let looks = looks(&*self.retina, self.extent());
        // Pixels dimmed at the first look are still dimmed.
        let Buffers { views, dimmed, .. } = &mut self.buffers;
        views.see_more(dimmed.as_ref().unwrap_or(image), states, gazes, looks, self.colour.as_mut());
    }

    // Deviation: the paper prints exp(−d), without a sharpness; that tracks nothing.
    fn log_likelihood(&mut self, states: &[State], gaze: Gaze, out: &mut [f64]) {
        let sharpness = self.kept().sharpness;
        self.distances(states, if self.steady { Gaze::CENTRE } else { gaze }, out);
        out.iter_mut().for_each(|d| *d *= -sharpness);
    }

    fn glimpse(&mut self, state: &State, gaze: Gaze, percept: &mut Percept) {
        let (n_v, n_h) = self.encoder.shape();
        percept.gaze = gaze;
        let gaze = if self.steady { Gaze::CENTRE } else { gaze };
        self.template_features(gaze);
        percept.glimpse.resize(n_v, 0.0);
        percept.features.resize(n_h, 0.0);
        let extent = self.extent();
        let views = &self.buffers.views;
        let view = views.of(state, gaze, looks(&*self.retina, extent), self.colour.is_some());
        let view = views.get(view);
        self.retina.look(&view.pyramid, state.fixate(gaze, extent), &mut percept.glimpse);
        let conditioned = &mut self.scratch.template_glimpse;
        conditioned.copy_from_slice(&percept.glimpse);
        self.encoder.condition(conditioned);
        self.encoder.encode(Rows::new(conditioned, n_v), RowsMut::new(&mut percept.features, n_h));
        percept.distance = self.distance.distance(&percept.features, &self.scratch.template);
        let colour = |colour: &Colour| colour.trust() * colour.distance(&view.sums, state, extent);
        percept.colour = self.colour.as_ref().map_or(0.0, colour);
    }

    fn colour_distances(&mut self, image: &Image, states: &[State], out: &mut [f64]) -> bool {
        let extent = self.extent();
        self.colour.as_mut().is_some_and(|colour| colour.broad_distances(image, states, extent, out))
    }

    fn width(&self) -> usize {
        self.encoder.shape().1
    }

    fn features(&mut self, states: &[State], rows: &mut Vec<f32>) {
        self.look_at_each(states, rows);
    }

    fn committed_gaze(&self) -> Gaze {
        self.committed
    }

    fn commit_gaze(&mut self, gaze: Gaze, streams: Streams) -> Option<ReferenceLikelihood> {
        self.commit(gaze, streams)
    }

    fn memory(&mut self) -> Option<&mut dyn Memory> {
        #[cfg(feature = "learn")]
        if self.training.is_some() {
            return Some(self);
        }
        (self.discriminant.is_some() || self.colour.is_some()).then_some(self as &mut dyn Memory)
    }

    fn template_source(&self) -> Option<TemplateSource<'_>> {
        let Template { image, origin, state, extent, .. } = self.kept.as_ref()?;
        Some(TemplateSource { image, origin: *origin, state, extent: *extent })
    }

    fn exchange(&mut self, buffers: &mut Buffers) {
        self.exchange_all(buffers);
    }

    fn compact(&mut self) {
        self.free();
    }

    fn save(&self) -> SavedState {
        self.to_saved()
    }

    fn load(&mut self, saved: &SavedState) -> Result<()> {
        self.take_up(saved)
    }
}

impl Memory for GazeAppearance {
    fn learn(&mut self, image: &Image, state: &State, distractors: &[State], lesson: Lesson) {
        self.take(image, state, distractors, lesson);
    }

    fn forget(&mut self) {
        if let Some(discriminant) = &mut self.discriminant {
            discriminant.restart();
        }
        if let Some(colour) = &mut self.colour {
            colour.restart();
        }
    }

    fn init_distractors(&mut self, image: &Image, state: &State, distractors: &[State]) {
        // What other gazes and later frames have taught stays.
        if self.discriminant.as_ref().is_some_and(|it| it.gazes().is_empty()) {
            self.learn_first(image, state, distractors);
        }
    }
}

#[cfg(all(test, feature = "learn"))]
mod tests;
