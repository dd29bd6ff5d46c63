//! A layer of shapes of napari, CSV: a line for each corner of each shape, `index,shape-type,vertex-index,axis-0,axis-1,axis-2`, which are
//! frame, y and x from 0; the centre of the first pixel is at (0, 0). Shapes have no ids: all boxes are of one target.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use foveate::video::mot::TrackBox;
use foveate::{BBox, Error, Result, files, memory};

use super::single::{ID, check_one};
use super::viame::split;
use super::{BOX, Boxes, MOST};

const COLUMNS: [&str; 6] = ["index", "shape-type", "vertex-index", "axis-0", "axis-1", "axis-2"];

/// The frame of a shape, and the least and the greatest x and y of its corners.
struct Shape {
    frame: f64,
    least: [f64; 2],
    greatest: [f64; 2],
}

pub(super) fn read(path: &Path) -> Result<Boxes> {
    let text = files::read_text(path, files::TEXT)?;
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let names = split(lines.next().map_or("", |(_, line)| line));
    if names != COLUMNS {
        let found = names.join(",");
        let problem = format!("line 1: expected the columns {}, found {found:.80}", COLUMNS.join(","));
        return Err(Error::malformed(path, problem));
    }
    memory::check(format_args!("{}: boxes", path.display()), lines.clone().count() as u64 * BOX)?;
    let (mut shapes, mut boxes, mut other) = (BTreeMap::<u64, Shape>::new(), Boxes::default(), 0);
    for (number, line) in lines {
        let wrong = |problem: String| Error::malformed(path, format!("line {}: {problem}", number + 1));
        let fields = split(line);
        if fields.len() != COLUMNS.len() {
            return Err(wrong(format!("expected {} fields between commas, found {}", COLUMNS.len(), fields.len())));
        }
        let value = |k: usize| {
            let number = fields[k].parse::<f64>().ok().filter(|n| n.abs() < 1e9);
            number.ok_or_else(|| wrong(format!("{}: expected a number, found \"{:.40}\"", COLUMNS[k], fields[k])))
        };
        let (index, frame, corner) = (value(0)? as u64, value(3)?, [value(5)?, value(4)?]);
        if frame < -0.5 || frame.round() >= MOST as f64 {
            return Err(wrong(format!("axis-0: expected a frame from 0 to {}, found {frame}", MOST - 1)));
        }
        other += usize::from(value(2)? == 0.0 && fields[1] != "rectangle");
        let shape = shapes.entry(index).or_insert(Shape { frame, least: corner, greatest: corner });
        if shape.frame != frame {
            return Err(wrong(format!("shape {index} lies in the frames {} and {frame}; expected one", shape.frame)));
        }
        for (i, value) in corner.into_iter().enumerate() {
            shape.least[i] = shape.least[i].min(value);
            shape.greatest[i] = shape.greatest[i].max(value);
        }
    }
    for (index, Shape { frame, least, greatest }) in shapes {
        // Corners are edges of pixels: the first pixel reaches from -0.5 to 0.5.
        let bbox = BBox::new(least[0] + 0.5, least[1] + 0.5, greatest[0] - least[0], greatest[1] - least[1]);
        bbox.check().map_err(|e| Error::malformed(path, format!("shape {index}: {e}")))?;
        let frame = frame.round().max(0.0) as usize;
        boxes.frames = boxes.frames.max(frame + 1);
        boxes.tracks.push(TrackBox { frame, id: ID, bbox, confidence: 1.0 });
    }
    boxes.lose(other, "shapes are no rectangles; they became the boxes about them");
    Ok(boxes)
}

pub(super) fn write(boxes: &mut Boxes, path: &Path) -> Result<()> {
    check_one(boxes)?;
    boxes.lose_confidence();
    let mut text = COLUMNS.join(",") + "\n";
    for (index, TrackBox { frame, bbox, .. }) in boxes.tracks.iter().enumerate() {
        let [left, top] = [bbox.x - 0.5, bbox.y - 0.5];
        let [right, bottom] = [left + bbox.w, top + bbox.h];
        for (corner, (y, x)) in [(top, left), (top, right), (bottom, right), (bottom, left)].into_iter().enumerate() {
            let _ = writeln!(text, "{index},rectangle,{corner},{frame},{y},{x}");
        }
    }
    boxes.lose(usize::from(boxes.tracks.iter().all(|b| b.frame + 1 < boxes.frames)), "length of the video is left out");
    files::write(path, text.as_bytes())
}
