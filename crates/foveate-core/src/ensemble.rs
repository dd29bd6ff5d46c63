//! Several trackers follow one target. A *voter* has a vote on the reported box and on P(lost) (`control/confidence/vote.rs`). Each voter may
//! have a *second tracker*, which reads another part of the target and has no vote: the voter compares the two boxes inside its step
//! (`engine/second.rs`). With one voter the result is that of a single tracker.
//!
//! A voter that has lost the target while the majority tracks it restarts at the elected box. It keeps its own template, so that it
//! judges that place by its own evidence.

use std::iter::once;

use serde_json::json;

use crate::control::{Ballot, Vote};
use crate::engine::{Claim, Engine, Parts};
use crate::geometry::BBox;
use crate::saved_state::{SavedState, refused};
use crate::scene::{Flow, Image, Meter, Scene, World};
use crate::seen::{Phase, Seen};
use crate::threads;
use foveate_base::Result;

/// Upper bound on the number of rectangles that a voter and its second tracker read of a picture.
const WINDOWS: usize = 64;

/// The random streams of a tracker are named by the number of its target. From this bit on it contains the number of the voter, and its last
/// bit is flipped for a second tracker, so that no two trackers share a random draw.
const VOTER: u32 = 56;
const SECOND: u64 = 1 << 63;

/// The trackers of one target.
pub(crate) struct Ensemble {
    /// At least one.
    members: Vec<Member>,
    vote: Vote,
    ballots: Vec<Ballot>,
    meter: Meter,
}

struct Member {
    voter: Engine,
    second: Option<Engine>,
}

impl Member {
    fn step<'a>(&'a mut self, world: World<'a, '_>) -> Result<Seen<'a>> {
        self.voter.step(world, self.second.as_mut())
    }
    fn trackers(&self) -> impl Iterator<Item = &Engine> {
        once(&self.voter).chain(&self.second)
    }
    fn trackers_mut(&mut self) -> impl Iterator<Item = &mut Engine> {
        once(&mut self.voter).chain(&mut self.second)
    }
}

impl Ensemble {
    /// Creates an ensemble with a voter of each of these parts, and a second tracker where they have parts for one. Its random streams are
    /// named by `seed` and `target`. Panics without parts.
    pub(crate) fn new(parts: Vec<Parts>, seed: u64, target: u64) -> Self {
        let member = |(mut parts, k): (Parts, u64)| {
            let (second, target) = (parts.second.take(), target ^ (k << VOTER));
            let second = second.map(|second| Engine::new(*second, seed, target ^ SECOND));
            Member { voter: Engine::new(parts, seed, target), second }
        };
        let members: Vec<Member> = parts.into_iter().zip(0..).map(member).collect();
        let vote = Vote::new(members[0].voter.parts().monitor.model());
        let meter = if members.len() > 1 { Meter::with_room(WINDOWS * members.len()) } else { Meter::default() };
        Self { members, vote, ballots: Vec::new(), meter }
    }

    /// Returns the first voter.
    pub(crate) fn first(&self) -> &Engine {
        &self.members[0].voter
    }
    /// Returns the first voter, for questions about the target and frames without a look, in which nothing is compared.
    pub(crate) fn first_mut(&mut self) -> &mut Engine {
        &mut self.members[0].voter
    }

    fn trackers_mut(&mut self) -> impl Iterator<Item = &mut Engine> {
        self.members.iter_mut().flat_map(Member::trackers_mut)
    }

    /// Starts all trackers on the target in this box.
    ///
    /// # Errors
    /// As [`Engine::init`], before anything has changed.
    pub(crate) fn init(&mut self, image: &Image, bbox: BBox) -> Result<()> {
        self.trackers_mut().try_for_each(|tracker| tracker.init(image, bbox))?;
        self.vote.reset();
        Ok(())
    }

    /// Runs one frame: a step of every tracker, and the vote. Several voters need a picture in memory.
    ///
    /// # Errors
    /// As [`Engine::step`].
    pub(crate) fn step<'a>(&'a mut self, world: World<'a, '_>) -> Result<Seen<'a>> {
        let scene = match world {
            World::Picture(scene) if self.members.len() > 1 => scene,
            world => return self.members[0].step(world),
        };
        threads::each(&mut self.members, |_, member| {
            member.step(World::Picture(scene)).expect("a picture in memory can be read");
        });
        self.ballots.clear();
        self.ballots.extend(self.members.iter().map(|Member { voter, .. }| {
            let (bbox, confidence) = voter.reported();
            Ballot { bbox, p_lost: confidence.p_lost, is_searching: voter.is_searching() }
        }));
        let (elected, p_lost, status) = self.vote.count(&self.ballots);
        if !self.vote.is_searching() {
            self.reset_lost_members(elected);
        }
        self.meter.clear();
        self.members.iter().for_each(|member| self.meter.add_all(member.voter.meter()));
        let values = self.meter.pixels() * scene.image.planes();
        let phase = Phase::of(status);
        Ok(Seen { values, p_lost, status, phase, ..self.members[elected].voter.report(scene) })
    }

    /// Runs one frame on a picture in memory.
    pub(crate) fn step_on<'a>(&'a mut self, scene: Scene<'a>) -> Seen<'a> {
        self.step(World::Picture(scene)).expect("a picture in memory can be read")
    }

    /// Restarts lost voters and their second trackers at the elected box.
    fn reset_lost_members(&mut self, elected: usize) {
        let here = self.ballots[elected].bbox;
        let lost = |(_, ballot): &(&mut Member, &Ballot)| ballot.is_searching && !ballot.is_on(&here);
        let members = self.members.iter_mut().zip(&self.ballots).filter(lost);
        members.flat_map(|(member, _)| member.trackers_mut()).for_each(|tracker| tracker.start_again_at(&here));
    }

    pub(crate) fn compensate(&mut self, flow: &Flow) {
        self.trackers_mut().for_each(|tracker| tracker.compensate(flow));
    }

    pub(crate) fn reset_at(&mut self, bbox: &BBox) {
        self.vote.reset();
        self.trackers_mut().for_each(|tracker| tracker.reset_at(bbox));
    }

    pub(crate) fn set_visibility(&mut self, visible: f64) {
        self.trackers_mut().for_each(|tracker| tracker.set_visibility(visible));
    }

    /// Sets the number of frames that were dropped before the next one.
    pub(crate) fn set_dropped(&mut self, frames: usize) {
        self.trackers_mut().for_each(|tracker| tracker.set_dropped(frames));
    }

    /// Takes a new template: see [`Engine::update_template`].
    pub(crate) fn update_template(&mut self, image: &Image, bbox: &BBox, velocity: (f64, f64)) -> Result<()> {
        self.trackers_mut().try_for_each(|tracker| tracker.update_template(image, bbox, velocity))
    }

    /// Sets the places that other targets claim: see [`Engine::exclude`].
    pub(crate) fn exclude(&mut self, own: Claim, others: impl Iterator<Item = Claim> + Clone) {
        self.trackers_mut().for_each(|tracker| tracker.exclude(own, others.clone()));
    }

    /// Frees memory that is not needed until the next step.
    pub(crate) fn compact(&mut self) {
        self.trackers_mut().for_each(Engine::compact);
    }

    /// Returns the state of all trackers, of each voter before its second tracker, and of the vote.
    pub(crate) fn save(&self) -> SavedState {
        let trackers: Vec<_> = self.members.iter().flat_map(Member::trackers).map(Engine::save).collect();
        SavedState::new(&json!({ "trackers": trackers, "vote": self.vote.state }))
    }

    /// Restores a state that [`Ensemble::save`] returned.
    pub(crate) fn load(&mut self, saved: &SavedState) -> Result<()> {
        let trackers: Vec<SavedState> = saved.part_read("trackers")?;
        let (count, ours) = (trackers.len(), self.trackers_mut().count());
        if count != ours {
            return Err(refused("tracker", &format!("it has {count} trackers, this one {ours}")));
        }
        self.trackers_mut().zip(&trackers).try_for_each(|(tracker, saved)| tracker.load(saved))?;
        let has_target = self.first().has_target();
        if self.trackers_mut().any(|tracker| tracker.has_target() != has_target) {
            return Err(refused("tracker", "some of its trackers have a target, others none"));
        }
        self.vote.state = saved.part_read("vote")?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use foveate_base::files::Nowhere;

    /// A chequered square at `x` on stripes.
    fn picture(x: usize) -> Image {
        let pixel = |i: usize| {
            let (column, row) = (i % 120, i / 120);
            let inside = (x..x + 20).contains(&column) && (30..50).contains(&row);
            if inside {
                60 + 130 * u8::from(((column - x) / 4 + row / 4).is_multiple_of(2))
            } else {
                20 + (7 * (row / 3) % 60) as u8
            }
        };
        Image::new(120, 90, 1, (0..120 * 90).map(pixel).collect()).expect("120 x 90")
    }

    /// One of three members is moved away, cannot find the target by itself, and is reset.
    #[test]
    fn a_lost_member_restarts_at_the_others() {
        let settings = [
            "particles=100",
            "committee=3",
            "second_opinion=none",
            "redetection=none",
            "local_search=none",
            "distractors=none",
            "box_regression=none",
            // The fitted weights leave the member on the stripes in doubt, P(lost) .42 to .52.
            "confidence.enter=0.3",
            "confidence.leave=0.1",
        ];
        let natural = Config::builtin("natural").expect("it ships").expect("it is right");
        let config = settings.iter().try_fold(natural, |config, setting| config.set(setting)).expect("keys");
        let blueprint = config.check(&Nowhere).expect("parts that fit");
        let mut committee = Ensemble::new(blueprint.members().expect("parts that fit"), 2, 0);
        let target = |x: usize| BBox::new(x as f64, 30.0, 20.0, 20.0);
        committee.init(&picture(10), target(10)).expect("a box in the picture");
        committee.members[2].voter.reset_at(&target(90));
        let mut fetched = None;
        committee.set_visibility(0.9);
        for i in 1..40 {
            let image = picture(10 + i / 2);
            let here = target(10 + i / 2);
            let result = committee.step_on(Scene { image: &image, detections: &[] });
            assert!(result.bbox.iou(&here) > 0.3, "frame {i}: {:?}", result.bbox);
            if committee.members[2].voter.reported().0.iou(&here) > 0.3 {
                fetched = fetched.or(Some(i));
            }
        }
        assert!(fetched.is_some_and(|i| i > 1), "fetched in frame {fetched:?}");
        assert!(
            committee.trackers_mut().all(|tracker| tracker.save().part("visible") == SavedState::new(&0.9)),
            "as much can be seen of it as before"
        );
    }

    /// Frames that were dropped before a picture were so for second trackers, too.
    #[test]
    fn all_trackers_move_over_dropped_frames() {
        use crate::engine::toy::{Toy, parts, picture, target};
        let pair = || parts(Toy::at(50.0)).with_second_tracker(Some(parts(Toy::at(50.0))));
        let mut ensemble = Ensemble::new((0..2).map(|_| pair()).collect(), 1, 0);
        ensemble.init(&picture(), target(50.0)).expect("a box in the picture");
        ensemble.set_dropped(3);
        assert_eq!(ensemble.trackers_mut().map(|tracker| tracker.dropped()).collect::<Vec<_>>(), [3; 4]);
    }

    /// The parts of a tracker that hardly moves: at a distance of 40 pixels it does not find the target by itself.
    #[test]
    fn the_committee_resets_a_lost_member() {
        use crate::engine::toy::{Toy, parts, picture, started, target};
        let image = picture();
        let scene = Scene { image: &image, detections: &[] };
        let mut alone = started(parts(Toy::at(50.0)), 2);
        let mut committee = Ensemble::new((0..3).map(|_| parts(Toy::at(50.0))).collect(), 1, 0);
        committee.init(&image, target(50.0)).expect("a box in the picture");
        alone.reset_at(&target(90.0));
        committee.members[2].voter.reset_at(&target(90.0));
        for frame in 0..20 {
            alone.step_on(scene);
            assert!(committee.step_on(scene).bbox.iou(&target(50.0)) > 0.5);
            let stays = committee.members[2].voter.reported().0.iou(&target(90.0)) > 0.5;
            assert!(frame > 2 || stays, "frame {frame}: it is not lost yet");
        }
        assert!(alone.is_searching() && alone.reported().0.iou(&target(90.0)) > 0.5, "alone it is lost");
        assert!(committee.members[2].voter.reported().0.iou(&target(50.0)) > 0.5, "fetched");
        assert!(!committee.members[2].voter.is_searching());
    }

    /// One voter has the status of a single tracker, bit for bit, also while it is lost: its model decides, not the rule of the vote.
    #[test]
    fn one_voter_is_a_single_tracker() {
        use crate::engine::toy::{Toy, parts, picture, started, target};
        let image = picture();
        let scene = Scene { image: &image, detections: &[] };
        let mut alone = started(parts(Toy::at(50.0)), 0);
        let mut ensemble = Ensemble::new(vec![parts(Toy::at(50.0))], 1, 0);
        ensemble.init(&image, target(50.0)).expect("a box in the picture");
        for frame in 0..30 {
            if frame == 5 {
                alone.reset_at(&target(90.0));
                ensemble.reset_at(&target(90.0));
            }
            let (a, b) = (alone.step_on(scene), ensemble.step_on(scene));
            assert_eq!((a.bbox, a.p_lost, a.status, a.phase), (b.bbox, b.p_lost, b.status, b.phase), "frame {frame}");
        }
        assert!(alone.is_searching());
    }

    /// The random streams of the trackers differ, a state fits the same number of trackers, and the vote is a part of it.
    #[test]
    fn trackers_share_no_draw_and_save_their_vote() {
        use crate::engine::toy::{Toy, parts, picture, target};
        let pair = || parts(Toy::at(50.0)).with_second_tracker(Some(parts(Toy::at(50.0))));
        let ensemble = |n| Ensemble::new((0..n).map(|_| pair()).collect(), 1, 0);
        let (mut one, mut two) = (ensemble(2), ensemble(2));
        assert!(ensemble(3).load(&one.save()).is_err());
        one.vote.count(&[Ballot { bbox: target(50.0), p_lost: 1.0, is_searching: true }]);
        two.load(&one.save()).expect("as many trackers");
        assert!(two.vote.is_searching());
        one.init(&picture(), target(50.0)).expect("a box in the picture");
        let drawn: Vec<_> = one.trackers_mut().map(|tracker| tracker.save().part("filter").to_string()).collect();
        assert!((0..4).all(|i| (0..i).all(|k| drawn[i] != drawn[k])));
    }

    /// The step of a voter compares its box with that of its second tracker, and leads a lost second tracker back.
    #[test]
    fn a_voter_reads_and_leads_its_second_tracker() {
        use crate::engine::toy::{Toy, parts, picture, target};
        let pair = parts(Toy::at(50.0)).with_second_tracker(Some(parts(Toy::at(50.0))));
        let mut ensemble = Ensemble::new(vec![pair], 1, 0);
        ensemble.init(&picture(), target(50.0)).expect("a box in the picture");
        let (agreement, image) = (crate::control::AGREEMENT, picture());
        let scene = Scene { image: &image, detections: &[] };
        assert!(ensemble.step_on(scene).cues[agreement] > 0.5);
        let second = |it: &mut Ensemble| it.members[0].second.take().expect("it has one");
        let mut away = second(&mut ensemble);
        away.reset_at(&target(95.0));
        ensemble.members[0].second = Some(away);
        (0..20).for_each(|_| _ = ensemble.step_on(scene));
        assert!(second(&mut ensemble).reported().0.iou(&target(50.0)) > 0.5);
    }

    /// A box that is given ends the search of the vote.
    #[test]
    fn a_given_box_resets_the_vote() {
        use crate::engine::toy::{Toy, parts, picture, target};
        let mut committee = Ensemble::new((0..3).map(|_| parts(Toy::at(50.0))).collect(), 1, 0);
        let init = |it: &mut Ensemble| it.init(&picture(), target(50.0)).expect("a box in the picture");
        init(&mut committee);
        for given in [init as fn(&mut Ensemble), |it| it.reset_at(&target(50.0))] {
            committee.reset_at(&target(90.0));
            (0..20).for_each(|_| _ = committee.step_on(Scene { image: &picture(), detections: &[] }));
            assert!(committee.vote.is_searching());
            given(&mut committee);
            assert!(!committee.vote.is_searching());
        }
    }

    /// Members at three places: the first is sure, and the other two expect the target elsewhere. The box is the first one's, P(lost) and
    /// status are those of the vote.
    #[test]
    fn a_committee_reports_its_vote() {
        use crate::control::Status;
        use crate::engine::toy::{Toy, parts, picture, target};
        let mut committee = Ensemble::new([50.0, 20.0, 80.0].map(|x| parts(Toy::at(x))).into(), 1, 0);
        committee.init(&picture(), target(50.0)).expect("a box in the picture");
        for (member, x) in committee.members.iter_mut().zip([50.0, 20.0, 80.0]) {
            member.voter.reset_at(&target(x));
        }
        let image = picture();
        let seen = committee.step_on(Scene { image: &image, detections: &[] });
        let (bbox, p_lost, status, phase) = (seen.bbox, seen.p_lost, seen.status, seen.phase);
        let (own, confidence) = committee.members[0].voter.reported();
        assert_eq!((bbox, confidence.status), (own, Status::Tracking));
        assert!((p_lost - (1.0 - (1.0 - confidence.p_lost) / 3.0)).abs() < 1e-12, "{p_lost}");
        assert_eq!((status, phase), (Status::Occluded, Phase::of(Status::Occluded)));
    }

    /// A new template and the visible share reach voters and second trackers.
    #[test]
    fn templates_and_visibility_reach_all_trackers() {
        use crate::engine::toy::{Toy, parts, picture, target};
        use std::sync::atomic::Ordering;
        let toys: Vec<_> = (0..4).map(|_| Toy::at(50.0)).collect();
        let templates: Vec<_> = toys.iter().map(|toy| toy.templates.clone()).collect();
        let mut made = toys.into_iter().map(parts);
        let pairs = (0..2).map(|_| made.next().expect("four").with_second_tracker(made.next())).collect();
        let mut ensemble = Ensemble::new(pairs, 1, 0);
        ensemble.init(&picture(), target(50.0)).expect("a box in the picture");
        let before: Vec<_> = templates.iter().map(|it| it.load(Ordering::Relaxed)).collect();
        ensemble.update_template(&picture(), &target(50.0), (0.0, 0.0)).expect("a box in the picture");
        assert!(templates.iter().zip(before).all(|(it, before)| it.load(Ordering::Relaxed) == before + 1));
        ensemble.set_visibility(0.5);
        assert!(ensemble.trackers_mut().all(|tracker| tracker.save().part("visible") == SavedState::new(&0.5)));
    }
}
