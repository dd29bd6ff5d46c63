//! The page's numbered files as sources of frames.

use std::io::{Error, ErrorKind, Read, Result, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use foveate_base::Error as Problem;
use foveate_base::files::PICTURE;
use foveate_core::scene::Image;
use foveate_page::Reopen;
use foveate_video::{CodedVideo, Frame, FrameSource, SourceInfo, VideoFile, decode_image};
use serde::Deserialize;

/// A store of files.
pub trait Store: Send + Sync {
    /// Reads bytes of a file at a position, at least one unless the file ends there. Returns their number.
    ///
    /// # Errors
    /// The file cannot be read.
    fn read(&self, file: u32, at: u64, to: &mut [u8]) -> Result<usize>;
}

/// Files of the file system, numbered from 0.
#[derive(Debug)]
pub struct Paths(pub Vec<PathBuf>);

impl Store for Paths {
    fn read(&self, file: u32, at: u64, to: &mut [u8]) -> Result<usize> {
        let path = self.0.get(file as usize).ok_or(ErrorKind::NotFound)?;
        let mut file = std::fs::File::open(path)?;
        file.seek(SeekFrom::Start(at))?;
        file.read(to)
    }
}

/// A file of the page.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Given {
    /// Its number.
    pub id: u32,
    pub name: String,
    /// Bytes.
    pub size: u64,
}

struct Open {
    store: Arc<dyn Store>,
    file: Given,
    at: u64,
}

impl Read for Open {
    fn read(&mut self, to: &mut [u8]) -> Result<usize> {
        let left = usize::try_from(self.file.size.saturating_sub(self.at)).unwrap_or(usize::MAX);
        let length = to.len().min(left);
        if length == 0 {
            return Ok(0);
        }
        let read = self.store.read(self.file.id, self.at, &mut to[..length])?;
        self.at += read as u64;
        Ok(read)
    }
}

impl Seek for Open {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => self.file.size.checked_add_signed(by),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
        };
        self.at = at.ok_or(Error::from(ErrorKind::InvalidInput))?;
        Ok(self.at)
    }
}

/// A video file, or a sequence of pictures.
#[derive(Clone)]
pub(crate) struct Video {
    pub store: Arc<dyn Store>,
    pub files: Vec<Given>,
    /// Frame rate of a sequence of pictures, frames per second.
    pub pictures: Option<f64>,
}

impl Video {
    fn open(&self, file: &Given) -> Open {
        Open { store: Arc::clone(&self.store), file: file.clone(), at: 0 }
    }

    /// Returns the coded file, if it is H.264 in MP4.
    pub(crate) fn coded(&self) -> foveate_base::Result<CodedVideo> {
        let file = self.files.first().ok_or_else(|| Problem::Invalid("expected a video file".into()))?;
        CodedVideo::open(&file.name, self.open(file), file.size)
    }
}

impl Reopen for Video {
    fn source(&self, from: usize) -> foveate_base::Result<Box<dyn FrameSource>> {
        if let Some(rate) = self.pictures {
            let files: Vec<Open> = self.files.iter().map(|file| self.open(file)).collect();
            return Ok(Box::new(Pictures::new(files, from, rate)?));
        }
        let [file] = &*self.files else {
            return Err(Problem::Invalid("expected one video file, or pictures (PNG or JPEG)".into()));
        };
        Ok(Box::new(VideoFile::from_reader(&file.name, self.open(file), file.size)?))
    }

    fn pictures(&self) -> Option<(usize, f64)> {
        self.pictures.map(|rate| (self.files.len(), rate))
    }
}

/// Pictures as frames, all with the size and kind of the first one.
struct Pictures {
    files: Vec<Open>,
    next: usize,
    planes: usize,
    info: SourceInfo,
}

impl Pictures {
    fn new(mut files: Vec<Open>, from: usize, rate: f64) -> foveate_base::Result<Self> {
        let first = files.first_mut().ok_or_else(|| Problem::Invalid("expected pictures, got none".into()))?;
        let image = load(first, 0)?;
        let (width, height, planes) = (image.width(), image.height(), image.planes());
        let info = SourceInfo { width, height, frames: Some(files.len()), rate, reader: "pictures".into() };
        Ok(Self { files, next: from, planes, info })
    }
}

fn load(file: &mut Open, index: usize) -> foveate_base::Result<Image> {
    let mut bytes = vec![];
    file.at = 0;
    let read = file.take(PICTURE).read_to_end(&mut bytes).map_err(|e| e.to_string());
    let wrong = |problem| Problem::Frame { path: Path::new(&file.file.name).into(), frame: index + 1, problem };
    read.and_then(|_| decode_image(&bytes)).map_err(wrong)
}

impl Iterator for Pictures {
    type Item = foveate_base::Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let (index, rate) = (self.next, self.info.rate);
        let file = self.files.get_mut(index)?;
        self.next += 1;
        let size = self.info.size();
        Some(load(file, index).and_then(|image| {
            if image.size() != size {
                let problem = format!("expected {size} pixels as in the first picture, found {}", image.size());
                return Err(Problem::Frame { path: Path::new(&file.file.name).into(), frame: index + 1, problem });
            }
            let image = image.with_planes(self.planes);
            Ok(Frame { index, time: index as f64 / rate, image })
        }))
    }
}

impl FrameSource for Pictures {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
}
