//! The file of a network: its layers one after the other, weights as bytes with a scale a filter.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::identity::numbers::{codes, floats};
use crate::tree::Node;
use foveate_base::{Error, Result};

/// The shape of a layer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    pub name: &'static str,
    /// Places along a side of a filter, and from one to the next.
    pub size: usize,
    pub stride: usize,
    pub channels: usize,
    pub filters: usize,
    /// Places that have a bias of their own for each filter; 1 if all have the same.
    pub places: usize,
    /// Whether negative values become 0.
    pub cut: bool,
}

/// Filters of one layer.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Filters {
    /// For each row, column and channel of a filter, the weights of all filters, each in the unit of its filter.
    pub weights: Vec<i8>,
    /// The unit of each filter.
    pub scales: Vec<f32>,
    /// Of each place that has its own, those of all filters.
    pub bias: Vec<f32>,
}

/// A layer in a file: bytes, and the scale of each filter.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    name: String,
    /// Rows, columns, channels, filters.
    shape: [usize; 4],
    #[serde(with = "codes")]
    weights: Vec<i8>,
    #[serde(with = "floats")]
    scales: Vec<f32>,
    #[serde(with = "floats")]
    bias: Vec<f32>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    /// How it was made.
    command: String,
    /// What of.
    data: String,
    layers: Vec<Written>,
}

/// The layers of a file, which must have these shapes.
///
/// # Errors
/// Fails if it is not a file of `bench/train_box_regression.py`, or damaged.
pub(super) fn read(bytes: &[u8], path: &Path, shapes: &[Shape]) -> Result<Vec<Filters>> {
    let wrong = |problem: String| {
        Error::malformed(path, format!("{problem}; expected a file of `bench/train_box_regression.py`"))
    };
    let file: File = Node::read_json(bytes).map_err(wrong)?;
    if file.layers.len() != shapes.len() {
        return Err(wrong(format!("it has {} layers, not {}", file.layers.len(), shapes.len())));
    }
    file.layers.into_iter().zip(shapes).map(|(written, shape)| layer(written, shape).map_err(wrong)).collect()
}

/// A layer of a file, of the shape that it must have.
fn layer(layer: Written, shape: &Shape) -> std::result::Result<Filters, String> {
    let Shape { name, size, channels, filters, places, .. } = *shape;
    let shape = [size, size, channels, filters];
    if layer.name != name || layer.shape != shape {
        return Err(format!("the layer {} of {:?} stands where {name} of {shape:?} should", layer.name, layer.shape));
    }
    let lengths =
        [("weights", layer.weights.len(), size * size * channels * filters), ("scales", layer.scales.len(), filters)];
    for (what, found, expected) in lengths.into_iter().chain([("bias", layer.bias.len(), places * filters)]) {
        if found != expected {
            return Err(format!("{name}.{what} has {found} numbers, not {expected}"));
        }
    }
    if layer.scales.iter().chain(&layer.bias).any(|x| x.abs() > 1e3) {
        return Err(format!("{name} has a scale or a bias beyond 1000"));
    }
    Ok(Filters { weights: layer.weights, scales: layer.scales, bias: layer.bias })
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::network::LAYERS;
    use super::*;
    use foveate_base::rng::Streams;
    use rand::RngExt;

    /// Weights of random numbers, as a file.
    pub(in crate::identity::box_regression) fn random(seed: u64, shapes: &[Shape]) -> Vec<u8> {
        let mut rng = Streams::new(seed, 0).rng(0);
        let layers = shapes.iter().map(|&Shape { name, size, channels, filters, places, .. }| {
            let n = size * size * channels;
            Written {
                name: name.into(),
                shape: [size, size, channels, filters],
                weights: (0..n * filters).map(|_| rng.random::<u8>().cast_signed()).collect(),
                scales: vec![0.02 / (n as f32).sqrt(); filters],
                bias: (0..places * filters).map(|_| rng.random::<f32>() - 0.5).collect(),
            }
        });
        let file = File { command: "c".into(), data: "d".into(), layers: layers.collect() };
        serde_json::to_vec(&file).expect("plain data")
    }

    #[test]
    fn files_that_are_none_are_refused() {
        let bytes = random(4, &LAYERS);
        let said = |bytes: &[u8]| read(bytes, Path::new("f"), &LAYERS).expect_err("refused").to_string();
        let change = |change: fn(&mut File)| {
            let mut file: File = serde_json::from_slice(&bytes).expect("just written");
            change(&mut file);
            serde_json::to_vec(&file).expect("plain data")
        };
        for (bytes, part) in [
            (b"{}".to_vec(), "missing field"),
            (change(|file| file.layers.truncate(3)), "it has 3 layers, not 12"),
            (change(|file| file.layers.swap(0, 1)), "the layer second"),
            (change(|file| file.layers[2].weights.truncate(8)), "third.weights has"),
            (change(|file| file.layers[10].bias.clear()), "answer.bias has 0 numbers, not 5"),
            (change(|file| file.layers[10].scales[0] = 1e4), "answer has a scale or a bias beyond 1000"),
            (change(|file| file.layers[10].scales[0] = f32::INFINITY), "not finite"),
        ] {
            let said = said(&bytes);
            assert!(said.contains(part) && said.contains("bench/train_box_regression.py"), "{said}");
        }
    }
}
