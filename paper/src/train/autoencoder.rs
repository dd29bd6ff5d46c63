//! Implements `paper train autoencoder`: a denoising autoencoder with tied weights, from natural glimpses.

use crate::autoencoder::{Recipe, Trainer};
use foveate::Result;
use foveate::identity::retina::Retina;
use foveate::lab::training::filters;

use foveate_cli::training::{Glimpses, Natural};

/// Train a denoising autoencoder with tied weights on glimpses of natural photographs.
///
/// Progress is kept in FILE.checkpoint: after an interruption (Ctrl-C, kill) the same command resumes and gives the same result bit for
/// bit. The same seed gives the same model for any number of threads.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    natural: Natural,
    /// Hidden units.
    #[arg(long, default_value_t = 200)]
    hidden: usize,
    /// Passes over the glimpses.
    #[arg(long, default_value_t = 30)]
    epochs: usize,
    /// Size of a mini-batch.
    #[arg(long, default_value_t = 100)]
    batch: usize,
    /// Learning rate.
    #[arg(long, default_value_t = 0.5)]
    rate: f32,
    /// Momentum.
    #[arg(long, default_value_t = 0.9)]
    momentum: f32,
    /// Fraction of a glimpse's values that noise sets to 0.
    #[arg(long, default_value_t = 0.3)]
    mask: f32,
    /// Standard deviation of the noise added to the others.
    #[arg(long, default_value_t = 0.5)]
    noise: f32,
    /// Weight decay.
    #[arg(long, default_value_t = 0.001)]
    l2: f32,
}

impl Args {
    fn recipe(&self) -> Recipe {
        Recipe {
            epochs: self.epochs,
            batch: self.batch,
            rate: self.rate,
            momentum: self.momentum,
            mask: self.mask,
            noise: self.noise,
            l2: self.l2,
            seed: self.natural.seed,
            ..Recipe::new(self.hidden)
        }
    }
    /// Returns the command that makes the same model, with every setting explicit and folders left open.
    fn command(&self, glimpses: &Glimpses) -> String {
        format!(
            "{} --hidden {} --epochs {} --batch {} --rate {} --momentum {} --mask {} --noise {} --l2 {} --out FILE",
            self.natural.command("autoencoder", glimpses.retina.config()),
            self.hidden,
            self.epochs,
            self.batch,
            self.rate,
            self.momentum,
            self.mask,
            self.noise,
            self.l2
        )
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Result<()> {
    let (files, recipe) = (args.natural.files()?, args.recipe());
    recipe.check()?;
    let glimpses = args.natural.glimpses()?;
    let trainer = files.train::<Trainer, _>(
        &recipe,
        &glimpses.sha256,
        |_| Ok(glimpses.rows()),
        |rows| *rows,
        |trainer, _| {
            let [ours, theirs] = glimpses.monitored().map(|rows| trainer.learned().error(rows));
            Ok(format!("reconstruction {ours:.3} (held out {theirs:.3})"))
        },
    )?;

    let model = trainer.learned();
    model.save(files.model, &glimpses.metadata(args.command(&glimpses), recipe.seed, recipe.epochs))?;
    files.finish(Some(&filters::picture(model.layer().weights(), glimpses.retina.cells(), 400)?))
}
