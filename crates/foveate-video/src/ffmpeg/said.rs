//! What ffmpeg logs, as far as it matters to people.

use crate::Remarks;

#[derive(Debug, Default)]
pub(crate) struct Said {
    pub complaint: Option<String>,
    /// The number of frames before its messages about the end of the file and the last corrupt frame.
    pub cut: Option<String>,
    pub corrupt: Option<(usize, String)>,
    pub frames: usize,
    /// The pictures have another size than the first.
    pub resized: bool,
    /// Where damage is counted.
    pub remarks: Remarks,
}

/// What ffmpeg logs of a file that was cut off. It ends well all the same.
const CUT: [&str; 8] = [
    "ended prematurely",
    "Error during demuxing",
    "partial file",
    "Truncating packet",
    // Of a transfer.
    "ends prematurely",
    "Connection timed out",
    "Connection reset",
    "Failed to open segment",
];
/// The length of a transfer that has none: its end is no cut.
pub(crate) const NO_LENGTH: &str = "should be 18446744073709551615";
/// The log line if our size filter refuses a picture.
const RESIZED: &str = "evaluating the expression 'if(eq(iw,";
/// Its message about a frame that it conceals in part.
const CORRUPT: [&str; 2] = ["corrupt decoded frame", "corrupt input packet"];

impl Said {
    /// A line of the log.
    pub(crate) fn hear(&mut self, line: &str) {
        let after = |level: &str| line.split_once(level).map(|(_, text)| text.trim().to_owned());
        let error = after("[error] ").or_else(|| after("[fatal] "));
        let Some(text) = error.clone().or_else(|| after("[warning] ")) else { return };
        if text.contains(NO_LENGTH) {
            return;
        }
        self.resized |= text.contains(RESIZED);
        if self.resized {
            // All that follows comes of it.
        } else if CUT.iter().any(|words| text.contains(words)) {
            self.cut.get_or_insert(text);
        } else if CORRUPT.iter().any(|words| text.contains(words)) {
            self.remarks.add_damage(self.frames + 1, &text);
            self.corrupt = Some((self.frames, text));
        } else if let Some(error) = error {
            self.remarks.add_damage(self.frames + 1, &error);
            self.complaint.get_or_insert(error);
        }
    }
}
