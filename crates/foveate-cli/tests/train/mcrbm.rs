//! `foveate train mcrbm` as a user meets it: it trains, it survives being killed, its model tracks.

use foveate::files::Folder;
use std::path::Path;
use std::process::Command;

use crate::photographs::write_photographs;
use crate::training::{fails, train, whole_and_cut};

fn command(dir: &Path, out: &str, extra: &[&str]) -> Command {
    let data = ["mcrbm", "--means", "9", "--held-out", "100", "--rings", "8/1,16/2"];
    let settings = ["--pooling", "grid", "--batch", "50", "--leapfrog-steps", "5", "--learn-pooling", "3"];
    train(dir, out, &[&data[..], &settings].concat(), extra)
}

#[test]
fn a_killed_training_goes_on_and_ends_with_the_same_bits_and_its_model_tracks() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_photographs(dir.path());
    let epochs = ["--epochs", "20", "--factors", "16", "--glimpses", "1500"];
    let train = |out| command(dir.path(), out, &epochs);
    let (whole, rest) = whole_and_cut(dir.path(), &train, &["epoch 1/20", "epoch 5/20"]);
    assert!(whole.contains("epoch 20/20  free energy") && whole.contains("16 factors, 4 covariance"), "{whole}");
    assert!(std::fs::read(dir.path().join("whole.png")).expect("filters").starts_with(b"\x89PNG"));
    assert!(rest.contains("resuming") && !rest.contains("epoch 3/20"), "{rest}");

    let config = |weights: &str, units: &str| {
        format!(
            "particles = 50\ndynamics = {{ kind = \"autoregressive\" }}\npolicy = {{ kind = \"fixed\" }}\n\
             encoder = {{ kind = \"mcrbm\", weights = \"{weights}\", units = \"{units}\" }}\n\
             likelihood = {{ distance = \"cosine\", sharpness = 50 }}\n"
        )
    };
    use foveate::config::Config;
    let check =
        |text: &str| Config::parse(text, "test").and_then(|config| config.check(&Folder::new(dir.path())).map(|_| ()));
    for units in ["both", "covariance", "mean"] {
        check(&config("whole.safetensors", units)).expect("the model fits");
    }
    let wrong = check(&config("builtin:natural", "both")).expect_err("an RBM of another kind").to_string();
    assert!(wrong.contains("kind \"mcrbm\""), "{wrong}");
}

#[test]
fn mistakes_are_told_before_the_work() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let says = |extra: &[&str], words: &str| fails(command(dir.path(), "m.safetensors", extra), words);
    says(&[], "no photographs here");
    write_photographs(dir.path());
    says(&["--factors", "15"], "square of an even number");
    says(&["--factors", "16", "--glimpses", "20"], "full batch");
    says(&["--factors", "16", "--rejection", "2"], "rejected");
}
