//! The pages of TIFF files.

use std::io::{Cursor, Read, Seek};

use tiff::TiffError;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

use crate::turn::turned;
use foveate_base::memory;
use foveate_core::scene::Image;

/// What is decoded, or a text that says why not.
pub(crate) type Decoded<T> = std::result::Result<T, String>;

/// Most pages of a stack.
const MOST: usize = 1_000_000;
/// Most bytes of a page's tags.
const TAGS: usize = 1 << 24;

/// The least and the greatest value of the first picture, which become 0 and 255 in all pictures. `None` before the first one, and for
/// samples of 8 bits, which stay as they are.
pub(crate) type Range = Option<[f64; 2]>;

/// The picture of a file with one page.
///
/// # Errors
/// A text if the data are damaged or of a kind that is not read, exceed the memory limit, or have several pages.
pub(crate) fn only_page(bytes: &[u8], most: usize, range: &mut Range) -> Decoded<Image> {
    let mut pages = Pages::new(Cursor::new(bytes), most)?;
    let image = pages.read(range)?;
    match pages.skip_to_next()? {
        true => {
            Err("the file has several pages, which are frames of their own; give the file alone, and without --sandbox"
                .into())
        }
        false => Ok(image),
    }
}

/// The pages of a file in turn, without reduced copies of other pages.
pub(crate) struct Pages<R: Read + Seek> {
    decoder: Decoder<R>,
    /// The longest side of a page, in pixels.
    most: usize,
}

impl<R: Read + Seek> Pages<R> {
    /// Goes to the first page.
    pub(crate) fn new(reader: R, most: usize) -> Decoded<Self> {
        let mut limits = Limits::default();
        limits.ifd_value_size = TAGS;
        limits.decoding_buffer_size = usize::try_from(memory::limit()).unwrap_or(usize::MAX);
        limits.intermediate_buffer_size = limits.decoding_buffer_size;
        Ok(Self { decoder: Decoder::new(reader).map_err(damaged)?.with_limits(limits), most })
    }

    /// Goes to the next page. Returns false at the end.
    pub(crate) fn skip_to_next(&mut self) -> Decoded<bool> {
        while self.decoder.more_images() {
            self.decoder.next_image().map_err(damaged)?;
            let kind: Option<u32> = self.decoder.find_tag_unsigned(Tag::NewSubfileType).map_err(damaged)?;
            if kind.is_none_or(|kind| kind & 1 == 0) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Decodes this page.
    pub(crate) fn read(&mut self, range: &mut Range) -> Decoded<Image> {
        let (width, height) = self.decoder.dimensions().map_err(damaged)?;
        let (width, height) = (width as usize, height as usize);
        if width.max(height) > self.most {
            return Err(format!("the picture has {width} x {height} pixels; expected sides of at most {}", self.most));
        }
        memory::check_picture(width, height).map_err(|error| error.to_string())?;
        let kind = self.decoder.colortype().map_err(damaged)?;
        let (samples, bits) = (usize::from(kind.num_samples()), kind.bit_depth());
        use tiff::ColorType::{Gray, GrayA, RGB, RGBA};
        if !matches!(kind, Gray(_) | GrayA(_) | RGB(_) | RGBA(_)) || bits < 8 {
            return Err(format!(
                "expected grey or red, green and blue of 8 bits or more, found {kind:?}; convert the file"
            ));
        }
        let mut values = DecodingResult::U8(vec![]);
        let planes = self.decoder.read_image_to_buffer(&mut values).map_err(damaged)?.planes;
        let kept = if samples < 3 { 1 } else { 3 };
        let is_colour = |at: usize| if planes > 1 { at < width * height * kept } else { at % samples < kept };
        let bytes = eight_bits(values, range, &is_colour);
        let wrong = || format!("expected {width} x {height} x {samples} values, found {}", bytes.len());
        if bytes.len() != width * height * samples {
            return Err(wrong());
        }
        let image = match (planes, samples) {
            (1, 1) => Image::new(width, height, 1, bytes),
            (1, 2) => Image::new(width, height, 1, bytes.chunks_exact(2).map(|pixel| pixel[0]).collect()),
            (1, 3) => Image::from_rgb8(width, height, &bytes),
            (1, _) => {
                Image::from_rgb8(width, height, &Vec::from_iter(bytes.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]])))
            }
            _ => Image::new(width, height, kept, bytes[..width * height * kept].to_vec()),
        };
        // As in a camera's mark: the side of the picture that its first row and column are.
        let turns = match self.decoder.find_tag_unsigned::<u32>(Tag::Orientation).map_err(damaged)? {
            Some(mark @ 2..=8) => [4, 2, 6, 7, 1, 5, 3][mark as usize - 2],
            _ => 0,
        };
        image.map(|image| turned(image, turns)).map_err(|error| error.to_string())
    }

    /// The number of pages from this one on.
    pub(crate) fn count(mut self) -> Decoded<usize> {
        let mut count = 1;
        while self.skip_to_next()? {
            count += 1;
            if count > MOST {
                return Err(format!("it has more than {MOST} pages"));
            }
        }
        Ok(count)
    }

    /// The text that a program left about the file.
    pub(crate) fn description(&mut self) -> String {
        self.decoder.get_tag_ascii_string(Tag::ImageDescription).unwrap_or_default()
    }
}

fn damaged(error: TiffError) -> String {
    format!("the TIFF data is damaged or unusual ({error}); copy or convert it")
}

/// Values of 8 bits. Others are stretched from the range of the colours of the first picture.
fn eight_bits(values: DecodingResult, range: &mut Range, is_colour: &dyn Fn(usize) -> bool) -> Vec<u8> {
    match values {
        DecodingResult::U8(bytes) => bytes,
        DecodingResult::I8(values) => stretched(&values, range, is_colour, f64::from),
        DecodingResult::U16(values) => stretched(&values, range, is_colour, f64::from),
        DecodingResult::I16(values) => stretched(&values, range, is_colour, f64::from),
        DecodingResult::U32(values) => stretched(&values, range, is_colour, f64::from),
        DecodingResult::I32(values) => stretched(&values, range, is_colour, f64::from),
        DecodingResult::U64(values) => stretched(&values, range, is_colour, |value| value as f64),
        DecodingResult::I64(values) => stretched(&values, range, is_colour, |value| value as f64),
        DecodingResult::F16(values) => stretched(&values, range, is_colour, f64::from),
        DecodingResult::F32(values) => stretched(&values, range, is_colour, f64::from),
        DecodingResult::F64(values) => stretched(&values, range, is_colour, |value| value),
    }
}

fn stretched<T: Copy>(
    values: &[T],
    range: &mut Range,
    is_colour: &dyn Fn(usize) -> bool,
    number: impl Fn(T) -> f64,
) -> Vec<u8> {
    let [least, greatest] = *range.get_or_insert_with(|| {
        let colours = || values.iter().enumerate().filter(|(at, _)| is_colour(*at));
        let finite = || colours().map(|(_, value)| number(*value)).filter(|value| value.is_finite());
        [finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max)]
    });
    let step = if greatest > least { 255.0 / (greatest - least) } else { 0.0 };
    values.iter().map(|value| ((number(*value) - least) * step).round() as u8).collect()
}
