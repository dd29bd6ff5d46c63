//! The conformance test of detectors.

use rand::RngExt;

use super::checks;
use crate::scene::detect::Detector;
use crate::scene::{Detection, Image};

/// Checks that boxes lie within the picture, best first, with finite positive scores; that `found` is cleared first; that the map covers
/// the frame without negative values; and that the same frames give the same result. A frame of another size must start a new video. Grey,
/// colour, tiny and thin pictures must not panic, and a uniform grey one has no detection.
///
/// `make` returns new detectors of the same settings.
pub fn detector(make: &dyn Fn() -> Box<dyn Detector>) {
    let mut rng = checks().rng(7);
    let mut video = vec![];
    for (width, height, planes, frames) in
        [(64, 48, 1, 4), (64, 48, 3, 4), (1, 1, 1, 2), (1, 90, 3, 2), (50, 3, 1, 2), (37, 29, 3, 3), (64, 48, 1, 4)]
    {
        let ground: Vec<u8> = (0..width * height * planes).map(|_| rng.random_range(100..120)).collect();
        for t in 0..frames {
            let mut image = Image::new(width, height, planes, ground.clone()).expect("as many bytes as it needs");
            for p in 0..planes {
                for (k, byte) in image.plane_mut(p).iter_mut().enumerate() {
                    let (x, y) = (k % width, k / width);
                    *byte = if (10 + 3 * t..22 + 3 * t).contains(&x) && (9..20).contains(&y) { 250 } else { *byte };
                }
            }
            video.push(image);
        }
    }
    let (mut one, mut two, mut late) = (make(), make(), make());
    let leftover = Detection::new(crate::geometry::BBox { x: -9.0, y: 0.0, w: 1.0, h: 1.0 }, f64::NAN);
    let (mut found, mut again) = (vec![], vec![]);
    for (k, frame) in video.iter().enumerate() {
        found.push(leftover);
        one.detect(frame, &mut found);
        two.detect(frame, &mut again);
        assert!(found == again && one.map() == two.map(), "frame {k}: the same frames must give the same boxes");
        if k >= video.len() - 4 {
            late.detect(frame, &mut again);
            assert!(found == again && one.map() == late.map(), "frame {k}: another size must begin a new video");
        }
        let (w, h) = (frame.width() as f64, frame.height() as f64);
        for d in &found {
            let b = d.bbox;
            let within = b.x >= 0.0 && b.y >= 0.0 && b.x + b.w <= w && b.y + b.h <= h && b.w >= 1.0 && b.h >= 1.0;
            assert!(within, "frame {k}: {b:?} must lie within {w} x {h} pixels");
            assert!(d.score.is_finite() && d.score > 0.0, "frame {k}: a score is finite and positive, not {}", d.score);
        }
        assert!(found.windows(2).all(|d| d[0].score >= d[1].score), "frame {k}: boxes come best first");
        assert!(one.map().covers(frame), "frame {k}: the map must cover the frame");
        assert!(one.map().values().iter().all(|v| v.is_finite() && *v >= 0.0), "frame {k}: values are 0 or more");
    }
    let (mut blank, mut found) = (make(), vec![]);
    for _ in 0..4 {
        blank.detect(&Image::grey(70, 50, 90), &mut found);
        assert!(found.is_empty(), "one even grey holds nothing, found {found:?}");
    }
}
