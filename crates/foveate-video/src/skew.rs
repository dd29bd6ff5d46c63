//! Whether the rows of a picture fit together: bare pixels of a wrong width do not.

use foveate_core::scene::Image;

/// Pairs of pixels that are compared for each width, at most.
const SAMPLES: usize = 4096;
/// Rows match if neighbours differ by less than this on average, in grey levels.
const FITS: f64 = 2.0;
/// Another width is better if neighbours differ by less than this fraction.
const PART: f64 = 0.5;
/// A width is that of a row if neighbours differ by less than this fraction of the difference at nearby widths.
const NEAR: f64 = 0.8;

/// So many pixels beside the width of a row, pixels fit together less well.
const BESIDE: usize = 4;

/// The width, from half to 1.7 times the given one, at which rows of a picture match far better, if any. Diagonal
/// stripes look like skewed pictures.
pub(crate) fn better_width(image: &Image) -> Option<usize> {
    let (width, pixels) = (image.width(), &image.bytes()[..image.width() * image.height()]);
    let (narrowest, widest) = (width.div_ceil(2), width * 17 / 10);
    let within = pixels.len().checked_sub(widest + BESIDE).filter(|n| *n >= width && width > 4 * BESIDE)?;
    let step = (within / SAMPLES).max(1);
    let differs = |lag: usize| {
        let pairs = (0..within).step_by(step).map(|i| f64::from(pixels[i].abs_diff(pixels[i + lag])));
        pairs.sum::<f64>() / within.div_ceil(step) as f64
    };
    let own = differs(width);
    let others = (narrowest..=widest).filter(|lag| *lag != width);
    let (best, least) = others.map(|lag| (lag, differs(lag))).min_by(|a, b| a.1.total_cmp(&b.1))?;
    let beside = differs(best - BESIDE).min(differs(best + BESIDE));
    (own > FITS && least < PART * own && least < NEAR * beside).then_some(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Soft blobs, seed 3.
    fn picture(width: usize, height: usize) -> Vec<u8> {
        let mut next = foveate_testing::draws(3);
        let blobs: Vec<[f64; 4]> = (0..40)
            .map(|_| [next(width) as f64, next(height) as f64, 4.0 + next(20) as f64, next(200) as f64 - 100.0])
            .collect();
        let at = |x: usize, y: usize| {
            let square = |a: &f64, b: &f64| (x as f64 - a).powi(2) + (y as f64 - b).powi(2);
            let sum: f64 = blobs.iter().map(|[a, b, size, tone]| tone * (-square(a, b) / (size * size)).exp()).sum();
            (120.0 + sum).clamp(0.0, 255.0) as u8
        };
        (0..width * height).map(|i| at(i % width, i / width)).collect()
    }

    fn found(width: usize, pixels: &[u8]) -> Option<usize> {
        let height = pixels.len() / width;
        better_width(&Image::new(width, height, 1, pixels[..width * height].to_vec()).expect("sizes agree"))
    }

    #[test]
    fn a_wrong_width_is_found_and_the_right_one_is_not_doubted() {
        let pixels = picture(160, 120);
        assert_eq!(found(160, &pixels), None);
        for wrong in [100, 120, 150, 158, 162, 170, 200, 240, 300] {
            assert_eq!(found(wrong, &pixels), Some(160), "{wrong}");
        }
        // Neither noise, nor one tone, nor lines, nor a picture too small to judge.
        let noise: Vec<u8> = foveate_testing::noise(1, 160 * 120).collect();
        let lines: Vec<u8> = (0..160 * 120).map(|i| if i / 160 % 2 == 0 { 20 } else { 220 }).collect();
        for pixels in [&noise[..], &vec![90; 160 * 120], &lines, &noise[..160 * 2], &noise[..1]] {
            assert_eq!(found(160.min(pixels.len()), pixels), None);
        }
    }
}
