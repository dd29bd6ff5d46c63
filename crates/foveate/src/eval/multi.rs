//! The paper's second experiment as a table: many digits that grow, turn and cross, and what becomes of their tracks.
//!
//! A [`Run`] is one way to follow all targets of one synthetic video from their true first boxes. A [`Line`] sums up runs:
//! the scores of MOTChallenge, crossings, and how well size and angle are known.

use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::experiment::quantile;
use super::mot::{Crossings, Score, Sighting, Tracks, score};
use super::table::aligned;
use crate::geometry::{BBox, Extent, State};
use crate::many::Many;
use crate::observe::many::{ManyObserver, Phase, Seen};
use crate::scene::synthetic::MultiVideo;
use crate::scene::{Frame, Scene};
use crate::tracker::Tracker;
use crate::{Error, Result};

/// A scale that is off by more than this share, or a place by more than half a box, is no longer following.
const LEAST_OVERLAP: f64 = 0.5;

/// Follows all targets of a video: the first frame's boxes, then frame by frame.
pub trait Follower {
    /// The first frame, and the boxes of targets 1, 2, ...
    fn start(&mut self, frame: &Frame, boxes: &[BBox]) -> Result<()>;
    /// One more frame.
    fn step(&mut self, frame: &Frame) -> Result<()>;
    /// The targets after the last frame, by id: places in `boxes`, counted from 1.
    fn seen(&self) -> &[Seen];
}

/// One tracker a target, none of which knows of the others.
pub struct Alone {
    trackers: Vec<Tracker>,
    seen: Vec<Seen>,
}

impl Alone {
    /// With a tracker for each target.
    pub fn new(trackers: Vec<Tracker>) -> Self {
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
            tracker.start(frame, *bbox)?;
            let (born, state, extent) = (frame.index, State::of(bbox), Extent::of(bbox));
            self.seen.push(Seen { born, bbox: *bbox, state, extent, ..Seen::unknown(i as u64 + 1) });
        }
        Ok(())
    }

    fn step(&mut self, frame: &Frame) -> Result<()> {
        for (tracker, seen) in self.trackers.iter_mut().zip(&mut self.seen) {
            let step = tracker.step(Scene { frame, detections: &[] });
            *seen = Seen {
                phase: if step.lost() { Phase::Lost } else { Phase::Followed },
                bbox: step.bbox(),
                state: step.estimate,
                covariance: step.covariance,
                gaze: step.plan.chosen(),
                doubt: step.watch.doubt,
                class: step.class(),
                ..*seen
            };
        }
        Ok(())
    }

    fn seen(&self) -> &[Seen] {
        &self.seen
    }
}

impl Follower for Many {
    fn start(&mut self, frame: &Frame, boxes: &[BBox]) -> Result<()> {
        Many::step(self, frame, &[]);
        (1..).zip(boxes).try_for_each(|(id, bbox)| self.give(frame, Some(id), *bbox).map(drop))
    }
    fn step(&mut self, frame: &Frame) -> Result<()> {
        Many::step(self, frame, &[]);
        Ok(())
    }
    fn seen(&self) -> &[Seen] {
        Many::seen(self)
    }
}

/// One target in one frame, as it was believed to be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Found {
    /// The frame, from 0.
    pub frame: usize,
    /// The target, from 1.
    pub id: u64,
    /// Where.
    pub bbox: BBox,
    /// Logarithm of its size relative to its first frame.
    pub log_scale: f64,
    /// Its turn since then, radians.
    pub angle: f64,
    /// Whether the box is a result rather than a guess.
    pub sure: bool,
    /// What it is called.
    pub class: Option<usize>,
}

/// One way to follow all targets of one video.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Length of the video.
    pub frames: usize,
    /// All targets in all frames, the first one included.
    pub found: Vec<Found>,
    /// Time in the follower from the second frame on, seconds.
    pub seconds: f64,
}

impl Run {
    /// Follows a video's targets from their true first boxes, and shows every frame to the observer.
    ///
    /// # Errors
    /// Those of the follower and of the observer, whose `finish` is not called here.
    pub fn follow(video: &MultiVideo, follower: &mut dyn Follower, observer: &mut dyn ManyObserver) -> Result<Self> {
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
                sure: seen.sure(),
                class: seen.class.map(|(class, _)| class),
            }));
            observer.observe(&frame, follower.seen())?;
        }
        Ok(run)
    }

    /// Whether these could be the results of a video of so many frames: a check of what was read from a file.
    pub fn is_of(&self, frames: usize) -> bool {
        self.frames == frames && self.found.iter().all(|found| found.frame < frames)
    }

    /// The boxes that are results.
    pub fn tracks(&self) -> Tracks {
        let one = |f: &Found| Sighting { frame: f.frame, id: f.id as i64, bbox: f.bbox, confidence: 1.0 };
        Tracks { sightings: self.found.iter().filter(|f| f.sure).map(one).collect() }
    }

    /// Its figures.
    ///
    /// # Errors
    /// The boxes cannot be scored.
    pub fn judge(&self, video: &MultiVideo) -> Result<Judged> {
        let (truth, results) = (video.truth(), self.tracks());
        let mut judged = Judged {
            score: score(&truth, &results)?,
            crossings: Crossings::of(&truth, &results),
            scale: vec![],
            angle: vec![],
            on: 0,
            named: 0,
            right: 0,
        };
        for f in self.found.iter().filter(|f| f.frame > 0) {
            let Some(mover) = (f.id as usize).checked_sub(1).and_then(|i| video.movers().get(i)) else { continue };
            let truth = mover.states[f.frame];
            judged.scale.push(((f.log_scale - truth.log_scale).exp() - 1.0).abs());
            let turn = f.angle - truth.angle;
            judged.angle.push(turn.sin().atan2(turn.cos()).abs().to_degrees());
            judged.on += usize::from(f.bbox.iou(&mover.bbox(f.frame)) >= LEAST_OVERLAP);
            if let Some(class) = f.class {
                judged.named += 1;
                judged.right += usize::from(class == usize::from(mover.class));
            }
        }
        Ok(judged)
    }
}

/// The figures of one run.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// MOTA, IDF1, HOTA and so on.
    pub score: Score,
    /// What became of the crossings.
    pub crossings: Crossings,
    /// For each target and frame from the second on: |size / true size − 1|.
    pub scale: Vec<f64>,
    /// For the same: the difference of angles, degrees, 0 to 180.
    pub angle: Vec<f64>,
    /// How many of these overlap their own target by half.
    pub on: usize,
    /// How many have a class, and the right one.
    pub named: usize,
    /// How many of them have the right one.
    pub right: usize,
}

/// One line of the table: one way to follow, on all videos.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// What was run.
    pub name: String,
    /// Number of videos.
    pub videos: usize,
    /// The scores, pooled.
    #[serde(flatten)]
    pub score: Score,
    /// What became of the crossings.
    pub crossings: Crossings,
    /// Median and 90 % quantile over targets and frames of |size / true size − 1|.
    pub scale_error: [f64; 2],
    /// The same of the difference of angles, degrees.
    pub angle_error: [f64; 2],
    /// Share of targets and frames whose box overlaps its own target by half.
    pub on: f64,
    /// Share of the frames with a class that have the right one; none without a recogniser.
    pub right: Option<f64>,
    /// Frames a second of a video with all its targets, in one thread.
    pub fps: Option<f64>,
}

impl Line {
    /// Sums up runs and their figures; `None` without any.
    pub fn of(name: &str, runs: &[&Run], judged: &[Judged]) -> Option<Self> {
        let all = |values: fn(&Judged) -> &Vec<f64>| judged.iter().flat_map(values).copied().collect::<Vec<f64>>();
        let (scale, angle) = (all(|j| &j.scale), all(|j| &j.angle));
        if scale.is_empty() {
            return None;
        }
        let sum = |count: fn(&Judged) -> usize| judged.iter().map(count).sum::<usize>() as f64;
        let named = sum(|j| j.named);
        let frames: usize = runs.iter().map(|run| run.frames - 1).sum();
        let seconds: f64 = runs.iter().map(|run| run.seconds).sum();
        Some(Self {
            name: name.into(),
            videos: judged.len(),
            score: Score::pooled(judged.iter().map(|j| &j.score)),
            crossings: Crossings::pooled(judged.iter().map(|j| &j.crossings)),
            scale_error: [quantile(&scale, 0.5), quantile(&scale, 0.9)],
            angle_error: [quantile(&angle, 0.5), quantile(&angle, 0.9)],
            on: sum(|j| j.on) / scale.len() as f64,
            right: (named > 0.0).then(|| sum(|j| j.right) / named),
            fps: (seconds > 0.0).then(|| frames as f64 / seconds),
        })
    }
}

const HEADS: [&str; 13] = [
    "",
    "videos",
    "HOTA",
    "IDF1",
    "MOTA",
    "switches",
    "crossings",
    "kept",
    "swapped",
    "scale error (90 %)",
    "angle error (90 %)",
    "class right",
    "frames/s",
];

/// Aligned text with its explanations.
pub fn text(lines: &[Line]) -> String {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let cells = |line: &Line| {
        let (s, c) = (&line.score, &line.crossings);
        vec![
            line.name.clone(),
            line.videos.to_string(),
            format!("{:.3}", s.hota.hota),
            format!("{:.3}", s.identity.idf1),
            format!("{:.3}", s.clear.mota),
            s.clear.switches.to_string(),
            c.all.to_string(),
            percent(c.share_kept()),
            percent(c.share_swapped()),
            format!("{} ({})", percent(line.scale_error[0]), percent(line.scale_error[1])),
            format!("{:.1}° ({:.1}°)", line.angle_error[0], line.angle_error[1]),
            line.right.map_or("-".into(), percent),
            line.fps.map_or("-".into(), |fps| format!("{fps:.0}")),
        ]
    };
    let mut rows = vec![HEADS.map(String::from).to_vec()];
    rows.extend(lines.iter().map(cells));
    format!(
        "{}\n{}",
        aligned(&rows),
        "HOTA, IDF1, MOTA, switches: all videos pooled, boxes believed lost left out; boxes are upright, of the target's size.\n\
         crossings: half of the smaller box is covered by the other target's. kept: both targets have, within 10 frames after, the\n\
         track they had within 10 frames before; swapped: one has the other's.\n\
         scale and angle error: median and 90 % quantile over all targets and frames from the second on, those off the target too.\n\
         class right: the class decided over all frames so far. frames/s: all targets of a frame, in one thread.\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Gaze;
    use crate::scene::Digits;
    use crate::scene::synthetic::Multi;

    /// Says what is true, but for a size 10 % too large, an angle 3 degrees off, and a last target that is lost.
    struct Oracle(MultiVideo, Vec<Seen>);

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
                    Seen {
                        id,
                        born: 0,
                        phase: if id as usize == last { Phase::Lost } else { Phase::Followed },
                        bbox: state.bbox(mover.extent),
                        state,
                        extent: mover.extent,
                        covariance: [[0.0; 6]; 6],
                        gaze: Gaze::CENTRE,
                        visible: 1.0,
                        doubt: 0.0,
                        detection: None,
                        class: Some((if t > 10 { mover.class.into() } else { 11 }, 0.9)),
                    }
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
        fn seen(&self) -> &[Seen] {
            &self.1
        }
    }

    #[test]
    fn figures_of_a_known_follower() {
        let video = Multi { targets: 4, frames: 31, crossings: 0, ..Multi::default() };
        let video = video.video(&Digits::drawn(1, 2)).expect("a video");
        let mut nobody: Vec<Box<dyn ManyObserver>> = vec![];
        let run = Run::follow(&video, &mut Oracle(video.clone(), vec![]), &mut nobody).expect("it follows");
        assert!(run.is_of(31) && !run.is_of(30) && run.found.len() == 124);
        let judged = run.judge(&video).expect("it can be judged");
        assert!(judged.scale.iter().all(|e| (e - 0.1).abs() < 1e-9) && judged.scale.len() == 120);
        assert!(judged.angle.iter().all(|e| (e - 3.0).abs() < 1e-9));
        assert_eq!((judged.on, judged.named, judged.right), (120, 120, 80));
        // Three of four boxes are there: recall 3/4, precision 1.
        assert!((judged.score.clear.mota - 0.75).abs() < 1e-9);
        assert!((judged.score.identity.idf1 - 2.0 * 0.75 / 1.75).abs() < 1e-9);
        let line = Line::of("oracle", &[&run], &[judged]).expect("a run");
        assert!((line.scale_error[0] - 0.1).abs() < 1e-9 && line.right == Some(80.0 / 120.0));
        assert!(text(&[line]).contains("10.0 % (10.0 %)"));
        assert!(Line::of("none", &[], &[]).is_none());
        let mut too_few = Alone::new(vec![]);
        let problem = Run::follow(&video, &mut too_few, &mut nobody).expect_err("no tracker").to_string();
        assert!(problem.contains("0 trackers for 4 targets"), "{problem}");
    }
}
