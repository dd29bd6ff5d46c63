//! Boxes in boxes, and the tables of numbers in them.

/// Big-endian numbers from the front of some bytes.
pub(super) struct Cursor<'a>(pub(super) &'a [u8]);

impl Cursor<'_> {
    pub(super) fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (front, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*front)
    }
    pub(super) fn u16(&mut self) -> Option<u16> {
        self.take().map(u16::from_be_bytes)
    }
    pub(super) fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_be_bytes)
    }
    pub(super) fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_be_bytes)
    }
}

/// The boxes inside a box, until one does not fit.
pub(super) fn boxes(mut body: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    std::iter::from_fn(move || {
        let mut c = Cursor(body);
        let (short, name) = (c.u32()?, c.take()?);
        let size = match short {
            0 => body.len(),
            1 => usize::try_from(c.u64()?).ok()?,
            size => size as usize,
        };
        let head = body.len() - c.0.len();
        let inner = body.get(head..size)?;
        body = &body[size..];
        Some((name, inner))
    })
}

pub(super) fn child<'a>(body: &'a [u8], name: &[u8; 4]) -> Option<&'a [u8]> {
    boxes(body).find(|(found, _)| found == name).map(|(_, inner)| inner).filter(|inner| !inner.is_empty())
}

pub(super) fn path<'a>(body: &'a [u8], names: &[&[u8; 4]]) -> Option<&'a [u8]> {
    names.iter().try_fold(body, |body, name| child(body, name))
}

/// Flags, and the data after them.
pub(super) fn full(body: &[u8]) -> Option<(u32, Cursor<'_>)> {
    let mut c = Cursor(body);
    Some((c.u32()? & 0xff_ffff, c))
}

/// The rows of a table with a counted head: version and flags, count, rows of `N` numbers.
pub(super) fn rows<const N: usize>(table: &[u8]) -> impl Iterator<Item = [u32; N]> {
    let count = table.get(4..).and_then(|rest| Cursor(rest).u32()).unwrap_or(0);
    rows_at(table, 8).take(count as usize)
}

pub(super) fn rows_at<const N: usize>(table: &[u8], start: usize) -> impl Iterator<Item = [u32; N]> {
    let mut c = Cursor(table.get(start..).unwrap_or_default());
    std::iter::from_fn(move || {
        let mut row = [0; N];
        for value in &mut row {
            *value = c.u32()?;
        }
        Some(row)
    })
}

pub(super) fn repeat(value: u32, n: u32) -> impl Iterator<Item = u32> {
    std::iter::repeat_n(value, n as usize)
}
