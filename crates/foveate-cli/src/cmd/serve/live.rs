//! Streams and cameras from the command line.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use foveate::video::{FrameSource, Live as Stream, LiveOptions, Pace, SourceInfo, newest};
use foveate::{Error, Result};
use foveate_page::{Pull, Recent, Source, check_size};

use super::video::Open;

/// Maximum time to wait for a frame of a stream.
const PATIENCE: Duration = Duration::from_secs(15);

/// Opens a stream or a camera as `foveate track` does: keeps the newest frame and drops the others. A file waits for the reader.
pub(super) fn open(address: &Path) -> Result<(Source<Open>, SourceInfo)> {
    let notify = |text: &str| note!("foveate: {text}");
    let source = Stream::open(address, LiveOptions { notify, ..LiveOptions::default() })?;
    check_size(source.info(), address)?;
    let until = Arc::new(Mutex::new(Instant::now()));
    let deadline = Arc::clone(&until);
    let late = move || Instant::now() > *deadline.lock().unwrap_or_else(PoisonError::into_inner);
    let pace = Pace { every_frame: source.is_finite(), ..Pace::default() };
    let (mut source, meter) = newest(Box::new(source), pace, late);
    // The number of frames of a file is an estimate; here the source ends with its last frame.
    let info = SourceInfo { frames: None, ..source.info().clone() };
    let mut recent = Recent::new(info.size());
    recent.remarks = source.remarks();
    let mut counted = 0;
    let pull: Pull = Box::new(move |recent| {
        let deadline = Instant::now() + PATIENCE;
        *until.lock().unwrap_or_else(PoisonError::into_inner) = deadline;
        match source.next() {
            Some(frame) => {
                let frame = frame?;
                let missed = meter.dropped() - counted;
                counted += missed;
                recent.push(frame.image, frame.time, missed).map(drop)
            }
            None if Instant::now() > deadline => {
                let seconds = PATIENCE.as_secs();
                Err(Error::Invalid(format!(
                    "no frame came for {seconds} s; check the source, and press play to continue"
                )))
            }
            None => Ok(()),
        }
    });
    Ok((Source::Live(recent, Some(pull)), info))
}
