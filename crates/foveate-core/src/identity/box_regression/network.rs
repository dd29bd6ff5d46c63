//! The network: its prediction for a picture of a box's surroundings, compared with one of the target's.
//!
//! Both pictures go through the same four layers. Each place of the one is compared with the places of the other around it (Dosovitskiy
//! et al., *FlowNet*, 2015). Two maps of the joined layers give the places of the upper left and the lower right corner of the target; their
//! means are the corners (Law and Deng, *CornerNet*, 2018; Yan et al., *Alpha-Refine*, 2021). Maps of places carry over to targets that
//! the network never saw; numbers of dense layers do so less (docs/lab/real-video.md).

use std::path::Path;

use super::file::{self, Filters, Shape};
use super::glimpse::{CHANNELS, COARSE, SIDE};
use foveate_base::Result;
use foveate_kernels::{self as kernels, FILTERS, Layer};

/// Places along a side of the map of features, and their channels.
const PLACES: usize = 8;
const FEATURES: usize = 32;
/// Numbers that are kept of a target.
pub(super) const KEPT: usize = PLACES * PLACES * FEATURES;
/// Places that features are compared with, along a side: up to two away, half a box.
const REACH: usize = 2;
const COMPARED: usize = (2 * REACH + 1) * (2 * REACH + 1);
/// Features that stand beside the comparisons, of each of the two pictures.
const BESIDE: usize = 16;
/// Channels of the joined pictures.
const JOINED: usize = 64;
const DENSE: usize = 64;
/// Log expected errors of centre, size and shape, and log odds that the target is not there.
const ANSWERS: usize = 5;
/// Maps of a corner: each has the four quarters of every place.
const CORNERS: usize = 8;
/// Places along a side of a corner's map, and how far its border is from the centre, half sides of the box.
const FINE: usize = 2 * PLACES;
const BORDER: f32 = 2.5;
/// The smallest half side that is answered, half sides of the box.
const SMALLEST: f32 = 0.1;
/// What squares of features are softened by before their length is made 1.
const SOFT: f32 = 0.01;

/// The layers, as a file has them one after the other.
pub(super) const LAYERS: [Shape; 12] = [
    Shape { name: "first", size: 5, stride: 2, channels: CHANNELS, filters: 16, cut: true, places: 1 },
    Shape { name: "second", size: 3, stride: 2, channels: COLOURED, filters: 32, cut: true, places: 1 },
    Shape { name: "third", size: 3, stride: 2, channels: 32, filters: 64, cut: true, places: 1 },
    Shape { name: "fourth", size: 3, stride: 1, channels: 64, filters: FEATURES, cut: false, places: 1 },
    Shape { name: "search", size: 1, stride: 1, channels: FEATURES, filters: BESIDE, cut: false, places: 1 },
    Shape { name: "template", size: 1, stride: 1, channels: FEATURES, filters: BESIDE, cut: false, places: 1 },
    Shape { name: "joint", size: 3, stride: 1, channels: COMPARED + 2 * BESIDE, filters: JOINED, cut: true, places: 1 },
    Shape { name: "again", size: 3, stride: 1, channels: JOINED, filters: JOINED, cut: true, places: 1 },
    Shape { name: "narrow", size: 3, stride: 2, channels: JOINED, filters: 48, cut: true, places: 1 },
    Shape { name: "dense", size: PLACES / 2, stride: 1, channels: 48, filters: DENSE, cut: true, places: 1 },
    Shape { name: "answer", size: 1, stride: 1, channels: DENSE, filters: ANSWERS, cut: false, places: 1 },
    Shape {
        name: "corners",
        size: 3,
        stride: 1,
        channels: JOINED,
        filters: CORNERS,
        cut: false,
        places: PLACES * PLACES,
    },
];
const FIRST: usize = 0;
const SECOND: usize = 1;
const THIRD: usize = 2;
const FOURTH: usize = 3;
const SEARCH: usize = 4;
const TEMPLATE: usize = 5;
const JOINT: usize = 6;
const AGAIN: usize = 7;
const NARROW: usize = 8;
const LAST_BUT_ONE: usize = 9;
const LAST: usize = 10;
const CORNER: usize = 11;
/// Channels of the second layer's input: those of the first, and the probability of each coarse cell's colour.
const COLOURED: usize = 17;

/// The layers, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    layers: Vec<Numbers>,
    /// Those of `joint` that see the target's features, apart.
    joint_template: Vec<i16>,
    /// The weights of the last layer, those of all answers for each value.
    last: Vec<f32>,
}

/// The numbers of a layer as [`kernels::convolve`] reads them.
#[derive(Clone, Debug, PartialEq)]
struct Numbers {
    weights: Vec<i16>,
    scales: Vec<f32>,
    bias: Vec<f32>,
}

/// The stored features of the target in frame 1.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Template {
    /// The features of the third layer, each place of length 1.
    even: Vec<f32>,
    /// Their contribution to `joint`, a value a place and filter.
    joined: Vec<f32>,
}

/// The network's prediction for a box, in its half sides.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Answer {
    /// Where the target's centre is from the box's: right, down.
    pub offset: [f32; 2],
    /// Logarithm of the target's size over the box's.
    pub log_scale: f32,
    /// Half the logarithm of the target's width / height over the box's.
    pub half_log_aspect: f32,
    /// Log expected errors of the four.
    pub log_spread: [f32; 4],
    /// Log odds that the target is not there.
    pub lost: f32,
}

/// Scratch memory of a look, allocated once.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    framed: Vec<i16>,
    found: Vec<f32>,
    features: Vec<f32>,
    joined: Vec<f32>,
}

impl Scratch {
    /// Of the glimpse that was looked at last.
    pub(super) fn features(&self) -> &[f32] {
        &self.features
    }
}

impl Network {
    /// From the content of a file.
    ///
    /// # Errors
    /// Fails if it is not a file of `bench/train_box_regression.py`, or damaged.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self> {
        file::read(bytes, path, &LAYERS).map(Self::of)
    }

    fn of(layers: Vec<Filters>) -> Self {
        let (channels, own) = (COMPARED + 2 * BESIDE, COMPARED + BESIDE);
        let (mut joint, mut joint_template) = (vec![], vec![]);
        for place in layers[JOINT].weights.chunks_exact(channels * JOINED) {
            joint.extend_from_slice(&place[..own * JOINED]);
            joint_template.extend_from_slice(&place[own * JOINED..]);
        }
        let Filters { weights, scales, .. } = &layers[LAST];
        let last =
            weights.iter().zip(scales.iter().cycle()).map(|(weight, scale)| f32::from(*weight) * scale).collect();
        let joint_template = kernels::paired(&joint_template, LAYERS[JOINT].size * BESIDE, JOINED);
        let layer = |(k, Filters { weights, scales, bias }): (usize, Filters)| {
            let Shape { size, channels, filters, .. } = LAYERS[k];
            match k {
                JOINT => Numbers { weights: kernels::paired(&joint, size * own, filters), scales, bias },
                CORNER => {
                    let weights = kernels::paired(&padded(&weights), size * channels, FILTERS);
                    Numbers { weights, scales: padded(&scales), bias: padded(&bias) }
                }
                _ => Numbers { weights: kernels::paired(&weights, size * channels, filters), scales, bias },
            }
        };
        Self { layers: layers.into_iter().enumerate().map(layer).collect(), joint_template, last }
    }

    /// Features of a glimpse (`SIDE` × `SIDE` × `CHANNELS`) and of the colours of its coarse cells (`COARSE` × `COARSE`), into
    /// `scratch.features`.
    pub(super) fn look(&self, glimpse: &[f32], colours: &[f32], scratch: &mut Scratch) {
        let Scratch { framed, found, features, joined } = scratch;
        self.layer(FIRST, (glimpse, SIDE), framed, found);
        joined.clear();
        for (place, colour) in found.chunks_exact(COLOURED - 1).zip(colours) {
            joined.extend_from_slice(place);
            joined.push(*colour);
        }
        self.layer(SECOND, (joined, COARSE), framed, found);
        self.layer(THIRD, (found, COARSE / 2), framed, joined);
        self.layer(FOURTH, (joined, PLACES), framed, features);
    }

    /// Computes the stored features of the target from those of its picture.
    pub(super) fn template(&self, features: &[f32]) -> Template {
        let (mut beside, mut framed, mut joined, mut even) = (vec![], vec![], vec![], features.to_vec());
        self.layer(TEMPLATE, (features, PLACES), &mut framed, &mut beside);
        joined.resize(PLACES * PLACES * JOINED, 0.0);
        let Numbers { scales, bias, .. } = &self.layers[JOINT];
        let layer = joint(BESIDE, false, &self.joint_template, scales, bias);
        let step = kernels::to_steps(&beside, (PLACES, BESIDE, 1), &mut framed);
        kernels::convolve(&layer, &framed, step, &mut joined);
        level(&mut even);
        Template { even, joined }
    }

    /// The prediction for the last features, compared with the target's.
    pub(super) fn answer(&self, template: &Template, scratch: &mut Scratch) -> Answer {
        let Scratch { framed, found, features, joined } = scratch;
        let across = COMPARED + BESIDE;
        joined.resize(PLACES * PLACES * across, 0.0);
        self.layer(SEARCH, (features, PLACES), framed, found);
        for (to, beside) in joined.chunks_exact_mut(across).zip(found.chunks_exact(BESIDE)) {
            to[COMPARED..].copy_from_slice(beside);
        }
        level(features);
        kernels::correlate([PLACES, FEATURES, REACH], features, &template.even, joined, across);
        let Numbers { weights, scales, .. } = &self.layers[JOINT];
        let step = kernels::to_steps(joined, (PLACES, across, 1), framed);
        found.resize(PLACES * PLACES * JOINED, 0.0);
        kernels::convolve(&joint(across, true, weights, scales, &template.joined), framed, step, found);
        self.layer(AGAIN, (found, PLACES), framed, joined);
        let step = kernels::to_steps(joined, (PLACES, JOINED, 1), framed);
        self.framed_layer(CORNER, PLACES + 2, (framed, step), found);
        let [[left, top], [right, bottom]] = [0, 1].map(|map| mean_place(found, map));
        self.framed_layer(NARROW, PLACES + 2, (framed, step), found);
        self.layer(LAST_BUT_ONE, (found, PLACES / 2), framed, joined);
        let mut out = [0.0; ANSWERS];
        out.copy_from_slice(&self.layers[LAST].bias);
        for (value, weights) in joined.iter().zip(self.last.chunks_exact(ANSWERS)) {
            out.iter_mut().zip(weights).for_each(|(out, weight)| *out += value * weight);
        }
        let [a, b, c, d, lost] = out;
        let [wide, high] = [right - left, bottom - top].map(|side| (0.5 * side).max(SMALLEST).ln());
        Answer {
            offset: [0.5 * (left + right), 0.5 * (top + bottom)],
            log_scale: 0.5 * (wide + high),
            half_log_aspect: 0.5 * (wide - high),
            log_spread: [a, b, c, d],
            lost,
        }
    }

    /// One layer on a map of `side` × `side` places, with zeros around it where the filters are at its border.
    fn layer(&self, k: usize, (map, side): (&[f32], usize), framed: &mut Vec<i16>, out: &mut Vec<f32>) {
        let Shape { size, channels, .. } = LAYERS[k];
        let margin = if size % 2 == 1 { size / 2 } else { 0 };
        let step = kernels::to_steps(map, (side, channels, margin), framed);
        self.framed_layer(k, side + 2 * margin, (framed, step), out);
    }

    /// One layer on a map of `side` × `side` places in steps of `step`, which has its zeros around it already.
    fn framed_layer(&self, k: usize, side: usize, (map, step): (&[i16], f32), out: &mut Vec<f32>) {
        let (Numbers { weights, scales, bias }, Shape { size, stride, channels, cut, .. }) =
            (&self.layers[k], LAYERS[k]);
        out.resize(((side - size) / stride + 1).pow(2) * scales.len(), 0.0);
        kernels::convolve(&Layer { side, channels, size, stride, cut, weights, scales, bias }, map, step, out);
    }
}

/// The layer `joint`, or the group of its channels that see the target's features.
fn joint<'a>(channels: usize, cut: bool, weights: &'a [i16], scales: &'a [f32], bias: &'a [f32]) -> Layer<'a> {
    Layer { side: PLACES + 2, channels, size: 3, stride: 1, cut, weights, scales, bias }
}

/// Numbers of the corners' filters, with zeros for filters that are missing in a whole register.
fn padded<T: Copy + Default>(values: &[T]) -> Vec<T> {
    let filters = |values: &[T]| values.iter().copied().chain([T::default(); FILTERS - CORNERS]).collect::<Vec<_>>();
    values.chunks_exact(CORNERS).flat_map(filters).collect()
}

/// The mean place under the softmax of a corner's map (the first or second four of `FILTERS` channels: the quarters of each place), in
/// half sides of the box: right, down.
fn mean_place(maps: &[f32], map: usize) -> [f32; 2] {
    let (mut logits, mut weights) = ([0.0; FINE * FINE], [0.0; FINE * FINE]);
    let quarters = maps.chunks_exact(FILTERS).flat_map(|place| &place[4 * map..][..4]);
    logits.iter_mut().zip(quarters).for_each(|(to, logit)| *to = f64::from(*logit));
    let sum = kernels::exp_from(&logits, kernels::largest_finite(&logits), &mut weights);
    let mut mean = [0.0; 2];
    for (i, weight) in weights.iter().enumerate() {
        let (place, quarter) = (i / 4, i % 4);
        mean[0] += weight * (2 * (place % PLACES) + quarter % 2) as f64;
        mean[1] += weight * (2 * (place / PLACES) + quarter / 2) as f64;
    }
    mean.map(|place| ((place / sum + 0.5) / FINE as f64 * 2.0 - 1.0) as f32 * BORDER)
}

/// Makes the mean square of each place's features 1, about.
fn level(features: &mut [f32]) {
    for place in features.chunks_exact_mut(FEATURES) {
        let gain = 1.0 / (kernels::dot(place, place) / FEATURES as f32 + SOFT).sqrt();
        place.iter_mut().for_each(|x| *x *= gain);
    }
}

#[cfg(test)]
mod tests {
    use super::super::file::tests::random;
    use super::*;
    use foveate_base::rng::Streams;
    use rand::RngExt;

    /// Cells of a glimpse, and the colours of its coarse cells.
    fn glimpse(stream: u64) -> [Vec<f32>; 2] {
        let mut rng = Streams::new(9, 0).rng(stream);
        [SIDE * SIDE * CHANNELS, COARSE * COARSE].map(|n| (0..n).map(|_| 2.0 * rng.random::<f32>() - 1.0).collect())
    }

    impl Filters {
        fn weight(&self, i: usize) -> f64 {
            f64::from(self.weights[i]) * f64::from(self.scales[i % self.scales.len()])
        }
    }

    /// A layer by plain loops in f64: zeros around the map.
    fn plain(filters: &Filters, map: &[f64], (side, size, stride, cut): (usize, usize, usize, bool)) -> Vec<f64> {
        let margin = size / 2;
        let channels = map.len() / (side * side);
        let n = filters.weights.len() / (size * size * channels);
        let mut out = vec![];
        for (y, x, f) in
            (0..side / stride).flat_map(|y| (0..side / stride).flat_map(move |x| (0..n).map(move |f| (y, x, f))))
        {
            let own = (y * side / stride + x) * n + f;
            let mut sum = f64::from(filters.bias[if filters.bias.len() == n { f } else { own }]);
            for (i, j, c) in (0..size).flat_map(|i| (0..size).flat_map(move |j| (0..channels).map(move |c| (i, j, c))))
            {
                let (row, column) = ((y * stride + i).wrapping_sub(margin), (x * stride + j).wrapping_sub(margin));
                if row < side && column < side {
                    let weight = filters.weight(((i * size + j) * channels + c) * n + f);
                    sum += map[(row * side + column) * channels + c] * weight;
                }
            }
            out.push(if cut { sum.max(0.0) } else { sum });
        }
        out
    }

    /// The definition, with both pictures joined before they are looked at.
    #[test]
    fn the_network_equals_its_definition() {
        let layers = file::read(&random(3, &LAYERS), Path::new("n"), &LAYERS).expect("just written");
        let network = Network::of(layers.clone());
        let features = |[cells, colours]: [Vec<f32>; 2]| {
            let cells: Vec<f64> = cells.into_iter().map(f64::from).collect();
            let map = plain(&layers[FIRST], &cells, (64, 5, 2, true));
            let places = map.chunks_exact(16).zip(&colours);
            let map: Vec<f64> = places.flat_map(|(p, c)| p.iter().copied().chain([f64::from(*c)])).collect();
            let map = plain(&layers[SECOND], &map, (32, 3, 2, true));
            plain(&layers[FOURTH], &plain(&layers[THIRD], &map, (16, 3, 2, true)), (8, 3, 1, false))
        };
        let (a, b) = (features(glimpse(1)), features(glimpse(2)));
        let even = |map: &[f64]| -> Vec<f64> {
            let places = map.chunks_exact(FEATURES);
            places
                .flat_map(|p| {
                    let gain = (p.iter().map(|x| x * x).sum::<f64>() / FEATURES as f64 + f64::from(SOFT)).sqrt();
                    p.iter().map(move |x| x / gain)
                })
                .collect()
        };
        let (even_a, even_b) = (even(&a), even(&b));
        let beside = [plain(&layers[SEARCH], &b, (8, 1, 1, false)), plain(&layers[TEMPLATE], &a, (8, 1, 1, false))];
        let mut joined = vec![];
        for place in 0..64usize {
            for (i, j) in (0..5usize).flat_map(|i| (0..5usize).map(move |j| (i, j))) {
                let (row, column) = ((place / 8 + i).wrapping_sub(2), (place % 8 + j).wrapping_sub(2));
                let product = |c: usize| even_b[place * 32 + c] * even_a[(row * 8 + column) * 32 + c] / 32.0;
                joined.push(if row < 8 && column < 8 { (0..32).map(product).sum() } else { 0.0 });
            }
            beside.iter().for_each(|map| joined.extend_from_slice(&map[place * BESIDE..][..BESIDE]));
        }
        let map = plain(&layers[AGAIN], &plain(&layers[JOINT], &joined, (8, 3, 1, true)), (8, 3, 1, true));
        let corners = plain(&layers[CORNER], &map, (8, 3, 1, false));
        let corner = |map: usize| {
            let (mut sum, mut mean) = (0.0, [0.0; 2]);
            for (row, column) in (0..FINE).flat_map(|row| (0..FINE).map(move |column| (row, column))) {
                let quarter = row % 2 * 2 + column % 2;
                let weight = corners[(row / 2 * PLACES + column / 2) * CORNERS + 4 * map + quarter].exp();
                let at = |k: usize| (k as f64 + 0.5) / 16.0 * 5.0 - 2.5;
                (sum, mean) = (sum + weight, [mean[0] + weight * at(column), mean[1] + weight * at(row)]);
            }
            mean.map(|x| x / sum)
        };
        let ([left, top], [right, bottom]) = (corner(0), corner(1));
        let [wide, high] = [right - left, bottom - top].map(|side| (side / 2.0).max(0.1).ln());
        let map = plain(&layers[NARROW], &map, (8, 3, 2, true));
        let whole = |filters: &Filters, map: &[f64], f: usize| {
            let n = filters.bias.len();
            f64::from(filters.bias[f]) + map.iter().enumerate().map(|(i, x)| x * filters.weight(i * n + f)).sum::<f64>()
        };
        let dense: Vec<f64> = (0..DENSE).map(|f| whole(&layers[LAST_BUT_ONE], &map, f).max(0.0)).collect();
        let place = [(left + right) / 2.0, (top + bottom) / 2.0, (wide + high) / 2.0, (wide - high) / 2.0];
        let exact: Vec<f64> = place.into_iter().chain((0..ANSWERS).map(|f| whole(&layers[LAST], &dense, f))).collect();
        let mut scratch = Scratch::default();
        let [cells, colours] = glimpse(1);
        network.look(&cells, &colours, &mut scratch);
        let template = network.template(&scratch.features);
        for _ in 0..2 {
            let [cells, colours] = glimpse(2);
            network.look(&cells, &colours, &mut scratch);
            let Answer { offset: [u, v], log_scale, half_log_aspect, log_spread: [p, q, r, s], lost } =
                network.answer(&template, &mut scratch);
            for (found, exact) in [u, v, log_scale, half_log_aspect, p, q, r, s, lost].into_iter().zip(&exact) {
                assert!((f64::from(found) - exact).abs() < 1e-3, "{found}, not {exact}");
            }
        }
    }
}
