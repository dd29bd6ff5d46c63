//! Options for opening a video.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

/// What decodes a video file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Decoder {
    /// ffmpeg if it is installed and faster for the file, otherwise the decoders of this library, and ffmpeg again
    /// for files that these cannot read.
    #[default]
    Auto,
    /// The decoders of this library alone: H.264 in MP4.
    Builtin,
    /// The program ffmpeg alone.
    Ffmpeg,
}

impl Decoder {
    /// All of them, by name.
    pub const ALL: [(&'static str, Self); 3] =
        [("auto", Self::Auto), ("builtin", Self::Builtin), ("ffmpeg", Self::Ffmpeg)];
}

/// Options for opening a video: see [`crate::open_with`].
#[derive(Clone, Debug)]
pub struct Options {
    /// What decodes it. The pixels do not depend on it, as long as the file is whole.
    pub decoder: Decoder,
    /// The program ffmpeg: a path, or a name to be found as programs are.
    pub ffmpeg: PathBuf,
    /// Size of raw pixels. `None` if the source has a header.
    pub raw: Option<Raw>,
    /// Called with a line of text if the first frame suggests wrong options.
    pub notify: fn(&str),
    /// Decodes H.264 and pictures in a child process without access to files and network. Other sources are refused.
    pub sandbox: Option<Sandbox>,
}

/// The program that decodes in a child process, and its first arguments: a program that begins with
/// [`decode_if_asked`](crate::sandbox::decode_if_asked). Linux alone has such children.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sandbox(pub Vec<OsString>);

/// Bare pixels, row by row from the top left, frame after frame without gaps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Raw {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// The format of a pixel.
    pub pixels: Pixels,
}

impl Raw {
    /// Bytes of a frame.
    pub(crate) fn bytes(self) -> usize {
        self.width * self.height * if self.pixels == Pixels::Gray { 1 } else { 3 }
    }
}

/// The bytes of a bare pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pixels {
    /// Red, green, blue.
    #[default]
    Rgb24,
    /// Blue, green, red, as OpenCV has them.
    Bgr24,
    /// One byte of brightness.
    Gray,
}

impl Pixels {
    /// All of them, by name.
    pub const ALL: [(&'static str, Self); 3] = [("rgb24", Self::Rgb24), ("bgr24", Self::Bgr24), ("gray", Self::Gray)];
}

impl Default for Options {
    fn default() -> Self {
        Self { decoder: Decoder::Auto, ffmpeg: "ffmpeg".into(), raw: None, notify: |_| (), sandbox: None }
    }
}

/// Options for opening a stream.
#[derive(Clone, Debug)]
pub struct LiveOptions {
    /// The program ffmpeg: a path, or a name to be found as programs are.
    pub ffmpeg: PathBuf,
    /// Whether to listen at the address for a sender instead of connecting to it.
    pub listen: bool,
    /// How long to try to open it again after it broke off, or to wait for another sender; zero does not try.
    pub reconnect: Duration,
    /// Is called with a line of text when the stream waits for a sender, breaks off, or ends.
    pub notify: fn(&str),
}

impl Default for LiveOptions {
    fn default() -> Self {
        Self { ffmpeg: "ffmpeg".into(), listen: false, reconnect: Duration::from_secs(60), notify: |_| () }
    }
}
