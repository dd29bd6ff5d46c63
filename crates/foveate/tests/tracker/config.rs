//! Configurations that are wrong: each is refused in words.

use foveate::files::Folder;
use std::path::Path;

use foveate::config::{BUILTIN, Config};

/// A configuration of many parts.
pub(crate) const GOOD: &str = r#"seed = 1
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

pub(crate) fn check(text: &str) -> foveate::Result<()> {
    Config::parse(text, "my.toml")?.check(&Folder::here()).map(|_| ())
}

/// The error of the good configuration with one line of a section changed.
fn error(section: &str, from: &str, to: &str) -> String {
    let at = if section.is_empty() { 0 } else { GOOD.find(section).expect("a section of the text") };
    assert!(GOOD[at..].contains(from), "{section} {from}");
    let text = format!("{}{}", &GOOD[..at], GOOD[at..].replacen(from, to, 1));
    check(&text).expect_err(&format!("{to} must be refused")).to_string()
}

#[test]
fn mistakes_are_errors_with_place_and_valid_names() {
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

/// Settings of training need a discriminant: without one the error names it.
#[test]
fn parts_of_a_discriminant_ask_for_one() {
    let without = GOOD.split("[discriminant]").next().expect("what is before it");
    for section in ["[distractors]", "[variation]"] {
        let said = check(&format!("{without}{section}\n")).expect_err("it has no discriminant").to_string();
        let name = section.trim_matches(['[', ']']);
        for word in [name, "add [discriminant]", &format!("leave {section} out")] {
            assert!(said.contains(word), "{section}: \"{word}\" is missing in: {said}");
        }
    }
}

/// A recogniser has no first picture to predict rewards from.
#[test]
fn a_recogniser_refuses_policies_that_ask_for_more_than_rewards() {
    let config = Config::builtin("natural").expect("it ships").expect("it is right");
    for policy in [
        "kind = \"gp-ucb\", saliency = 1",
        "kind = \"gp-ucb\", rehearsal = 1",
        "kind = \"anchor\", policy = { kind = \"gp-ucb\", rehearsal = 1 }",
    ] {
        let setting =
            format!("recogniser={{ kind = \"multi-fixation\", weights = \"builtin:x\", policy = {{ {policy} }} }}");
        let said = config.clone().set(&setting).and_then(|c| c.check(&Folder::here())).expect_err(policy).to_string();
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
        let error = config.check(&Folder::here()).expect_err(word).to_string();
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

/// How features vary is known of those of the configuration, and of no other encoder's.
#[test]
fn another_encoder_leaves_the_variation_out() {
    let config = Config::builtin("natural").expect("it ships").expect("it is right");
    let said = config.clone().set("encoder.kind=raw").and_then(|c| c.check(&Folder::here())).expect_err("raw");
    assert!(said.to_string().contains("set variation.weight to 0"), "{said}");
    let raw = config.clone().set("encoder.kind=raw").and_then(|c| c.set("variation.weight=0")).expect("a good one");
    let (retina, encoder) = raw.identity(&Folder::here()).expect("they fit");
    assert!(raw.check(&Folder::here()).is_ok());
    let blueprint = config.check(&Folder::here()).expect("it is right");
    assert!(blueprint.with(std::sync::Arc::new(retina), encoder).parts().is_ok());
}
