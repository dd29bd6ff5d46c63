//! Decoders at arm's length: a child process of the program decodes, without access to files, network, programs and threads (Linux).
//!
//! The parent opens the file and gives it to the child as standard input. The child limits its own memory and time, gives up all system
//! calls but a few, and only then reads. Its messages are pictures, which the parent checks.

use std::fs::File;
use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, ChildStdout, Command, Stdio};

use crate::child::{Interrupt, Leash};
use crate::options::Sandbox;
use crate::{Frame, FrameSource, Remarks, SourceInfo};
use foveate_base::{Error, Result, memory};
use foveate_core::scene::Image;
use job::Job;
use message::Message;

mod job;
mod limits;
mod message;
mod worker;

pub use worker::decode_if_asked;

/// A child, and the pipes to it.
pub(crate) struct Apart {
    leash: Leash,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

foveate_base::opaque_debug!(Apart);

impl Apart {
    fn start(sandbox: &Sandbox, input: Stdio, job: &Job) -> std::result::Result<Self, String> {
        if !limits::SUPPORTED {
            return Err(unavailable("it needs Linux on x86-64, AArch64 or RISC-V"));
        }
        let [program, arguments @ ..] = &sandbox.0[..] else { return Err("the sandbox needs a program".into()) };
        let mut command = Command::new(program);
        command.args(arguments).args(job.arguments()).stdin(input).stdout(Stdio::piped()).stderr(Stdio::null());
        let cannot = |error| format!("cannot start the decoder's process {}: {error}", program.display());
        let mut child = command.spawn().map_err(cannot)?;
        let (input, output) = (child.stdin.take(), child.stdout.take().expect("it was piped"));
        let leash = Leash::default();
        leash.hold(child);
        Ok(Self { leash, input, output: BufReader::with_capacity(1 << 16, output) })
    }

    /// A child that decodes pictures: at most `count`.
    pub(crate) fn pictures(sandbox: &Sandbox, count: usize) -> std::result::Result<Self, String> {
        let seconds = (count as u64).saturating_mul(10).saturating_add(60);
        Self::start(sandbox, Stdio::piped(), &Job { video: None, memory: memory::limit(), seconds })
    }

    /// Decodes the bytes of a PNG or JPEG file, as [`crate::decode_image`] does.
    pub(crate) fn picture(&mut self, bytes: &[u8]) -> std::result::Result<Image, String> {
        let input = self.input.as_mut().expect("a child for pictures");
        let sent = input.write_all(&(bytes.len() as u64).to_le_bytes()).and_then(|()| input.write_all(bytes));
        // A child that ended may have left the reason.
        let answer = Message::read(&mut self.output).or_else(|error| sent.and(Err(error)));
        match answer {
            Ok(Message::Frame(_, image)) => Ok(image),
            Ok(Message::Error(problem)) => Err(problem),
            Ok(Message::Refused(problem)) => Err(unavailable(&problem)),
            Ok(_) => Err(self.broken("it sent another message than a picture")),
            Err(error) => Err(self.broken(&error.to_string())),
        }
    }

    pub(crate) fn interrupt(&self) -> Interrupt {
        self.leash.interrupt()
    }

    /// The reason for a missing message.
    fn broken(&self, problem: &str) -> String {
        let _end = self.leash.end_after(std::time::Duration::from_secs(1));
        let status = self.leash.wait().map_or_else(|| "killed".into(), |status| status.to_string());
        format!(
            "the decoder in the sandbox failed ({problem}; {status}); the file is damaged or hostile, or needs more memory or time than \
             the sandbox grants: see --max-memory"
        )
    }
}

fn unavailable(problem: &str) -> String {
    format!("there is no sandbox here: {problem}; nothing was read; leave out --sandbox, or use a container")
}

impl Drop for Apart {
    fn drop(&mut self) {
        self.leash.end();
    }
}

/// Decodes a picture in a child of its own.
///
/// # Errors
/// As [`crate::decode_image`], and if the child cannot be started or ends early.
pub fn decode_image_in(sandbox: &Sandbox, bytes: &[u8]) -> std::result::Result<Image, String> {
    Apart::pictures(sandbox, 1)?.picture(bytes)
}

/// A video file that a child decodes.
pub(crate) struct Video {
    path: PathBuf,
    info: SourceInfo,
    remarks: Remarks,
    /// `None` after the end.
    child: Option<Apart>,
    leash: Leash,
    next: usize,
    time: f64,
}

impl Video {
    /// # Errors
    /// As [`crate::VideoFile::open`] with the built-in decoder, or the child cannot be started or cannot limit itself.
    pub(crate) fn open(path: &Path, sandbox: &Sandbox) -> Result<Self> {
        let file = File::open(path).map_err(Error::io(path, "cannot open"))?;
        let bytes = file.metadata().map_err(Error::io(path, "cannot open"))?.len();
        // A second decodes at least 10 kB of the slowest kind of video.
        let job = Job { video: Some(path.to_owned()), memory: memory::limit(), seconds: 60 + bytes / 10_000 };
        let mut child = Apart::start(sandbox, file.into(), &job).map_err(|problem| Error::malformed(path, problem))?;
        let info = match Message::read(&mut child.output) {
            Ok(Message::Info(info)) => info,
            // It names the file.
            Ok(Message::Error(problem)) => return Err(Error::Invalid(problem)),
            Ok(Message::Refused(problem)) => return Err(Error::malformed(path, unavailable(&problem))),
            Ok(_) => return Err(Error::malformed(path, child.broken("it sent another message than the size"))),
            Err(error) => return Err(Error::malformed(path, child.broken(&error.to_string()))),
        };
        let (path, leash) = (path.to_owned(), child.leash.clone());
        Ok(Self { path, info, remarks: Remarks::default(), child: Some(child), leash, next: 0, time: 0.0 })
    }

    fn frame(&mut self) -> Option<Result<Frame>> {
        let wrong = |problem: String| Error::Frame { path: self.path.clone(), frame: self.next + 1, problem };
        let child = self.child.as_mut()?;
        loop {
            let problem = match Message::read(&mut child.output) {
                Ok(Message::Frame(time, image)) if time >= self.time && image.size() == self.info.size() => {
                    let index = self.next;
                    (self.next, self.time) = (index + 1, time);
                    return Some(Ok(Frame { index, time, image }));
                }
                Ok(Message::Sides([stored, shown])) => {
                    self.remarks.set_sides(stored, shown);
                    continue;
                }
                Ok(Message::Damage(frame, report)) => {
                    self.remarks.add_damage(frame, &report);
                    continue;
                }
                Ok(Message::End) => return None,
                Ok(Message::Error(problem)) => return Some(Err(Error::Invalid(problem))),
                Ok(Message::Frame(..) | Message::Info(_) | Message::Refused(_)) => {
                    "it sent a picture of another size or time".to_owned()
                }
                Err(_) if self.leash.is_over() => return None,
                Err(error) => error.to_string(),
            };
            return Some(Err(wrong(child.broken(&problem))));
        }
    }
}

impl Iterator for Video {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let frame = self.frame();
        if !matches!(frame, Some(Ok(_))) {
            self.child = None;
        }
        frame
    }
}

impl FrameSource for Video {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
    fn interrupt(&self) -> Option<Interrupt> {
        Some(self.leash.interrupt())
    }
    fn remarks(&self) -> Remarks {
        self.remarks.clone()
    }
}
