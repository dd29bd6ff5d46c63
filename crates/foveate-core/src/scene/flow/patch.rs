//! One patch of the search for optical flow: cut from the first picture, moved by Gauss-Newton steps over the second, and its
//! flow spread over its pixels.

use foveate_kernels as kernels;
use kernels::PATCH;

use crate::scene::Map;

const PIXELS: usize = PATCH * PATCH;
/// Gauss-Newton steps of a patch at one level, at most.
const STEPS: usize = 12;
/// Least eigenvalue of a patch's mean squared gradient, of grey 0 to 1 a pixel. Below it the motion along some
/// direction is undetermined, and the patch keeps the position from the coarser level.
const TEXTURE: f32 = 2e-5;

/// A patch of the first picture, with the sums for a Gauss-Newton step. Edge pixels repeat outside the picture.
pub(super) struct Patch {
    x: usize,
    y: usize,
    made: kernels::Patch,
    /// The inverse of Σ g gᵀ of mean-free gradients, as xx, xy, yy; `None` with too little texture.
    inverse: Option<[f32; 3]>,
}

impl Patch {
    pub(super) fn cut(from: &Map, x: usize, y: usize) -> Self {
        let mut made = kernels::Patch::default();
        let [xx, xy, yy] = window::<{ PATCH + 2 }, _>(from, x as f32 - 1.0, y as f32 - 1.0, |values, stride| {
            kernels::cut_patch(values, stride, &mut made)
        });
        let least = 0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        let det = xx * yy - xy * xy;
        let inverse = (least > TEXTURE * PIXELS as f32).then(|| [yy / det, -xy / det, xx / det]);
        Self { x, y, made, inverse }
    }
    /// The position of the patch: steps from `start` while the error decreases; `start` if they lead too far.
    pub(super) fn search(&self, before: &Map, now: &Map, start: (f32, f32)) -> (f32, f32) {
        let Some([xx, xy, yy]) = self.inverse else { return start };
        let (mut best, mut least, mut flow) = (start, f32::INFINITY, start);
        let limit = (before.width() as f32, before.height() as f32);
        for _ in 0..STEPS {
            let [error, bx, by] =
                self.moved(now, flow, |values, stride, part| kernels::patch_residual(values, stride, part, &self.made));
            if error >= least {
                break;
            }
            (best, least) = (flow, error);
            let step = (xx * bx + xy * by, xy * bx + yy * by);
            flow = (flow.0 - step.0, flow.1 - step.1);
            let far = (flow.0 - start.0).hypot(flow.1 - start.1) > PATCH as f32;
            if far || flow.0.abs() > limit.0 || flow.1.abs() > limit.1 {
                return start;
            }
            if step.0.hypot(step.1) < 0.01 {
                break;
            }
        }
        best
    }
    /// The result of `of` on the values at the moved patch, their number in a row, and the fractional position.
    fn moved<T>(&self, now: &Map, flow: (f32, f32), of: impl FnOnce(&[f32], usize, (f32, f32)) -> T) -> T {
        let (x, y) = (self.x as f32 + flow.0, self.y as f32 + flow.1);
        let (left, top) = (x.floor(), y.floor());
        window::<{ PATCH + 1 }, _>(now, left, top, |values, stride| of(values, stride, (x - left, y - top)))
    }
    /// Adds the patch's flow to its pixels, each as far as it explains the pixel: weight 1 / max(error, 2 grey levels).
    pub(super) fn spread(
        &self,
        before: &Map,
        now: &Map,
        flow: (f32, f32),
        (u, v): (&mut Map, &mut Map),
        weight: &mut [f32],
    ) {
        let (w, h) = (before.width(), before.height());
        let moved = self.moved(now, flow, kernels::patch_between);
        let width = PATCH.min(w - self.x);
        for (y, moved) in (self.y..h).zip(moved.chunks_exact(PATCH)) {
            let line = y * w + self.x..y * w + self.x + width;
            let (u, v) = (&mut u.values_mut()[line.clone()], &mut v.values_mut()[line.clone()]);
            let sums = u.iter_mut().zip(v).zip(&mut weight[line.clone()]);
            for (((u, v), weight), (pixel, moved)) in sums.zip(before.values()[line].iter().zip(moved)) {
                let share = 1.0 / (pixel - moved).abs().max(2.0 / 255.0);
                *u += share * flow.0;
                *v += share * flow.1;
                *weight += share;
            }
        }
    }
}

/// What `of` makes of `SIDE` × `SIDE` values of a map, of which the first is at a column and row (whole numbers), and of how many
/// there are in a row.
fn window<const SIDE: usize, T>(from: &Map, left: f32, top: f32, of: impl FnOnce(&[f32], usize) -> T) -> T {
    let (w, h) = (from.width(), from.height());
    if left >= 0.0 && top >= 0.0 && left as usize + SIDE <= w && top as usize + SIDE <= h {
        return of(&from.values()[top as usize * w + left as usize..], w);
    }
    let mut room = [[0.0; SIDE]; SIDE];
    let column: [usize; SIDE] = std::array::from_fn(|i| (left + i as f32).clamp(0.0, (w - 1) as f32) as usize);
    for (j, row) in room.iter_mut().enumerate() {
        let line = &from.values()[(top + j as f32).clamp(0.0, (h - 1) as f32) as usize * w..][..w];
        row.iter_mut().zip(column).for_each(|(value, x)| *value = line[x]);
    }
    of(room.as_flattened(), SIDE)
}
