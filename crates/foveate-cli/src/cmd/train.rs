//! Implements `foveate train`: learns the features of the identity pathway from glimpses. This file trains RBMs, and the folder the other
//! models.

use std::path::PathBuf;

use clap::{Subcommand, ValueEnum};
use foveate::Result;
use foveate::identity::retina::{FovealConfig, Retina};
use foveate::lab::training;
use foveate::lab::training::filters;
use foveate::learn::rbm::likelihood::{ais, mean_log_likelihood};
use foveate::learn::rbm::monitor::Fit;
use foveate::learn::rbm::{Negative, Rbm, Recipe, Sparsity, Trainer, Visible};
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

/// Train a restricted Boltzmann machine on glimpses.
///
/// Progress is kept in FILE.checkpoint: after an interruption (Ctrl-C, kill) the same command resumes and gives the same result bit for
/// bit. The same seed gives the same model for any number of threads.
#[derive(clap::Args)]
struct RbmArgs {
    /// Folder with the data: the four MNIST files (or a folder `mnist` of them), or photographs (or a folder `natural`).
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Data set of the glimpses.
    #[arg(long, value_enum)]
    set: SetName,
    /// Output model file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Take the retina from the table `retina` of this configuration.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["side", "rings", "colour"])]
    config: Option<PathBuf>,
    /// Template pixels along a side of the target's box.
    #[arg(long, default_value_t = 28.0)]
    side: f64,
    /// Windows of the retina from the inside out, WINDOW/CELL in template pixels.
    #[arg(long, value_delimiter = ',', default_value = "8/1,16/2,24/4", value_parser = ring)]
    rings: Vec<[usize; 2]>,
    /// Windows that read the colour opponent channels, WINDOW/CELL.
    #[arg(long, value_delimiter = ',', value_parser = ring)]
    colour: Vec<[usize; 2]>,
    /// Hidden units.
    #[arg(long, default_value_t = 500)]
    hidden: usize,
    /// Passes over the glimpses.
    #[arg(long, default_value_t = 30)]
    epochs: usize,
    /// Number of training glimpses.
    #[arg(long, default_value_t = 120_000)]
    glimpses: usize,
    /// Number of glimpses of held-out pictures, for monitoring.
    #[arg(long, default_value_t = 2000)]
    held_out: usize,
    /// Visible units; default: bernoulli for digits, gaussian for natural.
    #[arg(long, value_enum)]
    visible: Option<VisibleName>,
    /// Size of a mini-batch.
    #[arg(long, default_value_t = 100)]
    batch: usize,
    /// Learning rate; default: 0.1 for bernoulli and 0.02 for gaussian units.
    #[arg(long)]
    rate: Option<f32>,
    /// Momentum, at most 0.5 in the first five epochs.
    #[arg(long, default_value_t = 0.9)]
    momentum: f32,
    /// Contrastive divergence, or stochastic maximum likelihood with persistent chains.
    #[arg(long, value_enum, default_value = "cd")]
    method: Method,
    /// Gibbs steps per batch.
    #[arg(long, default_value_t = 1)]
    steps: usize,
    /// Persistent chains.
    #[arg(long, default_value_t = 100)]
    chains: usize,
    /// L2 weight decay.
    #[arg(long, default_value_t = 2e-4)]
    l2: f32,
    /// L1 weight decay.
    #[arg(long, default_value_t = 0.0)]
    l1: f32,
    /// Target mean activity of hidden units, 0 for none; default: 0.1 for natural, none for digits.
    #[arg(long)]
    sparsity: Option<f32>,
    /// Weight of the sparsity target.
    #[arg(long, default_value_t = 1.0)]
    sparsity_cost: f32,
    /// First epoch of weight averaging; default: half of the epochs.
    #[arg(long)]
    average_from: Option<usize>,
    /// Random seed; the same seed gives the same model.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Output picture of the filters; default: the model's name with .png.
    #[arg(long, value_name = "FILE")]
    filters: Option<PathBuf>,
    /// Estimate the log-likelihood of the held-out glimpses at the end, by annealed importance sampling.
    #[arg(long)]
    ais: bool,
    /// Start from the beginning, even if there is a checkpoint.
    #[arg(long)]
    restart: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum SetName {
    Digits,
    Natural,
}

#[derive(Clone, Copy, ValueEnum)]
enum VisibleName {
    Bernoulli,
    Gaussian,
}

#[derive(Clone, Copy, ValueEnum)]
enum Method {
    Cd,
    Sml,
}

fn ring(text: &str) -> std::result::Result<[usize; 2], String> {
    let parsed = text.split_once('/').and_then(|(window, cell)| Some([window.parse().ok()?, cell.parse().ok()?]));
    parsed.ok_or_else(|| format!("expected WINDOW/CELL such as 16/2, got {text}"))
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

impl RbmArgs {
    fn recipe(&self) -> Recipe {
        let visible = match (self.visible, self.set) {
            (Some(VisibleName::Bernoulli), _) | (None, SetName::Digits) => Visible::Bernoulli,
            (Some(VisibleName::Gaussian), _) | (None, SetName::Natural) => Visible::Gaussian,
        };
        let target = self.sparsity.unwrap_or(if matches!(self.set, SetName::Natural) { 0.1 } else { 0.0 });
        let usual = Recipe::new(visible, self.hidden);
        Recipe {
            epochs: self.epochs,
            batch: self.batch,
            rate: self.rate.unwrap_or(usual.rate),
            momentum: self.momentum,
            negative: match self.method {
                Method::Cd => Negative::Contrastive { steps: self.steps },
                Method::Sml => Negative::Persistent { chains: self.chains, steps: self.steps },
            },
            l2: self.l2,
            l1: self.l1,
            sparsity: (target > 0.0).then_some(Sparsity { target, cost: self.sparsity_cost }),
            average_from: Some(self.average_from.unwrap_or(self.epochs / 2)),
            seed: self.seed,
            ..usual
        }
    }
    /// Returns the command that makes the same model, with every setting explicit and folders left open.
    fn command(&self, retina: &FovealConfig, recipe: &Recipe) -> String {
        let set = self.set.to_possible_value().expect("a name");
        let mut text = format!(
            "foveate train rbm --data DIR --set {} --side {} --rings {} --hidden {} --epochs {} --glimpses {} --visible {} \
             --batch {} --rate {} --momentum {} --l2 {} --l1 {} --average-from {} --seed {}",
            set.get_name(),
            retina.side,
            common::rings(&retina.rings),
            recipe.hidden,
            recipe.epochs,
            self.glimpses,
            if recipe.visible == Visible::Bernoulli { "bernoulli" } else { "gaussian" },
            recipe.batch,
            recipe.rate,
            recipe.momentum,
            recipe.l2,
            recipe.l1,
            recipe.average_from.unwrap_or(recipe.epochs),
            recipe.seed
        );
        match recipe.negative {
            Negative::Contrastive { steps } => text += &format!(" --method cd --steps {steps}"),
            Negative::Persistent { chains, steps } => {
                text += &format!(" --method sml --steps {steps} --chains {chains}")
            }
        }
        match recipe.sparsity {
            Some(s) => text += &format!(" --sparsity {} --sparsity-cost {}", s.target, s.cost),
            None => text += " --sparsity 0",
        }
        text + &common::colour(retina) + " --out FILE"
    }
}

fn train(args: &RbmArgs) -> Result<()> {
    let files = common::Files::of(&args.out, args.filters.as_deref(), args.restart)?;
    let retina = common::retina(args.config.as_deref(), args.side, &args.rings, &args.colour)?;
    let recipe = args.recipe();
    recipe.check()?;
    let set = match args.set {
        SetName::Digits => training::Set::Digits,
        SetName::Natural => training::Set::Natural,
    };
    let counts = [args.glimpses, args.held_out];
    let glimpses = common::Glimpses::look(retina, (set, &args.data), counts, recipe.visible, args.seed)?;

    let trainer = files.train::<Trainer, _>(
        &recipe,
        &glimpses.sha256,
        |_| Ok(glimpses.rows()),
        |rows| *rows,
        |trainer, _| {
            let learned = trainer.learned();
            let [fit, held] = glimpses.monitored().map(|rows| Fit::of(&learned, rows));
            Ok(epoch_line(&fit, &held))
        },
    )?;

    let (rbm, retina) = (trainer.learned(), &glimpses.retina);
    let command = args.command(retina.config(), &recipe);
    rbm.save(files.model, &glimpses.metadata(command, recipe.seed, recipe.epochs))?;
    if args.ais {
        print_likelihood(&rbm, glimpses.rows(), glimpses.held(), args.seed)?;
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
