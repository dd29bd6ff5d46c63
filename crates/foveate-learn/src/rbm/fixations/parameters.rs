//! The numbers of a machine, or as many numbers: their gradient, their moments, their mean.

use super::super::io::Tensor;
use super::super::number::is_usable;

/// How large a machine is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shape {
    /// Values of a glimpse.
    pub(super) n_v: usize,
    /// D.
    pub(super) factors: usize,
    /// n_h.
    pub(super) hidden: usize,
    /// Places.
    pub(super) places: usize,
    /// n_c, 0 for none.
    pub(super) classes: usize,
}

/// F, V, P, U, b, c, d.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Parameters {
    /// F, n_v × D: filters.
    pub(super) filters: Vec<f32>,
    /// V, places × D: one row of gates a place.
    pub(super) gates: Vec<f32>,
    /// P, D × n_h: pooling.
    pub(super) pooling: Vec<f32>,
    /// U, n_c × n_h.
    pub(super) labels: Vec<f32>,
    /// b, n_v.
    pub(super) visible_bias: Vec<f32>,
    /// c, n_h.
    pub(super) hidden_bias: Vec<f32>,
    /// d, n_c.
    pub(super) class_bias: Vec<f32>,
}

/// The mean subtracted from glimpses, n_v; measured, not learned.
pub(super) type Offset = Vec<f32>;

/// Names of the tensors in files.
pub(super) const NAMES: [&str; 7] =
    ["filters", "gates", "pooling", "labels", "visible_bias", "hidden_bias", "class_bias"];

impl Parameters {
    pub(super) fn zeros(s: Shape) -> Self {
        let zeros = |n: usize| vec![0.0; n];
        Self {
            filters: zeros(s.n_v * s.factors),
            gates: zeros(s.places * s.factors),
            pooling: zeros(s.factors * s.hidden),
            labels: zeros(s.classes * s.hidden),
            visible_bias: zeros(s.n_v),
            hidden_bias: zeros(s.hidden),
            class_bias: zeros(s.classes),
        }
    }
    pub(super) fn all(&self) -> [&Vec<f32>; 7] {
        let Self { filters, gates, pooling, labels, visible_bias, hidden_bias, class_bias } = self;
        [filters, gates, pooling, labels, visible_bias, hidden_bias, class_bias]
    }
    pub(super) fn all_mut(&mut self) -> [&mut Vec<f32>; 7] {
        let Self { filters, gates, pooling, labels, visible_bias, hidden_bias, class_bias } = self;
        [filters, gates, pooling, labels, visible_bias, hidden_bias, class_bias]
    }
    /// The shapes in the order of [`NAMES`].
    pub(super) fn shapes(s: Shape) -> [Vec<usize>; 7] {
        [
            vec![s.n_v, s.factors],
            vec![s.places, s.factors],
            vec![s.factors, s.hidden],
            vec![s.classes, s.hidden],
            vec![s.n_v],
            vec![s.hidden],
            vec![s.classes],
        ]
    }
    /// Tensors of a file.
    pub(super) fn tensors(&self, s: Shape) -> impl Iterator<Item = Tensor<'_>> {
        let values = NAMES.into_iter().zip(Self::shapes(s)).zip(self.all());
        values.filter(|(_, values)| !values.is_empty()).map(|((name, shape), values)| (name, shape, &**values))
    }
    pub(super) fn is_usable(&self) -> bool {
        self.all().into_iter().flatten().all(|x| is_usable(*x))
    }
}
