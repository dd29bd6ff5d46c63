//! Writes boxes to the files of other programs.

use std::path::PathBuf;

use foveate::BBox;
use foveate::video::mot::TrackBox;
use foveate_cli::convert::{Boxes, Format, write_yolo};
use pyo3::prelude::*;

use crate::errors::{OrRaise, input};

/// A box: index of its picture, id of its target, left, top, width, height, and confidence.
type Row = (usize, i64, [f64; 4], f64);

/// Writes the boxes of a video with this number of pictures. Returns one sentence for each kind of information that the format does not
/// hold.
#[pyfunction]
pub(crate) fn export_boxes(
    py: Python<'_>,
    format: &str,
    path: PathBuf,
    rows: Vec<Row>,
    frames: usize,
    size: Option<(usize, usize)>,
) -> PyResult<Vec<String>> {
    let boxes = rows.into_iter().map(|(frame, id, [x, y, w, h], confidence)| {
        let bbox = BBox::new(x, y, w, h);
        TrackBox { frame, id, bbox, confidence }
    });
    let boxes = Boxes::new(boxes.collect(), frames).or_raise(py)?.of_size(size.map(Into::into));
    if format == "yolo" {
        let size = size
            .ok_or_else(|| input(py, "YOLO's numbers are relative to the picture: give its size, (width, height)"))?;
        return py.detach(|| write_yolo(boxes, size.into(), &path)).or_raise(py);
    }
    let Some(known) = Format::named(format) else {
        let names = Format::names().join(", ");
        return Err(input(py, format!("format is one of {names}, yolo; it is \"{format}\"")));
    };
    py.detach(|| boxes.write(known, &path)).or_raise(py)
}
