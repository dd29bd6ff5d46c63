//! yuv4mpeg: raw video with one line of text before it and before every frame (`YUV4MPEG2 W360 H240 F30:1 C420 XCOLORRANGE=LIMITED`).
//!
//! The content of pictures cannot forge headers: the first line fixes the length of a frame.

use std::io::{ErrorKind, Read};

use crate::aspect::Aspect;
use crate::decode::MAX_SIDE;
use crate::decoded::{DecodeError, Decoded};
use crate::yuv::Yuv;
use foveate_core::geometry::Size;

/// The first bytes of a stream.
pub(crate) const MAGIC: &[u8] = b"YUV4MPEG2 ";
/// The longest line that is read; programs write a hundred bytes.
const MOST_LINE: usize = 1024;
const TODO: &str = "write it with `ffmpeg -i IN -fps_mode passthrough -pix_fmt yuv420p -f yuv4mpegpipe -`";
const SMALLER: &str = "make the video smaller with `ffmpeg -i IN -vf scale=iw/2:-2 OUT.mp4`";

/// The content of the first line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Head {
    pub width: usize,
    pub height: usize,
    /// Frames a second, if present.
    pub rate: Option<f64>,
    /// Size of the chroma planes; `None` if grey.
    chroma: Option<Size>,
    /// Bits a sample, 8 to 16.
    depth: u32,
    /// Whether samples use the full range. Grey without a statement does, as programs write it.
    pub full_range: Option<bool>,
    /// The shape of a pixel; square by default.
    pub aspect: Aspect,
}

/// A stream in mid-reading.
pub(crate) struct Y4m<R> {
    reader: R,
    pub head: Head,
    bytes: Vec<u8>,
}

impl<R: Read> Y4m<R> {
    /// Reads the first line. `read` are the bytes already read to detect the format.
    pub(crate) fn new(mut reader: R, read: &[u8]) -> Decoded<Self> {
        let mut first = read.to_vec();
        let ended = line(&mut reader, &mut first);
        if !first.is_empty() && !first.starts_with(MAGIC.trim_ascii_end()) {
            return Err(DecodeError::Damaged(format!(
                "expected yuv4mpeg, which begins with YUV4MPEG2, found {}",
                found(&first)
            )));
        }
        if !ended? {
            let problem = "expected yuv4mpeg, found nothing: the stream ended before its first byte";
            return Err(DecodeError::Damaged(problem.into()));
        }
        let line = first;
        let head = parse(&line).map_err(DecodeError::Damaged)?;
        Ok(Self { reader, head, bytes: vec![] })
    }

    /// The next picture, 8 bits a sample (deeper ones are cut to their upper bits); grey has no chroma planes.
    pub(crate) fn picture(&mut self) -> Option<Decoded<Yuv>> {
        let mut found = vec![];
        match line(&mut self.reader, &mut found) {
            Ok(true) => (),
            Ok(false) => return None,
            Err(error) => return Some(Err(error)),
        }
        if found != b"FRAME" && !found.starts_with(b"FRAME ") {
            let shown = String::from_utf8_lossy(&found[..found.len().min(40)]).escape_debug().to_string();
            return Some(Err(DecodeError::damaged(format!("expected a line FRAME before a frame, found \"{shown}\""))));
        }
        Some(self.planes())
    }

    fn planes(&mut self) -> Decoded<Yuv> {
        let Head { width, height, chroma, depth, .. } = self.head;
        let (wide, luma) = (if depth > 8 { 2 } else { 1 }, width * height);
        let part = chroma.map_or(0, |Size { width, height }| width * height);
        let wanted = wide * (luma + 2 * part);
        self.bytes.clear();
        // Memory follows the bytes that come, not those that the first line promises.
        let read = self.reader.by_ref().take(wanted as u64).read_to_end(&mut self.bytes);
        match read {
            Ok(n) if n == wanted => (),
            Ok(n) => {
                return Err(DecodeError::damaged(format!("the stream ends after {n} of {wanted} bytes of a frame")));
            }
            Err(e) => return Err(DecodeError::damaged(format!("cannot read on: {e}"))),
        }
        let plane = |from: usize, n: usize| -> Vec<u8> {
            let bytes = &self.bytes[wide * from..wide * (from + n)];
            if wide == 1 {
                return bytes.to_vec();
            }
            bytes.chunks_exact(2).map(|b| (u16::from_le_bytes([b[0], b[1]]) >> (depth - 8)) as u8).collect()
        };
        let (y, u, v) = (plane(0, luma), plane(luma, part), plane(luma + part, part));
        Ok(Yuv { width, height, chroma: chroma.unwrap_or_default(), y, u, v })
    }
}

/// Reads a line, without its end, into `line` after the bytes already there; false at the end of the stream.
fn line(reader: &mut impl Read, line: &mut Vec<u8>) -> Decoded<bool> {
    let mut byte = [0];
    loop {
        match reader.read(&mut byte) {
            Ok(0) if line.is_empty() => return Ok(false),
            Ok(0) => return Err(DecodeError::damaged("the stream ends in the middle of a line")),
            Ok(_) if byte[0] == b'\n' => return Ok(true),
            Ok(_) if line.len() < MOST_LINE => line.push(byte[0]),
            Ok(_) => {
                let problem = format!("expected yuv4mpeg, found a line of more than {MOST_LINE} bytes; {TODO}");
                return Err(DecodeError::Damaged(problem));
            }
            Err(e) if e.kind() == ErrorKind::Interrupted => (),
            Err(e) => return Err(DecodeError::damaged(format!("cannot read on: {e}"))),
        }
    }
}

/// The kind of a stream with this beginning, and how to convert it.
fn found(head: &[u8]) -> String {
    let kinds: [(&str, usize, &[u8]); 12] = [
        ("MP4 or QuickTime", 4, b"ftyp"),
        ("Matroska or WebM", 0, b"\x1a\x45\xdf\xa3"),
        ("AVI", 8, b"AVI "),
        ("FLV", 0, b"FLV"),
        ("Ogg", 0, b"OggS"),
        ("an MPEG program stream", 0, b"\0\0\x01\xba"),
        ("H.264 or H.265", 0, b"\0\0\0\x01"),
        ("H.264 or H.265", 0, b"\0\0\x01"),
        ("JPEG pictures", 0, b"\xff\xd8\xff"),
        ("PNG pictures", 0, b"\x89PNG"),
        ("GIF", 0, b"GIF8"),
        ("an MPEG transport stream", 0, b"\x47"),
    ];
    let kind = kinds.iter().find(|(_, at, name)| head.get(*at..).is_some_and(|head| head.starts_with(name)));
    let pipe = "ffmpeg -i - -fps_mode passthrough -pix_fmt yuv420p -f yuv4mpegpipe -";
    let of_files =
        |name: &str| if name.starts_with("MP4") { "give the file itself, without a pipe, or let" } else { "let" };
    match kind {
        Some((name, ..)) => {
            format!("{name}; {} ffmpeg convert it: `... | {pipe} | foveate track - ...`", of_files(name))
        }
        None => {
            let shown = &head[..head.len().min(40)];
            let text = shown.iter().all(|byte| (b' '..=b'~').contains(byte));
            let shown = if text {
                format!("\"{}\"", String::from_utf8_lossy(shown))
            } else {
                let bytes: Vec<String> = shown.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
                format!("other data, which begins with the bytes {}", bytes.join(" "))
            };
            format!(
                "{shown}; convert a video with `{}`, or give --raw WIDTHxHEIGHT for bare pixels",
                pipe.replace("-i -", "-i IN")
            )
        }
    }
}

fn parse(line: &[u8]) -> Result<Head, String> {
    let text = String::from_utf8_lossy(line);
    let rest = text.strip_prefix("YUV4MPEG2").unwrap_or_default();
    if text.ends_with('\r') {
        return Err(format!(
            "expected a first line that ends in a line feed alone, found a carriage return before it: the file was changed as if it \
             were text; copy it anew, or {TODO}"
        ));
    }
    let (mut width, mut height, mut rate, mut colour, mut full_range) = (0, 0, None, "420", None);
    let mut aspect = Aspect::default();
    for field in rest.split(' ').filter(|field| !field.is_empty()) {
        let (name, value) = field.split_at(field.chars().next().map_or(0, char::len_utf8));
        let side = || value.parse::<usize>().ok().filter(|n| (1..=MAX_SIDE).contains(n)).ok_or(());
        let wrong = |()| {
            let todo = if value.parse().is_ok_and(|n: u64| n > MAX_SIDE as u64) { SMALLER } else { TODO };
            format!("expected sides from 1 to {MAX_SIDE} pixels, found \"{}\"; {todo}", field.escape_debug())
        };
        match name {
            "W" => width = side().map_err(wrong)?,
            "H" => height = side().map_err(wrong)?,
            "F" => {
                let wrong = || {
                    let found = field.escape_debug();
                    format!("expected frames a second as F30:1, or F0:0 if unknown, found \"{found}\"; {TODO}")
                };
                let parts = value.split_once(':').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
                let (a, b): (f64, f64) = parts.ok_or_else(wrong)?;
                rate = Some(a / b).filter(|rate| rate.is_finite() && *rate > 0.0);
                if rate.is_none() && (a, b) != (0.0, 0.0) {
                    return Err(wrong());
                }
            }
            "C" => colour = value,
            "A" => {
                let sides = value.split_once(':').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
                aspect = sides.and_then(|(across, down)| Aspect::new(across, down)).unwrap_or_default();
            }
            "X" if value == "COLORRANGE=FULL" => full_range = Some(true),
            "X" if value == "COLORRANGE=LIMITED" => full_range = Some(false),
            _ => (),
        }
    }
    if width == 0 || height == 0 {
        return Err(format!(
            "expected width and height in the first line (W640 H480), found \"{}\"; {TODO}",
            text.escape_debug()
        ));
    }
    foveate_base::memory::check_picture(width, height).map_err(|error| error.to_string())?;
    let unknown = || {
        let known = "420, 422, 444 and mono, of 8 to 16 bits";
        format!("expected colours of the kinds {known}, found \"C{}\"; {TODO}", colour.escape_debug())
    };
    let (kind, rest) = match colour.strip_prefix("mono") {
        Some(rest) => ("mono", rest),
        None => colour.split_at_checked(3).ok_or_else(unknown)?,
    };
    let half = |side: usize| side.div_ceil(2);
    let chroma = match kind {
        "420" => Some(Size::new(half(width), half(height))),
        "422" => Some(Size::new(half(width), height)),
        "444" => Some(Size { width, height }),
        "mono" => None,
        _ => return Err(unknown()),
    };
    let depth = match rest {
        "" | "jpeg" | "mpeg2" | "paldv" => 8,
        deep => deep.trim_start_matches('p').parse().ok().filter(|bits| (9..=16).contains(bits)).ok_or_else(unknown)?,
    };
    Ok(Head { width, height, rate, chroma, depth, full_range, aspect })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::yuv::Colour;

    fn all(bytes: &[u8]) -> Decoded<(Head, Vec<Yuv>)> {
        let mut stream = Y4m::new(bytes, &[])?;
        let mut pictures = vec![];
        while let Some(picture) = stream.picture() {
            pictures.push(picture?);
        }
        Ok((stream.head, pictures))
    }

    fn problem(bytes: &[u8]) -> String {
        match all(bytes) {
            Err(DecodeError::Damaged(text) | DecodeError::Unsupported(text)) => text,
            Ok(_) => panic!("{bytes:?} is read"),
        }
    }

    #[test]
    fn every_kind_of_colour_has_its_planes() {
        for (colour, chroma, bytes) in [
            ("", (2, 1), 6 + 4),
            (" C420mpeg2", (2, 1), 6 + 4),
            (" C422", (2, 2), 6 + 8),
            (" C444", (3, 2), 18),
            (" Cmono", (0, 0), 6),
            (" C420p10", (2, 1), 20),
            (" C422p16", (2, 2), 28),
            (" Cmono12", (0, 0), 12),
        ] {
            let mut text = format!("YUV4MPEG2 W3 H2 F30000:1001 Ip A1:1{colour}\nFRAME\n").into_bytes();
            text.extend(std::iter::repeat_n(1, bytes));
            text.extend(b"FRAME Ixyz\n");
            text.extend(std::iter::repeat_n(2, bytes));
            let (head, pictures) = all(&text).expect("two frames");
            assert_eq!((head.width, head.height, pictures.len()), (3, 2, 2), "{colour}");
            assert!((head.rate.expect("a rate") - 29.97).abs() < 0.01 && head.full_range.is_none());
            assert_eq!(head.aspect, Aspect::default());
            assert_eq!(pictures[0].chroma, chroma.into(), "{colour}");
            let image = pictures[1].to_rgb(Colour::new(None, true, 3, 2));
            assert_eq!(image.planes(), if chroma.0 == 0 { 1 } else { 3 }, "{colour}");
        }
    }

    #[test]
    fn deep_samples_keep_their_upper_bits_and_grey_its_range() {
        let mut text = b"YUV4MPEG2 W2 H1 Cmono10 XCOLORRANGE=LIMITED\nFRAME\n".to_vec();
        text.extend([0, 1, 0xac, 3]);
        let (head, pictures) = all(&text).expect("one frame");
        let unknown = all(b"YUV4MPEG2 W2 H1 F0:0 Cmono\nFRAME\nab").expect("one frame");
        assert_eq!((unknown.0.rate, unknown.1.len()), (None, 1));
        assert_eq!((head.full_range, &*pictures[0].y), (Some(false), &[64, 235][..]));
        let image = pictures[0].to_rgb(Colour::new(None, false, 2, 1));
        assert_eq!(image.bytes(), [56, 255]);
        assert_eq!(pictures[0].to_rgb(Colour::new(None, true, 2, 1)).bytes(), [64, 235]);
    }

    #[test]
    fn other_bytes_than_yuv4mpeg_are_refused() {
        for (text, word) in [
            (&b""[..], "nothing"),
            (b"YUV4MPEG2 W3 H2", "middle of a line"),
            (b"hello\nworld", "found \"hello\"; convert a video"),
            (b"\x1f\x8b\x08\0 and more", "begins with the bytes 1f 8b 08 00"),
            (b"RIFF....AVI \n", "found AVI; let ffmpeg convert it: `... | ffmpeg -i - "),
            (b"\0\0\0 ftypisom\0\0\x02", "found MP4 or QuickTime; give the file itself"),
            (b"G@\x11\x10\0B\xf0\xff", "found an MPEG transport stream; let ffmpeg"),
            (b"\x1a\x45\xdf\xa3\x01", "found Matroska or WebM; let ffmpeg"),
            (b"\xff\xd8\xff\xe0", "found JPEG pictures; let ffmpeg"),
            (b"YUV4MPEG2 W3\n", "width and height"),
            (b"YUV4MPEG2 W3 H99999999999999999999\n", "sides from 1"),
            (b"YUV4MPEG2 W-3 H2\n", "sides from 1"),
            (b"YUV4MPEG2 W3 H2 Fabc\n", "F30:1, or F0:0 if unknown, found \"Fabc\""),
            (b"YUV4MPEG2 W3 H2 F25\n", "found \"F25\""),
            (b"YUV4MPEG2 W3 H2 F25:0\n", "found \"F25:0\""),
            (b"YUV4MPEG2 W3 H2 F-25:1\n", "found \"F-25:1\""),
            (b"YUV4MPEG2 W3 H2 F25:1\r\nFRAME\r\n", "found a carriage return"),
            (b"YUV4MPEG2 W3 H2 C411\n", "C411"),
            (b"YUV4MPEG2 W3 H2 C420p99\n", "C420p99"),
            (b"YUV4MPEG2 W3 H2 C4\xc3\xa9\n", "kinds"),
            (b"YUV4MPEG2 W2 H2 Cmono\nFRAME\nabc", "3 of 4 bytes"),
            (b"YUV4MPEG2 W2 H2 Cmono\nFRAME\nabcdFRAMES\nabcd", "FRAMES"),
            (b"YUV4MPEG2 W2048 H2048 C444\nFRAME\nabc", "3 of 12582912 bytes"),
        ] {
            let found = problem(text);
            assert!(found.contains(word) && !found.contains(|c: char| c.is_control()), "{found}");
        }
        let long = [b"YUV4MPEG2 ".as_slice(), &[b'a'; 5000]].concat();
        assert!(problem(&long).contains("more than 1024 bytes"));
    }

    /// 20,000 damaged streams, seed 5: an error or pictures, never a panic.
    #[test]
    fn damaged_streams_do_not_panic() {
        let mut good = b"YUV4MPEG2 W4 H3 F25:1 Ip C420p10 XCOLORRANGE=FULL\n".to_vec();
        (0..3).for_each(|_| good.extend([b"FRAME\n".as_slice(), &[7; 40]].concat()));
        assert_eq!(all(&good).expect("whole").1.len(), 3);
        let mut next = foveate_testing::draws(5);
        for _ in 0..20_000 {
            let mut bytes = good.clone();
            for _ in 0..1 + next(5) {
                let within = [60, bytes.len()][next(2)];
                let at = next(within);
                bytes[at] = if next(2) == 0 { bytes[at] ^ (1 << next(8)) } else { b"0123456789:C WHF\n"[next(17)] };
            }
            bytes.truncate(bytes.len() - next(2) * next(bytes.len()));
            let _ = all(&bytes);
        }
    }
}
