//! The state of a discriminant in a saved tracker.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::{Discriminant, MOST_PLACES, PLACES, Sums};
use crate::identity::numbers::floats;
use crate::saved_state::{SavedState, Valid, Validate, ensure};
use foveate_base::Result;

#[derive(Serialize, Deserialize)]
struct Saved<'a> {
    #[serde(with = "floats")]
    first_rows: Cow<'a, [f32]>,
    #[serde(with = "floats")]
    first_cross: Cow<'a, [f32]>,
    recent: Cow<'a, Sums>,
    #[serde(with = "floats")]
    weights: Cow<'a, [f32]>,
}

impl Validate<Discriminant> for Saved<'_> {
    fn validate(&self, of: &Discriminant) -> Valid {
        let Self { first_rows, first_cross, recent, weights } = self;
        let n = of.weights.len();
        // Of the first frame there may be distractors besides.
        let row = of.width() * of.gazes().len().max(1);
        let rows = (first_rows.len() / row).clamp(PLACES, MOST_PLACES);
        let sums = |sums: &Sums| [(sums.gram.len(), n * (n + 1) / 2), (sums.cross.len(), n)];
        let mut lengths = vec![(first_rows.len(), rows * row), (first_cross.len(), n), (weights.len(), n)];
        lengths.extend(sums(recent));
        lengths.into_iter().try_for_each(|(found, expected)| {
            ensure(found == expected, || format!("it has {found} numbers where this tracker has {expected}"))
        })
    }
}

impl Discriminant {
    /// Everything learned, to resume from.
    pub fn save(&self) -> SavedState {
        let mut recent = Cow::Borrowed(&self.recent);
        if recent.gram.is_empty() {
            self.packed.unpack(&mut recent.to_mut().gram);
        }
        SavedState::new(&Saved {
            first_rows: Cow::Borrowed(&self.first_rows),
            first_cross: Cow::Borrowed(&self.first.cross),
            recent,
            weights: Cow::Borrowed(&self.weights),
        })
    }

    /// Restores a state of `save`. Fails without change if it does not fit.
    pub fn load(&mut self, saved: &SavedState) -> Result<()> {
        let saved: Saved<'_> = saved.state("discriminant", self)?;
        self.first_rows = saved.first_rows.into_owned();
        self.sum_first();
        self.first.cross = saved.first_cross.into_owned();
        (self.recent, self.weights) = (saved.recent.into_owned(), saved.weights.into_owned());
        if let Some(layout) = &mut self.layout {
            layout.take(&self.weights);
        }
        Ok(())
    }
}
