//! Sequences with ground truth, found in folders.

use std::path::{Path, PathBuf};

use foveate_base::{Error, Result};
use foveate_core::geometry::BBox;
use foveate_video::annotation::{hide_absent, read_truth};
use foveate_video::{frames_folder, image_files, vot};

use super::catalogue::{self, Origin};

/// The file of the frames, if a sequence's folder has no pictures.
const VIDEO: &str = "video.mp4";

/// A video with the ground truth of its target.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    /// The folder's name, followed by `-2`, `-3` for further targets of the same video.
    pub name: String,
    /// The folder of the images: `img/` in OTB's layout, `img1/` in MOTChallenge's, `color/` in VOT's, the folder itself in GOT-10k's; or
    /// the file `video.mp4`.
    pub images: PathBuf,
    /// The file of the truth.
    pub truth_file: PathBuf,
    /// The box in each frame, 0-based; `None` if the target is absent.
    pub truth: Vec<Option<BBox>>,
    /// Its source, half and kind.
    pub origin: Origin,
    /// The file of the masks, `mask.png`, if there is one: [`Masks`](super::masks::Masks).
    pub masks: Option<PathBuf>,
}

impl Sequence {
    /// Returns the first box.
    ///
    /// # Errors
    /// The target is absent in frame 1.
    pub fn init(&self) -> Result<BBox> {
        let absent = || Error::malformed(&self.truth_file, "the target is absent in frame 1, where a tracker starts");
        self.truth.first().copied().flatten().ok_or_else(absent)
    }

    /// Creates a sequence without files, for tests.
    #[cfg(test)]
    pub(crate) fn named(name: &str, truth: Vec<Option<BBox>>) -> Self {
        let [images, truth_file] = ["nowhere"; 2].map(PathBuf::from);
        Self { name: name.into(), images, truth_file, truth, origin: catalogue::origin(name), masks: None }
    }

    /// Returns the files of its frames: the pictures in order, or the video.
    ///
    /// # Errors
    /// The folder of the images cannot be read or has none.
    pub fn files(&self) -> Result<Vec<PathBuf>> {
        if self.images.is_file() { Ok(vec![self.images.clone()]) } else { image_files(&self.images) }
    }
}

/// Finds all sequences in `folders`, each of which is a sequence or holds some, by name.
///
/// A sequence has `groundtruth_rect.txt` (OTB; `groundtruth_rect.2.txt` is a second target) or `groundtruth.txt`: GOT-10k and LaSOT, with
/// absent frames listed in `absence.label`, `full_occlusion.txt` and `out_of_view.txt`; or VOT, which counts pixels from 0 and also has
/// polygons. [`vot::is_sequence`] distinguishes them. Its frames are pictures, or `video.mp4`.
///
/// # Errors
/// A folder cannot be read or holds no sequence, a truth file is damaged, or two sequences share a name.
pub fn find_sequences(folders: &[PathBuf]) -> Result<Vec<Sequence>> {
    let mut found = Vec::new();
    for folder in folders {
        let before = found.len();
        add(folder, &mut found)?;
        if found.len() == before {
            for inner in list(folder)?.iter().filter(|path| path.is_dir()) {
                add(inner, &mut found)?;
            }
        }
        if found.len() == before {
            let problem =
                "no sequence here: expected groundtruth_rect.txt and img/ or video.mp4, or folders that have them";
            return Err(Error::malformed(folder, problem));
        }
    }
    by_name(found, |s| (&s.name, &s.truth_file))
}

/// Keeps the sequences of one half, `a` or `b`, or all.
///
/// # Errors
/// None is left.
pub fn of_half(mut sequences: Vec<Sequence>, half: Option<&str>) -> Result<Vec<Sequence>> {
    sequences.retain(|sequence| half.is_none_or(|half| sequence.origin.half.name() == half));
    let none = || Error::Invalid(format!("--half {}: none of these sequences is of it", half.unwrap_or_default()));
    if sequences.is_empty() { Err(none()) } else { Ok(sequences) }
}

/// Sorts sequences by name; the function returns the name and the file of the truth. Fails if two share a name.
pub(super) fn by_name<T>(mut found: Vec<T>, of: impl Fn(&T) -> (&str, &Path)) -> Result<Vec<T>> {
    found.sort_by(|a, b| of(a).0.cmp(of(b).0));
    for pair in found.windows(2) {
        let ((name, first), (same, second)) = (of(&pair[0]), of(&pair[1]));
        if name == same {
            let problem = format!("a second sequence with the name {name}, after {}", first.display());
            return Err(Error::malformed(second, problem));
        }
    }
    Ok(found)
}

/// Adds the sequences of a folder, if it is one.
fn add(folder: &Path, found: &mut Vec<Sequence>) -> Result<()> {
    for truth_file in list(folder)? {
        let Some(target) = truth_file.file_name().and_then(|name| target(&name.to_string_lossy())) else { continue };
        let whole = std::path::absolute(folder).map_err(Error::io(folder, "cannot find"))?;
        let base = whole.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let name = if target == 1 { base } else { format!("{base}-{target}") };
        let (images, video) = (frames_folder(folder), folder.join(VIDEO));
        let images = if images == folder && video.is_file() { video } else { images };
        let of_vot = truth_file.ends_with("groundtruth.txt") && vot::is_sequence(folder);
        let listed = catalogue::of_folder(whole.parent().unwrap_or(&whole))?.remove(&name);
        let origin = listed.unwrap_or_else(|| catalogue::origin(&name));
        let masks = Some(folder.join("mask.png")).filter(|path| path.is_file());
        let mut truth = if of_vot { vot::read_truth(&truth_file)? } else { read_truth(&truth_file)? };
        if !of_vot {
            hide_absent(&mut truth, folder)?;
        }
        found.push(Sequence { name, images, truth, truth_file, origin, masks });
    }
    Ok(())
}

/// Returns the target of a truth file's name: 2 for `groundtruth_rect.2.txt`.
fn target(name: &str) -> Option<usize> {
    match name {
        "groundtruth_rect.txt" | "groundtruth.txt" => Some(1),
        _ => name.strip_prefix("groundtruth_rect.")?.strip_suffix(".txt")?.parse().ok(),
    }
}

/// Returns the contents of a folder, sorted.
pub(super) fn list(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder, "cannot read this folder"))?;
    let paths: std::io::Result<Vec<_>> = entries.map(|entry| entry.map(|e| e.path())).collect();
    let mut paths = paths.map_err(Error::io(folder, "cannot read this folder"))?;
    paths.sort();
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sequences_are_found_and_named() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let write = |path: &str, text: &str| {
            let path = dir.path().join(path);
            std::fs::create_dir_all(path.parent().expect("inside")).expect("a new folder");
            std::fs::write(path, text).expect("written");
        };
        write("all/B/groundtruth_rect.txt", "1,1,5,5\n");
        write("all/B/groundtruth_rect.2.txt", "NaN\n1,1,5,5\n");
        write("all/B/img/0001.png", "");
        write("all/A/groundtruth.txt", "2,3,5,5\n");
        write("all/notes/readme.txt", "");
        write("film/V/groundtruth_rect.txt", "1,1,5,5\n");
        write("film/V/video.mp4", "");
        write("film/halves.txt", "b V animal brook\n");
        let all = dir.path().join("all");
        let found = find_sequences(std::slice::from_ref(&all)).expect("three");
        assert_eq!(found.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["A", "B", "B-2"]);
        assert_eq!((&found[0].images, &found[1].images), (&all.join("A"), &all.join("B/img")));
        assert_eq!(found[0].init().expect("a box"), BBox { x: 1.0, y: 2.0, w: 5.0, h: 5.0 });
        assert!(found[2].init().expect_err("absent").to_string().contains("absent in frame 1"));
        assert_eq!(find_sequences(&[all.join("B")]).expect("itself").len(), 2);
        let video = dir.path().join("film/V/video.mp4");
        let of_video = || find_sequences(&[dir.path().join("film")]).expect("one").remove(0);
        assert_eq!((of_video().images.clone(), of_video().files().expect("there")), (video.clone(), vec![video]));
        let halves = |half| of_half(vec![of_video()], half).map(|left| left.len());
        assert_eq!(
            (of_video().origin.source.as_str(), halves(None).ok(), halves(Some("b")).ok()),
            ("brook", Some(1), Some(1))
        );
        assert!(halves(Some("a")).expect_err("none").to_string().contains("--half a"));
        write("film/V/img/0001.png", "");
        assert_eq!(of_video().images, dir.path().join("film/V/img"), "pictures come first");

        // GOT-10k counts from 1, VOT from 0.
        write("got/G/groundtruth.txt", "2,3,5,5\n3,3,5,5\n");
        write("got/G/absence.label", "0\n1\n");
        write("vot/V/groundtruth.txt", "2,3,7,3,7,8,2,8\nnan,nan,nan,nan\n");
        write("vot/W/groundtruth.txt", "2,3,5,5\n");
        write("vot/W/color/00000001.jpg", "");
        let own = Some(BBox { x: 2.0, y: 3.0, w: 5.0, h: 5.0 });
        let got = &find_sequences(&[dir.path().join("got")]).expect("one")[0];
        assert_eq!(got.truth, [Some(BBox { x: 1.0, y: 2.0, w: 5.0, h: 5.0 }), None]);
        // LaSOT has all labels in one line, and boxes in frames in which the target is not visible.
        write("lasot/cat-1/groundtruth.txt", "2,3,5,5\n3,3,5,5\n4,3,5,5\n");
        write("lasot/cat-1/full_occlusion.txt", "0,1,0");
        write("lasot/cat-1/out_of_view.txt", "0,0,1\n");
        let lasot = &find_sequences(&[dir.path().join("lasot")]).expect("one")[0];
        assert_eq!(lasot.truth, [got.truth[0], None, None]);
        let of_vot = find_sequences(&[dir.path().join("vot")]).expect("two");
        assert_eq!((&of_vot[0].truth, &of_vot[1].truth), (&vec![own, None], &vec![own]));
        assert_eq!(of_vot[1].images, dir.path().join("vot/W/color"));

        let said = |folders: &[PathBuf]| find_sequences(folders).expect_err("wrong").to_string();
        assert!(said(&[all.join("notes")]).contains("no sequence here"));
        assert!(said(&[all.join("none")]).contains("cannot read this folder"));
        assert!(said(&[all.clone(), all.join("A")]).contains("a second sequence with the name A"));
        write("bad/C/groundtruth_rect.txt", "1,2,3\n");
        assert!(said(&[dir.path().join("bad")]).contains("line 1"));
        write("got/G/absence.label", "0\n");
        assert!(said(&[dir.path().join("got")]).contains("a label for each of 2 boxes, found 1"));
    }
}
