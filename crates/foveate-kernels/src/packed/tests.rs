use super::*;
use crate::sums::root_overlap;
use crate::sums::tests::values;

/// Weights like those of a trained machine: of both signs, near 0.05.
fn weights(n: usize) -> Vec<f32> {
    values(n, 3).iter().map(|x| (x - 0.5) * 0.2).collect()
}

fn every_kind() -> impl Iterator<Item = (Level, Precision)> {
    Level::all()
        .flat_map(|level| [Precision::F32, Precision::Bf16, Precision::Int8].map(|precision| (level, precision)))
}

/// Features in f64 of rounded inputs.
fn truth(glimpse: &[f32], w: &[f32], bias: &[f32], precision: Precision) -> Vec<f64> {
    let (n_h, scale) = (bias.len(), f64::from(TO_EXP2));
    let [least, step] = steps_of(glimpse).map(f64::from);
    (0..n_h)
        .map(|j| {
            let column: Vec<f64> = w.iter().skip(j).step_by(n_h).map(|w| f64::from(TO_EXP2 * w)).collect();
            let most = column.iter().fold(0.0f64, |most, w| most.max(w.abs()));
            let product = |(&v, &w): (&f32, &f64)| match precision {
                Precision::F32 => f64::from(v) * w,
                Precision::Bf16 => {
                    let round = |x: f32| f64::from(f32::from_bits(round_to_bf16(x)));
                    round(v) * round(w as f32)
                }
                Precision::Int8 => {
                    let whole = f64::from(byte(v, steps_of(glimpse)));
                    least * w + if most > 0.0 { step * whole * (w / most * 127.0).round() * most / 127.0 } else { 0.0 }
                }
            };
            let x: f64 = glimpse.iter().zip(&column).map(product).sum();
            1.0 / (1.0 + (-x / scale - f64::from(bias[j])).exp())
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
            for (glimpse, h) in glimpses.chunks(n_v).zip(h.chunks(n_h)) {
                for (&h, truth) in h.iter().zip(truth(glimpse, &w, &bias, precision)) {
                    let error = (h as f64 - truth).abs();
                    assert!(error < 2e-6, "{level:?} {precision:?} {n} x {n_v} x {n_h}: {h}, not {truth}");
                }
            }
        }
    }
}

/// The bounds that `PackedWeights::bf16` and `int8` state, and the typical errors.
#[test]
fn rounded_features_are_as_accurate_as_stated() {
    let (n, n_v, n_h) = (12, 240, 500);
    let (glimpses, w, bias) = (values(n * n_v, 4), weights(n_v * n_h), vec![0.0; n_h]);
    for (packed, most) in [(PackedWeights::bf16(n_v, n_h, &w), 4e-4), (PackedWeights::int8(n_v, n_h, &w), 8e-4)] {
        let mut h = vec![0.0; n * n_h];
        packed.features(&glimpses, &bias, &mut h);
        let mut square = 0.0;
        for (glimpse, h) in glimpses.chunks(n_v).zip(h.chunks(n_h)) {
            let [least, step] = steps_of(glimpse).map(f64::from);
            for (j, (&h, truth)) in h.iter().zip(truth(glimpse, &w, &bias, Precision::F32)).enumerate() {
                let error = (h as f64 - truth).abs();
                let column = || w.iter().skip(j).step_by(n_h).map(|&w| f64::from(w).abs());
                let half = column().fold(0.0, f64::max) / 127.0 / 2.0;
                let bound = |(&v, w): (&f32, f64)| match packed.precision() {
                    Precision::Int8 => step / 2.0 * (w + half) + (f64::from(v) - least) * half,
                    _ => f64::from(v).abs() * w / 256.0,
                };
                // A logistic's slope is at most a quarter.
                assert!(error < glimpse.iter().zip(column()).map(bound).sum::<f64>() / 4.0 + 1e-6);
                square += error * error / (n * n_h) as f64;
            }
        }
        assert!(square.sqrt() < most, "{:?}: root mean square error {}", packed.precision(), square.sqrt());
    }
}

/// Sums of whole numbers are the same at every level; what is fused after them moves the last bits.
#[test]
fn bytes_and_whole_numbers_in_f32_have_the_same_sums() {
    let (n_v, n_h) = (518, 70);
    let (glimpses, w, bias) = (values(9 * n_v, 4), weights(n_v * n_h), vec![0.0; n_h]);
    let features = |level| {
        let mut h = vec![0.0; 9 * n_h];
        PackedWeights::new(level, Precision::Int8, n_v, n_h, &w).features(&glimpses, &bias, &mut h);
        h
    };
    let portable = features(Level::Portable);
    for level in Level::all() {
        assert!(features(level).iter().zip(&portable).all(|(h, p)| (h - p).abs() < 3e-7), "{level:?}");
    }
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
        packed.features(&[f32::NAN], &[0.0; 3], &mut h);
        assert!(h.iter().all(|h| h.is_nan()), "{level:?} {precision:?}: {h:?}");
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
