//! surface.png: where the policy learned to look, over the target, as it stood at the end of the run.

use std::path::PathBuf;

use super::eye::Eye;
use super::first::{Crop, First};
use super::heat::Heat;
use super::sink::Sink;
use super::surface::{Panel, row};
use super::{Observer, RunInfo};
use crate::Result;
use crate::gaze::Portrait;
use crate::geometry::{BBox, Gaze};
use crate::scene::{Frame, Image, encode_png};
use crate::step::Step;

/// Points along a side at which a surface is asked for; each frame, for no frame knows that it is the last.
const POINTS: usize = 17;
/// Fixations that are drawn; the oldest go first.
const MOST_FIXATIONS: usize = 400;

/// Draws the policy's portrait of the last frame: [`row`]. A policy without a surface gets its probabilities.
pub struct SurfacePicture {
    info: RunInfo,
    file: Sink,
    crop: Option<Crop>,
    first: Option<First>,
    frames: usize,
    heat: Option<Heat>,
    arms: Vec<(Gaze, f64)>,
    fixations: Vec<Gaze>,
    best: Option<Gaze>,
    finished: bool,
}

impl SurfacePicture {
    /// Starts the file. Fails where its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>, info: RunInfo) -> Result<Self> {
        let (crop, first, heat, best, file) = (None, None, None, None, Sink::create(path)?);
        Ok(Self { info, file, crop, first, frames: 0, heat, arms: vec![], fixations: vec![], best, finished: false })
    }

    fn picture(&self) -> Image {
        let nothing = Crop::around(&Image::grey(3, 3, 128), &BBox { x: 0.0, y: 0.0, w: 3.0, h: 3.0 });
        let far = |gaze: &Gaze| gaze.u.abs().max(gaze.v.abs());
        let reach = self.heat.as_ref().map_or(0.0, |heat| heat.reach);
        let reach = self.arms.iter().map(|arm| far(&arm.0)).fold(reach, f64::max);
        let crop = &self.crop.as_ref().unwrap_or(&nothing).closer((1.15 * reach).max(1.05));
        let best: Vec<Gaze> = self.best.into_iter().collect();
        let retina = self.info.retina.as_deref();
        let cells = retina.iter().flat_map(|r| r.cells()).filter(|c| c.channel == 0);
        let finest = cells.clone().map(|c| c.half).fold(f64::INFINITY, f64::min);
        let window = cells.filter(|c| c.half <= finest).map(|c| c.u.abs().max(c.v.abs()) + c.half).reduce(f64::max);
        let mut panels = vec![Panel { best: &best, window, ..Panel::of("the fovea at the best gaze", crop) }];
        match &self.heat {
            Some(heat) => {
                let mean = Some((heat, &heat.mean[..], "mean reward"));
                let title = "believed reward, and where it looked";
                panels.push(Panel { map: mean, fixations: &self.fixations, best: &best, ..Panel::of(title, crop) });
                let sd = Some((heat, &heat.sd[..], "standard deviation"));
                panels.push(Panel { map: sd, best: &best, ..Panel::of("how unsure it is", crop) });
            }
            None => {
                let title = "share of each gaze: area of a disc";
                panels.push(Panel { arms: self.arms.clone(), ..Panel::of(title, crop) });
            }
        }
        let seen = match (&self.first, retina, self.best) {
            (Some(first), Some(retina), Some(best)) => {
                let glimpse = first.glimpse(retina, best);
                Eye::new(retina).filter(|_| !glimpse.is_empty()).map(|eye| eye.picture(&glimpse))
            }
            _ => None,
        };
        let name = self.info.source.rsplit(['/', '\\']).find(|part| !part.is_empty()).unwrap_or("");
        let at = self.best.map_or(String::new(), |g| format!(" · best gaze ({:.2}, {:.2})", g.u, g.v));
        let title = format!("{name} · {} frames{at}", self.frames);
        row(&title, &panels, seen.as_ref().map(|image| ("seen at the best gaze", image))).into_image()
    }
}

impl Observer for SurfacePicture {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        self.frames += 1;
        self.crop = Some(Crop::around(&frame.image, bbox));
        self.first = self.info.retina.as_deref().map(|retina| First::new(&frame.image, bbox, retina));
        Ok(())
    }

    fn observe(&mut self, step: &Step<'_>) -> Result<()> {
        self.frames += 1;
        match step.portrait {
            Portrait::Blank => (),
            Portrait::Arms { gazes, probabilities } => {
                self.arms.clear();
                self.arms.extend(gazes.iter().copied().zip(probabilities.iter().copied()));
                self.best = self.arms.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|arm| arm.0);
            }
            Portrait::Surface(surface) => {
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
        if !std::mem::replace(&mut self.finished, true) {
            self.file.write(&encode_png(&self.picture()))?;
        }
        self.file.finish()
    }
}
