//! The paper's components that no shipped configuration uses, under their names in configurations.

use std::path::Path;

use foveate::extend::{EncoderSite, Parts};
use foveate::identity::rbm_encoder::{Precision, RbmEncoder};
use foveate::identity::retina::{Foveal, FovealConfig};
use foveate::learn::rbm::Metadata;
use foveate::{Error, Result};
use serde::Deserialize;

use crate::autoencoder::Autoencoder;
use crate::mcrbm::{FactoredEncoder, FactoredRbm, Units};

/// Returns the encoders `mcrbm` and `autoencoder`.
pub(crate) fn parts() -> Parts {
    Parts::new().with_encoder("mcrbm", mcrbm).with_encoder("autoencoder", autoencoder)
}

/// Settings of `encoder.kind = "mcrbm"`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct McrbmSettings {
    /// A model file, or `builtin:natural-mcrbm`.
    #[serde(default = "natural_mcrbm")]
    weights: String,
    /// The units used as features.
    #[serde(default)]
    units: Units,
}

/// Settings of `encoder.kind = "autoencoder"`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AutoencoderSettings {
    /// A model file, or `builtin:natural-autoencoder`.
    #[serde(default = "natural_autoencoder")]
    weights: String,
    /// Rounding of the weights.
    #[serde(default)]
    precision: Precision,
}

fn natural_mcrbm() -> String {
    "builtin:natural-mcrbm".into()
}

fn natural_autoencoder() -> String {
    "builtin:natural-autoencoder".into()
}

fn mcrbm(settings: McrbmSettings, site: &EncoderSite<'_>) -> Result<(Foveal, FactoredEncoder)> {
    let (rbm, retina) = model(&settings.weights, site, FactoredRbm::from_bytes)?;
    let encoder = FactoredEncoder::new(rbm, settings.units, &retina.channels());
    Ok((retina, encoder))
}

fn autoencoder(settings: AutoencoderSettings, site: &EncoderSite<'_>) -> Result<(Foveal, RbmEncoder)> {
    let (model, retina) = model(&settings.weights, site, Autoencoder::from_bytes)?;
    let encoder = RbmEncoder::new(model.layer().clone(), &retina.channels()).rounded(settings.precision);
    Ok((retina, encoder))
}

/// The models of this crate.
const MODELS: [(&str, &[u8]); 2] = [
    ("builtin:natural-mcrbm", include_bytes!("../models/natural-mcrbm.safetensors")),
    ("builtin:natural-autoencoder", include_bytes!("../models/natural-autoencoder.safetensors")),
];

/// Reads a model and its metadata.
type Reader<M> = fn(&[u8], &Path) -> Result<(M, Metadata)>;

/// Returns a model with the retina of its training; fails if the configuration specifies another one.
fn model<M>(weights: &str, site: &EncoderSite<'_>, from_bytes: Reader<M>) -> Result<(M, Foveal)> {
    let path = Path::new(weights);
    let (model, metadata) = match MODELS.iter().find(|(name, _)| *name == weights) {
        Some((_, bytes)) => from_bytes(bytes, path)?,
        None => from_bytes(&site.read(path)?, path)?,
    };
    let trained: FovealConfig = serde_json::from_str(&metadata.retina)
        .map_err(|e| Error::malformed(path, format!("its metadata does not describe a retina ({e}); retrain it")))?;
    if site.given.as_ref().is_some_and(|given| *given != trained) {
        return Err(Error::Config(format!(
            "{weights} was trained with the retina {}, but the configuration has another; leave out [retina], or retrain",
            metadata.retina
        )));
    }
    Ok((model, Foveal::new(trained)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate::config::Config;
    use foveate::files::Folder;

    #[test]
    fn the_encoders_serve_the_configuration_of_learned_features() {
        let learned = Config::builtin("natural-learned").expect("it ships").expect("it is right").with_parts(&parts());
        for encoder in [r#"{ kind = "mcrbm", units = "covariance" }"#, r#"{ kind = "autoencoder" }"#] {
            let config = learned.clone().set(&format!("encoder={encoder}")).expect(encoder);
            config.check(&Folder::here()).expect(encoder);
        }
        let other =
            learned.set(r#"encoder={ kind = "mcrbm", weights = "builtin:natural-autoencoder" }"#).expect("settings");
        let wrong = other.check(&Folder::here()).map(|_| ()).expect_err("a model of another kind").to_string();
        assert!(wrong.contains("kind \"mcrbm\""), "{wrong}");
    }
}
