//! What a discriminant learned, as plain data.

use serde::{Deserialize, Serialize};

use super::{Discriminant, MOST_PLACES, PLACES, Sums, outer};
use crate::identity::numbers::{decode, encode};
use foveate_base::{Error, Result};

/// Rows of the first frame, its cross sums; the sums of the frames since, the weights. In base64.
type Parts = [String; 5];

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Saved {
    Parts(Parts),
    /// With the short-term memory: its sums and weights, and the weight of its difference from the long-term one.
    Apart {
        parts: Parts,
        short_term: [String; 3],
        apart: f64,
    },
}

impl Discriminant {
    /// Everything learned, to resume from.
    pub fn save(&self) -> serde_json::Value {
        let Self { first_rows, first, recent, packed, weights, .. } = self;
        let mut unpacked = vec![];
        let gram = match recent.gram.is_empty() {
            true => {
                packed.unpack(&mut unpacked);
                &unpacked
            }
            false => &recent.gram,
        };
        let parts = [first_rows, &first.cross, gram, &recent.cross, weights].map(|values| encode(values));
        let short_term = self.short_term.as_ref().and_then(|it| it.apart.map(|apart| (it, apart)));
        let saved = match short_term {
            Some((it, apart)) => {
                let short_term = [&it.sums.gram, &it.sums.cross, &it.weights].map(|values| encode(values));
                Saved::Apart { parts, short_term, apart }
            }
            None => Saved::Parts(parts),
        };
        serde_json::to_value(saved).expect("plain data is JSON")
    }

    /// Restores a state of `save`. Fails without change if it does not fit.
    pub fn load(&mut self, saved: &serde_json::Value) -> Result<()> {
        let bad = |what: String| Error::Invalid(format!("the saved discriminant cannot be used: {what}"));
        let saved = Saved::deserialize(saved).map_err(|e| bad(e.to_string()))?;
        let n = self.weights.len();
        let numbers = |text: &str, expected: usize, most: usize| {
            let numbers = decode(text).ok_or_else(|| bad("it is not base64 of finite numbers".into()))?;
            // Of the first frame there may be distractors besides.
            match (expected..=most).contains(&numbers.len()) && numbers.len() % n == expected % n {
                true => Ok(numbers),
                false => Err(bad(format!(
                    "it has {} numbers where this tracker has {expected}; use the configuration and version it was saved with",
                    numbers.len()
                ))),
            }
        };
        let exact = |text: &str, expected: usize| numbers(text, expected, expected);
        let triangle = n * (n + 1) / 2;
        let (parts, apart) = match &saved {
            Saved::Parts(parts) => (parts, None),
            Saved::Apart { parts, short_term, apart } => (parts, Some((short_term, *apart))),
        };
        let [first_rows, first_cross, gram, cross, weights] = parts;
        let first_rows = numbers(first_rows, PLACES * n, MOST_PLACES * n)?;
        let [first_cross, cross, weights] = [first_cross, cross, weights].map(|text| exact(text, n));
        let (first_cross, recent, weights) =
            (first_cross?, Sums { gram: exact(gram, triangle)?, cross: cross? }, weights?);
        let apart = match (apart, &self.short_term) {
            (Some(([gram, cross, weights], apart)), Some(_)) if (0.0..=1.0).contains(&apart) => {
                let sums = Sums { gram: exact(gram, triangle)?, cross: exact(cross, n)? };
                Some((sums, exact(weights, n)?, apart))
            }
            (Some(_), _) => return Err(bad("only it, and not this tracker, has a short-term memory".into())),
            (None, _) => None,
        };
        if let Some(it) = &mut self.short_term {
            it.apart = apart.as_ref().map(|(.., apart)| *apart);
            (it.sums, it.weights) =
                apart.map_or_else(|| (recent.clone(), weights.clone()), |(sums, weights, _)| (sums, weights));
        }
        outer(&first_rows, n, &mut self.first.gram);
        self.first.cross = first_cross;
        self.recent = recent;
        (self.first_rows, self.weights) = (first_rows, weights);
        Ok(())
    }
}
