//! Networks as detectors.

use foveate::config::{Config, DetectorConfig};
use foveate::conformance;
use foveate::geometry::BBox;
use foveate::scene::object_detector::{Layout, Settings};
use foveate::scene::{Detection, Image, ObjectDetector};
use foveate::{MultiTracker, Result};

use super::networks::boxes;
use super::{File, picture, said, truth};

/// Rows of centre x, centre y, width, height and scores of two classes as YOLOv8 lays them out, and where scores are.
fn yolov8(rows: &[[f32; 6]]) -> (Vec<i64>, Vec<f32>, Vec<f32>) {
    let n = rows.len();
    let turned = (0..6 * n).map(|i| rows[i % n][i / n]).collect();
    let scored = (0..6 * n).map(|i| if i / n < 4 { 0.0 } else { 1.0 }).collect();
    (vec![1, 6, n as i64], turned, scored)
}

/// The same as YOLOv5 does: how sure it is that there is an object, and of the class if so.
fn yolov5(rows: &[[f32; 6]]) -> (Vec<i64>, Vec<f32>, Vec<f32>) {
    let row = |&[x, y, w, h, a, b]: &[f32; 6]| {
        let object = a.max(b).max(f32::MIN_POSITIVE);
        [x, y, w, h, object, a / object, b / object]
    };
    let scored = rows.iter().flat_map(|_| [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]).collect();
    (vec![1, rows.len() as i64, 7], rows.iter().flat_map(row).collect(), scored)
}

/// The best class's box by its corners, as networks that choose by themselves do.
fn end_to_end(rows: &[[f32; 6]]) -> (Vec<i64>, Vec<f32>, Vec<f32>) {
    let row = |&[x, y, w, h, a, b]: &[f32; 6]| {
        [x - w / 2.0, y - h / 2.0, x + w / 2.0, y + h / 2.0, a.max(b), f32::from(u8::from(b > a))]
    };
    let scored = rows.iter().flat_map(|_| [0.0, 0.0, 0.0, 0.0, 1.0, 0.0]).collect();
    (vec![1, rows.len() as i64, 6], rows.iter().flat_map(row).collect(), scored)
}

/// Seven boxes in an input of 64 × 64 that a picture of 120 × 90 fills from line 8 to 56 (scale 8/15): two that overlap, one of the other
/// class, a weak one, one that reaches past the picture, one in the padding, and nothing.
const ROWS: [[f32; 6]; 7] = [
    [20.0, 24.0, 16.0, 16.0, 0.9, 0.1],
    [21.0, 24.0, 16.0, 16.0, 0.8, 0.0],
    [44.0, 40.0, 8.0, 16.0, 0.0, 0.7],
    [30.0, 50.0, 8.0, 8.0, 0.2, 0.1],
    [60.0, 52.0, 16.0, 16.0, 0.5, 0.0],
    [32.0, 4.0, 8.0, 6.0, 0.6, 0.0],
    [10.0, 40.0, 4.0, 4.0, 0.0, 0.0],
];

const INPUT: [i64; 4] = [1, 3, 64, 64];

fn settings(layout: Layout) -> Settings {
    Settings { layout, ..Settings::of("d.onnx") }
}

fn detect(settings: &Settings, file: &[u8], image: &Image) -> Result<Vec<Detection>> {
    let mut detector = DetectorConfig::Onnx(settings.clone()).read(&File(file.to_vec()))?.detector();
    let mut found = vec![];
    detector.detect(image, &mut found);
    Ok(found)
}

fn near(found: &[Detection], wanted: &[(BBox, f64)], scores: f64) {
    let off =
        |a: &BBox, b: &BBox| [a.x - b.x, a.y - b.y, a.w - b.w, a.h - b.h].map(f64::abs).into_iter().fold(0.0, f64::max);
    let same =
        |(d, (b, score)): (&Detection, &(BBox, f64))| off(&d.bbox, b) < 1e-3 && (d.score - scores * score).abs() < 1e-4;
    assert!(found.len() == wanted.len() && found.iter().zip(wanted).all(same), "{found:?}, not {wanted:?}");
}

/// Letterbox, threshold, classes and suppression by hand, in every layout.
#[test]
fn boxes_are_where_the_layout_puts_them() {
    // Black and white: the contrast is 1, whatever is around.
    let image =
        Image::new(120, 90, 3, (0..3 * 120 * 90).map(|i| if i % 120 < 60 { 0 } else { 255 }).collect()).expect("bytes");
    let box_of = |x: f64, y: f64, w: f64, h: f64| {
        let (s, left, top) = (120.0 / 64.0, x - w / 2.0, y - h / 2.0 - 8.0);
        BBox { x: s * left, y: s * top, w: s * w, h: s * h }
    };
    let first = (box_of(20.0, 24.0, 16.0, 16.0), 0.9);
    let other = (box_of(44.0, 40.0, 8.0, 16.0), 0.7);
    let cut = (BBox { x: 97.5, y: 67.5, w: 22.5, h: 22.5 }, 0.5);
    let second = (box_of(21.0, 24.0, 16.0, 16.0), 0.8);
    let weak = (box_of(30.0, 50.0, 8.0, 8.0), 0.2);
    for (layout, (sides, numbers, scored)) in
        [(Layout::Yolov8, yolov8(&ROWS)), (Layout::Yolov5, yolov5(&ROWS)), (Layout::EndToEnd, end_to_end(&ROWS))]
    {
        let file = boxes(&INPUT, &sides, &numbers, &scored);
        let found = |settings: Settings| detect(&settings, &file, &image).expect("a detector");
        near(&found(settings(layout)), &[first, other, cut], 1.0);
        near(&found(Settings { overlap: 1.0, ..settings(layout) }), &[first, second, other, cut], 1.0);
        near(&found(Settings { confidence: 0.1, ..settings(layout) }), &[first, other, cut, weak], 1.0);
        near(&found(Settings { classes: vec![1], ..settings(layout) }), &[other], 1.0);
        near(&found(Settings { most: 2, ..settings(layout) }), &[first, other], 1.0);
        // Grey pictures go to all planes.
        near(&detect(&settings(layout), &file, &image.to_grey()).expect("a detector"), &[first, other, cut], 1.0);
    }
    // One plane, with open sides, which are 640 by default.
    let (sides, numbers, scored) = yolov8(&ROWS);
    let open = boxes(&[0, 1, 0, 0], &sides, &numbers, &scored);
    let of_64 = Settings { side: 64, ..settings(Layout::Yolov8) };
    near(&detect(&of_64, &open, &image).expect("a detector"), &[first, other, cut], 1.0);
}

#[test]
fn it_keeps_the_law() {
    let _: Option<ObjectDetector> = None;
    let (sides, numbers, scored) = yolov8(&ROWS);
    let parts = DetectorConfig::Onnx(settings(Layout::Yolov8)).read(&File(boxes(&INPUT, &sides, &numbers, &scored)));
    let parts = parts.expect("a detector");
    conformance::detector(&|| parts.detector());
}

/// A file that is no detector, or another one, is refused with the reason.
#[test]
fn misfits_are_errors() {
    let (sides, numbers, scored) = yolov8(&ROWS);
    let says = |settings: &Settings, file: &[u8], parts: &[&str]| {
        let message = said(DetectorConfig::Onnx(settings.clone()).read(&File(file.to_vec())));
        assert!(parts.iter().all(|part| message.contains(part)), "{message:?} has not {parts:?}");
    };
    let auto = settings(Layout::Auto);
    let of = |input: &[i64], sides: &[i64]| boxes(input, sides, &numbers, &scored);
    says(&auto, &of(&[2, 3, 64, 64], &sides), &["d.onnx", "(2, 3, 64, 64)", "one picture"]);
    says(&auto, &of(&[1, 4, 64, 64], &sides), &["(1, 4, 64, 64)"]);
    says(&auto, &of(&[1, 3, 64], &sides), &["(1, 3, 64)"]);
    says(&auto, &of(&INPUT, &[1, 7, 6]), &["(1, 7, 6)", "detector.layout"]);
    says(&auto, &of(&INPUT, &[6, 7]), &["(6, 7)", "(1, boxes, 5 + classes)"]);
    says(&settings(Layout::EndToEnd), &of(&INPUT, &sides), &["(1, 6, 7)", "(1, boxes, 6)"]);
    says(&Settings { classes: vec![2], ..auto.clone() }, &of(&INPUT, &sides), &["detector.classes has 2", "0 to 1"]);
    says(&Settings { confidence: 1.5, ..auto.clone() }, &of(&INPUT, &sides), &["detector.confidence", "1.5"]);
    says(&Settings { side: 1 << 20, ..auto.clone() }, &of(&INPUT, &sides), &["detector.side"]);
    says(&Settings::of(""), &of(&INPUT, &sides), &["detector.model"]);
    let nan = boxes(&INPUT, &sides, &[f32::NAN; 42], &scored);
    says(&auto, &nan, &["d.onnx", "NaN"]);
}

/// Contrast is all that the network sees: boxes at the places of the target, whatever moves. As the proposal of one target they hold it
/// where the prior alone loses it, and they start the tracks of many.
#[test]
fn detections_are_proposals() {
    // At frame 30 the target is at (50, 45): 24 × 20; in the input at 8/15 of that and 8 down, if the picture is 120 × 90.
    let at = truth(30);
    let s = 64.0 / 120.0;
    let row = [
        (s * (at.x + at.w / 2.0)) as f32,
        (s * (at.y + at.h / 2.0) + 8.0) as f32,
        (s * at.w) as f32,
        (s * at.h) as f32,
        0.9,
        0.0,
    ];
    let (sides, numbers, scored) = yolov8(&[[row].as_slice(), &ROWS[3..4], &ROWS[6..]].concat().repeat(3));
    let file = File(boxes(&INPUT, &sides, &numbers, &scored));
    let config = |proposal: &str| {
        let text = format!(
            "seed = 3\nparticles = 100\ndynamics = {{ kind = \"autoregressive\", velocity = 0.02, position = 0.5 }}\n\
             retina = {{ kind = \"foveal\", side = 24, rings = [[24, 2]] }}\nencoder = {{ kind = \"raw\" }}\n\
             likelihood = {{ distance = \"cosine\", sharpness = 30 }}\npolicy = {{ kind = \"fixed\" }}\n{proposal}\n"
        );
        Config::parse(&text, "test").and_then(|config| config.check(&file)).expect("a good configuration")
    };
    // The target jumps by more than its size. `given` are detections from outside.
    let jump = |config: foveate::config::Blueprint, given: Option<&[Detection]>| {
        let mut tracker = config.tracker(1).expect("a checked configuration");
        tracker.init(&picture(0, 1), truth(0)).expect("a box in the picture");
        let boxes = (0..3).map(|_| match given {
            Some(given) => tracker.update_with(&picture(30, 1), given).expect("a picture of that size").bbox,
            None => tracker.update(&picture(30, 1)).expect("a picture of that size").bbox,
        });
        boxes.collect::<Vec<BBox>>()
    };
    const MIXTURE: &str = "proposal = { kind = \"mixture\" }";
    let alone = jump(config(""), None);
    let found = jump(config(&format!("{MIXTURE}\ndetector = {{ kind = \"onnx\", model = \"d.onnx\" }}")), None);
    let overlap = |boxes: &[BBox]| boxes[0].iou(&at);
    assert!(overlap(&alone) < 0.3 && overlap(&found) > 0.7, "{alone:?} by the prior alone, {found:?} with detections");
    let outside = detect(&Settings::of("d.onnx"), &file.0, &picture(30, 1)).expect("a detector");
    assert_eq!(outside.len(), 1, "{outside:?}");
    assert_eq!(
        found,
        jump(config(MIXTURE), Some(&outside)),
        "detections of the configuration's detector are as any other's"
    );

    let text = Config::builtin("multi").expect("it ships").expect("it is right").to_toml();
    let many = Config::parse(&format!("{text}\n[detector]\nkind = \"onnx\"\nmodel = \"d.onnx\"\n"), "test");
    let many = many.and_then(|config| config.check(&file)).expect("a good configuration");
    let mut many: MultiTracker = many.multi_tracker(1).expect("a checked configuration");
    let mut boxes = vec![];
    for _ in 0..10 {
        let frame = many.update(&picture(30, 1), &[]);
        boxes = frame.expect("a picture").iter().map(|t| t.bbox).collect();
    }
    assert!(boxes.len() == 1 && boxes[0].iou(&at) > 0.7, "{boxes:?}");
}
