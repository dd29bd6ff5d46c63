//! Track initiation: persistent unmatched detections start a target.

use super::edge;
use super::groups::{Fit, best};
use super::pairs::Expected;
use super::settings::Settings;
use crate::geometry::BBox;
use crate::scene::Detection;

/// A tentative track.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
struct Candidate {
    bbox: BBox,
    /// Its first box.
    origin: BBox,
    /// Pixels per frame.
    velocity: (f64, f64),
    hits: usize,
    /// Sum of the ranks of its detections' scores.
    ranks: f64,
    first: usize,
    last: usize,
    /// Index of its newest detection, in the frame of that detection.
    #[serde(skip)]
    newest: usize,
}

/// Tentative tracks.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct TentativeTracks {
    candidates: Vec<Candidate>,
}

/// Least IoU of a detection with the predicted box of a candidate.
const LEAST_OVERLAP: f64 = 0.2;
/// Number of detections that a candidate may miss.
const MOST_MISSED: usize = 2;
/// Motion of the edges of a static object's box that counts as jitter, pixels.
const JITTER: f64 = 3.0;
/// Weight of the newest displacement in a candidate's velocity.
const NEWEST: f64 = 0.5;

impl TentativeTracks {
    /// Updates the candidates with the unmatched detections of a frame, whose scores are ranks. Returns those that become targets, each
    /// with the index of the detection that it starts from.
    pub(super) fn grow(
        &mut self,
        frame: usize,
        detections: &[Detection],
        picture: (f64, f64),
        settings: &Settings,
    ) -> Vec<(Detection, usize)> {
        let s = &settings.initiation;
        let waits = |c: &Candidate| c.hits >= s.hits || settings.asked(frame - c.first) < s.within.max(1);
        self.candidates.retain(|c| c.may_return(frame, settings) && waits(c));
        let mut fits = vec![];
        for (i, candidate) in self.candidates.iter().enumerate() {
            let expected = candidate.expected(frame);
            let overlaps = detections.iter().map(|d| expected.iou(&d.bbox)).enumerate();
            fits.extend(overlaps.filter(|(_, score)| *score >= LEAST_OVERLAP).map(|(j, score)| Fit { i, j, score }));
        }
        let (given, mut taken) = (best(&fits, self.candidates.len(), detections.len()), vec![false; detections.len()]);
        for (candidate, j) in self.candidates.iter_mut().zip(given) {
            let Some(j) = j else { continue };
            taken[j] = true;
            candidate.hit(frame, j, &detections[j]);
        }
        let fresh = detections.iter().enumerate().filter(|(j, _)| !taken[*j]);
        self.candidates.extend(fresh.map(|(j, d)| Candidate {
            bbox: d.bbox,
            origin: d.bbox,
            velocity: (0.0, 0.0),
            hits: 1,
            ranks: d.score,
            first: frame,
            last: frame,
            newest: j,
        }));
        let enough = |c: &Candidate| c.hits >= s.hits && c.rank() >= s.rank;
        let ripe = |c: &Candidate| c.last == frame && enough(c) && (s.moved <= 0.0 || c.moved(picture) >= s.moved);
        let born = self.candidates.iter().filter(|c| ripe(c)).map(|c| (c.born(), c.newest)).collect();
        self.candidates.retain(|c| !ripe(c));
        born
    }

    /// Moves all candidates: `shift` returns the displacement at a place, pixels.
    pub(super) fn shift(&mut self, shift: &dyn Fn(f64, f64) -> (f64, f64)) {
        for c in &mut self.candidates {
            for b in [&mut c.bbox, &mut c.origin] {
                let (x, y) = b.centre();
                let (dx, dy) = shift(x, y);
                (b.x, b.y) = (b.x + dx, b.y + dy);
            }
        }
    }

    /// Appends the predicted boxes of the candidates.
    pub(super) fn expect(&self, frame: usize, s: &Settings, out: &mut Vec<Expected>) {
        let place = |c: &Candidate| Expected { bbox: c.expected(frame), variance: (0.0, 0.0), guess: false };
        out.extend(self.candidates.iter().filter(|c| c.may_return(frame, s)).map(place));
    }

    /// Checks numbers that were saved before frame `next`.
    pub(super) fn check(&self, next: usize) -> Result<(), String> {
        match self.candidates.iter().find(|c| c.first > c.last || c.last > next || c.hits == 0 || c.hits > next + 1) {
            None => Ok(()),
            Some(Candidate { first, last, hits, .. }) => Err(format!(
                "a tentative track has {hits} detections from frame {first} to {last}; expected first <= last <= `next`, \
                 {next}, and one a frame at most"
            )),
        }
    }

    /// Removes all candidates.
    pub(super) fn clear(&mut self) {
        self.candidates.clear();
    }
}

impl Candidate {
    /// Returns the detection that starts a target; its score is a mean rank.
    fn born(&self) -> Detection {
        Detection::new(self.bbox, self.rank())
    }
    /// Returns the mean rank of its detections' scores, 0 to 1.
    fn rank(&self) -> f64 {
        self.ranks / self.hits as f64
    }
    /// Returns whether it has missed few enough detections to continue.
    fn may_return(&self, frame: usize, s: &Settings) -> bool {
        s.asked(frame - self.last) <= MOST_MISSED + 1
    }
    fn expected(&self, frame: usize) -> BBox {
        let frames = (frame - self.last) as f64;
        BBox { x: self.bbox.x + frames * self.velocity.0, y: self.bbox.y + frames * self.velocity.1, ..self.bbox }
    }
    /// Returns how far it moved since its first detection, in half boxes, in a picture of this size; 0 if that may be jitter.
    fn moved(&self, (width, height): (f64, f64)) -> f64 {
        let (a, b) = (&self.origin, &self.bbox);
        let (x, y) = (edge::moved((a.x, a.w), (b.x, b.w), width), edge::moved((a.y, a.h), (b.y, b.h), height));
        if x.max(y) < JITTER { 0.0 } else { (2.0 * x / b.w).hypot(2.0 * y / b.h) }
    }
    fn hit(&mut self, frame: usize, number: usize, Detection { bbox, score, .. }: &Detection) {
        let frames = (frame - self.last).max(1) as f64;
        let ((x, y), (x0, y0)) = (bbox.centre(), self.bbox.centre());
        let share = if self.hits == 1 { 1.0 } else { NEWEST };
        self.velocity.0 += share * ((x - x0) / frames - self.velocity.0);
        self.velocity.1 += share * ((y - y0) / frames - self.velocity.1);
        (self.bbox, self.last, self.hits) = (*bbox, frame, self.hits + 1);
        self.ranks += score;
        self.newest = number;
    }
}

#[cfg(test)]
mod tests {
    use super::super::settings::Initiation;
    use super::*;

    fn with(initiation: Initiation) -> Settings {
        Settings { initiation, ..Settings::default() }
    }

    fn found(x: f64) -> Detection {
        Detection::new(BBox { x, y: 5.0, w: 20.0, h: 30.0 }, 1.0)
    }

    #[test]
    fn three_detections_start_a_target_and_stray_ones_do_not() {
        let (mut tentative, s) = (TentativeTracks::default(), Settings::default());
        for frame in 0..40 {
            // One candidate moves by 8 px a frame from frame 10 and is missed in frame 12; others come and go.
            let mut detections = vec![found(300.0 + 40.0 * (frame % 7) as f64)];
            if frame >= 10 && frame != 12 && frame <= 13 {
                detections.push(found(8.0 * (frame - 10) as f64));
            }
            let born = tentative.grow(frame, &detections, (400.0, 300.0), &s);
            match frame {
                13 => assert_eq!((born[0].0.bbox.x, born[0].1), (24.0, 1)),
                _ => assert!(born.is_empty(), "frame {frame}: {born:?}"),
            }
        }
        let at_once = with(Initiation { hits: 1, within: 1, ..s.initiation });
        assert_eq!(tentative.grow(41, &[found(1.0)], (400.0, 300.0), &at_once).len(), 1);
    }

    #[test]
    fn frames_without_the_detector_do_not_count() {
        let s = Settings { every: 5, ..Settings::default() };
        let born = |s: &Settings| {
            let mut tentative = TentativeTracks::default();
            let mut born = (0..40).filter(|frame| {
                // Seen in frames 5, 10, 20 (15 is missed), at 2 px a frame.
                let seen = [5, 10, 20].contains(frame).then(|| found(2.0 * *frame as f64));
                !tentative.grow(*frame, seen.as_slice(), (400.0, 300.0), s).is_empty()
            });
            born.next()
        };
        assert_eq!((born(&s), born(&Settings::default())), (Some(20), None));
    }

    #[test]
    fn a_weak_candidate_waits_for_stronger_detections() {
        let (mut tentative, s) = (TentativeTracks::default(), with(Initiation { rank: 0.5, ..Initiation::default() }));
        // Ranks 0.2, 0.2, 0.5, 0.9, 0.9: their mean is 0.54 with the fifth.
        for (frame, rank) in [0.2, 0.2, 0.5, 0.9, 0.9].into_iter().enumerate() {
            let seen = Detection { score: rank, ..found(4.0 * frame as f64) };
            let born = tentative.grow(frame, &[seen], (400.0, 300.0), &s);
            match frame {
                4 => assert!((born[0].0.score - 0.54).abs() < 1e-12),
                _ => assert!(born.is_empty(), "frame {frame}: {born:?}"),
            }
        }
    }

    #[test]
    fn candidates_move_with_the_camera() {
        let (mut tentative, s) = (TentativeTracks::default(), Settings::default());
        // The camera turns by 100 px a frame, more than the width of a box: a static object is found again.
        for frame in 0..3 {
            tentative.shift(&|_, _| (100.0, 0.0));
            let born = tentative.grow(frame, &[found(100.0 * frame as f64)], (400.0, 300.0), &s);
            assert_eq!(born.len(), usize::from(frame == 2));
        }
    }

    /// A candidate that moves uniformly is expected exactly where it will be, also after frames without a detection, and moves with the
    /// camera.
    #[test]
    fn uniform_motion_is_predicted_exactly() {
        let s = with(Initiation { hits: 9, within: 30, ..Initiation::default() });
        let at = |frame: usize| BBox { x: 6.0 * frame as f64, y: 90.0 - 4.0 * frame as f64, w: 20.0, h: 30.0 };
        let mut tentative = TentativeTracks::default();
        for frame in [0, 1, 3, 4] {
            assert!(tentative.grow(frame, &[Detection::new(at(frame), 1.0)], (400.0, 300.0), &s).is_empty());
        }
        let expected = |tentative: &TentativeTracks| {
            let mut all = vec![];
            tentative.expect(6, &s, &mut all);
            all.iter().map(|expected| expected.bbox).collect::<Vec<_>>()
        };
        assert_eq!(expected(&tentative), [at(6)]);
        tentative.shift(&|_, _| (30.0, -20.0));
        assert_eq!(expected(&tentative), [BBox { x: at(6).x + 30.0, y: at(6).y - 20.0, ..at(6) }]);
        tentative.clear();
        assert_eq!(expected(&tentative), []);
    }

    /// A candidate has one detection a frame at most, and none in frames to come.
    #[test]
    fn impossible_saved_candidates_are_refused() {
        let ok = |hits: usize, first: usize, last: usize| {
            let (bbox, velocity) = (found(0.0).bbox, (0.0, 0.0));
            let candidate = Candidate { bbox, origin: bbox, velocity, hits, ranks: 1.0, first, last, newest: 0 };
            TentativeTracks { candidates: vec![candidate] }.check(9).is_ok()
        };
        assert!(ok(1, 9, 9) && ok(10, 0, 9));
        assert!(!ok(1, 5, 4) && !ok(1, 0, 10) && !ok(0, 0, 9) && !ok(11, 0, 9));
    }

    #[test]
    fn only_moving_candidates_become_targets() {
        let s = with(Initiation { moved: 0.1, ..Initiation::default() });
        let (mut tentative, mut born) = (TentativeTracks::default(), vec![]);
        for frame in 0..30 {
            let jitter = f64::from(frame as u32 % 3);
            let in_view = BBox { x: 0.0, y: 200.0, w: 10.0 + 2.0 * frame as f64, h: 40.0 };
            let leaves = BBox { x: 0.0, y: 100.0, w: 80.0 - 2.0 * frame as f64, h: 40.0 };
            let [in_view, leaves] = [in_view, leaves].map(|bbox| Detection::new(bbox, 1.0));
            let all = [found(100.0 + jitter), in_view, leaves, found(200.0 + 2.0 * frame as f64)];
            born.extend(
                tentative.grow(frame, &all, (400.0, 300.0), &s).iter().map(|(b, _)| (b.bbox.y, b.bbox.x > 150.0)),
            );
        }
        assert!(born.contains(&(200.0, false)) && born.contains(&(5.0, true)), "{born:?}");
        assert!(!born.contains(&(5.0, false)) && !born.contains(&(100.0, false)), "{born:?}");
    }
}
