//! CVAT for video 1.1: one `track` per target, one `box` per frame; frames and pixels count from 0.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

use foveate::geometry::Size;
use foveate::report::escape;
use foveate::video::mot::TrackBox;
use foveate::{BBox, Error, Result, files, memory};
use roxmltree::{Document, Node};

use super::boxes::twice;
use super::{Boxes, KeyFrames, MOST};

/// Estimated bytes of a parsed element with the text after it, and of an attribute.
const ELEMENT: u64 = 150;
const ATTRIBUTE: u64 = 60;
/// Most attributes of an element; CVAT writes ten. The parser compares each with all others.
const ATTRIBUTES: usize = 256;

/// Checks whether memory and time suffice to parse this text. Values of attributes contain no `<`.
fn check(path: &Path, text: &str) -> Result<()> {
    let (mut elements, mut bytes) = (0, 0);
    for element in text.split('<') {
        let attributes = element.bytes().filter(|byte| *byte == b'=').count();
        if attributes > ATTRIBUTES {
            let problem = format!("an element has {attributes} attributes; expected at most {ATTRIBUTES}");
            return Err(Error::malformed(path, problem));
        }
        elements += 1;
        bytes += ELEMENT + ATTRIBUTE * attributes as u64;
    }
    memory::check(format_args!("{}: XML of {elements} elements", path.display()), bytes)
}

/// Interpolates boxes linearly between non-adjacent key frames, as CVAT does.
pub(super) fn read(path: &Path) -> Result<Boxes> {
    let text = files::read_text(path, files::TEXT)?;
    check(path, &text)?;
    let wrong = |problem: String| Error::malformed(path, problem);
    let document = Document::parse(&text).map_err(|e| wrong(format!("expected XML of CVAT for video 1.1: {e}")))?;
    let root = document.root_element();
    if root.has_tag_name("annotations") && root.children().any(|n| n.has_tag_name("image")) {
        return Err(wrong("it is CVAT for images; expected CVAT for video 1.1: export the task anew".into()));
    }
    let stated = |name: &str| document.descendants().find(|n| n.has_tag_name(name));
    let whole = |n: Node<'_, '_>| n.text()?.trim().parse::<usize>().ok();
    let frames = stated("size").and_then(whole).filter(|size| *size <= MOST);
    let mut boxes = Boxes { frames: frames.unwrap_or(0), ..Boxes::default() };
    boxes.size = stated("original_size").and_then(|size| {
        let side = |name: &str| size.children().find(|n| n.has_tag_name(name)).and_then(whole).filter(|side| *side > 0);
        Some(Size { width: side("width")?, height: side("height")? })
    });
    // A part of a task states fewer frames than it has.
    let numbers = root.descendants().filter(|n| n.has_tag_name("box")).filter_map(|shape| frame(&shape).ok());
    boxes.frames = boxes.frames.max(numbers.max().map_or(0, |last| last + 1));
    for track in root.children().filter(|n| n.has_tag_name("track")) {
        let id = number(&track, "id").map_err(wrong)? as i64;
        if let Some(label) = track.attribute("label") {
            boxes.labels.insert(id, label.to_owned());
        }
        let (mut shapes, mut keys, mut occluded) = (KeyFrames::new(), KeyFrames::new(), BTreeMap::new());
        for shape in track.children().filter(|n| n.has_tag_name("box")) {
            let frame = frame(&shape).map_err(wrong)?;
            let inside = shape.attribute("outside") != Some("1");
            let bbox = inside.then_some(corners(&shape).map_err(wrong)?);
            let other = shapes.insert(frame, bbox).flatten();
            if other.zip(bbox).is_some_and(|(other, bbox)| other != bbox) {
                return Err(wrong(twice(frame, id)));
            }
            occluded.insert(frame, shape.attribute("occluded") == Some("1"));
            if shape.attribute("keyframe") != Some("0") {
                keys.insert(frame, bbox);
            }
        }
        let before = boxes.tracks.len();
        boxes.fill(path, id, &shapes)?;
        let hidden = |b: &&TrackBox| occluded.range(..=b.frame).next_back().is_some_and(|(_, hidden)| *hidden);
        boxes.occluded.extend(boxes.tracks[before..].iter().filter(hidden).map(|b| (b.frame, id)));
        boxes.keys.entry(id).or_default().extend(keys);
    }
    let count = |such: &dyn Fn(&Node<'_, '_>) -> bool| document.descendants().filter(|n| such(n)).count();
    let turned = |n: &Node<'_, '_>| n.attribute("rotation").is_some_and(|r| r.parse() != Ok(0.0));
    boxes.lose(count(&|n| n.has_tag_name("box") && turned(n)), "boxes are rotated; they are taken upright");
    let shape = |n: &Node<'_, '_>| {
        ["polygon", "polyline", "points", "ellipse", "mask", "cuboid", "skeleton"].iter().any(|s| n.has_tag_name(*s))
    };
    boxes.lose(count(&shape), "shapes other than boxes are left out");
    let described = |n: &Node<'_, '_>| n.has_tag_name("attribute") && n.parent().is_some_and(|p| p.has_tag_name("box"));
    boxes.lose(count(&described), "attributes of boxes are left out");
    Ok(boxes)
}

fn number(node: &Node<'_, '_>, name: &str) -> std::result::Result<f64, String> {
    let text = node.attribute(name).unwrap_or_default();
    let number = text.parse::<f64>().ok().filter(|n| n.abs() < 1e9);
    number.ok_or_else(|| {
        let line = node.document().text_pos_at(node.range().start).row;
        format!("line {line}: expected <{} {name}=\"NUMBER\">, found \"{text:.40}\"", node.tag_name().name())
    })
}

fn frame(node: &Node<'_, '_>) -> std::result::Result<usize, String> {
    let value = number(node, "frame")?;
    if value >= 0.0 && value.fract() == 0.0 && value < MOST as f64 {
        return Ok(value as usize);
    }
    Err(format!("frame {value}: expected a whole number from 0 on"))
}

fn corners(node: &Node<'_, '_>) -> std::result::Result<BBox, String> {
    let [left, top, right, bottom] = ["xtl", "ytl", "xbr", "ybr"].map(|name| number(node, name));
    let bbox = BBox::from_corners(left?, top?, right?, bottom?);
    bbox.check().map_err(|e| format!("frame {}: {e}", node.attribute("frame").unwrap_or_default())).map(|()| bbox)
}

/// Writes every box as a key frame; a box marked `outside` ends each segment.
pub(super) fn write(boxes: &mut Boxes, path: &Path) -> Result<()> {
    boxes.lose_confidence();
    boxes.check_ids("CVAT for video")?;
    let labels: BTreeMap<i64, String> = boxes.ids().into_iter().map(|id| (id, attribute(&boxes.label(id)))).collect();
    let mut xml = format!(
        "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<annotations>\n  <version>1.1</version>\n  <meta><task>\n    <size>{}</size>\n    \
         <mode>interpolation</mode>\n    <labels>\n",
        boxes.frames
    );
    for name in labels.values().collect::<BTreeSet<_>>() {
        let _ = writeln!(xml, "      <label><name>{name}</name><attributes></attributes></label>");
    }
    xml.push_str("    </labels>\n");
    if let Some(Size { width, height }) = boxes.size {
        let _ = writeln!(xml, "    <original_size><width>{width}</width><height>{height}</height></original_size>");
    }
    xml.push_str("  </task></meta>\n");
    for own in boxes.by_target().chunk_by(|a, b| a.id == b.id) {
        let (id, label) = (own[0].id, &labels[&own[0].id]);
        let _ = writeln!(xml, "  <track id=\"{id}\" label=\"{label}\" source=\"auto\">");
        for (i, b) in own.iter().enumerate() {
            let hidden = boxes.occluded.contains(&(b.frame, id));
            shape(&mut xml, b.frame, &b.bbox, false, hidden);
            let next = own.get(i + 1).map_or(boxes.frames, |next| next.frame);
            if next > b.frame + 1 {
                shape(&mut xml, b.frame + 1, &b.bbox, true, hidden);
            }
        }
        xml.push_str("  </track>\n");
    }
    xml.push_str("</annotations>\n");
    files::write(path, xml.as_bytes())
}

/// Escapes a text for an attribute, in which readers take a line break or a tab for a space.
fn attribute(text: &str) -> String {
    let lines: Vec<String> = text.split('\r').map(escape).collect();
    lines.join("&#13;").replace('\t', "&#9;").replace('\n', "&#10;")
}

fn shape(xml: &mut String, frame: usize, b: &BBox, outside: bool, occluded: bool) {
    let (right, bottom, outside, occluded) = (b.x + b.w, b.y + b.h, u8::from(outside), u8::from(occluded));
    let _ = writeln!(
        xml,
        "    <box frame=\"{frame}\" outside=\"{outside}\" occluded=\"{occluded}\" keyframe=\"1\" xtl=\"{}\" ytl=\"{}\" xbr=\"{right}\" \
         ybr=\"{bottom}\" z_order=\"0\"/>",
        b.x, b.y
    );
}
