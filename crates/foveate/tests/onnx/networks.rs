//! The networks that the tests and the bench are about.

use super::writer::{Attribute, Network};

/// Numbers from −0.5 to 0.5, the same each time.
pub(crate) fn numbers(n: usize, seed: u32) -> Vec<f32> {
    let next = |state: &mut u32, _| {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        Some((*state >> 8) as f32 / (1 << 24) as f32 - 0.5)
    };
    (0..n).scan(seed.wrapping_mul(2_654_435_761), next).collect()
}

/// Its input.
pub(crate) fn identity(sides: &[i64]) -> Vec<u8> {
    Network::new(sides, sides).node("Identity", &["x"], "y", &[]).file()
}

/// `weights` is inputs × features, row-major.
pub(crate) fn linear(batch: i64, inputs: usize, features: usize, weights: &[f32], bias: &[f32]) -> Vec<u8> {
    let (n_v, n_h) = (inputs as i64, features as i64);
    let network =
        Network::new(&[batch, n_v], &[batch, n_h]).floats("w", &[n_v, n_h], weights).floats("b", &[n_h], bias);
    network.node("Gemm", &["x", "w", "b"], "y", &[]).file()
}

/// 3 × 3 filters on one plane, the positive part, means over 2 × 2 places.
pub(crate) fn convolution(side: usize, filters: usize, weights: &[f32], bias: &[f32]) -> Vec<u8> {
    let (s, f) = (side as i64, filters as i64);
    let places = (s - 2) / 2;
    let two = Attribute::Ints("kernel_shape", &[2, 2]);
    Network::new(&[0, 1, s, s], &[0, f, places, places])
        .floats("w", &[f, 1, 3, 3], weights)
        .floats("b", &[f], bias)
        .node("Conv", &["x", "w", "b"], "c", &[])
        .node("Relu", &["c"], "r", &[])
        .node("AveragePool", &["r"], "y", &[two, Attribute::Ints("strides", &[2, 2])])
        .file()
}

/// A small network as people train them: three convolutions with stride 2, 16, 32 and 32 filters, 512 features of 3 × 32 × 32 values.
pub(crate) fn deep(planes: usize) -> Vec<u8> {
    let p = planes as i64;
    let halve = || [Attribute::Ints("strides", &[2, 2]), Attribute::Ints("pads", &[1, 1, 1, 1])];
    let scaled = |n: usize, inputs: usize, seed| -> Vec<f32> {
        let gain = (24.0 / inputs as f32).sqrt();
        numbers(n * inputs, seed).into_iter().map(|x| gain * x).collect()
    };
    Network::new(&[0, p, 32, 32], &[0, 512])
        .floats("w1", &[16, p, 3, 3], &scaled(16, 9 * planes, 1))
        .floats("w2", &[32, 16, 3, 3], &scaled(32, 16 * 9, 2))
        .floats("w3", &[32, 32, 3, 3], &scaled(32, 32 * 9, 3))
        .node("Conv", &["x", "w1"], "c1", &halve())
        .node("Relu", &["c1"], "r1", &[])
        .node("Conv", &["r1", "w2"], "c2", &halve())
        .node("Relu", &["c2"], "r2", &[])
        .node("Conv", &["r2", "w3"], "c3", &halve())
        .node("Flatten", &["c3"], "y", &[Attribute::Int("axis", 1)])
        .file()
}

/// A detector that gives these numbers whatever it sees, but that scores, which are in `scored` places 1 and else 0, are multiplied by
/// the contrast of the input (largest value less the smallest).
pub(crate) fn boxes(input: &[i64], output: &[i64], numbers: &[f32], scored: &[f32]) -> Vec<u8> {
    let other: Vec<f32> = numbers.iter().zip(scored).map(|(x, scored)| x * (1.0 - scored)).collect();
    let scores: Vec<f32> = numbers.iter().zip(scored).map(|(x, scored)| x * scored).collect();
    let all = || [Attribute::Int("keepdims", 0)];
    Network::new(input, output)
        .floats("other", output, &other)
        .floats("scores", output, &scores)
        .node("ReduceMax", &["x"], "high", &all())
        .node("ReduceMin", &["x"], "low", &all())
        .node("Sub", &["high", "low"], "contrast", &[])
        .node("Mul", &["scores", "contrast"], "seen", &[])
        .node("Add", &["other", "seen"], "y", &[])
        .file()
}
