//! Implements `foveate train kmeans`: filters of natural patches, for a convolutional first layer.

use foveate::identity::convolution::Patches;
use foveate::identity::retina::{Foveal, FovealConfig, Retina};
use foveate::lab::training::{filters, sha256_of};
use foveate::learn::filters::{Recipe, Trainer};
use foveate::learn::rbm::Visible;
use foveate::rng::{Purpose, Streams};
use foveate::rows::Rows;
use foveate::{Error, Result};
use serde::{Deserialize, Serialize};

use super::common::{self, GlimpseRecipe, Glimpses};

/// Shipped recipes.
const RECIPES: [(&str, &str); 1] = [("kmeans", include_str!("../../../recipes/kmeans.toml"))];

/// Learn k-means filters of whitened patches, from the rings of glimpses of natural photographs.
///
/// Progress is kept in FILE.checkpoint: after an interruption (Ctrl-C, kill) the same command resumes and gives the same result bit for
/// bit. The same seed gives the same model for any number of threads.
#[derive(clap::Args)]
#[command(after_long_help = RECIPES[0].1)]
pub(super) struct Args {
    #[command(flatten)]
    common: common::Args,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PatchRecipe {
    patch: usize,
    patches: usize,
    glimpses: GlimpseRecipe,
    training: Recipe,
}

impl Args {
    /// Runs the command.
    pub(super) fn run(&self) -> Result<()> {
        let files = self.common.files()?;
        let plan: PatchRecipe = self.common.recipe(&RECIPES)?;
        let (recipe, side) = (&plan.training, plan.patch);
        recipe.check()?;
        if !(2..=8).contains(&side) {
            return Err(Error::Config(format!("patch is 2 to 8 cells, got {side}")));
        }
        let glimpses = Glimpses::look(&plan.glimpses, &self.common.data, &files, Visible::Gaussian, recipe.seed)?;
        let cut = Patches::new(glimpses.retina.cells(), side, 1)?;
        let streams = |seed| Streams::new(seed, 0).at(1, Purpose::Scene);
        let learn = cut.some(glimpses.rows(), plan.patches, streams(recipe.seed));
        let held = cut.some(glimpses.held(), glimpses.held().len(), streams(!recipe.seed));
        let (learn, held, sha256) = (Rows::new(&learn, side * side), Rows::new(&held, side * side), sha256_of(&learn));
        say!("{} patches of {} values", learn.len(), learn.width());
        let line = |trainer: &mut Trainer, _: &Rows<'_>| {
            Ok(format!("variance left {:.4} (held out {:.4})", trainer.cost(), trainer.learned().cost(held)))
        };
        let trainer = files.train::<Trainer, _>(recipe, &sha256, |_| Ok(learn), |rows| *rows, line)?;

        let model = trainer.learned();
        model
            .save(files.model, &glimpses.metadata(self.common.command("kmeans", &plan), recipe.seed, recipe.epochs))?;
        let patch = Foveal::new(FovealConfig { side: side as f64, rings: vec![[side, 1]], colour: vec![] })?;
        files.finish(Some(&filters::picture(Rows::new(&model.pictures(), recipe.filters), patch.cells(), 400)?))
    }
}
