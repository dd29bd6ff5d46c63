//! The terminal: results on standard output, progress on standard error, and Ctrl-C as a request to stop in good order.

use std::io::{ErrorKind, Write};
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressStyle};

/// A line on standard output, as `println!` writes it. Where the reader has gone (`foveate eval | head`) the work goes on without it.
macro_rules! say {
    ($($words:tt)*) => { $crate::terminal::put(format_args!("{}\n", format_args!($($words)*))) };
}

/// Writes to standard output.
pub fn put(text: std::fmt::Arguments<'_>) {
    match std::io::stdout().write_fmt(text) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            eprintln!("foveate: cannot write to standard output: {e}");
            std::process::exit(1);
        }
        _ => (),
    }
}

static STOP: AtomicBool = AtomicBool::new(false);

/// From now on Ctrl-C (or a polite kill) asks to stop; a second one ends the program at once.
pub fn catch_interrupts() {
    // A second handler cannot be set; then the first one already does this.
    let _ = ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
        eprintln!("\nfoveate: stopping in good order; press Ctrl-C again to end at once");
    });
}

/// Whether it was asked to stop.
pub fn stopping() -> bool {
    STOP.load(Ordering::SeqCst)
}

/// A progress bar, or a count where the length is unknown; nothing where standard error is not a terminal.
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
