//! The features of all places of a lattice at once, for the oriented encoder: places half a block apart share cells,
//! gradients and blocks, so each place costs only its normalisation.
//!
//! The results equal those of single looks, up to the rounding of sums.

use foveate_kernels as kernels;
use kernels::{HALVES, Lengths};

use super::encoder::Encoder;
use super::oriented::Oriented;
use super::pyramid::Pyramid;
use super::retina::{Cell, Retina};
use crate::geometry::{Extent, Fixation, Gaze, State};
use foveate_base::memory::grow;

/// Fewer places are looked at one by one.
const LEAST: usize = 32;
/// Half blocks between neighbouring places, at most: those that are farther apart share too little.
const FARTHEST: usize = 6;
/// Cells that are read at a time.
const STRIP: usize = 64;

/// Maps that the places of a lattice read their features from.
#[derive(Clone, Debug)]
pub(super) struct Dense {
    blocks: usize,
    lengths: Lengths,
    /// Side of a cell, template units.
    pitch: f64,
    /// The middle of the cells.
    middle: Gaze,
    pub maps: Maps,
    /// The first state that the maps are of, and how many; none once another picture may have been seen.
    pub of: Option<(State, State, usize)>,
}

/// The maps of one look.
#[derive(Clone, Debug, Default)]
pub(super) struct Maps {
    lattice: Lattice,
    /// Half blocks in a row of the maps.
    columns: usize,
    cells: Vec<f32>,
    halves: Vec<f32>,
    sums: Vec<f32>,
    grey: Vec<f32>,
    colour: [Vec<f32>; 2],
}

/// Places in rows, half blocks apart.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Lattice {
    columns: usize,
    rows: usize,
    across: usize,
    down: usize,
}

impl Lattice {
    /// The lattice that these states are, if they are one, of one size and shape and without turns; `half` is the size of a half block.
    fn of(states: &[State], half: (f64, f64)) -> Option<Self> {
        let first = states.first().filter(|_| states.len() >= LEAST)?;
        let columns = states.iter().take_while(|s| s.y == first.y).count();
        if columns < 2 || !states.len().is_multiple_of(columns) || states.len() == columns {
            return None;
        }
        let (dx, dy) = (states[1].x - first.x, states[columns].y - first.y);
        let steps = |d: f64, half: f64| {
            let steps = (d / half).round();
            let whole = (d - steps * half).abs() < 1e-6 * half && (1.0..=FARTHEST as f64).contains(&steps);
            whole.then_some(steps as usize)
        };
        let lattice =
            Self { columns, rows: states.len() / columns, across: steps(dx, half.0)?, down: steps(dy, half.1)? };
        let far = 1e-3 * half.0.min(half.1);
        let in_place = |(k, s): (usize, &State)| {
            let (i, j) = ((k % columns) as f64, (k / columns) as f64);
            let (x, y) = (first.x + i * dx - s.x, first.y + j * dy - s.y);
            x.abs() < far
                && y.abs() < far
                && s.angle == 0.0
                && (s.log_scale, s.log_aspect) == (first.log_scale, first.log_aspect)
        };
        states.iter().enumerate().all(in_place).then_some(lattice)
    }
}

impl Dense {
    /// Fails if the encoder is not the oriented one, or the cells are not a square of grey ones and two colour
    /// channels as large as blocks.
    pub(super) fn new(retina: &dyn Retina, encoder: &(dyn Encoder + 'static)) -> Option<Self> {
        let (blocks, lengths) = encoder.downcast::<Oriented>()?.blocks();
        let (side, cells) = (kernels::BLOCK * blocks + 2, retina.cells());
        let pitch = 2.0 * cells.first()?.half;
        let corners = [cells.first()?, cells.get(side * side - 1)?];
        let between = |of: fn(&Cell) -> f64| 0.5 * (of(corners[0]) + of(corners[1]));
        let middle = Gaze { u: between(|c| c.u), v: between(|c| c.v), arm: None };
        let square = |cells: &[Cell], side: usize, pitch: f64, channel: usize| {
            let at = |i: usize| (i as f64 - (side as f64 - 1.0) / 2.0) * pitch;
            cells.iter().enumerate().all(|(k, c)| {
                let off = (c.u - middle.u - at(k % side)).abs().max((c.v - middle.v - at(k / side)).abs());
                off < 1e-9 && c.channel == channel && (2.0 * c.half - pitch).abs() < 1e-9
            })
        };
        let (grey, colour) = cells.split_at_checked(side * side)?;
        let (first, second) = colour.split_at_checked(blocks * blocks)?;
        let wide = kernels::BLOCK as f64 * pitch;
        let fits = second.len() == first.len()
            && retina.footprints().len() == 3
            && square(grey, side, pitch, 0)
            && square(first, blocks, wide, 1)
            && square(second, blocks, wide, 2);
        fits.then(|| Self { blocks, lengths, pitch, middle, maps: Maps::default(), of: None })
    }

    /// Reads states of the prepared frame. Returns false, without effect, if they form no lattice.
    pub(super) fn look(&mut self, pyramid: &Pyramid, states: &[State], extent: Extent) -> bool {
        let Some(first) = states.first() else { return false };
        let of = (*first, *states.last().unwrap_or(first), states.len());
        if self.of == Some(of) {
            return true;
        }
        let (half, shape) = (2.0 * self.pitch * first.log_scale.exp(), first.shaped(extent));
        let Some(lattice) = Lattice::of(states, (half * shape.half_w, half * shape.half_h)) else { return false };
        let count = |places: usize, step: usize| (places - 1) * step + 2 * self.blocks;
        let columns = count(lattice.columns, lattice.across).next_multiple_of(HALVES);
        let rows = count(lattice.rows, lattice.down);
        let maps = &mut self.maps;
        (maps.lattice, maps.columns) = (lattice, columns);
        let n = columns * rows;
        let at = first.fixate(self.middle, extent);
        // From the middle of the first place to that of its first cell, and of its first block.
        let start = -0.5 * (kernels::BLOCK * self.blocks) as f64 * self.pitch;
        let read = |level: usize, out: &mut Vec<f32>, width: usize, height: usize, from: f64, step: f64| {
            grow(out, width * height);
            for left in (0..width).step_by(STRIP) {
                let mut du = [0.0; STRIP];
                du.iter_mut().enumerate().for_each(|(i, du)| *du = (from + (left + i) as f64 * step) as f32);
                let count = STRIP.min(width - left);
                for top in (0..height).step_by(STRIP) {
                    let row = |j: usize| Fixation { y: at.y + at.vy * (from + (top + j) as f64 * step), ..at };
                    let rows: [Fixation; STRIP] = std::array::from_fn(row);
                    let (rows, out) = (&rows[..STRIP.min(height - top)], &mut out[top * width + left..]);
                    pyramid.read(level, rows, &du[..count], &[0.0; STRIP][..count], out, width);
                }
            }
        };
        let (p, width, height) = (self.pitch, 2 * columns + 2, 2 * rows + 2);
        read(0, &mut maps.cells, width, height, start - 0.5 * p, p);
        for (level, colour) in maps.colour.iter_mut().enumerate() {
            read(1 + level, colour, columns, rows, start + 2.0 * p, 2.0 * p);
        }
        for (map, n) in [(&mut maps.halves, 8 * n), (&mut maps.sums, 8 * n), (&mut maps.grey, n)] {
            grow(map, n);
        }
        kernels::oriented_halves(
            &maps.cells[..width * height],
            columns,
            &mut maps.halves[..8 * n],
            &mut maps.grey[..n],
        );
        kernels::oriented_blocks(&maps.halves[..8 * n], columns, &mut maps.sums[..8 * n]);
        self.of = Some(of);
        true
    }

    /// The features of the k-th state that was looked at.
    pub(super) fn features(&self, k: usize, out: &mut [f32]) {
        let made = &self.maps;
        let Lattice { columns, across, down, .. } = made.lattice;
        let first = k / columns * down * made.columns + k % columns * across;
        let colour = made.colour.each_ref().map(|map| &map[..]);
        let maps = kernels::Maps { columns: made.columns, blocks: &made.sums, grey: &made.grey, colour };
        kernels::features_among(&maps, first, self.blocks, &self.lengths, out);
    }
}

#[cfg(test)]
mod tests {
    use super::super::oriented::{Oriented, Weights};
    use super::super::pyramid::Region;
    use super::super::retina::{Foveal, FovealConfig};
    use super::*;
    use crate::scene::Image;
    use foveate_base::rows::{Rows, RowsMut};

    const EXTENT: Extent = Extent { half_w: 13.0, half_h: 21.0 };

    fn foveal(side: f64, ring: usize) -> Foveal {
        let config = FovealConfig { side, rings: vec![[ring, 1]], colour: vec![[16, 4]] };
        Foveal::new(config).expect("whole cells")
    }

    fn encoder(retina: &Foveal, weights: Weights) -> Oriented {
        let channels: Vec<usize> = retina.cells().iter().map(|c| c.channel).collect();
        Oriented::new(&channels, weights).expect("a square of cells")
    }

    /// `n` × `m` places, so many template units apart.
    fn places(n: usize, m: usize, step: f64) -> Vec<State> {
        let (dx, dy) = (0.9 * step * EXTENT.half_w, 0.9 * step * EXTENT.half_h);
        let at = |k: usize| (30.0 + (k % n) as f64 * dx, 20.0 + (k / n) as f64 * dy);
        (0..n * m).map(|k| State { x: at(k).0, y: at(k).1, log_scale: 0.9f64.ln(), ..State::default() }).collect()
    }

    /// Every place of a lattice against a look of its own, also past the borders of the picture.
    #[test]
    fn places_have_the_features_of_looks() {
        let bytes: Vec<u8> = (0..160 * 120 * 3).map(|i: usize| (i * 7 + i * i / 1013) as u8).collect();
        let image = Image::from_rgb8(160, 120, &bytes).expect("enough bytes");
        let centred = foveal(16.0, 18);
        let mut pyramid = Pyramid::default();
        let aside = Gaze { u: 0.5, v: -0.3, arm: None };
        let without_grey = Weights { grey: 0.0, ..Weights::default() };
        for (encoder, (n, m, step, gaze)) in
            [Weights::default(), without_grey].map(|weights| encoder(&centred, weights)).iter().flat_map(|encoder| {
                [(9, 5, 0.5, Gaze::CENTRE), (20, 8, 0.25, Gaze::CENTRE), (7, 6, 0.75, Gaze::CENTRE), (9, 5, 0.5, aside)]
                    .map(|lattice| (encoder, lattice))
            })
        {
            let places = places(n, m, step);
            let retina = centred.about(gaze);
            let mut dense = Dense::new(&*retina, encoder).expect("cells as it needs them");
            let region = Region::covering(&image, &places, &[gaze], EXTENT, 1.1);
            pyramid.build(&image, region, retina.footprints(), (0.9 * EXTENT.half_w, 0.9 * EXTENT.half_h));
            assert!(dense.look(&pyramid, &places, EXTENT));
            let (n_v, n_h) = encoder.shape();
            let (mut glimpse, mut exact, mut found) = (vec![0.0; n_v], vec![0.0; n_h], vec![0.0; n_h]);
            for (k, place) in places.iter().enumerate() {
                retina.look(&pyramid, place.fixate(Gaze::CENTRE, EXTENT), &mut glimpse);
                encoder.encode(Rows::new(&glimpse, n_v), RowsMut::new(&mut exact, n_h));
                dense.features(k, &mut found);
                for (found, exact) in found.iter().zip(&exact) {
                    assert!((found - exact).abs() < 1e-3, "place {k} of {n} x {m}: {found} is not {exact}");
                }
            }
        }
    }

    #[test]
    fn what_is_no_lattice_is_left_alone() {
        let retina = foveal(16.0, 18);
        let encoder = encoder(&retina, Weights::default());
        let mut dense = Dense::new(&retina, &encoder).expect("cells as it needs them");
        let mut refuses = |places: &[State]| !dense.look(&Pyramid::default(), places, EXTENT);
        assert!(refuses(&[]) && refuses(&places(5, 5, 0.5)), "too few");
        assert!(refuses(&places(8, 8, 0.3)) && refuses(&places(8, 8, 2.0)), "not half blocks apart, or too far");
        for change in [
            (|s| s.x += 0.5) as fn(&mut State),
            |s| s.y += 0.5,
            |s| s.log_scale += 0.1,
            |s| s.log_aspect += 0.1,
            |s| s.angle = 0.1,
        ] {
            let mut places = places(8, 8, 0.5);
            change(&mut places[30]);
            assert!(refuses(&places));
        }
        assert!(Dense::new(&foveal(18.0, 18), &encoder).is_some(), "cells of any size");
    }
}
