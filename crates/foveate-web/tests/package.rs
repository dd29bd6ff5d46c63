//! The JavaScript package, packed by npm and used from node and from Chromium, if these are installed: the results are those of native
//! portable code, and misuse gives codes.
#![cfg(unix)]

#[path = "../../foveate-cli/tests/browser/mod.rs"]
mod browser;
mod page;

use std::path::{Path, PathBuf};
use std::process::Command;

use browser::Browser;
use foveate_core::config::Config;
use foveate_core::geometry::{BBox, Size};
use foveate_core::scene::{Image, Pixels};
use foveate_core::{Detection, MultiTracker, Seen, Tracker};
use foveate_kernels::Level;
use foveate_testing::{data, need, node, program};
use foveate_video::annotation::read_boxes;
use serde_json::{Value, json};

/// Maximum difference of a box from native portable code, pixels: exponentials and logarithms differ in the last bit, which may change
/// the rounding of features to f32, and so a value in the box regression by one of its 16,383 steps.
const PIXELS: f64 = 2e-3;

/// Packs the package, and unpacks it where a program finds it.
fn install(folder: &Path) -> Result<(), String> {
    let page = page::folder()?;
    node()?;
    program("npm", "--version")?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let package = folder.join(format!("foveate-{}.tgz", env!("CARGO_PKG_VERSION")));
    let modules = folder.join("node_modules");
    std::fs::create_dir(&modules).expect("a writable folder");
    run(Command::new(root.join("npm/pack")).arg(folder).arg(page));
    run(Command::new("tar").arg("-xzf").arg(package).arg("-C").arg(&modules));
    std::fs::rename(modules.join("package"), modules.join("foveate")).expect("npm's archives have this folder");
    Ok(())
}

fn run(command: &mut Command) -> String {
    let output = command.output().expect("it starts");
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// Runs check.js in node.
fn in_node(folder: &Path, more: &[&str]) -> Value {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/package/check.mjs");
    serde_json::from_str(&run(Command::new("node").arg(script).arg(folder).args(more))).expect("JSON")
}

/// Opens a page with the modules of the package and check.js in Chromium. Without npm: the files are served as they are.
fn open(folder: &Path, profile: &Path) -> Result<Browser, String> {
    let check = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/package/check.js");
    std::fs::copy(check, folder.join("check.js")).expect("a writable folder");
    std::fs::write(folder.join("index.html"), "<!doctype html><title>package</title><link rel=icon href=data:,>")
        .expect("a writable folder");
    let mut browser = Browser::start(profile, &[]).ok_or("chromium that runs here")?;
    browser.call("Page.navigate", json!({ "url": page::serve(folder.to_owned()) }));
    browser.until("document.readyState === 'complete' && document.title === 'package'");
    browser.value(
        "(async () => { window.modules = await Promise.all(['./node_modules/foveate/index.js', './node_modules/foveate/worker.js', \
         './check.js'].map(path => import(path))); return true; })()",
    );
    Ok(browser)
}

/// Runs check.js in the browser, on the frames in its folder.
fn in_browser(browser: &mut Browser, description: &Value) -> Value {
    browser.value(&format!(
        "(async () => modules[2].follow(modules[0], modules[1], new Uint8Array(await (await fetch('frames.raw')).arrayBuffer()), \
         {description}))()"
    ))
}

/// Frames, and the boxes of the targets in the first one: the first box is that of the tracker of one target.
struct Scene {
    size: Size,
    frames: Vec<Vec<u8>>,
    boxes: Vec<[f64; 4]>,
}

impl Scene {
    /// The moving square of the page's tests, and a part of the background.
    fn synthetic(count: usize) -> Self {
        let rgba = |grey: &u8| [*grey, *grey, *grey, 255];
        let frames = (0..count).map(|t| page::frame(t).iter().flat_map(rgba).collect()).collect();
        Self { size: page::SIZE, frames, boxes: vec![page::truth(0), [30.0, 40.0, 40.0, 30.0]] }
    }

    fn read(sequence: &Path, count: usize) -> Self {
        let video = foveate_video::open(sequence.join("img")).expect("a folder of pictures");
        let images: Vec<Image> = video.take(count).map(|frame| frame.expect("a picture").image).collect();
        let names = ["groundtruth_rect.txt", "groundtruth_rect.1.txt", "groundtruth_rect.2.txt"];
        let files = names.map(|name| sequence.join(name)).into_iter().filter(|file| file.is_file());
        let first = |file| read_boxes(file).expect("boxes")[0].map(|b| [b.x, b.y, b.w, b.h]).expect("a box");
        let boxes = files.map(first).collect();
        let rgba = |rgb: &[u8]| [rgb[0], rgb[1], rgb[2], 255];
        let frames = images.iter().map(|image| image.to_rgb8().chunks(3).flat_map(rgba).collect()).collect();
        Self { size: images[0].size(), frames, boxes }
    }

    fn image(&self, t: usize) -> Image {
        Image::from_pixels(Pixels::Rgba, self.size, 4 * self.size.width, &self.frames[t]).expect("a whole frame")
    }

    /// Writes the frames, and describes them to check.js.
    fn write(&self, folder: &Path, one: &str, many: &str) -> (PathBuf, Value) {
        let path = folder.join("frames.raw");
        std::fs::write(&path, self.frames.concat()).expect("a writable folder");
        let Size { width, height } = self.size;
        let count = self.frames.len();
        (
            path,
            json!({ "width": width, "height": height, "count": count, "boxes": self.boxes, "one": one, "many": many }),
        )
    }

    /// Compares the results of check.js with those of native code; returns the largest difference of a box, pixels.
    fn compare(&self, found: &Value, one: &str, many: &str) -> f64 {
        let boxes: Vec<BBox> = self.boxes.iter().map(|&[x, y, w, h]| BBox::new(x, y, w, h)).collect();
        let blueprint = |name| Config::named_or_parsed(name).expect("it ships");
        let mut tracker = Tracker::new(blueprint(one)).expect("parts that fit");
        let mut targets = MultiTracker::new(blueprint(many)).expect("parts that fit");
        let mut most = 0.0_f64;
        for t in 0..self.frames.len() {
            let image = self.image(t);
            if t == 0 {
                tracker.init(&image, boxes[0]).expect("a good box");
                targets.update(&image, &[]).expect("a picture");
                boxes.iter().for_each(|&bbox| _ = targets.add(&image, None, bbox).expect("a good box"));
                continue;
            }
            let found = |kind: &str| found[kind][t].as_array().expect("results").clone();
            let seen = tracker.update(&image).expect("a picture of one size");
            most = most.max(differ(&found("one"), &[seen.without_views()], t));
            let moved = |b: &BBox| Detection::new(BBox { x: b.x + t as f64, ..*b }, 0.9);
            targets.update(&image, &boxes.iter().map(moved).collect::<Vec<_>>()).expect("a picture of one size");
            most = most.max(differ(&found("many"), targets.targets(), t));
        }
        most
    }
}

fn differ(found: &[Value], expected: &[Seen<'static>], t: usize) -> f64 {
    assert_eq!(found.len(), expected.len(), "frame {t}");
    let one = |(found, seen): (&Value, &Seen<'_>)| {
        let expected = json!([seen.id, seen.status.name(), seen.is_usable(), seen.detection_index]);
        let given = ["id", "status", "usable", "detection"].map(|key| found[key].clone());
        assert_eq!(json!(given), expected, "frame {t}");
        let b = seen.bbox;
        let sides = [("x", b.x), ("y", b.y), ("width", b.w), ("height", b.h)];
        let side = |(name, side): (&str, f64)| (found["box"][name].as_f64().expect("a number") - side).abs();
        let p_lost = (found["pLost"].as_f64().expect("a number") - seen.p_lost).abs();
        let most = sides.into_iter().map(side).fold(0.0, f64::max);
        assert!(most <= PIXELS && p_lost <= PIXELS, "frame {t}: {most} px, P(lost) {p_lost}: {found}");
        most
    };
    found.iter().zip(expected).map(one).fold(0.0, f64::max)
}

#[test]
fn its_version_is_that_of_the_crates() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../npm/package.json");
    let package: Value = serde_json::from_slice(&std::fs::read(file).expect("npm/package.json")).expect("JSON");
    assert_eq!(package["version"], env!("CARGO_PKG_VERSION"));
}

#[test]
fn results_are_those_of_native_code_in_node_and_in_a_browser() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    need!(install(dir.path()));
    assert!(Level::Portable.at_most(), "no kernel was used before");
    let scene = Scene::synthetic(16);
    let (frames, description) = scene.write(dir.path(), "fast", "multi-boxes");
    let found = in_node(dir.path(), &[frames.to_str().expect("UTF-8"), &description.to_string()]);
    println!("synthetic: {:.1e} px", scene.compare(&found, "fast", "multi-boxes"));

    let profile = tempfile::tempdir().expect("a temporary folder");
    let mut browser = need!(open(dir.path(), profile.path()));
    assert_eq!(in_browser(&mut browser, &description), found, "a browser gives the bits of node");
    let codes = browser.value("modules[2].misuse(modules[0], modules[1])");
    assert_eq!(codes, in_node(dir.path(), &[]));
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

#[test]
fn results_in_real_video_are_those_of_native_code() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    need!(install(dir.path()));
    assert!(Level::Portable.at_most(), "no kernel was used before");
    let sequences = need!(data("tracking"));
    let profile = tempfile::tempdir().expect("a temporary folder");
    let mut browser = open(dir.path(), profile.path());
    for name in ["Car1", "Couple", "Crossing", "Dog1", "DragonBaby", "Jogging"] {
        let scene = Scene::read(&sequences.join(name), 12);
        let (frames, description) = scene.write(dir.path(), "balanced", "multi-boxes");
        let found = in_node(dir.path(), &[frames.to_str().expect("UTF-8"), &description.to_string()]);
        println!("{name}: {:.1e} px", scene.compare(&found, "balanced", "multi-boxes"));
        if let Ok(browser) = &mut browser {
            assert_eq!(in_browser(browser, &description), found, "{name}: a browser gives the bits of node");
        }
    }
    need!(browser.map(|browser| assert!(browser.complaints.is_empty(), "{:?}", browser.complaints)));
}

#[test]
fn misuse_gives_codes() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    need!(install(dir.path()));
    let codes = in_node(dir.path(), &[]);
    let codes = codes.as_object().expect("codes by name");
    assert!(codes.len() >= 20, "{codes:?}");
    for (name, code) in codes {
        let expected = match &**name {
            "configuration" => "config",
            "after free" | "after free in a thread" => "freed",
            _ => "invalid",
        };
        assert_eq!(code, expected, "{name}");
    }
}
