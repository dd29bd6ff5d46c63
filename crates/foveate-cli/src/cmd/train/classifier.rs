//! Implements `foveate train classifier`: a recogniser of the user's own classes, from one folder of pictures per class.

use std::path::{Path, PathBuf};

use foveate::Result;
use foveate::config::{Config, RetinaConfig};
use foveate::files::Folder;
use foveate::identity::Classifier;
use foveate::identity::retina::FovealConfig;
use foveate::lab::training::classifier::{Held, Recipe, Trainer, calibrated, judge};
use foveate::lab::training::pictures::{FeatureExtractor, Pictures, Variation};
use foveate::lab::training::sha256_of;
use foveate::learn::rbm::Metadata;
use foveate::rows::Rows;

use super::common::Files;
use crate::cmd::configure::{self, Changes};

/// Number of variants of each held-out picture, to estimate the accuracy along a track.
const SHOWN: u64 = 4;
/// Maximum number of classes in a printed confusion matrix.
const MOST: usize = 20;

/// Train a recogniser of your own classes: DIR has one folder of pictures per class, named after the class.
///
/// Pictures are JPEG or PNG of any size, cropped to the object. Colours become grey, unless the retina of --config reads colour. The last
/// fifth of each folder, by name, is held out for evaluation. `foveate track VIDEO --recognise FILE` uses the model. Progress is kept in
/// FILE.checkpoint: after an interruption (Ctrl-C, kill) the same command resumes and gives the same result bit for bit.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Folder with one folder of pictures per class.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Output model file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Take retina and first layer from this configuration: a file or the name of a shipped one. Default: k-means filters on 14 x 14 cells.
    #[arg(long, value_name = "FILE|NAME")]
    config: Option<String>,
    /// Passes over the pictures.
    #[arg(long, default_value_t = 100)]
    epochs: usize,
    /// Size of a mini-batch.
    #[arg(long, default_value_t = 32)]
    batch: usize,
    /// Learning rate.
    #[arg(long, default_value_t = 0.002)]
    rate: f32,
    /// Weight decay per step.
    #[arg(long, default_value_t = 0.002)]
    decay: f32,
    /// Train on pictures as they are, without the shifts, scales, rotations and lighting changes that occur along tracks.
    #[arg(long)]
    still: bool,
    /// Random seed; the same seed gives the same model.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Start from the beginning, even if there is a checkpoint.
    #[arg(long)]
    restart: bool,
}

impl Args {
    fn recipe(&self, classes: usize) -> Recipe {
        Recipe {
            epochs: self.epochs,
            batch: self.batch,
            rate: self.rate,
            decay: self.decay,
            seed: self.seed,
            ..Recipe::new(classes)
        }
    }
    /// Returns the configuration of retina and first layer, and the folder of its files.
    fn layer(&self) -> Result<(Config, Folder)> {
        if let Some(name) = &self.config {
            return configure::read(name, &Changes::default());
        }
        let usual = ["encoder.kind=kmeans", "encoder.pool=3"].map(String::from);
        let (mut config, folder) = configure::read("natural-learned", &Changes::of(&usual))?;
        let rings = vec![[28, 2]];
        config.retina = Some(RetinaConfig::Foveal(FovealConfig { side: 28.0, rings, colour: vec![] }));
        Ok((config, folder))
    }
    /// Returns the command that makes the same model, with every setting explicit and folders left open.
    fn command(&self) -> String {
        let config = self.config.as_ref().map_or(String::new(), |name| format!(" --config {name}"));
        let still = if self.still { " --still" } else { "" };
        format!(
            "foveate train classifier --data DIR{config}{still} --epochs {} --batch {} --rate {} --decay {} --seed {} --out FILE",
            self.epochs, self.batch, self.rate, self.decay, self.seed
        )
    }
}

/// Runs the command.
pub(super) fn run(args: &Args) -> Result<()> {
    let inputs: Vec<&Path> = args.config.iter().map(Path::new).collect();
    let files = Files::of(&args.out, &inputs, args.restart)?;
    let (config, folder) = args.layer()?;
    let (retina, encoder) = config.identity(&folder)?;
    let geometry = serde_json::to_string(retina.config()).expect("a retina's geometry becomes JSON");
    let first_layer = serde_json::to_string(&config.encoder).expect("a configuration becomes JSON");
    let all = Pictures::load(&args.data, !retina.config().colour.is_empty())?;
    let (learn, held) = all.split();
    let recipe = args.recipe(all.names().len());
    recipe.check()?;
    let n_h = encoder.shape().1;
    say!("{} pictures to learn from, {} held out: {n_h} features each", learn.len(), held.len());
    for (class, name) in all.names().iter().enumerate() {
        say!("  {name}: {} and {}", learn.of_class(class), held.of_class(class));
    }

    let variation = if args.still { Variation::default() } else { Variation::of_tracks() };
    let extractor = FeatureExtractor { retina, encoder, variation, seed: args.seed };
    let as_they_are = look(&extractor, Variation::default(), &held, 1);
    // Retina and first layer by what they make of them: a file may be another one of the same name.
    let data = format!("{} {} {}", all.sha256(), sha256_of(&as_they_are), args.still);
    let trainer = files.train::<Trainer, _>(
        &recipe,
        &data,
        |epoch| Ok((extractor.look(&learn, if args.still { 0 } else { epoch as u64 }), learn.labels())),
        |(made, labels)| (Rows::new(made, n_h), *labels),
        |trainer, (made, labels)| {
            let softmax = trainer.learned()?;
            let right = |rows: &[f32], labels: &[u8]| {
                100.0 * judge(&softmax, Rows::new(rows, n_h), labels).reliability.accuracy
            };
            let (ours, theirs) = (right(made, labels), right(&as_they_are, held.labels()));
            Ok(format!("right {ours:.1} % (held out {theirs:.1} %)"))
        },
    )?;

    let softmax = trainer.learned()?;
    let varied = look(&extractor, Variation::of_tracks(), &held, SHOWN);
    print("held-out pictures as they are", all.names(), &judge(&softmax, Rows::new(&as_they_are, n_h), held.labels()));
    print("held-out pictures as along tracks", all.names(), &judge(&softmax, Rows::new(&varied, n_h), held.labels()));
    let softmax = calibrated(softmax, Rows::new(&varied, n_h), held.labels());
    let metadata = Metadata {
        retina: geometry,
        command: args.command(),
        data: format!("{} pictures of {} classes", learn.len(), all.names().len()),
        data_sha256: all.sha256().into(),
        seed: recipe.seed,
        epochs: recipe.epochs,
    };
    let classifier = Classifier::new(softmax, all.names().to_vec())?;
    foveate::files::write(&args.out, &classifier.to_bytes(&metadata, &first_layer))?;
    files.finish(None)?;
    say!("try it with: foveate track VIDEO --init X,Y,W,H --recognise {}", args.out.display());
    Ok(())
}

/// Returns the features of pictures with `times` variations each, which differ from those of all training epochs.
fn look(extractor: &FeatureExtractor, variation: Variation, pictures: &Pictures, times: u64) -> Vec<f32> {
    let other = FeatureExtractor {
        retina: extractor.retina.clone(),
        encoder: extractor.encoder.clone(),
        variation,
        seed: !extractor.seed,
    };
    (0..times).flat_map(|time| other.look(pictures, time)).collect()
}

/// Prints the accuracy on held-out pictures.
fn print(what: &str, names: &[String], held: &Held) {
    let r = &held.reliability;
    say!(
        "{what}: {:.1} % right, log loss {:.3}, calibration error {:.1} %",
        100.0 * r.accuracy,
        r.log_loss,
        100.0 * r.ece
    );
    if names.len() > MOST {
        return;
    }
    let longest = names.iter().map(|n| n.chars().count()).max().unwrap_or(0);
    say!("  decided for, in the same order, of each class:");
    for (name, row) in names.iter().zip(&held.confusion) {
        let counts: String = row.iter().map(|n| format!("{n:>5}")).collect();
        say!("  {name:longest$}{counts}");
    }
}
