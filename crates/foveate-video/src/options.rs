//! How a video is to be opened.

use std::path::PathBuf;
use std::str::FromStr;

/// What decodes a video file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Decoder {
    /// The program ffmpeg where it is installed and faster for the file, else the decoders of this library, and ffmpeg again for
    /// what these cannot read.
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

impl FromStr for Decoder {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|(name, _)| *name == text);
        found.map(|(_, decoder)| decoder).ok_or_else(|| format!("expected auto, builtin or ffmpeg, got \"{text}\""))
    }
}

/// How a video is to be opened: see [`crate::open_with`].
#[derive(Clone, Debug)]
pub struct Options {
    /// What decodes it. The pixels do not depend on it, as long as the file is whole.
    pub decoder: Decoder,
    /// The program ffmpeg: a path, or a name to be found as programs are.
    pub ffmpeg: PathBuf,
}

impl Default for Options {
    fn default() -> Self {
        Self { decoder: Decoder::Auto, ffmpeg: "ffmpeg".into() }
    }
}
