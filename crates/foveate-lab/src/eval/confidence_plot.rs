//! The reliability curve: the fraction of lost frames against the reported P(lost).

use foveate_report::chart::{Axis, Chart, Mark, render};

use super::confidence::ConfidenceScore;

const COLOURS: [&str; 4] = ["#0072B2", "#D55E00", "#009E73", "#CC79A7"];

/// Plots curves side by side, as SVG text; perfect calibration is the diagonal. Bins of fewer than 20 frames are left out.
pub fn plot(scores: &[(&str, &ConfidenceScore)]) -> String {
    let diagonal = Mark::line("#888888", 2.2, [(0.0, 0.0), (1.0, 1.0)]).dashed("3 4").named("perfect");
    let mut marks = vec![diagonal];
    for ((name, score), colour) in scores.iter().zip(COLOURS.iter().cycle()) {
        let bins = score.bins.iter().filter(|b| b.count >= 20);
        let points: Vec<(f64, f64)> = bins.map(|b| (b.confidence, b.accuracy)).collect();
        if !points.is_empty() {
            marks.push(Mark::line(colour, 2.2, points).named(format!("{name} (error {:.3})", score.ece)));
        }
    }
    let chart = Chart {
        title: "Reliability of P(lost)".into(),
        x: Axis::new("P(lost) as reported, mean of a bin").between(0.0, 1.0),
        y: Axis::new("share of frames lost").between(0.0, 1.0),
        marks,
    };
    render(&[chart], 1, [420.0, 330.0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plot_has_all_points() {
        let svg = plot(&[("nobody", &ConfidenceScore::of(&[]))]);
        assert!(svg.contains("<svg") && svg.contains("perfect") && !svg.contains("nobody"));
    }
}
