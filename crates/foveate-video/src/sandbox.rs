//! Decoders at arm's length: a child process of the program decodes, without access to files, network, programs and threads (Linux).
//!
//! The parent opens the file and gives it to the child as standard input. The child limits its own memory and time, gives up all system
//! calls but a few, and only then reads. Its messages are pictures, which the parent checks.

use std::fs::File;
use std::io::{BufReader, Write};
use std::path::Path;
use std::process::{ChildStdin, ChildStdout, Command, Stdio};

use crate::child::{Interrupt, Leash};
use crate::decoded::{DecodeError, Picture};
use crate::options::Sandbox;
use crate::{Remarks, SourceInfo};
use foveate_base::{Error, Result, memory};
use foveate_core::scene::Image;
use job::Job;
use message::Message;

mod job;
#[cfg(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "riscv64")))]
mod limits;
mod message;
mod worker;

/// Other systems have no limits that foveate uses.
#[cfg(not(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "riscv64"))))]
mod limits {
    pub(super) const SUPPORTED: bool = false;

    pub(super) fn enter(_: u64, _: u64) -> Result<(), String> {
        Err("it needs Linux on x86-64, AArch64 or RISC-V".into())
    }
}

pub use worker::decode_if_asked;

/// A child, and the pipes to it.
pub(crate) struct Apart {
    leash: Leash,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

foveate_base::opaque_debug!(Apart);

impl Apart {
    fn start(sandbox: &Sandbox, input: Stdio, job: &Job, leash: &Leash) -> std::result::Result<Self, String> {
        if !limits::SUPPORTED {
            return Err(unavailable("it needs Linux on x86-64, AArch64 or RISC-V"));
        }
        let [program, arguments @ ..] = &sandbox.0[..] else { return Err("the sandbox needs a program".into()) };
        let mut command = Command::new(program);
        command.args(arguments).args(job.arguments()).stdin(input).stdout(Stdio::piped()).stderr(Stdio::null());
        let cannot = |error| format!("cannot start the decoder's process {}: {error}", program.display());
        let mut child = command.spawn().map_err(cannot)?;
        let (input, output) = (child.stdin.take(), child.stdout.take().expect("it was piped"));
        leash.hold(child);
        Ok(Self { leash: leash.clone(), input, output: BufReader::with_capacity(1 << 16, output) })
    }

    /// A child that decodes pictures: at most `count`.
    pub(crate) fn pictures(sandbox: &Sandbox, count: usize) -> std::result::Result<Self, String> {
        let seconds = (count as u64).saturating_mul(10).saturating_add(60);
        Self::start(sandbox, Stdio::piped(), &Job { video: None, memory: memory::limit(), seconds }, &Leash::default())
    }

    /// Decodes the bytes of a picture's file, as [`crate::decode_image`] does.
    pub(crate) fn picture(&mut self, bytes: &[u8]) -> std::result::Result<Image, String> {
        let input = self.input.as_mut().expect("a child for pictures");
        // A child that has ended may have left the reason, which a broken pipe is not.
        let _ = input.write_all(&(bytes.len() as u64).to_le_bytes()).and_then(|()| input.write_all(bytes));
        match Message::read(&mut self.output) {
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

/// A child that decodes a video file.
pub(crate) struct ApartVideo {
    child: Apart,
    about: SourceInfo,
    remarks: Remarks,
    time: f64,
}

impl ApartVideo {
    /// Starts a child that decodes `file`, which has so many `bytes` and is called `path` in errors.
    ///
    /// # Errors
    /// As [`crate::VideoFile::open`] with the built-in decoder, or the child cannot be started or cannot limit itself.
    pub(crate) fn open(
        path: &Path,
        (file, bytes): (File, u64),
        sandbox: &Sandbox,
        (leash, remarks): (&Leash, &Remarks),
    ) -> Result<Self> {
        let wrong = |problem: String| Error::malformed(path, problem);
        // A second decodes at least 10 kB of the slowest kind of video.
        let job = Job { video: Some(path.to_owned()), memory: memory::limit(), seconds: 60 + bytes / 10_000 };
        let mut child = Apart::start(sandbox, file.into(), &job, leash).map_err(wrong)?;
        match Message::read(&mut child.output) {
            Ok(Message::Info(about)) => Ok(Self { child, about, remarks: remarks.clone(), time: 0.0 }),
            // It names the file.
            Ok(Message::Error(problem)) => Err(Error::Invalid(problem)),
            Ok(Message::Refused(problem)) => Err(wrong(unavailable(&problem))),
            Ok(_) => Err(wrong(child.broken("it sent another message than the size"))),
            Err(error) => Err(wrong(child.broken(&error.to_string()))),
        }
    }

    /// Returns what the child read about the video.
    pub(crate) fn about(&self) -> &SourceInfo {
        &self.about
    }

    /// Returns the next picture; `None` at the end.
    pub(crate) fn picture(&mut self) -> Option<std::result::Result<Picture, DecodeError>> {
        loop {
            let problem = match Message::read(&mut self.child.output) {
                Ok(Message::Frame(time, image)) if time >= self.time => {
                    self.time = time;
                    return Some(Ok((image, time)));
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
                Ok(Message::Error(problem)) => return Some(Err(DecodeError::Damaged(problem))),
                Ok(Message::Frame(..) | Message::Info(_) | Message::Refused(_)) => {
                    "it sent a picture of an earlier time, or no picture".to_owned()
                }
                Err(_) if self.child.leash.is_over() => return None,
                Err(error) => error.to_string(),
            };
            return Some(Err(DecodeError::Damaged(self.child.broken(&problem))));
        }
    }
}
