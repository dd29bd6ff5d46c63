//! VOT's regions in text: rectangles, polygons and masks as boxes. Pixels count from 0, in the files and in memory.

use std::path::Path;

use crate::annotation::{LARGEST, lines, parse_lines, shortened};
use foveate_base::{Error, Result, files};
use foveate_core::geometry::BBox;

/// Width and height of a mask may be this at most, in pixels.
const WIDEST: u64 = 65_535;

/// The box of a region: a rectangle `x,y,w,h`, the axis-aligned box about a polygon `x,y,x,y,x,y,...`, as vot-toolkit
/// converts it (from the least to the largest coordinate), or the box about the pixels of a mask (`m` in files,
/// `mask:` in TraX). `None`, which is no box, for a code (one number), a NaN, and an empty mask.
///
/// # Errors
/// A text if it is none of these.
pub fn parse_region(text: &str) -> std::result::Result<Option<BBox>, String> {
    let word = text.trim_start();
    if let Some(runs) = word.strip_prefix("mask:").or_else(|| word.strip_prefix('m')) {
        return mask(runs).map_err(|problem| format!("{problem}, found \"{}\"", shortened(text)));
    }
    let wrong = || {
        format!(
            "expected a rectangle x,y,w,h, a polygon x,y,x,y,x,y,... or a mask m x,y,w,h,run,run,..., found \"{}\"",
            shortened(text)
        )
    };
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

/// The box about the pixels of a mask `x,y,w,h,run,run,...`. The runs are numbers of pixels, row by row in the
/// rectangle, alternately outside and inside the target; pixels after the last run are outside. `None` for an empty
/// mask.
///
/// A mask of one pixel has a box of 1 x 1. No picture is made of it, so that a large one costs nothing.
fn mask(text: &str) -> std::result::Result<Option<BBox>, String> {
    let wrong = || "expected a mask m x,y,w,h,run,run,... of whole numbers".to_owned();
    let numbers: std::result::Result<Vec<i64>, _> = text.split(',').map(|word| word.trim().parse::<i64>()).collect();
    let numbers = numbers.map_err(|_| wrong())?;
    let [x, y, w, h, runs @ ..] = &numbers[..] else { return Err(wrong()) };
    if let Some(bad) = [x, y].into_iter().find(|n| n.unsigned_abs() as f64 > LARGEST) {
        return Err(format!("{bad} is no number of pixels"));
    }
    let size = |n: &i64| u64::try_from(*n).ok().filter(|n| *n <= WIDEST);
    let (Some(w), Some(h)) = (size(w), size(h)) else {
        return Err(format!("expected a mask of at most {WIDEST} x {WIDEST} pixels"));
    };
    // The ends of the box, in pixels of the rectangle: left, top, right, bottom.
    let (mut at, mut ends) = (0u64, None::<[u64; 4]>);
    for (i, run) in runs.iter().enumerate() {
        let from = at;
        at = u64::try_from(*run).ok().and_then(|run| from.checked_add(run)).filter(|at| *at <= w * h).ok_or_else(
            || format!("expected runs of together at most {w} x {h} pixels: run {} ({run}) goes beyond", i + 1),
        )?;
        if i % 2 == 0 || at == from {
            continue;
        }
        let (top, bottom) = (from / w, (at - 1) / w);
        // A run that continues in the next row has the last pixel of a row and the first of another.
        let (left, right) = if top == bottom { (from % w, (at - 1) % w) } else { (0, w - 1) };
        ends = Some(match ends {
            None => [left, top, right, bottom],
            Some([a, b, c, d]) => [a.min(left), b.min(top), c.max(right), d.max(bottom)],
        });
    }
    let corner = |from: &i64, to: u64| *from as f64 + to as f64;
    Ok(ends.map(|[left, top, right, bottom]| BBox {
        x: corner(x, left),
        y: corner(y, top),
        w: (right - left + 1) as f64,
        h: (bottom - top + 1) as f64,
    }))
}

/// The boxes of a `groundtruth.txt`, one region a line; `None` for frames without a box or area.
///
/// # Errors
/// The file cannot be read, a line is no region (the error names it), or no frame has a box.
pub fn read_truth(path: impl AsRef<Path>) -> Result<Vec<Option<BBox>>> {
    let path = path.as_ref();
    let boxes = parse_truth(&files::read_text(path, files::TEXT)?, path)?;
    if boxes.iter().all(Option::is_none) {
        return Err(Error::malformed(path, "no frame has a box; expected a rectangle or polygon a line"));
    }
    Ok(boxes)
}

/// The boxes of a text; `path` is for the errors, which name the line.
pub fn parse_truth(text: &str, path: &Path) -> Result<Vec<Option<BBox>>> {
    parse_lines(text, path, |line| {
        // A blank line is a frame without a region, as in the other formats.
        let region = if line.is_empty() { None } else { parse_region(line)? };
        Ok(region.filter(|b| b.w > 0.0 && b.h > 0.0))
    })
}

/// The text of boxes: `x,y,w,h` a line, `nan,nan,nan,nan` for a frame without a box.
pub fn format_truth(truth: &[Option<BBox>]) -> String {
    let line =
        |b: &Option<BBox>| b.map_or("nan,nan,nan,nan\n".into(), |BBox { x, y, w, h }| format!("{x},{y},{w},{h}\n"));
    truth.iter().map(line).collect()
}

/// Whether a folder with a `groundtruth.txt` is a sequence of VOT, not of GOT-10k: it has a file `sequence`, a folder `color`, or
/// regions of other than four numbers.
pub fn is_sequence(folder: &Path) -> bool {
    let regions = || {
        let text = files::read_text(folder.join("groundtruth.txt"), files::TEXT).unwrap_or_default();
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
        for text in ["", "1,2", "1,2,3", "1,2,3,4,5", "1,2,3,4,5,6,7", "a,b,c,d"] {
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

    /// Runs as vot-toolkit and vot-trax write them, beside the pixels.
    #[test]
    fn a_masks_box_is_about_its_pixels() {
        let mut rng = Streams::new(1, 0).at(0, Purpose::Scene).rng(0);
        for trial in 0..2000 {
            let (w, h) = (rng.random_range(1..7usize), rng.random_range(1..7usize));
            let (x, y) = (rng.random_range(-5..20i32), rng.random_range(-5..20i32));
            let full = rng.random_range(0..4);
            let pixels: Vec<bool> = (0..w * h).map(|_| rng.random_range(0..4) < full).collect();
            let mut runs = vec![0usize];
            let mut last = false;
            for pixel in &pixels {
                if *pixel != last {
                    runs.push(0);
                }
                last = *pixel;
                *runs.last_mut().expect("one at least") += 1;
            }
            if !last && trial % 2 == 0 {
                runs.pop(); // as vot-trax leaves the last zeros out
            }
            if trial % 3 == 0 && runs.len() > 1 && runs[1] > 1 {
                runs.splice(1..2, [1, 0, runs[1] - 1]); // as vot-toolkit divides long runs
            }
            let words: Vec<String> = runs.iter().map(ToString::to_string).collect();
            let head = ["m", "mask:"][trial % 2];
            let text = [format!("{head}{x},{y},{w},{h}")].into_iter().chain(words).collect::<Vec<_>>().join(",");
            let there = |i: usize| (i % w, i / w);
            let of: Vec<(usize, usize)> = (0..w * h).filter(|i| pixels[*i]).map(there).collect();
            let ends = |value: &dyn Fn(&(usize, usize)) -> usize| {
                let values = || of.iter().map(value);
                Some((values().min()?, values().max()?))
            };
            let expected = ends(&|p| p.0).zip(ends(&|p| p.1)).map(|((left, right), (top, bottom))| BBox {
                x: f64::from(x) + left as f64,
                y: f64::from(y) + top as f64,
                w: (right - left + 1) as f64,
                h: (bottom - top + 1) as f64,
            });
            assert_eq!(parse_region(&text), Ok(expected), "{text}");
        }
    }

    #[test]
    fn invalid_masks_are_errors() {
        assert_eq!(parse_region("m0,0,0,0,0"), Ok(None), "as vot-toolkit writes an empty one");
        assert_eq!(parse_region("m0,0,65535,65535,0,4294836225").expect("the largest").map(|b| b.w), Some(65535.0));
        for (text, said) in [
            ("m", "of whole numbers, found \"m\""),
            ("m1,2,3", "of whole numbers"),
            ("m0,0,2,2,0.5,1", "of whole numbers"),
            ("m0,0,65536,2,0,1", "at most 65535 x 65535 pixels"),
            ("mask:0,0,-1,2,0,1", "at most 65535 x 65535 pixels"),
            ("m0,0,3,3,0,10", "run 2 (10) goes beyond"),
            ("m0,0,3,3,-1,1", "run 1 (-1) goes beyond"),
            ("m0,0,3,3,1,9223372036854775807", "goes beyond"),
            ("m9000000000,0,3,3,0,9", "is no number of pixels"),
        ] {
            let problem = parse_region(text).expect_err(text);
            assert!(problem.contains(said), "{text}: {problem}");
        }
    }

    #[test]
    fn no_text_panics() {
        let parts =
            ["m1,2,3,4,", "mask:", "1", "-2.5", "nan", "inf", ",", ",", ",", " ", "\n", "m", "1e9", "é", "-", "."];
        for trial in 0..20_000 {
            let mut rng = Streams::new(1, 0).at(trial, Purpose::Scene).rng(0);
            let text: String = (0..rng.random_range(0..30)).map(|_| parts[rng.random_range(0..parts.len())]).collect();
            if let Ok(boxes) = parse_truth(&text, Path::new("a")) {
                assert!(boxes.iter().flatten().all(|b| b.check().is_ok()), "{text:?}");
            }
        }
    }
}
