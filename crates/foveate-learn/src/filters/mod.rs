//! Filters of whitened patches: a convolutional first layer, learned in one of three ways.
//!
//! A patch of n_p values loses its mean, is divided by √(variance + softening) (both only where a softening is given), and is whitened
//! to n_x numbers x. The filters d₁ … d_K are the columns of D (n_x × K). A patch is a row here; this module knows no pictures.
//!
//! | [`Method`] | what is made small, the mean over patches of | filters |
//! | --- | --- | --- |
//! | k-means (Coates, Ng & Lee 2011; spherical: Coates & Ng 2012) | ‖x − s dⱼ‖², j and s = max(0, dⱼ·x) the best | of length 1 |
//! | sparse coding (Olshausen & Field 1996) | ½ ‖x − D s‖² + penalty · Σ \|sⱼ\|, s the best | of length 1 at most |
//! | ICA of two layers (Hyvärinen & Hoyer 2000) | Σ √(ε + Σ (dⱼ·x)²): inner sum over a subspace of filters, outer over subspaces | orthonormal |
//!
//! Every step of each makes it smaller or leaves it.
//!
//! Deviation: the second layer of ICA adds up given subspaces; Köster & Hyvärinen (2007) learn it, too, by score matching.
//!
//! Whitening is by principal components. ZCA, which Coates and others use, is a rotation of it, which lengths and products with filters
//! that were learned behind it do not see.

mod io;
mod kmeans;
mod sparse;
mod subspaces;
mod train;

pub use self::train::{Recipe, Trainer};

use crate::Stop;
use crate::rbm::Whitening;
use crate::rbm::product::rows_times;
use foveate_base::rows::Rows;
use foveate_base::{Error, Result};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Rows of one product.
const TOGETHER: usize = 256;
/// The most values of a patch, and the most filters.
pub const MOST: (usize, usize) = (1024, 4096);

/// How filters are learned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Method {
    /// Spherical k-means: one filter a patch.
    #[default]
    Kmeans,
    /// Sparse coding: a patch is a sum of few filters.
    Sparse {
        /// What a unit of Σ |sⱼ| costs; above 0, where a whitened number has variance 1.
        penalty: f32,
    },
    /// Two-layer ICA: filters in subspaces, of which few have energy at a time.
    Ica {
        /// Filters of a subspace: 1, 2, 4 or 8.
        size: usize,
    },
}

/// Filters, with the whitening that they were learned behind.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchFilters {
    method: Method,
    whitening: Whitening,
    /// n_x × K: a filter a column.
    filters: Vec<f32>,
    softening: Option<f32>,
}

/// What a part of the patches says of filters: the cost, and what their next step is made of.
struct Sums {
    cost: f64,
    parts: [Vec<f64>; 2],
}

impl Method {
    /// As commands and model files call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Kmeans => "kmeans",
            Self::Sparse { .. } => "sparse",
            Self::Ica { .. } => "ica",
        }
    }
    /// Fails, with the reason, if a number is out of its range.
    pub fn check(self) -> Result<()> {
        match self {
            Self::Sparse { penalty } if !(penalty > 0.0 && penalty.is_finite()) => {
                Err(Error::Config(format!("the penalty of sparse coding is above 0, got {penalty}")))
            }
            Self::Ica { size } if ![1, 2, 4, 8].contains(&size) => {
                Err(Error::Config(format!("a subspace has 1, 2, 4 or 8 filters, got {size}")))
            }
            _ => Ok(()),
        }
    }
    /// None if it was stopped.
    fn sums(self, white: Rows<'_>, filters: &[f32], stop: Stop<'_>) -> Option<Sums> {
        match self {
            Self::Kmeans => kmeans::sums(white, filters, stop),
            Self::Sparse { penalty } => sparse::sums(white, filters, penalty, stop),
            Self::Ica { size } => subspaces::sums(white, filters, size, stop),
        }
    }
    /// Filters ← the next ones; `some` gives a patch in the place of a filter that none uses. None if it was stopped: the filters are
    /// of no use then.
    fn turn(
        self,
        sums: &Sums,
        filters: &mut [f32],
        n_x: usize,
        some: impl FnMut() -> Vec<f64>,
        stop: Stop<'_>,
    ) -> Option<()> {
        match self {
            Self::Kmeans => kmeans::turn(sums, filters, n_x, some),
            Self::Sparse { .. } => return sparse::turn(sums, filters, n_x, some, stop),
            Self::Ica { size } => return subspaces::turn(sums, filters, n_x, size, stop),
        }
        Some(())
    }
}

impl PatchFilters {
    /// From a whitening of patches, filters (n_x × K, row-major) and the softening of contrasts (above 0), if patches lose their mean.
    ///
    /// Fails if they do not fit, are more than [`MOST`], are no whole subspaces, or a number is not finite.
    pub fn new(method: Method, whitening: Whitening, filters: Vec<f32>, softening: Option<f32>) -> Result<Self> {
        method.check()?;
        let (n_p, n_x) = whitening.shape();
        let k = filters.len() / n_x;
        let whole = if let Method::Ica { size } = method { k.is_multiple_of(size) } else { true };
        let fits = n_p <= MOST.0 && (1..=MOST.1).contains(&k) && filters.len() == n_x * k && whole;
        let softened = softening.is_none_or(|s| s > 0.0 && s.is_finite());
        if !(fits && softened && filters.iter().all(|x| x.is_finite())) {
            return Err(Error::Invalid(format!(
                "filters have patches of at most {} values, are 1 to {} (whole subspaces) of {n_x} finite numbers, with a softening above 0 or none; \
                 got patches of {n_p}, {} numbers, softening {softening:?}",
                MOST.0,
                MOST.1,
                filters.len()
            )));
        }
        Ok(Self { method, whitening, filters, softening })
    }
    /// How they were learned.
    pub fn method(&self) -> Method {
        self.method
    }
    /// (n_p, n_x, K).
    pub fn shape(&self) -> (usize, usize, usize) {
        let (n_p, n_x) = self.whitening.shape();
        (n_p, n_x, self.filters.len() / n_x)
    }
    /// What is added to a patch's variance, if patches lose their mean.
    pub fn softening(&self) -> Option<f32> {
        self.softening
    }
    /// The whitening.
    pub fn whitening(&self) -> &Whitening {
        &self.whitening
    }
    /// n_x × K: a filter a column.
    pub fn filters(&self) -> Rows<'_> {
        Rows::new(&self.filters, self.shape().2)
    }
    /// What the filters look like as patches, n_p × K: the whitening undone.
    pub fn pictures(&self) -> Vec<f32> {
        self.whitening.unwhiten(self.filters())
    }
    /// What the filters say of patches as they are (m × n_p), m × K: dⱼ·x; by sparse coding, the best s. A row's result depends on that
    /// row alone, bit for bit.
    pub fn codes(&self, patches: Rows<'_>) -> Vec<f32> {
        let (_, n_x, k) = self.shape();
        let white = whiten(&self.whitening, self.softening, patches);
        let mut codes = vec![0.0; patches.len() * k];
        let gram = if let Method::Sparse { .. } = self.method { sparse::gram(&self.filters, k) } else { vec![] };
        white.par_chunks(TOGETHER * n_x).zip(codes.par_chunks_mut(TOGETHER * k)).for_each(|(x, codes)| {
            let x = Rows::new(x, n_x);
            match self.method {
                Method::Sparse { penalty } => {
                    sparse::codes(x, (&self.filters, &gram), penalty, sparse::LAST_TURNS, codes, &|| false)
                        .expect("nothing stops it");
                }
                _ => rows_times(x, &self.filters, codes),
            }
        });
        codes
    }
    /// What the method makes small, the mean over patches as they are (not yet normalised), divided by n_x.
    pub fn cost(&self, patches: Rows<'_>) -> f64 {
        let white = whiten(&self.whitening, self.softening, patches);
        let n_x = self.shape().1;
        let sums = self.method.sums(Rows::new(&white, n_x), &self.filters, &|| false).expect("nothing stops it");
        sums.cost / (patches.len() * n_x) as f64
    }
}

/// Patches, each less its mean and divided by √(variance + softening), where there is a softening.
fn normalised(patches: Rows<'_>, softening: Option<f32>) -> Vec<f32> {
    let (mut all, n) = (patches.data().to_vec(), patches.width() as f32);
    for patch in all.chunks_exact_mut(patches.width()) {
        let Some(softening) = softening else { break };
        let mean = patch.iter().sum::<f32>() / n;
        patch.iter_mut().for_each(|x| *x -= mean);
        let variance = patch.iter().map(|x| x * x).sum::<f32>() / n;
        let gain = 1.0 / (variance + softening).sqrt();
        patch.iter_mut().for_each(|x| *x *= gain);
    }
    all
}

/// x of every patch.
fn whiten(whitening: &Whitening, softening: Option<f32>, patches: Rows<'_>) -> Vec<f32> {
    let normal = normalised(patches, softening);
    let mut centred = vec![0.0; normal.len()];
    let mut white = vec![0.0; patches.len() * whitening.shape().1];
    whitening.whiten(Rows::new(&normal, patches.width()), &mut centred, &mut white);
    white
}

/// Column j of the filters ← a direction, at length 1.
fn place(filters: &mut [f32], j: usize, direction: &[f64]) {
    let k = filters.len() / direction.len();
    let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
    direction.iter().enumerate().for_each(|(i, x)| filters[i * k + j] = (x / length) as f32);
}
