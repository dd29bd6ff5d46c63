//! Paths of synthetic targets: cubic splines through random points, as the authors' clicked ones.

use rand::RngExt;

use crate::spline::Spline;
use foveate_base::rng::Rng;
use foveate_base::{Error, Result};

/// Where a target may go, and how fast.
pub(super) struct Path {
    /// Places of its upper-left corner go from 0 to this, pixels.
    pub room: [f64; 2],
    /// Number of places.
    pub frames: usize,
    /// Slowest and fastest mean speed, pixels a frame.
    pub speed: [f64; 2],
}

impl Path {
    /// Upper-left corners of the target: a cubic spline through uniform points, equally sampled in its parameter,
    /// with a length for the given speed. A point near a fault of the curve is drawn again. Faults are a position off
    /// the canvas, a step of 5 px or more (none of the authors' videos has one; 2.3 times the mean if that is more),
    /// and two points nearer than a tenth of the canvas.
    pub(super) fn draw(&self, rng: &mut Rng) -> Result<Vec<[f64; 2]>> {
        const TRIES: usize = 100_000;
        let (room, frames) = (self.room, self.frames);
        let near = 0.1 * room[0].hypot(room[1]);
        let mean = self.speed[0] + (self.speed[1] - self.speed[0]) * rng.random::<f64>();
        let top = (2.3 * mean).max(5.0);
        let length = mean * (frames - 1) as f64;

        let click = |rng: &mut Rng| room.map(|side| side * rng.random::<f64>());
        let mut points = vec![click(rng), click(rng)];
        for _ in 0..TRIES {
            while points.windows(2).map(|p| distance(p[0], p[1])).sum::<f64>() < length {
                points.push(click(rng));
                if points.len() > 2 * frames + 2 {
                    break;
                }
            }
            let curve = Spline::through(points.clone());
            let Some(end) = parameter_at(&curve, length) else { break };
            let step = end / (frames - 1).max(1) as f64;
            let path: Vec<_> = (0..frames).map(|t| curve.at(t as f64 * step)).collect();
            let crowded = (0..end.ceil() as usize).find(|&i| distance(points[i], points[i + 1]) < near);
            let outside = |p: &[f64; 2]| (0..2).any(|k| !(0.0..=room[k]).contains(&p[k]));
            let fast = |t: usize| t > 0 && distance(path[t - 1], path[t]) >= top;
            let fault = |t: &usize| outside(&path[*t]) || fast(*t);
            let at = crowded.or_else(|| (0..frames).find(fault).map(|t| (t as f64 * step) as usize));
            let Some(i) = at else { return Ok(path) };
            let again = (i + rng.random_range(0..2)).min(points.len() - 1);
            points[again] = click(rng);
        }
        let [w, h] = room;
        Err(Error::Config(format!(
            "synthetic video: no path of {length:.0} px fits where the target has {w} x {h} px to move in; \
             make the canvas larger, or speed or frames less"
        )))
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The parameter at which a curve is `length` long.
fn parameter_at(curve: &Spline, length: f64) -> Option<f64> {
    const PIECES: usize = 32; // a point: chords then miss less than 0.2 % of an arc's length
    let mut run = 0.0;
    let mut last = curve.at(0.0);
    for i in 1..=(curve.end() as usize * PIECES) {
        let (t, next) = (i as f64 / PIECES as f64, curve.at(i as f64 / PIECES as f64));
        let step = distance(last, next);
        if run + step >= length {
            return Some(t - (1.0 - (length - run) / step.max(f64::MIN_POSITIVE)) / PIECES as f64);
        }
        run += step;
        last = next;
    }
    (length <= run).then_some(curve.end())
}
