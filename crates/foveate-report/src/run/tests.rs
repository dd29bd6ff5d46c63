use super::*;
use foveate_base::files::Nowhere;
use foveate_core::config::Config;
use foveate_core::multi::Phase;
use foveate_video::{ImageFolder, SourceInfo, save_png};

/// A pipe that must not be read beyond the last frame that has come.
struct Pipe {
    info: SourceInfo,
    come: std::ops::Range<usize>,
    image: Image,
}

impl Iterator for Pipe {
    type Item = Result<Frame>;
    fn next(&mut self) -> Option<Self::Item> {
        let index = self.come.next().expect("it would wait for a frame");
        Some(Ok(Frame { index, time: 0.0, image: self.image.clone() }))
    }
}

impl FrameSource for Pipe {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
}

/// A stream that drops frames 2 to 4.
struct Dropping(Pipe);

impl Iterator for Dropping {
    type Item = Result<Frame>;
    fn next(&mut self) -> Option<Self::Item> {
        let index = self.0.come.find(|index| !(2..5).contains(index))?;
        Some(Ok(Frame { index, time: 0.0, image: self.0.image.clone() }))
    }
}

impl FrameSource for Dropping {
    fn info(&self) -> &SourceInfo {
        &self.0.info
    }
}

struct Numbers(Vec<usize>);

impl Observer for Numbers {
    fn observe(&mut self, frame: &Frame, _: &[Seen<'_>]) -> Result<()> {
        self.0.push(frame.index);
        Ok(())
    }
}

fn picture() -> Image {
    Image::from_grey8(96, 64, &(0..96 * 64).map(|i| (i * 31 % 251) as u8).collect::<Vec<_>>()).expect("96 x 64")
}

#[test]
fn nothing_is_read_after_the_last_frame_of_the_plan() {
    let info = SourceInfo { width: 96, height: 64, frames: None, rate: 30.0, reader: String::new() };
    let (mut pipe, mut numbers) = (Pipe { info, come: 0..5, image: picture() }, Numbers(vec![]));
    let config = Config::builtin("multi").expect("it ships").expect("it is right");
    let mut tracker = config.check(&Nowhere).expect("it fits").multi_tracker(1).expect("trackers");
    let (summary, result) =
        run(&mut pipe, &mut tracker, &mut numbers, RunPlan { from: 2, until: 4, ..RunPlan::default() });
    result.expect("three frames");
    assert_eq!((numbers.0, summary.frames, summary.stopped), (vec![2, 3, 4], 3, false));
}

#[test]
fn a_target_that_is_given_again_is_counted_once_and_one_after_the_end_is_reported() {
    struct AtEnd(Warnings, Vec<String>);
    impl Observer for AtEnd {
        fn observe(&mut self, _: &Frame, _: &[Seen<'_>]) -> Result<()> {
            Ok(())
        }
        fn finish(&mut self) -> Result<()> {
            self.1 = self.0.all();
            Ok(())
        }
    }
    let dir = tempfile::tempdir().expect("a folder");
    let image = picture();
    (0..6).for_each(|t| save_png(dir.path().join(format!("{t}.png")), &image).expect("writable"));
    let config = Config::builtin("multi").expect("it ships").expect("it is right");
    let blueprint = Config { particles: 50, ..config }.check(&Nowhere).expect("it fits");
    let mut tracker = blueprint.multi_tracker(1).expect("trackers");
    let (a, b) = (BBox::new(10.0, 10.0, 20.0, 20.0), BBox::new(60.0, 30.0, 20.0, 20.0));
    let given =
        [(0, 7, a), (0, 8, b), (4, 7, a), (6, 9, b)].map(|(frame, id, bbox)| Given { frame, id: Some(id), bbox });
    let mut source = ImageFolder::open(dir.path()).expect("images");
    let mut seen = AtEnd(Warnings::default(), vec![]);
    let plan = RunPlan { given: &given, warnings: seen.0.clone(), ..RunPlan::default() };
    let (summary, result) = run(&mut source, &mut tracker, &mut seen, plan);
    result.expect("tracked");
    assert_eq!((summary.frames, summary.initiated), (6, 2));
    assert!(matches!(&seen.1[..], [late] if late.starts_with("1 of the first boxes")), "{:?}", seen.1);
}

#[test]
fn boxes_of_dropped_frames_are_used_in_the_next_one() {
    #[derive(Default)]
    struct Given(Vec<(usize, BBox)>);
    impl Observer for Given {
        fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
            self.0.extend(targets.iter().filter(|seen| seen.is_given()).map(|seen| (frame.index, seen.bbox)));
            Ok(())
        }
    }
    let stream = || {
        let info = SourceInfo { width: 96, height: 64, frames: None, rate: 30.0, reader: String::new() };
        Dropping(Pipe { info, come: 0..8, image: picture() })
    };
    let [a, b, c] = [10.0, 20.0, 30.0].map(|x| BBox::new(x, 10.0, 20.0, 20.0));
    let config = Config::builtin("natural-fast").expect("it ships").expect("it is right");
    let mut tracker = config.check(&Nowhere).expect("it fits").tracker(1).expect("it fits");
    let given = [(3, b), (4, c)].map(|(frame, bbox)| super::Given { frame, id: None, bbox });
    let mut seen = Given::default();
    let plan = RunPlan { init: Some(a), given: &given, ..RunPlan::default() };
    run(&mut stream(), &mut tracker, &mut seen, plan).1.expect("tracked");
    assert_eq!(seen.0, [(0, a), (5, c)]);
    // Of many targets each starts.
    let config = Config::builtin("multi").expect("it ships").expect("it is right");
    let blueprint = Config { particles: 50, ..config }.check(&Nowhere).expect("it fits");
    let mut tracker = blueprint.multi_tracker(1).expect("trackers");
    let plan = RunPlan { given: &given, ..RunPlan::default() };
    let (summary, result) = run(&mut stream(), &mut tracker, &mut Numbers(vec![]), plan);
    result.expect("tracked");
    assert_eq!((summary.frames, summary.initiated), (5, 2));
}

#[test]
fn frames_with_a_lost_target_of_many_are_counted() {
    let target = |phase| {
        let mut seen = Seen::given([96, 64, 1], &BBox::new(1.0, 1.0, 9.0, 9.0));
        seen.phase = phase;
        seen
    };
    let (well, hidden, lost) = (Phase::Tracked, Phase::Occluded, Phase::Lost);
    let mut summary = RunSummary::default();
    for frame in [&[well, well][..], &[well, hidden], &[hidden, lost], &[lost]] {
        let targets: Vec<_> = frame.iter().map(|phase| target(*phase)).collect();
        summary.add_all(&targets, &mut HashSet::new());
    }
    assert_eq!((summary.occluded, summary.lost), (1, 2));
}

/// A state saved then continues with the frame after it.
#[test]
fn a_frame_is_tracked_though_its_observer_fails() {
    struct Broken;
    impl Observer for Broken {
        fn observe(&mut self, frame: &Frame, _: &[Seen<'_>]) -> Result<()> {
            if frame.index == 3 { Err(Error::Invalid("nobody reads".into())) } else { Ok(()) }
        }
    }
    let source = || {
        let info = SourceInfo { width: 96, height: 64, frames: None, rate: 30.0, reader: String::new() };
        Pipe { info, come: 0..9, image: picture() }
    };
    let bbox = BBox::new(10.0, 10.0, 20.0, 20.0);
    let blueprint = |name| Config::builtin(name).expect("it ships").expect("it is right").check(&Nowhere);
    let one = blueprint("natural-fast").expect("it fits");
    let after = |observer: &mut dyn Observer, until| {
        let (mut tracker, mut last) = (one.tracker(1).expect("it fits"), 0);
        let mut progress = |frame: &Frame| last = frame.index;
        let plan = RunPlan { init: Some(bbox), until, progress: Some(&mut progress), ..RunPlan::default() };
        let (_, result) = run(&mut source(), &mut tracker, observer, plan);
        (serde_json::to_value(tracker.save()).expect("plain data"), last, result.is_ok())
    };
    let (state, last, well) = after(&mut Broken, 8);
    assert!(last == 3 && !well);
    assert!(after(&mut Numbers(vec![]), 3) == (state, 3, true), "it is that after frame 3");
    let mut many = blueprint("multi").expect("it fits").multi_tracker(1).expect("trackers");
    let mut last = 0;
    let mut progress = |frame: &Frame| last = frame.index;
    let given = [Given { frame: 0, id: None, bbox }];
    let plan = RunPlan { given: &given, progress: Some(&mut progress), ..RunPlan::default() };
    assert!(run(&mut source(), &mut many, &mut Broken, plan).1.is_err() && last == 3);
}
