//! A picture of bytes: one grey plane, or three planes red, green, blue.

use foveate_kernels as kernels;

use crate::{Error, Result};

/// A picture: planar, row-major, one byte a sample. Pixel centres lie at whole coordinates,
/// `(0, 0)` is the centre of the top-left pixel.
#[derive(Clone, PartialEq, Eq)]
pub struct Image {
    width: usize,
    height: usize,
    planes: usize,
    data: Vec<u8>,
}

impl Image {
    /// A picture from planar bytes: `planes` (1 grey, or 3 red, green, blue) of `width × height`.
    pub fn new(width: usize, height: usize, planes: usize, data: Vec<u8>) -> Result<Self> {
        let wanted = width.checked_mul(height).and_then(|n| n.checked_mul(planes));
        if width == 0 || height == 0 || !(planes == 1 || planes == 3) || wanted != Some(data.len()) {
            return Err(Error::Invalid(format!(
                "an image of {width} x {height} with {planes} planes needs {wanted:?} bytes (1 or 3 planes, no empty side), got {}",
                data.len()
            )));
        }
        Ok(Self { width, height, planes, data })
    }
    /// A grey picture of one value. Panics if a side is 0.
    pub fn grey(width: usize, height: usize, value: u8) -> Self {
        assert!(width > 0 && height > 0, "an image needs pixels");
        Self { width, height, planes: 1, data: vec![value; width * height] }
    }
    /// From interleaved red, green, blue bytes.
    pub fn from_rgb8(width: usize, height: usize, interleaved: &[u8]) -> Result<Self> {
        let n = width.saturating_mul(height);
        if interleaved.len() != n.saturating_mul(3) {
            return Err(Error::Invalid(format!(
                "{width} x {height} colour pixels need {} bytes, got {}",
                n.saturating_mul(3),
                interleaved.len()
            )));
        }
        let mut data = vec![0; 3 * n];
        for (i, pixel) in interleaved.chunks_exact(3).enumerate() {
            data[i] = pixel[0];
            data[n + i] = pixel[1];
            data[2 * n + i] = pixel[2];
        }
        Self::new(width, height, 3, data)
    }
    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }
    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }
    /// 1 (grey) or 3 (red, green, blue).
    pub fn planes(&self) -> usize {
        self.planes
    }
    /// The bytes of plane `p`, row-major.
    pub fn plane(&self, p: usize) -> &[u8] {
        &self.data[p * self.width * self.height..][..self.width * self.height]
    }
    /// The bytes of plane `p`, row-major, to write.
    pub fn plane_mut(&mut self, p: usize) -> &mut [u8] {
        let n = self.width * self.height;
        &mut self.data[p * n..][..n]
    }
    /// All bytes, plane after plane.
    pub fn bytes(&self) -> &[u8] {
        &self.data
    }
    /// The value at a pixel of plane `p`.
    pub fn at(&self, p: usize, x: usize, y: usize) -> u8 {
        self.plane(p)[y * self.width + x]
    }
    /// Interleaved red, green, blue bytes, for encoders; grey is repeated.
    pub fn to_rgb8(&self) -> Vec<u8> {
        let last = self.planes - 1;
        let (r, g, b) = (self.plane(0), self.plane(last.min(1)), self.plane(last));
        r.iter().zip(g).zip(b).flat_map(|((&r, &g), &b)| [r, g, b]).collect()
    }
    /// One grey plane: BT.601 luma of a colour picture, a copy of a grey one.
    pub fn to_grey(&self) -> Self {
        if self.planes == 1 {
            return self.clone();
        }
        let mut data = vec![0; self.width * self.height];
        kernels::luma([0, 1, 2].map(|p| self.plane(p)), &mut data);
        Self { width: self.width, height: self.height, planes: 1, data }
    }
}

impl std::fmt::Debug for Image {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Image({} x {} x {})", self.width, self.height, self.planes)
    }
}
