//! measure.html: results, motion over time, residuals.

use foveate_report::chart::{Axis, Chart, Mark, render};
use foveate_report::{card, document, drawing, escape};

use super::measurement::{Measurement, Row};
use super::requested::{AXES, Fit, Value};
use super::units::unit;

/// The colours of x and y, and of curves.
const INKS: [&str; 2] = ["#0072B2", "#D55E00"];
const CURVE: &str = "#000000";
/// The size of a chart.
const SIZE: [f64; 2] = [640.0, 360.0];
/// Most points of a chart; longer tracks show every n-th frame.
const MOST: usize = 2000;

/// Returns the page of a measurement. `source` is the name of the video.
pub(super) fn page(source: &str, points: &[Measurement]) -> String {
    let first = match points {
        [point] => point.text().swap_remove(0),
        _ => format!("{} points, {} frames.", points.len(), points[0].rows.len()),
    };
    let body: String = points.iter().map(|point| cards(point, points.len() > 1)).collect();
    document(&format!("Measurement of {source}"), &escape(&first), "", &body)
}

/// Returns the cards of a point; among several, their titles have its name.
fn cards(measured: &Measurement, named: bool) -> String {
    let title = |title: &str| match named {
        true => format!("{}: {title}", measured.point),
        false => title.to_owned(),
    };
    let results = match &measured.fits[..] {
        [] => "<p>No fit. Add one with --fit, such as --fit parabola:y.</p>\n".to_owned(),
        fits => fits.iter().map(table).collect(),
    };
    let notes: String = measured.all_notes().map(|note| format!("<p>{}</p>\n", escape(note))).collect();
    let quantities = ["Position", "Velocity", "Acceleration"];
    let motion: String = (0..3)
        .flat_map(|i| (0..2).map(move |axis| (i, axis)))
        .map(|(i, axis)| {
            let name = format!("{} {}", quantities[i], AXES[axis]);
            scrolled(&motion(measured, i, axis, &name), &format!("{name} over time with its 95 % band"))
        })
        .collect();
    let fits: String =
        measured.fits.iter().map(|fit| card(&title(&format!("Fit {}", fit.fit)), &charts(fit))).collect();
    let [scale, clock] = measured.relative.map(|error| 100.0 * error);
    let method = format!(
        "<p>Positions, velocities and accelerations come from all frames (Rauch-Tung-Striebel smoother, white jerk). Bands are 95 %. \
         Errors of the tracked positions are {:.2} (x) and {:.2} (y) times the reported ones, with a correlation of {} and {} from frame to \
         frame. The scale has an error of {scale:.2} %, the clock of {clock:.2} %: both are in the errors of the fits, not in the bands.</p>\n",
        measured.smoothing[0].noise,
        measured.smoothing[1].noise,
        measured.smoothing[0].correlation,
        measured.smoothing[1].correlation,
    );
    let motion = card(&title("Motion"), &motion);
    [card(&title("Results"), &(results + &notes)), fits, motion, card(&title("Method"), &method)].concat()
}

fn scrolled(svg: &str, label: &str) -> String {
    format!("<div class=\"scroll\">{}</div>\n", drawing(svg, label))
}

fn table(fit: &Fit) -> String {
    let row = |value: &Value| {
        let text = value.text();
        let (name, rest) = text.split_once(" = ").expect("a value has a name");
        format!("<tr><td class=\"words\">{}</td><td class=\"words\">{}</td></tr>\n", escape(name), escape(rest))
    };
    let rows: String = fit.values.iter().map(row).collect();
    let head = format!("{}: {}", fit.fit, fit.formula);
    let from = format!("t from {:.4} s, {} points", fit.t0, fit.points);
    format!(
        "<div class=\"scroll\"><table>\n<tr><th>{}</th><th>{}</th></tr>\n{rows}</table></div>\n",
        escape(&head),
        escape(&from)
    )
}

/// Draws one quantity of one coordinate over time with its 95 % band, and the tracked positions.
fn motion(measured: &Measurement, i: usize, axis: usize, name: &str) -> String {
    let every = measured.rows.len().div_ceil(MOST);
    let rows = || measured.rows.iter().step_by(every);
    let edges = |row: &Row| {
        let (value, off) = (row.smoothed[axis].value[i], 1.96 * row.smoothed[axis].sd[i]);
        (row.time, value - off, value + off)
    };
    let line = rows().map(|row| (row.time, row.smoothed[axis].value[i]));
    let mut marks = vec![Mark::band(INKS[axis], 0.2, rows().map(edges)), Mark::line(INKS[axis], 1.5, line)];
    if i == 0 {
        let tracked = rows().filter_map(|row| Some((row.time, row.measured?[axis])));
        marks.push(Mark::dots(CURVE, 1.5, tracked));
    }
    let symbol = format!("{}{} ({})", ["", "v", "a"][i], AXES[axis], unit(measured.unit, (1, -(i as i32))));
    chart(marks, name, &symbol)
}

/// Draws a fit over its points, and the residuals.
fn charts(fit: &Fit) -> String {
    let (axis, every) = (fit.curve.0, fit.data.len().div_ceil(MOST));
    let points = || fit.data.iter().step_by(every);
    let dots = |of: fn(&(f64, f64, f64)) -> (f64, f64)| Mark::dots(INKS[axis], 2.0, points().map(of));
    let ends = fit.data.first().map_or(0.0, |p| p.0)..fit.data.last().map_or(0.0, |p| p.0);
    let span = ends.end - ends.start;
    let steps = fit.steps(span);
    let times = (0..=steps).map(|k| ends.start + span * k as f64 / steps as f64);
    let curve = Mark::line(CURVE, 1.5, times.map(|t| (t, fit.at(t))));
    let zero = Mark::line(CURVE, 1.0, [(ends.start, 0.0), (ends.end, 0.0)]);
    let label = format!("{} ({})", AXES[axis], fit.unit);
    let data = chart(vec![curve, dots(|p| (p.0, p.1))], &fit.fit, &label);
    let rest = format!("residual ({})", fit.unit);
    let residuals = chart(vec![zero, dots(|p| (p.0, p.2))], "Residuals", &rest);
    scrolled(&data, "Data and fitted curve") + &scrolled(&residuals, "Residuals: data minus curve")
}

fn chart(marks: Vec<Mark>, title: &str, y_label: &str) -> String {
    render(&[Chart { title: title.into(), x: Axis::new("t (s)"), y: Axis::new(y_label), marks }], 1, SIZE)
}

#[cfg(test)]
mod tests {
    use super::super::measurement::Settings;
    use super::super::measurement::tests::{falling, measured};
    use super::super::models::Curve;
    use super::super::requested::FitRequest;
    use super::*;

    #[test]
    fn a_page_has_results_and_charts() {
        let fits = vec![FitRequest { curve: Curve::Parabola, axis: 1, range: None }];
        let measured = measured(&falling(0.0), None, &Settings { fits, ..Settings::default() }).expect("a measurement");
        let page = page("a<b.mp4", &[measured]);
        assert_eq!(
            page.matches("class=\"drawing\"").count(),
            8,
            "three quantities of two coordinates, data, residuals"
        );
        for part in ["Measurement of a&lt;b.mp4", "px/s²", "Residuals", "t (s)", "prefers-color-scheme: dark"] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("a<b") && !page.contains("NaN"));
    }
}
