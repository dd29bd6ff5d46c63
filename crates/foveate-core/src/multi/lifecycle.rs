//! Initiation, re-identification and termination of tracks, and the memory limit on new ones.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::target::Target;
use super::{MOST_ID, MOST_REMEMBERED, MultiTracker, SAME, Work};
use crate::geometry::{BBox, Size};
use crate::scene::{Detection, Image};
use crate::seen::Phase;
use foveate_base::text::counted;
use foveate_base::{Error, Result, memory};

impl MultiTracker {
    /// Checks whether memory suffices for `more` targets in boxes like this one, in pictures of this size.
    ///
    /// # Errors
    /// [`foveate_base::Error::Memory`], with the number of targets and the bytes.
    pub fn check_room(&self, more: usize, bbox: &BBox, size: Size) -> Result<()> {
        let n = self.active.len() + self.terminated.len() + more;
        let bytes = self.room.with(n.saturating_sub(1), bbox, size);
        memory::check(format_args!("{n} targets"), bytes.saturating_add(memory::of_picture(size.width, size.height)))
    }

    /// Checks that a picture has the size and the planes of those before it, if there were any.
    pub(super) fn check_shape(&self, image: &Image) -> Result<()> {
        let ([.., planes], found) = (self.shape, image.planes());
        // A saved state does not have the number of planes.
        let known = |first: &Size| *first != image.size() || (!self.resumed && planes != found);
        match self.size.filter(known) {
            None => Ok(()),
            Some(first) => {
                let (size, of) = (image.size(), counted(found, "plane"));
                let before = if first == size { counted(planes, "plane") } else { first.to_string() };
                Err(Error::Invalid(format!(
                    "the picture is {size} with {of}, those before it were {before}; give pictures of one size and format, or call cut \
                     between them"
                )))
            }
        }
    }

    /// Returns a flag that another thread may set to stop the tracker. An update in progress then ends with
    /// [`foveate_base::Error::Stopped`] as soon as the targets in work are done, and later updates return the same error. Use it with
    /// thousands of targets, whose frames take long.
    pub fn stopper(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.pool.stop)
    }

    /// Returns whether the memory limit, or the largest id, has ever kept a detection from starting a track, so that some targets are not
    /// followed.
    pub fn is_full(&self) -> bool {
        self.full
    }

    /// Keeps the ids up to this one for targets that are added with an id: those from detections, or added without one, get larger ids.
    pub fn reserve(&mut self, id: u64) {
        self.next_id = self.next_id.max(id.saturating_add(1).min(MOST_ID));
    }

    /// Ends the track of the target with this id permanently: it is not re-identified later, and its id is not used again. Returns whether
    /// it was active.
    pub fn remove(&mut self, id: u64) -> bool {
        self.terminated.retain(|target| target.track.id != id);
        let at = self.active.binary_search_by_key(&id, |target| target.track.id);
        if let Ok(at) = at {
            self.active.remove(at);
            self.publish();
        }
        at.is_ok()
    }

    /// Ends the tracks of targets that are gone.
    pub(super) fn terminate(&mut self, image: &Image) {
        let (rules, s, detecting) = (&self.settings, &self.settings.termination, self.detecting);
        let picture = BBox { x: 0.0, y: 0.0, w: image.width() as f64, h: image.height() as f64 };
        let gone = |t: &mut Target| {
            let b = &t.track.bbox;
            let outside = b.intersection(&picture) < s.inside * b.w * b.h;
            outside || t.lost >= s.lost || (detecting && rules.asked(t.unseen) >= s.unseen)
        };
        for mut target in self.active.extract_if(.., gone) {
            target.terminated = self.frame;
            self.terminated.push(target);
        }
        self.forget();
    }

    /// Removes terminated targets that are too old or too many.
    pub(super) fn forget(&mut self) {
        let frame = self.frame;
        self.terminated.retain(|t| frame - t.terminated <= self.settings.reidentification.frames);
        let excess = self.terminated.len().saturating_sub(MOST_REMEMBERED);
        self.terminated.drain(..excess);
    }

    /// Starts tracks from persistent unmatched detections, after a re-identification check against terminated targets. The first `own` of
    /// `given` are the caller's.
    pub(super) fn initiate(&mut self, image: &Image, given: &[Detection], own: usize) {
        let (s, unknown) = (self.settings.initiation, self.settings.unknown_rank());
        let Work { detections, numbers, .. } = &mut self.work;
        let (mut left, mut numbers) = (std::mem::take(detections), std::mem::take(numbers));
        let size @ (width, height) = (image.width() as f64, image.height() as f64);
        let fits = |b: &BBox| b.w >= s.side && b.h >= s.side && b.w * b.h <= s.most * width * height;
        left.iter_mut().for_each(|d| d.score = self.ranks.of(d.score).unwrap_or(unknown));
        super::pairs::retain_both(&mut left, &mut numbers, |_, d| fits(&d.bbox) && !self.is_taken(d));
        let mut started = vec![];
        for (born, newest) in self.tentative.grow(self.frame, &left, size, &self.settings) {
            let (bbox, number) = (born.bbox, numbers[newest]);
            if crate::start::check(image, &bbox).is_err() || self.is_taken(&born) {
                continue;
            }
            let index = Some(number).filter(|k| *k < own);
            match self.reidentify(image, &bbox) {
                Some(mut target) => {
                    target.ensemble.reset_at(&bbox);
                    let first = target.track.born;
                    target.begin(first, bbox, Phase::ReIdentified);
                    target.set_detection(Some(given[number]), index);
                    self.admit(target);
                }
                // The box was checked above: only memory or ids can run out.
                None => match self.place(image, self.next_id, bbox) {
                    Ok(id) => started.push((id, bbox, number, index)),
                    Err(_) => self.full = true,
                },
            }
        }
        // Ids rise.
        let (pool, frame) = (&self.pool, self.frame);
        crate::threads::each(&mut self.active, |_, target| {
            if let Ok(at) = started.binary_search_by_key(&target.track.id, |(id, ..)| *id) {
                let (_, bbox, number, index) = started[at];
                target.start(image, frame, bbox, pool);
                target.set_detection(Some(given[number]), index);
            }
        });
        (self.work.detections, self.work.numbers) = (left, numbers);
    }

    /// Returns whether active targets are already at the place of a detection whose score is a rank.
    fn is_taken(&self, Detection { bbox, score: rank, .. }: &Detection) -> bool {
        let s = &self.settings.initiation;
        if *rank >= s.strong {
            return self.active.iter().any(|t| t.track.bbox.iou(bbox) > SAME);
        }
        let area = bbox.w * bbox.h;
        let covered: f64 = self.active.iter().map(|t| t.track.bbox.intersection(bbox) / area).sum();
        covered > s.covered || self.active.iter().any(|t| t.track.bbox.iou(bbox) > s.overlap)
    }

    /// Returns the terminated target that is most similar to the box, if one is similar enough, and removes it from memory.
    fn reidentify(&mut self, image: &Image, bbox: &BBox) -> Option<Target> {
        let size = self.settings.size.ln();
        let mut best = (self.settings.reidentification.similarity, None);
        for (i, target) in self.terminated.iter_mut().enumerate() {
            let state = target.ensemble.first().state_at(bbox);
            if (state.log_scale - target.track.state.log_scale).abs() > size {
                continue;
            }
            let similarity =
                target.with_buffers(&self.pool, |target| target.ensemble.first_mut().similarity(image, &state));
            if similarity >= best.0 {
                best = (similarity, Some(i));
            }
        }
        best.1.map(|i| self.terminated.remove(i))
    }

    /// Adds a target with a box that [`crate::start::check`] accepts, but does not start it. Returns its id.
    pub(super) fn place(&mut self, image: &Image, id: u64, bbox: BBox) -> Result<u64> {
        if id >= MOST_ID {
            return Err(Error::Invalid(format!("a target's id is below {MOST_ID}; this one is {id}")));
        }
        let again = self.terminated.iter().any(|t| t.track.id == id);
        self.check_room(usize::from(!again), &bbox, image.size())?;
        let mut target = Target::new((self.make)(id), Target::unknown(id));
        target.track.bbox = bbox;
        self.next_id = self.next_id.max(id + 1);
        self.terminated.retain(|t| t.track.id != id);
        self.admit(target);
        Ok(id)
    }

    fn admit(&mut self, target: Target) {
        let at = self.active.partition_point(|t| t.track.id < target.track.id);
        self.active.insert(at, target);
    }
}

#[cfg(test)]
mod tests {
    use super::super::settings::{Initiation, Settings};
    use super::super::{Fresh, Make, MemoryEstimate};
    use super::*;
    use crate::engine::toy::{Toy, parts, picture, target};
    use crate::ensemble::Ensemble;
    use crate::origin::Origin;
    use crate::scene::Preprocessor;

    /// Creates a tracker in which every place of column 50 looks like each of its targets.
    fn targets(initiation: Initiation) -> MultiTracker {
        let make: Make = Box::new(|id| Ensemble::new(vec![parts(Toy::at(50.0))], 1, id));
        let fresh: Fresh = Box::new(Preprocessor::default);
        let (settings, room) =
            (Settings { initiation, ..Settings::default() }, MemoryEstimate { kept: 0, look: 0, reach: 1.0 });
        let mut it = MultiTracker::of(Origin::by_hand(1), settings, room, make, fresh);
        it.add(&picture(), None, target(50.0)).expect("a box in the picture");
        it
    }

    /// Pictures of one format: a template in grey does not fit pixels in colour.
    #[test]
    fn a_picture_of_other_planes_is_refused() {
        let mut it = targets(Initiation::default());
        let grey = picture();
        let colour = Image::new(grey.width(), grey.height(), 3, [grey.plane(0); 3].concat()).expect("three planes");
        it.update(&grey, &[]).expect("the first one");
        for error in [it.update(&colour, &[]).map(drop), it.add(&colour, None, target(50.0)).map(drop)] {
            let error = error.expect_err("another format").to_string();
            assert!(error.contains("with 3 planes, those before it were 1 plane"), "{error}");
        }
        it.cut();
        it.update(&colour, &[]).expect("another video");
    }

    /// A target that is added after a state was restored is as old as one that is added without that.
    #[test]
    fn a_target_is_born_in_the_frame_of_the_last_picture() {
        for cut in [false, true] {
            let mut it = targets(Initiation::default());
            it.remove(1);
            (0..3).for_each(|_| it.update(&picture(), &[]).map(drop).expect("a picture"));
            if cut {
                it.cut();
            }
            let mut other = targets(Initiation::default());
            other.load(&it.save()).expect("its state");
            let born = |mut it: MultiTracker| {
                let id = it.add(&picture(), None, target(80.0)).expect("a box in the picture");
                it.target(id).expect("it is active").born
            };
            assert_eq!(born(other), born(it), "{cut}");
        }
    }

    /// Reserved ids leave a state that can be restored.
    #[test]
    fn the_largest_id_can_be_reserved() {
        let mut it = targets(Initiation::default());
        it.remove(1);
        it.reserve(u64::MAX);
        targets(Initiation::default()).load(&it.save()).expect("its state");
    }

    /// Beside an active target (IoU above `overlap`) only a strong detection starts a track, and at its place (IoU above 0.6) none does.
    #[test]
    fn strong_detections_start_tracks_beside_others() {
        let it = targets(Initiation { strong: 0.9, overlap: 0.3, ..Initiation::default() });
        let taken = |x: f64, rank: f64| it.is_taken(&Detection::new(target(x), rank));
        // Moved by 8 of 20 pixels, boxes have an IoU of 12 / 28; by 2, of 18 / 22.
        assert_eq!([taken(58.0, 0.5), taken(58.0, 0.9), taken(52.0, 0.9)], [true, false, true]);
        assert!(!taken(80.0, 0.5), "nothing is there");
    }

    /// Similarity does not depend on size: without this rule a child at the place of its mother would be identified as her.
    #[test]
    fn a_terminated_target_of_another_size_is_not_identified() {
        for (side, found) in [(20.0, true), (28.0, true), (40.0, false), (10.0, false)] {
            let mut it = targets(Initiation::default());
            it.cut();
            let target = it.reidentify(&picture(), &BBox::around(50.0, 50.0, side, side));
            assert_eq!(target.is_some(), found, "a side of {side} pixels, where it had 20");
        }
    }

    /// An id names one target: it is not used again, and a target that is removed or added again is not identified later.
    #[test]
    fn an_id_names_one_target() {
        let mut it = targets(Initiation::default());
        let add = |it: &mut MultiTracker, id| it.add(&picture(), id, target(50.0)).expect("a box in the picture");
        assert_eq!(add(&mut it, None), 2);
        it.cut();
        assert!(!it.remove(1), "it is not active");
        add(&mut it, Some(2));
        assert!(it.terminated.is_empty());
        assert_eq!(add(&mut it, None), 3);
    }

    /// Ids that are kept for targets to come are given to no other, and a target that is added again after its end began with its first box.
    #[test]
    fn ids_are_kept_free() {
        let mut it = targets(at_once());
        it.reserve(9);
        assert_eq!(initiated(&mut it, &[target(20.0)], 1), [1, 10]);
        let add = |it: &mut MultiTracker, id| it.add(&picture(), id, target(80.0)).expect("a box in the picture");
        assert_eq!([add(&mut it, Some(5)), add(&mut it, None)], [5, 11]);
        (it.frame, it.next) = (7, 8);
        it.cut();
        add(&mut it, Some(5));
        assert_eq!(it.target(5).map(|target| target.born), Some(0));
    }

    /// Terminated targets are remembered for so many frames, and no more than fifty of them.
    #[test]
    fn terminated_targets_are_forgotten() {
        let mut it = targets(Initiation::default());
        let frames = it.settings.reidentification.frames;
        (it.frame, it.active[0].lost) = (7, 1000);
        it.terminate(&picture());
        for (frame, remembered) in [(7 + frames, 1), (8 + frames, 0)] {
            it.frame = frame;
            it.forget();
            assert_eq!(it.terminated.len(), remembered, "frame {frame}");
        }
        for _ in 0..MOST_REMEMBERED + 2 {
            it.add(&picture(), None, target(50.0)).expect("a box in the picture");
        }
        it.cut();
        assert_eq!(it.terminated.len(), MOST_REMEMBERED);
        assert_eq!(it.terminated[0].track.id, 4, "the oldest are forgotten");
    }

    /// Each detection starts a track at once.
    fn at_once() -> Initiation {
        Initiation { hits: 1, within: 1, ..Initiation::default() }
    }

    /// Initiates tracks from unmatched detections, the first `own` of which are the caller's. Returns the ids.
    fn initiated(it: &mut MultiTracker, found: &[BBox], own: usize) -> Vec<u64> {
        let found: Vec<_> = found.iter().map(|bbox| Detection::new(*bbox, 1.0)).collect();
        (it.work.detections, it.work.numbers) = (found.clone(), (0..found.len()).collect());
        it.initiate(&picture(), &found, own);
        it.active.iter().map(|target| target.track.id).collect()
    }

    /// Detections of a fitting size start tracks, one at a place. The index of a detection is reported if it is the caller's.
    #[test]
    fn detections_start_tracks() {
        let mut it = targets(at_once());
        it.remove(1);
        let tiny = BBox::around(50.0, 20.0, 4.0, 4.0);
        let found = [tiny, target(20.0), target(21.0), target(80.0)];
        assert_eq!(initiated(&mut it, &found, 2), [2, 3]);
        let indices = [0, 1].map(|i| it.active[i].track.detection_index);
        assert_eq!(indices, [Some(1), None]);
        it.next_id = MOST_ID;
        assert!(!it.is_full());
        initiated(&mut it, &[BBox::around(20.0, 80.0, 20.0, 20.0)], 0);
        assert!(it.is_full(), "there are no more ids");
    }

    /// A detection is taken if several targets cover it together.
    #[test]
    fn a_place_between_targets_is_taken() {
        let mut it = targets(Initiation { overlap: 0.5, ..at_once() });
        it.remove(1);
        it.add(&picture(), None, target(40.0)).expect("a box in the picture");
        let taken = |it: &MultiTracker| it.is_taken(&Detection::new(target(50.0), 0.5));
        assert!(!taken(&it), "half of it is covered, with an IoU of a third");
        it.add(&picture(), None, target(60.0)).expect("a box in the picture");
        assert!(taken(&it));
    }

    /// The variance ahead is that of the place plus the velocity: Var(x + v) = Var(x) + 2 Cov(x, v) + Var(v). The expected box has moved
    /// by the velocity.
    #[test]
    fn a_target_is_expected_where_it_moves() {
        let mut it = targets(Initiation::default());
        let track = &mut it.active[0].track;
        (track.state.vx, track.state.vy) = (3.0, -2.0);
        let c = &mut track.covariance;
        (c[0][0], c[0][2], c[2][2]) = (4.0, 1.0, 2.0);
        (c[1][1], c[1][3], c[3][3]) = (9.0, -2.0, 5.0);
        it.expect();
        let expected = it.work.expected[0];
        assert_eq!((expected.variance, expected.bbox.centre(), expected.guess), ((8.0, 10.0), (53.0, 48.0), false));
    }

    /// A box around two targets is assigned to none and starts no track, unless the detector does not merge targets.
    #[test]
    fn merged_detections_are_left_out() {
        for (merges, left) in [(true, 0), (false, 1)] {
            let mut it = targets(Initiation::default());
            it.remove(1);
            for x in [40.0, 60.0] {
                it.add(&picture(), None, target(x)).expect("a box in the picture");
            }
            it.settings.merges = merges;
            let around = Detection::new(BBox::around(50.0, 50.0, 40.0, 20.0), 1.0);
            it.expect();
            it.assign(&picture(), &[around], 1);
            let taken = it.active.iter().filter(|target| target.track.detection.is_some()).count();
            assert_eq!(it.work.detections.len() + taken, left, "merges: {merges}");
        }
    }

    /// A target has the index of its detection if the detection is one of the caller's.
    #[test]
    fn only_detections_of_the_caller_have_an_index() {
        for (own, index) in [(2, Some(1)), (1, None)] {
            let mut it = targets(Initiation::default());
            let found = [20.0, 51.0].map(|x| Detection::new(target(x), 1.0));
            it.expect();
            it.assign(&picture(), &found, own);
            let track = &it.active[0].track;
            assert_eq!((track.detection.map(|d| d.bbox), track.detection_index), (Some(found[1].bbox), index));
            assert_eq!((it.work.detections.len(), &it.work.numbers[..]), (1, &[0][..]), "the other one is left");
        }
    }

    /// A detection identifies the most similar of the terminated targets, which continues there with its id and its first frame.
    #[test]
    fn the_most_similar_target_is_identified() {
        let mut it = targets(at_once());
        it.remove(1);
        it.make = Box::new(|id| Ensemble::new(vec![parts(Toy::at(if id == 2 { 50.0 } else { 53.0 }))], 1, id));
        (0..2).for_each(|_| _ = it.add(&picture(), None, target(50.0)).expect("a box in the picture"));
        it.active.iter_mut().for_each(|it| it.ensemble.reset_at(&target(90.0)));
        it.next = 5;
        it.cut();
        assert_eq!(initiated(&mut it, &[target(50.0)], 0), [2]);
        let found = &mut it.active[0];
        assert_eq!((found.track.phase, found.track.born, found.track.detection_index), (Phase::ReIdentified, 0, None));
        let seen = found.ensemble.step_on(crate::scene::Scene { image: &picture(), detections: &[] }).bbox;
        assert!(seen.iou(&target(50.0)) > 0.5, "{seen:?}");
    }

    /// A track ends outside the picture, and after so many frames as lost, or without a detection if there is a detector.
    #[test]
    fn tracks_of_targets_that_are_gone_end() {
        let most = Settings::default().termination;
        for (x, lost, unseen, detecting, ends) in [
            (50.0, most.lost - 1, most.unseen - 1, true, false),
            (50.0, most.lost, 0, false, true),
            (50.0, 0, most.unseen, true, true),
            (50.0, 0, most.unseen, false, false),
            (200.0, 0, 0, false, true),
        ] {
            let mut it = targets(Initiation::default());
            it.detecting = detecting;
            let gone = &mut it.active[0];
            (gone.track.bbox, gone.lost, gone.unseen) = (target(x), lost, unseen);
            it.terminate(&picture());
            assert_eq!(it.active.is_empty(), ends, "column {x}, lost for {lost} frames, unseen for {unseen}");
            assert_eq!(it.terminated.len(), usize::from(ends));
        }
    }
}
