//! Colour of the target and of its surroundings: a cue for targets that deform.
//!
//! Two histograms, of the box and of a frame around it, give the probability that a pixel belongs to the target,
//! ```text
//! p(target | bin) = (f + ε/2) / (f + b + ε)
//! ```
//! as in Staple (Bertinetto et al., 2016) and DAT (Possegger et al., 2015). A state's contrast c is the mean of p
//! inside its box minus the mean in a ring around it. With c₁ that of frame 1, its distance is 1 − c / c₁: 0 on the
//! target, about 1 elsewhere. The smaller c₁, the smaller its mixing weight with the distance of shapes: a target
//! with the colours of its surroundings gives no evidence. Sums over boxes are four reads of an integral image.
//!
//! Deviation: the paper has one appearance, learned features of a grey glimpse.

use serde::{Deserialize, Serialize};

mod broad;
mod contrast;

use self::broad::Broad;
pub(super) use self::contrast::RING;
use self::contrast::{EMPTY, FULL, LEAST, RANGE, contrast};
pub(super) use super::integral::step;
use super::integral::{Bins, COLOUR, GREY, Integral, parts};
use super::numbers::floats;
use crate::geometry::{Extent, State};
use crate::saved_state::{Valid, Validate, ensure};
use crate::scene::Image;

foveate_base::settings! {
    /// Settings of the colour model.
    #[derive(Copy)]
    pub struct Settings in "colour" {
        /// Mixing weight of its distance if target and surroundings differ strongly in frame 1, 0 to 1.
        pub mixing_weight: f64 = 0.15; 0.0 to 1.0,
        /// Weight of the newest frame, 0 to 1.
        pub learning_rate: f64 = 0.04; 0.0 to 1.0,
        /// Weight of frame 1, 0 to 1.
        pub first_frame_weight: f64 = 0.3; 0.0 to 1.0,
        /// Evidence deficit above which a frame is not learned, 0 to 2.
        pub gate: f64 = 0.5; 0.0 to 2.0,
    }
}

/// The target: up to this far from the centre, in half boxes; corners of a box are seldom its.
const INSIDE: f64 = 0.8;
/// The surroundings: from here on to there.
const AROUND: (f64, f64) = (1.1, 2.0);

/// Shares of the bins in the target and in its surroundings.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Histograms {
    #[serde(with = "floats")]
    target: Vec<f32>,
    #[serde(with = "floats")]
    around: Vec<f32>,
}

/// The learned histograms of a colour model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct ColourState {
    first: Histograms,
    recent: Histograms,
    contrast: f64,
}

impl Validate for ColourState {
    fn validate(&self, (): &()) -> Valid {
        let Self { first, recent, contrast } = self;
        let bins = first.target.len();
        let sane = |h: &Vec<f32>| h.len() == bins && h.iter().all(|x| (0.0..=1.0).contains(x));
        let all = [&first.target, &first.around, &recent.target, &recent.around];
        ensure([GREY, COLOUR].contains(&bins) && all.into_iter().all(sane) && (LEAST..=1.0).contains(contrast), || {
            "its histograms are not four of one length, or its contrast is out of range".into()
        })
    }
}

/// The colour model of one target.
#[derive(Clone, Debug)]
pub struct Colour {
    settings: Settings,
    pub(super) state: ColourState,
    probability: Vec<f32>,
    /// The same as [`Integral`] sums it.
    parts: Vec<u16>,
    /// Made when it is needed first.
    broad: Option<Box<Broad>>,
    pub(super) counts: Counts,
}

/// The counts of one frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Counts {
    now: Histograms,
    bins: Bins,
    /// Of the columns.
    zones: Vec<Zone>,
}

impl Colour {
    /// Knows nothing yet.
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            state: ColourState { first: Histograms::default(), recent: Histograms::default(), contrast: LEAST },
            probability: vec![],
            parts: vec![],
            broad: None,
            counts: Counts::default(),
        }
    }

    /// The settings it was made with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Resets the model to the target at `state` of the first frame.
    pub fn init(&mut self, image: &Image, state: &State, extent: Extent) {
        self.counts.count(image, state, extent);
        self.state.first.clone_from(&self.counts.now);
        self.broad = None;
        self.restart();
        let mut sums = Integral::default();
        let (w, h) = state.half(extent);
        let (step, w, h) = (step(w.min(h)), RING * w, RING * h);
        self.sum_up(image, [state.x - w, state.y - h, state.x + w, state.y + h], step, &mut sums);
        self.state.contrast = contrast(&sums, state, extent).max(LEAST);
    }

    /// Learns from the target at `state` of a later frame.
    pub fn adapt(&mut self, image: &Image, state: &State, extent: Extent) {
        let Self { counts, settings, state: ColourState { recent, .. }, .. } = self;
        counts.count(image, state, extent);
        let now = &counts.now;
        let rate = settings.learning_rate as f32;
        for (recent, now) in [(&mut recent.target, &now.target), (&mut recent.around, &now.around)] {
            recent.iter_mut().zip(now).for_each(|(r, n)| *r += rate * (n - *r));
        }
        self.judge();
    }

    /// Resets to the first frame.
    pub(super) fn restart(&mut self) {
        self.state.recent.clone_from(&self.state.first);
        self.judge();
    }

    /// Sums over a region of a frame (left, top, right, bottom; pixels), a sample every so many pixels.
    pub(super) fn sum_up(&mut self, image: &Image, region: [f64; 4], step: usize, sums: &mut Integral) {
        sums.fill(image, region, step, &self.parts, &mut self.counts.bins);
    }

    /// The mixing weight of the cue, smaller for a smaller contrast of frame 1.
    pub fn weight(&self) -> f64 {
        self.settings.mixing_weight * self.trust()
    }

    /// The factor of the cue by the contrast of frame 1, 0 to 1.
    pub fn trust(&self) -> f64 {
        (self.state.contrast / FULL).min(1.0)
    }

    /// The distance of a state with these sums: 0 at the contrast of frame 1, 1 without contrast.
    pub(super) fn distance(&self, sums: &Integral, state: &State, extent: Extent) -> f64 {
        1.0 - (contrast(sums, state, extent) / self.state.contrast).clamp(RANGE.0, RANGE.1)
    }

    /// Writes how far the colours at each state are from those of the target in frame 1, in broad bins, which mixed colours hardly change: 0
    /// on the target, 1 without contrast. Returns false, and writes nothing, if the target has the colours of its surroundings.
    pub fn broad_distances(&mut self, image: &Image, states: &[State], extent: Extent, out: &mut [f64]) -> bool {
        let broad =
            self.broad.get_or_insert_with(|| Box::new(Broad::of([&self.state.first.target, &self.state.first.around])));
        broad.distances(image, states, extent, &mut self.counts.bins, out)
    }

    /// p(target | bin) of all bins.
    fn judge(&mut self) {
        let share = self.settings.first_frame_weight as f32;
        let mixed = |first: f32, recent: f32| share * first + (1.0 - share) * recent;
        let Self { state: ColourState { first, recent, .. }, probability, .. } = self;
        let target = first.target.iter().zip(&recent.target).map(|(a, b)| mixed(*a, *b));
        let around = first.around.iter().zip(&recent.around).map(|(a, b)| mixed(*a, *b));
        probability.clear();
        probability.extend(target.zip(around).map(|(f, b)| (f + 0.5 * EMPTY) / (f + b + EMPTY)));
        parts(&self.probability, &mut self.parts);
    }

    /// Continues from a valid state.
    pub(super) fn resume(&mut self, state: ColourState) {
        self.state = state;
        self.broad = None;
        self.judge();
    }
}

/// The whole pixels from `from` to `to` that a picture has along a side.
fn pixels(from: f64, to: f64, side: usize) -> std::ops::Range<usize> {
    let last = side as f64 - 1.0;
    from.clamp(0.0, last) as usize..to.clamp(0.0, last) as usize + 1
}

impl Counts {
    /// Counts the pixels of a target at `state`, and those around it: every so many of a large one.
    fn count(&mut self, image: &Image, state: &State, extent: Extent) {
        let Self { now: Histograms { target, around }, bins, zones } = self;
        let n = if image.planes() == 1 { GREY } else { COLOUR };
        for h in [&mut *target, &mut *around] {
            h.clear();
            h.resize(n, 0.0);
        }
        let (w, h) = state.half(extent);
        let (far, step) = (AROUND.1, step(w.min(h)));
        let columns = pixels(state.x - far * w, state.x + far * w, image.width());
        let rows = pixels(state.y - far * h, state.y + far * h, image.height()).step_by(step);
        zones.clear();
        // As many as there can ever be.
        zones.reserve(image.width());
        zones.extend(columns.clone().step_by(step).map(|x| Zone::of((x as f64 - state.x).abs() / w)));
        let mut counts = [0u32; 2];
        for y in rows {
            let down = Zone::of((y as f64 - state.y).abs() / h);
            let row = bins.of(image, y, columns.clone());
            for (across, bin) in zones.iter().zip(row.iter().step_by(step)) {
                let (histogram, count) = match down.max(*across) {
                    Zone::Inside => (&mut *target, &mut counts[0]),
                    Zone::Between => continue,
                    Zone::Around => (&mut *around, &mut counts[1]),
                };
                histogram[usize::from(*bin)] += 1.0;
                *count += 1;
            }
        }
        for (h, count) in [target, around].into_iter().zip(counts) {
            let share = 1.0 / count.max(1) as f32;
            h.iter_mut().for_each(|v| *v *= share);
        }
    }
}

/// Where a row or column lies; where a pixel does, is the farther of both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Zone {
    Inside,
    Between,
    Around,
}

impl Zone {
    /// So many half boxes off the centre.
    fn of(off: f64) -> Self {
        match off {
            off if off <= INSIDE => Self::Inside,
            off if off >= AROUND.0 => Self::Around,
            _ => Self::Between,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::saved_state::SavedState;

    const EXTENT: Extent = Extent { half_w: 8.0, half_h: 12.0 };
    const TARGET: State = State { x: 40.0, y: 30.0, vx: 0.0, vy: 0.0, log_scale: 0.0, angle: 0.0, log_aspect: 0.0 };

    /// A red box at `x` on a ground of greens.
    fn picture(x: f64) -> Image {
        let mut bytes = vec![];
        for (j, i) in (0..64).flat_map(|j| (0..96).map(move |i| (j, i))) {
            let inside = (i as f64 - x).abs() <= 8.0 && (j as f64 - 30.0).abs() <= 12.0;
            bytes.extend(if inside { [200, 30, 40] } else { [20, 90 + (i * 7 + j * 3) as u8 % 60, 30] });
        }
        Image::from_rgb8(96, 64, &bytes).expect("enough bytes")
    }

    fn colour(settings: Settings) -> Colour {
        let mut it = Colour::new(settings);
        it.init(&picture(TARGET.x), &TARGET, EXTENT);
        it
    }

    #[test]
    fn the_target_is_near_and_other_places_are_far() {
        let mut it = colour(Settings::default());
        assert!(it.state.contrast > 0.8 && it.weight() == 0.15, "{}", it.state.contrast);
        let moved = picture(60.0);
        let at = |x: f64, log_scale: f64| State { x, log_scale, ..TARGET };
        let places = [at(60.0, 0.0), at(40.0, 0.0), at(55.0, 0.0), at(60.0, 0.4), at(60.0, -0.4)];
        let mut sums = Integral::default();
        it.sum_up(&moved, [0.0, 0.0, 96.0, 64.0], 1, &mut sums);
        let d: Vec<f64> = places.iter().map(|s| it.distance(&sums, s, EXTENT)).collect();
        assert!(d[0].abs() < 0.05 && d[1] > 0.95, "{d:?}");
        assert!(
            d[2] > d[0] + 0.1 && d[3] > d[0] + 0.1 && d[4] > d[0] + 0.1,
            "neither beside it nor of another size: {d:?}"
        );
        assert!((it.distance(&sums, &at(300.0, 0.0), EXTENT) - 1.0).abs() < 1e-9, "outside there is nothing");
    }

    #[test]
    fn colours_without_contrast_count_less_and_learning_follows() {
        let plain = Image::from_grey8(96, 64, &[90; 96 * 64]).expect("enough bytes");
        let mut it = Colour::new(Settings::default());
        it.init(&plain, &TARGET, EXTENT);
        assert!(it.weight() <= 0.15 * LEAST / FULL + 1e-12);
        let settings = Settings { learning_rate: 0.5, first_frame_weight: 0.0, ..Settings::default() };
        let mut it = colour(settings);
        let blue = Image::from_rgb8(96, 64, &[10, 20, 230].repeat(96 * 64)).expect("enough bytes");
        let bin = usize::from(Bins::default().of(&blue, 0, 0..1)[0]);
        let before = it.state.recent.target[bin];
        it.adapt(&blue, &TARGET, EXTENT);
        assert_eq!((before, it.state.recent.target[bin]), (0.0, 0.5));
        it.restart();
        let fresh = colour(settings);
        assert_eq!(
            (&it.state.recent, &it.probability, &it.parts),
            (&fresh.state.recent, &fresh.probability, &fresh.parts)
        );
    }

    #[test]
    fn what_is_saved_goes_on_and_damage_is_refused() {
        let mut it = colour(Settings::default());
        it.adapt(&picture(42.0), &State { x: 42.0, ..TARGET }, EXTENT);
        let saved = SavedState::new(&it.state);
        let mut again = Colour::new(Settings::default());
        again.resume(saved.state("colours", &()).expect("it was saved"));
        assert_eq!((&again.state, &again.probability), (&it.state, &it.probability));
        let empty = ColourState { first: Histograms::default(), recent: Histograms::default(), contrast: 0.5 };
        let mut short = it.state.clone();
        short.recent.around.pop();
        for damaged in [empty, short, ColourState { contrast: -1.0, ..it.state.clone() }] {
            assert!(damaged.validate(&()).is_err());
        }
    }
}
