//! `foveate train classifier`: a recogniser of the user's own classes, from a folder of pictures for each.

use std::path::PathBuf;

use foveate::Result;
use foveate::config::{Config, RetinaConfig};
use foveate::files::Folder;
use foveate::identity::Classifier;
use foveate::identity::retina::FovealConfig;
use foveate::lab::training::classifier::{Held, Recipe, Trainer, calibrated, judge};
use foveate::lab::training::pictures::{FeatureExtractor, Pictures, Variation};
use foveate::learn::rbm::Metadata;
use foveate::rows::Rows;

use super::common::{self, Files};
use crate::cmd::configure::{self, Changes};

/// Times that held-out pictures are shown otherwise, to see what a track would make of them.
const SHOWN: u64 = 4;
/// Classes of the largest table of decisions that is printed.
const MOST: usize = 20;

/// Learn a recogniser of your own classes: DIR has a folder of pictures for each, whose name is the class.
///
/// Pictures are JPEG or PNG of any size, cut to the thing they show; colours become grey, unless the retina of --config reads
/// colour. The last fifth of each folder, by name, is held out to judge the recogniser by. `foveate track VIDEO --recognise FILE`
/// uses it. Progress is kept in FILE.checkpoint: after an interruption (Ctrl-C, kill) the same command goes on from there and ends
/// with the same bits.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Folder with a folder of pictures for each class.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// The model file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Take retina and first layer from this configuration, a file or the name of one that ships with the program; unless
    /// given, k-means filters on 14 x 14 cells.
    #[arg(long, value_name = "FILE|NAME")]
    config: Option<String>,
    /// Times that every picture is shown.
    #[arg(long, default_value_t = 100)]
    epochs: usize,
    /// Pictures of a mini-batch.
    #[arg(long, default_value_t = 32)]
    batch: usize,
    /// Step size.
    #[arg(long, default_value_t = 0.002)]
    rate: f32,
    /// Weight decay, with every step.
    #[arg(long, default_value_t = 0.002)]
    decay: f32,
    /// Show pictures as they are, not shifted, scaled, turned and in another light as along tracks.
    #[arg(long)]
    still: bool,
    /// Seed of all random numbers: the same seed gives the same model.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Begin anew, even if there is a checkpoint.
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
    /// The configuration of retina and first layer, and where its files are.
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
    /// The command that makes the same model: every setting said, folders left open.
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
    let files = Files::of(&args.out, None, args.restart)?;
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
    let shown =
        |extractor: &FeatureExtractor, epoch: usize| extractor.look(&learn, if args.still { 0 } else { epoch as u64 });
    let data = format!("{} {first_layer} {geometry} {}", all.sha256(), args.still);
    let first = shown(&extractor, 0);
    let rows = Rows::new(&first, n_h);
    let trainer = files.begin(
        Trainer::progress,
        |path| Trainer::resume(path, recipe.clone(), rows, &data),
        || Trainer::new(recipe.clone(), rows),
    )?;
    let as_they_are = look(&extractor, Variation::default(), &held, 1);
    // The trainer, and the pictures as this epoch shows them.
    let batches = trainer.batches(learn.len());
    let mut learning = (trainer, 0, first);
    common::train(
        (recipe.epochs, batches),
        &mut learning,
        |(trainer, ..)| trainer.progress(),
        |(trainer, epoch, made)| {
            if trainer.progress().0 != *epoch {
                *epoch = trainer.progress().0;
                *made = shown(&extractor, *epoch);
            }
            trainer.step(Rows::new(made, n_h), learn.labels());
            Ok(())
        },
        |(trainer, ..)| trainer.save(&files.checkpoint, &data),
        |(trainer, _, made)| {
            let softmax = trainer.learned()?;
            let right = |rows: &[f32], labels: &[u8]| {
                100.0 * judge(&softmax, Rows::new(rows, n_h), labels).reliability.accuracy
            };
            let (ours, theirs) = (right(made, learn.labels()), right(&as_they_are, held.labels()));
            Ok(format!("right {ours:.1} % (held out {theirs:.1} %)"))
        },
    )?;

    let softmax = learning.0.learned()?;
    let varied = look(&extractor, Variation::of_tracks(), &held, SHOWN);
    let again = held.labels().repeat(SHOWN as usize);
    print("held-out pictures as they are", all.names(), &judge(&softmax, Rows::new(&as_they_are, n_h), held.labels()));
    print("held-out pictures as along tracks", all.names(), &judge(&softmax, Rows::new(&varied, n_h), &again));
    let softmax = calibrated(softmax, Rows::new(&varied, n_h), &again);
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

/// Features of pictures shown so, `times` over, as no epoch of the training shows them.
fn look(extractor: &FeatureExtractor, variation: Variation, pictures: &Pictures, times: u64) -> Vec<f32> {
    let other = FeatureExtractor {
        retina: extractor.retina.clone(),
        encoder: extractor.encoder.clone(),
        variation,
        seed: !extractor.seed,
    };
    (0..times).flat_map(|time| other.look(pictures, time)).collect()
}

/// Prints how well held-out pictures are told apart.
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
