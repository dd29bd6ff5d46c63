//! A grid of numbers over a picture, such as motion or saliency.

use foveate_kernels as kernels;

use crate::scene::Image;
use foveate_base::memory::grow;

/// Values on a grid of square cells that covers a picture from its top-left corner; row-major, f32.
///
/// Cell `(i, j)` covers the pixels from `cell · i` to `cell · (i + 1) − 1` across, and likewise down; its centre lies at
/// image coordinate `cell · (i + ½) − ½`. The last column and row may reach past the picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Map {
    width: usize,
    height: usize,
    cell: usize,
    values: Vec<f32>,
}

impl Map {
    /// Zeros over a picture of `width × height` pixels, in cells of `cell` pixels. A cell of 0 is taken as 1.
    pub fn over(width: usize, height: usize, cell: usize) -> Self {
        let mut map = Self::default();
        map.cover(width, height, cell);
        map
    }
    /// Makes this map one of zeros over a picture, keeping its memory.
    pub fn cover(&mut self, width: usize, height: usize, cell: usize) {
        let cell = cell.max(1);
        self.resize(width.div_ceil(cell), height.div_ceil(cell), cell);
        self.values.fill(0.0);
    }
    /// Makes this map one of zeros with the cells of another, keeping its memory.
    pub(super) fn like(&mut self, other: &Self) {
        self.resize(other.width, other.height, other.cell);
        self.values.fill(0.0);
    }
    /// Sets the number of cells; values are kept as far as they go and mean nothing.
    fn resize(&mut self, width: usize, height: usize, cell: usize) {
        (self.width, self.height, self.cell) = (width, height, cell);
        self.values.resize(width * height, 0.0);
    }
    /// Number of columns.
    pub fn width(&self) -> usize {
        self.width
    }
    /// Number of rows.
    pub fn height(&self) -> usize {
        self.height
    }
    /// Side of a cell in pixels.
    pub fn cell(&self) -> usize {
        self.cell
    }
    /// All values, row after row.
    pub fn values(&self) -> &[f32] {
        &self.values
    }
    /// All values, row after row, to write.
    pub fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }
    /// The value of cell `(i, j)`. Panics outside the grid.
    pub fn at(&self, i: usize, j: usize) -> f32 {
        self.values[j * self.width + i]
    }
    /// The bilinear value at grid coordinates (cell centres at integers), the edge's value outside. 0 if the map is
    /// empty.
    pub fn between(&self, u: f32, v: f32) -> f32 {
        if self.values.is_empty() {
            return 0.0;
        }
        let (u, v) = (u.clamp(0.0, (self.width - 1) as f32), v.clamp(0.0, (self.height - 1) as f32));
        let (i, j) = (u as usize, v as usize);
        let (fu, fv) = (u - i as f32, v - j as f32);
        let right = usize::from(i + 1 < self.width);
        let down = if j + 1 < self.height { self.width } else { 0 };
        let k = j * self.width + i;
        let (top, low) =
            ([self.values[k], self.values[k + right]], [self.values[k + down], self.values[k + down + right]]);
        let across = |[a, b]: [f32; 2]| a + fu * (b - a);
        across(top) + fv * (across(low) - across(top))
    }
    /// The value at image coordinates, bilinear between cells.
    pub fn at_pixel(&self, x: f32, y: f32) -> f32 {
        let cell = self.cell as f32;
        self.between((x + 0.5) / cell - 0.5, (y + 0.5) / cell - 0.5)
    }
    /// The largest value, at least 0.
    pub fn max(&self) -> f32 {
        self.values.iter().fold(0.0, |a, &b| a.max(b))
    }
    /// The image coordinates of the centre of the cell with the largest value; of the first one among equals.
    pub fn peak(&self) -> (f64, f64) {
        let best = (0..self.values.len()).fold(0, |a, b| if self.values[b] > self.values[a] { b } else { a });
        let centre = |i: usize| self.cell as f64 * (i as f64 + 0.5) - 0.5;
        (centre(best % self.width.max(1)), centre(best / self.width.max(1)))
    }
    /// Red, green and blue of a picture as values of 0 to 1 in one map of their mean: its intensity.
    pub(super) fn intensity(&mut self, image: &Image) {
        self.resize(image.width(), image.height(), 1);
        let last = image.planes() - 1;
        kernels::intensity([0, last.min(1), last].map(|p| image.plane(p)), &mut self.values);
    }
    /// The same at half the resolution, as [`Map::halve`] makes it.
    pub(super) fn half_intensity(&mut self, image: &Image, sums: &mut Vec<u16>) {
        self.resize(image.width().div_ceil(2), image.height().div_ceil(2), 2);
        let last = image.planes() - 1;
        let planes = [0, last.min(1), last].map(|p| image.plane(p));
        sums.resize(image.width(), 0);
        kernels::half_intensity(planes, image.width(), sums, &mut self.values);
    }
    /// Means of the same over squares of `side` pixels, of two of their rows.
    pub(super) fn square_intensity(&mut self, image: &Image, side: usize, sums: &mut Vec<u16>) {
        self.resize(image.width().div_ceil(side), image.height().div_ceil(side), side);
        let last = image.planes() - 1;
        let planes = [0, last.min(1), last].map(|p| image.plane(p));
        sums.resize(image.width(), 0);
        kernels::square_intensity(planes, image.width(), side, 2, sums, &mut self.values);
    }
    /// This map at half the resolution: [1 3 3 1] / 8 across and down, then every second one. The kernel is even, so cells
    /// of the result cover exactly two of these.
    pub(super) fn halve(&self, across: &mut Vec<f32>, to: &mut Self) {
        let (w, h) = (self.width, self.height);
        to.resize(w.div_ceil(2), h.div_ceil(2), 2 * self.cell);
        // It serves every level of every picture.
        grow(across, to.width * h);
        kernels::halve(&self.values, w, &mut across[..to.width * h], &mut to.values);
    }
    /// The map as a grey picture of its own size, to look at: 0 is black, the largest value white, negative ones black.
    ///
    /// An empty map gives one black pixel.
    pub fn picture(&self) -> Image {
        let scale = 255.0 / self.max().max(f32::MIN_POSITIVE);
        let bytes = self.values.iter().map(|v| (v * scale).round() as u8).collect();
        Image::new(self.width, self.height, 1, bytes).unwrap_or_else(|_| Image::grey(1, 1, 0))
    }
    /// Whether this map covers a frame.
    pub fn covers(&self, image: &Image) -> bool {
        let side = |pixels: usize| pixels.div_ceil(self.cell.max(1));
        (self.width, self.height) == (side(image.width()), side(image.height()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_lie_where_they_say() {
        // A ramp in x + 10 y, halved: inner cells hold the ramp at their centres, exactly, for the kernel keeps lines.
        let mut ramp = Map::over(33, 20, 1);
        for (k, value) in ramp.values_mut().iter_mut().enumerate() {
            *value = (k % 33) as f32 + 10.0 * (k / 33) as f32;
        }
        assert_eq!(ramp.at_pixel(4.25, 7.5), 4.25 + 75.0);
        let (mut half, mut quarter, mut scratch) = (Map::default(), Map::default(), vec![]);
        ramp.halve(&mut scratch, &mut half);
        half.halve(&mut scratch, &mut quarter);
        assert_eq!((half.width(), half.height(), half.cell()), (17, 10, 2));
        assert_eq!((quarter.width(), quarter.height(), quarter.cell()), (9, 5, 4));
        for map in [&half, &quarter] {
            assert!((map.at_pixel(14.0, 9.0) - 104.0).abs() < 1e-4);
        }
    }

    #[test]
    fn a_map_can_be_looked_at() {
        let mut map = Map::over(7, 5, 2);
        map.values_mut()[5] = 4.0;
        map.values_mut()[6] = 1.0;
        map.values_mut()[0] = -3.0;
        let picture = map.picture();
        assert_eq!((picture.width(), picture.height()), (4, 3));
        assert_eq!((picture.at(0, 1, 1), picture.at(0, 2, 1), picture.at(0, 0, 0)), (255, 64, 0));
        assert_eq!(map.peak(), (2.5, 2.5));
        assert_eq!((Map::default().picture().width(), Map::default().at_pixel(3.0, 2.0)), (1, 0.0));
    }
}
