//! Evenly spaced pictures of a run of unknown length.

/// Maximum number of pictures in a page.
pub(super) const MOST_KEYS: usize = 400;
/// Maximum size of the pictures in a page before base64, bytes.
const MOST_BYTES: usize = 6_500_000;

/// Keeps every `every`-th offered row. If the rows become too many or too large, every second one is dropped.
pub(super) struct Kept<T> {
    /// Row, bytes, and kept data.
    items: Vec<(usize, usize, T)>,
    every: usize,
    most: usize,
    bytes: usize,
}

impl<T> Kept<T> {
    /// Keeps at most `most` rows, which is at least 2.
    pub(super) fn new(most: usize) -> Self {
        Self { items: vec![], every: 1, most, bytes: 0 }
    }
    /// Returns whether to keep a row.
    pub(super) fn keeps(&self, row: usize) -> bool {
        row.is_multiple_of(self.every)
    }
    /// Keeps a row.
    pub(super) fn push(&mut self, row: usize, bytes: usize, item: T) {
        self.items.push((row, bytes, item));
        self.bytes += bytes;
        while self.items.len() > 2 && (self.items.len() > self.most || self.bytes > MOST_BYTES) {
            self.every *= 2;
            let every = self.every;
            self.items.retain(|(row, ..)| row.is_multiple_of(every));
            self.bytes = self.items.iter().map(|(_, bytes, _)| bytes).sum();
        }
    }
    /// Returns the kept rows, in order.
    pub(super) fn iter(&self) -> impl Iterator<Item = &T> {
        self.items.iter().map(|(.., item)| item)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_runs_keep_evenly_spaced_pictures() {
        let mut kept = Kept::new(MOST_KEYS);
        for row in 0..5000 {
            if kept.keeps(row) {
                kept.push(row, 12_000, row);
            }
            assert!(kept.items.len() <= MOST_KEYS && kept.bytes <= MOST_BYTES);
        }
        let rows: Vec<usize> = kept.iter().copied().collect();
        assert_eq!(rows, (0..5000).step_by(kept.every).collect::<Vec<_>>());
        assert!(rows.len() > MOST_KEYS / 2, "{}", rows.len());
        let mut kept = Kept::new(MOST_KEYS);
        for row in (0..100).filter(|r| *r < 60 || r % 2 == 0) {
            kept.push(row, 150_000, row);
        }
        assert!(kept.bytes <= MOST_BYTES && kept.every == 4, "{} {}", kept.bytes, kept.every);
    }
}
