//! The messages of a decoder in a child process: a byte for the kind, then little-endian numbers, texts and pixels.
//!
//! The child may be in the hands of whoever made the video. The reader checks every size before it allocates, and escapes texts.

use std::io::{Error, ErrorKind, Read, Result, Write};

use crate::SourceInfo;
use crate::decode::MAX_SIDE;
use foveate_base::{memory, text::visible};
use foveate_core::geometry::Size;
use foveate_core::scene::Image;

/// A message of the child.
#[derive(Debug, PartialEq)]
pub(super) enum Message {
    Info(SourceInfo),
    /// A picture and its time in seconds.
    Frame(f64, Image),
    /// The stored and the displayed size, if pixels are not square.
    Sides([Size; 2]),
    /// A damaged frame, counted from 1, and the decoder's report.
    Damage(usize, String),
    /// Why the child cannot give up its rights. Nothing follows.
    Refused(String),
    /// The text of an error: of a video that cannot be opened with its name, of a frame or a picture without. No frame follows in a video.
    Error(String),
    /// The source ended as it should.
    End,
}

const LONGEST: usize = 4000;

impl Message {
    pub(super) fn write(&self, to: &mut impl Write) -> Result<()> {
        match self {
            Self::Info(info) => {
                to.write_all(&[0])?;
                size(to, info.size())?;
                number(to, info.frames.map_or(u64::MAX, |n| n as u64))?;
                number(to, info.rate.to_bits())?;
                words(to, &info.reader)
            }
            Self::Frame(time, image) => {
                to.write_all(&[1])?;
                number(to, time.to_bits())?;
                size(to, image.size())?;
                number(to, image.planes() as u64)?;
                to.write_all(image.bytes())
            }
            Self::Sides([stored, shown]) => {
                to.write_all(&[2])?;
                size(to, *stored)?;
                size(to, *shown)
            }
            Self::Damage(frame, report) => {
                to.write_all(&[3])?;
                number(to, *frame as u64)?;
                words(to, report)
            }
            Self::Refused(problem) => {
                to.write_all(&[4])?;
                words(to, problem)
            }
            Self::Error(problem) => {
                to.write_all(&[5])?;
                words(to, problem)
            }
            Self::End => to.write_all(&[6]),
        }
    }

    /// # Errors
    /// The bytes end early or are no message.
    pub(super) fn read(from: &mut impl Read) -> Result<Self> {
        let [kind] = array(from)?;
        Ok(match kind {
            0 => {
                let Size { width, height } = read_size(from)?;
                let frames = usize::try_from(read_number(from)?).ok().filter(|n| *n < usize::MAX);
                let rate = read_seconds(from)?;
                Self::Info(SourceInfo { width, height, frames, rate, reader: read_words(from)? })
            }
            1 => {
                let (time, Size { width, height }) = (read_seconds(from)?, read_size(from)?);
                let planes = usize::try_from(read_number(from)?).ok().filter(|n| [1, 3].contains(n));
                let planes = planes.ok_or_else(|| wrong("another number of planes than 1 or 3"))?;
                let mut bytes = vec![0; width * height * planes];
                from.read_exact(&mut bytes)?;
                Self::Frame(time, Image::new(width, height, planes, bytes).map_err(Error::other)?)
            }
            2 => Self::Sides([read_size(from)?, read_size(from)?]),
            3 => Self::Damage(read_frame(from)?, read_words(from)?),
            4 => Self::Refused(read_words(from)?),
            5 => Self::Error(read_words(from)?),
            6 => Self::End,
            _ => return Err(wrong("an unknown message")),
        })
    }
}

fn wrong(found: &str) -> Error {
    Error::new(ErrorKind::InvalidData, format!("it sent {found}"))
}

fn number(to: &mut impl Write, value: u64) -> Result<()> {
    to.write_all(&value.to_le_bytes())
}

fn size(to: &mut impl Write, size: Size) -> Result<()> {
    number(to, size.width as u64)?;
    number(to, size.height as u64)
}

fn words(to: &mut impl Write, text: &str) -> Result<()> {
    let bytes = &text.as_bytes()[..text.len().min(LONGEST)];
    number(to, bytes.len() as u64)?;
    to.write_all(bytes)
}

fn array<const N: usize>(from: &mut impl Read) -> Result<[u8; N]> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn read_number(from: &mut impl Read) -> Result<u64> {
    array(from).map(u64::from_le_bytes)
}

fn read_frame(from: &mut impl Read) -> Result<usize> {
    usize::try_from(read_number(from)?).map_err(|_| wrong("too large a number"))
}

/// A rate or a time: finite, not negative.
fn read_seconds(from: &mut impl Read) -> Result<f64> {
    let value = f64::from_bits(read_number(from)?);
    if (0.0..1e12).contains(&value) { Ok(value) } else { Err(wrong("a time or a rate that is none")) }
}

/// Sides of a picture that the memory limit allows.
fn read_size(from: &mut impl Read) -> Result<Size> {
    let [width, height] = [read_frame(from)?, read_frame(from)?];
    if ![width, height].iter().all(|side| (1..=MAX_SIDE).contains(side)) {
        return Err(wrong("sides that are none"));
    }
    memory::check_picture(width, height).map_err(Error::other)?;
    Ok(Size { width, height })
}

fn read_words(from: &mut impl Read) -> Result<String> {
    let length = read_frame(from)?;
    if length > LONGEST {
        return Err(wrong("too long a text"));
    }
    let mut bytes = vec![0; length];
    from.read_exact(&mut bytes)?;
    Ok(visible(&String::from_utf8_lossy(&bytes)).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<Message> {
        let info = SourceInfo { width: 3, height: 2, frames: None, rate: 29.97, reader: "H.264".into() };
        let image = Image::new(3, 2, 3, (0..18).collect()).expect("sizes agree");
        let sides = [Size::new(3, 2), Size::new(4, 2)];
        vec![
            Message::Info(SourceInfo { frames: Some(7), ..info.clone() }),
            Message::Info(info),
            Message::Sides(sides),
            Message::Damage(2, "late".into()),
            Message::Refused("old kernel".into()),
            Message::Frame(0.04, image),
            Message::Error("no".into()),
            Message::End,
        ]
    }

    #[test]
    fn messages_come_back_as_they_were() {
        let mut bytes = vec![];
        all().iter().for_each(|message| message.write(&mut bytes).expect("memory"));
        let mut rest = &bytes[..];
        for message in all() {
            assert_eq!(Message::read(&mut rest).expect("a message"), message);
        }
        assert!(rest.is_empty());
        let mut bytes = vec![];
        Message::Error("\u{1b}[31m\n".into()).write(&mut bytes).expect("memory");
        assert_eq!(Message::read(&mut &bytes[..]).expect("a text"), Message::Error("\\u{1b}[31m\\n".into()));
    }

    /// 50,000 damaged messages, seed 5: a message or an error, never a panic or much memory.
    #[test]
    fn damaged_messages_are_errors() {
        let mut next = foveate_testing::draws(5);
        for _ in 0..50_000 {
            let mut bytes = vec![];
            all()[next(8)].write(&mut bytes).expect("memory");
            for _ in 0..1 + next(3) {
                let at = next(bytes.len());
                bytes[at] = next(256) as u8;
            }
            if let Ok(Message::Frame(time, image)) = Message::read(&mut &bytes[..]) {
                assert!(time >= 0.0 && image.width() * image.height() <= 18);
            }
        }
    }
}
