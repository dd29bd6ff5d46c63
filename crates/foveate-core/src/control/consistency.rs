//! Consistency monitor: does the evidence fit the target's being there?
//!
//! The paper's Σw² cannot detect a loss: it stays high on a wrong, sharp peak. This monitor uses the evidence,
//! relative to the reference likelihoods of frame 1 on and off the target, and the effective sample size of softened
//! weights, which rises if nothing in view fits better than the rest.

use serde::{Deserialize, Serialize};

use crate::reference::ReferenceLikelihood;
use crate::saved_state::{SavedState, Valid, Validate, ensure};
use foveate_base::Result;

/// The verdict of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Consistency {
    /// Smoothed evidence deficit: 0 for the evidence on the target, 1 for that of other places; 0 to 2.
    pub deficit: f64,
    /// The same of this frame alone, 0 to 2.
    pub frame_deficit: f64,
    /// Effective sample size of the softened weights, as a share of N, 0 to 1.
    pub tempered_ess: f64,
    /// Whether the smoothed deficit is below the threshold; [`ConsistencyMonitor::learns`] decides whether the frame
    /// is learned.
    pub holds: bool,
    /// Whether the reference likelihoods separate the target from other places: at most half of the settling frames
    /// have a deficit too large to be informative. The reference is measured at the centre of the box, which may be
    /// empty, and a gaze may be elsewhere. `false` before the first frame.
    pub is_informative: bool,
}

foveate_base::settings! {
    /// How evidence and tempered weights are compared with the reference over time.
    pub struct ConsistencySettings in "consistency" {
        /// Weight of the newest frame in the smoothed deficit, 0 to 1.
        pub memory: f64 = 0.3; 0.0 to 1.0,
        /// Smoothed deficit above which a frame is not learned.
        pub threshold: f64 = 0.6; 0.0 to 100.0,
        /// The same threshold during a search; the smaller one applies.
        pub while_lost: f64 = 100.0; 0.0 to 100.0,
        /// Exponent of the likelihood in the weights that `flat` refers to.
        pub temperature: f64 = 0.25; 0.0 to 1.0,
        /// Effective sample size of these weights, as a share of N, above which no place fits.
        pub flat: f64 = 0.9; 0.0 to 1.0,
        /// Frames after the start whose mean evidence corrects the reference likelihood of frame 1, 0 to 1000.
        pub settle: usize = 10; 0.0 to 1000.0,
        /// Interval of learning in frames after the first `settle` frames, 1 to 1000.
        pub every: u64 = 1; 1.0 to 1000.0,
    }
}

/// Watches evidence and tempered weights over time.
#[derive(Clone, Debug)]
pub struct ConsistencyMonitor {
    settings: ConsistencySettings,
    pub(crate) state: ConsistencyState,
}

/// The state between frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ConsistencyState {
    consistency: Consistency,
    /// Frames judged since the start, `settle` at most, and the sum of how far their evidence fell short of the reference.
    settled: usize,
    shortfall: f64,
    /// Number of these frames with a deficit larger than settling allows.
    beyond: usize,
}

/// Largest share of the way from on to off that settling may go, so that on and off stay separated.
const MOST_SHORTFALL: f64 = 0.7;

impl ConsistencyMonitor {
    /// A monitor that has seen nothing yet.
    pub fn new(settings: ConsistencySettings) -> Self {
        Self { settings, state: ConsistencyState::default() }
    }

    /// Resets to the first frame: the target was just given.
    pub fn reset(&mut self) {
        self.state = ConsistencyState::default();
    }

    /// Judges a frame by the log evidence of a look, and by the log weights.
    pub fn judge(&mut self, evidence: f64, log_weights: &[f64], reference: ReferenceLikelihood) -> Consistency {
        let gap = (reference.on - reference.off).max(1e-9);
        let short = if evidence.is_finite() { (reference.on - evidence) / gap } else { 2.0 };
        let m = &mut self.state;
        if m.settled < self.settings.settle {
            m.settled += 1;
            m.shortfall += short.clamp(0.0, MOST_SHORTFALL);
            m.beyond += usize::from(short >= MOST_SHORTFALL);
        }
        // On the target the evidence is `usual` of the gap below the reference; deficit counts from there.
        let usual = if m.settled > 0 { (m.shortfall / m.settled as f64).min(MOST_SHORTFALL) } else { 0.0 };
        let deficit = ((short - usual) / (1.0 - usual)).clamp(0.0, 2.0);
        let tempered_ess = tempered_ess(log_weights, self.settings.temperature);
        let deficit = if tempered_ess > self.settings.flat { deficit.max(1.0) } else { deficit };
        m.consistency.frame_deficit = deficit;
        m.consistency.deficit += self.settings.memory * (deficit - m.consistency.deficit);
        m.consistency.tempered_ess = tempered_ess;
        m.consistency.holds = m.consistency.deficit <= self.settings.threshold;
        m.consistency.is_informative = 2 * m.beyond <= m.settled;
        m.consistency
    }

    /// Whether the frame of this number, judged last, is one to learn from, while the target is searched for (`lost`) or not.
    pub fn learns(&self, frame: u64, lost: bool) -> bool {
        let Consistency { holds, deficit, .. } = self.state.consistency;
        let turn = self.state.settled < self.settings.settle || frame.is_multiple_of(self.settings.every);
        turn && holds && !(lost && deficit > self.settings.while_lost)
    }

    /// The last verdict.
    pub fn last(&self) -> Consistency {
        self.state.consistency
    }

    /// Restores a state that was saved.
    pub(crate) fn load(&mut self, saved: &SavedState) -> Result<()> {
        self.state = saved.state("consistency", &self.settings)?;
        Ok(())
    }
}

impl Validate<ConsistencySettings> for ConsistencyState {
    fn validate(&self, settings: &ConsistencySettings) -> Valid {
        let Self { settled, beyond, .. } = self;
        let fits = beyond <= settled && *settled <= settings.settle;
        ensure(fits, || {
            format!("{beyond} of {settled} frames are beyond the reference, of {} at most", settings.settle)
        })
    }
}

/// 1/Σw² of weights raised to a power, as a share of their number.
fn tempered_ess(log_weights: &[f64], power: f64) -> f64 {
    let most = log_weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !most.is_finite() {
        return 1.0;
    }
    // The weight of one particle says nothing.
    if log_weights.len() == 1 {
        return 0.0;
    }
    let (mut sum, mut squares) = (0.0, 0.0);
    for w in log_weights.iter().map(|w| (power * (w - most)).exp()) {
        sum += w;
        squares += w * w;
    }
    sum * sum / squares / log_weights.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One particle has all of the weight whatever the picture: it does not make a frame uninformative.
    #[test]
    fn one_particle_on_the_target_has_no_deficit() {
        for n in [1, 2, 100] {
            let mut monitor = ConsistencyMonitor::new(ConsistencySettings::default());
            let log_weights: Vec<f64> = (0..n).map(|i| f64::from(i) * -30.0).collect();
            let reference = ReferenceLikelihood { on: 0.0, off: -10.0 };
            let last = (0..30).map(|_| monitor.judge(0.0, &log_weights, reference)).last().expect("frames");
            assert!(last.holds && last.deficit < 0.1, "{n}: {last:?}");
        }
    }

    const REFERENCE: ReferenceLikelihood = ReferenceLikelihood { on: -2.0, off: -12.0 };

    #[test]
    fn evidence_of_elsewhere_means_lost_after_some_frames() {
        let mut v = ConsistencyMonitor::new(ConsistencySettings::default());
        let peaked = [0.0, -50.0, -50.0, -50.0];
        for _ in 0..20 {
            assert!(v.judge(-2.5, &peaked, REFERENCE).holds);
        }
        let verdicts: Vec<bool> = (0..10).map(|_| !v.judge(-12.0, &peaked, REFERENCE).holds).collect();
        assert!(!verdicts[0] && verdicts[9], "one bad frame is not a loss, ten are: {verdicts:?}");
    }

    #[test]
    fn while_it_is_lost_less_is_learned_from() {
        let mut v = ConsistencyMonitor::new(ConsistencySettings { while_lost: 0.3, ..Default::default() });
        let peaked = [0.0, -50.0, -50.0, -50.0];
        (0..20).for_each(|_| _ = v.judge(-2.0, &peaked, REFERENCE));
        assert!(v.learns(0, false) && v.learns(0, true));
        (0..20).for_each(|_| _ = v.judge(-7.0, &peaked, REFERENCE));
        assert!(v.learns(0, false) && !v.learns(0, true), "half of what was promised is missing");
        (0..20).for_each(|_| _ = v.judge(-12.0, &peaked, REFERENCE));
        assert!(!v.learns(0, false) && !v.learns(0, true));
    }

    /// Noise halves the reference evidence from frame 2 on: after some frames that is usual, and a loss is still detected.
    #[test]
    fn what_is_usual_is_no_loss() {
        let mut v = ConsistencyMonitor::new(ConsistencySettings::default());
        let peaked = [0.0, -50.0, -50.0, -50.0];
        for t in 0..40 {
            let evidence = -7.0 + if t % 2 == 0 { 0.5 } else { -0.5 };
            assert!(v.judge(evidence, &peaked, REFERENCE).holds, "frame {t}");
        }
        let resumed = SavedState::new(&v.state);
        let lost = |v: &mut ConsistencyMonitor| {
            (0..12).map(|_| v.judge(-12.0, &peaked, REFERENCE)).last().expect("twelve frames")
        };
        let verdict = lost(&mut v);
        assert!(!verdict.holds);
        let mut other = ConsistencyMonitor::new(ConsistencySettings::default());
        other.load(&resumed).expect("it was saved");
        assert_eq!(lost(&mut other), verdict);
    }

    /// The target's evidence from frame 2 on lies beyond that of other places in frame 1: the deficit is at its maximum on the target, and
    /// is not informative. It is where only a few frames are so.
    #[test]
    fn an_inseparable_reference_is_not_informative() {
        let peaked = [0.0, -50.0, -50.0, -50.0];
        let last = |beyond: &dyn Fn(usize) -> bool| {
            let mut v = ConsistencyMonitor::new(ConsistencySettings::default());
            assert!(!v.last().is_informative, "no frame was judged");
            let judge = |t| v.judge(if beyond(t) { -25.0 } else { -4.0 }, &peaked, REFERENCE);
            (0..30).map(judge).last().expect("thirty frames")
        };
        let never = last(&|_| true);
        assert!(never.deficit > 1.9 && !never.is_informative, "{never:?}");
        let mostly = last(&|t| t % 3 == 0 && t < 10);
        assert!(mostly.deficit < 0.2 && mostly.is_informative, "{mostly:?}");
        let later = last(&|t| t > 15);
        assert!(later.deficit > 1.9 && later.is_informative, "a loss is one: {later:?}");
    }

    /// Of six frames at the start, three may be beyond the reference.
    #[test]
    fn a_reference_is_informative_in_half_of_the_first_frames() {
        for beyond in 0..=6 {
            let mut v = ConsistencyMonitor::new(ConsistencySettings { settle: 6, ..ConsistencySettings::default() });
            let judge = |t| v.judge(if t < beyond { -25.0 } else { -4.0 }, &[0.0, -50.0], REFERENCE);
            assert_eq!((0..6).map(judge).last().expect("six frames").is_informative, beyond <= 3, "{beyond} of 6");
        }
    }

    #[test]
    fn flat_weights_and_no_evidence_are_doubt() {
        let mut v = ConsistencyMonitor::new(ConsistencySettings::default());
        let flat = v.judge(-2.0, &[0.0; 8], REFERENCE);
        assert!((flat.tempered_ess - 1.0).abs() < 1e-12 && flat.deficit > 0.0);
        let none = v.judge(f64::NEG_INFINITY, &[f64::NEG_INFINITY; 8], REFERENCE);
        assert!(none.deficit > flat.deficit && none.deficit.is_finite());
    }

    /// (Σ wᵖ)² / Σ w²ᵖ / n: 1 for equal weights, 1/n for a single one, ((√3 + 1)² / 4) / 2 for 3 : 1 to the power ½.
    #[test]
    fn the_tempered_sample_size_is_a_share_of_softened_weights() {
        let third = (3f64.sqrt() + 1.0).powi(2) / 8.0;
        for (weights, power, exact) in [
            (&[2.0, 2.0, 2.0][..], 0.7, 1.0),
            (&[1.0, 0.0, 0.0, 0.0], 1.0, 0.25),
            (&[3.0, 1.0], 0.5, third),
            (&[2.0, 6.0], 0.5, third),
            (&[0.0, 0.0], 0.5, 1.0),
        ] {
            let logs: Vec<f64> = weights.iter().map(|w: &f64| w.ln()).collect();
            // A common factor of the weights, however large, changes nothing.
            for factor in [0.0, -5000.0, 5000.0] {
                let logs: Vec<f64> = logs.iter().map(|log| log + factor).collect();
                let found = tempered_ess(&logs, power);
                assert!((found - exact).abs() < 1e-9, "{weights:?} to the power {power}: {found}, expected {exact}");
            }
        }
    }

    /// While it settles, the deficits of its frames shift the reference; later frames count from there.
    #[test]
    fn settling_frames_shift_the_reference() {
        let settings = ConsistencySettings { settle: 2, memory: 1.0, flat: 1.0, ..ConsistencySettings::default() };
        let mut monitor = ConsistencyMonitor::new(settings);
        let mut deficit = |evidence: f64| monitor.judge(evidence, &[0.0, -50.0], REFERENCE).frame_deficit;
        // Shares of the gap of 10 nats: 0.1 and 0.3, with a mean of 0.2.
        deficit(-3.0);
        deficit(-5.0);
        for (evidence, exact) in [(-4.0, 0.0), (-6.0, 0.25), (-8.0, 0.5), (-3.0, 0.0)] {
            assert!((deficit(evidence) - exact).abs() < 1e-12, "evidence {evidence}");
        }
    }

    /// After the first frames every third one is learned, below a deficit that is smaller during a search.
    #[test]
    fn frames_to_learn_from_follow_the_settings() {
        let settings = ConsistencySettings {
            settle: 2,
            every: 3,
            threshold: 0.5,
            while_lost: 0.2,
            memory: 1.0,
            flat: 1.0,
            ..ConsistencySettings::default()
        };
        let mut monitor = ConsistencyMonitor::new(settings);
        let mut learns = |evidence: f64, frame, lost| {
            monitor.judge(evidence, &[0.0, -50.0], REFERENCE);
            monitor.learns(frame, lost)
        };
        assert!(learns(-2.0, 1, false), "it settles");
        assert!(!learns(-2.0, 2, false) && learns(-2.0, 3, false) && !learns(-2.0, 4, false));
        assert!(learns(-3.5, 6, true) && learns(-3.5, 6, false), "a deficit of 0.15");
        assert!(!learns(-5.0, 6, true) && learns(-5.0, 6, false), "a deficit of 0.3");
        assert!(!learns(-8.0, 6, true) && !learns(-8.0, 6, false), "a deficit of 0.6");
    }
}
