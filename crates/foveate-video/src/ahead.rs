//! Frames decoded on a thread of their own, some ahead of the one that is worked on.

use std::sync::mpsc::{Receiver, sync_channel};

use crate::{Frame, FrameSource, SourceInfo};
use foveate_base::{Error, Result, quiet};

/// How many frames wait at most.
const DEPTH: usize = 4;

/// The same frames in the same order as `source`, read while the caller works on earlier ones.
pub fn ahead(mut source: Box<dyn FrameSource>) -> Box<dyn FrameSource> {
    let info = source.info().clone();
    let (send, frames) = sync_channel(DEPTH);
    std::thread::spawn(move || {
        // The thread ends with the source, or at the first frame that nobody waits for.
        if let Err(panic) = quiet::catch(|| source.try_for_each(|frame| send.send(frame))) {
            let _ = send.send(Err(Error::Invalid(format!("reading the frames failed: {panic}"))));
        }
    });
    Box::new(Ahead { info, frames })
}

struct Ahead {
    info: SourceInfo,
    frames: Receiver<Result<Frame>>,
}

impl Iterator for Ahead {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        self.frames.recv().ok()
    }
}

impl FrameSource for Ahead {
    fn info(&self) -> &SourceInfo {
        &self.info
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
