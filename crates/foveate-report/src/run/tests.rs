use super::*;
use foveate_base::files::Nowhere;
use foveate_core::config::Config;
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
fn a_target_that_is_given_again_is_counted_once() {
    let dir = tempfile::tempdir().expect("a folder");
    let image = picture();
    (0..6).for_each(|t| save_png(dir.path().join(format!("{t}.png")), &image).expect("writable"));
    let config = Config::builtin("multi").expect("it ships").expect("it is right");
    let blueprint = Config { particles: 50, ..config }.check(&Nowhere).expect("it fits");
    let mut tracker = blueprint.multi_tracker(1).expect("trackers");
    let (a, b) = (BBox::new(10.0, 10.0, 20.0, 20.0), BBox::new(60.0, 30.0, 20.0, 20.0));
    let given = [(0, 7, a), (0, 8, b), (4, 7, a)].map(|(frame, id, bbox)| Given { frame, id: Some(id), bbox });
    let mut source = ImageFolder::open(dir.path()).expect("images");
    let plan = RunPlan { given: &given, ..RunPlan::default() };
    let (summary, result) = run(&mut source, &mut tracker, &mut Numbers(vec![]), plan);
    result.expect("tracked");
    assert_eq!((summary.frames, summary.initiated), (6, 2));
}
