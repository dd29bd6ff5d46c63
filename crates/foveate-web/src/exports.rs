//! The functions called by the page. Bytes pass through two buffers: the page writes to [`input`] and reads from [`output`]. Only the
//! names, which the linker must not change, are unsafe here.
#![allow(unreachable_pub)] // The page reaches these functions by the linker's names.

use std::io::{Error, ErrorKind, Result};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foveate_core::geometry::Size;
use foveate_video::Planes;

use crate::{App, Package, Store};

#[link(wasm_import_module = "page")]
unsafe extern "C" {
    /// Reads `length` bytes of a file at a position into memory; returns the number of bytes, or −1.
    safe fn read_file(file: u32, at: f64, to: *mut u8, length: usize) -> i32;
}

struct Files;

impl Store for Files {
    fn read(&self, file: u32, at: u64, to: &mut [u8]) -> Result<usize> {
        let read = read_file(file, at as f64, to.as_mut_ptr(), to.len());
        usize::try_from(read)
            .map_err(|_| Error::new(ErrorKind::Other, "the browser cannot read the file; choose it again"))
    }
}

#[derive(Default)]
struct Binding {
    app: Option<App>,
    package: Option<Package>,
    input: Vec<u8>,
    output: Vec<u8>,
}

/// A page, or a tracker of the package, has a memory of its own.
static BINDING: Mutex<Binding> = Mutex::new(Binding { app: None, package: None, input: vec![], output: vec![] });

fn binding() -> MutexGuard<'static, Binding> {
    BINDING.lock().unwrap_or_else(PoisonError::into_inner)
}

fn answer(work: impl FnOnce(&mut App, &[u8]) -> Option<Vec<u8>>) -> i32 {
    let mut binding = binding();
    let Binding { app, input, output, .. } = &mut *binding;
    let app = app.get_or_insert_with(|| App::new(Arc::new(Files)));
    match work(app, input) {
        Some(bytes) => {
            *output = bytes;
            output.len() as i32
        }
        None => -1,
    }
}

/// Returns the address of an input buffer with this length.
#[unsafe(no_mangle)]
pub extern "C" fn input(length: usize) -> *mut u8 {
    let mut binding = binding();
    binding.input.clear();
    binding.input.resize(length, 0);
    binding.input.as_mut_ptr()
}

/// Returns the address of the last answer.
#[unsafe(no_mangle)]
pub extern "C" fn output() -> *const u8 {
    binding().output.as_ptr()
}

/// Answers the message in the input; returns the number of output bytes.
#[unsafe(no_mangle)]
pub extern "C" fn ask() -> i32 {
    answer(|app, input| Some(app.ask(&String::from_utf8_lossy(input)).into_bytes()))
}

/// Answers a call of the JavaScript package: `message` bytes of the input, and the bytes of a picture or a state after them. Returns the
/// number of output bytes.
#[unsafe(no_mangle)]
pub extern "C" fn call(message: usize) -> i32 {
    let mut binding = binding();
    let Binding { package, input, output, .. } = &mut *binding;
    let (message, bytes) = input.split_at(message.min(input.len()));
    *output = package.get_or_insert_default().ask(&String::from_utf8_lossy(message), bytes).into_bytes();
    output.len() as i32
}

/// Writes the pixels of a frame (from 1) as red, green, blue, alpha; returns −1 if there are none.
#[unsafe(no_mangle)]
pub extern "C" fn picture(session: f64, frame: usize) -> i32 {
    answer(|app, _| app.picture(session as u64, frame))
}

/// Adds the pixels in the input as the next frame; returns its number from 1, or −1.
#[unsafe(no_mangle)]
pub extern "C" fn push(session: f64, time: f64, missed: f64) -> i32 {
    let mut number = -1;
    answer(|app, input| {
        number = app.push(session as u64, input, time, missed as u64).map_or(-1, |frame| frame as i32);
        None
    });
    number
}

/// Adds the planes in the input as a frame (from 1) that the browser decoded: I420 or NV12. Returns 1, or 0 if they do not fit.
#[unsafe(no_mangle)]
pub extern "C" fn decoded(session: f64, frame: usize, width: usize, height: usize, nv12: i32) -> i32 {
    let (mut fits, planes) = (false, if nv12 == 0 { Planes::I420 } else { Planes::Nv12 });
    answer(|app, input| {
        fits = app.decoded(session as u64, frame, Size { width, height }, planes, input);
        None
    });
    i32::from(fits)
}

/// Writes a piece, from 0, of a saved file named in the input; returns −1 after the last one.
#[unsafe(no_mangle)]
pub extern "C" fn file(session: f64, piece: usize) -> i32 {
    answer(|app, input| app.file(session as u64, &String::from_utf8_lossy(input), piece))
}
