//! measure.csv, ask.csv, fits.json, and the lines on the terminal.

use std::fmt::Write as _;
use std::path::Path;

use foveate_report::quoted;

use super::ask;
use super::measurement::Measurement;
use super::requested::{AXES, Fit};
use super::smooth::{Smoothed, median};
use super::trk::trk;
use super::units::unit;

/// Returns measure.csv, fits.json, ask.csv and measure.trk of at least one point, with their names. measure.trk is in pixels of the video,
/// whose pictures were tracked at this scale, and names `video` if it is a file.
pub fn tables(video: Option<&Path>, scale: f64, points: &[Measurement]) -> [(&'static str, String); 4] {
    let texts = [csv(points), json(scale, points), ask_csv(points), trk(video, scale, points)];
    let mut names = ["measure.csv", "fits.json", "ask.csv", "measure.trk"].into_iter();
    texts.map(|text| (names.next().expect("as many"), text))
}

/// Returns the names of the columns of measure.csv.
fn columns(length: &str) -> Vec<String> {
    // Spreadsheets read ASCII without a hint.
    let unit = |time: i32| unit(length, (1, -time)).replace('²', "^2");
    let mut names = vec!["frame".to_owned(), "t (s)".to_owned()];
    for (time, prefix) in [(0, ""), (1, "v"), (2, "a")] {
        names.extend(AXES.map(|axis| format!("{prefix}{axis} ({})", unit(time))));
    }
    for (time, prefix) in [(0, ""), (1, "v"), (2, "a")] {
        names.extend(AXES.map(|axis| format!("sd_{prefix}{axis} ({})", unit(time))));
    }
    names.extend(AXES.map(|axis| format!("tracked_{axis} ({})", unit(0))));
    names.extend(["p_lost", "status", "point"].map(str::to_owned));
    names
}

/// Returns measure.csv.
fn csv(points: &[Measurement]) -> String {
    let mut text = columns(points[0].unit).join(",") + "\n";
    for (point, row) in points.iter().flat_map(|point| point.rows.iter().map(move |row| (&point.point, row))) {
        let _ = write!(text, "{},{}", row.frame, row.time);
        for of in [|s: &Smoothed| s.value, |s: &Smoothed| s.sd] {
            for i in 0..3 {
                for smoothed in &row.smoothed {
                    let _ = write!(text, ",{}", of(smoothed)[i]);
                }
            }
        }
        let tracked = row.measured.map_or(",,".to_owned(), |[x, y]| format!(",{x},{y}"));
        let _ = writeln!(text, "{tracked},{},{},{}", row.p_lost, quoted(&row.status), quoted(point));
    }
    text
}

/// Returns ask.csv.
fn ask_csv(points: &[Measurement]) -> String {
    let lines = points.iter().map(|point| ask::lines(&point.ask, &quoted(&point.point)));
    format!("rank,frame,from,to,p_lost,region (px),reason,point\n{}", lines.collect::<String>())
}

/// Returns fits.json.
fn json(picture_scale: f64, points: &[Measurement]) -> String {
    let [scale, clock] = points[0].relative;
    let fits: Vec<&Fit> = points.iter().flat_map(|point| &point.fits).collect();
    let value = serde_json::json!({
        "unit": points[0].unit, "fps": points[0].clock, "reference": points[0].referenced, "picture": points[0].picture,
        "lens": points[0].straightened, "scale": picture_scale,
        "relative_error_of_scale": scale, "relative_error_of_clock": clock, "fits": fits,
        "notes": notes(points),
    });
    format!("{value:#}\n")
}

/// Returns the notes; with several points, each with its name.
fn notes(points: &[Measurement]) -> Vec<String> {
    let note = |point: &Measurement, note: &String| match points.len() {
        1 => note.clone(),
        _ => format!("{}: {note}", point.point),
    };
    points.iter().flat_map(|point| point.all_notes().map(move |text| note(point, text))).collect()
}

/// Returns the results as lines of text.
pub fn text(points: &[Measurement]) -> Vec<String> {
    let title = |point: &Measurement| (points.len() > 1).then(|| format!("Point {}:", point.point));
    points.iter().flat_map(|point| title(point).into_iter().chain(point.text())).collect()
}

impl Measurement {
    /// Returns the results as lines of text.
    pub fn text(&self) -> Vec<String> {
        let gaps = self.rows.iter().filter(|row| row.measured.is_none()).count();
        let off = (0..self.rows.len()).filter(|k| self.smoothing.iter().any(|it| it.inflation[*k] > 1.0)).count();
        let typical = |i: usize| median(self.rows.iter().map(|row| row.smoothed[i].sd[0]));
        let mut lines = vec![format!(
            "{} frames, {gaps} of them bridged, {off} down-weighted; typical error of a position {:.2e} {unit} in x, {:.2e} {unit} in y.",
            self.rows.len(),
            typical(0),
            typical(1),
            unit = self.unit
        )];
        for fit in &self.fits {
            lines.push(format!(
                "{}: {}, t from {:.4} s, rms {:.2e} {}",
                fit.fit, fit.formula, fit.t0, fit.rms, fit.unit
            ));
            lines.extend(fit.values.iter().map(|value| format!("  {}", value.text())));
        }
        lines.extend(self.all_notes().cloned());
        lines
    }

    /// Returns all notes.
    pub(super) fn all_notes(&self) -> impl Iterator<Item = &String> {
        self.fit_notes.iter().chain(&self.notes)
    }
}

#[cfg(test)]
mod tests {
    use super::super::measurement::measure;
    use super::super::measurement::tests::{falling, settings};
    use super::super::track::Track;
    use super::*;

    /// The fall at two points, the second one 20 px to the right, 0.2 m.
    fn two() -> Vec<Measurement> {
        let shifted = falling(0.0).into_iter().map(|mut position| {
            position.centre.0 += 20.0;
            position
        });
        let track = |name: &str, positions| Track { name: name.into(), positions };
        let points = [track("ball", falling(0.0)), track("a, \"b\" & <c>", shifted.collect())];
        measure(&points, None, &settings()).expect("a measurement")
    }

    #[test]
    fn tables_have_units_and_a_cell_for_each_column() {
        let points = &two()[..1];
        let csv = csv(points);
        let columns: Vec<&str> = csv.lines().next().expect("a header").split(',').collect();
        assert_eq!(
            columns[..8],
            ["frame", "t (s)", "x (m)", "y (m)", "vx (m/s)", "vy (m/s)", "ax (m/s^2)", "ay (m/s^2)"]
        );
        assert!(csv.lines().all(|line| line.split(',').count() == columns.len()) && csv.lines().count() == 31);
        let json: serde_json::Value = serde_json::from_str(&json(1.0, points)).expect("JSON");
        assert_eq!(json["fits"][0]["values"][3]["name"], "g");
        assert!(text(points).iter().any(|line| line.contains("g = 9.8") && line.contains("m/s² (95 %: 9.7")));
    }

    #[test]
    fn points_share_origin_and_tables() {
        let points = two();
        for (a, b) in points[0].rows.iter().zip(&points[1].rows) {
            let apart = b.smoothed[0].value[0] - a.smoothed[0].value[0];
            assert!((apart - 0.2).abs() < 1e-9 && b.smoothed[1] == a.smoothed[1], "{apart}");
        }
        let csv = csv(&points);
        assert_eq!(csv.lines().count(), 61);
        assert!(csv.lines().nth(1).is_some_and(|line| line.ends_with(",ball")));
        assert!(csv.lines().last().is_some_and(|line| line.ends_with(",\"a, \"\"b\"\" & <c>\"")));
        let json: serde_json::Value = serde_json::from_str(&json(0.5, &points)).expect("JSON");
        assert_eq!((json["scale"].as_f64(), json["lens"].as_bool()), (Some(0.5), Some(false)));
        let fits = json["fits"].as_array().expect("fits").iter();
        let of: Vec<_> = fits.map(|fit| (fit["point"].as_str(), fit["fit"].as_str())).collect();
        assert_eq!(of[0], (Some("ball"), Some("parabola:y")));
        assert!(of.contains(&(Some("a, \"b\" & <c>"), Some("parabola:y"))), "{of:?}");
        let mut notes = json["notes"].as_array().expect("notes").iter().filter_map(|note| note.as_str());
        assert!(notes.any(|note| note.starts_with("ball: Check")));
        assert!(ask_csv(&points).lines().nth(1).is_some_and(|line| line.starts_with("1,") && line.ends_with(",ball")));
        assert_eq!(text(&points)[0], "Point ball:");
        // An outlier in x in one frame, and in y in another.
        let mut point = points[0].clone();
        point.smoothing.iter_mut().for_each(|it| it.inflation.fill(1.0));
        (point.smoothing[0].inflation[3], point.smoothing[1].inflation[4]) = (9.0, 9.0);
        assert!(point.text()[0].contains(", 2 down-weighted"), "{:?}", point.text());
    }
}
