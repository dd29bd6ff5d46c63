//! The retina: a glimpse sharp at the gaze and coarse around it (section 2.1; Larochelle & Hinton 2010).
//!
//! A glimpse is a list of square cells. Each value is the mean of the image over the cell's footprint, read as
//! one bilinear tap from a [`Pyramid`] level whose box means match the footprint. The template's box is `side` ×
//! `side` template pixels; rings are windows around the gaze, in template pixels, each without the one inside it.
//! The authors' geometry is `side = 28`, windows of 8, 16, 24 in cells of 1, 2, 4: 64 + 48 + 20 = 132 values.

use serde::{Deserialize, Serialize};
use std::sync::Arc;

use super::footprint::Footprint;
use super::pyramid::Pyramid;
use crate::geometry::{Fixation, Gaze};
use foveate_base::rows::RowsMut;
use foveate_base::{Error, Result};

/// One cell of a retina, in template units relative to the gaze.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Centre across.
    pub u: f64,
    /// Centre down.
    pub v: f64,
    /// Half its side.
    pub half: f64,
    /// Which of the pyramid's channels it reads: 0 is grey.
    pub channel: usize,
}

/// From a fixation on the image to the values of a glimpse.
///
/// A glimpse must depend on the pyramid and the fixation alone.
pub trait Retina: Send + Sync {
    /// Number of values in a glimpse.
    fn glimpse_len(&self) -> usize;
    /// Where each value comes from, in order.
    fn cells(&self) -> &[Cell];
    /// The footprints a pyramid must hold for this retina, in template units (sides of cells), one for each level,
    /// and the channel each level averages.
    fn footprints(&self) -> &[Footprint];
    /// The same cells about another gaze: the new retina at the centre reads the cells of this one at that gaze.
    fn about(&self, gaze: Gaze) -> Arc<dyn Retina>;
    /// Reads a glimpse at each fixation, one a row.
    fn look_each(&self, pyramid: &Pyramid, at: &[Fixation], glimpses: RowsMut<'_>);
    /// Reads one glimpse.
    fn look(&self, pyramid: &Pyramid, at: Fixation, glimpse: &mut [f32]) {
        self.look_each(pyramid, &[at], RowsMut::new(glimpse, self.glimpse_len()));
    }
}

/// Geometry of a foveal retina, as a config file or a model's metadata has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FovealConfig {
    /// Template pixels along a side of the target's box.
    pub side: f64,
    /// Windows from the inside out, in template pixels.
    pub rings: Vec<[usize; 2]>,
    /// Windows of the colour opponent channels (red − green, blue − yellow).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub colour: Vec<[usize; 2]>,
}

impl FovealConfig {
    /// The authors' 132 values.
    pub fn authors() -> Self {
        Self { side: 28.0, rings: vec![[8, 1], [16, 2], [24, 4]], colour: vec![] }
    }
}

/// Concentric windows with coarser cells outside.
#[derive(Clone, Debug)]
pub struct Foveal {
    config: FovealConfig,
    cells: Vec<Cell>,
    footprints: Vec<Footprint>,
    /// Per level: its range of cells.
    ranges: Vec<std::ops::Range<usize>>,
    du: Vec<f32>,
    dv: Vec<f32>,
}

impl Foveal {
    /// The channel of each cell, in the order of a glimpse.
    pub fn channels(&self) -> Vec<usize> {
        self.cells.iter().map(|cell| cell.channel).collect()
    }

    /// Lays out the cells. Fails if a window is not a whole number of cells, or not wider than the one inside it.
    pub fn new(config: FovealConfig) -> Result<Self> {
        if !(1.0..=1e4).contains(&config.side) {
            return Err(Error::Config(format!("retina.side must be 1 to 10000 template pixels, got {}", config.side)));
        }
        if config.rings.is_empty() {
            return Err(Error::Config(
                "retina.rings is empty: give at least one [window, cell], such as [8, 1]".into(),
            ));
        }
        let unit = 2.0 / config.side;
        let mut retina =
            Self { config: config.clone(), cells: vec![], footprints: vec![], ranges: vec![], du: vec![], dv: vec![] };
        let mut inner = 0;
        for &[window, cell] in &config.rings {
            retina.ring("retina.rings", inner, window, cell, unit, 0)?;
            inner = window;
        }
        for channel in 1..=2 {
            let mut inner = 0;
            for &[window, cell] in &config.colour {
                retina.ring("retina.colour", inner, window, cell, unit, channel)?;
                inner = window;
            }
        }
        retina.lay();
        Ok(retina)
    }

    fn lay(&mut self) {
        self.du = self.cells.iter().map(|c| c.u as f32).collect();
        self.dv = self.cells.iter().map(|c| c.v as f32).collect();
    }

    /// The geometry it was made from.
    pub fn config(&self) -> &FovealConfig {
        &self.config
    }

    fn ring(&mut self, key: &str, inner: usize, window: usize, cell: usize, unit: f64, channel: usize) -> Result<()> {
        let whole = cell > 0 && window.is_multiple_of(cell) && inner.is_multiple_of(cell);
        let centred = cell > 0 && (window / cell) % 2 == (inner / cell) % 2 || inner == 0;
        if !whole || !centred || window <= inner || window > 1024 {
            return Err(Error::Config(format!(
                "{key} has [{window}, {cell}] around a window of {inner}: a window must be wider than the one inside it \
                 (at most 1024), both whole numbers of cells, with the inner one in the middle; for example [8, 1], [16, 2], [24, 4]"
            )));
        }
        let n = window / cell;
        let hole = (n - inner / cell) / 2..(n + inner / cell) / 2;
        let start = self.cells.len();
        for row in 0..n {
            for column in 0..n {
                if hole.contains(&row) && hole.contains(&column) {
                    continue;
                }
                let at = |i: usize| (i as f64 - (n - 1) as f64 / 2.0) * cell as f64 * unit;
                let half = cell as f64 * unit / 2.0;
                self.cells.push(Cell { u: at(column), v: at(row), half, channel });
            }
        }
        self.ranges.push(start..self.cells.len());
        let reach = (n - 1) as f64 / 2.0 * cell as f64 * unit;
        self.footprints.push(Footprint { side: cell as f64 * unit, channel, reach });
        Ok(())
    }
}

impl Retina for Foveal {
    fn glimpse_len(&self) -> usize {
        self.cells.len()
    }
    fn cells(&self) -> &[Cell] {
        &self.cells
    }
    fn footprints(&self) -> &[Footprint] {
        &self.footprints
    }
    fn about(&self, gaze: Gaze) -> Arc<dyn Retina> {
        let mut moved = self.clone();
        moved.cells.iter_mut().for_each(|cell| (cell.u, cell.v) = (cell.u + gaze.u, cell.v + gaze.v));
        moved.footprints.iter_mut().for_each(|it| it.reach += gaze.u.abs().max(gaze.v.abs()));
        moved.lay();
        Arc::new(moved)
    }
    fn look_each(&self, pyramid: &Pyramid, at: &[Fixation], mut glimpses: RowsMut<'_>) {
        let stride = glimpses.width();
        for (level, range) in self.ranges.iter().enumerate() {
            let (du, dv) = (&self.du[range.clone()], &self.dv[range.clone()]);
            pyramid.read(level, at, du, dv, &mut glimpses.data()[range.start..], stride);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Extent, State};
    use crate::identity::pyramid::Region;
    use crate::scene::Image;

    /// A retina about another gaze reads what the retina at the centre reads under that gaze.
    #[test]
    fn a_retina_about_a_gaze_reads_the_cells_of_that_gaze() {
        let bytes = (0..120 * 100 * 3).map(|i: usize| (i * 7 + i * i / 1013) as u8).collect();
        let image = Image::new(120, 100, 3, bytes).expect("enough bytes");
        let config = FovealConfig { side: 16.0, rings: vec![[10, 1], [18, 2]], colour: vec![[8, 4]] };
        let retina = Foveal::new(config).expect("whole cells");
        let (extent, gaze) = (Extent { half_w: 17.0, half_h: 12.0 }, Gaze { u: -0.5, v: 0.25, arm: Some(3) });
        let moved = retina.about(gaze);
        assert!(moved.footprints().iter().zip(retina.footprints()).all(|(m, r)| m.reach == r.reach + 0.5));
        let mut pyramid = Pyramid::default();
        let state = State { x: 60.0, y: 50.0, log_scale: 0.2, angle: 0.3, ..State::default() };
        let region = Region::covering(&image, &[state], &[gaze], extent, 2.0);
        pyramid.build(&image, region, retina.footprints(), (extent.half_w, extent.half_h));
        let (mut one, mut other) = (vec![0.0; retina.glimpse_len()], vec![0.0; moved.glimpse_len()]);
        retina.look(&pyramid, state.fixate(gaze, extent), &mut one);
        moved.look(&pyramid, state.fixate(Gaze::CENTRE, extent), &mut other);
        for (one, other) in one.iter().zip(&other) {
            assert!((one - other).abs() < 1e-3, "{one} is not {other}");
        }
    }
}
