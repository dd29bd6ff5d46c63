//! Remarks of a source on its video, for people.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foveate_base::text::counted;
use foveate_core::geometry::Size;

/// The findings so far in a source. Clones share them, and they keep growing after the source was handed over.
#[derive(Clone, Debug, Default)]
pub struct Remarks(Arc<Mutex<Found>>);

#[derive(Debug, Default)]
struct Found {
    /// Stored and displayed size, if pixels are not square.
    sides: Option<[Size; 2]>,
    /// The last damaged frames, counted from 1, the number of those before, and the first of all with the decoder's report.
    damaged: BTreeSet<usize>,
    damaged_before: u64,
    first_damaged: Option<usize>,
    report: String,
    /// Number of frames with a time stamp that does not rise, and the first of them.
    untimed: u64,
    first_untimed: usize,
    /// How often the time stamps of a stream jumped and its size changed, and the first frame of each.
    jumps: (u64, usize),
    resized: (u64, usize),
}

/// So many damaged frames are kept, for a stream may have no end.
const KEPT: usize = 1000;

impl Remarks {
    fn found(&self) -> MutexGuard<'_, Found> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Frames in which the decoder reported damage so far. What ffmpeg reports is assigned to the frame that it gave last, so that
    /// the number may be off by one or two.
    pub fn damaged(&self) -> u64 {
        let found = self.found();
        found.damaged_before + found.damaged.len() as u64
    }

    /// Where the stored pixels are not square: in which pixels the pictures are, and how to convert. Known from the first frame on.
    pub fn shape(&self) -> Option<String> {
        self.found().sides.map(|[stored, shown]| {
            format!(
                "The stored pixels are not square ({stored}): pictures and boxes are {shown}, as players show them. \
                 To convert a box of stored pixels, multiply x and width by {:.4}, y and height by {:.4}.",
                shown.width as f64 / stored.width as f64,
                shown.height as f64 / stored.height as f64
            )
        })
    }

    /// A sentence or two for each kind of fault found so far.
    pub fn sentences(&self) -> Vec<String> {
        let (n, found, mut all) = (self.damaged(), self.found(), vec![]);
        if let Some(first) = found.first_damaged {
            let (report, frames) = (&found.report, counted(n as usize, "frame"));
            all.push(format!(
                "The video is damaged: the decoder reports errors in {frames}, first near frame {first} ({report}). \
                 Pictures and boxes there and shortly after are unreliable; copy a file again, or check the network of a stream."
            ));
        }
        if found.untimed > 0 {
            all.push(format!(
                "The time stamps do not rise in {} of the frames, first in frame {}: there the time continues at the frame rate.",
                found.untimed, found.first_untimed
            ));
        }
        if let (n @ 1.., first) = found.resized {
            let times = counted(n as usize, "time");
            all.push(format!(
                "The size of the pictures changed {times}, first near frame {first}: all are scaled to the first size."
            ));
        }
        if let (n @ 1.., first) = found.jumps {
            let times = counted(n as usize, "time");
            all.push(format!(
                "The time stamps jumped {times}, first in frame {first}: there, and until they rise again, the clock gives the time."
            ));
        }
        all
    }

    /// Takes the sizes of pixels that are not square, and the damaged frames with a report.
    pub(crate) fn take(&self) -> (Option<[Size; 2]>, Vec<(usize, String)>) {
        let found = std::mem::take(&mut *self.found());
        (found.sides, found.damaged.into_iter().map(|frame| (frame, found.report.clone())).collect())
    }

    /// The stored size of a picture, and that in square pixels.
    pub(crate) fn set_sides(&self, stored: Size, shown: Size) {
        if stored != shown {
            self.found().sides = Some([stored, shown]);
        }
    }

    /// The decoder reported damage in a frame, counted from 1; a frame counts once.
    pub(crate) fn add_damage(&self, frame: usize, report: &str) {
        let mut found = self.found();
        if found.damaged.insert(frame) && found.first_damaged.is_none_or(|first| frame < first) {
            found.first_damaged = Some(frame);
            report.clone_into(&mut found.report);
        }
        if found.damaged.len() > KEPT {
            found.damaged.pop_first();
            found.damaged_before += 1;
        }
    }

    /// The time stamp of a frame of a stream, counted from 1, jumped.
    pub(crate) fn add_jump(&self, frame: usize) {
        add(&mut self.found().jumps, frame, 1);
    }

    /// The size of the pictures of a stream changed `times` times before a frame, counted from 1.
    pub(crate) fn add_resized(&self, frame: usize, times: u64) {
        add(&mut self.found().resized, frame, times);
    }

    /// The time stamp of a frame, counted from 1, does not rise.
    pub(crate) fn add_untimed(&self, frame: usize) {
        let mut found = self.found();
        if found.untimed == 0 {
            found.first_untimed = frame;
        }
        found.untimed += 1;
    }
}

fn add((count, first): &mut (u64, usize), frame: usize, times: u64) {
    if *count == 0 {
        *first = frame;
    }
    *count += times;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_is_a_sentence() {
        let remarks = Remarks::default();
        remarks.set_sides(Size::new(4, 4), Size::new(4, 4));
        assert!(remarks.shape().is_none() && remarks.sentences().is_empty() && remarks.damaged() == 0);
        remarks.clone().add_damage(3, "ac-tex damaged at 1 13");
        remarks.add_damage(3, "another one of the same frame");
        remarks.add_untimed(9);
        remarks.set_sides(Size::new(720, 576), Size::new(1024, 576));
        let all = remarks.sentences();
        assert_eq!((remarks.damaged(), all.len()), (1, 2));
        let shape = remarks.shape().expect("not square");
        assert!(shape.contains("720 x 576") && shape.contains("1024 x 576") && shape.contains("1.4222"), "{shape}");
        assert!(all[0].contains("in 1 frame, first near frame 3 (ac-tex"), "{all:?}");
        assert!(all[1].contains("frame 9"), "{all:?}");
        remarks.add_damage(2, "an earlier one");
        assert!(remarks.damaged() == 2 && remarks.sentences()[0].contains("2 frames, first near frame 2 (an earlier"));
    }
    #[test]
    fn damage_without_end_takes_no_memory() {
        let remarks = Remarks::default();
        (1..=100_000).for_each(|frame| remarks.add_damage(frame, &format!("frame {frame}")));
        assert_eq!((remarks.damaged(), remarks.found().damaged.len()), (100_000, KEPT));
        assert!(remarks.sentences()[0].contains("100000 frames, first near frame 1 (frame 1)"));
    }
}
