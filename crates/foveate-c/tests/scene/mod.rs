//! Videos, and the results of the Rust library for them.

use foveate::config::Config;
use foveate::files::Folder;
use foveate::{BBox, Detection, Image, Seen};
use std::path::Path;

/// Frames of red, green and blue bytes, and the targets' boxes in the first one.
pub(crate) struct Scene {
    pub width: usize,
    pub height: usize,
    pub frames: Vec<Vec<u8>>,
    pub boxes: Vec<[usize; 4]>,
}

impl Scene {
    /// Two textured patches drift over a third texture.
    pub(crate) fn synthetic(frames: usize) -> Self {
        let (width, height, boxes) = (120, 90, vec![[20, 10, 24, 20], [30, 55, 22, 24]]);
        let pixel = |t: usize, x: usize, y: usize, plane: usize| {
            let inside = |b: &&[usize; 4]| (b[0] + t..b[0] + t + b[2]).contains(&x) && (b[1]..b[1] + b[3]).contains(&y);
            match boxes.iter().find(inside) {
                Some(b) => {
                    (80 + 30 * plane + (37 * ((x - b[0] - t) / 3) * ((y - b[1]) / 3 + plane + b[0] / 9)) % 120) as u8
                }
                None => ((x * y + 13 * (x / 9)) % 97) as u8,
            }
        };
        let frame = |t| (0..3 * width * height).map(|i| pixel(t, i / 3 % width, i / 3 / width, i % 3)).collect();
        Self { width, height, frames: (0..frames).map(frame).collect(), boxes }
    }

    /// The first frames of a sequence in OTB layout, of one target or of two.
    pub(crate) fn read(folder: &Path, frames: usize) -> Self {
        let video = foveate::video::open(folder.join("img")).expect("a folder of pictures");
        let images: Vec<Image> = video.take(frames).map(|frame| frame.expect("a picture").image).collect();
        let names = ["groundtruth_rect.txt", "groundtruth_rect.1.txt", "groundtruth_rect.2.txt"];
        let first = |text: String| -> [usize; 4] {
            let line = text.lines().next().expect("a box").split([',', '\t', ' ']).filter(|word| !word.is_empty());
            let number: Vec<usize> = line.map(|word| word.parse::<f64>().expect("a number") as usize).collect();
            [number[0] - 1, number[1] - 1, number[2], number[3]]
        };
        let boxes =
            names.iter().filter_map(|name| std::fs::read_to_string(folder.join(name)).ok()).map(first).collect();
        let (width, height) = (images[0].width(), images[0].height());
        Self { width, height, frames: images.iter().map(Image::to_rgb8).collect(), boxes }
    }

    fn image(&self, t: usize) -> Image {
        Image::from_rgb8(self.width, self.height, &self.frames[t]).expect("whole frames")
    }

    fn boxes(&self) -> impl Iterator<Item = BBox> {
        self.boxes.iter().map(|b| b.map(|n| n as f64)).map(|[x, y, w, h]| BBox::new(x, y, w, h))
    }

    /// The results for the first target.
    pub(crate) fn seen(&self, configuration: &str) -> Vec<Seen<'static>> {
        let mut tracker = foveate::Tracker::new(configuration).expect("it ships");
        tracker.init(&self.image(0), self.boxes().next().expect("a box")).expect("a good box");
        let frames = 1..self.frames.len();
        frames.map(|t| tracker.update(&self.image(t)).expect("a picture of one size").without_views()).collect()
    }

    /// The lines of boxes.c for one target.
    pub(crate) fn single(&self, configuration: &str) -> String {
        self.seen(configuration).iter().zip(1..).map(|(seen, t)| line(t, seen)).collect()
    }

    /// The lines of boxes.c for many targets.
    pub(crate) fn many(&self, configuration: &str) -> String {
        let config = Config::builtin(configuration).expect("it ships").expect("it is right");
        let seed = config.seed;
        let blueprint = config.check(&Folder::here()).expect("parts that fit");
        let mut tracker = blueprint.multi_tracker(seed).expect("parts that fit");
        let mut lines = String::new();
        for t in 0..self.frames.len() {
            let image = self.image(t);
            let moved = |b: BBox| Detection::new(BBox { x: b.x + t as f64, ..b }, 0.9);
            let detections: Vec<_> = self.boxes().map(moved).filter(|_| t > 0).collect();
            tracker.update(&image, &detections).expect("a picture of one size");
            for bbox in self.boxes().filter(|_| t == 0) {
                tracker.add(&image, None, bbox).expect("a good box");
            }
            lines.extend(tracker.targets().iter().map(|seen| line(t, seen)));
        }
        lines
    }
}

fn line(t: usize, seen: &Seen<'_>) -> String {
    let BBox { x, y, w, h } = seen.bbox;
    let detection = seen.detection_index.map_or(-1, |index| index as i64);
    let status = ["tracking", "occluded", "lost", "reacquired"].iter().position(|name| *name == seen.status.name());
    let status = status.expect("one of four");
    let values = [x, y, w, h, seen.p_lost].into_iter().chain(seen.covariance.into_iter().flatten());
    let bits: String = values.map(|value| format!(" {:x}", value.to_bits())).collect();
    format!("{t} {} {status} {} {detection}{bits}\n", seen.id, u8::from(seen.is_usable()))
}

/// A scene in a layout of pixels: a foveate_format, and `gap` bytes between rows.
pub(crate) struct Video<'a> {
    pub scene: &'a Scene,
    pub format: usize,
    pub gap: usize,
}

impl Video<'_> {
    /// The bytes of a pixel as indices of red, green and blue; 3 is a byte that is not read.
    fn order(&self) -> &'static [usize] {
        [&[0][..], &[0, 1, 2], &[2, 1, 0], &[0, 1, 2, 3], &[2, 1, 0, 3]][self.format]
    }
    /// Width, height, stride and format.
    pub(crate) fn layout(&self) -> [usize; 4] {
        let Scene { width, height, .. } = *self.scene;
        [width, height, width * self.order().len() + self.gap, self.format]
    }
    /// All frames.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![];
        for row in self.scene.frames.iter().flat_map(|frame| frame.chunks(3 * self.scene.width)) {
            let pixel =
                |rgb: &[u8]| self.order().iter().map(|&p| rgb.get(p).copied().unwrap_or(99)).collect::<Vec<_>>();
            bytes.extend(row.chunks(3).flat_map(pixel));
            bytes.resize(bytes.len() + self.gap, 77);
        }
        bytes
    }
}
