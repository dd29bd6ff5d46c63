//! The plain data of the header.

use foveate::geometry::{Size, State};
use foveate::scene::Pixels;
use foveate::{BBox, Detection, Image, Seen, Status, memory};

use crate::errors::Failure;

/// An upright box, pixels from 0.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(crate) struct FoveateBox {
    /// Left edge.
    pub x: f64,
    /// Top edge.
    pub y: f64,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

/// The order of the bytes of a pixel.
#[derive(Clone, Copy, Debug)]
#[repr(i32)]
pub(crate) enum FoveateFormat {
    /// One grey byte.
    Grey = 0,
    /// Red, green, blue.
    Rgb = 1,
    /// Blue, green, red, as in OpenCV.
    Bgr = 2,
    /// Red, green, blue, and a byte that is not read.
    Rgba = 3,
    /// Blue, green, red, and a byte that is not read.
    Bgra = 4,
}

/// The formats, their layouts, and the bytes of a pixel.
const FORMATS: [(FoveateFormat, Pixels, usize); 5] = [
    (FoveateFormat::Grey, Pixels::Grey, 1),
    (FoveateFormat::Rgb, Pixels::Rgb, 3),
    (FoveateFormat::Bgr, Pixels::Bgr, 3),
    (FoveateFormat::Rgba, Pixels::Rgba, 4),
    (FoveateFormat::Bgra, Pixels::Bgra, 4),
];

/// A picture in the caller's memory. It is read during the call only.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(crate) struct FoveatePicture {
    /// The first byte of the top row. `stride * (height - 1)` bytes and one row must be readable.
    pub pixels: *const u8,
    /// Width in pixels.
    pub width: i32,
    /// Height in pixels.
    pub height: i32,
    /// Bytes from a row to the next, at least those of a row.
    pub stride: usize,
    /// A foveate_format.
    pub format: i32,
}

/// A box found by the caller's detector.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(crate) struct FoveateDetection {
    /// The box.
    pub bbox: FoveateBox,
    /// The score; a larger one is surer. NaN if there is none.
    pub score: f64,
}

/// The tracker's report on a target.
#[derive(Clone, Copy, Debug)]
#[repr(i32)]
pub(crate) enum FoveateStatus {
    /// The box is on the target.
    Tracking = 0,
    /// The target is probably lost, for a few frames. The box is a guess.
    Occluded = 1,
    /// The target is probably lost. The box is a guess.
    Lost = 2,
    /// The box is on the target again after a loss.
    Reacquired = 3,
}

/// One target in one frame.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(crate) struct FoveateResult {
    /// The number of the target, from 1.
    pub id: u64,
    /// The estimated box.
    pub bbox: FoveateBox,
    /// The probability, 0 to 1, that the box has an IoU below 0.1 with the target or that the target is not visible.
    pub p_lost: f64,
    /// Covariance of x, y, their velocities per frame (pixels), log scale, angle (radians) and log aspect.
    pub covariance: [[f64; 7]; 7],
    /// The index of the detection that was assigned to the target in this frame; -1 if there is none.
    pub detection: i64,
    /// The status.
    pub status: FoveateStatus,
    /// Whether the status is tracking or reacquired. Otherwise the box is a guess.
    pub usable: bool,
}

const _: () = assert!(State::N == 7, "the header states the size of the covariance");

impl From<FoveateBox> for BBox {
    fn from(b: FoveateBox) -> Self {
        Self::new(b.x, b.y, b.width, b.height)
    }
}

impl From<FoveateDetection> for Detection {
    fn from(d: FoveateDetection) -> Self {
        Self::new(d.bbox.into(), d.score)
    }
}

impl FoveateResult {
    pub(crate) fn of(seen: &Seen<'_>) -> Self {
        let BBox { x, y, w, h } = seen.bbox;
        Self {
            id: seen.id,
            bbox: FoveateBox { x, y, width: w, height: h },
            p_lost: seen.p_lost,
            covariance: seen.covariance,
            detection: seen.detection_index.map_or(-1, |index| index as i64),
            status: match seen.status {
                Status::Tracking => FoveateStatus::Tracking,
                Status::Occluded => FoveateStatus::Occluded,
                Status::Lost => FoveateStatus::Lost,
                Status::Reacquired => FoveateStatus::Reacquired,
            },
            usable: seen.is_usable(),
        }
    }
}

/// The checked shape of a picture.
pub(crate) struct Shape {
    pixels: Pixels,
    size: Size,
    stride: usize,
    /// The bytes from the first to the last pixel.
    pub bytes: usize,
}

impl FoveatePicture {
    /// Checks format, size and stride.
    pub(crate) fn shape(&self) -> Result<Shape, Failure> {
        let Some(&(_, pixels, depth)) = FORMATS.iter().find(|(format, ..)| *format as i32 == self.format) else {
            let format = self.format;
            return Err(Failure::invalid(format!("the picture's format is {format}; give a foveate_format, 0 to 4")));
        };
        let side = |side: i32| usize::try_from(side).ok().filter(|&side| side > 0);
        let (Some(width), Some(height)) = (side(self.width), side(self.height)) else {
            let (w, h) = (self.width, self.height);
            return Err(Failure::invalid(format!("the picture is {w} x {h}; give a width and a height of 1 or more")));
        };
        let (stride, row) = (self.stride, width.saturating_mul(depth));
        let before = stride.checked_mul(height - 1).and_then(|bytes| bytes.checked_add(row));
        match before.filter(|&bytes| stride >= row && bytes <= isize::MAX as usize) {
            Some(bytes) => Ok(Shape { pixels, size: Size { width, height }, stride, bytes }),
            None => Err(Failure::invalid(format!(
                "the picture's stride is {stride}; give the bytes from a row to the next, at least {row} for {width} pixels"
            ))),
        }
    }
}

impl Shape {
    /// Fails if pictures of a new size exceed the memory limit. It is called before the bytes are read.
    pub(crate) fn check(&self, kept: Option<&Image>) -> Result<(), Failure> {
        match kept.is_some_and(|image| image.size() == self.size) {
            true => Ok(()),
            false => Ok(memory::check_picture(self.size.width, self.size.height)?),
        }
    }

    /// Splits pixels into planes. If the picture before had the same size, it allocates nothing.
    pub(crate) fn read<'a>(&self, bytes: &[u8], kept: &'a mut Option<Image>) -> Result<&'a Image, Failure> {
        match kept {
            Some(image) => image.refill(self.pixels, self.size, self.stride, bytes)?,
            None => *kept = Some(Image::from_pixels(self.pixels, self.size, self.stride, bytes)?),
        }
        Ok(kept.as_ref().expect("it was put there"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::errors::FoveateCode;

    #[test]
    fn shapes_without_pixels_or_beyond_memory_are_refused() {
        let good = FoveatePicture { pixels: std::ptr::null(), width: 5, height: 3, stride: 20, format: 1 };
        assert_eq!(good.shape().expect("it has pixels").bytes, 2 * 20 + 15);
        for bad in [
            FoveatePicture { format: 5, ..good },
            FoveatePicture { width: 0, ..good },
            FoveatePicture { height: -1, ..good },
            FoveatePicture { stride: 14, ..good },
            FoveatePicture { stride: usize::MAX, ..good },
            FoveatePicture { stride: isize::MAX as usize, height: 2, ..good },
        ] {
            assert_eq!(bad.shape().map(|_| ()).expect_err("no such picture").code, FoveateCode::Invalid, "{bad:?}");
        }
    }
}
