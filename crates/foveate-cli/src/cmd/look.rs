//! Implements `foveate look`: draws salient or moving regions of one frame.

use std::path::PathBuf;

use clap::ValueEnum;
use foveate::geometry::Size;
use foveate::report::draw::{Colour, Drawing};
use foveate::scene::{Detector, Flow, Map, Motion, Saliency};
use foveate::text::counted;
use foveate::video::{Frame, ahead, open_with, save_png};
use foveate::{Error, Result};

use super::results::spare;
use super::track::source::DecoderArgs;

#[derive(clap::Args)]
#[command(after_help = "Example: foveate look video.mp4 --map flow --frame 120 --out look.png")]
pub(crate) struct Args {
    /// Video file or folder of images
    source: PathBuf,
    #[command(flatten)]
    decoder: DecoderArgs,
    /// Kind of map
    #[arg(long, value_enum, default_value_t = Kind::Saliency)]
    map: Kind,
    /// Frame to analyse, counted from 1; motion and flow also read the frames before it. Default: frame 30, or the last frame of a shorter
    /// video
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    frame: Option<u64>,
    /// Maximum number of candidates that get a box
    #[arg(long, value_name = "N", default_value_t = 10)]
    most: usize,
    /// Output image: the frame with the candidates' boxes, and the map beside it
    #[arg(long, short, value_name = "FILE.png", default_value = "look.png")]
    out: PathBuf,
}

#[derive(ValueEnum, Clone, Copy)]
enum Kind {
    /// Regions that differ from their surroundings, from one frame alone (Itti and Koch)
    Saliency,
    /// Regions that move differently from the camera (dense optical flow)
    Flow,
    /// Regions that differ from the background model; for a camera that stands still
    Motion,
}

impl Kind {
    fn detector(self) -> Box<dyn Detector> {
        match self {
            Self::Saliency => Box::<Saliency>::default(),
            Self::Flow => Box::<Flow>::default(),
            Self::Motion => Box::<Motion>::default(),
        }
    }
}

/// Runs the command.
pub(crate) fn run(args: Args) -> Result<()> {
    if args.out.extension().is_some_and(|extension| !extension.eq_ignore_ascii_case("png")) {
        return Err(Error::malformed(args.out, "the picture is a PNG; give a name that ends in .png"));
    }
    spare(&args.out, &[&args.source])?;
    let wanted = args.frame.map_or(29, |n| usize::try_from(n - 1).unwrap_or(usize::MAX));
    let (mut detector, mut found) = (args.map.detector(), vec![]);
    let mut last: Option<Frame> = None;
    let options = args.decoder.options();
    for frame in ahead(open_with(&args.source, &options)?) {
        let frame = frame?;
        // Saliency needs only one frame: the last one read.
        if !matches!(args.map, Kind::Saliency) {
            detector.detect(&frame.image, &mut found);
        }
        let index = frame.index;
        last = Some(frame);
        if index >= wanted {
            break;
        }
    }
    let Some(frame) = last else {
        return Err(Error::Invalid(format!("{}: no frames; give a video that has some", args.source.display())));
    };
    if args.frame.is_some() && frame.index < wanted {
        return Err(Error::Invalid(format!(
            "{}: there is no frame {}, the last is {}; give a smaller --frame",
            args.source.display(),
            wanted.saturating_add(1),
            frame.index + 1
        )));
    }
    if matches!(args.map, Kind::Saliency) {
        detector.detect(&frame.image, &mut found);
    }
    let size @ Size { width, height } = frame.image.size();
    let mut page = Drawing::new(2 * width, height, [0; 3]);
    page.paste(&frame.image, 0, 0, width, height);
    heat(&mut page, detector.map(), width as f64, size);
    say!(
        "frame {}: {}, the largest value of the map is {:.3}",
        frame.index + 1,
        counted(found.len(), "candidate"),
        detector.map().max()
    );
    for (k, d) in found.iter().take(args.most).enumerate() {
        let b = d.bbox;
        say!("{:.0},{:.0},{:.0},{:.0}  score {:.3}", b.x + 1.0, b.y + 1.0, b.w, b.h, d.score);
        for left in [0.0, width as f64] {
            let (x, y) = (left + b.x, b.y);
            let corners = [(x, y), (x + b.w - 1.0, y), (x + b.w - 1.0, y + b.h - 1.0), (x, y + b.h - 1.0)];
            page.outline(&corners, 1.5, if k == 0 { [255, 80, 60] } else { [80, 220, 255] }, 1.0);
        }
    }
    save_png(&args.out, page.image())?;
    say!("{}", args.out.display());
    Ok(())
}

/// Draws a map with a scale from black through violet and orange to pale yellow for the largest value.
fn heat(page: &mut Drawing, map: &Map, left: f64, Size { width, height }: Size) {
    const RAMP: [Colour; 5] = [[0, 0, 4], [87, 16, 110], [188, 55, 84], [249, 142, 9], [252, 255, 164]];
    let scale = (RAMP.len() - 1) as f32 / map.max().max(f32::MIN_POSITIVE);
    page.shade(left, 0.0, width as f64, height as f64, |x, y| {
        let at = (map.at_pixel((x - left) as f32, y as f32) * scale).clamp(0.0, (RAMP.len() - 1) as f32);
        let k = (at as usize).min(RAMP.len() - 2);
        let mix =
            |p: usize| f32::from(RAMP[k][p]) + (at - k as f32) * (f32::from(RAMP[k + 1][p]) - f32::from(RAMP[k][p]));
        Some((std::array::from_fn(|p| mix(p).round() as u8), 1.0))
    });
}
