//! TIFF stacks, as microscopes and ImageJ write them, as a source of frames.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use crate::decode::MAX_SIDE;
use crate::folder::RATE;
use crate::tiff::{Decoded, Pages, Range};
use crate::{Frame, FrameSource, SourceInfo};
use foveate_base::{Error, Result, quiet};
use foveate_core::scene::Image;

/// The pages of one file as frames. All have the size and the number of planes of the first one.
///
/// Pages of more than 8 bits and of floating-point numbers are stretched: the least value of the first page becomes 0, its greatest 255.
pub struct TiffStack {
    name: PathBuf,
    info: SourceInfo,
    pages: Pages<BufReader<File>>,
    range: Range,
    first: Option<Image>,
    planes: usize,
    next: usize,
}

foveate_base::opaque_debug!(TiffStack);

impl TiffStack {
    /// Opens a file.
    ///
    /// # Errors
    /// It cannot be read, is no TIFF file, or its first page cannot be decoded.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        caught(|| Self::open_path(path)).unwrap_or_else(|problem| Err(Error::malformed(path, problem)))
    }

    fn open_path(name: &Path) -> Result<Self> {
        let open = || Ok(BufReader::new(File::open(name).map_err(Error::io(name, "cannot open"))?));
        let wrong = |problem: String| Error::malformed(name, problem);
        let (mut pages, mut range) = (Pages::new(open()?, MAX_SIDE).map_err(wrong)?, None);
        let text = pages.description();
        let first = pages.read(&mut range).map_err(wrong)?;
        let frames = Pages::new(open()?, MAX_SIDE).and_then(Pages::count).map_err(wrong)?;
        // ImageJ leaves the pages of files above 4 GiB out, and only says how many pictures follow the first one; tifffile does if asked.
        let several = text.starts_with("ImageJ") && number(&text, "images=").is_some_and(|images| images > 1.0);
        if frames == 1 && (several || text.contains("\"truncate\": true")) {
            let problem = "it has one page, but says that it has several pictures; save it as another stack, or as single pictures";
            return Err(wrong(problem.into()));
        }
        let seconds = interval(&text, first.planes()).map_err(wrong)?;
        let (width, height, rate) = (first.width(), first.height(), seconds.map_or(RATE, f64::recip));
        let reader = if frames == 1 { "one image" } else { "TIFF stack" }.into();
        let info = SourceInfo { width, height, frames: Some(frames), rate, reader };
        let planes = first.planes();
        Ok(Self { name: name.to_owned(), info, pages, range, first: Some(first), planes, next: 0 })
    }

    fn page(&mut self) -> Decoded<Image> {
        if let Some(first) = self.first.take() {
            return Ok(first);
        }
        if !self.pages.skip_to_next()? {
            return Err("expected another page, found the end".into());
        }
        let image = self.pages.read(&mut self.range)?;
        if image.size() != self.info.size() {
            let (expected, found) = (self.info.size(), image.size());
            return Err(format!(
                "expected {expected} pixels as in the first page, found {found}; all frames have one size"
            ));
        }
        Ok(image.with_planes(self.planes))
    }
}

/// The number in a line of ImageJ's text that begins with this key.
fn number(text: &str, key: &str) -> Option<f64> {
    word(text, key)?.parse().ok()
}
fn word<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.lines().find_map(|line| Some(line.trim().strip_prefix(key)?.trim()))
}

/// Seconds between the pages of a stack with this description, in ImageJ's text or in OME's XML, which other programs of microscopes write.
///
/// Fails if a time has several pages.
fn interval(text: &str, planes: usize) -> Decoded<Option<f64>> {
    let attribute = |key: &str| text.split_once(&format!(" {key}=\""))?.1.split('"').next();
    let either = |key: &str, name: &str| number(text, key).or_else(|| attribute(name)?.parse().ok());
    let counts = [("channels=", "SizeC"), ("slices=", "SizeZ"), ("frames=", "SizeT")];
    let [channels, slices, times] = counts.map(|(key, name)| either(key, name).unwrap_or(1.0));
    if channels > planes as f64 || slices > 1.0 && times > 1.0 {
        let found = format!("{channels} channels and {slices} slices a time");
        return Err(format!("expected a picture a time, found {found}; save one channel and slice as a stack"));
    }
    // Without a known unit the interval says nothing.
    let unit = match word(text, "tunit=").or_else(|| attribute("TimeIncrementUnit")).unwrap_or("sec") {
        "sec" | "s" | "second" | "seconds" => 1.0,
        "msec" | "ms" => 1e-3,
        "usec" | "us" | "µs" => 1e-6,
        "min" | "minute" | "minutes" => 60.0,
        "h" | "hr" | "hour" | "hours" => 3600.0,
        _ => f64::NAN,
    };
    let seconds = either("finterval=", "TimeIncrement").map(|interval| interval * unit);
    Ok(seconds.filter(|seconds| (1e-6..1e6).contains(seconds)))
}

/// The decoder answers damage with an error; a panic of its own must not end the program either.
fn caught<T>(decode: impl FnOnce() -> T) -> Decoded<T> {
    quiet::catch(decode).map_err(|panic| format!("the TIFF data is damaged ({panic}); copy the file again"))
}

impl Iterator for TiffStack {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let (index, frames) = (self.next, self.info.frames.unwrap_or(0));
        if index >= frames {
            return None;
        }
        let page = caught(|| self.page()).and_then(|page| page);
        self.next = if page.is_ok() { index + 1 } else { frames };
        let time = index as f64 / self.info.rate;
        let wrong = |problem| Error::Frame { path: self.name.clone(), frame: index + 1, problem };
        Some(page.map(|image| Frame { index, time, image }).map_err(wrong))
    }
}

impl FrameSource for TiffStack {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode_image;
    use std::io::Cursor;
    use tiff::encoder::colortype::{Gray8, Gray16, Gray32Float, RGB8, RGBA16};
    use tiff::encoder::{Compression, TiffEncoder};
    use tiff::tags::Tag;

    fn written(pages: impl Fn(&mut TiffEncoder<Cursor<&mut Vec<u8>>>)) -> Vec<u8> {
        let mut bytes = vec![];
        pages(&mut TiffEncoder::new(Cursor::new(&mut bytes)).expect("memory"));
        bytes
    }

    fn stack(bytes: &[u8]) -> Result<TiffStack> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("stack.tif");
        std::fs::write(&path, bytes).expect("a writable folder");
        TiffStack::open(path)
    }

    fn problem<T>(result: Result<T>) -> String {
        result.err().expect("an error").to_string()
    }

    /// Microscopes have 12 bits in 16.
    #[test]
    fn deep_pages_are_stretched_by_the_range_of_the_first() {
        let pages: [[u16; 4]; 3] = [[100, 200, 300, 355], [100, 101, 0, 4000], [228, 228, 228, 228]];
        let bytes =
            written(|file| pages.iter().for_each(|page| file.write_image::<Gray16>(2, 2, page).expect("memory")));
        let source = stack(&bytes).expect("a stack");
        assert_eq!((source.info().frames, source.info().size().to_string()), (Some(3), "2 x 2".into()));
        let frames: Vec<Frame> = source.map(|frame| frame.expect("a page")).collect();
        let values: Vec<&[u8]> = frames.iter().map(|frame| frame.image.bytes()).collect();
        assert_eq!(values, [[0, 100, 200, 255], [0, 1, 0, 255], [128; 4]]);
        assert!((frames[2].time - 2.0 / RATE).abs() < 1e-12);
        let several = decode_image(&bytes).expect_err("a picture has one page");
        assert!(several.contains("several pages"), "{several}");
    }

    /// An opaque pixel has the greatest alpha that there is.
    #[test]
    fn transparency_does_not_stretch_the_colours() {
        let pixels: [u16; 8] = [0, 100, 200, u16::MAX, 255, 50, 0, u16::MAX];
        let bytes = written(|file| file.write_image::<RGBA16>(2, 1, &pixels).expect("memory"));
        assert_eq!(decode_image(&bytes), Image::from_rgb8(2, 1, &[0, 100, 200, 255, 50, 0]).map_err(|e| e.to_string()));
    }

    #[test]
    fn colour_and_compressed_pages_come_back_as_they_were() {
        let pixels: Vec<u8> = (0..5 * 4 * 3).map(|i| (i * 37 % 251) as u8).collect();
        for compression in [Compression::Uncompressed, Compression::Lzw, Compression::Packbits] {
            let mut bytes = vec![];
            let file = TiffEncoder::new(Cursor::new(&mut bytes)).expect("memory");
            let mut file = file.with_compression(compression);
            file.write_image::<RGB8>(5, 4, &pixels).expect("memory");
            assert_eq!(decode_image(&bytes), Ok(Image::from_rgb8(5, 4, &pixels).expect("bytes")));
        }
        let floats = written(|file| file.write_image::<Gray32Float>(2, 1, &[-1.5, f32::NAN]).expect("memory"));
        assert_eq!(decode_image(&floats).expect("a picture").bytes(), [0, 0]);
    }

    #[test]
    fn the_interval_of_imagej_gives_the_rate() {
        let described = |text: &str| {
            written(|file| {
                let mut image = file.new_image::<Gray8>(2, 1).expect("memory");
                image.encoder().write_tag(Tag::ImageDescription, text).expect("memory");
                image.write_data(&[1, 2]).expect("memory");
            })
        };
        let source = stack(&described("ImageJ=1.54f\nfinterval=0.25\n")).expect("a stack");
        assert_eq!(source.info().rate, 4.0);
        // Another unit of time, and one that nobody knows.
        for (unit, rate) in [("min", 1.0 / 15.0), ("ms", 4000.0), ("fortnight", RATE)] {
            let text = format!("ImageJ=1.54f\nfinterval=0.25\ntunit={unit}\n");
            let found = stack(&described(&text)).expect("a stack").info().rate;
            assert!((found / rate - 1.0).abs() < 1e-12, "{unit}: {found}");
        }
        for counts in ["channels=2\n", "slices=3\nframes=2\n"] {
            let text = problem(stack(&described(&format!("ImageJ=1.54f\n{counts}"))));
            assert!(text.contains("expected a picture a time"), "{text}");
        }
        // A video that was opened as slices.
        assert!(stack(&described("ImageJ=1.54f\nslices=9\n")).is_ok());
        let ome = |counts: &str| {
            format!(
                "<?xml version=\"1.0\"?><OME><Pixels {counts} TimeIncrement=\"1.5\" TimeIncrementUnit=\"min\"/></OME>"
            )
        };
        let text = problem(stack(&described(&ome("ID=\"1\" SizeC=\"2\" SizeT=\"3\" SizeZ=\"1\""))));
        assert!(text.contains("found 2 channels and 1 slices"), "{text}");
        let found =
            stack(&described(&ome("ID=\"1\" SizeC=\"1\" SizeT=\"3\" SizeZ=\"1\""))).expect("a stack").info().rate;
        assert!((found * 90.0 - 1.0).abs() < 1e-12, "{found}");
        let text = problem(stack(&described("ImageJ=1.54f\nimages=3\nfinterval=0.25\n")));
        assert!(text.contains("says that it has several"), "{text}");
    }

    /// The first row of the stored picture is at the top, the right, ... of the one shown; the values are those of TIFF 6.0, page 36.
    #[test]
    fn the_orientation_is_applied() {
        let turned = |mark: u16| {
            let bytes = written(|file| {
                let mut image = file.new_image::<Gray8>(3, 2).expect("memory");
                image.encoder().write_tag(Tag::Orientation, mark).expect("memory");
                image.write_data(&[1, 2, 3, 4, 5, 6]).expect("memory");
            });
            let image = decode_image(&bytes).expect("a picture");
            (image.width(), image.bytes().to_vec())
        };
        let wide = [[1, 2, 3, 4, 5, 6], [3, 2, 1, 6, 5, 4], [6, 5, 4, 3, 2, 1], [4, 5, 6, 1, 2, 3]];
        let tall = [[1, 4, 2, 5, 3, 6], [4, 1, 5, 2, 6, 3], [6, 3, 5, 2, 4, 1], [3, 6, 2, 5, 1, 4]];
        for (mark, bytes) in (1..).zip(wide.into_iter().chain(tall)) {
            assert_eq!(turned(mark), (if mark < 5 { 3 } else { 2 }, bytes.to_vec()), "{mark}");
        }
    }

    #[test]
    fn a_page_of_another_size_ends_the_stack() {
        let bytes = written(|file| {
            file.write_image::<Gray8>(2, 1, &[1, 2]).expect("memory");
            file.write_image::<Gray8>(1, 2, &[1, 2]).expect("memory");
        });
        let mut source = stack(&bytes).expect("a stack");
        assert!(source.next().expect("a page").is_ok());
        let text = problem(source.next().expect("an error"));
        assert!(text.contains("frame 2") && text.contains("found 1 x 2"), "{text}");
        assert!(source.next().is_none());
    }

    /// Every cut, and 3000 damaged stacks, seeds 0 to 2999: pages or an error, never a panic, and no more than 16 pages.
    #[test]
    fn damaged_stacks_do_not_panic() {
        let page: Vec<u16> = (0..64).map(|i| i * 1000).collect();
        let bytes = written(|file| (0..3).for_each(|_| file.write_image::<Gray16>(8, 8, &page).expect("memory")));
        let whole =
            |bytes: &[u8]| stack(bytes).map_or(0, |source| source.take(16).filter(|frame| frame.is_ok()).count());
        assert_eq!(whole(&bytes), 3);
        (0..bytes.len()).for_each(|n| assert!(whole(&bytes[..n]) < 3));
        for seed in 0..3000 {
            let damaged = foveate_testing::damaged(&bytes, &[], seed);
            let _ = (whole(&damaged), decode_image(&damaged));
        }
    }
}
