//! Decodes H.264 frames with rusty_h264 (fast) or rust_h264 (with interlacing, 10 bits and 4:2:2). Both are pure
//! Rust; a panic in either becomes an error of the file.

use rust_h264::nal::parse_avcc;

use crate::decoded::{DecodeError, Decoded};
use crate::sps;
use crate::sps::Sps;
use crate::yuv::Yuv;
use foveate_base::{memory, quiet};
use foveate_core::geometry::Size;

/// The parameters that decoders need before the first frame.
#[derive(Clone, Debug)]
pub(super) struct Setup {
    /// Sequence and picture parameter sets, as NAL units.
    parameters: Vec<Vec<u8>>,
    /// Bytes in the length before each NAL unit of a frame: 1, 2 or 4.
    prefix: usize,
    /// The first sequence parameter set, if readable.
    pub sps: Option<Sps>,
}

impl Setup {
    /// Reads a decoder configuration record (ISO/IEC 14496-15, 5.2.4.1).
    pub(crate) fn read(avcc: &[u8]) -> Decoded<Self> {
        let parse = || {
            let prefix = usize::from(*avcc.get(4)? & 3) + 1;
            let mut rest = avcc.get(5..)?;
            let mut parameters = Vec::new();
            for mask in [31, 255] {
                let (&count, after) = rest.split_first()?;
                rest = after;
                for _ in 0..count & mask {
                    let (length, after) = rest.split_first_chunk::<2>()?;
                    let (nal, after) = after.split_at_checked(usize::from(u16::from_be_bytes(*length)))?;
                    parameters.push(nal.to_vec());
                    rest = after;
                }
            }
            (prefix != 3).then_some((parameters, prefix))
        };
        let (parameters, prefix) =
            parse().ok_or_else(|| DecodeError::damaged("its decoder configuration (box \"avcC\") is cut off"))?;
        let mut sps = None;
        for set in parameters.iter().filter(|nal| is_sequence_set(nal)) {
            let parsed = check_size(set)?;
            sps = sps.or(Some(parsed));
        }
        Ok(Self { parameters, prefix, sps })
    }

    /// Fails if a frame changes the picture size to one that is too large.
    fn check(units: &[&[u8]]) -> Decoded<()> {
        units.iter().filter(|unit| is_sequence_set(unit)).try_for_each(|set| check_size(set).map(drop))
    }

    /// Whether a frame brings settings for pictures of another size than the first settings have.
    pub(crate) fn resizes(&self, frame: &[u8]) -> bool {
        let other = |unit: &&[u8]| {
            let (set, first) = (sps::parse(unit), self.sps);
            set.zip(first).is_some_and(|(set, first)| (set.width, set.height) != (first.width, first.height))
        };
        self.units(frame).is_ok_and(|units| units.iter().filter(|unit| is_sequence_set(unit)).any(other))
    }

    /// Whether a frame holds bytes that no encoder writes: two zeros and a byte below 3 (ITU-T H.264, 7.4.1). Zeros at the end of a
    /// unit are padding.
    pub(crate) fn is_damaged(&self, frame: &[u8]) -> bool {
        let illegal = |unit: &&[u8]| {
            let end = unit.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
            unit[..end].windows(3).any(|bytes| bytes[..2] == [0, 0] && bytes[2] < 3)
        };
        self.units(frame).is_ok_and(|units| units.iter().any(illegal))
    }

    /// Whether a frame needs no other before it (an IDR picture).
    pub(crate) fn starts_anew(&self, frame: &[u8]) -> Decoded<bool> {
        Ok(self.units(frame)?.iter().any(|unit| unit[0] & 31 == 5))
    }

    /// The parameter sets with start codes.
    pub(crate) fn start(&self) -> Vec<u8> {
        annex_b(self.parameters.iter().map(Vec::as_slice))
    }

    /// A frame with start codes; `None` if it has no picture or is truncated.
    pub(crate) fn with_start_codes(&self, frame: &[u8]) -> Option<Vec<u8>> {
        let units = self.units(frame).ok()?;
        units.iter().any(|unit| matches!(unit[0] & 31, 1..=5)).then(|| annex_b(units.into_iter()))
    }

    /// The NAL units of a frame, without their lengths.
    fn units<'a>(&self, mut frame: &'a [u8]) -> Decoded<Vec<&'a [u8]>> {
        let mut units = Vec::new();
        while !frame.is_empty() {
            let cut = || {
                let have = frame.len();
                DecodeError::damaged(format!("a part of the coded frame is longer than the {have} bytes left of it"))
            };
            let (length, rest) = frame.split_at_checked(self.prefix).ok_or_else(cut)?;
            let length = length.iter().fold(0, |n, &byte| n << 8 | usize::from(byte));
            let (unit, rest) = rest.split_at_checked(length).ok_or_else(cut)?;
            if !unit.is_empty() {
                units.push(unit);
            }
            frame = rest;
        }
        Ok(units)
    }
}

fn is_sequence_set(nal: &[u8]) -> bool {
    nal.first().is_some_and(|head| head & 31 == 7)
}

/// The content of a sequence parameter set. Its size is untrusted, and decoders allocate by it: a picture and up to
/// sixteen reference pictures.
fn check_size(set: &[u8]) -> Decoded<Sps> {
    let unread = || DecodeError::Unsupported("settings (a sequence parameter set) that cannot be read".into());
    let sps = sps::parse(set).ok_or_else(unread)?;
    let size = sps.coded;
    memory::check(format_args!("H.264 video of {size} pixels"), memory::of_picture(size.width, size.height) / 2 * 3)?;
    Ok(sps)
}

/// A decoder in mid-stream.
pub(super) enum Decoder {
    /// rusty_h264: 8 bits, 4:2:0, progressive.
    Rusty(Box<rusty_h264::Decoder>),
    /// rust_h264.
    Rust(Box<rust_h264::decoder::Decoder>),
}

impl Decoder {
    /// The faster decoder.
    pub(crate) fn fast(setup: &Setup) -> Decoded<Self> {
        if setup.sps.is_some_and(|sps| sps.cropped_before) {
            return Err(DecodeError::Unsupported("cropping at the left or the top".into()));
        }
        let mut decoder = Self::Rusty(Box::new(rusty_h264::Decoder::new()));
        decoder.feed(&setup.start())?;
        Ok(decoder)
    }

    /// The decoder that supports more.
    pub(crate) fn wide(setup: &Setup) -> Decoded<Self> {
        let mut decoder = Box::new(rust_h264::decoder::Decoder::new());
        let bytes = setup.start();
        guard(|| {
            for nal in rust_h264::nal::parse_annex_b(&bytes) {
                decoder.decode_nal(&nal).map_err(wide_trouble)?;
            }
            Ok(())
        })?;
        Ok(Self::Rust(decoder))
    }

    /// For people.
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Rusty(_) => "H.264 (built-in decoder)",
            Self::Rust(_) => "H.264 (built-in decoder for 10 bits, 4:2:2 and interlaced video)",
        }
    }

    /// Decodes one frame as stored in the file. `None` if it has settings only. After an error the decoder is
    /// unusable.
    pub(crate) fn decode(&mut self, setup: &Setup, frame: &[u8]) -> Decoded<Option<Yuv>> {
        let units = setup.units(frame)?;
        Setup::check(&units)?;
        let coded = units.iter().any(|unit| matches!(unit[0] & 31, 1..=5));
        let picture = match self {
            Self::Rusty(_) => self.feed(&annex_b(units.into_iter()))?,
            Self::Rust(decoder) => guard(|| {
                let mut picture = None;
                for nal in parse_avcc(frame, setup.prefix) {
                    picture = decoder.decode_nal(&nal).map_err(wide_trouble)?.or(picture);
                }
                Ok(decoder.flush().or(picture).map(eight_bits))
            })?,
        };
        match picture {
            None if coded => Err(DecodeError::damaged("parts of the coded picture are missing")),
            Some(picture) if !picture.is_valid() => Err(DecodeError::damaged("the decoder gave an impossible picture")),
            Some(picture) if setup.sps.is_some_and(|sps| sps.height == 2 * picture.height) && !setup.resizes(frame) => {
                Err(DecodeError::Unsupported("single fields (interlaced video) stored as frames".into()))
            }
            picture => Ok(picture),
        }
    }

    fn feed(&mut self, annex_b: &[u8]) -> Decoded<Option<Yuv>> {
        let Self::Rusty(decoder) = self else { unreachable!("only the fast decoder is fed start codes") };
        let picture = guard(|| {
            decoder.decode(annex_b).map_err(|error| match error {
                rusty_h264::DecodeError::Unsupported(what) if !is_damage(what) => DecodeError::Unsupported(what.into()),
                error => DecodeError::damaged(format!("the coded picture makes no sense ({error})")),
            })
        })?;
        Ok(picture.map(|p| {
            let chroma = Size::new(p.width.div_ceil(2), p.height.div_ceil(2));
            Yuv { width: p.width, height: p.height, chroma, y: p.y, u: p.u, v: p.v }
        }))
    }
}

fn guard<T>(decode: impl FnOnce() -> Decoded<T>) -> Decoded<T> {
    quiet::catch(decode)
        .unwrap_or_else(|panic| Err(DecodeError::damaged(format!("the coded picture makes no sense ({panic})"))))
}

/// Whether an "unsupported" error of a decoder can only come from damage.
fn is_damage(what: &str) -> bool {
    ["invalid", "without reference", "out of range", "missing", "mb_type"].iter().any(|sign| what.contains(sign))
}

fn wide_trouble(error: rust_h264::error::DecodeError) -> DecodeError {
    match error {
        rust_h264::error::DecodeError::Unsupported(what) if !is_damage(what) => DecodeError::Unsupported(what.into()),
        error => DecodeError::damaged(format!("the coded picture makes no sense ({error})")),
    }
}

fn annex_b<'a>(units: impl Iterator<Item = &'a [u8]>) -> Vec<u8> {
    units.flat_map(|unit| [&[0, 0, 0, 1], unit].concat()).collect()
}

fn eight_bits(frame: rust_h264::decoder::Frame) -> Yuv {
    let (width, height) = (frame.width as usize, frame.height as usize);
    let chroma = Size::new(frame.chroma_width() as usize, frame.chroma_height() as usize);
    let shift = frame.bit_depth.saturating_sub(8);
    let reduce = |plane: Vec<u8>| match shift {
        0 => plane,
        _ => plane.chunks_exact(2).map(|pair| (u16::from_le_bytes([pair[0], pair[1]]) >> shift) as u8).collect(),
    };
    Yuv { width, height, chroma, y: reduce(frame.y), u: reduce(frame.u), v: reduce(frame.v) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sequence parameter set of the baseline profile, of so many blocks of 16 × 16 pixels, of which all is shown, or so many
    /// blocks at the left.
    fn set(columns: u32, rows: u32, shown: Option<u32>) -> Vec<u8> {
        let mut bits = vec![];
        let code = |value: u32, bits: &mut Vec<bool>| {
            let n = 32 - (value + 1).leading_zeros();
            bits.extend((0..2 * n - 1).rev().map(|k| k < n && (value + 1) >> k & 1 == 1));
        };
        // Set 0, frame numbers of 4 bits, order as decoded, one reference, no gaps.
        [0, 0, 2, 1].into_iter().for_each(|value| code(value, &mut bits));
        bits.push(false);
        [columns - 1, rows - 1].into_iter().for_each(|value| code(value, &mut bits));
        // Frames only, direct inference, cropping at the right in units of 2 pixels, no usability, the end.
        bits.extend([true, true, shown.is_some()]);
        let cropped = shown.map(|shown| [0, (columns - shown) * 8, 0, 0]);
        cropped.into_iter().flatten().for_each(|value| code(value, &mut bits));
        bits.extend([false, true]);
        let mut bytes = vec![0x67, 66, 0, 30];
        bytes.extend(
            bits.chunks(8).map(|byte| byte.iter().enumerate().map(|(k, bit)| u8::from(*bit) << (7 - k)).sum::<u8>()),
        );
        bytes
    }

    fn record(set: &[u8]) -> Vec<u8> {
        [&[1, 66, 0, 30, 0xff, 0xe1][..], &(set.len() as u16).to_be_bytes(), set, &[0]].concat()
    }

    #[test]
    fn a_stream_that_claims_much_is_refused_before_it_is_decoded() {
        let small = Setup::read(&record(&set(4, 3, None))).expect("a small picture");
        assert_eq!(small.sps.map(|sps| (sps.width, sps.height)), Some((64, 48)));
        let large = set(2000, 2000, None);
        for set in [&large, &set(2000, 2000, Some(1))] {
            let Err(DecodeError::Damaged(said)) = Setup::read(&record(set)) else { panic!("32000 x 32000 is taken") };
            assert!(said.contains("32000 x 32000") && said.contains("--max-memory"), "{said}");
        }
        // In the middle of a stream, too.
        let frame = [&(large.len() as u32).to_be_bytes()[..], &large].concat();
        for mut decoder in [Decoder::fast(&small).expect("settings"), Decoder::wide(&small).expect("settings")] {
            assert!(matches!(decoder.decode(&small, &frame), Err(DecodeError::Damaged(_))));
        }
        assert!(matches!(Setup::read(&record(&[0x67, 66])), Err(DecodeError::Unsupported(_))));
    }
}
