//! Gradients, grey and colour of a glimpse (prototype).

use foveate_kernels as kernels;

use super::encoder::Encoder;
use crate::rows::{Rows, RowsMut};
use crate::{Error, Result};

/// prototype
pub struct Oriented {
    blocks: usize,
    cells: usize,
    colour: usize,
    weights: [f32; 3],
}

impl Oriented {
    /// prototype
    pub fn new(channels: &[usize], weights: [f32; 3]) -> Result<Self> {
        let cells = channels.iter().filter(|c| **c == 0).count();
        let side = (cells as f64).sqrt().round() as usize;
        if side * side != cells || side < 6 || (side - 2) % 4 != 0 || side > 34 {
            return Err(Error::Config(format!("oriented needs one square ring of 4 n + 2 cells, got {cells}")));
        }
        Ok(Self { blocks: (side - 2) / 4, cells, colour: channels.len() - cells, weights })
    }
}

/// Zero mean, length `weight`; flat ones shorter.
fn unit(values: &mut [f32], flat: f32, weight: f32) {
    let mean = kernels::sum(values) / values.len() as f32;
    values.iter_mut().for_each(|x| *x -= mean);
    let norm = kernels::dot(values, values).sqrt();
    let gain = weight / (norm + flat * (values.len() as f32).sqrt());
    values.iter_mut().for_each(|x| *x *= gain);
}

impl Encoder for Oriented {
    fn shape(&self) -> (usize, usize) {
        (self.cells + self.colour, 12 * self.blocks * self.blocks + self.colour)
    }
    fn encode(&self, glimpses: Rows<'_>, mut features: RowsMut<'_>) {
        let (n_v, n_h) = self.shape();
        let (h, g) = (8 * self.blocks * self.blocks, 12 * self.blocks * self.blocks);
        let roots = self.weights.map(f32::sqrt);
        for (v, out) in glimpses.data().chunks_exact(n_v).zip(features.data().chunks_exact_mut(n_h)) {
            kernels::oriented(&v[..self.cells], self.blocks, &mut out[..g]);
            out[..h].iter_mut().for_each(|x| *x = x.sqrt());
            unit(&mut out[..h], 0.05, roots[0]);
            unit(&mut out[h..g], 0.1, roots[1]);
            out[g..].copy_from_slice(&v[self.cells..]);
            if self.colour > 0 {
                let half = self.colour / 2;
                for part in out[g..].chunks_mut(half) {
                    part.iter_mut().for_each(|x| *x -= 0.5);
                    let norm = kernels::dot(part, part).sqrt();
                    let gain = (0.5 * self.weights[2]).sqrt() / (norm + 0.03 * (half as f32).sqrt());
                    part.iter_mut().for_each(|x| *x *= gain);
                }
            }
        }
    }
}
