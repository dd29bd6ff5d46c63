//! Filters of whitened patches by spherical k-means (Coates, Ng & Lee 2011; Coates & Ng 2012): a convolutional first layer.
//!
//! A patch of n_p values loses its mean, is divided by √(variance + softening) (both only with a softening), and is whitened
//! to n_x numbers x. The filters d₁ … d_K, of length 1, are the columns of D (n_x × K). Training reduces the mean over patches of
//! ‖x − s dⱼ‖², with the best j and s = max(0, dⱼ·x). No step increases it. A patch is a row; this module has no pictures.
//!
//! Whitening is by principal components. ZCA, which Coates and others use, is a rotation of it: lengths and products with filters
//! that were learned behind it stay the same.

mod io;
mod kmeans;
mod train;

pub use self::train::{Recipe, Trainer};

use crate::rbm::Whitening;
use crate::rbm::number::is_usable;
use crate::rbm::product::rows_times;
use foveate_base::rows::Rows;
use foveate_base::{Error, Result};
use rayon::prelude::*;

/// Rows of one product.
const TOGETHER: usize = 256;
/// The most values of a patch, and the most filters.
pub const MOST: (usize, usize) = (1024, 4096);

/// Filters, with the whitening that they were learned behind.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchFilters {
    whitening: Whitening,
    /// n_x × K: a filter a column.
    filters: Vec<f32>,
    softening: Option<f32>,
}

/// The sums over a part of the patches: the cost of the filters, and the terms of their next step.
struct Sums {
    cost: f64,
    parts: [Vec<f64>; 2],
}

impl PatchFilters {
    /// From a whitening of patches, filters (n_x × K, row-major) and the softening of contrasts (above 0), if patches lose their mean.
    ///
    /// # Errors
    /// They do not fit, are more than [`MOST`], or a number is not finite or beyond 1e8.
    pub fn new(whitening: Whitening, filters: Vec<f32>, softening: Option<f32>) -> Result<Self> {
        let (n_p, n_x) = whitening.shape();
        let k = filters.len() / n_x;
        let fits = n_p <= MOST.0 && (1..=MOST.1).contains(&k) && filters.len() == n_x * k;
        let softened = softening.is_none_or(|s| s > 0.0 && is_usable(s));
        if !(fits && softened && filters.iter().all(|x| is_usable(*x))) {
            return Err(Error::Invalid(format!(
                "filters have patches of at most {} values, are 1 to {} of {n_x} finite numbers, with a softening above 0 or none; got \
                 patches of {n_p}, {} numbers, softening {softening:?}",
                MOST.0,
                MOST.1,
                filters.len()
            )));
        }
        Ok(Self { whitening, filters, softening })
    }
    /// (n_p, n_x, K).
    pub fn shape(&self) -> (usize, usize, usize) {
        let (n_p, n_x) = self.whitening.shape();
        (n_p, n_x, self.filters.len() / n_x)
    }
    /// The term added to a patch's variance, if patches lose their mean.
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
    /// The filters as patches, n_p × K: without whitening.
    pub fn pictures(&self) -> Vec<f32> {
        self.whitening.unwhiten(self.filters())
    }
    /// Products dⱼ·x of patches as they are (m × n_p): m × K. A row's result depends on that row alone, bit for bit.
    pub fn codes(&self, patches: Rows<'_>) -> Vec<f32> {
        let (_, n_x, k) = self.shape();
        let white = whiten(&self.whitening, self.softening, patches);
        let mut codes = vec![0.0; patches.len() * k];
        let rows = white.par_chunks(TOGETHER * n_x).zip(codes.par_chunks_mut(TOGETHER * k));
        rows.for_each(|(x, codes)| rows_times(Rows::new(x, n_x), &self.filters, codes));
        codes
    }
    /// The mean of ‖x − s dⱼ‖² over patches as they are (not yet normalised), divided by n_x.
    pub fn cost(&self, patches: Rows<'_>) -> f64 {
        let white = whiten(&self.whitening, self.softening, patches);
        let n_x = self.shape().1;
        let sums = kmeans::sums(Rows::new(&white, n_x), &self.filters, &|| false).expect("nothing stops it");
        sums.cost / (patches.len() * n_x) as f64
    }
}

/// Patches, each less its mean and divided by √(variance + softening), if there is a softening.
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
