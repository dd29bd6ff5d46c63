//! Implements `foveate train`: learns the features of the identity pathway from glimpses. This file trains RBMs, and the folder the other
//! models.

use clap::Subcommand;
use foveate::Result;
use foveate::identity::retina::Retina;
use foveate::lab::training::filters;
use foveate::learn::rbm::likelihood::{ais, mean_log_likelihood};
use foveate::learn::rbm::monitor::Fit;
use foveate::learn::rbm::{Rbm, Recipe, Trainer, Visible};
use foveate::rows::Rows;

mod classifier;
pub(crate) mod common;
mod confidence;
mod confidence_tracks;
mod fixations;
mod patch_filters;
mod variation;

/// Train a model.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Rbm(Box<RbmArgs>),
    Fixations(Box<fixations::Args>),
    Kmeans(Box<patch_filters::Args>),
    Classifier(Box<classifier::Args>),
    Confidence(Box<confidence::Args>),
    Variation(Box<variation::Args>),
}

/// Shipped recipes.
const RECIPES: [(&str, &str); 2] =
    [("natural", include_str!("../../recipes/natural.toml")), ("digits", include_str!("../../recipes/digits.toml"))];

/// Train a restricted Boltzmann machine on glimpses, with the recipe natural or digits.
///
/// Progress is kept in FILE.checkpoint: after an interruption (Ctrl-C, kill) the same command resumes and gives the same result bit for
/// bit. The same seed gives the same model for any number of threads.
#[derive(clap::Args)]
#[command(after_long_help = RECIPES[0].1)]
struct RbmArgs {
    #[command(flatten)]
    common: common::Args,
    /// Estimate the log-likelihood of the held-out glimpses at the end, by annealed importance sampling.
    #[arg(long)]
    ais: bool,
}

/// Runs the command.
pub(crate) fn run(args: Args) -> Result<()> {
    match args.what {
        What::Rbm(args) => train(&args),
        What::Fixations(args) => fixations::run(&args),
        What::Kmeans(args) => args.run(),
        What::Classifier(args) => classifier::run(&args),
        What::Confidence(args) => confidence::run(&args),
        What::Variation(args) => variation::run(&args),
    }
}

fn train(args: &RbmArgs) -> Result<()> {
    let (files, args, ais) = (args.common.files()?, &args.common, args.ais);
    let recipe: common::Recipe<Recipe> = args.recipe(&RECIPES)?;
    let r = &recipe.training;
    r.check()?;
    let glimpses = common::Glimpses::look(&recipe.glimpses, &args.data, &files, r.visible, r.seed)?;
    let trainer = glimpses.train::<Trainer>(&files, r, |trainer, monitored| {
        let learned = trainer.learned();
        let [fit, held] = monitored.map(|rows| Fit::of(&learned, rows));
        epoch_line(&fit, &held)
    })?;

    let (rbm, retina) = (trainer.learned(), &glimpses.retina);
    rbm.save(files.model, &glimpses.metadata(args.command("rbm", &recipe), r.seed, r.epochs))?;
    if ais {
        print_likelihood(&rbm, glimpses.rows(), glimpses.held(), r.seed)?;
    }
    files.finish(Some(&filters::picture(rbm.weights(), retina.cells(), 400)?))
}

/// Formats one epoch: the fit on training data, followed by held-out data in brackets.
fn epoch_line(fit: &Fit, held: &Fit) -> String {
    let mut line = format!("reconstruction {:.3} (held out {:.3})", fit.reconstruction, held.reconstruction);
    if let (Some(a), Some(b)) = (fit.pseudo_log_likelihood, held.pseudo_log_likelihood) {
        line += &format!("  pseudo-log-likelihood {a:.2} ({b:.2})");
    }
    line + &format!("  free-energy gap {:.2}  activity {:.3}", held.free_energy - fit.free_energy, fit.activity)
}

fn print_likelihood(rbm: &Rbm, rows: Rows<'_>, held: Rows<'_>, seed: u64) -> Result<()> {
    let mut mean = vec![0.0f64; rows.width()];
    rows.iter().for_each(|row| mean.iter_mut().zip(row).for_each(|(m, &x)| *m += f64::from(x) / rows.len() as f64));
    let base = |m: &f64| match rbm.visible() {
        Visible::Bernoulli => (m.clamp(0.01, 0.99) / (1.0 - m.clamp(0.01, 0.99))).ln() as f32,
        Visible::Gaussian => *m as f32,
    };
    let base: Vec<f32> = mean.iter().map(base).collect();
    let found = ais(rbm, &base, 100, 2000, seed)?;
    say!(
        "log-likelihood of held-out glimpses {:.2}, by AIS: log Z {:.2} ± {:.2}, {:.0} effective chains of 100",
        mean_log_likelihood(rbm, held, found.log_z),
        found.log_z,
        found.standard_error,
        found.effective_chains
    );
    Ok(())
}
