//! What a child decodes, as its arguments.

use std::ffi::OsString;
use std::path::PathBuf;

/// The first argument of a child.
const ASKED: &str = "decode-in-sandbox";

/// The work of a child, which its arguments have.
pub(super) struct Job {
    /// The name of the video for errors; `None` for pictures.
    pub video: Option<PathBuf>,
    /// Bytes of memory.
    pub memory: u64,
    /// Seconds of processor time.
    pub seconds: u64,
}

impl Job {
    pub(super) fn arguments(&self) -> Vec<OsString> {
        let (memory, seconds) = (self.memory.to_string().into(), self.seconds.to_string().into());
        let name = self.video.as_ref().map(|name| name.clone().into_os_string());
        [ASKED.into(), memory, seconds].into_iter().chain(name).collect()
    }

    pub(super) fn of(arguments: &[OsString]) -> Option<Self> {
        let [asked, memory, seconds, name @ ..] = arguments else { return None };
        let number = |text: &OsString| text.to_str()?.parse().ok();
        let video = name.first().map(PathBuf::from);
        (asked == ASKED).then_some(Self { video, memory: number(memory)?, seconds: number(seconds)? })
    }
}
