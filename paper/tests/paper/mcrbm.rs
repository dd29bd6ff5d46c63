//! `paper train mcrbm` as a user meets it: it trains, and its model tracks.

use std::path::Path;
use std::process::Command;

use crate::photographs::write_photographs;
use crate::training::{fails, said, train};

fn command(dir: &Path, out: &str, extra: &[&str]) -> Command {
    let data = ["mcrbm", "training.means=9", "glimpses.held_out=100", "glimpses.retina.rings=[[8, 1], [16, 2]]"];
    let settings =
        ["training.pooling=grid", "training.batch=50", "training.leapfrog_steps=5", "training.learn_pooling=3"];
    train(dir, out, &[&data[..], &settings].concat(), extra)
}

#[test]
fn a_trained_model_tracks() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_photographs(dir.path());
    let epochs = ["training.epochs=20", "training.factors=16", "glimpses.number=1500"];
    let whole = said(command(dir.path(), "whole.safetensors", &epochs));
    assert!(whole.contains("epoch 20/20  free energy") && whole.contains("16 factors, 4 covariance"), "{whole}");
    assert!(std::fs::read(dir.path().join("whole.png")).expect("filters").starts_with(b"\x89PNG"));

    let track = |weights: &str, units: &str| {
        let config = format!(
            "particles = 50\ndynamics = {{ kind = \"autoregressive\" }}\npolicy = {{ kind = \"fixed\" }}\n\
             encoder = {{ kind = \"mcrbm\", weights = \"{weights}\", units = \"{units}\" }}\n\
             likelihood = {{ distance = \"cosine\", calibrate = {{ nats = 12, least = 1, most = 10000 }} }}\n"
        );
        std::fs::write(dir.path().join("c.toml"), config).expect("a writable folder");
        let mut command = Command::new(env!("CARGO_BIN_EXE_paper"));
        let args = ["track", "video", "-c", "c.toml", "--no-video", "--no-report", "-o", "out"];
        command.current_dir(dir.path()).args(args);
        command
    };
    let mut synth = Command::new(env!("CARGO_BIN_EXE_paper"));
    said({
        synth.current_dir(dir.path()).args(["synth", "clutter", "--frames", "3", "--out", "video"]);
        synth
    });
    said(track("whole.safetensors", "both"));
    said(track("whole.safetensors", "mean"));
    // Four covariance units alone are too few to find a target.
    fails(track("whole.safetensors", "covariance"), "on a test picture the target is only");
    fails(track("whole.png", "both"), "not a usable model");
}

#[test]
fn mistakes_are_errors_before_the_work() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let says = |extra: &[&str], words: &str| fails(command(dir.path(), "m.safetensors", extra), words);
    says(&[], "no photographs here");
    write_photographs(dir.path());
    says(&["training.factors=15"], "square of an even number");
    says(&["training.factors=16", "glimpses.number=20"], "full batch");
    says(&["training.factors=16", "training.rejection=2"], "rejected");
}
