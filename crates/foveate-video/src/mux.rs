//! The index of an MP4 file with one H.264 track (ISO/IEC 14496-12 and -15).
//!
//! Frames lie in the `mdat` boxes before it, each in a chunk of its own, so that a file is written
//! from front to back and no more of it is held than this index.

use crate::timing::Timing;
use crate::yuv::Colour;

/// Frames of one track, as they lie in the file.
#[derive(Debug, Default)]
pub(super) struct Track {
    /// Sequence and picture parameter set, once known.
    pub parameters: Option<(Vec<u8>, Vec<u8>)>,
    pub offsets: Vec<u64>,
    pub sizes: Vec<u32>,
    /// Frames that need no other before them, counted from 1.
    pub keys: Vec<u32>,
}

/// The first box of the file.
pub(super) fn file_type() -> Vec<u8> {
    bx(b"ftyp", &[b"isom", &512u32.to_be_bytes(), b"isomiso2avc1mp41"])
}

impl Track {
    /// The last box of the file. Sides in pixels, even and below 65536.
    pub(crate) fn index(&self, width: usize, height: usize, timing: &Timing, colour: Colour) -> Vec<u8> {
        let length = timing.length().to_be_bytes();
        let scale = timing.scale.to_be_bytes();
        let runs: Vec<u32> = timing.runs.iter().flat_map(|(count, each)| [*count, *each]).collect();
        let (width, height) = ((width as u16).to_be_bytes(), (height as u16).to_be_bytes());
        let matrix: Vec<u8> = [0x1_0000u32, 0, 0, 0, 0x1_0000, 0, 0, 0, 0x4000_0000].map(u32::to_be_bytes).concat();
        let one = 1u32.to_be_bytes();

        let mvhd = full(
            b"mvhd",
            1,
            0,
            &[&[0; 16], &scale, &length, &[0, 1, 0, 0], &[0; 12], &matrix, &[0; 24], &[0, 0, 0, 2]],
        );
        let shown_and_used = 3;
        let tkhd = full(
            b"tkhd",
            1,
            shown_and_used,
            &[&[0; 16], &one, &[0; 4], &length, &[0; 16], &matrix, &width, &[0; 2], &height, &[0; 2]],
        );
        let undetermined_language = [0x55, 0xc4, 0, 0];
        let mdhd = full(b"mdhd", 1, 0, &[&[0; 16], &scale, &length, &undetermined_language]);
        let hdlr = full(b"hdlr", 0, 0, &[&[0; 4], b"vide", &[0; 12], b"video\0"]);
        let dinf = bx(b"dinf", &[&full(b"dref", 0, 0, &[&one, &full(b"url ", 0, 1, &[])])]);

        let (sps, pps) = self.parameters.as_ref().map_or((&[][..], &[][..]), |(sps, pps)| (sps, pps));
        let four_byte_lengths = 0xff;
        let profile = sps.get(1..4).unwrap_or(&[66, 0xc0, 30]);
        let avcc = bx(b"avcC", &[&[1], profile, &[four_byte_lengths, 0xe1], &two(sps), sps, &[1], &two(pps), pps]);
        let code = if colour.is_bt709() { 1u16 } else { 6 }.to_be_bytes();
        let colr = bx(b"colr", &[b"nclx", &code, &code, &code, &[0]]);
        let inch = [0, 72, 0, 0];
        let avc1 = bx(
            b"avc1",
            &[
                &[0, 0, 0, 0, 0, 0, 0, 1],
                &[0; 16],
                &width,
                &height,
                &inch,
                &inch,
                &[0; 4],
                &[0, 1],
                &[0; 32],
                &[0, 24, 0xff, 0xff],
                &avcc,
                &colr,
            ],
        );
        let n = (self.sizes.len() as u32).to_be_bytes();
        let stbl = bx(
            b"stbl",
            &[
                &full(b"stsd", 0, 0, &[&one, &avc1]),
                &full(b"stts", 0, 0, &[&(timing.runs.len() as u32).to_be_bytes(), &words(&runs)]),
                &full(b"stss", 0, 0, &[&(self.keys.len() as u32).to_be_bytes(), &words(&self.keys)]),
                &full(b"stsc", 0, 0, &[&one, &one, &one, &one]),
                &full(b"stsz", 0, 0, &[&[0; 4], &n, &words(&self.sizes)]),
                &full(b"co64", 0, 0, &[&n, &self.offsets.iter().flat_map(|at| at.to_be_bytes()).collect::<Vec<u8>>()]),
            ],
        );
        let vmhd = full(b"vmhd", 0, 1, &[&[0; 8]]);
        let mdia = bx(b"mdia", &[&mdhd, &hdlr, &bx(b"minf", &[&vmhd, &dinf, &stbl])]);
        bx(b"moov", &[&mvhd, &bx(b"trak", &[&tkhd, &mdia])])
    }
}

/// A box: its length, its name, its parts.
pub(super) fn bx(name: &[u8; 4], parts: &[&[u8]]) -> Vec<u8> {
    let length = 8 + parts.iter().map(|part| part.len()).sum::<usize>();
    let length = u32::try_from(length).expect("what is put in one box is held in memory and far below 4 GiB");
    [&length.to_be_bytes(), name]
        .into_iter()
        .map(|part| &part[..])
        .chain(parts.iter().copied())
        .collect::<Vec<_>>()
        .concat()
}

fn full(name: &[u8; 4], version: u8, flags: u8, parts: &[&[u8]]) -> Vec<u8> {
    bx(name, &[&[&[version, 0, 0, flags][..]], parts].concat())
}

fn two(bytes: &[u8]) -> [u8; 2] {
    (bytes.len() as u16).to_be_bytes()
}

fn words(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_be_bytes()).collect()
}
