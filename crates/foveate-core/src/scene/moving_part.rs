//! The part of a box that moves differently from its border. A first box that is too large covers the target and much of the ground.
//!
//! The box of frame 1 is divided into cells, and their means are compared with those of a later picture at every displacement. The box is
//! too large if its middle and its border have moved differently, if the middle fits only at its own displacement in each quarter, and if
//! the ground on each side fits only at the displacement of the border.

use std::array;

use crate::geometry::BBox;
use crate::scene::Image;

/// Cells along the smaller side of a box, and samples along a side of a cell of a large box. Both are approximate.
const CELLS: f64 = 24.0;
const SAMPLES: f64 = 4.0;
/// Farthest displacement, and least difference of two displacements, cells.
const REACH: i32 = 10;
const LEAST: i32 = 2;
/// Fewest and most cells along a side of a box.
const FEWEST: i32 = 12;
const MOST: i32 = 192;
/// Distance from the centre up to which a cell is in the middle of a box, and from which on it is in its border: 1 is the edge of the box.
const MIDDLE: f64 = 0.3;
const BORDER: f64 = 0.8;
/// Width of the rings whose cells vote on the size of the part.
const RING: f64 = 0.1;
/// Largest error of a part at its own displacement, relative to its error at the other displacement. In the first ten frames of 159 videos
/// no box around the target gets below 0.38.
const OWN: f64 = 0.25;

/// The part of a box that moves as one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MovingPart {
    /// Its share of each side of the box, about the same centre, 0.3 to 0.8.
    pub share: f64,
    /// Its displacement, pixels right and down.
    pub moved: (f64, f64),
}

/// Sums of samples of a picture around a box: the mean of a cell is four reads.
struct Means {
    /// (columns + 1) × (rows + 1), modulo 2³².
    sums: Vec<u32>,
    /// Of the region, in samples from the left top corner of the box.
    left: i32,
    top: i32,
    columns: i32,
    rows: i32,
    /// Samples along a side of a cell.
    cell: i32,
}

impl Means {
    /// Samples every `step` pixels of the box from pixel `corner` on, `size` samples wide and high, with a margin as far as the picture
    /// reaches.
    fn of(image: &Image, corner: (i32, i32), size: (i32, i32), (margin, step, cell): (i32, i32, i32)) -> Self {
        let span = |corner: i32, size: i32, side: usize| {
            let first = (-margin).max(-corner.div_euclid(step));
            let end = (size + margin).min((side as i32 - 1 - corner).div_euclid(step) + 1);
            (first, (end - first).max(0))
        };
        let (left, columns) = span(corner.0, size.0, image.width());
        let (top, rows) = span(corner.1, size.1, image.height());
        let width = columns as usize + 1;
        let mut sums = vec![0u32; width * (rows as usize + 1)];
        for j in 0..rows as usize {
            let y = (corner.1 + (top + j as i32) * step) as usize;
            let (above, row) = sums[j * width..].split_at_mut(width);
            let mut sum = 0u32;
            for i in 0..columns as usize {
                let x = (corner.0 + (left + i as i32) * step) as usize;
                sum += (0..image.planes()).map(|p| u32::from(image.at(p, x, y))).sum::<u32>();
                row[i + 1] = above[i + 1].wrapping_add(sum);
            }
        }
        Self { sums, left, top, columns, rows, cell }
    }

    /// Returns the mean of the cell whose left top sample is (x, y), times the planes; NaN if the cell is not inside the picture.
    fn mean(&self, x: i32, y: i32) -> f64 {
        let (x, y) = (x - self.left, y - self.top);
        if x < 0 || y < 0 || x + self.cell > self.columns || y + self.cell > self.rows {
            return f64::NAN;
        }
        let at = |x: i32, y: i32| self.sums[(y * (self.columns + 1) + x) as usize];
        let (right, bottom) = (x + self.cell, y + self.cell);
        let sum = at(right, bottom).wrapping_sub(at(x, bottom)).wrapping_sub(at(right, y)).wrapping_add(at(x, y));
        f64::from(sum) / f64::from(self.cell * self.cell)
    }
}

/// How a box is divided into cells.
struct Grid {
    /// Pixel of its left top corner.
    corner: (i32, i32),
    /// Pixels from sample to sample, and samples along a side of a cell.
    step: i32,
    cell: i32,
    /// Cells along each side.
    nx: i32,
    ny: i32,
}

impl Grid {
    /// Returns the cells of a box; `None` if it has too few or too many.
    fn of(bbox: &BBox) -> Option<Self> {
        if !bbox.is_sane() {
            return None;
        }
        let side = bbox.w.min(bbox.h);
        let step = (side / (CELLS * SAMPLES)).floor().max(1.0);
        let cell = (side / (CELLS * step)).round().max(1.0);
        let count = |side: f64| (side / (cell * step)) as i32;
        let (nx, ny, corner) = (count(bbox.w), count(bbox.h), (bbox.x.round() as i32, bbox.y.round() as i32));
        let fits = nx.min(ny) >= FEWEST && nx.max(ny) <= MOST;
        fits.then_some(Self { corner, step: step as i32, cell: cell as i32, nx, ny })
    }

    /// Returns the sums of a picture, with or without the margin that displacements reach.
    fn means(&self, image: &Image, margin: bool) -> Means {
        let margin = if margin { (REACH + 1) * self.cell } else { 0 };
        let size = (self.nx * self.cell, self.ny * self.cell);
        Means::of(image, self.corner, size, (margin, self.step, self.cell))
    }
}

/// A cell of a box: its indices, and its centre, with the box from −1 to 1.
#[derive(Clone, Copy)]
struct Cell {
    i: i32,
    j: i32,
    u: f64,
    v: f64,
}

impl Cell {
    /// Its distance from the centre: 1 is the edge of the box.
    fn off(&self) -> f64 {
        self.u.abs().max(self.v.abs())
    }
}

/// A displacement, samples right and down.
type Shift = (i32, i32);

/// Returns the pixels of a later picture that [`moving_part`] reads: left column, top row, width and height; `None` if it reads none.
pub(crate) fn window(image: &Image, bbox: &BBox) -> Option<(usize, usize, usize, usize)> {
    let Grid { corner, step, cell, nx, ny } = Grid::of(bbox)?;
    let margin = (REACH + 1) * cell;
    let span = |corner: i32, cells: i32, side: usize| {
        let end = corner.saturating_add((cells * cell + margin) * step).clamp(0, side as i32);
        let first = corner.saturating_sub(margin * step).clamp(0, end);
        (first as usize, (end - first) as usize)
    };
    let ((x, columns), (y, rows)) = (span(corner.0, nx, image.width()), span(corner.1, ny, image.height()));
    Some((x, y, columns, rows))
}

/// Returns the part of `bbox` of the picture `first` that has moved differently from the border of the box up to the picture `now`; `None`
/// if no such part is certain.
pub(crate) fn moving_part(first: &Image, now: &Image, bbox: &BBox) -> Option<MovingPart> {
    if first.shape() != now.shape() {
        return None;
    }
    let grid = Grid::of(bbox)?;
    let Grid { step, cell, nx, ny, .. } = grid;
    let (before, after) = (grid.means(first, false), grid.means(now, true));
    let error = |at: &Cell, (dx, dy): Shift| {
        let (x, y) = (at.i * cell, at.j * cell);
        (after.mean(x + dx, y + dy) - before.mean(x, y)).abs()
    };
    let centre = |k: i32, n: i32| f64::from(2 * k + 1) / f64::from(n) - 1.0;
    let cells = (0..ny).flat_map(|j| (0..nx).map(move |i| Cell { i, j, u: centre(i, nx), v: centre(j, ny) }));
    let cells: Vec<Cell> = cells.collect();
    let part = |holds: &dyn Fn(&Cell) -> bool| cells.iter().copied().filter(|at| holds(at)).collect::<Vec<_>>();
    let sum = |part: &[Cell], by: Shift| part.iter().map(|at| error(at, by)).sum::<f64>();
    let best = |part: &[Cell], about: Shift, (reach, step): (i32, i32)| {
        let shifts = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)));
        let scored = shifts.map(|(dx, dy)| (about.0 + dx * step, about.1 + dy * step)).map(|by| (sum(part, by), by));
        scored.filter(|(error, _)| error.is_finite()).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, by)| by)
    };
    let motion = |part: &[Cell]| best(part, best(part, (0, 0), (REACH, cell))?, (cell - 1, 1));
    let own = motion(&part(&|at| at.off() < MIDDLE))?;
    let ground = motion(&part(&|at| at.off() >= BORDER))?;
    let apart = (own.0 - ground.0, own.1 - ground.1);
    if apart.0.abs().max(apart.1.abs()) < LEAST * cell {
        return None;
    }
    // The part ends where most cells of a ring move with the border.
    let moves = |at: &&Cell| error(at, own) < error(at, ground);
    let most_move = |share: &f64| {
        let ring = part(&|at| (share - RING..*share).contains(&at.off()));
        2 * ring.iter().filter(moves).count() > ring.len()
    };
    let share = (3..=8).rev().map(|k| RING * f64::from(k)).find(most_move)?;
    let apart = (f64::from(2 * apart.0) / f64::from(nx * cell), f64::from(2 * apart.1) / f64::from(ny * cell));
    let is_inside = |at: &Cell| at.off() < share - RING / 2.0;
    // The ground that the part does not cover in the later picture.
    let is_ground = |at: &Cell| {
        let covered = (at.u - apart.0).abs().max((at.v - apart.1).abs()) < share + RING / 2.0;
        at.off() >= share + RING / 2.0 && !covered && error(at, own).is_finite() && error(at, ground).is_finite()
    };
    let quarters: [_; 4] =
        array::from_fn(|k| part(&|at| is_inside(at) && (at.u > 0.0) == (k % 2 > 0) && (at.v > 0.0) == (k > 1)));
    let sides: [_; 4] = array::from_fn(|k| {
        let out = |at: &Cell| [-at.u, at.u, -at.v, at.v][k];
        part(&|at| is_ground(at) && out(at) > share)
    });
    // A part without cells fits nowhere.
    let fits = |part: &[Cell], by, other| sum(part, by) < OWN * sum(part, other);
    let is_certain =
        quarters.iter().all(|part| fits(part, own, ground)) && sides.iter().all(|part| fits(part, ground, own));
    let moved = (f64::from(own.0 * step), f64::from(own.1 * step));
    is_certain.then_some(MovingPart { share, moved })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use foveate_base::rng::{Purpose, Streams};
    use rand::RngExt;

    /// Blocks of 4 × 4 pixels of random grey, `side` pixels wide and high. In it a square of other blocks, 40 pixels wide, from `place` on;
    /// `ground` is the displacement of the rest.
    pub(crate) fn picture(side: usize, place: (i32, i32), ground: (i32, i32)) -> Image {
        let mut rng = Streams::new(3, 0).at(0, Purpose::Start).rng(0);
        let mut blocks = || -> Vec<u8> { (0..100 * 100).map(|_| rng.random_range(20..230)).collect() };
        let (target, around) = (blocks(), blocks());
        let pixel = |x: i32, y: i32| {
            let (u, v) = (x - place.0, y - place.1);
            let is_target = (0..40).contains(&u) && (0..40).contains(&v);
            let (blocks, u, v) =
                if is_target { (&target, u, v) } else { (&around, x - ground.0 + 20, y - ground.1 + 20) };
            blocks[(v / 4 * 100 + u / 4) as usize]
        };
        let bytes = (0..side * side).map(|k| pixel((k % side) as i32, (k / side) as i32)).collect();
        Image::new(side, side, 1, bytes).expect("a byte for each pixel")
    }

    /// In boxes of 1.5, 2 and 3 times the size of the target the target is found, before ground that stays or moves. A box of the size of
    /// the target or less is not too large, wherever it is; nor is one in which everything moves, or nothing.
    #[test]
    fn a_box_that_is_too_large_has_a_part_that_moves() {
        let first = picture(200, (80, 80), (0, 0));
        for (size, at, place, ground, expected) in [
            (60.0, 100.0, (87, 76), (0, 0), Some((0.67, (7.0, -4.0)))),
            (80.0, 100.0, (87, 76), (0, 0), Some((0.5, (7.0, -4.0)))),
            (120.0, 100.0, (92, 73), (0, 0), Some((0.33, (12.0, -7.0)))),
            (60.0, 100.0, (77, 76), (6, 3), Some((0.67, (-3.0, -4.0)))),
            (60.0, 100.0, (80, 80), (-7, 4), Some((0.67, (0.0, 0.0)))),
            (40.0, 100.0, (87, 76), (0, 0), None),
            (40.0, 110.0, (87, 76), (0, 0), None),
            (30.0, 100.0, (87, 76), (0, 0), None),
            (60.0, 100.0, (80, 80), (0, 0), None),
            (60.0, 100.0, (86, 83), (6, 3), None),
            (60.0, 100.0, (81, 80), (0, 0), None),
        ] {
            let found = moving_part(&first, &picture(200, place, ground), &BBox::around(at, at, size, size));
            match (found, expected) {
                (Some(found), Some((share, moved))) => {
                    assert!((found.share - share).abs() < 0.11 && found.moved == moved, "{size}: {found:?}");
                }
                (found, expected) => assert!(found.is_none() && expected.is_none(), "{size}, {place:?}: {found:?}"),
            }
        }
    }

    /// A box of plain ground or beyond the edge of the picture, a tiny one, and pictures of two shapes give no part.
    #[test]
    fn without_evidence_there_is_no_part() {
        let (first, now) = (picture(200, (80, 80), (0, 0)), picture(200, (87, 76), (0, 0)));
        let plain = |place: (i32, i32)| {
            let mut image = Image::grey(200, 200, 90);
            for k in 0..1600 {
                let (x, y) = ((place.0 + k % 40) as usize, (place.1 + k / 40) as usize);
                image.plane_mut(0)[y * 200 + x] = first.at(0, 80 + k as usize % 40, 80 + k as usize / 40);
            }
            image
        };
        let bbox = BBox::around(100.0, 100.0, 60.0, 60.0);
        assert!(moving_part(&first, &now, &bbox).is_some());
        assert_eq!(moving_part(&plain((80, 80)), &plain((87, 76)), &bbox), None);
        assert_eq!(moving_part(&first, &picture(220, (87, 76), (0, 0)), &bbox), None);
        for bbox in [BBox::new(180.0, -300.0, 60.0, 400.0), BBox::new(99.0, 99.0, 6.0, 6.0)] {
            assert_eq!(moving_part(&first, &now, &bbox), None);
        }
    }

    /// A large box is sampled: the same scene three times as large gives the same part.
    #[test]
    fn a_large_box_is_sampled() {
        let large = |image: &Image| {
            let bytes = (0..600 * 600).map(|k| image.at(0, k % 600 / 3, k / 600 / 3)).collect();
            Image::new(600, 600, 1, bytes).expect("a byte for each pixel")
        };
        let [first, now] = [(80, 80), (92, 74)].map(|place| large(&picture(200, place, (0, 0))));
        let found = moving_part(&first, &now, &BBox::new(180.0, 180.0, 240.0, 240.0)).expect("half of it moves");
        let off = (found.moved.0 - 36.0).abs().max((found.moved.1 + 18.0).abs());
        assert!((found.share - 0.5).abs() < 0.11 && off <= 2.0, "{found:?}");
    }
}
