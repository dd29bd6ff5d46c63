//! No networks from ONNX files: this build is without the feature `onnx`.

use std::path::Path;
use std::sync::Arc;

use crate::identity::encoder::Encoder;
use crate::identity::onnx::Planes;
use crate::identity::retina::{Foveal, FovealConfig};
use crate::scene::Detector;
use crate::scene::object_detector::Settings;
use foveate_base::files::Files;
use foveate_base::{Error, Result};

/// There is none.
#[derive(Clone, Debug)]
pub(super) enum Network {}

pub(super) fn first_layer(
    model: &str,
    _: Planes,
    _: (&[f32], &[f32]),
    _: Option<FovealConfig>,
    _: (&dyn Files, &Path),
) -> Result<(Foveal, Arc<dyn Encoder>)> {
    Err(without("encoder", model))
}

pub(super) fn detector(settings: &Settings, _: &dyn Files) -> Result<Network> {
    Err(without("detector", &settings.model))
}

pub(super) fn boxed(network: &Network) -> Box<dyn Detector> {
    match *network {}
}

fn without(what: &str, model: &str) -> Error {
    Error::Config(format!(
        "{model}: this build has no ONNX, which the {what} `onnx` needs; build one that has: cargo build --release --features onnx (of \
         the library: the feature `onnx`)"
    ))
}
