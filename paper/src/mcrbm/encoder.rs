//! The features of a factored RBM (section 2.1, Ranzato & Hinton 2010) as a first layer.

use super::{FactoredRbm, Units};
use foveate::identity::Encoder;
use foveate::identity::encoder::Raw;
use foveate::rows::{Rows, RowsMut};

/// The probabilities of a factored RBM's hidden units: covariance units off, mean units on.
pub(crate) struct FactoredEncoder {
    rbm: FactoredRbm,
    units: Units,
    glimpses: Raw,
}

impl FactoredEncoder {
    /// Creates an encoder with these units of a trained machine; each channel of a glimpse is standardised first, as in its training.
    pub(crate) fn new(rbm: FactoredRbm, units: Units, channels: &[usize]) -> Self {
        Self { rbm, units, glimpses: Raw::new(channels, true) }
    }
}

impl Encoder for FactoredEncoder {
    fn shape(&self) -> (usize, usize) {
        (self.rbm.glimpse_len(), self.rbm.width(self.units))
    }
    fn condition(&self, glimpse: &mut [f32]) {
        self.glimpses.condition(glimpse);
    }
    fn encode(&self, glimpses: Rows<'_>, features: RowsMut<'_>) {
        self.rbm.features(glimpses, self.units, features);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mcrbm::{Recipe, Trainer};
    use foveate::conformance;
    use foveate::learn::training::Training;
    use foveate::rng::Streams;
    use rand::RngExt;

    #[test]
    fn it_keeps_the_law() {
        let channels: Vec<usize> = (0..60).map(|i| i / 40).collect();
        let mut rng = Streams::new(6, 0).rng(0);
        let mut glimpses: Vec<f32> = (0..99 * 60).map(|_| rng.random()).collect();
        // More units than the rows of a thread's scratch buffer.
        let recipe = Recipe { batch: 40, ..Recipe::new(700, 130) };
        let trainer = Trainer::new(recipe, Rows::new(&glimpses, 60)).expect("good rows");
        for (units, n) in [(Units::Both, 830), (Units::Covariance, 700), (Units::Mean, 130)] {
            let encoder = FactoredEncoder::new(trainer.learned(), units, &channels);
            glimpses[..60].fill(0.5);
            glimpses.chunks_exact_mut(60).for_each(|glimpse| encoder.condition(glimpse));
            conformance::encoder(&encoder, &glimpses);
            assert_eq!(encoder.shape(), (60, n));
        }
    }
}
