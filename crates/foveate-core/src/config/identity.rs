//! The first layers by name, with the retinas that their models were trained with.

use std::path::Path;
use std::sync::Arc;

use super::encoders::EncoderConfig;
use super::parts::EncoderSite;
use super::places::Places;
use super::{Config, RetinaConfig};
use crate::identity::encoder::{Encoder, Raw};
use crate::identity::oriented::Oriented;
use crate::identity::retina::{Foveal, FovealConfig};
use foveate_base::files::Files;
use foveate_base::{Error, Result};

impl Config {
    /// The retina and the first layer, of model files from `files`.
    pub fn identity(&self, files: &dyn Files) -> Result<(Foveal, Arc<dyn Encoder>)> {
        let given = self.retina.as_ref().map(|RetinaConfig::Foveal(config)| config.clone());
        let places = (files, Path::new(""));
        match &self.encoder {
            EncoderConfig::Own(part) => self.parts.encoder(part, &EncoderSite::new(given, files, places.1)),
            builtin => first_layer(builtin, given, places),
        }
    }
}

/// A first layer with the retina it was trained on, which is the given one where one is given.
pub(super) fn first_layer(
    encoder: &EncoderConfig,
    given: Option<FovealConfig>,
    places: Places<'_>,
) -> Result<(Foveal, Arc<dyn Encoder>)> {
    match encoder {
        EncoderConfig::Own(part) => Err(Error::Config(format!("encoder.kind: `{}` cannot be used here", part.kind()))),
        EncoderConfig::Onnx { model, planes, mean, std } => {
            super::onnx::first_layer(model, *planes, (mean, std), given, places)
        }
        EncoderConfig::Oriented { weights } => {
            let config = given.ok_or_else(|| {
                Error::Config("an oriented encoder needs a retina; for example [retina] kind = \"foveal\", side = 16, rings = [[18, 1]], colour = [[16, 4]]".into())
            })?;
            let retina = Foveal::new(config)?;
            let encoder = Oriented::new(&retina.channels(), *weights)?;
            Ok((retina, Arc::new(encoder)))
        }
        EncoderConfig::Raw { standardise } => {
            let config = given.ok_or_else(|| {
                    Error::Config("a raw encoder needs a retina; for example [retina] kind = \"foveal\", side = 28, rings = [[8, 1], [16, 2], [24, 4]]".into())
                })?;
            let retina = Foveal::new(config)?;
            let encoder = Raw::new(&retina.channels(), *standardise);
            Ok((retina, Arc::new(encoder)))
        }
        #[cfg(feature = "learn")]
        learned => super::learned::first_layer(learned, given, places),
    }
}
