//! Remembers the places around the target in confident frames. A patch that was seen beside the target then cannot be
//! the target now.
//!
//! An object is at one place at a time. If the patch at the estimate was visible beside the target some frames ago, it is not the
//! target, however well it fits the learned appearance. Of a remembered frame a with the features of places at the target, Tₐ, and
//! around it, Sₐ, features h of the estimate get
//! ```text
//! max cos(h, s) over s in Sₐ − max cos(h, t) over t in Tₐ
//! ```
//! Deviation: the paper judges by the first frame alone. Kalal, Mikolajczyk and Matas (2010) track back in time to the same end; a
//! look back at places that were seen in any case costs next to nothing.

use foveate_kernels as kernels;
use serde::{Deserialize, Serialize};

use super::numbers;
use crate::geometry::{Extent, State};
use crate::saved_state::{Valid, Validate, ensure};

/// Places nearer to the target than this, across and down, count as at it; template units.
const AT_TARGET: f64 = 1.1;
/// Features are kept as so many steps on either side of 0.
const STEPS: f32 = 127.0;

/// Remembered frames; the newest take the place of the oldest.
#[derive(Clone, Debug)]
pub(crate) struct Surroundings {
    most: usize,
    /// Places of a frame, at most.
    places: usize,
    pub(crate) state: SurroundingsState,
    query: Vec<i8>,
    products: Vec<i32>,
}

/// The remembered frames: none, or as many as there may be, of which some are empty.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct SurroundingsState {
    frames: Vec<Remembered>,
    /// The next frame to overwrite.
    oldest: usize,
}

/// The places of one frame: their features as bytes, row by row, those at the target first, and one over each row's length.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Remembered {
    at_target: usize,
    #[serde(with = "numbers::codes")]
    codes: Vec<i8>,
    lengths: Vec<f32>,
}

impl Surroundings {
    /// A memory of so many frames, at least one, with so many places each, at most; empty.
    pub(crate) fn new(most: usize, places: usize) -> Self {
        Self { most, places, state: SurroundingsState::default(), query: vec![], products: vec![] }
    }

    /// Places of a frame, at most.
    pub(crate) fn places(&self) -> usize {
        self.places
    }

    /// Discards all frames.
    pub(crate) fn clear(&mut self) {
        self.state.oldest = 0;
        for frame in &mut self.state.frames {
            frame.at_target = 0;
            frame.codes.clear();
            frame.lengths.clear();
        }
    }

    /// Stores the features (`rows`, one a place) of places around a target at `state`. No effect unless there are
    /// places both at the target and around it.
    pub(crate) fn remember(&mut self, state: &State, extent: Extent, places: &[State], rows: &[f32]) {
        let (scale, extent) = (state.log_scale.exp(), state.shaped(extent));
        let (w, h) = (AT_TARGET * scale * extent.half_w, AT_TARGET * scale * extent.half_h);
        let at_target = |place: &State| (place.x - state.x).abs() <= w && (place.y - state.y).abs() <= h;
        let count = places.iter().filter(|place| at_target(place)).count();
        if count == 0 || count == places.len() {
            return;
        }
        let width = rows.len() / places.len();
        if self.state.frames.is_empty() {
            // Room for all there may be: a step allocates nothing later.
            let room = || Remembered {
                at_target: 0,
                codes: Vec::with_capacity(self.places * width),
                lengths: Vec::with_capacity(self.places),
            };
            self.state.frames = (0..self.most).map(|_| room()).collect();
            self.products.reserve(self.places);
        }
        let frame = &mut self.state.frames[self.state.oldest];
        self.state.oldest = (self.state.oldest + 1) % self.most;
        frame.at_target = count;
        frame.codes.clear();
        frame.lengths.clear();
        for which in [true, false] {
            let such = places.iter().zip(rows.chunks_exact(width)).filter(|(place, _)| at_target(place) == which);
            such.for_each(|(_, row)| frame.lengths.push(pack(row, &mut frame.codes)));
        }
    }

    /// How much more an estimate with these features resembles the surroundings of the target than the target, the
    /// mean over remembered frames: −2 to 2. 0 without memory.
    pub(crate) fn elsewhere(&mut self, features: &[f32]) -> f64 {
        let Self { state: SurroundingsState { frames, .. }, query, products, .. } = self;
        query.clear();
        let length = pack(features, query);
        let (mut sum, mut compared) = (0.0, 0);
        for frame in frames.iter().filter(|frame| !frame.lengths.is_empty()) {
            compared += 1;
            products.resize(frame.lengths.len(), 0);
            kernels::byte_products(&frame.codes, query, products);
            let cosine = |(product, of): (&i32, &f32)| *product as f32 * of * length;
            let best = |part: std::ops::Range<usize>| {
                let such = products[part.clone()].iter().zip(&frame.lengths[part]);
                such.map(cosine).fold(-1.0, f32::max)
            };
            sum += f64::from(best(frame.at_target..frame.lengths.len()) - best(0..frame.at_target));
        }
        sum / f64::from(compared.max(1))
    }
}

impl Validate<(&Surroundings, usize)> for SurroundingsState {
    /// The settings are those of a memory, and the length of the features.
    fn validate(&self, (memory, width): &(&Surroundings, usize)) -> Valid {
        let n = self.frames.len();
        if ![0, memory.most].contains(&n) || self.oldest >= memory.most {
            return Err(format!("they are of {n} frames, this tracker remembers {}", memory.most));
        }
        let fits = |Remembered { at_target, codes, lengths }: &Remembered| {
            let places = lengths.len();
            let sane = codes.iter().all(|code| *code >= -127) && lengths.iter().all(|of| (0.0..=1.0).contains(of));
            places == 0
                || sane && places <= memory.places && (1..places).contains(at_target) && codes.len() == places * width
        };
        ensure(self.frames.iter().all(fits), || {
            format!("its frames are not of up to {} places of {width} features", memory.places)
        })
    }
}

/// Added and taken off again, it leaves the nearest whole number of one so small: `round_ties_even`, without a call.
const ROUND: f32 = 1.5 * (1 << 23) as f32;

/// Adds features as bytes, the largest of them as 127; one over their length.
fn pack(features: &[f32], codes: &mut Vec<i8>) -> f32 {
    let largest = features.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
    let scale = if largest > 0.0 && largest.is_finite() { STEPS / largest } else { 0.0 };
    let from = codes.len();
    codes.extend(features.iter().map(|x| (x * scale + ROUND - ROUND) as i8));
    length(&codes[from..])
}

/// One over the length of a row; 0 of one without any.
fn length(codes: &[i8]) -> f32 {
    let square: i32 = codes.iter().map(|code| i32::from(*code) * i32::from(*code)).sum();
    if square > 0 { 1.0 / (square as f32).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::saved_state::SavedState;
    use foveate_base::Result;

    const EXTENT: Extent = Extent { half_w: 10.0, half_h: 20.0 };

    /// A row of places 8 px apart, the target at the second; each looks like one axis.
    fn places() -> (Vec<State>, Vec<f32>) {
        let places = (0..4).map(|i| State { x: 100.0 + 16.0 * f64::from(i), y: 50.0, ..State::default() }).collect();
        let rows = (0..4 * 6).map(|k| if k / 6 == k % 6 { 0.5 } else { 0.0 }).collect();
        (places, rows)
    }

    fn axis(k: usize) -> Vec<f32> {
        (0..6).map(|i| f32::from(u8::from(i == k))).collect()
    }

    #[test]
    fn what_was_beside_the_target_is_not_the_target() {
        let (places, rows) = places();
        let mut memory = Surroundings::new(3, 4);
        assert_eq!(memory.elsewhere(&axis(0)), 0.0, "nothing is remembered");
        memory.remember(&places[1], EXTENT, &places, &rows);
        assert_eq!(memory.elsewhere(&axis(1)), -1.0, "the target");
        assert_eq!(memory.elsewhere(&axis(2)), 1.0, "what was beside it");
        assert_eq!(memory.elsewhere(&axis(5)), 0.0, "what was not there");
        assert_eq!(memory.elsewhere(&[0.0; 6]), 0.0);
        assert_eq!(memory.elsewhere(&[f32::NAN; 6]), 0.0);
        // Cosines: lengths do not count, and half of each is neither.
        let both: Vec<f32> = axis(1).iter().zip(axis(2)).map(|(a, b)| 7.0 * (a + b)).collect();
        assert!(memory.elsewhere(&both).abs() < 1e-6);
        memory.clear();
        assert_eq!(memory.elsewhere(&axis(2)), 0.0, "forgotten");
    }

    #[test]
    fn all_frames_are_compared_and_the_oldest_is_dropped() {
        let (places, rows) = places();
        let mut memory = Surroundings::new(3, 4);
        memory.remember(&places[1], EXTENT, &places, &rows);
        for _ in 0..2 {
            memory.remember(&places[2], EXTENT, &places, &rows);
        }
        // Of three, one votes +1 and two vote -1.
        assert!((memory.elsewhere(&axis(2)) + 1.0 / 3.0).abs() < 1e-12);
        memory.remember(&places[2], EXTENT, &places, &rows);
        assert_eq!(memory.elsewhere(&axis(2)), -1.0, "the first frame is forgotten");
        // Alone at the target, or nothing of it: nothing to compare.
        memory.clear();
        memory.remember(&places[1], EXTENT, &places[1..2], &rows[6..12]);
        memory.remember(&State { x: 500.0, ..places[1] }, EXTENT, &places, &rows);
        assert_eq!(memory.elsewhere(&axis(2)), 0.0);
    }

    #[test]
    fn a_saved_memory_continues_and_a_foreign_one_is_refused() {
        let (places, rows) = places();
        let mut memory = Surroundings::new(3, 4);
        for at in [1, 2] {
            memory.remember(&places[at], EXTENT, &places, &rows);
        }
        let saved = SavedState::new(&memory.state);
        let load = |saved: &SavedState, into: &mut Surroundings, width: usize| -> Result<()> {
            into.state = saved.state("surroundings", &(&*into, width))?;
            Ok(())
        };
        let mut again = Surroundings::new(3, 4);
        load(&saved, &mut again, 6).expect("the same settings");
        for step in 0..8 {
            let at = step % 4;
            assert_eq!(memory.elsewhere(&axis(at)), again.elsewhere(&axis(at)));
            for it in [&mut memory, &mut again] {
                it.remember(&places[at], EXTENT, &places, &rows);
            }
        }
        assert!(load(&saved, &mut again, 5).is_err() && load(&saved, &mut again, 0).is_err());
        assert!(load(&saved, &mut Surroundings::new(1, 4), 6).is_err(), "too many frames");
        for damage in ["{\"oldest\":9,\"frames\":[]}", "{\"oldest\":0,\"frames\":[[1,\"?\",[]]]}", "[]"] {
            let damaged = serde_json::from_str(damage).expect("JSON");
            assert!(load(&damaged, &mut again, 6).is_err(), "{damage}");
        }
        let empty = SavedState::new(&Surroundings::new(3, 4).state);
        load(&empty, &mut again, 6).expect("nothing remembered");
        assert_eq!(again.elsewhere(&axis(2)), 0.0);
    }
}
