use super::*;
use crate::sums::root_overlap;
use crate::sums::tests::values;

/// Weights like those of a trained machine: of both signs, near 0.05.
fn weights(n: usize) -> Vec<f32> {
    values(n, 3).iter().map(|x| (x - 0.5) * 0.2).collect()
}

fn every_kind() -> impl Iterator<Item = (Level, Precision)> {
    Level::all().flat_map(|level| [(level, Precision::F32), (level, Precision::Bf16)])
}

/// Features in f64 of rounded inputs, and in f64 of the inputs themselves.
fn truth(glimpse: &[f32], w: &[f32], bias: &[f32], rounded: bool) -> Vec<f64> {
    let round = |x: f32| if rounded { f32::from_bits(round_to_bf16(x)) as f64 } else { x as f64 };
    let (n_h, scale) = (bias.len(), TO_EXP2 as f64);
    (0..n_h)
        .map(|j| {
            let x: f64 =
                glimpse.iter().enumerate().map(|(i, &v)| round(v) * round(TO_EXP2 * w[i * n_h + j]) / scale).sum();
            1.0 / (1.0 + (-x - bias[j] as f64).exp())
        })
        .collect()
}

#[test]
fn features_agree_with_f64() {
    for (n, n_v, n_h) in [(1, 1, 1), (7, 3, 5), (6, 240, 500), (13, 64, 64), (11, 33, 129), (61, 20, 70), (3, 1500, 9)]
    {
        let (glimpses, w, bias) = (values(n * n_v, 1), weights(n_v * n_h), values(n_h, 2));
        for (level, precision) in every_kind() {
            let packed = PackedWeights::new(level, precision, n_v, n_h, &w);
            let mut h = vec![f32::NAN; n * n_h];
            packed.features(&glimpses, &bias, &mut h);
            let rounded = precision == Precision::Bf16;
            for (glimpse, h) in glimpses.chunks(n_v).zip(h.chunks(n_h)) {
                for (&h, truth) in h.iter().zip(truth(glimpse, &w, &bias, rounded)) {
                    let error = (h as f64 - truth).abs();
                    assert!(error < 2e-6, "{level:?} {precision:?} {n} x {n_v} x {n_h}: {h}, not {truth}");
                }
            }
        }
    }
}

/// The bound that `PackedWeights::bf16` states, and the typical error.
#[test]
fn bf16_is_as_accurate_as_stated() {
    let (n, n_v, n_h) = (12, 240, 500);
    let (glimpses, w, bias) = (values(n * n_v, 4), weights(n_v * n_h), vec![0.0; n_h]);
    let mut h = vec![0.0; n * n_h];
    PackedWeights::bf16(n_v, n_h, &w).features(&glimpses, &bias, &mut h);
    let mut square = 0.0;
    for (glimpse, h) in glimpses.chunks(n_v).zip(h.chunks(n_h)) {
        for (j, (&h, truth)) in h.iter().zip(truth(glimpse, &w, &bias, false)).enumerate() {
            let error = (h as f64 - truth).abs();
            let terms = glimpse.iter().enumerate().map(|(i, v)| (v * w[i * n_h + j]).abs() as f64);
            // A logistic's slope is at most a quarter.
            assert!(error < terms.sum::<f64>() / 256.0 / 4.0 + 1e-6);
            square += error * error / (n * n_h) as f64;
        }
    }
    assert!(square.sqrt() < 4e-4, "root mean square error {}", square.sqrt());
}

#[test]
fn overlaps_are_those_of_the_features() {
    for (n, n_v, n_h) in [(1, 4, 3), (100, 240, 500), (49, 7, 65)] {
        let (glimpses, w, bias) = (values(n * n_v, 1), weights(n_v * n_h), values(n_h, 2));
        let template: Vec<f32> = values(n_h, 5).iter().map(|x| x.sqrt()).collect();
        for (level, precision) in every_kind() {
            let packed = PackedWeights::new(level, precision, n_v, n_h, &w);
            let (mut h, mut totals, mut overlaps) = (vec![0.0; n * n_h], vec![0.0; n], vec![0.0; n]);
            packed.features(&glimpses, &bias, &mut h);
            packed.overlaps(&glimpses, &bias, &template, &mut totals, &mut overlaps);
            for (h, got) in h.chunks(n_h).zip(totals.into_iter().zip(overlaps)) {
                let (total, overlap) = root_overlap(h, &template);
                assert!((got.0 - total).abs() < 1e-6 * total, "{level:?} {precision:?}: {} not {total}", got.0);
                assert!((got.1 - overlap).abs() < 1e-6 * overlap, "{level:?} {precision:?}: {} not {overlap}", got.1);
            }
        }
    }
}

/// A row alone gives the bits it gives in a batch.
#[test]
fn a_row_depends_on_itself_alone() {
    let (n, n_v, n_h) = (64, 31, 70);
    let (glimpses, w, bias) = (values(n * n_v, 1), weights(n_v * n_h), values(n_h, 2));
    for (level, precision) in every_kind() {
        let packed = PackedWeights::new(level, precision, n_v, n_h, &w);
        let (mut h, mut totals, mut overlaps) = (vec![0.0; n * n_h], vec![0.0; n], vec![0.0; n]);
        packed.features(&glimpses, &bias, &mut h);
        packed.overlaps(&glimpses, &bias, &bias, &mut totals, &mut overlaps);
        for (r, glimpse) in glimpses.chunks(n_v).enumerate() {
            let (mut alone, mut total, mut overlap) = (vec![0.0; n_h], [0.0], [0.0]);
            packed.features(glimpse, &bias, &mut alone);
            packed.overlaps(glimpse, &bias, &bias, &mut total, &mut overlap);
            assert_eq!(alone, h[r * n_h..][..n_h], "{level:?} {precision:?} row {r}");
            assert_eq!((total[0], overlap[0]), (totals[r], overlaps[r]), "{level:?} {precision:?} row {r}");
        }
    }
}

#[test]
fn infinite_sums_saturate_and_nan_stays() {
    for (level, precision) in every_kind() {
        let packed = PackedWeights::new(level, precision, 1, 3, &[1.0, -1.0, 0.0]);
        let mut h = [0.0; 3];
        packed.features(&[1e30], &[0.0, 0.0, f32::NAN], &mut h);
        assert!(h[0] == 1.0 && h[1] < 5e-39 && h[2].is_nan(), "{level:?} {precision:?}: {h:?}");
        let (mut total, mut overlap) = ([0.0], [0.0]);
        packed.overlaps(&[1e30], &[0.0; 3], &[1.0; 3], &mut total, &mut overlap);
        assert!((total[0] - 1.5).abs() < 1e-6 && (overlap[0] - (1.0 + 0.5f32.sqrt())).abs() < 1e-6);
    }
}

#[test]
fn bf16_rounds_to_nearest_even() {
    for (value, rounded) in
        [(1.0, 1.0), (1.003_906_3, 1.0), (1.011_718_8, 1.015_625), (1.004, 1.007_812_5), (-3.0, -3.0)]
    {
        assert_eq!(f32::from_bits(round_to_bf16(value)), rounded);
    }
    assert!(f32::from_bits(round_to_bf16(f32::from_bits(0x7f80_0001))).is_nan());
    assert_eq!(f32::from_bits(round_to_bf16(f32::INFINITY)), f32::INFINITY);
    assert_eq!(pair_of_bf16(1.0, -2.0), 0xc000_3f80);
}

#[test]
fn repacked_is_packed_anew() {
    let (n, n_v, n_h) = (3, 9, 70);
    let (glimpses, w, bias) = (values(n * n_v, 1), weights(n_v * n_h), values(n_h, 2));
    for (level, precision) in every_kind() {
        let (mut h, mut again) = (vec![0.0; n * n_h], vec![1.0; n * n_h]);
        PackedWeights::new(level, precision, n_v, n_h, &w).features(&glimpses, &bias, &mut h);
        let mut packed = PackedWeights::new(level, precision, n_v, n_h, &vec![9.0; n_v * n_h]);
        packed.repack(&w);
        packed.features(&glimpses, &bias, &mut again);
        assert_eq!(h, again, "{level:?} {precision:?}");
    }
}

#[test]
fn pooled_sums_agree_with_f64() {
    for (n, n_v, n_h) in [(1, 1, 1), (7, 3, 5), (100, 25, 100), (49, 25, 129)] {
        let (rows, w, thresholds) = (values(n * n_v, 1), weights(n_v * n_h), values(n_h, 2));
        let gains: Vec<f32> = values(n, 6).iter().map(|x| 5.0 * x).collect();
        let cells: Vec<u32> = (0..n).map(|r| (r * r % 3) as u32).collect();
        let mut truth = vec![0.25f64; 3 * n_h];
        for r in 0..n {
            for j in 0..n_h {
                let sum: f64 = (0..n_v).map(|i| f64::from(rows[r * n_v + i]) * f64::from(w[i * n_h + j])).sum();
                let above = f64::from(gains[r]) * sum - f64::from(thresholds[j]);
                truth[cells[r] as usize * n_h + j] += above.max(0.0);
            }
        }
        for level in Level::all() {
            let mut pooled = vec![0.25; 3 * n_h];
            let packed = PackedWeights::new(level, Precision::F32, n_v, n_h, &w);
            packed.pool(&rows, &gains, &cells, &thresholds, &mut pooled);
            for (&got, &truth) in pooled.iter().zip(&truth) {
                assert!((f64::from(got) - truth).abs() < 1e-5 * (1.0 + truth), "{level:?}: {got}, not {truth}");
            }
        }
    }
}

#[test]
fn no_glimpses_no_features() {
    PackedWeights::bf16(2, 3, &[0.0; 6]).features(&[], &[0.0; 3], &mut []);
}
