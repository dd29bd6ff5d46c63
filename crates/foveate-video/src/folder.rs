//! A folder of images as a source of frames, in the natural order of their names (2 before 10).

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use crate::decode::decode_next;
use crate::sandbox::Apart;
use crate::tiff::Range;
use crate::{Frame, FrameSource, Interrupt, Options, SourceInfo};
use foveate_base::text::counted;
use foveate_base::{Error, Result, files};
use foveate_core::scene::Image;

/// Default frames a second.
pub(crate) const RATE: f64 = 30.0;

/// Frames from the pictures of one folder: PNG, JPEG, BMP, WebP, TIFF of one page.
///
/// All frames have the size and the number of planes of the first: another size is an error, grey
/// and colour are converted. Hidden files, subfolders and files of other kinds are passed over.
#[derive(Debug)]
pub struct ImageFolder {
    info: SourceInfo,
    files: Vec<PathBuf>,
    planes: usize,
    next: usize,
    first: Option<Image>,
    range: Range,
    sandbox: Option<Apart>,
}

impl ImageFolder {
    /// Opens a folder, or the one inside that holds the frames ([`frames_folder`]).
    ///
    /// # Errors
    /// Fails if the folder cannot be read, has no picture, or the first cannot be decoded.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::from_files(image_files(path)?)
    }

    /// Frames from these files, in this order.
    ///
    /// # Errors
    /// Fails if there is none, or the first cannot be decoded.
    pub fn from_files(files: Vec<PathBuf>) -> Result<Self> {
        Self::from_files_with(files, &Options::default())
    }

    /// [`ImageFolder::from_files`], in the sandbox of the options if they have one.
    ///
    /// # Errors
    /// As [`ImageFolder::from_files`], or there is no sandbox.
    pub fn from_files_with(files: Vec<PathBuf>, options: &Options) -> Result<Self> {
        let Some(path) = files.first() else {
            return Err(Error::Invalid("a source of frames needs at least one image file, got none".into()));
        };
        let sandbox = options.sandbox.as_ref().map(|sandbox| Apart::pictures(sandbox, files.len()));
        let mut sandbox = sandbox.transpose().map_err(|problem| Error::malformed(path, problem))?;
        let mut range = None;
        let first = load(path, 0, sandbox.as_mut(), &mut range)?;
        let info = SourceInfo {
            width: first.width(),
            height: first.height(),
            frames: Some(files.len()),
            rate: RATE,
            reader: if files.len() == 1 { "one image" } else { "image folder" }.into(),
        };
        Ok(Self { info, planes: first.planes(), files, next: 0, first: Some(first), range, sandbox })
    }

    fn load(&mut self, index: usize) -> Result<Image> {
        let path = &self.files[index];
        let image = match self.first.take() {
            Some(first) if index == 0 => first,
            _ => load(path, index, self.sandbox.as_mut(), &mut self.range)?,
        };
        if image.size() != self.info.size() {
            let problem = format!(
                "expected {} pixels as in the first frame ({}), found {}; all frames of a video have one size",
                self.info.size(),
                self.files[0].display(),
                image.size(),
            );
            return Err(Error::Frame { path: path.clone(), frame: index + 1, problem });
        }
        Ok(image.with_planes(self.planes))
    }
}

impl Iterator for ImageFolder {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let index = self.next;
        if index >= self.files.len() {
            return None;
        }
        let image = self.load(index);
        self.next = if image.is_ok() { index + 1 } else { self.files.len() };
        Some(image.map(|image| Frame { index, time: index as f64 / RATE, image }))
    }
}

impl FrameSource for ImageFolder {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
    /// Without reading them.
    fn pass_over(&mut self, count: usize) -> Result<()> {
        self.next = self.next.saturating_add(count).min(self.files.len());
        Ok(())
    }
    fn interrupt(&self) -> Option<Interrupt> {
        self.sandbox.as_ref().map(Apart::interrupt)
    }
}

/// Subfolders that hold the frames: of OTB, of MOT, of VOT.
const INNER: [&str; 3] = ["img", "img1", "color"];

/// The folder that holds the frames of a sequence: its subfolder `img` (OTB layout), `img1` (MOT) or `color` (VOT), or else the folder itself.
pub fn frames_folder(path: &Path) -> PathBuf {
    INNER.iter().map(|name| path.join(name)).find(|inner| inner.is_dir()).unwrap_or_else(|| path.to_owned())
}

/// The pictures of [`frames_folder`] in natural order.
///
/// # Errors
/// Fails if the folder cannot be read, has none, has two for one frame (`1.jpg` and `1.png`), or has video files, too, as the folder of a
/// camera: pictures that lie beside videos are no frames of one.
pub fn image_files(path: impl AsRef<Path>) -> Result<Vec<PathBuf>> {
    files_in(frames_folder(path.as_ref()))
}

fn files_in(folder: PathBuf) -> Result<Vec<PathBuf>> {
    let (mut files, mut videos, mut others, mut foreign) = (Vec::new(), Vec::new(), 0, None);
    for entry in std::fs::read_dir(&folder).map_err(Error::io(&folder, "cannot read the folder"))? {
        let file = entry.map_err(Error::io(&folder, "cannot read the folder"))?.path();
        if is_hidden(&file) || file.is_dir() {
            continue;
        }
        match (is_image(&file), is_video(&file)) {
            (true, _) => files.push(file),
            (_, true) if file.file_name().is_none_or(|name| name != FILM) => videos.push(file),
            _ => {
                others += 1;
                foreign = foreign.or_else(|| ending(&file).filter(|end| FOREIGN.contains(&&**end)));
            }
        }
    }
    if let Some(video) = videos.iter().min() {
        let end = video.extension().unwrap_or_default().to_string_lossy();
        let here = folder.display();
        let (problem, rest) = match files.len() {
            0 => (format!("expected frames as pictures, found {}", counted(videos.len(), "video")), String::new()),
            n => (
                format!(
                    "expected frames alone, found {} and {}",
                    counted(n, "picture"),
                    counted(videos.len(), "video")
                ),
                "; for the pictures, give a folder that holds nothing else".to_owned(),
            ),
        };
        return Err(Error::malformed(&folder, format!("{problem}; for the videos, give {here}/*.{end}{rest}")));
    }
    if files.is_empty() {
        let found = if others == 0 { "no files".to_owned() } else { counted(others, "file") + " of other kinds" };
        let remedy = match foreign {
            Some(end) => format!("convert the .{end} files: ffmpeg -pattern_type glob -i '*.{end}' %06d.png"),
            None => "give the folder that holds the frames".to_owned(),
        };
        let problem = format!(
            "expected .jpg, .png, .bmp, .webp or .tif files (here, or in a subfolder img, img1 or color), found {found}; {remedy}"
        );
        return Err(Error::malformed(folder, problem));
    }
    files.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()));
    if let Some(pair) = files.windows(2).find(|pair| pair[0].file_stem() == pair[1].file_stem()) {
        let name = |file: &PathBuf| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let problem = format!(
            "expected one picture a frame, found {} and {}; keep one of the two kinds, or move the other elsewhere",
            name(&pair[0]),
            name(&pair[1])
        );
        return Err(Error::malformed(folder, problem));
    }
    Ok(files)
}

/// Whether a file of this name is a frame of the folder that it is in: one that ends as a picture does, and is not hidden.
pub fn is_image(path: &Path) -> bool {
    matches!(ending(path).as_deref(), Some("jpg" | "jpeg" | "png" | "bmp" | "webp" | "tif" | "tiff"))
        && !is_hidden(path)
}

/// The ending of a file's name, in small letters.
fn ending(path: &Path) -> Option<String> {
    path.extension().map(|end| end.to_string_lossy().to_ascii_lowercase())
}

/// How the names of pictures end that ffmpeg reads and foveate does not.
const FOREIGN: [&str; 4] = ["gif", "pgm", "ppm", "jp2"];

/// How the names of video files and of stacks of pictures end.
const VIDEOS: [&str; 20] = [
    "mp4", "m4v", "mov", "y4m", "mkv", "webm", "avi", "mpg", "mpeg", "ts", "mts", "m2ts", "wmv", "flv", "ogv", "3gp",
    "mxf", "vob", "tif", "tiff",
];
/// A result of ours: it may lie in the folder of the frames.
const FILM: &str = "annotated.mp4";

/// Whether a file is a video, by the ending of its name.
pub fn is_video(path: &Path) -> bool {
    ending(path).is_some_and(|end| VIDEOS.contains(&&*end))
}

fn is_hidden(path: &Path) -> bool {
    path.file_name().is_none_or(|name| name.to_string_lossy().starts_with('.'))
}

fn load(path: &Path, index: usize, sandbox: Option<&mut Apart>, range: &mut Range) -> Result<Image> {
    let decode = |bytes: Vec<u8>| match sandbox {
        Some(apart) => apart.picture(&bytes),
        None => decode_next(&bytes, range),
    };
    files::read(path, files::PICTURE)
        .map_err(|error| error.to_string())
        .and_then(decode)
        .map_err(|problem| Error::Frame { path: path.to_owned(), frame: index + 1, problem })
}

/// Runs of digits compare as numbers, all else as text: `a2` before `a10`, and `a02` beside `a2`.
pub(crate) fn natural(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    while let (Some(p), Some(q)) = (x.first(), y.first()) {
        let order = if p.is_ascii_digit() && q.is_ascii_digit() {
            let (m, n) = (digits(&mut x), digits(&mut y));
            m.len().cmp(&n.len()).then_with(|| m.cmp(n))
        } else {
            (x, y) = (&x[1..], &y[1..]);
            p.cmp(q)
        };
        if order.is_ne() {
            return order;
        }
    }
    x.len().cmp(&y.len()).then_with(|| a.cmp(b))
}

/// Takes the digits in front off `text`; without their leading zeros.
fn digits<'a>(text: &mut &'a [u8]) -> &'a [u8] {
    let end = text.iter().position(|c| !c.is_ascii_digit()).unwrap_or(text.len());
    let (number, rest) = text.split_at(end);
    *text = rest;
    &number[number.iter().position(|&c| c != b'0').unwrap_or(end)..]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{encode_jpeg, save_png};

    fn folder(values: &[(&str, u8)]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().expect("a temporary folder");
        for (name, value) in values {
            save_png(dir.path().join(name), &Image::grey(4, 3, *value)).expect("a writable folder");
        }
        dir
    }

    fn values(source: ImageFolder) -> Vec<u8> {
        source.map(|frame| frame.expect("good frames").image.at(0, 0, 0)).collect()
    }

    #[test]
    fn names_sort_as_people_count() {
        let mut names = ["f10", "f9", "f09", "f2b", "f2", "g1", "f", "f100000000000000000000000", "f3"];
        names.sort_by(|a, b| natural(a, b));
        assert_eq!(names, ["f", "f2", "f2b", "f3", "f09", "f9", "f10", "f100000000000000000000000", "g1"]);
    }

    #[test]
    fn frames_come_in_order_with_index_and_time() {
        let dir = folder(&[("10.png", 10), ("9.png", 9), ("x.PNG", 99), (".hidden.png", 1)]);
        std::fs::write(dir.path().join("notes.txt"), "no frame").expect("a writable folder");
        let source = ImageFolder::open(dir.path()).expect("a folder of images");
        assert_eq!((source.info.width, source.info.height, source.info.frames), (4, 3, Some(3)));
        let frames: Vec<Frame> = source.map(|frame| frame.expect("good frames")).collect();
        assert_eq!(frames.iter().map(|f| f.image.at(0, 0, 0)).collect::<Vec<_>>(), [9, 10, 99]);
        assert_eq!(frames.iter().map(|f| f.index).collect::<Vec<_>>(), [0, 1, 2]);
        assert!((frames[2].time - 2.0 / 30.0).abs() < 1e-12);
    }

    #[test]
    fn frames_that_are_passed_over_are_not_read() {
        let dir = folder(&[("1.png", 1), ("3.png", 3), ("4.png", 4)]);
        std::fs::write(dir.path().join("2.png"), "damaged").expect("a writable folder");
        let mut source = ImageFolder::open(dir.path()).expect("a folder of images");
        source.pass_over(2).expect("nothing is read");
        let frame = source.next().expect("a frame").expect("a good one");
        assert_eq!((frame.index, frame.image.at(0, 0, 0)), (2, 3));
        source.pass_over(usize::MAX).expect("the end");
        assert!(source.next().is_none());
    }

    #[test]
    fn the_inner_folder_of_otb_mot_and_vot_is_found() {
        for name in INNER {
            let dir = folder(&[("preview.png", 1)]);
            std::fs::create_dir(dir.path().join(name)).expect("a writable folder");
            save_png(dir.path().join(name).join("0001.png"), &Image::grey(4, 3, 7)).expect("a writable folder");
            assert_eq!(values(ImageFolder::open(dir.path()).expect("a folder")), [7]);
        }
    }

    #[test]
    fn a_break_gives_good_frames_then_one_error_then_nothing() {
        let dir = folder(&[("1.png", 1), ("2.png", 2), ("4.png", 4)]);
        let whole = encode_jpeg(&Image::grey(4, 3, 3), 90);
        std::fs::write(dir.path().join("3.jpg"), &whole[..whole.len() / 2]).expect("a writable folder");
        let mut source = ImageFolder::open(dir.path()).expect("a folder of images");
        assert!(source.next().is_some_and(|f| f.is_ok()) && source.next().is_some_and(|f| f.is_ok()));
        let text = source.next().expect("an error").expect_err("a cut file").to_string();
        assert!(text.contains("3.jpg, frame 3") && text.contains("cut off"), "{text}");
        assert!(source.next().is_none());
    }

    #[test]
    fn another_size_is_an_error_and_another_number_of_planes_is_converted() {
        let dir = folder(&[("1.png", 1), ("3.png", 3)]);
        let colour = Image::new(4, 3, 3, vec![200; 36]).expect("sizes agree");
        save_png(dir.path().join("2.png"), &colour).expect("a writable folder");
        save_png(dir.path().join("4.png"), &Image::grey(5, 3, 0)).expect("a writable folder");
        let mut source = ImageFolder::open(dir.path()).expect("a folder of images");
        let second = source.nth(1).expect("a frame").expect("a good frame");
        assert_eq!((second.image.planes(), second.image.at(0, 0, 0)), (1, 200));
        let text = source.nth(1).expect("an error").expect_err("another size").to_string();
        assert!(text.contains("4 x 3") && text.contains("5 x 3") && text.contains("frame 4"), "{text}");
    }

    #[test]
    fn two_pictures_of_one_frame_are_refused() {
        let dir = folder(&[("1.png", 1), ("10.png", 1), ("2.png", 2)]);
        std::fs::write(dir.path().join("2.jpg"), "x").expect("a writable folder");
        let text = ImageFolder::open(dir.path()).expect_err("two for frame 2").to_string();
        assert!(text.contains("found 2.jpg and 2.png"), "{text}");
    }

    #[test]
    fn a_folder_without_images_is_an_error() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let text = ImageFolder::open(dir.path()).expect_err("empty").to_string();
        assert!(text.contains("found no files"), "{text}");
        std::fs::write(dir.path().join("a.ppm"), "x").expect("a writable folder");
        let text = ImageFolder::open(dir.path()).expect_err("no images").to_string();
        assert!(text.contains("1 file of other kinds; convert the .ppm files: ffmpeg"), "{text}");
    }

    /// As a camera's folder: neither a picture that lies there nor one that comes later is taken for a frame.
    #[test]
    fn pictures_beside_videos_are_no_frames() {
        let dir = folder(&[("IMG_0001.PNG", 1)]);
        let problem = || ImageFolder::open(dir.path()).map(drop);
        std::fs::write(dir.path().join("annotated.mp4"), "ours").expect("a writable folder");
        assert!(problem().is_ok());
        ["MVI_0003.MP4", "MVI_0002.MP4"]
            .iter()
            .for_each(|name| std::fs::write(dir.path().join(name), "x").expect("writable"));
        let text = problem().expect_err("which one?").to_string();
        let all = format!("{}/*.MP4", dir.path().display());
        assert!(text.contains("found 1 picture and 2 videos") && text.contains(&all), "{text}");
        std::fs::remove_file(dir.path().join("IMG_0001.PNG")).expect("ours");
        let text = problem().expect_err("no picture").to_string();
        assert!(text.contains("found 2 videos") && text.contains(&all), "{text}");
    }
}
