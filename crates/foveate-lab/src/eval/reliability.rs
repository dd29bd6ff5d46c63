//! Calibration of class probabilities: calibration error and reliability bins (Guo et al. 2017).

/// Decisions with similar confidence (the probability of the most likely class).
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Bin {
    /// Number of decisions.
    pub count: usize,
    /// Their mean confidence, 0 to 1.
    pub confidence: f64,
    /// The fraction of right decisions.
    pub accuracy: f64,
}

/// Returns bins of equal width, from 0 to 1, of pairs of a probability and its outcome; and the expected calibration error: the mean
/// distance between probability and frequency in a bin, weighted by count.
pub(super) fn reliability(pairs: &[(f64, bool)], bins: usize) -> (Vec<Bin>, f64) {
    let mut found = vec![Bin::default(); bins];
    for (p, hit) in pairs {
        let bin = &mut found[((p * bins as f64) as usize).min(bins - 1)];
        bin.count += 1;
        bin.confidence += p;
        bin.accuracy += f64::from(u8::from(*hit));
    }
    for bin in found.iter_mut().filter(|bin| bin.count > 0) {
        bin.confidence /= bin.count as f64;
        bin.accuracy /= bin.count as f64;
    }
    let apart: f64 = found.iter().map(|b| b.count as f64 * (b.confidence - b.accuracy).abs()).sum();
    (found, apart / pairs.len().max(1) as f64)
}

/// The quality of log-probabilities as predictions of labels.
#[derive(Clone, Debug, PartialEq)]
pub struct Reliability {
    /// Bins of equal width of confidence, from 0 to 1; empty ones have count 0.
    pub bins: Vec<Bin>,
    /// Fraction of right decisions.
    pub accuracy: f64,
    /// Mean of −log p of the true class, nats.
    pub log_loss: f64,
    /// Expected calibration error: the mean distance between confidence and accuracy of a bin, weighted by count.
    pub ece: f64,
}

impl Reliability {
    /// Evaluates log-probabilities, a row of `classes` for each label, in `bins` bins. Ties go to the first class.
    ///
    /// # Panics
    /// If the shapes do not fit, or there is no label or bin.
    pub fn of(log_p: &[f64], labels: &[u8], classes: usize, bins: usize) -> Self {
        assert!(classes > 0 && bins > 0 && !labels.is_empty() && log_p.len() == labels.len() * classes, "a row each");
        let (mut log_loss, mut right, mut pairs) = (0.0, 0usize, vec![]);
        for (q, &label) in log_p.chunks_exact(classes).zip(labels) {
            let decided = (1..classes).fold(0, |best, l| if q[l] > q[best] { l } else { best });
            let p = q[decided].exp().clamp(0.0, 1.0);
            let hit = decided == usize::from(label);
            pairs.push((p, hit));
            right += usize::from(hit);
            log_loss -= q[usize::from(label)];
        }
        let n = labels.len() as f64;
        let (bins, ece) = reliability(&pairs, bins);
        Self { bins, accuracy: right as f64 / n, log_loss: log_loss / n, ece }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_by_hand() {
        // Confidences .9 (right), .8 (wrong), .6 (right), .55 (right).
        let p = [[0.9, 0.1], [0.2, 0.8], [0.6, 0.4], [0.45, 0.55]];
        let log_p: Vec<f64> = p.iter().flatten().map(|p: &f64| p.ln()).collect();
        let found = Reliability::of(&log_p, &[0, 0, 0, 1], 2, 4);
        assert_eq!(found.bins.iter().map(|b| b.count).collect::<Vec<_>>(), [0, 0, 2, 2]);
        assert!((found.bins[2].confidence - 0.575).abs() < 1e-12 && found.bins[2].accuracy == 1.0);
        assert!((found.bins[3].confidence - 0.85).abs() < 1e-12 && found.bins[3].accuracy == 0.5);
        assert!((found.ece - (0.5 * 0.425 + 0.5 * 0.35)).abs() < 1e-12 && found.accuracy == 0.75);
        let loss = -(0.9f64.ln() + 0.2f64.ln() + 0.6f64.ln() + 0.55f64.ln()) / 4.0;
        assert!((found.log_loss - loss).abs() < 1e-12);
        // Certain and right: no error. Certain and wrong: all of it.
        assert_eq!(Reliability::of(&[0.0, -99.0], &[0], 2, 10).ece, 0.0);
        assert!((Reliability::of(&[0.0, -99.0], &[1], 2, 10).ece - 1.0).abs() < 1e-12);
    }
}
