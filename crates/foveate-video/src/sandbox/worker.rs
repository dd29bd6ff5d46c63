//! The child: decodes its standard input, and writes messages to its standard output.

use std::ffi::OsString;
use std::fs::File;
use std::io::{BufWriter, Read, Result, Write};
use std::path::PathBuf;

use super::job::Job;
use super::limits::enter;
use super::message::Message;
use crate::decode::decode_next;
use crate::{FrameSource, VideoFile};
use foveate_base::{Error, memory};

/// Runs the decoder if the arguments, without the program's own name, are those of a child. Returns the exit status, or `None` if the
/// arguments are others.
///
/// Call it before the first thread of the program starts.
pub fn decode_if_asked(arguments: &[OsString]) -> Option<u8> {
    let job = Job::of(arguments)?;
    Some(u8::from(work(&job).is_err()))
}

fn work(job: &Job) -> Result<()> {
    let [input, output] = pipes()?;
    let length = input.metadata()?.len();
    let mut output = BufWriter::with_capacity(1 << 16, output);
    memory::set_limit(job.memory);
    let done = match enter(job.memory, job.seconds) {
        Err(problem) => Message::Refused(problem).write(&mut output),
        Ok(()) => match &job.video {
            Some(name) => video(name.clone(), input, length, &mut output),
            None => pictures(input, &mut output),
        },
    };
    done.and_then(|()| output.flush())
}

/// Standard input and output, without the buffers of the standard library.
#[cfg(unix)]
fn pipes() -> Result<[File; 2]> {
    use std::os::fd::AsFd;
    let (input, output) = (std::io::stdin(), std::io::stdout());
    Ok([input.as_fd().try_clone_to_owned()?.into(), output.as_fd().try_clone_to_owned()?.into()])
}

#[cfg(not(unix))]
fn pipes() -> Result<[File; 2]> {
    Err(std::io::ErrorKind::Unsupported.into())
}

fn video(name: PathBuf, input: File, length: u64, output: &mut impl Write) -> Result<()> {
    let mut source = match VideoFile::from_reader(name, input, length) {
        Ok(source) => source,
        Err(error) => return Message::Error(error.to_string()).write(output),
    };
    let remarks = source.remarks();
    Message::Info(source.info().clone()).write(output)?;
    loop {
        let frame = source.next();
        let (sides, damage) = remarks.take();
        sides.map_or(Ok(()), |sides| Message::Sides(sides).write(output))?;
        for (frame, report) in damage {
            Message::Damage(frame, report).write(output)?;
        }
        match frame {
            Some(Ok(frame)) => Message::Frame(frame.time, frame.image).write(output)?,
            Some(Err(Error::Frame { problem, .. })) => return Message::Error(problem).write(output),
            Some(Err(error)) => return Message::Error(error.to_string()).write(output),
            None => return Message::End.write(output),
        }
        output.flush()?;
    }
}

/// One answer to each length and that many bytes.
fn pictures(mut input: File, output: &mut impl Write) -> Result<()> {
    let (mut length, mut bytes, mut range) = ([0; 8], vec![], None);
    while input.read_exact(&mut length).is_ok() {
        bytes.clear();
        Read::by_ref(&mut input).take(u64::from_le_bytes(length)).read_to_end(&mut bytes)?;
        match decode_next(&bytes, &mut range) {
            Ok(image) => Message::Frame(0.0, image).write(output)?,
            Err(problem) => Message::Error(problem).write(output)?,
        }
        output.flush()?;
    }
    Ok(())
}
