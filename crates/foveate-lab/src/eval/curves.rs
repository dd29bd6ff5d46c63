//! Success and precision curves, and their plot.
//!
//! Success at threshold θ is the fraction of frames with an IoU above θ; precision at d is the fraction with a centre error of at most d
//! pixels (Wu, Lim and Yang 2013).

use foveate_base::text::visible;
use foveate_report::chart::{Axis, Chart, Mark, render};
use serde::Serialize;

/// Number of IoU thresholds: 0, 0.05 ... 1.
pub const N_IOU: usize = 21;
/// Number of centre error thresholds: 0, 1 ... 50 pixels.
pub const N_PIXELS: usize = 51;
/// The centre error of the quoted precision, pixels.
pub const QUOTED: usize = 20;

/// Both curves of a track, or their mean over tracks; fractions from 0 to 1.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curves {
    /// By IoU threshold, [`N_IOU`] values.
    pub success: Vec<f64>,
    /// By centre error threshold, [`N_PIXELS`] values.
    pub precision: Vec<f64>,
}

impl Curves {
    /// Computes the curves of frames with these overlaps (0 to 1) and centre errors (pixels, infinite without a box). All zero without a
    /// frame.
    pub fn of(overlaps: &[f64], errors: &[f64]) -> Self {
        let share = |hits: usize, of: usize| hits as f64 / of.max(1) as f64;
        let above = |i| overlaps.iter().filter(|&&o| o > iou_threshold(i)).count();
        let within = |i| errors.iter().filter(|&&e| e <= i as f64).count();
        Self {
            success: (0..N_IOU).map(|i| share(above(i), overlaps.len())).collect(),
            precision: (0..N_PIXELS).map(|i| share(within(i), errors.len())).collect(),
        }
    }
    /// Returns the mean of curves, with equal weights; all zero without one.
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
    /// Returns one standard deviation below and above the mean of curves (n − 1 in the denominator), within 0 and 1; `None` with fewer than
    /// two.
    pub fn band(all: &[Self]) -> Option<[Self; 2]> {
        let (mean, n) = (Self::mean(all.iter()), all.len() as f64);
        let edge = |sign: f64, of: &dyn Fn(&Self) -> &Vec<f64>| -> Vec<f64> {
            let at = |(i, m): (usize, &f64)| {
                let variance = all.iter().map(|c| (of(c)[i] - m).powi(2)).sum::<f64>() / (n - 1.0);
                (m + sign * variance.sqrt()).clamp(0.0, 1.0)
            };
            of(&mean).iter().enumerate().map(at).collect()
        };
        let side = |sign| Self { success: edge(sign, &|c| &c.success), precision: edge(sign, &|c| &c.precision) };
        (n > 1.0).then(|| [side(-1.0), side(1.0)])
    }
    /// Returns the area under the success curve: the mean of its 21 values, as in the toolkits.
    pub fn auc(&self) -> f64 {
        self.success.iter().sum::<f64>() / N_IOU as f64
    }
}

/// Returns threshold `i` of NumPy's linspace(0, 1, 21), to the last bit.
fn iou_threshold(i: usize) -> f64 {
    if i + 1 == N_IOU { 1.0 } else { i as f64 * (1.0 / (N_IOU - 1) as f64) }
}

/// Okabe and Ito's colours, which colour-blind people can distinguish; line styles distinguish them in grey.
const COLOURS: [&str; 7] = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"];
const DASHES: [&str; 4] = ["none", "9 4", "2 3", "9 3 2 3"];

/// A tracker in the plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawn<'a> {
    /// The name.
    pub name: &'a str,
    /// The mean curves.
    pub mean: Curves,
    /// The band around them, low and high: [`Curves::band`] over seeds.
    pub band: Option<[Curves; 2]>,
}

/// Draws success and precision plots of trackers side by side, as SVG text. Each legend lists the best first. With several trackers, the
/// first given is drawn above the others, with a line twice as wide.
pub fn plot(trackers: &[Drawn<'_>]) -> String {
    render(&PANELS.map(|panel| panel.draw(trackers)), 2, [560.0, 430.0])
}

/// Draws the two plots separately, each with its description; narrow enough for a phone.
pub fn panels(trackers: &[Drawn<'_>]) -> [(&'static str, String); 2] {
    PANELS.map(|panel| (panel.title, render(&[panel.draw(trackers)], 1, [420.0, 330.0])))
}

/// Success and precision.
const PANELS: [Panel; 2] = [
    Panel {
        title: "Success, and its mean (AUC)",
        x_label: "IoU above",
        x: iou_threshold,
        end: 1.0,
        values: |c| &c.success,
        quoted: Curves::auc,
    },
    Panel {
        title: "Precision, and its value at 20 px",
        x_label: "centre error at most, pixels",
        x: |i| i as f64,
        end: 50.0,
        values: |c| &c.precision,
        quoted: |c| c.precision[QUOTED],
    },
];

/// One of the two plots.
struct Panel {
    title: &'static str,
    x_label: &'static str,
    x: fn(usize) -> f64,
    /// The end of the x axis.
    end: f64,
    values: fn(&Curves) -> &Vec<f64>,
    quoted: fn(&Curves) -> f64,
}

impl Panel {
    fn draw(&self, trackers: &[Drawn<'_>]) -> Chart {
        let mut order: Vec<(usize, f64)> = trackers.iter().map(|t| (self.quoted)(&t.mean)).enumerate().collect();
        order.sort_by(|a, b| b.1.total_cmp(&a.1));
        let entry =
            |(i, quoted): (usize, f64)| self.line(i, &[]).named(format!("{} {quoted:.3}", visible(trackers[i].name)));
        let mut marks: Vec<Mark> = order.into_iter().map(entry).collect();
        // Later lines cover earlier ones, so the first tracker is drawn last.
        for (i, tracker) in trackers.iter().enumerate().rev() {
            if let Some([low, high]) = &tracker.band {
                let edges = (self.values)(low).iter().zip((self.values)(high)).enumerate();
                marks.push(Mark::band(colour(i), 0.2, edges.map(|(k, (low, high))| ((self.x)(k), *low, *high))));
            }
            marks.push(self.line(i, (self.values)(&tracker.mean)));
        }
        Chart {
            title: self.title.into(),
            x: Axis::new(self.x_label).between(0.0, self.end),
            y: Axis::new("share of frames").between(0.0, 1.0),
            marks,
        }
    }

    fn line(&self, i: usize, values: &[f64]) -> Mark {
        let points = values.iter().enumerate().map(|(k, y)| ((self.x)(k), *y));
        Mark::line(colour(i), if i == 0 { 3.6 } else { 1.8 }, points).dashed(DASHES[i % DASHES.len()])
    }
}

/// The colour of a tracker.
fn colour(i: usize) -> &'static str {
    COLOURS[i % COLOURS.len()]
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
    fn the_band_is_a_deviation_wide() {
        let with = |v: f64| Curves { success: vec![v; N_IOU], precision: vec![1.0; N_PIXELS] };
        let [low, high] = Curves::band(&[with(0.2), with(0.4), with(0.6)]).expect("three seeds");
        assert!((low.success[3] - 0.2).abs() < 1e-12 && (high.success[3] - 0.6).abs() < 1e-12);
        assert_eq!((low.precision[0], high.precision[50]), (1.0, 1.0));
        assert_eq!((Curves::band(&[with(0.2)]), Curves::band(&[])), (None, None));
    }

    #[test]
    fn the_plot_names_trackers_and_keeps_markup_out() {
        let c = Curves::of(&[0.7], &[3.0]);
        let drawn =
            |name| Drawn { name, mean: c.clone(), band: Curves::band(&[c.clone(), Curves::of(&[0.2], &[9.0])]) };
        let svg = plot(&[drawn("a<b"), Drawn { band: None, ..drawn("other") }]);
        assert!(svg.starts_with("<svg") || svg.starts_with("<?xml"));
        assert!(svg.contains("a&lt;b 0.667") && svg.contains("other 1.000") && !svg.contains("a<b"));
    }

    /// No legend covers the curves: all legends are below the axes, in both plots together and in each alone.
    #[test]
    fn legends_lie_below_the_curves() {
        let names = ["foveate", "another tracker", "a tracker with a rather long name", "d", "e"];
        let drawn = names.map(|name| Drawn { name, mean: Curves::of(&[0.7, 0.1], &[3.0, 40.0]), band: None });
        let number = |text: &str, name: &str| -> f64 {
            let value = text.split_once(&format!(" {name}=\"")).and_then(|(_, rest)| rest.split('"').next());
            value.and_then(|value| value.parse().ok()).expect(name)
        };
        for svg in panels(&drawn).map(|(_, svg)| svg).into_iter().chain([plot(&drawn)]) {
            let axes = svg.split("<rect").nth(2).expect("the region of the curves, after the ground");
            let bottom = number(axes, "y") + number(axes, "height");
            for name in names {
                let entries: Vec<usize> = svg.match_indices(&format!(">{name} ")).map(|(at, _)| at).collect();
                assert!(!entries.is_empty(), "{name}");
                for at in entries {
                    let text = &svg[svg[..at].rfind("<text").expect("its element")..];
                    assert!(number(text, "y") > bottom, "{name} lies on the curves: {}", &text[..80]);
                }
            }
        }
    }
}
