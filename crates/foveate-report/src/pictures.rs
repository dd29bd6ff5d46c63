//! Resizing of pictures.

use std::borrow::Cow;

use crate::draw::Drawing;
use foveate_core::scene::Image;

/// Returns a picture whose longer side has at most `longest` pixels.
pub(super) fn within(image: &Image, longest: usize) -> Cow<'_, Image> {
    let side = image.width().max(image.height());
    if side <= longest {
        return Cow::Borrowed(image);
    }
    let small = |n: usize| (n * longest / side).max(1);
    Cow::Owned(shrunk(image, small(image.width()), small(image.height())))
}

/// Resizes a picture: averages when shrinking, takes the nearest pixel when growing.
pub(super) fn resized(image: &Image, width: usize, height: usize) -> Image {
    if width <= image.width() && height <= image.height() {
        return shrunk(image, width, height);
    }
    let mut page = Drawing::new(width, height, [0; 3]);
    page.paste(image, 0, 0, width, height);
    page.into_image()
}

/// Shrinks a picture: each new pixel is the mean of the whole old pixels under it.
pub fn shrunk(image: &Image, width: usize, height: usize) -> Image {
    let mut data = Vec::with_capacity(width * height * image.planes());
    let span = |i: usize, old: usize, new: usize| i * old / new..((i + 1) * old / new).max(i * old / new + 1);
    let columns: Vec<_> = (0..width).map(|x| span(x, image.width(), width)).collect();
    let mut sums = vec![0u32; image.width()];
    for plane in (0..image.planes()).map(|p| image.plane(p)) {
        for y in 0..height {
            let rows = span(y, image.height(), height);
            sums.fill(0);
            for row in plane[rows.start * image.width()..rows.end * image.width()].chunks_exact(image.width()) {
                sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += u32::from(*value));
            }
            data.extend(columns.iter().map(|columns| {
                let count = (rows.len() * columns.len()) as u32;
                ((sums[columns.clone()].iter().sum::<u32>() + count / 2) / count) as u8
            }));
        }
    }
    Image::new(width, height, image.planes(), data).expect("as many bytes as pixels")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shrinking_keeps_the_mean_and_the_place() {
        let ramp: Vec<u8> = (0..60 * 40).map(|i| (3 * (i % 60)) as u8).collect();
        let small = shrunk(&Image::new(60, 40, 1, ramp).expect("60 x 40"), 20, 10);
        assert!((0..20).all(|x| small.at(0, x, 3) == (9 * x + 3) as u8), "means of three columns");
        let odd = shrunk(&Image::grey(7, 5, 99), 3, 2);
        assert!(odd.bytes().iter().all(|v| *v == 99));
        let size = |image: &Image| (image.width(), image.height());
        assert_eq!(size(&within(&Image::grey(60, 40, 0), 30)), (30, 20));
        assert_eq!(size(&within(&Image::grey(9, 7, 0), 30)), (9, 7));
        assert_eq!(size(&resized(&Image::grey(9, 7, 0), 18, 14)), (18, 14));
    }
}
