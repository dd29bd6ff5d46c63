//! `foveate annotate`: boxes of all frames from those of a few.

use foveate::BBox;
use foveate::video::annotation::{format_truth, read_boxes};

use crate::place::{Place, errors};

const FRAMES: usize = 100;

/// A drawn scene, with its true boxes.
fn scene() -> (Place, Vec<BBox>) {
    let place = Place::new();
    place.done(["synth", "clutter", "--frames", "100", "--out", "scene"]);
    let truth = read_boxes(place.path("scene/groundtruth_rect.txt")).expect("it was written");
    (place, truth.into_iter().map(|bbox| bbox.expect("always in the picture")).collect())
}

/// Writes the true boxes of some frames as key frames.
fn write_keys(place: &Place, name: &str, truth: &[BBox], keys: &[usize]) {
    let boxes: Vec<Option<BBox>> = (0..truth.len()).map(|t| keys.contains(&t).then(|| truth[t])).collect();
    place.write(name, format_truth(&boxes));
}

fn annotate(place: &Place, keys: &str, out: &str, more: &[&str]) -> Vec<Option<BBox>> {
    let args = ["annotate", "scene", "--keyframes", keys, "--format", "otb", "--out", out, "--config", "digits"];
    place.done([&args[..], more].concat());
    read_boxes(place.path(&format!("{out}/boxes.txt"))).unwrap_or_default()
}

#[test]
fn key_frames_are_exact_and_the_others_are_tracked() {
    let (place, truth) = scene();
    let keys = [0, 50, 99];
    write_keys(&place, "keys.txt", &truth, &keys);
    let boxes = annotate(&place, "keys.txt", "out", &[]);
    assert_eq!(boxes.len(), FRAMES);
    for t in keys {
        assert_eq!(boxes[t], Some(truth[t]), "key frame {t}");
    }
    let iou = |t: usize| boxes[t].map_or(0.0, |bbox| bbox.iou(&truth[t]));
    let mean = (0..FRAMES).map(iou).sum::<f64>() / FRAMES as f64;
    assert!(mean > 0.8, "{mean}");
    // A straight line between the key frames misses the digit, which flies a parabola.
    let straight = |t: usize| {
        let (a, b) = if t < 50 { (0, 50) } else { (50, 99) };
        let share = (t - a) as f64 / (b - a) as f64;
        let at = |from: f64, to: f64| from + share * (to - from);
        BBox::new(at(truth[a].x, truth[b].x), at(truth[a].y, truth[b].y), truth[a].w, truth[a].h).iou(&truth[t])
    };
    assert!(mean > (0..FRAMES).map(straight).sum::<f64>() / FRAMES as f64 + 0.1);
    let check = place.text("out/check.csv");
    assert!(check.starts_with("rank,frame,id,expected_iou,gain,mean_after,least_after\n1,"), "{check}");
    let page = place.text("out/check.html");
    assert!(page.contains("Expected mean IoU") && page.contains("stroke=\"var(--target)\""));
    assert!(page.contains("No correction is needed") && page.contains("<p>None.") && !page.contains("image/jpeg"));
}

#[test]
fn the_page_shows_the_frames_that_need_a_correction() {
    let (place, truth) = scene();
    write_keys(&place, "keys.txt", &truth, &[99]);
    // A few particles lose the target on the way back.
    annotate(&place, "keys.txt", "out", &["--set", "particles=3"]);
    let page = place.text("out/check.html");
    let shown = page.matches("data:image/jpeg;base64,").count();
    let said = page.split("After the ").nth(1).expect("corrections are needed").trim_start_matches("first ");
    let needed = if said.starts_with("correction") {
        1
    } else {
        said.split(' ').next().and_then(|n| n.parse().ok()).unwrap_or(0)
    };
    assert!(shown > 0 && shown == needed.min(24), "{shown} of {needed}: {said:.80}");
}

#[test]
fn a_correction_changes_only_what_lies_between_its_neighbours() {
    let (place, truth) = scene();
    write_keys(&place, "keys.txt", &truth, &[0, 20, 40, 99]);
    let before = annotate(&place, "keys.txt", "before", &[]);
    let mut corrected = truth.clone();
    corrected[30].x += 5.0;
    write_keys(&place, "corrected.txt", &corrected, &[0, 20, 30, 40, 99]);
    let after = annotate(&place, "corrected.txt", "after", &[]);
    assert_eq!(after[30], Some(corrected[30]));
    for t in (0..=20).chain(40..FRAMES) {
        assert_eq!(before[t], after[t], "frame {t}");
    }
    assert_ne!(before[29], after[29]);
}

#[test]
fn results_do_not_depend_on_memory_or_threads() {
    let (place, truth) = scene();
    write_keys(&place, "keys.txt", &truth, &[10, 99]);
    let boxes = annotate(&place, "keys.txt", "out", &[]);
    assert!(boxes[0].is_some(), "before the first key frame, the track goes backwards");
    // With less memory than the pictures need, the backward track reads the video block by block.
    for more in [["--max-memory", "16M"], ["--threads", "1"]] {
        assert_eq!(annotate(&place, "keys.txt", "again", &more), boxes, "{more:?}");
    }
}

#[test]
fn a_target_out_of_the_picture_has_no_boxes_and_keeps_its_label() {
    let (place, truth) = scene();
    let shape = |t: usize, outside: u8| {
        let BBox { x, y, w, h } = truth[t];
        let (right, bottom) = (x + w, y + h);
        format!(
            "<box frame=\"{t}\" outside=\"{outside}\" occluded=\"0\" keyframe=\"1\" xtl=\"{x}\" ytl=\"{y}\" xbr=\"{right}\" ybr=\"{bottom}\"/>"
        )
    };
    let other =
        "<box frame=\"30\" outside=\"0\" occluded=\"0\" keyframe=\"0\" xtl=\"0\" ytl=\"0\" xbr=\"9\" ybr=\"9\"/>";
    let xml = format!(
        "<annotations><track id=\"3\" label=\"digit &amp; co\">{}{}{}{other}</track></annotations>",
        shape(0, 0),
        shape(10, 1),
        shape(20, 0)
    );
    place.write("task.xml", xml);
    let args = ["annotate", "scene", "--keyframes", "task.xml", "--format", "cvat", "--config", "digits"];
    place.done([&args[..], &["--out", "cvat"]].concat());
    let xml = place.text("cvat/boxes.xml");
    assert!(xml.contains("<track id=\"3\" label=\"digit &amp; co\"") && xml.contains("<size>100</size>"), "{xml}");
    let outside: Vec<&str> = xml.lines().filter(|line| line.contains("outside=\"1\"")).collect();
    assert!(outside.len() == 1 && outside[0].contains("frame=\"10\""), "{outside:?}");
    for (to, file) in
        [("viame", "boxes.csv"), ("label-studio", "boxes.json"), ("coco", "boxes.json"), ("mot", "boxes.txt")]
    {
        place.done([&args[..], &["--to", to, "--out", to]].concat());
        let back = ["convert", &format!("{to}/{file}"), &format!("{to}.xml"), "--from", to, "--to", "cvat"];
        place.done([&back[..], &["--size", "250x200"]].concat());
    }
}

/// Boxes in pixels of other pictures are refused; those in per cent fit. A longer video is noted.
#[test]
fn key_frames_of_another_video_are_reported() {
    let place = Place::new();
    place.done(["synth", "clutter", "--frames", "4", "--out", "scene"]);
    let cvat = |width: usize, frames: usize| {
        format!(
            "<annotations><meta><task><size>{frames}</size><original_size><width>{width}</width><height>200</height></original_size>\
             </task></meta><track id=\"1\" label=\"a\"><box frame=\"0\" xtl=\"30\" ytl=\"30\" xbr=\"58\" ybr=\"58\"/></track></annotations>"
        )
    };
    let coco = r#"{"images":[{"id":1,"frame_id":0,"width":640,"height":480}],"annotations":[{"image_id":1,"track_id":1,"bbox":[30,30,28,28]}]}"#;
    let studio = r#"[{"annotations":[{"result":[{"type":"videorectangle","original_width":640,"original_height":480,"value":
        {"framesCount":4,"sequence":[{"frame":1,"x":20,"y":20,"width":10,"height":10}]}}]}]}]"#;
    for (keys, format, is_refused, said) in [
        (cvat(640, 4), "cvat", true, "it is for pictures of 640 x 200, and scene has 250 x 200"),
        (coco.to_owned(), "coco", true, "it is for pictures of 640 x 480, and scene has 250 x 200"),
        (studio.to_owned(), "label-studio", false, "it is for pictures of 640 x 480, and scene has 250 x 200"),
        (cvat(250, 9), "cvat", false, "it is for 9 frames, and the video has 4 frames"),
    ] {
        place.write("keys", keys);
        let args = ["annotate", "scene", "--config", "digits", "--keyframes", "keys", "--out"];
        let run = place.run([&args[..], &[format, "--format", format]].concat());
        assert_eq!(run.status.success(), !is_refused, "{format}: {}", errors(&run));
        assert!(errors(&run).contains(said), "{format}: {}", errors(&run));
    }
}

#[test]
fn what_cannot_be_annotated_is_refused_before_anything_is_written() {
    let (place, truth) = scene();
    write_keys(&place, "none.txt", &truth, &[]);
    place.write("late.txt", "101,1,1,1,9,9,1,-1,-1,-1\n");
    place.write("far.txt", "1,1,9999,9999,9,9,1,-1,-1,-1\n");
    place.write("found.txt", "1,-1,1,1,9,9,1,-1,-1,-1\n");
    place.write("two.txt", "1,1,1,1,9,9,1\n1,2,1,1,9,9,1\n");
    place.write("twice.txt", "5,3,1,1,9,9,1\n5,3,2,2,9,9,1\n");
    for (keys, format, problem) in [
        ("none.txt", "otb", "expected at least one key frame"),
        ("late.txt", "mot", "a box is in frame 101, and scene has 100 frames"),
        ("far.txt", "mot", "the box of target 1 in frame 1"),
        ("found.txt", "mot", "annotate needs tracks, not detections"),
        ("twice.txt", "mot", "frame 5 has two boxes of the target 3; expected one"),
        ("two.txt --to otb", "mot", "it has 2 targets (1, 2), and the format of the result holds one"),
        ("nowhere.txt", "otb", "nowhere.txt"),
    ] {
        let keys: Vec<&str> = keys.split(' ').collect();
        let args = [&["annotate", "scene", "--format", format, "--out", "out", "--keyframes"], &keys[..]].concat();
        place.refuses(args, problem);
        assert!(!place.path("out").exists(), "{keys:?}");
    }
}

/// The labels that were read beside the boxes are no place for those of the result.
#[test]
fn labels_beside_the_key_frames_are_kept() {
    let (place, truth) = scene();
    let BBox { x, y, w, h } = truth[0];
    let boxes: String = (0..FRAMES).map(|_| format!("{},{},{w},{h}\n", x + 1.0, y + 1.0)).collect();
    place.write("mine/groundtruth.txt", boxes);
    let labels = "0\n".to_owned() + &"1\n".repeat(FRAMES - 1);
    place.write("mine/absence.label", &labels);
    let keys = ["annotate", "scene", "--config", "digits", "--keyframes", "mine/groundtruth.txt", "--format", "got10k"];
    place.refuses([&keys[..], &["--out", "mine"]].concat(), "absence.label");
    assert_eq!(place.text("mine/absence.label"), labels);
}

/// Key frames stay in their frames, notes on their file are shown, and the labels of GOT-10k are a result like the boxes.
#[test]
fn results_are_those_of_the_key_frames() {
    let (place, truth) = scene();
    let annotation = |id: usize, t: usize| {
        let BBox { x, y, w, h } = truth[t];
        format!("{{\"image_id\":{id},\"track_id\":1,\"bbox\":[{x},{y},{w},{h}],\"segmentation\":[[1,2]]}}")
    };
    let coco = |frames: [usize; 2]| {
        let images = frames.map(|frame| format!("{{\"id\":{},\"frame_id\":{frame}}}", frame + 7)).join(",");
        let boxes = frames.map(|frame| annotation(frame + 7, frame)).join(",");
        format!("{{\"images\":[{images}],\"annotations\":[{boxes}]}}")
    };
    place.write("keys.json", coco([0, 60]));
    let args = ["annotate", "scene", "--config", "digits", "--out", "out", "--to", "got10k", "--format"];
    let annotated = |more: &[&str]| errors(&place.done([&args[..], more].concat()));
    let notes = annotated(&["coco", "--keyframes", "keys.json"]);
    assert!(notes.contains("keys.json: 2 segmentations are left out") && !notes.contains("confidence"), "{notes}");
    let boxes = read_boxes(place.path("out/boxes.txt")).expect("boxes");
    assert_eq!([0, 60].map(|t| boxes[t]), [0, 60].map(|t| Some(truth[t])));
    let labels = || place.text("out/absence.label");
    let before = labels();
    let run = place.text("out/run.json");
    assert!(before.lines().count() == FRAMES && run.contains("absence.label"), "{run}");
    let task = format!(
        "<annotations><track id=\"1\" label=\"a\"><box frame=\"0\" xtl=\"{x}\" ytl=\"{y}\" xbr=\"{r}\" ybr=\"{b}\"/>\
         <box frame=\"40\" outside=\"1\" xtl=\"{x}\" ytl=\"{y}\" xbr=\"{r}\" ybr=\"{b}\"/></track></annotations>",
        x = truth[0].x,
        y = truth[0].y,
        r = truth[0].x + truth[0].w,
        b = truth[0].y + truth[0].h
    );
    place.write("task.xml", task);
    annotated(&["cvat", "--keyframes", "task.xml"]);
    assert!(labels() != before && labels().ends_with("1\n"), "the labels are of the same run as the boxes");
}
