//! NumPy pictures as foveate's: read in place, with any strides, into planes that are reused from frame to frame.

use foveate::geometry::Size;
use foveate::scene::Pixels as Layout;
use foveate::{Image, memory};
use numpy::ndarray::{Array2, Array3, ArrayView2, ArrayViewD, ArrayViewMut2, Axis, Ix2, Ix3};
use numpy::{
    IntoPyArray, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray,
    PyUntypedArrayMethods, dtype,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::errors::input;

/// The order of a pixel's bytes, as given by the caller.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct Channels {
    pub name: &'static str,
    depth: usize,
    pixels: Layout,
    /// The byte for each plane.
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
    /// Returns the channels by name.
    pub(crate) fn named(py: Python<'_>, name: &str) -> PyResult<Self> {
        CHANNELS.into_iter().find(|c| c.name == name).ok_or_else(|| {
            let names = CHANNELS.map(|c| format!("\"{}\"", c.name)).join(", ");
            input(py, format!("channels is one of {names}; it is \"{name}\""))
        })
    }
    /// Returns the channels if there are three.
    pub(crate) fn of_three(self, py: Python<'_>) -> PyResult<Self> {
        if self.depth == 3 {
            return Ok(self);
        }
        Err(input(py, format!("a video's channels are \"rgb\" or \"bgr\"; they are \"{}\"", self.name)))
    }
    /// Returns the indices of red, green and blue in a pixel of three bytes; for grey and without alpha.
    pub(crate) fn order_of_three(self) -> &'static [usize] {
        if self.order.len() == 3 { self.order } else { CHANNELS[0].order }
    }
    /// Returns whether the named channels have the same colours in the same order.
    pub(crate) fn has_order_of(self, name: &str) -> bool {
        CHANNELS.iter().any(|c| c.name == name && c.order == self.order)
    }
    /// Returns three channels in the same order.
    fn without_alpha(self) -> Self {
        CHANNELS.into_iter().find(|c| c.depth == 3 && c.order == self.order).unwrap_or(self)
    }
    /// Returns the indices of red, green and blue in a pixel.
    pub(crate) fn order(self) -> &'static [usize] {
        self.order
    }
}

/// A Python picture that is not written to during the read.
pub(crate) struct Picture<'py> {
    array: PyReadonlyArrayDyn<'py, u8>,
    channels: Channels,
}

impl<'py> Picture<'py> {
    /// Reads a NumPy array, or an object that NumPy converts to one.
    pub(crate) fn new(picture: &Bound<'py, PyAny>, channels: Channels) -> PyResult<Self> {
        let py = picture.py();
        let (array, channels) = match picture.cast::<PyUntypedArray>() {
            Ok(array) => (array.clone(), channels),
            Err(_) if picture.hasattr("getbands")? => of_pillow(picture)?,
            Err(_) if picture.hasattr("__array_interface__")? || picture.hasattr("__array__")? => {
                (as_array(picture)?, channels)
            }
            Err(_) => {
                return Err(PyTypeError::new_err(format!(
                    "the picture is of type {}; expected a NumPy array of uint8, (height, width) or (height, width, channels)",
                    picture.get_type().name()?
                )));
            }
        };
        let found = array.dtype();
        if !found.is_equiv_to(&dtype::<u8>(py)) {
            return Err(PyTypeError::new_err(format!(
                "the picture's dtype is {found}; expected uint8, 0 to 255; convert it: {}",
                conversion(found.kind(), found.itemsize())
            )));
        }
        let shape = array.shape();
        let (fits, channels) = match *shape {
            [h, w] | [h, w, 1] => (h > 0 && w > 0, CHANNELS[4]),
            // A video has no alpha, which is not read anyway.
            [h, w, 3] if channels.depth == 4 => (h > 0 && w > 0, channels.without_alpha()),
            [h, w, depth] => (h > 0 && w > 0 && depth == channels.depth, channels),
            _ => (false, channels),
        };
        if !fits {
            return Err(input(
                py,
                format!(
                    "the picture's shape is {shape:?}; expected (height, width) for grey or (height, width, {}) for channels=\"{}\", \
                     no side 0{}",
                    channels.depth,
                    channels.name,
                    advice(shape)
                ),
            ));
        }
        let array = array.cast_into::<PyArrayDyn<u8>>()?.try_readonly();
        Ok(Self { array: array.map_err(|e| input(py, format!("the picture is being written to: {e}")))?, channels })
    }

    /// Returns its pixels, for reading without the interpreter's lock.
    pub(crate) fn pixels(&self) -> Pixels<'_> {
        Pixels { view: self.array.as_array(), channels: self.channels }
    }
}

fn as_array<'py>(picture: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyUntypedArray>> {
    Ok(picture.py().import("numpy")?.call_method1("asarray", (picture,))?.cast_into::<PyUntypedArray>()?)
}

/// Reads a Pillow picture; its mode gives the order of channels. Palettes, ink and other colour spaces become RGB.
fn of_pillow<'py>(picture: &Bound<'py, PyAny>) -> PyResult<(Bound<'py, PyUntypedArray>, Channels)> {
    let mode: String = picture.getattr("mode")?.extract()?;
    let (channels, convert) = match &*mode {
        "RGB" => ("rgb", None),
        "RGBA" => ("rgba", None),
        "L" => ("grey", None),
        "1" | "LA" | "La" => ("grey", Some("L")),
        "P" | "PA" | "CMYK" | "YCbCr" | "LAB" | "HSV" | "RGBX" | "RGBa" => ("rgb", Some("RGB")),
        _ => {
            return Err(PyTypeError::new_err(format!(
                "the picture's mode is {mode}, which has more than 8 bits a value; expected a mode of 8 bits, such as RGB or L; scale \
                 its values to 0 to 255, for example (numpy.asarray(picture) >> 8).astype(\"uint8\") of 16 bits"
            )));
        }
    };
    let array = match convert {
        None => as_array(picture)?,
        Some(mode) => as_array(&picture.call_method1("convert", (mode,))?)?,
    };
    Ok((array, Channels::named(picture.py(), channels)?))
}

/// Returns the NumPy expression that converts values to bytes, by the type's kind and size.
fn conversion(kind: u8, size: usize) -> &'static str {
    match (kind, size) {
        (b'b', _) => "`255 * picture.astype(\"uint8\")`",
        (b'u', 2) => "`(picture >> 8).astype(\"uint8\")` for 16 bits; shift by 4 for 12 bits, by 2 for 10 bits",
        (b'u' | b'i', _) => "`picture.clip(0, 255).astype(\"uint8\")` for values from 0 to 255",
        (b'f', _) => {
            "`(255 * picture).clip(0, 255).round().astype(\"uint8\")` for values from 0 to 1; without `255 *` for values from 0 to 255"
        }
        _ => "values must be numbers",
    }
}

/// Returns a hint about a wrong shape.
fn advice(shape: &[usize]) -> &'static str {
    match *shape {
        [_, _, 4] => {
            "; a picture with an alpha channel needs channels=\"rgba\" (PIL, imageio) or channels=\"bgra\" (OpenCV), or leave alpha \
             out: picture[..., :3]"
        }
        [_, _, 3] => "; for three channels give channels=\"rgb\" (PIL, imageio) or channels=\"bgr\" (OpenCV)",
        [1 | 3 | 4, h, w] if h > 4 && w > 4 => {
            "; the channels come first, as in PyTorch: give picture.transpose(1, 2, 0), or picture.permute(1, 2, 0).numpy() of a tensor"
        }
        [1, _, _, _] => "; this is a batch of one picture: give picture[0]",
        [_, _, _, _] => "; this is a batch of pictures: give them one after the other",
        _ => "",
    }
}

/// A view of a picture.
pub(crate) struct Pixels<'a> {
    view: ArrayViewD<'a, u8>,
    channels: Channels,
}

impl Pixels<'_> {
    /// Splits the pixels into planes; allocates nothing if the previous picture had the same size.
    pub(crate) fn read<'i>(&self, kept: &'i mut Option<Image>) -> foveate::Result<&'i Image> {
        let (height, width, planes) = (self.view.shape()[0], self.view.shape()[1], self.channels.order.len());
        let size = |image: &Image| [image.width(), image.height(), image.planes()];
        if kept.as_ref().is_none_or(|image| size(image) != [width, height, planes]) {
            memory::check_picture(width, height)?;
            *kept = Some(Image::new(width, height, planes, vec![0; width * height * planes])?);
        }
        let image = kept.as_mut().expect("it was put there");
        if let Some(bytes) = self.view.as_slice() {
            image.refill(self.channels.pixels, Size { width, height }, width * self.channels.depth, bytes)?;
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

/// A picture as a NumPy array.
pub(crate) enum Interleaved {
    Grey(Array2<u8>),
    Colour(Array3<u8>),
}

impl Interleaved {
    /// Returns the array.
    pub(crate) fn into_array(self, py: Python<'_>) -> Bound<'_, PyAny> {
        match self {
            Self::Grey(pixels) => pixels.into_pyarray(py).into_any(),
            Self::Colour(pixels) => pixels.into_pyarray(py).into_any(),
        }
    }
}

/// Interleaves planes into pixels of three bytes; `order` gives the indices of red, green and blue.
pub(crate) fn interleaved(image: &Image, order: &[usize]) -> Interleaved {
    let size = (image.height(), image.width());
    let plane = |p: usize| ArrayView2::from_shape(size, image.plane(p)).expect("a plane is whole");
    if image.planes() == 1 {
        return Interleaved::Grey(plane(0).to_owned());
    }
    let mut pixels = Array3::zeros((size.0, size.1, 3));
    for (p, &channel) in order.iter().enumerate() {
        pixels.index_axis_mut(Axis(2), channel).assign(&plane(p));
    }
    Interleaved::Colour(pixels)
}
