//! The input of the network: a box and as much around it, in cells that are means of the pixels under them, whatever the size of the box.

use crate::geometry::{Extent, State};
use crate::scene::Image;
use foveate_base::memory::grow;
use foveate_kernels as kernels;

/// Cells along a side, and half of the covered side in half sides of the box.
pub(super) const SIDE: usize = 64;
/// Coarse cells along a side: each is the mean of two by two.
pub(super) const COARSE: usize = SIDE / 2;
const REACH: f64 = 2.0;
/// Red, green, blue.
pub(super) const CHANNELS: usize = 3;
/// Pixels that a cell of a large box is made of along a side, at least; others are left out.
const PIXELS: f64 = 1.5;
/// A constant added to the standard deviation, grey levels.
const SOFT: f32 = 8.0;

/// Buffers of a glimpse, and the glimpse.
#[derive(Clone, Debug, Default)]
pub(super) struct Glimpse {
    across: Vec<(usize, f32)>,
    down: Vec<(usize, f32)>,
    ends: [Vec<usize>; 2],
    row: Vec<f32>,
    /// `SIDE` × `SIDE` × `CHANNELS`, of mean 0, in standard deviations of grey.
    pub values: Vec<f32>,
    /// `COARSE` × `COARSE` × `CHANNELS`, in grey levels.
    pub coarse: Vec<f32>,
    /// The rectangle read of the last picture, if any: left column, top row, width, height.
    pub read: Option<(usize, usize, usize, usize)>,
}

impl Glimpse {
    /// Reads a box. Outside the picture its border is repeated.
    pub(super) fn take(&mut self, image: &Image, state: &State, extent: Extent) {
        let (half_w, half_h) = state.half(extent);
        let Self { across, down, ends: [to_right, to_bottom], row, values, read, coarse } = self;
        let (left, width) = cells(state.x, half_w, image.width(), across, to_right);
        let (top, height) = cells(state.y, half_h, image.height(), down, to_bottom);
        *read = Some((left, top, width, height));
        values.clear();
        values.resize(SIDE * SIDE * CHANNELS, 0.0);
        grow(row, width);
        let row = &mut row[..width];
        for c in 0..CHANNELS {
            let plane = image.plane(c.min(image.planes() - 1));
            let mut from = 0;
            for (y, &to) in to_bottom.iter().enumerate() {
                row.fill(0.0);
                for &(pixel, share) in &down[from..to] {
                    kernels::add_scaled_bytes(share, &plane[pixel * image.width() + left..][..width], row);
                }
                from = to;
                let mut from = 0;
                for (x, &to) in to_right.iter().enumerate() {
                    let parts = across[from..to].iter().map(|&(pixel, share)| share * row[pixel - left]);
                    values[(y * SIDE + x) * CHANNELS + c] = parts.sum();
                    from = to;
                }
            }
        }
        coarsen(values, coarse);
        standardise(values);
    }
}

/// `coarse` ← means over two by two cells.
fn coarsen(cells: &[f32], coarse: &mut Vec<f32>) {
    let across = SIDE * CHANNELS;
    coarse.clear();
    for rows in cells.chunks_exact(2 * across) {
        let (upper, lower) = rows.split_at(across);
        for (a, b) in upper.chunks_exact(2 * CHANNELS).zip(lower.chunks_exact(2 * CHANNELS)) {
            coarse.extend((0..CHANNELS).map(|c| 0.25 * (a[c] + a[c + CHANNELS] + b[c] + b[c + CHANNELS])));
        }
    }
}

/// Where the middle of a coarse cell is along an axis, half sides of the box from its centre.
pub(super) fn place(cell: usize) -> f64 {
    ((cell as f64 + 0.5) / COARSE as f64 * 2.0 - 1.0) * REACH
}

/// The largest half side that is looked at, pixels: more than any picture has.
const LARGEST: f64 = 1e9;

/// Of each cell along an axis the pixels under it and their shares, which sum to 1; the end of each cell's; the first pixel, and how many.
///
/// The weight of a pixel is that of a bilinear read: the part of its hat function over the cell.
fn cells(
    centre: f64,
    half: f64,
    pixels: usize,
    shares: &mut Vec<(usize, f32)>,
    ends: &mut Vec<usize>,
) -> (usize, usize) {
    let last = pixels as f64 - 1.0;
    let size = 2.0 * REACH * half.clamp(1e-9, LARGEST) / SIDE as f64;
    let step = (size / PIXELS).floor().clamp(1.0, 1e12);
    let (size, centre) = (size / step, (centre / step).clamp(-1e9, 1e9));
    shares.clear();
    ends.clear();
    for k in 0..SIDE {
        let from = centre + (k as f64 - 0.5 * SIDE as f64) * size;
        let (first, past) = ((from - 1.0).floor() + 1.0, (from + size + 1.0).ceil());
        for i in 0..(past - first) as usize {
            let at = first + i as f64;
            let share = (hat(from + size - at) - hat(from - at)) / size;
            shares.push(((at * step).clamp(0.0, last) as usize, share as f32));
        }
        ends.push(shares.len());
    }
    let (first, past) = (shares[0].0, shares[shares.len() - 1].0 + 1);
    (first, past - first)
}

/// The integral up to `at` of a hat function over −1 to 1.
fn hat(at: f64) -> f64 {
    let at = at.clamp(-1.0, 1.0);
    if at < 0.0 { 0.5 * (at + 1.0).powi(2) } else { 1.0 - 0.5 * (1.0 - at).powi(2) }
}

/// Mean 0; the standard deviation of grey, about, is 1.
fn standardise(values: &mut [f32]) {
    let (pixels, _) = values.as_chunks::<CHANNELS>();
    let cells = pixels.len() as f32;
    let mean = kernels::sum(values) / values.len() as f32;
    let grey = |[r, g, b]: &[f32; CHANNELS]| (r + g + b) / CHANNELS as f32 - mean;
    let variance = pixels.iter().map(|pixel| grey(pixel).powi(2)).sum::<f32>() / cells;
    let gain = 1.0 / (variance.sqrt() + SOFT);
    values.iter_mut().for_each(|x| *x = (*x - mean) * gain);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BBox;

    fn taken(image: &Image, bbox: BBox) -> Glimpse {
        let mut glimpse = Glimpse::default();
        glimpse.take(image, &State::of(&bbox), Extent::of(&bbox));
        glimpse
    }

    fn picture(width: usize, height: usize, value: impl Fn(usize, usize) -> u8) -> Image {
        let mut image = Image::grey(width, height, 0);
        image.plane_mut(0).iter_mut().enumerate().for_each(|(i, v)| *v = value(i % width, i / width));
        image
    }

    /// A saved tracker may hold a target of any size.
    #[test]
    fn a_box_of_any_size_is_read() {
        let image = picture(64, 48, |x, _| x as u8);
        for log_scale in [-64.0, 0.0, 20.0, 64.0] {
            let bbox = BBox::around(30.0, 20.0, 24.0, 40.0);
            let mut glimpse = Glimpse::default();
            glimpse.take(&image, &State { log_scale, ..State::of(&bbox) }, Extent::of(&bbox));
            assert!(glimpse.values.iter().all(|x| x.is_finite()), "{log_scale}");
        }
    }

    /// A slope stays a slope where no border is in view: cells of any size are where they should be.
    #[test]
    fn cells_lie_where_they_should() {
        let image = picture(256, 256, |x, _| x as u8);
        for bbox in [
            BBox::around(120.0, 120.0, 24.0, 40.0),
            BBox::around(120.3, 119.1, 100.0, 7.0),
            BBox::around(120.0, 120.0, 5.0, 5.0),
        ] {
            let glimpse = taken(&image, bbox);
            // Equal from row to row, equal steps from column to column.
            let at = |x: usize, y: usize| glimpse.values[(y * SIDE + x) * CHANNELS];
            let step = at(1, 0) - at(0, 0);
            for (x, y) in (0..SIDE - 1).flat_map(|x| (0..SIDE).map(move |y| (x, y))) {
                assert!(
                    (at(x + 1, y) - at(x, y) - step).abs() < 2e-2 * step,
                    "{x}, {y}: {} after {}",
                    at(x + 1, y),
                    at(x, y)
                );
            }
            assert!((at(SIDE / 2 - 1, 3) + at(SIDE / 2, 3)).abs() < 1e-3, "the centre is the mean");
            let (left, top, width, height) = glimpse.read.expect("it was looked at");
            let (w, h) = (2.0 * bbox.w, 2.0 * bbox.h);
            assert!((width as f64 - w).abs() < 4.0 && (height as f64 - h).abs() < 4.0, "{:?}", glimpse.read);
            assert!(left + width <= 256 && top + height <= 256);
        }
    }

    #[test]
    fn shares_of_a_cell_sum_to_one() {
        let (mut shares, mut ends) = (vec![], vec![]);
        for (centre, half, pixels) in
            [(10.0, 3.0, 40), (-500.0, 8.0, 20), (1e7, 90.0, 20), (3.3, 1e6, 50), (7.0, 1.0, 9), (0.0, 0.001, 1)]
        {
            let (first, count) = cells(centre, half, pixels, &mut shares, &mut ends);
            assert!(first + count <= pixels && ends.len() == SIDE);
            let mut from = 0;
            for &to in &ends {
                let sum: f32 = shares[from..to].iter().map(|share| share.1).sum();
                assert!((sum - 1.0).abs() < 1e-3 && to - from < 12, "{sum} of {}", to - from);
                from = to;
            }
        }
    }

    /// Light and contrast do not change it, but for the softening.
    #[test]
    fn it_does_not_see_how_light_it_is() {
        let value = |x: usize, y: usize| (x * 7 + y * 13) % 100;
        let plain = taken(&picture(80, 60, |x, y| value(x, y) as u8), BBox::around(40.0, 30.0, 16.0, 12.0));
        let light = taken(&picture(80, 60, |x, y| 50 + 2 * value(x, y) as u8), BBox::around(40.0, 30.0, 16.0, 12.0));
        let flat = taken(&Image::grey(80, 60, 9), BBox::around(40.0, 30.0, 16.0, 12.0));
        let gain = light.values[0] / plain.values[0];
        assert!((1.0..1.5).contains(&gain), "{gain}");
        assert!(plain.values.iter().zip(&light.values).all(|(a, b)| (gain * a - b).abs() < 1e-3));
        assert!(flat.values.iter().all(|x| x.abs() < 1e-4));
    }
}
