//! Glimpses against closed forms and brute force, and the laws of the identity pathway's seams.

use std::sync::Arc;

use foveate::conformance;
use foveate::geometry::{Extent, Gaze, State};
use foveate::identity::calibrate::Calibration;
use foveate::identity::distance::Kind;
use foveate::identity::encoder::Raw;
use foveate::identity::gaze_appearance::Sharpness;
use foveate::identity::pyramid::Region;
use foveate::identity::rbm_encoder::RbmEncoder;
use foveate::identity::retina::FovealConfig;
use foveate::identity::{Appearance, Encoder, Foveal, GazeAppearance, Pyramid, Retina, discriminant};
use foveate::rng::{Rng, Streams};
use foveate::scene::Image;
use rand::RngExt;
use std::f64::consts::FRAC_PI_2;

/// A box of 28 pixels: at scale 1 a template pixel is a pixel.
const BOX: Extent = Extent { half_w: 14.0, half_h: 14.0 };

fn rng(name: u64) -> Rng {
    Streams::new(name, 0).rng(0)
}

/// The geometries under test: the authors' own, a wider one, and one with colour.
fn retinas() -> [Foveal; 3] {
    let wide = vec![[12, 1], [24, 3], [48, 6]];
    [
        FovealConfig::authors(),
        FovealConfig { side: 28.0, rings: wide, colour: vec![] },
        FovealConfig { side: 28.0, rings: vec![[8, 1], [16, 2]], colour: vec![[8, 2], [24, 4]] },
    ]
    .map(|config| Foveal::new(config).expect("whole cells"))
}

fn look(retina: &Foveal, image: &Image, state: &State, gaze: Gaze, extent: Extent) -> Vec<f32> {
    let reach = retina.footprints().iter().map(|f| f.reach).fold(0.0, f64::max);
    let region = Region::covering(image, &[*state], &[gaze], extent, reach);
    let mut pyramid = Pyramid::default();
    pyramid.build(image, region, retina.footprints(), state.half(extent));
    let mut glimpse = vec![f32::NAN; retina.glimpse_len()];
    retina.look(&pyramid, state.fixate(gaze, extent), &mut glimpse);
    glimpse
}

fn noise(width: usize, height: usize, planes: usize, name: u64) -> Image {
    let mut rng = rng(name);
    Image::new(width, height, planes, (0..width * height * planes).map(|_| rng.random()).collect()).expect("bytes")
}

/// A channel's value at a pixel, from 0 to 255: grey, red − green, blue − yellow.
fn channel(image: &Image, channel: usize, x: usize, y: usize) -> f64 {
    let at = |p: usize| i32::from(image.at(p.min(image.planes() - 1), x, y));
    let (r, g, b) = (at(0), at(1), at(2));
    match channel {
        0 if image.planes() == 1 => f64::from(r),
        0 => f64::from((r * 19595 + g * 38470 + b * 7471 + 32768) >> 16),
        1 => f64::from((r - g) / 2 + 128),
        _ => f64::from((2 * b - r - g) / 4 + 128),
    }
}

fn assert_near(got: &[f32], wanted: &[f64], allowed: f64, what: &str) {
    assert_eq!(got.len(), wanted.len(), "{what}");
    for (i, (g, w)) in got.iter().zip(wanted).enumerate() {
        assert!((f64::from(*g) - w).abs() <= allowed, "{what}: cell {i} is {g}, not {w}");
    }
}

#[test]
fn the_authors_geometry_has_132_values() {
    let [authors, wide, colour] = retinas();
    assert_eq!((authors.glimpse_len(), wide.glimpse_len()), (132, 144 + 48 + 48));
    assert_eq!(colour.glimpse_len(), 64 + 48 + 2 * (16 + 32));
}

/// 20 random places, sizes and turns of a target of any shape, 40 pixels and more from the border: the mean of a
/// ramp over a cell is the ramp at the cell's centre.
#[test]
fn a_ramp_is_seen_in_closed_form() {
    let mut rng = rng(1);
    // Whole steps alone are exact in bytes: one grey a pixel along a diagonal.
    let diagonal = |x: usize, y: usize| (x + y) as u8;
    let image = Image::new(130, 120, 1, (0..130 * 120).map(|i| diagonal(i % 130, i / 130)).collect()).expect("bytes");
    for retina in retinas() {
        for i in 0..20 {
            let mut spread = |by: f64| by * (2.0 * rng.random::<f64>() - 1.0);
            let state = State {
                x: 62.0 + spread(6.0),
                y: 58.0 + spread(6.0),
                log_scale: spread(0.3),
                angle: spread(3.0),
                log_aspect: spread(0.4),
                ..State::default()
            };
            let gaze = Gaze { u: spread(0.3), v: spread(0.3), arm: None };
            let extent = Extent { half_w: 12.0 + spread(2.0), half_h: 10.0 + spread(2.0) };
            let at = state.fixate(gaze, extent);
            let exact: Vec<f64> = (retina.cells().iter())
                .map(|cell| {
                    let x = at.x + cell.u * at.ux + cell.v * at.vx;
                    let y = at.y + cell.u * at.uy + cell.v * at.vy;
                    if cell.channel == 0 { (x + y) / 255.0 } else { 128.0 / 255.0 }
                })
                .collect();
            assert_near(&look(&retina, &image, &state, gaze, extent), &exact, 2e-5, &format!("ramp, look {i}"));
        }
    }
}

/// On whole pixels, at scale 1 and upright, a value is the mean over the cell's pixels, in every channel.
#[test]
fn a_glimpse_is_box_means() {
    for (i, retina) in retinas().iter().enumerate() {
        for planes in [1, 3] {
            let image = noise(90, 80, planes, 2 + i as u64);
            for (x, y) in [(44.5, 39.5), (31.5, 45.5), (50.5, 30.5)] {
                let state = State { x, y, ..State::default() };
                let exact: Vec<f64> = (retina.cells().iter())
                    .map(|cell| {
                        let (cx, cy, half) = (x + 14.0 * cell.u, y + 14.0 * cell.v, 14.0 * cell.half);
                        let range = |c: f64| (c - half + 0.5).round() as usize..(c + half + 0.5).round() as usize;
                        let pixels = range(cy).flat_map(|py| range(cx).map(move |px| (px, py)));
                        let values: Vec<f64> = pixels
                            .map(|(px, py)| {
                                if planes == 1 && cell.channel > 0 {
                                    128.0
                                } else {
                                    channel(&image, cell.channel, px, py)
                                }
                            })
                            .collect();
                        assert_eq!(values.len(), (2.0 * half).round().powi(2) as usize);
                        values.iter().sum::<f64>() / values.len() as f64 / 255.0
                    })
                    .collect();
                let glimpse = look(retina, &image, &state, Gaze::CENTRE, BOX);
                assert_near(&glimpse, &exact, 1e-5, &format!("retina {i}, {planes} planes at {x}, {y}"));
            }
        }
    }
}

/// The picture turned by a quarter, and the state with it: (x, y) goes to (last − y, x).
#[test]
fn turning_picture_and_state_together_changes_nothing() {
    let mut rng = rng(7);
    for retina in retinas() {
        let image = noise(101, 101, 3, 8);
        let mut turned = image.clone();
        for p in 0..3 {
            for i in 0..101 * 101 {
                let (x, y) = (i % 101, i / 101);
                turned.plane_mut(p)[x * 101 + (100 - y)] = image.at(p, x, y);
            }
        }
        for i in 0..20 {
            let mut spread = |by: f64| by * (2.0 * rng.random::<f64>() - 1.0);
            let state = State {
                x: 50.0 + spread(8.0),
                y: 50.0 + spread(8.0),
                log_scale: spread(0.2),
                angle: spread(3.0),
                ..State::default()
            };
            let gaze = Gaze { u: spread(0.5), v: spread(0.5), arm: None };
            let with = State { x: 100.0 - state.y, y: state.x, angle: state.angle + FRAC_PI_2, ..state };
            let extent = Extent { half_w: 13.0, half_h: 13.0 };
            let exact: Vec<f64> = look(&retina, &image, &state, gaze, extent).into_iter().map(f64::from).collect();
            assert_near(&look(&retina, &turned, &with, gaze, extent), &exact, 1e-4, &format!("turn {i}"));
        }
    }
}

/// Rows alike, so that what lies left and right of the picture is known; then columns alike.
#[test]
fn outside_the_picture_its_border_goes_on() {
    let mut rng = rng(9);
    let values: Vec<u8> = (0..60).map(|_| rng.random()).collect();
    let rows = Image::new(60, 60, 1, (0..3600).map(|i| values[i / 60]).collect()).expect("bytes");
    let columns = Image::new(60, 60, 1, (0..3600).map(|i| values[i % 60]).collect()).expect("bytes");
    for retina in retinas() {
        let see = |image: &Image, x: f64, y: f64| -> Vec<f64> {
            let state = State { x, y, ..State::default() };
            look(&retina, image, &state, Gaze::CENTRE, BOX).into_iter().map(f64::from).collect()
        };
        for far in [-500.0, -20.0, 0.0, 59.0, 75.5, 1e6, -1e12] {
            for (got, inside) in
                [(see(&rows, far, 29.5), see(&rows, 29.5, 29.5)), (see(&columns, 29.5, far), see(&columns, 29.5, 29.5))]
            {
                let got: Vec<f32> = got.iter().map(|&v| v as f32).collect();
                assert_near(&got, &inside, 1e-5, &format!("at {far}"));
            }
        }
        // Beyond a corner everything is the corner, as far as its boxes reach into the picture.
        let corner = see(&Image::grey(60, 60, 255), -400.0, 900.0);
        let grey = retina.cells().iter().map(|c| if c.channel == 0 { 1.0 } else { 128.0 / 255.0 });
        assert_near(&corner.iter().map(|&v| v as f32).collect::<Vec<_>>(), &grey.collect::<Vec<_>>(), 1e-5, "corner");
    }
}

#[test]
fn retinas_keep_the_law() {
    retinas().iter().for_each(|retina| conformance::retina(retina));
}

fn channels(retina: &Foveal) -> Vec<usize> {
    retina.cells().iter().map(|c| c.channel).collect()
}

#[test]
fn encoders_keep_the_law() {
    let mut rng = rng(10);
    for retina in retinas() {
        let channels = channels(&retina);
        let n = channels.len();
        let rbm = RbmEncoder::new(crate::common::random_rbm(n, 101), &channels);
        for encoder in [&Raw::new(&channels, true) as &dyn Encoder, &Raw::new(&channels, false), &rbm] {
            let mut glimpses: Vec<f32> = (0..66 * n).map(|_| rng.random()).collect();
            glimpses[..n].fill(0.5);
            glimpses.chunks_exact_mut(n).for_each(|glimpse| encoder.condition(glimpse));
            conformance::encoder(encoder, &glimpses);
        }
    }
}

#[test]
fn distances_keep_the_law() {
    let mut rng = rng(11);
    let mut features: Vec<f32> = (0..40 * 101).map(|_| rng.random()).collect();
    features[..101].fill(0.0);
    features[101..202].fill(1.0);
    for kind in [
        Kind::Bhattacharyya,
        Kind::BhattacharyyaSquared,
        Kind::Bernoulli,
        Kind::Cosine,
        Kind::Euclidean,
        Kind::Presence { extra: 0.3, cap: 0.5 },
    ] {
        conformance::distance(&kind, &features, 101);
    }
}

#[test]
fn appearances_keep_the_law() {
    for retina in retinas() {
        let (retina, channels) = (Arc::new(retina.clone()), channels(&retina));
        let raw: Arc<dyn Encoder> = Arc::new(Raw::new(&channels, true));
        let rbm: Arc<dyn Encoder> =
            Arc::new(RbmEncoder::new(crate::common::random_rbm(channels.len(), 101), &channels));
        for (encoder, distance) in [(raw, Kind::Cosine), (rbm, Kind::Bhattacharyya)] {
            for sharpness in
                [Sharpness::Fixed(30.0), Sharpness::Calibrated(Calibration { nats: 12.0, least: 5.0, most: 500.0 })]
            {
                conformance::appearance(&|| -> Box<dyn Appearance> {
                    let made = GazeAppearance::new(retina.clone(), encoder.clone(), distance, sharpness);
                    Box::new(made.expect("widths that fit"))
                });
                conformance::appearance(&|| -> Box<dyn Appearance> {
                    let made = GazeAppearance::new(retina.clone(), encoder.clone(), distance, sharpness);
                    Box::new(made.expect("widths that fit").with_discriminant(discriminant::Settings::default()))
                });
            }
        }
    }
}
