//! Cuts the targets of tracking sequences out into folders, one for each class, for `foveate train classifier`.
//!
//! cargo run --release -p foveate --features lab --example 08_cut_crops -- OUT [NAME:SEQUENCE,SEQUENCE ...] [STEP]
//!
//! A sequence is a folder in OTB layout (img/, groundtruth_rect.txt). Of its frames every STEP-th (5) gives one picture, of the
//! true box. Without arguments a drawn scene is cut, so that it runs anywhere.

use foveate::geometry::BBox;
use foveate::lab::Digits;
use foveate::lab::synthetic::{Clutter, Drawn};
use foveate::scene::Image;
use foveate::video::{annotation, open, save_png};
use std::path::{Path, PathBuf};

/// The box of a picture, at least a pixel, no further than the picture's edge.
fn crop(image: &Image, bbox: &BBox) -> Image {
    let whole = |from: f64, size: f64, most: usize| {
        let first = (from.round().max(0.0) as usize).min(most - 1);
        (first, ((from + size).round().max(0.0) as usize).clamp(first + 1, most))
    };
    let ((left, right), (top, bottom)) = (whole(bbox.x, bbox.w, image.width()), whole(bbox.y, bbox.h, image.height()));
    let mut data = vec![];
    for plane in 0..image.planes() {
        for row in image.plane(plane).chunks_exact(image.width()).take(bottom).skip(top) {
            data.extend_from_slice(&row[left..right]);
        }
    }
    Image::new(right - left, bottom - top, image.planes(), data).expect("as many bytes as pixels")
}

/// Cuts every `step`-th frame of a sequence; answers how many pictures it gave.
fn cut(sequence: &Path, into: &Path, step: usize) -> foveate::Result<usize> {
    let truth = annotation::read_truth(sequence.join("groundtruth_rect.txt"))?;
    let name = sequence.file_name().unwrap_or_default().to_string_lossy().into_owned();
    std::fs::create_dir_all(into).map_err(foveate::Error::io(into, "cannot create the folder"))?;
    let mut count = 0;
    for frame in open(sequence)? {
        let frame = frame?;
        if let (0, Some(Some(bbox))) = (frame.index % step, truth.get(frame.index)) {
            save_png(into.join(format!("{name}-{:04}.png", frame.index + 1)), &crop(&frame.image, bbox))?;
            count += 1;
        }
    }
    Ok(count)
}

fn main() -> foveate::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((out, rest)) = arguments.split_first() else { return drawn() };
    let step = rest.last().and_then(|last| last.parse().ok()).unwrap_or(5usize).max(1);
    for class in rest {
        let Some((name, sequences)) = class.split_once(':') else { continue };
        for sequence in sequences.split(',') {
            let n = cut(Path::new(sequence), &PathBuf::from(out).join(name), step)?;
            println!("{n} pictures of {name} from {sequence}");
        }
    }
    Ok(())
}

/// A drawn digit is cut out of its scene: the crop is the digit.
fn drawn() -> foveate::Result<()> {
    let scene = Clutter { digit: 3, frames: 3, distractors: 0, ..Clutter::default() };
    let video = scene.video(&Digits::drawn(1, 2))?;
    let truth = video.truth().to_vec();
    for frame in video.source() {
        let frame = frame?;
        let picture = crop(&frame.image, &truth[frame.index]);
        assert_eq!((picture.width(), picture.height()), (28, 28));
        assert!(picture.plane(0).iter().any(|ink| *ink > 200), "there is ink in it");
    }
    println!("a digit was cut out of 3 drawn frames");
    Ok(())
}
