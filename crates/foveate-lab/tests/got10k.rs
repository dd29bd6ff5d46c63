//! Scores equal those of the got10k toolkit on the same boxes.

use foveate_core::geometry::BBox;
use foveate_lab::eval::score;
use serde_json::Value;

#[test]
fn scores_equal_the_toolkits() {
    // Made by got10k 0.1.3 itself on random boxes; the file has the command.
    let golden: Value = serde_json::from_str(include_str!("data/got10k.json")).expect("JSON");
    let numbers =
        |v: &Value| v.as_array().expect("a list").iter().map(|v| v.as_f64().expect("a number")).collect::<Vec<_>>();
    let boxes = |v: &Value| {
        let one = |v: &Value| {
            let b = numbers(v);
            Some(BBox { x: b[0], y: b[1], w: b[2], h: b[3] })
        };
        v.as_array().expect("a list").iter().map(one).collect::<Vec<_>>()
    };
    let cases = golden["cases"].as_array().expect("a list");
    assert_eq!(cases.len(), 6);
    for case in cases {
        let (score, curves) = score(&boxes(&case["boxes"]), &boxes(&case["truth"])).expect("as many boxes as truths");
        let (success, precision) = (numbers(&case["success"]), numbers(&case["precision"]));
        for (ours, theirs) in curves.success.iter().zip(&success).chain(curves.precision.iter().zip(&precision)) {
            assert!((ours - theirs).abs() < 1e-12, "{ours} is not {theirs}");
        }
        assert!((score.auc - success.iter().sum::<f64>() / 21.0).abs() < 1e-12);
        assert_eq!((score.p20, score.sr50), (curves.precision[20], curves.success[10]));
    }
}
