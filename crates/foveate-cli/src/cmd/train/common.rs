//! What all trainings share: where glimpses come from, where files go, and going on after an interruption.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use foveate::identity::retina::{Foveal, FovealConfig, Retina};
use foveate::lab::training;
use foveate::lab::training::{Set, Source};
use foveate::learn::rbm::{Metadata, Visible};
use foveate::rows::Rows;
use foveate::scene::Image;
use foveate::video::save_png;
use foveate::{Error, Result};

use crate::cmd::results::writable;
use crate::terminal;

/// A checkpoint is written after every epoch, and within one when this has passed.
const BETWEEN_CHECKPOINTS: Duration = Duration::from_secs(10);

/// Rows that are monitored after every epoch, of those learned from and of those held out.
const MONITORED: usize = 500;

/// Glimpses of natural photographs, and what is made of them.
#[derive(clap::Args)]
pub struct Natural {
    /// Folder of photographs, JPEG or PNG (or with a folder `natural` of them).
    #[arg(long, value_name = "DIR")]
    pub data: PathBuf,
    /// The model file to write.
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
    /// Glimpses to learn from.
    #[arg(long, default_value_t = 100_000)]
    pub glimpses: usize,
    /// Glimpses of pictures never learned from, to monitor with.
    #[arg(long, default_value_t = 2000)]
    pub held_out: usize,
    /// Seed of all random numbers: the same seed gives the same model.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Picture of the filters: the model's name with .png, unless given.
    #[arg(long, value_name = "FILE")]
    pub filters: Option<PathBuf>,
    /// Begin anew, even if there is a checkpoint.
    #[arg(long)]
    pub restart: bool,
}

/// Glimpses to learn from and to monitor with, n × the retina's values.
pub struct Glimpses {
    /// The retina that looks.
    pub retina: Foveal,
    /// Those to learn from.
    pub learn: Vec<f32>,
    /// Those of pictures never learned from.
    pub held: Vec<f32>,
    /// Names `learn`.
    pub sha256: String,
    pictures_sha256: String,
    pictures: String,
}

impl Natural {
    /// Where its files go.
    pub fn files(&self) -> Result<Files<'_>> {
        Files::of(&self.out, self.filters.as_deref(), self.restart)
    }
    /// Reads the photographs and looks at them; says what it found.
    pub fn glimpses(&self) -> Result<Glimpses> {
        let retina = retina(self.config.as_deref(), self.side, &self.rings, &self.colour)?;
        Glimpses::look(retina, (Set::Natural, &self.data), [self.glimpses, self.held_out], Visible::Gaussian, self.seed)
    }
    /// The part of the command that says which glimpses, folders left open.
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

/// The retina of a configuration, or else of these windows. Fails where the configuration has none, or windows do not fit.
pub(crate) fn retina(config: Option<&Path>, side: f64, rings: &[[usize; 2]], colour: &[[usize; 2]]) -> Result<Foveal> {
    Foveal::new(match config {
        Some(path) => training::retina_of_config(path)?,
        None => FovealConfig { side, rings: rings.to_vec(), colour: colour.to_vec() },
    })
}

/// Windows as `--rings` takes them.
pub(crate) fn rings(rings: &[[usize; 2]]) -> String {
    rings.iter().map(|r| format!("{}/{}", r[0], r[1])).collect::<Vec<_>>().join(",")
}

/// ` --colour WINDOWS`, where a retina has such.
pub(crate) fn colour(retina: &FovealConfig) -> String {
    if retina.colour.is_empty() { String::new() } else { format!(" --colour {}", rings(&retina.colour)) }
}

impl Glimpses {
    /// Reads the pictures of a set in a folder, and looks `counts` times at those to learn from and at the others; says what
    /// it found. Fails where a count is 0, before it reads anything.
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
    /// What a model file says of its making.
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
    /// The glimpses to learn from.
    pub fn rows(&self) -> Rows<'_> {
        Rows::new(&self.learn, self.retina.glimpse_len())
    }
    /// The others.
    pub fn held(&self) -> Rows<'_> {
        Rows::new(&self.held, self.retina.glimpse_len())
    }
    /// Those that are monitored after every epoch, of those learned from and of those held out.
    pub fn monitored(&self) -> [Rows<'_>; 2] {
        let some = |rows: Rows<'_>| rows.data().len().min(MONITORED * rows.width());
        [&self.learn, &self.held].map(|all| {
            let rows = Rows::new(all, self.retina.glimpse_len());
            Rows::new(&all[..some(rows)], rows.width())
        })
    }
}

/// Where the files of a training go.
pub struct Files<'a> {
    /// The model.
    pub model: &'a Path,
    /// Progress, until the model is there.
    pub checkpoint: PathBuf,
    picture: PathBuf,
    restart: bool,
}

impl<'a> Files<'a> {
    /// The model's file, the picture of its filters (beside it unless given), and whether to begin anew though there is a
    /// checkpoint. Fails where a folder is not there or in the place of a file: before the work, not after it.
    pub fn of(model: &'a Path, picture: Option<&Path>, restart: bool) -> Result<Self> {
        let picture = picture.map_or_else(|| model.with_extension("png"), Path::to_path_buf);
        [model, &picture].into_iter().try_for_each(writable)?;
        let mut checkpoint = model.to_path_buf().into_os_string();
        checkpoint.push(".checkpoint");
        Ok(Self { model, checkpoint: checkpoint.into(), picture, restart })
    }

    /// A training that goes on from its checkpoint where there is one, unless it is to begin anew; else a new one. The
    /// trainer is asked for its `progress`, to say where it goes on.
    pub fn begin<T>(
        &self,
        progress: fn(&T) -> (usize, usize),
        resume: impl FnOnce(&Path) -> Result<T>,
        new: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        if self.restart || !self.checkpoint.exists() {
            return new();
        }
        let trainer = resume(&self.checkpoint).map_err(|e| Error::Invalid(format!("{e}; --restart begins anew")))?;
        let (epoch, batch) = progress(&trainer);
        say!("resuming {}: epoch {}, batch {batch}", self.checkpoint.display(), epoch + 1);
        Ok(trainer)
    }

    /// The model is there: keeps the picture of its filters, where there is one, and says so. There is nothing to go on
    /// from any more.
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

/// Trains to the end, or until Ctrl-C: then a checkpoint is written, and the program ends. `whole` has the epochs to do and
/// the batches of one, `progress` the epochs done and the batches done of the next. `step` does one mini-batch, `save` writes a
/// checkpoint, and `line` says how well the epoch that just ended went.
pub fn train<T>(
    (epochs, batches): (usize, usize),
    trainer: &mut T,
    progress: fn(&T) -> (usize, usize),
    mut step: impl FnMut(&mut T) -> Result<()>,
    save: impl Fn(&T) -> Result<()>,
    mut line: impl FnMut(&mut T) -> Result<String>,
) -> Result<()> {
    terminal::catch_interrupts();
    let bar = terminal::progress(Some(epochs * batches), "training");
    let (mut begun, mut saved) = (Instant::now(), Instant::now());
    while progress(trainer).0 < epochs {
        step(trainer)?;
        let (epoch, batch) = progress(trainer);
        bar.set_position((epoch * batches + batch) as u64);
        let stop = terminal::stopping();
        if batch == 0 || stop || saved.elapsed() > BETWEEN_CHECKPOINTS {
            save(trainer)?;
            saved = Instant::now();
        }
        if batch == 0 {
            let (line, seconds) = (line(trainer)?, begun.elapsed().as_secs_f64());
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
    Ok(())
}
