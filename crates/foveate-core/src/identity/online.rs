//! Trains the first layer while tracking (section 7, future work): settings, and the machine with its encoder.
//!
//! Rows are looks at the target: nine in the newest frame, at the estimate and about it, and the same nine in the first frame, so that
//! the template stays represented. Several particles are compared by eight looks at places beside the target.

use std::borrow::Cow;
use std::sync::Arc;

use foveate_base::Result;
use foveate_base::rng::{Purpose, Streams};
use foveate_base::rows::Rows;
use foveate_learn::rbm::online::{self, Particle};
use foveate_learn::rbm::{OnlineRbm, Rbm};
use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::encoder::Encoder;
use super::numbers::floats;
use super::rbm_encoder::RbmEncoder;
use crate::saved_state::SavedState;

foveate_base::settings! {
    /// Settings of training while tracking. It needs an RBM as the first layer.
    #[derive(Copy)]
    pub struct Settings in "online_training" {
        /// Number of RBMs, 1 to 64: 1 follows the stochastic gradient, several are particles of a filter over the parameters.
        pub particles: usize = 1; 1.0 to 64.0,
        /// Step along the mean gradient of a frame's looks, 0 to 1.
        pub learning_rate: f32 = 0.001; 0.0 to 1.0,
        /// Standard deviation of the noise on the hidden biases in a frame, for several particles, 0 to 1.
        pub noise: f32 = 0.01; 0.0 to 1.0,
        /// Largest distance of looks at the target from the estimate, template units, 0 to 1.
        pub reach: f64 = 0.1; 0.0 to 1.0,
        /// Evidence deficit above which a frame is not learned, 0 to 2.
        pub gate: f64 = 0.5; 0.0 to 2.0,
    }
}

/// Offsets along a side of a grid of looks, in steps: of `reach` at the target, of [`BESIDE`] about it.
const ABOUT: [f64; 3] = [-1.0, 0.0, 1.0];
/// Looks at the target in a frame.
pub(super) const LOOKS: usize = 9;
/// How far looks beside the target are from it, template units.
const BESIDE: f64 = 1.5;

/// An RBM that is trained while it tracks.
pub(super) struct Training {
    settings: Settings,
    pretrained: RbmEncoder,
    /// Names its random numbers.
    seed: u64,
    rbm: OnlineRbm,
    /// Looks at the target, now and in the first frame, and looks beside it.
    pub looks: Vec<f32>,
}

impl Training {
    /// Starts from a pretrained encoder.
    pub(super) fn new(settings: Settings, pretrained: &RbmEncoder) -> Self {
        Self { settings, pretrained: pretrained.clone(), seed: 0, rbm: begin(settings, pretrained, 0), looks: vec![] }
    }

    pub(super) fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Offsets of looks from the target, template units: nine at it, then eight beside it.
    pub(super) fn offsets(&self) -> impl Iterator<Item = (f64, f64)> {
        let grid = |step: f64| ABOUT.into_iter().flat_map(move |v| ABOUT.map(|u| (step * u, step * v)));
        grid(self.settings.reach).chain(grid(BESIDE).filter(|at| *at != (0.0, 0.0)))
    }

    /// Resets the machine to its pretrained state.
    pub(super) fn reset(&mut self, streams: Streams) -> Arc<dyn Encoder> {
        self.seed = streams.at(0, Purpose::Train).rng(0).random();
        self.rbm = begin(self.settings, &self.pretrained, self.seed);
        Arc::new(self.pretrained.clone())
    }

    /// One step along the looks.
    pub(super) fn learn(&mut self) -> Arc<dyn Encoder> {
        let (n_v, _) = self.pretrained.shape();
        let (target, beside) = self.looks.split_at(2 * LOOKS * n_v);
        self.rbm.learn(Rows::new(target, n_v), Rows::new(beside, n_v));
        self.encoder()
    }

    fn encoder(&self) -> Arc<dyn Encoder> {
        Arc::new(self.pretrained.with(self.rbm.mean()))
    }

    /// The learned machine.
    pub(super) fn save(&self) -> SavedState {
        let (steps, particles) = self.rbm.particles();
        let particles = particles.iter().map(|Particle { rbm, log_weight }| SavedParticle {
            weights: rbm.weights().data().into(),
            visible_bias: rbm.visible_bias().into(),
            hidden_bias: rbm.hidden_bias().into(),
            log_weight: *log_weight,
        });
        SavedState::new(&Saved { seed: self.seed, steps, particles: particles.collect() })
    }

    /// Takes up what `save` gave.
    pub(super) fn load(&mut self, saved: &SavedState) -> Result<Arc<dyn Encoder>> {
        let Saved { seed, steps, particles }: Saved<'_> = saved.read()?;
        let particle =
            |SavedParticle { weights: w, visible_bias: b, hidden_bias: c, log_weight }: SavedParticle<'_>| {
                let rbm = Rbm::new(self.pretrained.rbm().visible(), w.into_owned(), b.into_owned(), c.into_owned())?;
                Ok(Particle { rbm, log_weight })
            };
        let particles = particles.into_iter().map(particle).collect::<Result<Vec<_>>>()?;
        let mut rbm = begin(self.settings, &self.pretrained, seed);
        rbm.resume(steps, particles)?;
        (self.seed, self.rbm) = (seed, rbm);
        // As `reset`: the mean of equal machines is rounded.
        Ok(if steps == 0 { Arc::new(self.pretrained.clone()) } else { self.encoder() })
    }
}

fn begin(settings: Settings, pretrained: &RbmEncoder, seed: u64) -> OnlineRbm {
    let Settings { particles, learning_rate, noise, .. } = settings;
    let settings = online::Settings { particles, learning_rate, noise };
    OnlineRbm::new(pretrained.rbm().clone(), settings, Streams::new(seed, 0))
}

#[derive(Serialize, Deserialize)]
struct Saved<'a> {
    seed: u64,
    steps: u64,
    particles: Vec<SavedParticle<'a>>,
}

#[derive(Serialize, Deserialize)]
struct SavedParticle<'a> {
    #[serde(with = "floats")]
    weights: Cow<'a, [f32]>,
    #[serde(with = "floats")]
    visible_bias: Cow<'a, [f32]>,
    #[serde(with = "floats")]
    hidden_bias: Cow<'a, [f32]>,
    log_weight: f64,
}
