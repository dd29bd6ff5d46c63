//! H.264 in MP4 for a decoder that is not ours: which bytes are which frame, and pictures of the planes that come back.

use std::io::{Read, Seek};
use std::path::PathBuf;

use crate::decoded::DecodeError;
use crate::stream::Mp4;
use crate::yuv::Yuv;
use crate::{Frame, SourceInfo};
use foveate_base::{Error, Result};
use foveate_core::geometry::Size;

/// A video as it is coded.
pub struct CodedVideo {
    name: PathBuf,
    mp4: Mp4,
}

foveate_base::opaque_debug!(CodedVideo);

/// A coded frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CodedFrame {
    /// Its first byte in the file.
    pub offset: u64,
    /// Bytes.
    pub size: u32,
    /// Its number in the order of presentation, from 0; `None` if it is decoded but not shown.
    pub place: Option<u32>,
    /// Whether it needs no other frame.
    pub key: bool,
}

/// How 8 bits of 4:2:0 lie in a row: brightness, then both colours at half the width and height, rounded up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Planes {
    /// Blue, then red.
    I420,
    /// Blue and red in turns.
    Nv12,
}

impl CodedVideo {
    /// Reads the index of a file of `len` bytes; errors call it `name`.
    ///
    /// # Errors
    /// It cannot be read, or is no MP4 file with H.264.
    pub fn open(name: impl Into<PathBuf>, file: impl Read + Seek + Send + 'static, len: u64) -> Result<Self> {
        let name = name.into();
        match Mp4::new(Box::new(file), len) {
            Ok(mp4) => Ok(Self { name, mp4 }),
            Err(DecodeError::Unsupported(what)) => Err(Error::malformed(&name, format!("this is {what}"))),
            Err(DecodeError::Damaged(what)) => Err(Error::malformed(&name, what)),
        }
    }

    /// The decoder configuration record (`avcC`): profile, level, parameter sets.
    pub fn description(&self) -> &[u8] {
        self.mp4.description()
    }

    /// The frames, in the order in which they are decoded.
    pub fn frames(&self) -> impl Iterator<Item = CodedFrame> {
        let frame = |(sample, place): (&crate::mp4::Sample, Option<u32>)| {
            let (offset, size, key) = (sample.offset, sample.size, sample.key);
            CodedFrame { offset, size, place, key }
        };
        self.mp4.samples().map(frame)
    }

    /// The frame at a position from planes of another decoder, of this size as coded. With equal planes it
    /// equals that of [`VideoFile`](crate::VideoFile).
    ///
    /// # Errors
    /// The position does not exist, the number of bytes does not fit the size, or the picture is not of the video's
    /// size.
    pub fn picture(&self, place: usize, size: Size, planes: Planes, bytes: &[u8], info: &SourceInfo) -> Result<Frame> {
        let Size { width, height } = size;
        let wrong = |problem: String| Error::Frame { path: self.name.clone(), frame: place + 1, problem };
        let time = self.mp4.time_of(place).ok_or_else(|| wrong("the video has no such frame".into()))?;
        let chroma = Size::new(width.div_ceil(2), height.div_ceil(2));
        let (luma, each) = (width.saturating_mul(height), chroma.width.saturating_mul(chroma.height));
        if width == 0 || height == 0 || bytes.len() != luma.saturating_add(2 * each) {
            return Err(wrong(format!("expected a picture of {size} pixels, found {} bytes", bytes.len())));
        }
        let (y, colours) = bytes.split_at(luma);
        let (u, v) = match planes {
            Planes::I420 => (colours[..each].to_vec(), colours[each..].to_vec()),
            Planes::Nv12 => colours.chunks_exact(2).map(|pair| (pair[0], pair[1])).unzip(),
        };
        let image = self.mp4.image(&Yuv { width, height, chroma, y: y.to_vec(), u, v })?;
        if image.size() != info.size() {
            return Err(wrong(format!("expected {} pixels, found {}", info.size(), image.size())));
        }
        Ok(Frame { index: place, time, image })
    }
}

#[cfg(test)]
mod tests {
    use foveate_testing::{data, need};
    use std::io::Cursor;

    use super::*;
    use crate::{FrameSource, Mp4Writer, VideoFile};
    use foveate_core::scene::Image;

    /// Its bytes, and both ways to read it.
    fn video(bytes: &[u8]) -> (CodedVideo, VideoFile, Mp4) {
        let (len, file) = (bytes.len() as u64, || Cursor::new(bytes.to_vec()));
        let coded = CodedVideo::open("a.mp4", file(), len).expect("H.264 in MP4");
        let own = VideoFile::from_reader("a.mp4", file(), len).expect("the same");
        (coded, own, Mp4::new(Box::new(file()), len).expect("the same"))
    }

    /// Planes from elsewhere give the frames that our own decoder gives; keys are where a decoder may begin.
    fn check(bytes: &[u8], most: usize) {
        let (coded, own, mut planes) = video(bytes);
        let info = own.info().clone();
        let frames: Vec<CodedFrame> = coded.frames().collect();
        let mut places: Vec<u32> = frames.iter().filter_map(|frame| frame.place).collect();
        places.sort_unstable();
        assert_eq!(places, (0..places.len() as u32).collect::<Vec<_>>(), "each frame once");
        assert_eq!(info.frames, Some(places.len()));
        let setup = crate::h264::Setup::read(coded.description()).expect("settings");
        for frame in &frames {
            let data = &bytes[frame.offset as usize..][..frame.size as usize];
            assert_eq!(frame.key, setup.starts_anew(data).expect("units"), "{frame:?}");
        }
        for (place, frame) in own.take(most).enumerate() {
            let frame = frame.expect("a good frame");
            let (yuv, _) = planes.yuv().expect("a frame").expect("a good one");
            let size = Size::new(yuv.width, yuv.height);
            let woven: Vec<u8> = yuv.u.iter().zip(&yuv.v).flat_map(|(u, v)| [*u, *v]).collect();
            for (kind, bytes) in
                [(Planes::I420, [&*yuv.y, &*yuv.u, &*yuv.v].concat()), (Planes::Nv12, [&*yuv.y, &*woven].concat())]
            {
                let other = coded.picture(place, size, kind, &bytes, &info).expect("as many bytes");
                assert_eq!((other.index, other.time), (frame.index, frame.time));
                assert!(other.image == frame.image, "frame {place} differs");
                let short = coded.picture(place, size, kind, &bytes[1..], &info);
                assert!(short.expect_err("a byte is missing").to_string().contains("pixels"));
            }
        }
        assert!(coded.picture(places.len(), Size::new(2, 2), Planes::I420, &[0; 6], &info).is_err());
    }

    #[test]
    fn planes_from_elsewhere_give_the_same_frames() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("a.mp4");
        let mut writer = Mp4Writer::create(&path, 51, 33, 25.0).expect("a writable folder");
        for t in 0..40u8 {
            let data = (0..3 * 51 * 33).map(|i| (i % 251) as u8 ^ (t * 3)).collect();
            writer.push(&Image::new(51, 33, 3, data).expect("sizes agree"), f64::from(t) / 25.0).expect("a frame");
        }
        writer.finish().expect("written");
        check(&std::fs::read(&path).expect("a file"), 40);
        for name in ["car-detection", "bottle-detection", "hockey"] {
            let clip = need!(data(&format!("clips/{name}.mp4")));
            check(&std::fs::read(clip).expect("a file"), 20);
        }
    }
}
