//! States that were seen in different rectangles of a frame, each looked at in its own.

use super::{GazeAppearance, looks};
use crate::geometry::{Gaze, State};

impl GazeAppearance {
    /// Distances of the features at each state to the template at the same gaze, in shape and colour.
    pub(super) fn distances(&mut self, states: &[State], gaze: Gaze, out: &mut [f64]) {
        let Some(first) = states.first() else { return };
        let looks = looks(&*self.retina, self.extent());
        let of = |state: &State| self.buffers.views.of(state, gaze, looks, self.colour.is_some());
        let first = of(first);
        if self.buffers.views.count() == 1 || states.iter().all(|state| of(state) == first) {
            return self.distances_in(first, states, gaze, out);
        }
        let mut apart = std::mem::take(&mut self.buffers.apart);
        apart.view.clear();
        apart.view.extend(states.iter().map(of));
        for k in 0..self.buffers.views.count() {
            apart.which.clear();
            apart.which.extend((0..states.len()).filter(|i| apart.view[*i] == k));
            apart.states.clear();
            apart.states.extend(apart.which.iter().map(|i| states[*i]));
            apart.distances.resize(apart.which.len(), 0.0);
            if !apart.which.is_empty() {
                self.distances_in(k, &apart.states, gaze, &mut apart.distances);
            }
            apart.which.iter().zip(&apart.distances).for_each(|(i, d)| out[*i] = *d);
        }
        self.buffers.apart = apart;
    }

    /// The same for states in one prepared rectangle.
    fn distances_in(&mut self, view: usize, states: &[State], gaze: Gaze, out: &mut [f64]) {
        self.shape_distances(view, states, gaze, out);
        let (extent, sums) = (self.extent(), &self.buffers.views.get(view).sums);
        if let Some(colour) = &self.colour {
            let weight = self.mixing().1;
            for (d, state) in out.iter_mut().zip(states) {
                *d += weight * (colour.distance(sums, state, extent) - *d);
            }
        }
    }
}
