//! Texts of frames with a total size limit.

use std::collections::BTreeMap;

/// Texts by frame, with a total size limit in bytes.
pub(super) struct Texts {
    pub all: BTreeMap<usize, String>,
    pub bytes: usize,
    pub most: usize,
}

impl Texts {
    pub(crate) fn new(most: usize) -> Self {
        Self { all: BTreeMap::new(), bytes: 0, most }
    }
    pub(crate) fn put(&mut self, index: usize, text: String) {
        self.bytes += text.len();
        self.bytes -= self.all.insert(index, text).map_or(0, |old| old.len());
    }
    pub(crate) fn drop_first(&mut self) {
        self.bytes -= self.all.pop_first().map_or(0, |(_, text)| text.len());
    }
    /// Removes every other text; the first one stays.
    pub(crate) fn thin(&mut self) {
        let mut k = 0;
        self.all.retain(|_, _| {
            k += 1;
            k % 2 == 1
        });
        self.bytes = self.all.values().map(String::len).sum();
    }
    pub(crate) fn cut(&mut self, index: usize) {
        let gone = self.all.split_off(&index);
        self.bytes -= gone.values().map(String::len).sum::<usize>();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_bounded() {
        let mut kept = Texts::new(100);
        (0..10).for_each(|k| kept.put(k, "x".repeat(10)));
        kept.thin();
        assert_eq!((kept.all.keys().copied().collect::<Vec<_>>(), kept.bytes), (vec![0, 2, 4, 6, 8], 50));
        kept.cut(5);
        kept.drop_first();
        assert_eq!((kept.all.len(), kept.bytes), (2, 20));
    }
}
