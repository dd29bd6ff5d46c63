//! Spots of TrackMate, CSV: one line per spot, below the names and units of the columns. A spot is a disc, so that of a box only centre and
//! area stay. Frames count from 0; the centre of the first pixel is at (0, 0).

use std::fmt::Write;
use std::path::Path;

use foveate::video::mot::TrackBox;
use foveate::{BBox, Error, Result, files, memory};

use super::viame::split;
use super::{BOX, Boxes, MOST};

/// The names, long and short, and units come before the spots; earlier versions have the first line only.
const HEAD: usize = 4;

pub(super) fn read(path: &Path) -> Result<Boxes> {
    let text = files::read_text(path, files::TEXT)?;
    let mut lines = text.lines().enumerate();
    let names = split(lines.next().map_or("", |(_, line)| line));
    let column = |name: &str| {
        let problem =
            || Error::malformed(path, format!("line 1: expected a column {name}, found {} others", names.len()));
        names.iter().position(|n| n == name).ok_or_else(problem)
    };
    let [x, y, radius] = [column("POSITION_X")?, column("POSITION_Y")?, column("RADIUS")?];
    let [track, frame] = [column("TRACK_ID")?, column("FRAME")?];
    let quality = column("QUALITY").ok();
    memory::check(format_args!("{}: boxes", path.display()), lines.clone().count() as u64 * BOX)?;
    let mut boxes = Boxes::default();
    for (number, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let wrong = |problem: String| Error::malformed(path, format!("line {}: {problem}", number + 1));
        let fields = split(line);
        if fields.len() < names.len() {
            return Err(wrong(format!("expected {} fields between commas, found {}", names.len(), fields.len())));
        }
        let is_number = |k: usize| fields[k].parse::<f64>().is_ok();
        if number < HEAD && ![x, y, radius, frame].into_iter().any(is_number) {
            let unit = fields[x].trim_matches(['(', ')']);
            if fields[x].starts_with('(') && !["", "pixel", "pixels"].contains(&unit) {
                let advice = "in ImageJ, remove the scale (Analyze > Set Scale) before you track";
                return Err(wrong(format!("expected positions in pixels, found {unit:.20}: {advice}")));
            }
            continue;
        }
        let value = |k: usize| {
            let number = fields[k].parse::<f64>().ok().filter(|n| n.abs() < 1e9);
            number.ok_or_else(|| wrong(format!("{}: expected a number, found \"{:.40}\"", names[k], fields[k])))
        };
        let whole = |k: usize| {
            let number = value(k)?;
            let found = || wrong(format!("{}: expected a whole number from 0 on, found {number}", names[k]));
            if number.fract() == 0.0 && number >= 0.0 { Ok(number as usize) } else { Err(found()) }
        };
        let id = if ["", "None"].contains(&&*fields[track]) { -1 } else { whole(track)? as i64 };
        let frame = whole(frame)?;
        if frame >= MOST {
            return Err(wrong(format!("FRAME: expected less than {MOST}, found {frame}")));
        }
        let side = 2.0 * value(radius)?;
        let bbox = BBox::around(value(x)?, value(y)?, side, side);
        bbox.check().map_err(|e| wrong(e.to_string()))?;
        boxes.frames = boxes.frames.max(frame + 1);
        let confidence = quality.and_then(|k| fields[k].parse().ok()).filter(|q: &f64| q.is_finite()).unwrap_or(1.0);
        boxes.tracks.push(TrackBox { frame, id, bbox, confidence });
    }
    Ok(boxes)
}

pub(super) fn write(boxes: &mut Boxes, path: &Path) -> Result<()> {
    let (second, unit) = boxes.rate.map_or((1.0, "frame"), |rate| (1.0 / rate, "sec"));
    let mut text = format!(
        "LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME,RADIUS,VISIBILITY\n\
         Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame,Radius,Visibility\n\
         Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame,R,Visibility\n\
         ,,,(quality),(pixel),(pixel),(pixel),({unit}),,(pixel),\n"
    );
    for (spot, b) in boxes.tracks.iter().enumerate() {
        let (x, y) = b.bbox.centre();
        let track = if b.id < 0 { String::new() } else { b.id.to_string() };
        let radius = (b.bbox.w * b.bbox.h).sqrt() / 2.0;
        let (frame, time) = (b.frame, b.frame as f64 * second);
        let _ = writeln!(text, "ID{spot},{spot},{track},{},{x},{y},0,{time},{frame},{radius},1", b.confidence);
    }
    let oblong = boxes.tracks.iter().filter(|b| b.bbox.w != b.bbox.h).count();
    boxes.lose(oblong, "boxes are not square; only their centres and areas are kept");
    boxes.lose(usize::from(boxes.tracks.iter().all(|b| b.frame + 1 < boxes.frames)), "length of the video is left out");
    files::write(path, text.as_bytes())
}
