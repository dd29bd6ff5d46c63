//! One folder of pictures per class, and a retina's glimpses of them: the data of a user's own recogniser.

use foveate_base::rng::{Purpose, Rng, Streams};
use foveate_base::rows::{Rows, RowsMut};
use foveate_base::{Error, Result, files};
use foveate_core::geometry::{Extent, Gaze, State};
use foveate_core::identity::encoder::Encoder;
use foveate_core::identity::pyramid::{Pyramid, Region};
use foveate_core::identity::retina::{Foveal, Retina};
use foveate_core::scene::Image;
use image::{DynamicImage, GrayImage, RgbImage};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum longer side of a picture in memory, pixels; larger ones are reduced.
const SIDE: u32 = 128;
/// Maximum number of classes.
const MOST: usize = 256;

/// Pictures with a class each, grey or in colour, sorted by class and then by file name.
#[derive(Clone, Debug)]
pub struct Pictures {
    images: Vec<Image>,
    labels: Vec<u8>,
    names: Vec<String>,
    sha256: String,
}

impl Pictures {
    /// Reads every picture of every folder in `dir`; a folder's name is its class. Skips folders and files with names that begin
    /// with a dot. Colours become grey unless `colours` is true, for a retina that reads colour.
    ///
    /// Fails if there are not two to 256 such folders, one has fewer than two pictures, or a picture cannot be read.
    pub fn load(dir: &Path, colours: bool) -> Result<Self> {
        let folders: Vec<PathBuf> = sorted(dir)?.into_iter().filter(|p| p.is_dir()).collect();
        if !(2..=MOST).contains(&folders.len()) {
            return Err(Error::malformed(
                dir,
                format!(
                    "expected two to {MOST} folders of pictures here, one for each class, such as {}/cat and {}/dog; found {}",
                    dir.display(),
                    dir.display(),
                    folders.len()
                ),
            ));
        }
        let (mut files, mut names) = (vec![], vec![]);
        for (label, folder) in folders.iter().enumerate() {
            let is_picture = |p: &PathBuf| {
                let extension = p.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
                p.is_file() && ["jpg", "jpeg", "png"].contains(&&*extension)
            };
            let own: Vec<PathBuf> = sorted(folder)?.into_iter().filter(is_picture).collect();
            if own.len() < 2 {
                let problem = format!(
                    "a class needs two pictures at least, JPEG or PNG, one to learn from and one to be held out; found {}",
                    own.len()
                );
                return Err(Error::malformed(folder, problem));
            }
            names.push(folder.file_name().unwrap_or_default().to_string_lossy().into_owned());
            files.extend(own.into_iter().map(|path| (path, label as u8)));
        }
        let read = |(path, _): &(PathBuf, u8)| {
            let bytes = files::read(path, files::PICTURE)?;
            let sha: [u8; 32] = Sha256::digest(&bytes).into();
            Ok((small(&bytes, colours).map_err(|problem| Error::malformed(path, problem))?, sha))
        };
        let read: Vec<(Image, [u8; 32])> = files.par_iter().map(read).collect::<Result<_>>()?;
        let mut sha = Sha256::new_with_prefix(names.join("\n"));
        read.iter().zip(&files).for_each(|((_, own), (_, label))| sha.update([&own[..], &[*label]].concat()));
        let (images, labels) = (read.into_iter().map(|r| r.0).collect(), files.iter().map(|f| f.1).collect());
        Ok(Self { images, labels, names, sha256: super::hex(sha) })
    }
    /// Returns the number of pictures.
    pub fn len(&self) -> usize {
        self.images.len()
    }
    /// Returns whether there are no pictures.
    pub fn is_empty(&self) -> bool {
        self.images.is_empty()
    }
    /// Returns the class of each picture.
    pub fn labels(&self) -> &[u8] {
        &self.labels
    }
    /// Returns the names of the classes.
    pub fn names(&self) -> &[String] {
        &self.names
    }
    /// Returns the SHA-256 of names, files and classes.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }
    /// Returns (training, held out): the last of five files of each class by name, at least one, is held out. Consecutive files cut from
    /// one video are nearly identical, so a random choice would make the test too easy.
    pub fn split(&self) -> (Self, Self) {
        let counts: Vec<usize> = (0..self.names.len()).map(|c| self.of_class(c)).collect();
        let part = |held: bool| {
            let mut seen = vec![0; counts.len()];
            let mut to = Self { images: vec![], labels: vec![], ..self.clone() };
            for (image, &label) in self.images.iter().zip(&self.labels) {
                let (n, i) = (counts[usize::from(label)], &mut seen[usize::from(label)]);
                *i += 1;
                if (*i > n - (n / 5).max(1)) == held {
                    to.images.push(image.clone());
                    to.labels.push(label);
                }
            }
            to
        };
        (part(false), part(true))
    }
    /// Returns the number of pictures of a class.
    pub fn of_class(&self, class: usize) -> usize {
        self.labels.iter().filter(|l| usize::from(**l) == class).count()
    }
}

/// Returns the contents of a folder, by name.
fn sorted(dir: &Path) -> Result<Vec<PathBuf>> {
    let mut paths = vec![];
    for entry in std::fs::read_dir(dir).map_err(Error::io(dir, "cannot read the folder of pictures"))? {
        let entry = entry.map_err(Error::io(dir, "cannot read the folder of pictures"))?;
        if !entry.file_name().to_string_lossy().starts_with('.') {
            paths.push(entry.path());
        }
    }
    paths.sort();
    Ok(paths)
}

/// Decodes a picture, grey or in colour, at most [`SIDE`] pixels along a side.
fn small(bytes: &[u8], colours: bool) -> std::result::Result<Image, String> {
    let picture = foveate_video::decode_image(bytes)
        .map_err(|e| format!("not a picture that can be read ({e}); remove it or save it anew"))?;
    let (width, height) = (picture.width() as u32, picture.height() as u32);
    let picture = match picture.planes() {
        1 => GrayImage::from_raw(width, height, picture.bytes().to_vec()).map(DynamicImage::from),
        _ => RgbImage::from_raw(width, height, picture.to_rgb8()).map(DynamicImage::from),
    };
    let mut picture = picture.expect("as many bytes as pixels");
    if picture.width().max(picture.height()) > SIDE {
        picture = picture.resize(SIDE, SIDE, image::imageops::FilterType::Triangle);
    }
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let image = match colours {
        true => Image::from_rgb8(width, height, &picture.to_rgb8()),
        false => Image::new(width, height, 1, picture.to_luma8().into_raw()),
    };
    image.map_err(|e| e.to_string())
}

/// Random variation of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Variation {
    /// Maximum position error along an axis, in half boxes.
    pub jitter: f64,
    /// Maximum error of the logarithm of the size.
    pub log_scale: f64,
    /// Standard deviation of the angle, radians.
    pub angle: f64,
    /// Maximum change of the logarithm of contrast; the change of brightness is half of it.
    pub contrast: f64,
    /// Standard deviation of the noise of a value; white is 1.
    pub noise: f64,
}

impl Variation {
    /// Returns the variation of a tracker's box: a tenth of a box, a sixth of the size, slightly rotated, with other lighting.
    pub fn of_tracks() -> Self {
        Self { jitter: 0.15, log_scale: 0.15, angle: 0.08, contrast: 0.4, noise: 0.02 }
    }
}

/// Computes features of pictures: one glimpse at the centre of each, with the whole picture as its box.
pub struct FeatureExtractor {
    /// The retina.
    pub retina: Foveal,
    /// The first layer.
    pub encoder: Arc<dyn Encoder>,
    /// The variation of the pictures.
    pub variation: Variation,
    /// Seed of all random numbers.
    pub seed: u64,
}

foveate_base::opaque_debug!(FeatureExtractor);

impl FeatureExtractor {
    /// Returns the features of every picture with the variation of epoch `epoch`, a row each; clamped to 0 to 1, as in recognition.
    pub fn look(&self, pictures: &Pictures, epoch: u64) -> Vec<f32> {
        let ((n_v, n_h), streams) = (self.encoder.shape(), Streams::new(self.seed, 0).at(epoch, Purpose::Scene));
        let mut rows = vec![0.0; pictures.len() * n_h];
        rows.par_chunks_mut(n_h).zip(&pictures.images).enumerate().for_each_init(
            || (Pyramid::default(), vec![0.0; n_v]),
            |(pyramid, glimpse), (i, (row, image))| {
                self.glimpse(image, &mut streams.rng(i as u64), pyramid, glimpse);
                self.encoder.condition(glimpse);
                self.encoder.encode(Rows::new(glimpse, n_v), RowsMut::new(row, n_h));
                row.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
            },
        );
        rows
    }
    fn glimpse(&self, image: &Image, rng: &mut Rng, pyramid: &mut Pyramid, glimpse: &mut [f32]) {
        let v = self.variation;
        let half = (image.width() as f64 / 2.0, image.height() as f64 / 2.0);
        let extent = Extent { half_w: half.0, half_h: half.1 };
        let mut off = |most: f64| most * rng.random_range(-1.0..=1.0);
        let (x, y, log_scale) = (half.0 * off(v.jitter), half.1 * off(v.jitter), off(v.log_scale));
        let (gain, light) = (off(v.contrast).exp() as f32, (0.5 * off(v.contrast)) as f32);
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        let angle = v.angle * normal();
        let state = State { x: half.0 - 0.5 + x, y: half.1 - 0.5 + y, log_scale, angle, ..State::default() };
        let region = Region { x: 0, y: 0, width: image.width(), height: image.height() };
        let size = log_scale.exp();
        pyramid.build(image, region, self.retina.footprints(), (size * half.0, size * half.1));
        self.retina.look(pyramid, state.fixate(Gaze::CENTRE, extent), glimpse);
        for (x, cell) in glimpse.iter_mut().zip(self.retina.cells()) {
            // More light does not make anything redder.
            let light = if cell.channel == 0 { light } else { 0.0 };
            *x = (0.5 + gain * (*x - 0.5) + light + (v.noise * normal()) as f32).clamp(0.0, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::identity::encoder::Raw;
    use foveate_core::identity::retina::FovealConfig;

    fn extractor(variation: Variation) -> FeatureExtractor {
        let retina =
            Foveal::new(FovealConfig { side: 28.0, rings: vec![[28, 2]], colour: vec![] }).expect("whole cells");
        FeatureExtractor { encoder: Arc::new(Raw::new(&[0; 196], false)), retina, variation, seed: 1 }
    }

    /// Two classes of ten and five pictures: left half bright, top half bright; sizes differ.
    fn folder() -> tempfile::TempDir {
        let dir = tempfile::tempdir().expect("a temporary folder");
        for (name, n) in [("left", 10u32), ("top", 5)] {
            std::fs::create_dir(dir.path().join(name)).expect("a writable folder");
            for i in 0..n {
                let (w, h) = (40 + 30 * i, 50 + 7 * i);
                let on = |x, y| if name == "left" { x < w / 2 } else { y < h / 2 };
                let picture = image::RgbImage::from_fn(w, h, |x, y| image::Rgb([if on(x, y) { 255 } else { 0 }; 3]));
                let file = format!("{i:02}.{}", if i % 2 == 0 { "png" } else { "jpg" });
                picture.save(dir.path().join(name).join(file)).expect("a writable folder");
            }
        }
        std::fs::create_dir(dir.path().join(".hidden")).expect("a writable folder");
        std::fs::write(dir.path().join("notes.txt"), "no class").expect("a writable folder");
        dir
    }

    #[test]
    fn folders_are_classes_and_the_last_fifth_is_held_out() {
        let dir = folder();
        let all = Pictures::load(dir.path(), false).expect("two classes");
        assert_eq!((all.names(), all.len()), (&["left".to_string(), "top".to_string()][..], 15));
        let (learn, held) = all.split();
        assert_eq!((learn.len(), held.len()), (12, 3));
        assert_eq!(held.labels(), [0, 0, 1]);
        assert_eq!(Pictures::load(dir.path(), false).expect("two classes").sha256(), all.sha256());
    }

    #[test]
    fn a_picture_is_turned_as_its_camera_was_held() {
        for (colours, planes) in [(false, 1), (true, 3)] {
            let image = small(&crate::training::tests::lying(), colours).expect("a picture");
            assert_eq!((image.width(), image.height(), image.planes()), (2, 4, planes));
        }
    }

    #[test]
    fn what_is_seen_is_the_picture_whatever_its_size_and_the_threads() {
        let dir = folder();
        let all = Pictures::load(dir.path(), false).expect("two classes");
        let rows = extractor(Variation::default()).look(&all, 0);
        for (row, &label) in rows.chunks_exact(196).zip(all.labels()) {
            for (i, x) in row.iter().enumerate() {
                let along = if label == 0 { i % 14 } else { i / 14 };
                // The middle cells share an edge that smaller copies blur.
                if !(6..8).contains(&along) {
                    assert!((x - if along < 6 { 1.0 } else { 0.0 }).abs() < 0.1, "class {label}, cell {i}: {x}");
                }
            }
        }
        let varied = extractor(Variation::of_tracks());
        let with = |threads: usize, epoch: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| varied.look(&all, epoch))
        };
        let seen = with(1, 4);
        assert!(seen == with(3, 4) && seen != with(1, 5) && seen.iter().all(|x| (0.0..=1.0).contains(x)));
    }

    #[test]
    fn colours_are_read_where_they_are_asked_for_and_light_leaves_them() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        for (name, colour) in [("blue", [60, 60, 200]), ("red", [200, 60, 60])] {
            std::fs::create_dir(dir.path().join(name)).expect("a writable folder");
            for i in 0..2 {
                let picture = image::RgbImage::from_pixel(30, 40, image::Rgb(colour));
                picture.save(dir.path().join(name).join(format!("{i}.png"))).expect("a writable folder");
            }
        }
        let retina = Foveal::new(FovealConfig { side: 28.0, rings: vec![[28, 14]], colour: vec![[28, 14]] });
        let mut extractor = FeatureExtractor {
            encoder: Arc::new(Raw::new(&[0; 12], false)),
            retina: retina.expect("whole cells"),
            variation: Variation::default(),
            seed: 1,
        };
        // Four cells each of grey, red less green, blue less yellow.
        let rows = |extractor: &FeatureExtractor, colours| {
            extractor.look(&Pictures::load(dir.path(), colours).expect("two classes"), 0)
        };
        let (none, some) = (rows(&extractor, false), rows(&extractor, true));
        let near = |x: f32, to: f32| (x - to).abs() < 0.01;
        assert!(none.chunks_exact(12).all(|row| row[4..].iter().all(|x| near(*x, 0.5))), "{none:?}");
        let (blue, red) = (&some[..12], &some[24..36]);
        assert!(near(blue[4], 0.5) && blue[8] > 0.6, "{blue:?}");
        assert!(red[4] > 0.6 && red[8] < 0.5, "{red:?}");
        extractor.variation = Variation { contrast: 0.4, ..Variation::default() };
        for (i, row) in rows(&extractor, false).chunks_exact(12).enumerate() {
            assert!(!near(row[0], none[12 * i]) && row[4..].iter().all(|x| near(*x, 0.5)), "{row:?}");
        }
    }

    #[test]
    fn bad_folders_are_named() {
        let why = |dir: &Path| Pictures::load(dir, false).expect_err("refused").to_string();
        let dir = folder();
        let (top, broken) = (dir.path().join("top"), dir.path().join("top/00.png"));
        assert!(why(&dir.path().join("none")).contains("none"));
        assert!(why(&top).contains("one for each class"));
        std::fs::write(&broken, b"\x89PNG\r\n\x1a\nbut no more").expect("a writable folder");
        assert!(why(dir.path()).contains("00.png") && why(dir.path()).contains("save it anew"));
        (0..5).for_each(|i| {
            let _ = std::fs::remove_file(top.join(format!("0{i}.{}", if i % 2 == 0 { "png" } else { "jpg" })));
        });
        assert!(why(dir.path()).contains("top") && why(dir.path()).contains("found 0"));
        std::fs::remove_dir(&top).expect("empty now");
        assert!(why(dir.path()).contains("found 1"));
    }
}
