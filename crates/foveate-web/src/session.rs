//! A video that is open: its frames, its tracks, its results.

use std::path::Path;

use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;
use foveate_core::scene::{Image, Pixels};
use foveate_report::RunInfo;
use foveate_report::interactive::{
    FILES, Frames, Player, Recent, Reopen, Results, Setup, Tracks, check_size, described, named, proposed, target_of,
};
use foveate_report::run::check_box;
use foveate_video::{CodedVideo, Planes, SourceInfo};
use serde_json::{Value, json};

use crate::ahead::{Ahead, Decoded};
use crate::save::{Saving, Wanted};
use crate::store::Video;

/// Frames of a report made for one message, at most.
const REPORTED: usize = 10;
/// Frames of a video that the browser may decode, at most: nine hours at 30 a second. Their list is one message.
const MOST_CODED: usize = 1 << 20;

/// Where frames come from.
#[derive(Clone)]
pub enum Source {
    Video(Video, Decoded),
    Live(Recent),
}

impl Source {
    fn frames(&self) -> Box<dyn Frames> {
        match self {
            Self::Video(video, _) => Box::new(Player::new(video.clone())),
            Self::Live(live) => Box::new(live.clone()),
        }
    }
}

pub struct Session {
    name: String,
    source: Source,
    info: SourceInfo,
    truth: Vec<Option<BBox>>,
    /// Frames that are looked at, but not tracked.
    frames: Box<dyn Frames>,
    tracks: Tracks,
    coded: Option<CodedVideo>,
    /// Of each target.
    saving: Vec<Saving>,
}

impl Session {
    /// A video file or pictures.
    pub fn open(name: String, video: Video, truth: Vec<Option<BBox>>) -> Result<Self> {
        let info = video.source(0)?.info().clone();
        let decoded = Decoded::default();
        let ahead = Box::new(Ahead::new(decoded.clone(), video.clone()));
        let tracks = Tracks::new(ahead, Results::Kept(None));
        Self::new(name, Source::Video(video, decoded), tracks, info, truth)
    }

    /// Frames that will be pushed.
    pub fn live(name: String, width: usize, height: usize, rate: f64) -> Result<Self> {
        let info = SourceInfo { width, height, frames: None, rate, reader: "the browser".into() };
        let live = Recent::new(width, height);
        let tracks = Tracks::new(Box::new(live.clone()), Results::Kept(Some(live.meter.clone())));
        Self::new(name, Source::Live(live), tracks, info, vec![])
    }

    fn new(name: String, source: Source, tracks: Tracks, info: SourceInfo, truth: Vec<Option<BBox>>) -> Result<Self> {
        check_size(&info, Path::new(&name))?;
        let frames = source.frames();
        Ok(Self { name, source, info, truth, frames, tracks, coded: None, saving: vec![] })
    }

    pub fn about(&self) -> Value {
        described(&self.info, self.info.frames.is_some(), &self.truth)
    }

    /// Takes the next frame of a camera; its number from 0.
    pub fn push(&self, rgba: &[u8], time: f64, missed: u64) -> Result<usize> {
        match &self.source {
            Source::Live(live) => {
                let (width, _) = live.size();
                live.push(Image::from_pixels(Pixels::Rgba, live.size(), 4 * width, rgba)?, time, missed)
            }
            Source::Video(..) => Err(Error::Invalid("this video is read, not pushed".into())),
        }
    }

    /// The samples of H.264 in MP4, for a decoder of the browser; `{"codec": null}` of other sources.
    pub fn coded(&mut self) -> Result<Value> {
        let video = match &self.source {
            Source::Video(video, _) if video.pictures.is_none() => video,
            _ => return Ok(json!({ "codec": null })),
        };
        let coded = video.coded()?;
        let frames: Vec<_> = coded.frames().take(MOST_CODED + 1).collect();
        let avcc = coded.description().to_vec();
        let Some([profile, constraints, level]) = avcc.get(1..4).filter(|_| frames.len() <= MOST_CODED) else {
            return Ok(json!({ "codec": null }));
        };
        self.coded = Some(coded);
        Ok(json!({
            "codec": format!("avc1.{profile:02x}{constraints:02x}{level:02x}"), "description": avcc,
            "offsets": frames.iter().map(|f| f.offset).collect::<Vec<_>>(),
            "sizes": frames.iter().map(|f| f.size).collect::<Vec<_>>(),
            "frames": frames.iter().map(|f| f.place.map_or(0, |place| place + 1)).collect::<Vec<_>>(),
            "keys": frames.iter().map(|f| u8::from(f.key)).collect::<Vec<_>>(),
        }))
    }

    /// Takes the planes of a frame (from 0) that the browser decoded.
    pub fn decoded(&self, place: usize, size: (usize, usize), planes: Planes, bytes: &[u8]) -> Result<()> {
        match (&self.source, &self.coded) {
            (Source::Video(_, decoded), Some(coded)) => decoded.push(coded, place, size, planes, bytes, &self.info),
            _ => Err(Error::Invalid("this video is not decoded by the browser".into())),
        }
    }

    /// The frame (from 1) that will be tracked next.
    pub fn next(&self) -> Option<usize> {
        self.tracks.next().map(|index| index + 1)
    }

    /// The pixels of a frame (from 0), red, green, blue, alpha; `None` where the video ends before.
    pub fn picture(&mut self, index: usize) -> Result<Option<Vec<u8>>> {
        let frame = match self.tracks.decoded().filter(|frame| frame.index == index) {
            Some(frame) => Some(frame),
            None => self.frames.frame(index)?,
        };
        Ok(frame.map(|frame| rgba(&frame.image)))
    }

    pub fn propose(&mut self, frame: usize, at: Option<(f64, f64)>) -> Result<Value> {
        proposed(&mut *self.frames, frame, at)
    }

    pub fn start(&mut self, target: usize, setup: Setup, frame: usize, bbox: BBox) -> Result<Value> {
        check_box("the box", &bbox, &self.info)?;
        self.saving.clear();
        self.tracks.start(target, setup, frame, bbox)
    }

    pub fn remove(&mut self, target: usize) -> Result<Value> {
        self.saving.clear();
        self.tracks.remove(target)
    }

    pub fn step(&mut self, frames: usize) -> Result<Value> {
        let before = self.tracks.frames();
        let answer = self.tracks.step(frames, || false)?;
        if self.tracks.frames() > before {
            self.saving.clear();
        }
        Ok(answer)
    }

    pub fn detail(&self, target: usize, frame: usize) -> Value {
        self.tracks.detail(target, frame)
    }

    pub fn correct(&mut self, target: usize, frame: usize, bbox: BBox) -> Result<Value> {
        check_box("the box", &bbox, &self.info)?;
        self.saving.clear();
        self.tracks.correct(target, frame, bbox)
    }

    /// The commands that give these tracks; empty where there is none, as for a camera.
    pub fn command(&self) -> Result<String> {
        match self.source {
            Source::Live(_) => self.tracks.get(0).map(|_| String::new()),
            Source::Video(..) => self.tracks.command(Path::new(&self.name)),
        }
    }

    /// Begins to make the files that are not there anyway.
    pub fn save(&mut self, wanted: Wanted) -> Result<Value> {
        self.tracks.get(0)?;
        self.saving.clear();
        let again = (wanted.report || wanted.film) && matches!(self.source, Source::Video(..));
        for target in 0..if again { self.tracks.count() } else { 0 } {
            let tracking = self.tracks.get(target)?;
            let setup = &tracking.setup;
            let info = RunInfo {
                command: self.tracks.line(target, Path::new(&self.name))?,
                truth: self.truth.clone(),
                ..RunInfo::of(self.name.clone(), &self.info, setup.config.clone(), &setup.blueprint, setup.seed)
            };
            let (given, frames) = (tracking.given().clone(), self.source.frames());
            self.saving.push(Saving::begin(wanted, setup, info, frames, given, tracking.last())?);
        }
        Ok(json!({}))
    }

    /// How far that is; with the names of the files once they are whole.
    pub fn saved(&mut self) -> Result<Value> {
        if let Some(saving) = self.saving.iter_mut().find(|saving| saving.files.is_none()) {
            saving.go_on(REPORTED)?;
        }
        let frames: usize = self.saving.iter().map(|saving| saving.count).sum();
        if self.saving.iter().any(|saving| saving.files.is_none()) {
            return Ok(json!({ "frames": frames, "files": null }));
        }
        let names = |target: usize| {
            let made = self.saving.get(target).and_then(|saving| saving.files.as_ref()).into_iter().flatten();
            let names: Vec<&str> = FILES.into_iter().chain(made.map(|(name, _)| *name)).collect();
            names.into_iter().map(move |name| named(target, name))
        };
        let files: Vec<String> = (0..self.tracks.count()).flat_map(names).collect();
        Ok(json!({ "frames": frames, "files": files }))
    }

    /// A piece of a file, from 0.
    pub fn file(&self, name: &str, piece: usize) -> Option<Vec<u8>> {
        let (target, name) = target_of(name);
        if let Some(text) = self.tracks.lines(target)?.piece(name, piece) {
            return Some(text.into_bytes());
        }
        let made = self.saving.get(target)?.files.as_ref()?;
        made.iter().find(|(known, _)| *known == name && piece == 0).map(|(_, bytes)| bytes.clone())
    }
}

/// Red, green, blue and an alpha of 255, pixel by pixel.
pub fn rgba(image: &foveate_core::scene::Image) -> Vec<u8> {
    let plane = |p: usize| image.plane(p.min(image.planes() - 1));
    let colours = plane(0).iter().zip(plane(1)).zip(plane(2));
    let mut out = Vec::with_capacity(4 * image.width() * image.height());
    colours.for_each(|((r, g), b)| out.extend_from_slice(&[*r, *g, *b, 255]));
    out
}
