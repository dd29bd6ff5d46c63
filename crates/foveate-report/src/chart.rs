//! Charts as SVG text: lines, points and areas over two axes with round ticks, and a legend below. [`crate::drawing`] gives one the colours
//! of a page.

use std::fmt::Write as _;

use crate::escape;

/// Font sizes of title, labels, and ticks and legend.
const SIZES: [f64; 3] = [16.0, 13.0, 12.0];
/// Estimated width of a letter relative to its font size; digits and most letters are narrower.
const LETTER: f64 = 0.7;
/// Least distance of the ticks of x and y.
const APART: [f64; 2] = [64.0, 36.0];
/// Height of a row of the legend, and length of its samples.
const ROW: f64 = 20.0;
const SAMPLE: f64 = 24.0;

/// Marks over two axes.
#[derive(Clone, Debug, Default)]
pub struct Chart {
    /// Above the axes.
    pub title: String,
    /// From left to right. If all values are whole, so are the ticks.
    pub x: Axis,
    /// From bottom to top.
    pub y: Axis,
    /// Later marks cover earlier ones.
    pub marks: Vec<Mark>,
}

/// An axis of a [`Chart`].
#[derive(Clone, Debug, Default)]
pub struct Axis {
    /// The quantity and its unit.
    pub label: String,
    /// Both ends: values beyond them are drawn at them. `None`: the ticks around all values.
    pub ends: Option<[f64; 2]>,
    /// Ticks with names in place of round numbers.
    pub names: Vec<(f64, String)>,
}

impl Axis {
    /// Creates an axis with this label.
    pub fn new(label: impl Into<String>) -> Self {
        Self { label: label.into(), ..Self::default() }
    }
    /// With fixed ends.
    pub fn between(self, low: f64, high: f64) -> Self {
        Self { ends: Some([low, high]), ..self }
    }
}

/// A line, points or an area of a [`Chart`].
#[derive(Clone, Debug)]
pub struct Mark {
    shape: Shape,
    colour: &'static str,
    points: Vec<(f64, f64)>,
    name: String,
}

#[derive(Clone, Copy, Debug)]
enum Shape {
    Line { width: f64, dash: &'static str },
    Dots { radius: f64 },
    Area { opacity: f64 },
}

impl Mark {
    /// Creates a line. A value that is not finite interrupts it.
    pub fn line(colour: &'static str, width: f64, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        Self::new(Shape::Line { width, dash: "none" }, colour, points)
    }
    /// Creates a dot at each point.
    pub fn dots(colour: &'static str, radius: f64, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        Self::new(Shape::Dots { radius }, colour, points)
    }
    /// Creates the area between two lines: x, low, high. It leaves out values that are not finite.
    pub fn band(colour: &'static str, opacity: f64, edges: impl IntoIterator<Item = (f64, f64, f64)>) -> Self {
        let are_finite = |(x, low, high): &(f64, f64, f64)| is_finite(&(*x, *low)) && is_finite(&(*x, *high));
        let edges: Vec<_> = edges.into_iter().filter(are_finite).collect();
        let low = edges.iter().map(|(x, low, _)| (*x, *low));
        let high = edges.iter().rev().map(|(x, _, high)| (*x, *high));
        Self::new(Shape::Area { opacity }, colour, low.chain(high))
    }
    fn new(shape: Shape, colour: &'static str, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        Self { shape, colour, points: points.into_iter().collect(), name: String::new() }
    }
    /// With a line's dashes: lengths of strokes and gaps, or "none".
    pub fn dashed(mut self, dashes: &'static str) -> Self {
        if let Shape::Line { dash, .. } = &mut self.shape {
            *dash = dashes;
        }
        self
    }
    /// With a name in the legend, which has the order of the marks. A mark without points is in the legend only.
    pub fn named(self, name: impl Into<String>) -> Self {
        Self { name: name.into(), ..self }
    }

    /// Draws the shape through points in pixels.
    fn draw(&self, svg: &mut String, points: &[(f64, f64)]) {
        let colour = self.colour;
        let _ = match self.shape {
            Shape::Line { width, dash } => writeln!(
                svg,
                "<path d=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-dasharray=\"{dash}\"/>",
                path(points)
            ),
            Shape::Area { opacity } => {
                writeln!(svg, "<path d=\"{}\" fill=\"{colour}\" fill-opacity=\"{opacity}\"/>", path(points))
            }
            Shape::Dots { radius } => points.iter().filter(|p| is_finite(p)).try_for_each(|(x, y)| {
                writeln!(svg, "<circle cx=\"{}\" cy=\"{}\" r=\"{radius}\" fill=\"{colour}\"/>", short(*x), short(*y))
            }),
        };
    }
}

/// Draws charts row by row in so many columns. Each gets a cell of this width and height; legends add to the height.
pub fn render(charts: &[Chart], columns: usize, [wide, tall]: [f64; 2]) -> String {
    let (mut body, mut top) = (String::new(), 0.0);
    for row in charts.chunks(columns) {
        let mut deepest = tall;
        for (i, chart) in row.iter().enumerate() {
            let (drawn, height) = chart.draw(wide, tall);
            let _ = writeln!(body, "<g transform=\"translate({},{top})\">\n{drawn}</g>", wide * i as f64);
            deepest = deepest.max(height);
        }
        top += deepest;
    }
    let width = wide * columns.min(charts.len()) as f64;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{top}\" font-family=\"DejaVu Sans, Verdana, Liberation Sans, Arial, sans-serif\" fill=\"black\"><rect width=\"100%\" height=\"100%\" fill=\"white\" />\n{body}</svg>\n"
    )
}

impl Chart {
    /// Returns the SVG text, and the height with the legend.
    fn draw(&self, wide: f64, tall: f64) -> (String, f64) {
        let mut svg = String::new();
        let (top, right) = (if self.title.is_empty() { 12.0 } else { 36.0 }, wide - 20.0);
        let bottom = tall - if self.x.label.is_empty() { 24.0 } else { 46.0 };
        let points = || self.marks.iter().flat_map(|mark| &mark.points).filter(|p| is_finite(p));
        let whole = points().all(|(x, _)| x.fract() == 0.0);
        let (y_ends, y_ticks) = self.y.ticks(points().map(|p| p.1), (bottom - top) / APART[1], false);
        let longest = y_ticks.iter().map(|(_, text)| width(text, SIZES[2])).fold(0.0, f64::max);
        let left = (longest + if self.y.label.is_empty() { 14.0 } else { 36.0 }).min(wide / 2.0);
        let (x_ends, x_ticks) = self.x.ticks(points().map(|p| p.0), (right - left) / APART[0], whole);
        let fraction = |value: f64, [low, high]: [f64; 2]| ((value - low) / (high - low)).clamp(0.0, 1.0);
        let x = |value| left + (right - left) * fraction(value, x_ends);
        let y = |value| bottom - (bottom - top) * fraction(value, y_ends);
        let (from, across, down) = (short(left), short(right - left), bottom - top);
        let _ = writeln!(
            svg,
            "<rect x=\"{from}\" y=\"{top}\" width=\"{across}\" height=\"{down}\" fill=\"none\" stroke=\"#cccccc\"/>"
        );
        for (value, name) in &x_ticks {
            let at = x(*value);
            let _ = write!(svg, "<path d=\"M{} {top}v{down}\" stroke=\"#cccccc\"/>", short(at));
            text(&mut svg, [at, bottom + 16.0], SIZES[2], APART[0].min(2.0 * (wide - at)), "middle", name);
        }
        for (value, name) in &y_ticks {
            let at = y(*value);
            let _ = write!(svg, "<path d=\"M{from} {}h{across}\" stroke=\"#cccccc\"/>", short(at));
            text(&mut svg, [left - 6.0, at + 4.0], SIZES[2], left - 8.0, "end", name);
        }
        let _ = writeln!(svg, "<path d=\"M{from} {top}v{down}h{across}\" fill=\"none\" stroke=\"#000000\"/>");
        text(&mut svg, [wide / 2.0, 24.0], SIZES[0], wide - 16.0, "middle", &self.title);
        text(&mut svg, [(left + right) / 2.0, bottom + 36.0], SIZES[1], right - left, "middle", &self.x.label);
        let _ = write!(svg, "<g transform=\"translate(18,{}) rotate(-90)\">", short((top + bottom) / 2.0));
        text(&mut svg, [0.0, 0.0], SIZES[1], bottom, "middle", &self.y.label);
        svg += "</g>\n";
        for mark in &self.marks {
            let place = |p: &(f64, f64)| if is_finite(p) { (x(p.0), y(p.1)) } else { (f64::NAN, f64::NAN) };
            mark.draw(&mut svg, &mark.points.iter().map(place).collect::<Vec<_>>());
        }
        let (mut at, mut row) = (left, tall + 4.0);
        for mark in self.marks.iter().filter(|mark| !mark.name.is_empty()) {
            let long = SAMPLE + 6.0 + width(&mark.name, SIZES[2]);
            if at > left && at + long > wide {
                (at, row) = (left, row + ROW);
            }
            let (end, y) = (at + SAMPLE, row + 4.0);
            let sample = match mark.shape {
                Shape::Line { .. } => vec![(at, y), (end, y)],
                Shape::Dots { .. } => vec![((at + end) / 2.0, y)],
                Shape::Area { .. } => vec![(at, y - 6.0), (end, y - 6.0), (end, y + 6.0), (at, y + 6.0)],
            };
            mark.draw(&mut svg, &sample);
            text(&mut svg, [end + 6.0, row + 8.0], SIZES[2], wide - end - 10.0, "start", &mark.name);
            at += long + 14.0;
        }
        (svg, if at > left { row + ROW } else { tall })
    }
}

impl Axis {
    /// Returns the ends and the ticks of an axis of these values: at most `most` steps of 1, 2 or 5 times a power of ten.
    fn ticks(&self, values: impl Iterator<Item = f64>, most: f64, whole: bool) -> ([f64; 2], Vec<(f64, String)>) {
        let ends = self.ends.filter(|ends| is_finite(&(ends[0], ends[1])));
        let [mut low, mut high] = ends.unwrap_or_else(|| {
            values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
        });
        if low > high {
            [low, high] = [0.0, 1.0];
        }
        let largest = low.abs().max(high.abs());
        if high - low <= 1e-12 * largest + 1e-100 {
            let room = f64::max(0.5, 1e-3 * largest);
            [low, high] = [low - room, high + room];
        }
        let least = (high - low) / most.max(1.0);
        let mut power = least.log10().floor() as i32;
        let scaled =
            |value: f64, power: i32| if power < 0 { value * 10_f64.powi(-power) } else { value / 10_f64.powi(power) };
        let mut digit = [1.0, 2.0, 5.0, 10.0].into_iter().find(|d| *d >= scaled(least, power) - 1e-9).unwrap_or(10.0);
        if whole && power < 0 {
            (digit, power) = (1.0, 0);
        } else if digit == 10.0 {
            (digit, power) = (1.0, power + 1);
        }
        let value = |k: f64| scaled(k * digit, -power);
        let [from, to] = [low, high].map(|end| scaled(end, power) / digit);
        // In spite of rounding errors, an end at a tick has that tick.
        let [first, last] = match ends {
            Some(_) => [(from - 1e-6).ceil(), (to + 1e-6).floor()],
            None => [(from + 1e-6).floor(), (to - 1e-6).ceil()],
        };
        let ends = if ends.is_some() { [low, high] } else { [first, last].map(value) };
        let ticks = (0..=(last - first) as usize).map(|i| value(first + i as f64));
        let ticks = ticks.map(|v| (v, number(v, power)));
        (ends, if self.names.is_empty() { ticks.collect() } else { self.names.clone() })
    }
}

/// Returns a tick's number to the digit of this power of ten; very large and very small ones with an exponent.
fn number(value: f64, power: i32) -> String {
    match power {
        -6..6 => format!("{value:.*}", power.min(0).unsigned_abs() as usize),
        _ if value == 0.0 => "0".to_owned(),
        _ => format!("{value:.*e}", (value.abs().log10().floor() as i32 - power).max(0) as usize),
    }
}

/// Writes text, in smaller letters if it is longer than the room.
fn text(svg: &mut String, [x, y]: [f64; 2], size: f64, room: f64, anchor: &str, text: &str) {
    let (x, y, size) = (short(x), short(y), short(size.min(size * room / width(text, size))));
    if !text.is_empty() {
        let text = escape(text);
        let _ = writeln!(svg, "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\" text-anchor=\"{anchor}\">{text}</text>");
    }
}

/// Estimates the width of text in letters of this size; those beyond ASCII may be square.
fn width(text: &str, size: f64) -> f64 {
    text.chars().map(|c| if c.is_ascii() { LETTER * size } else { size }).sum()
}

/// Returns the path through points. One that is not finite interrupts it.
fn path(points: &[(f64, f64)]) -> String {
    let (mut path, mut pen) = (String::new(), 'M');
    for point in points {
        if is_finite(point) {
            let _ = write!(path, "{pen}{} {}", short(point.0), short(point.1));
        }
        pen = if is_finite(point) { 'L' } else { 'M' };
    }
    path
}

/// Whether a point is finite, and far from the largest numbers: the ends of an axis are then so, too.
fn is_finite((x, y): &(f64, f64)) -> bool {
    x.abs() < 1e100 && y.abs() < 1e100
}

/// Rounds to a hundredth of a pixel.
fn short(value: f64) -> f64 {
    (100.0 * value).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ticks(values: &[f64], most: f64, whole: bool) -> (Vec<String>, [f64; 2]) {
        let (ends, ticks) = Axis::default().ticks(values.iter().copied(), most, whole);
        (ticks.into_iter().map(|t| t.1).collect(), ends)
    }

    #[test]
    fn ticks_are_round_and_around_the_values() {
        assert_eq!(
            ticks(&[0.0, 1.0], 8.6, false),
            (["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"].map(String::from).into(), [0.0, 1.0])
        );
        assert_eq!(
            ticks(&[-3.0, 41.0], 5.0, false),
            (["-10", "0", "10", "20", "30", "40", "50"].map(String::from).into(), [-10.0, 50.0])
        );
        assert_eq!(ticks(&[1.0, 4.0], 9.0, true).0, ["1", "2", "3", "4"], "no half frames");
        assert_eq!(ticks(&[0.0, 2.1e-8], 3.0, false).0, ["0", "1e-8", "2e-8", "3e-8"]);
        assert_eq!(ticks(&[1.0e9, 1.2e9], 4.0, false).0, ["1.00e9", "1.05e9", "1.10e9", "1.15e9", "1.20e9"]);
        assert_eq!(ticks(&[7.0], 2.0, false).1, [6.5, 7.5]);
        assert_eq!(ticks(&[], 2.0, false).1, [0.0, 1.0]);
        for extreme in [&[1e17][..], &[-1e99, 1e99], &[0.0, 1e-320], &[1e17, 1e17 + 16.0], &[-1e-90, 2e-90]] {
            let (texts, [low, high]) = ticks(extreme, 5.0, false);
            let inside = |v: &f64| (-1e-6..=1.0 + 1e-6).contains(&((v - low) / (high - low)));
            assert!((2..9).contains(&texts.len()) && low < high && extreme.iter().all(inside), "{texts:?}");
        }
        let fixed = Axis::new("frame").between(0.0, 37.0).ticks([900.0].into_iter(), 4.0, true);
        assert_eq!((fixed.0, fixed.1.len()), ([0.0, 37.0], 4), "0, 10, 20, 30");
    }

    #[test]
    fn a_chart_draws_its_marks() {
        let marks = vec![
            Mark::band("#0072B2", 0.2, [(0.0, 1.0, 2.0), (9.0, 0.0, 3.0)]),
            Mark::line("#0072B2", 2.0, [(0.0, 1.5), (1.0, f64::NAN), (2.0, 1.0), (9.0, 1.5)])
                .dashed("9 4")
                .named("a<b"),
            Mark::dots("#D55E00", 3.0, [(4.0, 2.0), (5.0, f64::INFINITY)]).named("dots"),
        ];
        let chart = Chart { title: "T & U".into(), x: Axis::new("frame"), y: Axis::new("y (px)"), marks };
        let svg = render(&[chart.clone(), chart.clone(), chart], 2, [400.0, 300.0]);
        assert!(
            svg.starts_with("<svg") && svg.contains("width=\"800\" height=\"648\""),
            "two rows, with a legend each"
        );
        for part in ["T &amp; U", ">a&lt;b<", "frame", "y (px)", "stroke-dasharray=\"9 4\"", "fill-opacity=\"0.2\""] {
            assert_eq!(svg.matches(part).count() % 3, 0, "{part}");
            assert!(svg.contains(part), "{part}");
        }
        assert_eq!(svg.matches("<circle").count(), 6, "a point and a sample in each");
        assert!(!svg.contains("NaN") && !svg.contains("inf") && !svg.contains("a<b"));
        assert!(render(&[Chart::default()], 1, [300.0, 200.0]).contains(">1.0<"), "nothing to draw");
    }

    #[test]
    fn long_texts_and_many_names_fit() {
        let marks = (0..30).map(|i| Mark::line("#000000", 1.0, [(0.0, 0.0), (1.0, 1.0)]).named(format!("tracker {i}")));
        let names = vec![(0.0, "a name of a row that is far too long".repeat(3)), (1.0, "b".into())];
        let chart = Chart {
            title: "title ".repeat(40),
            marks: marks.collect(),
            y: Axis { names, ..Axis::default() },
            ..Chart::default()
        };
        let svg = render(&[chart], 1, [400.0, 300.0]);
        let number = |text: &str, name: &str| -> f64 {
            let value = text.split_once(&format!(" {name}=\"")).and_then(|(_, rest)| rest.split('"').next());
            value.and_then(|value| value.parse().ok()).expect(name)
        };
        let tall = number(&svg, "height");
        for element in svg.split("<text").skip(1) {
            let (_, content) = element.split_once('>').expect("text");
            let long = width(content.split('<').next().expect("its end"), number(element, "font-size"));
            let x = number(element, "x");
            let [from, to] = match () {
                () if element.contains("middle") => [x - long / 2.0, x + long / 2.0],
                () if element.contains("end") => [x - long, x],
                () => [x, x + long],
            };
            assert!(from >= 0.0 && to <= 400.0 && number(element, "y") < tall - 4.0, "{element}");
        }
    }
}
