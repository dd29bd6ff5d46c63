//! Any video the external program ffmpeg reads, as raw frames through a pipe.
//!
//! Pixels come as yuv4mpeg on its standard output, and the times of the same frames, as numbers, from a second writer of ffmpeg's on
//! the pipe that is its standard input. Colours and rate are asked of ffprobe, field by field, none of which is text of the file.
//! Nothing that a file says of itself, as a title, goes through any of these; what ffmpeg logs is for people alone.
//! The program is optional and runs as a separate process. It opens this file and no other: neither kinds of files that name others
//! (playlists, lists of pictures) nor other protocols are allowed.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, ErrorKind, Read, pipe};
use std::path::{Path, PathBuf};
use std::process::{ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};

use crate::child::{Leash, listen};
use crate::decoded::{DecodeError, Decoded, Picture};
use crate::y4m::Y4m;
use crate::yuv::Colour;
use foveate_base::{memory, thread};

/// The pixels as ffmpeg hands them over.
pub(crate) type Pixels = Y4m<BufReader<ChildStdout>>;

/// A running ffmpeg.
pub(super) struct Ffmpeg {
    leash: Leash,
    /// Its output, until the first line of it is read.
    output: Option<ChildStdout>,
    pixels: Option<Pixels>,
    times: Receiver<f64>,
    said: Arc<Mutex<Said>>,
    facts: Facts,
    /// Time stamp of the first frame, and how many frames came.
    origin: Option<f64>,
    frames: usize,
}

/// What ffmpeg is needed for: where it is missing, something else can be done about each.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Task {
    /// A file that our own decoders do not read.
    File,
    /// H.264 in MP4, which they do.
    Coded,
    /// A stream or a camera.
    Live,
}

/// What ffmpeg said that matters to people.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Said {
    complaint: Option<String>,
    /// What it said of the end of the file, and of the last corrupt frame: how many frames had come.
    cut: Option<String>,
    corrupt: Option<(usize, String)>,
    frames: usize,
}

/// What ffprobe knows of a video.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Facts {
    rate: Option<f64>,
    frames: Option<usize>,
    /// As in H.264's table E-5.
    matrix: Option<u16>,
    full_range: bool,
}

/// What ffmpeg says of a file that was cut off. It ends well all the same.
const CUT: [&str; 4] = ["ended prematurely", "Error during demuxing", "partial file", "Truncating packet"];
/// What it says of a frame that it makes up in part.
const CORRUPT: [&str; 2] = ["corrupt decoded frame", "corrupt input packet"];
/// A corrupt frame so near to the end, in frames, is the end.
const NEAR: usize = 4;

/// Kinds of files that hold their frames themselves. Those that name other files or addresses are left out on purpose.
pub(crate) const KINDS: &str = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpeg,mpegts,mpegtsraw,mpegvideo,vob,flv,live_flv,kux,asf,ogg,\
    h264,hevc,vvc,av1,obu,ivf,m4v,mjpeg,mjpeg_2000,mpjpeg,gif,apng,yuv4mpegpipe,nut,rm,wtv,dv,mxf,vc1,vc1test,h263,h261,dirac,swf,\
    nsv,bink,smk,ea,roq,gxf,mtv,nuv,cavsvideo,avs2,avs3,dxa,cdxl,fli,flic,lvf,mv,r3d,rpl,sdr2,thp,truehd,viv,xmv,yop";

/// Frames as they are coded, where yuv4mpeg has a name for that; else the nearest that has.
pub(crate) const FORMATS: &str = "format=yuv420p|yuvj420p|yuv422p|yuvj422p|yuv444p|yuvj444p|gray|yuv420p10|yuv422p10|yuv444p10|gray10|yuv420p12|\
    yuv422p12|yuv444p12|gray12";

/// The most pixels of a picture that ffmpeg decodes: those that we would take.
pub(crate) fn most_pixels() -> String {
    (memory::limit() / memory::PIXEL).to_string()
}

impl Ffmpeg {
    /// Starts `program` on a file; the first `skip` frames are thrown away.
    ///
    /// # Errors
    /// What is wrong and what to do, where the program is not there or does not start.
    pub fn open(program: &Path, path: &Path, skip: usize, leash: &Leash) -> Result<Self, String> {
        let passthrough = passthrough(program, Task::File)?;
        let mut input = OsString::from("file:");
        input.push(path);
        let (times, writer) = pipe().map_err(|error| format!("a pipe to ffmpeg cannot be made ({error})"))?;
        let mut command = Command::new(program);
        command
            .args(["-hide_banner", "-nostdin", "-nostats", "-loglevel", "level+warning"])
            .args(["-protocol_whitelist", "file", "-format_whitelist", KINDS, "-max_pixels", &most_pixels(), "-i"])
            .arg(&input)
            .args(["-map", "0:v:0", "-an", "-sn", "-dn", "-map_metadata", "-1", "-vf", FORMATS])
            .args(passthrough)
            // One frame goes to both outputs before the next one is made: none waits for the other.
            .args(["-c:v", "wrapped_avframe", "-strict", "-1", "-f", "tee"])
            .arg(r"[f=framecrc:flush_packets=1]pipe\:0|[f=yuv4mpegpipe:strict=-1]pipe\:1")
            .stdin(Stdio::from(writer))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|error| missing(program, Task::File, &error))?;
        // The command holds the writer too: while it does, the times would never end.
        drop(command);
        let output = child.stdout.take();
        let errors = child.stderr.take().expect("it was asked for a pipe");
        leash.hold(child);
        let said = Arc::new(Mutex::new(Said::default()));
        hear(errors, said.clone())?;
        let times = read_times(times, said.clone())?;
        let facts = Facts::ask(program, &input);
        let (leash, pixels, origin) = (leash.clone(), None, None);
        let mut ffmpeg = Self { leash, output, pixels, times, said, facts, origin, frames: 0 };
        for _ in 0..skip {
            match ffmpeg.picture() {
                Some(Ok(_)) => (),
                Some(Err(DecodeError::Unsupported(problem) | DecodeError::Damaged(problem))) => return Err(problem),
                None => return Err(format!("ffmpeg found only {} of the {skip} frames read so far", ffmpeg.frames)),
            }
        }
        Ok(ffmpeg)
    }

    /// Frames a second; known after the first frame.
    pub fn rate(&self) -> f64 {
        let stated = self.pixels.as_ref().and_then(|pixels| pixels.head.rate);
        self.facts.rate.or(stated).unwrap_or(30.0)
    }

    /// An estimate of the number of frames.
    pub fn frames(&self) -> Option<usize> {
        self.facts.frames
    }

    /// The next frame and its time in seconds from the first.
    pub fn picture(&mut self) -> Option<Decoded<Picture>> {
        if let Some(output) = self.output.take() {
            // Where nothing comes, the reason is told below.
            self.pixels = Y4m::new(BufReader::new(output), &[]).ok();
        }
        match self.pixels.as_mut().and_then(Y4m::picture) {
            Some(Ok(yuv)) => {
                let full = self.pixels.as_ref().and_then(|p| p.head.full_range).unwrap_or(self.facts.full_range);
                let image = yuv.to_rgb(Colour::new(self.facts.matrix, full, yuv.width, yuv.height));
                let time = self.times.recv().ok();
                let time = time.unwrap_or(self.origin.unwrap_or(0.0) + self.frames as f64 / self.rate());
                self.frames += 1;
                Some(Ok((image, time - *self.origin.get_or_insert(time))))
            }
            _ => self.end(),
        }
    }

    /// Why there is no frame any more; `None` where the video is at its end.
    fn end(&mut self) -> Option<Decoded<Picture>> {
        let ended = self.leash.wait();
        // What it said last may still be on its way; the channel of times ends when the program has.
        while self.times.recv().is_ok() {}
        std::thread::sleep(std::time::Duration::from_millis(20));
        let said = std::mem::take(&mut *self.said.lock().unwrap_or_else(PoisonError::into_inner));
        if self.frames > 0 && ended.is_some_and(|status| status.success()) {
            let corrupt = said.corrupt.filter(|(at, _)| at + NEAR >= self.frames).map(|(_, text)| text);
            let end = said.cut.or(corrupt)?;
            return Some(Err(DecodeError::damaged(format!("the video breaks off: ffmpeg says \"{end}\""))));
        }
        let text = said.complaint.unwrap_or_else(|| "it gave no reason".into());
        Some(Err(match self.frames {
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

/// Listens to what it says.
fn hear(errors: impl Read + Send + 'static, said: Arc<Mutex<Said>>) -> Result<(), String> {
    listen(errors, move |line| said.lock().unwrap_or_else(PoisonError::into_inner).hear(&line)).map(drop)
}

impl Said {
    fn hear(&mut self, line: &str) {
        let after = |level: &str| line.split_once(level).map(|(_, text)| text.trim().to_owned());
        let error = after("[error] ").or_else(|| after("[fatal] "));
        let Some(text) = error.clone().or_else(|| after("[warning] ")) else { return };
        if CUT.iter().any(|words| text.contains(words)) {
            self.cut.get_or_insert(text);
        } else if CORRUPT.iter().any(|words| text.contains(words)) {
            self.corrupt = Some((self.frames, text));
        } else if let Some(error) = error {
            self.complaint.get_or_insert(error);
        }
    }
}

/// The times of the frames in seconds, as they come: lines of numbers under a head that states the unit.
fn read_times(lines: impl Read + Send + 'static, said: Arc<Mutex<Said>>) -> Result<Receiver<f64>, String> {
    let (send, times) = sync_channel(1 << 10);
    let read = move || {
        let mut unit = None;
        for line in BufReader::new(lines).lines().map_while(Result::ok) {
            if let Some(stated) = line.strip_prefix("#tb 0: ") {
                unit = ratio(stated.trim());
            }
            if line.starts_with('#') {
                continue;
            }
            let stamp = line.split(',').nth(2).and_then(|stamp| stamp.trim().parse::<i64>().ok());
            let Some(time) = stamp.zip(unit).map(|(stamp, unit)| stamp as f64 * unit) else { break };
            said.lock().unwrap_or_else(PoisonError::into_inner).frames += 1;
            if send.send(time).is_err() {
                break;
            }
        }
    };
    thread::start("reading times from ffmpeg", read).map_err(|error| error.to_string())?;
    Ok(times)
}

impl Facts {
    /// Asks the ffprobe that lies beside the ffmpeg; nothing is known where it is not there.
    fn ask(program: &Path, input: &OsString) -> Self {
        let fields =
            "stream=pix_fmt,color_space,color_range,r_frame_rate,avg_frame_rate,duration,nb_frames:format=duration";
        let told = Command::new(probe(program))
            .args(["-v", "quiet", "-protocol_whitelist", "file", "-format_whitelist", KINDS])
            .args(["-select_streams", "v:0", "-show_entries", fields, "-of", "default=noprint_wrappers=1"])
            .arg(input)
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .output();
        told.map_or(Self::default(), |told| Self::read(&String::from_utf8_lossy(&told.stdout)))
    }

    fn read(text: &str) -> Self {
        let all = |name: &str| {
            let name = format!("{name}=");
            text.lines().filter_map(|line| line.strip_prefix(&name).map(str::to_owned)).collect::<Vec<_>>()
        };
        let number =
            |name| all(name).iter().find_map(|text| text.parse::<f64>().ok().filter(|n| *n > 0.0 && n.is_finite()));
        let rate = |name| all(name).iter().find_map(|text| ratio(text).filter(|rate| *rate > 0.0));
        let rate = rate("avg_frame_rate").or_else(|| rate("r_frame_rate"));
        let frames = number("nb_frames").or_else(|| Some(number("duration")? * rate?)).filter(|n| *n < 1e12);
        let format = all("pix_fmt").concat();
        let of_luma = ["yuv", "nv", "gray", "y"].iter().any(|name| format.starts_with(name));
        let matrix = match all("color_space").concat().as_str() {
            "bt709" => Some(1),
            "bt470bg" | "smpte170m" | "fcc" => Some(6),
            "smpte240m" => Some(7),
            "bt2020nc" | "bt2020c" => Some(9),
            // Red, green and blue, which ffmpeg turns into yuv by its own guess.
            _ if !of_luma && !format.is_empty() => Some(6),
            _ => None,
        };
        let full_range = of_luma && all("color_range").concat() == "pc";
        Self { rate, frames: frames.map(|n| n.round() as usize), matrix, full_range }
    }
}

/// `25/2`.
fn ratio(text: &str) -> Option<f64> {
    let (over, under) = text.split_once('/')?;
    let ratio = over.parse::<f64>().ok()? / under.parse::<f64>().ok()?;
    ratio.is_finite().then_some(ratio)
}

/// Beside `a/ffmpeg`, `a/ffprobe`.
fn probe(program: &Path) -> PathBuf {
    let name = program.file_name().unwrap_or_default().to_string_lossy().replace("ffmpeg", "ffprobe");
    program.with_file_name(name)
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

/// Why ffmpeg does not start, and what to do.
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
