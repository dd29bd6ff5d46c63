//! The checkpoints of an RBM's trainer.

use super::{Training, interrupted};
use crate::rbm::{Negative, Rbm, Recipe, Sparsity, Trainer, Visible};
use foveate_base::rows::Rows;
use std::path::Path;

#[test]
fn resumed_training_ends_with_the_same_bits() {
    let data: Vec<f32> = (0..9 * 53).map(|i| ((i * i) as f32 * 0.37).sin().abs()).collect();
    let rows = Rows::new(&data, 9);
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("c.checkpoint");
    for negative in [Negative::Contrastive { steps: 2 }, Negative::Persistent { chains: 7, steps: 1 }] {
        let recipe = Recipe {
            epochs: 4,
            batch: 10,
            negative,
            sparsity: Some(Sparsity { target: 0.2, cost: 0.1 }),
            average_from: Some(1),
            ..Recipe::new(Visible::Bernoulli, 6)
        };
        let mut whole = Trainer::new(recipe.clone(), rows).expect("good data");
        while !whole.is_done() {
            whole.step(rows);
        }
        let mut cut: Trainer = interrupted(&recipe, rows, 3, &path).expect("good data");
        assert_eq!((cut.learned(), cut.progress()), (whole.learned(), (4, 0)));
        assert_eq!(cut.parts(), whole.parts());
    }
}

#[test]
fn checkpoints_of_something_else_are_refused() {
    let (data, recipe) = (vec![0.5; 40], Recipe { batch: 4, ..Recipe::new(Visible::Bernoulli, 3) });
    let rows = Rows::new(&data, 4);
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("c.checkpoint");
    let mut trainer = Trainer::new(recipe.clone(), rows).expect("good data");
    trainer.epoch(rows);
    trainer.save(&path, "abc").expect("a writable folder");
    let why = |recipe: Recipe, sha: &str| Trainer::resume(&path, recipe, rows, sha).expect_err("refused").to_string();
    assert!(why(recipe.clone(), "def").contains("other data"));
    assert!(why(Recipe { rate: 0.3, ..recipe.clone() }, "abc").contains("it was begun as"));
    assert!(Trainer::resume(&path, Recipe { epochs: 99, ..recipe.clone() }, rows, "abc").is_ok());
    trainer.epoch(rows);
    trainer.save(&path, "abc").expect("a writable folder");
    assert!(Trainer::resume(&path, Recipe { epochs: 2, ..recipe.clone() }, rows, "abc").is_ok());
    assert!(why(Recipe { epochs: 1, ..recipe.clone() }, "abc").contains("more than the 1 epochs that are asked for"));
    let bytes = std::fs::read(&path).expect("just written");
    for cut in (0..bytes.len()).step_by(17) {
        std::fs::write(&path, &bytes[..cut]).expect("a writable folder");
        assert!(why(recipe.clone(), "abc").contains("c.checkpoint"));
    }
    trainer.learned().save(&path, &Default::default()).expect("a writable folder");
    assert!(why(recipe.clone(), "abc").contains("kind \"rbm\", expected format 1 and kind \"rbm-checkpoint\""));
}

#[test]
fn a_diverged_training_is_an_error() {
    let data: Vec<f32> = (0..400).map(|i| (i as f32).sin() * 30.0).collect();
    let rows = Rows::new(&data, 4);
    let recipe = Recipe { rate: 1e20, ..Recipe::new(Visible::Gaussian, 3) };
    let mut trainer = Trainer::new(recipe, rows).expect("finite data");
    while !trainer.is_done() {
        trainer.epoch(rows);
    }
    let message = trainer.save(Path::new("no/such/folder"), "").expect_err("diverged").to_string();
    assert!(message.contains("diverged") && message.contains("lower rate"), "{message}");
    // What would be saved could not be read.
    for (weight, fits) in [(1e8, true), (2e8, false)] {
        assert_eq!(Rbm::new(Visible::Gaussian, vec![weight], vec![0.0], vec![0.0]).is_ok(), fits);
    }
}
