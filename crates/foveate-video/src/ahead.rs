//! Frames decoded on a thread of their own, some ahead of the one that is worked on.

use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

use crate::{Frame, FrameSource, Interrupt, Remarks, SourceInfo};
use foveate_base::{Error, Result, quiet, thread};

/// How many frames wait at most.
const DEPTH: usize = 4;

/// The same frames in the same order as `source`, read while the caller works on earlier ones.
pub fn ahead(source: Box<dyn FrameSource>) -> Box<dyn FrameSource> {
    ahead_until(source, || false)
}

/// Interval of the calls of `stop` while no frame arrives.
const PATIENCE: Duration = Duration::from_millis(50);

/// [`ahead`], until `stop` returns true. It then ends, even if the source blocks. `stop` is called before every
/// frame, and repeatedly while none arrives.
pub fn ahead_until(mut source: Box<dyn FrameSource>, stop: impl Fn() -> bool + Send + 'static) -> Box<dyn FrameSource> {
    let (info, interrupt, remarks) = (source.info().clone(), source.interrupt(), source.remarks());
    let (send, frames) = sync_channel(DEPTH);
    let refused = send.clone();
    let read = move || {
        // The thread ends with the source, or at the first frame without a receiver.
        if let Err(panic) = quiet::catch(|| source.try_for_each(|frame| send.send(frame))) {
            let _ = send.send(Err(Error::Invalid(format!("reading the frames failed: {panic}"))));
        }
    };
    if let Err(error) = thread::start("reading frames ahead", read) {
        let _ = refused.send(Err(error));
    }
    drop(refused);
    Box::new(Ahead { info, frames, interrupt, remarks, stop: Box::new(stop) })
}

struct Ahead {
    info: SourceInfo,
    frames: Receiver<Result<Frame>>,
    interrupt: Option<Interrupt>,
    remarks: Remarks,
    stop: Box<dyn Fn() -> bool + Send>,
}

impl Iterator for Ahead {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if (self.stop)() {
                return None;
            }
            match self.frames.recv_timeout(PATIENCE) {
                Ok(frame) => return Some(frame),
                Err(RecvTimeoutError::Disconnected) => return None,
                Err(RecvTimeoutError::Timeout) => (),
            }
        }
    }
}

impl Drop for Ahead {
    /// A read that blocks would keep the source, and its ffmpeg, for ever.
    fn drop(&mut self) {
        if let Some(interrupt) = &self.interrupt {
            interrupt();
        }
    }
}

impl FrameSource for Ahead {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ImageFolder, save_png};
    use foveate_core::scene::Image;

    #[test]
    fn the_frames_and_the_error_are_those_of_the_source() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        for i in 0..20u8 {
            save_png(dir.path().join(format!("{i}.png")), &Image::grey(3, 2, i)).expect("a writable folder");
        }
        std::fs::write(dir.path().join("15.png"), "broken").expect("a writable folder");
        let open = || ImageFolder::open(dir.path()).expect("a folder of images");
        let tell = |frame: Result<Frame>| frame.map_err(|error| error.to_string()).map(|f| (f.index, f.image));
        let source = ahead(Box::new(open()));
        assert_eq!(source.info(), open().info());
        assert_eq!(source.map(tell).collect::<Vec<_>>(), open().map(tell).collect::<Vec<_>>());
        // One that is dropped early ends too.
        drop(ahead(Box::new(open())));
    }
}
