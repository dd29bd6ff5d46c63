//! A video that is open: its frames, its tracks, its results.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use foveate::geometry::BBox;
use foveate::report::interactive::{FILES, Player, Results, Setup, Tracks, named, proposed, target_of};
use foveate::report::run::check_box;
use foveate::video::SourceInfo;
use foveate::{Error, Result};
use serde_json::{Value, json};

use super::http::Response;
use super::live::Live;
use super::save::{Saved, Wanted};
use super::video::{Stills, Video};

/// How long one request to track may take.
const LONGEST_STEP: Duration = Duration::from_millis(60);

enum Source {
    Video(Video, Box<Stills>),
    Live(Live),
}

pub struct Session {
    pub info: SourceInfo,
    /// What it is called on the command line.
    pub shown: PathBuf,
    source: Source,
    pub tracks: Tracks,
    /// Of each target.
    saved: Vec<Saved>,
}

impl Session {
    pub fn of_video(video: Video) -> Self {
        let tracks = Tracks::new(Box::new(Player::new(video.clone())), Results::Again);
        let (info, shown, stills) =
            (video.info.clone(), video.place.shown.clone(), Box::new(Stills::new(video.clone())));
        Self { info, shown, source: Source::Video(video, stills), tracks, saved: vec![] }
    }

    pub fn of_live(live: Live, info: SourceInfo, shown: PathBuf) -> Self {
        let meter = live.recent.meter.clone();
        let tracks = Tracks::new(Box::new(live.recent.clone()), Results::Kept(Some(meter)));
        Self { info, shown, source: Source::Live(live), tracks, saved: vec![] }
    }

    pub fn is_live(&self) -> bool {
        matches!(self.source, Source::Live(_))
    }

    /// Waits for a frame of a stream where this one, from 0, or of `None` the one to be tracked next, is still to come.
    pub fn wait(&mut self, index: Option<usize>) -> Result<()> {
        let index = index.or(self.tracks.next());
        match &mut self.source {
            Source::Live(live) if index.is_some_and(|index| live.is_due(index)) => live.pull(),
            _ => Ok(()),
        }
    }

    /// Takes a frame of the page; its number, from 1.
    pub fn push(&mut self, picture: &[u8], time: f64, missed: u64) -> Result<usize> {
        match &self.source {
            Source::Live(live) => live.push(picture, time, missed),
            Source::Video(..) => Err(Error::Invalid("this video takes no frames of the page".into())),
        }
    }

    /// A frame as JPEG.
    pub fn picture(&mut self, index: usize) -> Result<Option<Arc<[u8]>>> {
        match &mut self.source {
            Source::Video(_, stills) => stills.get(index, self.tracks.decoded().as_ref()),
            Source::Live(live) => live.picture(index),
        }
    }

    pub fn propose(&mut self, frame: usize, at: Option<(f64, f64)>) -> Result<Value> {
        match &mut self.source {
            Source::Video(_, stills) => proposed(&mut stills.player, frame, at),
            Source::Live(live) => proposed(&mut live.recent, frame, at),
        }
    }

    pub fn start(&mut self, target: usize, setup: Setup, frame: usize, bbox: BBox) -> Result<Value> {
        check_box("the box", &bbox, &self.info)?;
        self.saved.clear();
        self.tracks.start(target, setup, frame, bbox)
    }

    pub fn remove(&mut self, target: usize) -> Result<Value> {
        self.saved.clear();
        self.tracks.remove(target)
    }

    pub fn step(&mut self, frames: usize) -> Result<Value> {
        let (began, before, live) = (Instant::now(), self.tracks.frames(), self.is_live());
        // Of a stream what has come; targets that are behind see frames that are kept.
        let mut answer = self.tracks.step(if live { 1 } else { frames }, || began.elapsed() > LONGEST_STEP)?;
        if self.tracks.frames() > before {
            self.saved.clear();
        }
        if let Source::Live(live) = &self.source {
            answer["missed"] = json!(live.recent.meter.dropped());
        }
        Ok(answer)
    }

    pub fn correct(&mut self, target: usize, frame: usize, bbox: BBox) -> Result<Value> {
        check_box("the box", &bbox, &self.info)?;
        self.saved.clear();
        self.tracks.correct(target, frame, bbox)
    }

    /// The commands that give these tracks; empty where no command gives them again.
    pub fn command(&self) -> Result<String> {
        if self.is_live() { self.tracks.get(0).map(|_| String::new()) } else { self.tracks.command(&self.shown) }
    }

    /// Begins to write results; of what comes but once they are there.
    pub fn save(&mut self, film: bool, report: bool, pool: &Arc<rayon::ThreadPool>) -> Result<Value> {
        self.tracks.get(0)?;
        // The files before go first.
        self.saved.clear();
        if let Source::Video(video, _) = &self.source {
            for target in 0..self.tracks.count() {
                let tracking = self.tracks.get(target)?;
                let given = tracking.given().iter().map(|(k, b)| (*k, *b)).collect();
                let (setup, last, command) =
                    (tracking.setup.clone(), tracking.last(), self.tracks.line(target, &self.shown)?);
                let wanted = Wanted { video: video.clone(), setup, given, last, command, film, report };
                self.saved.push(Saved::begin(wanted, pool)?);
            }
        }
        Ok(json!({}))
    }

    /// How far that is; with the names of the files once they are whole.
    pub fn saved(&self) -> Result<Value> {
        if self.is_live() {
            self.tracks.get(0)?;
            let files: Vec<String> =
                (0..self.tracks.count()).flat_map(|target| FILES.map(|name| named(target, name))).collect();
            return Ok(json!({ "frames": 0, "files": files }));
        }
        if self.saved.is_empty() {
            return Err(Error::Invalid("nothing is being saved; save the results first".into()));
        }
        let (mut frames, mut files) = (0, Some(vec![]));
        for (target, saved) in self.saved.iter().enumerate() {
            let (count, written) = saved.progress();
            frames += count;
            match (written.transpose().map_err(Error::Invalid)?, &mut files) {
                (Some(names), Some(files)) => files.extend(names.into_iter().map(|name| named(target, name))),
                _ => files = None,
            }
        }
        Ok(json!({ "frames": frames, "files": files }))
    }

    /// A saved file as an answer.
    pub fn file(&self, name: &str) -> Option<Response> {
        let (target, name) = target_of(name);
        if self.is_live() {
            let text = self.tracks.lines(target)?.file(name)?;
            return Some(Response::new(200, "text/plain; charset=utf-8", text));
        }
        let (file, length, kind) = self.saved.get(target)?.file(name)?;
        let mut response = Response::new(200, kind, vec![]);
        response.file = Some((file, length));
        Some(response)
    }
}
