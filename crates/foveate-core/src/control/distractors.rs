//! Distractors: places away from the estimate that resemble the target or have some probability.
//!
//! The discriminant (`identity/discriminant.rs`) learns them as negatives before the target passes close to one.
//! Distractors among the particles are present mistakes of the tracker, those around the target
//! ([`DistractorSearch`]) possible future ones.

use crate::geometry::{Extent, Size, State};

foveate_base::settings! {
    /// Places around the target, to find distractors among; lengths in template units (1 = half the target's box).
    pub struct DistractorSettings in "distractors" {
        /// Largest distance from the target, 1 to 50.
        pub reach: f64 = 6.0; 1.0 to 50.0,
        /// Distance of neighbouring places, 0.1 to 10.
        pub step: f64 = 0.8; 0.1 to 10.0,
        /// Number of confident frames whose distractors are remembered; an estimate that resembles one raises P(lost),
        /// 0 to 1000.
        pub remembered: usize = 0; 0.0 to 1000.0,
        /// Whether the discriminant keeps the distractors of frame 1 as hard negatives.
        pub first_frame: bool = false,
    }
}

impl DistractorSettings {
    /// Places of a lattice that is not cut by the border of the picture.
    pub fn count(&self) -> usize {
        (2 * self.steps() as usize + 1).pow(2)
    }
    /// Places on each side of the target, across and down.
    fn steps(&self) -> i32 {
        (self.reach / self.step) as i32
    }
}

/// Looks for distractors around the target in every frame.
#[derive(Clone, Debug)]
pub struct DistractorSearch {
    settings: DistractorSettings,
    places: Vec<State>,
}

impl DistractorSearch {
    /// With these settings.
    pub fn new(settings: DistractorSettings) -> Self {
        Self { settings, places: vec![] }
    }
    /// A lattice of places about the estimate, the estimate one of them, of its size, shape and angle, those inside a picture of
    /// this size; row by row.
    pub fn places(&mut self, size: Size, estimate: &State, extent: Extent) -> &[State] {
        let (scale, extent) = (estimate.log_scale.exp(), estimate.shaped(extent));
        let (dx, dy) = (self.settings.step * extent.half_w * scale, self.settings.step * extent.half_h * scale);
        let count = self.settings.steps();
        let inside = |v: f64, side: usize| (0.0..side as f64).contains(&v);
        self.places.clear();
        for y in (-count..=count).map(|i| estimate.y + f64::from(i) * dy).filter(|y| inside(*y, size.height)) {
            let row = (-count..=count).map(|i| estimate.x + f64::from(i) * dx).filter(|x| inside(*x, size.width));
            self.places.extend(row.map(|x| State { x, y, ..*estimate }));
        }
        &self.places
    }
    /// Whether those of frame 1 are learned.
    pub fn first_frame(&self) -> bool {
        self.settings.first_frame
    }
    /// Distance of neighbouring places and of the farthest, template units.
    pub fn lattice(&self) -> (f64, f64) {
        (self.settings.step, self.settings.reach)
    }
    /// The places that were looked at last.
    pub fn last(&self) -> &[State] {
        &self.places
    }
    /// Adds places to states so that those about an estimate will lie between them, if it is near the middle of these states and
    /// of their size and shape; they are close enough that a box at each leaves nothing out.
    pub fn surround(&self, states: &mut Vec<State>, extent: Extent) {
        let mean = |of: fn(&State) -> f64| states.iter().map(of).sum::<f64>() / states.len() as f64;
        let middle = State { log_aspect: mean(|s| s.log_aspect), log_scale: mean(|s| s.log_scale), ..State::default() };
        let (x, y, extent) = (mean(|s| s.x), mean(|s| s.y), middle.shaped(extent));
        let far = self.settings.reach + SLACK;
        let count = (0.5 * far).ceil() as i32;
        let step = far / f64::from(count) * middle.log_scale.exp();
        for (j, i) in (-count..=count).flat_map(|j| (-count..=count).map(move |i| (f64::from(j), f64::from(i)))) {
            let (x, y) = (x + i * step * extent.half_w, y + j * step * extent.half_h);
            states.push(State { x, y, ..middle });
        }
    }
}

/// How far an estimate may be from the middle of the states, template units.
const SLACK: f64 = 0.3;

/// How many there are at most.
const MOST: usize = 6;
/// How far from the estimate they are at least, and from each other, template units.
const APART: (f64, f64) = (0.7, 0.5);

/// Fills `distractors` with the most probable states away from the estimate and from each other, at most six. Returns
/// the log weight of the best; −∞ without one.
pub fn distractors(
    states: &[State],
    log_weights: &[f64],
    estimate: &State,
    extent: Extent,
    distractors: &mut Vec<State>,
) -> f64 {
    let (w, h) = estimate.half(extent);
    let far = |a: &State, b: &State, apart: f64| {
        let (u, v) = ((a.x - b.x) / w, (a.y - b.y) / h);
        u * u + v * v > apart * apart
    };
    let mut best = f64::NEG_INFINITY;
    distractors.clear();
    distractors.reserve(MOST);
    while distractors.len() < MOST {
        let candidates = states.iter().zip(log_weights).filter(|(state, log_weight)| {
            log_weight.is_finite()
                && far(state, estimate, APART.0)
                && distractors.iter().all(|distractor| far(state, distractor, APART.1))
        });
        match candidates.max_by(|a, b| a.1.total_cmp(b.1)) {
            Some((state, log_weight)) => {
                best = best.max(*log_weight);
                distractors.push(*state);
            }
            None => break,
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXTENT: Extent = Extent { half_w: 10.0, half_h: 20.0 };

    #[test]
    fn places_lie_around_the_target_and_in_the_picture() {
        let mut around = DistractorSearch::new(DistractorSettings { reach: 2.0, step: 0.5, ..Default::default() });
        let at = State { x: 30.0, y: 50.0, log_scale: 0.5f64.ln(), angle: 0.3, ..State::default() };
        let places = around.places(Size::new(100, 60), &at, EXTENT).to_vec();
        assert!(places.contains(&at));
        assert!(places.iter().all(|p| (p.x - at.x).abs() <= 10.0 && (p.y - at.y).abs() <= 20.0 && p.angle == 0.3));
        // Nine columns, and of nine rows 5 px apart from 30 to 70 those above 60.
        assert_eq!((places.len(), places[0].x, places[0].y), (9 * 6, 20.0, 30.0));
        let mut states = vec![at, at];
        around.surround(&mut states, EXTENT);
        let [first, .., last] = &states[2..] else { panic!("corners") };
        assert!(places.iter().all(|p| p.x > first.x && p.y > first.y && p.x < last.x && p.y < last.y));
        let near = |p: &State| states.iter().any(|s| (s.x - p.x).abs() <= 5.0 && (s.y - p.y).abs() <= 10.0);
        assert!(places.iter().all(near), "within a box of one of them");
        let outside = State { x: -50.0, ..at };
        assert!(around.places(Size::new(100, 60), &outside, EXTENT).is_empty(), "nothing there to be mistaken for");
    }

    #[test]
    fn the_best_that_are_apart() {
        let at = |x: f64, y: f64| State { x, y, ..State::default() };
        let states =
            [at(0.0, 0.0), at(6.0, 0.0), at(8.0, 0.0), at(9.0, 0.0), at(0.0, 13.0), at(0.0, 16.0), at(50.0, 0.0)];
        let log_weights = [0.0, -1.0, -3.0, -2.0, -1.5, -4.0, f64::NEG_INFINITY];
        let mut found = vec![State::default()];
        distractors(&states, &log_weights, &State::default(), EXTENT, &mut found);
        assert_eq!(found, [at(9.0, 0.0), at(0.0, 16.0)], "0.6 and 0.65 units are near; -infinity is none");
        let many: Vec<State> = (1..20).map(|i| at(10.0 * f64::from(i), 0.0)).collect();
        distractors(&many, &[0.0; 19], &State::default(), EXTENT, &mut found);
        assert_eq!(found.len(), MOST);
        distractors(&many, &[f64::NAN; 19], &State::default(), EXTENT, &mut found);
        assert!(found.is_empty());
    }
}
