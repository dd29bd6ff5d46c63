//! Parts of a user's own: named in a configuration, for one target and for many, saved and resumed.

use foveate::config::Config;
use foveate::control::{Reward, VarianceReduction};
use foveate::extend::{Parts, SavedState};
use foveate::files::Folder;
use foveate::gaze::{Context, Grid, Plan, Policy};
use foveate::geometry::{Extent, Gaze, State};
use foveate::identity::Encoder;
use foveate::identity::oriented::{Oriented, Weights};
use foveate::identity::retina::Retina;
use foveate::rng::Rng;
use foveate::rows::{Rows, RowsMut};
use foveate::scene::{Detection, Detector, Image, Map};
use foveate::{BBox, MultiTracker, Result, Tracker};
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Places {
    n: usize,
}

/// Stays at a gaze that is rewarded with more than a half.
struct WinStay {
    gazes: Vec<Gaze>,
    at: usize,
}

impl Policy for WinStay {
    fn plan(&mut self, _: &Context, plan: &mut Plan, _: &mut Rng) {
        plan.only(self.gazes[self.at]);
    }
    fn learn(&mut self, _: &Plan, rewards: &[f64]) {
        if rewards[0] <= 0.5 {
            self.at = (self.at + 1) % self.gazes.len();
        }
    }
    fn save(&self) -> SavedState {
        SavedState::new(&self.at)
    }
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        self.at = saved.read()?;
        Ok(())
    }
    fn reset(&mut self) {
        self.at = 0;
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Nothing {}

struct Sevenths(VarianceReduction);

impl Reward for Sevenths {
    fn reward(&mut self, s: &[State], prior: &[f64], l: &[f64], believed: (&State, Extent)) -> f64 {
        (7.0 * self.0.reward(s, prior, l, believed)).floor() / 7.0
    }
}

/// Standardised glimpses, times `gain`.
struct Scaled {
    width: usize,
    gain: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Gain {
    gain: f32,
}

impl Encoder for Scaled {
    fn shape(&self) -> (usize, usize) {
        (self.width, self.width)
    }
    fn condition(&self, glimpse: &mut [f32]) {
        foveate::identity::encoder::standardise(glimpse);
    }
    fn encode(&self, glimpses: Rows<'_>, mut features: RowsMut<'_>) {
        features.data().iter_mut().zip(glimpses.data()).for_each(|(h, v)| *h = self.gain * v);
    }
}

/// Glimpses as they are: all are about as bright.
struct Bare(usize);

impl Encoder for Bare {
    fn shape(&self) -> (usize, usize) {
        (self.0, self.0)
    }
    fn encode(&self, glimpses: Rows<'_>, mut features: RowsMut<'_>) {
        features.data().copy_from_slice(glimpses.data());
    }
}

/// Finds the square of [`picture`], once a frame.
#[derive(Default)]
struct Found {
    frames: usize,
    map: Map,
}

impl Detector for Found {
    fn detect(&mut self, _: &Image, found: &mut Vec<Detection>) {
        found.clear();
        found.push(Detection::new(BBox::new(40.0 + 2.0 * self.frames as f64, 30.0, 24.0, 24.0), 1.0));
        self.frames += 1;
    }
    fn map(&self) -> &Map {
        &self.map
    }
}

fn parts() -> Parts {
    Parts::new()
        .with_policy("win-stay", |it: Places| Ok(WinStay { gazes: Grid { n: it.n, reach: 0.5 }.gazes(), at: 0 }))
        .with_reward("sevenths", |_: Nothing| Ok(Sevenths(VarianceReduction::new(0.3)?)))
        .with_encoder("scaled", |it: Gain, site| {
            let retina = site.retina()?;
            let width = retina.glimpse_len();
            Ok((retina, Scaled { width, gain: it.gain }))
        })
        .with_encoder("bare", |_: Nothing, site| {
            let retina = site.retina()?;
            let width = retina.glimpse_len();
            Ok((retina, Bare(width)))
        })
        .with_encoder("gradients", |_: Nothing, site| {
            let retina = site.retina()?;
            let channels: Vec<usize> = retina.cells().iter().map(|cell| cell.channel).collect();
            Ok((retina, Oriented::new(&channels, Weights::default())?))
        })
        .with_detector("found", |_: Nothing| Ok(Found::default()))
}

fn config(settings: &[&str]) -> Result<Config> {
    let config = Config::builtin("natural-raw").expect("it ships")?.with_parts(&parts()).set("particles=60")?;
    settings.iter().try_fold(config, |config, setting| config.set(setting))
}

/// A textured square that moves over a ramp.
fn picture(t: usize) -> Image {
    let pixel = |x: usize, y: usize| {
        let (u, v) = (x as isize - 40 - 2 * t as isize, y as isize - 30);
        let inside = (0..24).contains(&u) && (0..24).contains(&v);
        if inside { (128.0 + 100.0 * ((u * v) as f64 / 9.0).sin()) as u8 } else { (x / 2 + y) as u8 }
    };
    Image::new(120, 80, 1, (0..120 * 80).map(|i| pixel(i % 120, i / 120)).collect()).expect("120 x 80")
}

const ALL: [&str; 3] =
    ["policy={ kind = \"win-stay\", n = 2 }", "reward.kind=sevenths", "encoder={ kind = \"scaled\", gain = 2.0 }"];

fn boxes(tracker: &mut Tracker, frames: std::ops::Range<usize>) -> Vec<BBox> {
    frames.map(|t| tracker.update(&picture(t)).expect("a picture").bbox).collect()
}

#[test]
fn one_target_is_followed_and_resumed_by_the_users_parts() {
    let config = config(&ALL).expect("registered parts");
    let text = config.to_toml();
    assert!(text.contains("kind = \"win-stay\"") && text.contains("n = 2"), "{text}");
    assert_eq!(Config::parse_with(&text, "again", &parts()).expect("it was written"), config);
    let mut tracker = Tracker::new(&config).expect("parts that fit");
    tracker.init(&picture(0), BBox::new(40.0, 30.0, 24.0, 24.0)).expect("a box in the picture");
    boxes(&mut tracker, 1..6);
    let saved = tracker.save();
    assert!(saved.to_string().contains("win-stay"), "a saved state names the parts");
    let rest = boxes(&mut tracker, 6..12);
    assert!((rest[5].x - 62.0).abs() < 4.0, "{rest:?}");
    let mut other = Tracker::new(&config).expect("parts that fit");
    other.load(&saved).expect("its own state");
    assert_eq!(boxes(&mut other, 6..12), rest);
    let another = self::config(&[ALL[0], "reward.kind=sevenths"]).expect("registered parts");
    let error = Tracker::new(&another).expect("parts that fit").load(&saved).expect_err("another encoder").to_string();
    assert!(error.contains("encoder"), "{error}");
}

#[test]
fn many_targets_are_found_and_followed_by_the_users_parts() {
    let many = [ALL[0], ALL[1], ALL[2], "detector.kind=found", "multi_target={}"];
    let mut tracker = MultiTracker::new(config(&many).expect("registered parts")).expect("parts that fit");
    for t in 0..12 {
        tracker.update(&picture(t), &[]).expect("a picture");
    }
    let boxes: Vec<BBox> = tracker.targets().iter().map(|target| target.bbox).collect();
    assert!(boxes.len() == 1 && (boxes[0].x - 62.0).abs() < 4.0, "{boxes:?}");
}

#[test]
fn an_unknown_kind_lists_the_registered_ones() {
    let text = config(&[]).expect("it ships").to_toml().replace("kind = \"fixed\"", "kind = \"win-saty\"");
    for (parts, listed) in [(parts(), true), (Parts::new(), false)] {
        let error = Config::parse_with(&text, "my.toml", &parts).expect_err("no such policy").to_string();
        assert!(
            error.contains("my.toml: ") && error.contains("unknown kind `win-saty`, expected one of `fixed`"),
            "{error}"
        );
        assert_eq!(error.contains("`anchor`, `win-stay`"), listed, "{error}");
    }
    let natural = Config::builtin("natural").expect("it ships").expect("it is right");
    let error = natural.set("observation_model.kind=mine").expect_err("none is registered").to_string();
    assert!(error.contains("unknown kind `mine`, expected a part that the program registers"), "{error}");
}

#[test]
fn settings_that_do_not_fit_are_refused_by_name() {
    for (setting, said) in [
        ("policy={ kind = \"win-stay\" }", "policy, kind `win-stay`: missing field `n`"),
        ("policy={ kind = \"win-stay\", n = 2, m = 1 }", "unknown field `m`"),
        ("policy={ kind = \"anchor\", policy = { kind = \"win-stay\", n = \"x\" } }", "expected a whole number"),
        ("encoder={ kind = \"scaled\", gain = \"loud\" }", "encoder, kind `scaled`"),
        ("reward={ kind = \"sevenths\", of = 3 }", "unknown field `of`"),
        ("detector={ kind = \"found\", of = 3 }", "unknown field `of`"),
    ] {
        let error = config(&[setting]).and_then(|c| c.check(&Folder::here())).expect_err(setting).to_string();
        assert!(error.contains(said), "{setting}: {error}");
    }
}

/// A law-abiding encoder that does not suit distance or sharpness would follow nothing.
#[test]
fn an_encoder_that_does_not_suit_is_refused() {
    let scaled = "encoder={ kind = \"scaled\", gain = 2.0 }";
    for (settings, said) in [
        (&["encoder.kind=bare"][..], "on a test picture the target is only"),
        (&[scaled, "likelihood.distance=bhattacharyya"], "needs features of 0 or more"),
        (&[scaled, "likelihood.distance=bernoulli"], "needs features of 0 to 1"),
        (&[scaled, "likelihood.sharpness=100000"], "one particle has all the weight"),
        (&["encoder={ kind = \"scaled\", gain = inf }"], "features must be finite"),
    ] {
        let error = config(settings).and_then(|c| c.check(&Folder::here())).expect_err(said).to_string();
        assert!(error.contains("encoder: ") && error.contains(said), "{error}");
    }
    let calibrated =
        ["encoder.kind=bare", "likelihood={ distance = \"cosine\", calibrate = { nats = 12, least = 1, most = 1e5 } }"];
    config(&calibrated).and_then(|c| c.check(&Folder::here())).expect("the first frame chooses the sharpness");
    let natural = Config::builtin("natural").expect("it ships").expect("it is right").with_parts(&parts());
    let natural = ["variation=none", "encoder.kind=gradients"].iter().try_fold(natural, |config, it| config.set(it));
    natural.and_then(|c| c.check(&Folder::here())).expect("the encoder of `natural`, registered anew");
}

#[test]
#[should_panic(expected = "`hedge` is a part of the library")]
fn names_of_the_library_cannot_be_taken() {
    drop(Parts::new().with_policy("hedge", |it: Places| Ok(WinStay { gazes: vec![Gaze::CENTRE; it.n], at: 0 })));
}
