//! Boxes in text files: ground truth of OTB, GOT-10k and LaSOT, and trackers' results.
//!
//! One frame a line, `x,y,w,h` in pixels, separated by comma, semicolon, tab or space. A blank line before the last
//! one, or a line with NaN, is a frame without a box. In the files the first pixel is (1, 1); a [`BBox`] counts from
//! 0.

use std::path::Path;

use foveate_base::{Error, Result, files, memory};
use foveate_core::geometry::BBox;

/// Numbers beyond this are damage, not pixels.
pub(super) const LARGEST: f64 = 1e7;

/// The boxes of a file, 0-based; `None` for frames without a box.
///
/// Errors: the file cannot be read, or a line is neither four numbers nor NaN; the error names the line.
pub fn read_boxes(path: impl AsRef<Path>) -> Result<Vec<Option<BBox>>> {
    let path = path.as_ref();
    parse_boxes(&files::read_text(path, files::TEXT)?, path)
}

/// The boxes of a target, 0-based: as [`read_boxes`], but a box without area is no box. Fails if no frame has one.
pub fn read_truth(path: impl AsRef<Path>) -> Result<Vec<Option<BBox>>> {
    let path = path.as_ref();
    let mut boxes = read_boxes(path)?;
    boxes.iter_mut().for_each(|b| *b = b.filter(|b| b.w > 0.0 && b.h > 0.0));
    if boxes.iter().all(Option::is_none) {
        return Err(Error::malformed(path, "no frame has a box; expected a line x,y,w,h for each frame"));
    }
    Ok(boxes)
}

/// The boxes of a text, 0-based; `path` is for the errors, which are those of [`read_boxes`].
pub fn parse_boxes(text: &str, path: &Path) -> Result<Vec<Option<BBox>>> {
    parse_lines(text, path, parse_box)
}

/// A box of each line, as `parse` finds it; `path` is for the errors. A blank line takes one byte of the text, and a box here.
pub(super) fn parse_lines(
    text: &str,
    path: &Path,
    parse: impl Fn(&str) -> std::result::Result<Option<BBox>, String>,
) -> Result<Vec<Option<BBox>>> {
    let count = lines(text).count();
    memory::check(format_args!("{}: {count} lines", path.display()), (count * size_of::<Option<BBox>>()) as u64)?;
    let mut boxes = Vec::with_capacity(count);
    for (number, line) in lines(text) {
        boxes.push(parse(line).map_err(|problem| at_line(path, number, &problem))?);
    }
    Ok(boxes)
}

/// One number a line: seconds a frame, or labels. Blank lines do not count.
///
/// Errors: the file cannot be read, or a line is not a finite number.
pub fn read_numbers(path: impl AsRef<Path>) -> Result<Vec<f64>> {
    numbers(path.as_ref(), &[])
}

/// Numbers of a file, a line each or with these characters between those of a line.
fn numbers(path: &Path, between: &[char]) -> Result<Vec<f64>> {
    let text = files::read_text(path, files::TEXT)?;
    let words = lines(&text).flat_map(|(number, line)| line.split(between).map(move |word| (number, word.trim())));
    let parsed = words.filter(|(_, word)| !word.is_empty()).map(|(number, word)| match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(at_line(path, number, &format!("expected one number, found {:?}", shortened(word)))),
    });
    parsed.collect()
}

/// GOT-10k's file of labels beside its boxes: not 0 if the target is absent.
pub const ABSENCE: &str = "absence.label";

/// All such files: GOT-10k's, a label a line, and LaSOT's two, with commas between labels.
const LABELS: [&str; 3] = [ABSENCE, "full_occlusion.txt", "out_of_view.txt"];

/// Removes the boxes of frames in which the target is absent according to the labels of GOT-10k or LaSOT in this
/// folder, if any.
///
/// Errors: a file cannot be read, a label is not a finite number, or there is not a label for each frame.
pub fn hide_absent(truth: &mut [Option<BBox>], folder: &Path) -> Result<()> {
    for labels in LABELS.map(|name| folder.join(name)).iter().filter(|labels| labels.is_file()) {
        let absent = numbers(labels, &[','])?;
        if absent.len() != truth.len() {
            let problem = format!("expected a label for each of {} boxes, found {}", truth.len(), absent.len());
            return Err(Error::malformed(labels, problem));
        }
        truth.iter_mut().zip(absent).filter(|(_, absent)| *absent != 0.0).for_each(|(bbox, _)| *bbox = None);
    }
    Ok(())
}

/// The text of boxes: one line `x,y,w,h` each, 1-based.
pub fn format_boxes(boxes: &[BBox]) -> String {
    boxes.iter().map(|b| format!("{},{},{},{}\n", b.x + 1.0, b.y + 1.0, b.w, b.h)).collect()
}

/// The same of boxes that may be absent: `NaN,NaN,NaN,NaN` then.
pub fn format_truth(truth: &[Option<BBox>]) -> String {
    let line = |b: &Option<BBox>| b.map_or("NaN,NaN,NaN,NaN\n".into(), |b| format_boxes(&[b]));
    truth.iter().map(line).collect()
}

/// Lines without the blank ones at the end, trimmed, counted from 1. The text may come from a caller, with a byte order mark.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let text = text.trim_start_matches('\u{feff}').trim_end();
    text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()))
}

fn parse_box(line: &str) -> std::result::Result<Option<BBox>, String> {
    let mut values = [0.0; 4];
    let mut count = 0;
    let mut absent = line.is_empty();
    for word in line.split([',', ';', '\t', ' ']).filter(|word| !word.is_empty()) {
        let value: f64 = word.parse().map_err(|_| format!("{:?} is not a number", shortened(word)))?;
        absent |= value.is_nan();
        if value.abs() > LARGEST {
            return Err(format!("{value} is no number of pixels"));
        }
        if let Some(place) = values.get_mut(count) {
            *place = value;
        }
        count += 1;
    }
    if absent && count <= 4 {
        return Ok(None);
    }
    if count != 4 {
        return Err(format!("expected x,y,w,h or NaN, found {count} numbers"));
    }
    let [x, y, w, h] = values;
    Ok(Some(BBox::counted_from_1(x, y, w, h)))
}

pub(super) fn shortened(text: &str) -> String {
    text.chars().take(40).collect()
}

pub(super) fn at_line(path: &Path, number: usize, problem: &str) -> Error {
    Error::malformed(path, format!("line {number}: {problem}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::{Purpose, Streams};
    use foveate_testing::{data, need};
    use rand::RngExt;

    fn parse(text: &str) -> Result<Vec<Option<BBox>>> {
        parse_boxes(text, Path::new("truth.txt"))
    }

    #[test]
    fn every_way_to_write_boxes_is_read() {
        let b = |x, y, w, h| Some(BBox { x, y, w, h });
        let wanted = vec![b(0.0, 1.0, 3.0, 4.5), None, b(-6.0, 9.0, 1.0, 0.0)];
        for text in [
            "1,2,3,4.5\nNaN,NaN,NaN,NaN\n-5,10,1,0\n",
            "1\t2\t3\t4.5\r\nnan\r\n-5\t10\t1\t0",
            "\u{feff}1 2  3 4.5 \n\n -5, 10, 1, 0\n\n \n",
            "1;2;3;4.5\n1,nan,3,4\n-5.0,1e1,1,0",
        ] {
            assert_eq!(parse(text).expect(text), wanted, "{text:?}");
        }
        assert_eq!(parse("").expect("an empty text has no frames"), vec![]);
        let text = format_boxes(&[b(0.0, 1.5, 28.0, 28.0).expect("a box")]);
        assert_eq!((text.as_str(), parse(&text).expect("own text")[0]), ("1,2.5,28,28\n", b(0.0, 1.5, 28.0, 28.0)));
    }

    #[test]
    fn errors_name_file_and_line() {
        for (text, said) in [
            ("1,2,3,4\n1,2,3\n", "truth.txt: line 2: expected x,y,w,h or NaN, found 3 numbers"),
            ("1,2,3,4,5", "line 1: expected x,y,w,h or NaN, found 5"),
            ("1,2,3,four", "line 1: \"four\" is not a number"),
            ("\n\n1e300,2,3,4", "line 3: 1000"),
            ("1,2,inf,4", "line 1: inf is no number of pixels"),
        ] {
            let problem = parse(text).expect_err(text).to_string();
            assert!(problem.contains(said), "{problem}");
        }
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("groundtruth_rect.txt");
        for (bytes, said) in
            [(&b"NaN\n0,0,0,0\n"[..], "no frame has a box"), (b"1,2,3,4\n\xff\xfe\n", "line 2: not UTF-8 text")]
        {
            std::fs::write(&path, bytes).expect("written");
            let problem = read_truth(&path).expect_err(said).to_string();
            assert!(problem.contains(said) && problem.contains("groundtruth_rect.txt"), "{problem}");
        }
        assert!(read_truth(dir.path().join("none.txt")).expect_err("no file").to_string().contains("none.txt"));
        std::fs::write(&path, "0.5\n\n0.25\n").expect("written");
        assert_eq!(read_numbers(&path).expect("numbers"), [0.5, 0.25]);
        std::fs::write(&path, "0.5\nfast\n").expect("written");
        assert!(read_numbers(&path).expect_err("a word").to_string().contains("line 2"));
    }

    #[test]
    fn no_text_panics() {
        // 20,000 texts of random fragments, seed 1: anything but a panic is right.
        let parts =
            ["1", "-2.5", "NaN", "inf", ",", ";", "\t", " ", "\n", "\r\n", "1e9", "é", "\u{feff}", "-", ".", "0"];
        for trial in 0..20_000 {
            let mut rng = Streams::new(1, 0).at(trial, Purpose::Scene).rng(0);
            let text: String = (0..rng.random_range(0..30)).map(|_| parts[rng.random_range(0..parts.len())]).collect();
            if let Ok(boxes) = parse(&text) {
                assert!(boxes.iter().flatten().all(|b| [b.x, b.y, b.w, b.h].iter().all(|v| v.is_finite())), "{text:?}");
            }
        }
    }

    #[test]
    fn the_tracking_data_is_read() {
        let truth = need!(data("tracking/Jogging/groundtruth_rect.txt"));
        let boxes = read_truth(truth).expect("boxes");
        assert!(boxes.len() == 307 && boxes.iter().all(Option::is_some));
    }
}
