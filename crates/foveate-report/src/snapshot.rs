//! surface.png: the final state of the gaze policy, drawn over the template.

use std::path::PathBuf;

use crate::eye::windows;
use crate::heat::Heat;
use crate::surface::{Panel, row};
use crate::template::{Crop, FirstFrame};
use crate::{Observer, RunInfo};
use foveate_base::Result;
use foveate_base::sink::Sink;
use foveate_base::text::counted;
use foveate_core::Seen;
use foveate_core::gaze::PolicySnapshot;
use foveate_core::geometry::{BBox, Gaze};
use foveate_core::scene::Image;
use foveate_video::{Frame, encode_png};

/// Points along a side of a sampled surface; sampled in every frame, because the last frame is not known in advance.
const POINTS: usize = 17;
/// Maximum number of drawn fixations; the oldest are dropped.
const MOST_FIXATIONS: usize = 400;

/// surface.png: the policy's snapshot of the last frame, as [`row`] draws it. For a policy without a reward surface, it shows the
/// probabilities of its gazes.
///
/// A policy with a single gaze has nothing to show ([`SurfacePicture::shows`]): its run writes no file.
#[derive(Debug)]
pub struct SurfacePicture {
    info: RunInfo,
    /// `None` once it is finished.
    file: Option<Sink>,
    /// Whether the policy has something to show, as far as known.
    shows: bool,
    crop: Option<Crop>,
    first: Option<FirstFrame>,
    frames: usize,
    heat: Option<Heat>,
    arms: Vec<(Gaze, f64)>,
    fixations: Vec<Gaze>,
    best: Option<Gaze>,
}

impl SurfacePicture {
    /// Starts the file.
    ///
    /// # Errors
    /// Its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>, info: RunInfo) -> Result<Self> {
        Ok(Self::to(Sink::create(path)?, info))
    }

    /// Writes to `file`.
    pub fn to(file: Sink, info: RunInfo) -> Self {
        let file = Some(file);
        let (crop, first, heat, best) = (None, None, None, None);
        let (arms, fixations) = (vec![], vec![]);
        Self { info, file, shows: true, crop, first, frames: 0, heat, arms, fixations, best }
    }

    /// Returns whether a policy has something to show: a reward surface, or several gazes.
    pub fn shows(snapshot: PolicySnapshot<'_>) -> bool {
        match snapshot {
            PolicySnapshot::Blank => false,
            PolicySnapshot::Arms { gazes, .. } => gazes.len() > 1,
            PolicySnapshot::Surface(_) => true,
        }
    }

    fn picture(&self) -> Image {
        let nothing = Crop::around(&Image::grey(3, 3, 128), &BBox { x: 0.0, y: 0.0, w: 3.0, h: 3.0 });
        let far = |gaze: &Gaze| gaze.u.abs().max(gaze.v.abs());
        let reach = self.heat.as_ref().map_or(0.0, |heat| heat.reach);
        let reach = self.arms.iter().map(|arm| far(&arm.0)).fold(reach, f64::max);
        let crop = &self.crop.as_ref().unwrap_or(&nothing).closer((1.15 * reach).max(1.05));
        let best: Vec<Gaze> = self.best.into_iter().collect();
        let retina = self.info.retina.as_deref();
        let window = retina.and_then(|retina| windows(retina).first().copied());
        let mut panels = vec![Panel { best: &best, window, ..Panel::of("template and best gaze", crop) }];
        match &self.heat {
            Some(heat) => {
                let mean = Some((heat, &heat.mean[..], "mean reward"));
                let title = "mean reward and fixations";
                panels.push(Panel { map: mean, fixations: &self.fixations, best: &best, ..Panel::of(title, crop) });
                let sd = Some((heat, &heat.sd[..], "standard deviation"));
                panels.push(Panel { map: sd, best: &best, ..Panel::of("uncertainty of the reward", crop) });
            }
            None => {
                let title = "probability of each gaze: area of its disc";
                panels.push(Panel { arms: self.arms.clone(), ..Panel::of(title, crop) });
            }
        }
        let glimpse = match (&self.first, retina, self.best) {
            (Some(first), Some(retina), Some(best)) => first.picture(retina, best),
            _ => None,
        };
        let name = self.info.source.rsplit(['/', '\\']).find(|part| !part.is_empty()).unwrap_or("");
        let at = self.best.map_or(String::new(), |g| format!(" · best gaze ({:.2}, {:.2})", g.u, g.v));
        let title = format!("{name} · {}{at}", counted(self.frames, "frame"));
        row(&title, &panels, glimpse.as_ref().map(|image| ("glimpse at the best gaze", image))).into_image()
    }
}

impl Observer for SurfacePicture {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        let Some(seen) = targets.first() else { return Ok(()) };
        self.frames += 1;
        if seen.is_given() {
            self.crop = Some(Crop::around(&frame.image, &seen.bbox));
            self.first = self.info.retina.as_deref().map(|retina| FirstFrame::new(&frame.image, &seen.bbox, retina));
            return Ok(());
        }
        self.shows = Self::shows(seen.snapshot);
        match seen.snapshot {
            PolicySnapshot::Blank => (),
            PolicySnapshot::Arms { gazes, probabilities } => {
                self.arms.clear();
                self.arms.extend(gazes.iter().copied().zip(probabilities.iter().copied()));
                self.best = self.arms.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|arm| arm.0);
            }
            PolicySnapshot::Surface(surface) => {
                self.heat = Some(Heat::of(surface, POINTS));
                let all = surface.fixations();
                self.fixations.clear();
                self.fixations.extend_from_slice(&all[all.len().saturating_sub(MOST_FIXATIONS)..]);
                self.best = surface.best();
            }
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        let Some(mut file) = self.file.take() else { return Ok(()) };
        if self.shows {
            file.write(&encode_png(&self.picture()))?;
            file.finish()?;
        }
        Ok(())
    }
}
