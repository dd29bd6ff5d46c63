//! The plain data of one active target, from frame to frame.

use crate::control::Consistency;
use crate::geometry::{BBox, Extent, Gaze, State};
use crate::scene::Detection;
use crate::seen::{Phase, Seen};

/// One active target.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Track {
    /// Who it is: 1, 2, ... in order of initiation, or as given; never used twice.
    pub id: u64,
    /// The frame it was first given or detected in, from 0.
    pub born: usize,
    pub phase: Phase,
    #[serde(default)]
    pub p_lost: f64,
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
    pub deficit: f64,
    /// Frames since it was looked at last: 0 where it was in this one.
    pub waited: usize,
    /// The detection of this frame that was assigned to this target, or that it starts from.
    #[serde(skip)]
    pub detection: Option<Detection>,
    /// Its place in the detections that [`crate::multi::MultiTracker::update`] was given, from 0; `None` where the configuration's own
    /// detector found it.
    #[serde(skip)]
    pub detection_index: Option<usize>,
    /// The class of its last detection that had one.
    pub detected_class: Option<usize>,
    /// The likeliest class and its probability; `None` without a recogniser.
    pub class: Option<(usize, f64)>,
}

impl Track {
    /// A target of which only the id is known.
    pub fn unknown(id: u64) -> Self {
        Self {
            id,
            born: 0,
            phase: Phase::Initiated,
            p_lost: 0.0,
            bbox: BBox { x: 0.0, y: 0.0, w: 1.0, h: 1.0 },
            state: State::default(),
            extent: Extent { half_w: 0.5, half_h: 0.5 },
            covariance: [[0.0; 6]; 6],
            gaze: Gaze::CENTRE,
            visible: 1.0,
            deficit: 0.0,
            waited: 0,
            detection: None,
            detection_index: None,
            detected_class: None,
            class: None,
        }
    }

    /// Sets the detection of this frame, and its place among those that were given.
    pub(super) fn set_detection(&mut self, detection: Option<Detection>, index: Option<usize>) {
        self.detection = detection;
        self.detection_index = index;
        self.detected_class = detection.and_then(|d| d.class).or(self.detected_class);
    }

    /// Whether the box is a result, rather than a guess.
    pub fn sure(&self) -> bool {
        self.phase != Phase::Lost
    }

    /// The result for a picture of this width, height and number of planes.
    pub(super) fn seen(&self, shape: [usize; 3]) -> Seen<'static> {
        let Self { id, born, phase, p_lost, bbox, state, extent, covariance, gaze, visible, deficit, .. } = *self;
        let Self { waited, detection, detection_index, detected_class, class, .. } = *self;
        let consistency = Consistency { deficit, ..Consistency::default() };
        let given = Seen::given(shape, &bbox).in_phase(phase);
        let life = Seen { id, born, waited, detection, detection_index, detected_class, class, ..given };
        Seen { p_lost, state, extent, covariance, gaze, visible, consistency, ..life }
    }
}
