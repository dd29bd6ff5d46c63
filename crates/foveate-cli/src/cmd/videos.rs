//! Videos with ground truth and random access to frames: sequences in memory, and drawn scenes.

use foveate::geometry::{BBox, Size};
use foveate::lab::Digits;
use foveate::lab::eval::Sequence;
use foveate::lab::eval::catalogue::{Origin, origin};
use foveate::lab::synthetic::Synthetic;
use foveate::scene::Image;
use foveate::text::counted;
use foveate::video::open;
use foveate::{Error, Result};

use crate::cmd::eval::record::Data;

/// A video with its ground truth.
pub struct Video<'a> {
    /// Its name.
    pub name: String,
    /// Its source, half and kind.
    pub origin: Origin,
    /// The box in each frame, 0-based; `None` if the target is absent.
    pub truth: Vec<Option<BBox>>,
    /// Width and height in pixels.
    pub size: Size,
    /// Returns frame t.
    pub picture: Box<dyn Fn(usize) -> Result<Image> + 'a>,
}

impl std::fmt::Debug for Video<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Video").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Video<'_> {
    /// Returns the video from its end to its beginning, under the same name.
    pub fn backwards(&self) -> Video<'_> {
        let last = self.truth.len() - 1;
        Video {
            name: self.name.clone(),
            origin: self.origin.clone(),
            truth: self.truth.iter().rev().copied().collect(),
            size: self.size,
            picture: Box::new(move |t| (self.picture)(last - t)),
        }
    }
}

/// Returns a digest of the true boxes and the pictures of a sequence, for the names of finished runs.
///
/// # Errors
/// It has no pictures, or one cannot be read.
pub fn digest(sequence: &Sequence) -> Result<String> {
    Data::with_pictures(sequence).map(|data| data.digest())
}

/// Decodes a sequence into memory.
pub fn of_sequence(sequence: &Sequence) -> Result<Video<'static>> {
    let mut source = open(&sequence.images)?;
    let size = source.info().size();
    let frames = source.by_ref().take(sequence.truth.len());
    let images = frames.map(|frame| Ok(frame?.image)).collect::<Result<Vec<Image>>>()?;
    if images.len() < sequence.truth.len() {
        let problem = format!("it has {} for {}", counted(sequence.truth.len(), "box"), counted(images.len(), "frame"));
        return Err(Error::malformed(&sequence.truth_file, problem));
    }
    let picture = Box::new(move |t: usize| Ok(images[t].clone()));
    Ok(Video {
        name: sequence.name.clone(),
        origin: sequence.origin.clone(),
        truth: sequence.truth.clone(),
        size,
        picture,
    })
}

/// Creates the video of a drawn scene.
pub(crate) fn of_scene<'a>(scene: &Synthetic, digits: &'a Digits) -> Result<Video<'a>> {
    let video = scene.video(digits)?;
    let truth = video.truth().iter().copied().map(Some).collect();
    let name = format!("digit {}, seed {}", scene.digit(), scene.seed());
    Ok(Video {
        origin: origin(&name),
        name,
        truth,
        size: video.size(),
        picture: Box::new(move |t| Ok(video.render(t))),
    })
}
