//! Medians of 3 × 3 pixels, and erosion and dilation of marks by discs.

/// Memory of [`median`].
#[derive(Clone, Debug, Default)]
pub(super) struct Rows {
    low: Vec<u8>,
    middle: Vec<u8>,
    high: Vec<u8>,
}

/// The median of each pixel's 3 × 3 neighbourhood; past the edges the edge's pixels are repeated.
///
/// The median of nine is that of three: the largest of the columns' minima, the median of their medians, the smallest of
/// their maxima.
pub(super) fn median(from: &[u8], width: usize, rows: &mut Rows, to: &mut Vec<u8>) {
    to.resize(from.len(), 0);
    let height = from.len() / width;
    for column in [&mut rows.low, &mut rows.middle, &mut rows.high] {
        column.resize(width + 2, 0);
    }
    let of_three = |a: u8, b: u8, c: u8| a.min(b).max(a.max(b).min(c));
    for (y, out) in to.chunks_exact_mut(width).enumerate() {
        let row = |y: usize| &from[y * width..][..width];
        let (a, b, c) = (row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1)));
        for x in 0..width {
            rows.low[x + 1] = a[x].min(b[x]).min(c[x]);
            rows.middle[x + 1] = of_three(a[x], b[x], c[x]);
            rows.high[x + 1] = a[x].max(b[x]).max(c[x]);
        }
        for column in [&mut rows.low, &mut rows.middle, &mut rows.high] {
            (column[0], column[width + 1]) = (column[1], column[width]);
        }
        for (x, pixel) in out.iter_mut().enumerate() {
            let low = rows.low[x].max(rows.low[x + 1]).max(rows.low[x + 2]);
            let middle = of_three(rows.middle[x], rows.middle[x + 1], rows.middle[x + 2]);
            let high = rows.high[x].min(rows.high[x + 1]).min(rows.high[x + 2]);
            *pixel = of_three(low, middle, high);
        }
    }
}

/// Marks, one a pixel, and memory to work on them.
#[derive(Clone, Debug, Default)]
pub(super) struct Mask {
    pub(super) marks: Vec<bool>,
    other: Vec<bool>,
}

impl Mask {
    /// Opening: keeps marks that a disc inside them can reach; removes specks and thin lines.
    pub(super) fn open(&mut self, width: usize, radius: usize) {
        self.each(width, radius, false);
        self.each(width, radius, true);
    }
    /// Closing: marks pixels that no disc outside the marks can reach; fills small gaps.
    pub(super) fn close(&mut self, width: usize, radius: usize) {
        self.each(width, radius, true);
        self.each(width, radius, false);
    }
    /// Marks all pixels within `radius` of a mark.
    pub(super) fn dilate(&mut self, width: usize, radius: usize) {
        self.each(width, radius, true);
    }
    /// Writes `value` over a disc at each pixel with this value. Outside the picture are neither marks nor gaps.
    fn each(&mut self, width: usize, radius: usize, value: bool) {
        let height = self.marks.len() / width;
        self.other.clone_from(&self.marks);
        for (k, _) in self.marks.iter().enumerate().filter(|(_, mark)| **mark == value) {
            let (x, y) = (k % width, k / width);
            for v in y.saturating_sub(radius)..=(y + radius).min(height - 1) {
                let reach = (radius * radius - v.abs_diff(y).pow(2)).isqrt();
                self.other[v * width..][x.saturating_sub(reach)..=(x + reach).min(width - 1)].fill(value);
            }
        }
        std::mem::swap(&mut self.marks, &mut self.other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::{Purpose, Streams};
    use rand::RngExt;

    #[test]
    fn the_median_is_the_fifth_of_nine() {
        let mut rng = Streams::new(1, 0).at(0, Purpose::Scene).rng(0);
        let (mut rows, mut out) = (Rows::default(), vec![]);
        for (w, h) in [(1, 1), (7, 1), (1, 6), (2, 2), (23, 17)] {
            let from: Vec<u8> = (0..w * h).map(|_| rng.random()).collect();
            median(&from, w, &mut rows, &mut out);
            for k in 0..w * h {
                let at = |d: usize, x: usize, n: usize| (x + d).saturating_sub(1).min(n - 1);
                let mut nine: Vec<u8> = (0..9).map(|d| from[at(d / 3, k / w, h) * w + at(d % 3, k % w, w)]).collect();
                nine.sort_unstable();
                assert_eq!(out[k], nine[4], "pixel {k} of {w} x {h}");
            }
        }
    }

    #[test]
    fn opening_drops_specks_and_closing_fills_gaps() {
        let square = |x: usize, y: usize| (4..12).contains(&x) && (4..12).contains(&y);
        let fill = |extra: &dyn Fn(usize, usize) -> bool| {
            let marks = (0..400).map(|k| square(k % 20, k / 20) ^ extra(k % 20, k / 20)).collect();
            Mask { marks, ..Mask::default() }
        };
        let clean = fill(&|_, _| false);
        let mut specks = fill(&|x, y| (x, y) == (16, 3) || y == 17);
        specks.open(20, 1);
        assert_eq!(specks.marks.iter().filter(|m| **m).count(), 60, "the corners of a square are no disc's");
        let mut gaps = fill(&|x, y| (x, y) == (6, 6) || (x == 9 && (6..10).contains(&y)));
        gaps.close(20, 2);
        assert!(gaps.marks == clean.marks);
        let mut point = Mask { marks: (0..400).map(|k| k == 210).collect(), ..Mask::default() };
        point.dilate(20, 2);
        assert_eq!(point.marks.iter().filter(|m| **m).count(), 13, "a disc of radius 2");
    }
}
