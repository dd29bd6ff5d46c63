//! Any video the external program ffmpeg reads, as raw frames through a pipe.
//!
//! Pixels arrive as yuv4mpeg on its standard output. The times of the same frames arrive as numbers from a second
//! writer of ffmpeg on the pipe of its standard input. ffprobe reports colours and rate, field by field, and none of
//! these is text of the file. No metadata of a file, such as a title, passes through these channels; the log of
//! ffmpeg is for people only. The program is optional and runs as a separate process. It opens this file only:
//! formats that name other files (playlists, lists of pictures) and other protocols are forbidden.

mod facts;
mod input;
mod said;

use std::io::{BufRead, BufReader, ErrorKind, Read, pipe};
use std::path::{Path, PathBuf};
use std::process::{ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use crate::Remarks;
use crate::aspect::Aspect;
use crate::child::{Leash, listen};
use crate::decoded::{DecodeError, Decoded, Picture};
use crate::y4m::Y4m;
use crate::yuv::{Colour, Yuv};
use facts::Facts;
pub(crate) use facts::probe;
use foveate_base::{memory, thread};
use foveate_core::geometry::Size;
pub(crate) use input::{Input, KINDS};
pub(crate) use said::{NO_LENGTH, Said};

/// The pixels in ffmpeg's layout.
pub(crate) type Pixels = Y4m<BufReader<ChildStdout>>;

/// A running ffmpeg.
pub(super) struct Ffmpeg {
    program: PathBuf,
    input: Input,
    facts: Facts,
    leash: Leash,
    remarks: Remarks,
    /// Its output, until the first line of it is read.
    output: Option<ChildStdout>,
    pixels: Option<Pixels>,
    times: Receiver<Stamp>,
    said: Arc<Mutex<Said>>,
    /// The thread that reads its log.
    listener: Option<JoinHandle<()>>,
    /// The time of the last frame in seconds, and how many frames came.
    last: f64,
    frames: usize,
}

/// The time stamp of a frame in seconds from the first, and its duration by the rate; 0 if unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stamp {
    pub time: f64,
    lasts: f64,
}

/// The purpose of ffmpeg. If it is missing, the advice depends on this.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Task {
    /// A file that our own decoders do not read.
    File,
    /// H.264 in MP4, which they do.
    Coded,
    /// A stream or a camera.
    Live,
}

/// Frames as coded if yuv4mpeg supports the format; otherwise the nearest supported one.
pub(crate) const FORMATS: &str = "format=yuv420p|yuvj420p|yuv422p|yuvj422p|yuv444p|yuvj444p|gray|yuv420p10|yuv422p10|yuv444p10|gray10|yuv420p12|\
    yuv422p12|yuv444p12|gray12";

/// The most pixels of a picture that ffmpeg decodes: those that we would take.
pub(crate) fn most_pixels() -> String {
    (memory::limit() / memory::PIXEL).to_string()
}

/// Ticks a second of the times from ffmpeg. Times in 1/90000, 1/1000000 and of common rates are integers in this
/// unit, and others are off by at most a nanosecond. Without it ffmpeg rounds times to the mean frame rate.
pub(crate) const TICKS: &str = "1:1764000000";
/// A corrupt frame so near to the end, in frames, is the end.
const NEAR: usize = 4;
/// Times closer than this, in seconds, were invented by ffmpeg because time stamps do not rise.
const NEAREST: f64 = 1e-6;

impl Ffmpeg {
    /// Starts `program` on a file; the first `skip` frames are thrown away.
    ///
    /// # Errors
    /// Cause and remedy if the program is missing or does not start, or if the file has sound only.
    pub(crate) fn open(
        program: &Path,
        path: &Path,
        skip: usize,
        leash: &Leash,
        remarks: &Remarks,
    ) -> Result<Self, String> {
        Self::of_input(program, Input::file(path), skip, leash, remarks)
    }

    /// The same for any input.
    pub(crate) fn of_input(
        program: &Path,
        input: Input,
        skip: usize,
        leash: &Leash,
        remarks: &Remarks,
    ) -> Result<Self, String> {
        let facts = Facts::ask(program, &input);
        if facts.sound {
            return Err("expected a video, found sound alone; give a file with pictures".into());
        }
        let (program, leash, remarks, times) = (program.to_owned(), leash.clone(), remarks.clone(), sync_channel(0).1);
        let said = Arc::default();
        let mut ffmpeg = Self {
            program,
            input,
            facts,
            leash,
            remarks,
            output: None,
            pixels: None,
            times,
            said,
            listener: None,
            last: 0.0,
            frames: 0,
        };
        ffmpeg.start()?;
        for _ in 0..skip {
            match ffmpeg.picture() {
                Some(Ok(_)) => (),
                Some(Err(DecodeError::Unsupported(problem) | DecodeError::Damaged(problem))) => return Err(problem),
                None => return Err(format!("ffmpeg found only {} of the {skip} frames read so far", ffmpeg.frames)),
            }
        }
        Ok(ffmpeg)
    }

    fn start(&mut self) -> Result<(), String> {
        let passthrough = passthrough(&self.program, Task::File)?;
        let (times, writer) = pipe().map_err(|error| format!("a pipe to ffmpeg cannot be made ({error})"))?;
        let stream = self.facts.stream.map_or("0:V:0".to_owned(), |stream| format!("0:{stream}"));
        // Where the size changes it stops, in the place of making all pictures as large as the first.
        let guard = self.facts.sides.map_or(String::new(), |Size { width, height }| {
            format!(",scale=w='if(eq(iw,{width})*eq(ih,{height}),iw,NAN)':h=ih")
        });
        let mut command = Command::new(&self.program);
        command
            .args(["-hide_banner", "-nostdin", "-nostats", "-loglevel", "level+warning", "-copyts"])
            .args(self.input.guards())
            // A picture is cut at the left where the stream says, not only where memory is aligned.
            .args(["-flags", "unaligned", "-max_pixels", &most_pixels(), "-i"])
            .arg(&self.input.name)
            .args(["-map", &stream, "-an", "-sn", "-dn", "-map_metadata", "-1", "-vf", &format!("{FORMATS}{guard}")])
            .args(passthrough)
            // One frame goes to both outputs before the next one is made: none waits for the other.
            .args(["-enc_time_base", TICKS, "-c:v", "wrapped_avframe", "-strict", "-1", "-f", "tee"])
            .arg(r"[f=framecrc:flush_packets=1]pipe\:0|[f=yuv4mpegpipe:strict=-1]pipe\:1")
            .stdin(Stdio::from(writer))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|error| missing(&self.program, Task::File, &error))?;
        // The command holds the writer too: while it does, the times would never end.
        drop(command);
        self.output = child.stdout.take();
        let errors = child.stderr.take().expect("it was asked for a pipe");
        self.leash.hold(child);
        self.said = Arc::new(Mutex::new(Said { remarks: self.remarks.clone(), ..Said::default() }));
        self.listener = Some(hear(errors, self.said.clone())?);
        self.times = read_times(times, self.said.clone())?;
        Ok(())
    }

    /// Mean frames a second.
    pub(crate) fn rate(&self) -> f64 {
        self.facts.rate.unwrap_or(30.0)
    }

    /// An estimate of the number of frames.
    pub(crate) fn frames(&self) -> Option<usize> {
        self.facts.frames
    }

    /// The next frame and its time in seconds from the first.
    pub(crate) fn picture(&mut self) -> Option<Decoded<Picture>> {
        if let Some(output) = self.output.take() {
            let mut output = BufReader::new(output);
            let has_header = output.fill_buf().is_ok_and(|bytes| !bytes.is_empty());
            match Y4m::new(output, &[]) {
                Ok(pixels) => self.pixels = Some(pixels),
                Err(problem) if has_header => return Some(Err(problem)),
                // `end` returns the reason.
                Err(_) => (),
            }
        }
        match self.pixels.as_mut().and_then(Y4m::picture) {
            Some(Ok(yuv)) => Some(self.shown(&yuv)),
            last => self.end().or(last.and_then(Result::err).map(Err)),
        }
    }

    fn shown(&mut self, yuv: &Yuv) -> Decoded<Picture> {
        let head = self.pixels.as_ref().map(|pixels| pixels.head);
        // Grey that states no range has all of it, as in ffmpeg.
        let stated = head.and_then(|head| head.full_range);
        let full = stated.unwrap_or(self.facts.full_range || yuv.is_grey());
        let image = yuv.to_rgb(Colour::new(self.facts.matrix, full, yuv.width, yuv.height));
        let image = head.map_or(Aspect::default(), |head| head.aspect).square(image)?;
        self.remarks.set_sides(Size::new(yuv.width, yuv.height), image.size());
        let stamp = self.times.recv().ok();
        self.frames += 1;
        self.last = match stamp {
            _ if self.frames == 1 => 0.0,
            Some(stamp) if stamp.time > self.last + NEAREST => stamp.time,
            stamp => {
                self.remarks.add_untimed(self.frames);
                let lasts = stamp.map_or(0.0, |stamp| stamp.lasts);
                self.last + self.facts.rate.map_or(if lasts > 0.0 { lasts } else { 1.0 / 30.0 }, |rate| 1.0 / rate)
            }
        };
        Ok((image, self.last))
    }

    /// Why frames stopped; `None` at the end of the video.
    fn end(&mut self) -> Option<Decoded<Picture>> {
        // While its pictures or times could be read, ffmpeg would wait for a reader.
        self.pixels = None;
        while self.times.recv().is_ok() {}
        let ended = self.leash.wait();
        // Its last messages may not have been read yet; the log ends with the program.
        self.listener.take().map(JoinHandle::join);
        let said = std::mem::take(&mut *self.said.lock().unwrap_or_else(PoisonError::into_inner));
        if said.resized && self.frames == 0 {
            // ffprobe was wrong about the size.
            self.facts.sides = None;
            return match self.start() {
                Ok(()) => self.picture(),
                Err(problem) => Some(Err(DecodeError::Damaged(problem))),
            };
        }
        if said.resized {
            let expected = |size: Size| format!("expected {size} pixels as in the first frame, ");
            let size = self.facts.sides.map_or(String::new(), expected);
            return Some(Err(DecodeError::Damaged(format!(
                "{size}found others; cut the video where the size changes"
            ))));
        }
        if self.frames > 0 && ended.is_some_and(|status| status.success()) {
            let corrupt = said.corrupt.filter(|(at, _)| at + NEAR >= self.frames).map(|(_, text)| text);
            let end = said.cut.or(corrupt)?;
            return Some(Err(DecodeError::damaged(format!("the video breaks off: ffmpeg says \"{end}\""))));
        }
        let text = said.complaint.unwrap_or_else(|| "it gave no reason".into());
        Some(Err(match self.frames {
            0 if text.contains("not on whitelist") => {
                let problem = "expected a video, found a file of another kind";
                DecodeError::Damaged(format!("{problem}; check that this is a video, or convert it to H.264 in MP4"))
            }
            0 => {
                let problem = "expected a video that ffmpeg reads; it says";
                DecodeError::Damaged(format!("{problem}: {text}; check that this is a video, and whole"))
            }
            _ => DecodeError::damaged(format!("ffmpeg stopped: {text}")),
        }))
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        self.leash.end();
    }
}

/// Reads its log.
fn hear(errors: impl Read + Send + 'static, said: Arc<Mutex<Said>>) -> Result<JoinHandle<()>, String> {
    listen(errors, move |line| said.lock().unwrap_or_else(PoisonError::into_inner).hear(&line))
}

/// The times of the frames from the first, as they come: lines of numbers under a head that states the unit.
pub(crate) fn read_times(lines: impl Read + Send + 'static, said: Arc<Mutex<Said>>) -> Result<Receiver<Stamp>, String> {
    let (send, times) = sync_channel(1 << 10);
    let read = move || {
        let (mut unit, mut first) = (None, None);
        for line in BufReader::new(lines).lines().map_while(Result::ok) {
            if let Some(stated) = line.strip_prefix("#tb 0: ") {
                unit = stated.trim().split_once('/').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
            }
            if line.starts_with('#') {
                continue;
            }
            let field = |n| line.split(',').nth(n).and_then(|number| number.trim().parse::<i64>().ok());
            let (Some((over, under)), Some(stamp)) = (unit, field(2)) else { break };
            // Of whole numbers: the seconds are the nearest number to the exact ones.
            let (over, under): (i64, i64) = (over, under);
            let seconds = |ticks: i128| (ticks * i128::from(over)) as f64 / under as f64;
            let time = seconds(i128::from(stamp) - i128::from(*first.get_or_insert(stamp)));
            said.lock().unwrap_or_else(PoisonError::into_inner).frames += 1;
            if send.send(Stamp { time, lasts: seconds(field(3).unwrap_or(0).into()) }).is_err() {
                break;
            }
        }
    };
    thread::start("reading times from ffmpeg", read).map_err(|error| error.to_string())?;
    Ok(times)
}

/// Every frame as it is, none doubled or left out. Before 5.1 the option had another name.
pub(crate) fn passthrough(program: &Path, task: Task) -> Result<[&'static str; 2], String> {
    let help = Command::new(program)
        .args(["-hide_banner", "-h", "long"])
        .stdin(Stdio::null())
        .output()
        .map_err(|error| missing(program, task, &error))?;
    let knows = help.stdout.windows(9).any(|text| text == b"-fps_mode");
    Ok(if knows { ["-fps_mode", "passthrough"] } else { ["-vsync", "0"] })
}

/// Why ffmpeg does not start, with the remedy.
pub(crate) fn missing(program: &Path, task: Task, error: &std::io::Error) -> String {
    let found = match error.kind() {
        ErrorKind::NotFound => "which was not found".to_owned(),
        _ => format!("which does not start ({error})"),
    };
    let (need, instead) = match task {
        Task::File => (
            "only H.264 in MP4 (8 or 10 bits, 4:2:0 or 4:2:2) and yuv4mpeg are read without",
            ", or convert the video elsewhere to H.264 in MP4",
        ),
        Task::Coded => ("the decoder ffmpeg is", ", or take --decoder auto, which reads H.264 in MP4 without it"),
        Task::Live => ("a camera or a stream is read by", ""),
    };
    format!(
        "{need} the program {}, {found}; install it \
         (`apt install ffmpeg`, `brew install ffmpeg`, `winget install ffmpeg`, or https://ffmpeg.org){instead}",
        program.display()
    )
}

#[cfg(test)]
mod tests;
