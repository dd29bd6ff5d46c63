//! `foveate convert`: boxes there and back, and the losses.

use crate::place::{Place, errors, failed};

impl Place {
    /// Converts. Returns the warnings of lost data.
    fn convert(&self, input: &str, from: &str, output: &str, to: &str, more: &[&str]) -> String {
        let args = ["convert", input, output, "--from", from, "--to", to];
        errors(&self.done([&args[..], more].concat()))
    }
    fn unconverted(&self, input: &str, from: &str, to: &str) -> String {
        let said = failed(&self.run(["convert", input, "failed", "--from", from, "--to", to]));
        assert!(!self.path("failed").exists());
        said
    }
}

const OTB: &str = "1,2,30,40\n2.5,2,30,40\nNaN,NaN,NaN,NaN\n4,5,6.25,7\nNaN,NaN,NaN,NaN\n";

#[test]
fn one_target_goes_everywhere_and_comes_back() {
    let place = Place::empty();
    place.write("boxes.txt", OTB);
    for format in ["otb", "vot", "got10k", "mot", "coco", "cvat"] {
        place.convert("boxes.txt", "otb", "there", format, &[]);
        place.convert("there", format, "back.txt", "otb", &[]);
        // MOTChallenge's text has no length: the last frame, without a box, is gone.
        let end = if format == "mot" { OTB.len() - "NaN,NaN,NaN,NaN\n".len() } else { OTB.len() };
        assert_eq!(place.text("back.txt"), OTB[..end], "{format}");
    }
    assert!(place.convert("boxes.txt", "otb", "a", "mot", &[]).contains("1 frames after the last box are left out"));
    place.convert("boxes.txt", "otb", "a", "vot", &[]);
    assert!(place.text("a").starts_with("0,1,30,40\n1.5,1,30,40\nnan,nan,nan,nan\n"), "VOT counts from 0");
    place.convert("boxes.txt", "otb", "a", "got10k", &[]);
    assert_eq!(place.text("absence.label"), "0\n0\n1\n0\n1\n");
    assert!(place.text("a").contains("\n0,0,0,0\n"));
    place.convert("boxes.txt", "otb", "a", "cvat", &[]);
    let cvat = place.text("a");
    assert!(cvat.contains(
        "frame=\"1\" outside=\"0\" occluded=\"0\" keyframe=\"1\" xtl=\"1.5\" ytl=\"1\" xbr=\"31.5\" ybr=\"41\""
    ));
    assert!(cvat.contains("frame=\"2\" outside=\"1\"") && cvat.contains("<size>5</size>"), "{cvat}");
}

#[test]
fn many_targets_keep_their_ids() {
    let place = Place::empty();
    let text = "1,3,1,1,5,5,1,-1,-1,-1\n1,7,20,1,5,5.5,1,-1,-1,-1\n3,3,2,1,5,5,1,-1,-1,-1\n";
    place.write("gt.txt", text);
    for format in ["coco", "cvat", "viame"] {
        place.convert("gt.txt", "mot", "there", format, &[]);
        place.convert("there", format, "back.txt", "mot", &[]);
        assert_eq!(place.text("back.txt"), text, "{format}");
    }
    // In per cent of the picture: exact in pictures of 64 pixels.
    let size = ["--size", "64x64"];
    place.convert("there", "viame", "tasks.json", "label-studio", &size);
    place.convert("tasks.json", "label-studio", "back.txt", "mot", &size);
    assert_eq!(place.text("back.txt"), text);
    // Regions of Label Studio itself have the next unused numbers; the others keep theirs.
    let tasks = place.text("tasks.json");
    for new in ["hD2cQ", "target-3", "target-1"] {
        place.write("tasks.json", tasks.replace("target-7", new));
        place.convert("tasks.json", "label-studio", "back.txt", "mot", &size);
        let back = place.text("back.txt");
        assert!(back.starts_with("1,1,20,") && back.contains("\n1,3,1,") && back.contains("\n3,3,2,"), "{new}: {back}");
    }
    assert!(place.unconverted("tasks.json", "label-studio", "mot").contains("give --size WIDTHxHEIGHT"));
    assert!(
        place
            .unconverted("gt.txt", "mot", "otb")
            .contains("2 targets (3, 7) for a format of one; choose one with --id")
    );
    let lost = place.convert("gt.txt", "mot", "one.txt", "otb", &["--id", "7"]);
    assert!(lost.contains("id other than 1 is left out"), "{lost}");
    assert_eq!(place.text("one.txt"), "20,1,5,5.5\nNaN,NaN,NaN,NaN\nNaN,NaN,NaN,NaN\n");
}

#[test]
fn spots_of_trackmate_are_square_boxes() {
    let place = Place::empty();
    let text = "1,3,1,1,5,5,1,-1,-1,-1\n1,7,20,1,5,5,1,-1,-1,-1\n3,3,2.5,1,6,6,1,-1,-1,-1\n";
    place.write("gt.txt", text);
    place.convert("gt.txt", "mot", "spots.csv", "trackmate", &[]);
    let spots = place.text("spots.csv");
    // The box of 5 pixels from the first pixel on has its centre on the third.
    assert_eq!(spots.lines().nth(4), Some("ID0,0,3,1,2,2,0,0,0,2.5,1"), "{spots}");
    place.convert("spots.csv", "trackmate", "back.txt", "mot", &[]);
    assert_eq!(place.text("back.txt"), text);
    // As early versions wrote them, with a spot of no track.
    place.write("early.csv", "Label,FRAME,TRACK_ID,RADIUS,POSITION_Y,POSITION_X\n\"a, b\",2.0,None,4,10,20\n");
    place.convert("early.csv", "trackmate", "back.txt", "mot", &[]);
    assert_eq!(place.text("back.txt"), "3,-1,17.5,7.5,8,8,1,-1,-1,-1\n");
    place.write("gt.txt", "1,3,1,1,4,9,1,-1,-1,-1\n");
    let lost = place.convert("gt.txt", "mot", "spots.csv", "trackmate", &[]);
    assert!(lost.contains("1 boxes are not square") && place.text("spots.csv").contains(",3,1,"), "{lost}");
    // The second line is a spot, not a head: its place may not be missing.
    place.write("early.csv", "FRAME,TRACK_ID,RADIUS,POSITION_Y,POSITION_X\n2,0,4,10,\n");
    assert!(place.unconverted("early.csv", "trackmate", "mot").contains("line 2: POSITION_X: expected a number"));
    for (from, to, problem) in [
        ("(pixel)", "(micron)", "line 4: expected positions in pixels, found micron"),
        ("RADIUS", "R", "line 1: expected a column RADIUS"),
        (",3,1,", ",-3,1,", "line 5: TRACK_ID: expected a whole number from 0 on, found -3"),
        ("3,1\n", "nan,1\n", "line 5: RADIUS: expected a number, found \"nan\""),
        (",0,0,0,", ",", "line 5: expected 11 fields between commas, found 8"),
    ] {
        place.write("wrong.csv", place.text("spots.csv").replace(from, to));
        let failure = place.unconverted("wrong.csv", "trackmate", "mot");
        assert!(failure.contains(problem), "{failure}");
    }
}

#[test]
fn shapes_of_napari_are_boxes() {
    let place = Place::empty();
    place.write("boxes.txt", OTB);
    place.convert("boxes.txt", "otb", "shapes.csv", "napari", &[]);
    // The box from the first pixel on, of which the edge is half a pixel before the centre.
    let shapes = place.text("shapes.csv");
    assert!(shapes.starts_with("index,shape-type,vertex-index,axis-0,axis-1,axis-2\n0,rectangle,0,0,"), "{shapes}");
    place.convert("shapes.csv", "napari", "back.txt", "otb", &[]);
    place.convert("boxes.txt", "otb", "there.txt", "otb", &[]);
    assert_eq!(
        place.text("back.txt").trim_end(),
        place.text("there.txt").trim_end_matches("NaN,NaN,NaN,NaN\n").trim_end()
    );
    let head = shapes.lines().next().expect("a head");
    // Drawn from the lower right corner on, in the third frame, and an ellipse.
    let drawn = "1,ellipse,0,2,9.5,19.5\n1,ellipse,1,2,9.5,9.5\n1,ellipse,2,2,4.5,9.5\n1,ellipse,3,2,4.5,19.5\n";
    place.write("drawn.csv", format!("{head}\n{drawn}"));
    let lost = place.convert("drawn.csv", "napari", "back.txt", "mot", &[]);
    assert_eq!(place.text("back.txt"), "3,1,11,6,10,5,1,-1,-1,-1\n");
    assert!(lost.contains("1 shapes are no rectangles"), "{lost}");
    for (from, to, problem) in [
        ("axis-2", "axis-3", "line 1: expected the columns index,shape-type"),
        (",2,9.5,19.5", ",nan,9.5,19.5", "line 2: axis-0: expected a number, found \"nan\""),
        (",1,2,9.5", ",1,3,9.5", "line 3: shape 1 lies in the frames 2 and 3; expected one"),
        (",2,2,4.5,9.5", ",2,2,4.5", "line 4: expected 6 fields between commas, found 5"),
        ("4.5", "9.5", "shape 1:"),
    ] {
        place.write("wrong.csv", place.text("drawn.csv").replace(from, to));
        let failure = place.unconverted("wrong.csv", "napari", "mot");
        assert!(failure.contains(problem), "{failure}");
    }
}

/// Spreadsheets and editors of Windows put a mark before a text.
#[test]
fn a_byte_order_mark_is_passed_over() {
    let place = Place::empty();
    place.write("boxes.txt", OTB);
    let size = ["--size", "64x48"];
    for format in ["otb", "vot", "mot", "coco", "cvat", "label-studio", "viame", "trackmate", "napari"] {
        place.convert("boxes.txt", "otb", "plain", format, &size);
        place.write("marked", format!("\u{feff}{}", place.text("plain")));
        place.convert("plain", format, "there", "mot", &size);
        place.convert("marked", format, "back", "mot", &size);
        assert_eq!(place.text("back"), place.text("there"), "{format}");
    }
}

/// The key frames of Label Studio are read in any order.
#[test]
fn key_frames_out_of_order_lose_no_boxes() {
    let place = Place::empty();
    let key = |frame: usize, enabled: bool| {
        format!("{{\"frame\":{frame},\"enabled\":{enabled},\"x\":{frame},\"y\":1,\"width\":9,\"height\":9}}")
    };
    let keys = [key(1, true), key(5, false), key(6, true), key(9, false)];
    let frames = |order: [usize; 4]| {
        let sequence = order.map(|k| keys[k].as_str()).join(",");
        let region =
            format!("{{\"type\":\"videorectangle\",\"value\":{{\"framesCount\":20,\"sequence\":[{sequence}]}}}}");
        place.write("tasks.json", format!("[{{\"annotations\":[{{\"result\":[{region}]}}]}}]"));
        place.convert("tasks.json", "label-studio", "there", "mot", &["--size", "100x100"]);
        place.text("there")
    };
    assert_eq!(frames([0, 1, 2, 3]).lines().count(), 9);
    assert_eq!(frames([2, 3, 0, 1]), frames([0, 1, 2, 3]));
    // The same box twice is one; two boxes of a frame are an error.
    assert_eq!(frames([0, 1, 1, 2]), frames([0, 1, 2, 2]));
    place.write("tasks.json", place.text("tasks.json").replacen("\"frame\":5", "\"frame\":1", 1));
    let twice = "convert tasks.json failed --from label-studio --to mot --size 100x100";
    place.refuses(twice.split(' '), "frame 1 has two boxes of the target 1");
}

/// The last box of a track holds up to the last frame of all, whatever the order of the tracks, and whatever a part of a task states.
#[test]
fn the_last_box_holds_up_to_the_end() {
    let place = Place::empty();
    let track = |id: usize, frame: usize| {
        format!(
            "<track id=\"{id}\" label=\"a\"><box frame=\"{frame}\" xtl=\"1\" ytl=\"1\" xbr=\"9\" ybr=\"9\"/></track>"
        )
    };
    let lines = |head: &str, tracks: [String; 2]| {
        place.write("task.xml", format!("<annotations>{head}{}</annotations>", tracks.concat()));
        place.convert("task.xml", "cvat", "there", "mot", &[]);
        place.text("there").lines().count()
    };
    for head in ["", "<meta><job><size>4</size></job></meta>"] {
        assert_eq!(
            [lines(head, [track(0, 0), track(1, 9)]), lines(head, [track(1, 9), track(0, 0)])],
            [11, 11],
            "{head}"
        );
    }
}

#[test]
fn labels_occlusion_and_size_stay() {
    let place = Place::empty();
    let task = |end: &str| {
        format!(
            "<annotations><meta><task><size>9</size><original_size><width>64</width><height>48</height></original_size></task></meta>\
             <track id=\"0\" label=\"a, &quot;b&quot;\"><box frame=\"1\" outside=\"0\" occluded=\"1\" keyframe=\"1\" xtl=\"1\" ytl=\"2\" \
             xbr=\"31\" ybr=\"42\"/></track><track id=\"5\" label=\"c\"><box frame=\"4\" outside=\"0\" keyframe=\"1\" xtl=\"1\" \
             ytl=\"2\" xbr=\"9\" ybr=\"8\"/>{end}</track></annotations>"
        )
    };
    let gone = "<box frame=\"5\" outside=\"1\" keyframe=\"1\" xtl=\"1\" ytl=\"2\" xbr=\"9\" ybr=\"8\"/>";
    place.write("task.xml", task(gone));
    let lost = place.convert("task.xml", "cvat", "same.xml", "cvat", &[]);
    assert!(lost.contains("7 boxes between key frames are interpolated") && !lost.contains("left out"), "{lost}");
    let same = place.text("same.xml");
    // A box holds up to the end of the video.
    assert_eq!((same.matches("occluded=\"1\"").count(), same.matches("outside=\"1\"").count()), (8, 1), "{same}");
    assert!(same.contains("<width>64</width><height>48</height>"), "{same}");
    for format in ["viame", "coco", "label-studio"] {
        let size = if format == "label-studio" { &["--size", "64x48"][..] } else { &[] };
        let lost = place.convert("task.xml", "cvat", "there", format, &[]);
        assert!(lost.contains("8 boxes are occluded") && !lost.contains("label"), "{format}: {lost}");
        place.convert("there", format, "back.xml", "cvat", size);
        let back = place.text("back.xml");
        assert!(
            back.contains("<track id=\"0\" label=\"a, &quot;b&quot;\"") && back.contains("<track id=\"5\" label=\"c\""),
            "{format}: {back}"
        );
        assert_eq!(back.matches("outside=\"0\"").count(), 9, "{format}");
    }
    place.write("lines.xml", task(gone).replace("label=\"c\"", "label=\"c&#10;d&#9;e&#13;f\""));
    place.convert("lines.xml", "cvat", "same.xml", "cvat", &[]);
    assert!(place.text("same.xml").contains("label=\"c&#10;d&#9;e&#13;f\""), "{}", place.text("same.xml"));
    place.write("dive.csv", "# metadata\n3,\"a, b.png\",0,1,1,9,9,0.5,-1,cat,0.2,dog,0.8,(atr) x 1\n");
    place.convert("dive.csv", "viame", "dive.xml", "cvat", &[]);
    assert!(place.text("dive.xml").contains("<track id=\"3\" label=\"dog\""));
    place.write("named.xml", place.text("dive.xml").replace("label=\"dog\"", "label=\"(left) dog\""));
    assert!(place.convert("named.xml", "cvat", "there", "viame", &[]).contains("1 labels are read back otherwise"));
}

#[test]
fn losses_of_a_conversion_are_reported() {
    let place = Place::empty();
    place.write("polygons.txt", "10,0,20,10,10,20,0,10\n0\n1,2,3,4\n");
    assert!(
        place.convert("polygons.txt", "vot", "a.txt", "otb", &[]).contains("1 polygons became the boxes about them")
    );
    assert_eq!(place.text("a.txt"), "1,1,20,20\nNaN,NaN,NaN,NaN\n2,3,3,4\n");
    place.write("masks.txt", "m5,7,4,3,1,2,1,4,2,1\nm0,0,0,0,0\n");
    assert!(place.convert("masks.txt", "vot", "a.txt", "otb", &[]).contains("2 masks became the boxes about them"));
    assert_eq!(place.text("a.txt"), "6,8,4,3\nNaN,NaN,NaN,NaN\n");
    place.write("found.txt", "1,1,1,1,5,5,0.5\n");
    assert!(place.convert("found.txt", "mot", "a.txt", "otb", &[]).contains("1 confidences other than 1"));
    place.write(
        "task.xml",
        "<annotations><meta><size>6</size></meta><track id=\"0\" label=\"cat\">\
         <box frame=\"0\" outside=\"0\" occluded=\"1\" xtl=\"0\" ytl=\"0\" xbr=\"10\" ybr=\"10\"/>\
         <box frame=\"2\" outside=\"0\" rotation=\"5\" xtl=\"4\" ytl=\"0\" xbr=\"14\" ybr=\"12\"><attribute name=\"pose\">up</attribute></box>\
         <box frame=\"4\" outside=\"1\" xtl=\"4\" ytl=\"0\" xbr=\"14\" ybr=\"12\"/></track>\
         <track id=\"1\" label=\"dog\"><points frame=\"1\" points=\"1,1\"/></track></annotations>",
    );
    let lost = place.convert("task.xml", "cvat", "a.txt", "otb", &[]);
    for said in [
        "2 boxes between key frames are interpolated",
        "2 labels",
        "2 boxes are occluded",
        "1 attributes of boxes",
        "1 boxes are rotated",
        "1 shapes other than boxes",
    ] {
        assert!(lost.contains(said), "{said}: {lost}");
    }
    // Other formats cannot hold it, or could not be read back.
    place.write("flat.txt", "1,1,1,1,0,5\n2,1,1,1,5,5\n");
    let lost = place.convert("flat.txt", "mot", "flat.xml", "cvat", &[]);
    assert!(lost.contains("1 boxes without area are left out"), "{lost}");
    place.convert("flat.xml", "cvat", "back.txt", "mot", &[]);
    assert_eq!(place.text("back.txt"), "2,1,1,1,5,5,1,-1,-1,-1\n");
    let nan = "NaN,NaN,NaN,NaN\n";
    assert_eq!(place.text("a.txt"), format!("1,1,10,10\n3,1,10,11\n5,1,10,12\n5,1,10,12\n{nan}{nan}"));
    place.write(
        "coco.json",
        r#"{"images":[{"id":9},{"id":4}],"annotations":[{"image_id":9,"bbox":[0,0,2,3],"segmentation":[[1,2]]}]}"#,
    );
    let lost = place.convert("coco.json", "coco", "a.txt", "mot", &[]);
    assert!(lost.contains("no track_id") && lost.contains("1 segmentations"), "{lost}");
    assert_eq!(place.text("a.txt"), "2,-1,1,1,2,3,1,-1,-1,-1\n", "images are in the order of their ids");
    place.write(
        "coco.json",
        r#"{"images":[{"id":9,"frame_id":3},{"id":4,"frame_id":9}],"annotations":[{"image_id":4,"bbox":[0,0,2,3]}]}"#,
    );
    place.convert("coco.json", "coco", "a.txt", "mot", &[]);
    assert_eq!(place.text("a.txt"), "10,-1,1,1,2,3,1,-1,-1,-1\n", "the frame_id is the frame");
    for (first, frame) in [(0, "10,-1,"), (1, "9,-1,"), (2, "10,-1,")] {
        let file = place.text("coco.json").replace("\"frame_id\":3", &format!("\"frame_id\":{first}"));
        place.write("first.json", &file);
        place.convert("first.json", "coco", "a.txt", "mot", &[]);
        assert!(place.text("a.txt").starts_with(frame), "they count from 1 if the least is 1: {first}");
    }
    place.write("mixed.csv", "1,,0,1,1,11,11,1,-1,cat,1\n1,,1,1,1,11,11,1,-1,dog,1\n");
    let lost = place.convert("mixed.csv", "viame", "a.json", "coco", &[]);
    assert!(lost.contains("1 boxes differ from the class of the first box"), "{lost}");
    place.write("known.txt", "1,7,100,50,13,17,1,2,0.5\n2,7,100,50,13,17,1,-1,-1,-1\n");
    let lost = place.convert("known.txt", "mot", "a.txt", "mot", &[]);
    assert!(lost.contains("1 boxes have a class, a visibility or a place"), "{lost}");
    place.write("sure.txt", "1,1,1,1,5,5,0.5,-1,-1,-1\n");
    place.convert("sure.txt", "mot", "sure.csv", "trackmate", &[]);
    assert_eq!(place.convert("sure.csv", "trackmate", "back.txt", "mot", &[]), "");
    assert_eq!(place.text("back.txt"), place.text("sure.txt"), "the confidence is the quality");
}

/// The notes on the input are those on the target that is converted.
#[test]
fn notes_are_on_what_is_converted() {
    let place = Place::empty();
    let track = |id: usize, label: &str, end: usize| {
        let shape = |frame: usize, outside: u8| {
            format!("<box frame=\"{frame}\" outside=\"{outside}\" xtl=\"0\" ytl=\"0\" xbr=\"9\" ybr=\"9\"/>")
        };
        format!("<track id=\"{id}\" label=\"{label}\">{}{}</track>", shape(0, 0), shape(end, 1))
    };
    place.write("two.xml", format!("<annotations>{}{}</annotations>", track(0, "cat", 5), track(1, "dog", 3)));
    let lost = place.convert("two.xml", "cvat", "a.txt", "otb", &["--id", "1"]);
    assert!(lost.contains("2 boxes between key frames") && !lost.contains("label"), "{lost}");
    place.convert("two.xml", "cvat", "a.txt", "got10k", &["--id", "1"]);
    assert_eq!(place.convert("a.txt", "got10k", "b.txt", "otb", &[]), "", "it marks absent frames itself");
}

#[test]
fn damage_is_an_error_that_names_the_file() {
    let place = Place::empty();
    for (text, from, to, said) in [
        ("1,2,3\n", "otb", "mot", "line 1: expected x,y,w,h"),
        ("1,2,3\n", "vot", "mot", "line 1: expected a rectangle"),
        ("1,1,1,1,5,5\n1,1,2,2,5,5\n", "mot", "coco", "frame 1 has two boxes of the target 1"),
        (
            "<annotations><track id=\"4\"><box frame=\"2\" xtl=\"1\" ytl=\"1\" xbr=\"9\" ybr=\"9\"/>\
             <box frame=\"2\" xtl=\"1\" ytl=\"1\" xbr=\"8\" ybr=\"9\"/></track></annotations>",
            "cvat",
            "mot",
            "frame 3 has two boxes of the target 4",
        ),
        ("1,-1,1,1,5,5\n", "mot", "cvat", "no id (-1)"),
        ("1,-1,1,1,5,5\n1,-1,9,9,5,5\n", "mot", "otb", "2 detections without ids (-1)"),
        ("", "otb", "mot", "neither frames nor boxes"),
        ("", "mot", "coco", "neither frames nor boxes"),
        ("900000000,1,1,1,5,5\n", "mot", "otb", "at most 1000000"),
        ("{}", "coco", "mot", "expected COCO's images and annotations"),
        (
            r#"{"images":[],"annotations":[{"image_id":9,"bbox":[0,0,2,3]}]}"#,
            "coco",
            "mot",
            "annotation 1: there is no image 9",
        ),
        (
            r#"{"images":[{"id":9}],"annotations":[{"image_id":9,"bbox":[0,0,-2,3]}]}"#,
            "coco",
            "mot",
            "annotation 1: a box is",
        ),
        (
            r#"{"images":[{"id":1,"frame_id":0},{"id":2,"frame_id":0}],"annotations":[]}"#,
            "coco",
            "mot",
            "two images have the frame_id 0; expected one video",
        ),
        ("<annotations><image/></annotations>", "cvat", "mot", "it is CVAT for images"),
        ("<annotations>", "cvat", "mot", "expected XML of CVAT for video"),
        (
            "<annotations><track id=\"0\">\n<box frame=\"0\" xtl=\"a\"/></track></annotations>",
            "cvat",
            "mot",
            "line 2: expected <box xtl=",
        ),
        (
            "<annotations><track id=\"0\"><box frame=\"9999999\" xtl=\"0\"/></track></annotations>",
            "cvat",
            "mot",
            "expected a whole number",
        ),
    ] {
        place.write("in", text);
        let problem = place.unconverted("in", from, to);
        assert!(problem.contains(said), "{said}: {problem}");
    }
    assert!(place.unconverted("none", "otb", "vot").contains("none: cannot read"));
    // The labels of other boxes in the folder stay.
    place.write("boxes.txt", OTB);
    place.write("absence.label", "0\n");
    assert!(place.unconverted("boxes.txt", "otb", "got10k").contains("absence.label: it labels other boxes"));
    assert_eq!(place.text("absence.label"), "0\n");
    std::fs::create_dir(place.path("folder")).expect("a folder");
    ["groundtruth.txt", "old.txt"].into_iter().for_each(|name| place.write(name, OTB));
    place.convert("boxes.txt", "otb", "groundtruth.txt", "got10k", &[]);
    place.write("absence.label", "0\n");
    for out in ["old.txt", "folder"] {
        let run = place.run(["convert", "boxes.txt", out, "--from", "otb", "--to", "got10k"]);
        assert!(!run.status.success() && place.text("absence.label") == "0\n", "{run:?}");
    }
    for frame in [-1, i64::MIN] {
        place.write("in", format!("{{\"images\":[{{\"id\":1,\"frame_id\":{frame}}}],\"annotations\":[]}}"));
        let problem = place.unconverted("in", "coco", "mot");
        assert!(problem.contains("image 1: expected a frame_id from 0 on, found -"), "{problem}");
    }
    place.write("in", r#"[{"annotations":[{"result":[]},{"result":[]}]}]"#);
    let two = "convert in failed --from label-studio --to mot --size 64x48";
    place.refuses(two.split(' '), "it has 2 annotations; expected one");
    assert!(!place.run("convert in in --from otb --to vot".split(' ')).status.success());
}
