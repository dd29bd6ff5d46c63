//! Several trackers with independent random streams follow one target and vote (`control/confidence/vote.rs`). With one member the result
//! is that of a single tracker.
//!
//! A member that has lost the target while the majority tracks it restarts at the elected box. It keeps its own template, so that it
//! judges that place by its own evidence.

use serde::{Deserialize, Serialize};

use crate::control::{Ballot, Vote};
use crate::engine::{Engine, Parts};
use crate::geometry::{BBox, Extent, State};
use crate::scene::{Flow, Image, Meter, Scene};
use crate::seen::{Phase, Seen};
use crate::threads;
use foveate_base::{Error, Result};

/// Upper bound on the number of rectangles that a member reads of a picture.
const WINDOWS: usize = 64;

/// One tracker or more.
pub(crate) struct Committee {
    /// At least one.
    members: Vec<Engine>,
    vote: Vote,
    ballots: Vec<Ballot>,
    meter: Meter,
}

#[derive(Serialize, Deserialize)]
struct Saved {
    members: Vec<serde_json::Value>,
    vote: serde_json::Value,
}

impl Committee {
    /// Creates a committee. Panics without members.
    pub(crate) fn new(members: Vec<Engine>) -> Self {
        let vote = Vote::new(members[0].parts().monitor.model());
        let meter = if members.len() > 1 { Meter::with_room(WINDOWS * members.len()) } else { Meter::default() };
        Self { members, vote, ballots: Vec::new(), meter }
    }

    /// Returns the first member.
    pub(crate) fn first(&self) -> &Engine {
        &self.members[0]
    }

    /// Returns the first member, for steps that read through a sensor, which a committee cannot share.
    pub(crate) fn first_mut(&mut self) -> &mut Engine {
        &mut self.members[0]
    }

    /// Starts all members on the target in this box.
    ///
    /// # Errors
    /// As [`Engine::init`], before anything has changed.
    pub(crate) fn init(&mut self, image: &Image, bbox: BBox) -> Result<()> {
        self.members.iter_mut().try_for_each(|member| member.init(image, bbox))?;
        self.vote.reset();
        Ok(())
    }

    /// Runs one frame: a step of every member, and the vote.
    pub(crate) fn step<'a>(&'a mut self, scene: Scene<'a>) -> Seen<'a> {
        if self.members.len() == 1 {
            return self.members[0].step_on(scene);
        }
        threads::each(&mut self.members, |_, member| {
            member.step_on(scene);
        });
        self.ballots.clear();
        self.ballots.extend(self.members.iter().map(|member| {
            let (bbox, confidence) = member.reported();
            Ballot { bbox, p_lost: confidence.p_lost, is_searching: member.is_searching() }
        }));
        let (elected, p_lost, status) = self.vote.count(&self.ballots);
        if !self.vote.is_searching() {
            self.reset_lost_members(elected);
        }
        self.meter.clear();
        self.members.iter().for_each(|member| self.meter.add_all(member.meter()));
        let values = self.meter.pixels() * scene.image.planes();
        let phase = Phase::of(status);
        Seen { values, p_lost, status, phase, ..self.members[elected].report(scene) }
    }

    /// Restarts lost members at the elected box.
    fn reset_lost_members(&mut self, elected: usize) {
        let here = self.ballots[elected].bbox;
        self.members
            .iter_mut()
            .zip(&self.ballots)
            .filter(|(_, ballot)| ballot.is_searching && !ballot.is_on(&here))
            .for_each(|(member, _)| member.start_again_at(&here));
    }

    pub(crate) fn compensate(&mut self, flow: &Flow) {
        self.members.iter_mut().for_each(|member| member.compensate(flow, &mut State::default()));
    }

    pub(crate) fn reset_at(&mut self, bbox: &BBox) {
        self.vote.reset();
        self.members.iter_mut().for_each(|member| member.reset_at(bbox));
    }

    pub(crate) fn set_visibility(&mut self, visible: f64) {
        self.members.iter_mut().for_each(|member| member.set_visibility(visible));
    }

    pub(crate) fn has_target(&self) -> bool {
        self.first().has_target()
    }

    pub(crate) fn extent(&self) -> Option<Extent> {
        self.first().extent()
    }

    pub(crate) fn parts(&self) -> &Parts {
        self.first().parts()
    }

    /// Returns the state of the only member, or of all members and the vote.
    pub(crate) fn save(&self) -> serde_json::Value {
        if let [only] = &self.members[..] {
            return only.save();
        }
        let saved = Saved { members: self.members.iter().map(Engine::save).collect(), vote: self.vote.save() };
        serde_json::to_value(saved).expect("plain data is JSON")
    }

    /// Restores a state that [`Committee::save`] returned.
    pub(crate) fn load(&mut self, saved: &serde_json::Value) -> Result<()> {
        if let [only] = &mut self.members[..] {
            return only.load(saved);
        }
        let bad = |what: String| Error::Invalid(format!("the saved tracker cannot be used: {what}"));
        let saved = Saved::deserialize(saved).map_err(|e| {
            bad(format!("it is not that of a committee ({e}); use the configuration it was saved with"))
        })?;
        if saved.members.len() != self.members.len() {
            return Err(bad(format!(
                "its committee has {} members, this one {}; use the configuration it was saved with",
                saved.members.len(),
                self.members.len()
            )));
        }
        self.members.iter_mut().zip(&saved.members).try_for_each(|(member, saved)| member.load(saved))?;
        if self.members.iter().any(|member| member.has_target() != self.has_target()) {
            return Err(bad("some members of its committee have a target, others none".into()));
        }
        self.vote.load(&saved.vote)
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
        ];
        let natural = Config::builtin("natural").expect("it ships").expect("it is right");
        let config = settings.iter().try_fold(natural, |config, setting| config.set(setting)).expect("keys");
        let blueprint = config.check(&Nowhere).expect("parts that fit");
        let mut committee = Committee::new(blueprint.members(2, 0).expect("parts that fit"));
        let target = |x: usize| BBox::new(x as f64, 30.0, 20.0, 20.0);
        committee.init(&picture(10), target(10)).expect("a box in the picture");
        committee.members[2].reset_at(&target(90));
        let mut fetched = None;
        committee.set_visibility(0.9);
        for i in 1..40 {
            let image = picture(10 + i / 2);
            let here = target(10 + i / 2);
            let told = committee.step(Scene { image: &image, detections: &[] });
            assert!(told.bbox.iou(&here) > 0.3, "frame {i}: {:?}", told.bbox);
            if committee.members[2].reported().0.iou(&here) > 0.3 {
                fetched = fetched.or(Some(i));
            }
        }
        assert!(fetched.is_some_and(|i| i > 1), "fetched in frame {fetched:?}");
        assert!(
            committee.members.iter().all(|member| member.save()["visible"] == 0.9),
            "as much can be seen of it as before"
        );
    }

    /// The parts of a tracker that hardly moves: at a distance of 40 pixels it does not find the target by itself.
    #[test]
    fn the_committee_resets_a_lost_member() {
        use crate::engine::toy::{Toy, parts, picture, started, target};
        let image = picture();
        let scene = Scene { image: &image, detections: &[] };
        let mut alone = started(parts(Toy::at(50.0)), 2);
        let mut committee = Committee::new((0..3).map(|k| started(parts(Toy::at(50.0)), k)).collect());
        alone.reset_at(&target(90.0));
        committee.members[2].reset_at(&target(90.0));
        for _ in 0..20 {
            alone.step_on(scene);
            assert!(committee.step(scene).bbox.iou(&target(50.0)) > 0.5);
        }
        assert!(alone.is_searching() && alone.reported().0.iou(&target(90.0)) > 0.5, "alone it is lost");
        assert!(committee.members[2].reported().0.iou(&target(50.0)) > 0.5, "fetched");
        assert!(!committee.members[2].is_searching());
    }
}
