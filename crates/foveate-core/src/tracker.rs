//! Tracks one target, picture by picture.
//!
//! [`Tracker`] contains everything between a picture and a result: camera motion, detector, the particle filter with its gaze, and the
//! recogniser. No other code steps the engine of one target.

use crate::config::{Blueprint, Configure};
use crate::engine::Parts;
use crate::ensemble::Ensemble;
use crate::geometry::{BBox, Extent, State};
use crate::origin::Origin;
use crate::saved_state::{FORMAT, SavedState, refused};
use crate::scene::{Detection, Image, Preprocessor, Regions, Scene, Sensor, World};
use crate::seen::Seen;
use crate::times::Times;
use foveate_base::files::Nowhere;
use foveate_base::{Error, Result};
use serde_json::json;

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
    ensemble: Ensemble,
    preprocessor: Preprocessor,
    /// The sensor that reads parts of the pictures; `None` if whole pictures are read.
    sensor: Option<Sensor>,
    /// Width, height and planes of the pictures.
    shape: Option<[usize; 3]>,
    /// The result of the last picture; `None` before the first one and after [`Tracker::load`].
    last: Box<Option<Seen<'static>>>,
    times: Times,
}

impl std::fmt::Debug for Tracker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tracker").field("origin", &self.origin).field("shape", &self.shape).finish_non_exhaustive()
    }
}

impl Tracker {
    /// Creates a tracker from a profile, from the name of a configuration that ships ([`crate::config::BUILTIN`]), or from a
    /// configuration.
    ///
    /// # Errors
    /// [`Error::Config`] if no configuration has that name, a number is out of range, or parts do not fit. Model files are those that
    /// ship; for others see [`crate::config::Config::check`] and [`Blueprint::tracker`].
    pub fn new(what: impl Configure) -> Result<Self> {
        let config = what.config()?;
        let seed = config.seed;
        config.check(&Nowhere)?.tracker(seed)
    }

    /// Creates a tracker of these parts, with random streams that are named by `seed`. The preprocessor runs before each step.
    pub fn from_parts(parts: Parts, preprocessor: Preprocessor, seed: u64) -> Self {
        Self::of(Origin::by_hand(seed), vec![parts], preprocessor)
    }

    /// Creates a tracker of these parts, or of several that vote.
    fn of(origin: Origin, parts: Vec<Parts>, preprocessor: Preprocessor) -> Self {
        let ensemble = Ensemble::new(parts, origin.seed, origin.target);
        Self {
            origin,
            ensemble,
            preprocessor,
            sensor: None,
            shape: None,
            last: Box::default(),
            times: Times::default(),
        }
    }

    /// Sets the sensor that reads pictures.
    pub fn with_sensor(self, sensor: Option<Sensor>) -> Self {
        Self { sensor, ..self }
    }

    /// Starts, or restarts, on the target in this box of a picture: an [`Image`], or any source of [`Regions`] for a configuration with
    /// `[sensor]`. The picture in the box becomes the template. Everything learned before and the random streams are reset, so that the
    /// tracker continues as a new one would, bit for bit. Only the times, and the pictures that the detector and the camera motion have
    /// received, stay, as after [`Tracker::skip`]: for another video create another tracker.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the box is not finite, smaller than 2 × 2 pixels, or does not touch the picture; nothing changes then.
    /// [`Error::Invalid`] if the picture serves regions only and the configuration has no `[sensor]`. An error of a source that cannot be
    /// read.
    pub fn init(&mut self, picture: &dyn Regions, bbox: BBox) -> Result<()> {
        if let Some(sensor) = &mut self.sensor {
            sensor.begin(picture)?;
        }
        crate::start::check(visible(self.sensor.as_ref(), picture)?, &bbox)?;
        if let Some(sensor) = &mut self.sensor {
            sensor.init_template(picture, &State::of(&bbox), Extent::of(&bbox))?;
        }
        let image = visible(self.sensor.as_ref(), picture)?;
        self.preprocessor.look(image);
        self.shape = Some(picture.shape());
        self.ensemble.init(image, bbox)?;
        self.times.take_dropped();
        *self.last = Some(Seen::given(picture.shape(), &bbox));
        Ok(())
    }

    /// Tracks the target into the next picture of the video. With `[sensor]` the tracker reads the overview first, then the windows around
    /// the expected place and the fovea at the gaze.
    ///
    /// # Errors
    /// [`Error::Invalid`] before [`Tracker::init`], if the picture has another size or other planes than the first, or if it serves
    /// regions only and the configuration has no `[sensor]`. An error of a source that cannot be read: set the target again after it.
    pub fn update<'a>(&'a mut self, picture: &'a dyn Regions) -> Result<Seen<'a>> {
        self.check_shape(picture.shape())?;
        if self.sensor.is_none() {
            return self.step(visible(None, picture)?, None);
        }
        let sensor = self.sensor.as_mut().expect("checked above");
        sensor.begin(picture)?;
        look(&mut self.preprocessor, &mut self.ensemble, sensor.seen());
        let detections = self.preprocessor.detections();
        self.ensemble.set_dropped(self.times.take_dropped());
        let seen = self.ensemble.step(World::Sensor { sensor, source: picture, detections })?;
        *self.last = Some(seen.without_views());
        Ok(seen)
    }

    /// Tracks the target as [`Tracker::update`] does, with the detections of your own detector instead of those of the configuration's.
    ///
    /// # Errors
    /// As [`Tracker::update`]. [`Error::Invalid`] if the configuration has `[sensor]`, or uses no detections: it has neither
    /// `[detection_likelihood]` nor `proposal = { kind = "mixture" }`.
    pub fn update_with<'a>(&'a mut self, image: &'a Image, detections: &'a [Detection]) -> Result<Seen<'a>> {
        if self.sensor.is_some() {
            return Err(Error::Invalid(
                "a tracker with [sensor] reads no detections of others; leave [sensor] out".into(),
            ));
        }
        if !self.ensemble.first().uses_detections() {
            return Err(Error::Invalid(
                "update_with: this configuration uses no detections; add [detection_likelihood] to it (settings: \
                 detection_likelihood.place=0.2), or proposal.kind = \"mixture\" with dynamics.tail_probability = 0, or call update"
                    .into(),
            ));
        }
        self.check_shape(image.shape())?;
        self.step(image, Some(detections))
    }

    /// Runs one frame on a whole picture, with these detections or those of the configuration's detector.
    fn step<'a>(&'a mut self, image: &'a Image, detections: Option<&'a [Detection]>) -> Result<Seen<'a>> {
        look(&mut self.preprocessor, &mut self.ensemble, image);
        let detections = detections.unwrap_or(self.preprocessor.detections());
        self.ensemble.set_dropped(self.times.take_dropped());
        let seen = self.ensemble.step_on(Scene { image, detections });
        // Camera motion and detectors read whole pictures.
        let values = if self.preprocessor.looks_everywhere() { image.bytes().len() } else { seen.values };
        let seen = Seen { values, ..seen };
        *self.last = Some(seen.without_views());
        Ok(seen)
    }

    /// Predicts the box and its covariance `dt` frames after the last picture, 0 or more, from the dynamics: to aim a camera or an arm at
    /// the time when it moves. Between whole frames mean and covariance are interpolated. The tracker does not change; status and P(lost)
    /// are those of the last picture, and the box may lie outside it. Multiply seconds by the frame rate.
    ///
    /// # Errors
    /// [`Error::Invalid`] before the first picture or after [`Tracker::load`], if `dt` is not from 0 to 10⁶, or if dynamics of your own
    /// have no closed form.
    pub fn predict(&self, dt: f64) -> Result<Seen<'static>> {
        const MOST: f64 = 1e6;
        let invalid = |problem: &str| Error::Invalid(format!("predict: {problem}"));
        let last = (*self.last).ok_or_else(|| invalid("there is no result yet; call init or update first"))?;
        if !(0.0..=MOST).contains(&dt) {
            return Err(invalid(&format!("the time is {dt}; expected frames from 0 to {MOST}")));
        }
        let at = |frames: usize| {
            let leap = self.ensemble.first().moments(frames);
            let leap =
                leap.ok_or_else(|| invalid("these dynamics have no closed form; implement Dynamics::moments"))?;
            let (mut mean, mut covariance) = (last.state, last.covariance);
            leap.spread(&mut mean, &mut covariance);
            Ok((mean.to_array(), covariance))
        };
        let (whole, share) = (dt.floor(), dt.fract());
        let ((a, c), (b, d)) = (at(whole as usize)?, at(dt.ceil() as usize)?);
        let between = |a: f64, b: f64| a + share * (b - a);
        let state = State::from_array(std::array::from_fn(|i| between(a[i], b[i])));
        let covariance = std::array::from_fn(|i| std::array::from_fn(|j| between(c[i][j], d[i][j])));
        Ok(Seen { bbox: state.bbox(last.extent), state, covariance, ..last })
    }

    /// Predicts as [`Tracker::predict`] does, for a time in seconds, from that of the last picture on: that of the motor's action. One frame
    /// is the usual interval between pictures.
    ///
    /// # Errors
    /// As [`Tracker::predict`]; [`Error::Invalid`] if fewer than two pictures have a time.
    pub fn predict_at(&self, seconds: f64) -> Result<Seen<'static>> {
        let untimed =
            "predict_at: the times of the pictures are unknown; call set_time before each picture, or predict";
        let untimed = || Error::Invalid(untimed.into());
        let (last, interval) = self.times.last().zip(self.times.interval()).ok_or_else(untimed)?;
        self.predict((seconds - last) / interval)
    }

    /// Sets the time of the next picture in seconds, from any origin. If the interval since the last picture is several times the usual
    /// one, frames were dropped: the particles then move for as many frames more, at most 30. Intervals count in whole frames, from the
    /// ninth on. At a constant rate nothing changes, bit for bit; nor does anything with dynamics of your own that have no
    /// [`Dynamics::moments`](crate::extend::Dynamics::moments).
    pub fn set_time(&mut self, seconds: f64) {
        self.times.advance(seconds);
    }

    /// Shows a picture without tracking to the detector and the camera motion, which compare pictures: one before the target is given, or
    /// the last one before [`Tracker::load`]. With `[sensor]` the overview is read.
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

    /// Returns the parts that were read of the last picture, painted into a picture; `None` without `[sensor]`.
    pub fn sensed(&self) -> Option<&Image> {
        self.sensor.as_ref().map(Sensor::seen)
    }

    /// Checks that there is a target, and that the picture has the shape of the first one.
    fn check_shape(&self, found: [usize; 3]) -> Result<()> {
        let Some(first) = self.shape.filter(|_| self.ensemble.first().has_target()) else {
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

    /// Moves the target into this box: draws the particles around it, and sets P(lost) to 0 until the next picture. The template, the
    /// state of policy, discriminant, colour model and recogniser, and the random streams do not change.
    ///
    /// # Errors
    /// [`Error::Invalid`] before [`Tracker::init`], or if the box is not finite or has no area.
    pub fn reset_at(&mut self, bbox: BBox) -> Result<()> {
        if !self.ensemble.first().has_target() {
            return Err(Error::Invalid("the tracker has no target to put somewhere: call init first".into()));
        }
        bbox.check()?;
        self.ensemble.reset_at(&bbox);
        self.times.take_dropped();
        let state = self.ensemble.first().state_at(&bbox);
        if let Some((extent, shape)) = self.extent().zip(self.shape) {
            *self.last = Some(Seen { extent, state, ..Seen::given(shape, &bbox) });
        }
        Ok(())
    }

    /// Sets the visible fraction of the target in the next pictures, 0 to 1, if something occludes it; the default is 1. It scales the
    /// evidence of the looks; below one half they cannot change the status to lost.
    pub fn set_visibility(&mut self, visible: f64) {
        self.ensemble.set_visibility(visible);
    }

    /// Returns whether there is a target, set by [`Tracker::init`] or loaded.
    pub fn has_target(&self) -> bool {
        self.ensemble.first().has_target()
    }

    /// Returns half the size of the target's box at scale 1, pixels; `None` before [`Tracker::init`].
    pub fn extent(&self) -> Option<Extent> {
        self.ensemble.first().extent()
    }

    /// Returns the parts.
    pub fn parts(&self) -> &Parts {
        self.ensemble.first().parts()
    }

    /// Returns the whole state in mid-video; [`Tracker::load`] resumes from it bit for bit. It excludes the pictures that the detector and
    /// the camera motion compare: show the last picture again with [`Tracker::skip`].
    pub fn save(&self) -> SavedState {
        let (origin, shape, ensemble) = (&self.origin, self.shape, self.ensemble.save());
        SavedState::new(
            &json!({ "format": FORMAT, "origin": origin, "shape": shape, "times": self.times, "ensemble": ensemble }),
        )
    }

    /// Restores a state that [`Tracker::save`] returned, in a tracker of the same configuration and seed. After an error, set the target
    /// again.
    ///
    /// # Errors
    /// [`Error::Invalid`] if it is not a saved tracker, is of another version, or was saved with another configuration or seed: the error
    /// names the settings that differ. The contents of model files are not compared.
    pub fn load(&mut self, saved: &SavedState) -> Result<()> {
        saved.check_origin(&self.origin)?;
        *self.last = None;
        self.ensemble.load(&saved.part("ensemble"))?;
        self.shape = saved.part_read("shape")?;
        self.times = saved.part_read("times")?;
        match self.shape.is_some() == self.has_target() {
            true => Ok(()),
            false => Err(refused("tracker", "it has a target without the size of its pictures, or the size alone")),
        }
    }
}

/// Shows the next picture to the preprocessor, and moves the particles with the camera.
fn look(preprocessor: &mut Preprocessor, ensemble: &mut Ensemble, image: &Image) {
    preprocessor.look(image);
    if let Some(flow) = preprocessor.flow() {
        ensemble.compensate(flow);
    }
}

/// Returns the picture that the tracker uses: the parts that the sensor has read, or the whole.
fn visible<'a>(sensor: Option<&'a Sensor>, picture: &'a dyn Regions) -> Result<&'a Image> {
    let unsensed = || Error::Invalid("this configuration reads whole pictures; add [sensor] to read regions".into());
    sensor.map(Sensor::seen).or_else(|| picture.whole()).ok_or_else(unsensed)
}

impl Blueprint {
    /// Creates a tracker of one target.
    ///
    /// # Errors
    /// None for a checked configuration; [`Error::Config`] if a part cannot be created.
    pub fn tracker(&self, seed: u64) -> Result<Tracker> {
        self.tracker_of(seed, 0)
    }
    /// Creates a tracker with the random streams of target `target`: trackers of several targets share a seed, but no draw.
    ///
    /// # Errors
    /// As [`Blueprint::tracker`].
    pub fn tracker_of(&self, seed: u64, target: u64) -> Result<Tracker> {
        let sensor = self.config().sensor.clone().map(Sensor::new);
        let sensor = match self.layout() {
            Some(layout) => sensor.map(|it| it.with_gazes(layout.gazes())),
            None => sensor,
        };
        Ok(Tracker::of(self.origin(seed, target), self.members()?, self.preprocessor()).with_sensor(sensor))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::toy::{Toy, parts, picture, target};
    use crate::geometry::Covariance;

    /// All values count with a flow or a detector, which read the whole picture; without them only the pixels of the looks do.
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

    /// The target is where a given box is: frames that were dropped before it move nothing.
    #[test]
    fn a_given_box_ends_the_dropped_frames_before_it() {
        let mut tracker = Tracker::from_parts(parts(Toy::at(50.0)), Preprocessor::new(None, None), 1);
        tracker.init(&picture(), target(50.0)).expect("a box in the picture");
        (0..9).for_each(|t| tracker.set_time(f64::from(t)));
        for (time, is_new) in [(20.0, true), (30.0, false)] {
            tracker.set_time(time);
            assert!(tracker.times.clone().take_dropped() > 5);
            if is_new {
                tracker.init(&picture(), target(50.0)).expect("a box in the picture");
            } else {
                tracker.reset_at(target(40.0)).expect("a box");
            }
            assert_eq!(tracker.times.take_dropped(), 0);
        }
    }

    /// Constant velocity with damping d and noises q, p: after n frames x has moved by (d + ... + dⁿ) v, and its variance is
    /// Cxx + 2 s Cxv + s² Cvv + n p² + q² Σ (1 + d + ... + dᵏ)² over k < n, with s the sum above and p² that of a heavy-tailed normal.
    #[test]
    fn predictions_in_closed_form() {
        let mut tracker = Tracker::new("natural").expect("it ships");
        let none = tracker.predict(1.0).expect_err("no target").to_string();
        assert!(none.contains("call init"), "{none}");
        tracker.init(&picture(), target(50.0)).expect("a box in the picture");
        let image = picture();
        let seen = tracker.update(&image).expect("a picture of that size").without_views();
        let unit = tracker.extent().expect("a target").mean();
        let config = crate::config::Config::builtin("natural").expect("it ships").expect("valid");
        let dynamics: toml::Value = toml::from_str(&config.to_toml()).expect("TOML");
        let of = |name: &str| dynamics["dynamics"][name].as_float().expect("a number");
        let (d, q, p) = (of("damping"), unit * of("velocity"), unit * of("position"));
        let p2 = p * p * (1.0 + of("tail_probability") * (of("tail_scale").powi(2) - 1.0));
        let exact = |n: i32| {
            let s: f64 = (1..=n).map(|k| d.powi(k)).sum();
            let sums = (0..n).map(|k| (0..=k).map(|j| d.powi(j)).sum::<f64>().powi(2)).sum::<f64>();
            let c: Covariance = seen.covariance;
            let variance = c[0][0] + 2.0 * s * c[0][2] + s * s * c[2][2] + f64::from(n) * p2 + q * q * sums;
            (seen.state.x + s * seen.state.vx, variance)
        };
        for n in 0..6 {
            let (x, variance) = exact(n);
            let ahead = tracker.predict(f64::from(n)).expect("a prediction");
            assert!((ahead.state.x - x).abs() < 1e-9 && (ahead.covariance[0][0] / variance - 1.0).abs() < 1e-9, "{n}");
            assert!((ahead.bbox.centre().0 - x).abs() < 1e-9 && ahead.p_lost == seen.p_lost);
        }
        let half = tracker.predict(2.5).expect("a prediction").state.x;
        assert!((half - 0.5 * (exact(2).0 + exact(3).0)).abs() < 1e-9);
        assert!(tracker.predict(-1.0).is_err() && tracker.predict(f64::NAN).is_err());
        assert!(tracker.predict_at(1.0).expect_err("no times").to_string().contains("set_time"));
        (0..4).for_each(|t| tracker.set_time(7.0 + 0.04 * f64::from(t)));
        let (at, by) = (tracker.predict_at(7.22).expect("a prediction"), tracker.predict(2.5).expect("a prediction"));
        assert!(
            (at.state.x - by.state.x).abs() < 1e-9 && (at.covariance[0][0] / by.covariance[0][0] - 1.0).abs() < 1e-9
        );
        assert!(tracker.predict_at(7.0).is_err(), "before the last picture");
        tracker.reset_at(target(30.0)).expect("a box");
        assert_eq!(tracker.predict(0.0).expect("a prediction").bbox, target(30.0));
    }
}
