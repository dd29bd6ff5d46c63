//! Video files as sources of frames, in the order of presentation.
//!
//! The library reads H.264 in MP4 itself. The external program ffmpeg reads everything else, and streams that our
//! decoders do not support. If installed, it also decodes long H.264, because it is faster; the pixels are the same.
//! Memory holds one frame, the few frames that wait for their turn, and the index.

use std::fs::File;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};

use crate::child::{Interrupt, Leash};
use crate::decoded::{DecodeError, Picture};
use crate::ffmpeg::{Ffmpeg, Input};
use crate::frame::FFMPEG;
use crate::options::{Decoder, Options};
use crate::sandbox::ApartVideo;
use crate::stream::{Bytes, Mp4};
use crate::{Frame, FrameSource, Remarks, SourceInfo};
use foveate_base::{Error, Result};

/// A video file.
pub struct VideoFile {
    path: PathBuf,
    options: Options,
    leash: Leash,
    info: SourceInfo,
    remarks: Remarks,
    reader: Option<Reader>,
    first: Option<Frame>,
    next: usize,
}

foveate_base::opaque_debug!(VideoFile);

enum Reader {
    Mp4(Box<Mp4>),
    Ffmpeg(Box<Ffmpeg>),
    Apart(Box<ApartVideo>),
}

impl VideoFile {
    /// Opens a video file and decodes its first frame.
    ///
    /// # Errors
    /// Fails if the file cannot be read, has no video, its first frame cannot be decoded, or its kind needs
    /// ffmpeg and that is not installed.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_with(path, &Options::default())
    }

    /// Opens a video file with a decoder of choice, and decodes its first frame. The sandbox, if the options have one, has our own decoders
    /// alone.
    ///
    /// # Errors
    /// As [`VideoFile::open`], and if the chosen decoder cannot read it, or there is no sandbox here.
    pub fn open_with(path: impl AsRef<Path>, options: &Options) -> Result<Self> {
        Self::open_path(path.as_ref(), options)
    }

    fn open_path(path: &Path, options: &Options) -> Result<Self> {
        let file = File::open(path).map_err(Error::io(path, "cannot open"))?;
        let len = file.metadata().map_err(Error::io(path, "cannot open"))?.len();
        let Some(sandbox) = &options.sandbox else { return Self::read(path, Box::new(file), len, options) };
        let mut video = Self::unread(path.to_owned(), options.clone());
        let child = ApartVideo::open(path, (file, len), sandbox, (&video.leash, &video.remarks))?;
        video.reader = Some(Reader::Apart(Box::new(child)));
        video.begun()
    }

    /// Opens H.264 in MP4 from `len` bytes that are not a file of the system, with our own decoders; errors call it
    /// `name`.
    ///
    /// # Errors
    /// Fails if it cannot be read, is no MP4 file with H.264, or its first frame cannot be decoded.
    pub fn from_reader(name: impl Into<PathBuf>, file: impl Read + Seek + Send + 'static, len: u64) -> Result<Self> {
        let options = Options { decoder: Decoder::Builtin, ..Options::default() };
        Self::read(&name.into(), Box::new(file), len, &options)
    }

    fn read(path: &Path, mut file: Box<dyn Bytes>, len: u64, options: &Options) -> Result<Self> {
        let mut video = Self::unread(path.to_owned(), options.clone());
        let mut head = [0; 12];
        let opened = match file.read_exact(&mut head) {
            Ok(()) if is_mp4(&head) => Mp4::new(file, len),
            Ok(()) if is_sound(&head) => {
                Err(DecodeError::Damaged("expected a video, found sound alone; give a file with pictures".into()))
            }
            _ => Err(DecodeError::Unsupported("a file of another kind than MP4".into())),
        };
        match opened {
            Ok(mp4) => video.begin(mp4)?,
            Err(DecodeError::Unsupported(why)) => video.hand_over(&why)?,
            Err(DecodeError::Damaged(problem)) => return Err(Error::malformed(&video.path, problem)),
        }
        video.begun()
    }

    /// Opens bytes that are not a file of the system with ffmpeg; errors call them `name`.
    pub(crate) fn of_input(name: PathBuf, input: Input, ffmpeg: &Path) -> Result<Self> {
        let mut video = Self::unread(name, Options { ffmpeg: ffmpeg.to_owned(), ..Options::default() });
        let reader =
            Ffmpeg::of_input(ffmpeg, input, 0, &video.leash, &video.remarks).map_err(|problem| video.error(problem))?;
        video.reader = Some(Reader::Ffmpeg(Box::new(reader)));
        video.begun()
    }

    fn unread(path: PathBuf, options: Options) -> Self {
        let info = SourceInfo { width: 0, height: 0, frames: None, rate: 0.0, reader: String::new() };
        let (leash, remarks) = (Leash::default(), Remarks::default());
        Self { path, options, leash, info, remarks, reader: None, first: None, next: 0 }
    }

    /// Decodes the first frame.
    fn begun(mut self) -> Result<Self> {
        let video = &mut self;
        let none = "expected frames, found none to show; check the file with another player";
        let (image, time) = video.picture().unwrap_or_else(|| Err(Error::malformed(&video.path, none)))?;
        let (frames, rate, reader) = match &video.reader {
            Some(Reader::Mp4(mp4)) => (Some(mp4.frames()), mp4.rate(), mp4.decoder()),
            Some(Reader::Ffmpeg(ffmpeg)) => (ffmpeg.frames(), ffmpeg.rate(), FFMPEG),
            Some(Reader::Apart(child)) => (child.about().frames, child.about().rate, &*child.about().reader),
            None => (None, 0.0, ""),
        };
        video.info = SourceInfo { width: image.width(), height: image.height(), frames, rate, reader: reader.into() };
        video.first = Some(Frame { index: 0, time, image });
        Ok(self)
    }

    /// Chooses the decoder of an MP4 file.
    fn begin(&mut self, mut mp4: Mp4) -> Result<()> {
        self.remarks = mp4.remarks().clone();
        let asked = self.options.decoder == Decoder::Ffmpeg;
        if asked || (self.options.decoder == Decoder::Auto && mp4.wants_ffmpeg()) {
            let file = File::open(&self.path).map_err(Error::io(&self.path, "cannot open"))?;
            match mp4.feed(file, &self.options.ffmpeg, &self.leash) {
                Err(problem) if asked => return Err(self.error(problem)),
                // Without the program our own decoders do.
                _ => (),
            }
        }
        self.reader = Some(Reader::Mp4(Box::new(mp4)));
        Ok(())
    }

    /// The next picture, from the next better decoder if one does not support it.
    fn picture(&mut self) -> Option<Result<Picture>> {
        loop {
            let outcome = match self.reader.as_mut()? {
                Reader::Mp4(mp4) => mp4.picture(),
                Reader::Ffmpeg(ffmpeg) => ffmpeg.picture(),
                Reader::Apart(child) => child.picture(),
            };
            let Some(outcome) = outcome else {
                self.reader = None;
                return None;
            };
            let error = match outcome {
                Ok(picture) => return Some(Ok(picture)),
                Err(DecodeError::Unsupported(why)) => match self.hand_over(&why) {
                    Ok(()) => continue,
                    Err(error) => error,
                },
                Err(DecodeError::Damaged(problem)) => self.error(problem),
            };
            self.reader = None;
            return Some(Err(error));
        }
    }

    /// Goes on with the next decoder, at the frame that this one could not do.
    fn hand_over(&mut self, why: &str) -> Result<()> {
        if let Some(Reader::Mp4(mp4)) = &mut self.reader
            && mp4.widen()
        {
            return Ok(());
        }
        if self.options.decoder == Decoder::Builtin {
            let problem = format!("this is {why}; expected H.264 in MP4, which alone is read without ffmpeg");
            return Err(self.error(problem + "; take the decoder auto or ffmpeg, or convert the video"));
        }
        match Ffmpeg::open(&self.options.ffmpeg, &self.path, self.next, &self.leash, &self.remarks) {
            Ok(ffmpeg) => self.reader = Some(Reader::Ffmpeg(Box::new(ffmpeg))),
            Err(problem) => return Err(self.error(format!("this is {why}; {problem}"))),
        }
        Ok(())
    }

    fn error(&self, problem: String) -> Error {
        Error::Frame { path: self.path.clone(), frame: self.next + 1, problem }
    }
}

impl Iterator for VideoFile {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let frame = match self.first.take() {
            Some(first) => Ok(first),
            None => self.picture()?.and_then(|(image, time)| {
                let (found, wanted) = (image.size(), self.info.size());
                if found == wanted {
                    return Ok(Frame { index: self.next, time, image });
                }
                self.reader = None;
                Err(self.error(format!(
                    "expected {wanted} pixels as in the first frame, found {found}; cut the video where the size changes"
                )))
            }),
        };
        self.next += 1;
        Some(frame)
    }
}

impl FrameSource for VideoFile {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
    fn interrupt(&self) -> Option<Interrupt> {
        Some(self.leash.interrupt())
    }
    fn remarks(&self) -> Remarks {
        self.remarks.clone()
    }
}

/// Whether a file that begins so is an MP4 or QuickTime file.
pub(super) fn is_mp4(head: &[u8]) -> bool {
    let names: [&[u8]; 8] = [b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"pnot", b"styp"];
    head.get(4..8).is_some_and(|name| names.contains(&name))
}

/// Whether a file that begins so is one of the kinds that hold sound alone: MP3, AAC, FLAC, WAVE, AIFF, AMR, MIDI, AU, CAF, WavPack, Musepack,
/// Monkey's Audio.
fn is_sound(head: &[u8; 12]) -> bool {
    let names: [&[u8]; 11] =
        [b"ID3", b"fLaC", b"#!AMR", b"MThd", b".snd", b"caff", b"wvpk", b"MPCK", b"MAC ", b"\xff\xf1", b"\xff\xf9"];
    // A frame of MPEG sound of layers 1 to 3: eleven bits of ones, a layer, a rate.
    let mpeg =
        head[0] == 0xff && head[1] & 0xe0 == 0xe0 && head[1] & 0x18 != 0x08 && head[1] & 6 != 0 && head[2] >> 4 != 15;
    let chunks =
        (&head[..4] == b"RIFF" && &head[8..] == b"WAVE") || (&head[..4] == b"FORM" && head[8..].starts_with(b"AIF"));
    names.iter().any(|name| head.starts_with(name)) || mpeg || chunks
}
