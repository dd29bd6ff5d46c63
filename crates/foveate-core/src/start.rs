//! p(x₀): the distribution of the first particles around the given box.

use rand::RngExt;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use crate::geometry::{BBox, Extent, State};
use crate::scene::Image;
use foveate_base::error::within;
use foveate_base::rng::Streams;
use foveate_base::{Error, Result};

/// Spread of the first particles. Lengths are in template units: 1 is half the box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StartSpread {
    /// Standard deviation of the position.
    pub position: f64,
    /// Standard deviation of the velocity, template units a frame.
    pub velocity: f64,
    /// Standard deviation of the log scale.
    pub log_scale: f64,
    /// Standard deviation of the angle, radians.
    pub angle: f64,
    /// Standard deviation of the log aspect.
    pub aspect: f64,
}

impl Default for StartSpread {
    fn default() -> Self {
        Self { position: 0.05, velocity: 0.1, log_scale: 0.0, angle: 0.0, aspect: 0.0 }
    }
}

impl StartSpread {
    /// Checks all standard deviations.
    ///
    /// # Errors
    /// If one is negative or too large; the error names the field.
    pub fn check(&self) -> Result<()> {
        for (name, sd, most) in [
            ("position", self.position, 100.0),
            ("velocity", self.velocity, 100.0),
            ("log_scale", self.log_scale, 5.0),
            ("angle", self.angle, 100.0),
            ("aspect", self.aspect, 5.0),
        ] {
            within(&format!("start.{name}"), sd, 0.0, most)?;
        }
        Ok(())
    }
    /// Draws particles around a state.
    pub fn draw(&self, state: &State, extent: Extent, particles: &mut [State], streams: Streams) {
        for (i, particle) in particles.iter_mut().enumerate() {
            let mut rng = streams.rng(i as u64);
            let mut normal = |sd: f64| sd * rng.sample::<f64, _>(StandardNormal);
            *particle = State {
                x: state.x + normal(self.position * extent.half_w),
                y: state.y + normal(self.position * extent.half_h),
                vx: state.vx + normal(self.velocity * extent.mean()),
                vy: state.vy + normal(self.velocity * extent.mean()),
                log_scale: state.log_scale + normal(self.log_scale),
                angle: state.angle + normal(self.angle),
                log_aspect: state.log_aspect + normal(self.aspect),
            };
        }
    }
}

/// Checks the box of a target.
///
/// # Errors
/// [`Error::Invalid`] if it is not finite, smaller than 2 × 2 pixels, larger than four times the picture, or does not touch the picture.
pub fn check(image: &Image, b: &BBox) -> Result<()> {
    let (w, h) = (image.width() as f64, image.height() as f64);
    let finite = [b.x, b.y, b.w, b.h].iter().all(|v| v.is_finite());
    let inside = b.x < w && b.y < h && b.x + b.w > 0.0 && b.y + b.h > 0.0;
    if finite && b.w >= 2.0 && b.h >= 2.0 && b.w <= 4.0 * w && b.h <= 4.0 * h && inside {
        return Ok(());
    }
    Err(Error::Invalid(format!(
        "the first box is x={}, y={}, w={}, h={}; expected finite numbers, at least 2 x 2 pixels and at most {} x {}, touching the \
         {w} x {h} picture. Give left, top, width, height in pixels from 0",
        b.x,
        b.y,
        b.w,
        b.h,
        4.0 * w,
        4.0 * h
    )))
}
