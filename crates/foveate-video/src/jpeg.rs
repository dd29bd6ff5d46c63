//! JPEG bytes to pictures, and whether all of the picture is there.
//!
//! JPEG decoders are lenient: missing data silently become zeros, then grey. This module inserts ones before the end
//! mark. No Huffman code consists of ones alone, so a decoder that reads past the end of a truncated picture fails; a
//! decoder of a complete picture never reads that far.

use image::metadata::Orientation;
use image::{DynamicImage, GrayImage, RgbImage};
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use foveate_base::memory;

/// Bytes of ones, as they are written: the decoder reads eight bytes ahead, and a code and its value have 32 bits at most.
const ONES: usize = 16;

/// The picture, as people see it: grey or colour, its orientation mark applied.
///
/// # Errors
/// A text if the data are damaged or truncated, with or without an end mark, or exceed the memory limit.
pub(crate) fn decode(bytes: &[u8], most: usize) -> Result<DynamicImage, String> {
    let Some(end) = end_mark(bytes) else {
        let n = bytes.len();
        return Err(format!("the JPEG data is cut off after {n} bytes, before its end mark; copy the file again"));
    };
    let damaged = |error: DecodeErrors| format!("the JPEG data is damaged or unusual ({error}); copy or convert it");
    let mut whole = Vec::with_capacity(end + 2 * ONES + 2);
    whole.extend_from_slice(&bytes[..end]);
    (0..ONES).for_each(|_| whole.extend([0xff, 0]));
    whole.extend([0xff, 0xd9]);
    // Headers may be odd, as many are; the pixels are to be there.
    let lenient = DecoderOptions::default().set_strict_mode(false).set_max_width(most).set_max_height(most);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(whole.as_slice()), lenient);
    decoder.decode_headers().map_err(damaged)?;
    let (width, height) = decoder.dimensions().ok_or("the JPEG data has no picture; copy it again")?;
    memory::check_picture(width, height).map_err(|error| error.to_string())?;
    let grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
    let colours = if grey { ColorSpace::Luma } else { ColorSpace::RGB };
    decoder.set_options(lenient.set_strict_mode(true).jpeg_set_out_colorspace(colours));
    let mut pixels = vec![0; width * height * colours.num_components()];
    decoder.decode_into(&mut pixels).map_err(|error| {
        format!(
            "expected {width} x {height} pixels of JPEG data, found less before its end mark, or damage ({error}); copy the file \
             again, or convert it"
        )
    })?;
    let (w, h) = (width as u32, height as u32);
    let image = match grey {
        true => GrayImage::from_raw(w, h, pixels).map(DynamicImage::from),
        false => RgbImage::from_raw(w, h, pixels).map(DynamicImage::from),
    };
    let mut image = image.ok_or("the JPEG data has another size than its header; copy it again")?;
    if let Some(orientation) = decoder.exif().and_then(|exif| Orientation::from_exif_chunk(exif)) {
        image.apply_orientation(orientation);
    }
    Ok(image)
}

/// Where the end mark is, of the first picture that the bytes have.
fn end_mark(bytes: &[u8]) -> Option<usize> {
    let mut at = 2;
    while let Some(&[first, mark]) = bytes.get(at..at + 2) {
        at += match (first, mark) {
            (0xff, 0xd9) => return Some(at),
            // Entropy-coded bytes, fill bytes, and marks without a length.
            (0xff, 0x00 | 0x01 | 0xd0..=0xd8) => 2,
            (0xff, 0xff) => 1,
            (0xff, _) => match bytes.get(at + 2..at + 4) {
                Some(&[high, low]) => 2 + usize::from(high) * 256 + usize::from(low),
                _ => return None,
            },
            _ => 1,
        };
    }
    None
}
