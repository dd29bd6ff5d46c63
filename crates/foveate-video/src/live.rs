//! Streams and cameras through the program ffmpeg: `rtsp://`, `http://`, `/dev/video0`. One that breaks off is opened again.
//!
//! ffmpeg may open what the address names and nothing else: each scheme has its protocols and its kinds of streams.

use std::borrow::Cow;
use std::ffi::OsString;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::child::{Interrupt, Leash, listen};
use crate::ffmpeg::{FORMATS, KINDS, Pixels, Task, missing, most_pixels, passthrough};
use crate::y4m::Y4m;
use crate::yuv::Colour;
use crate::{Frame, FrameSource, SourceInfo};
use foveate_base::{Error, Result, thread};

/// How a stream is to be opened.
#[derive(Clone, Debug)]
pub struct LiveOptions {
    /// The program ffmpeg: a path, or a name to be found as programs are.
    pub ffmpeg: PathBuf,
    /// Wait at the address for a sender, in the place of asking one there.
    pub listen: bool,
    /// How long to try to open it again after it broke off, before that is an error; zero does not try.
    pub reconnect: Duration,
}

impl Default for LiveOptions {
    fn default() -> Self {
        Self { ffmpeg: "ffmpeg".into(), listen: false, reconnect: Duration::from_secs(60) }
    }
}

/// The first pause before a stream is opened again, and the longest; each is twice the one before.
const PAUSES: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(4));
/// A stream that gives nothing for so long is opened again.
const STALL: Duration = Duration::from_secs(10);

/// What ffmpeg is told of a scheme.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Scheme {
    name: &'static str,
    protocols: &'static str,
    options: &'static [&'static str],
    /// What makes it wait for a sender.
    listen: Option<&'static [&'static str]>,
    /// Whether it may come to an end.
    ends: bool,
}

const SCHEMES: [Scheme; 4] = [
    Scheme {
        name: "rtsp://",
        protocols: "rtsp,tcp",
        options: &["-format_whitelist", "rtsp", "-rtsp_transport", "tcp"],
        listen: Some(&["-rtsp_flags", "listen"]),
        ends: false,
    },
    Scheme { name: "http://", protocols: "http,tcp", options: &[], listen: Some(&["-listen", "1"]), ends: true },
    Scheme { name: "https://", protocols: "https,tls,tcp", options: &[], listen: None, ends: true },
    Scheme {
        name: "/dev/video",
        protocols: "file",
        options: &["-format_whitelist", "video4linux2,v4l2", "-f", "v4l2"],
        listen: None,
        ends: false,
    },
];

fn scheme(address: &Path) -> Option<Scheme> {
    let text = address.to_str()?;
    SCHEMES
        .into_iter()
        .find(|scheme| text.get(..scheme.name.len()).is_some_and(|s| s.eq_ignore_ascii_case(scheme.name)))
}

/// Whether this is the address of a stream or a camera, not a path.
pub fn is_live(address: &Path) -> bool {
    scheme(address).is_some()
}

/// The address of a stream as it may be shown: without the name and the password that may stand before its host. Other text stays.
pub fn without_password(address: &str) -> Cow<'_, str> {
    let (Some(_), Some((scheme, rest))) = (scheme(Path::new(address)), address.split_once("://")) else {
        return address.into();
    };
    let host = rest.find(['/', '?', '#']).unwrap_or(rest.len());
    match rest[..host].rfind('@') {
        Some(at) => format!("{scheme}://{}", &rest[at + 1..]).into(),
        None => address.into(),
    }
}

/// A stream, opened again where it breaks off. Times are those of the clock, from the first frame on.
pub struct Live {
    address: PathBuf,
    /// The address as errors may say it.
    shown: PathBuf,
    scheme: Scheme,
    options: LiveOptions,
    info: SourceInfo,
    leash: Leash,
    /// How this ffmpeg is told to leave no frame out.
    passthrough: [&'static str; 2],
    pixels: Option<Pixels>,
    complaint: Arc<Mutex<Option<String>>>,
    /// Reads what this ffmpeg complains of.
    listener: Option<JoinHandle<()>>,
    /// The time of the first frame.
    began: Option<Instant>,
    /// The clock of signs of life: it is never set anew, for the watch has a copy of it.
    clock: Instant,
    /// Milliseconds of that clock at the last sign of life.
    alive: Arc<AtomicU64>,
    reconnected: Arc<AtomicU64>,
    first: Option<Frame>,
    next: usize,
}

impl Live {
    /// Opens a stream and waits for its first frame.
    ///
    /// # Errors
    /// Where the address is of an unknown scheme, ffmpeg is not there, or it finds no video.
    pub fn open(address: &Path, options: LiveOptions) -> Result<Self> {
        Self::open_within(address, options, STALL)
    }

    /// The same for a stream that is opened again where it gives nothing for `stall`.
    fn open_within(address: &Path, options: LiveOptions, stall: Duration) -> Result<Self> {
        let shown = PathBuf::from(&*without_password(&address.to_string_lossy()));
        let wrong = |problem: String| Error::malformed(&shown, problem);
        let scheme = scheme(address).ok_or_else(|| {
            wrong("expected an address that begins with rtsp://, http://, https:// or /dev/video".into())
        })?;
        if options.listen && scheme.listen.is_none() {
            return Err(wrong("this kind of source cannot be waited for; listen at rtsp:// or http://".into()));
        }
        let info = SourceInfo { width: 0, height: 0, frames: None, rate: 0.0, reader: "ffmpeg, live".into() };
        let (leash, complaint, alive, reconnected) =
            <(Leash, Arc<Mutex<_>>, Arc<AtomicU64>, Arc<AtomicU64>)>::default();
        let passthrough = passthrough(&options.ffmpeg, Task::Live).map_err(wrong)?;
        let (address, clock) = (address.to_owned(), Instant::now());
        let mut live = Self {
            address,
            shown,
            scheme,
            options,
            info,
            leash,
            passthrough,
            pixels: None,
            complaint,
            listener: None,
            began: None,
            clock,
            alive,
            reconnected,
            first: None,
            next: 0,
        };
        live.connect().map_err(|problem| Error::malformed(&live.shown, problem))?;
        live.watch(stall)?;
        let Some(frame) = live.frame() else {
            let said = live.said();
            let problem =
                format!("expected a stream that ffmpeg reads; it says: {said}; check the address and the sender");
            return Err(Error::malformed(&live.shown, problem));
        };
        let stated = live.pixels.as_ref().and_then(|pixels| pixels.head.rate);
        let (width, height, rate) = (frame.image.width(), frame.image.height(), stated.unwrap_or(30.0));
        live.info = SourceInfo { width, height, rate, ..live.info.clone() };
        live.first = Some(frame);
        Ok(live)
    }

    /// How often it was opened again. Counts on after this source was handed over.
    pub fn reconnections(&self) -> Arc<AtomicU64> {
        self.reconnected.clone()
    }

    /// What the ffmpeg that is given up said last.
    fn said(&mut self) -> String {
        self.leash.end();
        // It may have ended before its words were read.
        if let Some(listener) = self.listener.take() {
            let _ = listener.join();
        }
        let said = self.complaint.lock().unwrap_or_else(PoisonError::into_inner).take();
        // It may repeat the address.
        let said = said.map(|said| said.replace(&*self.address.to_string_lossy(), &self.shown.to_string_lossy()));
        said.unwrap_or_else(|| "it gave no reason".into())
    }

    fn connect(&mut self) -> std::result::Result<(), String> {
        let program = &*self.options.ffmpeg;
        let mut child = guarded(program)
            .args(arguments(&self.scheme, &self.address, self.options.listen, (self.info.width, self.info.height)))
            .args(self.passthrough)
            .args(["-c:v", "wrapped_avframe", "-strict", "-1", "-flush_packets", "1", "-f", "yuv4mpegpipe", "pipe:1"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| missing(program, Task::Live, &error))?;
        let output = child.stdout.take().expect("it was asked for a pipe");
        let complaint = self.complaint.clone();
        let errors = child.stderr.take().expect("it was asked for a pipe");
        self.leash.hold(child);
        self.listener = Some(listen(errors, move |line| {
            if let Some((_, text)) = line.split_once("[error] ").or_else(|| line.split_once("[fatal] ")) {
                complaint.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(text.trim().to_owned());
            }
        })?);
        self.show_life(self.options.listen);
        self.pixels = Y4m::new(BufReader::new(output), &[]).ok();
        Ok(())
    }

    /// Who waits for a sender may wait.
    fn show_life(&self, waits: bool) {
        let now = if waits { u64::MAX } else { self.clock.elapsed().as_millis() as u64 };
        self.alive.store(now, Ordering::Relaxed);
    }

    /// Ends an ffmpeg that gives nothing: then it is started again.
    fn watch(&self, stall: Duration) -> Result<()> {
        let (leash, alive, clock) = (self.leash.clone(), self.alive.clone(), self.clock);
        let watch = move || {
            while !leash.is_over() {
                std::thread::sleep(Duration::from_millis(500));
                let last = alive.load(Ordering::Relaxed);
                if (clock.elapsed().as_millis() as u64).saturating_sub(last) > stall.as_millis() as u64 {
                    leash.end();
                }
            }
        };
        thread::start("watching ffmpeg", watch).map(drop)
    }

    /// The next frame of this connection.
    fn frame(&mut self) -> Option<Frame> {
        let pixels = self.pixels.as_mut()?;
        let yuv = pixels.picture()?.ok()?;
        let full = pixels.head.full_range.unwrap_or(false);
        let image = yuv.to_rgb(Colour::new(None, full, yuv.width, yuv.height));
        let image = pixels.head.aspect.square(image).ok()?;
        self.show_life(false);
        let now = Instant::now();
        let time = now.duration_since(*self.began.get_or_insert(now)).as_secs_f64();
        Some(Frame { index: self.next, time, image })
    }

    /// Opens it again, with longer and longer pauses. `Some(Ok(None))`: it is over.
    fn again(&mut self) -> Result<Option<Frame>> {
        let ended = self.leash.wait().is_some_and(|status| status.success());
        self.leash.end();
        let (broke, mut pause) = (Instant::now(), PAUSES.0);
        if self.scheme.ends && ended {
            return Ok(None);
        }
        loop {
            if broke.elapsed() >= self.options.reconnect {
                let tried = self.options.reconnect.as_secs();
                let problem =
                    format!("the stream broke off and did not come back in {tried} s; ffmpeg says: {}", self.said());
                return Err(Error::Frame { path: self.shown.clone(), frame: self.next + 1, problem });
            }
            let until = Instant::now() + pause;
            while Instant::now() < until {
                if self.leash.is_over() {
                    return Ok(None);
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            pause = (2 * pause).min(PAUSES.1);
            self.complaint.lock().unwrap_or_else(PoisonError::into_inner).take();
            if self.connect().is_ok()
                && let Some(frame) = self.frame()
            {
                self.reconnected.fetch_add(1, Ordering::Relaxed);
                return Ok(Some(frame));
            }
            if self.leash.is_over() {
                return Ok(None);
            }
            self.leash.end();
        }
    }
}

impl Iterator for Live {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.leash.is_over() {
            return None;
        }
        let frame = match self.first.take().or_else(|| self.frame()) {
            Some(frame) => frame,
            None if self.leash.is_over() => return None,
            None => match self.again() {
                Ok(frame) => frame?,
                Err(error) => {
                    self.leash.end_for_good();
                    return Some(Err(error));
                }
            },
        };
        self.next = frame.index + 1;
        Some(Ok(frame))
    }
}

impl FrameSource for Live {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
    fn interrupt(&self) -> Option<Interrupt> {
        Some(self.leash.interrupt())
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.leash.end_for_good();
    }
}

/// What ffmpeg is told. Once the size is known, frames keep it.
fn arguments(scheme: &Scheme, address: &Path, listen: bool, size: (usize, usize)) -> Vec<OsString> {
    let mut options = vec!["-hide_banner", "-nostats", "-loglevel", "level+warning", "-fflags", "nobuffer"];
    // Decoding several frames at a time would hold back as many.
    options.extend(["-thread_type", "slice", "-protocol_whitelist", scheme.protocols]);
    options.extend(scheme.options);
    let of_lists = address.to_string_lossy().split('?').next().is_some_and(|path| path.ends_with(".m3u8"));
    let kinds = if of_lists { format!("{KINDS},hls") } else { KINDS.to_owned() };
    if scheme.ends {
        options.extend(["-format_whitelist", &kinds]);
    }
    options.extend(scheme.listen.filter(|_| listen).unwrap_or_default());
    let most = most_pixels();
    options.extend(["-max_pixels", &most]);
    let scale = if size.0 > 0 { format!("scale={}:{},{FORMATS}", size.0, size.1) } else { FORMATS.to_owned() };
    let mut all: Vec<OsString> = options.into_iter().map(OsString::from).collect();
    all.extend(["-i".into(), address.as_os_str().to_owned()]);
    all.extend(["-map", "0:v:0", "-an", "-sn", "-dn", "-map_metadata", "-1", "-vf", &scale].map(OsString::from));
    all
}

/// A shell ends the program when our end of its standard input closes, however this process ends.
#[cfg(unix)]
fn guarded(program: &Path) -> Command {
    const SCRIPT: &str = r#"exec 3<&0
"$0" "$@" </dev/null 3<&- &
child=$!
{ read -r _ <&3; kill -9 $child; } >/dev/null 2>&1 &
guard=$!
wait $child
status=$?
kill $guard 2>/dev/null
exit $status"#;
    let mut command = Command::new("/bin/sh");
    command.args(["-c", SCRIPT]).arg(program);
    command
}

#[cfg(not(unix))]
fn guarded(program: &Path) -> Command {
    Command::new(program)
}

#[cfg(test)]
mod tests;
