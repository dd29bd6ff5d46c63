//! The page's data of a frame.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use foveate_core::Seen;
use foveate_core::gaze::PolicySnapshot;
use foveate_core::geometry::{Extent, Gaze, State};
use foveate_core::identity::Retina;
use foveate_report::draw::CORNERS;
use foveate_report::heat::Heat;
use foveate_video::Frame;

/// Points along a side of a reward surface.
const SURFACE: usize = 17;

/// The numbers of a frame. Pixels count from 0, frames from 1.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Its number, from 1.
    pub frame: usize,
    /// Seconds from the first frame.
    pub time: f64,
    /// Left, top, width, height.
    #[serde(rename = "box")]
    pub bbox: [f64; 4],
    /// The corners of the rotated box.
    pub corners: [[f64; 2]; 4],
    /// Whether the box was given by hand.
    pub given: bool,
    /// The probability that the target is lost, 0 to 1.
    pub p_lost: f64,
    /// The status; `given` for a given box.
    pub status: &'static str,
    /// Whether the box is a result: false if the status is occluded or lost.
    pub usable: bool,
    /// The chosen gaze in template units.
    pub gaze: Option<[f64; 2]>,
    /// The position of the gaze: x, y, and one template unit along u and along v.
    pub fixation: Option<[f64; 6]>,
    /// The 90 % region of the centre: x, y, half axes, angle.
    pub region: Option<[f64; 5]>,
    /// Distance of the glimpse from the template.
    pub distance: Option<f64>,
    /// Effective sample size, 1 to the number of particles.
    pub ess: Option<f64>,
}

impl Row {
    /// Creates the row of a frame and its target.
    pub fn of(frame: &Frame, seen: &Seen<'_>) -> Self {
        let (b, gaze, region, given) = (seen.bbox, seen.gaze, seen.region(0.9), seen.is_given());
        let f = seen.state.fixate(gaze, seen.extent);
        Self {
            frame: frame.index + 1,
            time: frame.time,
            bbox: [b.x, b.y, b.w, b.h],
            corners: corners(&seen.state, seen.extent),
            given,
            p_lost: seen.p_lost,
            status: if given { "given" } else { seen.status.name() },
            usable: seen.is_usable(),
            gaze: (!given).then_some([gaze.u, gaze.v]),
            fixation: (!given).then_some([f.x, f.y, f.ux, f.uy, f.vx, f.vy]),
            region: (!given).then_some([region.x, region.y, region.half[0], region.half[1], region.turn]),
            distance: (!given).then_some(seen.percept.distance),
            ess: (!given).then_some(seen.ess),
        }
    }
}

fn corners(state: &State, extent: Extent) -> [[f64; 2]; 4] {
    CORNERS.map(|(u, v)| {
        let f = state.fixate(Gaze { u, v, arm: None }, extent);
        [f.x, f.y]
    })
}

/// The tracker's internal state in a frame, as JSON text: particles, glimpse, policy.
#[derive(Serialize)]
struct Detail {
    frame: usize,
    /// Particles: x and y as 16 bits each (low byte first) over −1 to 2 pictures, base64.
    particles: String,
    /// The same number of bytes: weights relative to the heaviest.
    weights: String,
    /// The glimpse, one byte per cell.
    glimpse: String,
    /// Further gazes used.
    also: Vec<[f64; 2]>,
    /// Gazes of a policy with several, and their probabilities.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    arms: Vec<[f64; 3]>,
}

/// Returns the tracker's internal state in a frame (from 1), as JSON text: particles, glimpse, gazes, probabilities of gazes.
pub fn detail(frame: usize, seen: &Seen<'_>) -> String {
    let (particles, weights) = foveate_report::particles(seen);
    let chosen = seen.plan.chosen_index();
    let also = seen.plan.used().filter(|(k, _)| *k != chosen).map(|(_, gaze)| [gaze.u, gaze.v]).collect();
    let arms = match seen.snapshot {
        PolicySnapshot::Arms { gazes, probabilities } if gazes.len() > 1 => {
            gazes.iter().zip(probabilities).map(|(gaze, p)| [gaze.u, gaze.v, *p]).collect()
        }
        _ => vec![],
    };
    let text = |bytes: &[u8]| STANDARD.encode(bytes);
    let detail = Detail {
        frame,
        particles: text(&particles),
        weights: text(&weights),
        glimpse: text(&foveate_report::levels(&seen.percept.glimpse)),
        also,
        arms,
    };
    serde_json::to_string(&detail).unwrap_or_default()
}

/// A reward surface: mean reward on points from −reach to reach, row by row from the top.
#[derive(Debug, Serialize)]
pub struct Surface {
    side: usize,
    reach: f64,
    mean: Vec<f64>,
    best: Option<[f64; 2]>,
}

/// Returns the current reward surface of a policy over a continuous space.
pub fn surface(snapshot: PolicySnapshot<'_>) -> Option<Surface> {
    let PolicySnapshot::Surface(surface) = snapshot else { return None };
    let heat = Heat::of(surface, SURFACE);
    Some(Surface { side: heat.n, reach: heat.reach, mean: heat.mean, best: surface.best().map(|g| [g.u, g.v]) })
}

/// Returns a retina's cells: centre, half side and channel of each, one after the other.
pub fn cells(retina: &dyn Retina) -> Vec<f64> {
    retina.cells().iter().flat_map(|c| [c.u, c.v, c.half, c.channel as f64]).collect()
}
