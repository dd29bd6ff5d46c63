//! The files of a measurement, from a run.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use foveate_base::sink::Sink;
use foveate_base::{Result, files};
use foveate_core::geometry::BBox;
use foveate_core::{Seen, Tracker};
use foveate_report::Observer;
use foveate_video::Frame;

use super::measurement::{Measurement, Settings, measure};
use super::page::page;
use super::tables::{tables, text};
use super::track::{Position, Track};

/// The names of the files.
pub const FILES: [&str; 5] = ["measure.csv", "fits.json", "ask.csv", "measure.trk", "measure.html"];

/// The lines of the results, which the observer adds at the end. Clones share them.
#[derive(Clone, Debug, Default)]
pub struct Lines(Arc<Mutex<Vec<String>>>);

impl Lines {
    /// Returns the lines so far.
    pub fn all(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// A tracker that follows a box in the frames of a run, beside the tracker of the run.
#[derive(Debug)]
pub struct Follower {
    tracker: Tracker,
    bbox: Option<BBox>,
}

impl Follower {
    /// Follows the target that has this box in the first frame.
    pub fn new(tracker: Tracker, bbox: BBox) -> Self {
        Self { tracker, bbox: Some(bbox) }
    }

    /// Returns the target in the next frame.
    ///
    /// # Errors
    /// The frame has another size than the first.
    pub fn follow<'a>(&'a mut self, frame: &'a Frame) -> Result<Seen<'a>> {
        self.tracker.set_time(frame.time);
        match self.bbox.take() {
            Some(bbox) => {
                self.tracker.init(&frame.image, bbox)?;
                Ok(Seen::given(frame.image.shape(), &bbox))
            }
            None => self.tracker.update(&frame.image),
        }
    }
}

/// Measures the targets of a run, and writes the files at its end.
#[derive(Debug)]
pub struct MeasureFiles {
    source: (String, f64),
    settings: Settings,
    points: Vec<Track>,
    reference: Option<(Follower, Vec<Position>)>,
    sinks: Vec<Sink>,
    lines: Lines,
    finished: bool,
}

impl MeasureFiles {
    /// Starts the files in a folder. `source` is the video, and the scale of its pictures; `names` are those of the targets, in their
    /// order.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn create(
        folder: &Path,
        source: (String, f64),
        names: Vec<String>,
        settings: Settings,
        lines: Lines,
    ) -> Result<Self> {
        let sinks = FILES.into_iter().map(|name| Sink::create(folder.join(name))).collect::<Result<_>>()?;
        let points = names.into_iter().map(|name| Track { name, positions: vec![] }).collect();
        Ok(Self { source, settings, points, reference: None, sinks, lines, finished: false })
    }

    /// Measures relative to a thing at rest.
    #[must_use]
    pub fn relative_to(self, reference: Follower) -> Self {
        Self { reference: Some((reference, vec![])), ..self }
    }
}

impl Observer for MeasureFiles {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        for (point, seen) in self.points.iter_mut().zip(targets) {
            point.positions.push(Position::of(frame, seen));
        }
        if let Some((follower, track)) = &mut self.reference {
            track.push(Position::of(frame, &follower.follow(frame)?));
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        if !std::mem::replace(&mut self.finished, true) {
            let reference = self.reference.as_ref().map(|(_, track)| &track[..]);
            let measured = measure(&self.points, reference, &self.settings)?;
            for (sink, text) in self.sinks.iter_mut().zip(texts(
                &self.source.0,
                Some(Path::new(&self.source.0)),
                self.source.1,
                &measured,
            )) {
                sink.write(text.as_bytes())?;
            }
            self.lines.0.lock().unwrap_or_else(PoisonError::into_inner).extend(text(&measured));
        }
        self.sinks.iter_mut().map(Sink::finish).fold(Ok(()), Result::and)
    }
}

/// Writes the files of a measurement to a folder. `source` is the name of the track, and the scale of the pictures that it was made on.
///
/// # Errors
/// A file cannot be written.
pub fn write(folder: &Path, (source, scale): (&str, f64), points: &[Measurement]) -> Result<()> {
    let mut files = FILES.into_iter().zip(texts(source, None, scale, points));
    files.try_for_each(|(name, text)| files::write(folder.join(name), text.as_bytes()))
}

fn texts(source: &str, video: Option<&Path>, scale: f64, points: &[Measurement]) -> [String; 5] {
    let [csv, fits, ask, trk] = tables(video, scale, points).map(|(_, text)| text);
    [csv, fits, ask, trk, page(source, points)]
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
        let names = vec!["1".into()];
        let files =
            MeasureFiles::create(dir.path(), ("pan".into(), 1.0), names, settings, lines.clone()).expect("writable");
        let reference = Follower::new(tracker(), BBox::new(20.0, 10.0, 24.0, 24.0));
        let (mut files, mut target) = (files.relative_to(reference), tracker());
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
