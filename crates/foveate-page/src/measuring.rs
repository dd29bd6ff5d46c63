//! The answer to the message `measure`: motion in metres and seconds, as `foveate measure` computes it from track.csv.

use std::path::Path;
use std::str::FromStr;

use foveate_base::{Error, Result};
use foveate_lab::measure::{
    AXES, Axes, Fit, FitRequest, Measurement, Settings, Track, Value, measure, parse, parse_angle, parse_point, tables,
    unit,
};
use serde::Deserialize;
use serde_json::{Value as Json, json};

use crate::command::word;

/// Maximum number of frames: the smoother takes seconds for more.
pub(crate) const MOST_MEASURED: usize = 3000;
/// Maximum number of points of a chart; longer tracks have every n-th frame.
const POINTS: usize = 1000;

/// The options of `foveate measure`, as text. Pixels count from 1.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Two points and the length between them: `X1,Y1,X2,Y2=LENGTH[+-ERROR][UNIT]`.
    pub ruler: Option<String>,
    /// The origin: `X,Y`.
    pub origin: Option<String>,
    /// The direction of the x axis, degrees.
    pub angle: Option<String>,
    /// Frames per second: `RATE[+-ERROR]`.
    pub fps: Option<String>,
    /// A curve: `CURVE:x|y[:FROM-TO]`.
    pub fit: Option<String>,
}

impl Options {
    /// Checks the options.
    ///
    /// # Errors
    /// One of them is malformed; the error names it.
    pub(crate) fn settings(&self) -> Result<Settings> {
        fn read<T>(
            name: &str,
            text: Option<&String>,
            parse: impl Fn(&str) -> std::result::Result<T, String>,
        ) -> Result<Option<T>> {
            let wrong = |problem| Error::Invalid(format!("{name}: {problem}"));
            text.map(|text| parse(text).map_err(wrong)).transpose()
        }
        let axes = Axes {
            ruler: read("ruler", self.ruler.as_ref(), FromStr::from_str)?,
            origin: read("origin", self.origin.as_ref(), parse_point)?,
            angle: read("angle", self.angle.as_ref(), parse_angle)?.unwrap_or(0.0),
        };
        let clock = read("fps", self.fps.as_ref(), FromStr::from_str)?;
        let fit: Option<FitRequest> = read("fit", self.fit.as_ref(), FromStr::from_str)?;
        Ok(Settings { axes, clock, fits: fit.into_iter().collect(), ..Settings::default() })
    }

    /// Returns the `foveate measure` command of the `foveate track` command of a target (from 0).
    pub(crate) fn command(&self, target: usize, track: &str) -> String {
        let Self { ruler, origin, angle, fps, fit } = self;
        let named = [("ruler", ruler), ("origin", origin), ("angle", angle), ("fps", fps), ("fit", fit)];
        let given = named.into_iter().filter_map(|(name, text)| Some((name, text.as_ref()?)));
        let options: String = given.map(|(name, text)| format!(" --{name}={}", word(text))).collect();
        let names = if target == 0 { String::new() } else { format!(" --names={}", target + 1) };
        track.replacen("foveate track", "foveate measure", 1) + &names + &options
    }
}

/// Measures a target (from 0) by its track.csv.
///
/// # Errors
/// The target was found in too few frames, or as [`measure`].
pub(crate) fn measured(target: usize, track: &str, settings: &Settings) -> Result<Measurement> {
    let positions = parse(track, Path::new("track.csv"))?;
    let point = Track { name: (target + 1).to_string(), positions };
    measure(&[point], None, settings).map(|mut all| all.remove(0))
}

/// Returns the files of a measurement by name; the video is not named in measure.trk.
pub(crate) fn files(measured: &Measurement) -> Json {
    json!({ "files": tables(None, 1.0, std::slice::from_ref(measured)).map(|(name, text)| json!({ "name": name, "text": text })) })
}

/// Returns the data of the page's charts.
pub(crate) fn charts(measured: &Measurement) -> Json {
    let every = measured.rows.len().div_ceil(POINTS).max(1);
    let rows = || measured.rows.iter().step_by(every);
    let motion = (0..3).flat_map(|i| (0..2).map(move |axis| (i, axis)));
    let motion = motion.map(|(i, axis)| {
        let label = format!("{}{} ({})", ["", "v", "a"][i], AXES[axis], unit(measured.unit, (1, -(i as i32))));
        let of = |row: &foveate_lab::measure::Row| (row.smoothed[axis].value[i], row.smoothed[axis].sd[i]);
        let (value, sd): (Vec<f64>, Vec<f64>) = rows().map(of).unzip();
        json!({ "label": label, "value": value, "sd": sd })
    });
    let ask = measured.ask.iter().map(|ask| {
        let [from, to] = ask.stretch;
        json!({ "frame": ask.frame, "from": from, "to": to, "reason": ask.reason })
    });
    let tracked = [0, 1].map(|axis| rows().map(|row| row.measured.map(|at| at[axis])).collect::<Vec<_>>());
    json!({
        "unit": measured.unit, "summary": measured.text()[0], "origin": measured.axes.origin, "relative": measured.relative,
        "frames": rows().map(|row| row.frame).collect::<Vec<_>>(),
        "times": rows().map(|row| row.time).collect::<Vec<_>>(),
        "tracked": tracked,
        "motion": motion.collect::<Vec<_>>(), "ask": ask.collect::<Vec<_>>(),
        "fit": measured.fits.first().map(fitted), "notes": measured.fit_notes,
    })
}

fn fitted(fit: &Fit) -> Json {
    let every = fit.data.len().div_ceil(POINTS).max(1);
    let [from, to] = [fit.data.first(), fit.data.last()].map(|point| point.map_or(0.0, |point| point.0));
    let steps = fit.steps(to - from);
    let times = (0..=steps).map(|k| from + (to - from) * k as f64 / steps as f64);
    json!({
        "axis": fit.curve.0, "formula": fit.formula, "t0": fit.t0, "points": fit.points, "rms": fit.rms,
        "values": fit.values.iter().map(Value::text).collect::<Vec<_>>(),
        "curve": times.map(|t| [t, fit.at(t)]).collect::<Vec<_>>(),
        "data": fit.data.iter().step_by(every).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(json: Json) -> Options {
        serde_json::from_value(json).expect("options")
    }

    /// A fall at 100 px/m and 50 frames/s; `usable` selects the frames that count.
    fn track(frames: usize, usable: impl Fn(usize) -> bool) -> String {
        let line = |k: usize| {
            let y = 40.0 + 490.5 * (k as f64 / 50.0).powi(2);
            format!("{},{},80,{y},0.04,0,0.04,0.01,tracking,{}\n", k + 1, k as f64 / 50.0, u8::from(usable(k)))
        };
        "frame,time,x,y,cov_x_x,cov_x_y,cov_y_y,p_lost,status,usable\n".to_owned()
            + &(0..frames).map(line).collect::<String>()
    }

    #[test]
    fn a_fall_has_charts_files_and_a_command() {
        let options = options(json!({ "ruler": "1,1,1,401=400+-0.2cm", "angle": "-0", "fit": "parabola:y" }));
        let settings = options.settings().expect("right");
        let measured = measured(1, &track(30, |k| k != 7), &settings).expect("a measurement");
        let answer = charts(&measured);
        assert_eq!(answer["motion"][3]["label"], "vy (m/s)");
        assert!(answer["fit"]["values"][3].as_str().is_some_and(|g| g.starts_with("g = 9.81")), "{}", answer["fit"]);
        assert_eq!((&answer["tracked"][0][7], &answer["ask"][0]["frame"]), (&Json::Null, &json!(8)));
        assert_eq!(answer["motion"][0]["value"].as_array().map(Vec::len), Some(30));
        let files = files(&measured);
        assert!(files["files"][0]["text"].as_str().is_some_and(|text| text.ends_with(",2\n")), "the second target");
        assert_eq!(
            options.command(1, "foveate track a.mp4 --init 1,2,3,4"),
            "foveate measure a.mp4 --init 1,2,3,4 --names=2 --ruler=1,1,1,401=400+-0.2cm --angle=-0 --fit=parabola:y"
        );
    }

    #[test]
    fn long_tracks_have_fewer_points() {
        let settings = Settings { fits: vec!["line:x".parse().expect("a fit")], ..Settings::default() };
        let answer = charts(&measured(0, &track(1500, |_| true), &settings).expect("a measurement"));
        assert_eq!(answer["times"].as_array().map(Vec::len), Some(750));
        assert_eq!(answer["fit"]["data"].as_array().map(Vec::len), Some(750));
    }

    #[test]
    fn a_curve_of_many_periods_has_more_points() {
        let line = |k: usize| {
            let x = 80.0 + 20.0 * (k as f64 * std::f64::consts::TAU / 10.0).sin();
            format!("{},{},{x},40,0.04,0,0.04,0.01,tracking,1\n", k + 1, k as f64 / 50.0)
        };
        let track = "frame,time,x,y,cov_x_x,cov_x_y,cov_y_y,p_lost,status,usable\n".to_owned();
        let track = track + &(0..=400).map(line).collect::<String>();
        let settings = Settings { fits: vec!["sine:x".parse().expect("a fit")], ..Settings::default() };
        let answer = charts(&measured(0, &track, &settings).expect("a measurement"));
        let points = answer["fit"]["curve"].as_array().map(Vec::len);
        assert!(points.is_some_and(|points| (630..660).contains(&points)), "16 for each of 40 periods: {points:?}");
    }

    #[test]
    fn what_cannot_be_measured_is_refused() {
        for (name, text) in [
            ("ruler", "5,5,5,5=1m"),
            ("ruler", "1,1,2,2=0m"),
            ("ruler", "nan,1,2,2=1m"),
            ("origin", "1"),
            ("origin", "inf,1"),
            ("angle", "1e999"),
            ("fps", "0"),
            ("fps", "-30"),
            ("fit", "parabola:z"),
            ("fit", "parabola:y:2-1"),
        ] {
            let error = options(json!({ name: text })).settings().expect_err(text).to_string();
            assert!(error.contains(name) && error.contains("expected"), "{error}");
        }
        assert!(serde_json::from_value::<Options>(json!({ "rulers": "1" })).is_err());
        let settings = Settings::default();
        for (track, why) in [
            (track(1, |_| true), "1 frame;"),
            (track(40, |_| false), "no frame"),
            (track(4, |_| true), "at least 5"),
            (String::new(), "no column"),
        ] {
            let error = measured(0, &track, &settings).expect_err(why).to_string();
            assert!(error.contains(why), "{error}");
        }
        // A fit that fails is a note.
        let settings = options(json!({ "fit": "sine:y:0-0.05" })).settings().expect("right");
        let answer = charts(&measured(0, &track(30, |_| true), &settings).expect("a measurement"));
        assert!(answer["fit"].is_null() && answer["notes"][0].as_str().is_some_and(|note| note.contains("at least 6")));
    }
}
