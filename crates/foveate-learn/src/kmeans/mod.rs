//! k-means on whitened patches (Coates, Ng & Lee 2011): the filters of a convolutional first layer.
//!
//! A patch of n_p values loses its mean, is divided by √(variance + softening), and is whitened to n_x numbers x. The filters
//! d₁ … d_K have length 1; each patch has one filter and one number s = max(0, d·x), and the mean of ‖x − s d‖² is made
//! small (spherical k-means: Coates & Ng 2012). A patch is a row here; this module knows no pictures.
//!
//! Whitening is by principal components. ZCA, theirs, is a rotation of it, which lengths and products with filters that were
//! learned behind it do not see.

mod io;
mod train;

pub use self::train::{Recipe, Trainer};

use crate::rbm::Whitening;
use foveate_base::rows::Rows;
use foveate_base::{Error, Result};

/// The most values of a patch, and the most filters.
pub const MOST: (usize, usize) = (64, 400);

/// Filters, with the whitening that they were learned behind.
#[derive(Clone, Debug, PartialEq)]
pub struct KMeans {
    whitening: Whitening,
    /// n_x × K: a filter a column.
    filters: Vec<f32>,
    softening: f32,
}

impl KMeans {
    /// From a whitening of patches, filters (n_x × K, row-major, columns of length 1) and the softening of contrasts (above 0).
    ///
    /// Fails if they do not fit, are more than [`MOST`], or a number is not finite.
    pub fn new(whitening: Whitening, filters: Vec<f32>, softening: f32) -> Result<Self> {
        let (n_p, n_x) = whitening.shape();
        let k = filters.len() / n_x;
        let fits = n_p <= MOST.0 && (1..=MOST.1).contains(&k) && filters.len() == n_x * k;
        let finite = filters.iter().all(|x| x.is_finite()) && softening.is_finite();
        if !(fits && finite && softening > 0.0) {
            return Err(Error::Invalid(format!(
                "k-means has patches of at most {} values, 1 to {} filters of {n_x} finite numbers, and a softening above 0; got patches of \
                 {n_p}, {} numbers, softening {softening}",
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
    /// What is added to a patch's variance.
    pub fn softening(&self) -> f32 {
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
    /// The mean of ‖x − s d‖² over patches as they are (not yet normalised), as a share of the mean of ‖x‖².
    pub fn error(&self, patches: Rows<'_>) -> f64 {
        let white = whiten(&self.whitening, self.softening, patches);
        let (n_x, mut left, mut all) = (self.shape().1, 0.0, 0.0);
        for x in white.chunks_exact(n_x) {
            let length: f64 = x.iter().map(|x| f64::from(*x).powi(2)).sum();
            let (_, s) = nearest(x, &self.filters);
            all += length;
            left += length - f64::from(s).powi(2);
        }
        left / all
    }
}

/// Takes the mean out of a patch and divides it by √(variance + softening).
pub fn normalise(patch: &mut [f32], softening: f32) {
    let n = patch.len() as f32;
    let mean = patch.iter().sum::<f32>() / n;
    patch.iter_mut().for_each(|x| *x -= mean);
    let variance = patch.iter().map(|x| x * x).sum::<f32>() / n;
    let gain = 1.0 / (variance + softening).sqrt();
    patch.iter_mut().for_each(|x| *x *= gain);
}

/// x of every patch.
fn whiten(whitening: &Whitening, softening: f32, patches: Rows<'_>) -> Vec<f32> {
    let mut normal = patches.data().to_vec();
    normal.chunks_exact_mut(patches.width()).for_each(|patch| normalise(patch, softening));
    let mut centred = vec![0.0; normal.len()];
    let mut white = vec![0.0; patches.len() * whitening.shape().1];
    whitening.whiten(Rows::new(&normal, patches.width()), &mut centred, &mut white);
    white
}

/// The filter (a column of n_x × K) that x has, and s. Of equal ones it is the first.
fn nearest(x: &[f32], filters: &[f32]) -> (usize, f32) {
    let k = filters.len() / x.len();
    let score = |j: usize| x.iter().enumerate().map(|(i, x)| x * filters[i * k + j]).sum::<f32>();
    let best = (0..k).map(|j| (j, score(j))).fold((0, f32::NEG_INFINITY), |a, b| if b.1 > a.1 { b } else { a });
    (best.0, best.1.max(0.0))
}
