//! The positions of a target, from a run or from its track.csv.

use std::path::Path;

use foveate_base::{Error, Result, files};
use foveate_core::Seen;
use foveate_video::Frame;

/// One frame of a track.
#[derive(Clone, Debug, PartialEq)]
pub struct Position {
    /// From 1.
    pub frame: usize,
    /// In the source, seconds.
    pub time: f64,
    /// Centre, pixels from 0.
    pub centre: (f64, f64),
    /// Covariance of the centre (xx, xy, yy), px²; `None` if the box was given.
    pub covariance: Option<[f64; 3]>,
    /// Probability that the target is lost, 0 to 1.
    pub p_lost: f64,
    /// Track status.
    pub status: String,
    /// Whether the position is a result.
    pub usable: bool,
}

/// The track of a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Its name in the results.
    pub name: String,
    /// One position per frame.
    pub positions: Vec<Position>,
}

impl Position {
    /// Returns the position of a target in a frame.
    pub fn of(frame: &Frame, seen: &Seen<'_>) -> Self {
        Self {
            frame: frame.index + 1,
            time: frame.time,
            centre: (seen.state.x, seen.state.y),
            covariance: seen.centre_covariance(),
            p_lost: seen.p_lost,
            status: if seen.is_given() { "given" } else { seen.status.name() }.to_owned(),
            usable: seen.is_usable(),
        }
    }
}

/// The largest number of a frame.
const LAST: f64 = 1e9;
/// The largest number of a track: squares of larger ones, summed up, would not be numbers.
const MOST: f64 = 1e12;

/// Reads the track.csv of a run.
///
/// # Errors
/// The file cannot be read, a column is missing, or a cell is not a number.
pub fn read(path: &Path) -> Result<Vec<Position>> {
    parse(&files::read_text(path, files::TEXT)?, path)
}

/// Reads the text of a track.csv. `path` is its name in errors.
///
/// # Errors
/// A column is missing, a cell is not a number, or frames do not increase.
pub fn parse(text: &str, path: &Path) -> Result<Vec<Position>> {
    const NAMES: [&str; 10] =
        ["frame", "time", "x", "y", "cov_x_x", "cov_x_y", "cov_y_y", "p_lost", "status", "usable"];
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let column = |name: &&str| {
        let found = header.iter().position(|head| head == name);
        found.ok_or_else(|| Error::malformed(path, format!("it has no column {name}; give the track.csv of a run")))
    };
    // These columns precede the class, the only text that may contain a comma.
    let columns = NAMES.iter().map(column).collect::<Result<Vec<_>>>()?;
    let mut track: Vec<Position> = vec![];
    for (k, line) in lines.enumerate() {
        let cells: Vec<&str> = line.split(',').collect();
        let cell = |i: usize| cells.get(columns[i]).copied().unwrap_or_default();
        let number = |i: usize| {
            let value = cell(i).parse::<f64>().ok().filter(|value| value.abs() <= MOST);
            let problem =
                || format!("line {}: {} is \"{}\"; expected a number up to {MOST:e}", k + 2, NAMES[i], cell(i));
            value.ok_or_else(|| Error::malformed(path, problem()))
        };
        let given = cell(4).is_empty();
        let (frame, last) = (number(0)?, track.last().map_or(0, |position| position.frame));
        if !(frame > last as f64 && frame.fract() == 0.0 && frame <= LAST) {
            let problem = format!("line {}: frame is {frame} after {last}; expected a later one", k + 2);
            return Err(Error::malformed(path, problem));
        }
        track.push(Position {
            frame: frame as usize,
            time: number(1)?,
            centre: (number(2)?, number(3)?),
            covariance: if given { None } else { Some([number(4)?, number(5)?, number(6)?]) },
            p_lost: if given { 0.0 } else { number(7)? },
            status: if given { "given" } else { cell(8) }.to_owned(),
            usable: given || cell(9) == "1",
        });
    }
    Ok(track)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::geometry::BBox;
    use foveate_core::scene::Image;
    use foveate_report::{Observer, Table};

    #[test]
    fn a_table_reads_back_as_the_run() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("track.csv");
        let mut table = Table::create(&path).expect("writable");
        let given = Seen::given([40, 30, 1], &BBox::new(4.0, 6.0, 10.0, 12.0));
        let frame = Frame { index: 2, time: 0.1, image: Image::grey(40, 30, 0) };
        table.observe(&frame, &[given]).expect("written");
        table.finish().expect("written");
        assert_eq!(read(&path).expect("a track"), [Position::of(&frame, &given)]);
        std::fs::write(&path, "frame,time\n1,0\n").expect("written");
        assert!(read(&path).expect_err("columns").to_string().contains("no column x"));
        let of = |frames: [i32; 2]| {
            let lines = frames.map(|frame| format!("{frame},0,1,1,,,,,given,1\n")).concat();
            parse(&format!("frame,time,x,y,cov_x_x,cov_x_y,cov_y_y,p_lost,status,usable\n{lines}"), &path)
        };
        assert!(of([1, 3]).is_ok_and(|track| track[1].frame == 3));
        for wrong in [[0, 1], [-1, 1], [2, 2], [2, 1]] {
            assert!(of(wrong).expect_err("frames").to_string().contains("expected a later one"), "{wrong:?}");
        }
    }
}
