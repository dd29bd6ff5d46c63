//! MNIST digits from IDX files, plain or gzip.
//!
//! An IDX file is a big-endian header (magic 0x0000_08nn with nn dimensions of bytes, then nn sizes
//! of 32 bits) and the bytes. MNIST pixels are 0 for background and 255 for ink.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;

use foveate_base::{Error, Result, memory};

/// Side of a digit in pixels.
pub const SIDE: usize = 28;
/// Bytes of one digit.
const PIXELS: usize = SIDE * SIDE;
/// More digits than this in one file are refused as a damaged header: MNIST has 60,000.
const MOST: usize = 1 << 20;

/// Which of MNIST's two sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// 60,000 digits to learn from.
    Train,
    /// 10,000 digits to test with; videos are made of these.
    Test,
}

/// Digits with their labels: digit `i` is the bytes `784 i .. 784 (i + 1)` of `images`, row-major.
#[derive(Clone, PartialEq, Eq)]
pub struct Digits {
    /// 28 × 28 bytes each, 0 background, 255 ink.
    pub images: Vec<u8>,
    /// The digit of each, 0 to 9.
    pub labels: Vec<u8>,
}

impl Digits {
    /// Reads a set from `dir`, or from `dir/mnist` where it lies there, `.gz` or unpacked.
    ///
    /// Errors: a file is missing, damaged, too short or too long, holds other than 28 × 28 pictures or
    /// labels above 9, or the two files differ in number.
    pub fn load(dir: impl AsRef<Path>, split: Split) -> Result<Self> {
        let dir = dir.as_ref();
        let prefix = match split {
            Split::Train => "train",
            Split::Test => "t10k",
        };
        let images = find(dir, prefix, "images", 3)?;
        let labels = find(dir, prefix, "labels", 1)?;
        Self::read(&images, &labels)
    }

    /// Reads a set from its two files; see [`Digits::load`] for the errors.
    pub fn read(images: &Path, labels: &Path) -> Result<Self> {
        let set = Self { images: read_idx(images, &[SIDE, SIDE])?, labels: read_idx(labels, &[])? };
        let n = set.images.len() / PIXELS;
        if n != set.labels.len() {
            let found = set.labels.len();
            let problem = format!("{n} pictures in {} need {n} labels, found {found}", images.display());
            return Err(Error::malformed(labels, problem));
        }
        if let Some(i) = set.labels.iter().position(|&label| label > 9) {
            return Err(Error::malformed(labels, format!("label {} is {}, expected 0 to 9", i + 1, set.labels[i])));
        }
        Ok(set)
    }

    /// Number of digits.
    pub fn len(&self) -> usize {
        self.labels.len()
    }
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.labels.is_empty()
    }
    /// The 28 × 28 bytes of digit `i`, row-major. Panics if there are not that many.
    pub fn digit(&self, i: usize) -> &[u8] {
        &self.images[i * PIXELS..][..PIXELS]
    }
    /// Digits `from` to `to` − 1. Panics if there are not that many.
    pub fn range(&self, from: usize, to: usize) -> Self {
        Self { images: self.images[from * PIXELS..to * PIXELS].to_vec(), labels: self.labels[from..to].to_vec() }
    }
    /// The indices of all digits of class `c`, in order.
    pub fn of_class(&self, c: u8) -> Vec<usize> {
        (0..self.len()).filter(|&i| self.labels[i] == c).collect()
    }
}

impl std::fmt::Debug for Digits {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Digits({})", self.len())
    }
}

/// The file of one part of a set under the names in use.
fn find(dir: &Path, prefix: &str, what: &str, dimensions: usize) -> Result<PathBuf> {
    let names = [format!("{prefix}-{what}-idx{dimensions}-ubyte"), format!("{prefix}-{what}.idx{dimensions}-ubyte")];
    for base in [dir.to_path_buf(), dir.join("mnist")] {
        for name in &names {
            for path in [base.join(name), base.join(format!("{name}.gz"))] {
                if path.is_file() {
                    return Ok(path);
                }
            }
        }
    }
    let problem = format!("no {0} or {0}.gz here; put the four MNIST files into this folder", names[0]);
    Err(Error::malformed(dir, problem))
}

/// The bytes of an IDX file of items of the given shape.
fn read_idx(path: &Path, shape: &[usize]) -> Result<Vec<u8>> {
    let mut start = [0; 2];
    let opened = || File::open(path).map_err(Error::io(path, "cannot open"));
    let gzip = opened()?.read_exact(&mut start).is_ok() && start == [0x1f, 0x8b];
    let plain = BufReader::new(opened()?);
    if gzip { parse(MultiGzDecoder::new(plain), path, shape) } else { parse(plain, path, shape) }
}

/// Checks the header before it trusts a size, and reads no more than the header promises.
fn parse(mut from: impl Read, path: &Path, shape: &[usize]) -> Result<Vec<u8>> {
    let mut number = |what: &str| {
        let mut bytes = [0; 4];
        let read = from.read_exact(&mut bytes).map(|()| u32::from_be_bytes(bytes));
        read.map_err(|e| Error::malformed(path, format!("{what} is missing from the IDX header: {e}")))
    };
    let (magic, wanted) = (number("the magic number")?, 0x0801 + shape.len() as u32);
    if magic != wanted {
        return Err(Error::malformed(
            path,
            format!("magic number is {magic:#010x}, an IDX file here has {wanted:#010x}"),
        ));
    }
    let count = number("the number of items")? as usize;
    for &side in shape {
        let found = number("a picture's size")? as usize;
        if found != side {
            return Err(Error::malformed(path, format!("pictures have a side of {found} pixels, expected {side}")));
        }
    }
    if count > MOST {
        return Err(Error::malformed(path, format!("the header promises {count} items, more than the {MOST} allowed")));
    }
    let length = count * shape.iter().product::<usize>();
    // Unpacked data may be a thousand times as long as the file.
    memory::check(format_args!("{}: {count} items", path.display()), 2 * length as u64)?;
    let mut bytes = Vec::new();
    let read = from.take(length as u64 + 1).read_to_end(&mut bytes);
    read.map_err(|e| Error::malformed(path, format!("damaged after {} of {length} bytes: {e}", bytes.len())))?;
    if bytes.len() != length {
        let found = if bytes.len() > length { "more".into() } else { bytes.len().to_string() };
        return Err(Error::malformed(
            path,
            format!("{count} items need {length} bytes after the header, found {found}"),
        ));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::GzEncoder;
    use foveate_base::rng::{Purpose, Streams};
    use foveate_testing::damaged;
    use foveate_testing::{data, need};
    use rand::RngExt;
    use std::io::Write;

    /// Two IDX files of `n` random digits.
    fn files(n: usize) -> (Vec<u8>, Vec<u8>, Digits) {
        let mut rng = Streams::new(1, 0).at(0, Purpose::Scene).rng(0);
        let set = Digits {
            images: (0..n * PIXELS).map(|_| rng.random()).collect(),
            labels: (0..n).map(|_| rng.random_range(0..10)).collect(),
        };
        let header = |magic: u32, sizes: &[usize]| -> Vec<u8> {
            [magic].into_iter().chain(sizes.iter().map(|&s| s as u32)).flat_map(u32::to_be_bytes).collect()
        };
        let images = [header(0x803, &[n, SIDE, SIDE]), set.images.clone()].concat();
        (images, [header(0x801, &[n]), set.labels.clone()].concat(), set)
    }
    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut to = GzEncoder::new(Vec::new(), Compression::fast());
        to.write_all(bytes).expect("memory takes all");
        to.finish().expect("memory takes all")
    }

    #[test]
    fn plain_and_gzip_files_are_read_back() {
        let (images, labels, set) = files(5);
        let dir = tempfile::tempdir().expect("a temporary folder");
        let inner = dir.path().join("mnist");
        std::fs::create_dir(&inner).expect("a new folder");
        std::fs::write(inner.join("t10k-images-idx3-ubyte.gz"), gzip(&images)).expect("written");
        std::fs::write(inner.join("t10k-labels.idx1-ubyte"), labels).expect("written");
        for place in [dir.path(), &inner] {
            assert_eq!(Digits::load(place, Split::Test).expect("good files"), set);
        }
        let missing = Digits::load(dir.path(), Split::Train).expect_err("no training set there").to_string();
        assert!(missing.contains("train-images-idx3-ubyte.gz"), "{missing}");
        for i in set.of_class(set.labels[3]) {
            assert_eq!(set.labels[i], set.labels[3]);
        }
        assert_eq!(set.digit(4).len(), PIXELS);
    }

    #[test]
    fn damage_is_an_error_that_names_the_file() {
        let (images, labels, _) = files(3);
        let dir = tempfile::tempdir().expect("a temporary folder");
        let (at, beside) = (dir.path().join("images"), dir.path().join("labels"));
        let attempt = |images: &[u8], labels: &[u8]| {
            std::fs::write(&at, images).expect("written");
            std::fs::write(&beside, labels).expect("written");
            Digits::read(&at, &beside).map_err(|e| e.to_string())
        };
        assert!(attempt(&images, &labels).is_ok());
        let mut swapped = images.clone();
        swapped[3] = 1;
        let mut wide = images.clone();
        wide[11] = 29;
        let mut huge = images.clone();
        huge[4..8].fill(0xff);
        let mut eleven = labels.clone();
        eleven[9] = 11;
        for (images, labels, said) in [
            (&swapped[..], &labels[..], "magic number is 0x00000801"),
            (&wide, &labels, "29 pixels"),
            (&huge, &labels, "promises 4294967295"),
            (&images[..500], &labels, "found 484"),
            (&images[..9], &labels, "missing from the IDX header"),
            (&[&images[..], &[0]].concat(), &labels, "found more"),
            (&images, &labels[..10], "found 2"),
            (&images, &eleven, "label 2 is 11"),
            (&gzip(&images)[..700], &labels, "damaged after"),
        ] {
            let problem = attempt(images, labels).expect_err(said);
            assert!(problem.contains(said) && problem.contains(&*dir.path().to_string_lossy()), "{problem}");
        }
    }

    #[test]
    fn no_damage_panics() {
        // 600 damaged files, a third of them in the header: anything but a panic is right.
        let (images, labels, _) = files(2);
        let dir = tempfile::tempdir().expect("a temporary folder");
        let (at, beside) = (dir.path().join("images"), dir.path().join("labels"));
        std::fs::write(&beside, labels).expect("written");
        for trial in 0..600 {
            let good = if trial % 2 == 0 { images.clone() } else { gzip(&images) };
            let (head, rest) = good.split_at(if trial % 3 == 0 { 20 } else { good.len() });
            std::fs::write(&at, [&damaged(head, &[], trial), rest].concat()).expect("written");
            let _ = Digits::read(&at, &beside);
        }
    }

    #[test]
    fn mnist_is_read_where_it_is_given() {
        let mnist = need!(data("mnist"));
        let test = Digits::load(mnist.parent().expect("the data"), Split::Test).expect("MNIST");
        assert_eq!((test.len(), test.of_class(3).len()), (10_000, 1010));
        assert_eq!(test.labels[..10], [7, 2, 1, 0, 4, 1, 4, 9, 5, 9]);
    }
}
