//! Finds objects that are brighter than the picture's mean: lights at night, or digits on black.

use foveate::extend::{Blobs, Detector, Map, Score};
use foveate::{Detection, Error, Image, Result};
use serde::Deserialize;

/// The keys of `[detector]` beside `kind`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// How much brighter than the mean a pixel of an object is, 1 to 254.
    above: u8,
    /// Smaller objects are left out, pixels.
    #[serde(default)]
    min_area: usize,
}

pub struct Bright {
    above: u8,
    blobs: Blobs,
    map: Map,
}

impl Bright {
    pub fn new(settings: Settings) -> Result<Self> {
        if !(1..=254).contains(&settings.above) {
            return Err(Error::Config(format!("detector.above is a number from 1 to 254; it is {}", settings.above)));
        }
        Ok(Self { above: settings.above, blobs: Blobs::new(settings.min_area, Score::Mass), map: Map::default() })
    }
}

impl Detector for Bright {
    fn detect(&mut self, image: &Image, found: &mut Vec<Detection>) {
        let pixels = image.plane(0);
        let mean = pixels.iter().map(|pixel| u64::from(*pixel)).sum::<u64>() as f32 / pixels.len().max(1) as f32;
        self.map.cover(image.width(), image.height(), 1);
        for (value, pixel) in self.map.values_mut().iter_mut().zip(pixels) {
            *value = (f32::from(*pixel) - mean - f32::from(self.above)).max(0.0);
        }
        self.blobs.find(&self.map, 0.0, image.size(), found);
    }
    fn map(&self) -> &Map {
        &self.map
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate::extend::conformance;

    #[test]
    fn the_law_of_detectors_holds() {
        let new = || Bright::new(Settings { above: 60, min_area: 4 }).expect("settings in range");
        conformance::detector(&|| Box::new(new()));
    }
}
