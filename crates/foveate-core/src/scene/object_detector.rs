//! Objects of known classes, found by a network from an ONNX file.
//!
//! The picture is scaled to the network's input with its aspect ratio, and padded with grey (letterbox). Boxes of
//! other classes and with low scores are dropped, and of overlapping boxes the best is kept (non-maximum suppression
//! across classes, because one object is tracked once).

use serde::{Deserialize, Serialize};

#[cfg(feature = "onnx")]
mod boxes;
#[cfg(feature = "onnx")]
mod letterbox;
#[cfg(feature = "onnx")]
mod network;
#[cfg(feature = "onnx")]
pub use network::ObjectDetector;

use foveate_base::error::within;
use foveate_base::{Error, Result};

/// Which network, and which of its boxes count.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// The ONNX file, relative to the configuration.
    pub model: String,
    /// Least score of a box, 0 to 1.
    #[serde(default = "confidence")]
    pub confidence: f64,
    /// Of two boxes with a larger IoU the weaker is dropped, 0 to 1.
    #[serde(default = "overlap")]
    pub overlap: f64,
    /// Numbers of the classes to keep, from 0; all if empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub classes: Vec<usize>,
    /// Most boxes a picture.
    #[serde(default = "most")]
    pub most: usize,
    /// Layout of the network's output.
    #[serde(default)]
    pub layout: Layout,
    /// Side of the network's square input in pixels, if its file leaves it open.
    #[serde(default = "side")]
    pub side: usize,
}

/// Layouts of a detector's output. Boxes are in pixels of the input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// `yolov8` or `yolov5`, by the shape. With six numbers a box, name the layout: it may be `yolov5` of one class or
    /// `end-to-end`.
    #[default]
    Auto,
    /// (1, 4 + classes, boxes): centre x, y, width, height, class scores. YOLOv8, YOLO11.
    Yolov8,
    /// (1, boxes, 5 + classes): centre x, y, width, height, object score, class scores. YOLOv5.
    Yolov5,
    /// (1, boxes, 6): left, top, right, bottom, score, class. YOLOv10, YOLO26, exports with non-maximum
    /// suppression.
    EndToEnd,
}

fn confidence() -> f64 {
    0.25
}

fn overlap() -> f64 {
    0.45
}

fn most() -> usize {
    300
}

fn side() -> usize {
    640
}

impl Settings {
    /// The defaults, for this file.
    pub fn of(model: impl Into<String>) -> Self {
        Self {
            model: model.into(),
            confidence: confidence(),
            overlap: overlap(),
            classes: vec![],
            most: most(),
            layout: Layout::Auto,
            side: side(),
        }
    }

    /// Fails with the key if a number is out of range.
    pub fn check(&self) -> Result<()> {
        if self.model.is_empty() {
            return Err(Error::Config("detector.model is empty: give the path of an ONNX file".into()));
        }
        within("detector.confidence", self.confidence, 0.0, 1.0)?;
        within("detector.overlap", self.overlap, 0.0, 1.0)?;
        within("detector.most", self.most as f64, 1.0, 1e5)?;
        within("detector.side", self.side as f64, 32.0, 8192.0)
    }
}
