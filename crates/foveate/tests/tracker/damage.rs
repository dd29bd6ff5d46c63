//! Damaged configurations, saved trackers and model files: none panics, and errors name the refused file.

use crate::common::{POLICIES, blueprint, natural, random_rbm};
use crate::config::{GOOD, check};
use foveate::config::Config;
use foveate::files::Folder;
use foveate::geometry::BBox;
use foveate::learn::rbm::Metadata;
use foveate::rng::Streams;
use foveate::scene::Image;
use foveate_testing::damaged;
use rand::RngExt;

/// 4,000 damaged texts.
#[test]
fn damaged_configurations_never_panic() {
    let words = ["nan", "inf", "1e300", "-1", "[[", "= {", "\n[policy.policy]\n", "kind = \"rbm\""];
    let mut good = 0;
    for seed in 0..4000 {
        let bytes = damaged(GOOD.as_bytes(), &words, seed);
        good += usize::from(check(&String::from_utf8_lossy(&bytes)).is_ok());
    }
    assert!(good > 0, "some changes do no harm");
    let deep = format!("[policy{}]\nkind = \"fixed\"\n", ".policy".repeat(20_000));
    let inline = format!("policy = {}", "{ kind = \"anchor\", policy = ".repeat(20_000));
    for text in [deep, inline] {
        assert!(check(&text).is_err());
    }
}

/// 6,000 damaged texts of saved trackers. A state that loads continues, whatever its numbers.
#[test]
fn damaged_saved_trackers_never_panic() {
    let words = ["null", "1e308", "-1e308", "1e400", "1e-320", "99999", "[]", "-0.0", ":0,"];
    let picture = |name: u64| {
        let mut rng = Streams::new(name, 0).rng(1);
        let data = (0..24 * 20).map(|_| rng.random()).collect();
        Image::new(24, 20, 1, data).expect("24 x 20")
    };
    let (mut taken, frames) = (0, [picture(1), picture(2)]);
    for policy in [POLICIES[2], POLICIES[4], POLICIES[6]] {
        let blueprint = blueprint(policy, false, 0.5, false, 8);
        let mut tracker = blueprint.tracker(1).expect("parts that fit");
        tracker.init(&frames[0], BBox { x: 6.0, y: 5.0, w: 8.0, h: 7.0 }).expect("a box in the picture");
        tracker.update(&frames[1]).expect("a picture of the first size");
        let saved = tracker.save().to_string().into_bytes();
        for seed in 0..2000 {
            let Ok(value) = serde_json::from_slice(&damaged(&saved, &words, seed)) else { continue };
            let mut fresh = blueprint.tracker(1).expect("parts that fit");
            if fresh.load(&value).is_ok() && fresh.has_target() {
                let went_on = frames.iter().all(|picture| match fresh.update(picture) {
                    Ok(_) => true,
                    Err(error) => {
                        // The size of the pictures is one of the numbers.
                        assert!(error.to_string().contains("the picture is 24 x 20 with 1 planes"), "{error}");
                        false
                    }
                });
                let _ = fresh.save().to_string();
                taken += usize::from(went_on);
            }
        }
    }
    assert!(taken > 100, "{taken} of the damaged states could be taken up");
    let numbers = [
        ("half_w", "1e308"),
        ("half_h", "0"),
        ("unit", "1e308"),
        ("log_scale", "1e308"),
        ("log_aspect", "-1e308"),
        ("x", "-1e308"),
        ("vx", "1e308"),
        ("angle", "-1e308"),
        ("sharpness", "1e308"),
        ("evidence", "-1e308"),
        ("deviation", "1e308"),
        ("shortfall", "-1e308"),
        ("deficit", "1e308"),
        ("settled", "10000"),
        ("frame", "281474976710656"),
    ];
    for blueprint in [blueprint(POLICIES[0], false, 1.0, false, 8), natural(8)] {
        for (key, wrong) in numbers {
            let mut tracker = blueprint.tracker(1).expect("parts that fit");
            tracker.init(&frames[0], BBox { x: 6.0, y: 5.0, w: 8.0, h: 7.0 }).expect("a box in the picture");
            let text = tracker.save().to_string();
            assert!(text.contains(&format!("\"{key}\":")), "{key} is one of the numbers");
            let all: String = (text.split(&format!("\"{key}\":")).enumerate())
                .map(|(i, part)| match (i, part.find([',', '}'])) {
                    (0, _) | (_, None) => part.to_owned(),
                    (_, Some(end)) => format!("\"{key}\":{wrong}{}", &part[end..]),
                })
                .collect();
            let mut fresh = blueprint.tracker(1).expect("parts that fit");
            if fresh.load(&serde_json::from_str(&all).expect("JSON still")).is_ok() {
                for picture in &frames {
                    fresh.update(picture).expect("a picture of the first size");
                }
            }
        }
    }
}

/// 300 damaged model files, by way of a configuration.
#[test]
fn damaged_models_are_refused_by_name() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let config = GOOD.replace("kind = \"raw\"\nstandardise = true", "kind = \"rbm\"\nweights = \"m.safetensors\"");
    let config =
        config.replace("[retina]\nkind = \"foveal\"\nside = 28.0\nrings = [[8, 2], [16, 4]]\ncolour = [[16, 4]]\n", "");
    let config = Config::parse(&config, "test").expect("a good configuration");
    let metadata = |retina: &str| Metadata { retina: retina.into(), ..Metadata::default() };
    let put = |bytes: &[u8]| std::fs::write(dir.path().join("m.safetensors"), bytes).expect("a writable folder");
    let retina = "{\"side\":28.0,\"rings\":[[8,2],[16,4]]}";
    let good = random_rbm(28, 5).to_bytes(&metadata(retina));
    put(&good);
    config.clone().check(&Folder::new(dir.path())).map(|_| ()).expect("a good model");
    for seed in 0..300 {
        let bytes = damaged(&good, &["null", "99"], seed);
        put(&bytes);
        if let Err(error) = config.clone().check(&Folder::new(dir.path())) {
            assert!(error.to_string().contains("m.safetensors"), "{error}");
        } else {
            assert_eq!(bytes, good, "a damaged model passed");
        }
    }
    for (bytes, words) in [
        (random_rbm(29, 5).to_bytes(&metadata(retina)), "takes 29 values, but the retina gives 28"),
        (random_rbm(28, 5).to_bytes(&metadata("a round one")), "does not describe a retina"),
        (random_rbm(28, 5).to_bytes(&metadata("{\"side\":28,\"rings\":[[8,0]]}")), "[8, 0]"),
    ] {
        put(&bytes);
        let error = config.clone().check(&Folder::new(dir.path())).expect_err(words).to_string();
        assert!(error.contains(words), "{error}");
    }
}
