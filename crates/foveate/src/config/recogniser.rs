//! Names → recognisers.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::identity::first_layer;
use super::policies::policy;
use super::ranges::Ranges;
use super::{Blueprint, PolicyConfig};
use crate::gaze::{Policy, Random};
use crate::geometry::Gaze;
use crate::identity::accumulate::Accumulate;
use crate::identity::encoder::Encoder;
use crate::identity::retina::{Foveal, FovealConfig};
use crate::identity::{MultiFixation, Retina};
use crate::rbm::fixations::FixationRbm;
use crate::recognition::Recognition;
use crate::{Error, Result};

/// The recognisers there are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum RecogniserConfig {
    /// A multi-fixation RBM over the last few looks (section 2.2), with the retina and first layer it was trained on.
    MultiFixation {
        /// A model file of `foveate train fixations`, or `builtin:` and the name of one that ships with the program.
        weights: String,
        /// How frames add up.
        #[serde(default)]
        accumulate: Accumulate,
        /// Where it looks; left out, at random among the places it was trained at.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        policy: Option<PolicyConfig>,
        /// Whether a class that is no longer seen means that the target is lost; without it, the track is the same as without a
        /// recogniser.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        alarm: bool,
    },
}

/// Recognisers that ship with the program: names after `builtin:`, and model files.
pub const RECOGNISERS: &[(&str, &[u8])] =
    &[("digits", include_bytes!("../../../../models/digits-fixations.safetensors"))];

/// A recogniser read from its file.
#[derive(Clone)]
pub(super) struct Recogniser {
    retina: Arc<Foveal>,
    encoder: Option<Arc<dyn Encoder>>,
    machine: MultiFixation,
    accumulate: Accumulate,
    policy: Option<PolicyConfig>,
    alarm: bool,
}

impl RecogniserConfig {
    /// This model, summing log-probabilities, looking at random among its places.
    pub fn multi_fixation(weights: impl Into<String>) -> Self {
        Self::MultiFixation { weights: weights.into(), accumulate: Accumulate::Sum, policy: None, alarm: false }
    }

    /// Reads the model, whose place is relative to `base`, and the first layer, whose place is relative to the model's.
    pub(super) fn read(&self, base: &Path) -> Result<Recogniser> {
        let Self::MultiFixation { weights, accumulate, policy, alarm } = self;
        let ((machine, about), beside) = match weights.strip_prefix("builtin:") {
            Some(name) => {
                let bytes =
                    RECOGNISERS.iter().find(|m| m.0 == name).map(|m| m.1).ok_or_else(|| none_of_that_name(name))?;
                let (rbm, about) = FixationRbm::from_bytes(bytes, Path::new(weights))?;
                let temperature = about.temperature.into();
                ((MultiFixation::new(Arc::new(rbm), None, temperature)?, about), PathBuf::new())
            }
            None => {
                let path = base.join(weights);
                (MultiFixation::load(&path)?, path.parent().map(PathBuf::from).unwrap_or_default())
            }
        };
        let unclear = |what: &str, e: serde_json::Error| {
            let problem = format!(
                "it does not say what {what} it was trained with ({e}); train it with `foveate train fixations`"
            );
            Error::malformed(Path::new(weights), problem)
        };
        let config: FovealConfig = serde_json::from_str(&about.metadata.retina).map_err(|e| unclear("retina", e))?;
        let (retina, encoder) = if about.first_layer.is_empty() {
            (Foveal::new(config)?, None)
        } else {
            let layer = serde_json::from_str(&about.first_layer).map_err(|e| unclear("first layer", e))?;
            let (retina, encoder) = first_layer(&layer, Some(config), &beside)?;
            (retina, Some(encoder))
        };
        let (retina, policy) = (Arc::new(retina), policy.clone());
        let read = Recogniser { retina, encoder, machine, accumulate: *accumulate, policy, alarm: *alarm };
        read.recognition().map_err(|e| Error::Config(format!("{weights}: {e}")))?;
        Ok(read)
    }
}

impl Blueprint {
    /// The same, with this recogniser in the place of its own; its model's file is relative to `base`. The track stays the
    /// same.
    pub fn recognising(mut self, config: RecogniserConfig, base: &Path) -> Result<Self> {
        config.ranges()?;
        self.recogniser = Some(config.read(base)?);
        self.config.recogniser = Some(config);
        Ok(self)
    }
}

fn none_of_that_name(name: &str) -> Error {
    let names: Vec<String> = RECOGNISERS.iter().map(|m| format!("builtin:{}", m.0)).collect();
    let there = names.join(", ");
    Error::Config(format!(
        "no recogniser is called builtin:{name}; there is {there}; `foveate train fixations` makes others, to be given by its file's name"
    ))
}

impl Recogniser {
    /// What a tracker has of it.
    pub(super) fn recognition(&self) -> Result<Recognition> {
        let policy: Box<dyn Policy> = match &self.policy {
            Some(config) => policy(config)?,
            None => {
                let places = self.machine.rbm().places().points().iter().enumerate();
                let gaze = |(k, at): (usize, &[f32; 2])| Gaze { u: at[0].into(), v: at[1].into(), arm: Some(k) };
                Box::new(Random::new(places.map(gaze).collect()))
            }
        };
        let retina: Arc<dyn Retina> = self.retina.clone();
        let machine = Box::new(self.machine.clone());
        let recognition = Recognition::new(retina, self.encoder.clone(), machine, policy, self.accumulate)?;
        if self.alarm { recognition.alarming() } else { Ok(recognition) }
    }
}

impl Ranges for RecogniserConfig {
    fn ranges(&self) -> Result<()> {
        let Self::MultiFixation { accumulate, policy, .. } = self;
        accumulate.check()?;
        policy.as_ref().map_or(Ok(()), Ranges::ranges)
    }
}

impl Ranges for Option<RecogniserConfig> {
    fn ranges(&self) -> Result<()> {
        self.as_ref().map_or(Ok(()), Ranges::ranges)
    }
}
