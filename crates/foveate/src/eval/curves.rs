//! Success and precision curves, and their plot.
//!
//! Success at threshold θ is the share of frames whose IoU is above θ; precision at d is the share
//! whose centre error is at most d pixels (Wu, Lim and Yang 2013).

use kuva::plot::{LegendPosition, LinePlot};
use kuva::prelude::{Figure, Layout, LineStyle, Plot, SvgBackend, TickFormat};
use serde::Serialize;

/// Number of IoU thresholds: 0, 0.05 ... 1.
pub const N_IOU: usize = 21;
/// Number of centre error thresholds: 0, 1 ... 50 pixels.
pub const N_PIXELS: usize = 51;
/// The centre error, in pixels, at which precision is quoted.
pub const QUOTED: usize = 20;

/// Both curves of a track, or their mean over tracks; shares from 0 to 1.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curves {
    /// By IoU threshold, [`N_IOU`] values.
    pub success: Vec<f64>,
    /// By centre error threshold, [`N_PIXELS`] values.
    pub precision: Vec<f64>,
}

impl Curves {
    /// The curves of frames with these overlaps (0 to 1) and centre errors (pixels, infinite where there is no box).
    /// All zero without a frame.
    pub fn of(overlaps: &[f64], errors: &[f64]) -> Self {
        let share = |hits: usize, of: usize| hits as f64 / of.max(1) as f64;
        let above = |i| overlaps.iter().filter(|&&o| o > iou_threshold(i)).count();
        let within = |i| errors.iter().filter(|&&e| e <= i as f64).count();
        Self {
            success: (0..N_IOU).map(|i| share(above(i), overlaps.len())).collect(),
            precision: (0..N_PIXELS).map(|i| share(within(i), errors.len())).collect(),
        }
    }
    /// The mean of curves, every one counting alike; all zero without one.
    pub fn mean<'a>(all: impl Iterator<Item = &'a Self>) -> Self {
        let mut sum = Self { success: vec![0.0; N_IOU], precision: vec![0.0; N_PIXELS] };
        let mut n = 0.0;
        for curves in all {
            n += 1.0;
            sum.success.iter_mut().zip(&curves.success).for_each(|(s, v)| *s += v);
            sum.precision.iter_mut().zip(&curves.precision).for_each(|(s, v)| *s += v);
        }
        let scale = 1.0 / f64::max(n, 1.0);
        sum.success.iter_mut().chain(&mut sum.precision).for_each(|v| *v *= scale);
        sum
    }
    /// Area under the success curve: the mean of its 21 values, as the toolkits take it.
    pub fn auc(&self) -> f64 {
        self.success.iter().sum::<f64>() / N_IOU as f64
    }
}

/// Threshold `i` as NumPy's linspace(0, 1, 21) has it, to the last bit.
fn iou_threshold(i: usize) -> f64 {
    if i + 1 == N_IOU { 1.0 } else { i as f64 * (1.0 / (N_IOU - 1) as f64) }
}

/// Okabe and Ito's colours, told apart by colour-blind people; with a line style each, also in grey.
const COLOURS: [&str; 7] = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"];
const DASHES: [&str; 4] = ["", "9 4", "2 3", "9 3 2 3"];

/// Success and precision plots of trackers side by side, as SVG text; the best comes first in each legend.
pub fn plot(trackers: &[(&str, &Curves)]) -> String {
    let panel = |title: &str, x_label: &str, x: &dyn Fn(usize) -> f64, values: &dyn Fn(&Curves) -> (Vec<f64>, f64)| {
        let mut lines: Vec<_> = (0..trackers.len()).map(|i| (i, values(trackers[i].1))).collect();
        lines.sort_by(|a, b| b.1.1.total_cmp(&a.1.1));
        let lines: Vec<Plot> =
            lines.into_iter().map(|(i, (curve, quoted))| line(i, trackers[i].0, curve, quoted, x)).collect();
        let layout = Layout::auto_from_plots(&lines)
            .with_title(title)
            .with_x_label(x_label)
            .with_y_label("share of frames")
            .with_x_axis_min(0.0)
            .with_y_axis_min(0.0)
            .with_y_axis_max(1.0)
            .with_y_tick_step(0.2)
            .with_y_tick_format(TickFormat::Fixed(1))
            .with_legend_box(true);
        (lines, layout)
    };
    let (success, success_layout) =
        panel("Success, and its mean (AUC)", "IoU above", &iou_threshold, &|c| (c.success.clone(), c.auc()));
    let (precision, precision_layout) =
        panel("Precision, and its value at 20 px", "centre error at most, pixels", &|i| i as f64, &|c| {
            (c.precision.clone(), c.precision[QUOTED])
        });
    let layouts = vec![
        success_layout
            .with_legend_position(LegendPosition::InsideTopRight)
            .with_x_axis_max(1.0)
            .with_x_tick_step(0.2)
            .with_x_tick_format(TickFormat::Fixed(1)),
        precision_layout
            .with_legend_position(LegendPosition::InsideBottomRight)
            .with_x_axis_max(50.0)
            .with_x_tick_step(10.0)
            .with_x_tick_format(TickFormat::Integer),
    ];
    let figure =
        Figure::new(1, 2).with_plots(vec![success, precision]).with_layouts(layouts).with_cell_size(560.0, 430.0);
    SvgBackend::default().render_scene(&figure.render())
}

fn line(i: usize, name: &str, curve: Vec<f64>, quoted: f64, x: &dyn Fn(usize) -> f64) -> Plot {
    let dash = DASHES[i % DASHES.len()];
    let style = if dash.is_empty() { LineStyle::Solid } else { LineStyle::Custom(dash.into()) };
    let points: Vec<_> = curve.into_iter().enumerate().map(|(k, y)| (x(k), y)).collect();
    LinePlot::new()
        .with_data(points)
        .with_color(COLOURS[i % COLOURS.len()])
        .with_line_style(style)
        .with_stroke_width(2.2)
        .with_legend(format!("{name} {quoted:.3}"))
        .into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_are_strict_for_overlap_and_not_for_pixels() {
        let c = Curves::of(&[0.0, 0.05, 0.5, 1.0], &[0.0, 20.0, 20.5, f64::INFINITY]);
        assert_eq!((c.success[0], c.success[1], c.success[10], c.success[20]), (0.75, 0.5, 0.25, 0.0));
        assert_eq!((c.precision[0], c.precision[20], c.precision[21], c.precision[50]), (0.25, 0.5, 0.75, 0.75));
        let mean = Curves::mean([&c, &Curves::of(&[1.0], &[0.0])].into_iter());
        assert_eq!((mean.success[10], mean.precision[0]), (0.625, 0.625));
        assert_eq!(Curves::of(&[], &[]).auc(), 0.0);
    }

    #[test]
    fn the_plot_names_trackers_and_keeps_markup_out() {
        let c = Curves::of(&[0.7], &[3.0]);
        let svg = plot(&[("a<b", &c), ("other", &c)]);
        assert!(svg.starts_with("<svg") || svg.starts_with("<?xml"));
        assert!(svg.contains("a&lt;b 0.667") && svg.contains("other 1.000") && !svg.contains("a<b"));
    }
}
