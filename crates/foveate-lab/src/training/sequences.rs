//! Sequences of fixations for training recognition: digits with gazes (section 2.2).
//!
//! Digit i of epoch e depends on (seed, e, i) alone. Clean and centred digits give the same sequences in every epoch if the gazes are
//! fixed, and different ones if they are drawn.

use crate::Digits;
use crate::idx::SIDE;
use foveate_base::rng::{Purpose, Rng, Streams};
use foveate_base::rows::{Rows, RowsMut};
use foveate_base::{Error, Result};
use foveate_core::geometry::{Extent, Gaze, State};
use foveate_core::identity::encoder::Encoder;
use foveate_core::identity::pyramid::{Pyramid, Region};
use foveate_core::identity::retina::{Foveal, Retina};
use foveate_core::scene::Image;
use foveate_learn::rbm::fixations::{Code, Places, Sequences};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::sync::Arc;

/// Side of the canvas around a digit, pixels: covers a fovea of 24 px at gazes half a box from the centre.
const CANVAS: usize = 60;
/// Number of digits that a thread processes at a time.
const TOGETHER: usize = 64;

/// The gazes of a sequence.
#[derive(Clone, Debug, PartialEq)]
pub enum Gazes {
    /// All of these, in this order.
    All(Vec<Gaze>),
    /// Drawn from the places without replacement, until all were taken.
    Among,
    /// Drawn from the square from −reach to reach, template units.
    Within {
        /// Half the square's side.
        reach: f64,
    },
}

/// Random variation of digits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Nuisance {
    /// Maximum position error along an axis, pixels.
    pub jitter: f64,
    /// Maximum error of the logarithm of the size.
    pub log_scale: f64,
    /// Standard deviation of the angle, radians.
    pub angle: f64,
    /// Fraction of digits with one or two others around, which partly cover them.
    pub cluttered: f64,
    /// Fraction of digits on salt-and-pepper noise of up to a fifth of the black pixels.
    pub noisy: f64,
}

impl Nuisance {
    /// Returns the variation along a track: 1.5 px off, slightly rotated, three of ten among others, one of five on noise.
    pub fn of_tracks() -> Self {
        Self { jitter: 1.5, log_scale: 0.05, angle: 0.05, cluttered: 0.3, noisy: 0.2 }
    }
}

/// Makes sequences of encoded glimpses of digits.
pub struct FixationSampler {
    /// The retina.
    pub retina: Foveal,
    /// The first layer; `None` for the glimpse itself.
    pub encoder: Option<Arc<dyn Encoder>>,
    /// The places with their own code.
    pub places: Places,
    /// The gazes.
    pub gazes: Gazes,
    /// Number of fixations of a sequence.
    pub window: usize,
    /// The variation of digits.
    pub nuisance: Nuisance,
    /// Seed of all random numbers.
    pub seed: u64,
}

foveate_base::opaque_debug!(FixationSampler);

/// Sampled sequences.
#[derive(Clone, Debug)]
pub struct FixationData {
    features: Vec<f32>,
    width: usize,
    codes: Vec<Code>,
    gazes: Vec<[f64; 2]>,
    labels: Vec<u8>,
    window: usize,
}

impl FixationData {
    /// Returns the sequences in the form for training.
    pub fn sequences(&self) -> Sequences<'_> {
        let rows = Rows::new(&self.features, self.width);
        Sequences::new(rows, &self.codes, &self.labels, self.window).expect("made to fit, of probabilities")
    }
    /// Returns the gaze of each row, in template units.
    pub fn gazes(&self) -> &[[f64; 2]] {
        &self.gazes
    }
}

impl FixationSampler {
    /// Returns the number of values of a row.
    pub fn width(&self) -> usize {
        self.encoder.as_ref().map_or(self.retina.glimpse_len(), |encoder| encoder.shape().1)
    }
    /// Returns a sequence of each of `digits`, with the variation of epoch `epoch`. Fails without digits, or if the gazes, the window and
    /// the encoder do not fit.
    pub fn look(&self, digits: &Digits, epoch: u64) -> Result<FixationData> {
        let gazes = if let Gazes::All(gazes) = &self.gazes { gazes.len() } else { self.window };
        let fits = self.encoder.as_ref().is_none_or(|e| e.shape().0 == self.retina.glimpse_len());
        if digits.is_empty() || gazes != self.window || self.window == 0 || !fits {
            let n = digits.len();
            return Err(Error::Invalid(format!(
                "sequences need digits ({n} given), a gaze for each of {} fixations ({gazes} given), and an encoder of the retina's width",
                self.window
            )));
        }
        let (width, window) = (self.width(), self.window);
        let mut features = vec![0.0; digits.len() * window * width];
        let mut gazes = vec![[0.0; 2]; digits.len() * window];
        let streams = Streams::new(self.seed, 0).at(epoch, Purpose::Scene);
        let chunk = TOGETHER * window;
        (features.par_chunks_mut(chunk * width), gazes.par_chunks_mut(chunk))
            .into_par_iter()
            .enumerate()
            .for_each_init(
                || (Pyramid::default(), vec![]),
                |(pyramid, glimpses), (i, (features, gazes))| {
                    let n_v = self.retina.glimpse_len();
                    glimpses.resize(gazes.len() * n_v, 0.0);
                    for (j, gazes) in gazes.chunks_exact_mut(window).enumerate() {
                        let index = i * TOGETHER + j;
                        let mut rng = streams.rng(index as u64);
                        self.fixate(digits, index, &mut rng, pyramid, &mut glimpses[j * window * n_v..], gazes);
                    }
                    glimpses.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
                    match &self.encoder {
                        Some(encoder) => {
                            glimpses.chunks_exact_mut(n_v).for_each(|glimpse| encoder.condition(glimpse));
                            encoder.encode(Rows::new(glimpses, n_v), RowsMut::new(features, width));
                            features.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
                        }
                        None => features.copy_from_slice(glimpses),
                    }
                },
            );
        let codes = gazes.iter().map(|&[u, v]| self.places.code(u as f32, v as f32)).collect();
        Ok(FixationData { features, width, codes, gazes, labels: digits.labels.clone(), window })
    }
    fn fixate(
        &self,
        digits: &Digits,
        index: usize,
        rng: &mut Rng,
        pyramid: &mut Pyramid,
        glimpses: &mut [f32],
        gazes: &mut [[f64; 2]],
    ) {
        let t = self.nuisance;
        let image = canvas(digits, index, t, rng);
        let mut off = |most: f64| most * rng.random_range(-1.0..=1.0);
        let (x, y, log_scale) = (off(t.jitter), off(t.jitter), off(t.log_scale));
        let turn: f64 = StandardNormal.sample(rng);
        let middle = (CANVAS as f64 - 1.0) / 2.0;
        let state = State { x: middle + x, y: middle + y, log_scale, angle: t.angle * turn, ..State::default() };
        let half = SIDE as f64 / 2.0;
        let extent = Extent { half_w: half, half_h: half };
        let whole = Region { x: 0, y: 0, width: CANVAS, height: CANVAS };
        pyramid.build(&image, whole, self.retina.footprints(), (half, half));
        let n_v = self.retina.glimpse_len();
        let points = self.places.points();
        let mut left: Vec<usize> = vec![];
        for (k, (at, glimpse)) in gazes.iter_mut().zip(glimpses.chunks_exact_mut(n_v)).enumerate() {
            let gaze = match &self.gazes {
                Gazes::All(gazes) => gazes[k],
                Gazes::Among => {
                    if left.is_empty() {
                        left.extend(0..points.len());
                    }
                    let place = left.swap_remove(rng.random_range(0..left.len()));
                    Gaze { u: points[place][0].into(), v: points[place][1].into(), arm: Some(place) }
                }
                Gazes::Within { reach } => {
                    let mut along = || reach * rng.random_range(-1.0..=1.0);
                    Gaze { u: along(), v: along(), arm: None }
                }
            };
            *at = [gaze.u, gaze.v];
            self.retina.look(pyramid, state.fixate(gaze, extent), glimpse);
        }
    }
}

/// Draws digit `index` at the centre of a canvas, over any other digits.
fn canvas(digits: &Digits, index: usize, nuisance: Nuisance, rng: &mut Rng) -> Image {
    let mut canvas = vec![0u8; CANVAS * CANVAS];
    let middle = (CANVAS - SIDE) / 2;
    let mut put = |digit: &[u8], x: usize, y: usize| {
        for (row, ink) in digit.chunks_exact(SIDE).enumerate() {
            let below = &mut canvas[(y + row) * CANVAS + x..][..SIDE];
            below.iter_mut().zip(ink).filter(|(_, ink)| **ink > 0).for_each(|(below, &ink)| *below = ink);
        }
    };
    let (cluttered, noisy): (f64, f64) = (rng.random(), rng.random());
    if cluttered < nuisance.cluttered {
        for _ in 0..rng.random_range(1..=2) {
            let other = rng.random_range(0..digits.len());
            put(digits.digit(other), rng.random_range(0..=CANVAS - SIDE), rng.random_range(0..=CANVAS - SIDE));
        }
    }
    put(digits.digit(index), middle, middle);
    if noisy < nuisance.noisy {
        let density = rng.random_range(0.0..0.2);
        for pixel in canvas.iter_mut().filter(|pixel| **pixel == 0) {
            if rng.random::<f64>() < density {
                *pixel = rng.random_range(1..=255);
            }
        }
    }
    Image::new(CANVAS, CANVAS, 1, canvas).expect("the canvas was made to these sides")
}

/// Returns approximately the retina and gazes of Larochelle & Hinton's MNIST experiment (2010, section 6.1): 36 pixels and 60 cells of 3 px
/// (theirs: 38, and 60 hexagons that grow outwards), at the corners of a square of 10 px around the centre.
pub fn larochelle_hinton() -> Result<(foveate_core::identity::retina::FovealConfig, Vec<Gaze>)> {
    let retina = foveate_core::identity::retina::FovealConfig {
        rings: vec![[6, 1], [24, 3]],
        ..foveate_core::identity::retina::FovealConfig::authors()
    };
    let off = 5.0 / (SIDE as f64 / 2.0);
    let gazes = [(-off, -off), (-off, off), (off, -off), (off, off)];
    Ok((retina, gazes.iter().enumerate().map(|(k, &(u, v))| Gaze { u, v, arm: Some(k) }).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::identity::retina::FovealConfig;

    fn sampler(gazes: Gazes, nuisance: Nuisance) -> FixationSampler {
        let retina = Foveal::new(FovealConfig::authors()).expect("the authors' geometry");
        let places = Places::grid(3, 0.5).expect("nine places");
        FixationSampler { retina, encoder: None, places, gazes, window: 3, nuisance, seed: 1 }
    }

    #[test]
    fn sequences_do_not_depend_on_threads_and_change_with_the_epoch() {
        let digits = Digits::drawn(3, 20);
        let look = |threads: usize, epoch: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let sampler = sampler(Gazes::Within { reach: 0.5 }, Nuisance::of_tracks());
            pool.install(|| sampler.look(&digits, epoch).expect("digits"))
        };
        let (one, three, other) = (look(1, 0), look(3, 0), look(1, 1));
        assert!(one.features == three.features && one.gazes == three.gazes && one.features != other.features);
        assert_eq!(one.labels, digits.labels);
        assert!(one.gazes.iter().flatten().all(|x| x.abs() <= 0.5));
    }

    #[test]
    fn clean_digits_are_seen_where_they_are_and_gazes_among_places_are_distinct() {
        let digits = Digits::drawn(1, 10);
        let made = sampler(Gazes::Among, Nuisance::default()).look(&digits, 0).expect("digits");
        let s = made.sequences();
        for (codes, gazes) in s.codes().chunks_exact(3).zip(made.gazes().chunks_exact(3)) {
            let places: Vec<usize> = codes.iter().map(|c| c.nearest()).collect();
            assert!(places[0] != places[1] && places[0] != places[2] && places[1] != places[2]);
            assert!(codes.iter().all(|c| c.parts().count() == 1) && gazes.iter().flatten().all(|x| x.abs() <= 0.5));
        }
        // The fovea at the centre equals the digit's own middle pixels.
        let gazes = Gazes::All(vec![Gaze::CENTRE; 3]);
        let made = sampler(gazes, Nuisance::default()).look(&digits, 0).expect("digits");
        let row = made.sequences().glimpses().row(0);
        for (i, x) in row[..64].iter().enumerate() {
            let pixel = digits.digit(0)[(10 + i / 8) * 28 + 10 + i % 8];
            assert!((x - f32::from(pixel) / 255.0).abs() < 1e-5, "{i}: {x} {pixel}");
        }
        let few = sampler(Gazes::All(vec![Gaze::CENTRE]), Nuisance::default());
        assert!(few.look(&digits, 0).expect_err("one gaze for three").to_string().contains("1 given"));
    }
}
