//! The terminal: results on standard output, progress on standard error, and Ctrl-C as a request to stop cleanly.

use std::borrow::Cow;
use std::io::{ErrorKind, Write};
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressStyle};

/// Prints a line on standard output as `println!` does. If the reader has closed it (`foveate eval | head`), the work continues.
#[macro_export]
macro_rules! say {
    ($($words:tt)*) => { $crate::terminal::put(format_args!("{}\n", format_args!($($words)*))) };
}

/// Prints a line on standard error, if possible: `eprintln!` panics if it cannot write, for example on a full device.
#[macro_export]
macro_rules! note {
    ($($words:tt)*) => { $crate::terminal::note(format_args!("{}\n", format_args!($($words)*))) };
}

static OUTPUT_TAKEN: AtomicBool = AtomicBool::new(false);

/// Reserves standard output for the lines of `--stream` or for a [`document`]; messages then go to standard error.
pub fn give_output() {
    OUTPUT_TAKEN.store(true, Ordering::SeqCst);
}

/// Writes to standard output.
pub fn put(text: std::fmt::Arguments<'_>) {
    if OUTPUT_TAKEN.load(Ordering::SeqCst) {
        return note(text);
    }
    document(text);
}

/// Writes to standard output even if it is reserved.
pub fn document(text: std::fmt::Arguments<'_>) {
    match std::io::stdout().write_all(harmless(&text.to_string()).as_bytes()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            note(format_args!("foveate: cannot write to standard output: {e}\n"));
            std::process::exit(1);
        }
        _ => (),
    }
}

/// Writes to standard error, if possible.
pub fn note(text: std::fmt::Arguments<'_>) {
    let _ = std::io::stderr().write_all(harmless(&text.to_string()).as_bytes());
}

/// Replaces control characters in the text with visible ones: names of files and classes come from other people, and a terminal would
/// execute them.
fn harmless(text: &str) -> Cow<'_, str> {
    foveate::text::visible_except(text, &['\n', '\t'])
}

/// Makes writes beyond a file-size limit (`ulimit -f`) fail as on a full disk. By default, the signal SIGXFSZ ends the program.
#[cfg(unix)]
pub fn catch_file_limit() {
    // If the signal cannot be caught, it ends the program as usual.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
}

/// There is no such limit here.
#[cfg(not(unix))]
pub fn catch_file_limit() {}

/// The exit status after a stop request; 0 until then.
static STOP: AtomicI32 = AtomicI32::new(0);

/// Makes Ctrl-C, SIGTERM and SIGHUP request a stop; a second signal ends the program at once.
pub fn catch_interrupts() {
    static CAUGHT: AtomicBool = AtomicBool::new(false);
    if !CAUGHT.swap(true, Ordering::SeqCst) {
        catch();
    }
}

/// The flags to set on a stop request.
static TOLD: Mutex<Vec<Arc<AtomicBool>>> = Mutex::new(Vec::new());

/// Registers a flag that is set on a stop request.
pub fn tell_stop(flag: Arc<AtomicBool>) {
    TOLD.lock().unwrap_or_else(PoisonError::into_inner).push(flag);
}

/// Handles a stop request by this signal.
fn asked(signal: i32) {
    if STOP.swap(128 + signal, Ordering::SeqCst) != 0 {
        std::process::exit(128 + signal);
    }
    TOLD.lock().unwrap_or_else(PoisonError::into_inner).iter().for_each(|flag| flag.store(true, Ordering::SeqCst));
    note(format_args!("\nfoveate: stopping in good order; press Ctrl-C again to end at once\n"));
}

#[cfg(unix)]
fn catch() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    // If signals cannot be caught, they end the program as usual.
    let (caught, ready) = std::sync::mpsc::sync_channel(1);
    let wait = move || {
        let signals = signal_hook::iterator::Signals::new([SIGHUP, SIGINT, SIGTERM]);
        drop(caught);
        if let Ok(mut signals) = signals {
            signals.forever().for_each(asked);
        }
    };
    if foveate::thread::start("catching signals", wait).is_ok() {
        let _: Result<(), _> = ready.recv();
    }
}

#[cfg(not(unix))]
fn catch() {
    let _ = ctrlc::set_handler(|| asked(2));
}

/// Returns whether a stop was requested.
pub fn stopping() -> bool {
    STOP.load(Ordering::SeqCst) != 0
}

/// Returns the exit status of a stopped run: 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP.
pub fn stop_status() -> i32 {
    STOP.load(Ordering::SeqCst)
}

/// Creates a progress bar, or a counter if the length is unknown; hidden if standard error is not a terminal.
pub fn progress(length: Option<usize>, what: &str) -> ProgressBar {
    let bar = match length {
        Some(n) => {
            ProgressBar::new(n as u64).with_style(style("{prefix} {bar:32} {pos}/{len}  {per_sec}  {eta} left  {msg}"))
        }
        None => ProgressBar::no_length().with_style(style("{prefix} {spinner} {pos}  {per_sec}  {msg}")),
    };
    bar.with_prefix(what.to_owned())
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("the template is a constant")
}

#[cfg(test)]
mod tests {
    #[test]
    fn names_do_not_control_the_terminal() {
        assert_eq!(super::harmless("a\x1b[31mb\u{9b}c\td\n"), "a\\u{1b}[31mb\\u{9b}c\td\n");
        assert_eq!(super::harmless("über\n"), "über\n");
    }
}
