//! MP4 files: which bytes are which frame, and when it is shown (ISO/IEC 14496-12, plain and fragmented).
//!
//! Only the index is held in memory. Every count in it is checked against the number of bytes and the memory limit,
//! and every read against the end, so no file can cause a panic, a hang, or memory beyond its size. re_mp4 does not
//! guarantee this; it is the oracle of the tests.

mod boxes;

use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};

use crate::aspect::Aspect;
use crate::decoded::{DecodeError, Decoded};
use boxes::{Cursor, boxes, child, full, path, repeat, rows, rows_at};
use foveate_base::memory;
use foveate_base::text::counted;

/// The largest index that is read, in bytes, the most boxes, and the most frames (155 hours at 30 a second).
const MAX_INDEX: u64 = 1 << 29;
const MAX_BOXES: usize = 1 << 20;
const MAX_FRAMES: u64 = 1 << 24;
/// Bytes that a frame takes here: twice while the list of them grows, and once; their order of presentation takes less.
const FRAME: u64 = 3 * size_of::<Sample>() as u64;
/// Of a fragment's sample flags: it needs others.
const NOT_A_KEY: u32 = 0x1_0000;

/// The index of the first H.264 track.
#[derive(Debug)]
pub(super) struct Movie {
    /// The decoder configuration record: parameter sets and the width of length prefixes.
    pub avcc: Vec<u8>,
    /// In decoding order.
    pub samples: Vec<Sample>,
    /// Time units in a second; not 0.
    pub timescale: u32,
    /// Number of clockwise turns of the picture by 90 degrees, 0 to 3; 4 more if left and right are exchanged before.
    pub turns: u8,
    /// Width over height of a pixel, if the container has it.
    pub aspect: Option<Aspect>,
    /// Matrix coefficients and full range, as the container has them.
    pub colour: Option<(u16, bool)>,
    /// The missing part after the last sample, if the index ends too early.
    pub cut: Option<String>,
}

/// One coded frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sample {
    pub offset: u64,
    pub size: u32,
    /// Presentation time, in units of the timescale, from any origin.
    pub time: i64,
    /// False if an edit list removes the frame; it is decoded all the same.
    pub shown: bool,
    /// Whether the index marks it as a key frame.
    pub key: bool,
}

/// Reads the index of a file of `len` bytes.
pub(super) fn read(file: &mut (impl Read + Seek), len: u64) -> Decoded<Movie> {
    let (mut moov, mut moofs, mut cut, mut at) = (None, Vec::new(), None, 0);
    let mut indexed = 0;
    for _ in 0..MAX_BOXES {
        if at >= len {
            break;
        }
        let mut head = [0; 16];
        let n = (len - at).min(16) as usize;
        read_at(file, at, &mut head[..n])?;
        let mut c = Cursor(&head[..n]);
        let header = (|| Some((u64::from(c.u32()?), c.take::<4>()?)))();
        let Some((short, name)) = header else { break };
        let (size, skip) = match short {
            0 => (len - at, 8),
            1 => (c.u64().unwrap_or(0), 16),
            size => (size, 8),
        };
        let shown = String::from_utf8_lossy(&name).into_owned();
        if size < skip && moov.is_some() {
            break;
        }
        if size < skip {
            return Err(DecodeError::damaged(format!(
                "box {shown:?} at byte {at} has a length of {size} bytes, less than its head"
            )));
        }
        let whole = at.checked_add(size).is_some_and(|end| end <= len);
        if !whole {
            cut = Some(format!("box {shown:?} at byte {at} should have {size} bytes, {} are there", len - at));
        }
        if matches!(&name, b"moov" | b"moof") {
            if !whole {
                break;
            }
            indexed += size;
            if indexed > MAX_INDEX {
                return Err(DecodeError::Unsupported(format!("an index above {} MiB", MAX_INDEX >> 20)));
            }
            memory::check("the video's index", indexed)?;
            let mut body = vec![0; (size - skip) as usize];
            read_at(file, at + skip, &mut body)?;
            match &name {
                b"moov" if moov.is_none() => moov = Some(body),
                b"moof" => moofs.push((at, body)),
                _ => {}
            }
        }
        at = at.saturating_add(size);
    }
    let Some(moov) = moov else {
        let seen = cut.unwrap_or_else(|| format!("{len} bytes without one"));
        return Err(DecodeError::damaged(format!(
            "the index (box \"moov\") is missing: {seen}; the file was not written to its end"
        )));
    };
    track(&moov, &moofs, len, cut)
}

/// The video track of the index: the first one that is enabled and has more than cover pictures.
fn track(moov: &[u8], moofs: &[(u64, Vec<u8>)], len: u64, cut: Option<String>) -> Decoded<Movie> {
    let handler = |trak| path(trak, &[b"mdia", b"hdlr"]).and_then(|hdlr| hdlr.get(8..12));
    let traks = || boxes(moov).filter(|(name, _)| name == b"trak").map(|(_, trak)| trak);
    let Some(trak) = traks().filter(|trak| handler(trak) == Some(b"vide")).min_by_key(|trak| demerits(trak)) else {
        let (all, sound) = (traks().count(), traks().filter(|trak| handler(trak) == Some(b"soun")).count());
        let found = match sound == all && all > 0 {
            true => "sound alone".to_owned(),
            false => format!("{} of other kinds", counted(all, "track")),
        };
        return Err(DecodeError::Damaged(format!("expected a video track, found {found}; give a video")));
    };
    let stbl = path(trak, &[b"mdia", b"minf", b"stbl"]).ok_or_else(|| lacks("stbl"))?;
    let stsd = child(stbl, b"stsd").and_then(|stsd| stsd.get(8..)).ok_or_else(|| lacks("stsd"))?;
    let (codec, entry) = boxes(stsd).next().ok_or_else(|| lacks("stsd"))?;
    if !matches!(&codec, b"avc1" | b"avc3") {
        let codec = codec.escape_ascii();
        return Err(DecodeError::Unsupported(format!("codec \"{codec}\" (H.264, \"avc1\", is read without help)")));
    }
    if boxes(stsd).count() > 1 {
        return Err(DecodeError::Unsupported("a track of several codec settings".into()));
    }
    let mut sides = Cursor(entry.get(24..28).unwrap_or_default());
    let stored = sides.u16().zip(sides.u16());
    let entry = entry.get(78..).ok_or_else(|| lacks("avc1"))?;
    let avcc = child(entry, b"avcC").ok_or_else(|| lacks("avcC"))?.to_vec();
    // QuickTime's own kind says nothing of the range.
    let colour =
        child(entry, b"colr").filter(|colr| matches!(colr.get(..4), Some(b"nclx" | b"nclc"))).and_then(|colr| {
            let mut c = Cursor(colr.get(8..)?);
            Some((c.u16()?, colr.starts_with(b"nclx") && c.take::<1>()?[0] & 0x80 != 0))
        });

    let timescale = |head: Option<&[u8]>| {
        let head = head?;
        Cursor(head.get(if head[0] == 1 { 20 } else { 12 }..)?).u32().filter(|&scale| scale > 0)
    };
    let scale = timescale(path(trak, &[b"mdia", b"mdhd"])).ok_or_else(|| lacks("mdhd"))?;
    let tkhd = child(trak, b"tkhd").ok_or_else(|| lacks("tkhd"))?;
    let (id, turns) = track_head(tkhd).ok_or_else(|| lacks("tkhd"))?;
    let pasp = child(entry, b"pasp").and_then(|pasp| rows_at::<2>(pasp, 0).next());
    let aspect = pasp.and_then(|[across, down]| Aspect::new(across, down)).or_else(|| stretched(tkhd, stored?));

    let (mut samples, misplaced) = sample_table(stbl, len)?;
    let fragments = fragments(moov, moofs, id, len, &mut samples);
    let cut = fragments.err().or(misplaced).or(cut.filter(|_| child(moov, b"mvex").is_some()));
    if samples.is_empty() {
        let seen = cut.map_or(String::new(), |cut| format!(" ({cut})"));
        return Err(DecodeError::damaged(format!("expected frames, found an empty video track{seen}")));
    }
    if let Some(elst) = path(trak, &[b"edts", b"elst"]) {
        edit(&mut samples, elst, scale, timescale(child(moov, b"mvhd")).unwrap_or(scale))?;
    }
    Ok(Movie { avcc, samples, timescale: scale, turns, aspect, colour, cut })
}

/// Penalty of a track in the choice of the video: for a disabled track, and more for a single picture such as a
/// cover.
fn demerits(trak: &[u8]) -> u8 {
    let enabled = child(trak, b"tkhd").and_then(full).is_some_and(|(flags, _)| flags & 1 != 0);
    let stsd = path(trak, &[b"mdia", b"minf", b"stbl", b"stsd"]).and_then(|stsd| stsd.get(8..));
    let still = stsd
        .and_then(|stsd| boxes(stsd).next())
        .is_some_and(|(codec, _)| matches!(&codec, b"jpeg" | b"mjpg" | b"png "));
    let single =
        path(trak, &[b"mdia", b"minf", b"stbl", b"stsz"]).and_then(|stsz| rows_at::<1>(stsz, 8).next()) == Some([1]);
    u8::from(!enabled) + 2 * u8::from(still || single)
}

/// The shape of a pixel, if the sides in the track's header (in 1/65536 of a pixel) have another ratio than the
/// pictures.
fn stretched(tkhd: &[u8], (width, height): (u16, u16)) -> Option<Aspect> {
    let [wide, high] = rows_at::<2>(tkhd, if tkhd.first() == Some(&1) { 88 } else { 76 }).next()?;
    let (over, under) = (u64::from(wide) * u64::from(height), u64::from(high) * u64::from(width));
    let ratio = over as f64 / under as f64;
    // Rounding of the sides is no statement.
    if !(ratio.is_finite() && (ratio - 1.0).abs() > 0.02) {
        return None;
    }
    let shift = 32 - over.max(under).leading_zeros().min(32);
    Aspect::new((over >> shift) as u32, (under >> shift) as u32)
}

/// Track number, and turns from the matrix.
fn track_head(tkhd: &[u8]) -> Option<(u32, u8)> {
    let long = *tkhd.first()? == 1;
    let id = Cursor(tkhd.get(if long { 20 } else { 12 }..)?).u32()?;
    let mut c = Cursor(tkhd.get(if long { 52 } else { 40 }..)?);
    let (a, b) = (c.u32()? as i32, c.u32()? as i32);
    let (_, c, d) = (c.u32()?, c.u32()? as i32, c.u32()? as i32);
    Some((
        id,
        match (a.signum(), b.signum(), c.signum(), d.signum()) {
            (0, 1, -1, 0) => 1,
            (-1, 0, 0, -1) => 2,
            (0, -1, 1, 0) => 3,
            (-1, 0, 0, 1) => 4,
            (0, -1, -1, 0) => 5,
            (1, 0, 0, -1) => 6,
            (0, 1, 1, 0) => 7,
            _ => 0,
        },
    ))
}

/// The frames of a file without fragments, with the gaps in its tables.
fn sample_table(stbl: &[u8], len: u64) -> Decoded<(Vec<Sample>, Option<String>)> {
    let Some(stsz) = child(stbl, b"stsz") else {
        return Err(DecodeError::Unsupported("an index without sample sizes (box \"stsz\")".into()));
    };
    let mut c = Cursor(stsz.get(4..).unwrap_or_default());
    let (Some(same), Some(count)) = (c.u32(), c.u32()) else { return Err(lacks("stsz")) };
    let room = if same == 0 { c.0.len() as u64 / 4 } else { len / u64::from(same) };
    if u64::from(count) > room.min(MAX_FRAMES) {
        return Err(DecodeError::damaged(format!(
            "its index (box \"stsz\") claims {count} frames, the file can hold {room}"
        )));
    }
    let mut sizes = std::iter::from_fn(|| if same == 0 { c.u32() } else { Some(same) });
    let times = |name| child(stbl, name).into_iter().flat_map(rows::<2>).flat_map(|[n, x]| repeat(x, n));
    let (mut deltas, mut shifts) = (times(b"stts"), times(b"ctts"));

    let narrow = child(stbl, b"stco").into_iter().flat_map(rows::<1>).map(|[at]| u64::from(at));
    let wide = child(stbl, b"co64").into_iter().flat_map(rows::<2>);
    let chunks = narrow.chain(wide.map(|[high, low]| u64::from(high) << 32 | u64::from(low)));
    let mut layout = child(stbl, b"stsc").into_iter().flat_map(rows::<3>).peekable();

    // Without a list of them every frame is one.
    let listed = child(stbl, b"stss");
    let mut keys = listed.into_iter().flat_map(rows::<1>).map(|[number]| number as usize).peekable();

    let mut samples = Vec::new();
    make_room(&mut samples, count)?;
    let (mut decoded, mut delta, mut per_chunk) = (0, 0, 0);
    for (number, mut offset) in (1..).zip(chunks) {
        while let Some([_, n, _]) = layout.next_if(|&[first, _, _]| first <= number) {
            per_chunk = n;
        }
        for _ in 0..per_chunk.min(count - samples.len() as u32) {
            let size = sizes.next().unwrap_or(0);
            let time = decoded + i64::from(shifts.next().unwrap_or(0) as i32);
            while keys.next_if(|&number| number <= samples.len()).is_some() {}
            let key = listed.is_none() || keys.peek() == Some(&(samples.len() + 1));
            samples.push(Sample { offset, size, time, shown: true, key });
            offset = offset.saturating_add(u64::from(size));
            delta = deltas.next().unwrap_or(delta);
            decoded += i64::from(delta);
        }
    }
    let placed = samples.len();
    let misplaced =
        (placed < count as usize).then(|| format!("the index counts {count} frames and has the places of {placed}"));
    Ok((samples, misplaced))
}

/// Appends the frames of the fragments, until one cannot be understood.
fn fragments(
    moov: &[u8],
    moofs: &[(u64, Vec<u8>)],
    id: u32,
    len: u64,
    samples: &mut Vec<Sample>,
) -> Result<(), String> {
    let trex = child(moov, b"mvex").into_iter().flat_map(boxes).filter(|(name, _)| name == b"trex");
    let trex = trex.filter_map(|(_, trex)| rows_at::<5>(trex, 4).next()).map(|row| (row[0], row));
    let defaults: BTreeMap<u32, [u32; 5]> = trex.collect();
    let mut decoded = 0;
    for (start, moof) in moofs {
        let mut end = *start;
        for (_, traf) in boxes(moof).filter(|(name, _)| name == b"traf") {
            let what = format!("the fragment at byte {start} is damaged");
            let tfhd = child(traf, b"tfhd").ok_or(&what)?;
            let (flags, mut c) = full(tfhd).ok_or(&what)?;
            // The bytes of other tracks count: those of the next track may begin behind them.
            let track = c.u32().ok_or(&what)?;
            let [_, _, default_delta, default_size, default_flags] = defaults.get(&track).copied().unwrap_or_default();
            let base = if flags & 1 != 0 {
                c.u64().ok_or(&what)?
            } else if flags & 0x20000 != 0 {
                *start
            } else {
                end
            };
            let mut optional = |bit| if flags & bit == 0 { Some(None) } else { c.u32().map(Some) };
            let _description = optional(2).ok_or(&what)?;
            let default_delta = optional(8).ok_or(&what)?.unwrap_or(default_delta);
            let default_size = optional(16).ok_or(&what)?.unwrap_or(default_size);
            let default_flags = optional(32).ok_or(&what)?.unwrap_or(default_flags);
            if let Some(tfdt) = child(traf, b"tfdt").filter(|_| track == id) {
                let long = tfdt.first() == Some(&1);
                let mut c = Cursor(tfdt.get(4..).ok_or(&what)?);
                decoded = if long { c.u64() } else { c.u32().map(u64::from) }.ok_or(&what)? as i64;
            }
            end = base;
            for (_, trun) in boxes(traf).filter(|(name, _)| name == b"trun") {
                let (flags, mut c) = full(trun).ok_or(&what)?;
                let count = c.u32().ok_or(&what)?;
                if flags & 1 != 0 {
                    end = base.saturating_add_signed(i64::from(c.u32().ok_or(&what)? as i32));
                }
                let mut first_flags = if flags & 4 != 0 { Some(c.u32().ok_or(&what)?) } else { None };
                if track != id && flags & 0x200 == 0 {
                    end = end.saturating_add(u64::from(count) * u64::from(default_size));
                    continue;
                }
                let fields = u64::from((flags >> 8 & 15).count_ones());
                let room = (c.0.len() as u64).checked_div(4 * fields).unwrap_or(len / 4);
                if u64::from(count) > room || samples.len() as u64 + u64::from(count) > MAX_FRAMES.min(len / 4) {
                    return Err(format!("the fragment at byte {start} claims {count} frames, more than it can hold"));
                }
                if track == id {
                    make_room(samples, count).map_err(|error| error.to_string())?;
                }
                for _ in 0..count {
                    let mut field = |bit, default| if flags & bit == 0 { default } else { c.u32().unwrap_or(default) };
                    let (delta, size) = (field(0x100, default_delta), field(0x200, default_size));
                    let (own, shift) = (field(0x400, default_flags), field(0x800, 0) as i32);
                    if track == id {
                        let time = decoded.saturating_add(i64::from(shift));
                        let key = first_flags.take().unwrap_or(own) & NOT_A_KEY == 0;
                        samples.push(Sample { offset: end, size, time, shown: true, key });
                        decoded = decoded.saturating_add(i64::from(delta));
                    }
                    end = end.saturating_add(u64::from(size));
                }
            }
        }
    }
    Ok(())
}

/// Reserves memory for so many more frames, within the limit.
fn make_room(samples: &mut Vec<Sample>, more: u32) -> foveate_base::Result<()> {
    let (frames, more) = (samples.len() + more as usize, more as usize);
    if frames > samples.capacity() {
        memory::check(format_args!("an index of {frames} frames"), frames as u64 * FRAME)?;
        samples.reserve(more);
    }
    Ok(())
}

/// Hides the frames that the edit list removes; shows all if none would remain.
fn edit(samples: &mut [Sample], elst: &[u8], scale: u32, movie_scale: u32) -> Decoded<()> {
    let long = elst.first() == Some(&1);
    let wide = |high: u32, low: u32| (u64::from(high) << 32 | u64::from(low)) as i64;
    let edits: Vec<(i64, i64)> = if long {
        rows::<5>(elst).map(|[a, b, c, d, _]| (wide(a, b), wide(c, d))).collect()
    } else {
        rows::<3>(elst).map(|[a, b, _]| (i64::from(a), i64::from(b as i32))).collect()
    };
    let mut kept = edits.iter().filter(|(_, start)| *start >= 0);
    let Some(&(duration, start)) = kept.next() else { return Ok(()) };
    if kept.next().is_some() {
        return Err(DecodeError::Unsupported("an edit list of several parts".into()));
    }
    let (scale, movie_scale) = (i128::from(scale), i128::from(movie_scale));
    let duration = (i128::from(duration) * scale + movie_scale / 2) / movie_scale;
    let inside = |sample: &Sample| {
        let after = i128::from(sample.time) - i128::from(start);
        after >= 0 && (duration <= 0 || after < duration)
    };
    if samples.iter().any(inside) {
        samples.iter_mut().for_each(|sample| sample.shown = inside(sample));
    }
    Ok(())
}

/// Fills `bytes` from byte `at` of the file.
pub(super) fn read_at(file: &mut (impl Read + Seek), at: u64, bytes: &mut [u8]) -> Decoded<()> {
    file.seek(SeekFrom::Start(at))
        .and_then(|_| file.read_exact(bytes))
        .map_err(|error| DecodeError::damaged(format!("cannot read {} bytes at byte {at}: {error}", bytes.len())))
}

fn lacks(name: &str) -> DecodeError {
    DecodeError::damaged(format!("its index lacks a good box {name:?}"))
}
