//! VOT's regions in text: rectangles and polygons as boxes. Pixels count from 0, in the files and in memory.

use std::path::Path;

use crate::annotation::{LARGEST, at_line, lines, read_text, shortened};
use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;

/// The box of a region: a rectangle `x,y,w,h`, or the axis-aligned box about a polygon `x,y,x,y,x,y,...`, as vot-toolkit converts it
/// (from the least to the largest coordinate). `None` for a code (one number) and where a number is NaN: no box there.
///
/// # Errors
/// In words, where it is none of these; masks are not read.
pub fn parse_region(text: &str) -> std::result::Result<Option<BBox>, String> {
    let wrong = || format!("expected a rectangle x,y,w,h or a polygon x,y,x,y,x,y,..., found \"{}\"", shortened(text));
    if text.trim_start().starts_with('m') {
        return Err(format!("{}: masks are not read", wrong()));
    }
    let numbers: std::result::Result<Vec<f64>, _> = text.split(',').map(|word| word.trim().parse::<f64>()).collect();
    let numbers = numbers.map_err(|_| wrong())?;
    if let Some(bad) = numbers.iter().find(|n| n.abs() > LARGEST) {
        return Err(format!("{bad} is no number of pixels"));
    }
    let absent = numbers.iter().any(|n| n.is_nan());
    match numbers[..] {
        [_] => Ok(None),
        [x, y, w, h] => Ok((!absent).then_some(BBox { x, y, w, h })),
        [_, _, _, _, _, _, ..] if numbers.len().is_multiple_of(2) => {
            let ends = |from: usize| {
                let values = || numbers.iter().skip(from).step_by(2).copied();
                (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
            };
            let ((left, right), (top, bottom)) = (ends(0), ends(1));
            Ok((!absent).then_some(BBox { x: left, y: top, w: right - left, h: bottom - top }))
        }
        _ => Err(wrong()),
    }
}

/// The boxes of a `groundtruth.txt`, a region a line; `None` where there is none, or it has no area.
///
/// # Errors
/// The file cannot be read, a line is no region (the error names it), or no frame has a box.
pub fn read_truth(path: impl AsRef<Path>) -> Result<Vec<Option<BBox>>> {
    let path = path.as_ref();
    let boxes = parse_truth(&read_text(path)?, path)?;
    if boxes.iter().all(Option::is_none) {
        return Err(Error::malformed(path, "no frame has a box; expected a rectangle or polygon a line"));
    }
    Ok(boxes)
}

/// The boxes of a text; `path` is for the errors, which name the line.
pub fn parse_truth(text: &str, path: &Path) -> Result<Vec<Option<BBox>>> {
    let parse = |(number, line): (usize, &str)| {
        // A blank line is a frame without a region, as in the other formats.
        let region = if line.is_empty() { Ok(None) } else { parse_region(line) };
        let region = region.map_err(|problem| at_line(path, number, &problem))?;
        Ok(region.filter(|b| b.w > 0.0 && b.h > 0.0))
    };
    lines(text).map(parse).collect()
}

/// The text of boxes: `x,y,w,h` a line, `nan,nan,nan,nan` where there is none.
pub fn format_truth(truth: &[Option<BBox>]) -> String {
    let line =
        |b: &Option<BBox>| b.map_or("nan,nan,nan,nan\n".into(), |BBox { x, y, w, h }| format!("{x},{y},{w},{h}\n"));
    truth.iter().map(line).collect()
}

/// Whether a folder with a `groundtruth.txt` is a sequence of VOT, not of GOT-10k: it has a file `sequence`, a folder `color`, or
/// regions of other than four numbers.
pub fn is_sequence(folder: &Path) -> bool {
    let regions = || {
        let text = read_text(&folder.join("groundtruth.txt")).unwrap_or_default();
        let mut filled = lines(&text).map(|(_, line)| line).filter(|line| !line.is_empty());
        filled.next().is_some_and(|line| line.starts_with('m') || line.split(',').count() > 4)
    };
    folder.join("sequence").is_file() || folder.join("color").is_dir() || regions()
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::{Purpose, Streams};
    use rand::RngExt;

    #[test]
    fn regions_are_boxes() {
        let b = |x, y, w, h| Some(BBox { x, y, w, h });
        assert_eq!(parse_region("1.5,2, 3,4"), Ok(b(1.5, 2.0, 3.0, 4.0)));
        assert_eq!(parse_region("10,0,20,10,10,20,0,10"), Ok(b(0.0, 0.0, 20.0, 20.0)));
        for text in ["0", "nan,nan,nan,nan", "1,2,NaN,4", "1,2,3,4,5,nan"] {
            assert_eq!(parse_region(text), Ok(None), "{text}");
        }
        for text in ["", "1,2", "1,2,3", "1,2,3,4,5", "1,2,3,4,5,6,7", "m0,0,3,3,9", "a,b,c,d"] {
            assert!(parse_region(text).expect_err(text).contains("expected a rectangle"), "{text}");
        }
        assert!(parse_region("1,2,inf,4").expect_err("too large").contains("no number of pixels"));
        let truth = vec![b(1.0, 2.0, 3.0, 4.5), None];
        let text = format_truth(&truth);
        assert_eq!(
            (text.as_str(), parse_truth(&text, Path::new("a")).expect("own")),
            ("1,2,3,4.5\nnan,nan,nan,nan\n", truth)
        );
        let problem = parse_truth("1,2,3,4\nx\n", Path::new("groundtruth.txt")).expect_err("a word").to_string();
        assert!(problem.contains("groundtruth.txt: line 2: expected a rectangle"), "{problem}");
    }

    #[test]
    fn no_text_panics() {
        let parts = ["1", "-2.5", "nan", "inf", ",", ",", ",", " ", "\n", "m", "1e9", "é", "-", "."];
        for trial in 0..20_000 {
            let mut rng = Streams::new(1, 0).at(trial, Purpose::Scene).rng(0);
            let text: String = (0..rng.random_range(0..30)).map(|_| parts[rng.random_range(0..parts.len())]).collect();
            if let Ok(boxes) = parse_truth(&text, Path::new("a")) {
                assert!(boxes.iter().flatten().all(|b| b.check().is_ok()), "{text:?}");
            }
        }
    }
}
