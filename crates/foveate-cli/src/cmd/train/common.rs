//! What all trainings share: where glimpses come from, and going on after an interruption.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use foveate::identity::retina::{Foveal, FovealConfig, Retina};
use foveate::rbm::{Metadata, Visible};
use foveate::rows::Rows;
use foveate::training::{self, Set, Source};
use foveate::{Error, Result};
use indicatif::{ProgressBar, ProgressStyle};

/// A checkpoint is written after every epoch, and within one when this has passed.
const BETWEEN_CHECKPOINTS: Duration = Duration::from_secs(10);

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
    /// Threads: all processors, unless given.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Picture of the filters: the model's name with .png, unless given.
    #[arg(long, value_name = "FILE")]
    pub filters: Option<PathBuf>,
    /// Begin anew, even if there is a checkpoint.
    #[arg(long)]
    pub restart: bool,
}

/// Glimpses to learn from and to monitor with, n × the retina's values.
pub struct Glimpses {
    pub retina: Foveal,
    pub learn: Vec<f32>,
    pub held: Vec<f32>,
    /// Names `learn`.
    pub sha256: String,
    pictures_sha256: String,
    pictures: String,
}

impl Natural {
    /// Where the picture of the filters goes.
    pub fn filters_path(&self) -> PathBuf {
        self.filters.clone().unwrap_or_else(|| self.out.with_extension("png"))
    }
    /// Where the checkpoint is.
    pub fn checkpoint(&self) -> PathBuf {
        let mut name = self.out.clone().into_os_string();
        name.push(".checkpoint");
        PathBuf::from(name)
    }
    fn retina(&self) -> Result<Foveal> {
        Foveal::new(match &self.config {
            Some(path) => training::retina_of_config(path)?,
            None => FovealConfig { side: self.side, rings: self.rings.clone(), colour: self.colour.clone() },
        })
    }
    /// Reads the photographs and looks at them; says what it found.
    pub fn glimpses(&self) -> Result<Glimpses> {
        let retina = self.retina()?;
        if self.glimpses == 0 || self.held_out == 0 {
            return Err(Error::Config("--glimpses and --held-out must be at least 1".into()));
        }
        let source = Source::load(Set::Natural, &self.data)?;
        let (learn, held) = source.split()?;
        let width = retina.glimpse_len();
        println!("{}: {} glimpses of {width} values, {} held out", source.describe(), self.glimpses, self.held_out);
        let rows = learn.glimpses(&retina, self.glimpses, Visible::Gaussian, self.seed);
        Ok(Glimpses {
            held: held.glimpses(&retina, self.held_out, Visible::Gaussian, !self.seed),
            sha256: training::sha256_of(&rows),
            learn: rows,
            retina,
            pictures_sha256: source.sha256().into(),
            pictures: learn.describe(),
        })
    }
    /// The part of the command that says which glimpses, folders left open.
    pub fn command(&self, kind: &str, retina: &FovealConfig) -> String {
        let rings =
            |rings: &[[usize; 2]]| rings.iter().map(|r| format!("{}/{}", r[0], r[1])).collect::<Vec<_>>().join(",");
        let mut text = format!(
            "foveate train {kind} --data DIR --side {} --rings {} --glimpses {} --seed {}",
            retina.side,
            rings(&retina.rings),
            self.glimpses,
            self.seed
        );
        if !retina.colour.is_empty() {
            text += &format!(" --colour {}", rings(&retina.colour));
        }
        text
    }
    /// What a model file says of its making.
    pub fn metadata(&self, glimpses: &Glimpses, command: String, epochs: usize) -> Metadata {
        Metadata {
            retina: serde_json::to_string(glimpses.retina.config()).expect("a retina's geometry becomes JSON"),
            command,
            data: format!("{} glimpses of {}", self.glimpses, glimpses.pictures),
            data_sha256: glimpses.pictures_sha256.clone(),
            seed: self.seed,
            epochs,
        }
    }
}

impl Glimpses {
    /// The glimpses to learn from.
    pub fn rows(&self) -> Rows<'_> {
        Rows::new(&self.learn, self.retina.glimpse_len())
    }
    /// The others.
    pub fn held(&self) -> Rows<'_> {
        Rows::new(&self.held, self.retina.glimpse_len())
    }
}

/// Threads to work with, and folders that are there: asked before the work, not after it.
pub fn pool(threads: Option<usize>, files: &[&Path]) -> Result<rayon::ThreadPool> {
    for path in files {
        if path.parent().is_some_and(|dir| !dir.as_os_str().is_empty() && !dir.is_dir()) {
            return Err(Error::Config(format!("{}: its folder does not exist", path.display())));
        }
    }
    let threads = rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build();
    threads.map_err(|e| Error::Config(format!("--threads: {e}")))
}

/// A training that can be interrupted.
pub trait Training {
    /// One mini-batch.
    fn step(&mut self);
    /// Epochs done, and batches done of the next.
    fn progress(&self) -> (usize, usize);
    /// Epochs to do, and batches an epoch has.
    fn whole(&self) -> (usize, usize);
    /// Writes a checkpoint.
    fn save(&self) -> Result<()>;
    /// How well it goes.
    fn line(&self) -> String;
}

/// Trains to the end, or until Ctrl-C: then a checkpoint is written, and the program ends.
pub fn train(training: &mut impl Training) -> Result<()> {
    static STOP: AtomicBool = AtomicBool::new(false);
    // A second Ctrl-C does not wait for the batch.
    let handler = || {
        if STOP.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
    };
    ctrlc::set_handler(handler).map_err(|e| Error::Invalid(format!("cannot listen for Ctrl-C: {e}")))?;

    let (epochs, batches) = training.whole();
    let bar = ProgressBar::new((epochs * batches) as u64);
    let style =
        ProgressStyle::with_template("{wide_bar} {percent}% of the batches, {eta} left").expect("a fixed template");
    bar.set_style(style);
    let (mut begun, mut saved) = (Instant::now(), Instant::now());
    while training.progress().0 < epochs {
        training.step();
        let (epoch, batch) = training.progress();
        bar.set_position((epoch * batches + batch) as u64);
        let stop = STOP.load(Ordering::SeqCst);
        if batch == 0 || stop || saved.elapsed() > BETWEEN_CHECKPOINTS {
            training.save()?;
            saved = Instant::now();
        }
        if batch == 0 {
            let (line, seconds) = (training.line(), begun.elapsed().as_secs_f64());
            bar.suspend(|| println!("epoch {epoch}/{epochs}  {line}  {seconds:.1} s"));
            begun = Instant::now();
        }
        if stop {
            bar.finish_and_clear();
            println!("stopped in epoch {}, after batch {batch}; the same command goes on from there", epoch + 1);
            std::process::exit(130);
        }
    }
    bar.finish_and_clear();
    Ok(())
}
