//! Interrupted training: everything the rest of it depends on, in a file.
//!
//! Random numbers have names (epoch, row, step), so a generator has no state to keep; a training that is resumed ends
//! with the same bits as one that was never interrupted.

use super::io::Tensor;
use super::progress::{Checkpoint, save};
use super::train::Parameters;
use super::{Rbm, Recipe, Trainer};
use foveate_base::Result;
use foveate_base::rows::Rows;
use std::path::Path;

const KIND: &str = "rbm-checkpoint";

impl Trainer {
    /// Writes a checkpoint; the file is whole or as it was before. `data_sha256` names the training rows.
    ///
    /// Fails if the training has diverged, or the file cannot be written.
    pub fn save(&self, path: &Path, data_sha256: &str) -> Result<()> {
        self.check()?;
        let (n_v, n_h) = self.rbm.shape();
        let (u, rbm) = (&self.velocity, &self.rbm);
        let mut tensors: Vec<Tensor<'_>> = vec![
            ("weights", vec![n_v, n_h], &rbm.weights),
            ("visible_bias", vec![n_v], &rbm.visible_bias),
            ("hidden_bias", vec![n_h], &rbm.hidden_bias),
            ("velocity.weights", vec![n_v, n_h], &u.weights),
            ("velocity.visible_bias", vec![n_v], &u.visible_bias),
            ("velocity.hidden_bias", vec![n_h], &u.hidden_bias),
            ("chains", vec![self.chains.len() / n_h, n_h], &self.chains),
            ("activity", vec![n_h], &self.activity),
        ];
        if let Some(mean) = &self.mean {
            tensors.push(("mean.weights", vec![n_v, n_h], &mean.weights));
            tensors.push(("mean.visible_bias", vec![n_v], &mean.visible_bias));
            tensors.push(("mean.hidden_bias", vec![n_h], &mean.hidden_bias));
        }
        save(path, KIND, (&self.recipe, self.progress(), data_sha256), &tensors)
    }
    /// Goes on from a checkpoint, made with the same recipe (but for the number of epochs) and the same data.
    ///
    /// Fails, with the reason, if the recipe or the data are others, or the file is damaged.
    pub fn resume(path: &Path, recipe: Recipe, data: Rows<'_>, data_sha256: &str) -> Result<Self> {
        let as_long = |begun| Recipe { epochs: recipe.epochs, ..begun };
        let mut checkpoint = Checkpoint::open(path, KIND, &recipe, as_long, ("data", data_sha256))?;
        let mut fresh = Self::new(recipe, data)?;
        let mut take = |name: &str, into: &mut Vec<f32>| -> Result<()> {
            *into = checkpoint.take(name, into.len())?;
            Ok(())
        };
        let mut rbm = Parameters::zeros(data.width(), fresh.recipe.hidden);
        let mut parts = vec![("", &mut rbm), ("velocity.", &mut fresh.velocity)];
        parts.extend(fresh.mean.as_mut().map(|mean| ("mean.", mean)));
        for (name, part) in parts {
            take(&format!("{name}weights"), &mut part.weights)?;
            take(&format!("{name}visible_bias"), &mut part.visible_bias)?;
            take(&format!("{name}hidden_bias"), &mut part.hidden_bias)?;
        }
        take("chains", &mut fresh.chains)?;
        take("activity", &mut fresh.activity)?;
        fresh.rbm = Rbm::new(fresh.recipe.visible, rbm.weights, rbm.visible_bias, rbm.hidden_bias)?;
        fresh.state = checkpoint.state(fresh.batches(data.len()))?;
        Ok(fresh)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rbm::{Negative, Sparsity, Visible};

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
            // Cut after every third batch.
            let mut cut = Trainer::new(recipe.clone(), rows).expect("good data");
            for step in 0.. {
                if cut.is_done() {
                    break;
                }
                if step % 3 == 2 {
                    cut.save(&path, "abc").expect("a writable folder");
                    cut = Trainer::resume(&path, recipe.clone(), rows, "abc").expect("just written");
                }
                cut.step(rows);
            }
            assert_eq!((cut.learned(), cut.progress()), (whole.learned(), (4, 0)));
            assert_eq!(cut.rbm, whole.rbm);
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
        let why =
            |recipe: Recipe, sha: &str| Trainer::resume(&path, recipe, rows, sha).expect_err("refused").to_string();
        assert!(why(recipe.clone(), "def").contains("other data"));
        assert!(why(Recipe { rate: 0.3, ..recipe.clone() }, "abc").contains("it was begun as"));
        assert!(Trainer::resume(&path, Recipe { epochs: 99, ..recipe.clone() }, rows, "abc").is_ok());
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
    }
}
