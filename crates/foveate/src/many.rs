//! Many targets: one [`Tracker`] each, and what happens between them.
//!
//! Every frame each detection goes to the target it fits best (overlap, motion, looks; one to one), targets that overlap are
//! put in order, so that the hidden one relies less on its pixels, and every tracker makes its step. Then some die, and
//! detections that follow each other where nobody lives are born: as somebody remembered, if they look like one who died,
//! or as somebody new.
//!
//! Deviation: the paper's experiments of many targets run trackers side by side that know nothing of each other.
//!
//! A target's randomness is named by its id: those who do not touch it cannot change a bit of its track. Targets make
//! their steps in parallel; the results do not depend on the number of threads.

mod births;
mod edge;
mod explain;
pub mod follow;
mod occlusion;
mod pairs;
mod saved;
pub mod settings;

pub use follow::{Followed, Plan, follow};
pub use settings::Settings;

use rayon::prelude::*;

use crate::Result;
use crate::geometry::{BBox, State};
use crate::observe::{Phase, Seen};
use crate::scene::{Detection, Frame, Scene};
use crate::tracker::Tracker;
use births::Nursery;
use explain::Look;
use occlusion::{Body, Fronts};
use pairs::Expected;

/// Makes the tracker of the target with this id.
pub type Make = Box<dyn Fn(u64) -> Tracker + Send>;

/// The dead that are remembered at most: each keeps its first frame.
const MOST_REMEMBERED: usize = 50;

/// Many targets being followed.
pub struct Many {
    settings: Settings,
    make: Make,
    /// By id.
    living: Vec<Target>,
    /// By time of death.
    dead: Vec<Target>,
    nursery: Nursery,
    fronts: Fronts,
    next_id: u64,
    /// Whether there ever was a detection.
    detecting: bool,
    seen: Vec<Seen>,
    work: Work,
}

/// One target.
struct Target {
    tracker: Tracker,
    seen: Seen,
    /// Frames in a row it was lost, and without a detection.
    lost: usize,
    unseen: usize,
    died: usize,
    /// Logarithm of its box's width over height, less that of its template's.
    shape: f64,
}

/// Buffers of one step.
#[derive(Default)]
struct Work {
    expected: Vec<Expected>,
    bodies: Vec<Body>,
    visible: Vec<f64>,
    detections: Vec<Detection>,
    /// The picture for each target, less what the others show.
    cleared: Vec<Frame>,
}

impl Many {
    /// Nobody yet. `make` is asked for a tracker at each birth; ids count from 1.
    pub fn new(settings: Settings, make: Make) -> Self {
        Self {
            settings,
            make,
            living: vec![],
            dead: Vec::with_capacity(MOST_REMEMBERED + 1), // so that a death allocates nothing
            nursery: Nursery::default(),
            fronts: Fronts::default(),
            next_id: 1,
            detecting: false,
            seen: vec![],
            work: Work::default(),
        }
    }

    /// One frame: its picture, and what a detector found in it. Answers those who live in it, by id.
    pub fn step(&mut self, frame: &Frame, detections: &[Detection]) -> &[Seen] {
        self.detecting |= !detections.is_empty();
        self.expect();
        self.assign(frame, detections);
        self.hide(frame);
        self.explain(frame);
        let (s, detecting) = (&self.settings, self.detecting);
        let cleared = &self.work.cleared;
        let move_on = |(i, target): (usize, &mut Target)| target.step(cleared.get(i).unwrap_or(frame), s, detecting);
        match self.living.len() > 1 && rayon::current_num_threads() > 1 {
            true => self.living.par_iter_mut().enumerate().for_each(move_on),
            false => self.living.iter_mut().enumerate().for_each(move_on),
        }
        self.bury(frame);
        self.deliver(frame);
        self.tell()
    }

    /// A target's box in this frame, which was already stepped through: a new target, or a living one that starts again.
    /// Answers its id, the next free one where none is given.
    ///
    /// Fails where the box has no area, is not finite, or does not touch the picture.
    pub fn give(&mut self, frame: &Frame, id: Option<u64>, bbox: BBox) -> Result<u64> {
        crate::start::check(&frame.image, &bbox)?;
        let id = id.unwrap_or(self.next_id);
        match self.living.binary_search_by_key(&id, |t| t.seen.id) {
            Ok(at) => {
                let born = self.living[at].seen.born;
                self.living[at].tracker.start(frame, bbox)?;
                self.living[at].begin(born, bbox, Phase::Born);
            }
            Err(_) => self.start(frame, id, bbox)?,
        }
        self.tell();
        Ok(id)
    }

    /// The picture changed altogether: all targets die, to be found again if they come back.
    pub fn cut(&mut self, frame: usize) {
        self.nursery.clear();
        self.fronts = Fronts::default();
        for mut target in self.living.drain(..) {
            target.died = frame;
            self.dead.push(target);
        }
        self.forget(frame);
        self.seen.clear();
    }

    /// Those who live in the last frame, by id.
    pub fn seen(&self) -> &[Seen] {
        &self.seen
    }

    /// The tracker of a living target.
    pub fn tracker(&self, id: u64) -> Option<&Tracker> {
        self.living.iter().find(|t| t.seen.id == id).map(|t| &t.tracker)
    }

    fn expect(&mut self) {
        self.work.expected.clear();
        self.work.expected.extend(self.living.iter().map(|t| {
            let c = &t.seen.covariance;
            Expected { bbox: t.shaped(t.next().bbox(t.seen.extent)), variance: (c[0][0] + c[2][2], c[1][1] + c[3][3]) }
        }));
    }

    /// Hands the detections out, and keeps those that nobody takes.
    fn assign(&mut self, frame: &Frame, detections: &[Detection]) {
        let Work { expected, detections: left, .. } = &mut self.work;
        left.clear();
        left.extend(detections.iter().filter(|d| pairs::is_box(&d.bbox) && !pairs::holds_several(&d.bbox, expected)));
        if left.is_empty() {
            return self.living.iter_mut().for_each(|target| target.seen.detection = None);
        }
        let living = &mut self.living;
        let given = pairs::pairs(expected, left, &self.settings, &mut |i, j| {
            let tracker = &mut living[i].tracker;
            let state = tracker.state_at(&left[j].bbox);
            tracker.likeness(&frame.image, &state)
        });
        for (target, given) in self.living.iter_mut().zip(&given) {
            target.seen.detection = given.map(|j| left[j]);
        }
        let mut j = 0;
        left.retain(|_| {
            j += 1;
            !given.contains(&Some(j - 1))
        });
    }

    /// Tells each tracker how much of its target can be seen.
    fn hide(&mut self, frame: &Frame) {
        let Work { expected, bodies, visible, .. } = &mut self.work;
        bodies.clear();
        for (i, target) in self.living.iter_mut().enumerate() {
            let bbox = expected[i].bbox;
            let meets = |(j, other): (usize, &Expected)| j != i && occlusion::meet(&bbox, &other.bbox);
            let met = expected.iter().enumerate().any(meets);
            let likeness = if met { target.tracker.likeness(&frame.image, &target.next()) } else { 1.0 };
            bodies.push(Body { id: target.seen.id, bbox, likeness });
        }
        occlusion::visible(bodies, &self.settings.occlusion, &mut self.fronts, visible);
        for (target, &visible) in self.living.iter_mut().zip(&*visible) {
            target.tracker.shade(if self.settings.occlusion.explain > 0.0 { 1.0 } else { visible });
            target.seen.visible = visible;
        }
    }

    /// Takes off each target's picture what the others show.
    fn explain(&mut self, frame: &Frame) {
        let (share, cleared) = (self.settings.occlusion.explain, &mut self.work.cleared);
        if share <= 0.0 {
            return;
        }
        let like = |f: &Frame| (f.image.width(), f.image.height()) == (frame.image.width(), frame.image.height());
        cleared.retain(|f| like(f) && f.image.planes() == frame.image.planes());
        cleared.resize_with(self.living.len().max(cleared.len()), || frame.clone());
        for (i, cleared) in cleared.iter_mut().enumerate().take(self.living.len()) {
            (cleared.index, cleared.time) = (frame.index, frame.time);
            for p in 0..frame.image.planes() {
                cleared.image.plane_mut(p).copy_from_slice(frame.image.plane(p));
            }
            for (_, other) in self.living.iter().enumerate().filter(|(j, t)| *j != i && t.seen.sure()) {
                if let Some((image, state, extent)) = other.tracker.parts().appearance.imprinted() {
                    explain::take_off(&mut cleared.image, Look { image, state, extent }, &other.next(), share);
                }
            }
        }
    }

    /// Takes out those who are gone.
    fn bury(&mut self, frame: &Frame) {
        let (s, detecting) = (&self.settings.death, self.detecting);
        let picture = BBox { x: 0.0, y: 0.0, w: frame.image.width() as f64, h: frame.image.height() as f64 };
        let gone = |t: &mut Target| {
            let b = &t.seen.bbox;
            let outside = b.intersection(&picture) < s.inside * b.w * b.h;
            outside || t.lost >= s.lost || (detecting && t.unseen >= s.unseen)
        };
        for mut target in self.living.extract_if(.., gone) {
            target.died = frame.index;
            self.dead.push(target);
        }
        self.forget(frame.index);
    }

    fn forget(&mut self, frame: usize) {
        self.dead.retain(|t| frame - t.died <= self.settings.memory.frames);
        let excess = self.dead.len().saturating_sub(MOST_REMEMBERED);
        self.dead.drain(..excess);
    }

    /// Births, of whom is remembered or of somebody new.
    fn deliver(&mut self, frame: &Frame) {
        let s = self.settings.birth;
        let mut left = std::mem::take(&mut self.work.detections);
        let size @ (width, height) = (frame.image.width() as f64, frame.image.height() as f64);
        let fits = |b: &BBox| b.w >= s.side && b.h >= s.side && b.w * b.h <= s.most * width * height;
        left.retain(|d| fits(&d.bbox) && !self.is_taken(&d.bbox));
        for born in self.nursery.grow(frame.index, &left, size, &s) {
            if crate::start::check(&frame.image, &born.bbox).is_err() || self.is_taken(&born.bbox) {
                continue;
            }
            match self.remembered(frame, &born.bbox) {
                Some(mut target) => {
                    target.tracker.place(&born.bbox);
                    let first = target.seen.born;
                    target.begin(first, born.bbox, Phase::Found);
                    self.admit(target);
                }
                None => self.start(frame, self.next_id, born.bbox).expect("the box was checked above"),
            }
        }
        self.work.detections = left;
    }

    /// Whether living targets are where something would be born.
    fn is_taken(&self, bbox: &BBox) -> bool {
        let s = &self.settings.birth;
        let area = bbox.w * bbox.h;
        let covered: f64 = self.living.iter().map(|t| t.seen.bbox.intersection(bbox) / area).sum();
        covered > s.covered || self.living.iter().any(|t| t.seen.bbox.iou(bbox) > s.overlap)
    }

    /// Takes out of memory whom a box looks like most, if anybody.
    fn remembered(&mut self, frame: &Frame, bbox: &BBox) -> Option<Target> {
        let size = self.settings.size.ln();
        let mut best = (self.settings.memory.likeness, None);
        for (i, target) in self.dead.iter_mut().enumerate() {
            let state = target.tracker.state_at(bbox);
            if (state.log_scale - target.seen.state.log_scale).abs() > size {
                continue;
            }
            let likeness = target.tracker.likeness(&frame.image, &state);
            if likeness >= best.0 {
                best = (likeness, Some(i));
            }
        }
        best.1.map(|i| self.dead.remove(i))
    }

    fn start(&mut self, frame: &Frame, id: u64, bbox: BBox) -> Result<()> {
        let mut tracker = (self.make)(id);
        tracker.start(frame, bbox)?;
        let mut target = Target { tracker, seen: Seen::unknown(id), lost: 0, unseen: 0, died: 0, shape: 0.0 };
        target.begin(frame.index, bbox, Phase::Born);
        self.next_id = self.next_id.max(id + 1);
        self.dead.retain(|dead| dead.seen.id != id);
        self.admit(target);
        Ok(())
    }

    fn admit(&mut self, target: Target) {
        let at = self.living.partition_point(|t| t.seen.id < target.seen.id);
        self.living.insert(at, target);
    }

    fn tell(&mut self) -> &[Seen] {
        self.seen.clear();
        self.seen.extend(self.living.iter().map(|t| t.seen));
        &self.seen
    }
}

impl Target {
    /// Where it is expected in the next frame.
    fn next(&self) -> State {
        let s = self.seen.state;
        State { x: s.x + s.vx, y: s.y + s.vy, ..s }
    }

    /// The same box in the target's present shape.
    fn shaped(&self, b: BBox) -> BBox {
        let ((x, y), wider) = (b.centre(), (self.shape / 2.0).exp());
        BBox::around(x, y, b.w * wider, b.h / wider)
    }

    /// A box that was given, or found.
    fn begin(&mut self, born: usize, bbox: BBox, phase: Phase) {
        let extent = self.tracker.extent().expect("it was started");
        let state = self.tracker.state_at(&bbox);
        let Seen { id, gaze, class, .. } = self.seen;
        self.seen = Seen { born, phase, bbox, state, extent, gaze, class, ..Seen::unknown(id) };
        (self.lost, self.unseen, self.shape) = (0, 0, (bbox.w / bbox.h / extent.half_w * extent.half_h).ln());
    }

    fn step(&mut self, frame: &Frame, s: &Settings, detecting: bool) {
        let detections = self.seen.detection.as_slice();
        let step = self.tracker.step(Scene { frame, detections });
        let (estimate, covariance, doubt, class) = (step.estimate, step.covariance, step.watch.doubt, step.class());
        let (gaze, bbox, lost) = (step.plan.chosen(), step.bbox(), step.lost() && detections.is_empty());
        self.unseen = if detections.is_empty() { self.unseen + 1 } else { 0 };
        self.lost = if lost { self.lost + 1 } else { 0 };
        let guessed = if detecting { self.unseen > s.death.guess } else { lost };
        let phase = match guessed {
            true => Phase::Lost,
            false if self.seen.visible < s.occlusion.hidden => Phase::Hidden,
            false => Phase::Followed,
        };
        let extent = self.tracker.extent().expect("it was started");
        self.seen = Seen { phase, state: estimate, covariance, extent, gaze, doubt, class, ..self.seen };
        if let Some(Detection { bbox: b, .. }) = self.seen.detection {
            self.shape += s.shape * ((b.w / b.h / extent.half_w * extent.half_h).ln() - self.shape);
        }
        self.seen.bbox = self.shaped(bbox);
        if let Some(Detection { bbox: b, .. }) = self.seen.detection {
            let comes_in = edge::comes_in(&self.seen.bbox, &b, &frame.image, s.birth.most);
            if comes_in {
                self.seen.bbox = b;
            }
            if comes_in || (doubt > s.renew && self.seen.visible >= 1.0) {
                self.renew(frame);
            }
        }
    }

    /// Takes a new template where it is, in its present shape; the old one stays where the box is no good.
    fn renew(&mut self, frame: &Frame) {
        let State { vx, vy, .. } = self.seen.state;
        if self.tracker.renew(&frame.image, &self.seen.bbox, (vx, vy)).is_ok() {
            self.seen.extent = self.tracker.extent().expect("it was started");
            (self.seen.state.log_scale, self.shape, self.seen.doubt) = (0.0, 0.0, 0.0);
        }
    }
}
