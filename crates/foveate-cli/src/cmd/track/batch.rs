//! Runs `foveate track` on many videos: one folder per video, finished videos skipped, failures listed, and an index with the worst first.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::CommandFactory;
use clap::parser::ValueSource;
use foveate::lab::eval::experiment;
use foveate::report::{card, document, escape};
use foveate::text::{counted, visible};
use foveate::{Error, Result, files, quiet};
use serde::{Deserialize, Serialize};

use super::args::Args;
use super::init::first_box;
use super::{Tally, one};
use crate::cmd::results::is_finished;
use crate::runs::Entry;
use crate::terminal;

/// Records the state of every video, for a second call and for programs.
const LIST: &str = "runs.json";
/// Shows all videos.
const PAGE: &str = "index.html";
/// Lists the errors of those that failed.
const FAILURES: &str = "failures.txt";

#[derive(Serialize, Deserialize)]
struct Runs {
    /// The command without its videos: runs with different settings do not mix.
    settings: String,
    /// A digest of the resolved settings.
    #[serde(default)]
    configuration: String,
    /// The runs by the name of the video's folder.
    runs: BTreeMap<String, Run>,
}

/// The result of one video.
#[derive(Serialize, Deserialize)]
struct Run {
    source: String,
    /// The first box, if it was read from a file beside the video.
    #[serde(default)]
    first: Option<String>,
    #[serde(flatten)]
    tally: Tally,
    error: Option<String>,
}

impl Run {
    /// Sort key: failures first, then by the fraction of occluded or lost frames, then of lost ones.
    fn badness(&self) -> (bool, f64, f64) {
        let share = |n: usize| n as f64 / self.tally.frames.max(1) as f64;
        (
            self.error.is_some(),
            share(self.tally.occluded_frames + self.tally.lost_frames),
            share(self.tally.lost_frames),
        )
    }
}

/// Tracks through each of `args.sources`.
///
/// # Errors
/// An option applies to a single video, two videos have the same name, or the folder has runs with other settings; at the end, if videos
/// failed.
pub(super) fn run(mut args: Args) -> Result<()> {
    refuse(&args)?;
    let (root, sources) = (args.out.clone(), std::mem::take(&mut args.sources));
    let videos = named(&sources)?;
    let (settings, configuration) = (settings()?, configuration(&args)?);
    std::fs::create_dir_all(&root).map_err(Error::io(&root, "cannot make the folder for results"))?;
    let mut runs = Runs::read(&root, settings, configuration)?;
    let json = std::mem::take(&mut args.json);
    if json {
        terminal::give_output();
    }
    let total = videos.len();
    let mut finished = 0;
    for (i, (name, source)) in videos.iter().enumerate() {
        let (out, source_name, first) = (root.join(name), source.to_string_lossy(), first(&args, source));
        let done = |run: &Run| run.error.is_none() && run.source == source_name && run.first == first;
        let done = runs.runs.get(name).is_some_and(done);
        if done && is_finished(&out) {
            finished += 1;
            continue;
        }
        note!("{} of {total}: {}", i + 1, visible(&source_name));
        // A damaged video must not end the other runs.
        let result = quiet::catch(|| one(&args, source, &out)).unwrap_or_else(|panic| Err(Error::Invalid(panic)));
        let (tally, error) = match result {
            Ok(tally) => (tally, None),
            Err(error) => (Tally::default(), Some(error.to_string())),
        };
        if let Some(error) = &error {
            note!("foveate: {error}");
        }
        runs.runs.insert(name.clone(), Run { source: source_name.into_owned(), first, tally, error });
        runs.write(&root)?;
    }
    runs.write(&root)?;
    if json {
        terminal::document(format_args!("{}", runs.text()?));
    }
    let failed = videos.keys().filter(|name| runs.runs.get(*name).is_some_and(|run| run.error.is_some())).count();
    let (all, tracked) = (counted(total, "video"), total - finished - failed);
    say!("{all}: {finished} finished before, {tracked} tracked now, {failed} failed.");
    say!("{}: {PAGE}, {LIST}{}", root.display(), if failed > 0 { format!(", {FAILURES}") } else { String::new() });
    if failed > 0 {
        let list = root.join(FAILURES);
        return Err(Error::Invalid(format!(
            "{failed} of {all} failed: see {}; the same command tries them again",
            list.display()
        )));
    }
    Ok(())
}

/// Refuses options that apply to a single video.
fn refuse(args: &Args) -> Result<()> {
    let many = &args.many;
    let given = [
        (args.stream.is_some(), "--stream"),
        (args.load_state.is_some(), "--load-state"),
        (args.save_state.is_some(), "--save-state"),
        (!args.reinit.is_empty(), "--reinit"),
        (many.detections.is_some(), "--detections"),
        (many.save_detections.is_some(), "--save-detections"),
        (many.inits.is_some(), "--inits"),
    ];
    match given.iter().find(|(given, _)| *given) {
        Some((_, name)) => Err(Error::Invalid(format!("{name} is for one video; give one, or leave it out"))),
        None => Ok(()),
    }
}

/// Returns the videos by the names of their folders: the file name without its extension.
fn named(sources: &[PathBuf]) -> Result<BTreeMap<String, &PathBuf>> {
    let mut named = BTreeMap::new();
    for source in sources {
        let whole = std::path::absolute(source).map_err(Error::io(source, "cannot find"))?;
        let name = if whole.is_dir() { whole.file_name() } else { whole.file_stem() };
        let name = name.unwrap_or_default().to_string_lossy().into_owned();
        if name.is_empty() || super::source::is_endless(source) {
            return Err(Error::malformed(source, "expected video files or folders of images; track it alone"));
        }
        if [LIST, PAGE, FAILURES].contains(&name.as_str()) {
            let problem = format!("{name} in the folder for results is a list of all videos; rename the video");
            return Err(Error::malformed(source, problem));
        }
        if let Some(other) = named.insert(name.clone(), source) {
            let problem = format!("its results would be in {name}, as those of {}; rename one", other.display());
            return Err(Error::malformed(source, problem));
        }
    }
    Ok(named)
}

/// The fields that do not change results, by name.
const NO_SETTINGS: [&str; 5] = ["sources", "out", "json", "threads", "decoder"];

/// Returns the command without the videos and without options that do not change results; every option by its long name.
fn settings() -> Result<String> {
    let words = std::iter::once("foveate".to_owned()).chain(crate::invocation::words());
    let mut command = crate::Cli::command();
    let matches = command.try_get_matches_from_mut(words).map_err(|e| Error::Invalid(e.to_string()))?;
    let Some((name, given)) = matches.subcommand() else { return Ok(String::new()) };
    let mut settings = name.to_owned();
    let known = command.find_subcommand(name).into_iter().flat_map(clap::Command::get_arguments);
    for option in known.filter(|option| !NO_SETTINGS.contains(&option.get_id().as_str())) {
        let (id, long) = (option.get_id().as_str(), option.get_long().unwrap_or_default());
        if given.value_source(id) != Some(ValueSource::CommandLine) {
            continue;
        }
        for values in given.get_raw_occurrences(id).into_iter().flatten() {
            settings += &format!(" --{long}");
            let values = values.filter(|_| option.get_action().takes_values());
            values.for_each(|value| settings += &format!(" {}", value.to_string_lossy()));
        }
    }
    Ok(settings)
}

/// Returns a digest of the inputs of the results besides videos and first boxes: the configuration, its models, the files of
/// a measurement and the program's version.
fn configuration(args: &Args) -> Result<String> {
    let (mut config, folder, _) = args.configured()?;
    if args.many.detect.is_some() {
        config.detector = None;
    }
    let mut parts = vec![Entry::of(args.blueprint(config, &folder)?, "track")?.key.into_bytes()];
    for model in args.models().filter(|model| model.is_file()) {
        parts.push(files::read(model, files::MODEL)?);
    }
    for path in args.measure.iter().flat_map(|measure| &measure.inputs) {
        parts.push(files::read(path, files::TEXT)?);
    }
    Ok(experiment::digest(&parts.iter().map(Vec::as_slice).collect::<Vec<_>>()))
}

/// Returns the box beside a video, if a run of it starts from that box; the run itself reports errors in it.
fn first(args: &Args, source: &Path) -> Option<String> {
    let beside = args.init.is_empty() && !args.many.asked();
    let bbox = beside.then(|| first_box(source, None, &args.input).ok()).flatten()?;
    Some(format!("{},{},{},{}", bbox.x, bbox.y, bbox.w, bbox.h))
}

impl Runs {
    fn read(root: &Path, settings: String, configuration: String) -> Result<Self> {
        let path = root.join(LIST);
        if !path.is_file() {
            return Ok(Self { settings, configuration, runs: BTreeMap::new() });
        }
        let text = files::read_text(&path, files::TEXT)?;
        let runs: Self = serde_json::from_str(&text)
            .map_err(|e| Error::malformed(&path, format!("not a list of runs ({e}); give another --out")))?;
        if runs.settings != settings {
            let problem = format!(
                "it lists runs of `foveate {}`, this is `foveate {settings}`; give another --out",
                runs.settings
            );
            return Err(Error::malformed(path, problem));
        }
        if runs.configuration != configuration {
            let problem = format!(
                "it lists runs of `foveate {settings}` with another configuration, model or version of the program than now; give \
                 another --out"
            );
            return Err(Error::malformed(path, problem));
        }
        Ok(runs)
    }

    fn text(&self) -> Result<String> {
        let text = serde_json::to_string_pretty(self).map_err(|e| Error::Invalid(e.to_string()))?;
        Ok(text + "\n")
    }

    fn write(&self, root: &Path) -> Result<()> {
        files::write_inside(root.join(LIST), self.text()?.as_bytes())?;
        files::write_inside(root.join(PAGE), self.page(root).as_bytes())?;
        let failures = root.join(FAILURES);
        let failed = self.runs.values().filter_map(|run| Some((&run.source, run.error.as_ref()?)));
        let lines: String =
            failed.map(|(source, error)| format!("{}\t{}\n", visible(source), visible(error))).collect();
        if lines.is_empty() {
            // The file may not exist.
            let _ = std::fs::remove_file(failures);
            return Ok(());
        }
        files::write_inside(failures, lines.as_bytes())
    }

    /// Returns the index page, with the worst videos first.
    fn page(&self, root: &Path) -> String {
        let mut order: Vec<(&String, &Run)> = self.runs.iter().collect();
        order.sort_by(|(_, a), (_, b)| b.badness().partial_cmp(&a.badness()).expect("finite numbers"));
        let mut rows = String::new();
        for (name, run) in order {
            let Tally { frames, occluded_frames, lost_frames } = run.tally;
            let report = if root.join(name).join("report.html").is_file() { "report.html" } else { "" };
            let shown = match root.join(name).is_dir() {
                true => format!("<a href=\"{}/{report}\">{}</a>", address(name), escape(name)),
                false => escape(name),
            };
            let figures = run.error.as_ref().map_or_else(
                || {
                    format!(
                        "<td>{frames}</td><td>{occluded_frames}</td><td>{lost_frames}</td><td>{:.1}</td>",
                        100.0 * run.badness().1
                    )
                },
                |error| format!("<td class=\"words\" colspan=\"4\">{}</td>", escape(error)),
            );
            let _ = writeln!(rows, "<tr><td>{shown}</td>{figures}</tr>");
        }
        let heads =
            ["video", "frames", "occluded", "lost", "occluded or lost, %"].map(|head| format!("<th>{head}</th>"));
        let table = format!(
            "<div class=\"scroll\"><table class=\"numbers\">\n<tr>{}</tr>\n{rows}</table></div>\n",
            heads.concat()
        );
        document(
            &format!("{}, the worst first", counted(self.runs.len(), "video")),
            "Failures come first, then videos by the share of frames in which the target is occluded or lost.",
            "",
            &card("Videos", &table),
        )
    }
}

/// Encodes a folder's name for a URL.
fn address(name: &str) -> String {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"-_.~".contains(&b);
    name.bytes().map(|b| if plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") }).collect()
}
