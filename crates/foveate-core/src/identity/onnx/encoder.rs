//! The encoder that runs a network on glimpses.

use super::{Planes, check_normalisation};
use crate::identity::encoder::Encoder;
use crate::identity::oriented::NEITHER;
use crate::identity::retina::{Foveal, Retina};
use crate::onnx::{Graph, Network, fixed, shape};
use foveate_base::rows::{Rows, RowsMut};
use foveate_base::{Error, Result};

/// Glimpses that a network whose file leaves it open is given at a time: chunks of particles are whole numbers of it. Missing ones
/// are zeros, so that every glimpse meets the same arithmetic.
const BATCH: usize = 16;

/// A network on glimpses.
pub struct OnnxEncoder {
    network: Network,
    batch: usize,
    /// Values of a glimpse, of an input, of a feature vector.
    glimpse: usize,
    input: usize,
    features: usize,
    /// Planes of the input, and whether they are made red, green and blue.
    planes: usize,
    rgb: bool,
    /// The offset subtracted from each plane, and the factor after it.
    mean: Vec<f32>,
    gain: Vec<f32>,
}

foveate_base::opaque_debug!(OnnxEncoder);

impl OnnxEncoder {
    /// For this retina. `mean` is taken off the values, which are then divided by `std`: none, one number, or one a plane.
    ///
    /// # Errors
    /// Fails if the network does not fit the retina, cannot be run, takes too much memory, or returns features that are not
    /// finite or depends on other glimpses.
    pub(crate) fn new(graph: &Graph, retina: &Foveal, planes: Planes, mean: &[f32], std: &[f32]) -> Result<Self> {
        let n = retina.glimpse_len();
        let sides = input(graph, retina)?;
        let count = if sides.len() == 3 { sides[0] } else { 1 };
        check_normalisation(mean, std, count)?;
        let each = |values: &[f32], other: f32| -> Vec<f32> {
            (0..count).map(|p| *values.get(p.min(values.len().saturating_sub(1))).unwrap_or(&other)).collect()
        };
        let (mean, gain) = (each(mean, 0.0), each(std, 1.0).into_iter().map(|std| 1.0 / std).collect::<Vec<_>>());
        let size = sides.iter().product::<usize>();
        let rgb = planes == Planes::Rgb && count == 3 && n == size;
        let batches = match graph.sides()[0] {
            Some(batch) => vec![batch],
            // Where the batch was fixed within, to 1 that is, or glimpses depend on each other.
            None => vec![BATCH, 1],
        };
        let mut last = None;
        for batch in batches.into_iter().filter(|batch| *batch > 0) {
            let made = graph.network(&[&[batch], &sides[..]].concat()).and_then(|network| {
                let rows = network.output().first().copied();
                let features = network.output().iter().skip(1).product();
                let (mean, gain) = (mean.clone(), gain.clone());
                let made = Self { network, batch, glimpse: n, input: size, features, planes: count, rgb, mean, gain };
                if rows != Some(batch) {
                    let found = fixed(made.network.output());
                    return Err(graph.error(format!(
                        "its output is {found} for {batch} glimpses, expected one row of features for each: ({batch}, ...)"
                    )));
                }
                made.check(graph).map(|()| made)
            });
            match made {
                Ok(made) => return Ok(made),
                Err(error) => last = Some(error),
            }
        }
        Err(last.unwrap_or_else(|| graph.error("its input is for 0 glimpses, expected 1 at least")))
    }

    /// Whether features of some glimpses are finite, the same each time, and of their own glimpse alone.
    fn check(&self, graph: &Graph) -> Result<()> {
        let n = self.glimpse;
        // Black, grey, white, and noise of a linear congruential generator.
        let mut glimpses = [0.0, 0.5, 1.0].map(|value| vec![value; n]).concat();
        let noise = (0..n).scan(1u32, |seed, _| {
            *seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            Some((*seed >> 8) as f32 / (1 << 24) as f32)
        });
        glimpses.extend(noise);
        let of = |glimpses: &[f32]| {
            let mut features = vec![0.0; glimpses.len() / n * self.features];
            self.apply(glimpses, &mut features).map(|()| features)
        };
        let together = of(&glimpses)?;
        if !together.iter().all(|h| h.is_finite()) {
            return Err(graph.error(
                "its output is not finite (NaN or infinite) for an even or a noisy glimpse; check its weights",
            ));
        }
        for (glimpse, h) in glimpses.chunks_exact(n).zip(together.chunks_exact(self.features)) {
            if of(glimpse)? != h {
                return Err(graph.error(
                    "what it makes of a glimpse depends on the glimpses beside it, or is not the same each time; export it for use, \
                     not for training (model.eval())",
                ));
            }
        }
        Ok(())
    }

    /// The network's features of glimpses, one a row.
    fn apply(&self, glimpses: &[f32], features: &mut [f32]) -> Result<()> {
        let (n_v, n_h) = (self.glimpse, self.features);
        let (mut input, mut output) = (vec![0.0; self.batch * self.input], vec![0.0; self.batch * n_h]);
        for (glimpses, features) in glimpses.chunks(self.batch * n_v).zip(features.chunks_mut(self.batch * n_h)) {
            input[glimpses.len() / n_v * self.input..].fill(0.0);
            let rows = glimpses.chunks_exact(n_v).zip(input.chunks_exact_mut(self.input));
            rows.for_each(|(glimpse, row)| self.feed(glimpse, row));
            self.network.run(&input, &mut output)?;
            features.copy_from_slice(&output[..features.len()]);
        }
        Ok(())
    }

    /// A glimpse as the network's input.
    fn feed(&self, glimpse: &[f32], input: &mut [f32]) {
        let side = self.input / self.planes;
        if self.rgb {
            for i in 0..side {
                let rgb = of_opponents([glimpse[i], glimpse[side + i], glimpse[2 * side + i]]);
                (0..3).for_each(|p| input[p * side + i] = rgb[p]);
            }
        } else {
            input.chunks_exact_mut(glimpse.len()).for_each(|input| input.copy_from_slice(glimpse));
        }
        for ((plane, mean), gain) in input.chunks_exact_mut(side).zip(&self.mean).zip(&self.gain) {
            plane.iter_mut().for_each(|x| *x = (*x - mean) * gain);
        }
    }
}

/// Sides of the network's input for one glimpse: planes and two sides, or the length of a glimpse.
fn input(graph: &Graph, retina: &Foveal) -> Result<Vec<usize>> {
    let (found, n, config) = (graph.sides(), retina.glimpse_len(), retina.config());
    let open = |at: usize, wanted: usize| found[at].is_none_or(|side| side == wanted);
    let grid = match (&config.rings[..], &config.colour[..]) {
        ([[window, cell]], []) => Some((1, window / cell)),
        ([ring], [colour]) if ring == colour => Some((3, ring[0] / ring[1])),
        _ => None,
    };
    match (found.len(), grid) {
        (2, _) if open(1, n) => Ok(vec![n]),
        (4, Some((planes, side))) if open(2, side) && open(3, side) => {
            let count = found[1].unwrap_or(planes);
            // Grey may be fed to three planes.
            if count == planes || (planes, count) == (1, 3) {
                Ok(vec![count, side, side])
            } else {
                Err(unfit(graph, retina))
            }
        }
        _ => Err(unfit(graph, retina)),
    }
}

fn unfit(graph: &Graph, retina: &Foveal) -> Error {
    let (found, n, config) = (graph.sides(), retina.glimpse_len(), retina.config());
    let rings = format!("rings = {:?}, colour = {:?}", config.rings, config.colour);
    let todo = match *found {
        [_, planes, height, width] if height == width => {
            let side = height.unwrap_or(32);
            let colour = if planes == Some(1) { "" } else { &format!(", colour = [[{side}, 1]]") };
            format!("a retina of one window fits it, such as rings = [[{side}, 1]]{colour}")
        }
        _ => format!("export it for (N, C, S, S) and a retina of one window of S x S cells, or for (N, {n})"),
    };
    graph.error(format!("its input is {}, which does not fit the retina ({rings}: {n} values); {todo}", shape(found)))
}

/// Red, green and blue, 0 to 1, of grey (0.299 r + 0.587 g + 0.114 b), (r − g) / 2 and (2 b − r − g) / 4 about the value for neither.
fn of_opponents([grey, red_green, blue_yellow]: [f32; 3]) -> [f32; 3] {
    let (difference, blue) = (2.0 * (red_green - NEITHER), 4.0 * (blue_yellow - NEITHER));
    let sum = 2.0 * grey + (0.587 - 0.299) * difference - 0.114 * blue;
    [(sum + difference) / 2.0, (sum - difference) / 2.0, (blue + sum) / 2.0].map(|x| x.clamp(0.0, 1.0))
}

impl Encoder for OnnxEncoder {
    fn shape(&self) -> (usize, usize) {
        (self.glimpse, self.features)
    }

    /// Features that are not finite, or that could not be computed after all, become zeros, which are like no template.
    fn encode(&self, glimpses: Rows<'_>, mut features: RowsMut<'_>) {
        let failed = self.apply(glimpses.data(), features.data()).is_err();
        for h in features.data().chunks_exact_mut(self.features) {
            if failed || !h.iter().all(|x| x.is_finite()) {
                h.fill(0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Within what rounding to bytes leaves.
    #[test]
    fn colours_come_back() {
        for rgb in
            [[0u8, 0, 0], [255, 255, 255], [200, 30, 90], [10, 240, 60], [0, 0, 255], [77, 77, 77], [255, 0, 128]]
        {
            let [r, g, b] = rgb.map(|x| [x]);
            let mut opponents = [[0u8]; 3];
            foveate_kernels::luma([&r, &g, &b], &mut opponents[0]);
            foveate_kernels::red_green([&r, &g, &b], &mut opponents[1]);
            foveate_kernels::blue_yellow([&r, &g, &b], &mut opponents[2]);
            let back = of_opponents(opponents.map(|[x]| f32::from(x) / 255.0)).map(|x| 255.0 * x);
            for (back, was) in back.iter().zip(rgb) {
                assert!((back - f32::from(was)).abs() < 4.0, "{rgb:?} becomes {back:?}");
            }
        }
    }
}
