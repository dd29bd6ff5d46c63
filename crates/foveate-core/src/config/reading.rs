//! Recognisers from their model files.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::identity::first_layer;
use super::parts::Parts;
use super::policies::{PolicyConfig, policy};
use super::ranges::Ranges;
use super::{Blueprint, RecogniserConfig};
use crate::gaze::{Fixed, Policy, Random};
use crate::geometry::Gaze;
use crate::identity::accumulate::Accumulate;
use crate::identity::encoder::Encoder;
use crate::identity::retina::{Foveal, FovealConfig};
use crate::identity::{Classifier, MultiFixation, Recognizer, Retina};
use crate::recognition::Recognition;
use crate::tree::Node;
use foveate_base::files::Files;
use foveate_base::{Error, Result};
use foveate_learn::rbm::fixations::FixationRbm;

/// Recognisers that ship with the program: names after `builtin:`, and model files.
pub const RECOGNISERS: &[(&str, &[u8])] = &[("digits", include_bytes!("../../models/digits-fixations.safetensors"))];

/// A recogniser read from its file.
#[derive(Clone)]
pub(super) struct Recogniser {
    retina: Arc<Foveal>,
    encoder: Option<Arc<dyn Encoder>>,
    machine: Machine,
    accumulate: Accumulate,
    policy: Option<PolicyConfig>,
    alarm: bool,
    parts: Parts,
}

#[derive(Clone)]
enum Machine {
    Fixations(MultiFixation),
    Classifier(Classifier),
}

impl RecogniserConfig {
    /// Reads the model, and the first layer, whose place is relative to the model's.
    pub(super) fn read(&self, files: &dyn Files, parts: &Parts) -> Result<Recogniser> {
        let (weights, accumulate, policy, alarm) = match self {
            Self::MultiFixation { weights, accumulate, policy, alarm } => (weights, accumulate, policy.clone(), *alarm),
            Self::Classifier { weights, accumulate } => (weights, accumulate, None, false),
        };
        let path = PathBuf::from(weights);
        let mut beside = path.parent().map(PathBuf::from).unwrap_or_default();
        let (machine, metadata, layer) = match (self, weights.strip_prefix("builtin:")) {
            (Self::Classifier { .. }, _) => {
                let (machine, about) = Classifier::from_bytes(&files.read(&path)?, &path)?;
                (Machine::Classifier(machine), about.metadata, about.first_layer)
            }
            (Self::MultiFixation { .. }, Some(name)) => {
                let bytes =
                    RECOGNISERS.iter().find(|m| m.0 == name).map(|m| m.1).ok_or_else(|| none_of_that_name(name))?;
                let (rbm, about) = FixationRbm::from_bytes(bytes, Path::new(weights))?;
                // All that ship were trained on digits alone, and have digits as classes.
                let names = (0..rbm.classes()).map(|digit| format!("digit {digit}")).collect();
                let machine = MultiFixation::new(Arc::new(rbm), None, about.temperature.into())?.named(names);
                beside = PathBuf::new();
                (Machine::Fixations(machine), about.metadata, about.first_layer)
            }
            (Self::MultiFixation { .. }, None) => {
                let (machine, about) = MultiFixation::read(files, &path)?;
                (Machine::Fixations(machine), about.metadata, about.first_layer)
            }
        };
        let unclear = |what: &str, e: String| {
            let problem = format!("it has no {what} of its training ({e}); train it again");
            Error::malformed(Path::new(weights), problem)
        };
        let config: FovealConfig = Node::read_json(&metadata.retina).map_err(|e| unclear("retina", e))?;
        let (retina, encoder) = if layer.is_empty() {
            (Foveal::new(config)?, None)
        } else {
            let layer = Node::read_json(&layer).map_err(|e| unclear("first layer", e))?;
            let (retina, encoder) = first_layer(&layer, Some(config), (files, &beside))?;
            (retina, Some(encoder))
        };
        let (retina, accumulate, parts) = (Arc::new(retina), *accumulate, parts.clone());
        let read = Recogniser { retina, encoder, machine, accumulate, policy, alarm, parts };
        read.recognition().map_err(|e| Error::Config(format!("{weights}: {e}")))?;
        Ok(read)
    }
}

impl Blueprint {
    /// The same, with this recogniser in the place of its own; its model comes from `files`. The track stays the
    /// same.
    pub fn with_recogniser(mut self, config: RecogniserConfig, files: &dyn Files) -> Result<Self> {
        config.ranges()?;
        self.recogniser = Some(config.read(files, &self.config.parts)?);
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
    /// The part of a tracker that uses it.
    pub(super) fn recognition(&self) -> Result<Recognition> {
        let policy: Box<dyn Policy> = match (&self.policy, &self.machine) {
            (Some(config), _) => policy(config, &self.parts)?,
            (None, Machine::Fixations(machine)) => {
                let places = machine.rbm().places().points().iter().enumerate();
                let gaze = |(k, at): (usize, &[f32; 2])| Gaze { u: at[0].into(), v: at[1].into(), arm: Some(k) };
                Box::new(Random::new(places.map(gaze).collect()))
            }
            (None, Machine::Classifier(_)) => Box::new(Fixed::new(Gaze::CENTRE)),
        };
        let (retina, machine): (Arc<dyn Retina>, Box<dyn Recognizer>) = (
            self.retina.clone(),
            match &self.machine {
                Machine::Fixations(machine) => Box::new(machine.clone()),
                Machine::Classifier(machine) => Box::new(machine.clone()),
            },
        );
        let recognition = Recognition::new(retina, self.encoder.clone(), machine, policy, self.accumulate)?;
        if self.alarm { recognition.with_alarm() } else { Ok(recognition) }
    }
}
