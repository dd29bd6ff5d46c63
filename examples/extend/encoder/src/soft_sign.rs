//! Brighter or darker than the mean, and less of how much: a few very bright or dark cells count for less than in a raw glimpse.

use foveate::extend::{Encoder, Retina, Rows, RowsMut, standardise};
use foveate::{Error, Result};
use serde::Deserialize;

/// The keys of `[encoder]` beside `kind`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// How soon a feature saturates, above 0 to 100.
    gain: f32,
}

pub struct SoftSign {
    cells: usize,
    gain: f32,
}

impl SoftSign {
    pub fn new(settings: Settings, retina: &dyn Retina) -> Result<Self> {
        if !(settings.gain > 0.0 && settings.gain <= 100.0) {
            return Err(Error::Config(format!("encoder.gain is above 0 to 100; it is {}", settings.gain)));
        }
        if retina.cells().iter().any(|cell| cell.channel > 0) {
            return Err(Error::Config("retina.colour: soft-sign reads grey cells alone; leave it out".into()));
        }
        Ok(Self { cells: retina.glimpse_len(), gain: settings.gain })
    }
}

impl Encoder for SoftSign {
    fn shape(&self) -> (usize, usize) {
        (self.cells, self.cells)
    }
    /// Zero mean and unit deviation. Without this all glimpses are about as bright, and by the cosine distance all are alike.
    fn condition(&self, glimpse: &mut [f32]) {
        standardise(glimpse);
    }
    fn encode(&self, glimpses: Rows<'_>, mut features: RowsMut<'_>) {
        for (h, v) in features.data().iter_mut().zip(glimpses.data()) {
            *h = self.gain * v / (1.0 + (self.gain * v).abs());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate::extend::{Foveal, FovealConfig, Purpose, Streams, conformance};

    #[test]
    fn the_law_of_encoders_holds() {
        let retina = Foveal::new(FovealConfig::authors()).expect("a retina");
        let encoder = SoftSign::new(Settings { gain: 2.0 }, &retina).expect("settings in range");
        let mut rng = Streams::new(1, 0).at(0, Purpose::Scene).rng(0);
        let mut glimpses: Vec<f32> = (0..6 * retina.glimpse_len()).map(|_| rng.uniform() as f32).collect();
        glimpses.chunks_mut(retina.glimpse_len()).for_each(|glimpse| encoder.condition(glimpse));
        conformance::encoder(&encoder, &glimpses);
    }
}
