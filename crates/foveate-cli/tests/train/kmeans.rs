//! `foveate train kmeans` as a user meets it: it trains, its filters serve any retina.

use foveate::files::Folder;
use std::path::Path;
use std::process::Command;

use crate::photographs::write_photographs;
use crate::training::{fails, said, train};

fn command(dir: &Path, out: &str, extra: &[&str]) -> Command {
    let args = ["kmeans", "glimpses.number=1500", "glimpses.held_out=100", "glimpses.retina.rings=[[8, 1], [16, 2]]"];
    train(dir, out, &args, extra)
}

#[test]
fn filters_serve_any_retina() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    write_photographs(dir.path());
    let settings = ["training.epochs=40", "training.filters=24", "patch=4", "patches=20000"];
    let whole = said(command(dir.path(), "whole.safetensors", &settings));
    assert!(whole.contains("epoch 40/40  variance left") && whole.contains("patches of 16 values"), "{whole}");
    assert!(std::fs::read(dir.path().join("whole.png")).expect("filters").starts_with(b"\x89PNG"));

    use foveate::config::Config;
    let check = |more: &str| {
        let text = format!(
            "particles = 50\ndynamics = {{ kind = \"autoregressive\" }}\npolicy = {{ kind = \"fixed\" }}\n\
             encoder = {{ kind = \"kmeans\", weights = \"whole.safetensors\" }}\n\
             likelihood = {{ distance = \"cosine\", sharpness = 50 }}\n{more}"
        );
        Config::parse(&text, "test").and_then(|config| config.check(&Folder::new(dir.path())).map(|_| ()))
    };
    check("").expect("the retina it was trained with");
    check("retina = { kind = \"foveal\", side = 28, rings = [[28, 1]] }\n").expect("another");
    let small =
        check("retina = { kind = \"foveal\", side = 28, rings = [[8, 4]] }\n").expect_err("too small").to_string();
    assert!(small.contains("2 x 2 cells"), "{small}");
}

#[test]
fn mistakes_are_errors_before_the_work() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let says = |extra: &[&str], words: &str| fails(command(dir.path(), "m.safetensors", extra), words);
    says(&[], "no photographs here");
    write_photographs(dir.path());
    says(&["training.filters=4097"], "filters are 1 to 4096, got 4097");
    says(&["patch=9"], "patch is 2 to 8 cells, got 9");
    says(&["training.softening=0"], "softening is above 0");
    says(&["patches=10"], "need as many patches");
    // Its picture of the filters would replace it, or a photograph.
    fails(command(dir.path(), "m.png", &[]), "the picture of the filters gets this name");
    fails(command(dir.path(), "natural/3", &[]), "which is read; give another folder");
    let mut inside = Command::new(env!("CARGO_BIN_EXE_foveate"));
    inside.args(["train", "kmeans", "--data", "natural", "--out", "natural/3"]).current_dir(dir.path());
    fails(inside, "which is read; give another folder");
    // A picture beside their folder is none of them.
    std::fs::copy(dir.path().join("natural/3.png"), dir.path().join("before.png")).expect("a writable folder");
    says(&["patches=10"], "need as many patches");
    std::fs::write(dir.path().join("r.toml"), "patch = 4\n").expect("a writable folder");
    let mut recipe = command(dir.path(), "r.toml", &[]);
    recipe.arg("--recipe").arg(dir.path().join("r.toml"));
    fails(recipe, "it is read, and would be replaced");
}
