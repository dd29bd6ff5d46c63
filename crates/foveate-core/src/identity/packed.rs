//! Sums of outer products in half their size, for targets that are not updated in this frame.

/// The largest share.
const MOST: f32 = 32767.0;
/// Adding this number rounds others of at most 2^22: the result is in the last bits.
const ROUNDER: f32 = 12_582_912.0;

/// A positive semidefinite matrix as its lower triangle, row after row, in 16 bits a value: a_ij as a share of √(a_ii
/// a_jj), which it never exceeds. The diagonal is exact. The error is at most 1.6e-5 of that root; packing again
/// changes nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Packed {
    diagonal: Vec<f32>,
    shares: Vec<i16>,
}

impl Packed {
    /// Takes up a triangle of `n` rows.
    pub(super) fn pack(&mut self, n: usize, gram: &[f32]) {
        let Self { diagonal, shares } = self;
        diagonal.clear();
        diagonal.extend((0..n).map(|i| gram[i * (i + 3) / 2]));
        shares.resize(gram.len(), 0);
        let inverse: Vec<f32> = diagonal.iter().map(|a| if *a > 0.0 { 1.0 / a.sqrt() } else { 0.0 }).collect();
        each_row(n, |i, from| {
            let scale = MOST * inverse[i];
            for ((share, a), inverse) in shares[from..=from + i].iter_mut().zip(&gram[from..]).zip(&inverse) {
                let rounded = (a * scale * inverse).clamp(-MOST, MOST) + ROUNDER;
                *share = rounded.to_bits() as i16;
            }
        });
    }

    /// The triangle, into `gram`.
    pub(super) fn unpack(&self, gram: &mut Vec<f32>) {
        let (n, roots) = (self.diagonal.len(), self.diagonal.iter().map(|a| a.max(0.0).sqrt()).collect::<Vec<f32>>());
        gram.resize(self.shares.len(), 0.0);
        each_row(n, |i, from| {
            let scale = roots[i] / MOST;
            for ((a, share), root) in gram[from..from + i].iter_mut().zip(&self.shares[from..]).zip(&roots) {
                *a = f32::from(*share) * scale * root;
            }
            gram[from + i] = self.diagonal[i];
        });
    }
}

/// The rows of a triangle with their offsets.
fn each_row(n: usize, mut row: impl FnMut(usize, usize)) {
    (0..n).for_each(|i| row(i, i * (i + 1) / 2));
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::Streams;
    use rand::RngExt;

    #[test]
    fn it_errs_little_and_once() {
        let (n, mut rng) = (37, Streams::new(5, 0).rng(1));
        let mut gram = vec![0.0f32; n * (n + 1) / 2];
        // Rows of which some are large, and one is nothing.
        for _ in 0..60 {
            let row: Vec<f32> = (0..n).map(|i| (rng.random::<f32>() - 0.4) * (i % 9) as f32).collect();
            each_row(n, |i, from| (0..=i).for_each(|j| gram[from + j] += row[i] * row[j]));
        }
        let (mut packed, mut back) = (Packed::default(), vec![]);
        packed.pack(n, &gram);
        packed.unpack(&mut back);
        each_row(n, |i, from| {
            for j in 0..=i {
                let most = 1.6e-5 * (gram[i * (i + 3) / 2] * gram[j * (j + 3) / 2]).sqrt();
                assert!((gram[from + j] - back[from + j]).abs() <= most, "{i} {j}");
            }
            assert_eq!(gram[from + i], back[from + i]);
        });
        let (mut again, mut same) = (Packed::default(), vec![1.0]);
        again.pack(n, &back);
        again.unpack(&mut same);
        assert!(again == packed && same == back);
    }

    #[test]
    fn what_is_no_sum_is_no_panic() {
        let mut back = vec![];
        for odd in [f32::NAN, f32::INFINITY, -1.0, 3e38] {
            let mut packed = Packed::default();
            packed.pack(3, &[odd; 6]);
            packed.unpack(&mut back);
            assert_eq!(back.len(), 6);
        }
    }
}
