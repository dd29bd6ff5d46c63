//! Shared parts of the tests of the whole tracker: small videos and trackers of every kind.
#![allow(dead_code, reason = "each test file uses a part")]

use foveate::files::Folder;
use std::path::Path;
use std::sync::Arc;

use foveate::config::{Blueprint, Config};
use foveate::extend::SavedState;
use foveate::geometry::BBox;
use foveate::identity::rbm_encoder::RbmEncoder;
use foveate::identity::retina::FovealConfig;
use foveate::identity::{Foveal, Retina};
use foveate::learn::rbm::{Rbm, Visible};
use foveate::rng::Streams;
use foveate::scene::Image;
use foveate::video::Frame;
use rand::RngExt;

/// Returns a saved state as JSON, to look into it or to damage it.
pub(crate) fn json(saved: &SavedState) -> serde_json::Value {
    saved.read().expect("any JSON")
}

/// Where the target of [`frame`] is in frame 0.
pub(crate) const INIT: BBox = BBox { x: 20.0, y: 30.0, w: 24.0, h: 20.0 };

/// The target's box in a later frame.
pub(crate) fn truth(index: usize) -> BBox {
    BBox { x: INIT.x + index as f64, y: INIT.y + (index / 2) as f64, ..INIT }
}

/// A patch with a texture of its own drifts over another texture; 1 or 3 planes of 120 × 90.
pub(crate) fn frame(index: usize, planes: usize) -> Frame {
    let (w, h) = (120, 90);
    let at = truth(index);
    let pixel = |plane: usize, x: usize, y: usize| {
        let (u, v) = (x as isize - at.x as isize, y as isize - at.y as isize);
        let inside = (0..24).contains(&u) && (0..20).contains(&v);
        let plane = plane as isize;
        if inside {
            (80 + 30 * plane + (37 * (u / 3) * (v / 3 + plane)) % 120) as u8
        } else {
            ((x * y + 13 * (x / 9)) % 97) as u8
        }
    };
    let data = (0..planes * w * h).map(|i| pixel(i / (w * h), i % w, i / w % h)).collect();
    Frame { index, time: index as f64 / 30.0, image: Image::new(w, h, planes, data).expect("120 x 90") }
}

/// The policies, as TOML.
pub(crate) const POLICIES: [&str; 7] = [
    "{ kind = \"fixed\", u = 0.25, v = -0.25 }",
    "{ kind = \"random\" }",
    "{ kind = \"circular\" }",
    "{ kind = \"hedge\", gamma = 0.5 }",
    "{ kind = \"anchor\", policy = { kind = \"hedge\", gamma = 0.5 } }",
    "{ kind = \"anchor\", policy = { kind = \"random\" } }",
    "{ kind = \"pool\", gamma = 0.5, looks = 2 }",
];

/// A checked configuration of `particles`; `rbm` puts a small random machine in the place of the raw encoder.
pub(crate) fn blueprint(policy: &str, rbm: bool, below: f64, colour: bool, particles: usize) -> Blueprint {
    let colour: Vec<[usize; 2]> = if colour { vec![[16, 4]] } else { vec![] };
    let distance = if rbm { "bhattacharyya" } else { "cosine" };
    let text = format!(
        "seed = 5\nparticles = {particles}\nresampling = {{ scheme = \"systematic\", below = {below:?} }}\n\
         dynamics = {{ kind = \"autoregressive\", angle = 0.02 }}\n\
         retina = {{ kind = \"foveal\", side = 28, rings = [[8, 1], [16, 2], [24, 4]], colour = {colour:?} }}\n\
         encoder = {{ kind = \"raw\" }}\n\
         likelihood = {{ distance = \"{distance}\", calibrate = {{ nats = 12, least = 5, most = 500 }} }}\n\
         policy = {policy}\n"
    );
    let raw = Config::parse(&text, "test").and_then(|c| c.check(&Folder::here())).expect("a good configuration");
    if !rbm {
        return raw;
    }
    let rings = vec![[8, 1], [16, 2], [24, 4]];
    let retina = Foveal::new(FovealConfig { side: 28.0, rings, colour }).expect("whole cells");
    let channels: Vec<usize> = retina.cells().iter().map(|c| c.channel).collect();
    raw.with(Arc::new(retina), Arc::new(RbmEncoder::new(random_rbm(channels.len(), 100), &channels)))
}

/// The configuration for real video, of fewer particles.
pub(crate) fn natural(particles: usize) -> Blueprint {
    let config = Config::builtin("natural").expect("it ships").expect("it is right");
    Config { particles, ..config }.check(&Folder::here()).expect("a good configuration")
}

/// A Gaussian machine of random weights: some units are on, some off, at any glimpse.
pub(crate) fn random_rbm(n_v: usize, n_h: usize) -> Rbm {
    let mut rng = Streams::new(11, 0).rng(0);
    let mut values = |n: usize, size: f32| (0..n).map(|_| size * (rng.random::<f32>() - 0.5)).collect::<Vec<f32>>();
    let (weights, visible, hidden) = (values(n_v * n_h, 1.0), values(n_v, 0.1), values(n_h, 1.0));
    Rbm::new(Visible::Gaussian, weights, visible, hidden).expect("shapes that fit")
}

/// A model file of a small multi-fixation RBM with three classes, of random weights, that reads the glimpses of a foveal
/// retina; in a folder that goes when it is dropped.
pub(crate) fn random_recogniser() -> (tempfile::TempDir, String) {
    use foveate::learn::rbm::fixations::{About, Code, Cost, Places, Recipe, Sequences, Trainer};
    use foveate::learn::training::Training;
    use foveate::rows::Rows;
    let retina = Foveal::new(FovealConfig { side: 28.0, rings: vec![[8, 2], [16, 4]], colour: vec![] });
    let n_v = retina.expect("whole cells").glimpse_len();
    let mut rng = Streams::new(12, 0).rng(0);
    let x: Vec<f32> = (0..30 * 2 * n_v).map(|_| rng.random()).collect();
    let z: Vec<Code> = (0..60).map(|i| Code::one_hot(i % 9)).collect();
    let y: Vec<u8> = (0..30).map(|i| i % 3).collect();
    let data = Sequences::new(Rows::new(&x, n_v), &z, &y, 2).expect("they fit");
    let usual = Recipe::new(Cost::Hybrid, 2, 3, Places::grid(3, 0.5).expect("nine places"));
    let recipe = Recipe { hidden: 12, factors: 10, epochs: 3, rate: 0.1, batch: 5, ..usual };
    let mut trainer = Trainer::new(recipe, data).expect("they fit");
    while !trainer.is_done() {
        trainer.epoch(data);
    }
    let metadata = foveate::learn::rbm::Metadata {
        retina: "{\"side\":28.0,\"rings\":[[8,2],[16,4]]}".into(),
        ..foveate::learn::rbm::Metadata::default()
    };
    let about = About { metadata, first_layer: String::new(), temperature: 1.0 };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("m.safetensors");
    trainer.learned().expect("finite").save(&path, &about).expect("a writable folder");
    (folder, path.display().to_string())
}

/// The same configuration with this recogniser; `policy` as TOML, or empty for the usual one.
pub(crate) fn with_recogniser(blueprint: &Blueprint, weights: &str, accumulate: &str, policy: &str) -> Blueprint {
    let policy = if policy.is_empty() { String::new() } else { format!(", policy = {policy}") };
    let text = format!(
        "{}\n[recogniser]\nkind = \"multi-fixation\"\nweights = '{weights}'\naccumulate = {accumulate}\n",
        blueprint.config().to_toml()
    );
    let text = if policy.is_empty() { text } else { format!("{text}{}\n", &policy[2..]) };
    Config::parse(&text, "test").and_then(|c| c.check(&Folder::here())).expect("a good configuration")
}

/// The text of a page in a browser at this `#fragment`, without scripts; an error if no browser shows it.
pub(crate) fn shown(page: &Path, fragment: &str) -> Result<String, String> {
    let profile = tempfile::tempdir().expect("a temporary folder");
    let profile = format!("--user-data-dir={}", profile.path().display());
    let address = format!("file://{}#{fragment}", page.display());
    let ask =
        ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=4000", "--dump-dom", &profile, &address];
    let answer = std::process::Command::new("chromium").args(ask).output().map_err(|_| "chromium")?;
    let shown = String::from_utf8_lossy(&answer.stdout);
    let (_, body) = shown.split_once("<body>").ok_or("chromium that shows pages")?;
    Ok(body.split("<script").next().expect("the page above its scripts").into())
}
