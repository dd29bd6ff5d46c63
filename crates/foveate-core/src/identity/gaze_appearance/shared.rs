//! One of many targets: shares scratch buffers with the others, and keeps only the part of the first picture with the
//! target.

use super::{GazeAppearance, Template, looks};
use crate::geometry::{Gaze, Size};
use crate::identity::Buffers;
use crate::identity::pyramid::{Pyramid, Region};
use crate::identity::retina::Retina;
use crate::scene::Image;

/// The farthest gaze a template can be read at, in template units.
const FARTHEST_GAZE: f64 = 1.5;
/// Margin in pixels around those that a pyramid used: a coarse one reads whole blocks of at most so many.
const BLOCK: usize = 16;

impl GazeAppearance {
    pub(super) fn exchange_all(&mut self, other: &mut Buffers) {
        let mine = &mut self.buffers;
        mine.views.exchange(&mut other.views);
        for (mine, others) in [
            (&mut mine.glimpses, &mut other.glimpses),
            (&mut mine.features, &mut other.features),
            (&mut mine.learned, &mut other.learned),
        ] {
            std::mem::swap(mine, others);
        }
        std::mem::swap(&mut mine.apart, &mut other.apart);
        std::mem::swap(&mut mine.dimmed, &mut other.dimmed);
        if let Some(dense) = &mut self.dense {
            std::mem::swap(&mut dense.maps, &mut other.maps);
            dense.of = None;
        }
        if let Some(discriminant) = &mut self.discriminant {
            std::mem::swap(&mut discriminant.learning, &mut other.learning);
        }
        if let Some(colour) = &mut self.colour {
            std::mem::swap(&mut colour.counts, &mut other.counts);
        }
    }

    /// Where gazes stay at the centre, one row of features is all that is read of the template. Where the background is not
    /// discounted, nothing is read of the picture far from the target.
    pub(super) fn free(&mut self) {
        if let Some(discriminant) = &mut self.discriminant {
            discriminant.compact();
        }
        let Some(kept) = &mut self.kept else { return };
        if kept.is_whole() && self.discounting_background <= 0.0 {
            let used = self.template.get_or_insert_with(|| kept.pyramid(&*self.retina)).used();
            let (x, y, width, height) = used;
            let Region { x, y, width, height } = Region { x, y, width, height }.padded((BLOCK, BLOCK), kept.size);
            kept.origin = (x, y);
            kept.image = kept.image.part(kept.origin, Size { width, height });
        }
        if !self.moves {
            self.template_features(Gaze::CENTRE);
            self.template = None;
        }
    }
}

impl Template {
    pub(super) fn is_whole(&self) -> bool {
        self.image.size() == self.size
    }

    /// The pyramid that gazes at the template read.
    pub(super) fn pyramid(&self, retina: &dyn Retina) -> Pyramid {
        if self.is_whole() {
            return self.build(&self.image, retina);
        }
        // The part at its place: its surroundings are not read.
        self.build(&self.whole(), retina)
    }

    /// The picture at full size, black outside the kept part.
    pub(super) fn whole(&self) -> Image {
        if self.is_whole() {
            return self.image.clone();
        }
        let planes = self.image.planes();
        let Size { width, height } = self.size;
        let mut whole =
            Image::new(width, height, planes, vec![0; width * height * planes]).expect("as large as a picture was");
        for p in 0..planes {
            let rows = self.image.plane(p).chunks_exact(self.image.width());
            let plane = whole.plane_mut(p);
            for (row, from) in rows.enumerate() {
                plane[(self.origin.1 + row) * width + self.origin.0..][..from.len()].copy_from_slice(from);
            }
        }
        whole
    }

    fn build(&self, image: &Image, retina: &dyn Retina) -> Pyramid {
        let gazes = [Gaze { u: FARTHEST_GAZE, v: FARTHEST_GAZE, arm: None }];
        let reach = looks(retina, self.extent).reach;
        let region = Region::covering(image, &[self.state], &gazes, self.extent, reach);
        let mut pyramid = Pyramid::default();
        pyramid.build(image, region, retina.footprints(), self.state.half(self.extent));
        pyramid.trim();
        pyramid
    }
}
