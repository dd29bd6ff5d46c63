//! A track that grows on request, and that can be resumed at any of its frames.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::lines::Lines;
use crate::player::Frames;
use crate::row::{self, Row, Surface};
use crate::texts::Texts;
use foveate_base::files::Files;
use foveate_base::{Error, Result};
use foveate_core::config::{Blueprint, Config};
use foveate_core::geometry::BBox;
use foveate_core::{Seen, Tracker, start};
use foveate_video::Frame;

/// Maximum number of frames of a track; for an endless source, of stored results.
pub(crate) const MOST_FRAMES: usize = 100_000;
/// Maximum size of stored details, and of saved states, in bytes; and of details if frames do not repeat.
const DETAILS: usize = 32 << 20;
const STATES: usize = 32 << 20;
const RECENT_DETAILS: usize = 1 << 18;
/// Number of frames between saved states.
const EVERY: usize = 50;

/// The tracking setup.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The checked configuration.
    pub blueprint: Blueprint,
    /// Its name.
    pub config: String,
    /// The policy that replaces the configuration's own.
    pub policy: Option<String>,
    /// The seed.
    pub seed: u64,
}

impl Setup {
    /// Creates a setup from a named configuration in which the policy is already replaced; uses its own seed if none is given.
    ///
    /// # Errors
    /// It is for many targets, or a part of it does not fit.
    pub fn new(
        config: Config,
        files: &dyn Files,
        name: String,
        policy: Option<String>,
        seed: Option<u64>,
    ) -> Result<Self> {
        if config.multi_target.is_some() {
            return Err(Error::Config(
                "this configuration is for many targets, the page follows one; choose another".into(),
            ));
        }
        let seed = seed.unwrap_or(config.seed);
        Ok(Self { blueprint: config.check(files)?, config: name, policy, seed })
    }
}

/// A track.
pub(crate) struct Tracking {
    /// The tracking setup.
    pub setup: Setup,
    tracker: Tracker,
    /// The results as text.
    pub lines: Lines,
    /// The first frame, from 0.
    first: usize,
    /// The number of frames.
    count: usize,
    /// Rows that were not taken yet.
    rows: Vec<Row>,
    /// Boxes given by hand, by frame from 0.
    given: BTreeMap<usize, BBox>,
    details: Texts,
    /// Saved tracker states after some frames.
    states: Texts,
    every: usize,
    /// Whether the video has ended.
    ended: bool,
}

impl Tracking {
    /// Starts on a box in frame `index` (from 0).
    ///
    /// # Errors
    /// There is no such frame, or the box does not fit it.
    pub(crate) fn start(frames: &mut dyn Frames, lines: Lines, setup: Setup, index: usize, bbox: BBox) -> Result<Self> {
        let tracker = setup.blueprint.tracker(setup.seed)?;
        let details = if frames.repeats() { DETAILS } else { RECENT_DETAILS };
        let mut tracking = Self {
            setup,
            tracker,
            lines,
            first: index,
            count: 0,
            rows: vec![],
            given: BTreeMap::new(),
            details: Texts::new(details),
            states: Texts::new(STATES),
            every: EVERY,
            ended: false,
        };
        tracking.give(frames, index, bbox)?;
        Ok(tracking)
    }

    /// Returns a row for each frame tracked since the last call. A track keeps no rows: the page stores them.
    pub(crate) fn take_rows(&mut self) -> Vec<Row> {
        std::mem::take(&mut self.rows)
    }
    /// Returns the number of frames.
    pub(crate) fn frames(&self) -> usize {
        self.count
    }
    /// Returns the first frame, from 0.
    pub(crate) fn first(&self) -> usize {
        self.first
    }
    /// Returns the last tracked frame, from 0.
    pub(crate) fn last(&self) -> usize {
        self.first + self.count - 1
    }
    /// Returns whether the video has ended.
    pub(crate) fn ended(&self) -> bool {
        self.ended
    }
    /// Returns the boxes given by hand, by frame from 0.
    pub(crate) fn given(&self) -> &BTreeMap<usize, BBox> {
        &self.given
    }
    /// Returns the detail of a frame (from 0), as JSON; `None` if it was not kept.
    pub(crate) fn detail(&self, index: usize) -> Option<&str> {
        self.details.all.get(&index).map(|text| &**text)
    }
    /// Returns the policy's reward surface after the last frame.
    pub(crate) fn surface(&self) -> Option<Surface> {
        row::surface(self.tracker.parts().gaze.policy().snapshot())
    }

    /// Tracks the next frame, if the video has one.
    ///
    /// # Errors
    /// The video breaks off, or the track is too long.
    pub(crate) fn step(&mut self, frames: &mut dyn Frames) -> Result<()> {
        if self.ended {
            return Ok(());
        }
        if self.count >= MOST_FRAMES && frames.repeats() {
            return Err(Error::Invalid(format!("the page tracks {MOST_FRAMES} frames at most; use foveate track")));
        }
        self.go_on(frames, self.last() + 1)
    }

    /// Sets a box by hand in a tracked frame (from 0): removes the track from there on and restarts the target, as `--reinit` does. If
    /// frames do not repeat, the frame must still be stored.
    ///
    /// # Errors
    /// The frame was not tracked, is no longer available, or the box does not fit it.
    pub(crate) fn correct(&mut self, frames: &mut dyn Frames, index: usize, bbox: BBox) -> Result<()> {
        if !(self.first..=self.last()).contains(&index) {
            let (first, last) = (self.first + 1, self.last() + 1);
            return Err(Error::Invalid(format!("frames {first} to {last} are tracked; correct one of these")));
        }
        // Check first, before removing anything: the frame may be unavailable, and the box may not fit it.
        let frame = needed(frames, index)?;
        start::check(&frame.image, &bbox)?;
        if !frames.repeats() {
            self.cut(index);
        } else if index == self.first {
            self.tracker = self.setup.blueprint.tracker(self.setup.seed)?;
            self.cut(index);
        } else {
            self.rewind(frames, index - 1)?;
        }
        self.begin(&frame, frames.repeats(), bbox)
    }

    /// Restores the tracker to its state after frame `index`, from the last saved state before it and the frames since.
    fn rewind(&mut self, frames: &mut dyn Frames, index: usize) -> Result<()> {
        let saved = self.states.all.range(..=index).next_back().map(|(k, text)| (*k, text.clone()));
        let (from, text) =
            saved.ok_or_else(|| Error::Invalid("the track cannot be taken up there; start anew".into()))?;
        let state = text.parse()?;
        let frame =
            frames.frame(from)?.ok_or_else(|| Error::Invalid("the video has become shorter; open it again".into()))?;
        let mut tracker = self.setup.blueprint.tracker(self.setup.seed)?;
        tracker.load(&state)?;
        tracker.skip(&frame.image)?;
        self.tracker = tracker;
        let given = self.given.clone();
        self.cut(from + 1);
        for k in from + 1..=index {
            match given.get(&k) {
                Some(bbox) => self.give(frames, k, *bbox)?,
                None => self.go_on(frames, k)?,
            }
        }
        Ok(())
    }

    /// Removes everything from frame `index` on.
    fn cut(&mut self, index: usize) {
        self.count = index - self.first;
        self.rows.retain(|row| row.frame <= index);
        self.given.retain(|k, _| *k < index);
        self.details.cut(index);
        self.states.cut(index);
        self.lines.cut(index);
        self.ended = false;
    }

    fn give(&mut self, frames: &mut dyn Frames, index: usize, bbox: BBox) -> Result<()> {
        let frame = needed(frames, index)?;
        self.begin(&frame, frames.repeats(), bbox)
    }

    fn begin(&mut self, frame: &Frame, repeats: bool, bbox: BBox) -> Result<()> {
        self.tracker.set_time(frame.time);
        self.tracker.init(&frame.image, bbox)?;
        self.given.insert(frame.index, bbox);
        self.count += 1;
        let seen = Seen::given(frame.image.shape(), &bbox);
        self.rows.push(Row::of(frame, &seen));
        self.lines.observe(frame, &seen)?;
        self.save(frame.index, repeats);
        Ok(())
    }

    fn go_on(&mut self, frames: &mut dyn Frames, index: usize) -> Result<()> {
        let Some(frame) = frames.frame(index)? else {
            self.ended = true;
            return Ok(());
        };
        self.tracker.set_time(frame.time);
        let seen = self.tracker.update(&frame.image)?;
        self.lines.observe(&frame, &seen)?;
        self.count += 1;
        self.rows.push(Row::of(&frame, &seen));
        self.details.put(index, row::detail(index + 1, &seen));
        while self.details.bytes > self.details.most {
            self.details.drop_first();
        }
        if (index - self.first).is_multiple_of(self.every) {
            self.save(index, frames.repeats());
        }
        Ok(())
    }

    /// Saves the tracker's state after a frame. If there is no room, removes every other state, and saves later ones less often.
    fn save(&mut self, index: usize, repeats: bool) {
        if !repeats {
            return;
        }
        self.states.put(index, self.tracker.save().to_string());
        while self.states.bytes > self.states.most && self.states.all.len() > 2 {
            self.every *= 2;
            self.states.thin();
        }
    }
}

/// Returns a frame that the video must have.
fn needed(frames: &mut dyn Frames, index: usize) -> Result<Arc<Frame>> {
    let missing = || Error::Invalid(format!("the video has no frame {}; choose an earlier one", index + 1));
    frames.frame(index)?.ok_or_else(missing)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::player::{Player, Reopen};
    use foveate_base::files::Nowhere;
    use foveate_core::config::Config;
    use foveate_core::scene::Image;
    use foveate_video::{FrameSource, ImageFolder, save_png};

    struct Folder(std::path::PathBuf);

    impl Reopen for Folder {
        fn source(&self, _: usize) -> Result<Box<dyn FrameSource>> {
            Ok(Box::new(ImageFolder::open(&self.0)?))
        }
    }

    /// A square that moves one pixel a frame.
    fn pictures() -> tempfile::TempDir {
        let dir = tempfile::tempdir().expect("a folder");
        for t in 0..30 {
            let inside = |x: usize, y: usize| (20 + t..44 + t).contains(&x) && (20..44).contains(&y);
            let pixel = |i: usize| if inside(i % 96, i / 96) { 120 + (i % 5 * 20) as u8 } else { (i * 31 % 67) as u8 };
            let image = Image::from_grey8(96, 64, &(0..96 * 64).map(pixel).collect::<Vec<_>>()).expect("96 x 64");
            save_png(dir.path().join(format!("{t}.png")), &image).expect("writable");
        }
        dir
    }

    fn setup() -> Setup {
        let config = Config::builtin("natural-fast").expect("it ships").expect("it is right");
        let blueprint = config.check(&Nowhere).expect("it fits");
        Setup { blueprint, config: "natural-fast".into(), policy: None, seed: 3 }
    }

    /// A source whose clock jumps by nine frames before frame 15.
    struct Gap(Box<dyn FrameSource>);

    impl Iterator for Gap {
        type Item = Result<Frame>;
        fn next(&mut self) -> Option<Self::Item> {
            let frame = self.0.next()?;
            Some(frame.map(|frame| {
                let time = frame.index + if frame.index < 15 { 0 } else { 9 };
                Frame { time: time as f64 / 30.0, ..frame }
            }))
        }
    }

    impl FrameSource for Gap {
        fn info(&self) -> &foveate_video::SourceInfo {
            self.0.info()
        }
    }

    struct Gapped(Folder);

    impl Reopen for Gapped {
        fn source(&self, from: usize) -> Result<Box<dyn FrameSource>> {
            Ok(Box::new(Gap(self.0.source(from)?)))
        }
    }

    /// Where frames were dropped, the page predicts as a run does.
    #[test]
    fn a_gap_in_the_times_gives_what_a_run_gives() {
        struct Boxes(Vec<[f64; 4]>);
        impl foveate_report::Observer for Boxes {
            fn observe(&mut self, _: &Frame, targets: &[Seen<'_>]) -> Result<()> {
                let b = targets[0].bbox;
                self.0.push([b.x, b.y, b.w, b.h]);
                Ok(())
            }
        }
        let (dir, setup, a) = (pictures(), setup(), BBox::new(20.0, 20.0, 24.0, 24.0));
        let folder = || Folder(dir.path().to_owned());
        let boxes = |frames: &mut dyn Frames| {
            let mut tracking = Tracking::start(frames, Lines::new(None, None, Default::default()), setup.clone(), 0, a)
                .expect("a box in the picture");
            (0..1000).for_each(|_| tracking.step(frames).expect("tracked"));
            tracking.take_rows().iter().map(|row| row.bbox).collect::<Vec<_>>()
        };
        let (even, gapped) = (boxes(&mut Player::new(folder())), boxes(&mut Player::new(Gapped(folder()))));
        let (mut tracker, mut run) = (setup.blueprint.tracker(setup.seed).expect("it fits"), Boxes(vec![]));
        let plan = foveate_report::run::RunPlan { init: Some(a), ..Default::default() };
        let mut source = Gapped(folder()).source(0).expect("a folder of images");
        foveate_report::run::run(&mut *source, &mut tracker, &mut run, plan).1.expect("tracked");
        assert_eq!(gapped, run.0);
        assert_ne!(gapped[15..], even[15..], "the gap matters");
    }

    #[test]
    fn a_correction_gives_what_a_run_with_that_box_gives() {
        let (dir, setup) = (pictures(), setup());
        let (a, b) = (BBox::new(20.0, 20.0, 24.0, 24.0), BBox::new(33.0, 18.0, 26.0, 28.0));
        let mut player = Player::new(Folder(dir.path().to_owned()));
        let frames: &mut dyn Frames = &mut player;
        let start = |frames: &mut dyn Frames| {
            Tracking::start(frames, Lines::new(None, None, Default::default()), setup.clone(), 0, a)
                .expect("a box in the picture")
        };
        let step = |t: &mut Tracking, frames: &mut dyn Frames, count: usize| {
            (0..count).for_each(|_| t.step(frames).expect("tracked"));
        };
        let boxes = |rows: &[Row]| rows.iter().map(|row| row.bbox).collect::<Vec<_>>();
        let mut plain = start(frames);
        step(&mut plain, frames, 11);
        plain.correct(frames, 11, b).expect("it was tracked");
        step(&mut plain, frames, 1000);
        assert!(plain.ended() && plain.frames() == 30);
        let rows = plain.take_rows();
        assert!(rows.len() == 30 && rows[11].given && plain.take_rows().is_empty());
        // Further on, then back; by a state in between, and by one at the start.
        for every in [4, 50] {
            let mut back = start(frames);
            back.every = every;
            step(&mut back, frames, 1000);
            let before = back.take_rows();
            assert_ne!(boxes(&before)[12..], boxes(&rows)[12..], "the correction matters");
            back.correct(frames, 20, a).expect("it was tracked");
            back.correct(frames, 11, b).expect("it was tracked");
            assert_eq!(back.frames(), 12);
            step(&mut back, frames, 1000);
            let after = back.take_rows();
            assert_eq!(boxes(&after[after.len() - 19..]), boxes(&rows[11..]));
            assert_eq!(back.given().len(), 2);
        }
        assert!(plain.correct(frames, 30, b).expect_err("not tracked").to_string().contains("1 to 30"));
        // A box that does not fit changes nothing, in the first frame neither.
        for index in [11, 0] {
            assert!(plain.correct(frames, index, BBox::new(900.0, 0.0, 9.0, 9.0)).is_err());
            assert_eq!((plain.frames(), plain.last(), plain.given().len()), (30, 29, 2));
            assert!(plain.ended() && plain.step(frames).is_ok() && plain.take_rows().is_empty());
        }
    }
}
