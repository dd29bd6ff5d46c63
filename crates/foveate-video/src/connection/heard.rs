//! What the ffmpeg of a stream logs: why it ended, damaged frames, and changes of the size.

use crate::Remarks;
use crate::ffmpeg::NO_LENGTH;

/// What ffmpeg reports of a transfer from which nothing more can be read.
const NO_MORE: &str = "Input/output error";

#[derive(Debug, Default)]
pub(super) struct Heard {
    /// The first error of this ffmpeg.
    pub complaint: Option<String>,
    /// The first error since the last frame.
    damage: Option<String>,
    /// A transfer without a length is at its end: ffmpeg then reports that it cannot read on.
    ended: bool,
    /// The size of the pictures as sent, and how often it changed since the last frame.
    size: Option<(usize, usize)>,
    resized: u64,
}

impl Heard {
    /// Another ffmpeg begins.
    pub(super) fn restart(&mut self) {
        (self.complaint, self.damage, self.ended) = (None, None, false);
    }

    /// A line of the log.
    pub(super) fn hear(&mut self, line: &str) {
        if let Some((_, text)) = line.split_once("[error] ").or_else(|| line.split_once("[fatal] ")) {
            let text = text.trim();
            self.complaint.get_or_insert_with(|| text.to_owned());
            self.ended |= text.contains(NO_LENGTH);
            if !(self.ended && [NO_LENGTH, NO_MORE].iter().any(|words| text.contains(words))) {
                self.damage.get_or_insert_with(|| text.to_owned());
            }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_of_a_transfer_without_a_length_is_no_damage() {
        let end = "[http @ 0x1] [error] Stream ends prematurely at 178036, should be 18446744073709551615";
        let no_more = "[error] http://127.0.0.1:9/a.ts: Input/output error";
        let damaged = |lines: &[&str]| {
            let (mut heard, remarks) = (Heard::default(), Remarks::default());
            lines.iter().for_each(|line| heard.hear(line));
            heard.report(2, true, &remarks);
            // Another ffmpeg has not come to its end.
            heard.restart();
            heard.hear(no_more);
            heard.report(3, true, &remarks);
            remarks.damaged()
        };
        assert_eq!(damaged(&[end, no_more, no_more]), 1);
        assert_eq!(damaged(&[no_more]), 2);
        assert_eq!(damaged(&[end, no_more, "[h264 @ 0x1] [error] overread 8"]), 2);
        let cut = "[http @ 0x1] [error] Stream ends prematurely at 178036, should be 278036";
        assert_eq!(damaged(&[cut]), 2);
    }
}
