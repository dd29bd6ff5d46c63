//! Configurations, saved trackers and model files that are wrong: each is refused in words, and none panics.

use foveate::files::Folder;
use std::path::Path;

use crate::common::{POLICIES, blueprint, natural, random_rbm};
use foveate::config::{BUILTIN, Config};
use foveate::geometry::BBox;
use foveate::learn::rbm::Metadata;
use foveate::rng::{Rng, Streams};
use foveate::scene::Image;
use rand::RngExt;

const GOOD: &str = r#"seed = 1
particles = 100
[resampling]
scheme = "residual"
below = 0.5
[dynamics]
kind = "autoregressive"
damping = 0.9
velocity = 0.1
position = 0.1
scale_pull = 0.9
log_scale = 0.01
angle_pull = 0.9
angle = 0.0
[start]
position = 0.05
velocity = 0.1
log_scale = 0.0
angle = 0.0
[retina]
kind = "foveal"
side = 28.0
rings = [[8, 2], [16, 4]]
colour = [[16, 4]]
[encoder]
kind = "raw"
standardise = true
[likelihood]
distance = { presence = { extra = 0.3, cap = 0.5 } }
calibrate = { nats = 12.0, least = 5.0, most = 200.0 }
[policy]
kind = "anchor"
[policy.policy]
kind = "hedge"
gamma = 0.5
grid = { n = 3, reach = 0.5 }
[reward]
kind = "variance-reduction"
temperature = 0.3
[consistency]
memory = 0.3
threshold = 0.6
temperature = 0.25
flat = 0.9
[proposal]
kind = "mixture"
alpha = 0.25
spread = 0.3
size = 0.1
gate = 4.0
[detection_likelihood]
place = 0.2
size = 0.1
outlier = 0.02
[camera_motion]
camera = 1.0
local = 0.5
[detector]
kind = "saliency"
[redetection]
every = 3
step = 0.5
share = 0.3
places = 20
fit = 0.7
spread = 0.2
chance = 0.01
[discriminant]
mixing_weight = 0.5
learning_rate = 0.1
first_frame_weight = 0.5
gate = 1.0
[distractors]
step = 0.5
reach = 4.0
[local_search]
fit = 0.5
chance = 0.02
share = 0.2
places = 3
spread = 0.15
"#;

fn check(text: &str) -> foveate::Result<()> {
    Config::parse(text, "my.toml")?.check(&Folder::here()).map(|_| ())
}

/// What is said of the good configuration with one line of a section changed.
fn error(section: &str, from: &str, to: &str) -> String {
    let at = if section.is_empty() { 0 } else { GOOD.find(section).expect("a section of the text") };
    assert!(GOOD[at..].contains(from), "{section} {from}");
    let text = format!("{}{}", &GOOD[..at], GOOD[at..].replacen(from, to, 1));
    check(&text).expect_err(&format!("{to} must be refused")).to_string()
}

#[test]
fn mistakes_are_told_with_place_and_valid_names() {
    check(GOOD).expect("a good configuration");
    let mut missing = vec![];
    for (section, from, to, words) in [
        ("", "particles = 100", "particels = 100", &["line 2, column 1", "particels", "`particles`"][..]),
        ("[dynamics]", "damping", "dampin", &["line 6, column 1", "dampin", "`damping`", "`angle_pull`"]),
        ("[start]", "position", "place", &["line 16, column 1", "place", "`position`"]),
        ("[retina]", "rings", "windows", &["line 20, column 1", "windows", "`rings`"]),
        ("[policy.policy]", "hedge", "hegde", &["line", "column", "hegde", "`hedge`", "`circular`"]),
        ("[dynamics]", "autoregressive", "brownian", &["line 7, column 8", "brownian", "`autoregressive`"]),
        ("[encoder]", "raw", "rmb", &["line 26, column 8", "rmb", "`rbm`", "`raw`"]),
        ("[likelihood]", "{ presence = { extra = 0.3, cap = 0.5 } }", "\"cosin\"", &["line 29", "cosin", "`cosine`"]),
        ("[resampling]", "residual", "residuals", &["line 4, column 10", "residuals", "`systematic`"]),
        ("[reward]", "variance-reduction", "variance", &["line 38, column 8", "variance", "`concentration`"]),
        ("", "particles = 100", "particles = \"many\"", &["line 2, column 13", "string", "a whole number"]),
        ("[dynamics]", "velocity = 0.1", "velocity = true", &["line 6", "boolean", "a number"]),
        ("[consistency]", "0.6", "[0.6]", &["line 42, column 13", "sequence", "a number"]),
        ("", "particles = 100", "particles = 0", &["line 2, column 13", "1 to 1000000"]),
        ("", "particles = 100", "particles = -1", &["line 2, column 13", "-1"]),
        ("[resampling]", "0.5", "1.5", &["line 3, column 1", "resampling.below", "0 to 1", "1.5"]),
        ("[dynamics]", "0.9", "1.1", &["line 6, column 1", "dynamics.damping", "1.1"]),
        ("[start]", "0.05", "-1", &["line 15, column 1", "start.position", "-1"]),
        ("[retina]", "[16, 4]", "[17, 4]", &["line 20, column 1", "retina.rings", "[17, 4]"]),
        ("[likelihood]", "least = 5.0", "least = 500.0", &["line 28", "likelihood.calibrate.most", "200"]),
        ("[policy.policy]", "n = 3", "n = 99", &["grid.n", "1 to 31", "99", "line"]),
        ("[reward]", "0.3", "3", &["line 37, column 1", "reward.temperature", "it is 3"]),
        ("[consistency]", "0.25", "-0.1", &["line 40, column 1", "consistency.temperature", "-0.1"]),
        ("[encoder]", "[encoder]", "[encoder", &["line 25, column"]),
        ("[proposal]", "0.25", "1.0", &["line 45, column 1", "proposal.alpha", "0 to 0.99", "it is 1"]),
        ("[proposal]", "spread", "spred", &["line 45", "spred", "`spread`"]),
        ("[detection_likelihood]", "0.02", "0", &["line 51, column 1", "detection_likelihood.outlier", "it is 0"]),
        ("[camera_motion]", "local", "flow", &["line 57, column 1", "flow", "`local`"]),
        ("[detector]", "saliency", "silence", &["line 59", "silence", "`saliency`"]),
        ("[redetection]", "chance = 0.01", "chance = 0", &["line 60, column 1", "redetection.chance", "it is 0"]),
        ("[discriminant]", "gate", "gait", &["line 72, column 1", "gait", "`gate`"]),
        ("[distractors]", "4.0", "0.5", &["line 73, column 1", "distractors.reach", "1 to 50", "it is 0.5"]),
        ("[local_search]", "places = 3", "places = 0", &["line 76, column 1", "local_search.places", "it is 0"]),
    ] {
        let error = error(section, from, to);
        for word in ["my.toml"].iter().chain(words) {
            if !error.contains(word) {
                missing.push(format!("{to}: \"{word}\" is missing in: {error}"));
            }
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
}

/// What is learned by a discriminant says so where there is none.
#[test]
fn parts_of_a_discriminant_ask_for_one() {
    let without = GOOD.split("[discriminant]").next().expect("what is before it");
    for section in ["[distractors]", "[short_term]", "[variation]", "[fusion]"] {
        let said = check(&format!("{without}{section}\n")).expect_err("it has no discriminant").to_string();
        let name = section.trim_matches(['[', ']']);
        for word in [name, "add [discriminant]", &format!("leave {section} out")] {
            assert!(said.contains(word), "{section}: \"{word}\" is missing in: {said}");
        }
    }
}

/// A recogniser looks without a first picture to foretell from, and without a sensor.
#[test]
fn a_recogniser_refuses_policies_that_ask_for_more_than_rewards() {
    let config = Config::builtin("natural").expect("it ships").expect("it is right");
    for policy in [
        "kind = \"gp-ucb\", saliency = 1",
        "kind = \"gp-ucb\", rehearsal = 1",
        "kind = \"contextual\"",
        "kind = \"anchor\", policy = { kind = \"contextual\" }",
    ] {
        let setting =
            format!("recogniser={{ kind = \"multi-fixation\", weights = \"builtin:x\", policy = {{ {policy} }} }}");
        let said = config.clone().set(&setting).and_then(|c| c.check(&Folder::here())).err().expect(policy).to_string();
        assert!(said.contains("recogniser.policy"), "{said}");
    }
}

#[test]
fn local_search_asks_for_distractors() {
    let (before, after) = GOOD.split_once("[distractors]").expect("it has them");
    let without = format!("{before}{}", &after[after.find("[local_search]").expect("it has it")..]);
    let said = check(&without).expect_err("there is nothing to look at").to_string();
    assert!(said.contains("local_search") && said.contains("add [distractors]"), "{said}");
}

/// TOML can write nan and inf: every number there is refuses both.
#[test]
fn every_number_refuses_nan_and_infinity() {
    let mut count = 0;
    for (i, line) in GOOD.lines().enumerate().filter(|(_, line)| !line.contains("[[")) {
        let numbers = line.match_indices(|c: char| c.is_ascii_digit()).filter(|(at, _)| line[..*at].ends_with(' '));
        for (at, _) in numbers {
            let end = line[at..].find([',', ' ']).map_or(line.len(), |n| at + n);
            for wrong in ["nan", "inf", "-inf", "1e300", "-1.0"] {
                let lines = GOOD.lines().enumerate().map(|(k, other)| {
                    if k == i { format!("{}{wrong}{}\n", &line[..at], &line[end..]) } else { format!("{other}\n") }
                });
                let error = check(&lines.collect::<String>()).expect_err(&format!("{line} with {wrong}")).to_string();
                let key = line[..at].trim_end_matches([' ', '=']).rsplit(' ').next().expect("a key");
                assert!(error.contains(key) && error.contains("line "), "{line} with {wrong}: {error}");
                count += 1;
            }
        }
    }
    assert!(count >= 5 * 25, "{count} numbers were tried");
    for (from, to) in [
        ("kind = \"anchor\"\n[policy.policy]\nkind = \"hedge\"\ngamma = 0.5", "kind = \"fixed\"\nu = nan"),
        ("kind = \"anchor\"\n[policy.policy]\nkind = \"hedge\"\ngamma = 0.5", "kind = \"fixed\"\nv = inf"),
        ("calibrate = { nats = 12.0, least = 5.0, most = 200.0 }", "sharpness = nan"),
        ("calibrate = { nats = 12.0, least = 5.0, most = 200.0 }", "sharpness = inf"),
        ("calibrate = { nats = 12.0, least = 5.0, most = 200.0 }", "sharpness = 0"),
        ("calibrate = { nats = 12.0, least = 5.0, most = 200.0 }", ""),
    ] {
        let text = GOOD.replace(from, to).replace("grid = { n = 3, reach = 0.5 }", "");
        assert!(check(&text).is_err(), "{to}");
    }
}

/// A configuration made in a program, not read, is checked too.
#[test]
fn made_configurations_are_checked() {
    let good = Config::parse(GOOD, "good").expect("a good configuration");
    let refuse = |change: &dyn Fn(&mut Config), word: &str| {
        let mut config = good.clone();
        change(&mut config);
        let error = config.check(&Folder::here()).err().expect(word).to_string();
        assert!(error.contains(word), "{error}");
    };
    refuse(&|c| c.particles = 0, "particles");
    refuse(&|c| c.start.velocity = f64::NAN, "start.velocity");
    refuse(&|c| c.consistency.flat = f64::INFINITY, "consistency.flat");
    refuse(&|c| c.retina = None, "needs a retina");
}

#[test]
fn every_configuration_that_ships_is_good_and_reads_back() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../foveate-core/configs");
    let mut names = vec![];
    for entry in std::fs::read_dir(&folder).expect("configs are there") {
        let path = entry.expect("readable").path();
        if path.extension().is_some_and(|e| e == "toml") {
            let config = Config::read(&Folder::here(), &path).expect("a good file");
            assert_eq!(Config::parse(&config.to_toml(), "again").expect("what was written"), config);
            config.check(&Folder::new(&folder)).map(|_| ()).expect("parts that fit");
            names.push(path.file_stem().expect("a name").to_string_lossy().into_owned());
        }
    }
    for (name, _) in BUILTIN {
        // The one that is made of another's file.
        let of = name.strip_suffix("-committee").unwrap_or(name);
        assert!(names.contains(&of.into()), "{name} ships, and is a file");
        Config::builtin(name)
            .expect("it ships")
            .expect("it is good")
            .check(&Folder::new(&folder))
            .map(|_| ())
            .expect("it fits");
    }
}

#[test]
fn the_committee_that_ships_is_three_of_natural() {
    let [natural, committee] =
        ["natural", "natural-committee"].map(|name| Config::builtin(name).expect("it ships").expect("it is good"));
    assert_eq!(committee, natural.set("committee=3").expect("a number"));
}

/// Changes, removes and repeats a few pieces of a text.
fn damage(bytes: &mut Vec<u8>, rng: &mut Rng, words: &[&str]) {
    for _ in 0..rng.random_range(1..4) {
        let at = rng.random_range(0..bytes.len());
        let end = (at + rng.random_range(1..20)).min(bytes.len());
        match rng.random_range(0..6) {
            0 => bytes[at] = rng.random(),
            1 => drop(bytes.drain(at..end)),
            2 => bytes.extend_from_within(at..end),
            3 => bytes.truncate(at + 1),
            4 => bytes[at] = b"0123456789.-e[]{}\",="[rng.random_range(0..20)],
            _ => drop(bytes.splice(at..end.min(at + 3), words[rng.random_range(0..words.len())].bytes())),
        }
    }
}

/// 4,000 damaged texts, seed 1.
#[test]
fn damaged_configurations_never_panic() {
    let (mut rng, mut good) = (Streams::new(1, 0).rng(0), 0);
    for _ in 0..4000 {
        let mut bytes = GOOD.as_bytes().to_vec();
        damage(
            &mut bytes,
            &mut rng,
            &["nan", "inf", "1e300", "-1", "[[", "= {", "\n[policy.policy]\n", "kind = \"rbm\""],
        );
        good += usize::from(check(&String::from_utf8_lossy(&bytes)).is_ok());
    }
    assert!(good > 0, "some changes do no harm");
    let deep = format!("[policy{}]\nkind = \"fixed\"\n", ".policy".repeat(20_000));
    let inline = format!("policy = {}", "{ kind = \"anchor\", policy = ".repeat(20_000));
    for text in [deep, inline] {
        assert!(check(&text).is_err());
    }
}

/// 4,000 damaged texts of saved trackers, seed 2. What is taken up can go on, whatever its numbers.
#[test]
fn damaged_saved_trackers_never_panic() {
    let mut rng = Streams::new(2, 0).rng(0);
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
        for _ in 0..2000 {
            let mut bytes = saved.clone();
            damage(&mut bytes, &mut rng, &["null", "1e308", "-1e308", "1e400", "1e-320", "99999", "[]", "-0.0", ":0,"]);
            let Ok(value) = serde_json::from_slice(&bytes) else { continue };
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

/// 300 damaged model files, seed 3, by way of a configuration.
#[test]
fn damaged_models_are_refused_by_name() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let mut rng = Streams::new(3, 0).rng(0);
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
    for _ in 0..300 {
        let mut bytes = good.clone();
        damage(&mut bytes, &mut rng, &["null", "99"]);
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
        let error = config.clone().check(&Folder::new(dir.path())).err().expect(words).to_string();
        assert!(error.contains(words), "{error}");
    }
}

/// How features vary is known of those of the configuration, and of no other encoder's.
#[test]
fn another_encoder_leaves_the_variation_out() {
    let config = Config::builtin("natural").expect("it ships").expect("it is right");
    let said = config.clone().set("encoder.kind=raw").and_then(|c| c.check(&Folder::here())).err().expect("raw");
    assert!(said.to_string().contains("set variation.weight to 0"), "{said}");
    let raw = config.clone().set("encoder.kind=raw").and_then(|c| c.set("variation.weight=0")).expect("a good one");
    let (retina, encoder) = raw.identity(&Folder::here()).expect("they fit");
    assert!(raw.check(&Folder::here()).is_ok());
    let blueprint = config.check(&Folder::here()).expect("it is right");
    assert!(blueprint.with(std::sync::Arc::new(retina), encoder).parts().is_ok());
}
