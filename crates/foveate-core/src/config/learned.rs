//! First layers with learned weights by name, with the retinas that their models were trained with.

use std::path::Path;
use std::sync::Arc;

use super::EncoderConfig;
use super::places::Places;
use crate::identity::convolution::ConvolutionEncoder;
use crate::identity::encoder::Encoder;
use crate::identity::rbm_encoder::RbmEncoder;
use crate::identity::retina::{Foveal, FovealConfig, Retina};
use crate::tree::Node;
use foveate_base::{Error, Result};
use foveate_learn::filters::PatchFilters;
use foveate_learn::rbm::io::command;
use foveate_learn::rbm::{Metadata, Rbm};

/// A first layer with the retina it was trained on, which is the given one where one is given.
pub(super) fn first_layer(
    encoder: &EncoderConfig,
    given: Option<FovealConfig>,
    places: Places<'_>,
) -> Result<(Foveal, Arc<dyn Encoder>)> {
    match encoder {
        EncoderConfig::Rbm { weights, precision } => {
            let (rbm, metadata) = model(weights, places, Rbm::from_bytes)?;
            let retina = trained_retina(weights, &metadata, given, "rbm")?;
            let encoder = RbmEncoder::new(rbm, &retina.channels()).rounded(*precision);
            Ok((retina, Arc::new(encoder)))
        }
        EncoderConfig::Kmeans { weights, pool, threshold } => convolution(weights, given, places, (*pool, *threshold)),
        EncoderConfig::Onnx { .. }
        | EncoderConfig::Oriented { .. }
        | EncoderConfig::Raw { .. }
        | EncoderConfig::Own(_) => {
            unreachable!("these were made before the learned ones")
        }
    }
}

/// Filters, convolved with the rings of any retina.
fn convolution(
    weights: &str,
    given: Option<FovealConfig>,
    places: Places<'_>,
    (pool, threshold): (usize, f32),
) -> Result<(Foveal, Arc<dyn Encoder>)> {
    let (model, metadata) = model(weights, places, PatchFilters::from_bytes)?;
    let retina = match given {
        Some(config) => Foveal::new(config)?,
        None => trained_retina(weights, &metadata, None, "kmeans")?,
    };
    let encoder = ConvolutionEncoder::new(&model, retina.cells(), pool, threshold)?;
    Ok((retina, Arc::new(encoder)))
}

/// The retina that a model was trained with; a configuration may have no other.
fn trained_retina(weights: &str, metadata: &Metadata, given: Option<FovealConfig>, kind: &str) -> Result<Foveal> {
    let trained: FovealConfig = Node::read_json(&metadata.retina).map_err(|e| {
        Error::malformed(
            weights,
            format!("its metadata does not describe a retina ({e}); retrain it with `{}`", command(kind)),
        )
    })?;
    if given.is_some_and(|g| g != trained) {
        return Err(Error::Config(format!(
            "{weights} was trained with the retina {}, but the configuration has another; leave out [retina], or retrain",
            metadata.retina
        )));
    }
    Foveal::new(trained)
}

/// A model and the metadata of its file.
type Read<M> = Result<(M, Metadata)>;

/// A model of some kind: one that ships with the library, or a file.
fn model<M>(weights: &str, (files, folder): Places<'_>, from_bytes: fn(&[u8], &Path) -> Read<M>) -> Read<M> {
    let Some(name) = weights.strip_prefix("builtin:") else {
        let path = folder.join(weights);
        return from_bytes(&files.read(&path)?, &path);
    };
    let bytes = MODELS.iter().find(|m| m.0 == name).map(|m| m.1).ok_or_else(|| {
        let names: Vec<&str> = MODELS.iter().map(|m| m.0).collect();
        Error::Config(format!("no model is called builtin:{name}; there are builtin:{}", names.join(", builtin:")))
    })?;
    from_bytes(bytes, Path::new(weights))
}

/// Models that ship with the program.
const MODELS: &[(&str, &[u8])] = &[
    ("digits", include_bytes!("../../models/digits.safetensors")),
    ("natural", include_bytes!("../../models/natural.safetensors")),
    ("natural-kmeans", include_bytes!("../../models/natural-kmeans.safetensors")),
];
