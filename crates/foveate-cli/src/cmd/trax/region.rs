//! TraX's regions as boxes. Coordinates count from 0.

use foveate::video::vot;
use foveate::{BBox, Error, Result};

/// Parses the bounding box of a rectangle, polygon or mask; fails for a region without one.
pub(super) fn parse(text: &str) -> Result<BBox> {
    let parsed =
        vot::parse_region(text).and_then(|region| region.ok_or_else(|| format!("the region \"{text:.40}\" is no box")));
    parsed.map_err(|problem| Error::Invalid(format!("initialize: {problem}")))
}

/// Formats a rectangle.
pub(super) fn format(b: &BBox) -> String {
    format!("{:.4},{:.4},{:.4},{:.4}", b.x, b.y, b.w, b.h)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_are_boxes() {
        assert_eq!(parse("10,0,20,10,10,20,0,10").expect("a polygon"), BBox::new(0.0, 0.0, 20.0, 20.0));
        assert_eq!(parse("mask:5,7,4,3,1,2,1,4,2,1").expect("a mask"), BBox::new(5.0, 7.0, 4.0, 3.0));
        assert_eq!(format(&BBox::new(1.0, -2.5, 3.0, 4.0)), "1.0000,-2.5000,3.0000,4.0000");
        for text in ["nan,1,2,3", "0", "1,2", "mask:1,1,2,2", "mask:1,1,2,2,0,5"] {
            assert!(parse(text).expect_err(text).to_string().starts_with("initialize: "), "{text}");
        }
    }
}
