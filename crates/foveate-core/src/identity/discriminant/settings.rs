//! Settings of the discriminant, and their ranges.

foveate_base::settings! {
    /// Settings of the discriminant. It needs a gaze at the centre; other gazes are compared with the template alone. With the encoder
    /// `oriented`, the policy `explore-then-commit` and no `[variation]` it learns all gazes of the grid.
    #[derive(Copy)]
    pub struct Settings in "discriminant" {
        /// Mixing weight of its score in the distance; the template has the rest, 0 to 1.
        pub mixing_weight: f64 = 0.5; 0.0 to 1.0,
        /// Weight of the newest frame, 0 to 1.
        pub learning_rate: f64 = 0.1; 0.0 to 1.0,
        /// Weight of frame 1, 0 to 1.
        pub first_frame_weight: f64 = 0.5; 0.0 to 1.0,
        /// Ridge added to the diagonal; features have a length of about 1.
        pub ridge: f64 = 0.003; 1e-6 to 1e3,
        /// Probability of dropping each group of features (gradients, grey, colour), 0 to 0.9. The fit minimises the expected error.
        pub dropout: f64 = 0.0; 0.0 to 0.9,
        /// Standard deviation of the Gaussian of labels in position, template units, 0.01 to 10.
        pub spread: f64 = 0.2; 0.01 to 10.0,
        /// Standard deviation of the same Gaussian in log scale, 0.01 to 10.
        pub log_scale: f64 = 0.1; 0.01 to 10.0,
        /// Evidence deficit above which a frame is not learned, 0 to 2.
        pub gate: f64 = 0.5; 0.0 to 2.0,
    }
}

impl Settings {
    /// The factor of the frames since the first, and the weight of the newest.
    pub(super) fn fading(&self) -> (f32, f32) {
        (1.0 - self.learning_rate as f32, self.learning_rate as f32)
    }
}
