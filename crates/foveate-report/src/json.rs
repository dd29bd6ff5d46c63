//! The summary of a run that `--json` prints.

use std::path::PathBuf;

use serde::{Deserialize, Serialize, Serializer};

use foveate_core::geometry::BBox;

/// What became of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// The video file or folder.
    pub source: String,
    /// Frames in the results, the first one included.
    pub frames: usize,
    /// Time spent in the tracker alone, seconds.
    pub seconds: f64,
    /// Frames a second of the tracker alone; 0 where nothing was measured.
    pub fps: f64,
    /// Time from the first frame to the last file, seconds: reading, tracking, writing.
    pub total_seconds: f64,
    /// Frames a second of all that.
    pub total_fps: f64,
    /// Frames whose status is occluded.
    pub occluded_frames: usize,
    /// Frames whose status is lost.
    pub lost_frames: usize,
    /// Frames whose box lies outside the picture.
    pub outside_frames: usize,
    /// The last box, counted from 0, in pixels; `null` without any frame, or where it lies outside the picture.
    pub bbox: Option<BBox>,
    /// The likeliest class over all frames, counted from 0, and its probability; left out without a recogniser.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub class: Option<(usize, f64)>,
    /// What it is called, where the recogniser's classes have names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub class_name: Option<String>,
    /// The seed in force.
    pub seed: u64,
    /// Files written. What is not UTF-8 in their names becomes the replacement character in JSON.
    #[serde(serialize_with = "lossy")]
    pub outputs: Vec<PathBuf>,
    /// Frames of the source in which its decoder reported damage.
    #[serde(default)]
    pub damaged_frames: u64,
    /// What readers of the results should be warned of, whole sentences.
    #[serde(default)]
    pub warnings: Vec<String>,
    /// Why the source ended early, if it did.
    pub error: Option<String>,
}

impl Summary {
    /// Frames a second, from frames and seconds.
    pub fn rate(frames: usize, seconds: f64) -> f64 {
        if seconds > 0.0 { frames as f64 / seconds } else { 0.0 }
    }
    /// As JSON on several lines.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("plain data is JSON")
    }
}

/// Paths as text: JSON has no other.
fn lossy<S: Serializer>(paths: &[PathBuf], to: S) -> Result<S::Ok, S::Error> {
    to.collect_seq(paths.iter().map(|path| path.to_string_lossy()))
}

#[cfg(test)]
mod tests {
    #[cfg(unix)]
    #[test]
    fn a_name_that_is_not_utf_8_is_written_all_the_same() {
        use super::*;
        use std::os::unix::ffi::OsStringExt;
        let text = r#"{"source": "a", "frames": 0, "seconds": 0, "fps": 0, "total_seconds": 0, "total_fps": 0, "bbox": null,
            "occluded_frames": 0, "lost_frames": 0, "outside_frames": 0, "seed": 0, "outputs": ["a/b.txt"], "error": null}"#;
        let mut summary: Summary = serde_json::from_str(text).expect("JSON");
        summary.outputs.push(std::ffi::OsString::from_vec(b"a/\xff.txt".to_vec()).into());
        let back: Summary = serde_json::from_str(&summary.to_json()).expect("JSON");
        assert_eq!(back.outputs, ["a/b.txt", "a/\u{fffd}.txt"].map(PathBuf::from));
    }
}
