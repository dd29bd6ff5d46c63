//! NumPy's pictures as foveate's: read in place, whatever their strides, into planes that are kept from frame to frame.

use foveate::scene::Pixels as Layout;
use foveate::{Image, memory};
use numpy::ndarray::{ArrayView2, ArrayViewD, ArrayViewMut2, Axis, Ix2, Ix3};
use numpy::{
    PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods, dtype,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::errors::input;

/// The order of a pixel's bytes, as the caller says it.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Channels {
    pub name: &'static str,
    depth: usize,
    pixels: Layout,
    /// Which of them goes into each plane.
    order: &'static [usize],
}

const CHANNELS: [Channels; 5] = [
    Channels { name: "rgb", depth: 3, pixels: Layout::Rgb, order: &[0, 1, 2] },
    Channels { name: "bgr", depth: 3, pixels: Layout::Bgr, order: &[2, 1, 0] },
    Channels { name: "rgba", depth: 4, pixels: Layout::Rgba, order: &[0, 1, 2] },
    Channels { name: "bgra", depth: 4, pixels: Layout::Bgra, order: &[2, 1, 0] },
    Channels { name: "grey", depth: 1, pixels: Layout::Grey, order: &[0] },
];

impl Channels {
    /// By name.
    pub fn named(py: Python<'_>, name: &str) -> PyResult<Self> {
        CHANNELS.into_iter().find(|c| c.name == name).ok_or_else(|| {
            let names = CHANNELS.map(|c| format!("\"{}\"", c.name)).join(", ");
            input(py, format!("channels is one of {names}; it is \"{name}\""))
        })
    }
    /// The same, where there are three.
    pub fn of_three(self, py: Python<'_>) -> PyResult<Self> {
        if self.depth == 3 {
            return Ok(self);
        }
        Err(input(py, format!("a video's channels are \"rgb\" or \"bgr\"; they are \"{}\"", self.name)))
    }
    /// Which byte of a pixel is red, green, blue.
    pub fn order(self) -> &'static [usize] {
        self.order
    }
}

/// A picture of Python's that nobody writes to while it is read.
pub struct Picture<'py> {
    array: PyReadonlyArrayDyn<'py, u8>,
    channels: Channels,
}

impl<'py> Picture<'py> {
    /// A NumPy array, or what NumPy makes one of.
    pub fn new(picture: &Bound<'py, PyAny>, channels: Channels) -> PyResult<Self> {
        let py = picture.py();
        let array = match picture.cast::<PyUntypedArray>() {
            Ok(array) => array.clone(),
            Err(_) if picture.hasattr("__array_interface__")? || picture.hasattr("__array__")? => {
                py.import("numpy")?.call_method1("asarray", (picture,))?.cast_into::<PyUntypedArray>()?
            }
            Err(_) => {
                return Err(PyTypeError::new_err(format!(
                    "the picture is of type {}; expected a NumPy array of uint8, (height, width) or (height, width, channels)",
                    picture.get_type().name()?
                )));
            }
        };
        if !array.dtype().is_equiv_to(&dtype::<u8>(py)) {
            return Err(PyTypeError::new_err(format!(
                "the picture's dtype is {}; expected uint8, 0 to 255 (of values from 0 to 1 make (255 * picture).astype(\"uint8\"))",
                array.dtype()
            )));
        }
        let shape = array.shape();
        let (fits, channels) = match *shape {
            [h, w] | [h, w, 1] => (h > 0 && w > 0, CHANNELS[4]),
            [h, w, depth] => (h > 0 && w > 0 && depth == channels.depth, channels),
            _ => (false, channels),
        };
        if !fits {
            return Err(input(
                py,
                format!(
                    "the picture's shape is {shape:?}; expected (height, width) for grey or (height, width, {}) for channels=\"{}\", \
                     no side 0; say the order of the channels, for example channels=\"bgr\" for OpenCV's",
                    channels.depth, channels.name
                ),
            ));
        }
        let array = array.cast_into::<PyArrayDyn<u8>>()?.try_readonly();
        Ok(Self { array: array.map_err(|e| input(py, format!("the picture is being written to: {e}")))?, channels })
    }

    /// Its pixels, to be read without the interpreter's lock.
    pub fn pixels(&self) -> Pixels<'_> {
        Pixels { view: self.array.as_array(), channels: self.channels }
    }
}

/// A view of a picture.
pub struct Pixels<'a> {
    view: ArrayViewD<'a, u8>,
    channels: Channels,
}

impl Pixels<'_> {
    /// Takes the pixels apart into planes; where the picture before had this size, no memory is taken.
    pub fn read<'i>(&self, kept: &'i mut Option<Image>) -> foveate::Result<&'i Image> {
        let (height, width, planes) = (self.view.shape()[0], self.view.shape()[1], self.channels.order.len());
        let size = |image: &Image| [image.width(), image.height(), image.planes()];
        if kept.as_ref().is_none_or(|image| size(image) != [width, height, planes]) {
            memory::check_picture(width, height)?;
            *kept = Some(Image::new(width, height, planes, vec![0; width * height * planes])?);
        }
        let image = kept.as_mut().expect("it was put there");
        if let Some(bytes) = self.view.as_slice() {
            image.refill(self.channels.pixels, (width, height), width * self.channels.depth, bytes)?;
            return Ok(image);
        }
        for (plane, &channel) in self.channels.order.iter().enumerate() {
            let mut out = ArrayViewMut2::from_shape((height, width), image.plane_mut(plane)).expect("a plane is whole");
            out.assign(&self.plane(channel));
        }
        Ok(image)
    }

    fn plane(&self, channel: usize) -> ArrayView2<'_, u8> {
        let view = self.view.view();
        match view.ndim() {
            2 => view.into_dimensionality::<Ix2>().expect("it has two"),
            _ => view.into_dimensionality::<Ix3>().expect("it has three").index_axis_move(Axis(2), channel),
        }
    }
}
