//! Random numbers of tests: two linear congruential generators.

/// Draws numbers below those that are asked for; the same seed gives the same.
pub fn draws(seed: u64) -> impl FnMut(usize) -> usize {
    let mut x = seed;
    move |n| {
        x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (x >> 33) as usize % n.max(1)
    }
}

/// Bytes of noise; the same seed gives the same.
pub fn noise(seed: u32, count: usize) -> impl Iterator<Item = u8> {
    let mut x = seed;
    std::iter::repeat_with(move || {
        x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (x >> 24) as u8
    })
    .take(count)
}
