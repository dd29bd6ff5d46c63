//! The server as the host of the page: requests, folders and threads.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::LazyLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use foveate::config::Config;
use foveate::geometry::BBox;
use foveate::report::run::check_box;
use foveate::text::counted;
use foveate::video::sandbox::decode_image_in;
use foveate::video::{Options, decode_image};
use foveate::{Error, Result};
use foveate_page::{
    Asked, FILES, Host, Made, Page, Session, Setup, Source, boxed, command, counted_from_1, offered, read,
};
use serde::Deserialize;
use serde_json::{Value, json};

use super::guard::Guard;
use super::http::{Request, Response};
use super::live;
use super::page;
use super::roots::Roots;
use super::save;
use super::video::{Open, Video, jpeg};
use crate::cmd::configure::{self, Changes, POLICIES};

/// A message that only this page sends.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "snake_case", deny_unknown_fields)]
enum Own {
    /// Lists a folder.
    List { path: String },
    /// Opens a video, or a stream.
    Open { path: String },
    /// Reports a box; the server prints the command that tracks it.
    Picked {
        session: u64,
        #[serde(deserialize_with = "counted_from_1")]
        frame: usize,
        #[serde(rename = "box", deserialize_with = "boxed")]
        bbox: BBox,
        config: String,
        policy: Option<String>,
    },
}

/// The server's state.
pub(super) struct App {
    pub guard: Guard,
    pub page: Page<Server>,
}

/// The videos and configurations that the page may use.
pub(super) struct Server {
    pub roots: Roots,
    /// Set if a box is only reported, not tracked.
    pub pick: Option<Pick>,
    /// Initial settings of the page.
    pub config: String,
    pub policy: Option<String>,
    /// The threads that serve the page.
    pub pool: rayon::ThreadPool,
    /// How videos are read.
    pub options: Options,
}

/// Handling of a picked box.
pub(super) struct Pick {
    /// Whether further boxes are accepted.
    pub keep: bool,
    pub done: Arc<AtomicBool>,
}

impl Host for Server {
    type Video = Open;
    const TEXTS: &[&str] = &[FILES[0], FILES[1]];

    fn now() -> Duration {
        static BEGAN: LazyLock<Instant> = LazyLock::new(Instant::now);
        BEGAN.elapsed()
    }

    fn hello(&self) -> Result<Value> {
        let mut configs = offered(|_| true);
        if !configs.iter().any(|config| config["name"] == self.config) {
            configs.insert(0, json!({ "name": self.config, "title": self.config, "group": "Yours", "for": "the file given to the program" }));
        }
        let (pick, roots) = (self.pick.is_some(), self.roots.list("")?);
        Ok(json!({ "pick": pick, "roots": roots, "configs": configs, "config": self.config, "policy": self.policy }))
    }

    /// Refuses files named by the page.
    fn setup(&self, config: String, policy: Option<String>, seed: Option<u64>) -> Result<Setup> {
        if config != self.config && !Config::names().contains(&&*config) {
            return Err(Error::Config(format!("no configuration is called {config}; choose one of the list")));
        }
        if let Some(policy) = policy.as_deref().filter(|policy| !POLICIES.contains(policy)) {
            return Err(Error::Config(format!("no policy is called {policy}; choose one of the list")));
        }
        let (changed, folder) = configure::read(&config, &Changes { policy: policy.clone(), set: vec![] })?;
        Setup::new(changed, &folder, config, policy, seed)
    }

    fn folder(&self) -> Result<Option<PathBuf>> {
        save::scratch().map(Some)
    }

    fn run<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.pool.install(work)
    }
}

impl App {
    /// Returns the response to a request.
    pub(super) fn answer(&self, request: &Request) -> Response {
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

    fn frame(&self, request: &Request) -> Response {
        let number = |name: &str| request.query(name).and_then(|text| text.parse::<u64>().ok());
        let (Some(id), Some(frame)) = (number("session"), number("frame").filter(|n| *n > 0)) else {
            return Response::error(400, "expected ?session=N&frame=N, frames counted from 1");
        };
        let index = usize::try_from(frame - 1).unwrap_or(usize::MAX);
        let picture =
            self.page.wait(id, Some(index)).and_then(|()| self.page.with(id, |session| picture(session, index)));
        match picture {
            Ok(Some(jpeg)) => Response::new(200, "image/jpeg", &*jpeg),
            Ok(None) => Response::error(404, "the video has no such frame"),
            Err(error) => Response::error(404, &error.to_string()),
        }
    }

    fn file(&self, request: &Request) -> Response {
        let id = request.query("session").and_then(|text| text.parse().ok()).unwrap_or(0);
        let name = request.query("name").unwrap_or_default();
        match self.page.with(id, |session| Ok(file(session, name))) {
            Ok(Some(mut response)) => {
                response.headers.push(("Content-Disposition", "attachment".into()));
                response.headers.push(("Content-Security-Policy", "sandbox; default-src 'none'".into()));
                response
            }
            _ => Response::error(404, "there is no such file; save the results first"),
        }
    }

    /// Handles a frame from the browser's camera.
    fn push(&self, request: &Request) -> Response {
        let number = |name: &str| request.query(name).unwrap_or_default();
        let time = number("time").parse().ok().filter(|time: &f64| time.is_finite());
        let (Ok(id), Some(time), Ok(missed)) = (number("session").parse(), time, number("missed").parse()) else {
            return Response::error(400, "expected ?session=N&time=SECONDS&missed=N");
        };
        if request.header("content-type") != Some("image/jpeg") {
            return Response::error(415, "expected a body of image/jpeg");
        }
        let push = |session: &mut Session<Server>| {
            let image = match &self.page.host.options.sandbox {
                Some(sandbox) => decode_image_in(sandbox, &request.body),
                None => decode_image(&request.body),
            };
            let image = image.map_err(|problem| Error::Invalid(format!("the camera's frame: {problem}")))?;
            session.push(image.with_planes(3), time, missed)
        };
        match self.page.with(id, push) {
            Ok(frame) => Response::new(200, "application/json", json!({ "frame": frame }).to_string()),
            Err(error) => Response::error(400, &error.to_string()),
        }
    }

    fn message(&self, request: &Request) -> Response {
        if request.header("content-type") != Some("application/json") {
            return Response::error(415, "expected a body of application/json");
        }
        let answer = read(&request.body, &["list", "open", "picked"]).and_then(|asked| match asked {
            Asked::Page(message) => self.page.act(message),
            Asked::Own(own) => self.act(own),
        });
        match answer {
            Ok(value) => Response::new(200, "application/json", value.to_string()),
            Err(error) => Response::error(400, &error.to_string()),
        }
    }

    fn act(&self, message: Own) -> Result<Value> {
        let server = &self.page.host;
        match message {
            Own::List { path } => Ok(json!({ "entries": server.roots.list(&path)? })),
            Own::Open { path } => Ok(self.page.add(server.open(&path)?)),
            Own::Picked { session, frame, bbox, config, policy } => {
                let Setup { config, policy, .. } = server.setup(config, policy, None)?;
                let line = self.page.with(session, |s| {
                    check_box("the box", &bbox, &s.info)?;
                    if let Some(n) = s.info.exact_frames().filter(|n| frame > *n) {
                        let has = counted(n, "frame");
                        return Err(Error::Invalid(format!("frame {frame}: the video has {has}; choose one of them")));
                    }
                    Ok(command(&s.name, &[(frame - 1, bbox)], &config, policy.as_deref(), None))
                })?;
                if let Some(pick) = &server.pick {
                    say!("{line}");
                    if !pick.keep {
                        pick.done.store(true, Ordering::SeqCst);
                    }
                }
                Ok(json!({ "command": line, "ends": server.pick.as_ref().is_some_and(|pick| !pick.keep) }))
            }
        }
    }
}

impl Server {
    fn open(&self, path: &str) -> Result<Session<Self>> {
        if let Some(address) = self.roots.stream(path) {
            if self.options.sandbox.is_some() {
                return Err(Error::malformed(address, "a stream has no sandbox; start the server without --sandbox"));
            }
            let (source, info) = live::open(address)?;
            return Session::new(address.to_owned(), source, info, vec![]);
        }
        let place = self.roots.find(path)?;
        let video = self.run(|| Video::open(place, self.options.clone()))?;
        let (shown, info, truth) = (video.place.shown.clone(), video.info.clone(), video.truth());
        Session::new(shown, Source::Video(Open::new(video)), info, truth)
    }
}

/// Returns a frame (index from 0) as JPEG.
fn picture(session: &mut Session<Server>, index: usize) -> Result<Option<Arc<[u8]>>> {
    let decoded = session.decoded();
    match &mut session.source {
        Source::Video(video) => video.stills.get(index, decoded.as_ref()),
        Source::Live(..) => Ok(session.frame(index)?.map(|frame| jpeg(&frame.image).into())),
    }
}

/// Returns a saved file as a response.
fn file(session: &Session<Server>, name: &str) -> Option<Response> {
    let kind = match name.rsplit('.').next() {
        Some("csv") => "text/csv; charset=utf-8",
        Some("mp4") => "video/mp4",
        Some("png") => "image/png",
        // A saved HTML file must not run in the origin of our page.
        Some("html") => "application/octet-stream",
        _ => "text/plain; charset=utf-8",
    };
    if let Some(first) = session.text(name, 0) {
        let whole = (1..).map_while(|piece| session.text(name, piece)).fold(first, |text, piece| text + &piece);
        return Some(Response::new(200, kind, whole));
    }
    let Some(Made::File(path)) = session.made(name) else { return None };
    let file = std::fs::File::open(path).ok()?;
    let length = file.metadata().ok()?.len();
    let mut response = Response::new(200, kind, vec![]);
    response.file = Some((file, length));
    Some(response)
}
