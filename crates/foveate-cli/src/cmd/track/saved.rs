//! The saved state of `--save-state` and `--load-state`.

use std::path::Path;

use foveate::extend;
use foveate::video::SourceInfo;
use foveate::{Error, Result, files, memory};

/// The state of a tracker, which names its configuration and seed, and the next frame of the video.
#[derive(serde::Serialize, serde::Deserialize)]
pub(super) struct SavedState {
    pub next_frame: usize,
    /// The name of the video, without its folder.
    pub source: String,
    /// Width and height of the tracked pictures.
    pub size: [usize; 2],
    pub tracker: extend::SavedState,
}

/// Most frames before a state: a thousand a second for a century.
const MOST_FRAMES: usize = 1 << 42;
/// Bytes of a parsed value and its copy, and of the first entry of an object, at most.
const VALUE: u64 = 100;
const OBJECT: u64 = 1400;

/// Returns the approximate bytes of a JSON text as values: a text of brackets and commas takes a hundred times its size.
fn parsed(text: &str) -> u64 {
    let of = |byte: &u8| match byte {
        b',' | b'[' => VALUE,
        b'{' => OBJECT,
        _ => 2,
    };
    text.as_bytes().iter().map(of).sum()
}

/// Returns the last component of a path or an address.
pub(super) fn video_name(source: &Path) -> String {
    let whole = std::fs::canonicalize(source);
    whole.as_deref().unwrap_or(source).file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

impl SavedState {
    /// Writes the state of a tracker after the frame before `next_frame` of this video.
    pub(super) fn write(
        path: &Path,
        (source, about): (&Path, &SourceInfo),
        next_frame: usize,
        tracker: extend::SavedState,
    ) -> Result<()> {
        let saved = Self { next_frame, source: video_name(source), size: [about.width, about.height], tracker };
        let text = serde_json::to_string(&saved).map_err(|e| Error::Invalid(e.to_string()))?;
        files::write(path, text.as_bytes())
    }

    /// Refuses pictures of another size than the tracked ones.
    pub(super) fn check_size(&self, path: &Path, about: &SourceInfo) -> Result<()> {
        let (then, now) = (self.size, [about.width, about.height]);
        if then == now {
            return Ok(());
        }
        let problem =
            format!("it was saved in pictures of {} x {} pixels, these have {} x {}", then[0], then[1], now[0], now[1]);
        Err(Error::malformed(path, format!("{problem}; give the same --scale and video")))
    }

    /// Reads a state.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = files::read_text(path, files::TEXT)?;
        memory::check(format_args!("{}: a state of {} bytes", path.display(), text.len()), parsed(&text))?;
        let saved: Self = serde_json::from_str(&text)
            .map_err(|e| Error::malformed(path, format!("not a state written by --save-state: {e}; write it again")))?;
        if saved.next_frame > MOST_FRAMES {
            let problem =
                format!("it continues after {} frames, more than a video has; write it again", saved.next_frame);
            return Err(Error::malformed(path, problem));
        }
        Ok(saved)
    }
}
