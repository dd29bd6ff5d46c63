//! A tracker behind a sensor receives the read values alone, counts them, and resumes from a saved state.

use std::sync::Mutex;

use foveate::config::Config;
use foveate::geometry::BBox;
use foveate::scene::Image;
use foveate::scene::sensor::{Regions, Window};
use foveate::video::{TileFolder, write_tiles};
use foveate::{Result, Tracker};

const BOX: BBox = BBox::new(60.0, 40.0, 40.0, 30.0);

/// A textured target that moves over a textured ground.
fn picture(t: usize) -> Image {
    let (w, h) = (200, 150);
    let noise = |x: usize, y: usize, seed: usize| (((x * 7919 + y * 104_729 + seed * 31) * 2_654_435_761) >> 7) as u8;
    let value = |x: usize, y: usize, p: usize| {
        let (left, top) = (60 + 2 * t, 40 + t);
        let on = (left..left + 40).contains(&x) && (top..top + 30).contains(&y);
        if on { noise((x - left) / 5, (y - top) / 5, 5 + p) } else { noise(x / 6, y / 6, p) / 2 }
    };
    let all = (0..3).flat_map(|p| (0..h).flat_map(move |y| (0..w).map(move |x| (x, y, p))));
    Image::new(w, h, 3, all.map(|(x, y, p)| value(x, y, p)).collect()).expect("three planes")
}

/// A picture that records which of its windows were read.
struct Watched {
    image: Image,
    read: Mutex<Vec<Window>>,
}

impl Watched {
    fn new(image: Image) -> Self {
        Self { image, read: Mutex::default() }
    }
    fn windows(&self) -> Vec<Window> {
        self.read.lock().expect("no panic").clone()
    }
    /// The picture with noise wherever nothing was read.
    fn poisoned(&self) -> (Image, usize) {
        let (w, h) = (self.image.width(), self.image.height());
        let read = self.windows();
        let (mut image, mut poisoned) = (self.image.clone(), 0);
        for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
            let inside = |r: &Window| {
                (r.x..r.x + r.columns * r.bin.0).contains(&x) && (r.y..r.y + r.rows * r.bin.1).contains(&y)
            };
            if !read.iter().any(inside) {
                (0..3).for_each(|p| image.plane_mut(p)[y * w + x] = (x * 31 + y * 17 + p * 5) as u8);
                poisoned += 1;
            }
        }
        (image, poisoned)
    }
}

impl Regions for Watched {
    fn shape(&self) -> [usize; 3] {
        self.image.shape()
    }
    fn read(&self, window: Window, out: &mut [u8]) -> Result<usize> {
        self.read.lock().expect("no panic").push(window);
        self.image.read(window, out)
    }
}

fn tracker(name: &str) -> Tracker {
    let config = Config::builtin(name).expect("it ships").expect("it is right");
    Tracker::new(config).expect("it fits")
}

/// Box, P(lost) and values of a frame, to the bit.
type Seen = (BBox, u64, usize);

#[test]
fn what_is_not_read_cannot_be_seen() {
    let config = Config::builtin("foveated").expect("it ships").expect("it is right");
    assert!(config.box_regression.is_some() && config.second_opinion.is_some(), "they, too, see what was read alone");
    let mut watching = tracker("foveated");
    let mut frames = vec![Watched::new(picture(0))];
    watching.init(&frames[0], BOX).expect("a box in the picture");
    let mut seen: Vec<Seen> = vec![];
    for t in 1..12 {
        let frame = Watched::new(picture(t));
        let output = watching.update(&frame).expect("a picture like the first");
        seen.push((output.bbox, output.p_lost.to_bits(), output.values));
        frames.push(frame);
    }
    let truth = BBox::new(60.0 + 22.0, 40.0 + 11.0, 40.0, 30.0);
    assert!(seen[10].0.iou(&truth) > 0.5, "it follows: {:?}", seen[10].0);
    let values = |frame: &Watched| frame.windows().iter().map(|w| 3 * w.columns * w.rows).sum::<usize>();
    let mut blind = tracker("foveated");
    let (first, poisoned) = frames[0].poisoned();
    assert!(poisoned > 0, "a first look does not take in everything");
    blind.init(&first, BOX).expect("a box in the picture");
    for (frame, expected) in frames[1..].iter().zip(&seen) {
        let (image, poisoned) = frame.poisoned();
        assert!(poisoned > 200 * 150 / 4, "most was not read");
        let output = blind.update(&image).expect("a picture like the first");
        assert_eq!(&(output.bbox, output.p_lost.to_bits(), output.values), expected);
        assert_eq!(expected.2, values(frame), "what was read is what is counted");
        assert!((output.share_read() - values(frame) as f64 / 90_000.0).abs() < 1e-12);
    }
}

#[test]
fn a_tracker_behind_a_sensor_goes_on_from_its_saved_state() {
    let (mut one, mut other) = (tracker("foveated"), tracker("foveated"));
    one.init(&picture(0), BOX).expect("a box in the picture");
    (1..5).for_each(|t| assert!(one.update(&picture(t)).expect("a picture").bbox.w > 0.0));
    other.load(&one.save()).expect("it was saved");
    other.skip(&picture(4)).expect("a picture in memory");
    for t in 5..9 {
        let (image, expected) = (picture(t), one.update(&picture(t)).expect("a picture").bbox);
        assert_eq!(other.update(&image).expect("a picture").bbox, expected);
    }
}

/// During exploration all nine parts of the target are read, then one; the chosen part is saved.
#[test]
fn through_a_narrow_window_it_settles_on_a_part() {
    let config =
        Config::builtin("narrow").expect("it ships").and_then(|c| c.set("policy.frames=6")).expect("it is right");
    let make = || Tracker::new(config.clone()).expect("it fits");
    let (mut one, mut other) = (make(), make());
    one.init(&picture(0), BOX).expect("a box in the picture");
    let mut values = vec![];
    for t in 1..9 {
        let image = picture(t);
        let output = one.update(&image).expect("a picture");
        assert_eq!(output.plan.gazes().len(), if t <= 6 { 9 } else { 1 });
        assert_eq!(output.percept.gaze, output.plan.chosen());
        values.push(output.values);
    }
    assert!(values[7] * 2 < values[0], "a part is fewer values than all: {values:?}");
    other.load(&one.save()).expect("it was saved");
    other.skip(&picture(8)).expect("a picture in memory");
    for t in 9..16 {
        let image = picture(t);
        let expected = one.update(&image).expect("a picture");
        let (bbox, chosen) = (expected.bbox, expected.plan.chosen());
        let output = other.update(&image).expect("a picture");
        assert_eq!((output.bbox, output.plan.chosen()), (bbox, chosen));
    }
    let truth = BBox::new(60.0 + 30.0, 40.0 + 15.0, 40.0, 30.0);
    assert!(one.update(&picture(15)).expect("a picture").bbox.iou(&truth) > 0.5, "it follows");
}

#[test]
fn behind_a_sensor_no_policy_looks_twice_or_rehearses() {
    let foveated = || Config::builtin("foveated").expect("it ships").expect("it is right");
    for (policy, said) in [("kind = 'hedge'", "one gaze a frame"), ("kind = 'gp-ucb', rehearsal = 1.0", "saliency")] {
        let problem = foveated().set(&format!("policy={{ {policy} }}")).and_then(Tracker::new).expect_err(said);
        assert!(problem.to_string().contains(said), "{problem}");
    }
    let allowed = foveated().set("policy={ kind = 'gp-ucb', saliency = 1.0 }").and_then(Tracker::new);
    assert!(allowed.is_ok());
}

#[test]
fn regions_need_a_sensor() {
    let mut whole = Tracker::new(Config::builtin("natural").expect("it ships").expect("it is right")).expect("it fits");
    let regions = Watched { image: picture(0), read: Mutex::default() };
    let said = whole.init(&regions, BOX).expect_err("no sensor").to_string();
    assert!(said.contains("[sensor]"), "{said}");
    whole.init(&picture(0), BOX).expect("a box in the picture");
    assert_eq!(whole.update(&picture(1)).expect("a picture").share_read(), 1.0, "camera motion reads all");
}

/// Of a picture of 3840 × 2160 in tiles of 64 × 64, at most 0.2 % of the values are decoded a frame, whole tiles counted.
#[test]
fn a_4k_picture_is_followed_by_its_tiles() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let picture = |t: usize| {
        let noise = |x: usize, y: usize| (((x * 7919 + y * 104_729) * 2_654_435_761) >> 7) as u8;
        let (left, top) = (1600 + 24 * t, 800 + 12 * t);
        let value = |x: usize, y: usize| {
            let on = (left..left + 480).contains(&x) && (top..top + 360).contains(&y);
            if on { noise((x - left) / 120, (y - top) / 90) } else { noise(x / 240 + 9, y / 240) / 3 }
        };
        let data = (0..2160).flat_map(|y| (0..3840).map(move |x| (x, y))).map(|(x, y)| value(x, y)).collect();
        Image::new(3840, 2160, 1, data).expect("one plane")
    };
    (0..3).for_each(|t| write_tiles(dir.path().join(format!("{t}")), &picture(t), 64, 7).expect("written"));
    let video = TileFolder::open(dir.path()).expect("tiles");
    let mut tracker = tracker("foveated");
    conformance_of_a_corner(&video);
    let frame = |t| video.frame(t).expect("three frames");
    tracker.init(&frame(0), BBox::new(1600.0, 800.0, 480.0, 360.0)).expect("a box in the picture");
    for t in 1..3 {
        let tiles = frame(t);
        let output = tracker.update(&tiles).expect("a picture like the first");
        let truth = BBox::new(1600.0 + 24.0 * t as f64, 800.0 + 12.0 * t as f64, 480.0, 360.0);
        assert!(output.bbox.iou(&truth) > 0.7, "frame {t}: {:?} is not {truth:?}", output.bbox);
        assert!(output.share_read() <= 0.002, "{} of the picture", output.share_read());
        assert!(!tiles.decoding().is_zero(), "tiles were decoded");
    }
}

/// A window of tiles holds the pixels of the picture there.
fn conformance_of_a_corner(video: &TileFolder) {
    let tiles = video.frame(0).expect("three frames");
    assert_eq!(tiles.shape(), [3840, 2160, 1]);
    let mut out = vec![0; 4];
    let window = Window { x: 3838, y: 2158, columns: 2, rows: 2, bin: (1, 1) };
    // The last tile is 64 × 48.
    assert_eq!(tiles.read(window, &mut out).expect("a tile"), 64 * 48);
}
