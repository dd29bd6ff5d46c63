//! What `bench/python.py` compares the package with: the Rust facade on the same bytes, in the same build.
//!
//! `facade FILE WIDTH HEIGHT FRAMES X Y W H`: FILE has interleaved RGB frames without gaps. Prints each box so that it reads back
//! bit for bit, then the seconds of each update, taking the pixels apart included, in one line.

use foveate::geometry::Size;
use foveate::scene::Pixels;
use foveate::{BBox, Image, Profile, Result, Tracker};
use std::time::Instant;

fn main() -> Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let bytes = std::fs::read(&words[0]).expect("a file of frames");
    let n: Vec<f64> = words[1..].iter().map(|word| word.parse().expect("a number")).collect();
    let (size, frames) = (Size::new(n[0] as usize, n[1] as usize), n[2] as usize);
    let (frame, stride) = (size.width * size.height * 3, size.width * 3);
    let mut image = Image::from_pixels(Pixels::Rgb, size, stride, &bytes[..frame])?;
    let mut tracker = Tracker::new(Profile::Balanced)?;
    tracker.init(&image, BBox::new(n[3], n[4], n[5], n[6]))?;
    let mut seconds = vec![];
    for t in 1..frames {
        let start = Instant::now();
        image.refill(Pixels::Rgb, size, stride, &bytes[t * frame..][..frame])?;
        let b = tracker.update(&image)?.bbox;
        seconds.push(start.elapsed().as_secs_f64().to_string());
        println!("{:?} {:?} {:?} {:?}", b.x, b.y, b.w, b.h);
    }
    println!("seconds {}", seconds.join(" "));
    Ok(())
}
