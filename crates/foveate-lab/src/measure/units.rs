//! From pixels and frames to metres and seconds.

use serde::{Deserialize, Serialize};

use foveate_base::{Error, Result};

use super::lens::Lens;

/// Standard error of each coordinate of a clicked point, pixels.
const CLICK: f64 = 0.5;

/// A length in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ruler {
    /// Its ends, pixels from 0. Each coordinate counts as known within half a pixel.
    pub ends: [(f64, f64); 2],
    /// The length, metres.
    pub length: f64,
    /// Its standard error, metres.
    pub error: f64,
}

/// The length of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Metres per pixel.
    pub metres: f64,
    /// Its relative standard error.
    pub error: f64,
}

impl Ruler {
    /// Returns the scale. `None` if the ends coincide or the length is not above 0.
    pub fn scale(&self) -> Option<Scale> {
        let Self { ends: [a, b], length, error } = *self;
        let pixels = (b.0 - a.0).hypot(b.1 - a.1);
        let relative = (error / length).hypot(CLICK * 2.0_f64.sqrt() / pixels);
        let scale = Scale { metres: length / pixels, error: relative };
        (pixels > 0.0 && length > 0.0 && error >= 0.0 && scale.metres.is_finite() && relative.is_finite())
            .then_some(scale)
    }
}

/// A frame rate that replaces the times of the source.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Clock {
    /// Frames per second, above 0.
    pub rate: f64,
    /// Its standard error.
    pub error: f64,
}

/// The coordinate system of a measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Axes {
    /// A known length; `None` measures in pixels.
    pub ruler: Option<Ruler>,
    /// The origin, pixels from 0; `None` is the first position of the target.
    pub origin: Option<(f64, f64)>,
    /// The direction of the x axis, degrees anticlockwise from the picture's right. The y axis points 90 degrees further: up.
    pub angle: f64,
}

impl Axes {
    /// Returns the unit of length.
    pub fn unit(&self) -> &'static str {
        if self.ruler.is_some() { "m" } else { "px" }
    }

    /// Returns the length of a pixel; `None` measures in pixels.
    fn scale(&self) -> Option<Scale> {
        self.ruler.as_ref().and_then(Ruler::scale)
    }

    /// Removes the distortion of a lens from the points.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the lens shows no point there.
    pub(super) fn straighten(&self, lens: &Lens) -> Result<Self> {
        let point = |(x, y): (f64, f64)| {
            let outside = || {
                Error::Invalid(format!(
                    "the lens shows no point at ({}, {}): is it that of this video?",
                    x + 1.0,
                    y + 1.0
                ))
            };
            lens.undistort((x, y)).ok_or_else(outside)
        };
        let ruler = self.ruler.map(|ruler| {
            let [a, b] = ruler.ends;
            Ok::<_, Error>(Ruler { ends: [point(a)?, point(b)?], ..ruler })
        });
        Ok(Self { ruler: ruler.transpose()?, origin: self.origin.map(point).transpose()?, ..*self })
    }

    /// Returns the relative standard error of all lengths.
    pub fn error(&self) -> f64 {
        self.scale().map_or(0.0, |scale| scale.error)
    }

    /// Returns coordinates and their variances, from a position relative to the origin and its covariance (xx, xy, yy) in the picture,
    /// pixels.
    pub(super) fn apply(&self, (dx, dy): (f64, f64), [xx, xy, yy]: [f64; 3]) -> ([f64; 2], [f64; 2]) {
        let metres = self.scale().map_or(1.0, |scale| scale.metres);
        let (sin, cos) = self.angle.to_radians().sin_cos();
        // The picture's y points down.
        let (up, across) = (-dy, -xy);
        let value = [dx * cos + up * sin, up * cos - dx * sin];
        let both = 2.0 * sin * cos * across;
        let variance = [cos * cos * xx + sin * sin * yy + both, sin * sin * xx + cos * cos * yy - both];
        (value.map(|v| v * metres), variance.map(|v| v * metres * metres))
    }
}

/// Returns a unit from the exponents of length and time, such as m/s².
pub fn unit(length: &str, exponents: (i32, i32)) -> String {
    let raised = |n: i32| if n == 1 { "" } else { "²" };
    match exponents {
        (0, 0) => "rad".into(),
        (0, _) => "s".into(),
        (_, 0) => length.into(),
        (_, time) => format!("{length}/s{}", raised(-time)),
    }
}

/// Formats a value with its standard error: two digits of the error.
pub fn with_error(value: f64, error: f64) -> String {
    let after = digits(error).map_or(String::new(), |digits| format!(" ± {error:.digits$}"));
    with_digits(value, error) + &after
}

/// Formats a number to the second digit of a standard error, or whole if there is none.
pub(super) fn with_digits(number: f64, error: f64) -> String {
    // Not -0.
    let number = number + 0.0;
    digits(error).map_or(format!("{number}"), |digits| format!("{number:.digits$}"))
}

/// Returns the decimals up to the second digit of a standard error; `None` if there is no error.
fn digits(error: f64) -> Option<usize> {
    (error > 0.0 && error.is_finite()).then(|| (1 - error.log10().floor() as i32).max(0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ruler_gives_the_scale_and_its_error() {
        let of = |ends, length, error| Ruler { ends, length, error }.scale();
        let scale = of([(10.0, 20.0), (40.0, 60.0)], 1.0, 0.01).expect("a ruler");
        assert!((scale.metres - 0.02).abs() < 1e-15);
        assert!((scale.error - (1e-4_f64 + 0.5 / 2500.0).sqrt()).abs() < 1e-15);
        assert!(of([(1.0, 1.0); 2], 1.0, 0.0).is_none() && of([(0.0, 0.0), (1.0, 0.0)], 0.0, 0.0).is_none());
    }

    #[test]
    fn axes_turn_positions_and_variances() {
        let ruler = Some(Ruler { ends: [(0.0, 0.0), (2.0, 0.0)], length: 1.0, error: 0.0 });
        let axes = Axes { ruler, origin: None, angle: 30.0 };
        // 10 px along an axis that points 30 degrees up, errors along it only.
        let (sin, cos) = 30_f64.to_radians().sin_cos();
        let (value, variance) =
            axes.apply((10.0 * cos, -10.0 * sin), [4.0 * cos * cos, -4.0 * cos * sin, 4.0 * sin * sin]);
        assert!((value[0] - 5.0).abs() < 1e-12 && value[1].abs() < 1e-12, "{value:?}");
        assert!((variance[0] - 1.0).abs() < 1e-12 && variance[1].abs() < 1e-12, "{variance:?}");
        assert_eq!(Axes::default().apply((1.0, 2.0), [1.0, 0.0, 2.0]), ([1.0, -2.0], [1.0, 2.0]));
    }

    #[test]
    fn units_and_errors_as_text() {
        assert_eq!([(1, 0), (1, -1), (1, -2), (0, 1), (0, 0)].map(|e| unit("m", e)), ["m", "m/s", "m/s²", "s", "rad"]);
        let texts = [with_error(9.7934, 0.0421), with_error(1234.5, 123.0), with_error(2.0, 0.0)];
        assert_eq!(texts, ["9.793 ± 0.042", "1234 ± 123", "2"]);
        assert_eq!([with_digits(0.12345, 0.02), with_digits(-0.0, 0.0)], ["0.123", "0"]);
    }
}
