//! `foveate train mcrbm` as a user meets it: it trains, it survives being killed, its model tracks.

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
    command.args(["train", "mcrbm", "--means", "9", "--held-out", "100"]);
    command.args(["--rings", "8/1,16/2", "--pooling", "grid", "--batch", "50", "--leaps", "5", "--learn-pooling", "3"]);
    command.args(["--threads", "2", "--data"]).arg(dir).arg("--out").arg(dir.join(out)).args(extra);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

#[test]
fn a_killed_training_goes_on_and_ends_with_the_same_bits_and_its_model_tracks() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_photographs(dir.path());
    let epochs = ["--epochs", "20", "--factors", "16", "--glimpses", "1500"];
    let whole = command(dir.path(), "whole.safetensors", &epochs).output().expect("it runs");
    assert!(whole.status.success(), "{}", String::from_utf8_lossy(&whole.stderr));
    let said = String::from_utf8_lossy(&whole.stdout).into_owned();
    assert!(said.contains("epoch 20/20  free energy") && said.contains("16 factors, 4 covariance"), "{said}");
    assert!(std::fs::read(dir.path().join("whole.png")).expect("filters").starts_with(b"\x89PNG"));

    // Killed (-9) twice, after its first and its fifth epoch or a little later.
    for epoch in ["epoch 1/20", "epoch 5/20"] {
        let mut child = command(dir.path(), "cut.safetensors", &epochs).spawn().expect("it runs");
        let out = BufReader::new(child.stdout.take().expect("piped"));
        out.lines().map_while(Result::ok).find(|line| line.starts_with(epoch)).expect("the epoch comes");
        child.kill().expect("it still runs, or has ended");
        child.wait().expect("it ends");
    }
    let rest = command(dir.path(), "cut.safetensors", &epochs).output().expect("it runs");
    let said = String::from_utf8_lossy(&rest.stdout).into_owned();
    assert!(said.contains("going on from") && !said.contains("epoch 3/20"), "{said}");
    let bytes = |name: &str| std::fs::read(dir.path().join(name)).expect("a model");
    assert!(bytes("cut.safetensors") == bytes("whole.safetensors"), "the same command gives the same file");

    let config = |weights: &str, units: &str| {
        format!(
            "particles = 50\ndynamics = {{ kind = \"autoregressive\" }}\npolicy = {{ kind = \"fixed\" }}\n\
             encoder = {{ kind = \"mcrbm\", weights = \"{weights}\", units = \"{units}\" }}\n\
             likelihood = {{ distance = \"cosine\", sharpness = 50 }}\n"
        )
    };
    use foveate::config::Config;
    let check = |text: &str| Config::parse(text, "test").and_then(|config| config.check(dir.path()).map(|_| ()));
    for units in ["both", "covariance", "mean"] {
        check(&config("whole.safetensors", units)).expect("the model fits");
    }
    let wrong = check(&config("builtin:natural", "both")).expect_err("an RBM of another kind").to_string();
    assert!(wrong.contains("kind \"mcrbm\""), "{wrong}");
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
    says(&["--factors", "15"], "square of an even number");
    says(&["--factors", "16", "--glimpses", "20"], "full batch");
    says(&["--factors", "16", "--rejection", "2"], "rejected");
}
