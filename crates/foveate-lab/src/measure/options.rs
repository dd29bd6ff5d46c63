//! The texts of lengths, points, angles and rates in options: pixels count from 1.

use std::path::Path;
use std::str::FromStr;

use serde::Deserialize;

use super::units::{Clock, Ruler};
use foveate_base::{Error, files};

type Parsed<T> = Result<T, String>;

/// The largest number of an option, and the reciprocal of the smallest rate or length: results of larger ones overflow.
const LARGEST: f64 = 1e12;

/// Parses numbers between commas.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|n: &f64| n.abs() <= LARGEST)).collect();
    numbers?.try_into().ok()
}

/// Parses a point `x,y`; returns it in pixels from 0.
///
/// # Errors
/// It is not two numbers of at most 1e12.
pub fn parse_point(text: &str) -> Parsed<(f64, f64)> {
    let [x, y] = numbers(text)
        .ok_or_else(|| format!("expected two numbers x,y such as 120,80 and at most 1e12, got \"{text}\""))?;
    Ok((x - 1.0, y - 1.0))
}

/// Parses an angle in degrees.
///
/// # Errors
/// It is not a number of at most 1e12.
pub fn parse_angle(text: &str) -> Parsed<f64> {
    let [angle] =
        numbers(text).ok_or_else(|| format!("expected degrees such as -12.5 and at most 1e12, got \"{text}\""))?;
    Ok(angle)
}

/// Parses a value of 1e-12 to 1e12 with its standard error: `1.0`, `1.0+-0.1` or `1.0±0.1`.
fn value_with_error(text: &str) -> Option<(f64, f64)> {
    let (value, error) = text.split_once("+-").or_else(|| text.split_once('±')).unwrap_or((text, "0"));
    let [value] = numbers(value)?;
    let [error] = numbers(error)?;
    (value >= 1.0 / LARGEST && error >= 0.0).then_some((value, error))
}

/// Reads two points and a length, such as `100,60,100,460=1.000+-0.002m`.
impl FromStr for Ruler {
    type Err = String;

    fn from_str(text: &str) -> Parsed<Self> {
        const UNITS: [(&str, f64); 6] =
            [("mm", 1e-3), ("cm", 1e-2), ("km", 1e3), ("m", 1.0), ("in", 0.0254), ("ft", 0.3048)];
        let read = || {
            let (points, length) = text.split_once('=').ok_or("there is no \"=\"")?;
            let [x1, y1, x2, y2] = numbers(points).ok_or("before \"=\" are not four numbers of at most 1e12")?;
            let named = UNITS.iter().find_map(|(name, metres)| Some((length.trim().strip_suffix(name)?, *metres)));
            let (length, metres) = named.unwrap_or((length, 1.0));
            let (length, error) = value_with_error(length)
                .ok_or("after \"=\" is no length above 0 and at most 1e12, alone or with +- and an error, then mm, cm, m, km, in or ft")?;
            let ends = [(x1 - 1.0, y1 - 1.0), (x2 - 1.0, y2 - 1.0)];
            let ruler = Self { ends, length: length * metres, error: error * metres };
            ruler.scale().map(|_| ruler).ok_or("both points are the same")
        };
        read().map_err(|problem: &str| {
            format!("expected X1,Y1,X2,Y2=LENGTH such as 100,60,100,460=1.000+-0.002m, got \"{text}\": {problem}")
        })
    }
}

/// Reads frames per second, such as `240` or `240+-0.5`.
impl FromStr for Clock {
    type Err = String;

    fn from_str(text: &str) -> Parsed<Self> {
        let wrong = || format!("expected frames per second such as 240 or 240+-0.5 and at most 1e12, got \"{text}\"");
        value_with_error(text).map(|(rate, error)| Self { rate, error }).ok_or_else(wrong)
    }
}

/// What the fits.json beside a track says of the measurement that it belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Earlier {
    /// The frame rate; `None` if the times were those of the video.
    pub fps: Option<Clock>,
    /// Whether positions were relative to a reference, which the track does not have.
    pub reference: bool,
    /// Width and height of the tracked pictures, if they are known.
    pub picture: Option<[usize; 2]>,
    /// Whether the distortion of a lens was removed from the positions; it is in the track.
    pub lens: bool,
    /// The scale at which the pictures were tracked, if it is known.
    pub scale: Option<f64>,
}

impl Earlier {
    /// Reads the file; the default if there is none.
    ///
    /// # Errors
    /// The file cannot be read, or is no fits.json.
    pub fn beside(track: &Path) -> foveate_base::Result<Self> {
        let path = track.with_file_name("fits.json");
        if !path.exists() {
            return Ok(Self::default());
        }
        let problem = |e: String| Error::malformed(&path, format!("{e}; give --fps, or move the file"));
        let earlier: Self =
            serde_json::from_str(&files::read_text(&path, files::TEXT)?).map_err(|e| problem(e.to_string()))?;
        let checked = |Clock { rate, error }| format!("{rate}+-{error}").parse().map_err(problem);
        Ok(Self { fps: earlier.fps.map(checked).transpose()?, ..earlier })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_read_or_refused() {
        let scale = |text: &str| text.parse::<Ruler>().expect("a ruler").scale().expect("a scale");
        let clock = |text: &str| text.parse::<Clock>();
        let ruler = scale("1,1,1,201=50+-0.5cm");
        assert!((ruler.metres - 0.0025).abs() < 1e-12 && ruler.error > 0.01);
        assert!((scale("0,0,3,4=2ft").metres - 0.12192).abs() < 1e-12);
        assert_eq!(clock("240±0.5"), Ok(Clock { rate: 240.0, error: 0.5 }));
        assert_eq!(parse_point("1,2"), Ok((0.0, 1.0)));
        for (wrong, problem) in [
            ("1,1,1,1=1m", "the same"),
            ("1,2,3=1m", "before"),
            ("1,2,3,4", "no \"=\""),
            ("1,2,3,4=-1m", "after"),
            ("1,2,3,4=1lightyear", "after"),
        ] {
            let error = wrong.parse::<Ruler>().expect_err(wrong);
            assert!(error.contains(problem), "{error}");
        }
        for large in ["1e13", "nan", "-inf"] {
            let ruler = format!("1,2,3,4={large}").parse::<Ruler>();
            assert!(clock(large).is_err() && parse_angle(large).is_err() && ruler.is_err(), "{large}");
            assert!(parse_point(&format!("1,{large}")).is_err(), "{large}");
        }
        assert!(clock("1e-13").is_err() && clock("1e-12").is_ok());
        assert!(clock("0").is_err() && clock("30+-x").is_err() && parse_point("1").is_err());
    }

    #[test]
    fn a_later_measurement_reads_the_rate_of_an_earlier_one() {
        let folder = tempfile::tempdir().expect("a folder");
        let track = folder.path().join("track.csv");
        assert_eq!(Earlier::beside(&track).expect("no file"), Earlier::default());
        let read = |text: &str| {
            std::fs::write(folder.path().join("fits.json"), text).expect("a file");
            Earlier::beside(&track).map(|it| it.fps).map_err(|e| e.to_string())
        };
        assert_eq!(read(r#"{"fps": {"rate": 240.0, "error": 0.5}}"#), Ok(Some(Clock { rate: 240.0, error: 0.5 })));
        assert_eq!(read(r#"{"fps": null, "fits": []}"#), Ok(None));
        for wrong in ["[", r#"{"fps": 25}"#, r#"{"fps": {"rate": 0.0, "error": 0.0}}"#] {
            assert!(read(wrong).is_err_and(|e| e.contains("fits.json") && e.contains("--fps")), "{wrong}");
        }
    }
}
