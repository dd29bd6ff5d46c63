//! The first layer of the paper: the hidden units of an RBM (section 2.1), all particles in one product.

use foveate_base::rows::{Rows, RowsMut};
use foveate_kernels as kernels;
use foveate_learn::rbm::{Rbm, Visible};
use serde::{Deserialize, Serialize};

use super::encoder::{Channels, Encoder};

/// How an RBM's weights and glimpses are rounded before they are multiplied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// Full precision.
    F32,
    /// 8 significant bits. Features differ by 4e-4 (root mean square). Faster on processors with bf16.
    #[default]
    Bf16,
    /// Bytes. Features differ by 6e-4. Fastest with VNNI.
    Int8,
}

/// The activation probabilities of an RBM's hidden units.
#[derive(Clone, Debug)]
pub struct RbmEncoder {
    rbm: Rbm,
    packed: kernels::PackedWeights,
    channels: Channels,
}

impl RbmEncoder {
    /// Encodes with a trained RBM, without rounding; Gaussian ones standardise each channel of a glimpse first, as their
    /// training did.
    pub fn new(rbm: Rbm, channels: &[usize]) -> Self {
        let (n_v, n_h) = rbm.shape();
        let packed = kernels::PackedWeights::f32(n_v, n_h, rbm.weights().data());
        Self { rbm, packed, channels: Channels::of(channels) }
    }

    /// The machine.
    pub fn rbm(&self) -> &Rbm {
        &self.rbm
    }

    /// The same encoder, with another machine of the same shape.
    pub fn with(&self, rbm: Rbm) -> Self {
        let precision = match self.packed.precision() {
            kernels::Precision::F32 => Precision::F32,
            kernels::Precision::Bf16 => Precision::Bf16,
            kernels::Precision::Int8 => Precision::Int8,
        };
        Self { rbm, ..self.clone() }.rounded(precision)
    }

    /// The same encoder at this precision.
    pub fn rounded(self, precision: Precision) -> Self {
        let ((n_v, n_h), weights) = (self.rbm.shape(), self.rbm.weights().data());
        let packed = match precision {
            Precision::F32 => kernels::PackedWeights::f32(n_v, n_h, weights),
            Precision::Bf16 => kernels::PackedWeights::bf16(n_v, n_h, weights),
            Precision::Int8 => kernels::PackedWeights::int8(n_v, n_h, weights),
        };
        Self { packed, ..self }
    }
}

impl Encoder for RbmEncoder {
    fn shape(&self) -> (usize, usize) {
        self.rbm.shape()
    }
    fn condition(&self, glimpse: &mut [f32]) {
        if self.rbm.visible() == Visible::Gaussian {
            self.channels.standardise(glimpse);
        }
    }
    fn encode(&self, glimpses: Rows<'_>, mut features: RowsMut<'_>) {
        self.packed.features(glimpses.data(), self.rbm.hidden_bias(), features.data());
    }
    fn overlaps(&self, glimpses: Rows<'_>, root: &[f32], totals: &mut [f32], overlaps: &mut [f32]) -> bool {
        self.packed.overlaps(glimpses.data(), self.rbm.hidden_bias(), root, totals, overlaps);
        true
    }
}
