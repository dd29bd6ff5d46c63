//! measure.trk: the points, the scale and the axes for Tracker of Open Source Physics.
//!
//! The file is the XML of its class `XMLControl`: an object has properties with a name and a type. In Tracker the corner of the first pixel
//! is (0, 0), where foveate has its centre; frames count from 0 and times are in milliseconds. Tracker takes the times of frames from the
//! video, or constant ones.

use std::fmt::Write as _;
use std::path::Path;

use foveate_report::escape;

use super::measurement::Measurement;

/// From the centre of the first pixel to its corner.
const CORNER: f64 = 0.5;
/// Red, green and blue of the points, in turn.
const COLOURS: [[u8; 3]; 4] = [[213, 94, 0], [0, 114, 178], [0, 158, 115], [204, 121, 167]];

/// Returns measure.trk, in pixels of the video: `scale` is that of the tracked pictures, whose sides are whole numbers of pixels. Tracker
/// opens the video if it is a file.
pub(super) fn trk(video: Option<&Path>, scale: f64, points: &[Measurement]) -> String {
    let rows = || points.iter().flat_map(|point| &point.rows);
    let first = rows().map(|row| row.frame).min().unwrap_or(1);
    let frames = rows().map(|row| row.frame).max().unwrap_or(1);
    let ahead = &points[0].rows;
    // The mean interval.
    let step = match &ahead[..] {
        [first, .., last] => 1000.0 * (last.time - first.time) / (last.frame - first.frame) as f64,
        _ => 0.0,
    };
    let every = ahead.windows(2).map(|pair| pair[1].frame - pair[0].frame).min().unwrap_or(1).max(1);
    let start = ahead.first().map_or(0.0, |row| 1000.0 * row.time - step * (row.frame - 1) as f64);
    let mut xml = Xml::default();
    xml.object("", "org.opensourcephysics.cabrillo.tracker.TrackerPanel", |xml| {
        xml.value("description", "string", about(points));
        xml.object("videoclip", "org.opensourcephysics.media.core.VideoClip", |xml| {
            if let Some(video) = video.filter(|video| video.is_file()) {
                // Tracker chooses the class by the file.
                xml.object("video", "org.opensourcephysics.media.xuggle.XuggleVideo", |xml| {
                    let path = std::path::absolute(video).unwrap_or_else(|_| video.to_path_buf());
                    xml.value("path", "string", path.to_string_lossy().replace('\\', "/"));
                });
            }
            xml.value("video_framecount", "int", frames);
            xml.value("startframe", "int", first - 1);
            xml.value("stepsize", "int", every);
            xml.value("stepcount", "int", (frames - first) / every + 1);
            xml.value("starttime", "double", start + step * (first - 1) as f64);
        });
        xml.object("clipcontrol", "org.opensourcephysics.media.core.StepperClipControl", |xml| {
            xml.value("rate", "double", 1.0);
            xml.value("delta_t", "double", step);
            xml.value("frame", "int", first - 1);
        });
        coords(xml, &points[0], scale);
        if points[0].unit == "m" {
            xml.value("length_unit", "string", "m");
        }
        xml.array("tracks", "collection", "java.util.ArrayList", |xml| {
            for (point, colour) in points.iter().zip(COLOURS.iter().cycle()) {
                xml.object("item", "org.opensourcephysics.cabrillo.tracker.PointMass", |xml| {
                    mass(xml, point, *colour, scale);
                });
            }
        });
    });
    format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{}", xml.text)
}

/// Returns the description of the file in Tracker.
fn about(points: &[Measurement]) -> String {
    let lens = if points.iter().any(|point| point.straightened) {
        " The distortion of the lens is removed: the marks are beside the film's."
    } else {
        ""
    };
    format!("Tracked by foveate. The errors are in measure.csv.{lens}")
}

/// Writes origin, angle and scale: those of all frames, or those of each if the origin follows a reference.
fn coords(xml: &mut Xml, point: &Measurement, scale: f64) {
    let [.., origin] = point.rows[0].pixels;
    let fixed = point.rows.iter().all(|row| row.pixels[1] == origin);
    let metres = point.axes.ruler.as_ref().and_then(|ruler| ruler.scale()).map_or(1.0, |ruler| ruler.metres);
    let pixels_per_unit = 1.0 / metres / scale;
    xml.object("coords", "org.opensourcephysics.media.core.ImageCoordSystem", |xml| {
        xml.value("fixedorigin", "boolean", fixed);
        xml.value("fixedangle", "boolean", true);
        xml.value("fixedscale", "boolean", true);
        let class = "org.opensourcephysics.media.core.ImageCoordSystem$FrameData";
        xml.array("framedata", "array", &format!("[L{class};"), |xml| {
            let mut frame = |index: usize, (x, y): (f64, f64)| {
                xml.object(&format!("[{index}]"), class, |xml| {
                    xml.value("xorigin", "double", (x + CORNER) / scale);
                    xml.value("yorigin", "double", (y + CORNER) / scale);
                    xml.value("angle", "double", point.axes.angle);
                    xml.value("xscale", "double", pixels_per_unit);
                    xml.value("yscale", "double", pixels_per_unit);
                });
            };
            // Frames without a row have the origin of the one before.
            let (mut rows, mut at) = (point.rows.iter().peekable(), origin);
            let last = if fixed { 1 } else { point.rows.last().map_or(1, |row| row.frame) };
            for index in 0..last {
                if let Some(row) = rows.next_if(|row| row.frame == index + 1) {
                    at = row.pixels[1];
                }
                frame(index, at);
            }
        });
    });
}

/// Writes the tracked positions of a point; frames in which it was lost have none.
fn mass(xml: &mut Xml, point: &Measurement, colour: [u8; 3], scale: f64) {
    xml.value("mass", "double", 1.0);
    xml.value("name", "string", &point.point);
    xml.object("color", "java.awt.Color", |xml| {
        for (name, value) in ["red", "green", "blue"].into_iter().zip(colour) {
            xml.value(name, "int", value);
        }
        xml.value("alpha", "int", 255);
    });
    xml.value("footprint", "string", "Footprint.Diamond");
    xml.value("visible", "boolean", true);
    xml.value("trail", "boolean", true);
    let class = "org.opensourcephysics.cabrillo.tracker.PointMass$FrameData";
    xml.array("framedata", "array", &format!("[L{class};"), |xml| {
        for row in point.rows.iter().filter(|row| row.measured.is_some()) {
            let [(x, y), _] = row.pixels;
            xml.object(&format!("[{}]", row.frame - 1), class, |xml| {
                xml.value("x", "double", (x + CORNER) / scale);
                xml.value("y", "double", (y + CORNER) / scale);
            });
        }
    });
}

/// The text of an `XMLControl`.
#[derive(Default)]
struct Xml {
    text: String,
    depth: usize,
}

impl Xml {
    fn line(&mut self, text: &str) {
        let _ = writeln!(self.text, "{:1$}{text}", "", 4 * self.depth);
    }

    fn value(&mut self, name: &str, kind: &str, value: impl std::fmt::Display) {
        let value = escape(&value.to_string());
        self.line(&format!("<property name=\"{name}\" type=\"{kind}\">{value}</property>"));
    }

    fn array(&mut self, name: &str, kind: &str, class: &str, content: impl FnOnce(&mut Self)) {
        self.line(&format!("<property name=\"{name}\" type=\"{kind}\" class=\"{class}\">"));
        self.depth += 1;
        content(self);
        self.depth -= 1;
        self.line("</property>");
    }

    /// Writes an object; the outermost one has no name.
    fn object(&mut self, name: &str, class: &str, content: impl FnOnce(&mut Self)) {
        if !name.is_empty() {
            self.line(&format!("<property name=\"{name}\" type=\"object\">"));
        }
        self.line(&format!("<object class=\"{class}\">"));
        self.depth += 1;
        content(self);
        self.depth -= 1;
        self.line("</object>");
        if !name.is_empty() {
            self.line("</property>");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::measurement::measure;
    use super::super::measurement::tests::{falling, settings};
    use super::super::track::{Position, Track};
    use super::*;

    fn falls(reference: Option<&[Position]>) -> Vec<Measurement> {
        let point = Track { name: "a<b".into(), positions: falling(0.0) };
        measure(&[point], reference, &settings()).expect("a measurement")
    }

    #[test]
    fn the_video_is_named_and_lost_frames_have_no_point() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("a & b.mp4");
        std::fs::write(&path, "").expect("written");
        let text = trk(Some(&path), 1.0, &falls(None));
        assert!(text.contains("/a &amp; b.mp4</property>") && text.contains(">a&lt;b<"), "{text}");
        assert!(text.contains("name=\"[11]\"") && !text.contains("name=\"[12]\""), "frames 13 and 14 are lost");
        assert!(!trk(None, 1.0, &falls(None)).contains("\"video\""));
    }

    /// Pictures of half the size show the corner (8, 6) of the video at (4, 3), and half as many pixels per metre.
    #[test]
    fn marks_and_axes_are_in_pixels_of_the_video() {
        let [whole, half] = [1.0, 0.5].map(|scale| trk(None, scale, &falls(None)));
        let mut compared = 0;
        for (whole, half) in whole.lines().zip(half.lines()) {
            let number = |line: &str| line.split(['>', '<']).nth(2).and_then(|text| text.parse::<f64>().ok());
            let is_place = ["x", "y", "xorigin", "yorigin", "xscale", "yscale"]
                .into_iter()
                .any(|name| whole.contains(&format!("name=\"{name}\"")));
            let wanted = number(whole).map(|value| if is_place { 2.0 * value } else { value });
            assert_eq!(number(half), wanted, "{whole} {half}");
            compared += usize::from(is_place);
        }
        assert_eq!(compared, 2 * 28 + 4, "28 points, origin and scale");
    }

    /// The origin of a moving camera is at a fixed distance from the reference.
    #[test]
    fn the_origin_follows_the_reference() {
        let at = |(k, p): (usize, Position)| Position { centre: (200.0 + k as f64, 50.0), usable: true, ..p };
        let reference: Vec<Position> = falling(0.0).into_iter().enumerate().map(at).collect();
        let text = trk(None, 1.0, &falls(Some(&reference)));
        assert!(text.contains("\"fixedorigin\" type=\"boolean\">false<"));
        let origins =
            text.lines().filter_map(|line| line.trim().strip_prefix("<property name=\"xorigin\" type=\"double\">"));
        let origins: Vec<f64> =
            origins.filter_map(|rest| rest.split('<').next().and_then(|x| x.parse().ok())).collect();
        assert_eq!(origins, (0..30).map(|k| 80.5 + f64::from(k)).collect::<Vec<_>>());
    }
}
