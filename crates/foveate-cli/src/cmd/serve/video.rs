//! A video with random access to its frames, and its frames as pictures for the page.

use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::sync::Arc;

use foveate::geometry::BBox;
use foveate::report::shrunk;
use foveate::scene::Image;
use foveate::video::{
    Frame, FrameSource, ImageFolder, Interrupt, Options, SourceInfo, annotation, encode_jpeg, image_files, open_with,
};
use foveate::{Error, Result};
use foveate_page::{BEFORE, Frames, Player, Reopen, check_size};

use super::roots::Place;
use crate::cmd::track::outputs::bit_rate;

/// Maximum longer side of a picture on the page, pixels.
const LONGEST: usize = 1280;
const QUALITY: u8 = 85;
/// Maximum size of the pictures that a session keeps, bytes.
const KEPT: usize = 64 << 20;

/// A video that can be opened at any frame.
#[derive(Clone, Debug)]
pub(super) struct Video {
    pub place: Place,
    pub info: SourceInfo,
    /// The image files, if the video is a folder.
    files: Option<Arc<[PathBuf]>>,
    options: Options,
}

impl Video {
    pub(super) fn open(place: Place, options: Options) -> Result<Self> {
        let files = match place.real.is_dir() {
            true => {
                let found = image_files(&place.real)?;
                let inside = found.iter().map(|file| place.inside(file)).collect::<Option<Arc<[PathBuf]>>>();
                let problem = "a picture in it is a link that leads out of the folders served; serve that folder, too";
                Some(inside.ok_or_else(|| Error::malformed(&place.shown, problem))?)
            }
            false => None,
        };
        let info = source(&place, files.as_deref(), 0, &options)?.info().clone();
        check_size(&info, &place.shown)?;
        Ok(Self { place, info, files, options })
    }

    /// Returns the true boxes, if the folder has them.
    pub(super) fn truth(&self) -> Vec<Option<BBox>> {
        let folder = if self.place.real.is_dir() { Some(&*self.place.real) } else { self.place.real.parent() };
        let file = folder.and_then(|folder| self.place.inside(&folder.join("groundtruth_rect.txt")));
        file.filter(|_| self.files.is_some()).and_then(|file| annotation::read_truth(file).ok()).unwrap_or_default()
    }
}

impl Reopen for Video {
    fn source(&self, from: usize) -> Result<Box<dyn FrameSource>> {
        source(&self.place, self.files.as_deref(), from, &self.options)
    }
    fn pictures(&self) -> Option<(usize, f64)> {
        self.files.as_ref().map(|files| (files.len(), self.info.rate))
    }
}

fn source(place: &Place, files: Option<&[PathBuf]>, from: usize, options: &Options) -> Result<Box<dyn FrameSource>> {
    match files {
        Some(files) => {
            let mut pictures = Pictures::new(place, files.to_vec(), options)?;
            pictures.pass_over(from)?;
            Ok(Box::new(pictures))
        }
        None => {
            place.check(&place.real)?;
            open_with(&place.real, options)
        }
    }
}

/// The pictures of a folder, each checked before it is read.
struct Pictures {
    place: Place,
    files: Vec<PathBuf>,
    next: usize,
    folder: ImageFolder,
}

impl Pictures {
    fn new(place: &Place, files: Vec<PathBuf>, options: &Options) -> Result<Self> {
        place.check(&files[0])?;
        let folder = ImageFolder::from_files_with(files.clone(), options)?;
        Ok(Self { place: place.clone(), files, next: 0, folder })
    }
}

impl Iterator for Pictures {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let checked = self.place.check(self.files.get(self.next)?);
        self.next += 1;
        checked.map_or_else(|error| Some(Err(error)), |()| self.folder.next())
    }
}

impl FrameSource for Pictures {
    fn info(&self) -> &SourceInfo {
        self.folder.info()
    }
    fn pass_over(&mut self, count: usize) -> Result<()> {
        self.next = self.next.saturating_add(count);
        self.folder.pass_over(count)
    }
    fn interrupt(&self) -> Option<Interrupt> {
        self.folder.interrupt()
    }
}

/// An open video, with its pictures for the page.
pub(super) struct Open {
    video: Video,
    pub stills: Stills,
}

impl Open {
    pub(super) fn new(video: Video) -> Self {
        Self { stills: Stills::new(video.clone()), video }
    }
}

impl foveate_page::Video for Open {
    fn frames(&mut self) -> &mut dyn Frames {
        &mut self.stills.player
    }
    fn reader(&self) -> Box<dyn Frames> {
        Box::new(Player::new(self.video.clone()))
    }
    fn bit_rate(&self) -> Option<f64> {
        bit_rate(&self.video.place.real, &self.video.info)
    }
}

/// A cache of the most recent frames as JPEG files.
pub(super) struct Stills {
    /// The original frames.
    pub player: Player<Video>,
    kept: BTreeMap<usize, Arc<[u8]>>,
    order: VecDeque<usize>,
    bytes: usize,
}

impl Stills {
    pub(super) fn new(video: Video) -> Self {
        Self { player: Player::new(video), kept: BTreeMap::new(), order: VecDeque::new(), bytes: 0 }
    }

    /// Returns frame `index` as a picture, from `decoded` if that is the frame; `None` if the video ends before it.
    pub(super) fn get(&mut self, index: usize, decoded: Option<&Arc<Frame>>) -> Result<Option<Arc<[u8]>>> {
        if let Some(jpeg) = self.kept.get(&index) {
            return Ok(Some(Arc::clone(jpeg)));
        }
        if let Some(frame) = decoded.filter(|frame| frame.index == index) {
            self.keep(frame);
        } else {
            let mut near = vec![];
            let found = self.player.passing(index, |frame| {
                if frame.index + BEFORE >= index {
                    near.push((frame.index, jpeg(&frame.image)));
                }
            })?;
            near.into_iter().for_each(|(k, bytes)| self.put(k, bytes));
            match found {
                Some(frame) => self.keep(&frame),
                None => return Ok(None),
            }
        }
        Ok(self.kept.get(&index).cloned())
    }

    fn keep(&mut self, frame: &Frame) {
        self.put(frame.index, jpeg(&frame.image));
    }

    fn put(&mut self, index: usize, bytes: Vec<u8>) {
        self.bytes += bytes.len();
        if let Some(old) = self.kept.insert(index, bytes.into()) {
            self.bytes -= old.len();
        } else {
            self.order.push_back(index);
        }
        while self.bytes > KEPT && self.order.len() > 1 {
            let old = self.order.pop_front().and_then(|k| self.kept.remove(&k));
            self.bytes -= old.map_or(0, |old| old.len());
        }
    }
}

/// Encodes a frame for the page; reduces a large frame by an integer factor.
pub(super) fn jpeg(image: &Image) -> Vec<u8> {
    let k = image.width().max(image.height()).div_ceil(LONGEST);
    if k <= 1 { encode_jpeg(image, QUALITY) } else { encode_jpeg(&smaller(image, k), QUALITY) }
}

/// Averages blocks of k × k pixels, or slightly different ones if a side is no multiple of k.
fn smaller(image: &Image, k: usize) -> Image {
    shrunk(image, (image.width() / k).max(1), (image.height() / k).max(1))
}

#[cfg(test)]
mod tests {
    use super::super::roots::Roots;
    use super::*;
    use foveate::video::{decode_image, save_png};

    #[test]
    fn any_frame_can_be_had() {
        let dir = tempfile::tempdir().expect("a folder");
        for t in 0..40 {
            save_png(dir.path().join(format!("{t}.png")), &Image::grey(16, 12, 6 * t)).expect("writable");
        }
        let place = Roots::new(&[dir.path().to_owned()]).and_then(|roots| roots.find("0")).expect("it is there");
        let video = Video::open(place, Options::default()).expect("pictures");
        let (mut player, mut stills) = (Player::new(video.clone()), Stills::new(video));
        for index in [0, 1, 30, 3, 39, 38, 0] {
            let frame = player.frame(index).expect("readable").expect("it is there");
            assert_eq!((frame.index, frame.image.at(0, 3, 3)), (index, 6 * index as u8));
            let jpeg = stills.get(index, None).expect("readable").expect("it is there");
            assert!(decode_image(&jpeg).expect("a picture").at(0, 3, 3).abs_diff(6 * index as u8) < 3);
        }
        assert!(player.frame(40).expect("readable").is_none());
        assert!(stills.get(usize::MAX, None).expect("readable").is_none());
        assert!(stills.kept.contains_key(&25), "frames before one that was asked for are there, too");
        let [before, at] = stills.player.pair(7).expect("readable");
        assert_eq!((before.map(|f| f.index), at.map(|f| f.index)), (Some(6), Some(7)));
        let [next, first] = stills.player.pair(0).expect("readable");
        assert_eq!((next.map(|f| f.index), first.map(|f| f.index)), (Some(1), Some(0)));
    }

    #[test]
    fn large_frames_are_averaged() {
        let image = Image::new(5, 4, 1, (0..20).collect()).expect("5 x 4");
        let small = smaller(&image, 2);
        assert_eq!((small.width(), small.height(), small.at(0, 0, 0)), (2, 2, (1 + 5 + 6) / 4));
    }
}
