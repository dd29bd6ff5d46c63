//! What ffprobe reports of a video file: numbers and names of ffmpeg's own, none of which is text of the file.

use std::collections::BTreeMap;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::input::Input;
use foveate_core::geometry::Size;

/// The facts of a video before decoding.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Facts {
    /// The number of the video stream; `None` if ffprobe is missing or finds none.
    pub stream: Option<usize>,
    /// The file has sound and no video.
    pub sound: bool,
    /// Size of the first picture, turned as it is shown, of stored pixels.
    pub sides: Option<Size>,
    /// Mean frames a second.
    pub rate: Option<f64>,
    /// An estimate of the number of frames.
    pub frames: Option<usize>,
    /// As in H.264's table E-5.
    pub matrix: Option<u16>,
    pub full_range: bool,
}

const FIELDS: &str = "stream=index,codec_type,codec_name,width,height,pix_fmt,color_space,color_range,r_frame_rate,avg_frame_rate,duration,\
    nb_frames:stream_disposition=default,attached_pic,timed_thumbnails,still_image:stream_side_data=rotation:format=duration";
/// Codecs of single pictures. A stream of these beside another one is a cover or thumbnails.
const PICTURES: [&str; 8] = ["mjpeg", "png", "bmp", "gif", "webp", "tiff", "jpeg2000", "jpegls"];

impl Facts {
    /// Runs the ffprobe beside the ffmpeg. Without it all facts are unknown.
    pub(super) fn ask(program: &Path, input: &Input) -> Self {
        let found = Command::new(probe(program))
            .args(["-v", "quiet"])
            .args(input.guards())
            .args(["-show_entries", FIELDS, "-of", "default"])
            .arg(&input.name)
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .output();
        found.map_or(Self::default(), |found| Self::read(&String::from_utf8_lossy(&found.stdout)))
    }

    pub(super) fn read(text: &str) -> Self {
        let (streams, format) = sections(text);
        let kind = |stream: &Section, kind: &str| stream.get("codec_type").is_some_and(|found| *found == kind);
        let videos = streams.values().filter(|stream| kind(stream, "video"));
        let Some(video) = videos.clone().min_by_key(|video| demerits(video)) else {
            let sound = streams.values().any(|stream| kind(stream, "audio"));
            return Self { sound, ..Self::default() };
        };
        let text = |name: &str| video.get(name).copied().unwrap_or_default();
        let positive = |text: &str| text.parse::<f64>().ok().filter(|n| *n > 0.0 && n.is_finite());
        let rate = |name| ratio(text(name)).filter(|rate| *rate > 0.0);
        let rate = rate("avg_frame_rate").or_else(|| rate("r_frame_rate"));
        let duration = positive(text("duration")).or_else(|| positive(format.get("duration")?));
        let frames = positive(text("nb_frames")).or_else(|| Some(duration? * rate?)).filter(|n| *n < 1e12);
        let of_colours = ["rgb", "bgr", "gbr", "argb", "abgr", "0rgb", "0bgr", "x2", "pal8", "bayer", "xyz"];
        let of_luma = !of_colours.iter().any(|name| text("pix_fmt").starts_with(name));
        let matrix = match text("color_space") {
            "bt709" => Some(1),
            "bt470bg" | "smpte170m" | "fcc" => Some(6),
            "smpte240m" => Some(7),
            "bt2020nc" | "bt2020c" => Some(9),
            // Red, green and blue, which ffmpeg turns into yuv by its own guess.
            _ if !of_luma && !text("pix_fmt").is_empty() => Some(6),
            _ => None,
        };
        let sides = text("width").parse().ok().zip(text("height").parse().ok()).filter(|(w, h)| *w > 0 && *h > 0);
        let turned = positive(text("rotation").trim_start_matches('-')).is_some_and(|angle| angle % 180.0 == 90.0);
        // A stream that holds covers alone is one of sound.
        let sound = is_cover(video) && streams.values().any(|stream| kind(stream, "audio"));
        Self {
            stream: text("index").parse().ok(),
            sound,
            sides: sides.map(|(w, h)| if turned { Size::new(h, w) } else { Size::new(w, h) }),
            rate,
            frames: frames.map(|n| n.round() as usize),
            matrix,
            full_range: of_luma && text("color_range") == "pc",
        }
    }
}

type Section<'a> = BTreeMap<&'a str, &'a str>;

/// The streams by number, and the remarks on the file. A stream that is also in a program counts once.
fn sections(text: &str) -> (BTreeMap<usize, Section<'_>>, Section<'_>) {
    let (mut streams, mut format, mut now): (BTreeMap<usize, Section<'_>>, _, _) = Default::default();
    for line in text.lines() {
        match (line, line.split_once('=')) {
            ("[STREAM]" | "[FORMAT]", _) => now = Section::new(),
            ("[/STREAM]", _) => {
                if let Some(index) = now.get("index").and_then(|index| index.parse().ok()) {
                    streams.entry(index).or_default().append(&mut now);
                }
            }
            ("[/FORMAT]", _) => format = std::mem::take(&mut now),
            (_, Some((name, value))) => drop(now.insert(name, value)),
            _ => (),
        }
    }
    (streams, format)
}

fn is_cover(video: &Section<'_>) -> bool {
    let marks = ["DISPOSITION:attached_pic", "DISPOSITION:timed_thumbnails", "DISPOSITION:still_image"];
    marks.iter().any(|mark| video.get(mark) == Some(&"1"))
}

/// Penalty of a stream in the choice of the video: high for covers and thumbnails, lower if it is not the default.
fn demerits(video: &Section<'_>) -> u8 {
    let pictures = video.get("codec_name").is_some_and(|name| PICTURES.contains(name));
    let default = video.get("DISPOSITION:default") == Some(&"1");
    4 * u8::from(is_cover(video)) + 2 * u8::from(pictures) + u8::from(!default)
}

/// Beside `a/ffmpeg`, `a/ffprobe`.
pub(crate) fn probe(program: &Path) -> PathBuf {
    let name = program.file_name().unwrap_or_default().to_string_lossy().replace("ffmpeg", "ffprobe");
    program.with_file_name(name)
}

/// `25/2`.
fn ratio(text: &str) -> Option<f64> {
    let (over, under) = text.split_once('/')?;
    let ratio = over.parse::<f64>().ok()? / under.parse::<f64>().ok()?;
    ratio.is_finite().then_some(ratio)
}
