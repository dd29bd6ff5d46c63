//! Model files of multi-fixation RBMs: safetensors with our metadata, as `rbm::io` has them.

use super::super::io::{self, Metadata, Tensors};
use super::parameters::{NAMES, Parameters, Shape};
use super::{FixationRbm, Places};
use foveate_base::{Result, files};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The metadata of a model file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct About {
    /// Its origin.
    pub metadata: Metadata,
    /// The first layer of its input features, as JSON; empty if it reads glimpses directly. Not used here.
    pub first_layer: String,
    /// What its log-probabilities are divided by, fitted on held-out sequences; 1 leaves them as they are.
    pub temperature: f32,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    pub window: usize,
    pub places: Places,
    pub about: About,
}

/// Reads the tensors into parameters of this shape, or fails with a text.
fn take(tensors: &mut Tensors, shape: Shape) -> std::result::Result<Parameters, String> {
    // Nothing is allocated by the sizes that a file claims.
    let mut parameters = Parameters::zeros(Shape { n_v: 0, factors: 0, hidden: 0, places: 0, classes: 0 });
    for ((name, shape), into) in NAMES.iter().zip(Parameters::shapes(shape)).zip(parameters.all_mut()) {
        if shape.contains(&0) {
            continue;
        }
        match tensors.remove(*name) {
            Some((found, values)) if found == shape => *into = values,
            Some((found, _)) => return Err(format!("the tensor {name} is {found:?}, expected {shape:?}")),
            None => return Err(format!("the tensor {name} is missing")),
        }
    }
    Ok(parameters)
}

impl FixationRbm {
    /// The bytes of a model file.
    pub fn to_bytes(&self, about: &About) -> Vec<u8> {
        let file = File { window: self.window, places: self.places.clone(), about: about.clone() };
        let mut tensors: Vec<_> = self.parameters.tensors(self.shape).collect();
        tensors.push(("offset", vec![self.shape.n_v], &self.offset));
        io::pack("fixations", file, &tensors)
    }
    /// Writes a model file; it is whole or not there.
    pub fn save(&self, path: &Path, about: &About) -> Result<()> {
        files::write(path, &self.to_bytes(about))
    }
    /// Reads a model from the bytes of a file; `path` stands for it in errors.
    ///
    /// Fails, with the reason, if they are not such a model, or are damaged in any way.
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<(Self, About)> {
        let refuse = |problem: String| {
            foveate_base::Error::malformed(
                path,
                format!(
                    "not a usable model: {problem}; `foveate train fixations` makes one of digits, `foveate train classifier` of other pictures"
                ),
            )
        };
        let (file, mut tensors, sealed) = io::unpack::<File>(bytes, "fixations").map_err(refuse)?;
        let sides = |tensors: &Tensors, name: &str| match tensors.get(name).map(|t| &*t.0) {
            Some(&[rows, columns]) if rows > 0 && columns > 0 => Ok((rows, columns)),
            _ => Err(refuse(format!("the tensor {name} is missing or empty"))),
        };
        let ((n_v, factors), (_, hidden)) = (sides(&tensors, "filters")?, sides(&tensors, "pooling")?);
        let classes = if tensors.contains_key("labels") { sides(&tensors, "labels")?.0 } else { 0 };
        let shape = Shape { n_v, factors, hidden, places: file.places.len(), classes };
        let parameters = take(&mut tensors, shape).map_err(refuse)?;
        let offset = tensors.remove("offset").filter(|o| o.0 == [n_v]);
        let Some((_, offset)) = offset else {
            return Err(refuse(format!("the tensor offset is not there, or not {n_v} long")));
        };
        if let Some(name) = tensors.keys().min() {
            return Err(refuse(format!("it has an unknown tensor {name}")));
        }
        let temperature = file.about.temperature;
        if !(1..=256).contains(&file.window) || classes > 256 || !(1e-3..=1e3).contains(&temperature) {
            let window = file.window;
            return Err(refuse(format!(
                "a window of {window} fixations, {classes} classes or a temperature of {temperature} is out of range"
            )));
        }
        let rbm = Self::new(shape, parameters, offset, file.places, file.window).map_err(|e| refuse(e.to_string()))?;
        sealed.map_err(refuse)?;
        Ok((rbm, file.about))
    }
    /// Reads a model file; see [`FixationRbm::from_bytes`].
    pub fn load(path: &Path) -> Result<(Self, About)> {
        Self::from_bytes(&io::read(path)?, path)
    }
}
