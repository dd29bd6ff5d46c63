//! Implements `foveate train fixations`: learns to recognise digits from a few fixations.

use std::path::PathBuf;
use std::sync::Arc;

use clap::ValueEnum;
use foveate::files::Folder;
use foveate::identity::multi_fixation::classifier_path;
use foveate::identity::retina::Foveal;
use foveate::identity::{Encoder, MultiFixation};
use foveate::lab::eval::Reliability;
use foveate::lab::training::recognition::curve;
use foveate::lab::training::sequences::{FixationData, FixationSampler, Gazes, Nuisance, larochelle_hinton};
use foveate::lab::{Digits, Split};
use foveate::learn::rbm::Metadata;
use foveate::learn::rbm::fixations::{About, Cost, FixationRbm, Gates, Places, Recipe, Trainer};
use foveate::learn::softmax::{Fit, Softmax, temperature};
use foveate::rows::Rows;
use foveate::{Error, Result};

use super::common::Files;
use crate::cmd::configure::{self, Changes};

/// Number of held-out training digits: the last of the set.
const HELD_OUT: usize = 5000;
/// Fixations of the final curve, and number of its digits.
const CURVE: (usize, usize) = (30, 2000);

/// Train a multi-fixation RBM, which recognises a digit by a few glimpses.
///
/// The input is the features of a configuration's first layer, at random gazes on digits as a tracker sees them: slightly displaced, among
/// other digits, with noise. Progress is kept in FILE.checkpoint: after an interruption (Ctrl-C, kill) the same command resumes and gives
/// the same result bit for bit. The same seed gives the same model for any number of threads.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Folder with the four MNIST files, or with a folder `mnist` of them.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Output model file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Take retina and first layer from this configuration: a file, or the name of a shipped configuration.
    #[arg(long, value_name = "FILE", default_value = "digits-rbm", conflicts_with = "larochelle_hinton")]
    config: String,
    /// Reproduce Larochelle and Hinton (2010) instead: no first layer, centred digits, four fixed gazes.
    #[arg(long)]
    larochelle_hinton: bool,
    /// Training cost: `generative` learns layer by layer, with a separate classifier on top, as in the paper.
    #[arg(long, value_enum, default_value = "hybrid-sequential")]
    cost: CostName,
    /// Weight of the generative part of the hybrid costs; default: 0.1 for 96 pixels of four fixations, 0.003 for the many features of a
    /// first layer.
    #[arg(long)]
    alpha: Option<f32>,
    /// Number of fixations per decision.
    #[arg(long, default_value_t = 3)]
    window: usize,
    /// Half side of the square of gaze places, in template units.
    #[arg(long, default_value_t = 0.5)]
    reach: f64,
    /// Number of places along a side of the square; fixations are drawn from all of them.
    #[arg(long, default_value_t = 3)]
    grid: usize,
    /// Draw fixations from the whole square instead of the places alone.
    #[arg(long)]
    anywhere: bool,
    /// Number of training digits, 10 to 55000; the last 5000 are held out.
    #[arg(long, default_value_t = 55_000)]
    digits: usize,
    /// Show digits centred and alone.
    #[arg(long)]
    clean: bool,
    /// Hidden units.
    #[arg(long, default_value_t = 500)]
    hidden: usize,
    /// Factors.
    #[arg(long, default_value_t = 250)]
    factors: usize,
    /// Nonlinearity of the gates: `linear` is the paper's.
    #[arg(long, value_enum, default_value = "logistic")]
    gates: GatesName,
    /// Passes over the digits.
    #[arg(long, default_value_t = 14)]
    epochs: usize,
    /// Sequences per mini-batch.
    #[arg(long, default_value_t = 100)]
    batch: usize,
    /// Initial learning rate.
    #[arg(long, default_value_t = 0.008)]
    rate: f32,
    /// Weight decay, independent of the learning rate.
    #[arg(long, default_value_t = 0.01)]
    l2: f32,
    /// Decay of the running mean of the parameters, 0 to 1.
    #[arg(long, default_value_t = 0.999)]
    average: f32,
    /// Random seed; the same seed gives the same model.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Start from the beginning, even if there is a checkpoint.
    #[arg(long)]
    restart: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum CostName {
    Generative,
    Hybrid,
    HybridSequential,
}

#[derive(Clone, Copy, ValueEnum)]
enum GatesName {
    Linear,
    Logistic,
}

/// The input of the recogniser and its description.
struct View {
    sampler: FixationSampler,
    retina: String,
    first_layer: String,
}

impl Args {
    fn recipe(&self, places: Places) -> Recipe {
        let cost = match self.cost {
            CostName::Generative => Cost::Generative,
            CostName::Hybrid => Cost::Hybrid,
            CostName::HybridSequential => Cost::HybridSequential,
        };
        let classes = if cost == Cost::Generative { 0 } else { 10 };
        Recipe {
            hidden: self.hidden,
            factors: self.factors,
            alpha: self.alpha.unwrap_or(if self.larochelle_hinton { 0.1 } else { 0.003 }),
            gates: match self.gates {
                GatesName::Linear => Gates::Linear,
                GatesName::Logistic => Gates::Logistic,
            },
            epochs: self.epochs,
            batch: self.batch,
            rate: self.rate,
            l2: self.l2,
            average: self.average,
            seed: self.seed,
            ..Recipe::new(cost, self.window(), classes, places)
        }
    }
    fn window(&self) -> usize {
        if self.larochelle_hinton { 4 } else { self.window }
    }
    fn view(&self) -> Result<View> {
        let (retina, encoder, places, gazes, nuisance, first_layer);
        if self.larochelle_hinton {
            let (config, fixed) = larochelle_hinton()?;
            places = Places::new(fixed.iter().map(|g| [g.u as f32, g.v as f32]).collect())?;
            (retina, encoder, gazes) = (Foveal::new(config)?, None, Gazes::All(fixed));
            (nuisance, first_layer) = (Nuisance::default(), String::new());
        } else {
            let (config, folder) = configure::read(&self.config, &Changes::default())?;
            if !(0.0..=1.0).contains(&self.reach) || !(1..=31).contains(&self.grid) {
                return Err(Error::Config("--reach must be 0 to 1 template units, --grid 1 to 31 places".into()));
            }
            let (seen, layer): (Foveal, Arc<dyn Encoder>) = config.identity(&folder)?;
            places = Places::grid(self.grid, self.reach as f32)?;
            gazes = if self.anywhere { Gazes::Within { reach: self.reach } } else { Gazes::Among };
            (retina, encoder) = (seen, Some(layer));
            nuisance = if self.clean { Nuisance::default() } else { Nuisance::of_tracks() };
            first_layer = serde_json::to_string(&config.encoder).expect("a configuration becomes JSON");
        }
        let geometry = serde_json::to_string(retina.config()).expect("a retina's geometry becomes JSON");
        let sampler =
            FixationSampler { retina, encoder, places, gazes, window: self.window(), nuisance, seed: self.seed };
        Ok(View { sampler, retina: geometry, first_layer })
    }
    /// Returns the command that makes the same model, with every setting explicit and folders left open.
    fn command(&self, r: &Recipe) -> String {
        let name = |value: Option<clap::builder::PossibleValue>| value.expect("a name").get_name().to_string();
        let what = if self.larochelle_hinton {
            "--larochelle-hinton".to_string()
        } else {
            let clean = if self.clean { " --clean" } else { "" };
            let anywhere = if self.anywhere { " --anywhere" } else { "" };
            format!(
                "--config {} --window {} --reach {} --grid {}{anywhere}{clean}",
                self.config, r.window, self.reach, self.grid
            )
        };
        format!(
            "foveate train fixations --data DIR {what} --cost {} --alpha {} --digits {} --hidden {} --factors {} --gates {} \
             --epochs {} --batch {} --rate {} --l2 {} --average {} --seed {} --out FILE",
            name(self.cost.to_possible_value()),
            r.alpha,
            self.digits,
            r.hidden,
            r.factors,
            name(self.gates.to_possible_value()),
            r.epochs,
            r.batch,
            r.rate,
            r.l2,
            r.average,
            r.seed
        )
    }
}

/// Runs the command.
pub(super) fn run(args: &Args) -> Result<()> {
    let files = Files::of(&args.out, None, args.restart)?;
    let view = args.view()?;
    let recipe = args.recipe(view.sampler.places.clone());
    recipe.check()?;
    let all = Digits::load(&args.data, Split::Train)?;
    let most = all.len().saturating_sub(HELD_OUT.min(all.len() / 10));
    if args.digits < 10 || most < 10 {
        return Err(Error::Config(format!(
            "--digits is {}, and there are {most}: at least 10 are needed",
            args.digits
        )));
    }
    let (learn, held) = (all.range(0, args.digits.min(most)), all.range(most, all.len()));
    let held = view.sampler.look(&held, u64::MAX)?;
    say!(
        "{} digits, {} held out: {} values a fixation, {} fixations",
        learn.len(),
        all.len() - most,
        view.sampler.width(),
        recipe.window
    );

    let name = format!("{} digits, {}", learn.len(), args.command(&recipe));
    let still = matches!(view.sampler.gazes, Gazes::All(_)) && view.sampler.nuisance == Nuisance::default();
    let shown = |epoch: usize| view.sampler.look(&learn, if still { 0 } else { epoch as u64 });
    let trainer = files.train::<Trainer, _>(&recipe, &name, shown, FixationData::sequences, |trainer, _| {
        let (log_p, wrong) = trainer.take_tally();
        let rbm = trainer.learned()?;
        if rbm.classes() == 0 {
            return Ok(String::new());
        }
        let s = held.sequences();
        let log_p_held = rbm.log_posterior(s.glimpses(), s.codes(), s.window());
        let held = Reliability::of(&log_p_held, s.labels(), rbm.classes(), 10);
        let errors = (100.0 * wrong, 100.0 * (1.0 - held.accuracy));
        Ok(format!(
            "log p(y|x) {log_p:.4} (held out {:.4})  errors {:.2} % ({:.2} %)",
            -held.log_loss, errors.0, errors.1
        ))
    })?;

    // Fit a temperature for the classes, or a classifier of the hidden units with its own temperature.
    let rbm = trainer.learned()?;
    let metadata = Metadata {
        retina: view.retina.clone(),
        command: args.command(&recipe),
        data: format!("{} MNIST training digits", learn.len()),
        data_sha256: foveate::lab::training::Source::of_digits(learn.clone()).sha256().into(),
        seed: recipe.seed,
        epochs: recipe.epochs,
    };
    let mut about = About { metadata, first_layer: view.first_layer.clone(), temperature: 1.0 };
    if rbm.classes() > 0 {
        let s = held.sequences();
        let log_p = rbm.log_posterior(s.glimpses(), s.codes(), s.window());
        about.temperature = temperature(&log_p, s.labels(), rbm.classes()) as f32;
    } else {
        let classifier = classifier(&rbm, &shown, still, &held)?;
        classifier.save(&classifier_path(&args.out), &about.metadata)?;
        say!("wrote {}", classifier_path(&args.out).display());
    }
    rbm.save(&args.out, &about)?;
    files.finish(None)?;
    match Digits::load(&args.data, Split::Test) {
        Ok(test) => assess(&MultiFixation::read(&Folder::here(), &args.out)?.0, view.sampler, &test),
        Err(_) => Ok(()),
    }
}

/// Fits the paper's classifier on the digits of two epochs, and its temperature on the held-out digits.
fn classifier(
    rbm: &FixationRbm,
    shown: &dyn Fn(usize) -> Result<FixationData>,
    still: bool,
    held: &FixationData,
) -> Result<Softmax> {
    let (mut hidden, mut labels) = (vec![], vec![]);
    for epoch in 0..if still { 1 } else { 2 } {
        let made = shown(epoch)?;
        let s = made.sequences();
        hidden.extend(rbm.hidden_probabilities(s.glimpses(), s.codes(), s.window()));
        labels.extend_from_slice(s.labels());
    }
    let (mut classifier, _) = Softmax::fit(Rows::new(&hidden, rbm.hidden()), &labels, 10, Fit::default())?;
    let s = held.sequences();
    let hidden = rbm.hidden_probabilities(s.glimpses(), s.codes(), s.window());
    classifier.calibrate(Rows::new(&hidden, rbm.hidden()), s.labels())?;
    Ok(classifier)
}

/// Prints the accuracy on test digits.
fn assess(recogniser: &MultiFixation, mut sampler: FixationSampler, test: &Digits) -> Result<()> {
    let print = |what: &str, found: &Reliability| {
        let (errors, ece) = (100.0 * (1.0 - found.accuracy), 100.0 * found.ece);
        say!("{what}: errors {errors:.2} %, log loss {:.4}, calibration error {ece:.2} %", found.log_loss);
    };
    sampler.seed = !sampler.seed;
    let n = test.len();
    if let Gazes::All(_) = sampler.gazes {
        let (points, found) = curve(recogniser, &sampler, test)?;
        print(&format!("{n} test digits, all {} fixations", sampler.window), &found);
        points.iter().for_each(|p| say!("  {} fixations: {:.2} % right", p.looks, 100.0 * p.single));
        return Ok(());
    }
    let window = sampler.window;
    for (what, nuisance) in [("centred and alone", Nuisance::default()), ("as along tracks", Nuisance::of_tracks())] {
        sampler.nuisance = nuisance;
        sampler.window = window;
        let (_, found) = curve(recogniser, &sampler, test)?;
        print(&format!("{n} test digits, {what}, a decision of {window} fixations"), &found);
        found.bins.iter().filter(|b| b.count > 0).for_each(|b| {
            say!("  confidence {:.3}: {:.3} right, {} decisions", b.confidence, b.accuracy, b.count);
        });
        sampler.window = CURVE.0;
        let (points, _) = curve(recogniser, &sampler, &test.range(0, CURVE.1.min(n)))?;
        for p in points.iter().filter(|p| [1, 2, 3, 5, 10, 20, 30].contains(&p.looks)) {
            say!(
                "  {} fixations: the last {window} alone {:.2} % right, all together {:.2} %",
                p.looks,
                100.0 * p.single,
                100.0 * p.gathered
            );
        }
    }
    Ok(())
}
