//! ffmpeg as a decoder of H.264: it is handed coded frames and gives raw ones, in the order of presentation.
//!
//! The file is read by us: ffmpeg opens nothing, and times, colours, cuts and turns are those of our own index.

use std::io::{BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use crate::child::{Leash, listen};
use crate::decoded::Decoded;
use crate::ffmpeg::{Pixels, Task, missing, most_pixels, passthrough};
use crate::y4m::Y4m;
use crate::yuv::Yuv;
use foveate_base::thread;

/// A running decoder. Dropped, it ends.
pub(super) struct Feed {
    leash: Leash,
    output: Option<std::process::ChildStdout>,
    pixels: Option<Pixels>,
    /// The first error that it logged, and the thread that reads them.
    complaint: Arc<Mutex<Option<String>>>,
    listener: Option<JoinHandle<()>>,
}

impl Feed {
    /// Starts `program` and a thread that writes the coded frames of `next` to it (as Annex B, with start codes).
    ///
    /// # Errors
    /// Cause and remedy if the program is missing or does not start.
    pub(crate) fn start(
        program: &Path,
        leash: &Leash,
        mut next: impl FnMut() -> Option<Vec<u8>> + Send + 'static,
    ) -> Result<Self, String> {
        let passthrough = passthrough(program, Task::Coded)?;
        let mut child = Command::new(program)
            .args(["-hide_banner", "-nostats", "-loglevel", "error", "-protocol_whitelist", "pipe"])
            // Unaligned: a picture is cut at the left where the stream says, not only where memory is aligned.
            // Strict: frames are held back until their order is certain. Damage ends it, and is left to our own decoders to name.
            .args(["-flags", "unaligned", "-strict", "1", "-err_detect", "explode", "-xerror"])
            .args(["-f", "h264", "-max_pixels", &most_pixels()])
            .args(["-i", "pipe:0"])
            .args(["-map", "0:v:0"])
            .args(passthrough)
            .args(["-c:v", "wrapped_avframe", "-strict", "-1", "-f", "yuv4mpegpipe", "pipe:1"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| missing(program, Task::Coded, &error))?;
        let mut input = child.stdin.take().expect("it was asked for a pipe");
        let output = child.stdout.take();
        let errors = child.stderr.take().expect("it was asked for a pipe");
        leash.hold(child);
        let complaint = Arc::<Mutex<Option<String>>>::default();
        let heard = complaint.clone();
        let listener = Some(listen(errors, move |line| {
            // After the name of the part of ffmpeg that logs it.
            let text = line.split_once("] ").map_or(&*line, |(_, text)| text).to_owned();
            heard.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(text);
        })?);
        let write = move || {
            // It ends with the last frame, or with the program.
            while let Some(frame) = next() {
                if input.write_all(&frame).is_err() {
                    break;
                }
            }
        };
        thread::start("feeding ffmpeg", write).map_err(|error| error.to_string())?;
        Ok(Self { leash: leash.clone(), output, pixels: None, complaint, listener })
    }

    /// The next picture; `None` at the end, an error if the program stops early.
    pub(crate) fn picture(&mut self) -> Option<Decoded<Yuv>> {
        if let Some(output) = self.output.take() {
            self.pixels = Y4m::new(BufReader::new(output), &[]).ok();
        }
        self.pixels.as_mut()?.picture()
    }

    /// Ends it. The first error that it logged, if any.
    pub(crate) fn complaint(&mut self) -> Option<String> {
        self.leash.end();
        self.listener.take().map(JoinHandle::join);
        self.complaint.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.leash.end();
    }
}
