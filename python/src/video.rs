//! Pictures of a video file, a folder, a stream or a camera, as arrays.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foveate::video::{FrameSource, Live, LiveOptions, Meter, Pace, SourceInfo, is_live, newest};
use foveate::{Error, Result};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::errors::{OrRaise, input};
use crate::pictures::{Channels, interleaved};

/// The pictures of a video file, a folder of images, a stream or a camera, one after the other.
///
/// Each loop continues at the end of the previous one; after the last picture the next loop starts again. It can be used in a ``with``
/// statement, which closes it.
///
/// Parameters
/// ----------
/// source : path, address or camera index
///     H.264 in MP4, a folder of JPEG or PNG images, a numbered pattern of images (``"frames/%04d.png"``), one image; with ffmpeg
///     installed also other videos, streams (``"rtsp://..."``, ``"http://..."``), and cameras, by their number or
///     ``"/dev/video0"``. Streams and cameras yield their newest picture.
/// channels : str
///     ``"rgb"`` or ``"bgr"``: the channel order of colour pictures; grey pictures have shape (height, width).
/// start : int
///     The first picture, counted from 0.
/// every : int
///     Read only every n-th picture from there on.
///
/// Raises
/// ------
/// foveate.FileError
///     The source does not exist or cannot be read; while iterating, the source breaks off.
/// foveate.InputError
///     There is no picture ``start``; if the number of pictures is unknown, the first read raises it.
///
/// Examples
/// --------
/// >>> import foveate
/// >>> with foveate.Video("walk.mp4", every=2) as video:  # doctest: +SKIP
/// ...     for image in video:
/// ...         print(video.frame, video.time, image.shape)
#[pyclass(frozen, module = "foveate", name = "Video")]
pub struct PyVideo {
    path: PathBuf,
    channels: Channels,
    start: usize,
    every: usize,
    info: SourceInfo,
    reading: Mutex<Reading>,
    /// The exception that a signal raised while waiting for a stream.
    signal: Signal,
}

type Signal = Arc<Mutex<Option<PyErr>>>;

/// The reading position.
struct Reading {
    /// `None` if closed.
    source: Option<Box<dyn FrameSource>>,
    meter: Option<Meter>,
    /// The next picture of the source.
    at: usize,
    /// The next requested picture.
    wanted: usize,
    /// Whether `start` or `seek` requested it; it must exist then.
    sought: bool,
    /// The last picture read, and its time.
    last: Option<(usize, f64)>,
    ended: bool,
}

impl Reading {
    fn open(path: &Path, wanted: usize, signal: Signal) -> Result<Self> {
        let (source, meter) = if is_live(path) {
            let stop = move || {
                let raised = Python::attach(|py| py.check_signals()).err();
                let stop = raised.is_some();
                if let Some(error) = raised {
                    *held(&signal) = Some(error);
                }
                stop
            };
            let (source, meter) = newest(Box::new(Live::open(path, LiveOptions::default())?), Pace::default(), stop);
            (source, Some(meter))
        } else {
            (foveate::video::open(path)?, None)
        };
        Ok(Self { source: Some(source), meter, at: 0, wanted, sought: true, last: None, ended: false })
    }
}

fn held<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns whether the source can be read a second time.
fn repeats(path: &Path) -> bool {
    !is_live(path) && std::fs::metadata(path).map_or(path != Path::new("-"), |about| about.is_file() || about.is_dir())
}

#[pymethods]
impl PyVideo {
    #[new]
    #[pyo3(signature = (source, *, channels = "rgb", start = 0, every = 1))]
    fn new(py: Python<'_>, source: &Bound<'_, PyAny>, channels: &str, start: usize, every: usize) -> PyResult<Self> {
        let channels = Channels::named(py, channels)?.of_three(py)?;
        if every == 0 {
            return Err(input(py, "every is 1 or more; it is 0"));
        }
        let path = match source.extract::<u32>() {
            Ok(camera) => format!("/dev/video{camera}").into(),
            Err(_) => source.extract::<PathBuf>().map_err(|_| {
                let kind = source.get_type().name().map_or_else(|_| "something else".into(), |name| name.to_string());
                PyTypeError::new_err(format!("a video is a path, an address or the number of a camera; it is a {kind}"))
            })?,
        };
        let signal = Signal::default();
        let reading = py.detach(|| Reading::open(&path, start, signal.clone())).or_raise(py)?;
        let info = reading.source.as_ref().map(|source| source.info().clone()).expect("it was just opened");
        let this = Self { path, channels, start, every, info, reading: Mutex::new(reading), signal };
        this.check(py, start)?;
        py.import("foveate._result")?.call_method1("log_video", (this.__repr__(),))?;
        Ok(this)
    }
    fn __iter__(slf: PyRef<'_, Self>) -> PyResult<PyRef<'_, Self>> {
        let (py, this) = (slf.py(), &*slf);
        if py.detach(|| held(&this.reading).ended) {
            if !repeats(&this.path) {
                let shown = foveate::video::without_password(&this.path.to_string_lossy()).into_owned();
                return Err(input(py, format!("{shown} has ended, and cannot be read again; open it anew")));
            }
            this.seek(py, this.start)?;
        }
        Ok(slf)
    }
    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let order = self.channels.order();
        let next = py.detach(|| {
            let mut reading = held(&self.reading);
            let Reading { source: Some(source), at, wanted, sought, last, ended, .. } = &mut *reading else {
                return Err(Error::Invalid("the video is closed; open it anew".into()));
            };
            if *ended {
                return Ok(None);
            }
            let frame = source.pass_over(wanted.saturating_sub(*at)).and_then(|()| source.next().transpose());
            *ended = !matches!(frame, Ok(Some(_)));
            match frame? {
                Some(frame) => {
                    *at = frame.index + 1;
                    *wanted = frame.index.saturating_add(self.every);
                    *sought = false;
                    *last = Some((frame.index, frame.time));
                    Ok(Some(interleaved(&frame.image, order)))
                }
                None if *sought => Err(Error::Invalid(format!(
                    "there is no picture {wanted}, counted from 0: the video ends before it"
                ))),
                None => Ok(None),
            }
        });
        if let Some(error) = held(&self.signal).take() {
            return Err(error);
        }
        Ok(next.or_raise(py)?.map(|pixels| pixels.into_array(py)))
    }
    /// The number of pictures that a loop from the start reads.
    ///
    /// Raises
    /// ------
    /// TypeError
    ///     The number is unknown before the end: for streams, and for sources read with ffmpeg, for which ``frames`` has an estimate.
    fn __len__(&self) -> PyResult<usize> {
        let frames = self.info.exact_frames().ok_or_else(|| {
            PyTypeError::new_err(
                "how many pictures there are is known at the end; `frames` has an estimate, where there is one",
            )
        })?;
        Ok(frames.saturating_sub(self.start).div_ceil(self.every))
    }
    fn __length_hint__(&self) -> usize {
        self.info.frames.unwrap_or(0).saturating_sub(self.start).div_ceil(self.every)
    }
    fn __bool__(&self) -> bool {
        true
    }
    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }
    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, pyo3::types::PyTuple>) {
        self.close(py);
    }
    /// Stops reading, and ends the decoding program if there is one. A closed video cannot be read.
    fn close(&self, py: Python<'_>) {
        py.detach(|| held(&self.reading).source = None);
    }
    /// Moves to a picture, counted from 0, which is read next. Immediate in folders; videos are decoded from the current place, or from
    /// the beginning if the current place is later.
    ///
    /// Raises
    /// ------
    /// foveate.InputError
    ///     There is no such picture, or it is an earlier one of a stream, which cannot be read again. If the number of pictures is
    ///     unknown, the next read raises it.
    fn seek(&self, py: Python<'_>, frame: usize) -> PyResult<()> {
        self.check(py, frame)?;
        let back = py.detach(|| {
            let mut reading = held(&self.reading);
            let back = reading.at > frame || reading.ended;
            if reading.source.is_some() && !back {
                (reading.wanted, reading.sought) = (frame, true);
            }
            reading.source.is_some() && back
        });
        if !back {
            return Ok(());
        }
        if !repeats(&self.path) {
            return Err(input(py, format!("picture {frame} is behind, and this source cannot be read again")));
        }
        py.detach(|| {
            *held(&self.reading) = Reading::open(&self.path, frame, self.signal.clone())?;
            Ok(())
        })
        .or_raise(py)
    }
    /// Width and height of a picture, pixels.
    #[getter]
    fn size(&self) -> (usize, usize) {
        self.info.size().into()
    }
    /// Number of pictures in the source, if known; an estimate for sources read with ffmpeg.
    #[getter]
    fn frames(&self) -> Option<usize> {
        self.info.frames
    }
    /// Pictures per second.
    #[getter]
    fn rate(&self) -> f64 {
        self.info.rate
    }
    /// The index of the last picture read in the source, counted from 0; ``None`` before the first one.
    #[getter]
    fn frame(&self, py: Python<'_>) -> Option<usize> {
        py.detach(|| held(&self.reading).last).map(|(frame, _)| frame)
    }
    /// The time of the last picture read, seconds from the first picture of the source; ``None`` before the first one. Pictures of a folder
    /// are 1/30 s apart; streams and cameras use the clock.
    #[getter]
    fn time(&self, py: Python<'_>) -> Option<f64> {
        py.detach(|| held(&self.reading).last).map(|(_, time)| time)
    }
    /// Number of pictures of a stream or camera that were dropped because the previous one was still being processed; 0 for files.
    #[getter]
    fn dropped(&self, py: Python<'_>) -> u64 {
        py.detach(|| held(&self.reading).meter.as_ref().map_or(0, Meter::dropped))
    }
    fn __repr__(&self) -> String {
        let SourceInfo { width, height, rate, reader, .. } = &self.info;
        format!("<foveate.Video {width} x {height}, {rate:.2} a second, {reader}>")
    }
}

impl PyVideo {
    /// Refuses a picture that is known not to exist.
    fn check(&self, py: Python<'_>, frame: usize) -> PyResult<()> {
        match self.info.exact_frames() {
            Some(frames) if frame >= frames => {
                Err(input(py, format!("there is no picture {frame}: the video has {frames}, counted from 0")))
            }
            _ => Ok(()),
        }
    }
}
