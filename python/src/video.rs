//! Pictures of a video file or a folder, as arrays.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use foveate::Image;
use foveate::video::{FrameSource, SourceInfo};
use numpy::IntoPyArray;
use numpy::ndarray::{Array2, Array3, ArrayView2, Axis};
use pyo3::prelude::*;

use crate::errors::OrRaise;
use crate::pictures::Channels;

/// The pictures of a video file or of a folder of images, one after the other.
///
/// Parameters
/// ----------
/// path : path
///     H.264 in MP4, a folder of JPEG or PNG images, one image; everything else where ffmpeg is installed.
/// channels : str
///     ``"rgb"`` or ``"bgr"``: the order that colour pictures come in; grey ones come as (height, width).
///
/// Raises
/// ------
/// foveate.FileError
///     Nothing is there, or it cannot be read; while iterating, where the source breaks.
///
/// Examples
/// --------
/// >>> import foveate
/// >>> for image in foveate.Video("walk.mp4"):  # doctest: +SKIP
/// ...     ok, box = tracker.update(image)
#[pyclass(frozen, module = "foveate", name = "Video")]
pub struct PyVideo {
    channels: Channels,
    info: SourceInfo,
    source: Mutex<Box<dyn FrameSource>>,
}

impl PyVideo {
    fn source(&self) -> MutexGuard<'_, Box<dyn FrameSource>> {
        self.source.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl PyVideo {
    #[new]
    #[pyo3(signature = (path, *, channels = "rgb"))]
    fn new(py: Python<'_>, path: PathBuf, channels: &str) -> PyResult<Self> {
        let channels = Channels::named(py, channels)?.of_three(py)?;
        let source = py.detach(|| foveate::video::open(&path)).or_raise(py)?;
        Ok(Self { channels, info: source.info().clone(), source: Mutex::new(source) })
    }
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }
    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let order = self.channels.order();
        let next = py.detach(|| {
            let frame = self.source().next()?;
            Some(frame.map(|frame| interleaved(&frame.image, order)))
        });
        Ok(match next.transpose().or_raise(py)? {
            None => None,
            Some(Pixels::Grey(pixels)) => Some(pixels.into_pyarray(py).into_any()),
            Some(Pixels::Colour(pixels)) => Some(pixels.into_pyarray(py).into_any()),
        })
    }
    /// Width and height of a picture, pixels.
    #[getter]
    fn size(&self) -> (usize, usize) {
        (self.info.width, self.info.height)
    }
    /// Number of pictures, where the source knows it; what ffmpeg reads has an estimate.
    #[getter]
    fn frames(&self) -> Option<usize> {
        self.info.frames
    }
    /// Pictures a second.
    #[getter]
    fn rate(&self) -> f64 {
        self.info.rate
    }
    fn __repr__(&self) -> String {
        let SourceInfo { width, height, rate, reader, .. } = &self.info;
        format!("<foveate.Video {width} x {height}, {rate:.2} a second, {reader}>")
    }
}

enum Pixels {
    Grey(Array2<u8>),
    Colour(Array3<u8>),
}

fn interleaved(image: &Image, order: &[usize]) -> Pixels {
    let size = (image.height(), image.width());
    let plane = |p: usize| ArrayView2::from_shape(size, image.plane(p)).expect("a plane is whole");
    if image.planes() == 1 {
        return Pixels::Grey(plane(0).to_owned());
    }
    let mut pixels = Array3::zeros((size.0, size.1, 3));
    for (p, &channel) in order.iter().enumerate() {
        pixels.index_axis_mut(Axis(2), channel).assign(&plane(p));
    }
    Pixels::Colour(pixels)
}
