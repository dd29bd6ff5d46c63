//! A path to a source of frames, by what the path is.

use std::io::Read;
use std::path::Path;

use crate::decode::image_kind;
use crate::{FrameSource, ImageFolder, Options, VideoFile};
use foveate_base::{Error, Result};

/// Opens a folder of images, a video file, or one image (a source of one frame), told apart by content.
///
/// # Errors
/// Where nothing is there, the folder has no images, the file is empty or of a kind that cannot be
/// read; each names the path, what was expected and what to do.
pub fn open(path: impl AsRef<Path>) -> Result<Box<dyn FrameSource>> {
    open_with(path, &Options::default())
}

/// [`open`], with a decoder of choice. The frames do not depend on the decoder.
///
/// # Errors
/// As [`open`], and where the decoder chosen cannot read it.
pub fn open_with(path: impl AsRef<Path>, options: &Options) -> Result<Box<dyn FrameSource>> {
    let path = path.as_ref();
    let cannot = "cannot open; expected a video file or a folder of images";
    if std::fs::metadata(path).map_err(Error::io(path, cannot))?.is_dir() {
        return Ok(Box::new(ImageFolder::open(path)?));
    }
    let mut head = Vec::new();
    let file = std::fs::File::open(path).map_err(Error::io(path, cannot))?;
    file.take(64).read_to_end(&mut head).map_err(Error::io(path, cannot))?;
    if head.is_empty() {
        return Err(Error::malformed(path, "the file is empty (0 bytes); expected a video or an image; copy it again"));
    }
    if image_kind(&head).is_some() {
        return Ok(Box::new(ImageFolder::from_files(vec![path.to_owned()])?));
    }
    Ok(Box::new(VideoFile::open_with(path, options)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::save_png;
    use foveate_core::scene::Image;

    fn without_ffmpeg() -> Options {
        Options { ffmpeg: "no-such-ffmpeg".into(), ..Options::default() }
    }

    fn refusal(path: &Path) -> String {
        open(path).err().expect("an error").to_string()
    }

    #[test]
    fn a_path_is_told_apart_by_what_is_there() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        assert!(refusal(&dir.path().join("missing.mp4")).contains("missing.mp4"));
        assert!(refusal(dir.path()).contains("no files"));
        let file = dir.path().join("picture.mp4");
        std::fs::write(&file, "").expect("a writable folder");
        assert!(refusal(&file).contains("empty"));
        std::fs::write(&file, "no video at all").expect("a writable folder");
        let text = VideoFile::open_with(&file, &without_ffmpeg()).err().expect("an error").to_string();
        assert!(text.contains("picture.mp4") && text.contains("install"), "{text}");
        save_png(&file, &Image::grey(4, 3, 7)).expect("a writable folder");
        let source = open(&file).expect("one image, whatever its name");
        assert_eq!(source.info().frames, Some(1));
        assert_eq!(source.count(), 1);
    }
}
