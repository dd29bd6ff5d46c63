use super::super::tests::squares;
use super::*;

fn each() -> impl Iterator<Item = MultiVideo> {
    (0..10).map(|seed| Multi { seed, ..Multi::default() }.video(&squares()).expect("a video"))
}

#[test]
fn targets_start_apart_grow_threefold_turn_and_cross() {
    for video in each() {
        assert!(video.apart(0) && crossings(&video.truth()).len() >= 4);
        let mut classes: Vec<u8> = video.movers().iter().map(|m| m.class).collect();
        classes.sort_unstable();
        classes.dedup();
        assert_eq!((classes.len(), video.truth().sightings.len()), (5, 1500));
        for mover in video.movers() {
            let sizes = mover.states.iter().map(|s| 2.0 * mover.extent.half_w * s.log_scale.exp());
            let (low, high) = sizes.fold((f64::MAX, 0.0), |(low, high): (f64, f64), s| (low.min(s), high.max(s)));
            // Half a swing at least, at 300 frames: both ends are reached but for a step.
            assert!((27.99..28.5).contains(&low) && (83.0..84.01).contains(&high), "{low} to {high}");
            let turn = mover.states.iter().map(|s| s.angle.abs().to_degrees()).fold(0.0, f64::max);
            assert!((44.0..=90.0).contains(&turn), "{turn}");
            assert_eq!((mover.states[0].log_scale, mover.states[0].angle), (0.0, 0.0));
            for (s, b) in mover.states.iter().zip((0..300).map(|t| mover.bbox(t))) {
                assert!(b.x >= -0.01 && b.y >= -0.01 && b.x + b.w <= 400.01 && b.y + b.h <= 300.01, "{b:?}");
                assert!((s.x, s.y) == b.centre() || (s.x - b.centre().0).hypot(s.y - b.centre().1) < 1e-9);
            }
        }
    }
}

/// The squares have ink on the middle 20 of 28 pixels: a point well inside is inked, one outside is not, whatever size
/// and angle, unless another one is near.
#[test]
fn ink_is_inside_the_state() {
    let video = Multi { targets: 1, crossings: 0, ..Multi::default() }.video(&squares()).expect("a video");
    let mover = &video.movers()[0];
    for t in [0, 77, 150, 299] {
        let image = video.render(t);
        for k in 0..16 {
            let (u, v) = (f64::from(k % 4) / 3.0 - 0.5, f64::from(k / 4) / 3.0 - 0.5);
            let look = |factor: f64| {
                let gaze = foveate_core::geometry::Gaze { u: factor * u, v: factor * v, arm: None };
                let at = mover.states[t].fixate(gaze, mover.extent);
                let (x, y) = (at.x.round(), at.y.round());
                let inside = (0.0..400.0).contains(&x) && (0.0..300.0).contains(&y);
                if inside { image.at(0, x as usize, y as usize) } else { 0 }
            };
            // Up to 1.2 of the ink's half side of 0.71 units, and from 2.7 of it on.
            assert_eq!(look(1.2), 100 + mover.class, "frame {t}, inside at ({u}, {v})");
            if u.abs().max(v.abs()) > 0.4 {
                assert_eq!(look(1.9), 0, "frame {t}, outside at ({u}, {v})");
            }
        }
    }
}

#[test]
fn later_ones_hide_earlier_ones() {
    let mut covered = 0;
    for video in each() {
        for crossing in crossings(&video.truth()) {
            let low = crossing.pair.0 as usize - 1;
            let least = (crossing.frames.0..=crossing.frames.1).map(|t| video.visible(t)[low]).fold(1.0, f64::min);
            covered += usize::from(least < 0.8);
        }
    }
    assert!(covered >= 10, "of 40 crossings at least, the lower one lost a fifth of its ink in {covered}");
    let video = each().next().expect("a video");
    assert!(video.visible(0).iter().all(|share| *share == 1.0));
    let top = video.movers().len() - 1;
    assert!((0..300).all(|t| video.visible(t)[top] == 1.0), "nothing lies above the last one");
}

#[test]
fn truth_files_have_every_target_and_frame() {
    let video = Multi { frames: 60, crossings: 0, ..Multi::default() }.video(&squares()).expect("a video");
    let read = Tracks::parse(&video.gt_txt(), "gt.txt".as_ref()).expect("own text");
    for (a, b) in read.sightings.iter().zip(&video.truth().sightings) {
        assert_eq!((a.frame, a.id, a.confidence), (b.frame, b.id, 1.0));
        assert!((a.bbox.x - b.bbox.x).abs() < 1e-3 && (a.bbox.w - b.bbox.w).abs() < 1e-3);
    }
    assert_eq!((read.sightings.len(), video.truth_csv().lines().count()), (300, 301));
    assert_eq!(video.clone().source().count(), 60);
    assert_eq!(video.render(7).bytes(), video.render(7).bytes());
}

#[test]
fn clutter_and_noise_are_drawn() {
    let clear = Multi { seed: 3, ..Multi::default() };
    let lit = |settings: &Multi| {
        let image = settings.video(&squares()).expect("a video").render(0);
        image.bytes().iter().filter(|p| **p > 0).count()
    };
    let (none, some) = (lit(&clear), lit(&Multi { clutter: 8, ..clear.clone() }));
    assert!(some > none + 1000, "{none} and {some}");
    // 15 % of 120,000 pixels turn white: binomial, 5 deviations of 124 at most; of the inked ones, 15 % turn black.
    let noisy = lit(&Multi { noise: 0.3, ..clear }) as f64;
    let expected = none as f64 * 0.85 + (120_000 - none) as f64 * 0.15;
    assert!((noisy - expected).abs() < 700.0, "{noisy}, {expected} expected");
}

#[test]
fn wrong_settings_are_errors_with_the_cause() {
    let good = Multi::default();
    for (settings, said) in [
        (Multi { targets: 0, ..good.clone() }, "multi.targets"),
        (Multi { targets: 10_001, ..good.clone() }, "multi.targets"),
        (Multi { scale: [3.0, 1.0], ..good.clone() }, "scale is from 3 to 1"),
        (Multi { scale: [1.0, f64::NAN], ..good.clone() }, "scale is from 1 to NaN"),
        (Multi { width: 83, ..good.clone() }, "the target's 84"),
        (Multi { turn: f64::INFINITY, ..good.clone() }, "multi.turn"),
        (Multi { noise: 1.5, ..good.clone() }, "multi.noise"),
        (Multi { frames: 3, crossings: 50, ..good.clone() }, "cross 50 times"),
    ] {
        let problem = settings.video(&squares()).expect_err(said).to_string();
        assert!(problem.contains(said), "{problem}");
    }
}
