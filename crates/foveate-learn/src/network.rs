//! A small convolutional network as a first layer: two layers of filters, trained elsewhere (`bench/train_network.py`).
//!
//! It reads grey cells in a square, standardised, and two channels of colour in cells twice as large:
//! ```text
//! grey                                    side × side              1 channel
//! filters, cut at 0, means over 2 × 2     n × n                    F₁ channels
//! with grey and colour beside them        n × n                    F₁ + 3 channels
//! filters, cut at 0                       n/2 × n/2                F₂ channels
//! ```
//! Filters are 3 × 3, so that n = (side − 2) / 2; those of the second layer 2 × 2, side by side. This module knows no pictures.

use crate::rbm::Metadata;
use crate::rbm::io::{About, open, pack};
use foveate_base::{Error, Result};
use std::path::Path;

/// What a model file says that it is.
pub const KIND: &str = "network";
/// Places along a side of a filter of the first layer.
pub const SIZE: usize = 3;
/// The most filters of a layer, and the most cells along a side of the grey square.
pub const MOST: (usize, usize) = (64, 34);

/// Weights of one layer, for each row, column and channel of a filter those of all filters; and a bias a filter.
#[derive(Clone, Debug, PartialEq)]
pub struct Filters {
    /// Row-major: rows × columns × channels × filters.
    pub weights: Vec<f32>,
    /// One a filter.
    pub bias: Vec<f32>,
}

/// Two layers.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    first: Filters,
    second: Filters,
}

impl Network {
    /// Fails if filters of a layer are not 16, 32, 48 or 64, weights are not as many as they need, or a number is not finite.
    pub fn new(first: Filters, second: Filters) -> Result<Self> {
        let inputs = [SIZE * SIZE, 4 * (first.bias.len() + 3)];
        for (filters, inputs) in [&first, &second].into_iter().zip(inputs) {
            let (n, weights) = (filters.bias.len(), filters.weights.len());
            let finite = filters.weights.iter().chain(&filters.bias).all(|x| x.is_finite());
            if !(16..=MOST.0).contains(&n) || n % 16 != 0 || weights != inputs * n || !finite {
                return Err(Error::Invalid(format!(
                    "this layer has 16, 32, 48 or 64 filters of {inputs} finite weights; found {n} biases and {weights} weights"
                )));
            }
        }
        Ok(Self { first, second })
    }
    /// The two layers.
    pub fn layers(&self) -> [&Filters; 2] {
        [&self.first, &self.second]
    }
    /// The bytes of a model file.
    pub fn to_bytes(&self, metadata: &Metadata) -> Vec<u8> {
        let (a, b) = (self.first.bias.len(), self.second.bias.len());
        let tensors = [
            ("first_weights", vec![SIZE, SIZE, 1, a], &*self.first.weights),
            ("first_bias", vec![a], &*self.first.bias),
            ("second_weights", vec![2, 2, a + 3, b], &*self.second.weights),
            ("second_bias", vec![b], &*self.second.bias),
        ];
        pack(KIND, About { metadata: metadata.clone() }, &tensors)
    }
    /// Reads a model from the bytes of a file; `path` stands for it in errors.
    ///
    /// Fails, with the reason, if they are not a model file, are of another format or kind, or are damaged in any way.
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<(Self, Metadata)> {
        let (network, about) = open(bytes, path, KIND, |_: &About, tensors| {
            let mut take = |layer: &str| {
                let mut tensor = |what: &str| {
                    let name = format!("{layer}_{what}");
                    tensors.remove(&name).ok_or_else(|| format!("the tensor {name} is missing"))
                };
                Ok::<_, String>(Filters { weights: tensor("weights")?.1, bias: tensor("bias")?.1 })
            };
            Self::new(take("first")?, take("second")?).map_err(|e| e.to_string())
        })?;
        Ok((network, about.metadata))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filters(n: usize, inputs: usize) -> Filters {
        let x = |n: usize| (0..n).map(|i| (i as f32 * 0.37).sin()).collect();
        Filters { weights: x(n * inputs), bias: x(n) }
    }

    #[test]
    fn models_come_back_and_others_are_refused() {
        let network = Network::new(filters(16, 9), filters(32, 76)).expect("they fit");
        let (path, metadata) = (Path::new("m"), Metadata { command: "train".into(), ..Metadata::default() });
        let bytes = network.to_bytes(&metadata);
        assert_eq!(Network::from_bytes(&bytes, path).expect("just packed"), (network, metadata));
        let mut bent = bytes.clone();
        *bent.last_mut().expect("not empty") ^= 1;
        let why = |bytes: &[u8]| Network::from_bytes(bytes, path).expect_err("refused").to_string();
        assert!(why(&bent).contains("checksum is wrong: the file is damaged; `bench/train_network.py` makes one"));
        assert!(why(&pack("kmeans", About { metadata: Metadata::default() }, &[])).contains("kind \"network\""));
        let missing = pack(KIND, About { metadata: Metadata::default() }, &[("first_weights", vec![1], &[0.0])]);
        assert!(why(&missing).contains("first_bias is missing"), "{}", why(&missing));
        for (first, second) in [((16, 8), (32, 76)), ((16, 9), (32, 75)), ((15, 9), (32, 72)), ((16, 9), (80, 76))] {
            assert!(Network::new(filters(first.0, first.1), filters(second.0, second.1)).is_err());
        }
        let bad = Filters { bias: vec![f32::NAN; 16], ..filters(16, 9) };
        assert!(Network::new(bad, filters(32, 76)).is_err());
    }
}
