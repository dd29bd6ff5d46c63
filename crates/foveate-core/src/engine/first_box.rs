//! A first box that is too large: the tracker follows the part of it that moves as one, and reports the box as it was drawn.
//!
//! Deviation: in the paper the target is all of the first box. A box with a wide margin of textured ground would keep the tracker on the
//! ground when the target leaves.

use super::Engine;
use crate::geometry::{Extent, State};
use crate::scene::Image;
use crate::scene::moving_part::{moving_part, window};

/// Steps in which the first box is compared with the picture of frame 1.
const FRAMES: u64 = 5;

impl Engine {
    /// In the first frames, compares the box of frame 1 with the picture `now`, unless the target was moved to another box since. If a part
    /// of the box moves as one, this tracker and the second one take that part of frame 1 as the template and restart where it is, with its
    /// velocity. Call it before the step.
    pub(super) fn shrink_first_box(&mut self, now: &Image, second: Option<&mut Self>) {
        if !self.parts.extras.shrinks_first_box || self.frame >= FRAMES {
            return;
        }
        let (target, source) = (*self.target(), self.parts.appearance.template_source());
        // A tracker of many targets may have kept only a part of the picture.
        let first =
            source.map(|it| it.image).filter(|it| target.share == 1.0 && !target.moved && it.shape() == now.shape());
        let Some(first) = first else { return };
        let (first, bbox) = (first.clone(), target.state.bbox(target.extent));
        self.parts.extras.read = window(now, &bbox);
        let Some(part) = moving_part(&first, now, &bbox) else { return };
        let frames = (self.frame + 1) as f64;
        let (vx, vy) = (part.moved.0 / frames, part.moved.1 / frames);
        // The place in the last frame: the step predicts the next.
        let State { x, y, .. } = target.state;
        let place = State { x: x + part.moved.0 - vx, y: y + part.moved.1 - vy, vx, vy, ..target.state };
        self.follow_part(&first, part.share, &place);
        if let Some(second) = second {
            second.follow_part(&first, part.share, &place);
        }
    }

    /// Takes this share of the sides of the first box as the target, in the picture of frame 1, and restarts at `place`.
    fn follow_part(&mut self, first: &Image, share: f64, place: &State) {
        let target = self.target();
        let Extent { half_w, half_h } = target.extent;
        let bbox = target.state.bbox(Extent { half_w: share * half_w, half_h: share * half_h });
        self.update_template(first, &bbox, (0.0, 0.0)).expect("it is inside a box that was accepted");
        let target = self.target.as_mut().expect("a template was taken");
        target.share = share;
        let extent = target.extent;
        self.restart(place, extent);
    }
}

#[cfg(test)]
mod tests {
    use crate::config::Config;
    use crate::geometry::BBox;
    use crate::scene::moving_part::tests::picture;
    use crate::tracker::Tracker;
    use foveate_base::files::Nowhere;

    fn tracker(settings: &[&str]) -> Tracker {
        let natural = Config::builtin("natural").expect("it ships").expect("it is valid");
        let config = settings.iter().fold(natural, |config, setting| config.set(setting).expect("a setting"));
        config.check(&Nowhere).expect("it fits").tracker(1).expect("it fits")
    }

    /// A box that is given while the first one is compared is kept: the target does not move as the part of the first box does.
    #[test]
    fn a_target_that_was_moved_keeps_its_box() {
        let mut it = tracker(&["shrink_first_box=true"]);
        let place = |t: i32| (60 + 4 * t, 100 - t);
        it.init(&picture(220, place(0), (0, 0)), BBox::new(40.0, 80.0, 80.0, 80.0)).expect("a box");
        it.update(&picture(220, place(1), (0, 0))).expect("a picture");
        it.reset_at(BBox::new(120.0, 20.0, 80.0, 80.0)).expect("a target");
        for t in 2..8 {
            let saved = it.save();
            it = tracker(&["shrink_first_box=true"]);
            it.load(&saved).expect("its own state");
            it.update(&picture(220, place(t), (0, 0))).expect("a picture");
            assert!(it.save().to_string().contains("\"share\":1.0"), "frame {t}");
        }
    }

    /// A box of twice the size of a moving target follows the target and keeps its size, also if the tracker is saved in between. Without
    /// the setting it stays on the ground.
    #[test]
    fn a_box_that_is_too_large_follows_what_moves() {
        for (settings, follows) in [(&["shrink_first_box=true"][..], true), (&["shrink_first_box=false"], false)] {
            let mut it = tracker(settings);
            let place = |t: i32| (60 + 4 * t, 100 - t);
            it.init(&picture(220, place(0), (0, 0)), BBox::new(40.0, 80.0, 80.0, 80.0)).expect("a box");
            let mut last = BBox::new(0.0, 0.0, 0.0, 0.0);
            for t in 1..20 {
                last = it.update(&picture(220, place(t), (0, 0))).expect("a picture").bbox;
                if t == 4 {
                    let saved = it.save();
                    it = tracker(settings);
                    it.load(&saved).expect("its own state");
                }
            }
            let ((x, y), (left, top)) = (last.centre(), place(19));
            let off = (x - f64::from(left) - 19.5).abs().max((y - f64::from(top) - 19.5).abs());
            assert_eq!(off < 5.0, follows, "{last:?}: {off} px beside the target");
            assert!(!follows || (last.w / 80.0).ln().abs() < 0.2, "the size that was drawn: {last:?}");
        }
    }
}
