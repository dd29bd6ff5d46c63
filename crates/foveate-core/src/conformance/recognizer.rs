//! The conformance test of recognisers.

use super::checks;
use crate::geometry::Gaze;
use crate::identity::Recognizer;
use rand::RngExt;

/// Checks that the result is log-probabilities: not NaN, with probabilities that sum to 1. After `reset` the same looks must give the same
/// result, whatever came before; so must a recogniser that loads a state saved in between, as JSON text. A state that does not fit must be
/// an error.
///
/// `make` returns new recognisers of the same settings. Looks are random features, 0 to 1, at random gazes.
pub fn recognizer(make: &dyn Fn() -> Box<dyn Recognizer>) {
    const LOOKS: usize = 7;
    let mut rng = checks().rng(9);
    let mut a = make();
    let (width, n) = (a.width(), a.classes());
    assert!(n >= 2, "to recognise is to choose");
    let features: Vec<f32> = (0..LOOKS * width).map(|_| rng.random()).collect();
    let gazes: Vec<Gaze> = (0..LOOKS)
        .map(|_| Gaze { u: rng.random_range(-1.0..1.0), v: rng.random_range(-1.0..1.0), arm: None })
        .collect();
    let say = |it: &mut dyn Recognizer, look: usize| {
        let mut log_p = vec![f64::NAN; n];
        it.recognize(&features[look * width..][..width], gazes[look], &mut log_p);
        let sum: f64 = log_p.iter().map(|q| q.exp()).sum();
        assert!((sum - 1.0).abs() < 1e-9, "probabilities sum to 1, not {sum}");
        log_p
    };
    a.reset();
    let first: Vec<Vec<f64>> = (0..LOOKS).map(|look| say(&mut *a, look)).collect();
    a.reset();
    for (look, first) in first.iter().enumerate() {
        let text = serde_json::to_string(&a.save()).expect("a JSON value is text");
        let mut b = make();
        say(&mut *b, LOOKS - 1);
        b.load(&serde_json::from_str(&text).expect("what was written can be read")).expect("what was saved fits");
        assert_eq!(say(&mut *b, look), *first, "what was loaded must go on as the one that was saved");
        assert_eq!(say(&mut *a, look), *first, "the same looks must be recognised as the same");
    }
    for rubbish in ["{\"rubbish\": 1}", "[]", "\"a\"", "7", "null"] {
        let rubbish = serde_json::from_str(rubbish).expect("valid JSON");
        assert!(a.load(&rubbish).is_err(), "{rubbish} must be refused");
    }
}
