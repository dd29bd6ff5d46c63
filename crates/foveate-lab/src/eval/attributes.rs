//! Attributes of sequences that make tracking hard, with the names of OTB and UAV123: computed from the true boxes or labelled by eye.
//!
//! A sequence has a computed attribute if its rule holds in at least one frame of [`ONE_IN`].

use foveate_core::geometry::BBox;

/// The rule of a computed attribute must hold in at least one of this many frames.
pub const ONE_IN: usize = 50;
/// Fast motion: the centre moves farther than this in one frame, pixels,
pub const FAST_PIXELS: f64 = 20.0;
/// or farther than this fraction of the box's side (the square root of its area).
pub const FAST_SHARE: f64 = 0.5;
/// Scale change: the area relative to frame 1 is above this, or below its inverse.
pub const SCALE: f64 = 2.0;
/// Aspect change: width / height relative to frame 1 is above this, or below its inverse.
pub const ASPECT: f64 = 1.5;
/// Low resolution: the area of the box is smaller than this, square pixels.
pub const SMALL: f64 = 400.0;

/// A property that makes a sequence hard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Attribute {
    /// The target is not rigid, and its shape changes significantly.
    Deformation,
    /// Another object covers a part of the target, or all of it.
    Occlusion,
    /// Computed: [`FAST_PIXELS`], [`FAST_SHARE`].
    FastMotion,
    /// Computed: [`SCALE`].
    ScaleChange,
    /// Computed: [`ASPECT`].
    AspectChange,
    /// The target rotates, in the plane of the picture or out of it.
    Rotation,
    /// Motion blurs the target or the picture.
    Blur,
    /// Computed: [`SMALL`].
    LowResolution,
    /// Similar objects or a similar background are near (OTB: background clutter).
    LookAlikes,
    /// The camera moves, or is moved with the target.
    CameraMotion,
}

impl Attribute {
    /// All attributes, in the order of tables.
    pub const ALL: [Self; 10] = [
        Self::Deformation,
        Self::Occlusion,
        Self::FastMotion,
        Self::ScaleChange,
        Self::AspectChange,
        Self::Rotation,
        Self::Blur,
        Self::LowResolution,
        Self::LookAlikes,
        Self::CameraMotion,
    ];

    /// Returns the name in tables and lists.
    pub fn name(self) -> &'static str {
        match self {
            Self::Deformation => "deformation",
            Self::Occlusion => "occlusion",
            Self::FastMotion => "fast motion",
            Self::ScaleChange => "scale change",
            Self::AspectChange => "aspect change",
            Self::Rotation => "rotation",
            Self::Blur => "blur",
            Self::LowResolution => "low resolution",
            Self::LookAlikes => "look-alikes",
            Self::CameraMotion => "camera motion",
        }
    }

    /// Returns whether the attribute is computed from the true boxes.
    pub fn is_computed(self) -> bool {
        matches!(self, Self::FastMotion | Self::ScaleChange | Self::AspectChange | Self::LowResolution)
    }
}

/// Computes the attributes of the true boxes. Frames with absent truth or a truth without area do not count; motion is measured between
/// adjacent frames.
pub fn computed(truth: &[Option<BBox>]) -> Vec<Attribute> {
    let seen = |b: &Option<BBox>| b.filter(|b| b.w > 0.0 && b.h > 0.0);
    let boxes: Vec<BBox> = truth.iter().filter_map(seen).collect();
    let pairs: Vec<(BBox, BBox)> = truth.windows(2).filter_map(|two| Some((seen(&two[0])?, seen(&two[1])?))).collect();
    let Some(first) = boxes.first() else { return vec![] };
    let area = |b: &BBox| b.w * b.h;
    let fast = |(a, b): &(BBox, BBox)| {
        let moved = (b.centre().0 - a.centre().0).hypot(b.centre().1 - a.centre().1);
        moved > FAST_PIXELS || moved > FAST_SHARE * area(a).sqrt()
    };
    let outside = |ratio: f64, limit: f64| ratio > limit || ratio < 1.0 / limit;
    let count = |such: &dyn Fn(&BBox) -> bool| boxes.iter().filter(|b| such(b)).count();
    let often = |count: usize, of: usize| count > 0 && count * ONE_IN >= of;
    let n = boxes.len();
    let found = [
        (Attribute::FastMotion, often(pairs.iter().filter(|p| fast(p)).count(), pairs.len())),
        (Attribute::ScaleChange, often(count(&|b| outside(area(b) / area(first), SCALE)), n)),
        (Attribute::AspectChange, often(count(&|b| outside(b.w / b.h * first.h / first.w, ASPECT)), n)),
        (Attribute::LowResolution, often(count(&|b| area(b) < SMALL), n)),
    ];
    found.into_iter().filter_map(|(attribute, is)| is.then_some(attribute)).collect()
}

/// Returns whether width / height stays within [`ASPECT`] of frame 1's in every frame with a true box.
pub fn keeps_aspect(truth: &[Option<BBox>]) -> bool {
    let mut ratios = truth.iter().flatten().filter(|b| b.w > 0.0 && b.h > 0.0).map(|b| b.w / b.h);
    let first = ratios.next().unwrap_or(1.0);
    ratios.all(|ratio| (1.0 / ASPECT..=ASPECT).contains(&(ratio / first)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a box with its centre at `x`.
    fn at(x: f64, w: f64, h: f64) -> Option<BBox> {
        Some(BBox { x: x - 0.5 * w, y: -0.5 * h, w, h })
    }

    #[test]
    fn rules_on_made_up_boxes() {
        let still = vec![at(0.0, 100.0, 100.0); 100];
        assert_eq!(computed(&still), []);
        // One frame of 100 is not enough, two are.
        let with = |change: &[(usize, Option<BBox>)]| {
            let mut truth = still.clone();
            change.iter().for_each(|(i, b)| truth[*i] = *b);
            computed(&truth)
        };
        let (tall, large) = (at(0.0, 80.0, 125.0), at(0.0, 145.0, 145.0));
        assert_eq!(with(&[(50, large)]), []);
        assert_eq!(with(&[(50, large), (51, large)]), [Attribute::ScaleChange]);
        assert_eq!(with(&[(50, tall), (51, tall)]), [Attribute::AspectChange], "0.64 is below 1 / 1.5");
        assert!(keeps_aspect(&[large, None, at(9.0, 125.0, 90.0)]) && !keeps_aspect(&[large, tall, large]));
        // A motion of 21 px there and back counts as two motions of 99; if the truth of the frame between is absent, there is none.
        assert_eq!(with(&[(50, at(21.0, 100.0, 100.0))]), [Attribute::FastMotion]);
        assert_eq!(with(&[(50, at(19.0, 100.0, 100.0))]), []);
        assert_eq!(with(&[(49, None), (50, at(21.0, 100.0, 100.0)), (51, None)]), []);
        // Six pixels are more than half of ten: small, and fast for its size.
        let small: Vec<_> = (0..10).map(|i| at(6.0 * f64::from(i), 10.0, 10.0)).collect();
        assert_eq!(computed(&small), [Attribute::FastMotion, Attribute::LowResolution]);
        assert_eq!(computed(&[at(0.0, 20.0, 20.0)]), [], "400 square pixels are not below 400");
        assert_eq!((computed(&[]), computed(&[None, at(0.0, 0.0, 5.0)])), (vec![], vec![]));
    }

    #[test]
    fn names_are_unlike() {
        let mut names: Vec<_> = Attribute::ALL.iter().map(|a| a.name()).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), Attribute::ALL.len());
        assert!(Attribute::ALL.is_sorted(), "tables and sorted lists have one order");
    }
}
