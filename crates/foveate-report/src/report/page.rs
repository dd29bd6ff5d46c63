//! The data of the page, and the generated page. `data.js` reads the output of [`Page::render`].

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::html::{self, Template, bytes_of, short};
use super::tracks::{Drawn, Tracks};
use crate::regret::RegretLog;
use crate::{Baseline, RunInfo};
use foveate_base::{Result, memory};
use foveate_core::Seen;
use foveate_core::control::Status;
use foveate_core::geometry::BBox;
use foveate_core::seen::credible;
use foveate_video::Frame;

/// One number per frame; NaN if there is none. All but the first two are of the only target, and empty if there are more.
const COLUMNS: [&str; 32] = [
    "frame",
    "time",
    "x",
    "y",
    "vx",
    "vy",
    "log_scale",
    "angle",
    "log_aspect",
    "half_w",
    "half_h",
    "true_x",
    "true_y",
    "true_w",
    "true_h",
    "cov_xx",
    "cov_xy",
    "cov_yy",
    "sd_x",
    "sd_y",
    "ess",
    "log_evidence",
    "usable",
    "u",
    "v",
    "arm",
    "reward",
    "reward_low",
    "reward_high",
    "distance",
    "p_lost",
    "status",
];

/// Memory of a row, as numbers and as the text of the page, bytes.
const ROW: u64 = 3000;
/// Maximum number of drawn classes: the number of colours.
const MOST_CLASSES: usize = 6;

/// The data of a frame besides its numbers. Texts are base64: a JPEG, or bytes.
#[derive(Default, Serialize)]
pub(super) struct Key {
    pub row: usize,
    pub jpeg: String,
    pub targets: Vec<Drawn>,
    /// x and y of each particle: 16 bits over −1 to 2 pictures.
    pub particles: String,
    /// Relative to the heaviest, 8 bits.
    pub weights: String,
    pub glimpse: String,
    /// The template at the same gaze, cell by cell.
    pub template: String,
    pub features: String,
    /// The values encoded as 0 and 255 in `features`, if they are not 0 and 1.
    pub span: Option<[f32; 2]>,
    /// One probability per arm, 16 bits.
    pub policy: String,
    /// Gazes used besides the chosen one.
    pub also: Vec<[f64; 2]>,
    /// The reward surface, if the policy has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface: Option<Hills>,
}

/// A reward surface: n × n bytes each, row by row, between the two values of its span.
#[derive(Serialize)]
pub(super) struct Hills {
    pub mean: String,
    pub mean_span: [f64; 2],
    pub sd: String,
    pub sd_span: [f64; 2],
    pub best: Option<[f64; 2]>,
}

impl Key {
    /// Returns the size of its pictures and surfaces before base64, bytes.
    pub(super) fn bytes(&self) -> usize {
        bytes_of(&self.jpeg) + self.surface.as_ref().map_or(0, |s| bytes_of(&s.mean) + bytes_of(&s.sd))
    }
}

/// All data of the page except its keys.
#[derive(Default)]
pub(super) struct Page {
    source: String,
    info: Value,
    rate: f64,
    truth: Vec<Option<BBox>>,
    baselines: Vec<Baseline>,
    cells: Vec<f64>,
    size: [usize; 2],
    particles: usize,
    seconds: f64,
    rows: Vec<[f64; COLUMNS.len()]>,
    tracks: Tracks,
    pub shown: usize,
    pub features: usize,
    pub learned: bool,
    pub arms: Vec<[f64; 2]>,
    pub template: Option<Template>,
    /// Points along a side of a reward surface, and its reach.
    pub surface: Option<[f64; 2]>,
    regret: Value,
    /// Class probabilities, one list per row; empty if there are none.
    classes: Vec<Vec<f64>>,
    class_names: Vec<String>,
}

impl Page {
    pub(super) fn new(info: &RunInfo) -> Self {
        let cells = info.retina.iter().flat_map(|r| r.cells()).flat_map(|c| [c.u, c.v, c.half, c.channel as f64]);
        Self {
            source: info.source.clone(),
            info: json!({
                "source": info.source, "reader": info.reader, "seed": info.seed, "command": info.command,
                "config_name": info.config_name, "config_text": info.config_text,
                "version": html::VERSION, "warnings": [],
            }),
            rate: info.rate,
            truth: info.truth.clone(),
            baselines: info.baselines.clone(),
            cells: cells.collect(),
            size: [1, 1],
            ..Self::default()
        }
    }

    /// Adds a row for a frame and its targets; returns its index.
    ///
    /// # Errors
    /// The rows exceed the memory limit.
    pub(super) fn frame(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<usize> {
        let frames = self.rows.len() + 1;
        if frames.is_multiple_of(1000) {
            memory::check(format_args!("report.html of {frames} frames"), frames as u64 * ROW)?;
        }
        let before = self.rows.last().map_or(0, |row| row[0] as usize - 1);
        targets.iter().for_each(|target| self.tracks.add(frame, before, target));
        let mut row = [f64::NAN; COLUMNS.len()];
        self.size = [frame.image.width(), frame.image.height()];
        row[0] = frame.index as f64 + 1.0;
        row[1] = frame.time;
        if let Some(Some(b)) = self.truth.get(frame.index) {
            let (x, y) = b.centre();
            row[11..15].copy_from_slice(&[x, y, b.w, b.h]);
        }
        self.rows.push(row);
        self.classes.push(vec![]);
        Ok(self.rows.len() - 1)
    }

    /// Returns whether there was at most one target so far: it has numbers in every frame.
    pub(super) fn has_one(&self) -> bool {
        self.tracks.len() < 2
    }

    /// Adds the only target to the last row.
    pub(super) fn only(&mut self, seen: &Seen<'_>) {
        let row = self.rows.last_mut().expect("a frame has a row");
        row[2..9].copy_from_slice(&seen.state.to_array());
        row[9..11].copy_from_slice(&[seen.extent.half_w, seen.extent.half_h]);
    }

    /// Adds the estimate of the only target to the last row. Without views there are no numbers of particles and gazes.
    pub(super) fn tracked(&mut self, seen: &Seen<'_>, arm: Option<usize>) {
        let index = self.rows.len() - 1;
        let c = &seen.covariance;
        let row = &mut self.rows[index];
        row[15..20].copy_from_slice(&[c[0][0], c[0][1], c[1][1], c[0][0].sqrt(), c[1][1].sqrt()]);
        row[22] = f64::from(u8::from(seen.is_usable()));
        row[30..].copy_from_slice(&[seen.p_lost, f64::from(seen.status as u8)]);
        if seen.weights.is_empty() {
            return;
        }
        self.particles = seen.weights.len();
        self.classes[index].extend_from_slice(seen.classes);
        if self.class_names.is_empty() {
            self.class_names = seen.class_names.to_vec();
        }
        let gaze = seen.plan.chosen();
        let low = seen.rewards.iter().copied().fold(f64::INFINITY, f64::min);
        let high = seen.rewards.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        row[20..22].copy_from_slice(&[seen.ess, seen.log_evidence]);
        row[23..30].copy_from_slice(&[
            gaze.u,
            gaze.v,
            arm.map_or(f64::NAN, |arm| arm as f64),
            seen.rewards[seen.plan.chosen_index()],
            low,
            high,
            seen.percept.distance,
        ]);
    }

    /// Adds rewards and regrets; the log has the tracked rows.
    pub(super) fn regret(&mut self, log: &RegretLog) {
        let Some(regret) = log.regret() else { return };
        // A frame with a given box has no gaze.
        let gaze = COLUMNS.iter().position(|name| *name == "u").expect("it is one of them");
        let (mut tracked, mut series) = (0..log.frames(), vec![vec![]; 3]);
        for row in &self.rows {
            let t = if row[gaze].is_nan() { None } else { tracked.next() };
            let values = t.map(|t| [log.offered(t)[regret.best], regret.cumulative[t], regret.at_random[t]]);
            series
                .iter_mut()
                .zip(values.unwrap_or([f64::NAN; 3]))
                .for_each(|(column, value)| column.push(short(value)));
        }
        let best = log.gazes()[regret.best];
        self.regret = json!({
            "gazes": log.gazes().len(), "best": [best.u, best.v],
            "reward": series[0], "total": series[1], "random": series[2],
        });
    }

    /// Returns the classes with the highest probabilities in any frame, the most likely at the end first: names and one value per row. Null
    /// without a recogniser.
    fn classes(&self) -> Value {
        let Some(last) = self.classes.iter().rfind(|p| !p.is_empty()) else { return Value::Null };
        let peak = |class: usize| self.classes.iter().filter_map(|p| p.get(class)).copied().fold(0.0, f64::max);
        let mut order: Vec<(usize, f64)> = (0..last.len()).map(|class| (class, peak(class))).collect();
        order.sort_by(|a, b| b.1.total_cmp(&a.1));
        order.truncate(MOST_CLASSES);
        order.sort_by(|a, b| last[b.0].total_cmp(&last[a.0]));
        let lines = order.iter().map(|&(class, _)| {
            let column = self.classes.iter().map(|p| short(p.get(class).copied().unwrap_or(f64::NAN)));
            let name = self.class_names.get(class).cloned().unwrap_or_else(|| class.to_string());
            json!({ "name": name, "of": column.collect::<Vec<Value>>() })
        });
        Value::Array(lines.collect())
    }

    /// Returns the name of another track, and its centre and size per row.
    fn columns_of(&self, baseline: &Baseline) -> Value {
        let boxes = baseline.boxes();
        let column = |of: fn(&BBox) -> f64| -> Vec<Value> {
            let boxes = self.rows.iter().map(|row| boxes.get(row[0] as usize - 1));
            boxes.map(|b| short(b.map_or(f64::NAN, of))).collect()
        };
        json!({
            "name": baseline.name(), "x": column(|b| b.centre().0), "y": column(|b| b.centre().1), "w": column(|b| b.w), "h": column(|b| b.h),
        })
    }

    /// Adds the facts of the end of the run: the tracking time, and the warnings.
    pub(super) fn end(&mut self, info: &RunInfo) {
        self.seconds = info.clock.total().as_secs_f64();
        self.info["warnings"] = json!(info.warnings.all());
    }

    /// Returns the page.
    pub(super) fn render(&self, keys: &[&Key]) -> String {
        let rows = |i: usize| &self.rows[..if i < 2 || self.has_one() { self.rows.len() } else { 0 }];
        let column = |i: usize| rows(i).iter().map(|row| short(row[i])).collect();
        let series: Map<String, Value> =
            COLUMNS.iter().enumerate().map(|(i, name)| ((*name).into(), Value::Array(column(i)))).collect();
        let fps = if self.seconds > 0.0 { short(self.rows.len() as f64 / self.seconds) } else { Value::Null };
        let statuses = [Status::Tracking, Status::Occluded, Status::Lost, Status::Reacquired].map(Status::name);
        let baselines: Vec<Value> = self.baselines.iter().map(|baseline| self.columns_of(baseline)).collect();
        let last = self.rows.last().map_or(0, |row| row[0] as usize - 1);
        let sections = if self.particles > 0 { String::new() } else { self.tracks.sections(last) };
        let data = json!({
            "format": 3, "info": self.info, "summary": { "fps": fps }, "size": self.size, "rate": self.rate, "tracks": self.tracks.summary(last),
            "particles": self.particles, "shown": self.shown, "features": self.features, "learned": self.learned,
            "cells": self.cells.iter().map(|v| short(*v)).collect::<Vec<_>>(), "template": self.template,
            "arms": self.arms, "surface": self.surface, "baselines": baselines, "regret": self.regret, "classes": self.classes(),
            "statuses": statuses, "credible": credible(0.9), "series": series, "keys": keys,
        });
        html::page(include_str!("page.html"), &self.source, &data, &SCRIPTS, &[("tracks", sections)])
    }
}

/// In order of dependency.
const SCRIPTS: [&str; 7] = [
    include_str!("data.js"),
    include_str!("stage.js"),
    include_str!("fovea.js"),
    include_str!("policy.js"),
    include_str!("surface.js"),
    include_str!("charts.js"),
    include_str!("main.js"),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::html::words_after;

    /// The scripts read only names that the page has: the test finds a name that is changed on one side alone.
    #[test]
    fn scripts_read_what_is_written() {
        let page = Page::new(&RunInfo::default()).render(&[]);
        let data = page.split("id=\"data\">").nth(1).and_then(|rest| rest.split("</script>").next()).expect("data");
        let data: Value = serde_json::from_str(data).expect("JSON");
        let surface =
            Hills { mean: String::new(), mean_span: [0.0; 2], sd: String::new(), sd_span: [0.0; 2], best: None };
        let key = serde_json::to_value(Key { surface: Some(surface), ..Key::default() }).expect("JSON");
        let script = SCRIPTS.concat();
        let target = serde_json::to_value(Drawn::new(&Seen::given([64, 48, 1], &BBox::new(4.0, 6.0, 10.0, 12.0))));
        let target = target.expect("JSON");
        for (prefix, known, own) in [
            ("data.", &data, ""),
            ("target.", &target, ""),
            ("series.", &data["series"], ""),
            ("info.", &data["info"], ""),
            ("key.", &key, "cloud"),
        ] {
            let words = words_after(&script, prefix);
            assert!(words.len() >= 5, "{prefix}");
            for word in words {
                assert!(
                    known.get(word).is_some() || word == own,
                    "a script reads {prefix}{word}, which is not written"
                );
            }
        }
        for name in ["u", "arm"] {
            assert!(COLUMNS.contains(&name));
        }
    }
}
