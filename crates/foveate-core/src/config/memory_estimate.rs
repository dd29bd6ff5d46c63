//! The memory estimate of a target, checked against the memory limit before the memory is allocated.

use super::Blueprint;
use crate::geometry::{BBox, Size, State};
use crate::identity::discriminant::Discriminant;
use crate::identity::retina::Retina;
use crate::multi::MemoryEstimate;
use foveate_base::{Error, Result, memory};

/// The fixed memory of a target; the colour model; the fixed scratch memory of a look.
const FIXED: u64 = (28 << 10) + 256;
const COLOURS: u64 = 128 << 10;
const VIEWS: u64 = 2 << 20;
/// Numbers that a particle takes beside its state while it is looked at.
const NUMBERS: u64 = 12;

impl Blueprint {
    /// Returns the memory estimate of targets.
    pub(crate) fn memory_estimate(&self) -> MemoryEstimate {
        let (c, (n_v, n_h)) = (&self.config, self.encoder.shape());
        let (particles, features) = (c.particles as u64, (n_v + n_h) as u64);
        let state = std::mem::size_of::<State>() as u64;
        // The rows of the first frame and a triangle of sums in 16 bits; in a look, two whole ones and their mixture.
        let (row, layout) = (n_h as u64 + 1, self.layout());
        let (gazes, learned) = layout.map_or((1, row), |it| (it.gazes().len() as u64, it.count() as u64));
        let of = |_| (Discriminant::FIRST_ROWS * row * gazes, learned * (learned + 1) / 2);
        let (rows, triangle) = c.discriminant.map_or((0, 0), of);
        let colours = if c.colour.is_some() { COLOURS } else { 0 };
        // Remembered places as bytes, each with its length; those of one frame as they are.
        let remembered = c.distractors.as_ref().filter(|settings| settings.remembered > 0);
        let (frames, places) =
            remembered.map_or((0, 0), |settings| (settings.remembered as u64, settings.count() as u64));
        let surroundings = frames.saturating_mul(places).saturating_mul(n_h as u64 + 4);
        let kept = (FIXED + particles * (state + 8) + 4 * rows + 2 * triangle + colours)
            .saturating_add(self.trained(n_v as u64, n_h as u64))
            .saturating_add(surroundings);
        let look = places.saturating_mul(4 * n_h as u64).saturating_add(VIEWS)
            + particles * (2 * state + 8 * NUMBERS + 4 * features)
            + 3 * 4 * triangle;
        let reach = self.retina.footprints().iter().map(|f| f.reach + f.side).fold(0.0, f64::max) + 1.5;
        let second = self.second.as_ref().map_or(0, |second| {
            let MemoryEstimate { kept, look, .. } = second.memory_estimate();
            kept.saturating_add(look)
        });
        let kept = kept.saturating_add(second);
        // Each further member has buffers of its own.
        let others = self.config.committee.saturating_sub(1) as u64;
        let kept = kept.saturating_add(others.saturating_mul(kept.saturating_add(look)));
        MemoryEstimate { kept, look, reach }
    }

    /// Bytes of RBMs that a target has for itself: those that are trained while it tracks, with their encoder and the pretrained one.
    fn trained(&self, n_v: u64, n_h: u64) -> u64 {
        #[cfg(feature = "learn")]
        if let Some(settings) = self.config.online_training {
            return 4 * (settings.particles as u64 + 4) * (n_v + 1) * (n_h + 1);
        }
        let _ = (n_v, n_h);
        0
    }

    /// Bytes that one target takes, about, its template left out: that is a part of a picture.
    pub fn memory_of_target(&self) -> u64 {
        self.memory_estimate().kept
    }

    /// Returns the approximate bytes of a [`crate::Tracker`] for a target in this box, with its own buffers, in pictures of this size.
    pub fn memory_of_tracker(&self, bbox: &BBox, size: Size) -> u64 {
        let estimate = self.memory_estimate();
        estimate.of_one(bbox, size).saturating_add(estimate.look)
    }

    /// Fails if the settings need more memory than the limit, before any is allocated.
    pub(super) fn fits(&self) -> Result<()> {
        let MemoryEstimate { kept, look, .. } = self.memory_estimate();
        let what = format_args!(
            "particles: {} of them, with {} features each, and {} remembered frames,",
            self.config.particles,
            self.encoder.shape().1,
            self.config.distractors.as_ref().map_or(0, |settings| settings.remembered)
        );
        memory::check(what, kept.saturating_add(look)).map_err(|error| Error::Config(error.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use crate::config::Config;
    use foveate_base::files::Nowhere;

    #[test]
    fn more_is_remembered_than_there_is_memory() {
        let natural = Config::builtin("natural").expect("it ships with the library").expect("it is right");
        let kept =
            |setting: &str| natural.set(setting).expect("a section").check(&Nowhere).map(|it| it.memory_of_target());
        let without = kept("distractors.remembered=0").expect("parts that fit");
        let with = kept("distractors.remembered=16").expect("parts that fit");
        assert_eq!(with - without, 16 * 13 * 13 * (224 + 4));
        // Gazes that share no feature: 961 times 57 of them, and all their products.
        let narrow = Config::builtin("narrow").expect("it ships with the library").expect("it is right");
        let many = narrow.set("policy.grid.n=31").and_then(|it| it.set("policy.grid.reach=9.87")).expect("in range");
        let error = many.check(&Nowhere).map(|_| ()).expect_err("20 GB");
        assert!(error.to_string().contains("GiB"), "{error}");
        let error = kept("distractors={ reach = 50.0, step = 0.1, remembered = 1000 }").expect_err("200 TB");
        assert!(error.to_string().contains("1000 remembered frames"), "{error}");
    }
}
