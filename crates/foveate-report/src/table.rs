//! boxes.txt and track.csv: a run as plain numbers, one line per frame, readable from the first frame on.

use std::path::PathBuf;

use crate::Observer;
use crate::columns::TRACK;
use crate::csv::Csv;
use crate::run::touching;
use foveate_base::Result;
use foveate_base::sink::Sink;
use foveate_core::Seen;
use foveate_video::Frame;

/// boxes.txt in OTB's format: [`crate::columns::BOXES`], pixels counted from 1, including the first frame. A box outside the picture is
/// written at the nearest place where it touches the picture; track.csv has the estimated position.
#[derive(Debug)]
pub struct Boxes {
    file: Sink,
}

impl Boxes {
    /// Starts the file.
    ///
    /// # Errors
    /// Its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        Ok(Self::to(Sink::create(path)?))
    }

    /// Writes the table to `file`.
    pub fn to(file: Sink) -> Self {
        Self { file }
    }
}

impl Observer for Boxes {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        let Some(seen) = targets.first() else { return Ok(()) };
        let b = if seen.is_given() { seen.bbox } else { touching(&seen.bbox, &frame.image) };
        self.file.write(format!("{:.3},{:.3},{:.3},{:.3}\n", b.x + 1.0, b.y + 1.0, b.w, b.h).as_bytes())?;
        self.file.flush()
    }
    fn finish(&mut self) -> Result<()> {
        self.file.finish()
    }
}

/// track.csv: the estimate and its uncertainty, with the columns [`TRACK`].
#[derive(Debug)]
pub struct Table {
    file: Csv,
}

impl Table {
    /// Starts the file.
    ///
    /// # Errors
    /// Its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        Ok(Self { file: Csv::create(path, TRACK)? })
    }

    /// Writes the table to `file`; the header comes with the first row.
    pub fn to(file: Sink) -> Self {
        Self { file: Csv::to(file, TRACK) }
    }
}

impl Observer for Table {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        let Some(seen) = targets.first() else { return Ok(()) };
        let (b, c, gaze) = (&seen.bbox, &seen.covariance, seen.gaze);
        self.file.write(|row| {
            row.put(frame.index + 1);
            row.put_all(&[frame.time, b.x, b.y, b.w, b.h]);
            row.put_all(&seen.state.to_array());
            if seen.is_given() {
                return row.end();
            }
            row.put_all(c.iter().enumerate().flat_map(|(i, line)| &line[i..]));
            row.put_all(&[c[0][0].sqrt(), c[1][1].sqrt(), seen.ess, seen.log_evidence]);
            match seen.consistency.is_informative {
                true => row.put(seen.consistency.deficit),
                false => row.put(""),
            }
            row.put(seen.p_lost);
            row.put(seen.status.name());
            row.put(u8::from(seen.is_usable()));
            row.put_all(&[gaze.u, gaze.v, seen.rewards[seen.plan.chosen_index()], seen.percept.distance]);
            row.put(seen.values);
            row.put(seen.share_read());
            if let Some((class, p)) = seen.class {
                row.put_text(&seen.class_name(class));
                row.put(p);
            }
            row.end();
        })
    }

    fn finish(&mut self) -> Result<()> {
        self.file.finish()
    }
}
