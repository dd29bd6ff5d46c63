//! Implements `paper train autoencoder`: a denoising autoencoder with tied weights, from natural glimpses.

use crate::autoencoder::{Recipe, Trainer};
use foveate::Result;
use foveate::identity::retina::Retina;
use foveate::lab::training::filters;
use foveate::learn::rbm::Visible;

use foveate_cli::training::{self, Glimpses};

/// Shipped recipes.
const RECIPES: [(&str, &str); 1] = [("autoencoder", include_str!("../../recipes/autoencoder.toml"))];

/// Train a denoising autoencoder with tied weights on glimpses of natural photographs.
///
/// Progress is kept in FILE.checkpoint: after an interruption (Ctrl-C, kill) the same command resumes and gives the same result bit for
/// bit. The same seed gives the same model for any number of threads.
#[derive(clap::Args)]
#[command(after_long_help = RECIPES[0].1)]
pub(crate) struct Args {
    #[command(flatten)]
    common: training::Args,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Result<()> {
    let (files, args) = (args.common.files()?, &args.common);
    let recipe: training::Recipe<Recipe> = args.recipe(&RECIPES)?;
    let r = &recipe.training;
    r.check()?;
    let glimpses = Glimpses::look(&recipe.glimpses, &args.data, &files, Visible::Gaussian, r.seed)?;
    let trainer = glimpses.train::<Trainer>(&files, r, |trainer, monitored| {
        let [ours, theirs] = monitored.map(|rows| trainer.learned().error(rows));
        format!("reconstruction {ours:.3} (held out {theirs:.3})")
    })?;

    let model = trainer.learned();
    model.save(files.model, &glimpses.metadata(args.command("autoencoder", &recipe), r.seed, r.epochs))?;
    files.finish(Some(&filters::picture(model.layer().weights(), glimpses.retina.cells(), 400)?))
}
