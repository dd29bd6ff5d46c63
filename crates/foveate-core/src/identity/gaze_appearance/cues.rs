//! Template, discriminant and colour: which are configured, and their mixing weights.

use std::sync::Arc;

use super::{CHUNK, GazeAppearance, dim, looks};
use crate::geometry::{Fixation, Gaze, State};
use crate::identity::colour::{self, Colour};
use crate::identity::discriminant::{self, Discriminant, Layout, Learning};
use crate::identity::{Buffers, Lesson};
use crate::scene::Image;
use foveate_base::rows::{Rows, RowsMut};

impl GazeAppearance {
    /// Adds a discriminant with these settings.
    pub fn with_discriminant(self, settings: discriminant::Settings) -> Self {
        Self { discriminant: Some(Discriminant::new(settings, self.encoder.parts())), ..self }
    }

    /// The discriminant adds this to its sums for how the target's features are known to vary: a lower triangle, with a last row for the 1
    /// behind them.
    pub(crate) fn with_variation(self, penalty: Option<Arc<[f32]>>) -> Self {
        Self { discriminant: self.discriminant.map(|it| it.with_variation(penalty)), ..self }
    }

    /// The discriminant learns one weight vector for all gazes of a layout.
    pub(crate) fn with_layout(self, layout: Option<Layout>) -> Self {
        let Some(layout) = layout else { return self };
        Self { discriminant: self.discriminant.map(|it| it.with_layout(layout)), ..self }
    }

    /// Learns while tracking the colours of the target and of its surroundings, by these settings.
    pub fn with_colour(self, settings: Option<colour::Settings>) -> Self {
        Self { colour: settings.map(Colour::new), ..self }
    }

    /// Reads the whole box under every gaze: gazes only steer the sharp region of a sensor.
    pub fn with_steady_gaze(self, steady: bool) -> Self {
        Self { steady, ..self }
    }

    /// Learns the first frame, under each gaze of the discriminant, with its distractors as negatives.
    pub(super) fn learn_first(&mut self, image: &Image, state: &State, distractors: &[State]) {
        self.discriminate(image, state, distractors, true);
    }

    /// Learns a frame according to a lesson.
    pub(super) fn take(&mut self, image: &Image, state: &State, distractors: &[State], lesson: Lesson) {
        let extent = self.extent();
        let within = |gate: f64| lesson.deficit <= gate;
        if let Some(colour) = self.colour.as_mut().filter(|colour| within(colour.settings().gate)) {
            colour.adapt(image, state, extent);
        }
        if self.discriminant.as_ref().is_some_and(|it| within(it.settings().gate)) {
            self.discriminate(image, state, distractors, false);
        }
        #[cfg(feature = "learn")]
        self.train(image, state, lesson.deficit);
    }

    /// Looks at the target and around it, and learns the difference: in the first frame under all gazes of the discriminant.
    fn discriminate(&mut self, image: &Image, state: &State, distractors: &[State], first: bool) {
        let Some(mut it) = self.discriminant.take() else { return };
        let extent = self.extent();
        it.look_around(state, extent, distractors);
        let all = if first { it.gazes() } else { &[] };
        let all: Vec<Gaze> = all.iter().map(|gaze| gaze.relative_to(self.committed)).collect();
        let gazes = if all.is_empty() { &[Gaze::CENTRE] } else { &all[..] };
        let places = &it.learning.places;
        // After a look around the target for distractors most often all is there.
        let looks = looks(&*self.retina, extent);
        let Buffers { views, dimmed, .. } = &mut self.buffers;
        if first || views.whole(places, looks).is_none() {
            let kept = self.kept.as_ref().expect("a template is kept before the first look");
            let image = dim(image, &kept.image, self.discounting_background, dimmed);
            views.see_whole(image, places, gazes, looks, self.colour.as_mut());
        }
        for (k, gaze) in gazes.iter().enumerate() {
            self.encode_each(*gaze, &mut it.learning);
            if first { it.learn_first(k) } else { it.learn() }
        }
        self.discriminant = Some(it);
    }

    /// Fills the rows with the features at all places under a gaze, each with a 1 behind them.
    fn encode_each(&mut self, gaze: Gaze, Learning { places, rows, .. }: &mut Learning) {
        let (extent, (n_v, n_h)) = (self.extent(), self.encoder.shape());
        let Buffers { views, learned: glimpses, .. } = &mut self.buffers;
        let view = views.whole(places, looks(&*self.retina, extent)).expect("just seen");
        glimpses.resize(CHUNK * n_v, 0.0);
        for (places, rows) in places.chunks(CHUNK).zip(rows.chunks_mut(CHUNK * (n_h + 1))) {
            let mut at = [Fixation::default(); CHUNK];
            at.iter_mut().zip(places).for_each(|(at, place)| *at = place.fixate(gaze, extent));
            let glimpses = &mut glimpses[..places.len() * n_v];
            self.retina.look_each(&view.pyramid, &at[..places.len()], RowsMut::new(glimpses, n_v));
            for (glimpse, row) in glimpses.chunks_exact_mut(n_v).zip(rows.chunks_exact_mut(n_h + 1)) {
                let (features, one) = row.split_at_mut(n_h);
                self.encoder.condition(glimpse);
                self.encoder.encode(Rows::new(glimpse, n_v), RowsMut::new(features, n_h));
                one[0] = 1.0;
            }
        }
    }

    /// Features of states that were seen, under the centre gaze, row by row.
    pub(super) fn look_at_each(&mut self, states: &[State], rows: &mut Vec<f32>) {
        let (extent, (n_v, n_h)) = (self.extent(), self.encoder.shape());
        rows.resize(states.len() * n_h, 0.0);
        let looks = looks(&*self.retina, extent);
        let Buffers { views, learned: glimpse, .. } = &mut self.buffers;
        let colours = self.colour.is_some();
        let view = |state: &State| views.of(state, Gaze::CENTRE, looks, colours);
        let first = states.first().map_or(0, view);
        if let Some(dense) = self.dense.as_mut().filter(|_| states.iter().all(|state| view(state) == first))
            && dense.look(&views.get(first).pyramid, states, extent)
        {
            rows.chunks_exact_mut(n_h).enumerate().for_each(|(k, row)| dense.features(k, row));
            return;
        }
        glimpse.resize(glimpse.len().max(n_v), 0.0);
        for (state, row) in states.iter().zip(rows.chunks_exact_mut(n_h)) {
            let glimpse = &mut glimpse[..n_v];
            self.retina.look(&views.get(view(state)).pyramid, state.fixate(Gaze::CENTRE, extent), glimpse);
            self.encoder.condition(glimpse);
            self.encoder.encode(Rows::new(glimpse, n_v), RowsMut::new(row, n_h));
        }
    }

    /// Mixing weights of the discriminant beside the template, and of colour beside both.
    pub(super) fn mixing(&self) -> (f64, f64) {
        let discriminant = self.discriminant.as_ref().map_or(0.0, |it| it.settings().mixing_weight);
        let colour = self.colour.as_ref().map_or(0.0, Colour::weight);
        (discriminant, colour)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Extent;
    use crate::identity::gaze_appearance::Sharpness;
    use crate::identity::oriented::{Oriented, Weights};
    use crate::identity::{Appearance, Foveal, Memory, Retina, distance, retina::FovealConfig};
    use foveate_base::rng::Streams;

    /// To the bit: after a frame of other colours was learned and the model was reset, it is as after the first frame.
    #[test]
    fn colours_are_forgotten_with_all_that_was_learned() {
        let picture = |target: [u8; 3], around: [u8; 3]| {
            let inside = |x: usize, y: usize| (26..54).contains(&x) && (28..52).contains(&y);
            let bytes = (0..80 * 80).flat_map(|i| if inside(i % 80, i / 80) { target } else { around });
            Image::from_rgb8(80, 80, &bytes.collect::<Vec<u8>>()).expect("80 x 80")
        };
        let [red, green, blue] = [[200, 30, 40], [30, 90, 30], [20, 40, 220]];
        let (first, second) = (picture(red, green), picture(blue, red));
        let (at, extent) = (State { x: 40.0, y: 40.0, ..State::default() }, Extent { half_w: 14.0, half_h: 12.0 });
        let retina =
            Foveal::new(FovealConfig { side: 16.0, rings: vec![[10, 1]], colour: vec![[8, 4]] }).expect("cells");
        let channels: Vec<usize> = retina.cells().iter().map(|c| c.channel).collect();
        let encoder = Oriented::new(&channels, Weights::default()).expect("a square of cells");
        let settings = colour::Settings { learning_rate: 0.5, mixing_weight: 0.5, ..colour::Settings::default() };
        let fixed = Sharpness::Fixed(60.0);
        let mut it = GazeAppearance::new(Arc::new(retina), Arc::new(encoder), distance::Kind::Cosine, fixed)
            .expect("parts that fit")
            .with_colour(Some(settings));
        it.init_template(&first, &at, extent, Streams::new(3, 0));
        let states: Vec<State> = (0..9).map(|k| State { x: 36.0 + f64::from(k), ..at }).collect();
        let judge = |it: &mut GazeAppearance| {
            let mut out = vec![0.0; states.len()];
            it.prepare(&first, &states, &[Gaze::CENTRE]);
            it.log_likelihood(&states, Gaze::CENTRE, &mut out);
            out
        };
        let fresh = judge(&mut it);
        it.prepare(&second, &states, &[Gaze::CENTRE]);
        it.learn(&second, &at, &[], Lesson { deficit: 0.0 });
        assert!(judge(&mut it) != fresh, "colours were learned");
        it.forget();
        assert!(judge(&mut it) == fresh, "colours are forgotten");
    }
}
