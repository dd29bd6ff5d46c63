//! The paper's second experiment: many targets that grow, turn and cross, as a table and a film strip.

use std::path::Path;

use foveate::eval::multi;
use foveate::observe::ManyObserver;
use foveate::scene::synthetic::Multi;
use foveate::{Error, Result};
use serde::{Deserialize, Serialize};

use super::Ground;
use super::figures::Picture;
use super::plan::Experiment;
use super::results::Results;
use super::table::Table;
use crate::cmd::experiment::multi::{Crowd, Way, strip};
use crate::cmd::track::DIGITS;

/// A way to follow all targets, on all videos.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CrowdLine {
    pub name: String,
    pub configuration: String,
    pub scene: String,
    pub videos: usize,
    pub hota: f64,
    pub idf1: f64,
    pub mota: f64,
    pub switches: usize,
    /// How many times two targets cross.
    pub crossings: usize,
    /// Share of them after which both targets have their tracks.
    pub kept: f64,
    /// Share of them after which one has the other's.
    pub swapped: f64,
    /// Median over targets and frames of |size / true size − 1|.
    pub scale_error: f64,
    /// The same of the difference of angles, degrees.
    pub angle_error: f64,
    /// Share of the frames with a class that have the right one.
    pub right: Option<f64>,
}

/// Columns of the table.
pub const HEADS: [&str; 12] = [
    "",
    "videos",
    "HOTA",
    "IDF1",
    "MOTA",
    "switches",
    "crossings",
    "kept",
    "swapped",
    "scale error",
    "angle error",
    "class right",
];

/// What the columns say.
pub const LEGEND: &str = "\
All videos pooled; boxes believed lost are left out. Crossings: half of the smaller box is covered. Kept: after it both targets have
the tracks they had before; swapped: one has the other's. Scale and angle errors are medians over targets and frames, lost ones too.
Class right: decided over all frames so far.";

/// Runs what is not done yet. `None` where runs are missing: those of another shard, or it was asked to stop.
pub fn crowd(experiment: &Experiment, ground: &Ground, out: &Path) -> Result<Option<Table>> {
    let scene = experiment.crowd.as_ref();
    let scene = scene.ok_or_else(|| Error::Config(format!("{}: no [crowd], the scene", experiment.name)))?;
    let settings = |seed| Multi { seed, frames: experiment.frames, ..scene.video.clone() };
    let videos = Crowd::new((1..=experiment.seeds).map(settings).collect(), (&ground.digits, &ground.from))?;
    let mut ways = vec![];
    for line in &experiment.lines {
        let config = line.entry()?.blueprint.config().clone();
        ways.push(Way::of(line.name.clone(), config, Path::new("."), DIGITS, !line.alone)?);
    }
    let runs = videos.runs(&experiment.name, &ground.store, &ways)?;
    let Some(runs) = runs.into_iter().collect::<Option<Vec<_>>>() else { return Ok(None) };
    let lines = videos.lines(&ways, &runs)?;
    let named = lines.iter().zip(&experiment.lines);
    let crowd = named.map(|(line, of)| CrowdLine::of(line, of.config(), &scene.name)).collect();
    let mut results = Results { crowd, ..Results::empty(experiment, ground) };
    results.check(experiment, ground.quick, ground.mnist);
    let speeds = lines.iter().map(|line| line.fps).collect();
    let pictures = film(experiment, &ways, &videos, out)?;
    Ok(Some(Table { results, speeds, pictures }))
}

/// The film strip of the first video, followed in the first way.
fn film(experiment: &Experiment, ways: &[Way], videos: &Crowd<'_>, out: &Path) -> Result<Vec<Picture>> {
    let (Some(way), Some((video, seed))) = (ways.first(), videos.first()) else { return Ok(vec![]) };
    let file = format!("{}-strip.png", experiment.name);
    let path = out.join(&file);
    let mut strip = strip(path.clone(), video)?;
    way.follow(video, seed, &mut strip)?;
    strip.finish()?;
    let bytes = std::fs::read(&path).map_err(Error::io(&path, "cannot read the picture just written"))?;
    let caption = format!("Seed {seed}, {}: each target's box, number, track and class.", way.name);
    Ok(vec![Picture { file, caption, bytes }])
}

impl CrowdLine {
    fn of(line: &multi::Line, configuration: &str, scene: &str) -> Self {
        let (score, crossings) = (&line.score, &line.crossings);
        Self {
            name: line.name.clone(),
            configuration: configuration.into(),
            scene: scene.into(),
            videos: line.videos,
            hota: score.hota.hota,
            idf1: score.identity.idf1,
            mota: score.clear.mota,
            switches: score.clear.switches,
            crossings: crossings.all,
            kept: crossings.share_kept(),
            swapped: crossings.share_swapped(),
            scale_error: line.scale_error[0],
            angle_error: line.angle_error[0],
            right: line.right,
        }
    }

    /// As text, in the order of [`HEADS`].
    pub fn cells(&self) -> [String; HEADS.len()] {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        [
            self.name.clone(),
            self.videos.to_string(),
            format!("{:.3}", self.hota),
            format!("{:.3}", self.idf1),
            format!("{:.3}", self.mota),
            self.switches.to_string(),
            self.crossings.to_string(),
            percent(self.kept),
            percent(self.swapped),
            percent(self.scale_error),
            format!("{:.1}°", self.angle_error),
            self.right.map_or("-".into(), percent),
        ]
    }
}

/// The table as Markdown.
pub fn markdown(lines: &[CrowdLine]) -> String {
    let row = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let rows: String = lines.iter().map(|line| row(&line.cells())).collect();
    format!("{}{}{rows}\n{LEGEND}\n", row(&HEADS.map(String::from)), row(&HEADS.map(|_| "---".into())))
}

/// A row a line.
pub fn csv(lines: &[CrowdLine]) -> String {
    let head = "scene,line,videos,hota,idf1,mota,switches,crossings,kept,swapped,scale_error,angle_error,class_right\n";
    let row = |l: &CrowdLine| {
        let right = l.right.map_or(String::new(), |right| right.to_string());
        format!(
            "\"{}\",\"{}\",{},{},{},{},{},{},{},{},{},{},{right}\n",
            l.scene,
            l.name,
            l.videos,
            l.hota,
            l.idf1,
            l.mota,
            l.switches,
            l.crossings,
            l.kept,
            l.swapped,
            l.scale_error,
            l.angle_error,
        )
    };
    head.to_owned() + &lines.iter().map(row).collect::<String>()
}
