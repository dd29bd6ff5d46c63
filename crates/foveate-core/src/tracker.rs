//! The front door: one target, picture by picture.
//!
//! [`Tracker`] owns everything between a picture and a result: camera motion, detector, the particle filter with its gaze,
//! and the recogniser. Nothing else in the project steps the engine of one target.

use crate::committee::Committee;
use crate::config::{Blueprint, Configure};
use crate::engine::{Engine, Parts};
use crate::geometry::{BBox, Extent, State};
use crate::origin::Origin;
use crate::scene::{Detection, Image, Preprocessor, Regions, Scene, Sensor, World};
use crate::seen::Seen;
use foveate_base::files::Nowhere;
use foveate_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// Follows one target.
///
/// ```
/// use foveate_core::{BBox, Image, Profile, Tracker};
///
/// let pixels: Vec<u8> = (0..160 * 120 * 3).map(|i| (i * 7 % 251) as u8).collect();
/// let image = Image::from_rgb8(160, 120, &pixels)?;
/// let mut tracker = Tracker::new(Profile::Balanced)?;
/// tracker.init(&image, BBox::new(60.0, 40.0, 30.0, 40.0))?; // left, top, width, height; pixels counted from 0
/// let seen = tracker.update(&image)?;
/// println!("{:?}, {}, lost with probability {:.2}", seen.bbox, seen.status.name(), seen.p_lost);
/// # Ok::<(), foveate_core::Error>(())
/// ```
pub struct Tracker {
    origin: Origin,
    committee: Committee,
    preprocessor: Preprocessor,
    /// What reads pictures, where not all of them is read.
    sensor: Option<Sensor>,
    /// Width, height and planes of the pictures.
    shape: Option<[usize; 3]>,
}

impl std::fmt::Debug for Tracker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tracker").field("origin", &self.origin).field("shape", &self.shape).finish_non_exhaustive()
    }
}

/// The format number of saved trackers.
const FORMAT: u32 = 16;

#[derive(Serialize, Deserialize)]
struct Saved {
    format: u32,
    origin: Origin,
    shape: Option<[usize; 3]>,
    engine: serde_json::Value,
}

impl Tracker {
    /// A tracker by profile, by the name of a configuration that ships ([`crate::config::BUILTIN`]), or by a configuration.
    ///
    /// # Errors
    /// [`Error::Config`] where there is none of that name, a number is out of range or parts do not fit. Model files are
    /// those that ship; for others see [`crate::config::Config::check`] and [`Blueprint::tracker`].
    pub fn new(what: impl Configure) -> Result<Self> {
        let config = what.config()?;
        let seed = config.seed;
        config.check(&Nowhere)?.tracker(seed)
    }

    /// A tracker of these parts, with its own streams of randomness named by `seed`; what is looked at before each step is
    /// the preprocessor's business.
    pub fn from_parts(parts: Parts, preprocessor: Preprocessor, seed: u64) -> Self {
        Self::of(Origin::by_hand(seed), vec![Engine::new(parts, seed, 0)], preprocessor)
    }

    /// Of one engine, or several that vote.
    fn of(origin: Origin, engines: Vec<Engine>, preprocessor: Preprocessor) -> Self {
        Self { origin, committee: Committee::new(engines), preprocessor, sensor: None, shape: None }
    }

    /// The same, reading pictures through a sensor.
    pub fn sensing(self, sensor: Option<Sensor>) -> Self {
        Self { sensor, ..self }
    }

    /// Starts, or starts again, on the target in this box of a picture: an [`Image`], or any source of [`Regions`] for a configuration with
    /// `[sensor]`. The template is what is there. Everything learned before is forgotten and the
    /// random streams start again, so that the tracker goes on as a new one would, bit for bit. Only what a detector and the camera motion
    /// saw of earlier pictures stays, as after [`Tracker::skip`]: for another video make another tracker.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the box is not finite, smaller than 2 × 2 pixels, or does not touch the picture; then nothing has changed.
    /// [`Error::Invalid`] if the picture serves regions only and the configuration has no `[sensor]`. An error of a source that cannot be
    /// read.
    pub fn init(&mut self, picture: &dyn Regions, bbox: BBox) -> Result<()> {
        if let Some(sensor) = &mut self.sensor {
            sensor.begin(picture)?;
        }
        crate::start::check(visible(self.sensor.as_ref(), picture)?, &bbox)?;
        if let Some(sensor) = &mut self.sensor {
            sensor.imprint(picture, &State::of(&bbox), Extent::of(&bbox))?;
        }
        let image = visible(self.sensor.as_ref(), picture)?;
        self.preprocessor.look(image);
        self.shape = Some(picture.shape());
        self.committee.init(image, bbox)
    }

    /// Tracks the target into the next picture of the video. With `[sensor]` the overview is read first, then the windows around the
    /// expected place and the fovea at the gaze.
    ///
    /// # Errors
    /// [`Error::Invalid`] before [`Tracker::init`], if the picture has another size or other planes than the first, or if it serves regions
    /// only and the configuration has no `[sensor]`. If a source cannot be read: then give the target anew.
    pub fn update<'a>(&'a mut self, picture: &'a dyn Regions) -> Result<Seen<'a>> {
        self.check_shape(picture.shape())?;
        if self.sensor.is_none() {
            return self.step(visible(None, picture)?, None);
        }
        let sensor = self.sensor.as_mut().expect("checked above");
        sensor.begin(picture)?;
        look(&mut self.preprocessor, &mut self.committee, sensor.seen());
        let detections = self.preprocessor.detections();
        self.committee.first_mut().step(World::Sensor { sensor, source: picture, detections })
    }

    /// The same with the detections of your own detector, which replace those of the configuration's.
    ///
    /// # Errors
    /// As [`Tracker::update`]; where the configuration uses no detections: it has neither `[detection_likelihood]` nor
    /// `proposal = { kind = "mixture" }`.
    pub fn update_with<'a>(&'a mut self, image: &'a Image, detections: &'a [Detection]) -> Result<Seen<'a>> {
        if self.sensor.is_some() {
            return Err(Error::Invalid(
                "a tracker with [sensor] reads no detections of others; leave [sensor] out".into(),
            ));
        }
        if !self.committee.first().uses_detections() {
            return Err(Error::Invalid(
                "update_with: this configuration uses no detections; add [detection_likelihood] to it (settings: \
                 detection_likelihood.place=0.2), or proposal.kind = \"mixture\" with dynamics.tail_probability = 0, or call update"
                    .into(),
            ));
        }
        self.check_shape(image.shape())?;
        self.step(image, Some(detections))
    }

    /// One frame of a whole picture, with these detections or those of the configuration's detector.
    fn step<'a>(&'a mut self, image: &'a Image, detections: Option<&'a [Detection]>) -> Result<Seen<'a>> {
        look(&mut self.preprocessor, &mut self.committee, image);
        let detections = detections.unwrap_or(self.preprocessor.detections());
        let seen = self.committee.step(Scene { image, detections });
        // Camera motion and detectors read whole pictures.
        let values = if self.preprocessor.looks_everywhere() { image.bytes().len() } else { seen.values };
        Ok(Seen { values, ..seen })
    }

    /// Shows a picture that is not tracked in to the detector and the camera motion, which compare pictures: one before the target is
    /// given, or the last one before [`Tracker::load`]. With `[sensor]` the overview is read.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the picture serves regions only and the configuration has no `[sensor]`. An error of a source that cannot be
    /// read.
    pub fn skip(&mut self, picture: &dyn Regions) -> Result<()> {
        if let Some(sensor) = &mut self.sensor {
            sensor.begin(picture)?;
        }
        self.preprocessor.look(visible(self.sensor.as_ref(), picture)?);
        Ok(())
    }

    /// What was read of the last picture, painted into a picture of its own; `None` without `[sensor]`.
    pub fn sensed(&self) -> Option<&Image> {
        self.sensor.as_ref().map(Sensor::seen)
    }

    /// Whether there is a target, and the picture is like the first one.
    fn check_shape(&self, found: [usize; 3]) -> Result<()> {
        let Some(first) = self.shape.filter(|_| self.committee.has_target()) else {
            return Err(Error::Invalid("the tracker has no target: call init with a picture and a box first".into()));
        };
        if first != found {
            let ([width, height, planes], [w, h, p]) = (first, found);
            return Err(Error::Invalid(format!(
                "the picture is {w} x {h} with {p} planes, the first one was {width} x {height} with {planes}; give pictures of one \
                 size, or call init again"
            )));
        }
        Ok(())
    }

    /// Puts the target into this box: particles start about it, and P(lost) is 0 until the next picture. Everything else stays: the
    /// template, what policy, discriminant, colour model and recogniser learned, and the random streams, which go on.
    ///
    /// # Errors
    /// [`Error::Invalid`] before [`Tracker::init`], or where the box is not finite or has no area.
    pub fn reset_at(&mut self, bbox: BBox) -> Result<()> {
        if !self.committee.has_target() {
            return Err(Error::Invalid("the tracker has no target to put somewhere: call init first".into()));
        }
        bbox.check()?;
        self.committee.reset_at(&bbox);
        Ok(())
    }

    /// Says which share of the target the next pictures can show, 0 to 1, because something covers it. Its looks count for as
    /// much less, and below one half they cannot make it lost. 1 until told otherwise.
    pub fn set_visibility(&mut self, visible: f64) {
        self.committee.set_visibility(visible);
    }

    /// Whether there is a target: it was given, or loaded.
    pub fn has_target(&self) -> bool {
        self.committee.has_target()
    }

    /// Half the size of the target's box at scale 1, pixels; `None` before [`Tracker::init`].
    pub fn extent(&self) -> Option<Extent> {
        self.committee.extent()
    }

    /// The parts, to look at.
    pub fn parts(&self) -> &Parts {
        self.committee.parts()
    }

    /// The whole state in mid-video, to go on from bit for bit with [`Tracker::load`]. What detector and camera motion saw is
    /// not in it: show the last picture again with [`Tracker::skip`].
    pub fn save(&self) -> serde_json::Value {
        let saved =
            Saved { format: FORMAT, origin: self.origin.clone(), shape: self.shape, engine: self.committee.save() };
        serde_json::to_value(saved).expect("plain data is JSON")
    }

    /// Takes up what [`Tracker::save`] gave, in a tracker of the same configuration and seed. After an error the tracker has to
    /// be given its target anew.
    ///
    /// # Errors
    /// [`Error::Invalid`] where it is not a saved tracker, is of another version, or was saved with another configuration or seed: the
    /// error names the settings that differ. The contents of model files are not compared.
    pub fn load(&mut self, saved: &serde_json::Value) -> Result<()> {
        let bad = |what: String| Error::Invalid(format!("the saved tracker cannot be used: {what}"));
        // First of all: a state of another format has other fields.
        if let Some(format) = saved["format"].as_u64().filter(|format| *format != u64::from(FORMAT)) {
            return Err(bad(format!("its format is {format}, this version writes and reads {FORMAT}")));
        }
        let saved = Saved::deserialize(saved).map_err(|e| bad(e.to_string()))?;
        self.origin.check(&saved.origin).map_err(bad)?;
        self.committee.load(&saved.engine)?;
        if saved.shape.is_some() != self.committee.has_target() {
            return Err(bad("it has a target without the size of its pictures, or the size without a target".into()));
        }
        self.shape = saved.shape;
        Ok(())
    }
}

/// Shows the next picture to what compares pictures, and moves the particles with the camera.
fn look(preprocessor: &mut Preprocessor, committee: &mut Committee, image: &Image) {
    preprocessor.look(image);
    if let Some(flow) = preprocessor.flow() {
        committee.compensate(flow);
    }
}

/// The picture as the tracker sees it: what the sensor has read, or the whole.
fn visible<'a>(sensor: Option<&'a Sensor>, picture: &'a dyn Regions) -> Result<&'a Image> {
    let unsensed = || Error::Invalid("this configuration reads whole pictures; add [sensor] to read regions".into());
    sensor.map(Sensor::seen).or_else(|| picture.whole()).ok_or_else(unsensed)
}

impl Blueprint {
    /// A tracker for one target.
    ///
    /// # Errors
    /// None for a checked configuration; [`Error::Config`] where a part cannot be made after all.
    pub fn tracker(&self, seed: u64) -> Result<Tracker> {
        self.tracker_of(seed, 0)
    }
    /// The same with the randomness of target `target`: trackers of several targets share a seed, and no draw.
    ///
    /// # Errors
    /// As [`Blueprint::tracker`].
    pub fn tracker_of(&self, seed: u64, target: u64) -> Result<Tracker> {
        let sensor = self.config().sensor.clone().map(Sensor::new);
        Ok(Tracker::of(self.origin(seed, target), self.members(seed, target)?, self.preprocessor()).sensing(sensor))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::toy::{Toy, parts, picture, target};

    /// A flow or a detector reads all of the picture; without either only what was looked at counts.
    #[test]
    fn all_values_count_if_the_preprocessor_reads_the_whole_picture() {
        for (flow, all) in [(None, false), (Some(0), true)] {
            let mut tracker = Tracker::from_parts(parts(Toy::at(50.0)), Preprocessor::new(None, flow), 1);
            tracker.init(&picture(), target(50.0)).expect("a box in the picture");
            let image = picture();
            let values = tracker.update(&image).expect("a picture of that size").values;
            assert_eq!(values == 100 * 100, all, "{values} values with flow {flow:?}");
        }
    }
}
