//! The files of a measurement, from a run.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use foveate_base::sink::Sink;
use foveate_base::{Result, files};
use foveate_core::geometry::BBox;
use foveate_core::{Seen, Tracker};
use foveate_report::Observer;
use foveate_video::Frame;

use super::ask::csv;
use super::measurement::{Measurement, Settings, measure};
use super::page::page;
use super::track::Position;

/// The names of the files.
pub const FILES: [&str; 4] = ["measure.csv", "fits.json", "ask.csv", "measure.html"];

/// The lines of the results, which the observer adds at the end. Clones share them.
#[derive(Clone, Debug, Default)]
pub struct Lines(Arc<Mutex<Vec<String>>>);

impl Lines {
    /// Returns the lines so far.
    pub fn all(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Measures the only target of a run, and writes the files at its end.
#[derive(Debug)]
pub struct MeasureFiles {
    source: String,
    settings: Settings,
    track: Vec<Position>,
    reference: Option<Reference>,
    sinks: Vec<Sink>,
    lines: Lines,
    finished: bool,
}

/// A second tracker, on a thing at rest.
#[derive(Debug)]
struct Reference {
    tracker: Tracker,
    bbox: Option<BBox>,
    track: Vec<Position>,
}

impl MeasureFiles {
    /// Starts the files in a folder. `source` is the name of the video.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn create(folder: &Path, source: String, settings: Settings, lines: Lines) -> Result<Self> {
        let sinks = FILES.into_iter().map(|name| Sink::create(folder.join(name))).collect::<Result<_>>()?;
        Ok(Self { source, settings, track: vec![], reference: None, sinks, lines, finished: false })
    }

    /// Measures relative to a thing at rest, which this tracker follows from a box in the first frame.
    #[must_use]
    pub fn relative_to(self, tracker: Tracker, bbox: BBox) -> Self {
        Self { reference: Some(Reference { tracker, bbox: Some(bbox), track: vec![] }), ..self }
    }
}

impl Observer for MeasureFiles {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        let Some(seen) = targets.first() else { return Ok(()) };
        self.track.push(Position::of(frame, seen));
        if let Some(Reference { tracker, bbox, track }) = &mut self.reference {
            tracker.set_time(frame.time);
            let seen = match bbox.take() {
                Some(bbox) => {
                    tracker.init(&frame.image, bbox)?;
                    Seen::given(frame.image.shape(), &bbox)
                }
                None => tracker.update(&frame.image)?,
            };
            track.push(Position::of(frame, &seen));
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        if !std::mem::replace(&mut self.finished, true) {
            let reference = self.reference.as_ref().map(|reference| &reference.track[..]);
            let measured = measure(&self.track, reference, &self.settings)?;
            for (sink, text) in self.sinks.iter_mut().zip(texts(&self.source, &measured)) {
                sink.write(text.as_bytes())?;
            }
            self.lines.0.lock().unwrap_or_else(PoisonError::into_inner).extend(measured.text());
        }
        self.sinks.iter_mut().map(Sink::finish).fold(Ok(()), Result::and)
    }
}

/// Writes the files of a measurement to a folder.
///
/// # Errors
/// A file cannot be written.
pub fn write(folder: &Path, source: &str, measured: &Measurement) -> Result<()> {
    let mut files = FILES.into_iter().zip(texts(source, measured));
    files.try_for_each(|(name, text)| files::write(folder.join(name), text.as_bytes()))
}

fn texts(source: &str, measured: &Measurement) -> [String; 4] {
    [measured.csv(), measured.json(), csv(&measured.ask), page(source, measured)]
}

#[cfg(test)]
mod tests {
    use super::super::units::Axes;
    use super::*;
    use foveate_core::Profile;
    use foveate_core::scene::Image;

    /// A camera pans over a square that moves by 1 px a frame and another at rest: the measured speed is that of the first alone.
    #[test]
    fn a_reference_is_tracked_in_the_frames_of_the_run() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let settings = Settings { axes: Axes::default(), ..Settings::default() };
        let tracker = || Tracker::new(Profile::Fast).expect("a tracker");
        let lines = Lines::default();
        let files = MeasureFiles::create(dir.path(), "pan".into(), settings, lines.clone()).expect("writable");
        let (mut files, mut target) = (files.relative_to(tracker(), BBox::new(20.0, 10.0, 24.0, 24.0)), tracker());
        for t in 0..16 {
            let pan = 2 * t;
            let squares = [(20 + pan, 10), (60 + pan + t, 60)];
            let pixel = |i: usize| {
                let (x, y) = (i % 160, i / 160);
                let square = squares.iter().find(|(l, top)| (*l..l + 24).contains(&x) && (*top..top + 24).contains(&y));
                square.map_or((x * 3 + y * 5) as u8 % 40, |(l, top)| {
                    120 + 100 * (((x - l) / 6 + (y - top) / 6) % 2) as u8
                })
            };
            let image = Image::from_grey8(160, 110, &(0..160 * 110).map(pixel).collect::<Vec<_>>()).expect("an image");
            let frame = Frame { index: t, time: t as f64 / 25.0, image };
            let bbox = BBox::new(60.0, 60.0, 24.0, 24.0);
            if t == 0 {
                target.init(&frame.image, bbox).expect("started");
                files.observe(&frame, &[Seen::given(frame.image.shape(), &bbox)]).expect("observed");
            } else {
                let seen = target.update(&frame.image).expect("tracked");
                files.observe(&frame, &[seen]).expect("observed");
            }
        }
        files.finish().expect("written");
        let csv = std::fs::read_to_string(dir.path().join("measure.csv")).expect("a table");
        let speed: f64 =
            csv.lines().nth(8).and_then(|line| line.split(',').nth(4)).and_then(|v| v.parse().ok()).expect("vx");
        assert!((speed - 25.0).abs() < 5.0, "{speed} px/s\n{csv}");
        assert!(!lines.all().is_empty() && FILES.iter().all(|name| dir.path().join(name).is_file()));
    }
}
