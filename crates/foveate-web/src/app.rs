//! What the page asks for, and what it is answered.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use foveate_base::files::{Nowhere, TEXT};
use foveate_base::{Error, Result};
use foveate_core::config::{Config, POLICIES};
use foveate_report::interactive::{MOST_TARGETS, Setup, boxed, offered};
use foveate_video::Planes;
use foveate_video::annotation::parse_boxes;
use serde_json::{Value, json};

use crate::lesson::Lesson;
use crate::message::Message;
use crate::save::Wanted;
use crate::session::Session;
use crate::store::{Given, Store, Video};

/// Frames a second that pictures are shown at.
const PICTURES: f64 = 30.0;

/// All that the page's messages are about.
pub struct App {
    store: Arc<dyn Store>,
    sessions: BTreeMap<u64, Session>,
    count: u64,
    lesson: Option<Lesson>,
}

fn unknown() -> Error {
    Error::Invalid("this video is no longer open: open it again".into())
}

impl App {
    /// With files of this kind.
    pub fn new(store: Arc<dyn Store>) -> Self {
        Self { store, sessions: BTreeMap::new(), count: 0, lesson: None }
    }

    /// Answers a message, both JSON; of what cannot be done, `{"error": why}`.
    pub fn ask(&mut self, message: &str) -> String {
        let message = serde_json::from_str(message).map_err(|error| Error::Invalid(format!("not a message: {error}")));
        let answer = message.and_then(|message| self.act(message));
        answer.unwrap_or_else(|error| json!({ "error": error.to_string() })).to_string()
    }

    /// The pixels of a frame (from 1) of a session, or of the digit scene (session 0): red, green, blue, alpha. `None` where
    /// there is no such frame.
    pub fn picture(&mut self, session: u64, frame: usize) -> Option<Vec<u8>> {
        let index = frame.checked_sub(1)?;
        match session {
            0 => self.lesson.as_ref().map(Lesson::picture),
            _ => self.sessions.get_mut(&session)?.picture(index).ok().flatten(),
        }
    }

    /// Takes the next frame of a camera: its pixels as [`App::picture`] has them, its time in seconds, and how many before it
    /// never came. Answers its number, from 1; `None` where it does not fit.
    pub fn push(&mut self, session: u64, rgba: &[u8], time: f64, missed: u64) -> Option<usize> {
        self.sessions.get(&session)?.push(rgba, time, missed).ok().map(|index| index + 1)
    }

    /// Takes the planes of a frame (from 1) that the browser decoded, its width and height as coded; whether they fit.
    pub fn decoded(&mut self, session: u64, frame: usize, size: (usize, usize), planes: Planes, bytes: &[u8]) -> bool {
        let session = self.sessions.get(&session).zip(frame.checked_sub(1));
        session.is_some_and(|(session, place)| session.decoded(place, size, planes, bytes).is_ok())
    }

    /// A piece of a saved file, from 0; `None` after the last one, or where there is none of that name.
    pub fn file(&self, session: u64, name: &str, piece: usize) -> Option<Vec<u8>> {
        self.sessions.get(&session)?.file(name, piece)
    }

    fn session(&mut self, id: u64) -> Result<&mut Session> {
        self.sessions.get_mut(&id).ok_or_else(unknown)
    }

    fn add(&mut self, session: Session) -> Value {
        self.count += 1;
        let mut about = session.about();
        about["session"] = json!(self.count);
        self.sessions.insert(self.count, session);
        about
    }

    fn act(&mut self, message: Message) -> Result<Value> {
        match message {
            Message::Hello {} => Ok(hello()),
            Message::Open { name, files, truth } => {
                let picture = |file: &Given| {
                    let name = file.name.to_ascii_lowercase();
                    [".jpg", ".jpeg", ".png"].iter().any(|end| name.ends_with(end))
                };
                let pictures = (!files.is_empty() && files.iter().all(picture)).then_some(PICTURES);
                let truth = truth.map(|file| self.truth(&file)).transpose()?.unwrap_or_default();
                let video = Video { store: Arc::clone(&self.store), files, pictures };
                let session = Session::open(name, video, truth)?;
                Ok(self.add(session))
            }
            Message::Live { name, width, height, rate } => {
                let session = Session::live(name, width, height, rate)?;
                Ok(self.add(session))
            }
            Message::Close { session } => {
                self.sessions.remove(&session);
                Ok(json!({}))
            }
            Message::Propose { session, frame, at } => self.session(session)?.propose(frame, at),
            Message::Start { session, target, frame, bbox, config, policy, seed } => {
                let setup = setup(config, policy, seed)?;
                self.session(session)?.start(target, setup, frame, boxed(bbox))
            }
            Message::Next { session } => Ok(json!({ "next": self.session(session)?.next() })),
            Message::Coded { session } => self.session(session)?.coded(),
            Message::Remove { session, target } => self.session(session)?.remove(target),
            Message::Step { session, frames } => self.session(session)?.step(frames),
            Message::Detail { session, target, frame } => Ok(self.session(session)?.detail(target, frame)),
            Message::Correct { session, target, frame, bbox } => {
                self.session(session)?.correct(target, frame, boxed(bbox))
            }
            Message::Command { session } => Ok(json!({ "command": self.session(session)?.command()? })),
            Message::Save { session, report, film } => self.session(session)?.save(Wanted { report, film }),
            Message::Saved { session } => self.session(session)?.saved(),
            Message::Lesson { scene, policy } => {
                self.lesson = None;
                let lesson = Lesson::begin(scene, &policy)?;
                let about = lesson.about();
                self.lesson = Some(lesson);
                Ok(about)
            }
            Message::LessonStep {} => {
                let none = || Error::Invalid("there is no scene yet; draw one".into());
                self.lesson.as_mut().ok_or_else(none)?.step()
            }
        }
    }

    /// The boxes of a file of the page.
    fn truth(&self, file: &Given) -> Result<Vec<Option<foveate_core::geometry::BBox>>> {
        let path = Path::new(&file.name);
        let size = file.size.min(TEXT);
        let mut bytes = vec![0; usize::try_from(size).unwrap_or(0)];
        let mut at = 0;
        while at < bytes.len() {
            match self.store.read(file.id, at as u64, &mut bytes[at..]).map_err(Error::io(path, "cannot read"))? {
                0 => break,
                read => at += read,
            }
        }
        parse_boxes(&String::from_utf8_lossy(&bytes[..at]), path)
    }
}

fn hello() -> Value {
    // Those that need learned weights are not in this build.
    let configs = offered(|config| config.check(&Nowhere).is_ok());
    json!({
        "version": env!("CARGO_PKG_VERSION"), "pick": false, "roots": [], "configs": configs, "policies": POLICIES,
        "config": "natural", "policy": null, "targets": MOST_TARGETS,
    })
}

/// What to track with.
fn setup(name: String, policy: Option<String>, seed: Option<u64>) -> Result<Setup> {
    let unknown = || Error::Config(format!("no configuration is called {name}; choose one of the list"));
    let mut config = Config::builtin(&name).ok_or_else(unknown)??;
    if let Some(policy) = &policy {
        config = config.with_policy(policy)?;
    }
    Setup::new(config, &Nowhere, name, policy, seed)
}
