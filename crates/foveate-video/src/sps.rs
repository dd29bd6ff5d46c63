//! The part of an H.264 sequence parameter set that the decoders do not expose: picture size, cropping, pixel shape
//! and colour coding (ITU-T H.264, 7.3.2.1.1 and E.1.1).

use crate::aspect::Aspect;
use foveate_core::geometry::Size;

/// The fields read from a sequence parameter set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Sps {
    /// Width and height of the shown picture in pixels.
    pub width: usize,
    pub height: usize,
    /// The coded size, in whole blocks, before cropping: the size that decoders allocate.
    pub coded: Size,
    /// Whether pixels are cropped away at the left or the top.
    pub cropped_before: bool,
    /// Matrix coefficients of table E-5, if present; 2 is "unspecified".
    pub matrix: Option<u16>,
    /// Samples use 0 to 255, not 16 to 235.
    pub full_range: bool,
    /// Width over height of a pixel, if present.
    pub aspect: Option<Aspect>,
}

/// Reads a NAL unit of type 7, with its header byte. `None` if it is truncated or invalid.
pub(super) fn parse(nal: &[u8]) -> Option<Sps> {
    let payload = nal.get(1..)?;
    let mut rbsp = Vec::with_capacity(payload.len());
    for (i, &byte) in payload.iter().enumerate() {
        if !(byte == 3 && i >= 2 && payload[i - 2..i] == [0, 0]) {
            rbsp.push(byte);
        }
    }
    let mut r = Bits { bytes: &rbsp, at: 0 };
    let profile = r.bits(8)?;
    r.bits(16)?;
    r.ue()?;
    let mut chroma = 1;
    if [100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135].contains(&profile) {
        chroma = r.ue()?;
        if chroma == 3 {
            r.bits(1)?;
        }
        r.ue()?;
        r.ue()?;
        r.bits(1)?;
        if r.bits(1)? == 1 {
            for i in 0..if chroma == 3 { 12 } else { 8 } {
                if r.bits(1)? == 1 {
                    scaling_list(&mut r, if i < 6 { 16 } else { 64 })?;
                }
            }
        }
    }
    r.ue()?;
    match r.ue()? {
        0 => {
            r.ue()?;
        }
        1 => {
            r.bits(1)?;
            r.ue()?;
            r.ue()?;
            for _ in 0..r.ue()?.min(256) {
                r.ue()?;
            }
        }
        _ => {}
    }
    r.ue()?;
    r.bits(1)?;
    let (columns, rows) = (r.ue()?.checked_add(1)?, r.ue()?.checked_add(1)?);
    let frames_only = r.bits(1)?;
    if frames_only == 0 {
        r.bits(1)?;
    }
    r.bits(1)?;
    let [mut left, mut right, mut top, mut bottom] = [0; 4];
    if r.bits(1)? == 1 {
        [left, right, top, bottom] = [r.ue()?, r.ue()?, r.ue()?, r.ue()?];
    }
    let side = |blocks: u32, cut: [u32; 2], unit: u32| {
        let pixels = u64::from(blocks) * 16;
        let shown = pixels.checked_sub((u64::from(cut[0]) + u64::from(cut[1])) * u64::from(unit))?;
        (pixels <= 1 << 16 && shown > 0 && shown < 1 << 16).then_some((pixels as usize, shown as usize))
    };
    let field = 2 - frames_only;
    let unit_x = if matches!(chroma, 1 | 2) { 2 } else { 1 };
    let unit_y = if chroma == 1 { 2 } else { 1 } * field;
    let (coded_width, width) = side(columns, [left, right], unit_x)?;
    let (coded_height, height) = side(rows.checked_mul(field)?, [top, bottom], unit_y)?;
    let coded = Size::new(coded_width, coded_height);
    let mut sps = Sps { width, height, coded, cropped_before: left > 0 || top > 0, ..Sps::default() };
    // It may be missing, or end early.
    let _ = usability(&mut r, &mut sps);
    Some(sps)
}

/// Width over height of a pixel, by number from 1 (table E-1).
const ASPECTS: [(u32, u32); 16] = [
    (1, 1),
    (12, 11),
    (10, 11),
    (16, 11),
    (40, 33),
    (24, 11),
    (20, 11),
    (32, 11),
    (80, 33),
    (18, 11),
    (15, 11),
    (64, 33),
    (160, 99),
    (4, 3),
    (3, 2),
    (2, 1),
];

/// Video usability information, as far as the colours.
fn usability(r: &mut Bits<'_>, sps: &mut Sps) -> Option<()> {
    if r.bits(1)? == 0 {
        return None;
    }
    if r.bits(1)? == 1 {
        let (across, down) = match r.bits(8)? as usize {
            255 => (r.bits(16)?, r.bits(16)?),
            number => ASPECTS.get(number.wrapping_sub(1)).copied().unwrap_or((0, 0)),
        };
        sps.aspect = Aspect::new(across, down);
    }
    if r.bits(1)? == 1 {
        r.bits(1)?;
    }
    if r.bits(1)? == 0 {
        return None;
    }
    r.bits(3)?;
    sps.full_range = r.bits(1)? == 1;
    if r.bits(1)? == 1 {
        r.bits(16)?;
        sps.matrix = Some(r.bits(8)? as u16);
    }
    Some(())
}

fn scaling_list(r: &mut Bits<'_>, n: usize) -> Option<()> {
    let (mut last, mut next) = (8i64, 8);
    for _ in 0..n {
        if next != 0 {
            let code = i64::from(r.ue()?);
            let delta = if code % 2 == 1 { (code + 1) / 2 } else { -(code / 2) };
            next = (last + delta).rem_euclid(256);
        }
        last = if next == 0 { last } else { next };
    }
    Some(())
}

/// Bits from the front, most significant first.
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Bits<'_> {
    fn bits(&mut self, n: usize) -> Option<u32> {
        let mut value = 0;
        for _ in 0..n {
            let byte = *self.bytes.get(self.at / 8)?;
            value = value << 1 | u32::from(byte >> (7 - self.at % 8) & 1);
            self.at += 1;
        }
        Some(value)
    }
    /// An Exp-Golomb code.
    fn ue(&mut self) -> Option<u32> {
        let mut zeros = 0;
        while self.bits(1)? == 0 {
            zeros += 1;
            if zeros > 31 {
                return None;
            }
        }
        Some((1u32 << zeros) - 1 + self.bits(zeros)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(hex: &str) -> Vec<u8> {
        (0..hex.len()).step_by(2).map(|i| u8::from_str_radix(&hex[i..i + 2], 16).expect("hexadecimal")).collect()
    }

    /// Sets that x264 wrote from known settings.
    #[test]
    fn sets_of_every_kind_are_read() {
        let kinds = [
            ("6764000aacd947378888c05b808080a0000003002000000641e244b2c0", (98, 82, (112, 96), false, Some(1), true)),
            ("6742c00ad907378888c044000003000400000300c83c489920", (98, 82, (112, 96), false, None, false)),
            ("677a000ab6cd94737888fc0440000003004000000c83c4896580", (98, 82, (112, 96), false, None, false)),
            (
                "67640015acd9466fc9ff80ab80a43502020640000003004000000c87c50a6580",
                (96, 84, (96, 96), false, Some(6), false),
            ),
            (
                "67f40028919b280f0044fc4ffe0372052020000003002000000641e30632c0",
                (1920, 1080, (1920, 1088), false, None, false),
            ),
            ("6764000aacd9473762108c05b808080a000003000200000300641e244b2c", (94, 80, (112, 96), true, Some(1), true)),
        ];
        for (hex, (width, height, coded, cropped_before, matrix, full_range)) in kinds {
            let found = parse(&bytes(hex)).expect("a good set");
            let found = Sps { matrix: found.matrix.filter(|&matrix| matrix != 2), ..found };
            let (coded, aspect) = (coded.into(), found.aspect);
            assert_eq!(found, Sps { width, height, coded, cropped_before, matrix, full_range, aspect }, "{hex}");
            for n in 0..hex.len() / 2 - 1 {
                let _ = parse(&bytes(&hex[..2 * n]));
            }
        }
    }
    /// As x264 writes pixels of 64:45, by numbers, and of 16:11, by its place in the table.
    #[test]
    fn the_shape_of_a_pixel_is_read() {
        for (hex, aspect) in [
            ("6764000aacd9462effc010000b44000003000400000300c83c489658", Aspect::new(64, 45)),
            ("6764000aacd9462ec104000003000400000300c83c489658", Aspect::new(16, 11)),
        ] {
            assert_eq!(parse(&bytes(hex)).expect("a good set").aspect, aspect);
        }
    }
}
