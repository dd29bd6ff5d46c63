//! YOLO's labels: one text file per image, one line per box, `class cx cy w h` as fractions of the image's width and height.

use std::fmt::Write;
use std::path::Path;

use foveate::geometry::Size;
use foveate::{Error, Result, files};

use super::Boxes;

/// Writes a folder with `000001.txt` and so on, one file per image, empty if there is no box. Boxes are clipped to the image, because
/// readers of YOLO's labels refuse other boxes. Label files of later frames in the folder, which a longer video left, are removed. Returns
/// one sentence for each kind of information that the format does not hold.
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
    remove_after(boxes.frames, folder).map_err(Error::io(folder, "cannot remove labels of a longer video"))?;
    Ok(boxes.lost)
}

/// Removes the label files of the frames after the last one.
fn remove_after(frames: usize, folder: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let (entry, last) = (entry?, frames as u128);
        let name = entry.file_name();
        let number = name.to_str().and_then(|name| name.strip_suffix(".txt"));
        let number = number.filter(|digits| digits.len() >= 6 && digits.bytes().all(|byte| byte.is_ascii_digit()));
        let is_later = number.and_then(|digits| digits.parse().ok()).is_some_and(|number: u128| number > last);
        if is_later && entry.file_type()?.is_file() {
            std::fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_a_longer_video_are_removed() {
        let dir = tempfile::tempdir().expect("a folder");
        let others = ["00003.txt", "classes.txt", "000009.txt.bak", "+000009.txt", "000009.jpg"];
        let old = ["000001.txt", "000003.txt", "1000000.txt"];
        others.iter().chain(&old).for_each(|name| std::fs::write(dir.path().join(name), "old").expect("written"));
        let boxes = Boxes::new(vec![], 2).expect("no boxes");
        write(boxes, Size::new(64, 48), dir.path()).expect("written");
        let names = std::fs::read_dir(dir.path()).expect("a folder").map(|entry| entry.expect("a file").file_name());
        let mut names: Vec<_> = names.map(|name| name.into_string().expect("text")).collect();
        names.sort_unstable();
        let mut expected = [&others[..], &["000001.txt", "000002.txt"]].concat();
        expected.sort_unstable();
        assert_eq!(names, expected);
    }
}
