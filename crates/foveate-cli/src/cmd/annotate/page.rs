//! The page of the frames to check: a picture of each, and the expected IoU over the video.

use std::fmt::Write;

use base64::Engine as _;
use foveate::report::chart::{Axis, Chart, Mark, render};
use foveate::report::draw::Drawing;
use foveate::report::{card, document, drawing, escape};
use foveate::scene::Image;
use foveate::video::encode_jpeg;
use foveate::{BBox, text::counted};

use super::check::{Check, Span};

/// Width and height of a chart, pixels.
const CHART: [f64; 2] = [640.0, 150.0];
/// The part of the picture that is shown: so many times the longer side of the box.
const AROUND: f64 = 4.0;
/// Sides of a shown part, pixels.
const SHOWN: usize = 240;

/// A frame to check with the part of its picture around the box, as JPEG.
pub(super) struct Shown {
    pub check: Check,
    pub jpeg: Vec<u8>,
}

/// The part of a frame around a box, with the box; black outside of the picture.
pub(super) fn part(image: &Image, bbox: &BBox) -> Vec<u8> {
    let (cx, cy) = bbox.centre();
    let scale = SHOWN as f64 / (AROUND * bbox.w.max(bbox.h)).max(16.0);
    // Edges of pixels: the centre of the box is in the middle of the page.
    let [left, top] = [cx, cy].map(|middle| middle + 0.5 - SHOWN as f64 / 2.0 / scale);
    let at = |from: f64, i: usize, side: usize| {
        let pixel = (from + (i as f64 + 0.5) / scale).floor();
        (pixel >= 0.0 && pixel < side as f64).then_some(pixel as usize)
    };
    let mut data = vec![];
    for p in 0..image.planes() {
        for (y, x) in (0..SHOWN).flat_map(|y| (0..SHOWN).map(move |x| (y, x))) {
            let place = at(left, x, image.width()).zip(at(top, y, image.height()));
            data.push(place.map_or(0, |(x, y)| image.at(p, x, y)));
        }
    }
    let part = Image::new(SHOWN, SHOWN, image.planes(), data).expect("as many bytes as pixels");
    let mut page = Drawing::new(SHOWN, SHOWN, [0; 3]);
    page.paste(&part, 0, 0, SHOWN, SHOWN);
    let (x, y) = ((bbox.x - left) * scale, (bbox.y - top) * scale);
    let (w, h) = (bbox.w * scale, bbox.h * scale);
    page.outline(&[(x, y), (x + w, y), (x + w, y + h), (x, y + h)], 2.0, [255, 220, 60], 1.0);
    encode_jpeg(page.image(), 80)
}

/// Returns the page. `verdict` is a sentence; `names` are the targets'.
pub(super) fn page(
    title: &str,
    verdict: &str,
    names: &[String],
    spans: &[Span],
    keys: &[(usize, usize)],
    shown: &[Shown],
) -> String {
    let mut frames = String::from("<div class=\"grid\" style=\"display:flex;flex-wrap:wrap;gap:1rem\">\n");
    for (rank, Shown { check, jpeg }) in shown.iter().enumerate() {
        let picture = base64::engine::general_purpose::STANDARD.encode(jpeg);
        let (name, frame) = (escape(&names[check.target]), check.frame + 1);
        let _ = writeln!(
            frames,
            "<figure style=\"margin:0;max-width:{SHOWN}px\"><img alt=\"frame {frame} of {name}\" src=\"data:image/jpeg;base64,{picture}\" \
             style=\"max-width:100%\"><figcaption>{}. frame {frame}, {name}<br>expected IoU {:.2}; after it a mean of {:.3}</figcaption></figure>",
            rank + 1,
            check.iou,
            check.mean
        );
    }
    frames.push_str("</div>\n");
    if shown.is_empty() {
        frames = "<p>None. check.csv lists the frames whose correction would still help most.</p>\n".into();
    }
    let end = spans.iter().map(|span| span.from + span.boxes.len()).max().unwrap_or(1);
    let charts: String = names
        .iter()
        .enumerate()
        .map(|(target, name)| {
            let own: Vec<&Span> = spans.iter().filter(|span| span.target == target).collect();
            let keys: Vec<usize> = keys.iter().filter(|(of, _)| *of == target).map(|(_, frame)| *frame).collect();
            let label = format!("expected IoU of {name} over the frames");
            let count = counted(keys.len(), "key frame");
            format!("<p>{}, {count}</p>\n{}\n", escape(name), drawing(&chart(&own, &keys, end), &label))
        })
        .collect();
    let body = card("Check these frames first", &frames) + &card("Expected IoU; key frames are marked below", &charts);
    document(
        title,
        &escape(verdict),
        "To correct frames, add them to the key frames, and run the command again.",
        &body,
    )
}

/// A chart of the expected IoU over the frames.
fn chart(spans: &[&Span], keys: &[usize], end: usize) -> String {
    let line = |span: &&Span| {
        let points = span.boxes.iter().enumerate().map(|(i, joined)| ((span.from + i + 1) as f64, joined.iou));
        Mark::line("#0072b2", 1.5, points)
    };
    let keys = Mark::dots("#e69f00", 3.0, keys.iter().map(|frame| ((frame + 1) as f64, 0.0)));
    let marks = spans.iter().map(line).chain([keys]).collect();
    let x = Axis::new("frame").between(1.0, end.max(2) as f64);
    render(&[Chart { x, y: Axis::new("expected IoU").between(0.0, 1.0), marks, ..Chart::default() }], 1, CHART)
}
