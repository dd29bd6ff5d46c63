use super::*;
use crate::VideoFile;

/// A bright square on a ramp, moving.
fn scene(width: usize, height: usize, t: usize) -> Image {
    let mut data = Vec::new();
    for plane in 0..3 {
        for y in 0..height {
            for x in 0..width {
                let inside = x.abs_diff(10 + t) < 6 && y.abs_diff(12) < 6;
                data.push(if inside { 220 - 60 * plane as u8 } else { (x + 2 * y + 20 * plane) as u8 / 2 + 40 });
            }
        }
    }
    Image::new(width, height, 3, data).expect("sizes agree")
}

#[test]
fn a_video_comes_back() {
    for (width, height, n) in [(64, 48, 65), (51, 33, 31), (2, 2, 1)] {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("a.mp4");
        let mut writer = Mp4Writer::create(&path, width, height, 12.5).expect("a writable folder");
        for t in 0..n {
            writer.push(&scene(width, height, t), t as f64 / 12.5).expect("a frame of the right size");
        }
        assert!(!path.exists());
        writer.finish().expect("written");
        assert_eq!(std::fs::read_dir(dir.path()).expect("readable").count(), 1);

        let video = VideoFile::open(&path).expect("a video");
        let frames: Vec<_> = video.map(|frame| frame.expect("a good frame")).collect();
        assert_eq!(frames.len(), n);
        let mut squares = 0.0;
        for (t, frame) in frames.iter().enumerate() {
            assert!((frame.time - t as f64 / 12.5).abs() < 1e-9);
            assert_eq!(
                (frame.image.width(), frame.image.height()),
                (width.next_multiple_of(2), height.next_multiple_of(2))
            );
            let wanted = scene(width, height, t);
            for y in 0..height {
                for x in 0..width {
                    let difference = f64::from(frame.image.at(1, x, y)) - f64::from(wanted.at(1, x, y));
                    squares += difference * difference / (n * width * height) as f64;
                }
            }
        }
        assert!(squares.sqrt() < 5.0, "root mean square error {} of 255", squares.sqrt());
    }
}

/// Noise costs many bits: the aim is met within a quarter, or the coarsest quantiser is taken, and one thread writes what
/// four write.
#[test]
fn the_bit_rate_is_near_the_aim() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let noisy = |t: usize| {
        let speck = |i: usize| ((i * 7919 + t * 104_729) % 251) as u8 / 4;
        let image = scene(96, 64, t);
        let data = image.bytes().iter().enumerate().map(|(i, v)| v.saturating_add(speck(i))).collect();
        Image::new(96, 64, 3, data).expect("sizes agree")
    };
    let write = |aim: Option<f64>, threads: usize| {
        let path = dir.path().join("a.mp4");
        let mut writer = Mp4Writer::create(&path, 96, 64, 30.0).expect("a writable folder").aiming_at(aim);
        writer.threads = threads;
        (0..300).for_each(|t| writer.push(&noisy(t), t as f64 / 30.0).expect("a frame of the right size"));
        writer.finish().expect("written");
        std::fs::read(&path).expect("a video")
    };
    let rate = |video: &[u8]| 8.0 * video.len() as f64 / 10.0;
    let free = write(None, 4);
    assert_eq!(write(Some(f64::NAN), 4), free);
    assert_eq!(write(Some(10.0 * rate(&free)), 4), free, "bits to spare");
    let aim = 0.5 * rate(&free);
    let half = write(Some(aim), 4);
    assert!((0.75..1.25).contains(&(rate(&half) / aim)), "{} of {aim}", rate(&half));
    assert_eq!(write(Some(aim), 1), half);
    assert!(rate(&write(Some(1.0), 4)) > 0.1 * aim, "no coarser than the coarsest");
}

/// A second reader of MP4 agrees on every sample.
#[test]
fn the_index_is_understood_by_others() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("a.mp4");
    let mut writer = Mp4Writer::create(&path, 32, 32, 29.97).expect("a writable folder");
    (0..40).for_each(|t| writer.push(&scene(32, 32, t), t as f64 / 29.97).expect("a frame of the right size"));
    writer.finish().expect("written");
    let (mp4, bytes) = re_mp4::Mp4::read_file(&path).expect("an MP4");
    let track = mp4.tracks().values().next().expect("a track");
    assert_eq!((track.width, track.height, track.timescale, track.samples.len()), (32, 32, 29970, 40));
    for (i, sample) in track.samples.iter().enumerate() {
        assert_eq!((sample.is_sync, sample.composition_timestamp), (i % GROUP == 0, 1000 * i as i64));
        let length = u32::from_be_bytes(bytes[sample.byte_range()][..4].try_into().expect("four bytes"));
        assert_eq!(u64::from(length) + 4, sample.size, "one slice a frame");
    }
}

#[test]
fn what_cannot_be_written_is_refused_and_leaves_nothing() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("a.mp4");
    for (width, height, rate) in [(0, 4, 30.0), (1 << 40, 1 << 40, 30.0), (4, 4, 0.0), (4, 4, f64::NAN)] {
        assert!(Mp4Writer::create(&path, width, height, rate).is_err());
    }
    assert!(Mp4Writer::create(dir.path().join("no/a.mp4"), 4, 4, 30.0).is_err());
    let mut writer = Mp4Writer::create(&path, 4, 4, 30.0).expect("a writable folder");
    writer.push(&Image::grey(4, 4, 9), 0.0).expect("a frame of the right size");
    let text = writer.push(&Image::grey(5, 4, 9), 0.1).expect_err("another size").to_string();
    assert!(text.contains("frame 2") && text.contains("5 x 4"), "{text}");
    drop(writer);
    Mp4Writer::create(&path, 4, 4, 30.0).expect("a writable folder").finish().expect("nothing to write");
    assert_eq!(std::fs::read_dir(dir.path()).expect("readable").count(), 0);
}

/// Frames of different lengths come back at their times, by our own reader and by another.
#[test]
fn times_are_kept() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("a.mp4");
    let times: Vec<f64> = [0, 33, 67, 100, 600, 617, 634, 5000].iter().map(|ms| 7.0 + f64::from(*ms) / 1e3).collect();
    let mut writer = Mp4Writer::create(&path, 32, 32, 30.0).expect("a writable folder");
    for (t, time) in times.iter().enumerate() {
        writer.push(&scene(32, 32, t), *time).expect("a frame of the right size");
    }
    assert!(writer.push(&scene(32, 32, 9), f64::NAN).expect_err("no time").to_string().contains("frame 9"));
    writer.finish().expect("written");
    let frames = VideoFile::open(&path).expect("a video").map(|frame| frame.expect("a good frame").time);
    let back: Vec<f64> = frames.collect();
    assert!(back.len() == 8 && back.iter().zip(&times).all(|(a, b)| (a - (b - 7.0)).abs() < 1e-9), "{back:?}");
    let (mp4, _) = re_mp4::Mp4::read_file(&path).expect("an MP4");
    let track = mp4.tracks().values().next().expect("a track");
    let scale = track.timescale as f64;
    for (sample, time) in track.samples.iter().zip(&times) {
        assert!((sample.composition_timestamp as f64 / scale - (time - 7.0)).abs() < 1e-9);
    }
    assert!((track.duration as f64 / scale - (5.0 + 1.0 / 30.0)).abs() < 1e-4);
}

/// Of a time lapse: a frame an hour.
#[test]
fn slow_times_are_kept() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("a.mp4");
    let mut writer = Mp4Writer::create(&path, 32, 32, 1.0 / 3600.0).expect("a writable folder");
    (0..4).for_each(|t| writer.push(&scene(32, 32, t), 3600.0 * t as f64).expect("a frame of the right size"));
    writer.finish().expect("written");
    let frames = VideoFile::open(&path).expect("a video").map(|frame| frame.expect("a good frame").time);
    assert_eq!(frames.collect::<Vec<f64>>(), [0.0, 3600.0, 7200.0, 10800.0]);
}
