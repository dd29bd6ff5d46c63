//! Colour as video codes it: luma and two coarser chroma planes, to red, green, blue and back.
//!
//! Matrix and range are those the stream states. Where it states none, the usual guess of players:
//! BT.709 from 1280 wide or above 576 high, else BT.601, and limited range (16 to 235).
//! Chroma is repeated, not interpolated; colours next to sharp edges differ a little from other programs.

use foveate_core::geometry::Size;
use foveate_core::scene::Image;
use foveate_kernels as kernels;

/// One decoded picture: 8 bits a sample, chroma of half or full size in either direction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Yuv {
    pub width: usize,
    pub height: usize,
    /// Width and height of `u` and `v`: those of the picture, or half of them, rounded up; 0 if grey.
    pub chroma: Size,
    pub y: Vec<u8>,
    pub u: Vec<u8>,
    pub v: Vec<u8>,
}

/// How samples stand for colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Colour {
    /// The weights of red and blue in luma.
    kr: f64,
    kb: f64,
    full_range: bool,
}

impl Colour {
    /// From H.264's matrix coefficients (table E-5), or from the size if they are missing or unspecified.
    pub(crate) fn new(matrix: Option<u16>, full_range: bool, width: usize, height: usize) -> Self {
        let (kr, kb) = match matrix {
            Some(1) => (0.2126, 0.0722),
            Some(5 | 6) => (0.299, 0.114),
            Some(7) => (0.212, 0.087),
            Some(9 | 10) => (0.2627, 0.0593),
            _ if width >= 1280 || height > 576 => (0.2126, 0.0722),
            _ => (0.299, 0.114),
        };
        Self { kr, kb, full_range }
    }

    /// Whether this is BT.709, for the mark in a file written.
    pub(crate) fn is_bt709(&self) -> bool {
        self.kr == 0.2126
    }

    /// Luma offset, and the scale of luma and chroma to 255 levels.
    fn steps(&self) -> (f64, f64, f64) {
        if self.full_range { (0.0, 1.0, 1.0) } else { (16.0, 255.0 / 219.0, 255.0 / 224.0) }
    }
}

impl Yuv {
    /// Whether the lengths of the planes fit their sizes.
    pub(crate) fn is_valid(&self) -> bool {
        let n = self.chroma.width * self.chroma.height;
        let side = |full: usize, part: usize| part == full || part == full.div_ceil(2);
        let coloured = side(self.width, self.chroma.width) && side(self.height, self.chroma.height);
        self.y.len() == self.width * self.height
            && (self.u.len(), self.v.len()) == (n, n)
            && (coloured || self.is_grey())
            && !self.y.is_empty()
    }

    /// Whether it has no chroma planes.
    pub(crate) fn is_grey(&self) -> bool {
        self.chroma == Size::default()
    }

    /// Red, green and blue planes; one plane if grey. Panics if the picture is not valid.
    pub(crate) fn to_rgb(&self, colour: Colour) -> Image {
        assert!(self.is_valid(), "the planes of a decoded picture have the sizes it states");
        let (black, luma, chroma) = colour.steps();
        if self.is_grey() {
            let grey = |y: u8| ((f64::from(y) - black) * luma).round().clamp(0.0, 255.0) as u8;
            let table: Vec<u8> = (0..=255).map(grey).collect();
            let data = self.y.iter().map(|&y| table[usize::from(y)]).collect();
            return Image::new(self.width, self.height, 1, data).expect("one plane of the size of luma");
        }
        let (kr, kb) = (colour.kr, colour.kb);
        let kg = 1.0 - kr - kb;
        let fixed = |x: f64| (x * 65536.0).round() as i32;
        let law = kernels::Decoding {
            gain: fixed(luma),
            offset: 32768 - fixed(luma * black),
            red_v: fixed(2.0 * (1.0 - kr) * chroma),
            green_u: fixed(2.0 * (1.0 - kb) * kb / kg * chroma),
            green_v: fixed(2.0 * (1.0 - kr) * kr / kg * chroma),
            blue_u: fixed(2.0 * (1.0 - kb) * chroma),
        };
        let (width, n) = (self.width, self.width * self.height);
        let down = if self.chroma.height == self.height { 1 } else { 2 };
        let mut data = vec![0; 3 * n];
        let (red, rest) = data.split_at_mut(n);
        let (green, blue) = rest.split_at_mut(n);
        let rows = red.chunks_exact_mut(width).zip(green.chunks_exact_mut(width)).zip(blue.chunks_exact_mut(width));
        for (row, ((red, green), blue)) in rows.enumerate() {
            let y = &self.y[row * width..][..width];
            let uv = [&self.u, &self.v].map(|plane| &plane[row / down * self.chroma.width..][..self.chroma.width]);
            kernels::rgb_of_yuv(y, uv, &law, [red, green, blue]);
        }
        Image::new(width, self.height, 3, data).expect("three planes of the size of luma")
    }

    /// A picture of even sides (the last column and row repeat if a side is odd), half-size chroma, limited range;
    /// grey images have neutral chroma.
    pub(crate) fn from_image(image: &Image, colour: Colour) -> Self {
        let (black, luma, chroma) = colour.steps();
        let (kr, kb) = (colour.kr, colour.kb);
        let fixed = |x: f64| (x * 65536.0).round() as i32;
        let (wr, wb) = (fixed(kr / luma), fixed(kb / luma));
        let wg = fixed(1.0 / luma) - wr - wb;
        let (du, dv) = (0.5 / (1.0 - kb) / chroma, 0.5 / (1.0 - kr) / chroma);
        let (ur, ub) = (fixed(-kr * du), fixed((1.0 - kb) * du));
        let (vr, vb) = (fixed((1.0 - kr) * dv), fixed(-kb * dv));
        let (ug, vg) = (-ur - ub, -vr - vb);
        let black = fixed(black) + 32768;
        let (width, height) = (image.width().next_multiple_of(2), image.height().next_multiple_of(2));
        let (cw, ch) = (width / 2, height / 2);
        let mut out = Self {
            width,
            height,
            chroma: Size::new(cw, ch),
            y: vec![0; width * height],
            u: vec![128; cw * ch],
            v: vec![128; cw * ch],
        };
        let last = image.planes() - 1;
        let planes = [image.plane(0), image.plane(last.min(1)), image.plane(last)];
        let row = |plane: usize, y: usize| &planes[plane][y.min(image.height() - 1) * image.width()..][..image.width()];
        for (y, line) in out.y.chunks_exact_mut(width).enumerate() {
            let shown = &mut line[..image.width()];
            kernels::weighted([row(0, y), row(1, y), row(2, y)], [wr, wg, wb], black, shown);
            line[width - 1] = line[image.width() - 1];
        }
        if image.planes() == 1 {
            return out;
        }
        let middle = (128 << 18) + (1 << 17);
        for (y, (u, v)) in out.u.chunks_exact_mut(cw).zip(out.v.chunks_exact_mut(cw)).enumerate() {
            let rows = [0, 1, 2].map(|plane| [row(plane, 2 * y), row(plane, 2 * y + 1)]);
            kernels::weighted_squares(rows, [ur, ug, ub], middle, u);
            kernels::weighted_squares(rows, [vr, vg, vb], middle, v);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MATRICES: [u16; 4] = [1, 6, 7, 9];

    #[test]
    fn black_white_and_the_primaries_follow_the_standard() {
        // BT.601, limited range: ITU-R BT.601-7, section 2.5.4; red is (81, 90, 240), BT.709's is (63, 102, 240).
        for (matrix, y, u, v) in [(6, 81, 90, 240), (1, 63, 102, 240)] {
            let red = Yuv { width: 2, height: 2, chroma: Size::new(1, 1), y: vec![y; 4], u: vec![u], v: vec![v] };
            let image = red.to_rgb(Colour::new(Some(matrix), false, 2, 2));
            assert!(image.at(0, 1, 1) >= 253 && image.at(1, 1, 1) <= 2 && image.at(2, 1, 1) <= 2);
            let back = Yuv::from_image(&image, Colour::new(Some(matrix), false, 2, 2));
            assert!(back.y[0].abs_diff(y) <= 1 && back.u[0].abs_diff(u) <= 1 && back.v[0].abs_diff(v) <= 1);
        }
        for (full, y, value) in [(false, 16, 0), (false, 235, 255), (true, 0, 0), (true, 255, 255), (false, 255, 255)] {
            let flat = Yuv { width: 2, height: 2, chroma: Size::new(1, 1), y: vec![y; 4], u: vec![128], v: vec![128] };
            let image = flat.to_rgb(Colour::new(None, full, 2, 2));
            assert!(image.bytes().iter().all(|&byte| byte == value), "{y} is {value}, not {:?}", image.bytes());
        }
    }

    /// Every seventh colour, there and back, for each matrix: within 3 of 255 (8-bit limited range has no more).
    #[test]
    fn there_and_back_is_near() {
        for matrix in MATRICES {
            let colour = Colour::new(Some(matrix), false, 2, 2);
            for i in (0..1 << 24).step_by(7 * 1031) {
                let pixel = [i as u8, (i >> 8) as u8, (i >> 16) as u8];
                let image = Image::new(2, 2, 3, pixel.iter().flat_map(|&byte| [byte; 4]).collect()).expect("sizes");
                let back = Yuv::from_image(&image, colour).to_rgb(colour);
                for (a, b) in image.bytes().iter().zip(back.bytes()) {
                    assert!(a.abs_diff(*b) <= 3, "{pixel:?} came back as {:?}", back.bytes());
                }
            }
        }
    }

    #[test]
    fn odd_sides_are_padded_by_repetition() {
        let image = Image::new(3, 1, 1, vec![0, 100, 255]).expect("sizes agree");
        let yuv = Yuv::from_image(&image, Colour::new(None, false, 3, 1));
        assert_eq!((yuv.width, yuv.height, yuv.chroma), (4, 2, Size::new(2, 1)));
        assert_eq!(yuv.y, [16, 102, 235, 235, 16, 102, 235, 235]);
        assert!(yuv.is_valid() && yuv.u == [128, 128]);
    }

    #[test]
    fn full_size_chroma_and_odd_sides_convert() {
        let colour = Colour::new(None, true, 3, 3);
        for chroma in [Size::new(3, 3), Size::new(2, 3), Size::new(2, 2)] {
            let n = chroma.width * chroma.height;
            let yuv = Yuv { width: 3, height: 3, chroma, y: vec![50; 9], u: vec![128; n], v: vec![128; n] };
            assert!(yuv.to_rgb(colour).bytes().iter().all(|&byte| byte == 50));
        }
    }
}
