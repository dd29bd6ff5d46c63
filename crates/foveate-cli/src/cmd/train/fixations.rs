//! Implements `foveate train fixations`: learns to recognise digits from a few fixations.

use std::sync::Arc;

use foveate::files::Folder;
use foveate::identity::multi_fixation::classifier_path;
use foveate::identity::retina::Foveal;
use foveate::identity::{Encoder, MultiFixation};
use foveate::lab::eval::Reliability;
use foveate::lab::training::recognition::curve;
use foveate::lab::training::sequences::{FixationData, FixationSampler, Gazes, Nuisance, larochelle_hinton};
use foveate::lab::training::{Source, sha256_of};
use foveate::lab::{Digits, Split};
use foveate::learn::rbm::Metadata;
use foveate::learn::rbm::fixations::{About, FixationRbm, Places, Recipe, Trainer};
use foveate::learn::softmax::{Fit, Softmax, temperature};
use foveate::rows::Rows;
use foveate::{Error, Result};
use serde::{Deserialize, Serialize};

use super::common;
use crate::cmd::configure::{self, Changes};

/// Number of held-out training digits: the last of the set.
const HELD_OUT: usize = 5000;
/// Fixations of the final curve, and number of its digits.
const CURVE: (usize, usize) = (30, 2000);

/// Shipped recipes.
const RECIPES: [(&str, &str); 2] = [
    ("fixations", include_str!("../../../recipes/fixations.toml")),
    ("larochelle-hinton", include_str!("../../../recipes/larochelle-hinton.toml")),
];

/// Train a multi-fixation RBM, which recognises a digit by a few glimpses.
///
/// The input is the features of a configuration's first layer, at random gazes on digits as in a track: slightly displaced, among
/// other digits, with noise. Progress is kept in FILE.checkpoint: after an interruption (Ctrl-C, kill) the same command resumes and gives
/// the same result bit for bit. The same seed gives the same model for any number of threads.
#[derive(clap::Args)]
#[command(after_long_help = RECIPES[0].1)]
pub(super) struct Args {
    #[command(flatten)]
    common: common::Args,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Lesson {
    /// None: the retina and the gazes of Larochelle & Hinton (2010).
    config: Option<String>,
    digits: usize,
    clean: bool,
    within: Option<f64>,
    training: Recipe,
}

/// The input of the recogniser and its description.
struct View {
    sampler: FixationSampler,
    retina: String,
    first_layer: String,
}

impl Lesson {
    /// Returns the input of the recogniser. Without a configuration it also sets the places.
    fn view(&mut self) -> Result<View> {
        let (retina, encoder, gazes, first_layer): (_, Option<Arc<dyn Encoder>>, _, _);
        if let Some(config) = &self.config {
            let (config, folder) = configure::read(config, &Changes::default())?;
            if self.within.is_some_and(|reach| !(0.0..=1.0).contains(&reach)) {
                return Err(Error::Config("within must be 0 to 1 template units".into()));
            }
            let (seen, layer): (Foveal, Arc<dyn Encoder>) = config.identity(&folder)?;
            (retina, encoder) = (seen, Some(layer));
            gazes = self.within.map_or(Gazes::Among, |reach| Gazes::Within { reach });
            first_layer = serde_json::to_string(&config.encoder).expect("a configuration becomes JSON");
        } else {
            let (config, fixed) = larochelle_hinton()?;
            self.training.places = Places::new(fixed.iter().map(|g| [g.u as f32, g.v as f32]).collect())?;
            (retina, encoder, gazes, first_layer) = (Foveal::new(config)?, None, Gazes::All(fixed), String::new());
        }
        let nuisance = if self.clean { Nuisance::default() } else { Nuisance::of_tracks() };
        let geometry = serde_json::to_string(retina.config()).expect("a retina's geometry becomes JSON");
        let Recipe { places, window, seed, .. } = self.training.clone();
        let sampler = FixationSampler { retina, encoder, places, gazes, window, nuisance, seed };
        Ok(View { sampler, retina: geometry, first_layer })
    }
}

/// Runs the command.
pub(super) fn run(args: &Args) -> Result<()> {
    let (files, args) = (args.common.files()?, &args.common);
    let mut lesson: Lesson = args.recipe(&RECIPES)?;
    lesson.training.check()?;
    let view = lesson.view()?;
    let (recipe, command) = (&lesson.training, args.command("fixations", &lesson));
    let all = Digits::load(&args.data, Split::Train)?;
    let most = all.len().saturating_sub(HELD_OUT.min(all.len() / 10));
    if lesson.digits < 10 || most < 10 {
        return Err(Error::Config(format!(
            "digits is {}, and there are {most}: at least 10 are needed",
            lesson.digits
        )));
    }
    let (learn, held) = (all.range(0, lesson.digits.min(most)), all.range(most, all.len()));
    let held = view.sampler.look(&held, u64::MAX)?;
    say!(
        "{} digits, {} held out: {} values a fixation, {} fixations",
        learn.len(),
        all.len() - most,
        view.sampler.width(),
        recipe.window
    );

    let digits = Source::of_digits(learn.clone()).sha256().to_owned();
    // What the first layer makes of them: its file may be another one of the same name.
    let name = format!("{digits} {} {command}", sha256_of(held.sequences().glimpses().data()));
    let still = matches!(view.sampler.gazes, Gazes::All(_)) && view.sampler.nuisance == Nuisance::default();
    let shown = |epoch: usize| view.sampler.look(&learn, if still { 0 } else { epoch as u64 });
    let trainer = files.train::<Trainer, _>(recipe, &name, shown, FixationData::sequences, |trainer, _| {
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
        command,
        data: format!("{} MNIST training digits", learn.len()),
        data_sha256: digits,
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
