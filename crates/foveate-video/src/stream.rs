//! The frames of an MP4 file: decoded in the order of the file, handed out in the order of presentation.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;

use crate::Remarks;
use crate::aspect::Aspect;
use crate::child::Leash;
use crate::decoded::{DecodeError, Decoded, Picture};
use crate::ffmpeg_decoder::Feed;
use crate::h264::{Decoder, Setup};
use crate::mp4;
use crate::mp4::{Movie, Sample};
use crate::turn::turned;
use crate::yuv::{Colour, Yuv};
use foveate_base::memory;
use foveate_core::geometry::Size;
use foveate_core::scene::Image;

/// Bytes with random access: a file or its equivalent.
pub(crate) trait Bytes: Read + Seek + Send {}
impl<T: Read + Seek + Send> Bytes for T {}

/// The report for a frame with bytes that no encoder writes.
const ILLEGAL: &str = "bytes that H.264 never has";
/// How many pictures may wait for one that is shown before them; H.264 allows 16.
const MAX_WAITING: usize = 32;

/// An MP4 file in mid-stream.
pub(super) struct Mp4 {
    file: Box<dyn Bytes>,
    len: u64,
    movie: Movie,
    setup: Setup,
    decoder: Decoder,
    aspect: Aspect,
    remarks: Remarks,
    /// Samples in the order of presentation, and the position of each shown sample in it.
    order: Vec<u32>,
    rank: Vec<Option<u32>>,
    /// How many places of the order are done, and how many samples are decoded.
    out: usize,
    fed: usize,
    waiting: BTreeMap<u32, Yuv>,
    bytes: Vec<u8>,
    /// The first sample needs others that are not there (an open group of pictures).
    open: bool,
    /// ffmpeg, if it decodes instead of our own decoders, and its next samples in order.
    fed_out: Option<(Feed, std::vec::IntoIter<u32>)>,
}

/// Seconds a pixel that ffmpeg saves at least, with the fast and with the wide decoder of ours (at 1080p the fast one takes 14 ms a
/// frame, ffmpeg 4); and the seconds it takes to start.
const SAVED: [f64; 2] = [3e-9, 15e-9];
const START: f64 = 0.4;

impl Mp4 {
    pub(crate) fn new(mut file: Box<dyn Bytes>, len: u64) -> Decoded<Self> {
        let movie = mp4::read(&mut file, len)?;
        let setup = Setup::read(&movie.avcc)?;
        let decoder = match Decoder::fast(&setup) {
            Err(DecodeError::Unsupported(_)) => Decoder::wide(&setup)?,
            decoder => decoder?,
        };
        let aspect = movie.aspect.or(setup.sps.and_then(|sps| sps.aspect)).unwrap_or_default();
        let (order, rank, bytes) = (Vec::new(), Vec::new(), Vec::new());
        let (waiting, open, remarks) = (BTreeMap::new(), false, Remarks::default());
        let mut mp4 = Self {
            file,
            len,
            movie,
            setup,
            decoder,
            aspect,
            remarks,
            order,
            rank,
            out: 0,
            fed: 0,
            waiting,
            bytes,
            open,
            fed_out: None,
        };
        // A first frame that cannot be read is an error when it is decoded.
        mp4.open = mp4.load(0).is_ok() && mp4.setup.starts_anew(&mp4.bytes).is_ok_and(|anew| !anew);
        let shown = |&i: &u32| mp4.movie.samples[i as usize].shown && !mp4.lost(i as usize);
        mp4.order = (0..mp4.movie.samples.len() as u32).filter(shown).collect();
        mp4.order.sort_by_key(|&i| mp4.movie.samples[i as usize].time);
        mp4.rank = vec![None; mp4.movie.samples.len()];
        (0..).zip(&mp4.order).for_each(|(place, &i)| mp4.rank[i as usize] = Some(place));
        Ok(mp4)
    }

    /// Shown before the first frame of an open group, a frame refers to others that were cut away.
    fn lost(&self, sample: usize) -> bool {
        self.open && self.movie.samples[sample].time < self.movie.samples[0].time
    }

    /// Whether ffmpeg saves more time than it takes to start.
    pub(crate) fn wants_ffmpeg(&self) -> bool {
        let sps = self.setup.sps.unwrap_or_default();
        let saved = SAVED[usize::from(matches!(self.decoder, Decoder::Rust(_)))];
        saved * (sps.width * sps.height) as f64 * self.frames() as f64 > START
    }

    /// Lets ffmpeg decode, from the first frame on; `file` is this file once more.
    ///
    /// # Errors
    /// Fails if the program is not there or does not start.
    pub(crate) fn feed(&mut self, mut file: File, program: &Path, leash: &Leash) -> Result<(), String> {
        let samples: Vec<u32> = (0..self.movie.samples.len() as u32).filter(|&i| !self.lost(i as usize)).collect();
        let mut order = samples.clone();
        order.sort_by_key(|&i| self.movie.samples[i as usize].time);
        let places: Vec<_> =
            samples.iter().map(|&i| (self.movie.samples[i as usize], self.number(i as usize))).collect();
        let (setup, len, remarks, mut next) = (self.setup.clone(), self.len, self.remarks.clone(), places.into_iter());
        let mut start = Some(setup.start());
        let coded = move || {
            if let Some(start) = start.take() {
                return Some(start);
            }
            // Unreadable data ends it: our own decoders then report the fault.
            let (sample, number) = next.next().filter(|(s, _)| s.offset.saturating_add(u64::from(s.size)) <= len)?;
            may_be_held(sample.size).ok()?;
            let mut bytes = vec![0; sample.size as usize];
            mp4::read_at(&mut file, sample.offset, &mut bytes).ok()?;
            if setup.is_damaged(&bytes) {
                remarks.add_damage(number, ILLEGAL);
            }
            // It would make all pictures as large as the first.
            setup.with_start_codes(&bytes).filter(|_| !setup.resizes(&bytes))
        };
        self.fed_out = Some((Feed::start(program, leash, coded)?, order.into_iter()));
        Ok(())
    }

    /// The next picture from ffmpeg; if it stops early, our own decoders continue.
    fn fed(&mut self) -> Option<(Yuv, f64)> {
        let (feed, order) = self.fed_out.as_mut()?;
        let rank = &self.rank;
        while let Some((Ok(picture), sample)) = feed.picture().zip(order.next()) {
            if rank[sample as usize] == Some(self.out as u32) && picture.is_valid() {
                self.out += 1;
                return Some((picture, self.time(sample)));
            }
        }
        // Our own decoders may accept data that it refuses: that is damage all the same, unless it was reported already.
        let complaint = self.fed_out.take().and_then(|(mut feed, _)| feed.complaint());
        if let Some(report) = complaint.filter(|_| self.remarks.damaged() == 0) {
            self.remarks.add_damage(self.out + 1, &report);
        }
        None
    }

    /// Restarts with the decoder that supports more, up to the frames already returned. False if it is already in
    /// use.
    pub(crate) fn widen(&mut self) -> bool {
        let wide = match self.decoder {
            Decoder::Rusty(_) => Decoder::wide(&self.setup).ok(),
            Decoder::Rust(_) => None,
        };
        wide.is_some_and(|wide| {
            (self.decoder, self.fed) = (wide, 0);
            self.waiting.clear();
            true
        })
    }

    /// Seconds from the first frame shown.
    fn time(&self, sample: u32) -> f64 {
        let time = |i: u32| i128::from(self.movie.samples[i as usize].time);
        (time(sample) - time(self.order[0])) as f64 / f64::from(self.movie.timescale)
    }

    /// Number of frames to show.
    pub(crate) fn frames(&self) -> usize {
        self.order.len()
    }

    /// The findings so far.
    pub(crate) fn remarks(&self) -> &Remarks {
        &self.remarks
    }

    /// The decoder, for people.
    pub(crate) fn decoder(&self) -> &'static str {
        if self.fed_out.is_some() { "H.264 (ffmpeg)" } else { self.decoder.name() }
    }

    /// Mean frames a second; 30 if unknown from the times.
    pub(crate) fn rate(&self) -> f64 {
        let last = self.order.last().map_or(0.0, |&last| self.time(last));
        if last > 0.0 { (self.order.len() - 1) as f64 / last } else { 30.0 }
    }

    pub(crate) fn picture(&mut self) -> Option<Decoded<Picture>> {
        let next = self.yuv()?;
        Some(next.and_then(|(yuv, time)| Ok((self.image(&yuv)?, time))))
    }

    /// A picture as displayed: in the video's colours, with square pixels and rotation.
    ///
    /// # Errors
    /// It would be too large.
    pub(crate) fn image(&self, yuv: &Yuv) -> foveate_base::Result<Image> {
        let sps = self.setup.sps.unwrap_or_default();
        let (matrix, full) = match (sps.matrix, self.movie.colour) {
            (None | Some(2), Some((matrix, full))) => (Some(matrix), full || sps.full_range),
            (matrix, _) => (matrix, sps.full_range),
        };
        let image = yuv.to_rgb(Colour::new(matrix, full, yuv.width, yuv.height));
        let image = turned(self.aspect.square(image)?, self.movie.turns);
        let (w, h) = (yuv.width, yuv.height);
        let stored = if self.movie.turns % 2 == 1 { Size::new(h, w) } else { Size::new(w, h) };
        self.remarks.set_sides(stored, image.size());
        Ok(image)
    }

    /// The decoder configuration record.
    pub(crate) fn description(&self) -> &[u8] {
        &self.movie.avcc
    }

    /// The samples in decoding order, each with its position in the order of presentation, if shown.
    pub(crate) fn samples(&self) -> impl Iterator<Item = (&Sample, Option<u32>)> {
        self.movie.samples.iter().zip(self.rank.iter().copied())
    }

    /// Time in seconds of a position in the order of presentation, from the first shown frame; `None` if there is no
    /// such position.
    pub(crate) fn time_of(&self, place: usize) -> Option<f64> {
        self.order.get(place).map(|&sample| self.time(sample))
    }

    /// The next picture in its coded form.
    pub(crate) fn yuv(&mut self) -> Option<Decoded<(Yuv, f64)>> {
        if let Some(picture) = self.fed() {
            return Some(Ok(picture));
        }
        while let Some(&sample) = self.order.get(self.out) {
            while self.fed <= sample as usize {
                if let Err(trouble) = self.decode_one() {
                    return Some(Err(trouble));
                }
            }
            let picture = self.waiting.remove(&(self.out as u32));
            self.out += 1;
            if let Some(picture) = picture {
                return Some(Ok((picture, self.time(sample))));
            }
        }
        self.movie.cut.take().map(|cut| Err(DecodeError::damaged(format!("the video breaks off: {cut}"))))
    }

    fn load(&mut self, sample: usize) -> Decoded<()> {
        let sample = self.movie.samples[sample];
        let (end, len) = (sample.offset.saturating_add(u64::from(sample.size)), self.len);
        if end > len {
            return Err(DecodeError::damaged(format!(
                "the file ends at byte {len}, the coded frame should reach to byte {end}"
            )));
        }
        if sample.size as usize > self.bytes.capacity() {
            may_be_held(sample.size)?;
        }
        self.bytes.resize(sample.size as usize, 0);
        mp4::read_at(&mut self.file, sample.offset, &mut self.bytes)
    }

    /// The frame number of a sample, from 1; 1 if it is not shown.
    fn number(&self, sample: usize) -> usize {
        self.rank[sample].map_or(1, |place| place as usize + 1)
    }

    fn decode_one(&mut self) -> Decoded<()> {
        self.load(self.fed)?;
        if self.setup.is_damaged(&self.bytes) {
            self.remarks.add_damage(self.number(self.fed), ILLEGAL);
        }
        if !self.lost(self.fed)
            && let Some(picture) = self.decoder.decode(&self.setup, &self.bytes)?
            && let Some(place) = self.rank[self.fed].filter(|&place| place as usize >= self.out)
        {
            self.waiting.insert(place, picture);
        }
        self.fed += 1;
        if self.waiting.len() > MAX_WAITING {
            return Err(DecodeError::damaged("the times of the frames are out of order beyond what H.264 allows"));
        }
        Ok(())
    }
}

/// Fails if a coded frame of so many bytes exceeds the memory limit.
fn may_be_held(size: u32) -> foveate_base::Result<()> {
    memory::check(format_args!("a coded frame of {size} bytes"), size.into())
}

#[cfg(test)]
mod tests;
