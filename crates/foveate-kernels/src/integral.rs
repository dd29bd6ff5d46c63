//! Integral images of a table lookup by pixel colour: the sum over any box is four reads.

use crate::colour::assert_one_size;
use crate::level::levels;

/// Number of colours of [`colour_bins`]: 16 levels of red, green and blue.
pub const COLOUR_BINS: usize = 4096;

levels! {
    /// `out` ← the bins of colours: 16 × 16 levels of red, 16 of green, and that of blue.
    ///
    /// # Panics
    /// If the planes and `out` differ in length.
    pub fn colour_bins / colour_bins_at (planes: [&[u8]; 3], out: &mut [u16]) = colour_bins_body
}

levels! {
    /// A row of an integral image: `here[i + 1]` ← `above[i + 1]` + the sum of `table[bin]` over the bins up to the i-th of
    /// every `step`-th one, and `here[0]` ← 0. Sums wrap around; differences of these are right all the same.
    ///
    /// # Panics
    /// If there are fewer bins than `here` needs, rows differ in length, `step` is 0, or the length of the table is
    /// not a power of two. A bin past its end wraps to its lower bits.
    pub fn integral_row / integral_row_at (
        bins: &[u16], step: usize, table: &[u16], above: &[u32], here: &mut [u32]
    ) = integral_row_body
}

#[inline(always)]
fn colour_bins_body<const V: u8>([r, g, b]: [&[u8]; 3], out: &mut [u16]) {
    assert_one_size([r, g, b], out.len());
    for (out, ((&r, &g), &b)) in out.iter_mut().zip(r.iter().zip(g).zip(b)) {
        *out = u16::from(r >> 4) << 8 | u16::from(g >> 4) << 4 | u16::from(b >> 4);
    }
}

#[inline(always)]
fn integral_row_body<const V: u8>(bins: &[u16], step: usize, table: &[u16], above: &[u32], here: &mut [u32]) {
    assert!(table.len().is_power_of_two(), "a table of a power of two, not of {}", table.len());
    assert!(above.len() == here.len(), "rows of one length");
    let Some((first, here)) = here.split_first_mut() else { return };
    assert!(bins.len().div_ceil(step) >= here.len(), "{} bins a row of {}", bins.len(), here.len());
    *first = 0;
    let (last, above, mut sum) = (table.len() - 1, &above[1..], 0u32);
    let mut add = |(here, above): (&mut u32, &u32), bin: u16| {
        sum = sum.wrapping_add(table[usize::from(bin) & last].into());
        *here = above.wrapping_add(sum);
    };
    match step {
        1 => here.iter_mut().zip(above).zip(bins).for_each(|(to, bin)| add(to, *bin)),
        _ => here.iter_mut().zip(above).zip(bins.iter().step_by(step)).for_each(|(to, bin)| add(to, *bin)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Level;

    #[test]
    fn bins_and_sums_agree_with_the_twins() {
        let plane = |k: usize| (0..301).map(|i| (i * (37 + 2 * k) + i * i / 7) as u8).collect::<Vec<u8>>();
        let planes = [0, 1, 2].map(plane);
        let table: Vec<u16> = (0..COLOUR_BINS).map(|i| ((i * 2_654_435) >> 7) as u16).collect();
        for level in Level::all() {
            let mut bins = vec![u16::MAX; 301];
            colour_bins_at(level, planes.each_ref().map(|p| &p[..]), &mut bins);
            for (i, bin) in bins.iter().enumerate() {
                let [r, g, b] = [0, 1, 2].map(|p| usize::from(planes[p][i]) / 16);
                assert_eq!(usize::from(*bin), 256 * r + 16 * g + b, "{level:?}");
            }
            for (step, count) in [(1, 301), (1, 17), (3, 101), (7, 1), (2, 0)] {
                let above: Vec<u32> = (0..=count).map(|i| u32::MAX - 1000 * i as u32).collect();
                let mut here = vec![77; count + 1];
                integral_row_at(level, &bins, step, &table, &above, &mut here);
                let mut sum = 0u64;
                assert_eq!(here[0], 0);
                for i in 0..count {
                    sum += u64::from(table[usize::from(bins[i * step])]);
                    assert_eq!(here[i + 1], (u64::from(above[i + 1]) + sum) as u32, "{level:?}, step {step}");
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "3 bins a row of 4")]
    fn too_few_bins_are_refused() {
        integral_row(&[1, 2, 3], 1, &[5; 4], &[0; 5], &mut [0; 5]);
    }
}
