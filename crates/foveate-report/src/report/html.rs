//! Shared parts of the pages of one target and of many: numbers, texts and pictures as HTML and JSON.

use base64::Engine as _;
use serde::Serialize;
use serde_json::{Value, json};

use crate::pictures::within;
use crate::template::Crop;
use foveate_base::text::visible_except;
use foveate_core::scene::Image;
use foveate_video::encode_jpeg;

/// The program's name and version on pages.
pub(super) const VERSION: &str = concat!("foveate ", env!("CARGO_PKG_VERSION"));
/// The style of the pages: colours, cards, buttons.
pub const STYLE: &str = include_str!("style.css");
/// The mark at the head of a page.
pub const BRAND: &str = include_str!("brand.html");
/// The common start of every page's scripts: elements, canvases, colours, clouds of particles.
pub const SCRIPT: &str = include_str!("shared.js");
/// Longer side of a picture on a page, pixels.
const LONGEST: usize = 480;
/// JPEG quality of the frames, and of the template.
const QUALITY: u8 = 62;
const TEMPLATE_QUALITY: u8 = 88;

/// Returns a page: `template` with its parts, the title, the data and the scripts that read them. The title has only the source's name, so
/// that it does not depend on the working directory.
pub(super) fn page(template: &str, source: &str, data: &Value, scripts: &[&str], parts: &[(&str, String)]) -> String {
    // Without any "<", the data cannot end the script element or start a comment.
    let data = data.to_string().replace('<', "\\u003c");
    let mut all = vec![
        ("title", format!("foveate: {}", escape(name(source)))),
        ("name", escape(name(source))),
        ("style", STYLE.into()),
        ("brand", BRAND.into()),
        ("transport", include_str!("transport.html").into()),
        ("data", data),
        ("script", [&[SCRIPT, include_str!("common.js")], scripts].concat().concat()),
    ];
    all.extend_from_slice(parts);
    fill(template, &all)
}

/// Returns the last component of a path or address.
fn name(source: &str) -> &str {
    source.rsplit(['/', '\\']).find(|part| !part.is_empty()).unwrap_or(source)
}

/// Escapes text for HTML: `&`, `<`, `>` and `"`; and shows control characters, line feeds and tabs excepted.
pub fn escape(text: &str) -> String {
    let text = visible_except(text, &['\n', '\t']);
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Replaces the places `{{name}}` of a template by parts, in one pass: a part is inserted unchanged, even if it contains `{{`.
///
/// # Panics
/// A place has no part, or no end.
pub fn fill(template: &str, parts: &[(&str, String)]) -> String {
    let mut out = String::with_capacity(template.len() + parts.iter().map(|p| p.1.len()).sum::<usize>());
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        let (name, after) = after.split_once("}}").expect("every {{ of the page has its }}");
        out.push_str(before);
        out.push_str(&parts.iter().find(|p| p.0 == name).expect("every place of the page has its part").1);
        rest = after;
    }
    out + rest
}

/// Rounds a number for a page to five digits; a number that is not finite becomes null.
pub(super) fn short(value: f64) -> Value {
    if !value.is_finite() {
        return Value::Null;
    }
    if value.fract() == 0.0 && value.abs() < 1e9 {
        return json!(value as i64);
    }
    json!(format!("{value:.5e}").parse::<f64>().expect("printed by Rust, read by Rust"))
}

/// Encodes bytes as base64.
pub(super) fn base64(bytes: &[u8]) -> String {
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// Returns the number of bytes that a base64 text encodes.
pub(super) fn bytes_of(text: &str) -> usize {
    text.len() / 4 * 3
}

/// Encodes a frame for a page: a small JPEG in base64.
pub(super) fn picture(image: &Image) -> String {
    base64(&encode_jpeg(&within(image, LONGEST), QUALITY))
}

/// The target in the first frame.
#[derive(Serialize)]
pub(super) struct Template {
    pub jpeg: String,
    /// Left, top, right, bottom in template units.
    #[serde(rename = "box")]
    pub bounds: [f64; 4],
}

impl Template {
    pub(super) fn new(crop: &Crop) -> Self {
        let jpeg = base64(&encode_jpeg(&within(&crop.image, LONGEST), TEMPLATE_QUALITY));
        Self { jpeg, bounds: crop.bounds }
    }
}

/// Returns the words after `prefix` in a script, for tests: for `series.ess` and `series.`, it returns `ess`.
#[cfg(test)]
pub(super) fn words_after<'a>(script: &'a str, prefix: &str) -> Vec<&'a str> {
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '$';
    let starts = script.match_indices(prefix).map(|(at, _)| at);
    let whole = starts.filter(|&at| !script[..at].ends_with(|c| is_word(c) || c == '.'));
    let rest = whole.map(|at| &script[at + prefix.len()..]);
    rest.map(|rest| &rest[..rest.find(|c| !is_word(c)).unwrap_or(rest.len())]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_put_in_once() {
        let parts = [("a", "{{b}} {{".to_owned()), ("b", "B".to_owned())];
        assert_eq!(fill("x{{a}}y{{b}}z", &parts), "x{{b}} {{yBz");
    }

    #[test]
    fn the_title_has_the_name_alone() {
        for source in [
            "a&b.mp4",
            "clips/a&b.mp4",
            "/home/me/clips/a&b.mp4",
            "C:\\clips\\a&b.mp4",
            "clips/a&b.mp4/",
            "rtsp://cam/a&b.mp4",
        ] {
            let page = page("{{title}}", source, &Value::Null, &[], &[]);
            assert_eq!(page, "foveate: a&amp;b.mp4", "{source}");
        }
        assert_eq!(page("{{title}}", "/", &Value::Null, &[], &[]), "foveate: /");
    }

    #[test]
    fn numbers_are_short_and_none_is_null() {
        assert_eq!(
            json!([short(1.0 / 3.0), short(-0.0), short(12.0), short(f64::NAN)]).to_string(),
            "[0.333333,0,12,null]"
        );
        assert_eq!(short(123_456.789).to_string(), "123457.0");
    }
}
