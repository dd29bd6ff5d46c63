//! The fuzzed functions: a function of bytes for each border that hostile bytes can reach. None may panic, and none may take more than a
//! second or more memory than the limit.
//!
//! They are called by `fuzz_targets/` (libFuzzer, nightly) and by `crates/foveate-cli/tests/fuzz.rs` (stable: the stored corpus in every
//! run of the tests, and mutations of it for as long as one likes).

use std::path::Path;
use std::sync::OnceLock;

use foveate::config::{Blueprint, Config};
use foveate::extend::SavedState;
use foveate::files::{Folder, Nowhere};
use foveate::geometry::Size;
use foveate::lab::{Digits, measure};
use foveate::scene::{Detection, Image};
use foveate::video::mot::Tracks;
use foveate::video::{Decoder, Options, Pixels, Raw, annotation, decode_image, open_with, vot};
use foveate::{BBox, MultiTracker, Tracker};
use foveate_cli::convert::{Boxes, Format};

use super::{http, message};

/// A target, by name, and the longest input that is worth trying.
pub(crate) type Body = (&'static str, fn(&[u8]), usize);

/// All of them.
pub(crate) const ALL: [Body; 16] = [
    ("pictures", pictures, 1 << 16),
    ("mp4", mp4, 1 << 16),
    ("raw", raw, 1 << 14),
    ("toml", toml, 1 << 13),
    ("models", models, 1 << 16),
    ("states", states, 1 << 20),
    ("mot", mot, 1 << 12),
    ("boxes", boxes, 1 << 12),
    ("annotations", annotations, 1 << 13),
    ("positions", positions, 1 << 12),
    ("lens", lens, 1 << 12),
    ("idx", idx, 1 << 14),
    ("targets", targets, 1 << 10),
    ("calls", calls, 1 << 8),
    ("requests", requests, 1 << 12),
    ("trax", trax, 1 << 12),
];

/// Frames of a source that are looked at, at most.
const FRAMES: usize = 8;

/// PNG and JPEG.
pub(crate) fn pictures(bytes: &[u8]) {
    if let Ok(image) = decode_image(bytes) {
        assert_eq!(image.bytes().len(), image.width() * image.height() * image.planes());
    }
}

/// A file with these bytes, for readers that read files.
fn with_file<T>(name: &str, bytes: &[u8], read: impl FnOnce(&Path) -> T) -> T {
    thread_local!(static PLACE: std::path::PathBuf = {
        // In memory, if there is such a place.
        let memory = Path::new("/dev/shm");
        let place = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
        let place = place.join(format!("foveate-fuzz-{}-{:?}", std::process::id(), std::thread::current().id()));
        std::fs::create_dir_all(&place).expect("a folder for one file");
        place
    });
    PLACE.with(|place| {
        let path = place.join(name);
        std::fs::write(&path, bytes).expect("room for a small file");
        let value = read(&path);
        let _ = std::fs::remove_file(path);
        value
    })
}

fn frames(path: &Path, options: &Options) {
    if let Ok(source) = open_with(path, options) {
        source.take(FRAMES).for_each(drop);
    }
}

/// MP4 and the decoders of H.264 behind it.
pub(crate) fn mp4(bytes: &[u8]) {
    let options = Options { decoder: Decoder::Builtin, ..Options::default() };
    with_file("a.mp4", bytes, |path| frames(path, &options));
}

/// yuv4mpeg, or bare pixels where the first byte is odd.
pub(crate) fn raw(bytes: &[u8]) {
    let Some((first, rest)) = bytes.split_first() else { return };
    let raw = (first % 2 == 1).then(|| Raw {
        width: usize::from(first >> 4) + 1,
        height: usize::from(first >> 2 & 3) + 1,
        pixels: Pixels::ALL[usize::from(first >> 1) % 3].1,
    });
    let options = Options { raw, decoder: Decoder::Builtin, ..Options::default() };
    with_file("a.y4m", if raw.is_some() { rest } else { bytes }, |path| frames(path, &options));
}

/// Configurations, and trackers made from them.
pub(crate) fn toml(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(config) = Config::parse(text, "fuzz") {
        let again = Config::parse(&config.to_toml(), "written").expect("what is written can be read");
        assert_eq!(again.to_toml(), config.to_toml());
        // A tracker of a hundred thousand particles is right, and slow to make.
        if config.particles <= 1000 {
            let _ = config.check(&Nowhere);
        }
    }
}

/// Model files of all kinds.
pub(crate) fn models(bytes: &[u8]) {
    use foveate::learn::{filters::PatchFilters, rbm, softmax::Softmax};
    let path = Path::new("fuzz.safetensors");
    drop(rbm::Rbm::from_bytes(bytes, path));
    drop(rbm::fixations::FixationRbm::from_bytes(bytes, path));
    drop(PatchFilters::from_bytes(bytes, path));
    drop(Softmax::from_bytes(bytes, path));
    drop(foveate::identity::Classifier::from_bytes(bytes, path));
}

/// Small and quick.
const SMALL: &str = "particles = 20\n[dynamics]\nkind = \"autoregressive\"\n[retina]\nkind = \"foveal\"\nside = 8\nrings = [[4, 1], [8, 2]]\n\
    [encoder]\nkind = \"raw\"\n[likelihood]\ndistance = \"cosine\"\nsharpness = 10\n[policy]\nkind = \"hedge\"\ngamma = 0.5\n[discriminant]\n[colour]\n\
    [redetection]\n[distractors]\n";
/// What one target remembers besides.
const OF_ONE: &str = "[local_search]\n[camera_motion]\n[box_regression]\n[confidence]\nabsence = { rate = 0.25, weight = 3.0, bias = 1.0 }\n";

fn blueprint(text: &str) -> Blueprint {
    let config = Config::parse(text, "small").expect("a configuration");
    config.check(&Folder::here()).expect("parts that fit")
}

fn one() -> &'static Blueprint {
    static ONE: OnceLock<Blueprint> = OnceLock::new();
    ONE.get_or_init(|| {
        let remembered = SMALL.replace("[distractors]\n", "[distractors]\nremembered = 4\nfirst_frame = true\n");
        let second = "committee = 2\nsecond_opinion = \"builtin:natural-middle\"\n";
        blueprint(&format!("{second}{remembered}{OF_ONE}"))
    })
}

fn several() -> &'static Blueprint {
    static SEVERAL: OnceLock<Blueprint> = OnceLock::new();
    // With fewer looks than targets, so that some wait.
    SEVERAL.get_or_init(|| blueprint(&format!("{SMALL}[detection_likelihood]\n[multi_target.attention]\nbudget = 2\n")))
}

const SIDE: usize = 40;

fn picture(t: u8) -> Image {
    let pixel = |k: usize| (((k % SIDE + usize::from(t)) * 37 % 251) ^ (k / SIDE)) as u8;
    Image::new(SIDE, SIDE, 3, (0..3 * SIDE * SIDE).map(pixel).collect()).expect("whole")
}

/// Saved trackers, of one target and of many, which then continue.
pub(crate) fn states(bytes: &[u8]) {
    goes_on(bytes);
}

/// Whether it is a saved tracker of one target or of many; if so, it continues.
pub(crate) fn goes_on(bytes: &[u8]) -> bool {
    let Ok(state) = serde_json::from_slice(bytes) else { return false };
    let start = || one().tracker(1).expect("parts that fit");
    let mut tracker = start();
    let loaded = tracker.load(&state).is_ok();
    if loaded && tracker.update(&picture(1)).is_ok() {
        start().load(&tracker.save()).expect("what is saved can be loaded");
    }
    let start = || several().multi_tracker(1).expect("parts that fit");
    let mut many = start();
    if many.load(&state).is_err() {
        return loaded;
    }
    // Beside each target, and on it.
    let at = |b: BBox| [0.0, 0.4].map(|off| Detection::new(BBox { x: b.x + off * b.w, ..b }, 0.9));
    let found: Vec<_> = many.targets().iter().flat_map(|target| at(target.bbox)).collect();
    if many.update(&picture(1), &found).is_ok() {
        start().load(&many.save()).expect("what is saved can be loaded");
    }
    true
}

/// States to begin from.
#[allow(dead_code)]
pub(crate) fn saved() -> [(&'static str, Vec<u8>); 2] {
    let mut tracker = one().tracker(1).expect("parts that fit");
    tracker.init(&picture(0), BBox::new(10.0, 12.0, 12.0, 9.0)).expect("a box in the picture");
    tracker.update(&picture(1)).expect("a picture of the same size");
    let mut many = several().multi_tracker(1).expect("parts that fit");
    for t in 0..3 {
        many.update(&picture(t), &[]).expect("a picture of the same size");
        let at = 4.0 + 6.0 * f64::from(t);
        many.add(&picture(t), None, BBox::new(at, at, 8.0, 8.0)).expect("a box in the picture");
    }
    many.update(&picture(3), &[]).expect("a picture of the same size");
    let text = |state: SavedState| state.to_string().into_bytes();
    [("tracker.json", text(tracker.save())), ("many.json", text(many.save()))]
}

/// MOTChallenge's text.
pub(crate) fn mot(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(tracks) = Tracks::parse(text, Path::new("fuzz.txt")) {
        Tracks::parse(&tracks.text(), Path::new("written.txt")).expect("what is written can be read");
    }
}

/// OTB's and VOT's texts.
pub(crate) fn boxes(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let path = Path::new("fuzz.txt");
    // At the largest numbers, a count from 1 overflows.
    let sane =
        |boxes: &[Option<BBox>]| boxes.iter().flatten().all(|b| [b.x, b.y, b.w, b.h].iter().all(|x| x.abs() < 1e6));
    if let Some(boxes) = annotation::parse_boxes(text, path).ok().filter(|boxes| sane(boxes)) {
        annotation::parse_boxes(&annotation::format_truth(&boxes), path).expect("what is written can be read");
    }
    if let Some(truth) = vot::parse_truth(text, path).ok().filter(|truth| sane(truth)) {
        vot::parse_truth(&vot::format_truth(&truth), path).expect("what is written can be read");
    }
}

/// CVAT's XML, COCO's and Label Studio's JSON, the CSV of VIAME, TrackMate and napari.
pub(crate) fn annotations(bytes: &[u8]) {
    let size = Some(Size { width: 64, height: 48 });
    for format in [Format::Cvat, Format::Coco, Format::LabelStudio, Format::Viame, Format::Trackmate, Format::Napari] {
        with_file("boxes", bytes, |path| {
            let Ok(boxes) = Boxes::read_of_size(format, path, size) else { return };
            let written = path.with_extension("written");
            if boxes.write(format, &written).is_ok() {
                drop(Boxes::read_of_size(format, &written, size));
                let _ = std::fs::remove_file(written);
            }
        });
    }
}

/// A track.csv that is measured: options in lines `name=text` before it, as the page sends them, and all files.
pub(crate) fn positions(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let start = text.find("frame,").unwrap_or(0);
    let (options, track) = text.split_at(start);
    let Ok(positions) = measure::parse(track, Path::new("track.csv")) else { return };
    let option = |name: &str| options.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix('='));
    let axes = measure::Axes {
        ruler: option("ruler").and_then(|text| text.parse().ok()),
        origin: option("origin").and_then(|text| measure::parse_point(text).ok()),
        angle: option("angle").and_then(|text| measure::parse_angle(text).ok()).unwrap_or(0.0),
    };
    let parabola = measure::FitRequest { curve: measure::Curve::Parabola, axis: 1, range: None };
    let fits = vec![option("fit").and_then(|text| text.parse().ok()).unwrap_or(parabola)];
    let clock = option("fps").and_then(|text| text.parse().ok());
    let point = measure::Track { name: "fuzz".into(), positions };
    if let Ok(measured) =
        measure::measure(&[point], None, &measure::Settings { axes, clock, fits, ..Default::default() })
    {
        measure::text(&measured);
        measure::tables(None, 1.0, &measured);
    }
}

/// Calibrations of a camera, as OpenCV and ROS write them.
pub(crate) fn lens(bytes: &[u8]) {
    if let Ok(lens) = with_file("lens.yml", bytes, measure::Lens::read) {
        let _ = lens.undistort((3.0, 4.0));
    }
}

/// MNIST's files, packed or not: pictures and labels, split in the middle.
pub(crate) fn idx(bytes: &[u8]) {
    let (images, labels) = bytes.split_at(bytes.len() - bytes.len() / 4);
    with_file("images", images, |images| with_file("labels", labels, |labels| drop(Digits::read(images, labels))));
}

/// Takes bytes off the front; zeros at the end.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }
    /// A coordinate: most often one in the picture, now and then any number at all.
    fn number(&mut self) -> f64 {
        match self.byte() {
            255 => f64::NAN,
            254 => f64::INFINITY,
            253 => -1e300,
            252 => f64::from_bits(u64::from_le_bytes(std::array::from_fn(|_| self.byte()))),
            byte => f64::from(byte) / 4.0 - 8.0,
        }
    }
    fn bbox(&mut self) -> BBox {
        BBox { x: self.number(), y: self.number(), w: self.number(), h: self.number() }
    }
    fn detection(&mut self) -> Detection {
        Detection::new(self.bbox(), self.number())
    }
}

/// Many targets: boxes and detections of any kind, cuts, states.
pub(crate) fn targets(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let mut many = several().multi_tracker(1).expect("parts that fit");
    for t in 0..12 {
        if bytes.0.is_empty() {
            break;
        }
        let (image, n) = (picture(t), bytes.byte() % 5);
        let found: Vec<Detection> = (0..n).map(|_| bytes.detection()).collect();
        let _ = many.update(&image, &found);
        match bytes.byte() % 6 {
            0 | 1 => drop(many.add(&image, None, bytes.bbox())),
            2 => drop(many.add(&image, Some(u64::from(bytes.byte() % 4)), bytes.bbox())),
            3 => many.cut(),
            4 => many = reloaded(&many),
            _ => many.skip(&image),
        }
    }
}

fn reloaded(many: &MultiTracker) -> MultiTracker {
    let mut again = several().multi_tracker(1).expect("parts that fit");
    again.load(&many.save()).expect("what is saved can be loaded");
    again
}

/// The calls of the facade in any order.
pub(crate) fn calls(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let mut tracker: Tracker = one().tracker(1).expect("parts that fit");
    for t in 0..16 {
        if bytes.0.is_empty() {
            break;
        }
        let image = picture(t);
        match bytes.byte() % 8 {
            0 => drop(tracker.init(&image, bytes.bbox())),
            1 | 2 => drop(tracker.update(&image).map(|seen| seen.region(0.9))),
            3 => drop(tracker.update_with(&image, &[bytes.detection()])),
            4 => drop(tracker.reset_at(bytes.bbox())),
            5 => tracker.set_visibility(bytes.number()),
            6 => drop(tracker.skip(&image)),
            _ => {
                let mut again = one().tracker(1).expect("parts that fit");
                again.load(&tracker.save()).expect("what is saved can be loaded");
                tracker = again;
            }
        }
    }
}

/// Requests to `foveate serve`.
pub(crate) fn requests(bytes: &[u8]) {
    struct Sent<'a>(&'a [u8]);
    impl std::io::Read for Sent<'_> {
        fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
            self.0.read(into)
        }
    }
    impl std::io::Write for Sent<'_> {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    let mut connection = http::Connection::new(Sent(bytes));
    while let Ok(request) = connection.request(&|_| true) {
        assert!(request.body.len() <= if request.path == "/push" { http::MOST_PICTURE } else { http::MOST_BODY });
        let _ = (request.query("a"), request.header("host"));
    }
}

/// Lines of TraX.
pub(crate) fn trax(bytes: &[u8]) {
    let mut input = bytes;
    while let Ok(Some(message)) = message::next(&mut input) {
        drop(message);
    }
}
