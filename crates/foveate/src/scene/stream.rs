//! The frames of an MP4 file: decoded in the order of the file, handed out in the order of presentation.

use std::collections::BTreeMap;
use std::fs::File;

use super::Image;
use super::h264::{Decoder, Setup};
use super::mp4::{self, Movie};
use super::video::{Decoded, Picture, Trouble};
use super::yuv::{Colour, Yuv};

/// How many pictures may wait for one that is shown before them; H.264 allows 16.
const MAX_WAITING: usize = 32;

/// An MP4 file in mid-stream.
pub(super) struct Mp4 {
    file: File,
    len: u64,
    movie: Movie,
    setup: Setup,
    decoder: Decoder,
    /// Samples in the order of presentation, and the place of each sample in it, where it is shown.
    order: Vec<u32>,
    rank: Vec<Option<u32>>,
    /// How many places of the order are done, and how many samples are decoded.
    out: usize,
    fed: usize,
    waiting: BTreeMap<u32, Yuv>,
    bytes: Vec<u8>,
    /// The first sample needs others that are not there (an open group of pictures).
    open: bool,
}

impl Mp4 {
    pub fn new(mut file: File, len: u64) -> Decoded<Self> {
        let movie = mp4::read(&mut file, len)?;
        let setup = Setup::read(&movie.avcc)?;
        let decoder = match Decoder::fast(&setup) {
            Err(Trouble::Unsupported(_)) => Decoder::wide(&setup)?,
            decoder => decoder?,
        };
        let samples = &movie.samples;
        let mut order: Vec<u32> = (0..samples.len() as u32).filter(|&i| samples[i as usize].shown).collect();
        order.sort_by_key(|&i| samples[i as usize].time);
        let mut rank = vec![None; samples.len()];
        (0..).zip(&order).for_each(|(place, &i)| rank[i as usize] = Some(place));
        let (waiting, bytes) = (BTreeMap::new(), Vec::new());
        Ok(Self { file, len, movie, setup, decoder, order, rank, out: 0, fed: 0, waiting, bytes, open: false })
    }

    /// Starts again with the decoder that knows more, up to the frames that are out. False where it is that one.
    pub fn widen(&mut self) -> bool {
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

    /// How many frames are to be shown.
    pub fn frames(&self) -> usize {
        self.order.len()
    }

    /// The decoder, for people.
    pub fn decoder(&self) -> &'static str {
        self.decoder.name()
    }

    /// Mean frames a second; 30 where the times do not tell.
    pub fn rate(&self) -> f64 {
        let last = self.order.last().map_or(0.0, |&last| self.time(last));
        if last > 0.0 { (self.order.len() - 1) as f64 / last } else { 30.0 }
    }

    pub fn picture(&mut self) -> Option<Decoded<Picture>> {
        let (yuv, time) = match self.yuv()? {
            Ok(next) => next,
            Err(trouble) => return Some(Err(trouble)),
        };
        let sps = self.setup.sps.unwrap_or_default();
        let (matrix, full) = match (sps.matrix, self.movie.colour) {
            (None | Some(2), Some((matrix, full))) => (Some(matrix), full || sps.full_range),
            (matrix, _) => (matrix, sps.full_range),
        };
        let image = yuv.to_rgb(Colour::new(matrix, full, yuv.width, yuv.height));
        Some(Ok((turned(image, self.movie.turns), time)))
    }

    /// The next picture as it was coded.
    pub fn yuv(&mut self) -> Option<Decoded<(Yuv, f64)>> {
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
        self.movie.cut.take().map(|cut| Err(Trouble::Damaged(format!("the video breaks off: {cut}"))))
    }

    fn decode_one(&mut self) -> Decoded<()> {
        let sample = self.movie.samples[self.fed];
        let end = sample.offset.saturating_add(u64::from(sample.size));
        if end > self.len {
            let len = self.len;
            return Err(Trouble::Damaged(format!(
                "the file ends at byte {len}, the coded frame should reach to byte {end}; the file is cut off, copy it again"
            )));
        }
        self.bytes.resize(sample.size as usize, 0);
        mp4::read_at(&mut self.file, sample.offset, &mut self.bytes)?;
        if self.fed == 0 {
            self.open = !self.setup.starts_anew(&self.bytes)?;
        }
        // Shown before the first frame of an open group, they refer to frames that were cut away.
        let lost = self.open && sample.time < self.movie.samples[0].time;
        if !lost
            && let Some(picture) = self.decoder.decode(&self.setup, &self.bytes)?
            && let Some(place) = self.rank[self.fed].filter(|&place| place as usize >= self.out)
        {
            self.waiting.insert(place, picture);
        }
        self.fed += 1;
        if self.waiting.len() > MAX_WAITING {
            let problem = "the times of the frames are out of order beyond what H.264 allows; the file is damaged";
            return Err(Trouble::Damaged(problem.into()));
        }
        Ok(())
    }
}

/// The image turned clockwise by quarter turns.
fn turned(image: Image, turns: u8) -> Image {
    if turns == 0 {
        return image;
    }
    let (w, h) = (image.width(), image.height());
    let (width, height) = if turns % 2 == 1 { (h, w) } else { (w, h) };
    let mut data = Vec::with_capacity(image.bytes().len());
    for p in 0..image.planes() {
        let plane = image.plane(p);
        for y in 0..height {
            data.extend((0..width).map(|x| match turns {
                1 => plane[(h - 1 - x) * w + y],
                2 => plane[(h - 1 - y) * w + (w - 1 - x)],
                _ => plane[x * w + (w - 1 - y)],
            }));
        }
    }
    Image::new(width, height, image.planes(), data).expect("as many pixels as before")
}

#[cfg(test)]
mod tests {
    use super::*;
    use md5::{Digest, Md5};
    use std::path::Path;

    fn data() -> Option<std::path::PathBuf> {
        let root = std::env::var_os("FOVEATE_DATA").map(Into::into);
        let root = root.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data"));
        let clips = root.join("clips");
        clips.is_dir().then_some(clips)
    }

    fn open(path: &Path) -> Mp4 {
        let file = File::open(path).expect("a file");
        let len = file.metadata().expect("a file").len();
        Mp4::new(file, len).expect("an MP4")
    }

    /// Every frame of the three clips is the frame that a reference decoder gave, in its order.
    #[test]
    fn clips_decode_exactly() {
        let Some(clips) = data() else { return println!("skipped: no data") };
        for name in ["car-detection", "bottle-detection", "hockey"] {
            let sums = std::fs::read_to_string(clips.join(name).with_extension("framemd5")).expect("checksums");
            let sums: Vec<&str> = sums.lines().filter(|line| !line.starts_with('#')).collect();
            let mut mp4 = open(&clips.join(name).with_extension("mp4"));
            assert_eq!(mp4.frames(), sums.len(), "{name}");
            let start = std::time::Instant::now();
            let mut times = Vec::new();
            for (i, sum) in sums.iter().enumerate() {
                let (yuv, time) = mp4.yuv().expect("a frame").expect("a good frame");
                let mut md5 = Md5::new();
                [yuv.y, yuv.u, yuv.v].iter().for_each(|plane| md5.update(plane));
                let found: String = md5.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
                assert_eq!(sum.rsplit(", ").next(), Some(found.as_str()), "{name}, frame {}", i + 1);
                times.push(time);
            }
            assert!(mp4.yuv().is_none());
            assert!(times[0] == 0.0 && times.is_sorted(), "{name}: times rise from 0");
            println!("{name}: {} frames a second", (times.len() as f64 / start.elapsed().as_secs_f64()).round());
        }
    }
}
