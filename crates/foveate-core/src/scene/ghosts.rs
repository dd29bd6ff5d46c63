//! Ghosts in a motion mask: objects that were in the background and have left.
//!
//! An object in the foreground has its edges in the frame; an object that left has them in the background. The
//! outline of a ghost does not change from frame to frame either (Cucchiara et al., IEEE PAMI 25(10), 2003, use only
//! this; a standing pedestrian is no ghost).

/// How many times as strong as the frame's the background's edges must be along the outline of a ghost.
const STRONGER: f32 = 1.5;
/// Pixels to each side over which an edge is measured.
const REACH: usize = 2;
/// Frames in a row, in the mean, that the outline of a ghost has not changed.
const STILL: f32 = 4.0;

/// The motion mask, the frame and the background. Rows have `width` pixels.
#[derive(Clone, Copy)]
pub(super) struct Marked<'a> {
    pub marks: &'a [bool],
    pub width: usize,
    pub now: &'a [u8],
    pub mean: &'a [f32],
    /// Frames that a marked pixel has not changed.
    pub still: &'a [u8],
}

/// Buffers for finding ghosts.
#[derive(Clone, Debug, Default)]
pub(super) struct Ghosts {
    seen: Vec<bool>,
    /// Pixels of the ghosts found so far, then those of the part at hand.
    pixels: Vec<usize>,
}

impl Ghosts {
    /// The pixels of all parts (pixels that touch at a side) that are ghosts.
    pub(super) fn find(&mut self, m: Marked) -> &[usize] {
        let Self { seen, pixels } = self;
        seen.clear();
        seen.extend(m.marks.iter().map(|mark| !mark));
        pixels.clear();
        for start in 0..seen.len() {
            if seen[start] {
                continue;
            }
            let (mut fresh, mut stale, mut still, mut outline) = (0.0, 0.0, 0.0, 0.0);
            let first = pixels.len();
            let mut next = first;
            pixels.push(start);
            seen[start] = true;
            while next < pixels.len() {
                let k = pixels[next];
                next += 1;
                let mut outer = false;
                for l in m.beside(k) {
                    outer |= !m.marks[l];
                    if !seen[l] {
                        seen[l] = true;
                        pixels.push(l);
                    }
                }
                if outer {
                    fresh += m.edge(k, &|k| f32::from(m.now[k]));
                    stale += m.edge(k, &|k| m.mean[k]);
                    still += f32::from(m.still[k]);
                    outline += 1.0;
                }
            }
            if stale <= STRONGER * fresh || still <= STILL * outline {
                pixels.truncate(first);
            }
        }
        pixels
    }
}

impl Marked<'_> {
    /// The pixels at the four sides of one.
    fn beside(&self, k: usize) -> impl Iterator<Item = usize> {
        let (width, n) = (self.width, self.marks.len());
        let (left, right) = ((!k.is_multiple_of(width)).then(|| k - 1), (k % width + 1 < width).then_some(k + 1));
        let (up, down) = (k.checked_sub(width), (k + width < n).then_some(k + width));
        [left, right, up, down].into_iter().flatten()
    }

    /// How much a picture changes across a pixel.
    fn edge(&self, k: usize, value: &dyn Fn(usize) -> f32) -> f32 {
        let (x, y, last) = (k % self.width, k / self.width, self.marks.len() / self.width - 1);
        let at = |x: usize, y: usize| value(y * self.width + x);
        let across = at((x + REACH).min(self.width - 1), y) - at(x.saturating_sub(REACH), y);
        let down = at(x, (y + REACH).min(last)) - at(x, y.saturating_sub(REACH));
        across.abs() + down.abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_object_that_left_is_a_ghost_and_one_that_came_is_not() {
        const SIDE: usize = 40;
        let block = |k: usize, x: usize| (x..x + 8).contains(&(k % SIDE)) && (10..25).contains(&(k / SIDE));
        let pixels = 0..SIDE * SIDE;
        // At 5 the background has something, at 25 the frame.
        let now: Vec<u8> = pixels.clone().map(|k| if block(k, 25) { 200 } else { 60 }).collect();
        let mean: Vec<f32> = pixels.clone().map(|k| if block(k, 5) { 200.0 } else { 60.0 }).collect();
        let marks: Vec<bool> = pixels.clone().map(|k| block(k, 5) || block(k, 25)).collect();
        let mut ghosts = Ghosts::default();
        let mut find = |still: u8| {
            let still = vec![still; now.len()];
            let marked = Marked { marks: &marks, width: SIDE, now: &now, mean: &mean, still: &still };
            let mut found = ghosts.find(marked).to_vec();
            found.sort_unstable();
            found
        };
        assert_eq!(find(9), pixels.filter(|k| block(*k, 5)).collect::<Vec<_>>());
        assert!(find(2).is_empty(), "it may be moving");
    }
}
