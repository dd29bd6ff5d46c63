//! Label Studio's JSON of a video: one `videorectangle` per target; frames count from 1, boxes are in per cent of the picture.

use std::collections::BTreeSet;
use std::path::Path;

use foveate::geometry::Size;
use foveate::{BBox, Error, Result, files, memory};
use serde::Deserialize;
use serde_json::json;

use super::boxes::{Side, size_of, twice};
use super::{Boxes, KeyFrames, MOST, list};

/// Estimated bytes of memory per byte of the file.
const PARSED: u64 = 8;
/// What the name of a written region begins with; its id follows.
const REGION: &str = "target-";
/// Label Studio's default for frames per second.
const RATE: f64 = 24.0;

#[derive(Deserialize)]
struct Task {
    #[serde(default)]
    annotations: Vec<Annotation>,
    #[serde(default)]
    predictions: Vec<Annotation>,
}

impl Task {
    /// Returns the boxes that persons drew or, if there are none, those that a program proposed.
    fn drawn(&self) -> &[Annotation] {
        if self.annotations.is_empty() { &self.predictions } else { &self.annotations }
    }
}

#[derive(Deserialize)]
struct Annotation {
    #[serde(default)]
    result: Vec<Region>,
}

#[derive(Deserialize)]
struct Region {
    #[serde(default)]
    id: serde_json::Value,
    #[serde(rename = "type")]
    kind: String,
    original_width: Option<Side>,
    original_height: Option<Side>,
    #[serde(default)]
    value: Value,
}

#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
struct Value {
    frames_count: usize,
    labels: Vec<String>,
    sequence: Vec<Key>,
}

#[derive(Deserialize)]
struct Key {
    frame: usize,
    #[serde(default = "yes")]
    enabled: bool,
    #[serde(default)]
    rotation: f64,
    x: f64,
    y: f64,
    width: f64,
    height: f64,
}

fn yes() -> bool {
    true
}

/// Boxes move linearly between key frames; a key frame that is not `enabled` is the last one of its stretch.
pub(super) fn read(path: &Path, size: Option<Size>) -> Result<Boxes> {
    let Size { width, height } = sized(path, size)?;
    let text = files::read_text(path, files::TEXT)?;
    memory::check(format_args!("{}: JSON of {} bytes", path.display(), text.len()), PARSED * text.len() as u64)?;
    let tasks: Vec<Task> = serde_json::from_str(&text)
        .map_err(|e| Error::malformed(path, format!("expected a list of Label Studio's tasks: {e}")))?;
    let drawn: Vec<&Annotation> = tasks.iter().flat_map(Task::drawn).collect();
    if drawn.len() > 1 {
        let problem =
            format!("it has {} annotations; expected one: export one task, and delete other annotations", drawn.len());
        return Err(Error::malformed(path, problem));
    }
    let (tracks, other): (Vec<&Region>, Vec<&Region>) =
        drawn.iter().flat_map(|a| &a.result).partition(|region| region.kind == "videorectangle");
    let last =
        |region: &&Region| region.value.sequence.iter().map(|key| key.frame).chain([region.value.frames_count]).max();
    let frames = tracks.iter().filter_map(last).max().unwrap_or(0).min(MOST);
    let size = tracks.iter().find_map(|region| size_of(region.original_width, region.original_height));
    let (mut boxes, mut turned) = (Boxes { frames, size, ..Boxes::default() }, 0);
    for (id, region) in ids(&tracks).into_iter().zip(&tracks) {
        let mut keys = KeyFrames::new();
        for key in &region.value.sequence {
            let wrong = |problem: &str| Error::malformed(path, format!("region {id}, frame {}: {problem}", key.frame));
            if !(1..=MOST).contains(&key.frame) {
                return Err(wrong(&format!("expected a frame from 1 to {MOST}")));
            }
            let per_cent =
                [key.x * width as f64, key.y * height as f64, key.width * width as f64, key.height * height as f64];
            let [x, y, w, h] = per_cent.map(|value| value / 100.0);
            let bbox = BBox::new(x, y, w, h);
            bbox.check().map_err(|e| wrong(&e.to_string()))?;
            turned += usize::from(key.rotation != 0.0);
            if keys.insert(key.frame - 1, Some(bbox)).flatten().is_some_and(|other| other != bbox) {
                return Err(Error::malformed(path, twice(key.frame - 1, id)));
            }
            if !key.enabled && (region.value.frames_count == 0 || key.frame < region.value.frames_count) {
                keys.entry(key.frame).or_insert(None);
            }
        }
        boxes.fill(path, id, &keys)?;
        if let Some(label) = region.value.labels.first() {
            boxes.labels.insert(id, label.clone());
        }
        boxes.keys.insert(id, keys);
    }
    boxes.lose(turned, "boxes are rotated; they are taken upright");
    boxes.lose(other.len(), "other regions are left out");
    Ok(boxes)
}

/// The ids that [`write`] gave to the regions. A region without one, or with that of an earlier region, gets the next unused number from 1.
fn ids(regions: &[&Region]) -> Vec<i64> {
    let own = |region: &&Region| region.id.as_str()?.strip_prefix(REGION)?.parse().ok().filter(|id: &i64| *id >= 0);
    let mut used = BTreeSet::new();
    let kept: Vec<Option<i64>> = regions.iter().map(|region| own(region).filter(|id| used.insert(*id))).collect();
    let mut unused = (1..).filter(|id| !used.contains(id));
    kept.into_iter().filter_map(|id| id.or_else(|| unused.next())).collect()
}

fn sized(path: &Path, size: Option<Size>) -> Result<Size> {
    size.ok_or_else(|| {
        Error::malformed(path, "Label Studio's boxes are in per cent of the picture; give --size WIDTHxHEIGHT")
    })
}

/// Writes every box as a key frame of a prediction, which Label Studio imports beside the video.
pub(super) fn write(boxes: &mut Boxes, path: &Path) -> Result<()> {
    boxes.check_ids("Label Studio's format")?;
    boxes.lose_confidence();
    let Size { width, height } = sized(path, boxes.size)?;
    let rate = boxes.rate.unwrap_or(RATE);
    let mut regions = vec![];
    for own in boxes.by_target().chunk_by(|a, b| a.id == b.id) {
        let id = own[0].id;
        let followed = |i: usize| own.get(i + 1).is_some_and(|next| next.frame == own[i].frame + 1);
        let sequence = own.iter().enumerate().map(|(i, b)| {
            let BBox { x, y, w, h } = b.bbox;
            let [x, w] = [x, w].map(|value| 100.0 * value / width as f64);
            let [y, h] = [y, h].map(|value| 100.0 * value / height as f64);
            let enabled = followed(i);
            let (frame, time) = (b.frame + 1, (b.frame + 1) as f64 / rate);
            json!({
                "frame": frame, "time": time, "enabled": enabled, "rotation": 0, "x": x, "y": y, "width": w, "height": h
            })
        });
        let (sequence, label) = (list(sequence), json!(boxes.label(id)));
        let (count, duration) = (boxes.frames, json!(boxes.frames as f64 / rate));
        regions.push(format!(
            "{{\"from_name\":\"box\",\"id\":\"{REGION}{id}\",\"to_name\":\"video\",\"type\":\"videorectangle\",\"value\":\
             {{\"duration\":{duration},\"framesCount\":{count},\"labels\":[{label}],\"sequence\":{sequence}}}}}"
        ));
    }
    let regions = list(regions.into_iter());
    let tasks = format!("[{{\"data\":{{\"video\":\"\"}},\"predictions\":[{{\"result\":{regions}}}]}}]\n");
    boxes.lost.push("the address of the video is not known; fill in data.video before the import".into());
    files::write(path, tasks.as_bytes())
}
