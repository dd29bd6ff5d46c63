//! One run over time, as in the paper's figures: the target's place, the gaze, the reward, and the class.
//!
//! [`Timeline`] is an observer that keeps a few numbers of each frame; [`Timeline::plot`] draws them as panels below each other.

use foveate::gaze::PolicySnapshot;
use foveate::geometry::{BBox, Gaze};
use foveate::lab::eval::metrics::centre_error;
use foveate::report::Observer;
use foveate::report::chart::{Axis, Chart, Mark, render};
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
        let last = match self.classes.iter().any(|c| !c.is_empty()) {
            true => self.class(),
            false => self.reward(),
        };
        render(&[self.place(title), self.look(), last], 1, [900.0, 270.0])
    }

    /// Returns the frames, counted from 1.
    fn numbers(&self) -> impl Iterator<Item = f64> {
        self.frames.iter().map(|t| (t + 1) as f64)
    }

    /// Plots the values of each frame.
    fn line(&self, of: impl Fn(usize) -> f64, colour: &'static str) -> Mark {
        Mark::line(colour, 2.0, self.numbers().enumerate().map(|(i, x)| (x, of(i))))
    }

    fn chart(&self, title: &str, y: Axis, marks: Vec<Mark>) -> Chart {
        let x = Axis::new("frame").between(0.0, self.numbers().last().unwrap_or(1.0));
        Chart { title: title.into(), x, y, marks }
    }

    fn place(&self, title: &str) -> Chart {
        let estimate = |i: usize| self.boxes[i].centre();
        let mut marks = vec![
            self.line(|i| estimate(i).0, COLOURS[4]).named("x"),
            self.line(|i| estimate(i).1, COLOURS[5]).named("y"),
        ];
        let truth: Option<Vec<_>> = self.frames.iter().map(|t| Some((*self.truth.get(*t)?)?.centre())).collect();
        if let Some(truth) = truth {
            marks.push(self.line(|i| truth[i].0, COLOURS[7]).dashed("8 4").named("true x, y"));
            marks.push(self.line(|i| truth[i].1, COLOURS[7]).dashed("8 4"));
        }
        self.chart(title, Axis::new("centre of the target, px"), marks)
    }

    fn look(&self) -> Chart {
        if self.arms.is_empty() {
            let marks = vec![
                self.line(|i| self.gazes[i].u, COLOURS[4]).named("u, across"),
                self.line(|i| self.gazes[i].v, COLOURS[5]).named("v, down"),
            ];
            return self.chart("Where it looked, in half boxes from the middle", Axis::new("gaze"), marks);
        }
        let names = |k: usize| {
            let Gaze { u, v, .. } = self.arms[k];
            if (u, v) == (0.0, 0.0) { "G5, the centre".to_owned() } else { format!("G{} ({u:+.2}, {v:+.2})", k + 1) }
        };
        let middle = |k: &usize| (self.arms[*k].u, self.arms[*k].v) != (0.0, 0.0);
        let mut order: Vec<usize> = (0..self.arms.len()).collect();
        order.sort_by_key(middle);
        self.stacked("The policy: probability of each gaze", &self.policy, &order, names)
    }

    fn class(&self) -> Chart {
        let n = self.classes.iter().map(Vec::len).max().unwrap_or(0);
        let last = self.classes.last();
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|a, b| last.map_or(std::cmp::Ordering::Equal, |p| p[*b].total_cmp(&p[*a])));
        let title = "What it is: probability of each class over all frames so far";
        self.stacked(title, &self.classes, &order, |k| k.to_string())
    }

    fn reward(&self) -> Chart {
        let mean = |i: usize| {
            let from = (i + 1).saturating_sub(WINDOW);
            self.rewards[from..=i].iter().sum::<f64>() / (i + 1 - from) as f64
        };
        let marks = vec![
            Mark::line(COLOURS[1], 1.0, self.numbers().zip(self.rewards.iter().copied())).named("each frame"),
            self.line(mean, COLOURS[4]).named("mean of 10"),
        ];
        self.chart("What the look was worth", Axis::new("reward").between(0.0, 1.0), marks)
    }

    /// Plots probabilities above each other.
    fn stacked(&self, title: &str, shares: &[Vec<f64>], order: &[usize], name: impl Fn(usize) -> String) -> Chart {
        let mut below = vec![0.0; shares.len()];
        let mut marks = vec![];
        for (i, &k) in order.iter().enumerate() {
            let above: Vec<f64> =
                shares.iter().zip(&below).map(|(p, low)| low + p.get(k).copied().unwrap_or(0.0)).collect();
            let edges = self.numbers().zip(&below).zip(&above).map(|((x, low), high)| (x, *low, *high));
            // The first class, which matters most, is blue.
            marks.push(Mark::band(COLOURS[(i + 4) % COLOURS.len()], 0.85, edges).named(name(k)));
            below = above;
        }
        self.chart(title, Axis::new("probability").between(0.0, 1.0), marks)
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
