//! Sequences written in the layout of OTB: `img/0001.png ...` and `groundtruth_rect.txt`.

use std::path::Path;

use crate::annotation::format_truth;
use crate::{Frame, save_png};
use foveate_base::{Error, Result, files};
use foveate_core::geometry::BBox;

/// Writes a sequence as a folder that is whole or not there: the frames as PNG, numbered from 1, the
/// truth (0-based; 1-based in the file), and `notes`, further text files by name.
///
/// # Errors
/// `out` exists and is not an empty folder, a frame is an error, the truth has not one box a frame,
/// or a file cannot be written. Nothing is left behind then.
pub fn write_otb(
    out: &Path,
    frames: impl Iterator<Item = Result<Frame>>,
    truth: &[Option<BBox>],
    notes: &[(&str, String)],
) -> Result<()> {
    let boxes = ("groundtruth_rect.txt".to_string(), format_truth(truth));
    let notes: Vec<_> = std::iter::once(boxes).chain(notes.iter().map(|n| (n.0.to_string(), n.1.clone()))).collect();
    write_folder(out, "img", 4, frames, truth.len(), &notes)
}

/// Writes a folder that is whole or not there: `length` frames as PNG in its folder `images`, numbered from 1 with so many
/// `digits`, and `notes`, text files by their path in it.
///
/// # Errors
/// Those of [`write_otb`].
pub fn write_folder(
    out: &Path,
    images: &str,
    digits: usize,
    frames: impl Iterator<Item = Result<Frame>>,
    length: usize,
    notes: &[(String, String)],
) -> Result<()> {
    if out.read_dir().is_ok_and(|mut inside| inside.next().is_some()) || out.is_file() {
        return Err(Error::malformed(out, "is there already; remove it or choose another name"));
    }
    let out = std::path::absolute(out).map_err(Error::io(out, "cannot find"))?;
    let part = files::temporary(&out);
    let fill = || -> Result<()> {
        let folder = part.join(images);
        std::fs::create_dir_all(&folder).map_err(Error::io(&folder, "cannot create"))?;
        let mut count = 0;
        for frame in frames {
            count += 1;
            save_png(folder.join(format!("{count:0digits$}.png")), &frame?.image)?;
        }
        if count != length {
            return Err(Error::Invalid(format!("{count} frames need {count} boxes of truth, got {length}")));
        }
        for (name, text) in notes {
            let path = part.join(name);
            let folder = path.parent().unwrap_or(&part);
            std::fs::create_dir_all(folder).map_err(Error::io(folder, "cannot create"))?;
            files::write_inside(&path, text.as_bytes())?;
        }
        Ok(())
    };
    let made = fill().and_then(|()| std::fs::rename(&part, &out).map_err(Error::io(&out, "cannot create")));
    if made.is_err() {
        let _ = std::fs::remove_dir_all(&part);
    }
    made
}
