//! The machine itself: energy, free energy, hidden units, classes.

use super::super::number::is_usable;
use super::super::units::{add_bias, dot, softplus};
use super::batch::{add, add_gated, classify, gates_of, gather, times};
use super::parameters::{Offset, Parameters, Shape};
use super::{Code, Places};
use foveate_base::rows::Rows;
use foveate_base::{Error, Result};
use foveate_kernels::bias_logistic;
use serde::{Deserialize, Serialize};

/// A multi-fixation RBM.
#[derive(Clone, Debug, PartialEq)]
pub struct FixationRbm {
    pub(super) shape: Shape,
    pub(super) parameters: Parameters,
    /// μ, n_v.
    pub(super) offset: Offset,
    /// Fᵀμ.
    pub(super) offset_seen: Vec<f32>,
    pub(super) places: Places,
    pub(super) window: usize,
}

/// A term for each of the last fixations and the resulting probabilities: glimpse by glimpse, without allocation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reading {
    /// `window` rows of D, the oldest first.
    terms: Vec<f32>,
    /// Fixations taken in, at most `window`.
    count: usize,
    gates: Vec<f32>,
    excitation: Vec<f32>,
    on: Vec<f32>,
}

impl FixationRbm {
    pub(super) fn new(
        shape: Shape,
        parameters: Parameters,
        offset: Offset,
        places: Places,
        window: usize,
    ) -> Result<Self> {
        if !parameters.is_usable() || !offset.iter().all(|x| is_usable(*x)) {
            return Err(Error::Invalid("a multi-fixation RBM needs finite numbers up to 1e8".into()));
        }
        let mut offset_seen = vec![0.0; shape.factors];
        times(Rows::new(&offset, shape.n_v), &parameters.filters, &mut offset_seen);
        Ok(Self { shape, parameters, offset, offset_seen, places, window })
    }
    /// Values of a glimpse.
    pub fn glimpse_len(&self) -> usize {
        self.shape.n_v
    }
    /// n_h.
    pub fn hidden(&self) -> usize {
        self.shape.hidden
    }
    /// n_c; 0 if it was learned without classes.
    pub fn classes(&self) -> usize {
        self.shape.classes
    }
    /// D.
    pub fn factors(&self) -> usize {
        self.shape.factors
    }
    /// Fixations of a sequence it was learned from.
    pub fn window(&self) -> usize {
        self.window
    }
    /// The places that have a code.
    pub fn places(&self) -> &Places {
        &self.places
    }
    /// W(k) for one code, n_v × n_h, in f64: for oracles and pictures.
    pub fn weights(&self, code: Code) -> Vec<f64> {
        let (s, p) = (self.shape, &self.parameters);
        let mut gates = vec![0.0; s.factors];
        gates_of(&[code], &p.gates, s.factors, &mut gates);
        let entry = |i: usize, j: usize| -> f64 {
            (0..s.factors)
                .map(|f| [p.filters[i * s.factors + f], gates[f], p.pooling[f * s.hidden + j]].map(f64::from))
                .map(|[a, b, c]| a * b * c)
                .sum()
        };
        (0..s.n_v * s.hidden).map(|e| entry(e / s.hidden, e % s.hidden)).collect()
    }
    /// Log odds of the hidden units but for a class, in f64: c + Σₖ (xₖ − μ)ᵀW(k).
    fn exact_excitation(&self, glimpses: Rows<'_>, codes: &[Code]) -> Vec<f64> {
        assert_eq!((glimpses.width(), glimpses.len()), (self.shape.n_v, codes.len()), "a glimpse for each code");
        let mut z: Vec<f64> = self.parameters.hidden_bias.iter().map(|&c| f64::from(c)).collect();
        for (x, &code) in glimpses.iter().zip(codes) {
            let w = self.weights(code);
            for ((x, m), w) in x.iter().zip(&self.offset).zip(w.chunks_exact(self.shape.hidden)) {
                let x = f64::from(*x) - f64::from(*m);
                z.iter_mut().zip(w).for_each(|(z, w)| *z += x * w);
            }
        }
        z
    }
    /// The part of the energy that glimpses and class alone have.
    fn outer_energy(&self, glimpses: Rows<'_>, class: Option<usize>) -> f64 {
        let seen: f64 = glimpses.iter().map(|x| dot(&self.parameters.visible_bias, x)).sum();
        -seen - class.map_or(0.0, |l| f64::from(self.parameters.class_bias[l]))
    }
    fn labels_of(&self, class: usize) -> &[f32] {
        &self.parameters.labels[class * self.shape.hidden..][..self.shape.hidden]
    }
    /// E(x₁..K, h, y) in nats, in f64; `class` is None for a machine without classes.
    pub fn energy(&self, glimpses: Rows<'_>, codes: &[Code], h: &[f32], class: Option<usize>) -> f64 {
        let z = self.exact_excitation(glimpses, codes);
        let inner: f64 = z.iter().zip(h).map(|(z, &h)| z * f64::from(h)).sum();
        self.outer_energy(glimpses, class) - inner - class.map_or(0.0, |l| dot(self.labels_of(l), h))
    }
    /// F(x₁..K, y) = −log Σₕ exp(−E) in nats, in f64.
    pub fn free_energy(&self, glimpses: Rows<'_>, codes: &[Code], class: Option<usize>) -> f64 {
        let z = self.exact_excitation(glimpses, codes).into_iter().enumerate();
        let u = |j: usize| class.map_or(0.0, |l| f64::from(self.labels_of(l)[j]));
        self.outer_energy(glimpses, class) - z.map(|(j, z)| softplus(z + u(j))).sum::<f64>()
    }
    /// c + Σₖ (xₖ − μ)ᵀW(k) for sequences of `window` glimpses each (any number), a row of n_h each.
    pub(super) fn excitations(&self, glimpses: Rows<'_>, codes: &[Code], window: usize) -> Vec<f32> {
        let s = self.shape;
        assert_eq!((glimpses.width(), glimpses.len()), (s.n_v, codes.len()), "a glimpse for each code");
        let (mut z, mut a) = (vec![0.0; codes.len() * s.factors], vec![0.0; codes.len() * s.factors]);
        gates_of(codes, &self.parameters.gates, s.factors, &mut z);
        times(glimpses, &self.parameters.filters, &mut a);
        a.chunks_exact_mut(s.factors).for_each(|a| add(a, -1.0, &self.offset_seen));
        let sequences = codes.len() / window;
        let (mut g, mut o) = (vec![0.0; sequences * s.factors], vec![0.0; sequences * s.hidden]);
        gather(&z, &a, s.factors, window, false, &mut g);
        times(Rows::new(&g, s.factors), &self.parameters.pooling, &mut o);
        add_bias(&mut o, &self.parameters.hidden_bias);
        o
    }
    /// logistic(c + Σₖ (xₖ − μ)ᵀW(k)), the hidden probabilities without a class: a row of n_h for each sequence of
    /// `window` glimpses.
    pub fn hidden_probabilities(&self, glimpses: Rows<'_>, codes: &[Code], window: usize) -> Vec<f32> {
        let mut h = self.excitations(glimpses, codes, window);
        foveate_kernels::logistic(&mut h);
        h
    }
    /// log p(y | x₁..K), exact, in nats: a row of n_c for each sequence of `window` glimpses.
    pub fn log_posterior(&self, glimpses: Rows<'_>, codes: &[Code], window: usize) -> Vec<f64> {
        let (s, p) = (self.shape, &self.parameters);
        let o = self.excitations(glimpses, codes, window);
        let (mut on, mut log_p) = (vec![0.0; s.classes * s.hidden], vec![0.0; codes.len() / window * s.classes]);
        for (x, log_p) in o.chunks_exact(s.hidden).zip(log_p.chunks_exact_mut(s.classes)) {
            classify(x, &p.labels, &p.class_bias, &mut on, log_p);
        }
        log_p
    }
    /// A reading that has seen nothing yet.
    pub fn reading(&self) -> Reading {
        let s = self.shape;
        Reading {
            terms: vec![0.0; self.window * s.factors],
            count: 0,
            gates: vec![0.0; 2 * s.factors],
            excitation: vec![0.0; s.hidden],
            on: vec![0.0; s.classes * s.hidden],
        }
    }
}

impl Reading {
    /// Forgets all fixations.
    pub fn clear(&mut self) {
        self.count = 0;
    }
    /// Number of fixations so far, at most the machine's window.
    pub fn count(&self) -> usize {
        self.count
    }
    /// Whether it is of a machine of this size.
    pub fn fits(&self, rbm: &FixationRbm) -> bool {
        let sizes = |r: &Self| [r.terms.len(), r.gates.len(), r.excitation.len(), r.on.len()];
        sizes(self) == sizes(&rbm.reading()) && self.count <= rbm.window
    }
    /// Adds a glimpse and drops the oldest of more than `window`.
    pub fn fixate(&mut self, rbm: &FixationRbm, glimpse: &[f32], code: Code) {
        let d = rbm.shape.factors;
        if self.count == rbm.window {
            self.terms.copy_within(d.., 0);
            self.count -= 1;
        }
        let (gates, seen) = self.gates.split_at_mut(d);
        gates_of(&[code], &rbm.parameters.gates, d, gates);
        times(Rows::new(glimpse, rbm.shape.n_v), &rbm.parameters.filters, seen);
        add(seen, -1.0, &rbm.offset_seen);
        let term = &mut self.terms[self.count * d..][..d];
        term.fill(0.0);
        add_gated(term, gates, seen);
        self.count += 1;
    }
    /// c + Σₖ (xₖ − μ)ᵀW(k).
    fn excite(&mut self, rbm: &FixationRbm) {
        let d = rbm.shape.factors;
        let sum = &mut self.gates[..d];
        sum.fill(0.0);
        self.terms.chunks_exact(d).take(self.count).for_each(|term| add(sum, 1.0, term));
        times(Rows::new(sum, d), &rbm.parameters.pooling, &mut self.excitation);
    }
    /// The hidden probabilities given the fixations, without a class: length n_h.
    pub fn hidden_probabilities(&mut self, rbm: &FixationRbm, out: &mut [f32]) {
        self.excite(rbm);
        out.copy_from_slice(&self.excitation);
        bias_logistic(out, &rbm.parameters.hidden_bias);
    }
    /// log p(y | x), exact, in nats: length n_c.
    pub fn log_posterior(&mut self, rbm: &FixationRbm, out: &mut [f64]) {
        let p = &rbm.parameters;
        self.excite(rbm);
        add_bias(&mut self.excitation, &p.hidden_bias);
        classify(&self.excitation, &p.labels, &p.class_bias, &mut self.on, out);
    }
}
