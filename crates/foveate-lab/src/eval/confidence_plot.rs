//! The reliability curve: the fraction of lost frames against the reported P(lost).

use kuva::plot::{LegendPosition, LinePlot};
use kuva::prelude::{Figure, Layout, LineStyle, Plot, SvgBackend, TickFormat};

use super::confidence::ConfidenceScore;

const COLOURS: [&str; 4] = ["#0072B2", "#D55E00", "#009E73", "#CC79A7"];

/// Plots curves side by side, as SVG text; perfect calibration is the diagonal. Bins of fewer than 20 frames are left out.
pub fn plot(scores: &[(&str, &ConfidenceScore)]) -> String {
    let line = |points: Vec<(f64, f64)>, colour: &str, style: LineStyle, name: String| -> Plot {
        let plot = LinePlot::new().with_data(points).with_color(colour).with_line_style(style);
        plot.with_stroke_width(2.2).with_legend(name).into()
    };
    let dashed = LineStyle::Custom("3 4".into());
    let mut lines = vec![line(vec![(0.0, 0.0), (1.0, 1.0)], "#888888", dashed, "perfect".into())];
    for (i, (name, score)) in scores.iter().enumerate() {
        let bins = score.bins.iter().filter(|b| b.count >= 20);
        let points: Vec<(f64, f64)> = bins.map(|b| (b.confidence, b.accuracy)).collect();
        if !points.is_empty() {
            let name = format!("{name} (error {:.3})", score.ece);
            lines.push(line(points, COLOURS[i % COLOURS.len()], LineStyle::Solid, name));
        }
    }
    let layout = Layout::auto_from_plots(&lines)
        .with_title("Reliability of P(lost)")
        .with_x_label("P(lost) as reported, mean of a bin")
        .with_y_label("share of frames lost")
        .with_x_axis_min(0.0)
        .with_x_axis_max(1.0)
        .with_y_axis_min(0.0)
        .with_y_axis_max(1.0)
        .with_x_tick_step(0.2)
        .with_y_tick_step(0.2)
        .with_x_tick_format(TickFormat::Fixed(1))
        .with_y_tick_format(TickFormat::Fixed(1))
        .with_legend_box(false)
        .with_legend_position(LegendPosition::OutsideBottomLeft);
    let figure = Figure::new(1, 1)
        .with_plots(vec![lines])
        .with_layouts(vec![layout])
        .with_cell_size(420.0, 330.0 + 22.0 * (scores.len() + 1) as f64);
    SvgBackend::default().render_scene(&figure.render())
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
