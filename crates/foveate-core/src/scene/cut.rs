//! Cuts: a frame of which most has nothing to do with the one before.
//!
//! Both pictures are reduced to 16 × 12 means of grey. A cell has changed if it differs by more than some grey levels
//! beyond the change of the whole picture (switching on a lamp is no cut). If most cells have changed, there was a
//! cut.

use crate::scene::Image;

/// Cells across and down.
const ACROSS: usize = 16;
const DOWN: usize = 12;

/// Watches a video for cuts.
#[derive(Clone, Debug)]
pub struct Cuts {
    /// Grey levels of 255 by which a cell must differ.
    pub level: f32,
    /// Share of the cells that must, 0 to 1.
    pub share: f64,
    before: Option<[f32; ACROSS * DOWN]>,
}

impl Default for Cuts {
    fn default() -> Self {
        Self { level: 20.0, share: 0.5, before: None }
    }
}

impl Cuts {
    /// Whether this frame begins a new shot; the first frame does not.
    pub fn cut(&mut self, image: &Image) -> bool {
        let now = small(image);
        let Some(before) = self.before.replace(now) else { return false };
        let mut off: Vec<f32> = now.iter().zip(&before).map(|(a, b)| a - b).collect();
        off.sort_by(f32::total_cmp);
        let brighter = off[off.len() / 2];
        let changed = off.iter().filter(|off| (*off - brighter).abs() > self.level).count();
        changed as f64 > self.share * off.len() as f64
    }
}

/// Rows of a cell that are read, at least.
const ROWS: usize = 16;

/// Means of grey over cells; of tall cells, over every so many rows.
fn small(image: &Image) -> [f32; ACROSS * DOWN] {
    let (w, h, planes) = (image.width(), image.height(), image.planes());
    std::array::from_fn(|k| {
        let (i, j) = (k % ACROSS, k / ACROSS);
        let (x0, y0) = (i * w / ACROSS, j * h / DOWN);
        let (x1, y1) = (((i + 1) * w / ACROSS).max(x0 + 1), ((j + 1) * h / DOWN).max(y0 + 1));
        let rows = (y0..y1.min(h)).step_by(((y1 - y0) / ROWS).max(1));
        let mut sum = 0u64;
        for p in 0..planes {
            for y in rows.clone() {
                let row = &image.plane(p)[y * w..][x0..x1.min(w)];
                sum += row.iter().map(|&v| u64::from(v)).sum::<u64>();
            }
        }
        sum as f32 / ((x1 - x0) * rows.len() * planes) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(value: &dyn Fn(usize, usize) -> u8) -> Image {
        Image::new(64, 48, 1, (0..64 * 48).map(|k| value(k % 64, k / 64)).collect()).expect("one byte a pixel")
    }

    #[test]
    fn another_scene_is_a_cut_but_motion_and_dimming_are_not() {
        let checks = |x: usize, y: usize| if (x / 9 + y / 9).is_multiple_of(2) { 200 } else { 40 };
        let mut cuts = Cuts::default();
        assert!(!cuts.cut(&picture(&checks)), "the first frame");
        assert!(!cuts.cut(&picture(&|x, y| if x < 20 { 0 } else { checks(x, y) })), "a thing a third as wide");
        assert!(!cuts.cut(&picture(&|x, y| checks(x, y) - 30)), "it is gone, and darker");
        assert!(cuts.cut(&picture(&|x, y| 240 - checks(x, y))), "all else");
        assert!(!cuts.cut(&picture(&|x, y| 240 - checks(x, y))), "and goes on from there");
        let mut tiny = Cuts::default();
        let one = |v| Image::new(1, 1, 3, vec![v; 3]).expect("three bytes");
        assert!(!tiny.cut(&one(0)) && !tiny.cut(&one(255)), "fewer pixels than cells");
    }
}
