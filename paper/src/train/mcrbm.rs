//! Implements `paper train mcrbm`: a factored RBM, of covariance and mean units, from natural glimpses.

use crate::mcrbm::{FactoredRbm, Negative, Pooling, Recipe, Trainer, Units};
use clap::ValueEnum;
use foveate::Result;
use foveate::identity::retina::Retina;
use foveate::lab::training::filters;
use foveate::rows::{Rows, RowsMut};

use foveate_cli::say;
use foveate_cli::training::{Glimpses, Natural};

/// Train a factored RBM, of covariance and mean units, on glimpses of natural photographs.
///
/// Progress is kept in FILE.checkpoint: after an interruption (Ctrl-C, kill) the same command resumes and gives the same result bit for
/// bit. The same seed gives the same model for any number of threads.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    natural: Natural,
    /// Factors; the square of an even number for pooling over a grid.
    #[arg(long, default_value_t = 256)]
    factors: usize,
    /// Initial factors of a covariance unit: one, or 3 x 3 neighbours on a grid.
    #[arg(long, value_enum, default_value = "single")]
    pooling: PoolingName,
    /// Mean units.
    #[arg(long, default_value_t = 100)]
    means: usize,
    /// Fraction of the glimpses' variance that whitening keeps.
    #[arg(long, default_value_t = 0.99)]
    keep: f64,
    /// Passes over the glimpses.
    #[arg(long, default_value_t = 50)]
    epochs: usize,
    /// Size of a mini-batch.
    #[arg(long, default_value_t = 128)]
    batch: usize,
    /// Learning rate.
    #[arg(long, default_value_t = 0.075)]
    rate: f32,
    /// Epoch after which the learning rate falls as 1 / epoch.
    #[arg(long, default_value_t = 20)]
    anneal: usize,
    /// Start of the model's own glimpses in every batch: at the data, or at the end of the previous batch.
    #[arg(long, value_enum, default_value = "persistent")]
    negative: NegativeName,
    /// Leapfrog steps per batch.
    #[arg(long, alias = "leaps", default_value_t = 20)]
    leapfrog_steps: usize,
    /// Target rejection rate of proposals.
    #[arg(long, default_value_t = 0.1)]
    rejection: f32,
    /// First epoch with --l1 weight decay, counted from 0.
    #[arg(long, default_value_t = 10)]
    settle: usize,
    /// First epoch in which pooling weights are learned, counted from 0; default: never.
    #[arg(long)]
    learn_pooling: Option<usize>,
    /// L1 weight decay.
    #[arg(long, default_value_t = 0.001)]
    l1: f32,
}

#[derive(Clone, Copy, ValueEnum)]
enum PoolingName {
    Single,
    Grid,
}

#[derive(Clone, Copy, ValueEnum)]
enum NegativeName {
    Contrastive,
    Persistent,
}

impl Args {
    fn recipe(&self) -> Recipe {
        Recipe {
            pooling: match self.pooling {
                PoolingName::Single => Pooling::Single,
                PoolingName::Grid => Pooling::Grid,
            },
            keep: self.keep,
            epochs: self.epochs,
            batch: self.batch,
            rate: self.rate,
            anneal: self.anneal,
            negative: match self.negative {
                NegativeName::Contrastive => Negative::Contrastive,
                NegativeName::Persistent => Negative::Persistent,
            },
            leapfrog_steps: self.leapfrog_steps,
            rejection: self.rejection,
            settle: self.settle,
            learn_pooling: self.learn_pooling,
            l1: self.l1,
            seed: self.natural.seed,
            ..Recipe::new(self.factors, self.means)
        }
    }
    /// Returns the command that makes the same model, with every setting explicit and folders left open.
    fn command(&self, glimpses: &Glimpses) -> String {
        let name = |value: Option<clap::builder::PossibleValue>| value.expect("a name").get_name().to_string();
        let pooling = self.learn_pooling.map_or(String::new(), |from| format!(" --learn-pooling {from}"));
        format!(
            "{} --factors {} --pooling {} --means {} --keep {} --epochs {} --batch {} --rate {} --anneal {} \
             --negative {} --leapfrog-steps {} --rejection {} --settle {} --l1 {}{pooling} --out FILE",
            self.natural.command("mcrbm", glimpses.retina.config()),
            self.factors,
            name(self.pooling.to_possible_value()),
            self.means,
            self.keep,
            self.epochs,
            self.batch,
            self.rate,
            self.anneal,
            name(self.negative.to_possible_value()),
            self.leapfrog_steps,
            self.rejection,
            self.settle,
            self.l1
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
            let model = trainer.learned();
            let [(ours, covariance, mean), (theirs, ..)] = glimpses.monitored().map(|rows| fit(&model, rows));
            let (step, rejected) = trainer.leapfrog();
            Ok(format!(
                "free energy {ours:.2} (held out {theirs:.2})  covariance units on {covariance:.3}, mean units {mean:.3}  \
                 leapfrog step {step:.3}, {rejected:.2} rejected"
            ))
        },
    )?;

    let rbm = trainer.learned();
    let sizes = rbm.sizes();
    say!(
        "{} whitened values, {} factors, {} covariance and {} mean units",
        sizes.white,
        sizes.factors,
        sizes.covariance,
        sizes.mean
    );
    rbm.save(files.model, &glimpses.metadata(args.command(&glimpses), recipe.seed, recipe.epochs))?;
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
