//! Pictures turned upright.

use foveate_core::scene::Image;

/// The image turned clockwise by quarter turns, 0 to 3; 4 more if left and right are exchanged before.
pub(crate) fn turned(image: Image, turns: u8) -> Image {
    if turns == 0 {
        return image;
    }
    let (w, h) = (image.width(), image.height());
    let (width, height) = if turns % 2 == 1 { (h, w) } else { (w, h) };
    let mut data = Vec::with_capacity(image.bytes().len());
    for p in 0..image.planes() {
        let plane = image.plane(p);
        for y in 0..height {
            data.extend((0..width).map(|x| {
                let (column, row) = match turns % 4 {
                    0 => (x, y),
                    1 => (y, h - 1 - x),
                    2 => (w - 1 - x, h - 1 - y),
                    _ => (w - 1 - y, x),
                };
                plane[row * w + if turns < 4 { column } else { w - 1 - column }]
            }));
        }
    }
    Image::new(width, height, image.planes(), data).expect("as many pixels as before")
}
