//! The reported status follows from the reported P(lost): row by row, for every configuration that ships, through an occlusion.

use crate::common::{INIT, frame, truth};
use foveate::config::Config;
use foveate::lab::Digits;
use foveate::lab::synthetic::{Clutter, Drawn, Occlusion, Synthetic};
use foveate::multi::Phase;
use foveate::scene::Image;
use foveate::{BBox, Status, Tracker};

/// The results of one frame.
struct Row {
    p_lost: f64,
    status: Status,
    /// Where it is informative.
    deficit: Option<f64>,
    iou: f64,
}

/// Frames in which nothing of the target is seen: long enough for a loss.
const HIDDEN: std::ops::Range<usize> = 20..50;
const FRAMES: usize = 70;

/// The moving patch, covered by its surroundings while it is hidden.
fn natural_scene(planes: usize) -> Vec<(Image, BBox)> {
    let picture = |t: usize| {
        let (at, mut image) = (truth(t), frame(t, planes).image);
        if HIDDEN.contains(&t) {
            let empty = frame(1000, planes).image;
            for plane in 0..planes {
                for y in at.y as usize..(at.y + at.h) as usize {
                    let row = y * 120 + at.x as usize..y * 120 + ((at.x + at.w) as usize).min(120);
                    image.plane_mut(plane)[row.clone()].copy_from_slice(&empty.plane(plane)[row]);
                }
            }
        }
        (image, at)
    };
    (0..FRAMES).map(picture).collect()
}

/// A digit, all of whose picture is black while it is hidden.
fn digit_scene(scene: &Synthetic) -> Vec<(Image, BBox)> {
    let video = scene.video(&Digits::drawn(3, 20)).expect("a scene");
    let truth = video.truth().to_vec();
    let pictures = video.source().take(FRAMES).map(|frame| frame.expect("it is drawn").image);
    let hide = |(t, image): (usize, Image)| {
        if HIDDEN.contains(&t) { Image::grey(image.width(), image.height(), 0) } else { image }
    };
    pictures.enumerate().map(hide).zip(truth).collect()
}

fn run(config: &Config, scene: &[(Image, BBox)]) -> Vec<Row> {
    let mut tracker = Tracker::new(config).expect("parts that fit");
    tracker.init(&scene[0].0, scene[0].1).expect("a box in the picture");
    let row = |(image, truth): &(Image, BBox)| {
        let seen = tracker.update(image).expect("a picture of the first size");
        assert_eq!(seen.is_lost(), seen.status == Status::Lost);
        assert_eq!(seen.is_usable(), seen.phase == Phase::Tracked);
        let consistency = seen.consistency;
        let deficit = consistency.is_informative.then_some(consistency.deficit);
        Row { p_lost: seen.p_lost, status: seen.status, deficit, iou: seen.bbox.iou(truth) }
    };
    scene[1..].iter().map(row).collect()
}

fn check(name: &str, config: &Config, scene: &[(Image, BBox)], met: &mut [usize; 4]) {
    let rows = run(config, scene);
    // Of a committee the thresholds are those of its vote.
    let (enter, leave) = match config.committee {
        1 => (config.confidence.status.enter, config.confidence.status.leave),
        _ => (0.5, 0.45),
    };
    let mut usable = true;
    for (t, Row { p_lost, status, .. }) in rows.iter().enumerate() {
        let at = format!("{name}, frame {}: {status:?} with P(lost) {p_lost}", t + 1);
        match status.is_usable() {
            true => assert!(*p_lost < enter, "{at}"),
            false => assert!(*p_lost >= leave, "{at}"),
        }
        // Between the two thresholds it stays unchanged.
        let between = (leave..enter).contains(p_lost);
        assert!(!between || status.is_usable() == usable, "{at}");
        usable = status.is_usable();
        met[*status as usize] += 1;
    }
    // Before the occlusion the box is on the target: a deficit is none, or is marked as uninformative.
    let on_target: Vec<f64> =
        rows[..HIDDEN.start - 1].iter().filter(|row| row.iou > 0.5).filter_map(|row| row.deficit).collect();
    let high = on_target.iter().filter(|deficit| **deficit >= 1.0).count();
    assert!(2 * high <= on_target.len(), "{name}: deficits on the target: {on_target:?}");
    assert!(
        rows[..HIDDEN.start - 1].iter().all(|row| row.iou < 0.5 || row.p_lost < 0.5),
        "{name}: P(lost) on the target"
    );
}

/// A 0 whose middle, where a small look is, is empty.
fn closeup() -> Occlusion {
    Occlusion { bars: 0, patch: 8, noise: 0.02, side: 56, width: 256, height: 256, digit: 0, ..Occlusion::default() }
}

#[test]
fn no_row_of_a_configuration_that_ships_contradicts_itself() {
    let closeup = closeup();
    let (closeup, clutter) =
        (digit_scene(&Synthetic::Occlusion(closeup)), digit_scene(&Synthetic::Clutter(Clutter::default())));
    let partial = digit_scene(&Synthetic::Occlusion(Occlusion::default()));
    let colour = natural_scene(3);
    assert_eq!(colour[0].1, INIT);
    let (mut met, mut count) = ([0; 4], 0);
    for name in Config::names() {
        let config = Config::builtin(name).expect("it ships").expect("it is right");
        if config.multi_target.is_some() || config.detector.is_some() {
            continue;
        }
        let config = Config { particles: config.particles.min(100), ..config };
        let scene = match name {
            "digits-closeup" | "digits-pool" => &closeup,
            "digits-partial" => &partial,
            _ if name.starts_with("digits") => &clutter,
            _ => &colour,
        };
        check(name, &config, scene, &mut met);
        count += 1;
    }
    assert!(count > 10 && met.iter().all(|frames| *frames > 10), "{count} configurations meet each status: {met:?}");
}

/// The centre of a 0 is empty, so that the look of frame 1 does not predict the evidence of later frames. Every deficit is at
/// its maximum, means nothing, and is reported nowhere; P(lost) is low.
#[test]
fn the_deficit_of_a_closeup_is_not_reported() {
    let scene = Occlusion { seed: 7, ..closeup() };
    let mut scene = digit_scene(&Synthetic::Occlusion(scene));
    scene.truncate(HIDDEN.start);
    let config = Config::builtin("digits-closeup").expect("it ships").expect("it is right");
    let rows = run(&config, &scene);
    assert!(rows.iter().all(|row| row.iou > 0.8 && row.p_lost < 0.01 && row.status == Status::Tracking));
    assert!(
        rows.iter().all(|row| row.deficit.is_none()),
        "{:?}",
        rows.iter().map(|row| row.deficit).collect::<Vec<_>>()
    );
}
