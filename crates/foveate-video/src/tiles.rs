//! Pictures cut into tiles at several resolutions, of which only those are decoded that are looked at.
//!
//! One folder a frame, named by its number. In it one folder a level: `0` is the picture itself, `1` half its size,
//! and so on. In that one PNG or JPEG file a tile, `COLUMN_ROW.png`, counted from 0. All tiles of a level have the
//! size of the first, except those at the right and the bottom. [`write_tiles`] writes such a folder. `times.txt`, if it is there, has the
//! time of each frame in seconds, one a line ([`write_times`]).

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::decode::decode_image;
use crate::{Frame, FrameSource, SourceInfo, encode_png};
use foveate_base::text::counted;
use foveate_base::{Error, Result, files, memory};
use foveate_core::geometry::Size;
use foveate_core::scene::Image;
use foveate_core::scene::sensor::{Regions, Window};

/// Frames a second of a folder without times.
const RATE: f64 = 30.0;
/// The file of times.
const TIMES: &str = "times.txt";
/// The most levels that are looked for.
const LEVELS: usize = 16;

/// A video of tiled pictures: its frames in natural order.
#[derive(Clone, Debug)]
pub struct TileFolder {
    frames: Vec<PathBuf>,
    shape: [usize; 3],
    /// Tile sizes of the levels.
    tiles: Vec<Size>,
    /// Number of times that its sides are halved for readers.
    halvings: usize,
    /// Times of the frames, seconds.
    times: Vec<f64>,
}

/// One picture, read tile by tile; a tile is decoded once.
#[derive(Debug)]
pub struct Tiles<'a> {
    folder: &'a TileFolder,
    path: &'a Path,
    decoded: Mutex<Decoded>,
}

/// The decoded tiles of a picture, by level, column and row.
#[derive(Debug, Default)]
struct Decoded {
    tiles: HashMap<(usize, usize, usize), Image>,
    time: Duration,
}

impl TileFolder {
    /// Opens a folder of frames.
    ///
    /// # Errors
    /// Fails if it cannot be read, or its first frame has no tiles.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_path(path.as_ref())
    }

    fn open_path(path: &Path) -> Result<Self> {
        let entries = std::fs::read_dir(path).map_err(Error::io(path, "cannot read the folder"))?;
        let mut frames: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(|p| is_frame(p)).collect();
        frames.sort_by(|a, b| crate::folder::natural(&a.to_string_lossy(), &b.to_string_lossy()));
        let Some(first) = frames.first() else {
            return Err(Error::malformed(path, "no folder of tiles in it; expected one a frame, as 000001/0/0_0.png"));
        };
        let tile = load(first, 0, (0, 0))?;
        let count =
            |at: &dyn Fn(usize) -> (usize, usize)| (0..).take_while(|i| file(first, 0, at(*i)).is_some()).count();
        let (columns, rows) = (count(&|i| (i, 0)), count(&|i| (0, i)));
        let last = load(first, 0, (columns - 1, rows - 1))?;
        let size @ Size { width, height } = tile.size();
        let shape = [(columns - 1) * width + last.width(), (rows - 1) * height + last.height(), tile.planes()];
        let mut tiles = vec![size];
        while tiles.len() < LEVELS && file(first, tiles.len(), (0, 0)).is_some() {
            tiles.push(load(first, tiles.len(), (0, 0))?.size());
        }
        let times = read_times(&path.join(TIMES), frames.len())?;
        Ok(Self { frames, shape, tiles, halvings: 0, times })
    }
    /// The same frames with both sides halved so many times, at most 15: places are those of the smaller pictures, and no pixel
    /// smaller than theirs is read.
    pub fn halved(self, times: usize) -> Self {
        Self { halvings: times.min(LEVELS - 1), ..self }
    }
    /// Width, height and planes of the pictures that are read.
    fn served(&self) -> [usize; 3] {
        let [width, height, planes] = self.shape;
        [width.div_ceil(1 << self.halvings), height.div_ceil(1 << self.halvings), planes]
    }
    /// Whether this is a folder of frames in tiles.
    pub fn is_at(path: impl AsRef<Path>) -> bool {
        let folders = std::fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
        folders.filter(|path| is_frame(path)).any(|frame| file(&frame, 0, (0, 0)).is_some())
    }
    /// Its frames in order, with number and time but pictures of one pixel: pixels come from [`TileFolder::frame`].
    /// The first one is an error if a picture of the read size, which trackers fill, exceeds the memory limit.
    pub fn frames(&self) -> TileFrames {
        let [width, height, _] = self.served();
        let reader = format!("tiles of {} at {} resolutions", self.tiles[0], self.tiles.len());
        let span = self.times.last().zip(self.times.first()).map_or(0.0, |(last, first)| last - first);
        let rate = if span > 0.0 { (self.len() - 1) as f64 / span } else { RATE };
        let info = SourceInfo { width, height, frames: Some(self.len()), rate, reader };
        TileFrames { next: 0, info, times: self.times.clone() }
    }
    /// How many frames it has.
    pub fn len(&self) -> usize {
        self.frames.len()
    }
    /// Whether it has none, which [`TileFolder::open`] refuses.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }
    /// A frame, of which nothing is read yet; `None` past the last.
    pub fn frame(&self, index: usize) -> Option<Tiles<'_>> {
        self.frames.get(index).map(|path| Tiles { folder: self, path, decoded: Mutex::default() })
    }
}

/// What [`TileFolder::frames`] gives.
#[derive(Clone, Debug)]
pub struct TileFrames {
    next: usize,
    info: SourceInfo,
    times: Vec<f64>,
}

impl Iterator for TileFrames {
    type Item = Result<Frame>;
    fn next(&mut self) -> Option<Self::Item> {
        let index = self.next;
        self.info.frames.is_some_and(|n| index < n).then(|| {
            self.next += 1;
            if index == 0 {
                memory::check_picture(self.info.width, self.info.height)?;
            }
            let time = self.times.get(index).copied().unwrap_or(index as f64 / RATE);
            Ok(Frame { index, time, image: Image::grey(1, 1, 0) })
        })
    }
}

impl FrameSource for TileFrames {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
}

impl Tiles<'_> {
    /// The time that its tiles took until now to be found, read and decoded.
    pub fn decoding(&self) -> Duration {
        self.decoded.lock().unwrap_or_else(PoisonError::into_inner).time
    }
}

impl Regions for Tiles<'_> {
    fn shape(&self) -> [usize; 3] {
        self.folder.served()
    }
    /// Reads the coarsest level with pixels no larger than the bins. All values of a newly decoded tile count.
    fn read(&self, window: Window, out: &mut [u8]) -> Result<usize> {
        let [width, height, planes] = self.folder.shape;
        let halvings = self.folder.halvings;
        let bin = (window.bin.0 << halvings, window.bin.1 << halvings);
        let window = Window { x: window.x << halvings, y: window.y << halvings, bin, ..window };
        let (right, bottom) = window.end(Size { width, height });
        let least = window.bin.0.min(window.bin.1);
        let level = (0..self.folder.tiles.len()).rev().find(|l| 1 << l <= least).unwrap_or(0);
        let Size { width: tw, height: th } = self.folder.tiles[level];
        let mut decoded = self.decoded.lock().unwrap_or_else(PoisonError::into_inner);
        let Decoded { tiles: decoded, time } = &mut *decoded;
        let (mut values, began) = (0, Instant::now());
        // The tiles that the window touches.
        let (left, top) = ((window.x >> level) / tw, (window.y >> level) / th);
        let (columns, rows) = (((right - 1) >> level) / tw + 1 - left, ((bottom - 1) >> level) / th + 1 - top);
        let touched = (0..columns * rows).map(|k| (level, left + k % columns, top + k / columns));
        for key @ (_, column, row) in touched.clone() {
            if let std::collections::hash_map::Entry::Vacant(free) = decoded.entry(key) {
                let tile = load(self.path, level, (column, row))?;
                if tile.planes() != planes {
                    let problem =
                        format!("expected tiles of {planes} planes as in the first frame, found {}", tile.planes());
                    return Err(Error::malformed(self.path, problem));
                }
                values += tile.bytes().len();
                free.insert(tile);
            }
        }
        *time += began.elapsed();
        let tiles: Vec<&Image> = touched.map(|key| &decoded[&key]).collect();
        let at = |p: usize, x: usize, y: usize| {
            let tile = tiles[(y / th - top) * columns + x / tw - left];
            u64::from(tile.at(p, (x % tw).min(tile.width() - 1), (y % th).min(tile.height() - 1)))
        };
        let n = window.columns * window.rows;
        for (k, out) in out.iter_mut().enumerate() {
            let (p, i, j) = (k / n, k % n % window.columns, k % n / window.columns);
            // Whole pixels of the level, one at least.
            let along = |from: usize, bin: usize, end: usize| {
                let (a, b) = (from >> level, (from + bin).min(end).div_ceil(1 << level));
                a..b.max(a + 1).min(((end - 1) >> level) + 1).max(a + 1)
            };
            let (xs, ys) = (
                along(window.x + i * window.bin.0, window.bin.0, right),
                along(window.y + j * window.bin.1, window.bin.1, bottom),
            );
            let count = (xs.len() * ys.len()) as u64;
            let sum: u64 = ys.flat_map(|y| xs.clone().map(move |x| (x, y))).map(|(x, y)| at(p, x, y)).sum();
            *out = ((sum + count / 2) / count) as u8;
        }
        Ok(values)
    }
}

/// Whether this is the folder of a frame: its name is a number. Other folders are ignored.
fn is_frame(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().as_encoded_bytes();
    !name.is_empty() && name.iter().all(u8::is_ascii_digit) && path.is_dir()
}

fn file(frame: &Path, level: usize, (column, row): (usize, usize)) -> Option<PathBuf> {
    let name = |ext: &str| frame.join(level.to_string()).join(format!("{column}_{row}.{ext}"));
    ["png", "jpg", "jpeg"].iter().map(|ext| name(ext)).find(|path| path.is_file())
}

fn load(frame: &Path, level: usize, at: (usize, usize)) -> Result<Image> {
    let missing = || Error::malformed(frame, format!("tile {level}/{}_{}.png is missing", at.0, at.1));
    let path = file(frame, level, at).ok_or_else(missing)?;
    let bytes = files::read(&path, files::PICTURE)?;
    decode_image(&bytes).map_err(|problem| Error::malformed(&path, problem))
}

/// Reads the times of so many frames; none if there is no file.
fn read_times(path: &Path, frames: usize) -> Result<Vec<f64>> {
    if !path.exists() {
        return Ok(vec![]);
    }
    let text = files::read_text(path, files::TEXT)?;
    let wrong = |problem: String| Error::malformed(path, format!("{problem}; correct or remove it"));
    let of = |(i, line): (usize, &str)| {
        let time = line.trim().parse().ok().filter(|time: &f64| time.is_finite());
        time.ok_or_else(|| wrong(format!("line {}: expected seconds, found {line:?}", i + 1)))
    };
    let times = text.lines().enumerate().map(of).collect::<Result<Vec<f64>>>()?;
    if times.len() != frames {
        return Err(wrong(format!("it has {} for {}", counted(times.len(), "time"), counted(frames, "frame"))));
    }
    Ok(times)
}

/// Writes the times of the frames of a folder of tiles, seconds.
///
/// # Errors
/// The file cannot be written.
pub fn write_times(folder: impl AsRef<Path>, times: &[f64]) -> Result<()> {
    let path = folder.as_ref().join(TIMES);
    let text: String = times.iter().map(|time| format!("{time}\n")).collect();
    files::put(&path, text.as_bytes()).map_err(Error::io(&path, "cannot write"))
}

/// Cuts a picture into tiles of this side, at so many levels, in a folder of its own.
///
/// # Errors
/// Fails if a side is 0, or files cannot be written.
pub fn write_tiles(frame: impl AsRef<Path>, image: &Image, side: usize, levels: usize) -> Result<()> {
    write_path(frame.as_ref(), image, side, levels)
}

fn write_path(frame: &Path, image: &Image, side: usize, levels: usize) -> Result<()> {
    if side == 0 || levels == 0 {
        return Err(Error::Invalid("tiles need a side and a level of at least 1".into()));
    }
    for level in 0..levels.min(LEVELS) {
        let folder = frame.join(level.to_string());
        std::fs::create_dir_all(&folder).map_err(Error::io(&folder, "cannot create"))?;
        let (width, height, bin) = (image.width(), image.height(), 1 << level);
        let span = side * bin;
        for (y, x) in (0..height).step_by(span).flat_map(|y| (0..width).step_by(span).map(move |x| (y, x))) {
            let cells = |from: usize, length: usize| span.min(length - from).div_ceil(bin);
            let (columns, rows) = (cells(x, width), cells(y, height));
            let mut bytes = vec![0; image.planes() * columns * rows];
            image.read(Window { x, y, columns, rows, bin: (bin, bin) }, &mut bytes)?;
            let tile = Image::new(columns, rows, image.planes(), bytes)?;
            let path = folder.join(format!("{}_{}.png", x / span, y / span));
            files::put(&path, &encode_png(&tile)).map_err(Error::io(&path, "cannot write"))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(w: usize, h: usize) -> Image {
        let value = |i: usize| (i * 37 + i * i / 1013) as u8;
        Image::new(w, h, 3, (0..w * h * 3).map(value).collect()).expect("three planes")
    }

    #[test]
    fn halved_tiles_are_those_of_the_halved_picture() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let image = picture(210, 130);
        write_tiles(dir.path().join("1"), &image, 32, 3).expect("written");
        let folder = TileFolder::open(dir.path()).expect("tiles");
        let halved = folder.clone().halved(1);
        let (tiles, halved) = (folder.frame(0).expect("a frame"), halved.frame(0).expect("a frame"));
        assert_eq!(halved.shape(), [105, 65, 3]);
        foveate_core::conformance::regions(&halved);
        let read = |of: &Tiles<'_>, x, y, bin| {
            let mut out = vec![0; 3 * 20 * 11];
            of.read(Window { x, y, columns: 20, rows: 11, bin: (bin, bin) }, &mut out).expect("read");
            out
        };
        for (x, y, bin) in [(0, 0, 1), (40, 30, 1), (65, 43, 2)] {
            assert_eq!(read(&halved, x, y, bin), read(&tiles, 2 * x, 2 * y, 2 * bin), "{x}, {y}, {bin}");
        }
    }

    /// Where bins are powers of two and windows lie on their grid, tiles give the values of the whole picture, to half a grey level a
    /// level; elsewhere level 0 does.
    #[test]
    fn tiles_equal_the_picture() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let image = picture(210, 130);
        write_tiles(dir.path().join("1"), &image, 32, 3).expect("written");
        let folder = TileFolder::open(dir.path()).expect("tiles");
        assert_eq!((folder.len(), folder.frame(1).is_none()), (1, true));
        let tiles = folder.frame(0).expect("one frame");
        assert_eq!(tiles.shape(), [210, 130, 3]);
        foveate_core::conformance::regions(&image);
        foveate_core::conformance::regions(&tiles);
        for (x, y, columns, rows, bin) in [
            (0, 0, 210, 130, (1, 1)),
            (33, 17, 40, 21, (1, 1)),
            (64, 32, 12, 9, (2, 2)),
            (8, 4, 50, 31, (4, 4)),
            (7, 3, 20, 11, (1, 3)),
        ] {
            let window = Window { x, y, columns, rows, bin };
            let (mut found, mut exact) = (vec![0; 3 * columns * rows], vec![0; 3 * columns * rows]);
            let first = tiles.read(window, &mut found).expect("tiles");
            image.read(window, &mut exact).expect("memory");
            let off = found.iter().zip(&exact).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(off <= Some(1), "{window:?}: off by {off:?}");
            assert_eq!(
                tiles.read(window, &mut found).expect("tiles"),
                0,
                "no tile is decoded twice, not after {first} values"
            );
        }
        let mut out = vec![0; 3 * 100];
        let fresh = folder.frame(0).expect("one frame");
        let window = Window { x: 64, y: 32, columns: 10, rows: 10, bin: (1, 1) };
        assert_eq!(fresh.read(window, &mut out).expect("one tile"), 3 * 32 * 32);
    }

    #[test]
    fn what_is_no_folder_of_tiles_is_refused() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        assert!(TileFolder::open(dir.path()).expect_err("empty").to_string().contains("0_0.png"));
        std::fs::create_dir_all(dir.path().join("1/0")).expect("made");
        assert!(TileFolder::open(dir.path()).expect_err("no tile").to_string().contains("0/0_0.png is missing"));
        assert!(write_tiles(dir.path().join("2"), &picture(4, 4), 0, 1).is_err());
    }

    #[test]
    fn other_folders_are_no_frames() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        ["2", "10"].iter().for_each(|name| write_tiles(dir.path().join(name), &picture(9, 5), 8, 1).expect("written"));
        ["junk", ".3", "4b"].iter().for_each(|name| std::fs::create_dir(dir.path().join(name)).expect("made"));
        let names = TileFolder::open(dir.path()).expect("tiles").frames;
        assert_eq!(names, ["2", "10"].map(|name| dir.path().join(name)));
        assert!(TileFolder::is_at(dir.path()));
    }

    /// A sum of white pixels that 32 bits do not hold.
    #[test]
    fn times_are_those_of_the_video() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        (0..3).for_each(|t| write_tiles(dir.path().join(format!("{t}")), &picture(9, 5), 8, 1).expect("written"));
        let times = || {
            let frames = TileFolder::open(dir.path())?.frames();
            let rate = frames.info().rate;
            Ok((frames.map(|frame| frame.expect("a frame").time).collect::<Vec<_>>(), rate))
        };
        assert_eq!(times().expect("none"), (vec![0.0, 1.0 / 30.0, 2.0 / 30.0], 30.0));
        write_times(dir.path(), &[0.0, 0.1, 0.5]).expect("written");
        assert_eq!(times().expect("written"), (vec![0.0, 0.1, 0.5], 4.0));
        for (text, problem) in [("0\n0.1\n", "2 times for 3 frames"), ("0\nx\n1\n", "line 2"), ("0\n1\ninf", "line 3")]
        {
            std::fs::write(dir.path().join("times.txt"), text).expect("written");
            let error: Error = times().expect_err("refused");
            assert!(error.to_string().contains(problem), "{error}");
        }
    }

    #[test]
    fn a_large_bin_is_a_mean_too() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        write_tiles(dir.path().join("1"), &Image::grey(4200, 4100, 255), 4200, 1).expect("written");
        let folder = TileFolder::open(dir.path()).expect("tiles");
        let window = Window { x: 0, y: 0, columns: 1, rows: 1, bin: (4200, 4100) };
        let mut out = [0];
        folder.frame(0).expect("a frame").read(window, &mut out).expect("one tile");
        assert_eq!(out, [255]);
    }

    /// Few small tiles can claim a picture that no memory holds; read at a smaller scale it may fit.
    #[test]
    fn a_picture_too_large_is_refused_before_it_is_read() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let frame = dir.path().join("1");
        write_tiles(&frame, &Image::grey(4000, 4000, 0), 4000, 1).expect("written");
        let tile = std::fs::read(frame.join("0/0_0.png")).expect("a tile");
        for k in 1..100 {
            for name in [format!("0/{k}_0.png"), format!("0/0_{k}.png")] {
                std::fs::write(frame.join(name), if k == 99 { &*tile } else { &[] }).expect("written");
            }
        }
        std::fs::write(frame.join("0/99_99.png"), &tile).expect("written");
        let folder = TileFolder::open(dir.path()).expect("tiles");
        let error = folder.frames().next().expect("a frame").expect_err("no memory").to_string();
        assert!(error.contains("400000 x 400000"), "{error}");
        assert!(folder.halved(8).frames().next().expect("a frame").is_ok());
    }
}
