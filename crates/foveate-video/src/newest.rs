//! The newest frame of a source that does not wait: a slot for one frame, in which a newer one takes the place of an older one.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::{Frame, FrameSource, Interrupt, Remarks, SourceInfo};
use foveate_base::{Error, Result, quiet, thread};

/// Interval of the calls of `stop` while no frame arrives.
const PATIENCE: Duration = Duration::from_millis(50);

/// What becomes of frames that come while the tracker is busy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pace {
    /// None is dropped: the source waits.
    pub every_frame: bool,
    /// A frame that waited longer than this for the tracker, since it was read, is dropped, except the first one.
    pub max_latency: Option<Duration>,
}

/// The facts of the last frame handed out and of those dropped. Clones share them.
#[derive(Clone, Debug, Default)]
pub struct Meter(Arc<Measured>);

#[derive(Debug, Default)]
struct Measured {
    dropped: AtomicU64,
    arrived: Mutex<Option<Instant>>,
}

impl Meter {
    /// Frames that were read and not handed out, so far.
    pub fn dropped(&self) -> u64 {
        self.0.dropped.load(Ordering::Relaxed)
    }
    /// Time since the frame handed out last had been read whole; `None` before the first one.
    pub fn latency(&self) -> Option<Duration> {
        self.0.arrived.lock().unwrap_or_else(PoisonError::into_inner).map(|arrived| arrived.elapsed())
    }
    /// Counts frames that were not handed out.
    pub fn drop_frames(&self, count: u64) {
        self.0.dropped.fetch_add(count, Ordering::Relaxed);
    }
}

#[derive(Default)]
struct Slot {
    frame: Option<(Frame, Instant)>,
    /// The first frame was handed out: nothing takes its place, since the first box belongs to it.
    begun: bool,
    /// The source has ended, with an error perhaps.
    end: Option<Option<Error>>,
}

#[derive(Default)]
struct Shared {
    slot: Mutex<Slot>,
    changed: Condvar,
    /// Nobody waits for frames any more.
    gone: AtomicBool,
}

impl Shared {
    fn slot(&self) -> MutexGuard<'_, Slot> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The newest frames of `source`, read on a separate thread until `stop` returns true.
pub fn newest(
    mut source: Box<dyn FrameSource>,
    pace: Pace,
    stop: impl Fn() -> bool + Send + 'static,
) -> (Box<dyn FrameSource>, Meter) {
    let (info, interrupt, remarks) = (source.info().clone(), source.interrupt(), source.remarks());
    let (shared, meter) = (Arc::new(Shared::default()), Meter::default());
    let (slot, counter) = (shared.clone(), meter.clone());
    let work = move || {
        let read = quiet::catch(|| {
            for frame in &mut source {
                let frame = frame?;
                if !put(&slot, (frame, Instant::now()), pace.every_frame, &counter) {
                    break;
                }
            }
            Ok(())
        });
        let error = match read {
            Ok(Ok(())) => None,
            Ok(Err(error)) => Some(error),
            Err(panic) => Some(Error::Invalid(format!("reading the frames failed: {panic}"))),
        };
        slot.slot().end = Some(error);
        slot.changed.notify_all();
    };
    if let Err(error) = thread::start("reading the newest frame", work) {
        shared.slot().end = Some(Some(error));
    }
    let newest = Newest { info, shared, pace, meter: meter.clone(), interrupt, remarks, stop: Box::new(stop) };
    (Box::new(newest), meter)
}

/// Puts a frame into the slot; false if the reader is gone.
fn put(shared: &Shared, frame: (Frame, Instant), wait: bool, meter: &Meter) -> bool {
    let mut slot = shared.slot();
    while wait && slot.frame.is_some() && !shared.gone.load(Ordering::Relaxed) {
        slot = shared.changed.wait_timeout(slot, PATIENCE).unwrap_or_else(PoisonError::into_inner).0;
    }
    let full = slot.frame.is_some();
    if slot.begun || !full {
        slot.frame = Some(frame);
    }
    meter.drop_frames(u64::from(full));
    shared.changed.notify_all();
    !shared.gone.load(Ordering::Relaxed)
}

struct Newest {
    info: SourceInfo,
    shared: Arc<Shared>,
    pace: Pace,
    meter: Meter,
    interrupt: Option<Interrupt>,
    remarks: Remarks,
    stop: Box<dyn Fn() -> bool + Send>,
}

impl Iterator for Newest {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut slot = self.shared.slot();
        loop {
            if (self.stop)() {
                return None;
            }
            if let Some((frame, arrived)) = slot.frame.take() {
                self.shared.changed.notify_all();
                let begun = std::mem::replace(&mut slot.begun, true);
                if begun && self.pace.max_latency.is_some_and(|most| arrived.elapsed() > most) {
                    self.meter.drop_frames(1);
                    continue;
                }
                *self.meter.0.arrived.lock().unwrap_or_else(PoisonError::into_inner) = Some(arrived);
                return Some(Ok(frame));
            }
            if let Some(end) = &mut slot.end {
                return end.take().map(Err);
            }
            slot = self.shared.changed.wait_timeout(slot, PATIENCE).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl FrameSource for Newest {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
    fn interrupt(&self) -> Option<Interrupt> {
        self.interrupt.clone()
    }
    fn remarks(&self) -> Remarks {
        self.remarks.clone()
    }
}

impl Drop for Newest {
    fn drop(&mut self) {
        self.shared.gone.store(true, Ordering::Relaxed);
        if let Some(interrupt) = &self.interrupt {
            interrupt();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::scene::Image;
    use std::thread::sleep;

    /// `frames` frames, one in `every` milliseconds, then an error.
    struct Camera(SourceInfo, usize, usize, u64);

    impl Iterator for Camera {
        type Item = Result<Frame>;
        fn next(&mut self) -> Option<Self::Item> {
            sleep(Duration::from_millis(self.3));
            let index = self.1;
            self.1 += 1;
            let end = || Error::Invalid("the camera is gone".into());
            Some(if index < self.2 { Ok(Frame { index, time: 0.0, image: Image::grey(2, 2, 0) }) } else { Err(end()) })
        }
    }

    impl FrameSource for Camera {
        fn info(&self) -> &SourceInfo {
            &self.0
        }
    }

    fn camera(frames: usize, every: u64) -> Box<dyn FrameSource> {
        let info = SourceInfo { width: 2, height: 2, frames: None, rate: 30.0, reader: "test".into() };
        Box::new(Camera(info, 0, frames, every))
    }

    /// A source five times as fast as its reader: drops are counted, frames are new, and the error comes at the end.
    #[test]
    fn a_slow_reader_gets_new_frames() {
        let (source, meter) = newest(camera(300, 2), Pace::default(), || false);
        let (mut seen, mut last, mut late) = (0, None, vec![]);
        let mut error = None;
        for frame in source {
            match frame {
                Ok(frame) => {
                    assert!(last.is_none_or(|last| frame.index > last));
                    (seen, last) = (seen + 1, Some(frame.index));
                    late.push(meter.latency().expect("a frame came"));
                    sleep(Duration::from_millis(10));
                }
                Err(e) => error = Some(e.to_string()),
            }
        }
        assert_eq!(seen + meter.dropped(), 300);
        assert!(meter.dropped() > 100, "{} were dropped", meter.dropped());
        assert_eq!(error.as_deref(), Some("the camera is gone"));
        late.sort();
        assert!(late[late.len() / 2] < Duration::from_millis(10), "{late:?}");
    }

    #[test]
    fn every_frame_arrives_if_requested() {
        let (source, meter) = newest(camera(50, 0), Pace { every_frame: true, ..Pace::default() }, || false);
        let seen: Vec<usize> = source.map_while(Result::ok).map(|frame| frame.index).collect();
        assert_eq!((seen, meter.dropped()), ((0..50).collect(), 0));
    }

    #[test]
    fn frames_that_waited_too_long_are_dropped() {
        let pace = Pace { every_frame: true, max_latency: Some(Duration::from_millis(20)) };
        let (mut source, meter) = newest(camera(5, 0), pace, || false);
        let mut next = || source.next().expect("one that is new").expect("a frame").index;
        assert_eq!(next(), 0);
        sleep(Duration::from_millis(100));
        // One waited in the slot, the next one for it.
        assert_eq!((next(), meter.dropped()), (3, 2));
    }

    #[test]
    fn the_first_frame_is_not_dropped() {
        for max_latency in [None, Some(Duration::from_millis(1))] {
            let (mut source, meter) = newest(camera(9, 2), Pace { max_latency, ..Pace::default() }, || false);
            sleep(Duration::from_millis(100));
            let first = source.next().expect("it came").expect("a frame");
            assert_eq!((first.index, meter.dropped()), (0, 8));
        }
    }

    #[test]
    fn a_source_that_blocks_is_left() {
        let began = Instant::now();
        let (mut source, _) = newest(camera(3, 20_000), Pace::default(), move || began.elapsed().as_millis() > 100);
        assert!(source.next().is_none());
        drop(source);
        assert!(began.elapsed() < Duration::from_secs(1));
    }
}
