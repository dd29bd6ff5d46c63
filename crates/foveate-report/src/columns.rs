//! The columns of every text file that this crate writes: name, unit, origin, meaning.
//!
//! The header line of each CSV file is written from these tables, and [`dictionary`] renders them as Markdown. Frames count
//! from 1 in files. Pixels count from 1 in the text formats of OTB and MOTChallenge, and from 0 everywhere else, where the
//! centre of the top-left pixel is (0, 0).

mod dictionary;

pub use self::dictionary::dictionary;

/// A column of a CSV file, a field of a text line, or a key of a JSON object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    /// As it stands in the file; a dot separates a key from one inside it.
    pub name: &'static str,
    /// Its unit; empty for numbers without one, flags and texts.
    pub unit: &'static str,
    /// The first number, for indices and coordinates.
    pub from: Option<u8>,
    /// Its meaning, its range, and when it is empty.
    pub meaning: &'static str,
}

impl Column {
    const fn new(name: &'static str, unit: &'static str, meaning: &'static str) -> Self {
        Self { name, unit, from: None, meaning }
    }
    const fn counted(from: u8, name: &'static str, unit: &'static str, meaning: &'static str) -> Self {
        Self { name, unit, from: Some(from), meaning }
    }

    /// Returns whether `other` is this column, perhaps inside another key, as `estimate.x` is `x`.
    fn is_inside(&self, other: &Self) -> bool {
        let name = other.name.rsplit('.').next();
        name == Some(self.name) && (self.unit, self.from, self.meaning) == (other.unit, other.from, other.meaning)
    }
}

/// A file and its columns.
#[derive(Clone, Copy, Debug)]
pub struct OutputFile {
    /// Its usual name.
    pub name: &'static str,
    /// The content of one line.
    pub line: &'static str,
    /// Its columns, in order.
    pub columns: &'static [Column],
}

/// All files with columns: those of a single target first.
pub const FILES: [OutputFile; 7] = [
    OutputFile {
        name: "boxes.txt",
        line: "OTB's format: one line a frame, the first included, no header. A box outside the picture is moved until it touches the \
               picture.",
        columns: BOXES,
    },
    OutputFile {
        name: "track.csv",
        line: "A header, then one line a frame. If the box of a frame was given, everything from `cov_x_x` on is empty. \
               Numbers read back bit for bit.",
        columns: TRACK,
    },
    OutputFile {
        name: "trace.jsonl",
        line: "One JSON object a frame with every intermediate quantity. A dot separates a key from one inside it. A frame whose \
               box was given has `frame`, `time` and `given` only. Numbers that are not finite are `null`; others read back \
               bit for bit.",
        columns: TRACE,
    },
    OutputFile {
        name: "regret.csv",
        line: "A header, then one line a tracked frame: the reward of the policy and of fixed gazes.",
        columns: REGRET,
    },
    OutputFile {
        name: "tracks.txt",
        line: "MOTChallenge's format: one line for each active target of a frame, no header. Lost targets are left out.",
        columns: TRACKS_TXT,
    },
    OutputFile {
        name: "tracks.csv",
        line: "A header, then one line for each active target of a frame, lost ones included.",
        columns: TRACKS,
    },
    OutputFile { name: "targets.csv", line: "A header, then one line a target.", columns: TARGETS },
];

const FRAME: Column = Column::counted(1, "frame", "frame", "Frame number.");
const TIME: Column = Column::new("time", "s", "Time of the frame in the source.");
const LEFT: Column = Column::counted(0, "left", "px", "Left edge of the box.");
const TOP: Column = Column::counted(0, "top", "px", "Top edge of the box.");
const WIDTH: Column = Column::new("width", "px", "Width of the box.");
const HEIGHT: Column = Column::new("height", "px", "Height of the box.");
const X: Column =
    Column::counted(0, "x", "px", "Centre, across: mean of the particles, corrected by the box regression.");
const Y: Column = Column::counted(0, "y", "px", "Centre of the target, down.");
const VX: Column = Column::new("vx", "px/frame", "Velocity, across.");
const VY: Column = Column::new("vy", "px/frame", "Velocity, down.");
const LOG_SCALE: Column =
    Column::new("log_scale", "", "Natural logarithm of the size relative to the newest template.");
const ANGLE: Column = Column::new("angle", "rad", "Rotation relative to frame 1, clockwise on the screen.");
const LOG_ASPECT: Column =
    Column::new("log_aspect", "", "Natural logarithm of width / height relative to that template, at the same area.");
const SD_X: Column = Column::new("sd_x", "px", "Standard deviation of the error of `x`.");
const SD_Y: Column = Column::new("sd_y", "px", "Standard deviation of the error of `y`.");
const GAZE_U: Column =
    Column::new("gaze_u", "half-boxes", "The chosen gaze, across: −1 to 1 from the left edge of the box to the right.");
const GAZE_V: Column =
    Column::new("gaze_v", "half-boxes", "The chosen gaze, down: −1 to 1 from the top edge of the box to the bottom.");
const REWARD: Column = Column::new("reward", "", "Reward of the chosen gaze, 0 to 1.");
const DEFICIT: Column = Column::new(
    "deficit",
    "",
    "Evidence deficit, smoothed over frames: 0 as on the target in frame 1, 1 as elsewhere, at most 2.",
);
const P_LOST: &str = "Probability that the target is lost, 0 to 1.";
const STATUS: &str = "Track status: tracking, occluded, lost or reacquired.";
const CLASS_PROBABILITY: Column =
    Column::new("class_probability", "", "Probability of that class over all frames so far, 0 to 1.");
const CLASS: Column = Column::counted(
    0,
    "class",
    "",
    "Number of the most probable class over all frames so far; empty without a recogniser.",
);

/// boxes.txt.
pub const BOXES: &[Column] = &[
    Column::counted(1, "x", "px", "Left edge of the box."),
    Column::counted(1, "y", "px", "Top edge of the box."),
    Column::new("w", "px", "Width of the box."),
    Column::new("h", "px", "Height of the box."),
];

macro_rules! cov {
    ($a:literal, $unit:literal) => {
        Column::new(concat!("cov_", $a, "_", $a), $unit, concat!("Variance of `", $a, "`."))
    };
    ($a:literal, $b:literal, $unit:literal) => {
        Column::new(concat!("cov_", $a, "_", $b), $unit, concat!("Covariance of `", $a, "` and `", $b, "`."))
    };
}

/// track.csv.
pub const TRACK: &[Column] = &[
    FRAME,
    TIME,
    LEFT,
    TOP,
    WIDTH,
    HEIGHT,
    X,
    Y,
    VX,
    VY,
    LOG_SCALE,
    ANGLE,
    LOG_ASPECT,
    cov!("x", "px²"),
    cov!("x", "y", "px²"),
    cov!("x", "vx", "px²/frame"),
    cov!("x", "vy", "px²/frame"),
    cov!("x", "log_scale", "px"),
    cov!("x", "angle", "px rad"),
    cov!("x", "log_aspect", "px"),
    cov!("y", "px²"),
    cov!("y", "vx", "px²/frame"),
    cov!("y", "vy", "px²/frame"),
    cov!("y", "log_scale", "px"),
    cov!("y", "angle", "px rad"),
    cov!("y", "log_aspect", "px"),
    cov!("vx", "px²/frame²"),
    cov!("vx", "vy", "px²/frame²"),
    cov!("vx", "log_scale", "px/frame"),
    cov!("vx", "angle", "px rad/frame"),
    cov!("vx", "log_aspect", "px/frame"),
    cov!("vy", "px²/frame²"),
    cov!("vy", "log_scale", "px/frame"),
    cov!("vy", "angle", "px rad/frame"),
    cov!("vy", "log_aspect", "px/frame"),
    cov!("log_scale", ""),
    cov!("log_scale", "angle", "rad"),
    cov!("log_scale", "log_aspect", ""),
    cov!("angle", "rad²"),
    cov!("angle", "log_aspect", "rad"),
    cov!("log_aspect", ""),
    SD_X,
    SD_Y,
    Column::new("ess", "particles", "Effective sample size 1/Σw², 1 to the number of particles."),
    Column::new("log_evidence", "nats", "Log evidence of the frame, up to the constant of the likelihood."),
    Column::new(
        "deficit",
        "",
        "Evidence deficit, an input of `p_lost`, smoothed over frames: 0 as on the target in frame 1, 1 as elsewhere, at most 2. \
         Empty if frame 1 does not separate the target from other places.",
    ),
    Column::new("p_lost", "", P_LOST),
    Column::new("status", "", STATUS),
    Column::new("usable", "", "1 if the box is a result (tracking, reacquired), 0 if it is a guess (occluded, lost)."),
    GAZE_U,
    GAZE_V,
    REWARD,
    Column::new("distance", "", "Distance of the glimpse to the template at the chosen gaze, at least 0."),
    Column::new("values_read", "", "Values read from the picture, each once: pixels or bins, times planes."),
    Column::new("share_read", "", "The same as a share of all values of the picture, 0 to 1."),
    Column::counted(
        0,
        "class",
        "",
        "The most probable class over all frames so far: its name, or its number if it has none. Empty without a \
         recogniser; quoted if necessary.",
    ),
    CLASS_PROBABILITY,
];

/// tracks.txt.
pub const TRACKS_TXT: &[Column] = &[
    FRAME,
    ID,
    Column::counted(1, "bb_left", "px", "Left edge of the box."),
    Column::counted(1, "bb_top", "px", "Top edge of the box."),
    Column::new("bb_width", "px", "Width of the box."),
    Column::new("bb_height", "px", "Height of the box."),
    Column::new("conf", "", "Confidence: 1 − evidence deficit, at least 0."),
    Column::new("x", "", "Always −1: no world coordinates."),
    Column::new("y", "", "Always −1."),
    Column::new("z", "", "Always −1."),
];

const ID: Column =
    Column::counted(1, "id", "", "Track id, in order of initiation or as given; never reused for another target.");

/// tracks.csv.
pub const TRACKS: &[Column] = &[
    FRAME,
    TIME,
    ID,
    Column::new("phase", "", "Track phase: initiated, re-identified, tracked, occluded or lost."),
    LEFT,
    TOP,
    WIDTH,
    HEIGHT,
    X,
    Y,
    VX,
    VY,
    LOG_SCALE,
    ANGLE,
    LOG_ASPECT,
    SD_X,
    SD_Y,
    DEFICIT,
    Column::new("p_lost", "", P_LOST),
    Column::new("visible", "", "Share of the target that no other target covers, 0 to 1."),
    Column::new("waited", "frames", "Frames since the last look at it; 0 if it was in this frame."),
    Column::new("detected", "", "1 if a detection was assigned to it in this frame, else 0."),
    Column::counted(0, "detection", "", "Number of that detection in the frame; empty without one."),
    Column::counted(0, "detected_class", "", "Class of its last detection with a class; empty if none had one."),
    GAZE_U,
    GAZE_V,
    FIRST_FRAME,
    CLASS,
    CLASS_PROBABILITY,
];

const FIRST_FRAME: Column = Column::counted(1, "first_frame", "frame", "Frame in which the track was initiated.");

/// targets.csv.
pub const TARGETS: &[Column] = &[
    ID,
    FIRST_FRAME,
    Column::counted(1, "last_frame", "frame", "Last frame in which it was active."),
    Column::new("frames", "frames", "Frames in which it was active."),
    Column::new("occluded", "frames", "Of these, frames in the phase occluded."),
    Column::new("lost", "frames", "Of these, frames in the phase lost."),
    Column::new("detected", "frames", "Of these, frames with an assigned detection."),
    Column::new("reidentified", "times", "How often it was re-identified after its termination."),
    CLASS,
    CLASS_PROBABILITY,
];

/// regret.csv; the last column stands for one a fixed gaze.
pub const REGRET: &[Column] = &[
    FRAME,
    GAZE_U,
    GAZE_V,
    REWARD,
    Column::new("best_reward", "", "Reward of the fixed gaze with the largest sum over all frames."),
    Column::new("regret", "", "`best_reward` minus `reward`, −1 to 1."),
    Column::new("cumulative_regret", "", "Sum of `regret` up to this frame."),
    Column::new("cumulative_regret_so_far", "", "The same against the best fixed gaze up to this frame."),
    Column::new("reward_U_V", "", "Reward of the fixed gaze (U, V), 0 to 1; one column for each gaze."),
];

/// trace.jsonl.
pub const TRACE: &[Column] = &[
    FRAME,
    TIME,
    Column::counted(0, "given", "px", "The given box: `x`, `y` (left and top edge), `w`, `h`."),
    Column::counted(0, "bbox", "px", "The estimated upright box: `x`, `y` (left and top edge), `w`, `h`."),
    Column::counted(0, "estimate.x", "px", X.meaning),
    Column::counted(0, "estimate.y", "px", Y.meaning),
    Column::new("estimate.vx", "px/frame", VX.meaning),
    Column::new("estimate.vy", "px/frame", VY.meaning),
    Column::new("estimate.log_scale", "", LOG_SCALE.meaning),
    Column::new("estimate.angle", "rad", ANGLE.meaning),
    Column::new("estimate.log_aspect", "", LOG_ASPECT.meaning),
    Column::new("covariance", "as the state", "7 × 7 covariance of the state, row by row."),
    Column::new("ess", "particles", "Effective sample size 1/Σw², 1 to the number of particles."),
    Column::new("log_evidence", "nats", "Log evidence of the frame, up to the constant of the likelihood."),
    Column::new("consistency.deficit", "", DEFICIT.meaning),
    Column::new("consistency.frame_deficit", "", "Evidence deficit of this frame alone, 0 to 2."),
    Column::new(
        "consistency.tempered_ess",
        "",
        "Effective sample size of the tempered weights as a share of the particles, 0 to 1.",
    ),
    Column::new("consistency.holds", "", "Whether the smoothed deficit is below its threshold."),
    Column::new(
        "consistency.is_informative",
        "",
        "Whether frame 1 separates the target from other places. If not, ignore the deficits.",
    ),
    Column::new("confidence.p_lost", "", P_LOST),
    Column::new("confidence.own", "", "The same without the second tracker; the search and the learning use it."),
    Column::new("confidence.status", "", STATUS),
    Column::new(
        "confidence.cues",
        "",
        "Inputs of P(lost): deficit, frame_deficit, drop, lasting, flat, spread, distance, margin, colour, elsewhere, agreement, absence, leap.",
    ),
    Column::new("extent.half_w", "px", "Half the width of the box at scale 1 in the shape of frame 1."),
    Column::new("extent.half_h", "px", "Half the height of the box at scale 1 in the shape of frame 1."),
    Column::counted(0, "predicted", "as the state", "Predicted particles: the seven numbers of the state for each."),
    Column::new("weights", "", "One weight for each particle; they sum to 1."),
    Column::counted(0, "ancestors", "", "Index in `predicted` of the parent of each particle of the next frame."),
    Column::new("plan.gazes", "half-boxes", "Scored gazes: `u`, `v`, and `arm`, an index from 0, or null."),
    Column::new("plan.used", "", "Whether each gaze counts in the weights."),
    Column::new("plan.weights", "", "Mixing weight of the log-likelihood of each gaze, at least 0."),
    Column::counted(0, "plan.chosen", "", "Index of the chosen gaze in `plan.gazes`."),
    Column::new("rewards", "", "Reward of each gaze of `plan.gazes`, 0 to 1."),
    Column::new("recorded_gazes", "half-boxes", "Gazes scored for observers only; left out if there are none."),
    Column::new("recorded_rewards", "", "Their rewards, 0 to 1."),
    Column::new("gaze_evidence", "nats", "Log evidence of each gaze of `plan.gazes` alone."),
    Column::new("percept.gaze", "half-boxes", "The gaze of the glimpse: `u`, `v`, `arm`."),
    Column::new("percept.glimpse", "", "The glimpse at the estimate, one value for each cell of the retina, 0 to 1."),
    Column::new("percept.features", "", "Activations of the encoder."),
    Column::new("percept.distance", "", "Distance of the glimpse to the template at that gaze, at least 0."),
    Column::new(
        "classes",
        "",
        "Probability of each class over all frames so far; this and the next three are left out without a recogniser.",
    ),
    Column::new("class", "", "Name of the most probable class, if it has one."),
    Column::new("own_classes", "", "Probability of each class in this frame alone."),
    Column::new("recognition_gazes", "half-boxes", "Gazes of the recogniser."),
    Column::new("snapshot", "", "State of the policy; null if it has none."),
    Column::new("snapshot.gazes", "half-boxes", "Gazes of a policy with arms: `u`, `v`, `arm`."),
    Column::new("snapshot.probabilities", "", "Probability of choosing each next, or its weight; they sum to 1."),
    Column::new("snapshot.points", "", "Points along a side of the reward surface, for a continuous policy."),
    Column::new("snapshot.reach", "half-boxes", "Half the side of the square that the surface covers."),
    Column::new("snapshot.mean", "", "Mean reward at each point of the surface, row by row from the top."),
    Column::new(
        "snapshot.best",
        "half-boxes",
        "The gaze with the largest mean: `u`, `v`, `arm`; null before the first reward.",
    ),
];

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::control::CUE_NAMES;

    #[test]
    fn names_are_unique_and_the_dictionary_has_them_all() {
        let text = dictionary();
        for file in &FILES {
            let part = text.split(&format!("## `{}`\n", file.name)).nth(1).expect("its part");
            let part = part.split("\n## `").next().expect("one part");
            for (i, column) in file.columns.iter().enumerate() {
                assert!(file.columns[..i].iter().all(|c| c.name != column.name), "{} twice", column.name);
                assert!(column.meaning.ends_with('.'), "{}: {}", column.name, column.meaning);
                let inner = column.name.starts_with("cov_");
                assert!(inner || part.contains(&format!("`{}`", column.name)), "{}: {}", file.name, column.name);
            }
        }
        assert_eq!(text.matches("## `").count(), FILES.len());
        assert_eq!(text.matches("`cov_x_x` to `cov_log_aspect_log_aspect`").count(), 1);
    }

    #[test]
    fn all_cues_are_named_in_their_order() {
        let cues = TRACE.iter().find(|c| c.name == "confidence.cues").expect("it is there");
        assert!(cues.meaning.ends_with(&format!(": {}.", CUE_NAMES.join(", "))), "{}", cues.meaning);
    }

    #[test]
    fn the_covariance_is_an_upper_triangle_row_by_row() {
        let state = ["x", "y", "vx", "vy", "log_scale", "angle", "log_aspect"];
        let triangle = (0..7).flat_map(|i| (i..7).map(move |j| format!("cov_{}_{}", state[i], state[j])));
        let first = TRACK.iter().position(|c| c.name == "cov_x_x").expect("it is there");
        assert!(triangle.eq(TRACK[first..first + 28].iter().map(|c| c.name.to_owned())));
    }
}
