//! A stream or a camera as an ffmpeg of its own gives it. Where it breaks off, another one is started.
//!
//! ffmpeg may open only the address itself: each scheme has its protocols and kinds of streams.

mod clock;
mod heard;

use std::ffi::OsString;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::address::{Scheme, without_password};
use crate::child::{Interrupt, Leash, guarded, listen};
use crate::ffmpeg::{FORMATS, Pixels, Said, Stamp, TICKS, Task, missing, most_pixels, passthrough, read_times};
use crate::y4m::Y4m;
use crate::yuv::Colour;
use crate::{Frame, LiveOptions, Remarks, SourceInfo};
use clock::Clock;
use foveate_base::{Error, Result, thread};
use foveate_core::geometry::Size;
use heard::Heard;

/// The first pause before a stream is opened again, and the longest; each is twice the one before.
const PAUSES: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(4));
/// The reason of an ffmpeg that gives none.
const NO_REASON: &str = "no reason";
/// The time stamp of a frame comes before its pixels.
const PATIENCE: Duration = Duration::from_millis(200);

/// A stream that is opened again if it breaks off.
pub(crate) struct Connection {
    address: PathBuf,
    /// The address as errors may show it.
    pub shown: PathBuf,
    pub scheme: Scheme,
    options: LiveOptions,
    pub info: SourceInfo,
    pub remarks: Remarks,
    leash: Leash,
    /// The option with which this ffmpeg leaves no frame out.
    passthrough: [&'static str; 2],
    pixels: Option<Pixels>,
    times: Option<Receiver<Stamp>>,
    /// Whether time stamps are reliable.
    pub timed: bool,
    clock: Clock,
    heard: Arc<Mutex<Heard>>,
    /// Whether this ffmpeg gave a frame: what it logs before is no damage.
    begun: bool,
    /// Reads the log of this ffmpeg.
    listener: Option<JoinHandle<()>>,
    stall: Duration,
    watch: Watch,
    reconnected: Arc<AtomicU64>,
    first: Option<Frame>,
    next: usize,
}

/// When an ffmpeg that gives nothing is ended, in milliseconds of a clock that is never set anew.
#[derive(Clone)]
struct Watch {
    began: Instant,
    due: Arc<AtomicU64>,
}

impl Watch {
    fn set(&self, due: Option<Instant>) {
        let due = due.map_or(u64::MAX, |due| due.saturating_duration_since(self.began).as_millis() as u64);
        self.due.store(due, Ordering::Relaxed);
    }

    fn start(&self, leash: Leash) -> Result<()> {
        let this = self.clone();
        let watch = move || {
            while !leash.is_over() {
                std::thread::sleep(Duration::from_millis(100));
                if this.began.elapsed().as_millis() as u64 > this.due.load(Ordering::Relaxed) {
                    leash.end();
                }
            }
        };
        thread::start("watching ffmpeg", watch).map(drop)
    }
}

impl Connection {
    /// Opens a stream and waits for its first frame. Reconnects if no frame arrives for `stall`.
    ///
    /// # Errors
    /// Fails if the address is of an unknown scheme, ffmpeg is not there, or it finds no video.
    pub(crate) fn open(address: &Path, options: LiveOptions, stall: Duration) -> Result<Self> {
        let shown = PathBuf::from(&*without_password(&address.to_string_lossy()));
        let wrong = |problem: String| Error::malformed(&shown, problem);
        let scheme = Scheme::of(address).ok_or_else(|| {
            wrong("expected an address that begins with rtsp://, http://, https:// or /dev/video".into())
        })?;
        if options.listen && scheme.listen.is_none() {
            return Err(wrong("this kind of source cannot be waited for; listen at rtsp:// or http://".into()));
        }
        let passthrough = passthrough(&options.ffmpeg, Task::Live).map_err(wrong)?;
        let info = SourceInfo { width: 0, height: 0, frames: None, rate: 0.0, reader: "ffmpeg, live".into() };
        let mut live = Self {
            address: address.to_owned(),
            shown,
            scheme,
            options,
            info,
            remarks: Remarks::default(),
            leash: Leash::default(),
            passthrough,
            pixels: None,
            times: None,
            timed: true,
            clock: Clock::default(),
            heard: Arc::default(),
            begun: false,
            listener: None,
            stall,
            watch: Watch { began: Instant::now(), due: Arc::default() },
            reconnected: Arc::default(),
            first: None,
            next: 0,
        };
        if live.options.listen {
            live.notify("waiting for a sender");
        }
        // The wait for the first sender has no limit.
        let due = (!live.options.listen).then(|| Instant::now() + stall);
        live.connect(due).map_err(|problem| Error::malformed(&live.shown, problem))?;
        live.watch.start(live.leash.clone())?;
        let Some(frame) = live.frame(due) else {
            let reason = live.reason();
            let problem = format!("expected a stream that ffmpeg reads; it reports: {reason}; {}", advice(&reason));
            return Err(Error::malformed(&live.shown, problem));
        };
        let Size { width, height } = frame.image.size();
        live.info = SourceInfo { width, height, ..live.info.clone() };
        live.first = Some(frame);
        Ok(live)
    }

    /// How often it was opened again. Counts on after this source was handed over.
    pub(crate) fn reconnections(&self) -> Arc<AtomicU64> {
        self.reconnected.clone()
    }

    /// To end it from another thread.
    pub(crate) fn interrupt(&self) -> Interrupt {
        self.leash.interrupt()
    }

    fn notify(&self, news: &str) {
        (self.options.notify)(&format!("{}: {news}", self.shown.display()));
    }

    fn reason(&mut self) -> String {
        self.complaint().unwrap_or_else(|| NO_REASON.into())
    }

    /// The first error that the ffmpeg reported which is given up.
    fn complaint(&mut self) -> Option<String> {
        self.leash.end();
        // It may have ended before its words were read.
        if let Some(listener) = self.listener.take() {
            let _ = listener.join();
        }
        let reason = self.heard.lock().unwrap_or_else(PoisonError::into_inner).complaint.take();
        // It may repeat the address.
        reason.map(|text| text.replace(&*self.address.to_string_lossy(), &self.shown.to_string_lossy()))
    }

    /// Starts ffmpeg, and ends it if no frame arrives until `due`.
    fn connect(&mut self, due: Option<Instant>) -> std::result::Result<(), String> {
        let program = &*self.options.ffmpeg;
        self.watch.set(due);
        let (mut command, line) =
            guarded(program).map_err(|error| format!("a pipe to ffmpeg cannot be made ({error})"))?;
        command
            .args(arguments(&self.scheme, &self.address, self.options.listen, self.info.size()))
            .args(self.passthrough)
            // One frame goes to both outputs before the next one is made, its time first.
            .args(["-enc_time_base", TICKS, "-c:v", "wrapped_avframe", "-strict", "-1", "-f", "tee"])
            .arg(r"[f=framecrc:flush_packets=1]pipe\:0|[f=yuv4mpegpipe:strict=-1:flush_packets=1]pipe\:1")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|error| missing(program, Task::Live, &error))?;
        // The command holds the other end of the line: while it does, the line never ends.
        drop(command);
        let output = child.stdout.take().expect("it was asked for a pipe");
        let errors = child.stderr.take().expect("it was asked for a pipe");
        let times = line.reader().map_err(|error| format!("a pipe to ffmpeg cannot be made ({error})"))?;
        self.leash.hold_with(child, line);
        self.heard.lock().unwrap_or_else(PoisonError::into_inner).restart();
        self.begun = false;
        let heard = self.heard.clone();
        self.listener =
            Some(listen(errors, move |line| heard.lock().unwrap_or_else(PoisonError::into_inner).hear(&line))?);
        self.times = Some(read_times(times, Arc::<Mutex<Said>>::default())?);
        self.clock.restart();
        self.pixels = Y4m::new(BufReader::new(output), &[]).ok();
        Ok(())
    }

    /// The next frame of this connection. Ends ffmpeg if it does not arrive until `due`.
    fn frame(&mut self, due: Option<Instant>) -> Option<Frame> {
        self.watch.set(due);
        let pixels = self.pixels.as_mut()?;
        let yuv = pixels.picture()?.ok()?;
        // From here on the reader is waited for, and may take its time.
        self.watch.set(None);
        let full = pixels.head.full_range.unwrap_or(yuv.is_grey());
        let image = yuv.to_rgb(Colour::new(None, full, yuv.width, yuv.height));
        let image = pixels.head.aspect.square(image).ok()?;
        self.remarks.set_sides(Size::new(yuv.width, yuv.height), image.size());
        let stamp = self.times.as_ref().and_then(|times| times.recv_timeout(PATIENCE).ok());
        if stamp.is_none() {
            // Those that come late would belong to other frames.
            self.times = None;
        }
        let (time, jumped) = self.clock.time(stamp.filter(|_| self.timed).map(|stamp| stamp.time), Instant::now());
        if jumped {
            self.remarks.add_jump(self.next + 1);
        }
        self.heard.lock().unwrap_or_else(PoisonError::into_inner).report(self.next + 1, self.begun, &self.remarks);
        self.begun = true;
        Some(Frame { index: self.next, time, image })
    }

    /// Opens it again, with longer and longer pauses. `Ok(None)`: it is over.
    fn again(&mut self) -> Result<Option<Frame>> {
        let status = self.leash.wait();
        let (whole, stalled) = (status.is_some_and(|status| status.success()), status.is_none());
        if self.leash.is_over() {
            return Ok(None);
        }
        let reason = if stalled { format!("nothing came for {} s", self.stall.as_secs()) } else { self.reason() };
        self.leash.end();
        let (patience, frames, listen) = (self.options.reconnect, self.next, self.options.listen);
        if whole && (self.scheme.ends || patience.is_zero()) {
            return Ok(None);
        }
        let end = if whole { "ended" } else { "broke off" };
        let why = if whole { String::new() } else { format!(" ({reason})") };
        let todo = if listen { "waiting for another sender" } else { "opening it again" };
        if !patience.is_zero() {
            self.notify(&format!(
                "the stream {end} after frame {frames}{why}; {todo}, for {} s at most",
                patience.as_secs()
            ));
        }
        let (deadline, mut pause, mut last) = (Instant::now() + patience, PAUSES.0, None);
        while Instant::now() < deadline {
            let until = deadline.min(Instant::now() + pause);
            while Instant::now() < until {
                if self.leash.is_over() {
                    return Ok(None);
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            pause = (2 * pause).min(PAUSES.1);
            let due = if listen { deadline } else { deadline.min(Instant::now() + self.stall) };
            if self.connect(Some(due)).is_ok()
                && let Some(frame) = self.frame(Some(due))
            {
                self.reconnected.fetch_add(1, Ordering::Relaxed);
                return Ok(Some(frame));
            }
            if self.leash.is_over() {
                return Ok(None);
            }
            // The last one may be ended before it says anything.
            last = Some(self.complaint().or(last).unwrap_or_else(|| NO_REASON.into()));
        }
        if whole && listen {
            self.notify("no other sender came: the stream is at its end");
            return Ok(None);
        }
        let problem = match last {
            Some(last) if !listen => {
                format!(
                    "the stream {end} ({reason}) and could not be opened again in {} s; ffmpeg reports: {last}",
                    patience.as_secs()
                )
            }
            Some(_) => format!(
                "the stream {end}, and no other sender came in {} s; ffmpeg reports: {reason}",
                patience.as_secs()
            ),
            None => format!("the stream {end}; ffmpeg reports: {reason}"),
        };
        Err(Error::Frame { path: self.shown.clone(), frame: frames + 1, problem })
    }
}

impl Iterator for Connection {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.leash.is_over() {
            return None;
        }
        let due = Some(Instant::now() + self.stall);
        let frame = match self.first.take().or_else(|| self.frame(due)) {
            Some(frame) => Ok(frame),
            None => self.again().transpose()?,
        };
        match &frame {
            Ok(frame) => self.next = frame.index + 1,
            Err(_) => self.leash.end_for_good(),
        }
        Some(frame)
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.leash.end_for_good();
    }
}

/// What to do about an error of ffmpeg.
fn advice(reason: &str) -> &'static str {
    match ["partial file", "moov atom not found"].iter().any(|text| reason.contains(text)) {
        true => {
            "an MP4 with its index at its end needs a server that sends parts of files (Range): download it first, or put the index at \
             its beginning with `ffmpeg -i IN -c copy -movflags +faststart OUT.mp4`"
        }
        false => "check the address and the sender",
    }
}

/// The options of ffmpeg up to its output. Once the size is known, frames keep it.
fn arguments(scheme: &Scheme, address: &Path, listen: bool, size: Size) -> Vec<OsString> {
    let input = scheme.input(address);
    // Decoding several frames at a time would hold back as many.
    let mut options =
        vec!["-hide_banner", "-nostdin", "-nostats", "-loglevel", "level+verbose", "-thread_type", "slice"];
    options.extend(scheme.listen.filter(|_| listen).unwrap_or_default());
    let most = most_pixels();
    options.extend(["-flags", "unaligned", "-max_pixels", &most]);
    let scale =
        if size.width > 0 { format!("scale={}:{},{FORMATS}", size.width, size.height) } else { FORMATS.to_owned() };
    let mut all: Vec<OsString> = options.into_iter().map(OsString::from).collect();
    all.extend(input.guards());
    all.extend(["-i".into(), input.name]);
    all.extend(["-map", "0:v:0", "-an", "-sn", "-dn", "-map_metadata", "-1", "-vf", &scale].map(OsString::from));
    all
}

#[cfg(test)]
mod tests;
