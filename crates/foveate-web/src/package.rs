//! The tracker of the JavaScript package: one target or many, without a page. It adds no algorithm.

use foveate_base::files::Nowhere;
use foveate_base::{Error, Result, memory};
use foveate_core::config::Config;
use foveate_core::geometry::{BBox, Size};
use foveate_core::scene::{Image, Pixels};
use foveate_core::{Detection, MultiTracker, Seen, Tracker};
use foveate_page::boxed;
use serde::Deserialize;
use serde_json::{Value, json};

/// A call of the package. The bytes of a picture or of a state come beside it.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields)]
enum Call {
    /// Creates a tracker of one target, or of many. `config` is a name or TOML.
    Create { many: bool, config: String, seed: Option<u64> },
    /// Starts on the target in this box of a picture.
    Init {
        picture: Size,
        #[serde(rename = "box", deserialize_with = "boxed")]
        bbox: BBox,
    },
    /// Tracks into the next picture. `detections` are left, top, width, height, and the score or null.
    Update { picture: Size, detections: Vec<([f64; 4], Option<f64>)> },
    /// Shows a picture without tracking.
    Skip { picture: Size },
    /// Sets the time of the next picture.
    SetTime { seconds: f64 },
    /// Moves the target into this box.
    ResetAt {
        #[serde(rename = "box", deserialize_with = "boxed")]
        bbox: BBox,
    },
    /// Adds a target in the picture of the last update, or restarts one.
    Add {
        picture: Size,
        id: Option<u64>,
        #[serde(rename = "box", deserialize_with = "boxed")]
        bbox: BBox,
    },
    /// Ends a track.
    Remove { id: u64 },
    /// Requests the state.
    Save {},
    /// Restores the state in the bytes.
    Load {},
}

#[derive(Debug)]
enum Kind {
    One(Box<Tracker>),
    Many(Box<MultiTracker>),
}

/// A tracker of one target or of many, called by messages.
#[derive(Debug, Default)]
pub struct Package {
    kind: Option<Kind>,
    /// The last picture, whose planes the next one reuses.
    image: Option<Image>,
}

impl Package {
    /// Answers a message, both in JSON. `bytes` are the pixels of its picture, row by row without gaps (1 byte a pixel: grey; 3: red, green,
    /// blue; 4: and one that is not read), or the state to load. A request that cannot be fulfilled gives `{"error": why, "code": kind}`.
    pub fn ask(&mut self, message: &str, bytes: &[u8]) -> String {
        let call = serde_json::from_str(message).map_err(|error| Error::Invalid(format!("a call: {error}")));
        let answer = call.and_then(|call| self.act(call, bytes));
        answer.unwrap_or_else(|error| json!({ "error": error.to_string(), "code": code(&error) })).to_string()
    }

    fn act(&mut self, call: Call, bytes: &[u8]) -> Result<Value> {
        if let Call::Create { many, config, seed } = call {
            let blueprint = Config::named_or_parsed(&config)?.check(&Nowhere)?;
            let seed = seed.unwrap_or(blueprint.config().seed);
            self.kind = Some(match many {
                true => Kind::Many(Box::new(blueprint.multi_tracker(seed)?)),
                false => Kind::One(Box::new(blueprint.tracker(seed)?)),
            });
            return Ok(json!({}));
        }
        let Self { kind, image } = self;
        let kind = kind.as_mut().ok_or_else(|| Error::Invalid("there is no tracker; create one".into()))?;
        match (call, kind) {
            (Call::Init { picture, bbox }, Kind::One(tracker)) => {
                tracker.init(read(image, picture, bytes)?, bbox)?;
                Ok(json!({}))
            }
            (Call::Update { picture, .. }, Kind::One(tracker)) => {
                Ok(json!({ "result": result(&tracker.update(read(image, picture, bytes)?)?) }))
            }
            (Call::Update { picture, detections }, Kind::Many(tracker)) => {
                let given = |&([x, y, w, h], score): &([f64; 4], Option<f64>)| {
                    Detection::new(BBox::new(x, y, w, h), score.unwrap_or(f64::NAN))
                };
                let detections: Vec<_> = detections.iter().map(given).collect();
                tracker.update(read(image, picture, bytes)?, &detections)?;
                Ok(json!({ "results": tracker.targets().iter().map(result).collect::<Vec<_>>() }))
            }
            (Call::Skip { picture }, Kind::One(tracker)) => {
                tracker.skip(read(image, picture, bytes)?)?;
                Ok(json!({}))
            }
            (Call::Skip { picture }, Kind::Many(tracker)) => {
                tracker.skip(read(image, picture, bytes)?);
                Ok(json!({}))
            }
            (Call::SetTime { seconds }, Kind::One(tracker)) => {
                tracker.set_time(seconds);
                Ok(json!({}))
            }
            (Call::ResetAt { bbox }, Kind::One(tracker)) => {
                tracker.reset_at(bbox)?;
                Ok(json!({}))
            }
            (Call::Add { picture, id, bbox }, Kind::Many(tracker)) => {
                Ok(json!({ "id": tracker.add(read(image, picture, bytes)?, id, bbox)? }))
            }
            (Call::Remove { id }, Kind::Many(tracker)) => Ok(json!({ "removed": tracker.remove(id) })),
            (Call::Save {}, Kind::One(tracker)) => Ok(json!({ "state": tracker.save().to_string() })),
            (Call::Save {}, Kind::Many(tracker)) => Ok(json!({ "state": tracker.save().to_string() })),
            (Call::Load {}, kind) => {
                let state = String::from_utf8_lossy(bytes).parse()?;
                match kind {
                    Kind::One(tracker) => tracker.load(&state)?,
                    Kind::Many(tracker) => tracker.load(&state)?,
                }
                Ok(json!({}))
            }
            _ => Err(Error::Invalid("this kind of tracker has no such call".into())),
        }
    }
}

/// Splits pixels into planes. If the picture before had the same size, it allocates nothing.
fn read<'a>(kept: &'a mut Option<Image>, size: Size, bytes: &[u8]) -> Result<&'a Image> {
    let Size { width, height } = size;
    let area = width.checked_mul(height).filter(|&area| area > 0);
    let depth = area.filter(|&area| bytes.len().is_multiple_of(area)).map(|area| bytes.len() / area);
    let pixels = match depth {
        Some(1) => Pixels::Grey,
        Some(3) => Pixels::Rgb,
        Some(4) => Pixels::Rgba,
        _ => {
            return Err(Error::Invalid(format!(
                "the picture is {size} and its data has {} bytes; give 1 (grey), 3 (RGB) or 4 (RGBA) bytes for each pixel",
                bytes.len()
            )));
        }
    };
    let stride = bytes.len() / height;
    match kept {
        Some(image) if image.size() == size => image.refill(pixels, size, stride, bytes)?,
        _ => {
            memory::check_picture(width, height)?;
            *kept = Some(Image::from_pixels(pixels, size, stride, bytes)?);
        }
    }
    Ok(kept.as_ref().expect("it was put there"))
}

fn result(seen: &Seen<'_>) -> Value {
    let BBox { x, y, w, h } = seen.bbox;
    json!({
        "id": seen.id, "box": { "x": x, "y": y, "width": w, "height": h }, "status": seen.status.name(), "usable": seen.is_usable(),
        "pLost": seen.p_lost, "covariance": seen.covariance, "detection": seen.detection_index,
    })
}

/// Returns the kind of an error, as `FoveateError.code` has it.
fn code(error: &Error) -> &'static str {
    match error {
        Error::Invalid(_) => "invalid",
        Error::Config(_) => "config",
        Error::Memory(_) => "memory",
        _ => "internal",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(package: &mut Package, message: &Value, bytes: &[u8]) -> Value {
        serde_json::from_str(&package.ask(&message.to_string(), bytes)).expect("JSON")
    }

    #[test]
    fn pixels_of_one_three_and_four_bytes_are_read_and_others_refused() {
        let mut package = Package::default();
        let init = json!({ "op": "init", "picture": [8, 6], "box": [1, 1, 4, 3] });
        assert_eq!(ask(&mut package, &init, &[0; 48])["code"], "invalid", "there is no tracker");
        assert_eq!(ask(&mut package, &json!({ "op": "create", "many": false, "config": "fast" }), &[]), json!({}));
        for (bytes, good) in [(48, true), (96, false), (144, true), (192, true), (240, false), (191, false), (0, false)]
        {
            let answer = ask(&mut package, &init, &vec![7; bytes]);
            assert_eq!(answer["error"].is_null(), good, "{bytes}: {answer}");
        }
        assert_eq!(ask(&mut package, &json!({ "op": "set_time", "seconds": 0.5 }), &[]), json!({}));
        let add = json!({ "op": "add", "picture": [8, 6], "box": [1, 1, 4, 3], "id": null });
        assert_eq!(ask(&mut package, &add, &[0; 48])["code"], "invalid");
        let other = json!({ "op": "create", "many": true, "config": "natural\nkind = 1" });
        assert_eq!(ask(&mut package, &other, &[])["code"], "config");
    }
}
