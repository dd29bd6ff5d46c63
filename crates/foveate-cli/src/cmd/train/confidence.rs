//! Implements `foveate train confidence`: fits P(lost) on tracks with ground truth, and cross-validates its calibration.

use std::path::PathBuf;

use foveate::control::{CUE_NAMES, ConfidenceModel};
use foveate::lab::eval::catalogue::Half;
use foveate::lab::eval::choice::{by_half, by_source};
use foveate::lab::eval::confidence::Judgement;
use foveate::lab::eval::confidence::{ConfidenceScore, Judged};
use foveate::lab::eval::confidence_cross::{self, Fitting, cross_fit};
use foveate::lab::eval::confidence_fit::{fit, fit_second_opinion};
use foveate::lab::eval::localisation_fit::fit_localisation;
use foveate::lab::eval::{confidence, confidence_plot};
use foveate::report::quoted;
use foveate::{Error, Result, files};
use serde::Serialize;

use super::confidence_tracks::{Tracked, Videos};
use crate::cmd::configure::{self, Changes};
use crate::cmd::results::{spare, writable};
use crate::runs::{self, Store};
use crate::terminal;

/// Fit the probability of being lost on sequences or drawn scenes with ground truth.
///
/// Run the tracker on each video unchanged and with inserted occlusions (`--occlusions` for each kind of occlusion). Print the scores of
/// the configuration's model, and of new models by cross-validation: leave one source video out, and fit on one half of the videos and test
/// on the other (the halves of foveate eval --choose). Write the new model, fitted on all videos, as the section `[confidence]` that
/// replaces the configuration's section.
/// P(lost) decides when the tracker searches for a lost target, so a new model changes the tracks: `--rounds 2` tracks again with the new
/// model, and fits on both rounds. The printed scores are those of the last round. The same command resumes after Ctrl-C or a kill.
/// In --config and --set, {other} stands for the letter of the half that a sequence is not of, as in foveate eval.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Tracker: a configuration file, or the name of a shipped configuration
    #[arg(long, value_name = "FILE|NAME", default_value = "natural")]
    config: String,
    #[command(flatten)]
    changes: Changes,
    #[command(flatten)]
    tracked: Tracked,
    /// Number of rounds, each with the model fitted on all tracks before: a better P(lost) changes the tracks
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=10))]
    rounds: u64,
    /// Fit only the weights of the second tracker: the tracker's own weights and boxes stay unchanged
    #[arg(long, conflicts_with = "only_localisation")]
    only_second_opinion: bool,
    /// Fit only the localisation, from which the covariance of the place and its credible regions follow: P(lost) and boxes stay unchanged
    #[arg(long)]
    only_localisation: bool,
    /// Output file for the section
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Write the cues of every frame to this CSV file
    #[arg(long, value_name = "FILE")]
    cues: Option<PathBuf>,
}

#[derive(Serialize)]
struct Section<'a> {
    confidence: &'a ConfidenceModel,
}

/// Runs the command.
pub(super) fn run(args: &Args) -> Result<()> {
    terminal::catch_interrupts();
    let read = |half: Half| {
        let name = args.config.replace(configure::OTHER, half.other().name());
        configure::read(&name, &args.changes.for_half(half))
    };
    let mut halves = Half::BOTH.map(read).into_iter().collect::<Result<Vec<_>>>()?;
    if halves[0].0.confidence != halves[1].0.confidence {
        return Err(Error::Invalid(format!(
            "{}: [confidence] of the two halves differs; the models are fitted to one, so give both the same",
            args.config
        )));
    }
    if halves.iter().any(|(config, _)| config.committee > 1) {
        return Err(Error::Invalid(format!(
            "{}: a committee's P(lost) is made of its members', and nothing of it is fitted; fit a member: --set committee=1",
            args.config
        )));
    }
    if args.only_second_opinion && halves.iter().any(|(config, _)| config.second_opinion.is_none()) {
        return Err(Error::Invalid(format!(
            "--only-second-opinion: {} has none; add second_opinion = \"builtin:natural-middle\" to it, or leave the option out",
            args.config
        )));
    }
    for (what, end) in [("its plot gets", "svg"), ("the folder of its finished tracks gets", "runs")] {
        if args.out.extension().is_some_and(|it| it == end) {
            let problem = format!(
                "--out is the file of the table; {what} the same name with .{end}; give another name, such as confidence.toml"
            );
            return Err(Error::Invalid(format!("{}: {problem}", args.out.display())));
        }
    }
    let (plot, finished) = (args.out.with_extension("svg"), args.out.with_extension("runs"));
    if let Some(cues) = args.cues.as_ref().filter(|cues| [&args.out, &plot, &finished].contains(cues)) {
        let problem = "table, plot or finished tracks are written under the same name; give another one";
        return Err(Error::Invalid(format!("--cues {}: {problem}", cues.display())));
    }
    for path in [&args.out, &plot].into_iter().chain(&args.cues) {
        writable(path)?;
        spare(path, &[args.config.as_ref()])?;
    }
    let (videos, store) = (Videos::of(&args.tracked)?, Store { folder: finished, ..Store::default() });
    let mut tracks: Vec<Judgement> = vec![];
    let (mut before, mut kept) = (0, vec![]);
    for round in 1..=args.rounds {
        before = tracks.len();
        let blueprints = halves.iter().map(|(config, folder)| config.clone().check(folder)).collect::<Result<_>>()?;
        let jobs = videos.jobs(&args.tracked, blueprints)?;
        kept.extend(jobs.keys());
        let Some(made) = jobs.tracks(&store, &format!("confidence, round {round}"))? else {
            return Err(runs::stopped(&store.folder));
        };
        tracks.extend(made);
        if round < args.rounds {
            let fitted = args.fitting()(&tracks.iter().collect::<Vec<_>>(), &halves[0].0.confidence)?;
            halves.iter_mut().for_each(|(config, _)| config.confidence = fitted.clone());
        }
    }
    judge(args, &tracks, before, &halves[0].0.confidence)?;
    // The next call starts from the beginning.
    store.forget(kept)
}

impl Args {
    fn fitting(&self) -> Fitting {
        match (self.only_second_opinion, self.only_localisation) {
            (true, _) => fit_second_opinion,
            (_, true) => fit_localisation,
            _ => fit,
        }
    }
}

/// Prints the scores of the tracks from `from` on, and writes the model fitted on all tracks.
fn judge(args: &Args, tracks: &[Judgement], from: usize, confidence: &ConfidenceModel) -> Result<()> {
    let slices = |tracks: &[Vec<Judged>]| ConfidenceScore::of(&tracks.iter().map(Vec::as_slice).collect::<Vec<_>>());
    let last = &tracks[from..];
    let now: Vec<Vec<Judged>> = last.iter().map(|t| t.frames.clone()).collect();
    say!("The model that the tracks were made with:\n{}", confidence::text(&slices(&now)));
    if let Some(path) = &args.cues {
        files::write(path, csv(tracks).as_bytes())?;
    }
    let unseen = cross_fit(tracks, confidence, args.fitting(), by_source)?.split_off(from);
    say!("New models, leave one source video out (boxes and searches are those of the model before):");
    say!("{}", confidence::text(&slices(&unseen)));
    let (plain, occluded): (Vec<usize>, Vec<usize>) = (0..last.len()).partition(|i| !last[*i].occluded);
    for (name, such) in [("without", plain), ("with", occluded)].into_iter().filter(|(_, such)| !such.is_empty()) {
        let of: Vec<Vec<Judged>> = such.iter().map(|i| unseen[*i].clone()).collect();
        say!("Of these, videos {name} an inserted occlusion:\n{}", confidence::text(&slices(&of)));
    }
    match cross_fit(tracks, confidence, args.fitting(), by_half) {
        Ok(halves) => {
            let others = [("the model before", &now), ("all other sources", &unseen)];
            judged_on_halves(last, &others, &halves[from..])
        }
        Err(e) => say!("Not judged by halves: {e}"),
    }
    let table = args.fitting()(&tracks.iter().collect::<Vec<_>>(), confidence)?;
    let text = toml::to_string(&Section { confidence: &table }).map_err(|e| Error::Invalid(e.to_string()))?;
    files::write(&args.out, format!("# foveate {}\n{text}", crate::invocation::arguments()).as_bytes())?;
    let plot = args.out.with_extension("svg");
    let scores = [("present", slices(&now)), ("new, leave one source out", slices(&unseen))];
    files::write(&plot, confidence_plot::plot(&scores.each_ref().map(|(name, score)| (*name, score))).as_bytes())?;
    say!("{text}\nwrote {} and {}", args.out.display(), plot.display());
    Ok(())
}

/// Prints the scores of models fitted on one half of the videos and tested on the other, and pooled, beside those of other models.
fn judged_on_halves(tracks: &[Judgement], others: &[(&str, &Vec<Vec<Judged>>)], halves: &[Vec<Judged>]) {
    for (occluded, kind) in [(false, "without"), (true, "with")] {
        if tracks.iter().all(|t| t.occluded != occluded) {
            continue;
        }
        let score = |judged: &[Vec<Judged>], half: Option<&str>| {
            let such = tracks.iter().zip(judged).filter(|(t, _)| t.occluded == occluded);
            let such = such.filter(|(t, _)| half.is_none_or(|half| by_half(&t.origin) == half));
            ConfidenceScore::of(&such.map(|(_, track)| track.as_slice()).collect::<Vec<_>>())
        };
        let of_others = others.iter().map(|(name, judged)| (format!("{name}, all"), score(judged, None)));
        let by_halves =
            [("half b, half a", Some("a")), ("half a, half b", Some("b")), ("the other half, all (pooled)", None)];
        let by_halves = by_halves.map(|(name, half)| (name.to_owned(), score(halves, half)));
        let lines: Vec<(String, ConfidenceScore)> = of_others.chain(by_halves).collect();
        say!(
            "By what P(lost) was fitted on, videos {kind} an inserted occlusion:\n{}",
            confidence_cross::text("fitted on, judged on", &lines)
        );
    }
}

fn csv(tracks: &[Judgement]) -> String {
    let mut text = format!("track,video,occlusion,visible,p_lost,reported,iou,{}\n", CUE_NAMES.join(","));
    for (i, track) in tracks.iter().enumerate() {
        let video = quoted(&track.video);
        for j in &track.frames {
            let [occluded, visible, reported] = [track.occluded, j.off.is_some(), !j.status.is_usable()].map(u8::from);
            text += &format!("{i},{video},{occluded},{visible},{},{reported},{}", j.p_lost, j.iou);
            j.cues.iter().for_each(|c| text += &format!(",{c}"));
            text.push('\n');
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate::Status;
    use foveate::lab::eval::catalogue::origin;

    #[test]
    fn a_video_may_have_any_name() {
        let (status, cues) = (Status::Tracking, [0.0; CUE_NAMES.len()]);
        let frame =
            Judged { p_lost: 0.5, status, cues, iou: 1.0, off: None, covariance: [0.0; 3], place: Default::default() };
        let track = Judgement { video: "=a,b".into(), origin: origin("=a,b"), occluded: false, frames: vec![frame] };
        let text = csv(&[track]);
        assert!(text.lines().nth(1).is_some_and(|line| line.starts_with("0,\"'=a,b\",0,0,0.5,0,1,")), "{text}");
    }
}
