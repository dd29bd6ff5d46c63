//! Tracks of many targets in text files, as MOTChallenge has them: truth, results, and detections.
//!
//! One box a line, in any order: `frame,id,x,y,w,h,conf,...`, separated by comma, semicolon, tab or space. Frames and
//! pixels count from 1 in the files, from 0 in memory. Confidence is optional (1); later fields (class and
//! visibility, or world coordinates) are skipped. Detections have the id −1.

use std::path::Path;

use crate::annotation::{LARGEST, at_line, lines, shortened};
use foveate_base::{Error, Result, files};
use foveate_core::geometry::BBox;

/// Frame numbers beyond this are damage, and ids are not whole.
const LAST_FRAME: f64 = 1e9;
const LARGEST_ID: f64 = (1_u64 << 53) as f64;

/// One box in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackBox {
    /// The frame, from 0.
    pub frame: usize,
    /// The id, from 0; negative: unknown (a detection).
    pub id: i64,
    /// Where, 0-based; sizes may be 0.
    pub bbox: BBox,
    /// In truth: whether it counts (0: it does not). Else how sure its maker was.
    pub confidence: f64,
}

/// The boxes of many targets in a video.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracks {
    /// The boxes, in the order of the file.
    pub sightings: Vec<TrackBox>,
}

impl Tracks {
    /// Reads a file; an empty one has no boxes.
    ///
    /// # Errors
    /// The file cannot be read, or a line does not have this format; the error names the line.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        Self::parse(&files::read_text(path, files::TEXT)?, path)
    }

    /// The tracks of a text; `path` is for the errors, which are those of [`Tracks::read`]. Blank lines do not count.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let filled = lines(text).filter(|(_, line)| !line.is_empty());
        let parsed = filled.map(|(number, line)| parse_line(line).map_err(|problem| at_line(path, number, &problem)));
        Ok(Self { sightings: parsed.collect::<Result<_>>()? })
    }

    /// The text that [`Tracks::parse`] reads: `frame,id,x,y,w,h,conf,-1,-1,-1` a line, by frame.
    pub fn text(&self) -> String {
        let mut sorted: Vec<_> = self.sightings.iter().collect();
        sorted.sort_by_key(|s| s.frame);
        let line = |s: &TrackBox| {
            let BBox { x, y, w, h } = s.bbox;
            let (frame, x, y) = (s.frame as u64 + 1, x + 1.0, y + 1.0);
            format!("{frame},{},{x},{y},{w},{h},{},-1,-1,-1\n", s.id, s.confidence)
        };
        sorted.into_iter().map(line).collect()
    }

    /// Writes [`Tracks::text`] to a file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        files::write(path, self.text().as_bytes())
    }

    /// Frames up to the last one with a box.
    pub fn frames(&self) -> usize {
        self.sightings.iter().map(|s| s.frame + 1).max().unwrap_or(0)
    }
}

/// The number of frames in a sequence's `seqinfo.ini` (`seqLength`); `None` without this file.
///
/// # Errors
/// The file cannot be read or has no `seqLength` that is a whole number.
pub fn sequence_length(folder: &Path) -> Result<Option<usize>> {
    let path = folder.join("seqinfo.ini");
    if !path.is_file() {
        return Ok(None);
    }
    let text = files::read_text(&path, files::TEXT)?;
    let value = |line: &str| {
        let (key, value) = line.split_once('=')?;
        key.trim().eq_ignore_ascii_case("seqLength").then(|| value.trim().to_string())
    };
    let Some((number, value)) = lines(&text).find_map(|(number, line)| Some((number, value(line)?))) else {
        return Err(Error::malformed(path, "has no line seqLength=FRAMES"));
    };
    match value.parse::<u32>() {
        Ok(frames) => Ok(Some(frames as usize)),
        Err(_) => Err(at_line(&path, number, &format!("expected a number of frames, found {:?}", shortened(&value)))),
    }
}

fn parse_line(line: &str) -> std::result::Result<TrackBox, String> {
    let mut values: [f64; 7] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let mut count = 0;
    let words = line.split([',', ';', '\t', ' ']).filter(|word| !word.is_empty());
    for (place, word) in values.iter_mut().zip(words) {
        *place = word.parse().map_err(|_| format!("{:?} is not a number", shortened(word)))?;
        count += 1;
    }
    if count < 6 {
        return Err(format!("expected frame,id,x,y,w,h,conf, found {count} numbers"));
    }
    let [frame, id, x, y, w, h, confidence] = values;
    for (name, value, most) in [("frame", frame, LAST_FRAME), ("id", id, LARGEST_ID)] {
        if value.fract() != 0.0 || value.abs() > most || value.is_nan() {
            return Err(format!("{name} {value} is not a whole number up to {most}"));
        }
    }
    if frame < 1.0 {
        return Err(format!("frame {frame}: frames count from 1"));
    }
    if let Some(bad) = [x, y, w, h].into_iter().find(|v| v.is_nan() || v.abs() > LARGEST) {
        return Err(format!("{bad} is no number of pixels"));
    }
    if w < 0.0 || h < 0.0 {
        return Err(format!("a box cannot be {w} x {h} pixels"));
    }
    if !confidence.is_finite() {
        return Err(format!("confidence {confidence} is not a finite number"));
    }
    let bbox = BBox::counted_from_1(x, y, w, h);
    Ok(TrackBox { frame: frame as usize - 1, id: id as i64, bbox, confidence })
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::{Purpose, Streams};
    use rand::RngExt;

    fn parse(text: &str) -> Result<Tracks> {
        Tracks::parse(text, Path::new("gt.txt"))
    }

    #[test]
    fn every_way_to_write_tracks_is_read() {
        let s = |frame, id, x, confidence| TrackBox { frame, id, bbox: BBox { x, y: 9.5, w: 3.0, h: 0.0 }, confidence };
        let wanted = vec![s(1, 7, 0.0, 1.0), s(0, -1, -4.0, 0.25)];
        for text in [
            "2,7,1,10.5,3,0\n1,-1,-3,10.5,3,0,0.25\n",
            "\u{feff}2 7 1 10.5 3 0 1 -1 -1 -1 \r\n\r\n1\t-1\t-3\t10.5\t3\t0\t.25",
            "2.0,7e0, 1, 10.5, 3, 0, 1, pedestrian, 0.5\n1;-1;-3;10.5;3;0;0.25;9\n\n",
        ] {
            assert_eq!(parse(text).expect(text).sightings, wanted, "{text:?}");
        }
        let tracks = Tracks { sightings: wanted };
        let text = "1,-1,-3,10.5,3,0,0.25,-1,-1,-1\n2,7,1,10.5,3,0,1,-1,-1,-1\n";
        assert_eq!((tracks.text().as_str(), tracks.frames()), (text, 2));
        let dir = tempfile::tempdir().expect("a temporary folder");
        tracks.write(dir.path().join("a.txt")).expect("written");
        assert_eq!(Tracks::read(dir.path().join("a.txt")).expect("own file").text(), text);
        assert_eq!(parse("").expect("no boxes"), Tracks::default());
        let large = parse("1,9007199254740992,1,1,1,1").expect("the largest id");
        assert_eq!(large.sightings[0].id, 1 << 53);
    }

    #[test]
    fn errors_name_file_and_line() {
        for (text, said) in [
            ("1,1,1,1,1,1\n1,2,3\n", "gt.txt: line 2: expected frame,id,x,y,w,h,conf, found 3 numbers"),
            ("1,one,1,1,1,1", "line 1: \"one\" is not a number"),
            ("\n0,1,1,1,1,1", "line 2: frame 0: frames count from 1"),
            ("1.5,1,1,1,1,1", "frame 1.5 is not a whole number"),
            ("1,1e300,1,1,1,1", "is not a whole number"),
            ("1,9007199254740994,1,1,1,1", "is not a whole number up to 9007199254740992"),
            ("1000000001,1,1,1,1,1", "is not a whole number up to 1000000000"),
            ("1,nan,1,1,1,1", "id NaN"),
            ("1,1,1,1,1e9,1", "1000000000 is no number of pixels"),
            ("1,1,1,inf,1,1", "inf is no number of pixels"),
            ("1,1,1,1,-2,1", "a box cannot be -2 x 1 pixels"),
            ("1,1,1,1,2,1,nan", "confidence NaN"),
        ] {
            let problem = parse(text).expect_err(text).to_string();
            assert!(problem.contains(said), "{problem}");
        }
        let dir = tempfile::tempdir().expect("a temporary folder");
        assert_eq!(sequence_length(dir.path()).expect("none is fine"), None);
        for (text, said) in [("[Sequence]\n", "no line seqLength"), ("\nseqLength=many", "line 2: expected a number")] {
            std::fs::write(dir.path().join("seqinfo.ini"), text).expect("written");
            assert!(sequence_length(dir.path()).expect_err(text).to_string().contains(said));
        }
        std::fs::write(dir.path().join("seqinfo.ini"), "[Sequence]\r\nseqLength = 71\r\n").expect("written");
        assert_eq!(sequence_length(dir.path()).expect("a length"), Some(71));
    }

    #[test]
    fn no_text_panics() {
        // 20,000 texts of random fragments, seed 1: anything but a panic is right; text that parses is written and parsed again.
        let parts = ["1", "2", "3,", "-2.5", "NaN", "inf", ",", ";", "\t", " ", "\n", "1e9", "é", "\u{feff}", "-", "0"];
        for trial in 0..20_000 {
            let mut rng = Streams::new(1, 0).at(trial, Purpose::Scene).rng(0);
            let text: String = (0..rng.random_range(0..40)).map(|_| parts[rng.random_range(0..parts.len())]).collect();
            if let Ok(tracks) = parse(&text) {
                assert_eq!(parse(&tracks.text()).expect("own text").sightings.len(), tracks.sightings.len());
            }
        }
    }
}
