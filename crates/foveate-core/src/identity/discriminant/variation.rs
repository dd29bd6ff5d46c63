//! How the features of a target vary along its track: their within-class covariance C, learned once, from many tracks.
//!
//! Ridge regression takes all features to be equally sure. Those of a target that turns, bends and passes through other light are not, and
//! they do not vary one by one. With δ the deviation of a target's features from their mean over its track,
//! ```text
//! E (w · (h + δ) − label)² = (w · h − label)² + wᵀ C w,   C = E δ δᵀ
//! ```
//! so that with `weight` · C beside the ridge the score relies on stable features (Fisher, 1936; within-class
//! covariance normalisation: Hatch et al., 2006). A frame has some sixty training places; `weight` is the number of
//! them that count as the target's.
//!
//! Deviation: the paper learns features from photographs, and nothing of how they change.

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::identity::Encoder;
use crate::identity::numbers::{codes, floats};
use crate::identity::oriented::Oriented;
use crate::tree::Node;
use foveate_base::error::within;
use foveate_base::files::Files;
use foveate_base::{Error, Result};

/// Settings of the variation that is expected of a target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Variation {
    /// Weight of the covariance in the matrix to which `discriminant.ridge` is added, 0 to 1000.
    pub weight: f64,
    /// A file of `foveate train variation`, or `builtin:natural-variation`.
    pub covariance: String,
}

impl Default for Variation {
    fn default() -> Self {
        Self { weight: 30.0, covariance: "builtin:natural-variation".into() }
    }
}

impl Variation {
    /// Fails if the weight is out of range.
    pub fn check(&self) -> Result<()> {
        within("variation.weight", self.weight, 0.0, 1000.0)
    }

    /// The term added to the sums of an encoder's features, if the covariance counts.
    ///
    /// # Errors
    /// As [`Variation::read`]; [`Error::Config`] if it is not the covariance of these features.
    pub(crate) fn penalty(&self, files: &dyn Files, encoder: &(dyn Encoder + 'static)) -> Result<Option<Arc<[f32]>>> {
        self.read(files)?.map(|covariance| covariance.penalty(self.weight, encoder)).transpose()
    }

    /// The covariance, if it counts.
    ///
    /// # Errors
    /// Fails if the file cannot be read, or is none of `foveate train variation`.
    pub fn read(&self, files: &dyn Files) -> Result<Option<Covariance>> {
        match self.covariance.strip_prefix("builtin:") {
            _ if self.weight == 0.0 => Ok(None),
            None => {
                let path = Path::new(&self.covariance);
                Covariance::parse(&files.read(path)?, path).map(Some)
            }
            Some("natural-variation") => {
                let shipped = include_bytes!("../../../models/natural-variation.json");
                Covariance::parse(shipped, Path::new(&self.covariance)).map(Some)
            }
            Some(name) => Err(Error::Config(format!(
                "variation.covariance: there is no builtin:{name}; there is builtin:natural-variation, or the name of a file of \
                 `foveate train variation`"
            ))),
        }
    }
}

/// A covariance of features of the oriented encoder, all three of its parts with a weight of 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Covariance {
    /// Lengths of the parts: gradients, grey, colour.
    parts: [usize; 3],
    #[serde(with = "floats")]
    deviations: Vec<f32>,
    /// Correlations in 1/127, the lower triangle without its diagonal.
    #[serde(with = "codes")]
    correlations: Vec<i8>,
}

/// As it is in a file.
#[derive(Serialize)]
struct Written<'a> {
    /// How it was made.
    command: &'a str,
    /// Of the pictures and boxes it was made of.
    sha256: &'a str,
    #[serde(flatten)]
    covariance: &'a Covariance,
}

/// Lengths of the parts with weights of 1: colour is two channels.
const UNIT: [f32; 3] = [1.0, 1.0, std::f32::consts::FRAC_1_SQRT_2];
/// Correlations are made smaller by a twentieth: as bytes they then still are a covariance.
const SHRUNK: f64 = 0.95;
/// The most features.
const MOST: usize = 4096;

impl Covariance {
    /// Of the sums of products of features (all pairs, row by row) of so many deviations, of parts of these lengths.
    pub fn of(parts: [usize; 3], products: &[f64], count: f64) -> Self {
        let n = parts.iter().sum::<usize>();
        assert_eq!(products.len(), n * n, "all pairs of features");
        let deviation = |i: usize| (products[i * n + i] / count).max(0.0).sqrt();
        let correlation = |(i, j): (usize, usize)| {
            let of = products[i * n + j] / count / (deviation(i) * deviation(j));
            (127.0 * SHRUNK * if of.is_finite() { of } else { 0.0 }).round() as i8
        };
        let pairs = (0..n).flat_map(|i| (0..i).map(move |j| (i, j)));
        Self {
            parts,
            deviations: (0..n).map(|i| deviation(i) as f32).collect(),
            correlations: pairs.map(correlation).collect(),
        }
    }

    /// As the bytes of a file, with metadata on its training.
    pub fn to_json(&self, command: &str, sha256: &str) -> String {
        let written = Written { command, sha256, covariance: self };
        serde_json::to_string_pretty(&Node::of(&written)).expect("plain data") + "\n"
    }

    /// From the content of a file.
    ///
    /// # Errors
    /// Fails if it is not a file of `foveate train variation`, or damaged.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self> {
        let wrong = |problem: String| {
            Error::malformed(path, format!("{problem}; expected a file of `foveate train variation`"))
        };
        let found: Self = Node::read_json(bytes).map_err(wrong)?;
        let Self { parts, deviations, correlations } = &found;
        let n = parts.iter().try_fold(0usize, |n, part| n.checked_add(*part)).filter(|n| *n <= MOST);
        let n = n.ok_or_else(|| wrong(format!("parts: more than {MOST} features")))?;
        if deviations.len() != n || correlations.len() != n * n.saturating_sub(1) / 2 {
            let found = (deviations.len(), correlations.len());
            return Err(wrong(format!("{} deviations and {} correlations of {n} features", found.0, found.1)));
        }
        if !deviations.iter().all(|v| (0.0..=1.0).contains(v)) {
            return Err(wrong("deviations: features of parts of length 1 deviate by 0 to 1".into()));
        }
        Ok(found)
    }

    /// The term added to the sums of an encoder's features: the lower triangle with a last row for the 1 behind them.
    ///
    /// # Errors
    /// [`Error::Config`] if it is not the covariance of these features.
    fn penalty(&self, weight: f64, encoder: &(dyn Encoder + 'static)) -> Result<Arc<[f32]>> {
        let Some((_, lengths)) = encoder.downcast::<Oriented>().map(Oriented::blocks) else {
            return Err(Error::Config(
                "variation: it is known of features of encoder.kind = \"oriented\" alone; set variation.weight to 0, or leave \
                 [variation] out"
                    .into(),
            ));
        };
        let own: [usize; 3] = encoder.parts().try_into().expect("an oriented encoder has three parts");
        if !own.iter().zip(self.parts).all(|(own, known)| *own == 0 || *own == known) {
            return Err(Error::Config(format!(
                "variation: its covariance is of parts of {:?} features, and those of this retina have {own:?}; make one of its own \
                 with `foveate train variation`, or set variation.weight to 0",
                self.parts
            )));
        }
        let (mut start, mut kept) = (0, vec![]);
        for k in 0..3 {
            let scale = lengths.length[k] / UNIT[k];
            kept.extend((start..start + own[k]).map(|i| (i, self.deviations[i] * scale)));
            start += self.parts[k];
        }
        let mut penalty = Vec::with_capacity((kept.len() + 1) * (kept.len() + 2) / 2);
        for (row, &(i, a)) in kept.iter().enumerate() {
            penalty.extend(kept[..row].iter().map(|&(j, b)| {
                let correlation = f32::from(self.correlations[i * (i - 1) / 2 + j]) / 127.0;
                weight as f32 * correlation * a * b
            }));
            penalty.push(weight as f32 * a * a);
        }
        penalty.resize(penalty.len() + kept.len() + 1, 0.0);
        Ok(penalty.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identity::encoder::Raw;
    use crate::identity::oriented::{Oriented, Weights};
    use foveate_base::files::Nowhere;
    use foveate_base::rng::Streams;
    use rand::RngExt;

    const PARTS: [usize; 3] = [8, 4, 2];

    /// An encoder of one block with one cell of each colour.
    fn encoder(weights: Weights) -> Oriented {
        Oriented::new(&[vec![0; 36], vec![1], vec![2]].concat(), weights).expect("one block and a border")
    }

    /// Of products of twelve random deviations.
    fn random() -> (Covariance, Vec<f64>) {
        let (n, mut rng) = (14, Streams::new(9, 0).rng(0));
        let rows: Vec<f64> = (0..12 * n).map(|_| 0.3 * (rng.random::<f64>() - 0.5)).collect();
        let mut products = vec![0.0; n * n];
        for row in rows.chunks_exact(n) {
            (0..n * n).for_each(|k| products[k] += row[k / n] * row[k % n]);
        }
        (Covariance::of(PARTS, &products, 12.0), products)
    }

    /// By hand, to the last bit of a byte; parts that are not there are left out, and lengths count.
    #[test]
    fn it_is_the_covariance_of_the_parts_there_are() {
        let (it, products) = random();
        let weights = Weights { gradients: 0.6, grey: 0.0, colour: 0.2 };
        let penalty = it.penalty(30.0, &encoder(weights)).expect("its parts");
        let kept: Vec<(usize, f64)> =
            (0..8).map(|i| (i, 0.6f64.sqrt())).chain((12..14).map(|i| (i, 0.2f64.sqrt()))).collect();
        assert_eq!(penalty.len(), 11 * 12 / 2);
        for (row, &(i, a)) in kept.iter().enumerate() {
            for (column, &(j, b)) in kept[..=row].iter().enumerate() {
                let of = |i: usize, j: usize| products[i * 14 + j] / 12.0;
                let exact = 30.0 * a * b * of(i, j) * if i == j { 1.0 } else { SHRUNK };
                let within = 30.0 * a * b * (of(i, i) * of(j, j)).sqrt() * 0.5 / 127.0 + 1e-5;
                let found = f64::from(penalty[row * (row + 1) / 2 + column]);
                assert!((found - exact).abs() <= within, "{i}, {j}: {found} is not {exact}");
            }
        }
        assert!(penalty[10 * 11 / 2..].iter().all(|v| *v == 0.0), "the 1 behind the features does not vary");
    }

    #[test]
    fn a_file_keeps_it() {
        let (it, _) = random();
        let text = it.to_json("train variation", "ab");
        let path = Path::new("x.json");
        assert_eq!(Covariance::parse(text.as_bytes(), path).expect("written so"), it);
        for (from, to, part) in [
            ("\"parts\"", "\"part\"", "missing field"),
            ("\"deviations\": \"", "\"deviations\": \"AAAAAAAAAAAAAAAA", "deviations and"),
            ("\"deviations\": \"", "\"deviations\": \"?", "Invalid symbol"),
            ("    8,", "    4294967296,", "features"),
            ("{", "", "x.json"),
        ] {
            let damaged = text.replacen(from, to, 1);
            let said = Covariance::parse(damaged.as_bytes(), path).expect_err(part).to_string();
            assert!(said.contains(part) && said.contains("x.json"), "{said}");
        }
    }

    /// What ships is positive definite but for rounding: no direction of the features is rewarded. By Cholesky, with a millionth added.
    #[test]
    fn what_ships_is_a_covariance() {
        let it = Variation::default().read(&Nowhere).expect("it ships").expect("it counts");
        let n = it.deviations.len();
        let mut l = vec![0.0f64; n * n];
        for i in 0..n {
            for j in 0..=i {
                let of = match i == j {
                    true => 1.0 + 1e-6,
                    false => f64::from(it.correlations[i * (i - 1) / 2 + j]) / 127.0,
                };
                let left = of - (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum::<f64>();
                assert!(i != j || left > 0.0, "feature {i}");
                l[i * n + j] = if i == j { left.sqrt() } else { left / l[j * n + j] };
            }
        }
        assert!(it.deviations.iter().all(|v| *v > 0.0));
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let (it, _) = random();
        let said = it.penalty(1.0, &Raw::new(&[0; 4], true)).expect_err("raw").to_string();
        assert!(said.contains("oriented") && said.contains("weight to 0"), "{said}");
        let larger = Oriented::new(&[0; 100], Weights::default()).expect("four blocks");
        let said = it.penalty(1.0, &larger).expect_err("larger").to_string();
        assert!(said.contains("[8, 4, 2]") && said.contains("train variation"), "{said}");
        let other = |weight, name: &str| Variation { weight, covariance: name.into() }.read(&Nowhere);
        assert!(other(1.0, "builtin:digits").expect_err("none").to_string().contains("builtin:natural-variation"));
        assert!(other(1.0, "mine.json").is_err());
        assert!(other(0.0, "mine.json").expect("not read").is_none());
        let wrong = Variation { weight: f64::NAN, ..Variation::default() };
        assert!(wrong.check().expect_err("out of range").to_string().contains("variation.weight"));
    }
}
