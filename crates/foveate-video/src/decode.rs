//! Bytes of picture files to pictures: PNG, JPEG, BMP, WebP, TIFF.

use std::io::Cursor;
use std::path::Path;

use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};

use crate::jpeg;
use crate::tiff::{Range, only_page};
use foveate_base::{Error, Result, files, memory};
use foveate_core::scene::Image;

/// The longest side of a picture that is read, in pixels. A header can claim more than memory holds.
pub const MAX_SIDE: usize = 16384;
/// The greatest height of pictures below each other, in pixels.
const MAX_STACK: usize = 1 << 20;
/// Most bytes of a PNG's rows and texts; a colour profile that unpacks to more is skipped.
const MAX_CHUNKS: u64 = 16 << 20;
/// How many bytes tell the kind of a picture.
pub(super) const KIND: usize = 12;

/// Decodes a picture from the bytes of a PNG, JPEG, BMP, WebP or TIFF file; the content decides which.
///
/// Grey stays one plane, colour becomes three; 16 bits are reduced to 8, transparency is dropped,
/// and a camera's orientation mark is applied, so the picture is as people see it. TIFF of more than 8 bits is stretched: its
/// least value becomes 0, its greatest 255.
///
/// # Errors
/// A text with expectation and finding if the bytes are of another kind, damaged or truncated, have a side above
/// [`MAX_SIDE`], claim more pixels than [`memory::limit`] allows, or have several pages.
pub fn decode_image(bytes: &[u8]) -> std::result::Result<Image, String> {
    decode_next(bytes, &mut None)
}

/// The same for one of several pictures: TIFF is stretched as the first of them was.
pub(crate) fn decode_next(bytes: &[u8], range: &mut Range) -> std::result::Result<Image, String> {
    decode_up_to(bytes, MAX_SIDE, range)
}

/// The same for a picture of this height at most, except for JPEG and TIFF.
fn decode_up_to(bytes: &[u8], height: usize, range: &mut Range) -> std::result::Result<Image, String> {
    let kind = image_kind(bytes).ok_or_else(|| match bytes {
        [] => "the file is empty (0 bytes); expected a picture".to_owned(),
        _ => "expected a PNG, JPEG, BMP, WebP or TIFF picture, found other data; convert it first".to_owned(),
    })?;
    // The decoders answer damage with an error; a panic of theirs must not end the program either.
    let decoded = foveate_base::quiet::catch(|| match kind {
        ImageFormat::Tiff => only_page(bytes, MAX_SIDE, range),
        ImageFormat::Jpeg => planar(&jpeg::decode(bytes, MAX_SIDE)?),
        _ => planar(&other(kind, bytes, height)?),
    });
    let name = name(kind);
    decoded.map_err(|panic| format!("the {name} data is damaged ({panic}); copy the file again"))?
}

/// Reads a picture's file; see [`decode_image`].
///
/// # Errors
/// [`Error::Io`] or [`Error::Malformed`], naming the file.
pub fn read_image(path: impl AsRef<Path>) -> Result<Image> {
    let path = path.as_ref();
    let bytes = files::read(path, files::PICTURE)?;
    decode_image(&bytes).map_err(|problem| Error::malformed(path, problem))
}

/// Reads a PNG file of many pictures below each other, up to 2²⁰ pixels high; otherwise as [`read_image`].
///
/// # Errors
/// [`Error::Io`] or [`Error::Malformed`], naming the file.
pub fn read_stack(path: impl AsRef<Path>) -> Result<Image> {
    let path = path.as_ref();
    let bytes = files::read(path, files::PICTURE)?;
    decode_up_to(&bytes, MAX_STACK, &mut None).map_err(|problem| Error::malformed(path, problem))
}

/// The kind of picture, by the first bytes, of which [`KIND`] suffice.
pub(super) fn image_kind(bytes: &[u8]) -> Option<ImageFormat> {
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => Some(ImageFormat::Png),
        [0xff, 0xd8, 0xff, ..] => Some(ImageFormat::Jpeg),
        [b'B', b'M', _, _, _, _, 0, 0, 0, 0, ..] => Some(ImageFormat::Bmp),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some(ImageFormat::WebP),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Some(ImageFormat::Tiff),
        _ => None,
    }
}

fn name(kind: ImageFormat) -> &'static str {
    match kind {
        ImageFormat::Jpeg => "JPEG",
        ImageFormat::Bmp => "BMP",
        ImageFormat::WebP => "WebP",
        ImageFormat::Tiff => "TIFF",
        _ => "PNG",
    }
}

fn planar(image: &DynamicImage) -> std::result::Result<Image, String> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let image = match image.color() {
        ColorType::L8 | ColorType::La8 | ColorType::L16 | ColorType::La16 => {
            Image::new(width, height, 1, image.to_luma8().into_raw())
        }
        _ => match image.as_rgb8() {
            Some(rgb) => Image::from_rgb8(width, height, rgb.as_raw()),
            None => Image::from_rgb8(width, height, image.to_rgb8().as_raw()),
        },
    };
    image.map_err(|error| error.to_string())
}

fn other(kind: ImageFormat, bytes: &[u8], height: usize) -> std::result::Result<DynamicImage, String> {
    let name = name(kind);
    if kind == ImageFormat::WebP
        && bytes.get(12..16) == Some(b"VP8X")
        && bytes.get(20).is_some_and(|flags| flags & 2 != 0)
    {
        return Err(
            "the file is an animation, whose frames are not read; convert them to pictures or to a video".into()
        );
    }
    let damaged = |error: ImageError| format!("the {name} data is damaged or unusual ({error}); copy or convert it");
    let mut reader = ImageReader::with_format(Cursor::new(bytes), kind);
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE as u32);
    limits.max_image_height = Some(height as u32);
    limits.max_alloc = Some(MAX_CHUNKS);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    memory::check_picture(width as usize, height as usize).map_err(|error| error.to_string())?;
    let orientation = decoder.orientation().map_err(damaged)?;
    let mut image = DynamicImage::from_decoder(decoder).map_err(damaged)?;
    image.apply_orientation(orientation);
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{encode_jpeg, encode_png};
    use foveate_testing::{data, draws, need, skip};

    fn noise(width: usize, height: usize, planes: usize) -> Image {
        let bytes = foveate_testing::noise(7, width * height * planes);
        Image::new(width, height, planes, bytes.collect()).expect("sizes agree")
    }

    #[test]
    fn a_stack_may_be_higher_than_a_picture() {
        let image = Image::grey(2, MAX_SIDE + 1, 7);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("stack.png");
        std::fs::write(&path, encode_png(&image)).expect("a file");
        assert_eq!(read_stack(&path).expect("a stack"), image);
        assert!(read_image(&path).expect_err("too high").to_string().contains("exceeds limit"));
    }

    #[test]
    fn png_comes_back_as_it_was() {
        for planes in [1, 3] {
            let image = noise(13, 7, planes);
            assert_eq!(decode_image(&encode_png(&image)).expect("a PNG"), image);
        }
    }

    #[test]
    fn bmp_and_webp_come_back_as_they_were() {
        let image = noise(13, 7, 3);
        let pixels = DynamicImage::ImageRgb8(image::RgbImage::from_raw(13, 7, image.to_rgb8()).expect("as many bytes"));
        for kind in [ImageFormat::Bmp, ImageFormat::WebP] {
            let mut bytes = Cursor::new(Vec::new());
            pixels.write_to(&mut bytes, kind).expect("memory");
            let mut bytes = bytes.into_inner();
            assert_eq!(decode_image(&bytes), Ok(image.clone()));
            (0..bytes.len() - 12).for_each(|n| assert!(decode_image(&bytes[..n]).is_err(), "{kind:?}: {n} bytes"));
            if kind == ImageFormat::WebP {
                let flags = [10, 0, 0, 0, 2, 0, 0, 0, 12, 0, 0, 6, 0, 0];
                let animated = [&bytes[..12], b"VP8X", &flags].concat();
                assert!(decode_image(&animated).expect_err("frames").contains("animation"));
                continue;
            }
            // Its header claims a width of 2^31 - 1 pixels.
            bytes[18..22].copy_from_slice(&i32::MAX.to_le_bytes());
            assert!(decode_image(&bytes).is_err());
        }
    }

    #[test]
    fn sixteen_bits_and_transparency_are_reduced() {
        let deep = image::ImageBuffer::from_fn(4, 3, |x, y| image::Rgba([257 * (x * 10 + y) as u16, 0, 65535, 1]));
        let mut bytes = Cursor::new(Vec::new());
        DynamicImage::ImageRgba16(deep).write_to(&mut bytes, ImageFormat::Png).expect("memory");
        let image = decode_image(bytes.get_ref()).expect("a PNG");
        assert_eq!((image.planes(), image.at(0, 3, 2), image.at(1, 3, 2), image.at(2, 3, 2)), (3, 32, 0, 255));
        let grey = image::ImageBuffer::from_fn(4, 3, |x, _| image::LumaA([257 * x as u16, 9]));
        let mut bytes = Cursor::new(Vec::new());
        DynamicImage::ImageLumaA16(grey).write_to(&mut bytes, ImageFormat::Png).expect("memory");
        let image = decode_image(bytes.get_ref()).expect("a PNG");
        assert_eq!((image.planes(), image.at(0, 3, 1)), (1, 3));
    }

    #[test]
    fn every_cut_of_a_picture_is_refused() {
        let image = noise(24, 16, 3);
        for bytes in [encode_png(&image), encode_jpeg(&image, 90)] {
            for n in 0..bytes.len() - 12 {
                assert!(decode_image(&bytes[..n]).is_err(), "{n} of {} bytes are not a picture", bytes.len());
            }
        }
    }

    /// The decoder finds missing data by the data, not by the end mark.
    #[test]
    fn a_truncated_jpeg_is_refused() {
        for (planes, quality) in [(1, 90), (3, 90), (3, 30)] {
            for image in [noise(61, 45, planes), Image::new(61, 45, planes, vec![40; 61 * 45 * planes]).expect("bytes")]
            {
                let bytes = encode_jpeg(&image, quality);
                assert!(decode_image(&bytes).is_ok());
                let data = bytes.windows(2).rposition(|mark| mark == [0xff, 0xda]).expect("a scan") + 14;
                // The last byte or two may be bits that fill it up.
                for cut in data..bytes.len() - 4 {
                    let ended = [&bytes[..cut], &[0xff, 0xd9]].concat();
                    let said = decode_image(&ended).expect_err("cut off");
                    assert!(said.contains("expected 61 x 45") && said.contains("copy"), "{cut}: {said}");
                }
            }
        }
    }

    /// In scans after the first: a scan that begins must be whole.
    #[test]
    fn a_truncated_progressive_jpeg_is_refused() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/pictures/progressive.jpg");
        let bytes = need!(std::fs::read(path).map_err(|_| "clone of the repository"));
        let whole = decode_image(&bytes).expect("a picture");
        assert_eq!((whole.width(), whole.height(), whole.planes()), (48, 40, 1));
        let scans = bytes.windows(2).enumerate().filter(|(_, mark)| *mark == [0xff, 0xda]).map(|(at, _)| at);
        let scans: Vec<usize> = scans.chain([bytes.len() - 2]).collect();
        for scan in scans.windows(2) {
            for cut in scan[0] + 10..scan[1] - 2 {
                assert!(decode_image(&[&bytes[..cut], &[0xff, 0xd9]].concat()).is_err(), "{cut}");
            }
        }
    }

    /// 600 damaged pictures, seed 7, and 100 damaged photographs where they are: an error or a picture, never a panic.
    #[test]
    fn damaged_pictures_do_not_panic() {
        let mut goods = Vec::new();
        for planes in [1, 3] {
            let image = noise(40, 30, planes);
            goods.extend([encode_png(&image), encode_jpeg(&image, 80)].map(|bytes| (bytes, 150)));
        }
        match data("natural") {
            Ok(folder) => {
                let files = crate::image_files(folder).expect("pictures");
                goods.extend(files.iter().take(5).map(|file| (std::fs::read(file).expect("a file"), 20)));
            }
            Err(missing) => skip(&missing),
        }
        let mut next = draws(7);
        for (good, n) in goods {
            assert!(decode_image(&good).is_ok());
            for _ in 0..n {
                let mut bytes = good.clone();
                for _ in 0..1 + next(8) {
                    let at = next(bytes.len());
                    bytes[at] ^= 1 << next(8);
                }
                bytes.truncate(bytes.len() - next(2) * next(bytes.len()));
                let _ = decode_image(&bytes);
            }
        }
    }
}
