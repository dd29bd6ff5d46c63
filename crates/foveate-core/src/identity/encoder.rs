//! From glimpses to features: the first layer of the identity pathway (section 2.1).

use std::any::Any;

use foveate_kernels as kernels;

use foveate_base::rows::{Rows, RowsMut};

/// Maps glimpses to features, row by row.
///
/// A row's features must depend on that row alone: the tracker splits batches as it pleases. If they depend on others, results change with
/// the number of threads, and `conformance::encoder` fails.
///
/// The features must suit the distance of the configuration. Cosine and Euclidean distance take any finite values; with the cosine
/// distance, take out the mean in [`Encoder::condition`], or all glimpses are nearly alike. The Bhattacharyya distances need values of 0
/// or more, `bernoulli` values from 0 to 1. The sharpness of the likelihood must suit the size of the distances.
/// [`crate::Config::check`] tries an encoder of your own on a test picture, and refuses one that does not suit.
pub trait Encoder: Any + Send + Sync {
    /// (n_v, n_h): values in a glimpse, which is the retina's `glimpse_len`, and values in a feature vector.
    fn shape(&self) -> (usize, usize);
    /// Prepares a glimpse (values 0 to 1) for [`Encoder::encode`], in place; for example by [`standardise`].
    fn condition(&self, _glimpse: &mut [f32]) {}
    /// Encodes conditioned glimpses.
    fn encode(&self, glimpses: Rows<'_>, features: RowsMut<'_>);
    /// For conditioned glimpses with features h: `totals` ← Σ h and `overlaps` ← Σ √h · `root`, one each a row, without
    /// writing the features; `root` has length n_h. Returns false, and does nothing, if it has no faster way than
    /// [`Encoder::encode`].
    fn overlaps(&self, _glimpses: Rows<'_>, _root: &[f32], _totals: &mut [f32], _overlaps: &mut [f32]) -> bool {
        false
    }
    /// Lengths of the parts of a feature vector, in their order: each describes another quantity, such as gradients and colours. One
    /// part by default. They must add up to n_h: otherwise the models learned while tracking have the wrong width, the tracker panics,
    /// and `conformance::encoder` fails.
    fn parts(&self) -> Vec<usize> {
        vec![self.shape().1]
    }
}

impl dyn Encoder {
    /// The encoder as this type, if it is of this type.
    pub(crate) fn downcast<E: Encoder>(&self) -> Option<&E> {
        (self as &dyn Any).downcast_ref()
    }
}

/// No first layer: the glimpse is the feature vector, as it is or with its mean taken out and its contrast brought to 1.
///
/// Standardised, with the cosine distance, this is normalised cross-correlation of foveated patches: the baseline
/// every learned feature has to beat.
#[derive(Clone, Debug)]
pub struct Raw {
    standardise: bool,
    channels: Channels,
}

impl Raw {
    /// For a retina whose cells have these channels; with `standardise` each channel is standardised separately.
    pub fn new(channels: &[usize], standardise: bool) -> Self {
        Self { standardise, channels: Channels::of(channels) }
    }
}

impl Encoder for Raw {
    fn shape(&self) -> (usize, usize) {
        let n = self.channels.0.iter().sum();
        (n, n)
    }
    fn condition(&self, glimpse: &mut [f32]) {
        if self.standardise {
            self.channels.standardise(glimpse);
        }
    }
    fn encode(&self, glimpses: Rows<'_>, mut features: RowsMut<'_>) {
        features.data().copy_from_slice(glimpses.data());
    }
}

/// How many values of a glimpse each channel has, in their order.
#[derive(Clone, Debug)]
pub(super) struct Channels(Vec<usize>);

impl Channels {
    /// For a retina whose cells have these channels.
    pub(super) fn of(cells: &[usize]) -> Self {
        Self(cells.chunk_by(|a, b| a == b).map(<[usize]>::len).collect())
    }
    /// [`standardise`] of each channel on its own.
    pub(super) fn standardise(&self, glimpse: &mut [f32]) {
        let mut rest = glimpse;
        for n in &self.0 {
            let (channel, others) = rest.split_at_mut(*n);
            standardise(channel);
            rest = others;
        }
    }
}

/// Zero mean and unit standard deviation. 0.05 is added to the deviation, so that flat glimpses stay flat
/// instead of showing their noise.
pub fn standardise(values: &mut [f32]) {
    const FLAT: f32 = 0.05;
    let n = values.len() as f32;
    let mean = kernels::sum(values) / n;
    values.iter_mut().for_each(|x| *x -= mean);
    let sd = (kernels::dot(values, values) / n).sqrt();
    let gain = 1.0 / (sd + FLAT);
    values.iter_mut().for_each(|x| *x *= gain);
}
