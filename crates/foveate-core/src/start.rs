//! p(x₀): the distribution of the first particles around the given box.

use rand::RngExt;
use rand_distr::StandardNormal;

use crate::geometry::{BBox, Extent, State};
use crate::scene::Image;
use foveate_base::rng::Streams;
use foveate_base::{Error, Result};

foveate_base::settings! {
    /// Spread of the first particles. Lengths are in template units: 1 is half the box.
    #[derive(Copy)]
    pub struct StartSpread in "start" {
        /// Standard deviation of the position, half sides of the box.
        pub position: f64 = 0.05; 0.0 to 100.0,
        /// Standard deviation of the velocity, template units a frame.
        pub velocity: f64 = 0.1; 0.0 to 100.0,
        /// Standard deviation of the log scale.
        pub log_scale: f64 = 0.0; 0.0 to 5.0,
        /// Standard deviation of the angle, radians.
        pub angle: f64 = 0.0; 0.0 to 100.0,
        /// Standard deviation of the log aspect.
        pub aspect: f64 = 0.0; 0.0 to 5.0,
    }
}

impl StartSpread {
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
