//! Results as text, line by line as they come, so that a correction can take lines back.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foveate_base::Result;
use foveate_base::sink::{Memory, Sink};
use foveate_core::geometry::BBox;
use foveate_core::step::Step;
use foveate_report::interactive;
use foveate_report::stream::Format;
use foveate_report::{Boxes, Observer, Stream, Table};
use foveate_video::{Frame, Meter};

/// The files of text, and what each holds.
pub const NAMES: [&str; 3] = ["boxes.txt", "track.csv", "track.jsonl"];

/// Lines of the three files; clones share them.
#[derive(Clone, Default)]
pub struct Lines(Arc<Mutex<Kept>>);

#[derive(Default)]
struct Kept {
    first: usize,
    header: String,
    /// A line of each file a frame.
    lines: Vec<[String; 3]>,
}

impl Lines {
    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A file as text; `None` where there is none of that name.
    pub fn file(&self, name: &str) -> Option<String> {
        let which = NAMES.iter().position(|known| *known == name)?;
        let kept = self.kept();
        let mut text = if name == "track.csv" { kept.header.clone() } else { String::new() };
        kept.lines.iter().for_each(|lines| text += &lines[which]);
        Some(text)
    }
}

/// Writes them.
pub struct Log {
    lines: Lines,
    observers: [Box<dyn Observer + Send>; 3],
    out: [Memory; 3],
}

impl Log {
    pub fn new(lines: Lines, meter: Option<Meter>) -> Self {
        let out: [Memory; 3] = Default::default();
        let sink = |i: usize| Sink::memory(NAMES[i], out[i].clone());
        let observers: [Box<dyn Observer + Send>; 3] = [
            Box::new(Boxes::to(sink(0))),
            Box::new(Table::to(sink(1))),
            Box::new(Stream::new(out[2].clone(), Format::Json, meter)),
        ];
        Self { lines, observers, out }
    }

    fn take(&self, index: usize) {
        let [boxes, mut table, json] = self.out.each_ref().map(|out| String::from_utf8_lossy(&out.take()).into_owned());
        let mut kept = self.lines.kept();
        if kept.lines.is_empty() {
            kept.first = index;
        }
        // The header comes with the first line.
        if kept.header.is_empty()
            && let Some(end) = table.find('\n')
        {
            let line = table.split_off(end + 1);
            kept.header = std::mem::replace(&mut table, line);
        }
        kept.lines.push([boxes, table, json]);
    }
}

impl interactive::Log for Log {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        self.observers.iter_mut().try_for_each(|o| o.start(frame, bbox))?;
        self.take(frame.index);
        Ok(())
    }
    fn observe(&mut self, frame: &Frame, step: &Step<'_>) -> Result<()> {
        self.observers.iter_mut().try_for_each(|o| o.observe(frame, step))?;
        self.take(frame.index);
        Ok(())
    }
    fn cut(&mut self, index: usize) {
        let mut kept = self.lines.kept();
        let left = index.saturating_sub(kept.first);
        kept.lines.truncate(left);
    }
}
