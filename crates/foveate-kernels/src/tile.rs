//! One tile of the product: up to 6 glimpses times 64 columns, for each level of the machine.
//!
//! `words` holds the glimpses of the block, `depth` words each, one every `stride` words; `lines` the tile, `depth` × 4 lines.
//! Every sum starts at 0 and runs over the words in order.

use crate::level::Level;
#[cfg(not(target_arch = "aarch64"))]
use crate::level::{BASE, multiply_add};

/// Columns of a tile.
pub(crate) const TILE: usize = 64;
/// Glimpses of a full block: 6 × 4 sums, 4 lines and a word fill the 32 registers of AVX-512.
pub(crate) const BLOCK: usize = 6;

/// 16 words, as wide and as aligned as the widest register.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Line(pub [u32; 16]);

/// Sums of one block: row r, column c of the tile at `[r][c]`.
pub(crate) type Sums = [[f32; TILE]; BLOCK];

/// The format of a word, and the instructions that multiply it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kernel {
    F32(Level),
    /// Two bf16 and their instruction; without it bf16 values are held as f32 and `F32` multiplies them.
    Bf16,
    /// Four bytes, those of lines with a sign, and their instruction; the same holds without it. Sums are i32.
    Int8,
}

/// Sums for the `rows` (1 to 6) glimpses in `words`.
#[inline]
pub(crate) fn multiply<const ADD: bool>(
    kernel: Kernel,
    rows: usize,
    stride: usize,
    words: &[u32],
    lines: &[Line],
    sums: &mut Sums,
) {
    assert!((1..=BLOCK).contains(&rows));
    // The remainders of a block run as 3, 2 and 1 rows: a row's sums are the same in any of them.
    let mut done = 0;
    while done < rows {
        let step = match rows - done {
            4 | 5 => 3,
            step => step,
        };
        let (words, sums) = (&words[done * stride..], &mut sums[done..done + step]);
        match step {
            6 => fixed::<6, ADD>(kernel, stride, words, lines, sums),
            3 => fixed::<3, ADD>(kernel, stride, words, lines, sums),
            2 => fixed::<2, ADD>(kernel, stride, words, lines, sums),
            _ => fixed::<1, ADD>(kernel, stride, words, lines, sums),
        }
        done += step;
    }
}

#[inline]
fn fixed<const ROWS: usize, const ADD: bool>(
    kernel: Kernel,
    stride: usize,
    words: &[u32],
    lines: &[Line],
    sums: &mut [[f32; TILE]],
) {
    let depth = lines.len() / 4;
    let sums: &mut [[f32; TILE]; ROWS] = sums.try_into().expect("one row of sums for each row of words");
    assert!(lines.len() == 4 * depth && words.len() >= (ROWS - 1) * stride + depth);
    #[cfg(target_arch = "x86_64")]
    match kernel {
        Kernel::Bf16 => {
            assert_eq!(Level::best(), Level::Avx512Dots);
            // SAFETY: the lengths were just checked, and the processor has the instructions of `kernel`.
            return unsafe { x86::bf16::<ROWS, ADD>(stride, words, lines, sums) };
        }
        Kernel::Int8 => {
            assert_eq!(Level::best(), Level::Avx512Dots);
            // SAFETY: the lengths were just checked, and the processor has the instructions of `kernel`.
            return unsafe { x86::int8::<ROWS, ADD>(stride, words, lines, sums) };
        }
        Kernel::F32(level) if level >= Level::Avx512 && level <= Level::best() => {
            // SAFETY: the lengths were just checked, and the processor has the instructions of `kernel`.
            return unsafe { x86::f32_avx512::<ROWS, ADD>(stride, words, lines, sums) };
        }
        Kernel::F32(level) if level >= Level::Avx2 && level <= Level::best() => {
            // SAFETY: the lengths were just checked, and the processor has the instructions of `kernel`.
            return unsafe { f32_lanes::<ROWS, ADD>(stride, words, lines, sums) };
        }
        _ => {}
    }
    assert!(matches!(kernel, Kernel::F32(_)), "only x86-64 has the other kernels");
    #[cfg(target_arch = "aarch64")]
    // SAFETY: the lengths were just checked, and every processor of this architecture has NEON.
    unsafe {
        f32_lanes::<ROWS, ADD>(stride, words, lines, sums)
    };
    #[cfg(not(target_arch = "aarch64"))]
    portable::<ROWS, ADD>(stride, words, lines, sums);
}

/// The plain twin of the f32 kernels.
#[cfg(not(target_arch = "aarch64"))]
fn portable<const ROWS: usize, const ADD: bool>(
    stride: usize,
    words: &[u32],
    lines: &[Line],
    sums: &mut [[f32; TILE]; ROWS],
) {
    for (r, sums) in sums.iter_mut().enumerate() {
        for (quarter, sums) in sums.as_chunks_mut::<16>().0.iter_mut().enumerate() {
            let mut sum = if ADD { *sums } else { [0.0; 16] };
            for (&word, lines) in words[r * stride..].iter().zip(lines.as_chunks::<4>().0) {
                let value = f32::from_bits(word);
                for (sum, &w) in sum.iter_mut().zip(&lines[quarter].0) {
                    *sum = multiply_add::<BASE>(value, f32::from_bits(w), *sum);
                }
            }
            *sums = sum;
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Line, TILE};
    use std::arch::x86_64::*;
    use std::mem::transmute;

    /// The AVX-512 kernels differ in the instruction that adds word × line to a sum.
    macro_rules! kernel_512 {
        ($name:ident, $features:literal, |$value:ident, $line:ident, $sum:ident| $step:expr) => {
            /// # Safety
            /// `lines` must hold 4 × depth lines, and `words` depth words at each of ROWS multiples of `stride`.
            #[target_feature(enable = $features)]
            pub(super) unsafe fn $name<const ROWS: usize, const ADD: bool>(
                stride: usize,
                words: &[u32],
                lines: &[Line],
                sums: &mut [[f32; TILE]; ROWS],
            ) {
                let mut acc = [[_mm512_setzero_ps(); 4]; ROWS];
                for (acc, sums) in acc.iter_mut().zip(&*sums).filter(|_| ADD) {
                    for (acc, sums) in acc.iter_mut().zip(sums.as_chunks::<16>().0) {
                        // SAFETY: `sums` is 16 f32.
                        *acc = unsafe { _mm512_loadu_ps(sums.as_ptr()) };
                    }
                }
                let (mut word, mut line) = (words.as_ptr(), lines.as_ptr());
                for _ in 0..lines.len() / 4 {
                    // SAFETY: `word` runs over the first row, so `word + r × stride` over row r < ROWS; `line`
                    // over the groups of 4 lines. Lines are aligned to 64 bytes.
                    unsafe {
                        let group = line.cast::<__m512>();
                        let group = [*group, *group.add(1), *group.add(2), *group.add(3)];
                        for (r, acc) in acc.iter_mut().enumerate() {
                            let $value = _mm512_set1_epi32(*word.add(r * stride) as i32);
                            for (acc, line) in acc.iter_mut().zip(group) {
                                let ($line, $sum) = (line, *acc);
                                *acc = $step;
                            }
                        }
                        word = word.add(1);
                        line = line.add(4);
                    }
                }
                for (acc, sums) in acc.iter().zip(sums) {
                    for (acc, sums) in acc.iter().zip(sums.as_chunks_mut::<16>().0) {
                        // SAFETY: `sums` is 16 f32.
                        unsafe { _mm512_storeu_ps(sums.as_mut_ptr(), *acc) };
                    }
                }
            }
        };
    }

    kernel_512!(f32_avx512, "avx512f", |value, line, sum| _mm512_fmadd_ps(_mm512_castsi512_ps(value), line, sum));
    kernel_512!(bf16, "avx512f,avx512bf16", |value, line, sum| {
        // Both are 64 bytes of plain numbers.
        _mm512_dpbf16_ps(sum, transmute::<__m512i, __m512bh>(value), transmute::<__m512, __m512bh>(line))
    });

    kernel_512!(int8, "avx512f,avx512vnni", |value, line, sum| {
        let (sum, line) = (_mm512_castps_si512(sum), _mm512_castps_si512(line));
        _mm512_castsi512_ps(_mm512_dpbusd_epi32(sum, value, line))
    });
}

/// # Safety
/// The processor has the instructions; `lines` must hold 4 × depth lines, and `words` depth words at each of ROWS multiples of `stride`.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
#[cfg_attr(target_arch = "x86_64", target_feature(enable = "avx2,fma"))]
#[cfg_attr(target_arch = "aarch64", target_feature(enable = "neon"))]
unsafe fn f32_lanes<const ROWS: usize, const ADD: bool>(
    stride: usize,
    words: &[u32],
    lines: &[Line],
    sums: &mut [[f32; TILE]; ROWS],
) {
    use crate::lanes::{Lanes, N, add_product, load, splat, store};
    for quarter in 0..4 {
        let mut acc = [[splat(0.0); 16 / N]; ROWS];
        for (acc, sums) in acc.iter_mut().zip(&*sums).filter(|_| ADD) {
            for (acc, sums) in acc.iter_mut().zip(sums[16 * quarter..][..16].as_chunks::<N>().0) {
                // SAFETY: `sums` is a whole register.
                *acc = unsafe { load(sums.as_ptr()) };
            }
        }
        for k in 0..lines.len() / 4 {
            // SAFETY: row r < ROWS has a word k < depth at r × stride + k, and 4 × k + quarter < 4 × depth; a line is 16 / N registers.
            unsafe {
                let line = *lines.as_ptr().add(4 * k + quarter).cast::<[Lanes; 16 / N]>();
                for (r, acc) in acc.iter_mut().enumerate() {
                    let value = splat(f32::from_bits(*words.as_ptr().add(r * stride + k)));
                    for (acc, line) in acc.iter_mut().zip(line) {
                        *acc = add_product(*acc, value, line);
                    }
                }
            }
        }
        for (acc, sums) in acc.iter().zip(sums.iter_mut()) {
            for (acc, sums) in acc.iter().zip(sums[16 * quarter..][..16].as_chunks_mut::<N>().0) {
                // SAFETY: `sums` is a whole register.
                unsafe { store(sums.as_mut_ptr(), *acc) };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::level::{BASE, FUSED};
    use crate::sums::tests::values;

    /// The bits of multiply-adds in order, at every level that has them.
    #[test]
    fn sums_run_over_the_words_in_order() {
        foveate_testing::need!(foveate_testing::fused_multiply_add());
        const DEPTH: usize = 37;
        let words: Vec<u32> = values(BLOCK * DEPTH, 1).into_iter().map(f32::to_bits).collect();
        let weights = values(TILE * DEPTH, 2);
        let lines: Vec<Line> = weights.as_chunks::<16>().0.iter().map(|line| Line(line.map(f32::to_bits))).collect();
        for level in Level::all().filter(|level| *level != Level::Portable || BASE == FUSED) {
            for rows in 1..=BLOCK {
                let mut sums = [[0.5; TILE]; BLOCK];
                multiply::<true>(Kernel::F32(level), rows, DEPTH, &words, &lines, &mut sums);
                for (r, c) in (0..rows).flat_map(|r| (0..TILE).map(move |c| (r, c))) {
                    let sum = (0..DEPTH)
                        .fold(0.5, |sum, k| f32::from_bits(words[r * DEPTH + k]).mul_add(weights[k * TILE + c], sum));
                    assert_eq!(sums[r][c].to_bits(), sum.to_bits(), "{level:?}, {rows} rows: row {r}, column {c}");
                }
            }
        }
    }
}
