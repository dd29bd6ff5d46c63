//! A glimpse as a picture, cell by cell.

use foveate_core::identity::Retina;
use foveate_core::identity::retina::Cell;
use foveate_core::scene::Image;

/// Maximum number of smallest cells along a side that are drawn individually.
const MOST: usize = 256;

/// Returns half the sides of a retina's windows in template units, innermost first, by the sizes of its grey cells.
pub(super) fn windows(retina: &dyn Retina) -> Vec<f64> {
    let mut windows: Vec<(f64, f64)> = vec![];
    for cell in retina.cells().iter().filter(|c| c.channel == 0) {
        let reach = cell.u.abs().max(cell.v.abs()) + cell.half;
        match windows.iter_mut().find(|w| w.0 == cell.half) {
            Some(window) => window.1 = window.1.max(reach),
            None => windows.push((cell.half, reach)),
        }
    }
    windows.sort_by(|a, b| a.1.total_cmp(&b.1));
    windows.into_iter().map(|w| w.1).collect()
}

/// The cell of a retina at each pixel of a raster of its smallest cells.
#[derive(Clone, Debug)]
pub(super) struct Eye {
    side: usize,
    /// For grey, red − green and blue − yellow: the cell at each pixel.
    maps: [Vec<Option<usize>>; 3],
}

impl Eye {
    /// Returns `None` for a retina without cells.
    pub(crate) fn new(retina: &dyn Retina) -> Option<Self> {
        let cells = retina.cells();
        let reach = cells.iter().map(|c| c.u.abs().max(c.v.abs()) + c.half).fold(0.0, f64::max);
        let finest = cells.iter().map(|c| c.half).fold(f64::INFINITY, f64::min);
        let side = ((reach / finest).round() as usize).clamp(1, MOST);
        let mut eye = Self { side, maps: [(); 3].map(|()| vec![None; side * side]) };
        for (i, cell) in cells.iter().enumerate().filter(|(_, c)| c.channel < 3) {
            let pixel = |x: f64| (((x + reach) / (2.0 * reach) * side as f64).round().max(0.0) as usize).min(side);
            let Cell { u, v, half, channel } = *cell;
            for y in pixel(v - half)..pixel(v + half) {
                eye.maps[channel][y * side..][pixel(u - half)..pixel(u + half)].fill(Some(i));
            }
        }
        (!cells.is_empty()).then_some(eye)
    }

    /// Draws a glimpse, one pixel for each smallest cell; black where the retina has no grey cell.
    pub(crate) fn picture(&self, glimpse: &[f32]) -> Image {
        let mut rgb = Vec::with_capacity(3 * self.side * self.side);
        for i in 0..self.side * self.side {
            let value = |channel: usize| self.maps[channel][i].and_then(|cell| glimpse.get(cell)).copied();
            // Grey is BT.601 luma; the other channels are (red − green) / 2 and (2 blue − red − green) / 4 around one half, as in the
            // pyramid. These are three equations for red, green and blue.
            let (grey, a, b) =
                (value(0).unwrap_or(0.0), 2.0 * (value(1).unwrap_or(0.5) - 0.5), 4.0 * (value(2).unwrap_or(0.5) - 0.5));
            let green = grey - 0.356 * a - 0.057 * b;
            rgb.extend([green + a, green, (b + a) / 2.0 + green].map(|v| (255.0 * v).round() as u8));
        }
        Image::from_rgb8(self.side, self.side, &rgb).expect("three bytes a pixel")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::identity::Foveal;
    use foveate_core::identity::retina::FovealConfig;

    #[test]
    fn every_pixel_shows_its_cell() {
        let retina = Foveal::new(FovealConfig::authors()).expect("the authors' geometry");
        let eye = Eye::new(&retina).expect("it has cells");
        assert_eq!(eye.side, 24);
        let glimpse: Vec<f32> = (0..132).map(|i| i as f32 / 131.0).collect();
        let picture = eye.picture(&glimpse);
        let value = |cell: usize| (255.0 * glimpse[cell]).round() as u8;
        assert_eq!(picture.at(0, 8, 8), value(0), "the fovea begins in the middle");
        assert_eq!(picture.at(1, 4, 4), value(64), "the first cell of the second ring, at its corner");
        assert_eq!(picture.at(2, 23, 23), value(131));
        let count = |cell: usize| eye.maps[0].iter().filter(|c| **c == Some(cell)).count();
        assert_eq!([count(0), count(64), count(131)], [1, 4, 16]);
    }

    #[test]
    fn colour_comes_back_from_the_opponent_channels() {
        let config = FovealConfig { side: 28.0, rings: vec![[8, 4]], colour: vec![[8, 4]] };
        let retina = Foveal::new(config).expect("two by two cells of each channel");
        let (r, g, b) = (200.0f32, 120.0, 40.0);
        let grey = 0.299 * r + 0.587 * g + 0.114 * b;
        let values = [grey, (r - g) / 2.0 + 127.5, (2.0 * b - r - g) / 4.0 + 127.5].map(|v| v / 255.0);
        let glimpse: Vec<f32> = retina.cells().iter().map(|c| values[c.channel]).collect();
        let picture = Eye::new(&retina).expect("it has cells").picture(&glimpse);
        for (p, want) in [200u8, 120, 40].into_iter().enumerate() {
            assert!(picture.at(p, 1, 0).abs_diff(want) <= 1, "{} should be {want}", picture.at(p, 1, 0));
        }
    }
}
