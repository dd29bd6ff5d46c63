//! Implements `foveate measure`: motion in metres and seconds, from a video or from the track.csv of a run.

use std::path::{Path, PathBuf};

use foveate::BBox;
use foveate::lab::measure::{self, Axes, Clock, Earlier, FitRequest, Lens, Ruler, Settings, Track};
use foveate::text::counted;
use foveate::{Error, Result};

use super::convert::Format;
use super::results::{self, spare};
use super::track;
use super::track::init::parse_box;

/// Help text on the results.
const FILES: &str = "\
Several --init measure several points; each is tracked on its own.

The output folder also has measure.csv (times, positions, velocities and accelerations with their standard errors), fits.json, ask.csv
(the frames to look at), measure.html, and measure.trk for Tracker (Open Source Physics). All points, origins and boxes count pixels from 1. y points up. Results of a fit have the errors of tracking, scale and clock.

Example: foveate measure ball.mp4 --init 310,40,28,28 --ruler 100,60,100,460=1.000+-0.002m --fit parabola:y";

/// Returns the options that say how a video is read and tracked: all of a run but the folder and the scale of its results, and some of ours.
fn of_a_video() -> impl Iterator<Item = clap::Id> {
    let command = <track::Args as clap::Args>::augment_args(clap::Command::new("track"));
    let options: Vec<clap::Id> = command.get_arguments().map(|option| option.get_id().clone()).collect();
    let options = options.into_iter().filter(|option| option != "out" && option != "scale");
    options.chain(["reference", "keyframes", "format"].map(clap::Id::from))
}

/// Options of streams and of many targets, which a measurement refuses.
const HIDDEN: [&str; 11] = [
    "every_frame",
    "max_latency",
    "listen",
    "reconnect",
    "detect",
    "detections",
    "least",
    "classes",
    "layout",
    "inits",
    "save_detections",
];

#[derive(clap::Args)]
#[command(after_help = FILES, mut_arg("sources", of_files), mut_args(|arg| match HIDDEN.contains(&arg.get_id().as_str()) {
    true => arg.hide(true),
    false => arg,
}))]
pub(crate) struct MeasureArgs {
    /// Measure an existing track.csv of `foveate track` instead of a video
    #[arg(long, value_name = "track.csv", conflicts_with_all = of_a_video())]
    track: Option<PathBuf>,
    /// Scale: two points in the picture and the length between them, with its standard error and unit (mm, cm, m, km, in, ft; default: m).
    /// Without it lengths are in pixels
    #[arg(long, value_name = "X1,Y1,X2,Y2=LENGTH[+-ERROR][UNIT]", allow_hyphen_values = true)]
    ruler: Option<Ruler>,
    /// Names of the points in the results, in the order of --init. Default: 1, 2, ...
    #[arg(long, value_name = "NAME,NAME", value_delimiter = ',')]
    names: Vec<String>,
    /// Origin of the coordinates. Default: the first position of the first point
    #[arg(long, value_name = "X,Y", value_parser = measure::parse_point, allow_hyphen_values = true)]
    origin: Option<(f64, f64)>,
    /// Direction of the x axis, degrees anticlockwise from the picture's right
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, hide_default_value = true, value_parser = measure::parse_angle, allow_hyphen_values = true)]
    angle: f64,
    /// Frames per second at which the scene was recorded, for slow motion or wrong time stamps. Default: the times of the video; with --track,
    /// the rate of the fits.json beside it
    #[arg(long, value_name = "RATE[+-ERROR]")]
    fps: Option<Clock>,
    /// Fit a curve to x or y: line, parabola (y: g), sine (period), damped, exponential or drag (y: g), over all times or a range in
    /// seconds, such as parabola:y:0.10-0.45. Repeatable
    #[arg(long, value_name = "CURVE:x|y[:FROM-TO]")]
    fit: Vec<FitRequest>,
    /// Moving camera: a box in the first frame around a thing at rest. It is tracked too, and positions are relative to it
    #[arg(long, value_name = "X,Y,W,H", value_parser = parse_box, allow_hyphen_values = true)]
    reference: Option<BBox>,
    /// Key frames: boxes of the target that you drew in some frames, as for `foveate annotate`. Tracking starts at the first one and restarts
    /// at each of the others. Add the frames of ask.csv, and measure again. Their pixels are those of the video, whatever --scale is
    #[arg(long, value_name = "FILE", requires = "format", conflicts_with_all = ["init", "reinit", "from", "load_state"])]
    keyframes: Option<PathBuf>,
    /// Format of the key frames
    #[arg(long, value_enum, requires = "keyframes")]
    format: Option<Format>,
    /// Calibration of the camera, which takes out the distortion of the lens: a file of OpenCV (YAML, XML, JSON) with camera matrix and
    /// distortion coefficients
    #[arg(long, value_name = "FILE")]
    lens: Option<PathBuf>,
    #[command(flatten)]
    run: track::Args,
}

/// Returns the argument of `foveate track` for files alone.
fn of_files(sources: clap::Arg) -> clap::Arg {
    let help = "Video file; folder of images or of tiles (foveate tiles)";
    sources.required(false).required_unless_present("track").help(help)
}

pub(crate) fn run(args: MeasureArgs) -> Result<()> {
    let MeasureArgs {
        track: file,
        ruler,
        names,
        origin,
        angle,
        fps: clock,
        fit: fits,
        reference,
        keyframes,
        format,
        lens: calibration,
        mut run,
    } = args;
    let lens = calibration.as_deref().map(Lens::read).transpose()?;
    let mut settings = Settings { axes: Axes { ruler, origin, angle }, lens, picture: None, clock, fits };
    let names = named(names, if file.is_some() { 1 } else { run.init.len().max(1) }, file.is_some())?;
    let Some(file) = file else {
        if let Some((path, format)) = keyframes.as_ref().zip(format) {
            run.start_at_key_frames(path, format)?;
        }
        let inputs = keyframes.into_iter().chain(calibration).collect();
        run.measure = Some(track::Measure { settings, names, reference, inputs });
        return track::run(run);
    };
    let folder = &run.out;
    for name in measure::FILES {
        let inputs: Vec<&Path> =
            [Some(&file), calibration.as_ref()].into_iter().flatten().map(PathBuf::as_path).collect();
        spare(&folder.join(name), &inputs)?;
    }
    let earlier = Earlier::beside(&file)?;
    if earlier.reference {
        let problem = "it was measured relative to --reference, whose track it does not hold; measure the video again";
        return Err(Error::malformed(file, problem));
    }
    if earlier.lens && settings.lens.is_none() {
        let problem = "it was measured with --lens, and its positions have the distortion; give --lens again, or move the fits.json beside it";
        return Err(Error::malformed(file, problem));
    }
    settings.picture = earlier.picture;
    settings.check()?;
    if let (None, Some(earlier)) = (clock, earlier.fps) {
        say!("{} frames per second, of the fits.json beside the track; --fps changes them", earlier.rate);
        settings.clock = Some(earlier);
    }
    let point = Track { name: names.concat(), positions: measure::read(&file)? };
    let measured = measure::measure(&[point], None, &settings).map_err(super::of_file(&file))?;
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "cannot make the folder for results"))?;
    let scale = match run.input.selection().scale {
        1.0 => earlier.scale.unwrap_or(1.0),
        scale => scale,
    };
    measure::write(folder, (&file.display().to_string(), scale), &measured)?;
    // Of that track: another one in the same folder must not find them.
    if file.canonicalize().ok().as_deref().and_then(Path::parent) == folder.canonicalize().ok().as_deref() {
        results::add(folder, &measure::FILES)?;
    }
    measure::text(&measured).iter().for_each(|line| say!("{line}"));
    say!("{}: {}", folder.display(), measure::FILES.join(", "));
    Ok(())
}

/// Returns the names of so many points: those given, or their numbers.
fn named(names: Vec<String>, count: usize, tracked: bool) -> Result<Vec<String>> {
    if names.is_empty() {
        return Ok((1..=count).map(|k| k.to_string()).collect());
    }
    let (points, given) = (counted(count, "point"), counted(names.len(), "name"));
    if names.len() != count {
        let advice = if tracked { "a track has one point" } else { "give one for each --init" };
        return Err(Error::Invalid(format!("--names: {given} for {points}; {advice}")));
    }
    if let Some(name) = names.iter().enumerate().find_map(|(i, name)| names[..i].contains(name).then_some(name)) {
        return Err(Error::Invalid(format!("--names: two points are named {name:?}; give each its own")));
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use clap::Args;

    use super::*;

    /// An option of a run is refused with --track, unless it is listed here because it applies; and hidden options are options.
    #[test]
    fn options_of_a_run_are_refused_with_a_track() {
        let command = MeasureArgs::augment_args(clap::Command::new("measure"));
        let known = |name: &str| command.get_arguments().find(|option| option.get_id() == name);
        let refused = command.get_arg_conflicts_with(known("track").expect("an option"));
        for option in track::Args::augment_args(clap::Command::new("track")).get_arguments() {
            let (id, applies) = (option.get_id(), ["out", "scale"].contains(&option.get_id().as_str()));
            assert_eq!(refused.iter().any(|other| other.get_id() == id), !applies, "{id}");
        }
        assert!(HIDDEN.into_iter().all(|name| known(name).is_some()));
    }
}
