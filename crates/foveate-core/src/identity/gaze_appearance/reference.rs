//! The committed gaze: the template and the learned appearance belong to it.

use super::{GazeAppearance, Sharpness, Template};
use crate::geometry::{Extent, Gaze, State};
use crate::identity::dense::Dense;
use crate::identity::{Appearance, calibrate};
use crate::reference::ReferenceLikelihood;
use crate::scene::Image;
use foveate_base::rng::Streams;

impl GazeAppearance {
    /// Learns the first frame, unless that is `learned` under the committed gaze, and measures the reference likelihoods.
    pub(super) fn init_reference(
        &mut self,
        image: &Image,
        state: &State,
        extent: Extent,
        streams: Streams,
        learned: bool,
    ) -> ReferenceLikelihood {
        // On the first frame itself everything is familiar.
        let discounting_background = std::mem::take(&mut self.discounting_background);
        if !learned {
            self.learn_first(image, state, &[]);
        }
        let found = calibrate::calibrate(image, state, extent, streams, &mut |states, out| {
            self.prepare(image, states, &[Gaze::CENTRE]);
            self.distances(states, Gaze::CENTRE, out);
        });
        self.discounting_background = discounting_background;
        let sharpness = match self.setting {
            Sharpness::Fixed(sharpness) => sharpness,
            Sharpness::Calibrated(rule) => rule.sharpness(&found),
        };
        let kept = self.kept.as_mut().expect("a template is kept before its reference likelihood is measured");
        kept.sharpness = sharpness;
        ReferenceLikelihood { on: -sharpness * found.on, off: -sharpness * found.off }
    }

    /// Keeps a template, of which nothing is read yet.
    pub(super) fn keep(&mut self, kept: Template) {
        self.template = Some(kept.pyramid(&*self.retina));
        self.kept = Some(kept);
        self.scratch.template_gaze = None;
    }

    /// Moves the retina to another committed gaze. Returns false if the learned appearance is still that of the last one.
    pub(super) fn recenter(&mut self, gaze: Gaze) -> bool {
        if (gaze.u, gaze.v) != (self.committed.u, self.committed.v) {
            self.retina = self.centred.about(gaze);
            self.dense = Dense::new(&*self.retina, &*self.encoder);
            (self.template, self.scratch.template_gaze) = (None, None);
        }
        self.committed = gaze;
        self.discriminant.as_mut().is_some_and(|it| it.commit(gaze))
    }

    /// Takes another committed gaze, and learns it from the first frame on, unless it has been learned with the others. Returns `None`
    /// before the first frame, or if gazes steer a sensor.
    pub(super) fn commit(&mut self, gaze: Gaze, streams: Streams) -> Option<ReferenceLikelihood> {
        let kept = self.kept.as_ref().filter(|_| !self.steady)?;
        let (image, state, extent) = (kept.whole(), kept.state, kept.extent);
        let learned = self.recenter(gaze);
        Some(self.init_reference(&image, &state, extent, streams, learned))
    }
}
