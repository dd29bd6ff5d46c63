//! The parts of a glimpse's features beside each other, each with its mean taken off, and brought to a length of its own.

use super::DIRECTIONS;
use crate::sums::{dot_body, sum_body};

/// How long the parts of [`oriented_features`](super::oriented_features) become, in this order: gradients; grey, the sums over half blocks;
/// and each of both channels of colour. A part of length 0 after gradients is not there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lengths {
    /// Lengths of parts that are not flat.
    pub length: [f32; 3],
    /// Root mean squares that are added to a part's own before it is divided by it: of less it stays short.
    pub flat: [f32; 3],
    /// The value of a colour channel without colour.
    pub neither: f32,
}

impl Lengths {
    /// How many features each part has, of so many blocks a side and so many values of colour.
    pub fn sizes(&self, blocks: usize, colour: usize) -> [usize; 3] {
        let count = blocks * blocks;
        let mut sizes = [DIRECTIONS * count, 4 * count, colour];
        sizes.iter_mut().zip(self.length).skip(1).filter(|(_, length)| *length == 0.0).for_each(|(size, _)| *size = 0);
        sizes
    }
}

/// The destinations of gradients, sums over half blocks and colour: their parts of `out`. The sums go to `room` (4 a
/// block) if grey is no part; colour is empty if unused.
#[inline(always)]
pub(crate) fn places<'a>(
    lengths: &Lengths,
    blocks: usize,
    colour: usize,
    room: &'a mut [f32],
    out: &'a mut [f32],
) -> [&'a mut [f32]; 3] {
    let (count, [_, grey, opponent]) = (blocks * blocks, lengths.length);
    let (gradients, rest) = out.split_at_mut(DIRECTIONS * count);
    let (squares, rest) = if grey > 0.0 { rest.split_at_mut(4 * count) } else { (room, rest) };
    [gradients, squares, if opponent > 0.0 { &mut rest[..colour] } else { &mut [] }]
}

/// Scales all parts written to [`places`] to their lengths.
#[inline(always)]
pub(crate) fn bring_to_length<const V: u8>(lengths: &Lengths, blocks: usize, colour: usize, out: &mut [f32]) {
    let (Lengths { length, flat, .. }, count) = (lengths, blocks * blocks);
    let sizes = lengths.sizes(blocks, colour);
    assert!(out.len() == sizes.iter().sum::<usize>(), "as many features as blocks and colour have");
    // Each part is as long as is known before `lengths` are.
    let (gradients, mut rest) = out.split_at_mut(DIRECTIONS * count);
    let mut take = |n: usize| rest.split_off_mut(..n).expect("as long as all parts");
    centre::<V>(gradients);
    stretch::<V>(gradients, flat[0], length[0]);
    if length[1] > 0.0 {
        let grey = take(4 * count);
        centre::<V>(grey);
        stretch::<V>(grey, flat[1], length[1]);
    }
    if length[2] > 0.0 {
        for _ in 0..2 {
            stretch::<V>(take(colour / 2), flat[2], length[2]);
        }
    }
}

/// Takes the mean off.
#[inline(always)]
fn centre<const V: u8>(part: &mut [f32]) {
    let mean = sum_body::<V>(part) / part.len() as f32;
    part.iter_mut().for_each(|x| *x -= mean);
}

/// Brings the length to `length`; that of a part of little contrast stays short.
#[inline(always)]
fn stretch<const V: u8>(part: &mut [f32], flat: f32, length: f32) {
    let gain = length / (dot_body::<V>(part, part).sqrt() + flat * (part.len() as f32).sqrt());
    part.iter_mut().for_each(|x| *x *= gain);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Level;
    use crate::oriented::{oriented, oriented_features, oriented_features_at};
    use crate::sums::tests::values;

    const LENGTHS: Lengths = Lengths { length: [0.8, 0.5, 0.3], flat: [0.05, 0.1, 0.03], neither: 0.4 };

    fn exact(glimpse: &[f32], blocks: usize, colour: usize) -> Vec<f64> {
        let (patch, cells) = glimpse.split_at(glimpse.len() - colour);
        let (mut gradients, mut squares) = (vec![0.0; 8 * blocks * blocks], vec![0.0; 4 * blocks * blocks]);
        oriented(patch, blocks, &mut gradients, &mut squares);
        let wide = |part: &[f32]| part.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>();
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        let centred = |part: Vec<f64>| {
            let mean = mean(&part);
            part.iter().map(|x| x - mean).collect::<Vec<f64>>()
        };
        let channel = |k: usize| wide(&cells[k * colour / 2..][..colour / 2]).into_iter().map(|x| x - 0.4f32 as f64);
        let parts = [
            (0, centred(wide(&gradients).iter().map(|x| x.sqrt()).collect())),
            (1, centred(wide(&squares))),
            (2, channel(0).collect()),
            (2, channel(1).collect()),
        ];
        let stretched = parts.into_iter().filter(|(_, part)| !part.is_empty()).flat_map(|(k, part)| {
            let (flat, length) = (f64::from(LENGTHS.flat[k]), f64::from(LENGTHS.length[k]));
            let norm = part.iter().map(|x| x * x).sum::<f64>().sqrt() + flat * (part.len() as f64).sqrt();
            part.into_iter().map(move |x| x * length / norm)
        });
        stretched.collect()
    }

    #[test]
    fn features_agree_with_the_twin() {
        for (blocks, colour) in [(1, 0), (3, 2), (4, 32), (5, 18), (8, 200)] {
            let glimpse = values((4 * blocks + 2usize).pow(2) + colour, 2);
            let exact = exact(&glimpse, blocks, colour);
            for level in Level::all() {
                let mut out = vec![f32::NAN; exact.len()];
                oriented_features_at(level, &glimpse, blocks, &LENGTHS, &mut out);
                for (out, exact) in out.iter().zip(&exact) {
                    assert!((f64::from(*out) - exact).abs() < 1e-4, "{level:?}, {blocks} blocks: {out} is not {exact}");
                }
            }
        }
    }

    /// A part that does not count leaves all others as they are.
    #[test]
    fn what_does_not_count_is_not_there() {
        let (blocks, colour) = (4, 32);
        let glimpse = values(18 * 18 + colour, 3);
        let features = |lengths: &Lengths| {
            let mut out = vec![f32::NAN; lengths.sizes(blocks, colour).iter().sum()];
            oriented_features(&glimpse, blocks, lengths, &mut out);
            out
        };
        let (all, sizes) = (features(&LENGTHS), LENGTHS.sizes(blocks, colour));
        assert_eq!(sizes, [128, 64, 32]);
        for part in 1..3 {
            let mut without = LENGTHS;
            without.length[part] = 0.0;
            let first = sizes[..part].iter().sum::<usize>();
            assert_eq!(features(&without), [&all[..first], &all[first + sizes[part]..]].concat(), "part {part}");
        }
    }
}
