//! How fast a policy learns where to look: the curve of the companion paper (Bazzani et al., ICML 2011, figure 4).
//!
//! The figure shows Hedge's probabilities over nine gazes as bars, at a few frames of one video of an eight. [`PAPER`] has the
//! probabilities of the centre. A [`Learning`] is the same curve of one tracker on one synthetic video, a [`Curve`] that of many videos.

use serde::{Deserialize, Serialize};

use foveate::Tracker;
use foveate::gaze::PolicySnapshot;
use foveate::geometry::BBox;
use foveate::lab::eval::experiment::{OFF, Run, quantile};
use foveate::lab::eval::metrics::{centre_error, mean_sd};
use foveate::lab::eval::table::aligned;
use foveate::lab::synthetic::Drawn;
use foveate::report::chart::{Axis, Chart, Mark, render};
use foveate::scene::Image;
use foveate::text::counted;
use foveate::video::Frame;
use foveate::{Error, Result};

/// Frame, counted from 1, and the probability of the centre gaze there: read off the bars of the companion paper's figure, to about ±0.03.
/// Its fourth bar is .93 and lies between frames 181 and 215.
pub(crate) const PAPER: [(usize, f64); 6] = [(20, 0.2), (69, 0.5), (142, 0.85), (181, 0.93), (215, 0.93), (260, 0.98)];

/// A run counts as on target if the centre error is above [`OFF`] in at most this share of its frames.
pub(crate) const OFF_SHARE: f64 = 0.05;

/// One tracker on one video, with the probability of the centre gaze over time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Learning {
    /// The track.
    pub run: Run,
    /// The centre gaze's probability after each frame from the second on.
    pub centre: Vec<f64>,
}

impl Learning {
    /// Follows a video's target from its true first box, with the template made according to `template`.
    ///
    /// # Errors
    /// The tracker refuses the first box, or its policy has no probability for the centre gaze.
    pub(crate) fn follow(video: &dyn Drawn, tracker: &mut Tracker, template: Template) -> Result<Self> {
        let mut learning = Self::default();
        for (index, truth) in video.truth().iter().enumerate() {
            let frame = Frame { index, time: index as f64 / 30.0, image: video.render(index) };
            if index == 0 {
                tracker.init(&template.of(frame, truth).image, *truth)?;
                continue;
            }
            let step = tracker.update(&frame.image)?;
            learning.run.errors.push(centre_error(&step.bbox, truth));
            learning.run.lost.push(!step.is_usable());
            let centre = centre(step.snapshot).ok_or_else(|| {
                Error::Config("a learning curve needs a policy with probabilities over gazes of which one is the centre, as hedge with an odd grid has".into())
            })?;
            learning.centre.push(centre);
        }
        Ok(learning)
    }
    /// Returns whether it can belong to a video with this number of frames.
    pub(crate) fn is_of(&self, frames: usize) -> bool {
        self.run.is_of(frames) && self.centre.len() == self.run.errors.len()
    }
    /// Returns whether the tracker followed the target: see [`OFF_SHARE`].
    pub(crate) fn on_target(&self) -> bool {
        let off = self.run.errors.iter().filter(|e| **e > OFF).count();
        off as f64 <= OFF_SHARE * self.run.errors.len() as f64
    }
}

/// The source of the target's template.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Template {
    /// The unchanged first frame.
    #[default]
    Frame,
    /// As in the authors' program: the box cut out, 3 × 3 median filtered, on black.
    Authors,
}

impl Template {
    /// Returns the first frame as the tracker receives it.
    fn of(self, frame: Frame, bbox: &BBox) -> Frame {
        match self {
            Self::Frame => frame,
            Self::Authors => Frame { image: cut_out(&frame.image, bbox), ..frame },
        }
    }
}

/// Returns a grey picture that is black outside the box; inside, each pixel is the median of its 3 × 3 neighbourhood, with 0 for pixels
/// outside the box.
fn cut_out(image: &Image, bbox: &BBox) -> Image {
    let side = |from: f64, long: f64, most: usize| {
        let end = (from + long).round().clamp(0.0, most as f64) as usize;
        (from.round().max(0.0) as usize).min(end)..end
    };
    let (columns, rows) = (side(bbox.x, bbox.w, image.width()), side(bbox.y, bbox.h, image.height()));
    let mut out = vec![0; image.width() * image.height()];
    for y in rows.clone() {
        for x in columns.clone() {
            let mut near = [0; 9];
            for (i, value) in near.iter_mut().enumerate() {
                let (x, y) = ((x + i % 3).wrapping_sub(1), (y + i / 3).wrapping_sub(1));
                if columns.contains(&x) && rows.contains(&y) {
                    *value = image.at(0, x, y);
                }
            }
            near.sort_unstable();
            out[y * image.width() + x] = near[4];
        }
    }
    Image::new(image.width(), image.height(), 1, out).expect("as many bytes as pixels")
}

fn centre(snapshot: PolicySnapshot<'_>) -> Option<f64> {
    let PolicySnapshot::Arms { gazes, probabilities } = snapshot else { return None };
    gazes.iter().position(|g| (g.u, g.v) == (0.0, 0.0)).map(|k| probabilities[k])
}

/// The statistics of many runs at one frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Point {
    /// The frame, counted from 1.
    pub frame: usize,
    /// Mean over the runs.
    pub mean: f64,
    /// Standard deviation over the runs.
    pub sd: f64,
    /// Minimum, 10 %, median, 90 % and maximum.
    pub quantiles: [f64; 5],
}

/// The curve of several runs of the same length.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Curve {
    /// Description of the runs.
    pub name: String,
    /// Number of runs.
    pub runs: usize,
    /// One point for each frame from the second on.
    pub points: Vec<Point>,
}

impl Curve {
    /// Computes the curve of the runs; `None` without a run.
    pub(crate) fn of(name: &str, runs: &[&Learning]) -> Option<Self> {
        let frames = runs.first()?.centre.len();
        let point = |i: usize| {
            let values: Vec<f64> = runs.iter().map(|run| run.centre[i]).collect();
            let (mean, sd) = mean_sd(&values);
            Point { frame: i + 2, mean, sd, quantiles: [0.0, 0.1, 0.5, 0.9, 1.0].map(|q| quantile(&values, q)) }
        };
        Some(Self { name: name.into(), runs: runs.len(), points: (0..frames).map(point).collect() })
    }
    /// Returns the paper's frames that the videos have, each with the paper's value.
    pub(crate) fn beside_paper(&self) -> impl Iterator<Item = (f64, &Point)> {
        PAPER.iter().filter_map(|(frame, p)| Some((*p, self.points.get(frame.checked_sub(2)?)?)))
    }
    /// Returns the root mean square difference of the median from the paper's values; NaN if there is none.
    pub(crate) fn distance(&self) -> f64 {
        let off: Vec<f64> = self.beside_paper().map(|(p, at)| (at.quantiles[2] - p).powi(2)).collect();
        (off.iter().sum::<f64>() / off.len() as f64).sqrt()
    }
}

/// Formats each curve at the paper's frames as aligned text.
pub(crate) fn text(curves: &[Curve]) -> String {
    let heads = ["runs of", "runs", "frame", "paper", "mean", "sd", "least", "10 %", "median", "90 %", "greatest", ""];
    let mut rows = vec![heads.map(String::from).to_vec()];
    for curve in curves {
        for (i, (paper, at)) in curve.beside_paper().enumerate() {
            let [least, low, median, high, greatest] = at.quantiles;
            let within = |from: f64, to: f64| (from..=to).contains(&paper);
            let verdict = match () {
                () if within(low, high) => "within 10-90 %",
                () if within(least, greatest) => "within the range",
                () => "outside",
            };
            let first = |text: String| if i == 0 { text } else { String::new() };
            let mut row = vec![first(curve.name.clone()), first(curve.runs.to_string()), at.frame.to_string()];
            row.extend([paper, at.mean, at.sd, least, low, median, high, greatest].map(|v| format!("{v:.2}")));
            row.push(verdict.into());
            rows.push(row);
        }
    }
    let distances: String = curves
        .iter()
        .map(|c| format!("{}: the median is {:.3} off the paper's values (root mean square)\n", c.name, c.distance()))
        .collect();
    format!(
        "{}\nProbability of the centre gaze after a frame, over runs. The paper's values are read off bars, to about 0.03.\n\
         on target: more than {OFF:.0} px off in at most {:.0} % of the frames.\n{distances}",
        aligned(&rows),
        100.0 * OFF_SHARE
    )
}

/// Plots a panel for each curve: median, the band from 10 to 90 %, the paper's points. Returns SVG text.
pub(crate) fn plot(curves: &[Curve]) -> String {
    let chart = |curve: &Curve| {
        let points = || curve.points.iter().map(|p| (p.frame as f64, p.quantiles));
        let paper = curve.beside_paper().map(|(p, at)| (at.frame as f64, p));
        let marks = vec![
            Mark::band("#0072B2", 0.2, points().map(|(x, q)| (x, q[1], q[3]))),
            Mark::line("#0072B2", 2.2, points().map(|(x, q)| (x, q[2]))).named("median, 10-90 %"),
            Mark::dots("#D55E00", 5.0, paper).named("the paper"),
        ];
        Chart {
            title: format!("{} ({})", curve.name, counted(curve.runs, "run")),
            x: Axis::new("frame").between(0.0, curve.points.last().map_or(1.0, |p| p.frame as f64)),
            y: Axis::new("probability of the centre gaze").between(0.0, 1.0),
            marks,
        }
    };
    render(&curves.iter().map(chart).collect::<Vec<_>>(), 2, [520.0, 400.0])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn learning(slope: f64, error: f64) -> Learning {
        let run = Run { errors: vec![error; 299], lost: vec![false; 299], seconds: 0.0 };
        Learning { run, centre: (0..299).map(|i| slope * i as f64 / 298.0).collect() }
    }

    #[test]
    fn curves_summed_up_by_hand() {
        let runs = [learning(0.0, 1.0), learning(0.5, 15.0), learning(1.0, 1.0)];
        assert!(runs[0].on_target() && !runs[1].on_target() && runs[0].is_of(300) && !runs[0].is_of(299));
        let curve = Curve::of("three", &runs.iter().collect::<Vec<_>>()).expect("three runs");
        let at = curve.points[149];
        assert_eq!((at.frame, at.mean), (151, 0.25));
        assert_eq!(at.quantiles, [0.0, 0.05, 0.25, 0.45, 0.5]);
        let frames: Vec<usize> = curve.beside_paper().map(|(_, at)| at.frame).collect();
        assert_eq!(frames, PAPER.map(|p| p.0));
        let exact = |p: usize| (PAPER[p].1 - 0.5 * (PAPER[p].0 - 2) as f64 / 298.0).powi(2);
        assert!((curve.distance() - ((0..6).map(exact).sum::<f64>() / 6.0).sqrt()).abs() < 1e-12);
        assert!(Curve::of("none", &[]).is_none());
        let said = text(std::slice::from_ref(&curve));
        assert!(said.contains("outside") && said.contains("0.513 off"), "{said}");
        let svg = plot(&[curve]);
        assert!(svg.contains("three (3 runs)") && svg.contains("probability of the centre gaze"));
    }

    #[test]
    fn the_authors_template_is_a_median_on_black() {
        let picture: Vec<u8> = (0..8 * 7).map(|i| if (i % 8, i / 8) == (4, 3) { 255 } else { 100 }).collect();
        let image = Image::new(8, 7, 1, picture).expect("8 x 7");
        let out = cut_out(&image, &BBox { x: 2.0, y: 1.0, w: 5.0, h: 5.0 });
        for (i, value) in out.plane(0).iter().enumerate() {
            let (x, y) = (i % 8, i / 8);
            let inside = (2..7).contains(&x) && (1..6).contains(&y);
            // A corner has five neighbours outside, so its median is black; the median removes the single bright pixel.
            let corner = [2, 6].contains(&x) && [1, 5].contains(&y);
            assert_eq!(*value, if inside && !corner { 100 } else { 0 }, "{x} {y}");
        }
        let far = cut_out(&image, &BBox { x: -9.0, y: 50.0, w: 3.0, h: 3.0 });
        assert!(far.plane(0).iter().all(|v| *v == 0));
    }

    #[test]
    fn short_videos_have_fewer_points() {
        let short = Learning { centre: vec![0.1; 30], ..Learning::default() };
        let curve = Curve::of("short", &[&short]).expect("one run");
        assert_eq!(curve.beside_paper().count(), 1);
        let tiny = Learning { centre: vec![0.1], ..Learning::default() };
        assert!(Curve::of("tiny", &[&tiny]).expect("one run").distance().is_nan());
    }
}
