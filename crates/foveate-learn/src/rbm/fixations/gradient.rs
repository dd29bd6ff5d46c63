//! The gradient of a cost on a mini-batch: exact for log p(y | x), contrastive divergence for log p(x, y).
//!
//! Every part of every cost needs ∂/∂θ of Σ −F(x, y) with some weights. With δ the weight of a row times p(h | x, y),
//! and g = Σₖ (V zₖ) ∘ (Fᵀxₖ), this is ∂P = gᵀδ, ∂g = δPᵀ, and from there to V and F as usual. So the discriminative,
//! the positive and the negative part share one backward pass: rows of the data carry the first two, rows of the
//! reconstruction the third.

use super::super::units::{add_bias, add_rows, sample_binary};
use super::batch::{add, add_gated, classify, gates_of, gather, outer, times, times_transposed};
use super::parameters::{Parameters, Shape};
use super::{Code, Recipe};
use foveate_base::rng::Rng;
use foveate_base::rows::Rows;
use foveate_kernels::{add_product, add_to_both, bias_logistic, dot, logistic, product};
use rand::RngExt;
use rayon::prelude::*;

/// Rows whose gradient of U is summed together: fixed, so that no sum depends on the number of threads.
const TOGETHER: usize = 32;

/// A mini-batch and its intermediate results. If a field has both, data come before reconstruction.
#[derive(Debug, Default)]
pub(super) struct Work {
    /// Glimpses less μ, 2 N × n_v.
    pub(super) x: Vec<f32>,
    /// N.
    pub(super) codes: Vec<Code>,
    /// A label for each sequence, or none.
    pub(super) labels: Vec<u8>,
    /// Reconstructed label for each row (sequence or beginning).
    pub(super) fantasy: Vec<u8>,
    /// V z, N × D.
    z: Vec<f32>,
    /// Fᵀx, 2 N × D; later its derivative.
    a: Vec<f32>,
    /// g, 2 M × D.
    g: Vec<f32>,
    /// ∂g, 2 M × D.
    dg: Vec<f32>,
    /// Excitation, later δ, 2 M × n_h.
    delta: Vec<f32>,
    /// p(h | x, y) of the data, then a draw of it, M × n_h.
    h: Vec<f32>,
    /// For each `TOGETHER` rows: gradients of U and d, n_c × (n_h + 1), and p(h | x, y) for all y, n_c × n_h.
    parts: Vec<f32>,
    scratch: Vec<f32>,
}

/// The class probabilities at the end of each sequence of the batch.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tally {
    pub(super) log_posterior: f64,
    pub(super) wrong: usize,
}

/// The ascending gradient of minus the cost, summed over the batch in `work`, in `gradient`; that of `gates` are of V
/// itself. `stream` names the random numbers of row m (0 to M − 1).
pub(super) fn gradient(
    (shape, p, gates, offset): (Shape, &Parameters, &[f32], &[f32]),
    recipe: &Recipe,
    stream: &(dyn Fn(usize) -> Rng + Sync),
    work: &mut Work,
    gradient: &mut Parameters,
) -> Tally {
    let Shape { n_v, factors: d, hidden: n_h, classes, .. } = shape;
    let (window, sequential, (sharp, soft)) = (recipe.window, recipe.sequential(), recipe.shares());
    let Work { x, codes, labels, fantasy, z, a, g, dg, delta, h, parts, scratch } = work;
    let n = codes.len();
    let rows = if sequential { n } else { n / window };
    let of_sequence = |m: usize| if sequential { m / window } else { m };
    let label = |labels: &[u8], m: usize| labels.get(of_sequence(m)).map_or(0, |&l| usize::from(l));
    // F and P are written as a whole, the others summed up.
    let Parameters { gates: of_gates, labels: of_labels, visible_bias, hidden_bias, class_bias, .. } = &mut *gradient;
    [of_gates, of_labels, visible_bias, hidden_bias, class_bias].into_iter().for_each(|sum| sum.fill(0.0));
    x.resize(2 * n * n_v, 0.0);
    z.resize(n * d, 0.0);
    a.resize(2 * n * d, 0.0);
    g.resize(2 * rows * d, 0.0);
    dg.resize(2 * rows * d, 0.0);
    delta.resize(2 * rows * n_h, 0.0);
    h.resize(rows * n_h, 0.0);
    fantasy.resize(rows, 0);
    let (x, x1) = x.split_at_mut(n * n_v);
    let (a0, a1) = a.split_at_mut(n * d);
    let (g0, g1) = g.split_at_mut(rows * d);
    let (delta0, delta1) = delta.split_at_mut(rows * n_h);

    // Up, from the data.
    gates_of(codes, gates, d, z);
    times(Rows::new(x, n_v), &p.filters, a0);
    gather(z, a0, d, window, sequential, g0);
    times(Rows::new(g0, d), &p.pooling, delta0);
    add_bias(delta0, &p.hidden_bias);

    // Classes, and δ of the data.
    let part = classes * (2 * n_h + 1);
    parts.clear();
    parts.resize(rows.div_ceil(TOGETHER) * (part + 2), 0.0);
    (delta0.par_chunks_mut(TOGETHER * n_h), h.par_chunks_mut(TOGETHER * n_h), parts.par_chunks_mut(part + 2))
        .into_par_iter()
        .enumerate()
        .for_each(|(chunk, (delta, h, sums))| {
            let (sums, tally) = sums.split_at_mut(part);
            let (du, rest) = sums.split_at_mut(classes * n_h);
            let (on, dd) = rest.split_at_mut(classes * n_h);
            let mut log_p = [0.0; 256];
            for (r, (delta, h)) in delta.chunks_exact_mut(n_h).zip(h.chunks_exact_mut(n_h)).enumerate() {
                let m = chunk * TOGETHER + r;
                if classes == 0 {
                    logistic(delta);
                    h.copy_from_slice(delta);
                    delta.iter_mut().for_each(|x| *x *= soft);
                    continue;
                }
                let (y, log_p) = (label(labels, m), &mut log_p[..classes]);
                classify(delta, &p.labels, &p.class_bias, on, log_p);
                if !sequential || m % window == window - 1 {
                    tally[0] += log_p[y] as f32;
                    tally[1] += f32::from(u8::from(log_p.iter().any(|q| *q > log_p[y])));
                }
                h.copy_from_slice(&on[y * n_h..][..n_h]);
                delta.fill(0.0);
                for (l, q) in log_p.iter().enumerate() {
                    let target = if l == y { 1.0 } else { 0.0 };
                    let weight = sharp * (target - q.exp() as f32) + soft * target;
                    add_to_both(weight, &on[l * n_h..][..n_h], &mut du[l * n_h..][..n_h], delta);
                    dd[l] += weight;
                }
            }
        });
    let mut tally = Tally::default();
    for sums in parts.chunks_exact(part + 2) {
        add(&mut gradient.labels, 1.0, &sums[..classes * n_h]);
        add(&mut gradient.class_bias, 1.0, &sums[2 * classes * n_h..][..classes]);
        tally.log_posterior += f64::from(sums[part]);
        tally.wrong += sums[part + 1] as usize;
    }

    // Down and up again: one step of Gibbs sampling, of means where the usual practice has means.
    let both = if soft > 0.0 { 2 } else { 1 };
    if soft > 0.0 {
        (h.par_chunks_mut(n_h), fantasy.par_iter_mut()).into_par_iter().enumerate().for_each(|(m, (h, class))| {
            let (mut rng, mut p_h) = (stream(m), [0.0; 64]);
            for h in h.chunks_mut(64) {
                p_h[..h.len()].copy_from_slice(h);
                sample_binary(&p_h[..h.len()], &mut rng, h);
            }
            *class = draw_class(p, h, &mut rng);
        });
        let (hp, gated) = (&mut dg[..rows * d], &mut *a1);
        times_transposed(Rows::new(h, n_h), &p.pooling, hp);
        gated.fill(0.0);
        for (i, (gated, z)) in gated.chunks_exact_mut(d).zip(z.chunks_exact(d)).enumerate() {
            let m = if sequential { i } else { i / window };
            add_gated(gated, z, &hp[m * d..][..d]);
        }
        times_transposed(Rows::new(gated, d), &p.filters, x1);
        bias_logistic(x1, &p.visible_bias);
        x1.chunks_exact_mut(n_v).for_each(|x| add(x, -1.0, offset));
        times(Rows::new(x1, n_v), &p.filters, a1);
        if sequential {
            // The fixations before are the data's; only the last one was reconstructed.
            for (m, g1) in g1.chunks_exact_mut(d).enumerate() {
                if m % window == 0 {
                    g1.fill(0.0)
                } else {
                    g1.copy_from_slice(&g0[(m - 1) * d..][..d])
                }
                add_gated(g1, &z[m * d..][..d], &a1[m * d..][..d]);
            }
        } else {
            gather(z, a1, d, window, false, g1);
        }
        times(Rows::new(g1, d), &p.pooling, delta1);
        for (delta, &y) in delta1.chunks_exact_mut(n_h).zip(&*fantasy) {
            if classes > 0 {
                add(delta, 1.0, &p.labels[usize::from(y) * n_h..][..n_h]);
            }
        }
        bias_logistic(delta1, &p.hidden_bias);
        delta1.iter_mut().for_each(|x| *x *= -soft);
        for (delta, &y) in delta1.chunks_exact(n_h).zip(&*fantasy).filter(|_| classes > 0) {
            add(&mut gradient.labels[usize::from(y) * n_h..][..n_h], 1.0, delta);
            gradient.class_bias[usize::from(y)] -= soft;
        }
        scratch.clear();
        scratch.resize(2 * n_v, 0.0);
        let (seen, dreamt) = scratch.split_at_mut(n_v);
        add_rows(x, seen);
        add_rows(x1, dreamt);
        add(&mut gradient.visible_bias, soft, seen);
        add(&mut gradient.visible_bias, -soft, dreamt);
    }

    // Back, through both at once.
    let (g, delta, dg) = (&g[..both * rows * d], &delta[..both * rows * n_h], &mut dg[..both * rows * d]);
    add_rows(delta, &mut gradient.hidden_bias);
    outer(&mut gradient.pooling, Rows::new(g, d), Rows::new(delta, n_h));
    times_transposed(Rows::new(delta, n_h), &p.pooling, dg);
    let (dg0, dg1) = dg.split_at(rows * d);
    scratch.clear();
    scratch.resize(2 * d, 0.0);
    let (later, now) = scratch.split_at_mut(d);
    for i in (0..n).rev() {
        let m = if sequential { i } else { i / window };
        // The term of fixation i moves its own row and (sequential) all later rows of its sequence.
        if !sequential || i % window == window - 1 {
            later.fill(0.0);
        }
        now.copy_from_slice(&dg0[m * d..][..d]);
        let part = i * d..(i + 1) * d;
        if sequential {
            add(later, 1.0, now);
            now.copy_from_slice(later);
        }
        back(codes[i], now, &mut a0[part.clone()], &z[part.clone()], &mut gradient.gates);
        if both == 2 {
            let dreamt = &dg1[m * d..][..d];
            back(codes[i], dreamt, &mut a1[part.clone()], &z[part], &mut gradient.gates);
            if sequential {
                add(later, 1.0, dreamt);
            }
        }
    }
    let (x, a) = (&work.x[..both * n * n_v], &work.a[..both * n * d]);
    outer(&mut gradient.filters, Rows::new(x, n_v), Rows::new(a, d));
    tally
}

/// From the derivative of a term (V z) ∘ a to those of V and of a; the second overwrites a.
fn back(code: Code, term: &[f32], a: &mut [f32], z: &[f32], gates: &mut [f32]) {
    let d = term.len();
    for (place, share) in code.parts() {
        add_product(share, term, a, &mut gates[place * d..][..d]);
    }
    product(term, z, a);
}

/// y ~ p(y | h).
fn draw_class(p: &Parameters, h: &[f32], rng: &mut Rng) -> u8 {
    let classes = p.class_bias.len();
    if classes == 0 {
        return 0;
    }
    let mut odds = [0.0f32; 256];
    let odds = &mut odds[..classes];
    for (l, q) in odds.iter_mut().enumerate() {
        *q = p.class_bias[l] + dot(&p.labels[l * h.len()..][..h.len()], h);
    }
    let most = odds.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    odds.iter_mut().for_each(|q| *q = (*q - most).exp());
    let mut left = rng.random::<f32>() * odds.iter().sum::<f32>();
    let last = classes - 1;
    odds.iter()
        .position(|q| {
            left -= q;
            left < 0.0
        })
        .unwrap_or(last) as u8
}
