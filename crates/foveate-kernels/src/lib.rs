#![doc = include_str!("../README.md")]
//!
//! # Guarantees
//!
//! Every function is safe to call, and is tested against a plain scalar twin at every level of the
//! machine ([`Level`]): AVX-512, AVX2 with FMA, or portable code, which any architecture compiles,
//! on aarch64 with NEON. The level is found once, at run time.
//!
//! A result depends on the inputs of its own element or row alone: not on its place in the batch, on
//! alignment, or on the thread. Sums run in fixed lanes. Between levels the last bits may differ,
//! because fused multiply-adds round once where two operations round twice.

mod adam;
mod boxes;
mod classes;
mod colour;
mod convolve;
mod covariance;
mod epilogue;
mod exponential;
mod gram;
mod halve;
mod integral;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod lanes;
mod lattice;
mod level;
mod logistic;
mod matrix;
mod normal;
mod oriented;
mod packed;
mod patch;
mod plane;
mod rows;
mod sums;
mod taps;
mod tile;
mod triangle;
#[cfg(target_arch = "x86_64")]
mod upright;
mod vector;
mod wide;
mod zeros;

pub use adam::{Adam, adam};
pub use boxes::{BoxScratch, Pixels, Region, box_means};
pub use classes::{add_to_both, softplus_sum};
pub use colour::{Decoding, blue_yellow, luma, red_green, rgb_of_yuv, take_apart, weighted, weighted_squares};
pub use convolve::{FILTERS, Layer, convolve, correlate, paired, to_steps};
pub use covariance::{
    Covariance, Points, Posterior, covariances, covariances_with, likelihood_gradient, predict, slopes_times,
};
pub use exponential::{exp_from, largest_finite};
pub use gram::{add_outer, symmetric_times};
pub use halve::{half_intensity, halve, intensity, shrink, square_intensity};
pub use integral::{COLOUR_BINS, colour_bins, integral_row};
pub use lattice::{HALVES, Maps, features_among, oriented_blocks, oriented_halves};
pub use level::Level;
pub use logistic::{bias_logistic, logistic};
pub use matrix::{Matrix, Write, matrix_product, matrix_product_f64};
pub use normal::Normals;
pub use oriented::{BLOCK, DIRECTIONS, Lengths, oriented, oriented_features};
pub use packed::{PackedWeights, Precision};
pub use patch::{PATCH, Patch, cut_patch, patch_between, patch_residual};
pub use plane::Plane;
pub use rows::{add_product, add_scaled, add_scaled_bytes, blend, byte_products, product};
pub use sums::{dot, dots, presence, root_overlap, squared_distance, sum};
pub use taps::{taps, taps_rows};
pub use triangle::{SQUARE, extend, factor, invert, solve, solve_back};
