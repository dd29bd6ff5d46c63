//! Implements `foveate train kmeans`: filters of natural patches, for a convolutional first layer.

use foveate::Result;
use foveate::identity::convolution::Patches;
use foveate::identity::retina::{Foveal, FovealConfig, Retina};
use foveate::lab::training::{filters, sha256_of};
use foveate::learn::filters::{Recipe, Trainer};
use foveate::rng::{Purpose, Streams};
use foveate::rows::Rows;

use super::common::{Glimpses, Natural};

/// Learn k-means filters of whitened patches, from the rings of glimpses of natural photographs.
///
/// Progress is kept in FILE.checkpoint: after an interruption (Ctrl-C, kill) the same command resumes and gives the same result bit for
/// bit. The same seed gives the same model for any number of threads.
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    natural: Natural,
    /// Number of filters.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u16).range(1..=400))]
    units: u16,
    /// Cells along a side of a patch, 2 to 8.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u8).range(2..=8))]
    patch: u8,
    /// Number of training patches, each at a random place of a glimpse.
    #[arg(long, default_value_t = 300_000)]
    patches: usize,
    /// Fraction of the patches' variance that whitening keeps.
    #[arg(long, default_value_t = 0.99)]
    keep: f64,
    /// Constant added to a patch's variance before division by its square root; a glimpse has variance 1.
    #[arg(long, default_value_t = 1.0)]
    softening: f32,
    /// Passes over the patches.
    #[arg(long, default_value_t = 30)]
    epochs: usize,
}

impl Args {
    fn recipe(&self) -> Recipe {
        Recipe {
            epochs: self.epochs,
            keep: self.keep,
            softening: Some(self.softening),
            seed: self.natural.seed,
            ..Recipe::new(self.units.into())
        }
    }
    /// Returns the command that makes the same model, with every setting explicit and folders left open.
    fn command(&self, glimpses: &Glimpses) -> String {
        format!(
            "{} --units {} --patch {} --patches {} --keep {} --softening {} --epochs {} --out FILE",
            self.natural.command("kmeans", glimpses.retina.config()),
            self.units,
            self.patch,
            self.patches,
            self.keep,
            self.softening,
            self.epochs
        )
    }
    /// Runs the command.
    pub(super) fn run(&self) -> Result<()> {
        let (files, recipe, side) = (self.natural.files()?, self.recipe(), usize::from(self.patch));
        recipe.check()?;
        let glimpses = self.natural.glimpses()?;
        let cut = Patches::new(glimpses.retina.cells(), side, 1)?;
        let streams = |seed| Streams::new(seed, 0).at(1, Purpose::Scene);
        let learn = cut.some(glimpses.rows(), self.patches, streams(self.natural.seed));
        let held = cut.some(glimpses.held(), glimpses.held().len(), streams(!self.natural.seed));
        let (learn, held, sha256) = (Rows::new(&learn, side * side), Rows::new(&held, side * side), sha256_of(&learn));
        say!("{} patches of {} values", learn.len(), learn.width());
        let line = |trainer: &mut Trainer, _: &Rows<'_>| {
            Ok(format!("variance left {:.4} (held out {:.4})", trainer.cost(), trainer.learned().cost(held)))
        };
        let trainer = files.train::<Trainer, _>(&recipe, &sha256, |_| Ok(learn), |rows| *rows, line)?;

        let model = trainer.learned();
        model.save(files.model, &glimpses.metadata(self.command(&glimpses), recipe.seed, recipe.epochs))?;
        let patch = Foveal::new(FovealConfig { side: side as f64, rings: vec![[side, 1]], colour: vec![] })?;
        files.finish(Some(&filters::picture(Rows::new(&model.pictures(), recipe.filters), patch.cells(), 400)?))
    }
}
