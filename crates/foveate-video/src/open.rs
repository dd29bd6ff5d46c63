//! Opens a source of frames by the kind of its path.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use image::ImageFormat;

use crate::address::{is_live, other_protocol, without_password};
use crate::decode::{KIND, image_kind};
use crate::folder::image_files;
use crate::piped::Piped;
use crate::y4m::MAGIC;
use crate::{Decoder, FrameSource, ImageFolder, Options, TiffStack, VideoFile, pattern};
use foveate_base::{Error, Result};

/// Videos that begin as a picture does, by how their names end.
const MOVING: [&str; 3] = ["mjpeg", "mjpg", "apng"];

/// Opens a folder of images, a numbered pattern of images (`frame%04d.png`), a video file, a TIFF stack, or one image (a
/// source of one frame). The content decides; files with the endings `.mjpeg`, `.mjpg` and `.apng` are videos. `-` is standard
/// input. Standard input, a fifo and a file `.y4m` are read as yuv4mpeg.
///
/// # Errors
/// The path does not exist, the folder has no images, or the file is empty or of an unsupported kind. Each error has
/// the path, the expectation and the remedy.
pub fn open(path: impl AsRef<Path>) -> Result<Box<dyn FrameSource>> {
    open_with(path, &Options::default())
}

/// [`open`], with a decoder of choice, on which the frames do not depend, or from bare pixels.
///
/// # Errors
/// As [`open`], and if the chosen decoder cannot read it.
pub fn open_with(path: impl AsRef<Path>, options: &Options) -> Result<Box<dyn FrameSource>> {
    open_path(path.as_ref(), options)
}

fn open_path(path: &Path, options: &Options) -> Result<Box<dyn FrameSource>> {
    let refused = |what: &str| {
        let problem = format!("the sandbox decodes H.264 in MP4 and pictures alone; {what}, or leave out --sandbox");
        if options.sandbox.is_some() { Err(Error::malformed(path, problem)) } else { Ok(()) }
    };
    if options.raw.is_some() || path == Path::new("-") || is_live(path) {
        refused("give a file or a folder of images")?;
    } else if options.decoder == Decoder::Ffmpeg {
        refused("leave out --decoder ffmpeg")?;
    }
    if path == Path::new("-") {
        return piped("standard input".into(), std::io::stdin(), &[], unread_input(), options);
    }
    if is_live(path) {
        let address = without_password(&path.to_string_lossy()).into_owned();
        let problem =
            "a stream or a camera, which is not opened as a file is; expected a video file or a folder of images";
        return Err(Error::malformed(address, problem));
    }
    if let Some(name) = other_protocol(path).filter(|_| !path.exists()) {
        let address = path.display();
        let problem = format!(
            "{name}:// is not opened; expected rtsp://, http://, https:// or /dev/video; let ffmpeg read it: \
             `ffmpeg -i {address} -fps_mode passthrough -pix_fmt yuv420p -f yuv4mpegpipe - | foveate track - ...`"
        );
        return Err(Error::malformed(path, problem));
    }
    if let Some(files) = pattern::files(path)? {
        return Ok(Box::new(ImageFolder::from_files_with(files, options)?));
    }
    let cannot = "cannot open; expected a video file or a folder of images";
    let about = std::fs::metadata(path).map_err(Error::io(path, cannot))?;
    if about.is_dir() {
        return Ok(Box::new(ImageFolder::from_files_with(image_files(path)?, options)?));
    }
    let mut file = File::open(path).map_err(Error::io(path, cannot))?;
    if options.raw.is_some() {
        let length = about.is_file().then_some(about.len());
        return piped(path.to_owned(), file, &[], length, options);
    }
    let mut head = Vec::new();
    // Only the bytes that identify yuv4mpeg: a fifo cannot be read twice.
    file.by_ref().take(MAGIC.len() as u64).read_to_end(&mut head).map_err(Error::io(path, cannot))?;
    if head == MAGIC || !about.is_file() {
        refused("convert it")?;
        return piped(path.to_owned(), file, &head, None, options);
    }
    if head.is_empty() {
        return Err(Error::malformed(path, "the file is empty (0 bytes); expected a video or an image; copy it again"));
    }
    let moving = path.extension().is_some_and(|end| MOVING.iter().any(|moving| end.eq_ignore_ascii_case(moving)));
    file.by_ref().take(KIND as u64 - head.len() as u64).read_to_end(&mut head).map_err(Error::io(path, cannot))?;
    let kind = image_kind(&head);
    if kind == Some(ImageFormat::Tiff) && options.sandbox.is_none() {
        return Ok(Box::new(TiffStack::open(path)?));
    }
    if kind.is_some() && !moving && !(kind == Some(ImageFormat::Png) && is_animated(&mut file)) {
        return Ok(Box::new(ImageFolder::from_files_with(vec![path.to_owned()], options)?));
    }
    Ok(Box::new(VideoFile::open_with(path, options)?))
}

/// Whether a PNG file is an animation: then a chunk of that name comes before its first picture.
fn is_animated(file: &mut File) -> bool {
    let mut head = Vec::new();
    let _ = file.take(1 << 12).read_to_end(&mut head);
    let at = |name: &[u8]| head.windows(4).position(|bytes| bytes == name);
    at(b"acTL").is_some_and(|animated| at(b"IDAT").is_none_or(|picture| animated < picture))
}

/// Raw video, with the bytes `read` that were already read, and its number of bytes if known.
fn piped(
    name: PathBuf,
    file: impl Read + Send + 'static,
    read: &[u8],
    bytes: Option<u64>,
    options: &Options,
) -> Result<Box<dyn FrameSource>> {
    let reader = Box::new(BufReader::with_capacity(1 << 16, file));
    Ok(Box::new(match options.raw {
        Some(raw) => Piped::raw(name, reader, bytes, raw, options.notify)?,
        None => Piped::y4m(name, reader, read)?,
    }))
}

/// The number of bytes left in standard input, if it is a file.
fn unread_input() -> Option<u64> {
    #[cfg(unix)]
    {
        let mut input = File::from(std::os::fd::AsFd::as_fd(&std::io::stdin()).try_clone_to_owned().ok()?);
        let about = input.metadata().ok().filter(std::fs::Metadata::is_file)?;
        about.len().checked_sub(std::io::Seek::stream_position(&mut input).ok()?)
    }
    #[cfg(not(unix))]
    None
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
    fn the_content_of_a_path_decides_its_kind() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        assert!(refusal(&dir.path().join("missing.mp4")).contains("missing.mp4"));
        assert!(refusal(dir.path()).contains("no files"));
        let stream = refusal(Path::new("rtsp://me:secret@host/live"));
        assert!(stream.contains("a stream") && !stream.contains("secret"), "{stream}");
        let file = dir.path().join("picture.mp4");
        std::fs::write(&file, "").expect("a writable folder");
        assert!(refusal(&file).contains("empty"));
        std::fs::write(&file, "no video at all").expect("a writable folder");
        let text = VideoFile::open_with(&file, &without_ffmpeg()).expect_err("an error").to_string();
        assert!(text.contains("picture.mp4") && text.contains("install"), "{text}");
        save_png(&file, &Image::grey(4, 3, 7)).expect("a writable folder");
        let source = open(&file).expect("one image, whatever its name");
        assert_eq!(source.info().frames, Some(1));
        assert_eq!(source.count(), 1);
        // Pictures one after the other are none of those: their first one is not all there is.
        let moving = dir.path().join("walk.MJPEG");
        std::fs::write(&moving, crate::encode_jpeg(&Image::grey(16, 16, 7), 85).repeat(3)).expect("a writable folder");
        let text = open_with(&moving, &without_ffmpeg()).err().expect("an error").to_string();
        assert!(text.contains("walk.MJPEG") && text.contains("install"), "{text}");
    }
}
