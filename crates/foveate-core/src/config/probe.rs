//! Whether an encoder of a user's own suits the retina, distance and sharpness of its configuration, tried on a test picture.

use crate::geometry::{Extent, State};
use crate::identity::pyramid::Region;
use crate::identity::{Appearance, Encoder, Pyramid, Retina, distance};
use crate::scene::Image;
use foveate_base::rng::{Purpose, Streams};
use foveate_base::rows::{Rows, RowsMut};
use foveate_base::{Error, Result};

/// Nats by which the target must at least be likelier than the most similar other places of the test picture: with fewer, a thousand
/// particles elsewhere outweigh those on the target.
const LEAST: f64 = 2.0;
/// The most: beyond it, one particle has all the weight.
const MOST: f64 = 1000.0;

/// Width and height of the test picture.
const SIZE: [usize; 2] = [160, 120];
const TARGET: State = State { x: 80.0, y: 60.0, vx: 0.0, vy: 0.0, log_scale: 0.0, angle: 0.0, log_aspect: 0.0 };
const EXTENT: Extent = Extent { half_w: 16.0, half_h: 16.0 };

/// Fails if the features are not finite, are out of the distance's range, or do not separate the target from other places.
pub(super) fn encoder(
    retina: &dyn Retina,
    encoder: &dyn Encoder,
    distance: distance::Kind,
    appearance: &mut dyn Appearance,
) -> Result<()> {
    let image = picture();
    let features = features(&image, retina, encoder);
    let wrong = |what: String| Err(Error::Config(format!("encoder: {what}")));
    if let Some(h) = features.iter().find(|h| !h.is_finite()) {
        return wrong(format!("a feature of a test picture is {h}; features must be finite"));
    }
    let (least, most, name) = match distance {
        distance::Kind::Bhattacharyya | distance::Kind::BhattacharyyaSquared => (0.0, f32::MAX, "bhattacharyya"),
        distance::Kind::Bernoulli => (0.0, 1.0, "bernoulli"),
        _ => (f32::MIN, f32::MAX, ""),
    };
    if let Some(h) = features.iter().find(|h| !(least..=most).contains(*h)) {
        let range = if most > 1.0 { "0 or more" } else { "0 to 1" };
        return wrong(format!(
            "a feature of a test picture is {h}, but likelihood.distance = \"{name}\" needs features of {range}; set \
             likelihood.distance to \"cosine\" or \"euclidean\", or change the encoder"
        ));
    }
    let reference = appearance.init_template(&image, &TARGET, EXTENT, Streams::new(1, 0));
    let gap = reference.on - reference.off;
    if (LEAST..=MOST).contains(&gap) {
        return Ok(());
    }
    let usual = "about 12 nats are usual: likelihood.calibrate = { nats = 12, least = 1, most = 10000 } in the place of \
                 likelihood.sharpness finds them";
    if gap > MOST {
        return wrong(format!(
            "on a test picture the target is {gap:.0} nats likelier than the most similar other places, so that one particle has all the \
             weight; {usual}"
        ));
    }
    wrong(format!(
        "on a test picture the target is only {gap:.2} nats likelier than the most similar other places, so that the filter cannot tell \
         them apart. Take the mean out of a glimpse and divide by its deviation in `Encoder::condition` \
         (`extend::standardise`), and choose the sharpness: {usual}"
    ))
}

/// The features at the target and at 24 other places.
fn features(image: &Image, retina: &dyn Retina, encoder: &dyn Encoder) -> Vec<f32> {
    let (n_v, n_h) = encoder.shape();
    let place = |k: usize| State { x: 20.0 + 30.0 * (k % 5) as f64, y: 20.0 + 20.0 * (k / 5) as f64, ..TARGET };
    let states: Vec<State> = (0..24).map(place).chain([TARGET]).collect();
    let reach = retina.footprints().iter().map(|f| f.reach).fold(0.0, f64::max);
    let region = Region::covering(image, &states, &[crate::geometry::Gaze::CENTRE], EXTENT, reach);
    let mut pyramid = Pyramid::default();
    pyramid.build(image, region, retina.footprints(), (EXTENT.half_w, EXTENT.half_h));
    let mut glimpses = vec![0.0; states.len() * n_v];
    for (state, glimpse) in states.iter().zip(glimpses.chunks_exact_mut(n_v)) {
        retina.look(&pyramid, state.fixate(crate::geometry::Gaze::CENTRE, EXTENT), glimpse);
        encoder.condition(glimpse);
    }
    let mut features = vec![0.0; states.len() * n_h];
    encoder.encode(Rows::new(&glimpses, n_v), RowsMut::new(&mut features, n_h));
    features
}

/// Noise of three sizes in three planes, 4, 8 and 16 pixels, about as rich in contrast as camera video.
fn picture() -> Image {
    let [w, h] = SIZE;
    let mut rng = Streams::new(1, 0).at(0, Purpose::Scene).rng(0);
    let mut bytes = vec![64_u8; 3 * w * h];
    for plane in bytes.chunks_exact_mut(w * h) {
        for (cell, high) in [(4, 30.0), (8, 40.0), (16, 55.0)] {
            let columns = w / cell + 1;
            let noise: Vec<f64> = (0..columns * (h / cell + 1)).map(|_| high * rng.uniform()).collect();
            for (k, byte) in plane.iter_mut().enumerate() {
                *byte += noise[(k / w / cell) * columns + k % w / cell] as u8;
            }
        }
    }
    Image::new(w, h, 3, bytes).expect("three planes")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use foveate_base::files::Nowhere;

    #[test]
    fn encoders_for_real_video_suit_their_configurations() {
        for name in ["natural", "natural-fast", "natural-middle", "natural-raw"] {
            let config = Config::builtin(name).expect("it ships").expect("it is right");
            let distance = config.likelihood.distance;
            let blueprint = config.check(&Nowhere).expect("parts that fit");
            let mut appearance = blueprint.observation_model().expect("parts that fit");
            let tried = encoder(&*blueprint.retina, &*blueprint.encoder, distance, &mut *appearance);
            assert!(tried.is_ok(), "{name}: {}", tried.expect_err("it is not ok"));
        }
    }
}
