//! What observers of many targets see: one record a living target a frame, plain data.

use crate::Result;
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::scene::{Detection, Frame};

/// How a target fares in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Phase {
    /// Its box was given or detected in this frame; its template is what is there.
    Born,
    /// It had died, was kept in mind, and a newcomer of this frame looks like it: it lives on under its old id.
    Found,
    /// Followed, and believed to be where it is said to be.
    Followed,
    /// Behind another target, for the most part: followed by its motion rather than by its looks.
    Hidden,
    /// Believed lost: the box is a guess.
    Lost,
}

/// One living target in one frame.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Seen {
    /// Who it is: 1, 2, ... in order of birth, or as given; never used twice.
    pub id: u64,
    /// The frame it was first given or detected in, from 0.
    pub born: usize,
    /// How it fares.
    pub phase: Phase,
    /// Its upright box, pixels from 0.
    pub bbox: BBox,
    /// Mean of the belief.
    pub state: State,
    /// Half the size of its box at scale 1, pixels: `state.fixate(gaze, extent)` is where a gaze falls.
    pub extent: Extent,
    /// Covariance of the belief over x, y, vx, vy, log scale, angle.
    pub covariance: [[f64; 6]; 6],
    /// The chosen gaze of this frame, template units.
    pub gaze: Gaze,
    /// Share of it that no other target covers, 0 to 1.
    pub visible: f64,
    /// How much the evidence speaks against it being there: 0 none, 1 as much as elsewhere, up to 2.
    pub doubt: f64,
    /// What a detector found and was taken to be this target.
    #[serde(skip)]
    pub detection: Option<Detection>,
    /// The likeliest class and its probability; `None` without a recogniser.
    pub class: Option<(usize, f64)>,
}

impl Seen {
    /// Somebody of whom nothing is known but the id.
    pub(crate) fn unknown(id: u64) -> Self {
        Self {
            id,
            born: 0,
            phase: Phase::Born,
            bbox: BBox { x: 0.0, y: 0.0, w: 1.0, h: 1.0 },
            state: State::default(),
            extent: Extent { half_w: 0.5, half_h: 0.5 },
            covariance: [[0.0; 6]; 6],
            gaze: Gaze::CENTRE,
            visible: 1.0,
            doubt: 0.0,
            detection: None,
            class: None,
        }
    }
    /// Whether the box is a result, rather than a guess.
    pub fn sure(&self) -> bool {
        self.phase != Phase::Lost
    }
}

/// Watches a run of many targets from outside.
///
/// `observe` comes once a frame, in order, also where no target lives; targets come by id. One that is missing has died
/// (and may come back under its id, see [`Phase::Found`]). `finish` comes once, at the end, also where the source broke
/// half-way. Dropped without `finish`, an observer leaves no file.
pub trait ManyObserver {
    /// A frame, and the targets that live in it.
    fn observe(&mut self, frame: &Frame, targets: &[Seen]) -> Result<()>;
    /// The end: files get their names.
    fn finish(&mut self) -> Result<()>;
}

/// Each of them in turn. Where one fails, `finish` still comes to all; the first error is answered.
impl ManyObserver for Vec<Box<dyn ManyObserver>> {
    fn observe(&mut self, frame: &Frame, targets: &[Seen]) -> Result<()> {
        self.iter_mut().try_for_each(|o| o.observe(frame, targets))
    }
    fn finish(&mut self) -> Result<()> {
        self.iter_mut().map(|o| o.finish()).fold(Ok(()), Result::and)
    }
}
