use super::*;
use crate::identity::rbm_encoder::{Precision, RbmEncoder};
use crate::identity::retina::{Foveal, FovealConfig};
use foveate_learn::rbm::{Rbm, Visible};
use rand::RngExt;

const N: usize = 150;
const EXTENT: Extent = Extent { half_w: 14.0, half_h: 12.0 };
const GAZE: Gaze = Gaze { u: 0.3, v: -0.2, arm: None };

fn states() -> Vec<State> {
    let mut rng = Streams::new(3, 0).rng(1);
    let mut off = |size: f64| size * (rng.random::<f64>() - 0.5);
    (0..N)
        .map(|_| State {
            x: 40.0 + off(9.0),
            y: 40.0 + off(9.0),
            log_scale: off(0.1),
            angle: off(0.2),
            log_aspect: off(0.1),
            ..State::default()
        })
        .collect()
}

/// Of random weights, a template taken of noise, the particles' surroundings seen.
fn appearance(precision: Precision, distance: Kind) -> GazeAppearance {
    let mut rng = Streams::new(3, 0).rng(0);
    let retina = Foveal::new(FovealConfig::authors()).expect("whole cells");
    let (n_v, n_h) = (retina.glimpse_len(), 200);
    let mut values = |n: usize| (0..n).map(|_| rng.random::<f32>() - 0.5).collect::<Vec<f32>>();
    let rbm = Rbm::new(Visible::Bernoulli, values(n_v * n_h), values(n_v), values(n_h)).expect("shapes that fit");
    let encoder = RbmEncoder::new(rbm, &vec![0; n_v]).rounded(precision);
    let fixed = Sharpness::Fixed(1.0);
    let mut it = GazeAppearance::new(Arc::new(retina), Arc::new(encoder), distance, fixed).expect("parts that fit");
    let image = Image::new(80, 80, 1, (0..80 * 80).map(|_| rng.random()).collect()).expect("one byte a pixel");
    it.init_template(&image, &State { x: 40.0, y: 40.0, ..State::default() }, EXTENT, Streams::new(3, 0));
    it.prepare(&image, &states(), &[GAZE]);
    it
}

fn distances(it: &mut GazeAppearance, states: &[State], threads: usize) -> Vec<f64> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let mut out = vec![f64::NAN; states.len()];
    pool.install(|| it.distances(states, GAZE, &mut out));
    out
}

/// To the bit: neither the threads nor the other particles change a distance.
#[test]
fn a_distance_depends_on_its_state_alone() {
    for precision in [Precision::F32, Precision::Bf16, Precision::Int8] {
        for kind in [Kind::Bhattacharyya, Kind::Cosine] {
            let (mut it, states) = (appearance(precision, kind), states());
            let together = distances(&mut it, &states, 1);
            assert_eq!(together, distances(&mut it, &states, 3), "{kind:?} {precision:?}");
            let alone: Vec<f64> = states.iter().flat_map(|s| distances(&mut it, &[*s], 1)).collect();
            assert_eq!(together, alone, "{kind:?} {precision:?}");
        }
    }
}

/// In shape and colour, except the last bits of places: the looks at states all over a picture, in rectangles of their own,
/// equal the looks at each alone; rectangles of more states are added, and the space between stays out.
#[test]
fn scattered_states_are_seen_as_each_alone() {
    let mut rng = Streams::new(3, 0).rng(5);
    let image = Image::new(700, 500, 3, (0..700 * 500 * 3).map(|_| rng.random()).collect()).expect("bytes");
    let mut it =
        appearance(Precision::F32, Kind::Cosine).with_colour(Some(crate::identity::colour::Settings::default()));
    it.init_template(&image, &State { x: 200.0, y: 150.0, ..State::default() }, EXTENT, Streams::new(3, 0));
    let mut about =
        |x: f64, y: f64| State { x: x + rng.random::<f64>(), y: y + rng.random::<f64>(), ..State::default() };
    let corners = [(20.0, 20.0), (680.0, 20.0), (20.0, 480.0), (680.0, 490.0), (-30.0, 250.0)];
    let states: Vec<State> = (0..60).map(|k| about(corners[k % 5].0, corners[k % 5].1)).collect();
    let more: Vec<State> = (0..60).map(|k| about(200.0, 150.0 + (k % 3) as f64)).chain(states.clone()).collect();
    it.prepare(&image, &states, &[GAZE]);
    assert!(it.buffers.views.count() > 2, "corners are not worth the whole picture");
    let mut together = distances(&mut it, &states, 1);
    let before = it.buffers.views.count();
    it.extend(&image, &states, &[GAZE]);
    assert_eq!(it.buffers.views.count(), before, "all is there");
    it.extend(&image, &more, &[GAZE]);
    assert_eq!(it.buffers.views.count(), before + 1);
    together.extend(distances(&mut it, &more, 2));
    let alone = states.iter().chain(&more).map(|state| {
        it.prepare(&image, &[*state], &[GAZE]);
        distances(&mut it, &[*state], 1)[0]
    });
    let alone: Vec<f64> = alone.collect();
    assert_eq!(together.len(), alone.len());
    for (a, b) in together.iter().zip(&alone) {
        assert!((a - b).abs() < 1e-6, "{a} together, {b} alone");
    }
}

/// Overlaps straight from the product are those of the features; rounding moves a distance by less than a hundredth.
#[test]
fn ways_to_a_distance_agree() {
    let mut exact = appearance(Precision::F32, Kind::BhattacharyyaSquared);
    let (states, mut percept) = (states(), Percept::default());
    let unrounded = distances(&mut exact, &states, 1);
    for precision in [Precision::F32, Precision::Bf16, Precision::Int8] {
        let mut it = appearance(precision, Kind::BhattacharyyaSquared);
        let together = distances(&mut it, &states, 1);
        for ((state, d), unrounded) in states.iter().zip(&together).zip(&unrounded) {
            it.glimpse(state, GAZE, &mut percept);
            assert!((percept.distance - d).abs() < 1e-6, "{precision:?}: {d}, not {}", percept.distance);
            let most = if precision == Precision::F32 { 0.0 } else { 0.01 * unrounded + 1e-5 };
            assert!((d - unrounded).abs() <= most, "{precision:?}: {d}, not {unrounded}");
        }
    }
}

/// A new template replaces the old one's features at the same gaze.
#[test]
fn a_new_template_is_used_at_once() {
    let mut it = appearance(Precision::F32, Kind::Euclidean);
    let (image, there) = (Image::grey(80, 80, 200), State { x: 30.0, y: 50.0, ..State::default() });
    assert!(distances(&mut it, &states()[..1], 1)[0] > 1e-3);
    it.init_template(&image, &there, EXTENT, Streams::new(3, 0));
    it.prepare(&image, &[there], &[GAZE]);
    assert_eq!(distances(&mut it, &[there], 1), [0.0]);
}

/// Settled on a gaze it is, to the bit, what an appearance with its retina there has been from the first frame on; gazes are counted
/// from there; and a new target is looked at from the centre again.
#[test]
fn settled_it_is_as_if_it_had_always_looked_there() {
    use crate::identity::discriminant;
    use crate::identity::oriented::{Oriented, Weights};
    let mut rng = Streams::new(5, 0).rng(0);
    let image = Image::new(90, 80, 3, (0..90 * 80 * 3).map(|_| rng.random()).collect()).expect("one byte a pixel");
    let config = FovealConfig { side: 16.0, rings: vec![[10, 1]], colour: vec![[8, 4]] };
    let retina = Foveal::new(config).expect("whole cells");
    let channels: Vec<usize> = retina.cells().iter().map(|c| c.channel).collect();
    let encoder = Arc::new(Oriented::new(&channels, Weights::default()).expect("a square of cells"));
    let make = |retina: Arc<dyn Retina>| {
        GazeAppearance::new(retina, encoder.clone(), Kind::Cosine, Sharpness::Fixed(60.0))
            .expect("parts that fit")
            .with_discriminant(discriminant::Settings::default())
    };
    let (at, streams) = (State { x: 40.0, y: 40.0, ..State::default() }, Streams::new(3, 0));
    let judge = |it: &mut GazeAppearance, gaze: Gaze| {
        let mut out = vec![0.0; N];
        it.prepare(&image, &states(), &[gaze]);
        it.log_likelihood(&states(), gaze, &mut out);
        out
    };
    let home = Gaze { u: -0.5, v: 0.5, arm: Some(2) };
    let mut always = make(retina.about(home));
    let expected = always.init_template(&image, &at, EXTENT, streams);
    let mut settled = make(Arc::new(retina));
    settled.init_template(&image, &at, EXTENT, streams);
    let centred = judge(&mut settled, Gaze::CENTRE);
    let reference = settled.commit_gaze(home, streams);
    assert_eq!(judge(&mut settled, Gaze::CENTRE), judge(&mut always, Gaze::CENTRE));
    assert_eq!(judge(&mut settled, GAZE.relative_to(home)), judge(&mut always, GAZE.relative_to(home)));
    assert_eq!(reference, Some(expected));
    let mut other = make(settled.centred.clone());
    other.load(&settled.save()).expect("it was saved");
    assert_eq!(judge(&mut other, Gaze::CENTRE), judge(&mut settled, Gaze::CENTRE));
    let mut saved = settled.save().read::<serde_json::Value>().expect("any value");
    saved["committed"]["u"] = serde_json::json!(1e9);
    assert!(other.load(&SavedState::new(&saved)).is_err(), "a gaze far from the template");
    settled.init_template(&image, &at, EXTENT, streams);
    assert_eq!(judge(&mut settled, Gaze::CENTRE), centred);
    assert!(settled.with_steady_gaze(true).commit_gaze(home, streams).is_none(), "there the gaze moves a sensor");
    assert!(make(always.centred.clone()).commit_gaze(home, streams).is_none(), "before there is a target");
}
