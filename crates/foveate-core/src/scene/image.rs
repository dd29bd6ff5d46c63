//! A picture of bytes: one grey plane, or three planes red, green, blue.

use std::sync::Arc;

use foveate_kernels as kernels;

use crate::geometry::Size;
use foveate_base::{Error, Result};

/// A picture: planar, row-major, one byte a sample. Pixel centres lie at whole coordinates,
/// `(0, 0)` is the centre of the top-left pixel. A clone shares the bytes until one of the two is written to.
#[derive(Clone, PartialEq, Eq)]
pub struct Image {
    width: usize,
    height: usize,
    planes: usize,
    data: Arc<Vec<u8>>,
}

/// How the bytes of a pixel follow each other in other people's buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// One grey byte.
    Grey,
    /// Red, green, blue.
    Rgb,
    /// Blue, green, red, as OpenCV has them.
    Bgr,
    /// Red, green, blue, and a byte that is not read, as canvases have them.
    Rgba,
    /// Blue, green, red, and a byte that is not read.
    Bgra,
}

impl Pixels {
    /// Bytes a pixel, and planes.
    fn layout(self) -> (usize, usize) {
        match self {
            Self::Grey => (1, 1),
            Self::Rgb | Self::Bgr => (3, 3),
            Self::Rgba | Self::Bgra => (4, 3),
        }
    }
}

impl Image {
    /// A picture from planar bytes, without a copy: `planes` (1 grey, or 3 red, green, blue) of `width × height`.
    pub fn new(width: usize, height: usize, planes: usize, data: Vec<u8>) -> Result<Self> {
        let wanted = width.checked_mul(height).and_then(|n| n.checked_mul(planes));
        if width == 0 || height == 0 || !(planes == 1 || planes == 3) || wanted != Some(data.len()) {
            return Err(Error::Invalid(format!(
                "an image of {width} x {height} with {planes} planes needs {wanted:?} bytes (1 or 3 planes, no empty side), got {}",
                data.len()
            )));
        }
        Ok(Self { width, height, planes, data: Arc::new(data) })
    }
    /// A grey picture of one value. Panics if a side is 0.
    pub fn grey(width: usize, height: usize, value: u8) -> Self {
        assert!(width > 0 && height > 0, "an image needs pixels");
        Self { width, height, planes: 1, data: Arc::new(vec![value; width * height]) }
    }
    /// From interleaved red, green, blue bytes without gaps between rows.
    ///
    /// # Errors
    /// As [`Image::from_pixels`].
    pub fn from_rgb8(width: usize, height: usize, interleaved: &[u8]) -> Result<Self> {
        Self::from_pixels(Pixels::Rgb, Size { width, height }, width.saturating_mul(3), interleaved)
    }
    /// From grey bytes without gaps between rows.
    ///
    /// # Errors
    /// As [`Image::from_pixels`].
    pub fn from_grey8(width: usize, height: usize, grey: &[u8]) -> Result<Self> {
        Self::from_pixels(Pixels::Grey, Size { width, height }, width, grey)
    }
    /// Copies interleaved pixels into planes. `stride` is the number of bytes from one row to the next, at least the
    /// length of a row; the last row may end early.
    ///
    /// # Errors
    /// [`Error::Invalid`] if a side is 0, the stride is less than a row, or there are too few bytes.
    pub fn from_pixels(pixels: Pixels, size: Size, stride: usize, bytes: &[u8]) -> Result<Self> {
        let mut image = Self { width: 0, height: 0, planes: 1, data: Arc::default() };
        image.refill(pixels, size, stride, bytes)?;
        Ok(image)
    }
    /// The same into an existing picture; allocates only if its size was another.
    ///
    /// # Errors
    /// As [`Image::from_pixels`]; then nothing has changed.
    pub fn refill(&mut self, pixels: Pixels, size: Size, stride: usize, bytes: &[u8]) -> Result<()> {
        let Size { width, height } = size;
        let (depth, planes) = pixels.layout();
        let row = width.saturating_mul(depth);
        let needed = stride.saturating_mul(height.saturating_sub(1)).saturating_add(row);
        if width == 0 || height == 0 || stride < row || bytes.len() < needed {
            return Err(Error::Invalid(format!(
                "{width} x {height} pixels of {depth} bytes each, {stride} bytes from row to row, need a stride of at least {row}, \
                 {needed} bytes and no empty side; got {} bytes",
                bytes.len()
            )));
        }
        let n = width * height;
        if Arc::get_mut(&mut self.data).is_none() {
            self.data = Arc::default();
        }
        let data = Arc::make_mut(&mut self.data);
        data.resize(n * planes, 0);
        let rows = bytes.chunks(stride).take(height).map(|bytes| &bytes[..row]);
        if depth == 1 {
            data.chunks_exact_mut(width).zip(rows).for_each(|(out, row)| out.copy_from_slice(row));
        } else {
            let (red, rest) = data.split_at_mut(n);
            let (green, blue) = rest.split_at_mut(n);
            for (y, row) in rows.enumerate() {
                let mut planes = [&mut *red, &mut *green, &mut *blue].map(|plane| &mut plane[y * width..][..width]);
                if matches!(pixels, Pixels::Bgr | Pixels::Bgra) {
                    planes.reverse();
                }
                kernels::take_apart(row, depth, planes);
            }
        }
        (self.width, self.height, self.planes) = (width, height, planes);
        Ok(())
    }
    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }
    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }
    /// Width and height in pixels.
    pub fn size(&self) -> Size {
        Size { width: self.width, height: self.height }
    }
    /// 1 (grey) or 3 (red, green, blue).
    pub fn planes(&self) -> usize {
        self.planes
    }
    /// Width, height and planes.
    pub fn shape(&self) -> [usize; 3] {
        [self.width, self.height, self.planes]
    }
    /// The bytes of plane `p`, row-major.
    pub fn plane(&self, p: usize) -> &[u8] {
        &self.data[p * self.width * self.height..][..self.width * self.height]
    }
    /// The bytes of plane `p`, row-major, to write.
    pub fn plane_mut(&mut self, p: usize) -> &mut [u8] {
        let n = self.width * self.height;
        &mut Arc::make_mut(&mut self.data)[p * n..][..n]
    }
    /// All bytes, plane after plane.
    pub fn bytes(&self) -> &[u8] {
        &self.data
    }
    /// The value at a pixel of plane `p`.
    pub fn at(&self, p: usize, x: usize, y: usize) -> u8 {
        self.plane(p)[y * self.width + x]
    }
    /// The part with so many columns and rows from a pixel on; it must be inside.
    pub(crate) fn part(&self, (x, y): (usize, usize), Size { width, height }: Size) -> Self {
        let mut data = Vec::with_capacity(width * height * self.planes);
        for p in 0..self.planes {
            let rows = self.plane(p).chunks_exact(self.width).skip(y).take(height);
            rows.for_each(|row| data.extend_from_slice(&row[x..x + width]));
        }
        Self { width, height, planes: self.planes, data: Arc::new(data) }
    }
    /// Interleaved red, green, blue bytes, for encoders; grey is repeated.
    pub fn to_rgb8(&self) -> Vec<u8> {
        let last = self.planes - 1;
        let (r, g, b) = (self.plane(0), self.plane(last.min(1)), self.plane(last));
        let mut pixels = vec![0; 3 * r.len()];
        for (pixel, ((r, g), b)) in pixels.as_chunks_mut::<3>().0.iter_mut().zip(r.iter().zip(g).zip(b)) {
            *pixel = [*r, *g, *b];
        }
        pixels
    }
    /// One grey plane: BT.601 luma of a colour picture, a copy of a grey one.
    pub fn to_grey(&self) -> Self {
        if self.planes == 1 {
            return self.clone();
        }
        let mut data = vec![0; self.width * self.height];
        kernels::luma([0, 1, 2].map(|p| self.plane(p)), &mut data);
        Self { width: self.width, height: self.height, planes: 1, data: Arc::new(data) }
    }
    /// The same with so many planes, 1 or 3, as the pictures before it had: grey made of colour, or three equal planes of grey.
    pub fn with_planes(self, planes: usize) -> Self {
        match (planes, self.planes) {
            (1, 3) => self.to_grey(),
            (3, 1) => Self { planes: 3, data: Arc::new(self.data.repeat(3)), ..self },
            _ => self,
        }
    }
}

impl std::fmt::Debug for Image {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Image({} x {} x {})", self.width, self.height, self.planes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_layout_and_stride_gives_the_same_planes() {
        let (w, h) = (3, 2);
        let value = |x: usize, y: usize, p: usize| (10 * (y * w + x) + p) as u8;
        for (pixels, depth, order) in [
            (Pixels::Rgb, 3, [0, 1, 2]),
            (Pixels::Bgr, 3, [2, 1, 0]),
            (Pixels::Rgba, 4, [0, 1, 2]),
            (Pixels::Bgra, 4, [2, 1, 0]),
        ] {
            for gap in [0, 5] {
                let stride = w * depth + gap;
                let mut bytes = vec![99; stride * h - gap];
                for (x, y, p) in (0..h).flat_map(|y| (0..w).flat_map(move |x| (0..3).map(move |p| (x, y, p)))) {
                    bytes[y * stride + x * depth + order[p]] = value(x, y, p);
                }
                let image = Image::from_pixels(pixels, Size::new(w, h), stride, &bytes).expect("enough bytes");
                let all = (0..3).flat_map(|p| (0..h).flat_map(move |y| (0..w).map(move |x| (x, y, p))));
                assert!(
                    image.planes() == 3 && all.clone().all(|(x, y, p)| image.at(p, x, y) == value(x, y, p)),
                    "{pixels:?}"
                );
                let short = Image::from_pixels(pixels, Size::new(w, h), stride, &bytes[1..])
                    .expect_err("a byte too few")
                    .to_string();
                assert!(short.contains("3 x 2"), "{short}");
                assert!(Image::from_pixels(pixels, Size::new(w, h), w * depth - 1, &bytes).is_err());
            }
        }
        let grey = Image::from_grey8(2, 2, &[1, 2, 3, 4]).expect("four bytes");
        assert_eq!((grey.planes(), grey.bytes()), (1, &[1, 2, 3, 4][..]));
        assert!(Image::from_grey8(0, 2, &[]).is_err() && Image::from_rgb8(usize::MAX, 2, &[0]).is_err());
    }
}
