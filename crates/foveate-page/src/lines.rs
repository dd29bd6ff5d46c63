//! boxes.txt, track.csv and track.jsonl of a growing track, with one line of each per frame, so that a correction can remove lines. Older
//! lines are compressed, from a few hundred bytes per frame to fewer than two hundred.

use std::collections::VecDeque;
use std::io::{Read, Write};

use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;

use foveate_base::Result;
use foveate_base::sink::{Memory, Sink};
use foveate_core::Seen;
use foveate_report::stream::Format;
use foveate_report::{Boxes, Observer, Stream, Table};
use foveate_video::{Frame, Meter, Remarks};

/// The files.
pub const FILES: [&str; 3] = ["boxes.txt", "track.csv", "track.jsonl"];
/// Number of frames that are compressed together.
const CHUNK: usize = 256;

/// Returns the name of a target's file: unchanged for the first target, `target-2-boxes.txt` for the second.
pub(crate) fn named(target: usize, file: &str) -> String {
    if target == 0 { file.to_owned() } else { format!("target-{}-{file}", target + 1) }
}

/// Returns the target, from 0, and the file with this name.
pub(crate) fn target_of(name: &str) -> (usize, &str) {
    let parts = name.strip_prefix("target-").and_then(|rest| rest.split_once('-'));
    let found = parts.and_then(|(number, file)| Some((number.parse::<usize>().ok().filter(|n| *n > 1)? - 1, file)));
    found.unwrap_or((0, name))
}

/// Lines of the three files of a growing track.
pub(crate) struct Lines {
    kept: Kept,
    observers: [Box<dyn Observer + Send>; 3],
    out: [Memory; 3],
}

#[derive(Default)]
struct Kept {
    /// The first stored frame, from 0.
    first: usize,
    /// The header line of track.csv.
    header: String,
    /// Chunks of lines, compressed.
    packed: VecDeque<Vec<u8>>,
    /// The most recent lines, three per frame, and their frames.
    tail: String,
    frames: usize,
    /// Maximum number of frames; newer frames replace older ones.
    most: Option<usize>,
}

impl Kept {
    fn push(&mut self, index: usize, lines: [String; 3]) {
        if self.packed.is_empty() && self.frames == 0 {
            self.first = index;
        }
        lines.iter().for_each(|line| self.tail += line);
        self.frames += 1;
        if self.frames == CHUNK {
            self.packed.push_back(pack(&self.tail));
            self.tail.clear();
            self.frames = 0;
        }
        if self.most.is_some_and(|most| self.packed.len().saturating_sub(1) * CHUNK >= most) {
            self.packed.pop_front();
            self.first += CHUNK;
        }
    }

    fn cut(&mut self, index: usize) {
        let left = index.saturating_sub(self.first);
        while left < self.packed.len() * CHUNK
            && let Some(chunk) = self.packed.pop_back()
        {
            (self.tail, self.frames) = (unpack(&chunk), CHUNK);
        }
        let frames = left - self.packed.len() * CHUNK;
        if frames < self.frames {
            let end = self.tail.split_inclusive('\n').take(3 * frames).map(str::len).sum();
            self.tail.truncate(end);
            self.frames = frames;
        }
    }

    fn piece(&self, name: &str, piece: usize) -> Option<String> {
        let which = FILES.iter().position(|known| *known == name)?;
        let chunk = match self.packed.get(piece) {
            Some(packed) => unpack(packed),
            None if piece == self.packed.len() => self.tail.clone(),
            None => return None,
        };
        let header = if piece == 0 && name == "track.csv" { &*self.header } else { "" };
        let lines = chunk.split_inclusive('\n').skip(which).step_by(3);
        Some(std::iter::once(header).chain(lines).collect())
    }
}

/// Writing text to memory and reading back our own output cannot fail.
fn pack(text: &str) -> Vec<u8> {
    let mut encoder = DeflateEncoder::new(vec![], Compression::default());
    let mut bytes = encoder.write_all(text.as_bytes()).and_then(|()| encoder.finish()).expect("memory takes it");
    bytes.shrink_to_fit();
    bytes
}

fn unpack(bytes: &[u8]) -> String {
    let mut text = String::new();
    DeflateDecoder::new(bytes).read_to_string(&mut text).expect("it was packed here");
    text
}

impl Lines {
    /// Creates an empty store. It keeps `most` frames, or slightly more; `meter` and `remarks` are those of the source.
    pub(crate) fn new(most: Option<usize>, meter: Option<Meter>, remarks: Remarks) -> Self {
        let out: [Memory; 3] = Default::default();
        let sink = |i: usize| Sink::memory(FILES[i], out[i].clone());
        let observers: [Box<dyn Observer + Send>; 3] = [
            Box::new(Boxes::to(sink(0))),
            Box::new(Table::to(sink(1))),
            Box::new(Stream::new(out[2].clone(), Format::Json, meter, remarks)),
        ];
        Self { kept: Kept { most, ..Kept::default() }, observers, out }
    }

    /// Returns a piece of a file, from 0; `None` after the last one, or if there is no such file.
    pub(crate) fn piece(&self, name: &str, piece: usize) -> Option<String> {
        self.kept.piece(name, piece)
    }

    fn take(&mut self, index: usize) {
        let [boxes, mut table, json] = self.out.each_ref().map(|out| String::from_utf8_lossy(&out.take()).into_owned());
        let kept = &mut self.kept;
        // The header comes with the first line.
        if kept.header.is_empty()
            && let Some(end) = table.find('\n')
        {
            let line = table.split_off(end + 1);
            kept.header = std::mem::replace(&mut table, line);
        }
        kept.push(index, [boxes, table, json]);
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// It cannot be written.
    pub(crate) fn observe(&mut self, frame: &Frame, seen: &Seen<'_>) -> Result<()> {
        self.observers.iter_mut().try_for_each(|o| o.observe(frame, std::slice::from_ref(seen)))?;
        self.take(frame.index);
        Ok(())
    }
    /// Removes all frames from `index` (from 0) on.
    pub(crate) fn cut(&mut self, index: usize) {
        self.kept.cut(index);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(k: usize) -> [String; 3] {
        ["box", "row", "json"].map(|kind| format!("{kind} {k}\n"))
    }

    fn file(kept: &Kept, name: &str) -> String {
        (0..).map_while(|piece| kept.piece(name, piece)).collect()
    }

    #[test]
    fn lines_come_back_as_they_were_and_can_be_taken_back() {
        let mut kept = Kept { header: "columns\n".into(), ..Kept::default() };
        let whole =
            |from: usize, to: usize, which: usize| (from..to).map(|k| line(k)[which].clone()).collect::<String>();
        (7..2000).for_each(|k| kept.push(k, line(k)));
        for cut in [1999, 1500, 7 + 3 * CHUNK, 7 + 2 * CHUNK + 1, 300, 8, 7] {
            kept.cut(cut);
            assert_eq!(file(&kept, "boxes.txt"), whole(7, cut, 0), "{cut}");
            assert_eq!(file(&kept, "track.csv"), "columns\n".to_owned() + &whole(7, cut, 1));
            (cut..2000).for_each(|k| kept.push(k, line(k)));
            assert_eq!(file(&kept, "track.jsonl"), whole(7, 2000, 2));
        }
        assert_eq!(kept.piece("else", 0), None);
    }

    #[test]
    fn files_of_further_targets_have_names_of_their_own() {
        for target in 0..3 {
            assert_eq!(target_of(&named(target, "boxes.txt")), (target, "boxes.txt"));
        }
        assert_eq!(target_of("target-1-boxes.txt"), (0, "target-1-boxes.txt"));
        assert_eq!(target_of("target-x"), (0, "target-x"));
    }

    #[test]
    fn without_an_end_the_oldest_lines_go() {
        let mut kept = Kept { most: Some(1000), ..Kept::default() };
        (0..10_000).for_each(|k| kept.push(k, line(k)));
        let text = file(&kept, "boxes.txt");
        let frames = text.lines().count();
        assert!((1000..=1000 + 2 * CHUNK).contains(&frames) && text.ends_with("box 9999\n"), "{frames}");
        assert_eq!(kept.first, 10_000 - frames);
        assert!(text.starts_with(&format!("box {}\n", kept.first)));
        kept.cut(9990);
        assert!(file(&kept, "boxes.txt").ends_with("box 9989\n"));
    }
}
