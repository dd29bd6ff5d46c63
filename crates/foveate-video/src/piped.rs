//! Raw video from a pipe, a fifo or a file: yuv4mpeg, or bare pixels of a size that is given.

use std::io::Read;
use std::path::PathBuf;

use crate::decode::MAX_SIDE;
use crate::decoded::DecodeError;
use crate::options::{Pixels, Raw};
use crate::skew::better_width;
use crate::y4m::Y4m;
use crate::yuv::Colour;
use crate::{Frame, FrameSource, Remarks, SourceInfo};
use foveate_base::{Error, Result, memory};
use foveate_core::geometry::Size;
use foveate_core::scene::Image;

type Bytes = Box<dyn Read + Send>;

/// Frames of raw video, in order, none left out.
pub(crate) struct Piped {
    name: PathBuf,
    info: SourceInfo,
    remarks: Remarks,
    kind: Option<Kind>,
    next: usize,
    notify: fn(&str),
}

enum Kind {
    Y4m(Y4m<Bytes>),
    Raw(Bytes, Raw, Vec<u8>),
}

/// Default frames a second.
const RATE: f64 = 30.0;

impl Piped {
    /// yuv4mpeg; `read` was read of it already. `name` is for errors.
    ///
    /// # Errors
    /// Fails if it does not begin as yuv4mpeg does.
    pub(crate) fn y4m(name: PathBuf, reader: Bytes, read: &[u8]) -> Result<Self> {
        let stream = Y4m::new(reader, read).map_err(|error| match error {
            DecodeError::Damaged(problem) | DecodeError::Unsupported(problem) => Error::malformed(&name, problem),
        })?;
        let stored = Size::new(stream.head.width, stream.head.height);
        let shown @ Size { width, height } = stream.head.aspect.shown(stored);
        let remarks = Remarks::default();
        remarks.set_sides(stored, shown);
        let rate = stream.head.rate.unwrap_or(RATE);
        let info = SourceInfo { width, height, frames: None, rate, reader: "yuv4mpeg".into() };
        Ok(Self { name, info, remarks, kind: Some(Kind::Y4m(stream)), next: 0, notify: |_| () })
    }

    /// Raw pixels, row by row, frame after frame; `bytes` in all, if known. Calls `notify` if the first picture seems
    /// to have another width.
    ///
    /// # Errors
    /// Fails if the size is none, or the bytes are no whole number of frames.
    pub(crate) fn raw(name: PathBuf, reader: Bytes, bytes: Option<u64>, raw: Raw, notify: fn(&str)) -> Result<Self> {
        let (width, height) = (raw.width, raw.height);
        if ![width, height].iter().all(|side| (1..=MAX_SIDE).contains(side)) {
            let problem =
                format!("expected sides from 1 to {MAX_SIDE} pixels, found {width} x {height}; give another size");
            return Err(Error::malformed(&name, problem));
        }
        memory::check_picture(width, height)?;
        let frame = raw.bytes() as u64;
        if let Some(n) = bytes.filter(|n| n % frame != 0) {
            let (whole, rest) = (n / frame, n % frame);
            let problem = format!(
                "expected whole frames of {frame} bytes ({width} x {height}), found {n} bytes, which are {whole} frames and {rest} bytes; check --raw and --pix"
            );
            let cut = if whole > 0 {
                format!(", or cut an unfinished frame off: head -c {}", whole * frame)
            } else {
                String::new()
            };
            return Err(Error::malformed(&name, problem + &cut));
        }
        let info = SourceInfo { width, height, frames: None, rate: RATE, reader: "raw pixels".into() };
        let (remarks, kind) = (Remarks::default(), Some(Kind::Raw(reader, raw, vec![])));
        Ok(Self { name, info, remarks, kind, next: 0, notify })
    }
}

impl Kind {
    fn picture(&mut self) -> Option<std::result::Result<Image, String>> {
        match self {
            Self::Y4m(stream) => Some(match stream.picture()? {
                Ok(yuv) => {
                    // Grey that states no range is written in full range by the programs that write it.
                    let full = stream.head.full_range.unwrap_or(yuv.is_grey());
                    let image = yuv.to_rgb(Colour::new(None, full, yuv.width, yuv.height));
                    stream.head.aspect.square(image).map_err(|error| error.to_string())
                }
                Err(DecodeError::Damaged(problem) | DecodeError::Unsupported(problem)) => Err(problem),
            }),
            Self::Raw(reader, raw, bytes) => {
                let wanted = raw.bytes();
                bytes.clear();
                match reader.take(wanted as u64).read_to_end(bytes) {
                    Ok(0) => return None,
                    Ok(n) if n < wanted => {
                        let todo = "check --raw and --pix";
                        return Some(Err(format!("it ends after {n} of the {wanted} bytes of a frame; {todo}")));
                    }
                    Ok(_) => (),
                    Err(e) => return Some(Err(format!("cannot read on: {e}"))),
                }
                if raw.pixels == Pixels::Bgr24 {
                    bytes.chunks_exact_mut(3).for_each(|pixel| pixel.swap(0, 2));
                }
                let image = match raw.pixels {
                    Pixels::Gray => Image::from_grey8(raw.width, raw.height, bytes),
                    _ => Image::from_rgb8(raw.width, raw.height, bytes),
                };
                Some(image.map_err(|e| e.to_string()))
            }
        }
    }
}

impl Iterator for Piped {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let picture = self.kind.as_mut()?.picture();
        if !matches!(picture, Some(Ok(_))) {
            self.kind = None;
        }
        let index = self.next;
        self.next += 1;
        if let (0, Some(Kind::Raw(_, raw, _)), Some(Ok(image))) = (index, &self.kind, &picture)
            && let Some(better) = better_width(image)
        {
            let (name, width, height) = (self.name.display(), raw.width, raw.height);
            (self.notify)(&format!(
                "{name}: the rows of the first frame do not fit together at --raw {width}x{height}, but at {better} pixels a row; check --raw and --pix"
            ));
        }
        Some(match picture? {
            Ok(image) => Ok(Frame { index, time: index as f64 / self.info.rate, image }),
            Err(problem) => Err(Error::Frame { path: self.name.clone(), frame: index + 1, problem }),
        })
    }
}

impl FrameSource for Piped {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
    fn remarks(&self) -> Remarks {
        self.remarks.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn raw(pixels: Pixels, bytes: &[u8]) -> Vec<std::result::Result<Image, String>> {
        let raw = Raw { width: 2, height: 1, pixels };
        let source = Piped::raw("-".into(), Box::new(Cursor::new(bytes.to_vec())), None, raw, |_| ()).expect("a size");
        source.map(|frame| frame.map(|f| f.image).map_err(|e| e.to_string())).collect()
    }

    #[test]
    fn raw_pixels_are_frames() {
        let image = Image::from_rgb8(2, 1, &[1, 2, 3, 4, 5, 6]).expect("sizes agree");
        assert_eq!(raw(Pixels::Rgb24, &[1, 2, 3, 4, 5, 6]), [Ok(image.clone())]);
        assert_eq!(raw(Pixels::Bgr24, &[3, 2, 1, 6, 5, 4]), [Ok(image)]);
        let grey = raw(Pixels::Gray, &[1, 2, 3, 4, 5]);
        assert_eq!(grey.len(), 3);
        assert_eq!(grey[1], Ok(Image::new(2, 1, 1, vec![3, 4]).expect("sizes agree")));
        assert!(grey[2].as_ref().is_err_and(|e| e.contains("1 of the 2 bytes") && e.contains("frame 3")));
        let size = Raw { width: 0, height: 1, pixels: Pixels::Gray };
        assert!(Piped::raw("-".into(), Box::new(Cursor::new(vec![])), None, size, |_| ()).is_err());
    }

    #[test]
    fn a_y4m_file_is_read_as_a_pipe_is() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("a.y4m");
        let mut text = b"YUV4MPEG2 W4 H2 F10:1 Cmono\n".to_vec();
        (1..4u8).for_each(|i| text.extend([b"FRAME\n".as_slice(), &[i; 8]].concat()));
        std::fs::write(&path, &text).expect("a writable folder");
        let source = crate::open(&path).expect("a video");
        assert_eq!((source.info().width, source.info().rate, &*source.info().reader), (4, 10.0, "yuv4mpeg"));
        let frames: Vec<Frame> = source.map(|frame| frame.expect("a frame")).collect();
        assert_eq!(
            frames.iter().map(|f| (f.index, f.time, f.image.at(0, 0, 0))).collect::<Vec<_>>(),
            [(0, 0.0, 1), (1, 0.1, 2), (2, 0.2, 3)]
        );
        std::fs::write(&path, &text[..text.len() - 3]).expect("a writable folder");
        let last = crate::open(&path).expect("a video").last().expect("an error").expect_err("cut off").to_string();
        assert!(last.contains("a.y4m") && last.contains("frame 3"), "{last}");
    }
}
