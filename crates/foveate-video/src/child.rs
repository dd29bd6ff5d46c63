//! A program that runs beside this one, and never longer.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use foveate_base::thread;

/// A handle that ends a blocking source. Its next frame is then an error or the end.
pub type Interrupt = Arc<dyn Fn() + Send + Sync>;

/// The child of a source, which others may end.
#[derive(Clone, Debug, Default)]
pub(crate) struct Leash(Arc<Mutex<Held>>);

#[derive(Debug, Default)]
struct Held {
    child: Option<Child>,
    line: Option<Line>,
    /// No further child is needed.
    over: bool,
}

impl Leash {
    fn held(&self) -> MutexGuard<'_, Held> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Holds a child, which ends with the next one.
    pub(crate) fn hold(&self, child: Child) {
        self.put(child, None);
    }

    /// Holds a [`guarded`] child and the line to it.
    pub(crate) fn hold_with(&self, child: Child, line: Line) {
        self.put(child, Some(line));
    }

    fn put(&self, child: Child, line: Option<Line>) {
        self.end();
        let mut held = self.held();
        (held.child, held.line) = (Some(child), line);
        if held.over {
            drop(held);
            self.end();
        }
    }

    /// Ends the child.
    pub(crate) fn end(&self) {
        let mut held = self.held();
        if let Some(mut child) = held.child.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
        if let Some(line) = held.line.take() {
            line.hang_up();
        }
    }

    /// Ends the child, and every later one.
    pub(crate) fn end_for_good(&self) {
        self.held().over = true;
        self.end();
    }

    /// Whether no further child is needed.
    pub(crate) fn is_over(&self) -> bool {
        self.held().over
    }

    /// A handle for other threads that ends it permanently.
    pub(crate) fn interrupt(&self) -> Interrupt {
        let leash = self.clone();
        Arc::new(move || leash.end_for_good())
    }

    /// Ends the child unless the returned guard is dropped within `patience`.
    pub(crate) fn end_after(&self, patience: Duration) -> Sender<()> {
        let (in_time, waits) = channel();
        let leash = self.clone();
        let work = move || {
            if waits.recv_timeout(patience) == Err(RecvTimeoutError::Timeout) {
                leash.end();
            }
        };
        // Without a thread it is waited for as long as it takes.
        let _ = thread::start("watching a program", work);
        in_time
    }

    /// Waits until the child exits. `None` if another thread ended it.
    pub(crate) fn wait(&self) -> Option<ExitStatus> {
        loop {
            let ended = self.held().child.as_mut().map(Child::try_wait)?;
            match ended {
                Ok(Some(status)) => return Some(status),
                Ok(None) => std::thread::sleep(Duration::from_millis(2)),
                Err(_) => return None,
            }
        }
    }
}

/// Our end of a pipe to a program: bytes that the program writes to its standard input arrive here.
#[derive(Debug)]
pub(crate) struct Line(#[cfg(unix)] std::os::unix::net::UnixStream, #[cfg(not(unix))] std::io::PipeReader);

impl Line {
    pub(crate) fn reader(&self) -> std::io::Result<impl Read + Send + 'static> {
        self.0.try_clone()
    }

    /// Ends the line: a guarded program ends with it.
    fn hang_up(&self) {
        #[cfg(unix)]
        let _ = self.0.shutdown(std::net::Shutdown::Both);
    }
}

/// A command that runs `program`, and the line to it. A shell between the two ends the program when our end of the line closes, however
/// this process ends.
#[cfg(unix)]
pub(crate) fn guarded(program: &Path) -> std::io::Result<(Command, Line)> {
    const SCRIPT: &str = r#"exec 3<&0
"$0" "$@" <&3 3<&- &
child=$!
{ read -r _ <&3; kill -9 $child; } >/dev/null 2>&1 &
guard=$!
wait $child
status=$?
kill $guard 2>/dev/null
exit $status"#;
    let (ours, theirs) = std::os::unix::net::UnixStream::pair()?;
    let mut command = Command::new("/bin/sh");
    command.args(["-c", SCRIPT]).arg(program).stdin(Stdio::from(std::os::fd::OwnedFd::from(theirs)));
    Ok((command, Line(ours)))
}

/// A command that runs `program`, and the line to it.
#[cfg(not(unix))]
pub(crate) fn guarded(program: &Path) -> std::io::Result<(Command, Line)> {
    let (ours, theirs) = std::io::pipe()?;
    let mut command = Command::new(program);
    command.stdin(Stdio::from(theirs));
    Ok((command, Line(ours)))
}

/// The lines of a child's standard error. A line is cut after 2000 bytes, and control characters are escaped, because
/// its content may come from a video.
pub(crate) fn listen(
    errors: impl Read + Send + 'static,
    mut on_line: impl FnMut(String) + Send + 'static,
) -> Result<JoinHandle<()>, String> {
    let work = move || {
        for line in BufReader::new(errors).split(b'\n').map_while(Result::ok) {
            let line = String::from_utf8_lossy(&line[..line.len().min(2000)]).into_owned();
            on_line(line.trim_end_matches('\r').chars().flat_map(shown).collect());
        }
    };
    thread::start("listening to ffmpeg", work).map_err(|error| error.to_string())
}

fn shown(c: char) -> Vec<char> {
    if c.is_control() { c.escape_default().collect() } else { vec![c] }
}

/// A script of the shell in the place of ffmpeg; with `-help` it prints nothing.
#[cfg(all(test, unix))]
pub(crate) fn script(folder: &std::path::Path, text: &str) -> std::path::PathBuf {
    let path = folder.join("script");
    std::fs::write(&path, format!("#!/bin/sh\n[ \"$2\" = -h ] && exit 0\n{text}\n")).expect("a writable folder");
    let mode = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(&path, mode).expect("ours");
    // A process that another test starts at this moment may hold it open for a while: then it is busy.
    let busy = || std::process::Command::new(&path).args(["-hide_banner", "-h"]).status().is_err();
    (0..500).any(|_| {
        std::thread::sleep(Duration::from_millis(2));
        !busy()
    });
    path
}
