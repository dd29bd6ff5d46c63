//! One run over time, as in the paper's figures: the target's place, the gaze, the reward, and the class.
//!
//! [`Timeline`] is an observer that keeps a few numbers of each frame; [`Timeline::plot`] draws them as panels below each other.

use kuva::plot::{LinePlot, StackedAreaPlot};
use kuva::prelude::{Figure, Layout, LegendPosition, Plot, SvgBackend, TickFormat};

use foveate::gaze::PolicySnapshot;
use foveate::geometry::{BBox, Gaze};
use foveate::lab::eval::metrics::centre_error;
use foveate::report::Observer;
use foveate::video::Frame;
use foveate::{Result, Seen};

/// Okabe and Ito's colours, which colour-blind people can distinguish, and two greys.
const COLOURS: [&str; 10] =
    ["#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7", "#000000", "#999999", "#5B5B5B"];
/// Frames over which rewards are averaged in the plot.
const WINDOW: usize = 10;

/// A run, frame by frame from the second on.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Timeline {
    /// The true boxes by index of the frame, if known.
    pub truth: Vec<Option<BBox>>,
    /// Indices of the frames.
    pub frames: Vec<usize>,
    /// The estimates.
    pub boxes: Vec<BBox>,
    /// The chosen gazes.
    pub gazes: Vec<Gaze>,
    /// Their rewards, 0 to 1.
    pub rewards: Vec<f64>,
    /// The policy's gazes; empty if it has no probabilities.
    pub arms: Vec<Gaze>,
    /// For each frame, the probabilities of the arms.
    pub policy: Vec<Vec<f64>>,
    /// For each frame, the probabilities of the classes over all frames so far; empty without a recogniser.
    pub classes: Vec<Vec<f64>>,
}

impl Timeline {
    /// Creates an empty timeline of a video with this truth.
    pub(crate) fn new(truth: Vec<Option<BBox>>) -> Self {
        Self { truth, ..Self::default() }
    }

    /// Returns the distances of the estimated centres from the true ones, pixels, in frames with known truth.
    pub(crate) fn errors(&self) -> Vec<f64> {
        let known = self.frames.iter().zip(&self.boxes);
        known.filter_map(|(&t, bbox)| Some(centre_error(bbox, self.truth.get(t)?.as_ref()?))).collect()
    }

    /// Plots panels below each other: place, gaze, reward, and class if there is one. Returns SVG text.
    pub(crate) fn plot(&self, title: &str) -> String {
        let mut panels = vec![self.place(title), self.look()];
        panels.push(match self.classes.iter().any(|c| !c.is_empty()) {
            true => self.class(),
            false => self.reward(),
        });
        let (plots, layouts): (Vec<_>, Vec<_>) = panels.into_iter().unzip();
        let figure = Figure::new(plots.len(), 1).with_plots(plots).with_layouts(layouts).with_cell_size(900.0, 270.0);
        SvgBackend::default().render_scene(&figure.render())
    }

    /// Plots the values of each frame against frames counted from 1.
    fn line(&self, of: impl Fn(usize) -> f64, colour: &str, name: &str) -> LinePlot {
        let points: Vec<(f64, f64)> = self.frames.iter().enumerate().map(|(i, &t)| ((t + 1) as f64, of(i))).collect();
        LinePlot::new().with_data(points).with_color(colour).with_stroke_width(2.0).with_legend(name)
    }

    fn layout(&self, plots: &[Plot], title: &str, y_label: &str) -> Layout {
        Layout::auto_from_plots(plots)
            .with_title(title)
            .with_x_label("frame")
            .with_y_label(y_label)
            .with_x_axis_min(0.0)
            .with_x_axis_max(self.frames.last().map_or(1.0, |t| (t + 1) as f64))
            .with_x_tick_format(TickFormat::Integer)
            .with_legend_position(LegendPosition::OutsideRightTop)
    }

    fn place(&self, title: &str) -> (Vec<Plot>, Layout) {
        let estimate = |i: usize| self.boxes[i].centre();
        let mut plots: Vec<Plot> = vec![
            self.line(|i| estimate(i).0, COLOURS[4], "x").into(),
            self.line(|i| estimate(i).1, COLOURS[5], "y").into(),
        ];
        let truth: Option<Vec<_>> = self.frames.iter().map(|t| Some((*self.truth.get(*t)?)?.centre())).collect();
        if let Some(truth) = truth {
            plots.push(self.line(|i| truth[i].0, COLOURS[7], "true x, y").with_dashed().into());
            plots.push(
                LinePlot { legend_label: None, ..self.line(|i| truth[i].1, COLOURS[7], "") }.with_dashed().into(),
            );
        }
        let layout = self.layout(&plots, title, "centre of the target, px");
        (plots, layout)
    }

    fn look(&self) -> (Vec<Plot>, Layout) {
        if self.arms.is_empty() {
            let plots: Vec<Plot> = vec![
                self.line(|i| self.gazes[i].u, COLOURS[4], "u, across").into(),
                self.line(|i| self.gazes[i].v, COLOURS[5], "v, down").into(),
            ];
            let layout = self.layout(&plots, "Where it looked, in half boxes from the middle", "gaze");
            return (plots, layout);
        }
        let names = |k: usize| {
            let Gaze { u, v, .. } = self.arms[k];
            if (u, v) == (0.0, 0.0) { "G5, the centre".to_owned() } else { format!("G{} ({u:+.2}, {v:+.2})", k + 1) }
        };
        let middle = |k: &usize| (self.arms[*k].u, self.arms[*k].v) != (0.0, 0.0);
        let mut order: Vec<usize> = (0..self.arms.len()).collect();
        order.sort_by_key(middle);
        let plot = self.stacked(&self.policy, &order, names);
        let plots: Vec<Plot> = vec![plot.into()];
        let layout = self.layout(&plots, "The policy: probability of each gaze", "probability");
        (plots, layout.with_y_axis_min(0.0).with_y_axis_max(1.0))
    }

    fn class(&self) -> (Vec<Plot>, Layout) {
        let n = self.classes.iter().map(Vec::len).max().unwrap_or(0);
        let last = self.classes.last();
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|a, b| last.map_or(std::cmp::Ordering::Equal, |p| p[*b].total_cmp(&p[*a])));
        let plots: Vec<Plot> = vec![self.stacked(&self.classes, &order, |k| k.to_string()).into()];
        let layout = self.layout(&plots, "What it is: probability of each class over all frames so far", "probability");
        (plots, layout.with_y_axis_min(0.0).with_y_axis_max(1.0))
    }

    fn reward(&self) -> (Vec<Plot>, Layout) {
        let mean = |i: usize| {
            let from = (i + 1).saturating_sub(WINDOW);
            self.rewards[from..=i].iter().sum::<f64>() / (i + 1 - from) as f64
        };
        let plots: Vec<Plot> = vec![
            self.line(|i| self.rewards[i], COLOURS[1], "each frame").with_stroke_width(1.0).into(),
            self.line(mean, COLOURS[4], "mean of 10").into(),
        ];
        let layout = self.layout(&plots, "What the look was worth", "reward");
        (plots, layout.with_y_axis_min(0.0))
    }

    fn stacked(&self, shares: &[Vec<f64>], order: &[usize], name: impl Fn(usize) -> String) -> StackedAreaPlot {
        let mut plot = StackedAreaPlot::new().with_x(self.frames.iter().map(|t| (t + 1) as f64));
        for (i, &k) in order.iter().enumerate() {
            // The first class, which matters most, is blue.
            let colour = COLOURS[(i + 4) % COLOURS.len()];
            let series = shares.iter().map(|p| p.get(k).copied().unwrap_or(0.0)).collect::<Vec<f64>>();
            plot = plot.with_series(series).with_color(colour).with_legend(name(k));
        }
        plot.with_fill_opacity(0.85)
    }
}

impl Observer for Timeline {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        let Some(seen) = targets.first().filter(|seen| !seen.is_given()) else { return Ok(()) };
        self.frames.push(frame.index);
        self.boxes.push(seen.bbox);
        self.gazes.push(seen.plan.chosen());
        self.rewards.push(seen.rewards[seen.plan.chosen_index()]);
        if let PolicySnapshot::Arms { gazes, probabilities } = seen.snapshot {
            self.arms = gazes.to_vec();
            self.policy.push(probabilities.to_vec());
        }
        self.classes.push(seen.classes.to_vec());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timeline(classes: usize) -> Timeline {
        let bbox = |x: f64| BBox { x, y: 0.0, w: 2.0, h: 2.0 };
        Timeline {
            truth: (0..5).map(|t| Some(bbox(t as f64))).collect(),
            frames: (1..5).collect(),
            boxes: (1..5).map(|t| bbox(t as f64 + 3.0)).collect(),
            gazes: vec![Gaze::CENTRE; 4],
            rewards: vec![0.5; 4],
            arms: vec![Gaze { u: -0.5, ..Gaze::CENTRE }, Gaze::CENTRE],
            policy: vec![vec![0.25, 0.75]; 4],
            classes: vec![vec![1.0 / classes as f64; classes]; 4],
        }
    }

    #[test]
    fn panels_are_drawn() {
        let whole = timeline(10);
        assert_eq!(whole.errors(), [3.0; 4]);
        let mut gap = whole.clone();
        gap.truth[2] = None;
        assert_eq!(gap.errors(), [3.0; 3]);
        assert!(whole.plot("all").contains("true x, y") && !gap.plot("some").contains("true x, y"));
        let svg = whole.plot("an <8>");
        assert!(svg.contains("G5, the centre") && svg.contains("probability of each class"), "{svg}");
        let plain = Timeline { arms: vec![], ..timeline(1) };
        let plain = Timeline { classes: vec![vec![]; 4], ..plain };
        let svg = plain.plot("a face");
        assert!(svg.contains("u, across") && svg.contains("reward") && !svg.contains("class"));
        assert!(Timeline::default().plot("nothing").contains("svg"));
    }
}
