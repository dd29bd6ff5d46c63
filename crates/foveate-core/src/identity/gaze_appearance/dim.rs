//! Discounts the background of frame 1, for fixed cameras.

use crate::scene::Image;

/// `image` minus a share of its common part with `first`, in `out`. Returns `image` itself if the share is 0, the
/// sizes differ, or it is the first frame.
pub(super) fn dim<'a>(image: &'a Image, first: &Image, share: f32, out: &'a mut Option<Image>) -> &'a Image {
    let like = |other: &Image| other.shape() == image.shape();
    if share <= 0.0 || !like(first) || image.bytes() == first.bytes() {
        *out = None;
        return image;
    }
    if !out.as_ref().is_some_and(like) {
        *out = Some(image.clone());
    }
    let out = out.as_mut().expect("made above");
    let share = (share * 256.0) as u16;
    for p in 0..image.planes() {
        for ((out, &now), &then) in out.plane_mut(p).iter_mut().zip(image.plane(p)).zip(first.plane(p)) {
            *out = now - ((u16::from(now.min(then)) * share) >> 8) as u8;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_new_stays_and_the_first_picture_is_all_familiar() {
        let first = Image::new(2, 1, 1, vec![100, 40]).expect("a byte a pixel");
        let later = Image::new(2, 1, 1, vec![100, 200]).expect("a byte a pixel");
        let mut out = None;
        assert_eq!(dim(&later, &first, 1.0, &mut out).bytes(), [0, 160]);
        assert_eq!(dim(&later, &first, 0.5, &mut out).bytes(), [50, 180]);
        assert_eq!(dim(&later, &first, 0.0, &mut out).bytes(), later.bytes());
        assert!(out.is_none(), "nothing is kept");
        _ = dim(&later, &first, 1.0, &mut out);
        assert_eq!(dim(&first.clone(), &first, 1.0, &mut out).bytes(), first.bytes());
        assert!(out.is_none(), "nor of an earlier frame");
    }
}
