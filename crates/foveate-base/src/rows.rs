//! `n × d` views of `f32`: the only "tensor" in a public signature. Row-major, contiguous.

/// A borrowed matrix of `f32`, row-major.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    data: &'a [f32],
    width: usize,
}

impl<'a> Rows<'a> {
    /// Views `data` as rows of `width` values. Panics if they are not whole rows.
    pub fn new(data: &'a [f32], width: usize) -> Self {
        assert!(width > 0 && data.len().is_multiple_of(width), "{} values are not whole rows of {width}", data.len());
        Self { data, width }
    }
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.data.len() / self.width
    }
    /// Whether there is no row at all.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }
    /// Values in a row.
    pub fn width(&self) -> usize {
        self.width
    }
    /// All values, row after row.
    pub fn data(&self) -> &'a [f32] {
        self.data
    }
    /// Row `i`.
    pub fn row(&self, i: usize) -> &'a [f32] {
        &self.data[i * self.width..][..self.width]
    }
    /// The rows in order.
    pub fn iter(&self) -> std::slice::ChunksExact<'a, f32> {
        self.data.chunks_exact(self.width)
    }
}

/// A matrix of `f32` to write into, row-major.
#[derive(Debug)]
pub struct RowsMut<'a> {
    data: &'a mut [f32],
    width: usize,
}

impl<'a> RowsMut<'a> {
    /// Views `data` as rows of `width` values. Panics if they are not whole rows.
    pub fn new(data: &'a mut [f32], width: usize) -> Self {
        assert!(width > 0 && data.len().is_multiple_of(width), "{} values are not whole rows of {width}", data.len());
        Self { data, width }
    }
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.data.len() / self.width
    }
    /// Whether there is no row at all.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }
    /// Values in a row.
    pub fn width(&self) -> usize {
        self.width
    }
    /// All values, row after row.
    pub fn data(&mut self) -> &mut [f32] {
        self.data
    }
    /// Row `i`.
    pub fn row(&mut self, i: usize) -> &mut [f32] {
        &mut self.data[i * self.width..][..self.width]
    }
}
