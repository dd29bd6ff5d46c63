//! Where things are, and in which space.
//!
//! *Image* coordinates are pixels, x right, y down, the centre of the top-left pixel at (0, 0).
//! *Template* coordinates (u, v) are in half-boxes: the target's box is the square from −1 to 1,
//! whatever its size and shape on the image. [`State::fixate`] maps the second to the first.

use foveate_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// A box on the image: top-left corner and size in pixels, 0-based; it covers x to x + w − 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BBox {
    /// Left column.
    pub x: f64,
    /// Top row.
    pub y: f64,
    /// Width, at least 1 for a target.
    pub w: f64,
    /// Height, at least 1 for a target.
    pub h: f64,
}

/// The size of a picture or of a map: columns and rows. It is saved as `[width, height]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "(usize, usize)", into = "(usize, usize)")]
pub struct Size {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Size {
    /// A size by its columns and rows.
    pub const fn new(width: usize, height: usize) -> Self {
        Self { width, height }
    }
}

impl From<(usize, usize)> for Size {
    fn from((width, height): (usize, usize)) -> Self {
        Self { width, height }
    }
}

impl From<Size> for (usize, usize) {
    fn from(Size { width, height }: Size) -> Self {
        (width, height)
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} x {}", self.width, self.height)
    }
}

/// All pairs of `n` boxes that share a column, by index, each once, by a sweep from left to right. `order` is a buffer.
pub fn sharing_columns<'a>(
    n: usize,
    at: &'a dyn Fn(usize) -> BBox,
    order: &'a mut Vec<u32>,
) -> impl Iterator<Item = (usize, usize)> + 'a {
    order.clear();
    order.extend(0..n as u32);
    order.sort_unstable_by(|a, b| at(*a as usize).x.total_cmp(&at(*b as usize).x).then(a.cmp(b)));
    let order = &order[..];
    order.iter().enumerate().flat_map(move |(k, &i)| {
        let BBox { x, w, .. } = at(i as usize);
        let beside = order[k + 1..].iter().take_while(move |j| at(**j as usize).x < x + w);
        beside.map(move |&j| (i as usize, j as usize))
    })
}

impl BBox {
    /// A box by its left and top edge, counted from 0, and its width and height, pixels.
    pub const fn new(x: f64, y: f64, w: f64, h: f64) -> Self {
        Self { x, y, w, h }
    }
    /// The same counted from 1, as OTB's and MOTChallenge's files have it.
    pub const fn counted_from_1(x: f64, y: f64, w: f64, h: f64) -> Self {
        Self { x: x - 1.0, y: y - 1.0, w, h }
    }
    /// The box between two corners, left and top inclusive, right and bottom exclusive, pixels counted from 0.
    pub const fn from_corners(left: f64, top: f64, right: f64, bottom: f64) -> Self {
        Self { x: left, y: top, w: right - left, h: bottom - top }
    }
    /// Whether it may be of a picture: a size of 0.001 to 10⁷ pixels a side, and nowhere beyond 10⁹.
    pub(crate) fn is_sane(&self) -> bool {
        let side = |side: f64| (1e-3..=1e7).contains(&side);
        self.x.abs() <= 1e9 && self.y.abs() <= 1e9 && side(self.w) && side(self.h)
    }
    /// Fails if no picture can hold it: a side is not from 0.001 to 10⁷ pixels, or a corner is beyond 10⁹.
    pub fn check(&self) -> Result<()> {
        let Self { x, y, w, h } = *self;
        if self.is_sane() {
            return Ok(());
        }
        Err(Error::Invalid(format!(
            "a box is four numbers, with a width and height from 0.001 to 10000000 and a corner within 1000000000; it is x={x}, y={y}, \
             w={w}, h={h}"
        )))
    }
    /// The smallest box that holds both.
    pub(crate) fn union(&self, other: &Self) -> Self {
        let right = (self.x + self.w).max(other.x + other.w);
        let bottom = (self.y + self.h).max(other.y + other.h);
        Self::from_corners(self.x.min(other.x), self.y.min(other.y), right, bottom)
    }
    /// The centre in image coordinates: x + (w − 1) / 2, as OTB's and GOT-10k's toolkits have it.
    pub fn centre(&self) -> (f64, f64) {
        (self.x + (self.w - 1.0) / 2.0, self.y + (self.h - 1.0) / 2.0)
    }
    /// The box of this size around a centre.
    pub fn around(cx: f64, cy: f64, w: f64, h: f64) -> Self {
        Self { x: cx - (w - 1.0) / 2.0, y: cy - (h - 1.0) / 2.0, w, h }
    }
    /// The area both boxes cover, pixels; 0 where they do not meet.
    pub fn intersection(&self, other: &Self) -> f64 {
        let w = (self.x + self.w).min(other.x + other.w) - self.x.max(other.x);
        let h = (self.y + self.h).min(other.y + other.h) - self.y.max(other.y);
        w.max(0.0) * h.max(0.0)
    }
    /// Intersection over union with another box, 0 to 1.
    pub fn iou(&self, other: &Self) -> f64 {
        let inter = self.intersection(other);
        let union = self.w * self.h + other.w * other.h - inter;
        (inter / union.max(f64::EPSILON)).clamp(0.0, 1.0)
    }
}

/// Half the size of the target's box at `log_scale` and `log_aspect` 0, in pixels per template unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Halves")]
pub struct Extent {
    /// Pixels per unit of u: half the box's width.
    pub half_w: f64,
    /// Pixels per unit of v: half the box's height.
    pub half_h: f64,
}

/// A saved extent, before its check.
#[derive(Deserialize)]
struct Halves {
    half_w: f64,
    half_h: f64,
}

impl TryFrom<Halves> for Extent {
    type Error = String;

    fn try_from(Halves { half_w, half_h }: Halves) -> std::result::Result<Self, String> {
        let sane = |half: f64| (1e-3..=1e6).contains(&half);
        match sane(half_w) && sane(half_h) {
            true => Ok(Self { half_w, half_h }),
            false => Err(format!("half a box is from 0.001 to 1000000 pixels; it is {half_w} x {half_h}")),
        }
    }
}

impl Extent {
    /// The extent of a box.
    pub fn of(bbox: &BBox) -> Self {
        Self { half_w: bbox.w / 2.0, half_h: bbox.h / 2.0 }
    }
    /// Geometric mean of the halves: pixels per template unit, on the whole.
    pub fn mean(&self) -> f64 {
        (self.half_w * self.half_h).sqrt()
    }
}

/// The covariance of a state, in the order of its fields.
pub type Covariance = [[f64; State::N]; State::N];

/// xₜ: the state of the target in a particle (section 3.1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Believed")]
pub struct State {
    /// Centre, pixels.
    pub x: f64,
    /// Centre, pixels.
    pub y: f64,
    /// Velocity, pixels a frame.
    pub vx: f64,
    /// Velocity, pixels a frame.
    pub vy: f64,
    /// Natural logarithm of size relative to the first frame.
    pub log_scale: f64,
    /// Turn relative to the first frame, radians, positive from x towards y (clockwise on the screen).
    pub angle: f64,
    /// Natural logarithm of width / height relative to the first frame, at the same area.
    pub log_aspect: f64,
}

/// A saved state, before its check.
#[derive(Deserialize)]
struct Believed {
    x: f64,
    y: f64,
    vx: f64,
    vy: f64,
    log_scale: f64,
    angle: f64,
    log_aspect: f64,
}

impl TryFrom<Believed> for State {
    type Error = String;

    fn try_from(saved: Believed) -> std::result::Result<Self, String> {
        let Believed { x, y, vx, vy, log_scale, angle, log_aspect } = saved;
        if [x, y, vx, vy, angle].iter().any(|v| v.abs() > 1e12) || log_scale.abs().max(log_aspect.abs()) > 64.0 {
            return Err(format!(
                "a state is seven numbers up to 1e12, the logarithms of its scale and aspect up to 64; one is {x}, {y}, {vx}, {vy}, \
                 {log_scale}, {angle}, {log_aspect}"
            ));
        }
        Ok(Self { x, y, vx, vy, log_scale, angle, log_aspect })
    }
}

impl State {
    /// How many numbers it is.
    pub const N: usize = 7;
    /// At rest at the centre of a box, with its size and no turn.
    pub fn of(bbox: &BBox) -> Self {
        let (x, y) = bbox.centre();
        Self { x, y, ..Self::default() }
    }
    /// The numbers in the order of the fields.
    pub fn to_array(&self) -> [f64; Self::N] {
        [self.x, self.y, self.vx, self.vy, self.log_scale, self.angle, self.log_aspect]
    }
    /// From numbers in the order of the fields.
    pub fn from_array([x, y, vx, vy, log_scale, angle, log_aspect]: [f64; Self::N]) -> Self {
        Self { x, y, vx, vy, log_scale, angle, log_aspect }
    }
    /// The extent of the first frame in the shape of this state: the same area, another width / height.
    pub fn shaped(&self, extent: Extent) -> Extent {
        if self.log_aspect == 0.0 {
            return extent;
        }
        let wider = (0.5 * self.log_aspect).exp();
        Extent { half_w: wider * extent.half_w, half_h: extent.half_h / wider }
    }
    /// Half the width and height of the target's box, pixels: one template unit across and down.
    pub fn half(&self, extent: Extent) -> (f64, f64) {
        let (scale, Extent { half_w, half_h }) = (self.log_scale.exp(), self.shaped(extent));
        (scale * half_w, scale * half_h)
    }
    /// The upright box of the target: its size, not the bounding box of the turned one.
    pub fn bbox(&self, extent: Extent) -> BBox {
        let (w, h) = self.half(extent);
        BBox::around(self.x, self.y, 2.0 * w, 2.0 * h)
    }
    /// Sine and cosine of the angle; often no state turns at all, and they cost nothing.
    pub fn turn(&self) -> (f64, f64) {
        if self.angle == 0.0 { (0.0, 1.0) } else { self.angle.sin_cos() }
    }
    /// Where a gaze falls on the image: image from template.
    pub fn fixate(&self, gaze: Gaze, extent: Extent) -> Fixation {
        let ((sin, cos), (w, h)) = (self.turn(), self.half(extent));
        let (uu, vv) = (w * gaze.u, h * gaze.v);
        Fixation {
            x: self.x + cos * uu - sin * vv,
            y: self.y + sin * uu + cos * vv,
            ux: cos * w,
            uy: sin * w,
            vx: -sin * h,
            vy: cos * h,
        }
    }
}

/// aₜ: where to look, in template coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Gaze {
    /// Across: −1 is the left edge of the box, 1 the right one.
    pub u: f64,
    /// Down: −1 is the top edge of the box, 1 the bottom one.
    pub v: f64,
    /// Its index among a policy's fixed gazes, if it is one of those.
    pub arm: Option<usize>,
}

impl Gaze {
    /// As a retina has it that has settled on another gaze, which is its centre. Of the centre nothing changes.
    pub(crate) fn relative_to(self, home: Self) -> Self {
        match ((home.u, home.v) == (0.0, 0.0), (self.u, self.v) == (home.u, home.v)) {
            (true, _) => self,
            (false, true) => Self::CENTRE,
            (false, false) => Self { u: self.u - home.u, v: self.v - home.v, ..self },
        }
    }
    /// The middle of the template.
    pub const CENTRE: Self = Self { u: 0.0, v: 0.0, arm: None };
}

/// A gaze on the image: a centre, and where one template unit along u and along v leads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fixation {
    /// Centre, pixels.
    pub x: f64,
    /// Centre, pixels.
    pub y: f64,
    /// x of one unit of u, pixels.
    pub ux: f64,
    /// y of one unit of u, pixels.
    pub uy: f64,
    /// x of one unit of v, pixels.
    pub vx: f64,
    /// y of one unit of v, pixels.
    pub vy: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two states of one size and turn but of another shape: the corners of each are where half its width and height lead, and the areas
    /// are the same.
    #[test]
    fn a_gaze_falls_where_the_half_sizes_lead() {
        let extent = Extent { half_w: 20.0, half_h: 10.0 };
        let upright = State { x: 5.0, y: 7.0, log_scale: 2f64.ln(), angle: 0.3, ..State::default() };
        let wide = State { log_aspect: 4f64.ln(), ..upright };
        for (state, (w, h)) in [(upright, (40.0, 20.0)), (wide, (80.0, 10.0))] {
            let (sin, cos) = 0.3f64.sin_cos();
            for (u, v) in [(1.0, 1.0), (-1.0, 1.0), (0.5, -0.25), (0.0, 0.0)] {
                let at = state.fixate(Gaze { u, v, arm: None }, extent);
                let exact = (5.0 + cos * w * u - sin * h * v, 7.0 + sin * w * u + cos * h * v);
                assert!((at.x - exact.0).hypot(at.y - exact.1) < 1e-12, "({u}, {v}) is at {at:?}, not {exact:?}");
                assert!((at.ux.hypot(at.uy) - w).abs() < 1e-12 && (at.vx.hypot(at.vy) - h).abs() < 1e-12);
            }
            let BBox { w: width, h: height, .. } = state.bbox(extent);
            assert!((width - 2.0 * w).abs() < 1e-12 && (height - 2.0 * h).abs() < 1e-12);
        }
        assert_eq!(State::from_array(wide.to_array()), wide);
    }

    #[test]
    fn a_saved_state_is_within_bounds() {
        let read = |log_aspect: f64| {
            serde_json::from_value::<State>(serde_json::json!(State { log_aspect, ..State::default() }))
        };
        assert_eq!(read(-0.5).expect("a usual shape").log_aspect, -0.5);
        assert!(read(65.0).expect_err("no picture has it").to_string().contains("aspect up to 64"));
    }
}
