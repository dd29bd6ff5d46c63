//! What the ffmpeg of a stream logs: why it ended, damaged frames, and changes of the size.

use crate::Remarks;

#[derive(Debug, Default)]
pub(super) struct Heard {
    /// The first error of this ffmpeg.
    pub complaint: Option<String>,
    /// The first error since the last frame.
    damage: Option<String>,
    /// The size of the pictures as sent, and how often it changed since the last frame.
    size: Option<(usize, usize)>,
    resized: u64,
}

impl Heard {
    /// Another ffmpeg begins.
    pub(super) fn restart(&mut self) {
        (self.complaint, self.damage) = (None, None);
    }

    /// A line of the log.
    pub(super) fn hear(&mut self, line: &str) {
        if let Some((_, text)) = line.split_once("[error] ").or_else(|| line.split_once("[fatal] ")) {
            let text = text.trim();
            self.complaint.get_or_insert_with(|| text.to_owned());
            self.damage.get_or_insert_with(|| text.to_owned());
        } else if let Some(size) = line.split_once("[verbose] ").and_then(|(_, text)| size(text)) {
            self.resized += u64::from(self.size.replace(size).is_some_and(|before| before != size));
        }
    }

    /// Hands over what was logged until a frame, counted from 1. `begun`: this ffmpeg gave an earlier one.
    pub(super) fn report(&mut self, frame: usize, begun: bool, remarks: &Remarks) {
        if let Some(damage) = self.damage.take().filter(|_| begun) {
            remarks.add_damage(frame, &damage);
        }
        remarks.add_resized(frame, std::mem::take(&mut self.resized));
    }
}

/// The size of pictures that now enter the filters, as in `w:64 h:48 pixfmt:yuv420p tb:1/90000 ...`.
fn size(text: &str) -> Option<(usize, usize)> {
    let (width, rest) = text.strip_prefix("w:")?.split_once(" h:")?;
    let (height, _) = rest.split_once(" pixfmt:")?;
    Some((width.parse().ok()?, height.parse().ok()?))
}
