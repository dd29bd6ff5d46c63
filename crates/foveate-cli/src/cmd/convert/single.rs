//! Formats of one target: OTB, VOT, GOT-10k.

use std::path::Path;

use foveate::text::counted;
use foveate::video::mot::TrackBox;
use foveate::video::{annotation, vot};
use foveate::{BBox, Error, Result, files};

use super::{Boxes, Format};

/// The id of the only target.
pub(super) const ID: i64 = 1;

pub(super) fn read(format: Format, path: &Path) -> Result<Boxes> {
    let mut boxes = Boxes::default();
    let mut truth = match format {
        Format::Vot => {
            // First, since it refuses a file of too many lines.
            let truth = vot::read_truth(path)?;
            let [polygons, masks] = shapes(path)?;
            boxes.lose(polygons, "polygons became the boxes about them");
            boxes.lose(masks, "masks became the boxes about them");
            truth
        }
        _ => annotation::read_boxes(path)?,
    };
    if format == Format::Got10k {
        let is_filled = |b: &Option<BBox>| b.is_some_and(|b| b.w > 0.0 && b.h > 0.0);
        let before = truth.iter().filter(|b| is_filled(b)).count();
        annotation::hide_absent(&mut truth, path.parent().unwrap_or(Path::new("")))?;
        let hidden = before - truth.iter().filter(|b| is_filled(b)).count();
        boxes.lose(hidden, "boxes are left out: labels beside them say absent");
    }
    let empty = truth.iter_mut().filter(|b| b.is_some_and(|b| b.w <= 0.0 || b.h <= 0.0));
    boxes.lose(empty.map(|b| *b = None).count(), "boxes without area are left out");
    let tracks = truth.iter().enumerate().filter_map(|(frame, bbox)| {
        let bbox = (*bbox)?;
        Some(TrackBox { frame, id: ID, bbox, confidence: 1.0 })
    });
    boxes.tracks = tracks.collect();
    boxes.frames = truth.len();
    Ok(boxes)
}

/// Returns the numbers of lines that are polygons and that are masks.
fn shapes(path: &Path) -> Result<[usize; 2]> {
    let text = files::read_text(path, files::TEXT)?;
    let is_mask = |line: &str| line.trim_start().starts_with('m');
    let polygons =
        text.lines().filter(|line| !is_mask(line) && line.bytes().filter(|byte| *byte == b',').count() > 3).count();
    Ok([polygons, text.lines().filter(|line| is_mask(line)).count()])
}

/// Refuses boxes of several targets, and without ids.
pub(super) fn check_one(boxes: &mut Boxes) -> Result<()> {
    let ids: Vec<i64> = boxes.ids().into_iter().collect();
    if let [-1] = ids[..] {
        let n = boxes.tracks.len();
        return Err(Error::Invalid(format!(
            "{} without ids (-1) for a format of one target; give the target's boxes an id of 0 or more",
            counted(n, "detection")
        )));
    }
    if let [_, _, ..] | [..=-1] = ids[..] {
        let all: Vec<String> = ids.iter().take(20).map(i64::to_string).collect();
        let (n, all) = (ids.len(), all.join(", "));
        return Err(Error::Invalid(format!(
            "{n} targets ({all}) for a format of one; choose one with --id (0 or more)"
        )));
    }
    boxes.lose(ids.iter().filter(|id| **id != ID).count(), "id other than 1 is left out");
    Ok(())
}

pub(super) fn write(format: Format, boxes: &mut Boxes, path: &Path) -> Result<()> {
    check_one(boxes)?;
    boxes.lose_confidence();
    let mut truth = vec![None; boxes.frames];
    boxes.tracks.iter().for_each(|b| truth[b.frame] = Some(b.bbox));
    let text = match format {
        Format::Vot => vot::format_truth(&truth),
        Format::Got10k => {
            // The GOT-10k toolkit reads only numbers; absence.label marks the frames without a target.
            let labels: String = truth.iter().map(|b| if b.is_some() { "0\n" } else { "1\n" }).collect();
            let beside = path.with_file_name(annotation::ABSENCE);
            // GOT-10k has one sequence in a folder, in this file.
            let usual = path.with_file_name("groundtruth.txt");
            if beside.exists() && (!path.exists() || (usual.exists() && path != usual)) {
                return Err(Error::malformed(beside, "it labels other boxes in this folder; write to another folder"));
            }
            let filled: Vec<BBox> =
                truth.iter().map(|b| b.unwrap_or(BBox::counted_from_1(0.0, 0.0, 0.0, 0.0))).collect();
            files::write(path, annotation::format_boxes(&filled).as_bytes())?;
            return files::write(beside, labels.as_bytes());
        }
        _ => annotation::format_truth(&truth),
    };
    files::write(path, text.as_bytes())
}
