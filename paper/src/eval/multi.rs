//! The paper's second experiment as a table: many digits that grow, turn and cross, and the accuracy of their tracks.
//!
//! A [`Run`] is one way to follow all targets of one synthetic video from their true first boxes. A [`Line`] summarises runs: the scores of
//! MOTChallenge, identity preservation at crossings, and the errors of size and angle.

use std::time::Instant;

use serde::{Deserialize, Serialize};

use foveate::Tracker;
use foveate::geometry::BBox;
use foveate::lab::eval::experiment::quantile;
use foveate::lab::eval::mot::{Crossings, Score, TrackBox, Tracks, score};
use foveate::lab::synthetic::MultiVideo;
use foveate::multi::MultiTracker;
use foveate::report::Observer;
use foveate::video::Frame;
use foveate::{Error, Result, Seen};

/// Follows all targets of a video: first the boxes of the first frame, then frame by frame.
pub(crate) trait Follower {
    /// Starts on the first frame with the boxes of targets 1, 2, ...
    fn start(&mut self, frame: &Frame, boxes: &[BBox]) -> Result<()>;
    /// Tracks in the next frame.
    fn step(&mut self, frame: &Frame) -> Result<()>;
    /// Returns the targets after the last frame, by id: indices of `boxes`, counted from 1.
    fn seen(&self) -> &[Seen<'static>];
}

/// An independent tracker for each target.
pub(crate) struct Alone {
    trackers: Vec<Tracker>,
    seen: Vec<Seen<'static>>,
}

impl Alone {
    /// Creates a follower with a tracker for each target.
    pub(crate) fn new(trackers: Vec<Tracker>) -> Self {
        Self { trackers, seen: vec![] }
    }
}

impl Follower for Alone {
    fn start(&mut self, frame: &Frame, boxes: &[BBox]) -> Result<()> {
        if boxes.len() != self.trackers.len() {
            return Err(Error::Invalid(format!("{} trackers for {} targets", self.trackers.len(), boxes.len())));
        }
        self.seen.clear();
        for (i, (tracker, bbox)) in self.trackers.iter_mut().zip(boxes).enumerate() {
            tracker.init(&frame.image, *bbox)?;
            let mut seen = Seen::given(frame.image.shape(), bbox);
            (seen.id, seen.born) = (i as u64 + 1, frame.index);
            self.seen.push(seen);
        }
        Ok(())
    }

    fn step(&mut self, frame: &Frame) -> Result<()> {
        for (tracker, seen) in self.trackers.iter_mut().zip(&mut self.seen) {
            let (id, born) = (seen.id, seen.born);
            *seen = tracker.update(&frame.image)?.without_views();
            (seen.id, seen.born) = (id, born);
        }
        Ok(())
    }

    fn seen(&self) -> &[Seen<'static>] {
        &self.seen
    }
}

impl Follower for MultiTracker {
    fn start(&mut self, frame: &Frame, boxes: &[BBox]) -> Result<()> {
        self.update(&frame.image, &[])?;
        (1..).zip(boxes).try_for_each(|(id, bbox)| self.add(&frame.image, Some(id), *bbox).map(drop))
    }
    fn step(&mut self, frame: &Frame) -> Result<()> {
        self.update(&frame.image, &[]).map(drop)
    }
    fn seen(&self) -> &[Seen<'static>] {
        self.targets()
    }
}

/// The estimate of one target in one frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Found {
    /// The frame, from 0.
    pub frame: usize,
    /// The target, from 1.
    pub id: u64,
    /// The box.
    pub bbox: BBox,
    /// Logarithm of the size relative to the first frame.
    pub log_scale: f64,
    /// Rotation since the first frame, radians.
    pub angle: f64,
    /// Whether the box is a result rather than a guess.
    pub sure: bool,
    /// The class.
    pub class: Option<usize>,
}

/// One way to follow all targets of one video.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Run {
    /// Length of the video.
    pub frames: usize,
    /// The estimates of all targets in all frames, including the first.
    pub found: Vec<Found>,
    /// Time in the follower from the second frame on, seconds.
    pub seconds: f64,
}

impl Run {
    /// Follows a video's targets from their true first boxes, and shows every frame to the observer.
    ///
    /// # Errors
    /// Those of the follower and of the observer. The caller must call the observer's `finish`.
    pub(crate) fn follow(video: &MultiVideo, follower: &mut dyn Follower, observer: &mut dyn Observer) -> Result<Self> {
        let mut run = Self { frames: video.frames(), ..Self::default() };
        for frame in video.clone().source() {
            let frame = frame?;
            let began = Instant::now();
            if frame.index == 0 {
                let boxes: Vec<BBox> = video.movers().iter().map(|m| m.bbox(0)).collect();
                follower.start(&frame, &boxes)?;
            } else {
                follower.step(&frame)?;
                run.seconds += began.elapsed().as_secs_f64();
            }
            run.found.extend(follower.seen().iter().map(|seen| Found {
                frame: frame.index,
                id: seen.id,
                bbox: seen.bbox,
                log_scale: seen.state.log_scale,
                angle: seen.state.angle,
                sure: seen.is_usable(),
                class: seen.class.map(|(class, _)| class),
            }));
            observer.observe(&frame, follower.seen())?;
        }
        Ok(run)
    }

    /// Returns whether the results can belong to a video with this number of frames: a check of a file's content.
    pub(crate) fn is_of(&self, frames: usize) -> bool {
        self.frames == frames && self.found.iter().all(|found| found.frame < frames)
    }

    /// Returns the boxes that are results.
    pub(crate) fn tracks(&self) -> Tracks {
        let one = |f: &Found| TrackBox { frame: f.frame, id: f.id as i64, bbox: f.bbox, confidence: 1.0 };
        Tracks { sightings: self.found.iter().filter(|f| f.sure).map(one).collect() }
    }

    /// Computes the scores.
    ///
    /// # Errors
    /// The boxes cannot be scored.
    pub(crate) fn judge(&self, video: &MultiVideo) -> Result<Judged> {
        let (truth, results) = (video.truth(), self.tracks());
        let mut judged = Judged {
            score: score(&truth, &results)?,
            crossings: Crossings::of(&truth, &results),
            scale: vec![],
            angle: vec![],
            named: 0,
            right: 0,
        };
        for f in self.found.iter().filter(|f| f.frame > 0) {
            let Some(mover) = (f.id as usize).checked_sub(1).and_then(|i| video.movers().get(i)) else { continue };
            let truth = mover.states[f.frame];
            judged.scale.push(((f.log_scale - truth.log_scale).exp() - 1.0).abs());
            let turn = f.angle - truth.angle;
            judged.angle.push(turn.sin().atan2(turn.cos()).abs().to_degrees());
            if let Some(class) = f.class {
                judged.named += 1;
                judged.right += usize::from(class == usize::from(mover.class));
            }
        }
        Ok(judged)
    }
}

/// The scores of one run.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Judged {
    /// MOTA, IDF1, HOTA and so on.
    pub score: Score,
    /// The outcomes of the crossings.
    pub crossings: Crossings,
    /// |size / true size − 1| for each target and frame from the second on.
    pub scale: Vec<f64>,
    /// The difference of angles for the same targets and frames, degrees, 0 to 180.
    pub angle: Vec<f64>,
    /// The number of these with a class.
    pub named: usize,
    /// The number of these with the right class.
    pub right: usize,
}

/// One line of the table: one way to follow, on all videos.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Line {
    /// Name of the tracker.
    pub name: String,
    /// Its configuration.
    pub configuration: String,
    /// Description of the videos.
    pub scene: String,
    /// Number of videos. All scores are pooled over them.
    pub videos: usize,
    /// HOTA.
    pub hota: f64,
    /// IDF1.
    pub idf1: f64,
    /// MOTA.
    pub mota: f64,
    /// Identity switches.
    pub switches: usize,
    /// Number of crossings of two targets.
    pub crossings: usize,
    /// Fraction of the crossings that preserve both identities: afterwards both targets have the tracks they had.
    pub preserved: f64,
    /// Fraction of the crossings that swap identities: afterwards one target has the other's track.
    pub swapped: f64,
    /// Median over targets and frames of |size / true size − 1|.
    pub scale_error: f64,
    /// Median of the difference of angles, degrees.
    pub angle_error: f64,
    /// Fraction of the frames with a class that have the right one; `None` without a recogniser.
    pub right: Option<f64>,
}

impl Line {
    /// Summarises the scores of runs; `None` without a run.
    pub(crate) fn of(name: &str, configuration: &str, scene: &str, judged: &[Judged]) -> Option<Self> {
        let all = |values: fn(&Judged) -> &Vec<f64>| judged.iter().flat_map(values).copied().collect::<Vec<f64>>();
        let (scale, angle) = (all(|j| &j.scale), all(|j| &j.angle));
        if scale.is_empty() {
            return None;
        }
        let sum = |count: fn(&Judged) -> usize| judged.iter().map(count).sum::<usize>() as f64;
        let named = sum(|j| j.named);
        let score = Score::pooled(judged.iter().map(|j| &j.score));
        let crossings = Crossings::pooled(judged.iter().map(|j| &j.crossings));
        Some(Self {
            name: name.into(),
            configuration: configuration.into(),
            scene: scene.into(),
            videos: judged.len(),
            hota: score.hota.hota,
            idf1: score.identity.idf1,
            mota: score.clear.mota,
            switches: score.clear.switches,
            crossings: crossings.all,
            preserved: crossings.share_preserved(),
            swapped: crossings.share_swapped(),
            scale_error: quantile(&scale, 0.5),
            angle_error: quantile(&angle, 0.5),
            right: (named > 0.0).then(|| sum(|j| j.right) / named),
        })
    }
}

/// Returns the frames per second of videos with all their targets, in one thread.
pub(crate) fn fps(runs: &[&Run]) -> Option<f64> {
    let frames: usize = runs.iter().map(|run| run.frames - 1).sum();
    let seconds: f64 = runs.iter().map(|run| run.seconds).sum();
    (seconds > 0.0).then(|| frames as f64 / seconds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate::geometry::State;
    use foveate::lab::Digits;
    use foveate::lab::synthetic::Multi;
    use foveate::multi::Phase;

    /// Returns the truth, except for a size 10 % too large, an angle 3 degrees off, and a lost last target.
    struct Oracle(MultiVideo, Vec<Seen<'static>>);

    impl Oracle {
        fn at(&mut self, t: usize) {
            let last = self.0.movers().len();
            self.1 = (1..)
                .zip(self.0.movers())
                .map(|(id, mover)| {
                    let truth = mover.states[t];
                    let state = State {
                        log_scale: truth.log_scale + 1.1f64.ln(),
                        angle: truth.angle - 3f64.to_radians(),
                        ..truth
                    };
                    let phase = if id as usize == last { Phase::Lost } else { Phase::Tracked };
                    let mut seen = Seen::given([1; 3], &state.bbox(mover.extent)).in_phase(phase);
                    (seen.id, seen.state, seen.extent) = (id, state, mover.extent);
                    seen.class = Some((if t > 10 { mover.class.into() } else { 11 }, 0.9));
                    seen
                })
                .collect();
        }
    }

    impl Follower for Oracle {
        fn start(&mut self, _: &Frame, boxes: &[BBox]) -> Result<()> {
            assert_eq!(boxes.len(), self.0.movers().len());
            self.at(0);
            Ok(())
        }
        fn step(&mut self, frame: &Frame) -> Result<()> {
            self.at(frame.index);
            Ok(())
        }
        fn seen(&self) -> &[Seen<'static>] {
            &self.1
        }
    }

    #[test]
    fn figures_of_a_known_follower() {
        let video = Multi { targets: 4, frames: 31, crossings: 0, ..Multi::default() };
        let video = video.video(&Digits::drawn(1, 2)).expect("a video");
        let mut nobody: Vec<Box<dyn Observer>> = vec![];
        let run = Run::follow(&video, &mut Oracle(video.clone(), vec![]), &mut nobody).expect("it follows");
        assert!(run.is_of(31) && !run.is_of(30) && run.found.len() == 124);
        let judged = run.judge(&video).expect("it can be judged");
        assert!(judged.scale.iter().all(|e| (e - 0.1).abs() < 1e-9) && judged.scale.len() == 120);
        assert!(judged.angle.iter().all(|e| (e - 3.0).abs() < 1e-9));
        assert_eq!((judged.named, judged.right), (120, 80));
        // Three of four boxes are found: recall 3/4, precision 1.
        assert!((judged.score.clear.mota - 0.75).abs() < 1e-9);
        assert!((judged.score.identity.idf1 - 2.0 * 0.75 / 1.75).abs() < 1e-9);
        let line = Line::of("oracle", "none", "digits", &[judged]).expect("a run");
        assert!((line.scale_error - 0.1).abs() < 1e-9 && line.right == Some(80.0 / 120.0));
        assert!(Line::of("none", "none", "digits", &[]).is_none());
        let mut too_few = Alone::new(vec![]);
        let problem = Run::follow(&video, &mut too_few, &mut nobody).expect_err("no tracker").to_string();
        assert!(problem.contains("0 trackers for 4 targets"), "{problem}");
    }
}
