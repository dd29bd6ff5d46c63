//! Tracks of DIVE and VIAME: one line per box, `id, video, frame, left, top, right, bottom, confidence, length, class, confidence`; frames
//! and pixels count from 0.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use foveate::video::mot::TrackBox;
use foveate::{BBox, Error, Result, files, memory};

use super::{BOX, Boxes, MOST};

/// The fields that every line has.
const FIELDS: usize = 9;

pub(super) fn read(path: &Path) -> Result<Boxes> {
    let text = files::read_text(path, files::TEXT)?;
    let lines =
        || text.lines().map(str::trim).enumerate().filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let count = lines().count();
    memory::check(format_args!("{}: {count} boxes", path.display()), count as u64 * BOX)?;
    let (mut boxes, mut more, mut other) = (Boxes::default(), 0, 0);
    for (number, line) in lines() {
        let wrong = |problem: String| Error::malformed(path, format!("line {}: {problem}", number + 1));
        let fields = split(line);
        if fields.len() < FIELDS {
            return Err(wrong(format!("expected at least {FIELDS} fields between commas, found {}", fields.len())));
        }
        let value = |k: usize| {
            let number = fields[k].parse::<f64>().ok().filter(|n| n.abs() < 1e9);
            number.ok_or_else(|| wrong(format!("field {}: expected a number, found \"{:.40}\"", k + 1, fields[k])))
        };
        let whole = |k: usize| {
            let number = value(k)?;
            let found = || wrong(format!("field {}: expected a whole number from 0 on, found {number}", k + 1));
            if number.fract() == 0.0 && number >= 0.0 { Ok(number as usize) } else { Err(found()) }
        };
        let (id, frame) = (whole(0)? as i64, whole(2)?);
        if frame >= MOST {
            return Err(wrong(format!("frame {frame}: expected at most {MOST} frames")));
        }
        let bbox = BBox::from_corners(value(3)?, value(4)?, value(5)?, value(6)?);
        bbox.check().map_err(|e| wrong(e.to_string()))?;
        if let Some(label) = label(&fields[FIELDS..]) {
            other += usize::from(boxes.labels.entry(id).or_insert_with(|| label.to_owned()) != label);
        }
        more += usize::from(fields.len() > FIELDS + 2);
        boxes.frames = boxes.frames.max(frame + 1);
        boxes.tracks.push(TrackBox { frame, id, bbox, confidence: value(7)? });
    }
    boxes.lose(other, "boxes differ from the class of the first box of their target, which is kept");
    boxes.lose(more, "boxes have further classes or attributes; they are left out");
    Ok(boxes)
}

/// The fields of a line; those in quotes may contain commas.
pub(super) fn split(line: &str) -> Vec<String> {
    let (mut fields, mut field, mut quoted) = (vec![], String::new(), false);
    let mut characters = line.chars().peekable();
    while let Some(c) = characters.next() {
        match c {
            '"' if quoted && characters.next_if_eq(&'"').is_some() => field.push('"'),
            '"' => quoted = !quoted,
            ',' if !quoted => fields.push(std::mem::take(&mut field).trim().to_owned()),
            _ => field.push(c),
        }
    }
    fields.push(field.trim().to_owned());
    fields
}

/// The class with the highest confidence: pairs `class, confidence`, before any attributes, which begin with a parenthesis.
fn label(pairs: &[String]) -> Option<&str> {
    let classes = pairs.chunks(2).take_while(|pair| !pair[0].is_empty() && !pair[0].starts_with('('));
    let sure = classes.map(|pair| (pair[0].as_str(), pair.get(1).and_then(|p| p.parse::<f64>().ok()).unwrap_or(0.0)));
    sure.reduce(|a, b| if b.1 > a.1 { b } else { a }).map(|(class, _)| class)
}

pub(super) fn write(boxes: &mut Boxes, path: &Path) -> Result<()> {
    boxes.check_ids("the format")?;
    let mut text = String::from(
        "# 1: track id, 2: image, 3: frame, 4 to 7: box (left, top, right, bottom), 8: confidence, 9: length, 10 and 11: class, confidence\n",
    );
    let quoted = |label: String| {
        let label = label.replace(['\n', '\r'], " ");
        if label.contains([',', '"']) { format!("\"{}\"", label.replace('"', "\"\"")) } else { label }
    };
    let plain: BTreeMap<i64, String> = boxes.ids().into_iter().map(|id| (id, boxes.label(id))).collect();
    let labels: BTreeMap<i64, String> = plain.iter().map(|(id, text)| (*id, quoted(text.clone()))).collect();
    let changed = plain.iter().filter(|(id, text)| label(&split(&labels[*id])) != Some(text)).count();
    boxes.lose(
        changed,
        "labels are read back otherwise: they begin with a parenthesis or a space, or have several lines",
    );
    for b in &boxes.tracks {
        let label = &labels[&b.id];
        let (right, bottom) = (b.bbox.x + b.bbox.w, b.bbox.y + b.bbox.h);
        let (id, frame, confidence) = (b.id, b.frame, b.confidence);
        let _ = writeln!(
            text,
            "{id},,{frame},{},{},{right},{bottom},{confidence},-1,{label},{confidence}",
            b.bbox.x, b.bbox.y
        );
    }
    boxes.lose(usize::from(boxes.tracks.iter().all(|b| b.frame + 1 < boxes.frames)), "length of the video is left out");
    files::write(path, text.as_bytes())
}
