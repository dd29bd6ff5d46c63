//! COCO's JSON for one video: one image per frame, one annotation per box; `track_id` identifies the target.

use std::collections::BTreeMap;
use std::path::Path;

use foveate::video::mot::TrackBox;
use foveate::{BBox, Error, Result, files, memory};
use serde::de::{IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::boxes::{Side, size_of};
use super::{Boxes, list};

#[derive(Deserialize)]
struct File {
    images: Vec<Image>,
    annotations: Vec<Annotation>,
    #[serde(default)]
    categories: Vec<Category>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Category {
    id: i64,
    name: String,
}

#[derive(Deserialize)]
struct Image {
    id: i64,
    /// Index of the frame in its video.
    frame_id: Option<i64>,
    width: Option<Side>,
    height: Option<Side>,
}

#[derive(Deserialize)]
struct Annotation {
    image_id: i64,
    category_id: Option<i64>,
    bbox: [f64; 4],
    track_id: Option<i64>,
    score: Option<f64>,
    #[serde(default)]
    segmentation: Filled,
    #[serde(default)]
    iscrowd: Filled,
}

/// Whether a value is none of null, false, 0 and the empty list. The value is not kept: it may be large.
#[derive(Default)]
struct Filled(bool);

impl<'de> Deserialize<'de> for Filled {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        deserializer.deserialize_any(AnyValue).map(Self)
    }
}

struct AnyValue;

impl<'de> Visitor<'de> for AnyValue {
    type Value = bool;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("any value")
    }
    fn visit_unit<E>(self) -> std::result::Result<bool, E> {
        Ok(false)
    }
    fn visit_bool<E>(self, value: bool) -> std::result::Result<bool, E> {
        Ok(value)
    }
    fn visit_i64<E>(self, value: i64) -> std::result::Result<bool, E> {
        Ok(value != 0)
    }
    fn visit_u64<E>(self, value: u64) -> std::result::Result<bool, E> {
        Ok(value != 0)
    }
    fn visit_f64<E>(self, value: f64) -> std::result::Result<bool, E> {
        Ok(value != 0.0)
    }
    fn visit_str<E>(self, value: &str) -> std::result::Result<bool, E> {
        Ok(!value.is_empty())
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> std::result::Result<bool, A::Error> {
        let mut filled = false;
        while list.next_element::<IgnoredAny>()?.is_some() {
            filled = true;
        }
        Ok(filled)
    }
    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<bool, A::Error> {
        while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
        Ok(true)
    }
}

/// Bytes in memory for each of the text, at most: of an annotation with nothing but an image and a box.
const PARSED: u64 = 8;

/// A frame is the `frame_id` of its image; these count from 1 if the least is 1, as in files that [`write`] makes, and else
/// from 0. If an image has no `frame_id`, the frames are the images in the order of their ids.
pub(super) fn read(path: &Path) -> Result<Boxes> {
    let text = files::read_text(path, files::TEXT)?;
    memory::check(format_args!("{}: JSON of {} bytes", path.display(), text.len()), PARSED * text.len() as u64)?;
    let file: File = serde_json::from_str(&text)
        .map_err(|e| Error::malformed(path, format!("expected COCO's images and annotations: {e}")))?;
    let ordered = file.images.iter().all(|image| image.frame_id.is_some());
    let mut order: Vec<(i64, i64)> =
        file.images.iter().map(|i| (if ordered { i.frame_id.unwrap_or(0) } else { i.id }, i.id)).collect();
    order.sort_unstable();
    let is_twice = |pair: &[(i64, i64)]| pair[0].0 == pair[1].0;
    if let Some(pair) = order.windows(2).find(|pair| is_twice(pair)) {
        return Err(Error::malformed(path, format!("two images have the frame_id {}; expected one video", pair[0].0)));
    }
    let first = i64::from(order.first().is_some_and(|(frame_id, _)| *frame_id == 1));
    let mut frames: BTreeMap<i64, usize> = BTreeMap::new();
    for (rank, (frame_id, id)) in order.iter().enumerate() {
        let frame = if ordered { usize::try_from(frame_id.saturating_sub(first)) } else { Ok(rank) };
        let wrong = |_| Error::malformed(path, format!("image {id}: expected a frame_id from 0 on, found {frame_id}"));
        if frames.insert(*id, frame.map_err(wrong)?).is_some() {
            return Err(Error::malformed(path, "two images have the same id"));
        }
    }
    let length = frames.values().max().map_or(0, |last| last.saturating_add(1));
    let size = file.images.iter().find_map(|image| size_of(image.width, image.height));
    let names: BTreeMap<i64, &str> = file.categories.iter().map(|c| (c.id, c.name.as_str())).collect();
    let (mut boxes, mut unnamed) = (Boxes { frames: length, size, ..Boxes::default() }, 0);
    for (i, a) in file.annotations.iter().enumerate() {
        let wrong = |what: String| Error::malformed(path, format!("annotation {}: {what}", i + 1));
        let frame = *frames.get(&a.image_id).ok_or_else(|| wrong(format!("there is no image {}", a.image_id)))?;
        let [x, y, w, h] = a.bbox;
        let bbox = BBox::new(x, y, w, h);
        bbox.check().map_err(|e| wrong(e.to_string()))?;
        if let Some(name) = a.category_id.and_then(|id| names.get(&id)) {
            let label = a.track_id.map(|id| boxes.labels.entry(id).or_insert_with(|| (*name).to_owned()));
            unnamed += usize::from(label.is_none_or(|label| label != name));
        }
        boxes.tracks.push(TrackBox { frame, id: a.track_id.unwrap_or(-1), bbox, confidence: a.score.unwrap_or(1.0) });
    }
    let nameless = file.images.iter().filter(|image| image.frame_id.is_none()).count();
    boxes.lose(nameless, "images have no frame_id; frames are the images in the order of their ids");
    let count = |such: &dyn Fn(&Annotation) -> bool| file.annotations.iter().filter(|a| such(a)).count();
    boxes.lose(count(&|a| a.track_id.is_none()), "boxes have no track_id: they are detections, of the id -1");
    boxes.lose(count(&|a| a.segmentation.0), "segmentations are left out");
    boxes.lose(count(&|a| a.iscrowd.0), "boxes are crowds; that is left out");
    boxes.lose(
        if names.len() > 1 { unnamed } else { 0 },
        "boxes differ from the category of their target, or have no target",
    );
    Ok(boxes)
}

pub(super) fn write(boxes: &mut Boxes, path: &Path) -> Result<()> {
    let labels: BTreeMap<i64, String> = boxes.ids().into_iter().map(|id| (id, boxes.label(id))).collect();
    let mut categories: Vec<&String> = labels.values().collect();
    categories.sort_unstable();
    categories.dedup();
    let images =
        (1..=boxes.frames).map(|n| serde_json::json!({"id": n, "frame_id": n, "file_name": format!("{n:06}.jpg")}));
    let annotation = |(i, b): (usize, &TrackBox)| {
        let BBox { x, y, w, h } = b.bbox;
        let category = 1 + categories.binary_search(&&labels[&b.id]).expect("every label is a category");
        let mut value = serde_json::json!({
            "id": i + 1, "image_id": b.frame + 1, "category_id": category, "bbox": [x, y, w, h], "area": w * h, "iscrowd": 0,
            "score": b.confidence,
        });
        if b.id >= 0 {
            value["track_id"] = b.id.into();
        }
        value
    };
    let text = format!(
        "{{\"annotations\":{},\"categories\":{},\"images\":{}}}\n",
        list(boxes.tracks.iter().enumerate().map(annotation)),
        list((1..).zip(&categories).map(|(id, name)| serde_json::json!({"id": id, "name": name}))),
        list(images)
    );
    boxes.lost.push("names (000001.jpg ...), widths and heights of the pictures are not known; fill them in".into());
    files::write(path, text.as_bytes())
}
