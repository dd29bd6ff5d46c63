//! What the page asks for, and what it is answered.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use foveate::config::Config;
use foveate::geometry::BBox;
use foveate::report::interactive::{MOST_TARGETS, Setup, boxed, command, described, offered};
use foveate::report::run::check_box;
use foveate::{Error, Result};
use serde_json::{Value, json};

use super::guard::Guard;
use super::http::{Request, Response};
use super::live::Live;
use super::message::Message;
use super::page;
use super::roots::Roots;
use super::session::Session;
use super::video::Video;
use crate::cmd::configure::{Changes, POLICIES, read};

/// Videos open at a time; the one that was used longest ago makes room.
pub const MOST_SESSIONS: usize = 4;
/// True boxes told, at most.
const MOST_TRUTH: usize = 20_000;

/// The server's state.
pub struct App {
    pub guard: Guard,
    pub roots: Roots,
    /// Whether a box that was drawn is only to be told.
    pub pick: Option<Pick>,
    /// What the page begins with.
    pub config: String,
    pub policy: Option<String>,
    /// What answers the page, and what writes results meanwhile.
    pub pool: rayon::ThreadPool,
    pub saving: Arc<rayon::ThreadPool>,
    pub sessions: Mutex<Sessions>,
}

/// What becomes of a box that was picked.
pub struct Pick {
    /// Whether others may follow.
    pub keep: bool,
    pub done: Arc<AtomicBool>,
}

/// Videos that are open, the one used last at the end.
#[derive(Default)]
pub struct Sessions {
    open: Vec<(u64, Arc<Mutex<Session>>)>,
    last: u64,
}

fn unknown() -> Error {
    Error::Invalid("this video is no longer open (at most 4 are): open it again".into())
}

impl App {
    /// Answers a request.
    pub fn answer(&self, request: &Request) -> Response {
        if let Err(refused) = self.guard.check(request) {
            return refused;
        }
        match (&*request.method, &*request.path) {
            ("GET", "/") => page::response(),
            ("GET", "/frame") => self.frame(request),
            ("GET", "/file") => self.file(request),
            ("POST", "/api") => self.message(request),
            ("POST", "/push") => self.push(request),
            (_, path @ ("/" | "/frame" | "/file" | "/api" | "/push")) => Response::other_method(path),
            _ => Response::error(404, "there is nothing here; the page is at /"),
        }
    }

    /// Closes all videos, and removes what was written for them.
    pub fn close(&self) {
        self.sessions().open.clear();
    }

    fn sessions(&self) -> std::sync::MutexGuard<'_, Sessions> {
        self.sessions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn session(&self, id: u64) -> Option<Arc<Mutex<Session>>> {
        let mut sessions = self.sessions();
        let at = sessions.open.iter().position(|(other, _)| *other == id)?;
        let entry = sessions.open.remove(at);
        let session = Arc::clone(&entry.1);
        sessions.open.push(entry);
        Some(session)
    }

    /// Does something with an open video. One in which something broke is closed.
    fn with<T>(&self, id: u64, work: impl FnOnce(&mut Session) -> Result<T> + Send) -> Result<T>
    where
        T: Send,
    {
        let session = self.session(id).ok_or_else(unknown)?;
        let Ok(mut guard) = session.lock() else {
            self.sessions().open.retain(|(other, _)| *other != id);
            return Err(unknown());
        };
        let session = &mut *guard;
        self.pool.install(|| work(session))
    }

    /// Waits for a frame of a stream, where it is to come; not in the pool, where others would wait with it.
    fn wait(&self, id: u64, index: Option<usize>) -> Result<()> {
        let session = self.session(id).ok_or_else(unknown)?;
        session.lock().map_err(|_| unknown())?.wait(index)
    }

    fn frame(&self, request: &Request) -> Response {
        let number = |name: &str| request.query(name).and_then(|text| text.parse::<u64>().ok());
        let (Some(id), Some(frame)) = (number("session"), number("frame").filter(|n| *n > 0)) else {
            return Response::error(400, "expected ?session=N&frame=N, frames counted from 1");
        };
        let index = usize::try_from(frame - 1).unwrap_or(usize::MAX);
        let picture = self.wait(id, Some(index)).and_then(|()| self.with(id, |session| session.picture(index)));
        match picture {
            Ok(Some(jpeg)) => Response::new(200, "image/jpeg", &*jpeg),
            Ok(None) => Response::error(404, "the video has no such frame"),
            Err(error) => Response::error(404, &error.to_string()),
        }
    }

    fn file(&self, request: &Request) -> Response {
        let id = request.query("session").and_then(|text| text.parse().ok()).unwrap_or(0);
        let name = request.query("name").unwrap_or_default();
        match self.with(id, |session| Ok(session.file(name))) {
            Ok(Some(mut response)) => {
                response.headers.push(("Content-Disposition", "attachment".into()));
                response.headers.push(("Content-Security-Policy", "sandbox; default-src 'none'".into()));
                response
            }
            _ => Response::error(404, "there is no such file; save the results first"),
        }
    }

    /// A frame of the browser's camera.
    fn push(&self, request: &Request) -> Response {
        let number = |name: &str| request.query(name).unwrap_or_default();
        let time = number("time").parse().ok().filter(|time: &f64| time.is_finite());
        let (Ok(id), Some(time), Ok(missed)) = (number("session").parse(), time, number("missed").parse()) else {
            return Response::error(400, "expected ?session=N&time=SECONDS&missed=N");
        };
        if request.header("content-type") != Some("image/jpeg") {
            return Response::error(415, "expected a body of image/jpeg");
        }
        match self.with(id, |session| session.push(&request.body, time, missed)) {
            Ok(frame) => Response::new(200, "application/json", json!({ "frame": frame }).to_string()),
            Err(error) => Response::error(400, &error.to_string()),
        }
    }

    fn message(&self, request: &Request) -> Response {
        if request.header("content-type") != Some("application/json") {
            return Response::error(415, "expected a body of application/json");
        }
        let message = match serde_json::from_slice(&request.body) {
            Ok(message) => message,
            Err(error) => return Response::error(400, &format!("not a message: {error}")),
        };
        match self.act(message) {
            Ok(value) => Response::new(200, "application/json", value.to_string()),
            Err(error) => Response::error(400, &error.to_string()),
        }
    }

    fn act(&self, message: Message) -> Result<Value> {
        match message {
            Message::Hello {} => self.hello(),
            Message::List { path } => Ok(json!({ "entries": self.roots.list(&path)? })),
            Message::Open { path } => self.open(&path),
            Message::Close { session } => {
                self.sessions().open.retain(|(id, _)| *id != session);
                Ok(json!({}))
            }
            Message::Live { name, width, height, rate } => {
                let (live, info) = Live::pushed(width, height, rate)?;
                Ok(self.add(Session::of_live(live, info, name.into()), &[]))
            }
            Message::Propose { session, frame, at } => self.with(session, |s| s.propose(frame, at)),
            Message::Start { session, target, frame, bbox, config, policy, seed } => {
                let setup = self.setup(config, policy, seed)?;
                self.with(session, |s| s.start(target, setup, frame, boxed(bbox)))
            }
            Message::Remove { session, target } => self.with(session, |s| s.remove(target)),
            Message::Step { session, frames } => {
                self.wait(session, None)?;
                self.with(session, |s| s.step(frames))
            }
            Message::Detail { session, target, frame } => self.with(session, |s| Ok(s.tracks.detail(target, frame))),
            Message::Correct { session, target, frame, bbox } => {
                self.with(session, |s| s.correct(target, frame, boxed(bbox)))
            }
            Message::Command { session } => self.with(session, |s| Ok(json!({ "command": s.command()? }))),
            Message::Picked { session, frame, bbox, config, policy } => {
                let Setup { config, policy, .. } = self.setup(config, policy, None)?;
                let given = [(frame.saturating_sub(1), boxed(bbox))];
                let line = self.with(session, |s| {
                    check_box("the box", &given[0].1, &s.info)?;
                    Ok(command(&s.shown, &given, &config, policy.as_deref(), None))
                })?;
                if let Some(pick) = &self.pick {
                    say!("{line}");
                    if !pick.keep {
                        pick.done.store(true, Ordering::SeqCst);
                    }
                }
                Ok(json!({ "command": line, "ends": self.pick.as_ref().is_some_and(|pick| !pick.keep) }))
            }
            Message::Save { session, film, report } => self.with(session, |s| s.save(film, report, &self.saving)),
            Message::Saved { session } => self.with(session, |s| s.saved()),
        }
    }

    fn hello(&self) -> Result<Value> {
        let mut configs = offered(|_| true);
        if !configs.iter().any(|config| config["name"] == self.config) {
            configs.insert(0, json!({ "name": self.config, "title": self.config, "group": "Yours", "for": "the file given to the program" }));
        }
        let entries = self.roots.list("")?;
        Ok(json!({
            "version": env!("CARGO_PKG_VERSION"), "pick": self.pick.is_some(), "roots": entries, "configs": configs,
            "policies": POLICIES, "config": self.config, "policy": self.policy, "targets": MOST_TARGETS,
        }))
    }

    fn open(&self, path: &str) -> Result<Value> {
        if let Some(address) = self.roots.stream(path) {
            let (live, info) = Live::open(address)?;
            return Ok(self.add(Session::of_live(live, info, address.to_owned()), &[]));
        }
        let place = self.roots.find(path)?;
        let video = self.pool.install(|| Video::open(place))?;
        let mut truth = video.truth();
        truth.truncate(MOST_TRUTH);
        Ok(self.add(Session::of_video(video), &truth))
    }

    /// Keeps a session; what the page is told of it.
    fn add(&self, session: Session, truth: &[Option<BBox>]) -> Value {
        let mut about = described(&session.info, session.info.exact_frames().is_some(), truth);
        if session.is_live() {
            about["live"] = json!(true);
        }
        let mut sessions = self.sessions();
        if sessions.open.len() >= MOST_SESSIONS {
            sessions.open.remove(0);
        }
        sessions.last += 1;
        let id = sessions.last;
        sessions.open.push((id, Arc::new(Mutex::new(session))));
        about["session"] = json!(id);
        about
    }

    /// What to track with: a configuration that may be asked for. The page may not name files.
    fn setup(&self, config: String, policy: Option<String>, seed: Option<u64>) -> Result<Setup> {
        if config != self.config && !Config::names().contains(&&*config) {
            return Err(Error::Config(format!("no configuration is called {config}; choose one of the list")));
        }
        if let Some(policy) = policy.as_deref().filter(|policy| !POLICIES.contains(policy)) {
            return Err(Error::Config(format!("no policy is called {policy}; choose one of the list")));
        }
        let (changed, folder) = read(&config, &Changes { policy: policy.clone(), set: vec![] })?;
        Setup::new(changed, &folder, config, policy, seed)
    }
}
