//! Pictures to PNG and JPEG bytes and files.

use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use foveate_base::{Result, files};
use foveate_core::scene::Image;

/// The picture as a PNG file: lossless, grey (1 plane) or colour (3 planes), 8 bits a sample.
///
/// Panics if a side is above 2³² - 1, which no memory holds.
pub fn encode_png(image: &Image) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode(image, PngEncoder::new(&mut bytes));
    bytes
}

/// The picture as a JPEG file, grey or colour; `quality` from 1 (small) to 100 (near lossless), clamped.
///
/// Panics if a side is above 65535, the limit of the format; no frame source gives such pictures.
pub fn encode_jpeg(image: &Image, quality: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode(image, JpegEncoder::new_with_quality(&mut bytes, quality.clamp(1, 100)));
    bytes
}

/// Writes the picture as a PNG file, which is whole or not there.
///
/// # Errors
/// [`foveate_base::Error::Io`] with `path` if it cannot be written.
pub fn save_png(path: impl AsRef<Path>, image: &Image) -> Result<()> {
    files::write(path, &encode_png(image))
}

fn encode(image: &Image, encoder: impl ImageEncoder) {
    let side = |n: usize| u32::try_from(n).expect("the side of an image fits 32 bits");
    let (width, height) = (side(image.width()), side(image.height()));
    match image.planes() {
        1 => encoder.write_image(image.bytes(), width, height, ExtendedColorType::L8),
        _ => encoder.write_image(&image.to_rgb8(), width, height, ExtendedColorType::Rgb8),
    }
    .expect("bytes in memory take any picture whose sides the format can say")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(planes: usize) -> Image {
        let data = (0..planes * 20 * 10).map(|i| (i % 200 + 20) as u8).collect();
        Image::new(20, 10, planes, data).expect("sizes agree")
    }

    #[test]
    fn png_keeps_every_byte_and_the_number_of_planes() {
        for planes in [1, 3] {
            let image = ramp(planes);
            let back = image::load_from_memory(&encode_png(&image)).expect("a PNG");
            assert_eq!(back.color().channel_count() as usize, planes);
            assert_eq!(back.to_rgb8().as_raw(), &image.to_rgb8());
        }
    }

    #[test]
    fn jpeg_is_near() {
        for planes in [1, 3] {
            let image = Image::new(16, 16, planes, vec![120; planes * 256]).expect("sizes agree");
            let back = image::load_from_memory(&encode_jpeg(&image, 95)).expect("a JPEG");
            assert_eq!(back.color().channel_count() as usize, planes);
            assert!(back.to_rgb8().iter().all(|&v| v.abs_diff(120) <= 2));
        }
    }
}
