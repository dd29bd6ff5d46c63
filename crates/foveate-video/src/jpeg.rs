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

/// Pixels of all scans of a picture together: about three seconds.
const SCANNED: usize = 1 << 30;
/// Scans that a picture of any size may have, and the most of a small one. Encoders write 3 to 12.
const USUAL: usize = 20;
const MOST: usize = 100;

/// The picture, as people see it: grey or colour, its orientation mark applied.
///
/// # Errors
/// A text if the data are damaged or truncated, with or without an end mark, or exceed the memory limit.
pub(crate) fn decode(bytes: &[u8], most: usize) -> Result<DynamicImage, String> {
    let Some((end, scans)) = end_mark(bytes) else {
        let n = bytes.len();
        return Err(format!("the JPEG data is cut off after {n} bytes, before its end mark; copy the file again"));
    };
    let damaged = |error: DecodeErrors| format!("the JPEG data is damaged or unusual ({error}); copy or convert it");
    let mut whole = Vec::with_capacity(end + 2 * ONES + 2);
    whole.extend_from_slice(&bytes[..end]);
    (0..ONES).for_each(|_| whole.extend([0xff, 0]));
    whole.extend([0xff, 0xd9]);
    // Headers may be unusual, as many are; the pixels must be there.
    let lenient = DecoderOptions::default().set_strict_mode(false).set_max_width(most).set_max_height(most);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(whole.as_slice()), lenient);
    decoder.decode_headers().map_err(damaged)?;
    let (width, height) = decoder.dimensions().ok_or("the JPEG data has no picture; copy it again")?;
    memory::check_picture(width, height).map_err(|error| error.to_string())?;
    let most = most_scans(width, height);
    if scans > most {
        return Err(format!(
            "the JPEG data has {scans} scans of {width} x {height} pixels, more than {most}; convert it to fewer"
        ));
    }
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

/// Most scans of a picture of this size: each takes time for every pixel, and needs hardly a byte.
fn most_scans(width: usize, height: usize) -> usize {
    (SCANNED / (width * height).max(1)).clamp(USUAL, MOST)
}

/// Where the end mark is, of the first picture that the bytes have, and how many scans there are before it.
fn end_mark(bytes: &[u8]) -> Option<(usize, usize)> {
    let (mut at, mut scans) = (2, 0);
    while let Some(&[first, mark]) = bytes.get(at..at + 2) {
        scans += usize::from((first, mark) == (0xff, 0xda));
        at += match (first, mark) {
            (0xff, 0xd9) => return Some((at, scans)),
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A grey progressive JPEG: a scan of levels, and so many of coefficients, all 0.
    fn progressive(side: usize, scans: usize) -> Vec<u8> {
        let high = |n: usize| [(n >> 8) as u8, n as u8];
        let segment = |mark: u8, data: &[u8]| [&[0xff, mark][..], &high(data.len() + 2), data].concat();
        let blocks = side.div_ceil(8).pow(2);
        // Codes of one bit: 0 is a level as before; 0 is the end of 16384 to 32767 blocks, whose number follows in 14 bits.
        let table = |kind: u8, symbol: u8| [&[kind, 1][..], &[0; 15], &[symbol]].concat();
        let (mut bits, mut ends) = (vec![], String::new());
        bits.resize(blocks.div_ceil(8), 0u8);
        let mut left = blocks;
        while left > 0 {
            let run = left.min(32767);
            assert!(run >= 16384, "a multiple that the one code can say");
            ends += &format!("0{:014b}", run - 16384);
            left -= run;
        }
        ends += &"1".repeat(ends.len().next_multiple_of(8) - ends.len());
        let ends: Vec<u8> = (0..ends.len())
            .step_by(8)
            .flat_map(|at| {
                let byte = u8::from_str_radix(&ends[at..at + 8], 2).expect("bits");
                if byte == 255 { vec![255, 0] } else { vec![byte] }
            })
            .collect();
        let frame = [&[8][..], &high(side), &high(side), &[1, 1, 0x11, 0]].concat();
        let mut jpeg = [
            &[0xff, 0xd8][..],
            &segment(0xdb, &[[0].as_slice(), &[1; 64]].concat()),
            &segment(0xc2, &frame),
            &segment(0xc4, &table(0, 0)),
            &segment(0xc4, &table(0x10, 0xe0)),
            &segment(0xda, &[1, 1, 0, 0, 0, 0]),
            &bits,
        ]
        .concat();
        for scan in 0..scans {
            jpeg.extend(segment(0xda, &[1, 1, 0, 1, 63, if scan == 0 { 1 } else { 0x10 }]));
            jpeg.extend(&ends);
        }
        jpeg.extend([0xff, 0xd9]);
        jpeg
    }

    #[test]
    fn scans_without_number_are_refused() {
        assert_eq!([most_scans(640, 480), most_scans(4000, 3000), most_scans(16384, 16384)], [100, 89, 20]);
        assert_eq!(decode(&progressive(1100, 19), 16384).expect("a picture").width(), 1100);
        let said = decode(&progressive(8000, 90), 16384).expect_err("too many scans");
        assert!(said.contains("91 scans of 8000 x 8000 pixels, more than 20"), "{said}");
        assert_eq!(decode(&progressive(1100, 101), 16384).err().map(|said| said.contains("more than")), Some(true));
    }
}
