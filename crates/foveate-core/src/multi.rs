//! Multi-target tracking: one particle filter a target, and what happens between targets.
//!
//! Every frame each detection is assigned to the target it fits best (overlap, motion, appearance; one to one), targets that
//! overlap are put in order of depth, so that the occluded one relies less on its pixels, what is seen where they meet is shared among
//! them, so that they do not end on one of them, and every filter makes its step.
//! Then tracks that are gone are terminated, and persistent unmatched detections start new ones, after a re-identification
//! check against terminated ones.
//!
//! Deviation: the paper's experiments of many targets run trackers side by side that know nothing of each other.
//!
//! A target's randomness is named by its id: those who do not touch it cannot change a bit of its track. Targets make
//! their steps in parallel; the results do not depend on the number of threads.

pub mod attention;
mod edge;
mod explain;
mod groups;
mod initiation;
mod lifecycle;
mod meeting;
mod occlusion;
mod pairs;
mod pool;
mod ranks;
mod room;
mod saved;
pub mod settings;
mod target;

pub use crate::seen::Phase;
pub(crate) use room::Room;
pub use settings::Settings;

use crate::engine::{Claim, Engine};
use crate::geometry::BBox;
use crate::origin::Origin;
use crate::scene::{Detection, Image, Preprocessor};
use crate::seen::Seen;

use foveate_base::{Error, Result};
use initiation::TentativeTracks;
use meeting::Meetings;
use occlusion::{Body, Fronts};
use pairs::Expected;
use pool::Pool;
use ranks::Ranks;
use target::Target;

/// Makes the engine of the target with this id.
pub(crate) type Make = Box<dyn Fn(u64) -> Engine + Send + Sync>;

/// Makes a preprocessor.
pub(crate) type Fresh = Box<dyn Fn() -> Preprocessor + Send + Sync>;

/// The terminated targets that are remembered at most: each keeps its first frame.
const MOST_REMEMBERED: usize = 50;

/// Ids of targets are below this: the last bit names the randomness of a second opinion.
const MOST_ID: u64 = 1 << 63;

/// Intersection over union from which on two boxes are of the same target.
const SAME: f64 = 0.6;

/// Follows many targets: those that are given, and those that detections start.
pub struct MultiTracker {
    origin: Origin,
    settings: Settings,
    room: Room,
    /// Whether memory kept a track from being started.
    full: bool,
    make: Make,
    /// Makes a preprocessor that has seen nothing.
    fresh: Fresh,
    preprocessor: Preprocessor,
    /// Number of the present picture, from 0, and of the next.
    frame: usize,
    next: usize,
    /// Whether it was loaded since the last update: pictures that are skipped then were counted before.
    resumed: bool,
    size: Option<(usize, usize)>,
    /// Width, height and planes of the last picture.
    shape: [usize; 3],
    /// By id.
    active: Vec<Target>,
    /// By time of termination.
    terminated: Vec<Target>,
    tentative: TentativeTracks,
    ranks: Ranks,
    fronts: Fronts,
    next_id: u64,
    /// Whether there ever was a detection.
    detecting: bool,
    targets: Vec<Seen<'static>>,
    /// Those of them whose boxes are results.
    results: Vec<Seen<'static>>,
    pool: Pool,
    work: Work,
}

/// Buffers of one step.
#[derive(Default)]
struct Work {
    expected: Vec<Expected>,
    meetings: Meetings,
    /// Where each target is expected, if it is not lost, and who meets whom, both ways round.
    claims: Vec<Option<Claim>>,
    neighbours: Vec<(usize, usize)>,
    bodies: Vec<Body>,
    visible: Vec<f64>,
    /// Detections that no target has yet, and the number of each among all of the frame.
    detections: Vec<Detection>,
    numbers: Vec<usize>,
    found: Vec<Detection>,
    /// The picture for each target, less what the others show.
    cleared: Vec<Image>,
    order: Vec<(f64, usize)>,
}

impl MultiTracker {
    pub(crate) fn of(origin: Origin, settings: Settings, room: Room, make: Make, fresh: Fresh) -> Self {
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
            pool: Pool::default(),
            work: Work::default(),
        }
    }

    /// Tracks all targets into the next picture. `detections` are those of your detector, pixels from 0, in any order; if the
    /// configuration has a detector, its detections are added. Returns the targets whose boxes are results, by id: targets in the phase
    /// [`Phase::Lost`] are left out, and [`MultiTracker::targets`] has them too. [`Seen::detection_index`] names the detection that
    /// was assigned to a target.
    ///
    /// A detection without a score has the score NaN. If no detection has a score, or all have the same one, each can start a track, but
    /// none can start one beside another target.
    ///
    /// # Errors
    /// [`Error::Invalid`] where the picture has another size than the first one (after [`MultiTracker::cut`] it may), or a detection's box is
    /// not finite or has no width or height; then nothing has changed.
    /// [`Error::Stopped`] where it was asked to: see [`MultiTracker::stopper`].
    pub fn update(&mut self, image: &Image, detections: &[Detection]) -> Result<&[Seen<'static>]> {
        let size = (image.width(), image.height());
        if self.size.is_some_and(|first| first != size) {
            return Err(Error::Invalid(format!(
                "the picture is {} x {}, those before it were {:?}; give pictures of one size, or call cut between them",
                size.0, size.1, self.size
            )));
        }
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

    /// One frame. Of the detections, the first `own` are the caller's.
    fn step(&mut self, image: &Image, detections: &[Detection], own: usize) {
        self.detecting |= !detections.is_empty();
        self.ranks.look(detections);
        if let Some(flow) = self.preprocessor.flow() {
            self.active.iter_mut().for_each(|target| target.engine.compensate(flow, &mut target.track.state));
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
            if !target.looked_at && target.engine.waits(target.track.detection.is_some()) {
                return target.step(image, s, detecting); // It needs no room.
            }
            target.looking(pool, |target| target.step(image, s, detecting));
        });
        self.terminate(image);
        self.initiate(image, detections, own);
        self.publish();
    }

    /// A target's box in the picture of the last update: a new target, or an active one that starts again. Answers its id, the
    /// next free one where none is given.
    ///
    /// # Errors
    /// [`Error::Invalid`] where the box is not finite, smaller than 2 × 2 pixels, or does not touch the picture, or the id is 2⁶³ or
    /// more; [`Error::Memory`]
    /// where another target takes more memory than there may be ([`foveate_base::memory`]).
    pub fn add(&mut self, image: &Image, id: Option<u64>, bbox: BBox) -> Result<u64> {
        crate::start::check(image, &bbox)?;
        if self.pool.stops() {
            return Err(Error::Stopped);
        }
        let id = id.unwrap_or(self.next_id);
        match self.active.binary_search_by_key(&id, |t| t.track.id) {
            Ok(at) => {
                let born = self.active[at].track.born;
                self.active[at].looking(&self.pool, |target| target.engine.init(image, bbox))?;
                self.active[at].begin(born, bbox, Phase::Initiated);
            }
            Err(_) => _ = self.start(image, id, bbox)?,
        }
        self.publish();
        Ok(id)
    }

    /// The picture changed altogether: all targets are terminated, to be re-identified if they come back.
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

    /// A picture that is not tracked in, before the first that is, or before the first update after [`MultiTracker::load`]:
    /// detector and camera motion compare pictures, and see it.
    pub fn skip(&mut self, image: &Image) {
        self.preprocessor.look(image);
        self.next += usize::from(!self.resumed);
    }

    /// All active targets of the last picture, by id, with those in the phase [`Phase::Lost`], whose boxes are guesses.
    pub fn targets(&self) -> &[Seen<'static>] {
        &self.targets
    }

    /// The active target with this id, lost or not, in the last picture.
    pub fn target(&self, id: u64) -> Option<&Seen<'static>> {
        self.targets.binary_search_by_key(&id, |target| target.id).ok().map(|at| &self.targets[at])
    }

    fn expect(&mut self) {
        self.work.expected.clear();
        self.work.expected.extend(self.active.iter().map(|t| {
            let c = &t.track.covariance;
            // Of place and velocity together.
            let variance = [0, 1].map(|k| c[k][k] + 2.0 * c[k][k + 2] + c[k + 2][k + 2]);
            let (bbox, guess) = (t.shaped(t.next().bbox(t.track.extent)), self.settings.guesses(t.unseen));
            Expected { bbox, variance: (variance[0], variance[1]), guess }
        }));
        let Work { expected, meetings, .. } = &mut self.work;
        meetings.find(expected.len(), &|i| expected[i].bbox);
    }

    /// Decides who is looked at.
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
        // Tentative tracks take part: what is theirs is left to them.
        self.tentative.expect(self.frame, &self.settings, expected);
        let (active, ranks, s, pool) = (&mut self.active, &self.ranks, &self.settings, &self.pool);
        let unknown = s.unknown_rank();
        let weak = |d: &Detection| ranks.of(d.score).unwrap_or(unknown) < s.weak;
        let mut given = pairs::in_stages(expected, left, &weak, s, &mut |i, j| {
            let target = active.get_mut(i).filter(|target| target.looked_at && !pool.stops())?;
            let state = target.engine.state_at(&left[j].bbox);
            Some(target.looking(pool, |target| target.engine.similarity(image, &state)))
        });
        given.truncate(self.active.len());
        expected.truncate(self.active.len());
        for (target, given) in self.active.iter_mut().zip(&given) {
            let index = given.map(|j| numbers[j]).filter(|k| *k < own);
            target.set_detection(given.map(|j| left[j]), index);
        }
        pairs::retain_both(left, numbers, |j, _| !given.contains(&Some(j)));
    }

    /// Tells each engine how much of its target can be seen.
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
            target.engine.set_visibility(if self.settings.occlusion.explain > 0.0 { 1.0 } else { visible });
            target.track.visible = visible;
        }
    }

    /// Two targets cannot be in one place: where boxes meet, each engine gets the places that the others are expected at. Detections, and
    /// explaining away, tell targets apart in their own way.
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
            target.engine.exclude(expected[i].claim(), met.iter().filter_map(|(_, j)| claims[*j]));
        }
    }

    /// Takes off each target's picture what the others show.
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
                if let Some(source) = other.engine.parts().appearance.template_source() {
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
