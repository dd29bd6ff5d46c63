//! Sums over slices, in 32 fixed lanes folded in halves, so that the order of additions is fixed.

use crate::level::{greater, lesser, levels, multiply_add};

const LANES: usize = 32;

/// Adds the lanes up: the upper half onto the lower, until one is left.
#[inline(always)]
pub(crate) fn fold<const LANES: usize>(mut lanes: [f32; LANES]) -> f32 {
    let mut half = LANES / 2;
    while half > 0 {
        for i in 0..half {
            lanes[i] += lanes[i + half];
        }
        half /= 2;
    }
    lanes[0]
}

#[inline(always)]
pub(crate) fn sum_body<const V: u8>(a: &[f32]) -> f32 {
    let mut lanes = [0.0; LANES];
    let (chunks, rest) = a.as_chunks::<LANES>();
    for a in chunks {
        for i in 0..LANES {
            lanes[i] += a[i];
        }
    }
    if !rest.is_empty() {
        let a = filled::<V>(rest);
        for i in 0..LANES {
            lanes[i] += a[i];
        }
    }
    fold(lanes)
}

/// The last values, fewer than there are lanes, and zeros. Lanes of which only some are written would not stay in registers.
#[inline(always)]
fn filled<const V: u8>(rest: &[f32]) -> [f32; LANES] {
    let mut all = [0.0; LANES];
    #[cfg(target_arch = "x86_64")]
    if V >= crate::level::AVX512 {
        use std::arch::x86_64::*;
        let first = rest.len().min(16);
        // SAFETY: by `V` the caller is compiled for AVX-512, and runs only where it is there; the masks have as
        // many bits as there are values, and `all` has room for them.
        unsafe {
            let (low, high) = ((1u32 << first) - 1, (1u32 << (rest.len().min(LANES) - first)) - 1);
            _mm512_storeu_ps(all.as_mut_ptr(), _mm512_maskz_loadu_ps(low as u16, rest.as_ptr()));
            _mm512_storeu_ps(all[16..].as_mut_ptr(), _mm512_maskz_loadu_ps(high as u16, rest.as_ptr().add(first)));
        }
        return all;
    }
    #[cfg(target_arch = "x86_64")]
    if V == crate::level::FUSED {
        use std::arch::x86_64::*;
        // A copy of a length that is not known is a call.
        // SAFETY: by `V` the caller is compiled for AVX, and runs only where it is there; of a vector those values are read
        // that there are.
        unsafe {
            let place = _mm256_setr_ps(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0);
            for (k, all) in all.as_chunks_mut::<8>().0.iter_mut().enumerate() {
                let there = _mm256_set1_ps(rest.len() as f32 - (8 * k) as f32);
                let mask = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(place, there));
                _mm256_storeu_ps(all.as_mut_ptr(), _mm256_maskload_ps(rest.as_ptr().wrapping_add(8 * k), mask));
            }
        }
        return all;
    }
    copy_short(rest, &mut all);
    all
}

/// Copies fewer than 32 values to the beginning of as many or more.
#[inline(always)]
pub(crate) fn copy_short(from: &[f32], to: &mut [f32]) {
    // In WebAssembly a copy of a length that is not known is a call, which takes longer than a sum.
    if !cfg!(target_arch = "wasm32") {
        return to[..from.len()].copy_from_slice(from);
    }
    let mut at = 0;
    macro_rules! part {
        ($($n:literal)*) => {$(
            if from.len() & $n != 0 {
                if let (Some(to), Some(from)) = (to[at..].first_chunk_mut::<$n>(), from[at..].first_chunk()) {
                    *to = *from;
                }
                at += $n;
            }
        )*};
    }
    part!(16 8 4 2 1);
    debug_assert!(at == from.len(), "fewer than 32 values");
}

#[inline(always)]
pub(crate) fn dot_body<const V: u8>(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len(), "a and b must be equally long");
    let mut lanes = [0.0; LANES];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in a.iter().zip(b) {
        for i in 0..LANES {
            lanes[i] = multiply_add::<V>(a[i], b[i], lanes[i]);
        }
    }
    if !a_rest.is_empty() {
        let (a, b) = (filled::<V>(a_rest), filled::<V>(b_rest));
        for i in 0..LANES {
            lanes[i] = multiply_add::<V>(a[i], b[i], lanes[i]);
        }
    }
    fold(lanes)
}

#[inline(always)]
fn dots_body<const V: u8>(a: &[f32], others: [&[f32]; 2]) -> [f32; 3] {
    let [b, c] = others;
    [dot_body::<V>(a, a), dot_body::<V>(a, b), dot_body::<V>(a, c)]
}

#[inline(always)]
fn squared_distance_body<const V: u8>(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len(), "a and b must be equally long");
    let mut lanes = [0.0; LANES];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in a.iter().zip(b) {
        for i in 0..LANES {
            let d = a[i] - b[i];
            lanes[i] = multiply_add::<V>(d, d, lanes[i]);
        }
    }
    for (lane, (&a, &b)) in lanes.iter_mut().zip(a_rest.iter().zip(b_rest)) {
        *lane = multiply_add::<V>(a - b, a - b, *lane);
    }
    fold(lanes)
}

#[inline(always)]
fn root_overlap_body<const V: u8>(a: &[f32], b_root: &[f32]) -> (f32, f32) {
    assert_eq!(a.len(), b_root.len(), "a and b_root must be equally long");
    let (mut total, mut overlap) = ([0.0; LANES], [0.0; LANES]);
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b_root.as_chunks::<LANES>());
    for (a, b) in a.iter().zip(b) {
        for i in 0..LANES {
            total[i] += a[i];
            overlap[i] = multiply_add::<V>(a[i].sqrt(), b[i], overlap[i]);
        }
    }
    for (i, (&a, &b)) in a_rest.iter().zip(b_rest).enumerate() {
        total[i] += a;
        overlap[i] = multiply_add::<V>(a.sqrt(), b, overlap[i]);
    }
    (fold(total), fold(overlap))
}

#[inline(always)]
fn presence_body<const V: u8>(v: &[f32], template: &[f32], extra: f32, cap: f32) -> f32 {
    assert_eq!(v.len(), template.len(), "v and template must be equally long");
    let mut lanes = [0.0; LANES];
    let add = |lane: &mut f32, v: f32, template: f32| {
        let missing = template - v;
        let e = lesser(greater(missing, -extra * missing), cap);
        *lane = multiply_add::<V>(e, e, *lane);
    };
    let ((v, v_rest), (template, template_rest)) = (v.as_chunks::<LANES>(), template.as_chunks::<LANES>());
    for (v, template) in v.iter().zip(template) {
        for i in 0..LANES {
            add(&mut lanes[i], v[i], template[i]);
        }
    }
    for (lane, (&v, &template)) in lanes.iter_mut().zip(v_rest.iter().zip(template_rest)) {
        add(lane, v, template);
    }
    fold(lanes)
}

levels! {
    /// Σ a.
    pub fn sum / sum_at (a: &[f32]) -> f32 = sum_body
}

levels! {
    /// Σ a b.
    ///
    /// # Panics
    /// If the lengths differ, as in all functions of two slices here.
    pub fn dot / dot_at (a: &[f32], b: &[f32]) -> f32 = dot_body
}

levels! {
    /// Σ a a, Σ a b, Σ a c: the bits of three calls of [`dot`].
    pub fn dots / dots_at (a: &[f32], others: [&[f32]; 2]) -> [f32; 3] = dots_body
}

levels! {
    /// Σ (a - b)².
    pub fn squared_distance / squared_distance_at (a: &[f32], b: &[f32]) -> f32 = squared_distance_body
}

levels! {
    /// (Σ a, Σ √a · b_root): with `b_root` = √b these give the Bhattacharyya coefficient of a / Σa and b / Σb,
    /// Σ √a √b / √(Σa Σb). `a` must not be negative.
    pub fn root_overlap / root_overlap_at (a: &[f32], b_root: &[f32]) -> (f32, f32) = root_overlap_body
}

levels! {
    /// Σ min(e, `cap`)², with e = template - v if the template is brighter, else `extra` · (v - template). `extra`
    /// must not be negative and `cap` must be above 0.
    pub fn presence / presence_at (v: &[f32], template: &[f32], extra: f32, cap: f32) -> f32 = presence_body
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::Level;

    /// Values in [0, 1) from a fixed linear congruence.
    pub(crate) fn values(n: usize, mut seed: u32) -> Vec<f32> {
        std::iter::repeat_with(|| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / (1 << 24) as f32
        })
        .take(n)
        .collect()
    }

    #[test]
    fn short_copies_are_whole() {
        let from = values(31, 9);
        for n in 0..32 {
            let mut to = [-1.0; 40];
            copy_short(&from[..n], &mut to);
            assert!(to[..n] == from[..n] && to[n..].iter().all(|x| *x == -1.0), "{n}");
        }
    }

    #[test]
    fn agree_with_f64_sums() {
        for n in [0, 1, 7, 31, 32, 33, 64, 100, 500, 1001] {
            let (a, b) = (values(n, 1), values(n, 2));
            let over = |f: fn(f64, f64) -> f64| a.iter().zip(&b).map(|(&a, &b)| f(a as f64, b as f64)).sum::<f64>();
            for level in Level::all() {
                let near = |got: f32, truth: f64| {
                    assert!((got as f64 - truth).abs() <= 1e-6 * truth, "{level:?}, {n} values: {got} is not {truth}");
                };
                near(sum_at(level, &a), over(|a, _| a));
                near(dot_at(level, &a, &b), over(|a, b| a * b));
                let all = [(&a, &a), (&a, &b), (&a, &a)].map(|(a, b)| dot_at(level, a, b));
                assert_eq!(dots_at(level, &a, [&b, &a]), all, "{level:?}, {n} values");
                near(squared_distance_at(level, &a, &b), over(|a, b| (a - b) * (a - b)));
                let (total, overlap) = root_overlap_at(level, &a, &b);
                near(total, over(|a, _| a));
                near(overlap, over(|a, b| a.sqrt() * b));
                near(presence_at(level, &a, &b, 0.25, 0.5), over(|v, t| (t - v).max(0.25 * (v - t)).min(0.5).powi(2)));
            }
        }
    }

    /// Whole numbers are summed exactly, so every lane is counted once.
    #[test]
    fn whole_numbers_are_exact() {
        let a: Vec<f32> = (0..517).map(|i| i as f32).collect();
        for level in Level::all() {
            assert_eq!(sum_at(level, &a), 517.0 * 258.0);
            let squares: Vec<f32> = a.iter().map(|a| a * a).collect();
            let (total, overlap) = root_overlap_at(level, &squares[..100], &[1.0; 100]);
            assert_eq!((total, overlap), (328_350.0, 4_950.0));
        }
    }
}
