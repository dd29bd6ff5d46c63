//! Training glimpses: a retina's glimpses of many pictures, row after row (section 2.1).
//!
//! A *training image* is a canvas of drawn digits, or a photograph, with fixations. Image i depends on the seed and i alone, so threads
//! make images in parallel and the rows are the same for any number of threads.

pub mod classifier;
pub mod filters;
mod images;
pub mod pictures;
pub mod recognition;
pub mod sequences;
pub mod variation;

use crate::{Digits, Split};
use foveate_base::rng::{Purpose, Streams};
use foveate_base::{Error, Result, files, memory};
use foveate_core::geometry::{Extent, Fixation};
use foveate_core::identity::encoder::{Encoder, Raw};
use foveate_core::identity::pyramid::{Pyramid, Region};
use foveate_core::identity::retina::{Foveal, Retina};
use foveate_core::scene::Image;
use foveate_learn::rbm::Visible;
use foveate_video::decode_image;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::borrow::Cow;
use std::path::Path;

/// Glimpses taken of one training image.
const GLIMPSES: usize = 32;

/// The data sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Set {
    /// Canvases of MNIST digits, clean and noisy: for the paper's first experiments.
    Digits,
    /// Photographs, at any place and scale, with small rotations: for everything else.
    Natural,
}

/// A source of glimpses.
#[derive(Clone, Debug)]
pub struct Source {
    pictures: Pictures,
    sha256: String,
}

#[derive(Clone, Debug)]
enum Pictures {
    Digits(Digits),
    Photographs(Vec<Image>),
}

/// A picture with its fixations.
struct TrainingImage<'a> {
    image: Cow<'a, Image>,
    extent: Extent,
    looks: Vec<Fixation>,
}

impl Source {
    /// Reads MNIST's training digits from `dir` or `dir/mnist`, or all pictures of `dir/natural` or `dir`.
    pub fn load(set: Set, dir: &Path) -> Result<Self> {
        match set {
            Set::Digits => {
                let digits = Digits::load(dir, Split::Train)?;
                let sha256 = hex(Sha256::new_with_prefix(&digits.images).chain_update(&digits.labels));
                Ok(Self { pictures: Pictures::Digits(digits), sha256 })
            }
            Set::Natural => {
                let inner = dir.join("natural");
                let (images, sha256) = photographs(if inner.is_dir() { &inner } else { dir })?;
                Ok(Self { pictures: Pictures::Photographs(images), sha256 })
            }
        }
    }
    /// Uses loaded digits.
    pub fn of_digits(digits: Digits) -> Self {
        let sha256 = hex(Sha256::new_with_prefix(&digits.images).chain_update(&digits.labels));
        Self { pictures: Pictures::Digits(digits), sha256 }
    }
    /// Returns the SHA-256 of the input: the digits' pixels and labels, or the photographs' files in the order of their names.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }
    /// Returns a description such as "60000 digits".
    pub fn describe(&self) -> String {
        match &self.pictures {
            Pictures::Digits(digits) => format!("{} digits", digits.len()),
            Pictures::Photographs(images) => format!("{} photographs", images.len()),
        }
    }
    /// Holds out every tenth digit or photograph: returns (training, held out). Fails with fewer than ten.
    pub fn split(&self) -> Result<(Self, Self)> {
        let part = |held: bool| {
            let takes = |i: &usize| (i % 10 == 9) == held;
            let pictures = match &self.pictures {
                Pictures::Digits(digits) => {
                    let indices: Vec<usize> = (0..digits.len()).filter(takes).collect();
                    Pictures::Digits(Digits {
                        images: indices.iter().flat_map(|&i| digits.digit(i)).copied().collect(),
                        labels: indices.iter().map(|&i| digits.labels[i]).collect(),
                    })
                }
                Pictures::Photographs(images) => {
                    Pictures::Photographs((0..images.len()).filter(takes).map(|i| images[i].clone()).collect())
                }
            };
            Self { pictures, sha256: self.sha256.clone() }
        };
        let (learn, held) = (part(false), part(true));
        if held.is_empty() {
            return Err(Error::Invalid(format!(
                "training holds every tenth picture out and needs at least 10, got {}",
                self.describe()
            )));
        }
        Ok((learn, held))
    }
    fn is_empty(&self) -> bool {
        match &self.pictures {
            Pictures::Digits(digits) => digits.is_empty(),
            Pictures::Photographs(images) => images.is_empty(),
        }
    }
    /// Returns `n` glimpses, n × `retina.glimpse_len()` values: 0 to 1 for binary units, each channel standardised for Gaussian ones (as in
    /// the encoder). Deterministic in `seed`, for any number of threads. Fails if the glimpses need more memory than allowed.
    /// Panics without a picture.
    pub fn glimpses(&self, retina: &Foveal, n: usize, visible: Visible, seed: u64) -> Result<Vec<f32>> {
        assert!(!self.is_empty(), "glimpses need a picture");
        let bytes = (n as u64).saturating_mul((size_of::<f32>() * retina.glimpse_len()) as u64);
        memory::check(format_args!("{n} glimpses of {} values", retina.glimpse_len()), bytes)?;
        let (width, streams) = (retina.glimpse_len(), Streams::new(seed, 0).at(0, Purpose::Scene));
        let channels: Vec<usize> = retina.cells().iter().map(|c| c.channel).collect();
        let standard = Raw::new(&channels, true);
        let mut rows = vec![0.0; n * width];
        rows.par_chunks_mut(GLIMPSES * width).enumerate().for_each_init(Pyramid::default, |pyramid, (i, rows)| {
            let mut rng = streams.rng(i as u64);
            let training = match &self.pictures {
                Pictures::Digits(digits) => images::digits(digits, rows.len() / width, &mut rng),
                Pictures::Photographs(images) => {
                    images::photograph(images, retina.config().side, rows.len() / width, &mut rng)
                }
            };
            let Extent { half_w, half_h } = training.extent;
            let image = &*training.image;
            let whole = Region { x: 0, y: 0, width: image.width(), height: image.height() };
            pyramid.build(image, whole, retina.footprints(), (half_w, half_h));
            for (row, &look) in rows.chunks_exact_mut(width).zip(&training.looks) {
                retina.look(pyramid, look, row);
                match visible {
                    // Rounding may move a mean slightly outside.
                    Visible::Bernoulli => row.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0)),
                    Visible::Gaussian => standard.condition(row),
                }
            }
        });
        Ok(rows)
    }
}

/// Returns the SHA-256 of rows, which identifies the data of a checkpoint.
pub fn sha256_of(rows: &[f32]) -> String {
    let mut sha = Sha256::new();
    rows.chunks(4096).for_each(|part| sha.update(part.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>()));
    hex(sha)
}

fn hex(sha: Sha256) -> String {
    sha.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

/// Returns all pictures of a folder in the order of their names, and the SHA-256 of their joined bytes.
fn photographs(dir: &Path) -> Result<(Vec<Image>, String)> {
    let entries = std::fs::read_dir(dir).map_err(Error::io(dir, "cannot read the folder"))?;
    let mut paths = Vec::new();
    for entry in entries {
        let path = entry.map_err(Error::io(dir, "cannot read the folder"))?.path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        if ["jpg", "jpeg", "png"].contains(&&*extension) {
            paths.push(path);
        }
    }
    if paths.is_empty() {
        return Err(Error::malformed(dir, "no photographs here: give a folder of JPEG or PNG files with --data"));
    }
    paths.sort();
    let (mut images, mut sha) = (Vec::new(), Sha256::new());
    // Reads as many files at a time as are decoded in parallel.
    for paths in paths.chunks(rayon::current_num_threads()) {
        let files = paths.iter().map(|path| files::read(path, files::PICTURE)).collect::<Result<Vec<_>>>()?;
        files.iter().for_each(|bytes| sha.update(bytes));
        let decode = |(path, bytes): (&std::path::PathBuf, &Vec<u8>)| {
            let image = decode_image(bytes).map_err(|problem| Error::malformed(path, problem))?;
            Ok(image.with_planes(3))
        };
        images.extend(paths.par_iter().zip(&files).map(decode).collect::<Result<Vec<_>>>()?);
    }
    Ok((images, hex(sha)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::identity::encoder;
    use foveate_core::identity::retina::FovealConfig;

    /// Returns ten digits that are filled squares.
    fn squares(n: usize) -> Digits {
        let pixel = |i: usize| if (6..22).contains(&(i / 28)) && (6..22).contains(&(i % 28)) { 255 } else { 0 };
        Digits {
            images: (0..n * 784).map(|i| pixel(i % 784)).collect(),
            labels: (0..n).map(|i| (i % 10) as u8).collect(),
        }
    }

    #[test]
    fn glimpses_of_digits_do_not_depend_on_threads_and_see_ink() {
        let source = Source::of_digits(squares(20));
        let retina = Foveal::new(FovealConfig::authors()).expect("the authors' geometry");
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| source.glimpses(&retina, 500, Visible::Bernoulli, 3)).expect("room")
        };
        let rows = with(1);
        assert_eq!(rows, with(3));
        assert_eq!(
            rows[..100 * 132],
            source.glimpses(&retina, 100, Visible::Bernoulli, 3).expect("room"),
            "more rows, the same first ones"
        );
        assert!(rows.iter().all(|x| (0.0..=1.0).contains(x)));
        let said = source.glimpses(&retina, usize::MAX, Visible::Bernoulli, 3).expect_err("too many").to_string();
        assert!(said.contains("glimpses of 132 values") && said.contains("--max-memory"), "{said}");
        let mean = rows.iter().sum::<f32>() / rows.len() as f32;
        assert!((0.1..0.6).contains(&mean), "{mean}");
    }

    /// Returns a picture of 4 x 2 pixels from a camera held upright: an orientation tag rotates it.
    pub(super) fn lying() -> Vec<u8> {
        let jpeg = foveate_video::encode_jpeg(&Image::grey(4, 2, 90), 90);
        let mark = b"\xff\xe1\0\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
        [&jpeg[..2], mark, &jpeg[2..]].concat()
    }

    #[test]
    fn photographs_are_read_as_a_tracker_reads_them() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let write = |name: &str, bytes: &[u8]| std::fs::write(dir.path().join(name), bytes).expect("written");
        for i in 0..9 {
            write(&format!("{i}.jpg"), &lying());
        }
        let (images, sha256) = photographs(dir.path()).expect("nine pictures");
        let size = |image: &Image| (image.width(), image.height(), image.planes());
        assert!(images.len() == 9 && images.iter().all(|image| size(image) == (2, 4, 3)), "{images:?}");
        assert_eq!(sha256, hex(Sha256::new_with_prefix(lying().repeat(9))));
        write("9.jpg", &lying()[..lying().len() - 2]);
        let said = photographs(dir.path()).expect_err("cut off").to_string();
        assert!(said.contains("9.jpg") && said.contains("cut off"), "{said}");
    }

    #[test]
    fn photographs_are_standardised() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        for i in 0..10u32 {
            let picture = image::RgbImage::from_fn(90, 60, |x, y| {
                image::Rgb([((x * y * (i + 3)) % 251) as u8, (x % 256) as u8, 90])
            });
            picture.save(dir.path().join(format!("{i}.png"))).expect("a writable folder");
        }
        let source = Source::load(Set::Natural, dir.path()).expect("ten pictures");
        let (learn, held) = source.split().expect("ten pictures");
        assert_eq!((learn.describe(), held.describe()), ("9 photographs".into(), "1 photographs".into()));
        let config = FovealConfig { colour: vec![[16, 4]], ..FovealConfig::authors() };
        let retina = Foveal::new(config).expect("whole cells");
        let rows = learn.glimpses(&retina, 40, Visible::Gaussian, 1).expect("room");
        for row in rows.chunks_exact(retina.glimpse_len()) {
            for part in [&row[..132], &row[132..148], &row[148..]] {
                let mean = part.iter().sum::<f32>() / part.len() as f32;
                let variance = part.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / part.len() as f32;
                assert!(mean.abs() < 1e-4 && variance < 1.01, "{mean} {variance}");
            }
        }
        let mut flat = [0.5; 8];
        encoder::standardise(&mut flat);
        assert_eq!(flat, [0.0; 8]);
        let none = tempfile::tempdir().expect("a temporary folder");
        assert!(Source::load(Set::Natural, none.path()).expect_err("empty").to_string().contains("no photographs"));
    }
}
