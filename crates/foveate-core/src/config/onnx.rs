//! Networks from ONNX files, as first layers and as detectors.

use std::path::Path;
use std::sync::Arc;

use crate::identity::encoder::Encoder;
use crate::identity::onnx::{OnnxEncoder, Planes};
use crate::identity::retina::{Foveal, FovealConfig};
use crate::onnx::Graph;
use crate::scene::object_detector::Settings;
use crate::scene::{Detector, ObjectDetector};
use foveate_base::files::Files;
use foveate_base::{Error, Result};

/// A detector whose file is read.
pub(super) type Network = ObjectDetector;

/// The first layer of a file, on the given retina.
pub(super) fn first_layer(
    model: &str,
    planes: Planes,
    (mean, std): (&[f32], &[f32]),
    given: Option<FovealConfig>,
    (files, folder): (&dyn Files, &Path),
) -> Result<(Foveal, Arc<dyn Encoder>)> {
    let config = given.ok_or_else(|| {
        Error::Config("an ONNX encoder needs a retina; for example [retina] kind = \"foveal\", side = 32, rings = [[32, 1]], colour = [[32, 1]]".into())
    })?;
    let retina = Foveal::new(config)?;
    let path = folder.join(model);
    let graph = Graph::read(&files.read(&path)?, &path)?;
    let encoder = OnnxEncoder::new(&graph, &retina, planes, mean, std)?;
    Ok((retina, Arc::new(encoder)))
}

/// The detector of a file.
pub(super) fn detector(settings: &Settings, files: &dyn Files) -> Result<Network> {
    let path = Path::new(&settings.model);
    ObjectDetector::new(&Graph::read(&files.read(path)?, path)?, settings)
}

/// A detector that shares the network.
pub(super) fn boxed(network: &Network) -> Box<dyn Detector> {
    Box::new(network.clone())
}
