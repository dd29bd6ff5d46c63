//! Pictures of hidden units: their weights drawn on the retina's cells.

use foveate_base::Result;
use foveate_base::rows::Rows;
use foveate_core::identity::retina::Cell;
use foveate_core::scene::Image;

/// Minimum side of one unit's tile, pixels.
const TILE: usize = 48;

/// Draws a grey picture of the first `most` columns of `weights` (n_v × n_h), one per hidden unit, in a grid; 128 for weight 0, each unit
/// on its own scale from −max to max. Cells of further channels are drawn beside the grey ones. Fails if there are not as many cells as
/// visible units.
pub fn picture(weights: Rows<'_>, cells: &[Cell], most: usize) -> Result<Image> {
    let (n_v, n_h) = (weights.len(), weights.width());
    if cells.len() != n_v {
        return Err(foveate_base::Error::Invalid(format!(
            "{n_v} visible units cannot be drawn on {} cells",
            cells.len()
        )));
    }
    let reach = cells.iter().map(|c| c.u.abs().max(c.v.abs()) + c.half).fold(0.0, f64::max);
    let finest = cells.iter().map(|c| c.half).fold(f64::INFINITY, f64::min);
    // A whole number of pixels per finest cell.
    let across = (reach / finest).round().max(1.0) as usize;
    let side = across * TILE.div_ceil(across);
    let channels = 1 + cells.iter().map(|c| c.channel).max().unwrap_or(0);
    let n = n_h.min(most).max(1);
    let (width, height) = (channels * side + 2, side + 2);
    let columns = ((n * height) as f64 / width as f64).sqrt().ceil().max(1.0) as usize;
    let columns = columns.min(n);
    let mut image = Image::grey(columns * width + 2, n.div_ceil(columns) * height + 2, 0);
    let stride = image.width();
    let plane = image.plane_mut(0);
    let mut order: Vec<usize> = (0..n_v).collect();
    order.sort_by(|&a, &b| cells[b].half.total_cmp(&cells[a].half));
    for unit in 0..n.min(n_h) {
        let (left, top) = (2 + unit % columns * width, 2 + unit / columns * height);
        let weight = |i: usize| f64::from(weights.row(i)[unit]);
        let largest = (0..n_v).map(|i| weight(i).abs()).fold(f64::MIN_POSITIVE, f64::max);
        (0..side).for_each(|y| plane[(top + y) * stride + left..][..channels * side].fill(128));
        for &i in &order {
            let Cell { u, v, half, channel } = cells[i];
            let grey = (127.5 + 127.5 * weight(i) / largest).round() as u8;
            let pixel = |x: f64| (((x + reach) / (2.0 * reach) * side as f64).round() as usize).min(side);
            let (x0, x1) = (channel * side + pixel(u - half), channel * side + pixel(u + half));
            for y in pixel(v - half)..pixel(v + half) {
                plane[(top + y) * stride + left + x0..][..x1 - x0].fill(grey);
            }
        }
    }
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::identity::retina::{Foveal, FovealConfig, Retina};

    #[test]
    fn weights_land_on_their_cells() {
        let retina = Foveal::new(FovealConfig::authors()).expect("the authors' geometry");
        // Unit 0 likes the first cell of the fovea, unit 1 dislikes the last of the outer ring.
        let mut weights = vec![0.0; 132 * 2];
        (weights[0], weights[131 * 2 + 1]) = (0.5, -2.0);
        let weights = Rows::new(&weights, 2);
        let image = picture(weights, retina.cells(), 100).expect("as many cells as units");
        // The window is 24 template pixels in tiles of 48: two pixels to one; the fovea begins at 8.
        assert_eq!((image.width(), image.height()), (2 * 50 + 2, 52));
        assert_eq!(
            [image.at(0, 2 + 16, 2 + 16), image.at(0, 2 + 17, 2 + 17), image.at(0, 2 + 18, 2 + 16)],
            [255, 255, 128]
        );
        assert_eq!(
            [image.at(0, 52 + 47, 2 + 47), image.at(0, 52 + 40, 2 + 40), image.at(0, 52 + 39, 2 + 47)],
            [0, 0, 128]
        );
        assert!(picture(weights, &retina.cells()[1..], 100).is_err());
    }
}
