//! YOLO's labels: one text file per image, one line per box, `class cx cy w h` as fractions of the image's width and height.

use std::fmt::Write;
use std::path::Path;

use foveate::geometry::Size;
use foveate::{Error, Result, files};

use super::Boxes;

/// Writes a folder with `000001.txt` and so on, one file per image, empty if there is no box. Boxes are clipped to the image, because
/// readers of YOLO's labels refuse other boxes. Returns one sentence for each kind of information that the format does not hold.
///
/// # Errors
/// The size is 0, or the folder cannot be written.
pub fn write(mut boxes: Boxes, size: Size, folder: &Path) -> Result<Vec<String>> {
    if size.width == 0 || size.height == 0 {
        return Err(Error::Invalid(format!("the pictures' size is {size}; expected no side 0")));
    }
    boxes.lose_confidence();
    boxes.lose(boxes.ids().len(), "ids are left out");
    let (width, height) = (size.width as f64, size.height as f64);
    let (mut texts, mut cut, mut outside) = (vec![String::new(); boxes.frames], 0, 0);
    for b in &boxes.tracks {
        let (left, top) = (b.bbox.x.max(0.0), b.bbox.y.max(0.0));
        let (right, bottom) = ((b.bbox.x + b.bbox.w).min(width), (b.bbox.y + b.bbox.h).min(height));
        let (w, h) = (right - left, bottom - top);
        if w <= 0.0 || h <= 0.0 {
            outside += 1;
            continue;
        }
        let is_cut = left > b.bbox.x || top > b.bbox.y || right < b.bbox.x + b.bbox.w || bottom < b.bbox.y + b.bbox.h;
        cut += usize::from(is_cut);
        let numbers = [(left + right) / 2.0 / width, (top + bottom) / 2.0 / height, w / width, h / height];
        let [x, y, w, h] = numbers;
        let _ = writeln!(texts[b.frame], "0 {x:.6} {y:.6} {w:.6} {h:.6}");
    }
    boxes.lose(cut, "boxes are cut at the picture's borders");
    boxes.lose(outside, "boxes outside the picture are left out");
    boxes.lost.push("every box is of class 0".into());
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "cannot write"))?;
    for (frame, text) in texts.iter().enumerate() {
        files::write(folder.join(format!("{:06}.txt", frame + 1)), text.as_bytes())?;
    }
    Ok(boxes.lost)
}
