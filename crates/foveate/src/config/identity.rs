//! The first layers by name, with the retinas that their models were trained with.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{Config, EncoderConfig, RetinaConfig};
use crate::autoencoder::Autoencoder;
use crate::identity::convolution::ConvolutionEncoder;
use crate::identity::encoder::{Encoder, Raw, RbmEncoder};
use crate::identity::factored::FactoredEncoder;
use crate::identity::oriented::Oriented;
use crate::identity::retina::{Foveal, FovealConfig, Retina};
use crate::kmeans::KMeans;
use crate::rbm::factored::FactoredRbm;
use crate::rbm::{Metadata, Rbm};
use crate::{Error, Result};

impl Config {
    /// The retina and the first layer, of model files relative to `base`.
    pub fn identity(&self, base: &Path) -> Result<(Foveal, Arc<dyn Encoder>)> {
        let given = self.retina.as_ref().map(|RetinaConfig::Foveal(config)| config.clone());
        first_layer(&self.encoder, given, base)
    }
}

/// A first layer with the retina it was trained on, which is the given one where one is given.
pub(super) fn first_layer(
    encoder: &EncoderConfig,
    given: Option<FovealConfig>,
    base: &Path,
) -> Result<(Foveal, Arc<dyn Encoder>)> {
    match encoder {
        EncoderConfig::Oriented { weights } => {
            let config = given.ok_or_else(|| {
                Error::Config("an oriented encoder needs a retina; for example [retina] kind = \"foveal\", side = 16, rings = [[18, 1]], colour = [[16, 4]]".into())
            })?;
            let retina = Foveal::new(config)?;
            let encoder = Oriented::new(&channels(&retina), *weights)?;
            Ok((retina, Arc::new(encoder)))
        }
        EncoderConfig::Raw { standardise } => {
            let config = given.ok_or_else(|| {
                    Error::Config("a raw encoder needs a retina; for example [retina] kind = \"foveal\", side = 28, rings = [[8, 1], [16, 2], [24, 4]]".into())
                })?;
            let retina = Foveal::new(config)?;
            let encoder = Raw::new(&channels(&retina), *standardise);
            Ok((retina, Arc::new(encoder)))
        }
        EncoderConfig::Rbm { weights, precision } => {
            let (rbm, metadata) = model(weights, base, Rbm::from_bytes, Rbm::load)?;
            let retina = trained_retina(weights, &metadata, given, "rbm")?;
            let encoder = RbmEncoder::new(rbm, &channels(&retina)).rounded(*precision);
            Ok((retina, Arc::new(encoder)))
        }
        EncoderConfig::Autoencoder { weights, precision } => {
            let (model, metadata) = model(weights, base, Autoencoder::from_bytes, Autoencoder::load)?;
            let retina = trained_retina(weights, &metadata, given, "autoencoder")?;
            let encoder = RbmEncoder::new(model.layer().clone(), &channels(&retina)).rounded(*precision);
            Ok((retina, Arc::new(encoder)))
        }
        EncoderConfig::Mcrbm { weights, units } => {
            let (rbm, metadata) = model(weights, base, FactoredRbm::from_bytes, FactoredRbm::load)?;
            let retina = trained_retina(weights, &metadata, given, "mcrbm")?;
            let encoder = FactoredEncoder::new(rbm, *units, &channels(&retina));
            Ok((retina, Arc::new(encoder)))
        }
        EncoderConfig::Kmeans { weights, pool, threshold } => {
            let (model, metadata) = model(weights, base, KMeans::from_bytes, KMeans::load)?;
            let retina = match given {
                Some(config) => Foveal::new(config)?,
                None => trained_retina(weights, &metadata, None, "kmeans")?,
            };
            let encoder = ConvolutionEncoder::new(&model, retina.cells(), *pool, *threshold)?;
            Ok((retina, Arc::new(encoder)))
        }
    }
}

/// The retina that a model was trained with; a configuration may ask for no other.
fn trained_retina(weights: &str, metadata: &Metadata, given: Option<FovealConfig>, kind: &str) -> Result<Foveal> {
    let trained: FovealConfig = serde_json::from_str(&metadata.retina).map_err(|e| {
        Error::malformed(
            weights,
            format!("its metadata does not describe a retina ({e}); retrain it with `foveate train {kind}`"),
        )
    })?;
    if given.is_some_and(|g| g != trained) {
        return Err(Error::Config(format!(
            "{weights} was trained with the retina {}, but the configuration asks for another; leave out [retina], or retrain",
            metadata.retina
        )));
    }
    Foveal::new(trained)
}

fn channels(retina: &Foveal) -> Vec<usize> {
    retina.cells().iter().map(|c| c.channel).collect()
}

/// A model and what its file says of it.
type Read<M> = Result<(M, Metadata)>;

/// A model of some kind: one that ships with the program, or a file relative to `base`.
fn model<M>(
    weights: &str,
    base: &Path,
    from_bytes: fn(&[u8], &Path) -> Read<M>,
    load: fn(&Path) -> Read<M>,
) -> Read<M> {
    match weights.strip_prefix("builtin:") {
        Some(name) => {
            let bytes = MODELS.iter().find(|m| m.0 == name).map(|m| m.1).ok_or_else(|| {
                let names: Vec<&str> = MODELS.iter().map(|m| m.0).collect();
                Error::Config(format!(
                    "no model is called builtin:{name}; there are builtin:{}",
                    names.join(", builtin:")
                ))
            })?;
            from_bytes(bytes, Path::new(weights))
        }
        None => load(&base.join(PathBuf::from(weights))),
    }
}

/// Models that ship with the program.
const MODELS: &[(&str, &[u8])] = &[
    ("digits", include_bytes!("../../../../models/digits.safetensors")),
    ("natural", include_bytes!("../../../../models/natural.safetensors")),
    ("natural-mcrbm", include_bytes!("../../../../models/natural-mcrbm.safetensors")),
    ("natural-autoencoder", include_bytes!("../../../../models/natural-autoencoder.safetensors")),
    ("natural-kmeans", include_bytes!("../../../../models/natural-kmeans.safetensors")),
];
