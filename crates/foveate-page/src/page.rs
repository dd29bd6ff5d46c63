//! The open videos, and the answers to messages about them.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foveate_base::{Error, Result};
use serde_json::{Value, json};

use crate::host::Host;
use crate::measuring::{charts, files, measured};
use crate::message::Message;
use crate::session::Session;
use crate::tracks::MOST_TARGETS;

/// Maximum number of open videos; the least recently used one is closed.
const MOST_SESSIONS: usize = 4;

/// The state of the page.
pub struct Page<H: Host> {
    /// The program that shows the page.
    pub host: H,
    sessions: Mutex<Sessions<H>>,
}

foveate_base::opaque_debug!(Page<H: Host>);

/// Open videos, most recently used last.
struct Sessions<H: Host> {
    open: Vec<(u64, Arc<Mutex<Session<H>>>)>,
    last: u64,
}

fn unknown() -> Error {
    Error::Invalid(format!("this video is no longer open (at most {MOST_SESSIONS} are): open it again"))
}

impl<H: Host> Page<H> {
    /// Creates a page with no open video.
    pub fn new(host: H) -> Self {
        Self { host, sessions: Mutex::new(Sessions { open: vec![], last: 0 }) }
    }

    fn sessions(&self) -> MutexGuard<'_, Sessions<H>> {
        self.sessions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn session(&self, id: u64) -> Result<Arc<Mutex<Session<H>>>> {
        let mut sessions = self.sessions();
        let at = sessions.open.iter().position(|(other, _)| *other == id).ok_or_else(unknown)?;
        let entry = sessions.open.remove(at);
        let session = Arc::clone(&entry.1);
        sessions.open.push(entry);
        Ok(session)
    }

    /// Adds a session; returns its description for the page, with its number.
    pub fn add(&self, session: Session<H>) -> Value {
        let mut about = session.about();
        let mut sessions = self.sessions();
        if sessions.open.len() >= MOST_SESSIONS {
            // That of another page may have a track that nobody has saved.
            let idle =
                |session: &Arc<Mutex<Session<H>>>| session.try_lock().is_ok_and(|session| !session.is_tracking());
            let at = sessions.open.iter().position(|(_, session)| idle(session)).unwrap_or(0);
            sessions.open.remove(at);
        }
        sessions.last += 1;
        let id = sessions.last;
        sessions.open.push((id, Arc::new(Mutex::new(session))));
        about["session"] = json!(id);
        about
    }

    /// Calls `work` with an open video. Closes the video if `work` panics.
    ///
    /// # Errors
    /// The video is not open, or as `work`.
    pub fn with<T: Send>(&self, id: u64, work: impl FnOnce(&mut Session<H>) -> Result<T> + Send) -> Result<T> {
        let session = self.session(id)?;
        let Ok(mut guard) = session.lock() else {
            self.close(Some(id));
            return Err(unknown());
        };
        let session = &mut *guard;
        self.host.run(|| work(session))
    }

    /// Waits for a frame of a stream, as [`Session::wait`]. Do not call it on the threads that answer messages: it would block them.
    ///
    /// # Errors
    /// As [`Session::wait`].
    pub fn wait(&self, id: u64, index: Option<usize>) -> Result<()> {
        self.session(id)?.lock().map_err(|_| unknown())?.wait(index)
    }

    /// Closes a video, or all, and removes its files.
    pub fn close(&self, id: Option<u64>) {
        self.sessions().open.retain(|(other, _)| id.is_some_and(|id| *other != id));
    }

    /// Answers a message.
    ///
    /// # Errors
    /// The request cannot be fulfilled.
    pub fn act(&self, message: Message) -> Result<Value> {
        match message {
            Message::Hello {} => {
                let mut hello = self.host.hello()?;
                hello["version"] = json!(env!("CARGO_PKG_VERSION"));
                hello["policies"] = json!(foveate_core::config::POLICIES);
                hello["targets"] = json!(MOST_TARGETS);
                Ok(hello)
            }
            Message::Live { name, width, height, rate } => {
                Ok(self.add(Session::pushed(name.into(), width, height, rate)?))
            }
            Message::Close { session } => {
                self.close(Some(session));
                Ok(json!({}))
            }
            Message::Propose { session, frame, at } => self.with(session, |s| s.propose(frame, at)),
            Message::Start { session, target, frame, bbox, config, policy, seed } => {
                let setup = self.host.setup(config, policy, seed)?;
                self.with(session, |s| s.start(target, setup, frame, bbox))
            }
            Message::Step { session, frames } => {
                self.wait(session, None)?;
                self.with(session, |s| s.step(frames))
            }
            Message::Next { session } => {
                self.with(session, |s| Ok(json!({ "next": s.tracks.next().map(|index| index + 1) })))
            }
            Message::Remove { session, target } => self.with(session, |s| s.remove(target)),
            Message::Detail { session, target, frame } => self.with(session, |s| Ok(s.tracks.detail(target, frame))),
            Message::Correct { session, target, frame, bbox } => self.with(session, |s| s.correct(target, frame, bbox)),
            Message::Command { session } => self.with(session, |s| Ok(json!({ "command": s.command()? }))),
            Message::Measure { session, target, options, files } => {
                let mut settings = options.settings()?;
                let (track, command, picture) = self.with(session, |s| s.measurable(target, &options))?;
                settings.picture = Some(picture);
                // Without the lock of the video: the page shows and tracks its frames meanwhile.
                self.host.run(|| {
                    let measured = measured(target, &track, &settings)?;
                    let mut answer = if files { self::files(&measured) } else { charts(&measured) };
                    answer["command"] = json!(command);
                    Ok(answer)
                })
            }
            Message::Save { session, film, report } => self.with(session, |s| s.save(film, report, &self.host)),
            Message::Saved { session } => self.with(session, Session::saved),
        }
    }
}
