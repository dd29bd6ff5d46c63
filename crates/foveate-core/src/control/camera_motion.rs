//! p(xₜ | xₜ₋₁, flow): states move with the picture before the dynamics move them.
//!
//! With c the camera's affine flow and f the flow at the state's own place (`scene/flow.rs`), a parent is moved by
//! ```text
//! m = camera · c(place) + local · (f(place) − camera · c(place))
//! ```
//! pixels, and its velocity, kept as it is, means what moves beyond that: with `camera`, relative to the ground; with
//! `local` = 1, whatever the flow missed. A `share` of the parents is moved, the others stay: the camera's motion may be
//! mistaken, if one object fills most of the picture, and the likelihood can decide.
//!
//! Deviation: the paper puts flow into the proposal q. Here it belongs to p, which then includes camera motion: p/q
//! stays 1, and a jump of the picture is not a jump of the target.

use super::evenly;
use crate::geometry::State;
use crate::scene::Flow;

foveate_base::settings! {
    /// How far states move with the picture.
    #[derive(Copy)]
    pub struct CameraMotion in "camera_motion" {
        /// Share of the camera's motion that particles follow, 0 to 1.
        pub camera: f64 = 1.0; 0.0 to 1.0,
        /// Share of the local flow beyond the camera's motion that particles follow, 0 to 1.
        pub local: f64 = 0.0; 0.0 to 1.0,
        /// Share of the particles that follow it; the others assume a fixed camera, 0 to 1.
        pub share: f64 = 1.0; 0.0 to 1.0,
    }
}

impl CameraMotion {
    /// The level of the picture's pyramid at which the flow may end: for the camera alone an eighth of the sides does, in
    /// a fraction of the time.
    pub fn finest(&self) -> usize {
        if self.local > 0.0 { 2 } else { 3 }
    }

    /// Moves states of the frame before by the flow from it to the one at hand.
    pub fn shift(&self, flow: &Flow, states: &mut [State]) {
        let (camera, (u, v)) = (flow.camera(), flow.field());
        if u.values().is_empty() {
            return;
        }
        for i in evenly(states.len(), self.share) {
            let state = &mut states[i];
            let (cu, cv) = camera.at(state.x, state.y);
            let (mut dx, mut dy) = (self.camera * cu, self.camera * cv);
            if self.local > 0.0 {
                let (x, y) = (state.x as f32, state.y as f32);
                dx += self.local * (f64::from(u.at_pixel(x, y)) - dx);
                dy += self.local * (f64::from(v.at_pixel(x, y)) - dy);
            }
            (state.x, state.y) = (state.x + dx, state.y + dy);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Image;
    use foveate_base::rng::{Purpose, Streams};
    use rand::RngExt;

    const SIDE: usize = 160;

    /// Smooth noise that moves by (3, −2) pixels a frame, and in its middle a square that moves by (−1, 1).
    fn picture(t: f64) -> Image {
        let mut rng = Streams::new(5, 0).at(0, Purpose::Scene).rng(0);
        let mut waves = || -> Vec<[f64; 3]> {
            (0..30)
                .map(|_| [rng.random_range(-0.4..0.4), rng.random_range(-0.4..0.4), rng.random_range(0.0..6.3)])
                .collect()
        };
        let (ground, thing) = (waves(), waves());
        let texture = |waves: &[[f64; 3]], x: f64, y: f64| {
            128.0 + 15.0 * waves.iter().map(|w| (w[0] * x + w[1] * y + w[2]).sin()).sum::<f64>()
        };
        let pixel = |k: usize| {
            let (x, y) = ((k % SIDE) as f64, (k / SIDE) as f64);
            let (i, j) = (x - 60.0 + t, y - 60.0 - t);
            let on = (0.0..40.0).contains(&i) && (0.0..40.0).contains(&j);
            let grey = if on { texture(&thing, i, j) } else { texture(&ground, x - 3.0 * t, y + 2.0 * t) };
            grey.round().clamp(0.0, 255.0) as u8
        };
        Image::new(SIDE, SIDE, 1, (0..SIDE * SIDE).map(pixel).collect()).expect("as many bytes")
    }

    #[test]
    fn states_move_with_the_camera_or_with_the_thing() {
        let mut flow = Flow::down_to(0);
        let shifted = |camera_motion: CameraMotion, flow: &Flow| {
            let mut states = [State { x: 80.0, y: 80.0, vx: 0.5, ..State::default() }];
            camera_motion.shift(flow, &mut states);
            let [s] = states;
            (s.x - 80.0, s.y - 80.0, s.vx)
        };
        let all = CameraMotion { camera: 1.0, local: 1.0, share: 1.0 };
        assert_eq!(shifted(all, &flow), (0.0, 0.0, 0.5), "no picture yet");
        flow.look(&picture(0.0));
        assert_eq!(shifted(all, &flow), (0.0, 0.0, 0.5), "no flow yet");
        flow.look(&picture(1.0));
        for (camera, local, exact) in [
            (1.0, 0.0, (3.0, -2.0)),
            (0.5, 0.0, (1.5, -1.0)),
            (1.0, 1.0, (-1.0, 1.0)),
            (0.0, 0.5, (-0.5, 0.5)),
            (0.0, 0.0, (0.0, 0.0)),
        ] {
            let (dx, dy, vx) = shifted(CameraMotion { camera, local, share: 1.0 }, &flow);
            let off = (dx - exact.0).hypot(dy - exact.1);
            assert!(off < 0.2 && vx == 0.5, "camera {camera}, local {local}: moved by {dx}, {dy}, not {exact:?}");
        }
    }
}
