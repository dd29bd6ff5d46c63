//! Implements `paper train mcrbm`: a factored RBM, of covariance and mean units, from natural glimpses.

use crate::mcrbm::{FactoredRbm, Recipe, Trainer, Units};
use foveate::Result;
use foveate::identity::retina::Retina;
use foveate::lab::training::filters;
use foveate::learn::rbm::Visible;
use foveate::rows::{Rows, RowsMut};

use foveate_cli::say;
use foveate_cli::training::{self, Glimpses};

/// Shipped recipes.
const RECIPES: [(&str, &str); 1] = [("mcrbm", include_str!("../../recipes/mcrbm.toml"))];

/// Train a factored RBM, of covariance and mean units, on glimpses of natural photographs.
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
        let model = trainer.learned();
        let [(ours, covariance, mean), (theirs, ..)] = monitored.map(|rows| fit(&model, rows));
        let (step, rejected) = trainer.leapfrog();
        format!(
            "free energy {ours:.2} (held out {theirs:.2})  covariance units on {covariance:.3}, mean units {mean:.3}  \
             leapfrog step {step:.3}, {rejected:.2} rejected"
        )
    })?;

    let rbm = trainer.learned();
    let sizes = rbm.sizes();
    say!(
        "{} whitened values, {} factors, {} covariance and {} mean units",
        sizes.white,
        sizes.factors,
        sizes.covariance,
        sizes.mean
    );
    rbm.save(files.model, &glimpses.metadata(args.command("mcrbm", &recipe), r.seed, r.epochs))?;
    let (factors, means) = (rbm.factor_filters(), rbm.mean_filters());
    // The factors' filters, then the mean units' filters.
    let both: Vec<f32> = (factors.chunks_exact(sizes.factors).zip(means.chunks_exact(sizes.mean)))
        .flat_map(|(f, m)| f.iter().chain(m).copied())
        .collect();
    let both = Rows::new(&both, sizes.factors + sizes.mean);
    files.finish(Some(&filters::picture(both, glimpses.retina.cells(), both.width())?))
}

/// Returns means over some rows: free energy, and the activity of the units of both kinds.
fn fit(model: &FactoredRbm, rows: Rows<'_>) -> (f64, f64, f64) {
    let (n_h, n) = (model.width(Units::Both), rows.len());
    let mut h = vec![0.0; n * n_h];
    model.features(rows, Units::Both, RowsMut::new(&mut h, n_h));
    let n_c = model.sizes().covariance;
    let mean = |part: &dyn Fn(&[f32]) -> f32| f64::from(h.chunks_exact(n_h).map(part).sum::<f32>()) / n as f64;
    let share = |h: &[f32]| h.iter().sum::<f32>() / h.len() as f32;
    let energy = rows.iter().map(|v| model.free_energy(v)).sum::<f64>() / n as f64;
    (energy, 1.0 - mean(&|h| share(&h[..n_c])), mean(&|h| share(&h[n_c..])))
}
