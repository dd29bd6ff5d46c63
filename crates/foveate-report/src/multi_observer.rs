//! What observers of many targets are told.

use foveate_base::Result;
use foveate_core::Seen;
use foveate_video::Frame;

/// Observes a run with many targets.
///
/// `observe` comes once a frame, in order, also where no target is active; targets are in order of their ids. A target that
/// is missing was terminated; it may be re-identified later ([`foveate_core::multi::Phase::ReIdentified`]). `finish` comes
/// once, at the end, also where the source broke half-way. An observer that is dropped without `finish` leaves no file.
pub trait MultiObserver {
    /// A frame and its active targets.
    ///
    /// # Errors
    /// A file cannot be written.
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()>;
    /// The end: files get their names.
    ///
    /// # Errors
    /// A file cannot be written.
    fn finish(&mut self) -> Result<()>;
}

/// Each of them in turn. Where one fails, `finish` still comes to all; the first error is returned.
impl MultiObserver for Vec<Box<dyn MultiObserver>> {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        self.iter_mut().try_for_each(|o| o.observe(frame, targets))
    }
    fn finish(&mut self) -> Result<()> {
        self.iter_mut().map(|o| o.finish()).fold(Ok(()), Result::and)
    }
}
