//! Learned gaze rewards for each digit (section 6.2, the paper's figure of ten digits).

use foveate::gaze::PolicySnapshot;
use foveate::geometry::Gaze;
use foveate::identity::Retina;
use foveate::lab::synthetic::{Drawn, Synthetic};
use foveate::report::heat::Heat;
use foveate::report::surface::{Column, Panel, banner, glimpse_picture, mean_picture};
use foveate::report::template::Crop;
use foveate::video::{Frame, encode_png};
use foveate::{Error, Result, Tracker};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::output::{Figure, Picture};
use super::plan::Experiment;
use super::setup::{Job, Setup};
use foveate_cli::runs::{Entry, Finished};

/// Points along a side of the surfaces.
const POINTS: usize = 33;

/// The learned surface of one run.
#[derive(Clone, Serialize, Deserialize)]
struct Learned {
    heat: Heat,
    best: Gaze,
    /// Length of the video.
    frames: usize,
}

impl Finished for Learned {
    fn is_of(&self, frames: usize) -> bool {
        self.frames == frames && self.heat.mean.len() == POINTS * POINTS && self.heat.sd.len() == POINTS * POINTS
    }
}

impl Learned {
    /// Follows a video's target, and keeps the policy's final estimates.
    fn follow(video: &dyn Drawn, tracker: &mut Tracker) -> Result<Self> {
        for (index, truth) in video.truth().iter().enumerate() {
            let frame = Frame { index, time: index as f64 / 30.0, image: video.render(index) };
            match index {
                0 => tracker.init(&frame.image, *truth)?,
                _ => tracker.update(&frame.image).map(|_| ())?,
            }
        }
        let PolicySnapshot::Surface(surface) = tracker.parts().gaze.policy().snapshot() else {
            return Err(Error::Config(
                "surfaces are learned by the policy gp-ucb, alone or beside an anchor; this configuration has another"
                    .into(),
            ));
        };
        let best = surface.best().ok_or_else(|| Error::Config("the video is shorter than the warm-up".into()))?;
        Ok(Self { heat: Heat::of(surface, POINTS), best, frames: video.truth().len() })
    }
}

/// Computes reward surfaces: one video of each digit, followed by several trackers with different seeds. `None` if runs are missing.
pub(super) fn surfaces(experiment: &Experiment, setup: &Setup) -> Result<Option<Figure>> {
    let (mut figure, seeds, scene) = (Figure::default(), experiment.seeds, &experiment.scene()?.video);
    for (i, line) in experiment.lines.iter().enumerate() {
        let entries = [Entry::of(line.entry(&setup.settings)?.blueprint, "surfaces")?];
        let settings: Vec<Synthetic> =
            experiment.digits.iter().map(|&digit| scene.with(digit, seeds.first, experiment.frames)).collect();
        let job = |video: &Synthetic, seed| Job { entry: 0, scene: 0, video: video.clone(), seed };
        let jobs: Vec<Job> = settings.iter().flat_map(|v| seeds.iter().map(move |seed| job(v, seed))).collect();
        let runs = setup.runs(&experiment.name, &entries, &jobs, &Learned::follow)?;
        let Some(learned) = runs.into_iter().collect::<Option<Vec<_>>>() else { return Ok(None) };
        let videos = settings.iter().map(|video| video.video(&setup.digits)).collect::<Result<Vec<_>>>()?;
        let title = format!("Where it learned to look: {} runs on a video of each digit", seeds.count);
        let (bytes, rows) = picture(&title, &videos, &learned, &*entries[0].blueprint.retina());
        let caption =
            format!("{}: reward surfaces and best gazes; below, the mean of the views at the best gazes.", line.name);
        figure.pictures.push(Picture { file: format!("{}-{}.png", experiment.name, i + 1), caption, bytes });
        figure.numbers.push(json!({ "line": line.name, "points": POINTS, "surfaces": rows }));
    }
    Ok(Some(figure))
}

/// Returns the figure as PNG, and its numbers: one column per video, with the same number of consecutive runs each.
fn picture(title: &str, videos: &[Box<dyn Drawn>], learned: &[Learned], retina: &dyn Retina) -> (Vec<u8>, Vec<Value>) {
    let runs = (learned.len() / videos.len().max(1)).max(1);
    let first: Vec<_> = videos.iter().map(|video| video.render(0)).collect();
    let templates: Vec<_> =
        videos.iter().zip(&first).map(|(video, image)| Crop::around(image, &video.truth()[0]).closer(1.2)).collect();
    let heats: Vec<_> = learned
        .chunks(runs)
        .map(|runs| Heat::average(&runs.iter().map(|run| run.heat.clone()).collect::<Vec<_>>()))
        .collect();
    let bests: Vec<Vec<Gaze>> = learned.chunks(runs).map(|runs| runs.iter().map(|run| run.best).collect()).collect();
    let columns: Vec<_> = (0..videos.len())
        .map(|i| Column {
            panel: Panel {
                map: heats[i].as_ref().map(|heat| (heat, &heat.mean[..], "mean reward")),
                best: &bests[i],
                ..Panel::of(&videos[i].label().to_string(), &templates[i])
            },
            view: mean_picture(
                &bests[i]
                    .iter()
                    .filter_map(|&gaze| glimpse_picture(&first[i], &videos[i].truth()[0], retina, gaze))
                    .collect::<Vec<_>>(),
            ),
        })
        .collect();
    let row = |i: usize| {
        let best: Vec<_> = bests[i].iter().map(|gaze| [gaze.u, gaze.v]).collect();
        json!({ "digit": videos[i].label(), "best": best, "mean": heats[i].as_ref().map(|heat| &heat.mean) })
    };
    (encode_png(banner(title, &columns).image()), (0..videos.len()).map(row).collect())
}
