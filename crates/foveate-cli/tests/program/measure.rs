//! `foveate measure`: motion in metres and seconds.

use crate::place::{FRAMES, Place, errors, printed};

const UNITS: [&str; 6] = ["--ruler", "1,1,1,101=1.00+-0.01m", "--fps", "25", "--fit", "line:x"];

#[test]
fn a_video_and_its_track_give_the_same_measurement() {
    let place = Place::new();
    fn with<'a>(args: &[&'a str]) -> Vec<&'a str> {
        [&["measure"], &UNITS[..], args].concat()
    }
    let run = |args: &[&str]| place.done(with(args));
    let quick = ["video", "-c", "c.toml", "--no-video", "--no-report"];
    let said = printed(&run(&[&quick[..], &["-o", "out"]].concat()));
    assert!(said.contains("line:x") && said.contains("  v = ") && said.contains("m/s (95 %:"), "{said}");
    let names =
        ["ask.csv", "boxes.txt", "fits.json", "measure.csv", "measure.html", "measure.trk", "run.json", "track.csv"];
    assert_eq!(place.names("out"), names);
    assert_eq!(place.lines("out/measure.csv"), FRAMES + 1);
    run(&["--track", "out/track.csv", "-o", "again"]);
    for name in ["measure.csv", "fits.json", "ask.csv", "measure.trk"] {
        assert!(place.read(&format!("out/{name}")) == place.read(&format!("again/{name}")), "{name}");
    }
    // The frame rate is that of the first measurement.
    let later = [&["measure"], &UNITS[..2], &UNITS[4..], &["--track", "out/track.csv", "-o", "later"]].concat();
    let later = place.run(&later);
    assert!(printed(&later).contains("25 frames per second"), "{}", errors(&later));
    assert!(place.read("out/measure.csv") == place.read("later/measure.csv"));
    // Another track in the same folder has no measurement yet.
    let there = |args: &[&str]| printed(&place.done(args));
    there(&["track", "video", "-c", "c.toml", "--no-video", "--no-report", "-o", "same"]);
    there(&["measure", "--track", "same/track.csv", "--fps", "240", "-o", "same"]);
    assert!(there(&["measure", "--track", "same/track.csv", "-o", "same"]).contains("240 frames per second"));
    there(&["track", "video", "-c", "c.toml", "--no-video", "--no-report", "-o", "same"]);
    assert_eq!(place.names("same"), ["boxes.txt", "run.json", "track.csv"]);
    assert!(!there(&["measure", "--track", "same/track.csv", "-o", "same"]).contains("frames per second"));
    // A thing that moves with the target takes its motion away.
    let truth = place.text("video/groundtruth_rect.txt");
    let first = truth.lines().next().expect("a box").to_owned();
    run(&[&quick[..], &["-o", "relative", "--reference", &first]].concat());
    let speed = |folder: &str| {
        let fits = place.json(&format!("{folder}/fits.json"));
        fits["fits"][0]["values"][1]["value"].as_f64().expect("a speed").abs()
    };
    assert!(speed("relative") < 0.3 * speed("out"), "{} {}", speed("relative"), speed("out"));
    // The reference is not in the track, so that it cannot be taken off again.
    place.refuses(with(&["--track", "relative/track.csv", "-o", "without"]), "--reference");
    place.write("lens.yml", calibration("image_width: 4000\nimage_height: 90\n", 0.0));
    place.refuses(with(&["--track", "out/track.csv", "-o", "without", "--lens", "lens.yml"]), "4000 x 90");
    for more in [&["--from", "3"][..], &["--until", "5"], &["--json"], &["--init", &first]] {
        let args = [&["--track", "out/track.csv", "-o", "without"], more].concat();
        place.refuses(with(&args), "cannot be used with");
    }
    assert!(!place.path("without").exists());
}

#[test]
fn each_of_several_points_is_measured_as_on_its_own() {
    let place = Place::new();
    let truth = place.text("video/groundtruth_rect.txt");
    let boxes = [truth.lines().next().expect("a box"), "5,8,24,20"];
    let run = |args: &[&str]| {
        let quick = ["measure", "video", "-c", "c.toml", "--no-video", "--no-report", "--origin", "11,21"];
        printed(&place.done([&quick[..], &UNITS[..], args].concat()))
    };
    let said = run(&["--init", boxes[0], "--init", boxes[1], "--names", "ball,cart", "-o", "both"]);
    assert!(said.contains("Point ball:") && said.contains("Point cart:"), "{said}");
    let outputs = ["tracks.txt", "tracks.csv", "targets.csv", "measure.csv", "measure.trk"];
    assert!(outputs.iter().all(|name| place.names("both").contains(&(*name).to_owned())), "{:?}", place.names("both"));
    assert_eq!(place.lines("both/tracks.csv"), 2 * FRAMES + 1);
    let rows = |folder: &str, name: &str| -> Vec<String> {
        let text = place.text(&format!("{folder}/measure.csv"));
        let of = |line: &str| line.strip_suffix(&format!(",{name}")).map(str::to_owned);
        text.lines().filter_map(of).collect()
    };
    for (bbox, name) in boxes.into_iter().zip(["ball", "cart"]) {
        run(&["--init", bbox, "-o", name]);
        assert_eq!(rows("both", name).len(), FRAMES);
        assert_eq!(rows("both", name), rows(name, "1"), "{name}");
    }
    // Tracker's file has the scale, the origin, the times and the points of track.csv.
    let text = place.text("both/measure.trk");
    let xml = roxmltree::Document::parse(&text).expect("well-formed XML");
    let named = |name: &str| -> Vec<roxmltree::Node<'_, '_>> {
        xml.descendants().filter(|node| node.attribute("name") == Some(name)).collect()
    };
    let number =
        |node: &roxmltree::Node<'_, '_>| node.text().and_then(|text| text.parse::<f64>().ok()).expect("a number");
    let values = |name: &str| named(name).iter().map(number).collect::<Vec<_>>();
    assert_eq!([values("xscale"), values("yscale")], [[100.0], [100.0]]);
    assert_eq!([values("xorigin"), values("yorigin")], [[10.5], [20.5]]);
    assert!((values("delta_t")[0] - 40.0).abs() < 1e-9, "{text}");
    assert_eq!([values("starttime"), values("startframe")], [[0.0], [0.0]]);
    assert_eq!(values("stepcount"), [FRAMES as f64]);
    let names: Vec<_> = named("name").iter().filter_map(roxmltree::Node::text).collect();
    assert_eq!(names, ["ball", "cart"]);
    let points = named("framedata");
    assert_eq!(points.len(), 3, "those of the axes and of two points");
    let table = place.text("cart/track.csv");
    let header: Vec<&str> = table.lines().next().expect("a header").split(',').collect();
    let column = |name: &str| header.iter().position(|head| *head == name).expect("a column");
    let (x, frame, usable) = (column("x"), column("frame"), column("usable"));
    let mut compared = 0;
    for line in table.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>()) {
        let index = line[frame].parse::<usize>().expect("a frame") - 1;
        let name = format!("[{index}]");
        let found = points[2].children().find(|node| node.attribute("name") == Some(name.as_str()));
        let of = |node: roxmltree::Node<'_, '_>| {
            node.descendants().find(|node| node.attribute("name") == Some("x")).map(|node| number(&node))
        };
        let wanted = (line[usable] != "0").then(|| line[x].parse::<f64>().expect("x") + 0.5);
        assert_eq!(found.and_then(of), wanted, "{index}");
        compared += usize::from(wanted.is_some());
    }
    assert!(compared > FRAMES / 2, "{compared}");
}

/// A calibration as OpenCV writes it; `size` has the lines with the size of the pictures.
fn calibration(size: &str, k1: f64) -> String {
    format!(
        "%YAML:1.0\n---\n{size}camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
         data: [ 100., 0., 59.5, 0., 100., 44.5, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   \
         dt: d\n   data: [ {k1}, 0., 0., 0., 0. ]\n"
    )
}

#[test]
fn corrections_are_key_frames_and_a_lens_is_taken_out() {
    let place = Place::new();
    let truth = place.text("video/groundtruth_rect.txt");
    let line = |frame: usize| format!("{frame},1,{},1,-1,-1,-1\n", truth.lines().nth(frame - 1).expect("a box"));
    place.write("keys.txt", line(2) + &line(7));
    let run = |args: &[&str]| {
        let quick = "measure video -c c.toml --no-video --no-report --keyframes keys.txt --format mot";
        place.done(quick.split(' ').chain(args.iter().copied()));
    };
    let given = |folder: &str| -> Vec<String> {
        let table = place.text(&format!("{folder}/track.csv"));
        let given = table.lines().filter(|line| line.contains(",,,,,,"));
        given.filter_map(|line| line.split(',').next().map(str::to_owned)).collect()
    };
    // Only the key frames of the part that is tracked.
    run(&["-o", "until", "--until", "6"]);
    assert_eq!(given("until"), ["2"]);
    run(&["-o", "plain"]);
    assert_eq!(given("plain"), ["2", "7"]);
    place.write("flat.yml", calibration("", 0.0));
    place.write("bent.yml", calibration("", -0.1));
    run(&["-o", "flat", "--lens", "flat.yml"]);
    run(&["-o", "bent", "--lens", "bent.yml"]);
    let measured = |folder: &str| place.read(&format!("{folder}/measure.csv"));
    assert!(measured("flat") != measured("bent"));
    let x = |folder: &str| -> f64 {
        let text = String::from_utf8(measured(folder)).expect("text");
        text.lines().nth(5).and_then(|line| line.split(',').nth(2)).and_then(|x| x.parse().ok()).expect("x")
    };
    assert!((x("flat") - x("plain")).abs() < 1e-6 && (x("bent") - x("plain")).abs() > 1e-3);
    // The track has the distortion, and says nothing of it; the fits.json beside it does.
    let again = ["measure", "--track", "bent/track.csv", "-o", "again"];
    place.refuses(again, "--lens again");
    place.done([&again[..], &["--lens", "bent.yml"]].concat());
    // So is the scale of the pictures, in which measure.trk is not.
    run(&["-o", "small", "--scale", "0.5"]);
    place.done(["measure", "--track", "small/track.csv", "-o", "large"]);
    let frames = |folder: &str| {
        let text = place.text(&format!("{folder}/measure.trk"));
        text.lines().filter(|line| line.contains("xorigin") || line.contains("\"xscale\"")).collect::<String>()
    };
    assert!(frames("small") == frames("large") && !frames("small").is_empty(), "{}", frames("small"));
    // Of several videos those that were measured with another calibration are not finished.
    let several = "measure video other -c c.toml --no-video --no-report --lens flat.yml -o several";
    let pictures = (1..=FRAMES).map(|frame| format!("img/{frame:04}.png"));
    for name in pictures.chain(["groundtruth_rect.txt".to_owned()]) {
        place.write(&format!("other/{name}"), place.read(&format!("video/{name}")));
    }
    (0..2).for_each(|_| drop(place.done(several.split(' '))));
    place.write("flat.yml", calibration("", -0.1));
    place.refuses(several.split(' '), "another configuration");
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let place = Place::new();
    place.write("lens.yml", calibration("image_width: 4000\nimage_height: 90\n", 0.0));
    place.write("two.txt", "1,1,5,5,20,20,1,-1,-1,-1\n1,2,50,50,20,20,1,-1,-1,-1\n");
    let refused = |args: &[&str], said: &str| {
        place.refuses([&["measure", "-o", "none"][..], args].concat(), said);
        assert!(!place.path("none").exists(), "{args:?}");
    };
    let two = ["video", "--init", "1,1,20,20", "--init", "40,40,20,20"];
    let refused_two = |more: &[&str], said: &str| refused(&[&two[..], more].concat(), said);
    refused_two(&["--detect"], "--init");
    refused_two(&["--names", "a"], "2 points");
    refused_two(&["--names", "a,a"], "two points");
    refused_two(&["--trace"], "--trace");
    refused_two(&["--init", "5000,1,20,20"], "point 3");
    refused(&["video", "--reference", "5000,1,20,20"], "--reference");
    refused(&["video", "--track", "track.csv"], "cannot be used with");
    refused(&["--track", "nothing.csv"], "nothing.csv");
    refused(&[], "required");
    refused(&["video", "--lens", "lens.yml"], "4000 x 90");
    refused(&["video", "--keyframes", "two.txt", "--format", "mot"], "2 targets");
    refused(&["video", "--keyframes", "two.txt"], "--format");
    // A target that is never in the picture is none.
    let shape = |frame: usize, outside: u8| {
        format!("<box frame=\"{frame}\" outside=\"{outside}\" xtl=\"5\" ytl=\"5\" xbr=\"25\" ybr=\"25\"/>")
    };
    let never = format!("<track id=\"1\">{}</track>", shape(0, 1));
    let task = |end: String| {
        format!("<annotations>{never}<track id=\"2\">{}{}{end}</track></annotations>", shape(0, 1), shape(1, 0))
    };
    place.write("task.xml", task(shape(4, 1) + &shape(6, 0)));
    let gone = ["video", "--keyframes", "task.xml", "--format", "cvat"];
    refused(&gone, "outside the picture in frame 5");
    refused(&gone, "the first with --until 4");
    refused(&[&gone[..], &["--until", "4", "--every", "3", "--fit", "cubic:y"]].concat(), "parabola");
    place.write("keys.txt", "1,1,5,5,20,20,1,-1,-1,-1\n3,1,5,5,20,20,1,-1,-1,-1\n");
    let keys = ["video", "--keyframes", "keys.txt", "--format", "mot", "--every", "3"];
    refused(&keys, "keys.txt: --every 3 leaves out the key frame 3");
    refused(&["video", "--fit", "cubic:y"], "parabola");
}
