//! The variation of target features along tracks with ground truth: their covariance about the mean over each track.

use foveate_base::rows::{Rows, RowsMut};
use foveate_base::{Error, Result, files};
use foveate_core::geometry::{BBox, Extent, Gaze, State};
use foveate_core::identity::discriminant::Covariance;
use foveate_core::identity::encoder::Encoder;
use foveate_core::identity::oriented::{Oriented, Weights};
use foveate_core::identity::pyramid::{Pyramid, Region};
use foveate_core::identity::retina::{Foveal, Retina};
use foveate_core::scene::Image;
use foveate_video::open;
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use crate::eval::Sequence;

/// Minimum number of frames of a track.
const FRAMES: usize = 3;

/// The estimated covariance, and its data.
#[derive(Debug)]
pub struct Learned {
    /// The covariance of the features.
    pub covariance: Covariance,
    /// Number of tracks used.
    pub tracks: usize,
    /// SHA-256 of the tracks' pictures and boxes.
    pub sha256: String,
}

/// One track, unchanged and mirrored.
struct Track {
    /// Σ δ δᵀ / (frames − 1) of both versions.
    products: Vec<f64>,
    sha256: [u8; 32],
}

/// Returns the covariance of features of the oriented encoder with this retina, from every n-th frame of each sequence, unchanged and
/// mirrored, with equal weight for each sequence. A target is sampled in its true box, with the aspect ratio of the first frame's box.
/// Sequences with fewer than three such frames do not count.
///
/// # Errors
/// A picture cannot be read, the retina does not fit the oriented encoder, or no sequence is left.
pub fn covariance(sequences: &[Sequence], retina: &Foveal, every: usize) -> Result<Learned> {
    let channels: Vec<usize> = retina.cells().iter().map(|cell| cell.channel).collect();
    let alike = Weights { gradients: 1.0, grey: 1.0, colour: 1.0 };
    let encoder = Oriented::new(&channels, alike)?;
    let parts: [usize; 3] = encoder.parts().try_into().expect("the oriented encoder has three parts");
    let tracks: Vec<Option<Track>> =
        sequences.par_iter().map(|sequence| track(sequence, retina, &encoder, every)).collect::<Result<_>>()?;
    let tracks: Vec<Track> = tracks.into_iter().flatten().collect();
    if tracks.is_empty() {
        return Err(Error::Invalid(format!("no sequence has {FRAMES} boxes where one frame in {every} is taken")));
    }
    let (mut products, mut sha) = (vec![0.0; tracks[0].products.len()], Sha256::new());
    for track in &tracks {
        products.iter_mut().zip(&track.products).for_each(|(sum, more)| *sum += more);
        sha.update(track.sha256);
    }
    Ok(Learned {
        covariance: Covariance::of(parts, &products, 2.0 * tracks.len() as f64),
        tracks: tracks.len(),
        sha256: super::hex(sha),
    })
}

fn track(sequence: &Sequence, retina: &Foveal, encoder: &Oriented, every: usize) -> Result<Option<Track>> {
    let first = sequence.init()?;
    let mut sha = Sha256::new_with_prefix(&sequence.name);
    for file in sequence.files()? {
        sha.update(files::read(&file, files::PICTURE)?);
    }
    let frames = open(&sequence.images)?.zip(&sequence.truth).step_by(every);
    let mut rows = [vec![], vec![]];
    for (frame, bbox) in frames.filter_map(|(frame, bbox)| Some((frame, bbox.filter(|b| b.check().is_ok())?))) {
        let image = frame?.image;
        [bbox.x, bbox.y, bbox.w, bbox.h].iter().for_each(|v| sha.update(v.to_le_bytes()));
        let longer = (bbox.w * bbox.h / (first.w * first.h)).sqrt();
        let (x, y) = bbox.centre();
        let shaped = BBox::around(x, y, first.w * longer, first.h * longer);
        let mirrored = BBox { x: image.width() as f64 - shaped.x - shaped.w, ..shaped };
        features(&image, &shaped, retina, encoder, &mut rows[0]);
        features(&mirror(&image), &mirrored, retina, encoder, &mut rows[1]);
    }
    let n = encoder.shape().1;
    if rows[0].len() < FRAMES * n {
        return Ok(None);
    }
    let mut products = vec![0.0; n * n];
    rows.iter().for_each(|rows| add_products(rows, n, &mut products));
    Ok(Some(Track { products, sha256: sha.finalize().into() }))
}

/// Appends the encoded features of a box.
fn features(image: &Image, bbox: &BBox, retina: &Foveal, encoder: &Oriented, rows: &mut Vec<f64>) {
    let (state, extent, (n_v, n_h)) = (State::of(bbox), Extent::of(bbox), encoder.shape());
    let reach = retina.footprints().iter().map(|f| f.reach + f.side).fold(0.0, f64::max);
    let region = Region::covering(image, &[state], &[Gaze::CENTRE], extent, reach);
    let (mut pyramid, mut glimpse, mut row) = (Pyramid::default(), vec![0.0; n_v], vec![0.0; n_h]);
    pyramid.build(image, region, retina.footprints(), (extent.half_w, extent.half_h));
    retina.look(&pyramid, state.fixate(Gaze::CENTRE, extent), &mut glimpse);
    encoder.condition(&mut glimpse);
    encoder.encode(Rows::new(&glimpse, n_v), RowsMut::new(&mut row, n_h));
    rows.extend(row.iter().map(|v| f64::from(*v)));
}

fn mirror(image: &Image) -> Image {
    let (mut mirrored, width) = (image.clone(), image.width());
    (0..image.planes()).for_each(|p| mirrored.plane_mut(p).chunks_exact_mut(width).for_each(<[u8]>::reverse));
    mirrored
}

/// Adds the products of deviations from the mean row, divided by the number of rows minus one.
fn add_products(rows: &[f64], n: usize, products: &mut [f64]) {
    let count = (rows.len() / n) as f64;
    let mut mean = vec![0.0; n];
    rows.chunks_exact(n).for_each(|row| mean.iter_mut().zip(row).for_each(|(mean, v)| *mean += v / count));
    for row in rows.chunks_exact(n) {
        let off: Vec<f64> = row.iter().zip(&mean).map(|(v, mean)| v - mean).collect();
        for (a, sums) in off.iter().zip(products.chunks_exact_mut(n)) {
            sums.iter_mut().zip(&off).for_each(|(sum, b)| *sum += a * b / (count - 1.0));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::identity::retina::FovealConfig;

    fn retina() -> Foveal {
        Foveal::new(FovealConfig { side: 16.0, rings: vec![[18, 1]], colour: vec![[16, 4]] }).expect("whole cells")
    }

    /// A square that is dark on its left for so many of six frames and bright for the others, and moves.
    fn sequence(folder: &std::path::Path, dark: usize) -> Sequence {
        let images = folder.join("img");
        std::fs::create_dir_all(&images).expect("a new folder");
        let truth = (0..6).map(|t| {
            let left = 20 + 3 * t as u32;
            let of = |x: u32, y: u32| match (left..left + 32).contains(&x) && (20..52).contains(&y) {
                true if x < left + 16 && t < dark => 40,
                true => 200 - y as u8,
                false => 90 + ((x * 7 + y * 13) % 11) as u8,
            };
            image::GrayImage::from_fn(96, 72, |x, y| image::Luma([of(x, y)]))
                .save(images.join(format!("{t}.png")))
                .expect("written");
            Some(BBox { x: f64::from(left), y: 20.0, w: 32.0, h: 32.0 })
        });
        let truth = truth.collect();
        Sequence { images, ..Sequence::named("s", truth) }
    }

    fn of(dark: usize) -> String {
        let dir = tempfile::tempdir().expect("a temporary folder");
        covariance(&[sequence(dir.path(), dark)], &retina(), 1).expect("six frames").covariance.to_json("", "")
    }

    /// Changing features have another variance than constant ones, and the same track gives the same result. Deviations are from the mean.
    #[test]
    fn what_changes_varies() {
        assert_ne!(of(0), of(3));
        assert_eq!(of(3), of(3));
        let mut products = vec![0.0; 4];
        add_products(&[1.0, 5.0, 3.0, 5.0, 5.0, 5.0], 2, &mut products);
        assert_eq!(products, [4.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn too_few_frames_are_refused() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let said = covariance(&[sequence(dir.path(), 0)], &retina(), 3).expect_err("two frames").to_string();
        assert!(said.contains("3 boxes"), "{said}");
    }
}
