//! A small convolutional network as the first layer: learned where gradients are made by hand.
//!
//! The retina has grey cells in a square, and two channels of colour in a square of cells twice as large. Features are what the
//! second layer says at the places of its map: their roots, less their mean, brought to length 1; beside them, where asked for, those of
//! the oriented encoder. Deviation: the paper's first layer is an RBM (section 2.1).

use foveate_kernels as kernels;
use foveate_learn::network::{MOST, Network, SIZE};
use kernels::Layer;

use super::encoder::{Encoder, standardise};
use super::oriented::{NEITHER, Oriented, Weights};
use super::retina::Cell;
use foveate_base::error::within;
use foveate_base::rows::{Rows, RowsMut};
use foveate_base::{Error, Result};

/// What colour is multiplied by, to be as large as standardised grey.
const COLOUR: f32 = 8.0;
/// Added before roots are taken: their slope is finite.
const SOFT: f32 = 1e-4;
/// Root mean square of features that counts as flat.
const FLAT: f32 = 0.05;

/// Values of the map between the layers, at most.
const BETWEEN: usize = (MOST.1 / 2).pow(2) * (MOST.0 + 3);

/// Two layers of filters.
#[derive(Clone, Debug)]
pub struct NetworkEncoder {
    network: Network,
    /// Grey cells along a side.
    side: usize,
    /// Places along a side of the map between the layers: twice those of the second's.
    places: usize,
    /// Share of the square of the length that gradients have, and what makes them.
    gradients: Option<(f32, Oriented)>,
}

impl NetworkEncoder {
    /// Fails where this share of gradients is out of range, 0 to 1.
    pub fn check(gradients: f32) -> Result<()> {
        within("encoder.gradients", gradients.into(), 0.0, 1.0)
    }

    /// For a retina with these cells; hand-made gradients have this share of its features, 0 to 1. Fails where the cells are not what
    /// the network reads, or the share is out of range.
    pub fn new(network: Network, cells: &[Cell], gradients: f32) -> Result<Self> {
        Self::check(gradients)?;
        let grey = cells.iter().filter(|c| c.channel == 0).count();
        let side = grey.isqrt();
        let places = side.saturating_sub(SIZE - 1) / 2;
        let square = side * side == grey && side <= MOST.1 && side == 2 * places + SIZE - 1;
        if !square || places == 0 || !places.is_multiple_of(8) || cells.len() != grey + 2 * places * places {
            return Err(Error::Config(format!(
                "the convolutional encoder needs one ring of 18 or 34 grey cells a side, and two channels of colour of 8 or 16, such as \
                 rings = [[18, 1]], colour = [[16, 2]]; this retina has {grey} grey cells of {} in all",
                cells.len()
            )));
        }
        let channels = [vec![0; grey], vec![1; places * places / 4], vec![2; places * places / 4]].concat();
        let share = |all: f32| gradients * all;
        let all = Weights::default();
        let weights = Weights { gradients: share(all.gradients), grey: share(all.grey), colour: share(all.colour) };
        let oriented = (gradients > 0.0).then(|| Oriented::new(&channels, weights)).transpose()?;
        Ok(Self { network, side, places, gradients: oriented.map(|oriented| (gradients, oriented)) })
    }
}

impl Encoder for NetworkEncoder {
    fn shape(&self) -> (usize, usize) {
        let (n, made) = (self.places, self.gradients.as_ref().map_or(0, |(_, oriented)| oriented.shape().1));
        (self.side * self.side + 2 * n * n, n * n / 4 * self.network.layers()[1].bias.len() + made)
    }

    fn encode(&self, glimpses: Rows<'_>, mut features: RowsMut<'_>) {
        let ((n_v, n_h), n, [first, second]) = (self.shape(), self.places, self.network.layers());
        let (filters, channels) = (first.bias.len(), first.bias.len() + 3);
        let learned = n * n / 4 * second.bias.len();
        let (weights, bias) = (&first.weights, &first.bias);
        let first = Layer { side: self.side, channels: 1, size: SIZE, stride: 1, pool: 2, cut: true, weights, bias };
        // Filters of 2 × 2 places that do not overlap: one place of four times the channels.
        let (weights, bias) = (&second.weights, &second.bias);
        let second =
            Layer { side: n / 2, channels: 4 * channels, size: 1, stride: 1, pool: 1, cut: true, weights, bias };
        let (mut grey, mut found, mut between) = ([0.0; MOST.1 * MOST.1], [0.0; BETWEEN], [0.0; BETWEEN]);
        let (found, between) = (&mut found[..n * n * filters], &mut between[..n * n * channels]);
        let grey = &mut grey[..self.side * self.side];
        for (v, h) in glimpses.data().chunks_exact(n_v).zip(features.data().chunks_exact_mut(n_h)) {
            let (plain, colour) = v.split_at(grey.len());
            let (h, made) = h.split_at_mut(learned);
            grey.copy_from_slice(plain);
            standardise(grey);
            kernels::convolve(&first, grey, found);
            for (place, found) in found.chunks_exact(filters).enumerate() {
                let (x, y) = (place % n, place / n);
                let at = (y / 2 * (n / 2) + x / 2) * 4 + y % 2 * 2 + x % 2;
                let to = &mut between[at * channels..][..channels];
                let corner = (2 * y + 1) * self.side + 2 * x + 1;
                let four = grey[corner] + grey[corner + 1] + grey[corner + self.side] + grey[corner + self.side + 1];
                to[..filters].copy_from_slice(found);
                to[filters] = 0.25 * four;
                to[filters + 1] = COLOUR * (colour[place] - NEITHER);
                to[filters + 2] = COLOUR * (colour[n * n + place] - NEITHER);
            }
            kernels::convolve(&second, between, h);
            h.iter_mut().for_each(|x| *x = (*x + SOFT).sqrt());
            let mean = kernels::sum(h) / learned as f32;
            h.iter_mut().for_each(|x| *x -= mean);
            let share = self.gradients.as_ref().map_or(0.0, |(share, _)| *share);
            let gain = (1.0 - share).sqrt() / (kernels::dot(h, h).sqrt() + FLAT * (learned as f32).sqrt());
            h.iter_mut().for_each(|x| *x *= gain);
            if let Some((_, oriented)) = &self.gradients {
                self.gradients_of(oriented, plain, colour, made);
            }
        }
    }
}

impl NetworkEncoder {
    /// The features of the oriented encoder: colour in means over 2 × 2 cells.
    fn gradients_of(&self, oriented: &Oriented, grey: &[f32], colour: &[f32], out: &mut [f32]) {
        let (n, half) = (self.places, self.places / 2);
        let mut glimpse = [0.0; MOST.1 * MOST.1 + MOST.1 * MOST.1 / 8];
        let glimpse = &mut glimpse[..grey.len() + 2 * half * half];
        let (to, wide) = glimpse.split_at_mut(grey.len());
        to.copy_from_slice(grey);
        for (k, wide) in wide.iter_mut().enumerate() {
            let corner = k / half * 2 * n + k % half * 2; // of both channels: n is 2 half
            *wide = 0.25 * (colour[corner] + colour[corner + 1] + colour[corner + n] + colour[corner + n + 1]);
        }
        oriented.encode(Rows::new(glimpse, glimpse.len()), RowsMut::new(out, out.len()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance;
    use crate::identity::retina::{Foveal, FovealConfig, Retina};
    use foveate_base::rng::Streams;
    use foveate_learn::network::Filters;
    use rand::RngExt;

    fn cells(rings: [usize; 2], colour: &[[usize; 2]]) -> Vec<Cell> {
        let config = FovealConfig { side: 16.0, rings: vec![rings], colour: colour.to_vec() };
        Foveal::new(config).expect("whole cells").cells().to_vec()
    }

    fn random(n: usize, stream: u64) -> Vec<f32> {
        let mut rng = Streams::new(8, 0).rng(stream);
        (0..n).map(|_| rng.random::<f32>() - 0.3).collect()
    }

    fn network(first: usize, second: usize) -> Network {
        let layer = |n: usize, inputs: usize, stream| Filters {
            weights: random(n * inputs, stream),
            bias: random(n, stream + 1),
        };
        Network::new(layer(first, 9, 1), layer(second, 4 * (first + 3), 3)).expect("they fit")
    }

    #[test]
    fn it_keeps_the_law() {
        for (rings, colour, first, second, gradients) in
            [([18, 1], [[16, 2]], 16, 32, 0.0), ([34, 1], [[32, 2]], 64, 16, 0.0), ([18, 1], [[16, 2]], 16, 48, 0.5)]
        {
            let cells = cells(rings, &colour);
            let encoder = NetworkEncoder::new(network(first, second), &cells, gradients).expect("they fit");
            let mut glimpses = random(7 * cells.len(), 5);
            glimpses[..cells.len()].fill(0.0);
            conformance::encoder(&encoder, &glimpses);
        }
    }

    /// The definition, by plain loops in f64.
    #[test]
    fn it_is_two_convolutions() {
        let (cells, network) = (cells([18, 1], &[[16, 2]]), network(16, 32));
        let encoder = NetworkEncoder::new(network.clone(), &cells, 0.0).expect("they fit");
        let plain = random(cells.len(), 6);
        let mut glimpse = plain.clone();
        standardise(&mut glimpse[..324]);
        let [first, second] = network.layers().map(|layer| {
            let double = |x: &[f32]| x.iter().copied().map(f64::from).collect::<Vec<f64>>();
            (double(&layer.weights), double(&layer.bias))
        });
        let v = |i: usize| f64::from(glimpse[i]);
        let between = |x: usize, y: usize, c: usize| -> f64 {
            let four = (0..4).map(|k| (2 * x + k % 2, 2 * y + k / 2));
            match c {
                0..16 => {
                    let said = |(x, y): (usize, usize)| {
                        let sum = |i: usize| v((y + i / 3) * 18 + x + i % 3) * first.0[i * 16 + c];
                        (first.1[c] + (0..9).map(sum).sum::<f64>()).max(0.0)
                    };
                    four.map(said).sum::<f64>() / 4.0
                }
                16 => four.map(|(x, y)| v((y + 1) * 18 + x + 1)).sum::<f64>() / 4.0,
                _ => 8.0 * (v(324 + (c - 17) * 64 + y * 8 + x) - 128.0 / 255.0),
            }
        };
        let mut exact = vec![];
        for (place, f) in (0..16).flat_map(|place| (0..32).map(move |f| (place, f))) {
            let term = |i: usize| {
                let (corner, c) = (i / 19, i % 19);
                let (x, y) = (place % 4 * 2 + corner % 2, place / 4 * 2 + corner / 2);
                between(x, y, c) * second.0[i * 32 + f]
            };
            exact.push(((second.1[f] + (0..76).map(term).sum::<f64>()).max(0.0) + 1e-4).sqrt());
        }
        let mean = exact.iter().sum::<f64>() / 512.0;
        exact.iter_mut().for_each(|x| *x -= mean);
        let length = exact.iter().map(|x| x * x).sum::<f64>().sqrt() + 0.05 * 512f64.sqrt();
        let mut h = vec![f32::NAN; 512];
        encoder.encode(Rows::new(&plain, cells.len()), RowsMut::new(&mut h, 512));
        for (i, (h, exact)) in h.iter().zip(&exact).enumerate() {
            assert!((f64::from(*h) - exact / length).abs() < 1e-5, "{i}: {h}, not {}", exact / length);
        }
    }

    /// With a share of gradients: the network's features shorter, and beside them the oriented encoder's of colour cells as it has them.
    #[test]
    fn gradients_stand_beside_it() {
        let (cells, network, plain) = (cells([18, 1], &[[16, 2]]), network(16, 32), random(324 + 128, 6));
        let encode = |encoder: &dyn Encoder, v: &[f32]| {
            let mut h = vec![f32::NAN; encoder.shape().1];
            encoder.encode(Rows::new(v, v.len()), RowsMut::new(&mut h, encoder.shape().1));
            h
        };
        let with = |share: f32| NetworkEncoder::new(network.clone(), &cells, share).expect("they fit");
        let (alone, both) = (encode(&with(0.0), &plain), encode(&with(0.25), &plain));
        let channels = [vec![0; 324], vec![1; 16], vec![2; 16]].concat();
        let oriented = Oriented::new(&channels, Weights::default()).expect("blocks and a border");
        let mut wide = plain[..324].to_vec();
        for (c, y, x) in (0..32).map(|k| (k / 16, k / 4 % 4, k % 4)) {
            let at = |dx: usize, dy: usize| plain[324 + c * 64 + (2 * y + dy) * 8 + 2 * x + dx];
            wide.push((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)) / 4.0);
        }
        let expected =
            alone.iter().map(|x| 0.75f32.sqrt() * x).chain(encode(&oriented, &wide).into_iter().map(|x| 0.5 * x));
        assert_eq!(both.len(), 512 + 224);
        for (found, expected) in both.iter().zip(expected.collect::<Vec<f32>>()) {
            assert!((found - expected).abs() < 1e-6, "{found}, not {expected}");
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        for (rings, colour) in
            [([16, 1], vec![[16, 2]]), ([18, 1], vec![[16, 4]]), ([18, 1], vec![]), ([66, 1], vec![[64, 2]])]
        {
            let said =
                NetworkEncoder::new(network(16, 32), &cells(rings, &colour), 0.0).expect_err("refused").to_string();
            assert!(said.contains("18 or 34 grey cells"), "{said}");
        }
        let said =
            NetworkEncoder::new(network(16, 32), &cells([18, 1], &[[16, 2]]), 1.5).expect_err("refused").to_string();
        assert!(said.contains("encoder.gradients"), "{said}");
    }
}
