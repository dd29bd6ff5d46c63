//! DIRECT: the largest value of a function on a box, without derivatives or randomness.
//!
//! Jones, Perttunen & Stuckman 1993 (J. Optim. Theory Appl. 79), and the locally biased form of Gablonsky & Kelley 2001
//! (J. Global Optim. 21). The box is cut into rectangles, each known by the value at its centre. A rectangle is worth
//! cutting if, for some rate K of change, no other could reach higher: its (size, value) lies on the upper hull of
//! all. It is trisected along its longest sides, so that every side is 3⁻ᵏ or 3⁻ᵏ⁻¹ of the box's and a rectangle's
//! size follows from how often it was cut.
//!
//! NaN and −∞ mean that a point is not allowed ("hidden constraints"); such a rectangle counts as the worst value seen.

mod heaps;

use heaps::Heaps;

/// Sides of 3⁻³⁰ of the box, 5 · 10⁻¹⁵, are not cut further.
const MOST_CUTS: u16 = 30;

/// Room for this many evaluations is made at once, however many are allowed.
const AT_ONCE: usize = 1 << 16;

/// Values this much apart, relative to themselves, are equal but for rounding: symmetric functions have many such.
const ALIKE: f64 = 1e-12;

/// Which rectangles are cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Jones et al.: size is the distance from centre to corner; equally good rectangles are all cut.
    Original,
    /// Gablonsky & Kelley: size is half the longest side, and one rectangle of a size is cut. Fewer evaluations
    /// where there are few local maxima.
    LocallyBiased,
}

/// The method, and room for its rectangles, which is kept from call to call.
#[derive(Clone, Debug)]
pub struct Direct<const D: usize> {
    form: Form,
    epsilon: f64,
    target: f64,
    /// Size of a rectangle of each class.
    sizes: Vec<f64>,
    rectangles: Vec<Rectangle<D>>,
    heaps: Heaps,
    hull: Vec<(usize, f64)>,
    chosen: Vec<u32>,
    points: Vec<[f64; D]>,
    values: Vec<f64>,
    evaluations: usize,
}

#[derive(Clone, Copy, Debug)]
struct Rectangle<const D: usize> {
    /// In the unit cube about 0.
    centre: [f64; D],
    /// How often each side was cut; these differ by 1 at most.
    cuts: [u8; D],
    /// How often all sides were cut together.
    depth: u16,
}

impl<const D: usize> Direct<D> {
    /// With the settings of its authors: ε = 10⁻⁴ for the original form, 0 for the locally biased one.
    pub fn new(form: Form) -> Self {
        let side = |cuts: usize| 3f64.powi(-(cuts as i32));
        let size = |class: usize| match form {
            Form::Original => {
                let (cuts, shorter) = (class / D, (class % D) as f64);
                0.5 * ((D as f64 - shorter) * side(cuts).powi(2) + shorter * side(cuts + 1).powi(2)).sqrt()
            }
            Form::LocallyBiased => 0.5 * side(class),
        };
        let classes = usize::from(MOST_CUTS) * if form == Form::Original { D } else { 1 };
        Self {
            form,
            epsilon: if form == Form::Original { 1e-4 } else { 0.0 },
            target: f64::INFINITY,
            sizes: (0..classes).map(size).collect(),
            rectangles: Vec::new(),
            heaps: Heaps::default(),
            hull: Vec::new(),
            chosen: Vec::new(),
            points: Vec::new(),
            values: Vec::new(),
            evaluations: 0,
        }
    }
    /// A rectangle is cut only if it may improve on the best value f by ε |f|, at least 0; more looks further afield.
    pub fn epsilon(self, epsilon: f64) -> Self {
        assert!(epsilon >= 0.0 && epsilon.is_finite(), "epsilon is a number from 0, not {epsilon}");
        Self { epsilon, ..self }
    }
    /// Stops at the first value that is not below `target`; batches are finished first.
    pub fn until(self, target: f64) -> Self {
        Self { target, ..self }
    }
    /// Evaluations of the last call.
    pub fn evaluations(&self) -> usize {
        self.evaluations
    }
    /// The best point found and its value, after at most `max_evaluations` (one at least) of `objective`.
    ///
    /// The first point is the centre of the box. Where no point was allowed, the centre with NaN. Limits are finite,
    /// `lower` not above `upper`.
    pub fn maximise(
        &mut self,
        lower: [f64; D],
        upper: [f64; D],
        max_evaluations: usize,
        mut objective: impl FnMut(&[f64; D]) -> f64,
    ) -> ([f64; D], f64) {
        let target = self.target;
        self.search(lower, upper, max_evaluations, |points, values| {
            for (done, (point, value)) in points.iter().zip(values).enumerate() {
                *value = objective(point);
                if *value >= target {
                    return done + 1;
                }
            }
            points.len()
        })
    }
    /// The same with the same points, but `objective` gets all of a sweep at once and fills in their values.
    pub fn maximise_batches(
        &mut self,
        lower: [f64; D],
        upper: [f64; D],
        max_evaluations: usize,
        mut objective: impl FnMut(&[[f64; D]], &mut [f64]),
    ) -> ([f64; D], f64) {
        self.search(lower, upper, max_evaluations, |points, values| {
            objective(points, values);
            points.len()
        })
    }

    /// `evaluate` returns how many of the points it evaluated: all, unless the target was reached.
    fn search(
        &mut self,
        lower: [f64; D],
        upper: [f64; D],
        max_evaluations: usize,
        mut evaluate: impl FnMut(&[[f64; D]], &mut [f64]) -> usize,
    ) -> ([f64; D], f64) {
        let bounded = (0..D).all(|i| lower[i] <= upper[i] && (upper[i] - lower[i]).is_finite());
        assert!(bounded, "a box has finite limits in order, not {lower:?} and {upper:?}");
        let most = max_evaluations.clamp(1, u32::MAX as usize - 1);
        // About the middle, so that points which mirror each other do so to the last bit in a box that does.
        let middle: [f64; D] = std::array::from_fn(|i| lower[i] + 0.5 * (upper[i] - lower[i]));
        let place = |centre: &[f64; D]| {
            std::array::from_fn(|i| (middle[i] + centre[i] * (upper[i] - lower[i])).clamp(lower[i], upper[i]))
        };
        self.clear(most.min(AT_ONCE));

        self.points.push(middle);
        self.values.push(f64::NAN);
        evaluate(&self.points, &mut self.values);
        self.evaluations = 1;
        let (mut best, mut worst) = ((self.points[0], f64::NAN), f64::INFINITY);
        note(&self.points, &self.values, &mut best, &mut worst);
        self.add(Rectangle { centre: [0.0; D], cuts: [0; D], depth: 0 }, self.values[0]);

        let target = self.target;
        let reached = |value: f64| value >= target; // never NaN
        while self.evaluations < most && !reached(best.1) {
            // Until a point is allowed all rectangles are equally good.
            self.choose(best.1, if worst.is_finite() { worst } else { 0.0 });
            if self.chosen.is_empty() {
                break; // nothing is left that could be cut
            }
            self.aim(most - self.evaluations, place);
            let done = evaluate(&self.points, &mut self.values);
            self.evaluations += done;
            note(&self.points[..done], &self.values[..done], &mut best, &mut worst);
            if done == self.points.len() && self.evaluations < most {
                self.cut();
            }
        }
        best
    }

    fn clear(&mut self, room: usize) {
        self.rectangles.clear();
        self.rectangles.reserve(room);
        self.heaps.clear(self.sizes.len(), room);
        self.hull.clear();
        self.hull.reserve(self.sizes.len());
        self.chosen.clear();
        self.chosen.reserve(room);
        self.points.clear();
        self.points.reserve(room);
        self.values.clear();
        self.values.reserve(room);
    }

    fn add(&mut self, rectangle: Rectangle<D>, value: f64) {
        let id = self.heaps.add(if value.is_nan() { f64::NEG_INFINITY } else { value });
        self.rectangles.push(rectangle);
        self.queue(id);
    }
    /// Puts a rectangle among those of its size, unless it is too small to be cut.
    fn queue(&mut self, id: u32) {
        let depth = usize::from(self.rectangles[id as usize].depth);
        let class = if self.form == Form::Original { depth } else { depth / D };
        if class < self.sizes.len() {
            self.heaps.push(class, id);
        }
    }

    /// Takes out the potentially optimal rectangles, the smallest first.
    fn choose(&mut self, best: f64, worst: f64) {
        self.hull.clear();
        for (class, &size) in self.sizes.iter().enumerate() {
            let Some(value) = self.heaps.top(class) else { continue };
            let value = if value == f64::NEG_INFINITY { worst } else { value };
            // From the largest on, the hull rises, ever less steeply for the size that is given up.
            if self.hull.last().is_some_and(|top| value <= top.1) {
                continue;
            }
            while let [.., a, b] = self.hull[..] {
                let (to_b, to_new) = (self.sizes[a.0] - self.sizes[b.0], self.sizes[b.0] - size);
                if (b.1 - a.1) * to_new >= (value - b.1) * to_b {
                    break;
                }
                self.hull.pop();
            }
            self.hull.push((class, value));
        }
        self.chosen.clear();
        let enough = best + self.epsilon * best.abs();
        for i in (0..self.hull.len()).rev() {
            let (class, value) = self.hull[i];
            if i > 0 {
                let (larger, its) = self.hull[i - 1];
                let size = self.sizes[class];
                let rate = (value - its) / (self.sizes[larger] - size);
                if value + rate * size < enough {
                    continue;
                }
            }
            let alike = match self.form {
                Form::Original => value - ALIKE * value.abs(),
                Form::LocallyBiased => f64::INFINITY,
            };
            self.chosen.extend(self.heaps.pop(class));
            while self.heaps.top(class).is_some_and(|other| other.max(worst) >= alike) {
                self.chosen.extend(self.heaps.pop(class));
            }
        }
    }

    /// The points that cutting the chosen ones needs, `most` at most: two for each longest side.
    fn aim(&mut self, most: usize, place: impl Fn(&[f64; D]) -> [f64; D]) {
        self.points.clear();
        for &id in &self.chosen {
            let Rectangle { centre, cuts, depth } = self.rectangles[id as usize];
            let cut = depth / D as u16;
            let third = third(cut);
            for i in (0..D).filter(|&i| u16::from(cuts[i]) == cut) {
                let mut point = centre;
                point[i] = centre[i] - third;
                self.points.push(place(&point));
                point[i] = centre[i] + third;
                self.points.push(place(&point));
            }
            if self.points.len() >= most {
                break;
            }
        }
        self.points.truncate(most);
        self.values.clear();
        self.values.resize(self.points.len(), f64::NAN);
    }

    /// Cuts the chosen ones: the side with the best new value first, so that this value gets the largest rectangle.
    fn cut(&mut self) {
        let mut at = 0;
        for k in 0..self.chosen.len() {
            let id = self.chosen[k];
            let mut rectangle = self.rectangles[id as usize];
            let cut = rectangle.depth / D as u16;
            let third = third(cut);
            let (mut sides, mut n) = ([(0, 0, 0.0); D], 0); // side, its first value's place, the better of both values
            for i in (0..D).filter(|&i| u16::from(rectangle.cuts[i]) == cut) {
                let value = self.values[at].max(self.values[at + 1]);
                let side = (i, at, if value.is_nan() { f64::NEG_INFINITY } else { value });
                let mut j = n;
                while j > 0 && sides[j - 1].2 < side.2 {
                    sides[j] = sides[j - 1];
                    j -= 1;
                }
                sides[j] = side;
                (n, at) = (n + 1, at + 2);
            }
            for &(i, at, _) in &sides[..n] {
                rectangle.cuts[i] += 1;
                rectangle.depth += 1;
                for (step, value) in [(-third, self.values[at]), (third, self.values[at + 1])] {
                    let mut child = rectangle;
                    child.centre[i] += step;
                    self.add(child, value);
                }
            }
            self.rectangles[id as usize] = rectangle;
            self.queue(id);
        }
    }
}

/// A third of a side that was cut so often, of the unit cube.
fn third(cuts: u16) -> f64 {
    const THIRDS: [f64; MOST_CUTS as usize] = {
        let (mut thirds, mut power, mut i) = ([0.0; MOST_CUTS as usize], 1.0, 0);
        while i < thirds.len() {
            power *= 3.0;
            thirds[i] = 1.0 / power;
            i += 1;
        }
        thirds
    };
    THIRDS[usize::from(cuts)]
}

/// Keeps the best point, the first of equals, and the worst value that is allowed.
fn note<const D: usize>(points: &[[f64; D]], values: &[f64], best: &mut ([f64; D], f64), worst: &mut f64) {
    for (point, &value) in points.iter().zip(values) {
        if value > f64::NEG_INFINITY {
            if best.1.is_nan() || value > best.1 {
                *best = (*point, value);
            }
            *worst = worst.min(value);
        }
    }
}

#[cfg(test)]
mod tests;
