//! The browser as the host of the page: files by number, frames decoded by the browser, and the digit scenes.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use foveate_base::files::{self, Nowhere, TEXT};
use foveate_base::{Error, Result};
use foveate_core::config::Config;
use foveate_core::geometry::{BBox, Size};
use foveate_core::scene::{Image, Pixels};
use foveate_page::{Asked, FILES, Host, Made, Page, Reopen, Session, Setup, Source, offered, read};
use foveate_video::Planes;
use foveate_video::annotation::parse_boxes;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::lesson::{Lesson, Scene, rgba};
use crate::open::Open;
use crate::store::{Given, Store, Video};

/// Frame rate of a sequence of pictures, frames per second.
const PICTURES: f64 = 30.0;

/// A message that only this page sends.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields)]
enum Own {
    /// Opens a video file, or pictures in order; `truth` is a file of true boxes.
    Open { name: String, files: Vec<Given>, truth: Option<Given> },
    /// Requests the samples of H.264 in MP4 for a decoder of the browser.
    Coded { session: u64 },
    /// Draws a digit scene and starts tracking in it.
    Lesson { scene: Scene, policy: String },
    /// Tracks the scene's next frame.
    LessonStep {},
}

/// The state of the page.
#[derive(Debug)]
pub struct App {
    page: Page<Browser>,
}

/// The files of the page, and its digit scene.
struct Browser {
    store: Arc<dyn Store>,
    lesson: Mutex<Option<Lesson>>,
}

impl Host for Browser {
    type Video = Open;
    const TEXTS: &[&str] = &FILES;

    /// WebAssembly has no clock; the worker measures the time.
    fn now() -> Duration {
        Duration::ZERO
    }

    fn hello(&self) -> Result<Value> {
        // This build excludes configurations with learned weights.
        let configs = offered(|config| config.check(&Nowhere).is_ok());
        Ok(json!({ "pick": false, "roots": [], "configs": configs, "config": "natural", "policy": null }))
    }

    fn setup(&self, name: String, policy: Option<String>, seed: Option<u64>) -> Result<Setup> {
        let unknown = || Error::Config(format!("no configuration is called {name}; choose one of the list"));
        let mut config = Config::builtin(&name).ok_or_else(unknown)??;
        if let Some(policy) = &policy {
            config = config.with_policy(policy)?;
        }
        Setup::new(config, &Nowhere, name, policy, seed)
    }
}

impl App {
    /// Creates the app with this file store.
    pub fn new(store: Arc<dyn Store>) -> Self {
        Self { page: Page::new(Browser { store, lesson: Mutex::new(None) }) }
    }

    /// Answers a message, both in JSON; returns `{"error": why}` for a request that cannot be fulfilled.
    pub fn ask(&mut self, message: &str) -> String {
        let answer =
            read(message.as_bytes(), &["open", "coded", "lesson", "lesson_step"]).and_then(|asked| match asked {
                Asked::Page(message) => self.page.act(message),
                Asked::Own(own) => self.act(own),
            });
        answer.unwrap_or_else(|error| json!({ "error": error.to_string() })).to_string()
    }

    /// Returns the pixels of a frame (from 1) of a session, or of the digit scene (session 0): red, green, blue, alpha. `None` if there is
    /// no such frame.
    pub fn picture(&mut self, session: u64, frame: usize) -> Option<Vec<u8>> {
        let index = frame.checked_sub(1)?;
        if session == 0 {
            return self.lesson().as_ref().map(Lesson::picture);
        }
        let frame = self.page.with(session, |session| session.frame(index)).ok()??;
        Some(rgba(&frame.image))
    }

    /// Adds the next frame of a camera: its pixels as in [`App::picture`], its time in seconds, and the number of frames before it that
    /// never arrived. Returns its number from 1; `None` if it does not fit.
    pub fn push(&mut self, session: u64, rgba: &[u8], time: f64, missed: u64) -> Option<usize> {
        let push = |session: &mut Session<Browser>| {
            let size = session.info.size();
            session.push(Image::from_pixels(Pixels::Rgba, size, 4 * size.width, rgba)?, time, missed)
        };
        self.page.with(session, push).ok()
    }

    /// Adds the planes of a frame (from 1) that the browser decoded, with its coded width and height. Returns whether they fit.
    pub fn decoded(&mut self, session: u64, frame: usize, size: Size, planes: Planes, bytes: &[u8]) -> bool {
        let decoded = |session: &mut Session<Browser>| match (&session.source, frame.checked_sub(1)) {
            (Source::Video(video), Some(place)) => video.decoded(place, size, planes, bytes, &session.info),
            _ => Err(Error::Invalid("this video is not decoded by the browser".into())),
        };
        self.page.with(session, decoded).is_ok()
    }

    /// Returns a piece of a saved file, from 0; `None` after the last one, or if there is no such file.
    pub fn file(&self, session: u64, name: &str, piece: usize) -> Option<Vec<u8>> {
        let file = |session: &mut Session<Browser>| {
            let made = || match session.made(name).filter(|_| piece == 0) {
                Some(Made::Bytes(bytes)) => Some(bytes.to_vec()),
                _ => None,
            };
            Ok(session.text(name, piece).map(String::into_bytes).or_else(made))
        };
        self.page.with(session, file).ok().flatten()
    }

    fn lesson(&self) -> std::sync::MutexGuard<'_, Option<Lesson>> {
        self.page.host.lesson.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn act(&self, message: Own) -> Result<Value> {
        match message {
            Own::Open { name, files, truth } => {
                let picture = |file: &Given| {
                    let name = file.name.to_ascii_lowercase();
                    [".jpg", ".jpeg", ".png"].iter().any(|end| name.ends_with(end))
                };
                let pictures = (!files.is_empty() && files.iter().all(picture)).then_some(PICTURES);
                let truth = truth.map(|file| self.truth(&file)).transpose()?.unwrap_or_default();
                let video = Video { store: Arc::clone(&self.page.host.store), files, pictures };
                let info = video.source(0)?.info().clone();
                Ok(self.page.add(Session::new(name.into(), Source::Video(Open::new(video)), info, truth)?))
            }
            Own::Coded { session } => self.page.with(session, |session| match &mut session.source {
                Source::Video(video) => video.coded(),
                Source::Live(..) => Ok(json!({ "codec": null })),
            }),
            Own::Lesson { scene, policy } => {
                *self.lesson() = None;
                let lesson = Lesson::begin(scene, &policy)?;
                let about = lesson.about();
                *self.lesson() = Some(lesson);
                Ok(about)
            }
            Own::LessonStep {} => {
                let none = || Error::Invalid("there is no scene yet; draw one".into());
                self.lesson().as_mut().ok_or_else(none)?.step()
            }
        }
    }

    /// Reads the boxes of a file of the page.
    fn truth(&self, file: &Given) -> Result<Vec<Option<BBox>>> {
        let path = Path::new(&file.name);
        let size = file.size.min(TEXT);
        let mut bytes = vec![0; usize::try_from(size).unwrap_or(0)];
        let mut at = 0;
        while at < bytes.len() {
            match self
                .page
                .host
                .store
                .read(file.id, at as u64, &mut bytes[at..])
                .map_err(Error::io(path, "cannot read"))?
            {
                0 => break,
                read => at += read,
            }
        }
        bytes.truncate(at);
        parse_boxes(&files::text(path, bytes)?, path)
    }
}
