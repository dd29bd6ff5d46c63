//! Multi-target tracking: one particle filter per target, and the interactions of targets.
//!
//! In every frame, each detection is assigned to the target that it fits best (overlap, motion, appearance; one to one), and overlapping
//! targets are put in depth order, so that an occluded target relies less on its pixels. Targets share the evidence where they overlap, so
//! that they do not end on the same object. Then every filter makes its step. At last, tracks of targets that are gone are terminated, and
//! persistent unmatched detections start new ones, after a re-identification check against terminated ones.
//!
//! Deviation: the paper's experiments with several targets run independent trackers.
//!
//! The id of a target names its random streams, so targets that do not overlap it cannot change its track by a bit. Targets make their
//! steps in parallel; the results do not depend on the number of threads.

pub mod attention;
mod edge;
mod explain;
mod groups;
mod initiation;
mod lifecycle;
mod meeting;
mod memory_estimate;
mod occlusion;
mod pairs;
mod pool;
mod ranks;
mod saved;
pub mod settings;
mod target;

pub use crate::seen::Phase;
pub(crate) use memory_estimate::MemoryEstimate;
pub use settings::Settings;

use crate::engine::Claim;
use crate::ensemble::Ensemble;
use crate::geometry::{BBox, Size};
use crate::origin::Origin;
use crate::scene::{Detection, Image, Preprocessor};
use crate::seen::Seen;

use foveate_base::{Error, Result};
use initiation::TentativeTracks;
use meeting::Meetings;
use occlusion::{Body, Fronts};
use pairs::Expected;
use pool::BufferPool;
use ranks::Ranks;
use target::Target;

/// Creates the trackers of the target with this id.
pub(crate) type Make = Box<dyn Fn(u64) -> Ensemble + Send + Sync>;

/// Creates a preprocessor.
pub(crate) type Fresh = Box<dyn Fn() -> Preprocessor + Send + Sync>;

/// Maximum number of remembered terminated targets; each keeps its first frame.
const MOST_REMEMBERED: usize = 50;

/// Upper bound of target ids: the last bit names the random streams of a second tracker.
const MOST_ID: u64 = 1 << 63;

/// IoU from which two boxes belong to the same target.
const SAME: f64 = 0.6;

/// Follows many targets: those that the caller adds, and those that detections start.
pub struct MultiTracker {
    origin: Origin,
    settings: Settings,
    room: MemoryEstimate,
    /// Whether the memory limit kept a track from starting.
    full: bool,
    make: Make,
    /// Creates a preprocessor without history.
    fresh: Fresh,
    preprocessor: Preprocessor,
    /// Numbers of the present picture, from 0, and of the next.
    frame: usize,
    next: usize,
    /// Whether the state was loaded, and no picture came since: the planes are unknown, and a skipped picture was counted.
    resumed: bool,
    size: Option<Size>,
    /// Width, height and planes of the last picture.
    shape: [usize; 3],
    /// In order of id.
    active: Vec<Target>,
    /// In order of termination.
    terminated: Vec<Target>,
    tentative: TentativeTracks,
    ranks: Ranks,
    fronts: Fronts,
    next_id: u64,
    /// Whether there has been any detection.
    detecting: bool,
    targets: Vec<Seen<'static>>,
    /// The targets whose boxes are results.
    results: Vec<Seen<'static>>,
    pool: BufferPool,
    work: Work,
}

/// Buffers of one step.
#[derive(Default)]
struct Work {
    expected: Vec<Expected>,
    meetings: Meetings,
    /// The predicted place of each target, unless it is lost, and all pairs of overlapping targets, in both directions.
    claims: Vec<Option<Claim>>,
    neighbours: Vec<(usize, usize)>,
    bodies: Vec<Body>,
    visible: Vec<f64>,
    /// Unassigned detections, and the index of each among all of the frame.
    detections: Vec<Detection>,
    numbers: Vec<usize>,
    found: Vec<Detection>,
    /// The picture for each target, from which the templates of the others are subtracted.
    cleared: Vec<Image>,
    order: Vec<(f64, usize)>,
}

impl MultiTracker {
    pub(crate) fn of(origin: Origin, settings: Settings, room: MemoryEstimate, make: Make, fresh: Fresh) -> Self {
        Self {
            origin,
            settings,
            room,
            full: false,
            make,
            preprocessor: fresh(),
            fresh,
            frame: 0,
            next: 0,
            resumed: false,
            size: None,
            shape: [1, 1, 1],
            active: vec![],
            terminated: Vec::with_capacity(MOST_REMEMBERED + 1), // so that a termination allocates nothing
            tentative: TentativeTracks::default(),
            ranks: Ranks::default(),
            fronts: Fronts::default(),
            next_id: 1,
            detecting: false,
            targets: vec![],
            results: vec![],
            pool: BufferPool::default(),
            work: Work::default(),
        }
    }

    /// Tracks all targets into the next picture. `detections` are those of your detector, pixels from 0, in any order; if the
    /// configuration has a detector, its detections are added. Returns the targets whose boxes are results, by id: targets in the phase
    /// [`Phase::Lost`] are left out, and [`MultiTracker::targets`] has them too. [`Seen::detection_index`] names the detection that was
    /// assigned to a target.
    ///
    /// A detection without a score has the score NaN. If no detection has a score, or all have the same one, each can start a track, but
    /// none can start one beside another target.
    ///
    /// # Errors
    /// [`Error::Invalid`] if size or planes of the picture differ from those of the first one (after [`MultiTracker::cut`] it may), or if a
    /// detection's box is not finite or has no width or height; nothing changes then. [`Error::Stopped`] if another thread has stopped the
    /// tracker: see [`MultiTracker::stopper`].
    pub fn update(&mut self, image: &Image, detections: &[Detection]) -> Result<&[Seen<'static>]> {
        let size = image.size();
        self.check_shape(image)?;
        detections.iter().enumerate().try_for_each(|(index, detection)| detection.check(index))?;
        if self.next >= saved::MOST_FRAMES {
            return Err(Error::Invalid(format!("a video has at most {} frames", saved::MOST_FRAMES)));
        }
        (self.size, self.shape) = (Some(size), image.shape());
        (self.frame, self.next, self.resumed) = (self.next, self.next + 1, false);
        self.preprocessor.look_or_watch(image, self.frame.is_multiple_of(self.settings.every));
        let mut found = std::mem::take(&mut self.work.found);
        found.clear();
        found.extend_from_slice(detections);
        found.extend_from_slice(self.preprocessor.detections());
        self.step(image, &found, detections.len());
        self.work.found = found;
        if self.pool.stops() {
            return Err(Error::Stopped);
        }
        Ok(&self.results)
    }

    /// Runs one frame. The first `own` detections are the caller's.
    fn step(&mut self, image: &Image, detections: &[Detection], own: usize) {
        self.detecting |= !detections.is_empty();
        self.ranks.look(detections);
        if let Some(flow) = self.preprocessor.flow() {
            for target in &mut self.active {
                target.ensemble.compensate(flow);
                target.ensemble.first().shift(flow, &mut target.track.state);
            }
            let camera = flow.camera();
            self.tentative.shift(&|x, y| camera.at(x, y));
        }
        self.expect();
        self.attend();
        self.assign(image, detections, own);
        self.occlude(image);
        self.exclude();
        self.explain(image);
        let (s, detecting) = (&self.settings, self.detecting);
        let (cleared, pool) = (&self.work.cleared, &self.pool);
        crate::threads::each(&mut self.active, |i, target| {
            if pool.stops() {
                return;
            }
            let image = cleared.get(i).unwrap_or(image);
            if !target.looked_at && target.ensemble.first().waits() {
                return target.step(image, s, detecting); // It needs no buffers.
            }
            target.with_buffers(pool, |target| target.step(image, s, detecting));
        });
        self.terminate(image);
        self.initiate(image, detections, own);
        self.publish();
    }

    /// Adds a target with its box in the picture of the last update, or restarts an active one. Returns its id; if `id` is `None`, that is
    /// the next free one.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the picture has another shape than those before, if the box is not finite, smaller than 2 × 2 pixels, or does
    /// not touch the picture, or if the id is 2⁶³ or more.
    /// [`Error::Memory`] if another target exceeds the memory limit ([`foveate_base::memory`]).
    pub fn add(&mut self, image: &Image, id: Option<u64>, bbox: BBox) -> Result<u64> {
        self.check_shape(image)?;
        crate::start::check(image, &bbox)?;
        if self.pool.stops() {
            return Err(Error::Stopped);
        }
        let id = id.unwrap_or(self.next_id);
        let known = self.active.binary_search_by_key(&id, |t| t.track.id);
        let earlier = known.map(|at| &self.active[at]).ok();
        let earlier = earlier.or_else(|| self.terminated.iter().find(|target| target.track.id == id));
        let born = earlier.map_or(self.frame, |target| target.track.born);
        if known.is_err() {
            self.place(image, id, bbox)?;
        }
        // Where it is, or where it was just inserted.
        let at = known.unwrap_or_else(|at| at);
        self.active[at].start(image, born, bbox, &self.pool);
        self.publish();
        Ok(id)
    }

    /// Declares a cut in the video: terminates all targets, which are re-identified if they return.
    pub fn cut(&mut self) {
        self.tentative.clear();
        self.fronts = Fronts::default();
        (self.size, self.frame) = (None, self.next);
        self.preprocessor = (self.fresh)();
        for mut target in self.active.drain(..) {
            target.terminated = self.frame;
            self.terminated.push(target);
        }
        self.forget();
        self.publish();
    }

    /// Shows a picture without tracking to the detector and the camera motion, which compare pictures. It counts as a frame, but for the
    /// first after [`MultiTracker::load`]: that is the last one before the state was saved.
    pub fn skip(&mut self, image: &Image) {
        self.preprocessor.look(image);
        match std::mem::take(&mut self.resumed) {
            true => self.shape = image.shape(),
            false => self.next += 1,
        }
    }

    /// Returns all active targets of the last picture, by id. The boxes of targets in the phase [`Phase::Lost`] are guesses.
    pub fn targets(&self) -> &[Seen<'static>] {
        &self.targets
    }

    /// Returns the active target with this id in the last picture, lost or not.
    pub fn target(&self, id: u64) -> Option<&Seen<'static>> {
        self.targets.binary_search_by_key(&id, |target| target.id).ok().map(|at| &self.targets[at])
    }

    fn expect(&mut self) {
        self.work.expected.clear();
        self.work.expected.extend(self.active.iter().map(|t| {
            let c = &t.track.covariance;
            // The variance of place plus velocity.
            let variance = [0, 1].map(|k| c[k][k] + 2.0 * c[k][k + 2] + c[k + 2][k + 2]);
            let (bbox, guess) = (t.shaped(t.next().bbox(t.track.extent)), self.settings.guesses(t.unseen));
            Expected { bbox, variance: (variance[0], variance[1]), guess }
        }));
        let Work { expected, meetings, .. } = &mut self.work;
        meetings.find(expected.len(), &|i| expected[i].bbox);
    }

    /// Selects the targets that are updated in this frame.
    fn attend(&mut self) {
        let (attention, order) = (&self.settings.attention, &mut self.work.order);
        let all = attention.suffices(self.active.len());
        self.active.iter_mut().for_each(|target| target.looked_at = all);
        if !all {
            attention.order(self.active.iter().map(Target::candidate), order);
            order.iter().take(attention.budget).for_each(|(_, i)| self.active[*i].looked_at = true);
        }
    }

    /// Assigns detections to targets, one to one, and keeps the unmatched ones.
    fn assign(&mut self, image: &Image, detections: &[Detection], own: usize) {
        let Work { expected, detections: left, numbers, .. } = &mut self.work;
        left.clear();
        numbers.clear();
        let merged = |b: &BBox| self.settings.merges && pairs::holds_several(b, expected);
        for (k, d) in detections.iter().enumerate().filter(|(_, d)| pairs::is_box(&d.bbox) && !merged(&d.bbox)) {
            left.push(*d);
            numbers.push(k);
        }
        if left.is_empty() {
            return self.active.iter_mut().for_each(|target| target.set_detection(None, None));
        }
        // Tentative tracks take part, so that their detections are not assigned to targets.
        self.tentative.expect(self.frame, &self.settings, expected);
        let (active, ranks, s, pool) = (&mut self.active, &self.ranks, &self.settings, &self.pool);
        let unknown = s.unknown_rank();
        let weak = |d: &Detection| ranks.of(d.score).unwrap_or(unknown) < s.weak;
        let mut given = pairs::in_stages(expected, left, &weak, s, &mut |i, j| {
            let target = active.get_mut(i).filter(|target| target.looked_at && !pool.stops())?;
            let state = target.ensemble.first().state_at(&left[j].bbox);
            Some(target.with_buffers(pool, |target| target.ensemble.first_mut().similarity(image, &state)))
        });
        given.truncate(self.active.len());
        expected.truncate(self.active.len());
        let mut taken = vec![false; left.len()];
        given.iter().flatten().for_each(|j| taken[*j] = true);
        for (target, given) in self.active.iter_mut().zip(&given) {
            let index = given.map(|j| numbers[j]).filter(|k| *k < own);
            target.set_detection(given.map(|j| left[j]), index);
        }
        pairs::retain_both(left, numbers, |j, _| !taken[j]);
    }

    /// Sets the visible fraction of each target.
    fn occlude(&mut self, image: &Image) {
        let Work { expected, meetings, bodies, visible, .. } = &mut self.work;
        let (meetings, pool) = (&*meetings, &self.pool);
        bodies.clear();
        crate::threads::each(&mut self.active, |i, target| {
            let looks = target.looked_at && meetings.meets(i) && !pool.stops();
            target.similarity = if looks { target.similarity_ahead(image, pool) } else { 1.0 };
        });
        let body = |(t, e): (&Target, &Expected)| Body { id: t.track.id, bbox: e.bbox, similarity: t.similarity };
        bodies.extend(self.active.iter().zip(&*expected).map(body));
        occlusion::visible(bodies, meetings, &self.settings.occlusion, &mut self.fronts, visible);
        for (target, &visible) in self.active.iter_mut().zip(&*visible) {
            target.ensemble.set_visibility(if self.settings.occlusion.explain > 0.0 { 1.0 } else { visible });
            target.track.visible = visible;
        }
    }

    /// Sets the places that overlapping targets claim, because two targets cannot be in one place. With detections or explaining away,
    /// which separate targets too, there are no claims.
    fn exclude(&mut self) {
        let Work { expected, meetings, claims, neighbours, .. } = &mut self.work;
        claims.clear();
        claims.extend(self.active.iter().zip(&*expected).map(|(t, e)| t.track.is_usable().then(|| e.claim())));
        neighbours.clear();
        if !self.detecting && self.settings.occlusion.explain <= 0.0 {
            neighbours.extend(meetings.pairs().flat_map(|(i, j)| [(i, j), (j, i)]));
            neighbours.sort_unstable();
        }
        let mut rest = &neighbours[..];
        for (i, target) in self.active.iter_mut().enumerate() {
            let (met, others) = rest.split_at(rest.partition_point(|(k, _)| *k == i));
            rest = others;
            target.ensemble.exclude(expected[i].claim(), met.iter().filter_map(|(_, j)| claims[*j]));
        }
    }

    /// Subtracts the templates of all other targets from each target's picture.
    fn explain(&mut self, image: &Image) {
        let (share, cleared) = (self.settings.occlusion.explain, &mut self.work.cleared);
        if share <= 0.0 {
            return;
        }
        cleared.retain(|i| i.shape() == image.shape());
        cleared.resize_with(self.active.len().max(cleared.len()), || image.clone());
        for (i, cleared) in cleared.iter_mut().enumerate().take(self.active.len()) {
            for p in 0..image.planes() {
                cleared.plane_mut(p).copy_from_slice(image.plane(p));
            }
            for (_, other) in self.active.iter().enumerate().filter(|(j, t)| *j != i && t.track.is_usable()) {
                if let Some(source) = other.ensemble.first().parts().appearance.template_source() {
                    explain::take_off(cleared, source, &other.next(), share);
                }
            }
        }
    }

    fn publish(&mut self) {
        self.targets.clear();
        self.targets.extend(self.active.iter().map(|t| Seen { shape: self.shape, ..t.track }));
        self.results.clear();
        self.results.extend(self.targets.iter().filter(|target| target.is_usable()));
    }
}
