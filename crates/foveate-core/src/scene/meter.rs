//! How much of a picture was read: pixels in a union of rectangles, each counted once however often it was read.

use super::sensor::Window;

/// Rectangles of one frame.
#[derive(Clone, Debug, Default)]
pub struct Meter {
    windows: Vec<Window>,
    edges: Vec<usize>,
    spans: Vec<(usize, usize)>,
}

impl Meter {
    /// One with room for so many rectangles: it allocates no more until there are more.
    pub fn with_room(rectangles: usize) -> Self {
        let edges = Vec::with_capacity(2 * rectangles);
        Self { windows: Vec::with_capacity(rectangles), edges, spans: Vec::with_capacity(rectangles) }
    }
    /// Discards all rectangles.
    pub fn clear(&mut self) {
        self.windows.clear();
    }
    /// A rectangle was read, pixel by pixel: left column, top row, width and height.
    pub fn add(&mut self, (x, y, columns, rows): (usize, usize, usize, usize)) {
        let window = Window { x, y, columns, rows, bin: (1, 1) };
        if !self.windows.contains(&window) {
            self.windows.push(window);
        }
    }
    /// Adds the counts of another meter.
    pub fn add_all(&mut self, other: &Self) {
        other.windows.iter().for_each(|w| self.add((w.x, w.y, w.columns, w.rows)));
    }
    /// Pixels in the union of the rectangles.
    pub fn pixels(&mut self) -> usize {
        let Self { windows, edges, spans } = self;
        edges.clear();
        edges.extend(windows.iter().flat_map(|w| [w.x, w.x + w.columns]));
        edges.sort_unstable();
        let mut pixels = 0;
        for strip in edges.windows(2).filter(|strip| strip[0] < strip[1]) {
            let crossing = windows.iter().filter(|w| w.x <= strip[0] && strip[1] <= w.x + w.columns);
            spans.clear();
            spans.extend(crossing.map(|w| (w.y, w.y + w.rows)));
            spans.sort_unstable();
            let (mut rows, mut reached) = (0, 0);
            for &(top, bottom) in &*spans {
                rows += bottom.saturating_sub(top.max(reached));
                reached = reached.max(bottom);
            }
            pixels += rows * (strip[1] - strip[0]);
        }
        pixels
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::Streams;
    use rand::RngExt;

    /// 200 random sets of up to seven rectangles against counting pixels, seed 8.
    #[test]
    fn a_union_counts_each_pixel_once() {
        let mut rng = Streams::new(8, 0).rng(0);
        let mut meter = Meter::default();
        assert_eq!(meter.pixels(), 0);
        for _ in 0..200 {
            let mut read = [[false; 30]; 30];
            meter.clear();
            for _ in 0..rng.random_range(0..8) {
                let mut side = || (rng.random_range(0..20usize), rng.random_range(1..10usize));
                let ((x, columns), (y, rows)) = (side(), side());
                meter.add((x, y, columns, rows));
                read[y..y + rows].iter_mut().for_each(|row| row[x..x + columns].fill(true));
            }
            let counted = read.iter().flatten().filter(|read| **read).count();
            let mut twice = Meter::default();
            twice.add_all(&meter);
            twice.add_all(&meter);
            assert_eq!((meter.pixels(), twice.pixels()), (counted, counted));
        }
    }
}
