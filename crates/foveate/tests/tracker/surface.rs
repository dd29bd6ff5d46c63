//! A policy with a reward surface as results show it: report, trace, video and picture of a short real run.

use foveate_testing::need;
use std::path::Path;
use std::sync::Arc;

use crate::common::shown;
use foveate::Seen;
use foveate::control::{Autoregressive, ConfidenceModel, ConsistencySettings, Prior, VarianceReduction};
use foveate::gaze::{Context, Plan, Policy, PolicySnapshot, Surface};
use foveate::geometry::{BBox, Gaze};
use foveate::identity::distance::Kind;
use foveate::identity::encoder::Raw;
use foveate::identity::gaze_appearance::{GazeAppearance, Sharpness};
use foveate::identity::retina::FovealConfig;
use foveate::identity::{Foveal, Retina};
use foveate::report::heat::Heat;
use foveate::report::{Annotator, Observer, Report, RunInfo, SurfacePicture, Trace};
use foveate::rng::Rng;
use foveate::scene::{Image, Preprocessor};
use foveate::video::Frame;
use foveate::{Filter, GazeControl, Monitor, Parts, Tracker};
use rand::RngExt;
use serde_json::Value;

const FRAMES: usize = 40;
const INIT: BBox = BBox { x: 20.0, y: 22.0, w: 32.0, h: 24.0 };

/// Looks at random and reports a hill that grows with the looks: a stand-in for a policy that learns.
#[derive(Default)]
struct Wanderer {
    looks: Vec<Gaze>,
}

impl Policy for Wanderer {
    fn plan(&mut self, _: &Context, plan: &mut Plan, rng: &mut Rng) {
        let mut place = || rng.random_range(-0.9..0.9);
        plan.only(Gaze { u: place(), v: place(), arm: None });
    }
    fn learn(&mut self, plan: &Plan, _: &[f64]) {
        self.looks.push(plan.chosen());
    }
    fn snapshot(&self) -> PolicySnapshot<'_> {
        PolicySnapshot::Surface(self)
    }
}

impl Surface for Wanderer {
    fn reach(&self) -> f64 {
        1.0
    }
    fn at(&self, u: f64, v: f64) -> (f64, f64) {
        let known = self.looks.len() as f64 / FRAMES as f64;
        let near = self.looks.iter().map(|g| (-12.0 * ((g.u - u).powi(2) + (g.v - v).powi(2))).exp()).sum::<f64>();
        (0.3 + 0.5 * known * (-2.0 * ((u - 0.5).powi(2) + (v + 0.25).powi(2))).exp(), 0.2 / (1.0 + near).sqrt())
    }
    fn fixations(&self) -> &[Gaze] {
        &self.looks
    }
    fn best(&self) -> Option<Gaze> {
        (!self.looks.is_empty()).then_some(Gaze { u: 0.5, v: -0.25, arm: None })
    }
}

fn retina() -> Arc<dyn Retina> {
    Arc::new(Foveal::new(FovealConfig::authors()).expect("the authors' geometry"))
}

fn tracker() -> Tracker {
    let retina = retina();
    let channels: Vec<usize> = retina.cells().iter().map(|c| c.channel).collect();
    let encoder = Arc::new(Raw::new(&channels, true));
    let appearance =
        GazeAppearance::new(retina, encoder, Kind::Cosine, Sharpness::Fixed(20.0)).expect("parts that fit");
    let prior = Prior::new(Arc::new(Autoregressive::default()));
    let filter = Filter::new(Box::new(prior), 80).expect("some particles");
    let reward = VarianceReduction::new(0.3).expect("a temperature");
    let gaze = GazeControl::new(Box::new(Wanderer::default()), Box::new(reward));
    let monitor = Monitor::new(ConsistencySettings::default(), ConfidenceModel::default());
    Tracker::from_parts(Parts::new(filter, gaze, Box::new(appearance), monitor), Preprocessor::default(), 3)
}

/// A textured patch drifts over a ramp.
fn frame(index: usize) -> Frame {
    let (w, h) = (120, 80);
    let pixel = |x: usize, y: usize| {
        let (u, v) = (x as isize - 20 - index as isize, y as isize - 22);
        let inside = (0..32).contains(&u) && (0..24).contains(&v);
        let ring = ((u - 16).pow(2) + (v - 12).pow(2)) as f64;
        if inside { (128.0 + 110.0 * (ring.sqrt() / 2.2).sin()) as u8 } else { (x / 2 + y) as u8 }
    };
    let data = (0..w * h).map(|i| pixel(i % w, i / w)).collect();
    Frame { index, time: index as f64 / 25.0, image: Image::new(w, h, 1, data).expect("120 x 80") }
}

fn info() -> RunInfo {
    RunInfo { source: "a/wanderer".into(), rate: 25.0, retina: Some(retina()), ..RunInfo::default() }
}

fn run(observer: &mut dyn Observer, mut look: impl FnMut(&Frame, &Seen<'_>)) {
    let mut tracker = tracker();
    tracker.init(&frame(0).image, INIT).expect("a box in the picture");
    observer.observe(&frame(0), &[Seen::given(frame(0).image.shape(), &INIT)]).expect("room on the disk");
    for index in 1..FRAMES {
        let frame = frame(index);
        let step = tracker.update(&frame.image).expect("a picture of the first size");
        observer.observe(&frame, &[step]).expect("room on the disk");
        look(&frame, &step);
    }
    observer.finish().expect("renamed");
}

/// Where the results of these tests stay, for people to look at; a temporary folder unless $FOVEATE_KEEP names one.
fn folder() -> (Option<tempfile::TempDir>, std::path::PathBuf) {
    match std::env::var_os("FOVEATE_KEEP") {
        Some(kept) => (None, kept.into()),
        None => {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let path = folder.path().to_owned();
            (Some(folder), path)
        }
    }
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).expect("a text file")
}

#[test]
fn the_trace_has_the_surface() {
    let (_kept, folder) = folder();
    let path = folder.join("trace.jsonl");
    let mut heats = vec![];
    run(&mut Trace::create(&path).expect("a writable folder"), |_, step| {
        let PolicySnapshot::Surface(surface) = step.snapshot else { panic!("it has a surface") };
        heats.push(Heat::of(surface, 11));
    });
    let text = read(&path);
    assert_eq!(text.lines().count(), FRAMES);
    for (line, heat) in text.lines().skip(1).zip(&heats) {
        let line: Value = serde_json::from_str(line).expect("JSON");
        let shown = &line["snapshot"];
        let mean: Vec<f64> = serde_json::from_value(shown["mean"].clone()).expect("numbers");
        assert_eq!((shown["points"].as_u64(), shown["reach"].as_f64(), &mean), (Some(11), Some(1.0), &heat.mean));
        assert_eq!((shown["best"]["u"].as_f64(), shown["best"]["v"].as_f64()), (Some(0.5), Some(-0.25)));
    }
}

#[test]
fn the_report_has_a_surface_for_each_picture_and_draws_it() {
    let (_kept, folder) = folder();
    let path = folder.join("report.html");
    run(&mut Report::create(&path, info()).expect("a writable folder"), |_, _| ());
    let page = read(&path);
    let data = page.split("id=\"data\">").nth(1).and_then(|rest| rest.split("</script>").next()).expect("data");
    let data: Value = serde_json::from_str(data).expect("JSON");
    assert_eq!(data["surface"], serde_json::json!([21.0, 1.0]));
    let keys = data["keys"].as_array().expect("keys");
    assert!(keys[0].get("surface").is_none(), "nothing is believed before the first look");
    for key in &keys[1..] {
        assert_eq!(key["surface"]["mean"].as_str().map(str::len), Some((21 * 21usize).div_ceil(3) * 4));
        assert_eq!(key["surface"]["best"], serde_json::json!([0.5, -0.25]));
    }
    let markup = need!(shown(&path, "frame=30"));
    assert!(
        markup.contains("mean reward") && markup.contains("standard deviation") && !markup.contains("script failed")
    );
}

#[test]
fn the_picture_and_the_video_show_it() {
    let (_kept, folder) = folder();
    let path = folder.join("surface.png");
    run(&mut SurfacePicture::create(&path, info()).expect("a writable folder"), |_, _| ());
    let picture = foveate::video::read_image(&path).expect("a picture");
    assert!(picture.width() > 900 && picture.planes() == 3, "{} wide", picture.width());

    let mut annotator = Annotator::new(&info());
    annotator.annotate(&frame(0), &Seen::given(frame(0).image.shape(), &INIT));
    let mut last = None;
    run(&mut Vec::<Box<dyn Observer>>::new(), |frame, step| last = Some(annotator.annotate(frame, step)));
    let last = last.expect("frames");
    // Pale yellow, the top of the ramp, is in the inset: the page has it nowhere else.
    let top = (0..last.width() * last.height()).filter(|&i| {
        let [r, g, b] = [0, 1, 2].map(|p| last.plane(p)[i]);
        r > 200 && g > 180 && b < 150 && i % last.width() > 3 * last.width() / 4
    });
    assert!(top.count() > 20);
    foveate::video::save_png(folder.join("frame.png"), &last).expect("a writable folder");
}
