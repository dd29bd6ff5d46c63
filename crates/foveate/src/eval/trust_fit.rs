//! Fits the table of [`Confidence`] on tracks with truth, and says how well it does on a video it has not seen.

use super::trust::{Judged, TrustScore};
use crate::Result;
use crate::control::{CUES, Confidence, Cues};
use crate::geometry::BBox;
use crate::rows::Rows;
use crate::scene::hide::Hide;
use crate::scene::{Frame, Image, Scout};
use crate::softmax::{Fit, Softmax};
use crate::tracker::Tracker;

/// The pull of the weights towards 0.
const L2: f64 = 1e-3;

/// One tracker on one video, and which video that was.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// Tracks of the same video are left out together.
    pub video: String,
    /// Whether its target was made to vanish.
    pub hidden: bool,
    /// From the second frame on.
    pub frames: Vec<Judged>,
}

/// Follows a video of which every frame can be had, with or without a target that vanishes, up to `last`; the truth is
/// that of the video as it is seen.
///
/// # Errors
/// A picture cannot be had, or the tracker refuses the first box.
pub fn follow(
    truth: &[Option<BBox>],
    last: usize,
    hide: Option<&Hide>,
    picture: &dyn Fn(usize) -> Result<Image>,
    (scout, tracker): (&mut Scout, &mut Tracker),
) -> Result<Vec<Judged>> {
    let mut frames = vec![];
    for (index, &there) in truth.iter().enumerate().take(last + 1) {
        let image = picture(index)?;
        let (image, there) = match hide {
            Some(hide) => (hide.apply(index, &image, there), hide.truth(index, there)),
            None => (image, there),
        };
        let frame = Frame { index, time: index as f64 / 30.0, image };
        scout.look(&frame);
        if index == 0 {
            let absent = || crate::Error::Invalid("the target is absent in frame 1, where a tracker starts".into());
            tracker.start(&frame, there.ok_or_else(absent)?)?;
            continue;
        }
        if let Some(flow) = scout.flow() {
            tracker.guide(flow);
        }
        frames.push(Judged::of(&tracker.step(scout.scene(&frame)), there));
    }
    Ok(frames)
}

/// Weights, bias and blur fitted on these tracks; all else as it was. Videos as they are and those with a vanishing target count
/// about the same, however many frames there are of each: neither is what tomorrow's videos are like.
///
/// # Errors
/// There is no frame, or none of one of the two kinds.
pub fn fit(tracks: &[&Judgement], confidence: &Confidence) -> Result<Confidence> {
    let count = |hidden: bool| tracks.iter().filter(|t| t.hidden == hidden).map(|t| t.frames.len()).sum::<usize>();
    let more = |of: bool| (count(!of) as f64 / count(of).max(1) as f64).round().clamp(1.0, 10.0) as usize;
    let times = [more(false), more(true)];
    let frames = || tracks.iter().flat_map(|t| std::iter::repeat_n(&t.frames, times[usize::from(t.hidden)])).flatten();
    let rows: Vec<f32> = frames().flat_map(|j| j.cues.map(|c| c as f32)).collect();
    let labels: Vec<u8> = frames().map(|j| u8::from(j.lost())).collect();
    if !(labels.contains(&0) && labels.contains(&1)) {
        return Err(crate::Error::Invalid(format!(
            "a table of confidence needs frames on the target and lost ones; these {} are all of one kind",
            labels.len()
        )));
    }
    let settings = Fit { l2: L2, steps: 500, tolerance: 1e-6 };
    let model = Softmax::fit(Rows::new(&rows, CUES), &labels, 2, settings)?;
    // The model is linear in the log-odds: they are read off at 0 and at each cue's 1.
    let log_odds = |at: usize| {
        let (mut row, mut log_p) = ([0f32; CUES], [0.0; 2]);
        row.iter_mut().enumerate().for_each(|(k, c)| *c = f32::from(u8::from(k == at)));
        model.log_probabilities(Rows::new(&row, CUES), &mut log_p);
        log_p[1] - log_p[0]
    };
    let bias = log_odds(CUES);
    let weights: Cues = std::array::from_fn(|k| log_odds(k) - bias);
    let such: Vec<&[Judged]> = tracks.iter().map(|t| &t.frames[..]).collect();
    let blur = TrustScore::of(&such, 0.0).best_blur.unwrap_or(confidence.blur);
    let mut table = confidence.clone();
    (table.weights, table.bias, table.blur) = (weights, bias, blur);
    Ok(table)
}

/// The tracks as a table says that has not seen their video, and the blur for each.
///
/// # Errors
/// As [`fit`].
pub fn leave_one_out(tracks: &[Judgement], confidence: &Confidence) -> Result<Vec<(Vec<Judged>, f64)>> {
    let mut videos: Vec<&str> = tracks.iter().map(|t| t.video.as_str()).collect();
    videos.sort();
    videos.dedup();
    let mut judged = vec![];
    for video in videos {
        let (mine, others): (Vec<&Judgement>, Vec<_>) = tracks.iter().partition(|t| t.video == video);
        let table = fit(&others, confidence)?;
        judged.extend(mine.iter().map(|t| (TrustScore::rejudged(&t.frames, &table), table.blur)));
    }
    Ok(judged)
}
