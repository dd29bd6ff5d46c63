//! Shared parts of the training commands: glimpses, files, and resuming after an interruption.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use foveate::identity::retina::{Foveal, FovealConfig, Retina};
use foveate::lab::training;
use foveate::lab::training::{Set, Source};
use foveate::learn::rbm::{Metadata, Visible};
use foveate::learn::training::Training;
use foveate::rows::Rows;
use foveate::scene::Image;
use foveate::video::save_png;
use foveate::{Error, Result};

use crate::cmd::results::writable;
use crate::terminal;

/// Interval between checkpoints within an epoch; a checkpoint is also written after every epoch.
const BETWEEN_CHECKPOINTS: Duration = Duration::from_secs(10);

/// Number of training rows and of held-out rows that are monitored after every epoch.
const MONITORED: usize = 500;

/// Arguments for a model of glimpses of natural photographs.
#[derive(Debug, clap::Args)]
pub struct Natural {
    /// Folder of photographs, JPEG or PNG (or with a folder `natural` of them).
    #[arg(long, value_name = "DIR")]
    pub data: PathBuf,
    /// Output model file.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Take the retina from the table `retina` of this configuration.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["side", "rings", "colour"])]
    pub config: Option<PathBuf>,
    /// Template pixels along a side of the target's box.
    #[arg(long, default_value_t = 28.0)]
    pub side: f64,
    /// Windows of the retina from the inside out, WINDOW/CELL in template pixels.
    #[arg(long, value_delimiter = ',', default_value = "8/1,16/2,32/4", value_parser = super::ring)]
    pub rings: Vec<[usize; 2]>,
    /// Windows that read the colour opponent channels, WINDOW/CELL.
    #[arg(long, value_delimiter = ',', value_parser = super::ring)]
    pub colour: Vec<[usize; 2]>,
    /// Number of training glimpses.
    #[arg(long, default_value_t = 100_000)]
    pub glimpses: usize,
    /// Number of glimpses of held-out pictures, for monitoring.
    #[arg(long, default_value_t = 2000)]
    pub held_out: usize,
    /// Random seed; the same seed gives the same model.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Output picture of the filters; default: the model's name with .png.
    #[arg(long, value_name = "FILE")]
    pub filters: Option<PathBuf>,
    /// Start from the beginning, even if there is a checkpoint.
    #[arg(long)]
    pub restart: bool,
}

/// Training and monitoring glimpses, n × the number of retina values.
#[derive(Debug)]
pub struct Glimpses {
    /// The retina of the glimpses.
    pub retina: Foveal,
    /// Training glimpses.
    pub learn: Vec<f32>,
    /// Glimpses of held-out pictures.
    pub held: Vec<f32>,
    /// Digest that identifies `learn`.
    pub sha256: String,
    pictures_sha256: String,
    pictures: String,
}

impl Natural {
    /// Returns the output files of the training.
    pub fn files(&self) -> Result<Files<'_>> {
        Files::of(&self.out, self.filters.as_deref(), self.restart)
    }
    /// Reads the photographs, takes the glimpses, and prints a summary.
    pub fn glimpses(&self) -> Result<Glimpses> {
        let retina = retina(self.config.as_deref(), self.side, &self.rings, &self.colour)?;
        Glimpses::look(retina, (Set::Natural, &self.data), [self.glimpses, self.held_out], Visible::Gaussian, self.seed)
    }
    /// Returns the part of the command that specifies the glimpses, with folders left open.
    pub fn command(&self, kind: &str, retina: &FovealConfig) -> String {
        format!(
            "foveate train {kind} --data DIR --side {} --rings {} --glimpses {} --seed {}{}",
            retina.side,
            rings(&retina.rings),
            self.glimpses,
            self.seed,
            colour(retina)
        )
    }
}

/// Returns the retina of a configuration, or one with these windows. Fails if the configuration has no retina, or the windows do not fit.
pub(crate) fn retina(config: Option<&Path>, side: f64, rings: &[[usize; 2]], colour: &[[usize; 2]]) -> Result<Foveal> {
    Foveal::new(match config {
        Some(path) => training::retina_of_config(path)?,
        None => FovealConfig { side, rings: rings.to_vec(), colour: colour.to_vec() },
    })
}

/// Formats windows as `--rings` takes them.
pub(crate) fn rings(rings: &[[usize; 2]]) -> String {
    rings.iter().map(|r| format!("{}/{}", r[0], r[1])).collect::<Vec<_>>().join(",")
}

/// Returns ` --colour WINDOWS` if the retina has such windows.
pub(crate) fn colour(retina: &FovealConfig) -> String {
    if retina.colour.is_empty() { String::new() } else { format!(" --colour {}", rings(&retina.colour)) }
}

impl Glimpses {
    /// Reads the pictures of a set in a folder, takes `counts` training and held-out glimpses, and prints a summary. Fails before reading
    /// if a count is 0.
    pub fn look(
        retina: Foveal,
        (set, data): (Set, &Path),
        counts: [usize; 2],
        visible: Visible,
        seed: u64,
    ) -> Result<Self> {
        if counts.contains(&0) {
            return Err(Error::Config("--glimpses and --held-out must be at least 1".into()));
        }
        let source = Source::load(set, data)?;
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
    /// Creates the paths of the model and of the picture of its filters (beside the model by default); `restart` ignores a checkpoint.
    /// Fails if a folder is missing or a folder has the name of a file, so that the error comes before the work.
    pub fn of(model: &'a Path, picture: Option<&Path>, restart: bool) -> Result<Self> {
        let picture = picture.map_or_else(|| model.with_extension("png"), Path::to_path_buf);
        [model, &picture].into_iter().try_for_each(writable)?;
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
                say!("stopped in epoch {}, after batch {batch}; the same command goes on from there", epoch + 1);
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
