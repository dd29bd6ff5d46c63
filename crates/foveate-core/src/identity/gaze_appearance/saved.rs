//! The state of an appearance between frames, as plain data: the picture of frame 1 and the learned models.

use base64::Engine as _;
use serde::{Deserialize, Serialize};

use super::{GazeAppearance, Template};
use crate::geometry::{Extent, Gaze, State};
use crate::identity::colour::Colour;
use crate::identity::discriminant::Discriminant;
use crate::saved_state::SavedState;
use crate::scene::Image;
use foveate_base::{Error, Result, memory};

/// The farthest gaze that a policy may have, template units.
const FARTHEST: f64 = 10.0;

impl GazeAppearance {
    pub(super) fn to_saved(&self) -> SavedState {
        let Some(kept) = &self.kept else { return SavedState::empty() };
        let saved = Saved {
            width: kept.image.width(),
            height: kept.image.height(),
            planes: kept.image.planes(),
            part: (!kept.is_whole()).then_some((kept.origin, kept.size)),
            pixels: base64::engine::general_purpose::STANDARD.encode(kept.image.bytes()),
            state: kept.state,
            extent: kept.extent,
            sharpness: kept.sharpness,
            discriminant: self.discriminant.as_ref().map(Discriminant::save),
            colour: self.colour.as_ref().map(Colour::save),
            home: (self.committed != Gaze::CENTRE).then_some(self.committed),
            training: self.saved_training(),
        };
        SavedState::new(&saved)
    }

    pub(super) fn take_up(&mut self, saved: &SavedState) -> Result<()> {
        if saved.is_empty() {
            self.kept = None;
            return Ok(());
        }
        let bad = |what: String| Error::Invalid(format!("the saved appearance cannot be used: {what}"));
        let saved: Saved = saved.read().map_err(|e| bad(e.to_string()))?;
        let pixels = base64::engine::general_purpose::STANDARD.decode(&saved.pixels).map_err(|e| bad(e.to_string()))?;
        let image = Image::new(saved.width, saved.height, saved.planes, pixels)?;
        match (&mut self.discriminant, &saved.discriminant) {
            (Some(it), Some(saved)) => it.load(saved)?,
            (None, None) => (),
            _ => {
                return Err(bad(
                    "it, or this tracker, has no discriminant; use the configuration it was saved with".into()
                ));
            }
        }
        match (&mut self.colour, &saved.colour) {
            (Some(it), Some(saved)) => it.load(saved)?,
            (None, None) => (),
            _ => {
                return Err(bad(
                    "only one of it and this tracker has colours; use the configuration it was saved with".into(),
                ));
            }
        }
        self.take_up_training(saved.training.as_ref())?;
        let home = saved.home.unwrap_or(Gaze::CENTRE);
        if ![home.u, home.v].iter().all(|place| place.abs() <= FARTHEST) {
            return Err(bad("its usual gaze is no place of the template".into()));
        }
        self.recenter(home);
        let Saved { state, extent, sharpness, part, .. } = saved;
        let (origin, size) = part.unwrap_or(((0, 0), (image.width(), image.height())));
        let holds = |from: usize, n: usize, side: usize| from.checked_add(n).is_some_and(|end| end <= side);
        if !holds(origin.0, image.width(), size.0) || !holds(origin.1, image.height(), size.1) {
            return Err(bad("the part of a picture that it has lies outside of the picture".into()));
        }
        memory::check_picture(size.0, size.1)?;
        self.keep(Template { image, origin, size, state, extent, sharpness });
        Ok(())
    }
}

#[cfg(feature = "learn")]
impl GazeAppearance {
    fn saved_training(&self) -> Option<serde_json::Value> {
        self.training.as_ref().map(super::Training::save)
    }

    fn take_up_training(&mut self, saved: Option<&serde_json::Value>) -> Result<()> {
        match (&mut self.training, saved) {
            (Some(training), Some(saved)) => self.encoder = training.load(saved)?,
            (None, None) => (),
            _ => return Err(Error::Invalid(ONE_TRAINED.into())),
        }
        Ok(())
    }
}

#[cfg(not(feature = "learn"))]
impl GazeAppearance {
    fn saved_training(&self) -> Option<serde_json::Value> {
        None
    }

    fn take_up_training(&mut self, saved: Option<&serde_json::Value>) -> Result<()> {
        saved.map_or(Ok(()), |_| Err(Error::Invalid(ONE_TRAINED.into())))
    }
}

const ONE_TRAINED: &str = "the saved appearance cannot be used: only one of it and this tracker trains its first layer; use the \
                           configuration it was saved with";

#[derive(Serialize, Deserialize)]
struct Saved {
    width: usize,
    height: usize,
    planes: usize,
    /// Column, row, width and height of the whole picture, if it is a part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    part: Option<((usize, usize), (usize, usize))>,
    pixels: String,
    state: State,
    extent: Extent,
    sharpness: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    discriminant: Option<serde_json::Value>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    colour: Option<serde_json::Value>,
    /// The committed gaze, if it is not the centre.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    home: Option<Gaze>,
    /// The first layer as it was trained while tracking.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    training: Option<serde_json::Value>,
}
