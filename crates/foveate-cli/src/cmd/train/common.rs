//! Shared parts of the training commands: recipes, glimpses, files, and the loop with its checkpoints.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use foveate::config::{changed, parse};
use foveate::identity::retina::{Foveal, FovealConfig, Retina};
use foveate::lab::training;
use foveate::lab::training::{Set, Source};
use foveate::learn::rbm::{Metadata, Visible, io};
use foveate::learn::training::Training;
use foveate::rows::Rows;
use foveate::scene::Image;
use foveate::video::save_png;
use foveate::{Error, Result, files};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::cmd::results::{spare, writable};
use crate::terminal;

/// Interval between checkpoints within an epoch; a checkpoint is also written after every epoch.
const BETWEEN_CHECKPOINTS: Duration = Duration::from_secs(10);

/// Number of training rows and of held-out rows that are monitored after every epoch.
const MONITORED: usize = 500;

/// Arguments of a training with a recipe.
// Commands flatten it into groups of the same name.
#[derive(Debug, clap::Args)]
#[group(skip)]
pub struct Args {
    /// Folder with the data: the four MNIST files (or a folder `mnist` of them), or photographs, JPEG or PNG (or a folder `natural` of them).
    #[arg(long, value_name = "DIR")]
    pub data: PathBuf,
    /// Output model file.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Recipe: a TOML file with all settings, or the name of a shipped recipe.
    #[arg(long, value_name = "FILE|NAME")]
    recipe: Option<String>,
    /// Change one setting of the recipe, for example training.epochs=10. KEY=none removes a setting. Repeatable.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Start from the beginning, even if there is a checkpoint.
    #[arg(long)]
    pub restart: bool,
}

/// A recipe of a model of glimpses.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe<R> {
    /// The glimpses.
    pub glimpses: GlimpseRecipe,
    /// How the model learns.
    pub training: R,
}

/// The glimpses of a training.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GlimpseRecipe {
    set: Set,
    number: usize,
    held_out: usize,
    retina: FovealConfig,
}

/// Training and monitoring glimpses, n × the number of retina values.
#[derive(Debug)]
pub struct Glimpses {
    /// The retina of the glimpses.
    pub retina: Foveal,
    learn: Vec<f32>,
    held: Vec<f32>,
    /// Digest that identifies `learn`.
    pub sha256: String,
    pictures_sha256: String,
    pictures: String,
}

impl Args {
    /// Returns the output files of the training.
    pub fn files(&self) -> Result<Files<'_>> {
        let inputs: Vec<&Path> = self.recipe.iter().map(Path::new).collect();
        Files::of(&self.out, &inputs, self.restart)
    }
    /// Reads the recipe, by default the first of `shipped`, which are names and TOML texts, and applies the changes.
    pub fn recipe<T: Serialize + DeserializeOwned>(&self, shipped: &[(&str, &'static str)]) -> Result<T> {
        let name = self.recipe.as_deref().unwrap_or(shipped[0].0);
        let text = match shipped.iter().find(|(it, _)| *it == name) {
            Some((_, text)) => Cow::from(*text),
            None => files::read_text(Path::new(name), files::TEXT).map(Cow::from).map_err(|e| {
                let names: Vec<_> = shipped.iter().map(|(it, _)| *it).collect();
                Error::Config(format!("{e}; recipes that ship with the program: {}", names.join(", ")))
            })?,
        };
        self.set.iter().try_fold(parse(&text, name)?, |recipe, setting| changed(&recipe, setting))
    }
    /// Returns the command that makes the same model, with folders left open, and its recipe.
    pub fn command(&self, kind: &str, recipe: &impl Serialize) -> String {
        let recipe = toml::to_string(recipe).expect("a recipe is plain data");
        format!("{} --data DIR --recipe FILE --out FILE, with the recipe:\n{recipe}", io::command(kind))
    }
}

impl Glimpses {
    /// Trains on the same glimpses in every epoch, as `Files::train`. `line` describes the fit to the [monitored](Self::monitored) glimpses.
    pub fn train<T: for<'d> Training<Data<'d> = Rows<'d>>>(
        &self,
        files: &Files<'_>,
        recipe: &T::Recipe,
        mut line: impl FnMut(&mut T, [Rows<'_>; 2]) -> String,
    ) -> Result<T> {
        let line = |trainer: &mut T, _: &Rows<'_>| Ok(line(trainer, self.monitored()));
        files.train(recipe, &self.sha256, |_| Ok(self.rows()), |rows| *rows, line)
    }

    /// Reads the pictures in a folder, takes the glimpses, and prints a summary. Fails before reading if a count is 0, the retina's windows
    /// do not fit, or one of the output files would become a photograph.
    pub fn look(recipe: &GlimpseRecipe, data: &Path, files: &Files<'_>, visible: Visible, seed: u64) -> Result<Self> {
        let retina = Foveal::new(recipe.retina.clone())?;
        let counts = [recipe.number, recipe.held_out];
        if counts.contains(&0) {
            return Err(Error::Config("glimpses.number and glimpses.held_out must be at least 1".into()));
        }
        if recipe.set == Set::Natural {
            let inner = data.join("natural");
            let photographs = [if inner.is_dir() { &*inner } else { data }];
            [files.model, &files.picture].into_iter().try_for_each(|path| spare(path, &photographs))?;
        }
        let source = Source::load(recipe.set, data)?;
        let (learn, held) = source.split()?;
        let width = retina.glimpse_len();
        say!("{}: {} glimpses of {width} values, {} held out", source.describe(), counts[0], counts[1]);
        let rows = learn.glimpses(&retina, counts[0], visible, seed)?;
        Ok(Self {
            held: held.glimpses(&retina, counts[1], visible, !seed)?,
            sha256: training::sha256_of(&rows),
            learn: rows,
            retina,
            pictures_sha256: source.sha256().into(),
            pictures: learn.describe(),
        })
    }
    /// Returns the training metadata of a model file.
    pub fn metadata(&self, command: String, seed: u64, epochs: usize) -> Metadata {
        Metadata {
            retina: serde_json::to_string(self.retina.config()).expect("a retina's geometry becomes JSON"),
            command,
            data: format!("{} glimpses of {}", self.rows().len(), self.pictures),
            data_sha256: self.pictures_sha256.clone(),
            seed,
            epochs,
        }
    }
    /// Returns the training glimpses.
    pub fn rows(&self) -> Rows<'_> {
        Rows::new(&self.learn, self.retina.glimpse_len())
    }
    /// Returns the held-out glimpses.
    pub fn held(&self) -> Rows<'_> {
        Rows::new(&self.held, self.retina.glimpse_len())
    }
    /// Returns the training rows and the held-out rows that are monitored after every epoch.
    pub fn monitored(&self) -> [Rows<'_>; 2] {
        let some = |rows: Rows<'_>| rows.data().len().min(MONITORED * rows.width());
        [&self.learn, &self.held].map(|all| {
            let rows = Rows::new(all, self.retina.glimpse_len());
            Rows::new(&all[..some(rows)], rows.width())
        })
    }
}

/// The output files of a training run.
#[derive(Debug)]
pub struct Files<'a> {
    /// The model file.
    pub model: &'a Path,
    /// The checkpoint, which exists until the model is complete.
    checkpoint: PathBuf,
    picture: PathBuf,
    restart: bool,
}

impl<'a> Files<'a> {
    /// Creates the paths of the model and of the picture of its filters beside it; `restart` ignores a checkpoint.
    /// Fails if a folder is missing, a folder has the name of a file, or a file would replace one of the `inputs`, so that the error comes
    /// before the work.
    pub fn of(model: &'a Path, inputs: &[&Path], restart: bool) -> Result<Self> {
        let picture = model.with_extension("png");
        if picture == model {
            let problem =
                "the picture of the filters gets this name; give the model another one, such as model.safetensors";
            return Err(Error::Invalid(format!("--out {}: {problem}", model.display())));
        }
        for path in [model, &picture] {
            writable(path)?;
            spare(path, inputs)?;
        }
        let mut checkpoint = model.to_path_buf().into_os_string();
        checkpoint.push(".checkpoint");
        Ok(Self { model, checkpoint: checkpoint.into(), picture, restart })
    }

    /// Trains from the checkpoint, or from the beginning if there is none or `restart` is true, to the end. `name` identifies the data of all
    /// epochs, `shown` makes those of an epoch (counted from 0), `view` gives them to the trainer, and `line` describes the fit after an
    /// epoch. Ctrl-C writes a checkpoint and ends the program.
    pub fn train<T: Training, D>(
        &self,
        recipe: &T::Recipe,
        name: &str,
        shown: impl Fn(usize) -> Result<D>,
        view: impl for<'d> Fn(&'d D) -> T::Data<'d>,
        mut line: impl FnMut(&mut T, &D) -> Result<String>,
    ) -> Result<T> {
        let (mut seen, mut data) = (0, shown(0)?);
        let mut trainer = if self.restart || !self.checkpoint.exists() {
            T::new(recipe.clone(), view(&data))?
        } else {
            let trainer = T::resume(&self.checkpoint, recipe.clone(), view(&data), name)
                .map_err(|e| Error::Invalid(format!("{e}; --restart begins anew")))?;
            let (epoch, batch) = trainer.progress();
            say!("resuming {}: epoch {}, batch {batch}", self.checkpoint.display(), epoch + 1);
            trainer
        };
        terminal::catch_interrupts();
        let (epochs, batches) = (trainer.state().epochs(), trainer.batches(view(&data)));
        let bar = terminal::progress(Some(epochs * batches), "training");
        let (mut begun, mut saved) = (Instant::now(), Instant::now());
        while !trainer.is_done() {
            let (epoch, _) = trainer.progress();
            if epoch != seen {
                (seen, data) = (epoch, shown(epoch)?);
            }
            trainer.step(view(&data));
            let (epoch, batch) = trainer.progress();
            bar.set_position((epoch * batches + batch) as u64);
            let stop = terminal::stopping();
            if batch == 0 || stop || saved.elapsed() > BETWEEN_CHECKPOINTS {
                trainer.save(&self.checkpoint, name)?;
                saved = Instant::now();
            }
            if batch == 0 {
                let (line, seconds) = (line(&mut trainer, &data)?, begun.elapsed().as_secs_f64());
                bar.suspend(|| say!("epoch {epoch}/{epochs}  {line}  {seconds:.1} s"));
                begun = Instant::now();
            }
            if stop {
                bar.finish_and_clear();
                say!("stopped in epoch {}, after batch {batch}; the same command continues from there", epoch + 1);
                std::process::exit(terminal::stop_status());
            }
        }
        bar.finish_and_clear();
        Ok(trainer)
    }

    /// Writes the picture of the filters, if there is one, reports the model, and removes the checkpoint.
    pub fn finish(&self, picture: Option<&Image>) -> Result<()> {
        if let Some(picture) = picture {
            save_png(&self.picture, picture)?;
        }
        let _ = std::fs::remove_file(&self.checkpoint);
        let and = picture.map_or(String::new(), |_| format!(" and {}", self.picture.display()));
        say!("wrote {}{and}", self.model.display());
        Ok(())
    }
}
