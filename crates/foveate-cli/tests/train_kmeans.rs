//! `foveate train kmeans` as a user meets it: it trains, it survives being killed, its filters serve any retina.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

/// Ten pictures of stripes and noise, in a folder of their own: beside them a picture of filters would count as one.
fn write_photographs(dir: &Path) {
    let dir = dir.join("natural");
    std::fs::create_dir(&dir).expect("a writable folder");
    for i in 0..10u32 {
        let wave = |x: u32, y: u32| ((x * (i + 1) + y * (11 - i)) as f32 * 0.1).sin() * 90.0 + (x * y % 31) as f32;
        let picture = image::GrayImage::from_fn(120, 90, |x, y| image::Luma([(wave(x, y) + 100.0) as u8]));
        picture.save(dir.join(format!("{i}.png"))).expect("a writable folder");
    }
}

fn command(dir: &Path, out: &str, extra: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    command.args([
        "train",
        "kmeans",
        "--glimpses",
        "1500",
        "--held-out",
        "100",
        "--rings",
        "8/1,16/2",
        "--threads",
        "2",
    ]);
    command.arg("--data").arg(dir).arg("--out").arg(dir.join(out)).args(extra);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

#[test]
fn a_killed_training_goes_on_and_ends_with_the_same_bits_and_its_filters_serve_any_retina() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_photographs(dir.path());
    let settings = ["--epochs", "40", "--units", "24", "--patch", "4", "--patches", "20000"];
    let whole = command(dir.path(), "whole.safetensors", &settings).output().expect("it runs");
    assert!(whole.status.success(), "{}", String::from_utf8_lossy(&whole.stderr));
    let said = String::from_utf8_lossy(&whole.stdout).into_owned();
    assert!(said.contains("epoch 40/40  variance left") && said.contains("patches of 16 values"), "{said}");
    assert!(std::fs::read(dir.path().join("whole.png")).expect("filters").starts_with(b"\x89PNG"));

    let mut child = command(dir.path(), "cut.safetensors", &settings).spawn().expect("it runs");
    let out = BufReader::new(child.stdout.take().expect("piped"));
    out.lines().map_while(Result::ok).find(|line| line.starts_with("epoch 2/40")).expect("the epoch comes");
    child.kill().expect("it still runs, or has ended");
    child.wait().expect("it ends");
    let rest = command(dir.path(), "cut.safetensors", &settings).output().expect("it runs");
    assert!(rest.status.success(), "{}", String::from_utf8_lossy(&rest.stderr));
    let bytes = |name: &str| std::fs::read(dir.path().join(name)).expect("a model");
    assert!(bytes("cut.safetensors") == bytes("whole.safetensors"), "the same command gives the same file");

    use foveate::config::Config;
    let check = |more: &str| {
        let text = format!(
            "particles = 50\ndynamics = {{ kind = \"autoregressive\" }}\npolicy = {{ kind = \"fixed\" }}\n\
             encoder = {{ kind = \"kmeans\", weights = \"whole.safetensors\" }}\n\
             likelihood = {{ distance = \"cosine\", sharpness = 50 }}\n{more}"
        );
        Config::parse(&text, "test").and_then(|config| config.check(dir.path()).map(|_| ()))
    };
    check("").expect("the retina it was trained with");
    check("retina = { kind = \"foveal\", side = 28, rings = [[28, 1]] }\n").expect("another");
    let small =
        check("retina = { kind = \"foveal\", side = 28, rings = [[8, 4]] }\n").expect_err("too small").to_string();
    assert!(small.contains("2 x 2 cells"), "{small}");
}

#[test]
fn mistakes_are_told_before_the_work() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let says = |extra: &[&str], words: &str| {
        let output = command(dir.path(), "m.safetensors", extra).output().expect("it runs");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && text.contains(words), "{text}");
    };
    says(&[], "no photographs here");
    write_photographs(dir.path());
    says(&["--units", "0"], "filters are 1 to");
    says(&["--patch", "9"], "9 is not in 2..=8");
    says(&["--softening", "0"], "softening is above 0");
    says(&["--patches", "10"], "need as many patches");
}
