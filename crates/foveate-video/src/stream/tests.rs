//! Video against second opinions: stored checksums, the program ffmpeg where there is one, re_mp4, and damage.

use crate::ffmpeg::Ffmpeg;
use crate::stream::*;
use crate::{Frame, FrameSource, Options, Remarks, SourceInfo, VideoFile};
use foveate_testing::{data, draws, need, skip};
use md5::{Digest, Md5};
use std::path::{Path, PathBuf};
use std::process::Command;

fn without_ffmpeg() -> Options {
    Options { ffmpeg: "no-such-ffmpeg".into(), ..Options::default() }
}

fn open(path: &Path) -> Mp4 {
    let file = File::open(path).expect("a file");
    let len = file.metadata().expect("a file").len();
    Mp4::new(Box::new(file), len).expect("an MP4")
}

fn md5(yuv: Yuv) -> String {
    let mut md5 = Md5::new();
    [yuv.y, yuv.u, yuv.v].iter().for_each(|plane| md5.update(plane));
    md5.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Every frame of the three clips is the frame that a reference decoder gave, in its order.
#[test]
fn clips_decode_exactly() {
    let clips = need!(data("clips"));
    for name in ["car-detection", "bottle-detection", "hockey"] {
        let sums = std::fs::read_to_string(clips.join(name).with_extension("framemd5")).expect("checksums");
        let sums: Vec<&str> = sums.lines().filter(|line| !line.starts_with('#')).collect();
        let mut mp4 = open(&clips.join(name).with_extension("mp4"));
        assert_eq!(mp4.frames(), sums.len(), "{name}");
        let start = std::time::Instant::now();
        let mut times = Vec::new();
        for (i, sum) in sums.iter().enumerate() {
            let (yuv, time) = mp4.yuv().expect("a frame").expect("a good frame");
            assert_eq!(sum.rsplit(", ").next(), Some(md5(yuv).as_str()), "{name}, frame {}", i + 1);
            times.push(time);
        }
        assert!(mp4.yuv().is_none());
        assert!(times[0] == 0.0 && times.is_sorted(), "{name}: times rise from 0");
        println!("{name}: {} frames a second", (times.len() as f64 / start.elapsed().as_secs_f64()).round());
    }
}

/// A second reader of MP4 finds the same bytes and times, plain and in fragments.
#[test]
fn the_index_is_what_re_mp4_reads() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let fragments = "-c:v libx264 -g 8 -bf 2 -pix_fmt yuv420p -movflags frag_keyframe+empty_moov+default_base_moof";
    let mut files: Vec<PathBuf> = made(dir.path(), "fragments.mp4", fragments).into_iter().collect();
    for name in ["car-detection", "bottle-detection", "hockey"] {
        files.extend(data("clips").ok().map(|clips| clips.join(name).with_extension("mp4")));
    }
    for path in files {
        let ours = open(&path).movie;
        let (theirs, _) = re_mp4::Mp4::read_file(&path).expect("an MP4");
        let video = |track: &&re_mp4::Track| track.kind == Some(re_mp4::TrackKind::Video);
        let theirs = theirs.tracks().values().find(video).expect("a video track");
        assert_eq!((ours.samples.len(), u64::from(ours.timescale)), (theirs.samples.len(), theirs.timescale));
        let origin = ours.samples.iter().map(|sample| sample.time).min().expect("samples");
        let first = theirs.samples.iter().map(|sample| sample.composition_timestamp).min().expect("samples");
        for (a, b) in ours.samples.iter().zip(&theirs.samples) {
            assert_eq!((a.offset, u64::from(a.size)), (b.offset, b.size));
            assert_eq!(a.time - origin, b.composition_timestamp - first);
        }
    }
}

/// What ffmpeg makes of a moving test picture of 24 frames, 25 a second; `None` without ffmpeg or the codec.
fn made(dir: &Path, name: &str, options: &str) -> Option<PathBuf> {
    let path = dir.join(name);
    let source = "testsrc2=size=100x84:rate=25:duration=0.96";
    let run = Command::new("ffmpeg")
        .args(["-v", "error", "-y", "-f", "lavfi", "-i", source])
        .args(options.split_whitespace())
        .arg(&path)
        .output();
    run.is_ok_and(|run| run.status.success()).then_some(path)
}

/// MD5 of each frame as ffmpeg decodes it.
fn sums(path: &Path) -> Vec<String> {
    let run = Command::new("ffmpeg")
        .args(["-v", "error", "-noautorotate", "-i"])
        .arg(path)
        .args(["-map", "0:v:0", "-fps_mode", "passthrough", "-f", "framemd5", "-"])
        .output()
        .expect("it ran before");
    let text = String::from_utf8(run.stdout).expect("text");
    text.lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| line.rsplit(", ").next().expect("columns").into())
        .collect()
}

#[test]
fn h264_of_every_kind_is_what_ffmpeg_decodes() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let kinds = [
        ("baseline.mp4", "-c:v libx264 -profile:v baseline -pix_fmt yuv420p"),
        ("reordered.mp4", "-c:v libx264 -pix_fmt yuv420p -bf 3 -x264-params b-pyramid=normal:keyint=10"),
        ("slices.mp4", "-c:v libx264 -pix_fmt yuv420p -x264-params slices=4:weightp=2"),
        ("fragments.mp4", "-c:v libx264 -pix_fmt yuv420p -g 8 -bf 2 -movflags frag_keyframe+empty_moov"),
        ("base-moof.mp4", "-c:v libx264 -pix_fmt yuv420p -g 8 -movflags frag_keyframe+empty_moov+default_base_moof"),
        (
            "after-sound.mp4",
            "-f lavfi -i sine=duration=0.96 -map 1 -map 0 -c:a aac -c:v libx264 -pix_fmt yuv420p -g 8 -movflags \
             frag_keyframe+empty_moov+omit_tfhd_offset",
        ),
        ("faststart.mov", "-c:v libx264 -pix_fmt yuv420p -movflags +faststart"),
        ("interlaced.mp4", "-c:v libx264 -pix_fmt yuv420p -flags +ilme+ildct -x264-params interlaced=1"),
        ("fake-interlaced.mp4", "-c:v libx264 -pix_fmt yuv420p -x264-params fake-interlaced=1"),
        ("4-2-2.mp4", "-c:v libx264 -pix_fmt yuv422p"),
        ("open.mp4", "-c:v libx264 -pix_fmt yuv420p -bf 3 -x264-params open-gop=1:keyint=8:min-keyint=8"),
        ("full-range.mp4", "-c:v libx264 -pix_fmt yuvj420p"),
        ("negative.mp4", "-c:v libx264 -pix_fmt yuv420p -bf 2 -movflags negative_cts_offsets"),
    ];
    for (name, options) in kinds {
        let Some(path) = made(dir.path(), name, options) else {
            skip(&format!("ffmpeg that writes {name}"));
            continue;
        };
        let sums = sums(&path);
        let mut mp4 = open(&path);
        let mut found = Vec::new();
        loop {
            match mp4.yuv() {
                Some(Ok((yuv, time))) => {
                    assert!((time - found.len() as f64 / 25.0).abs() < 1e-3, "{name}: {time} s");
                    found.push(md5(yuv));
                }
                Some(Err(DecodeError::Unsupported(why))) => {
                    println!("{name}: handed over: {why}");
                    assert!(mp4.widen(), "{name}: {why}");
                }
                Some(Err(DecodeError::Damaged(why))) => panic!("{name}: {why}"),
                None => break,
            }
        }
        assert_eq!(found, sums, "{name}");
    }
}

/// Brightness of the red, green and blue planes at the corners and the middle, averaged over 9 x 9 pixels.
fn look(image: &Image) -> Vec<i32> {
    let (w, h) = (image.width() - 10, image.height() - 10);
    let mean = |p: usize, x: usize, y: usize| {
        let sum: i32 = (0..81).map(|i| i32::from(image.at(p, x + i % 9, y + i / 9))).sum();
        sum / 81
    };
    let places = [(0, 0), (w, 0), (0, h), (w, h), (w / 2, h / 2)];
    places.iter().flat_map(|&(x, y)| (0..3).map(move |p| mean(p, x, y))).collect()
}

/// Every kind of file gives the frames and times of the same picture, by whichever reader.
#[test]
fn every_kind_of_video_is_read_alike() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let plain =
        need!(made(dir.path(), "plain.mp4", "-c:v libx264 -qp 8 -pix_fmt yuv420p").ok_or("ffmpeg with libx264"));
    let read = |path: &Path| -> (SourceInfo, Vec<Frame>) {
        let video = crate::open(path).expect("a video");
        (video.info().clone(), video.map(|frame| frame.expect("a good frame")).collect())
    };
    let (_, wanted) = read(&plain);
    let kinds = [
        ("wide.mp4", "(built-in decoder for", "-c:v libx264 -pix_fmt yuv420p10"),
        ("full.mp4", "(built-in decoder)", "-c:v libx264 -qp 8 -pix_fmt yuvj420p"),
        (
            "bt709.mp4",
            "(built-in decoder)",
            "-vf scale=out_color_matrix=bt709 -colorspace bt709 -c:v libx264 -qp 8 -pix_fmt yuv420p",
        ),
        ("lossless.mp4", "ffmpeg", "-c:v libx264 -qp 0 -pix_fmt yuv420p"),
        ("4-4-4.mp4", "ffmpeg", "-c:v libx264 -qp 8 -pix_fmt yuv444p"),
        ("hevc.mp4", "ffmpeg", "-c:v libx265 -x265-params log-level=none -crf 8"),
        ("vp9.webm", "ffmpeg", "-c:v libvpx-vp9 -crf 8 -cpu-used 5 -pix_fmt yuv420p"),
        ("mjpeg.avi", "ffmpeg", "-c:v mjpeg -q:v 2"),
        ("mpeg4.mkv", "ffmpeg", "-c:v mpeg4 -q:v 2"),
        ("raw.h264", "ffmpeg", "-c:v libx264 -qp 8 -pix_fmt yuv420p"),
    ];
    for (name, reader, options) in kinds {
        let Some(path) = made(dir.path(), name, options) else {
            skip(&format!("ffmpeg that writes {name}"));
            continue;
        };
        let (info, frames) = read(&path);
        assert!(info.reader.contains(reader), "{name} was read by {}", info.reader);
        assert_eq!((info.width, info.height, frames.len()), (100, 84, 24), "{name}");
        assert!((info.rate - 25.0).abs() < 0.01, "{name}: {} frames a second", info.rate);
        assert!(info.frames.is_none_or(|n| n == 24), "{name}: {:?} frames", info.frames);
        for (i, (frame, wanted)) in frames.iter().zip(&wanted).enumerate() {
            assert_eq!(frame.index, i);
            assert!((frame.time - i as f64 / 25.0).abs() < 2e-3, "{name}, frame {i}: {} s", frame.time);
            let (a, b) = (look(&frame.image), look(&wanted.image));
            assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 12), "{name}, frame {i}: {a:?}, expected {b:?}");
        }
    }
}

/// What edits, cuts and turns leave to be shown is what ffmpeg shows of the same file.
#[test]
fn edits_cuts_and_turns_are_followed() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let kinds = [
        ("open.mp4", "-c:v libx264 -pix_fmt yuv420p -bf 3 -x264-params open-gop=1:keyint=8:min-keyint=8"),
        ("uneven.mp4", "-vf select=not(eq(mod(n\\,3)\\,1)) -fps_mode vfr -c:v libx264 -pix_fmt yuv420p"),
        ("cut.mp4", "-ss 0.4 -i IN/open.mp4 -map 1 -c copy"),
        ("cut-without-edits.mp4", "-ss 0.4 -i IN/open.mp4 -map 1 -c copy -copyinkf -use_editlist 0"),
        ("end.mp4", "-i IN/open.mp4 -map 1 -ss 0.2 -t 0.4 -c copy"),
        ("turned.mp4", "-i IN/open.mp4 -map 1 -c copy -metadata:s:v rotate=90"),
        ("back.mp4", "-i IN/open.mp4 -map 1 -c copy -metadata:s:v rotate=270"),
        ("over.mp4", "-i IN/open.mp4 -map 1 -c copy -metadata:s:v rotate=180"),
        ("nclc.mov", "-i IN/open.mp4 -map 1 -c copy -colorspace bt709 -color_primaries bt709 -color_trc bt709"),
        ("cropped.mp4", "-i IN/open.mp4 -map 1 -c copy -bsf:v h264_metadata=crop_left=4:crop_top=2"),
        ("mirror.mp4", "-1 0 0 1"),
        ("mirror-turned.mp4", "0 -1 -1 0"),
        ("upside-down.mp4", "1 0 0 -1"),
        ("transposed.mp4", "0 1 1 0"),
    ];
    for (name, options) in kinds {
        let options = options.replace("IN", &dir.path().to_string_lossy());
        let matrix: Vec<i32> = options.split(' ').map_while(|n| n.parse().ok()).collect();
        let copied = || made(dir.path(), name, &format!("-i {}/open.mp4 -map 1 -c copy", dir.path().display()));
        let path = if matrix.is_empty() { made(dir.path(), name, &options) } else { copied() };
        let Some(path) = path else {
            skip(&format!("ffmpeg that writes {name}"));
            continue;
        };
        if let [a, b, c, d] = matrix[..] {
            let mut bytes = std::fs::read(&path).expect("just made");
            let at = 44 + bytes.windows(4).position(|name| name == b"tkhd").expect("a track");
            for (k, value) in [(0, a), (1, b), (3, c), (4, d)] {
                bytes[at + 4 * k..][..4].copy_from_slice(&(value << 16).to_be_bytes());
            }
            std::fs::write(&path, bytes).expect("a writable folder");
        }
        let mut other =
            Ffmpeg::open(Path::new("ffmpeg"), &path, 0, &Leash::default(), &Remarks::default()).expect("ffmpeg runs");
        let mut ours = crate::open(&path).expect("a video");
        assert!(ours.info().reader.contains("(built-in decoder"), "{name}");
        for i in 0.. {
            let (Some(frame), Some(picture)) = (ours.next(), other.picture()) else {
                assert!(
                    ours.next().is_none() && other.picture().is_none() && i > 5,
                    "{name}: both end after {i} frames"
                );
                break;
            };
            let (frame, (image, time)) = (frame.expect("a good frame"), picture.expect("a good frame"));
            assert!((frame.time - time).abs() < 1e-3, "{name}, frame {i}: {} s, ffmpeg {time} s", frame.time);
            let (a, b) = (look(&frame.image), look(&image));
            assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 12), "{name}, frame {i}: {a:?}, expected {b:?}");
        }
    }
}

/// Reads what can be read of damaged bytes: good frames, one error at most, the end. At most 40 frames.
fn survive(path: &Path, bytes: &[u8]) -> bool {
    std::fs::write(path, bytes).expect("a writable folder");
    let Ok(mut video) = VideoFile::open_with(path, &without_ffmpeg()) else { return false };
    for _ in 0..40 {
        match video.next() {
            Some(Ok(_)) => {}
            Some(Err(error)) => {
                assert!(error.to_string().contains("frame"), "{error}");
                assert!(video.next().is_none(), "the end comes after an error");
                return false;
            }
            None => break,
        }
    }
    true
}

/// 600 damaged files made of a small video, seed 11: half with flipped bits, half cut off or overwritten in part.
/// Where ffmpeg is there, 200 of each of three other kinds, for the second decoder too.
#[test]
fn damaged_videos_do_not_panic() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("a.mp4");
    let mut writer = crate::Mp4Writer::create(&path, 48, 32, 25.0).expect("a writable folder");
    for t in 0..12 {
        let data = (0..48 * 32).map(|i| ((i % 48) * 5 + i / 48 * 3 + t * 9) as u8).collect();
        writer
            .push(&Image::new(48, 32, 1, data).expect("sizes agree"), t as f64 / 25.0)
            .expect("a frame of the right size");
    }
    writer.finish().expect("written");
    let small = "-vf scale=48:32 -frames:v 12 -g 6 -c:v libx264";
    let others = [
        ("interlaced.mp4", "-flags +ilme+ildct -pix_fmt yuv420p"),
        ("reordered.mp4", "-bf 3 -pix_fmt yuv420p -movflags frag_keyframe+empty_moov"),
        ("deep.mp4", "-pix_fmt yuv422p10"),
    ];
    let others = others.iter().filter_map(|(name, options)| made(dir.path(), name, &format!("{small} {options}")));
    let mut draw = draws(11);
    for (source, n) in std::iter::once((path, 600)).chain(others.map(|path| (path, 200))) {
        let good = std::fs::read(&source).expect("just written");
        let path = dir.path().join("damaged.mp4");
        assert!(survive(&path, &good));
        let mut whole = 0;
        for i in 0..n {
            let mut bytes = good.clone();
            match i % 4 {
                0 | 1 => (0..1 + draw(6)).for_each(|_| {
                    let at = draw(bytes.len());
                    bytes[at] ^= 1 << draw(8);
                }),
                2 => bytes.truncate(draw(good.len())),
                _ => {
                    let (at, n) = (draw(good.len()), 1 + draw(8));
                    let value = [0, 0xff, 0x7f, 1][draw(4)];
                    bytes.iter_mut().skip(at).take(n).for_each(|byte| *byte = value);
                }
            }
            whole += usize::from(survive(&path, &bytes));
        }
        println!("{whole} of {n} damaged copies of {} were read to their end", source.display());
    }
}

/// 120 damaged clips, seed 12: bits flipped in the index or in the first coded frames, or the end cut off.
#[test]
fn damaged_clips_do_not_panic() {
    let clips = need!(data("clips"));
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("a.mp4");
    let mut draw = draws(12);
    for name in ["car-detection", "bottle-detection", "hockey"] {
        let good = std::fs::read(clips.join(name).with_extension("mp4")).expect("a clip");
        let index = good.windows(4).position(|name| name == b"moov").expect("an index");
        let first = open(&clips.join(name).with_extension("mp4")).movie.samples[0].offset as usize;
        for i in 0..40 {
            let mut bytes = good.clone();
            let (start, n) = if i % 2 == 0 { (index, 4000) } else { (first, 60_000) };
            for _ in 0..1 + draw(4) {
                let at = (start + draw(n)).min(bytes.len() - 1);
                bytes[at] ^= 1 << draw(8);
            }
            if i % 8 == 7 {
                bytes.truncate(draw(good.len()));
            }
            survive(&path, &bytes);
        }
    }
}

/// How a file is read by a decoder of choice: its facts, each frame's checksum and time, and the error at the end.
fn decoded(path: &Path, decoder: crate::Decoder) -> (SourceInfo, Vec<(u64, String)>, Option<String>) {
    let mut video = VideoFile::open_with(path, &Options { decoder, ..Options::default() }).expect("a video");
    let (info, mut frames, mut error) = (video.info().clone(), vec![], None);
    for frame in &mut video {
        match frame {
            Ok(frame) => {
                let sum: String = Md5::digest(frame.image.bytes()).iter().map(|byte| format!("{byte:02x}")).collect();
                frames.push((frame.time.to_bits(), sum));
            }
            Err(e) => error = Some(e.to_string()),
        }
    }
    (info, frames, error)
}

/// Whichever decoder reads it, a video has the same pixels at the same times: all kinds of H.264, clips of real video, cut-off files.
#[test]
fn the_pixels_do_not_depend_on_the_decoder() {
    use crate::Decoder::{Builtin, Ffmpeg};
    let dir = tempfile::tempdir().expect("a temporary folder");
    let kinds = [
        ("baseline.mp4", "-c:v libx264 -profile:v baseline -pix_fmt yuv420p"),
        ("reordered.mp4", "-c:v libx264 -pix_fmt yuv420p -bf 3 -x264-params b-pyramid=normal:keyint=10"),
        ("open.mp4", "-c:v libx264 -pix_fmt yuv420p -bf 3 -x264-params open-gop=1:keyint=8:min-keyint=8"),
        ("cut.mp4", "-ss 0.4 -i IN/open.mp4 -map 1 -c copy"),
        ("cut-without-edits.mp4", "-ss 0.4 -i IN/open.mp4 -map 1 -c copy -copyinkf -use_editlist 0"),
        ("turned.mp4", "-i IN/open.mp4 -map 1 -c copy -metadata:s:v rotate=90"),
        ("uneven.mp4", "-vf select=not(eq(mod(n\\,3)\\,1)) -fps_mode vfr -c:v libx264 -pix_fmt yuv420p"),
        ("interlaced.mp4", "-c:v libx264 -pix_fmt yuv420p -flags +ilme+ildct -x264-params interlaced=1"),
        ("4-2-2.mp4", "-c:v libx264 -pix_fmt yuv422p"),
        ("deep.mp4", "-c:v libx264 -pix_fmt yuv420p10"),
        ("odd.mp4", "-vf crop=75:51 -c:v libx264 -pix_fmt yuv420p"),
        ("full-range.mp4", "-c:v libx264 -pix_fmt yuvj420p"),
        ("bt709.mp4", "-colorspace bt709 -c:v libx264 -pix_fmt yuv420p"),
        ("cropped.mp4", "-i IN/open.mp4 -map 1 -c copy -bsf:v h264_metadata=crop_left=4:crop_top=2"),
    ];
    let mut files = vec![];
    for (name, options) in kinds {
        match made(dir.path(), name, &options.replace("IN", &dir.path().to_string_lossy())) {
            Some(path) => files.push(path),
            None => skip(&format!("ffmpeg that writes {name}")),
        }
    }
    if files.is_empty() {
        return;
    }
    let clips =
        data("clips").ok().map(|clips| ["car-detection", "hockey"].map(|name| clips.join(name).with_extension("mp4")));
    files.extend(clips.into_iter().flatten());
    let cut = dir.path().join("cut-off.mp4");
    let fast = made(dir.path(), "fast.mp4", "-c:v libx264 -pix_fmt yuv420p -movflags +faststart").expect("made before");
    let bytes = std::fs::read(fast).expect("just made");
    std::fs::write(&cut, &bytes[..bytes.len() * 3 / 4]).expect("a writable folder");
    files.push(cut);
    for path in files {
        let (ours, theirs) = (decoded(&path, Builtin), decoded(&path, Ffmpeg));
        let name = path.display();
        assert!(theirs.0.reader.contains("ffmpeg") && !ours.0.reader.contains("ffmpeg"), "{name}: {}", theirs.0.reader);
        assert_eq!(
            SourceInfo { reader: String::new(), ..ours.0 },
            SourceInfo { reader: String::new(), ..theirs.0 },
            "{name}"
        );
        assert_eq!(ours.1.len(), theirs.1.len(), "{name}");
        let first = ours.1.iter().zip(&theirs.1).position(|(a, b)| a != b);
        assert_eq!(first, None, "{name}: the first frame that differs");
        assert_eq!(ours.2, theirs.2, "{name}: the error at the end");
    }
}

/// The same for 48 streams with three or four settings each, drawn with seed 3: profile, references, weights, interlace, cropping, time
/// stamps, colours and others. Both readers give the same size, rate, times, pixels and error.
#[test]
fn drawn_streams_are_what_ffmpeg_decodes() {
    use crate::Decoder::{Builtin, Ffmpeg};
    let dir = tempfile::tempdir().expect("a temporary folder");
    let _ = need!(made(dir.path(), "a.mp4", "-c:v libx264").ok_or("ffmpeg with libx264"));
    let pictures = [
        "-pix_fmt yuv420p",
        "-pix_fmt yuvj420p",
        "-pix_fmt yuv422p",
        "-pix_fmt yuv420p10",
        "-pix_fmt yuv420p -profile:v main",
        "-pix_fmt yuv420p -profile:v baseline",
        "-pix_fmt yuv420p -colorspace bt709",
        "-pix_fmt yuv420p -colorspace smpte170m -color_range tv",
    ];
    let filters = [
        "null",
        "crop=98:62",
        "crop=75:51",
        "scale=176:144,setsar=12/11",
        "select=not(eq(mod(n\\,3)\\,1))",
        "setpts=PTS*(1+N/40)",
        "fade=in:0:20",
        "geq=lum=mod(X*Y+N*37\\,256):cb=128:cr=128",
    ];
    let outputs = ["", "-movflags +faststart", "-movflags frag_keyframe+empty_moov", "-movflags negative_cts_offsets"];
    let settings = [
        "ref=1",
        "ref=5",
        "bframes=0",
        "bframes=3:b-adapt=0",
        "bframes=5:b-pyramid=strict",
        "weightp=0",
        "weightp=2",
        "weightb=0",
        "direct=temporal",
        "direct=spatial",
        "cabac=0",
        "cabac=1",
        "8x8dct=0",
        "8x8dct=1",
        "slices=3",
        "slice-max-mbs=7",
        "interlaced=1",
        "tff=1",
        "bff=1",
        "fake-interlaced=1",
        "constrained-intra=1",
        "no-deblock=1",
        "deblock=3,-2",
        "cqm=jvt",
        "keyint=1",
        "keyint=9:open-gop=1",
        "keyint=6:min-keyint=6",
        "intra-refresh=1:keyint=8",
        "level=1.3",
        "level=4.2",
        "qp=1",
        "qp=44",
        "me=tesa:subme=10:trellis=2",
        "partitions=all",
        "nal-hrd=vbr:vbv-maxrate=300:vbv-bufsize=300",
        "aud=1",
        "sps-id=7",
        "crop-rect=0,2,4,6", // ffmpeg rounds what is cut off on the left
        "psy-rd=2,1",
        "no-mbtree=1:rc-lookahead=0",
    ];
    let (mut next, mut used, mut streams) = (draws(3), vec![0; settings.len()], 0);
    for k in 0..48 {
        // The first comes round; the others are drawn.
        let few: Vec<usize> = (0..4).map(|i| if i == 0 { k % settings.len() } else { next(settings.len()) }).collect();
        let few: Vec<usize> = few[..3 + next(2)].to_vec();
        let parameters = few.iter().map(|&i| settings[i]).collect::<Vec<_>>().join(":");
        let (picture, filter) = (pictures[next(pictures.len())], filters[next(filters.len())]);
        let output = outputs[next(outputs.len())];
        let options = format!(
            "-vf {filter} -fps_mode passthrough -c:v libx264 -preset fast {picture} -x264-params {parameters} {output}"
        );
        // Some of them exclude each other.
        let Some(path) = made(dir.path(), &format!("{k}.mp4"), &options) else { continue };
        let (ours, theirs) = (decoded(&path, Builtin), decoded(&path, Ffmpeg));
        let (a, b) = (SourceInfo { reader: String::new(), ..ours.0 }, SourceInfo { reader: String::new(), ..theirs.0 });
        assert_eq!(a, b, "{options}");
        assert_eq!((ours.1.len(), &ours.2), (theirs.1.len(), &theirs.2), "{options}");
        let first = ours.1.iter().zip(&theirs.1).position(|(a, b)| a != b);
        assert_eq!(first, None, "{options}: the first frame that differs");
        streams += 1;
        few.iter().for_each(|&i| used[i] += 1);
    }
    let never: Vec<&str> = settings.iter().zip(&used).filter(|(_, n)| **n == 0).map(|(name, _)| *name).collect();
    println!("{streams} streams are equal; settings in none: {never:?}");
    assert!(streams >= 40 && never.len() <= 4, "{streams}: {never:?}");
}

/// `auto` takes ffmpeg where it saves time, our own decoders where it does not or where the program is not there.
#[test]
fn the_faster_decoder_is_taken() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("a.mp4");
    let write = |n: usize, side: usize| {
        let mut writer = crate::Mp4Writer::create(&path, side, side, 25.0).expect("a writable folder");
        (0..n).for_each(|t| writer.push(&Image::grey(side, side, 9), t as f64 / 25.0).expect("a frame"));
        writer.finish().expect("written");
        open(&path).wants_ffmpeg()
    };
    assert!(!write(20, 64));
    assert!(write(150, 1024));
    let video = VideoFile::open_with(&path, &without_ffmpeg()).expect("a video");
    assert!(video.info().reader.contains("(built-in decoder)"));
    let asked = Options { decoder: crate::Decoder::Ffmpeg, ..without_ffmpeg() };
    let error = VideoFile::open_with(&path, &asked).expect_err("no program").to_string();
    assert!(error.contains("no-such-ffmpeg") && error.contains("install"), "{error}");
    std::fs::write(&path, "RIFF of another kind").expect("a writable folder");
    let asked = Options { decoder: crate::Decoder::Builtin, ..Options::default() };
    let error = VideoFile::open_with(&path, &asked).expect_err("no MP4").to_string();
    assert!(error.contains("without ffmpeg") && error.contains("auto"), "{error}");
}

/// Pixels that are not square, by the box pasp, by the track's head, or by the settings of H.264: both decoders give the same pictures, of
/// the size that players show, also turned.
#[test]
fn pixels_are_square() {
    use crate::Decoder::{Builtin, Ffmpeg};
    let dir = tempfile::tempdir().expect("a temporary folder");
    let wide = need!(
        made(dir.path(), "wide.mp4", "-vf setsar=64/45 -c:v libx264 -pix_fmt yuv420p").ok_or("ffmpeg with libx264")
    );
    let bytes = std::fs::read(&wide).expect("just made");
    let at = |name: &[u8]| bytes.windows(4).position(|found| found == name).expect("a box of this name");
    let (pasp, head) = (at(b"pasp"), at(b"tkhd") + 4 + 76);
    let mut files = vec![(wide, (142, 84))];
    let mut write = |name: &str, size, changes: &[(usize, &[u8])]| {
        let (mut bytes, path) = (bytes.clone(), dir.path().join(name));
        changes.iter().for_each(|(at, with)| bytes[*at..*at + with.len()].copy_from_slice(with));
        std::fs::write(&path, bytes).expect("a writable folder");
        files.push((path, size));
    };
    let sides = |w: u32, h: u32| [(w << 16).to_be_bytes(), (h << 16).to_be_bytes()].concat();
    write("by-settings.mp4", (142, 84), &[(pasp, b"free"), (head, &sides(100, 84))]);
    write("by-head.mp4", (200, 84), &[(pasp, b"free"), (head, &sides(200, 84))]);
    write("square.mp4", (100, 84), &[(pasp + 4, &[0, 0, 0, 1, 0, 0, 0, 1])]);
    write("high.mp4", (100, 168), &[(pasp + 4, &[0, 0, 0, 1, 0, 0, 0, 2])]);
    let turned = format!("-i {}/wide.mp4 -map 1 -c copy -metadata:s:v rotate=90", dir.path().display());
    files.extend(made(dir.path(), "turned.mp4", &turned).map(|path| (path, (84, 142))));
    for (path, size) in files {
        let (ours, theirs) = (decoded(&path, Builtin), decoded(&path, Ffmpeg));
        assert_eq!((ours.0.width, ours.0.height), size, "{}", path.display());
        assert_eq!((theirs.0.width, theirs.0.height), size, "{}", path.display());
        assert!(ours.1.len() == 24 && ours.1 == theirs.1, "{}", path.display());
    }
}

/// H.264 whose size changes, also to half the height with the same width, as single fields would have it.
#[test]
fn a_change_of_size_is_called_so_by_every_decoder() {
    use crate::Decoder::{Auto, Builtin, Ffmpeg};
    let dir = tempfile::tempdir().expect("a temporary folder");
    let raw = |name: &str, size: &str| {
        let sides = size.replace('x', ":");
        let options = format!("-vf scale={sides},setsar=1 -c:v libx264 -bf 0 -pix_fmt yuv420p");
        made(dir.path(), name, &options).map(|path| std::fs::read(path).expect("just made"))
    };
    let first = need!(raw("first.h264", "96x64").ok_or("ffmpeg with libx264"));
    for size in ["96x32", "48x32", "64x96"] {
        let second = raw("second.h264", size).expect("made before");
        std::fs::write(dir.path().join("both.h264"), [&*first, &*second].concat()).expect("a writable folder");
        let options = format!("-i {}/both.h264 -map 1 -c copy", dir.path().display());
        let path = made(dir.path(), "both.mp4", &options).expect("made before");
        for decoder in [Builtin, Ffmpeg, Auto] {
            let (info, frames, error) = decoded(&path, decoder);
            let error = error.expect("another size");
            assert_eq!((info.width, info.height, frames.len()), (96, 64, 24), "{size} by {decoder:?}: {error}");
            let found = size.replace('x', " x ");
            assert!(error.contains("size changes") && error.contains(&found), "{size} by {decoder:?}: {error}");
        }
    }
}

/// A hundred bytes are zeros: H.264 never has three in a row, whether the decoder sees the damage or not.
#[test]
fn zeros_in_the_middle_are_counted_as_damage() {
    use crate::Decoder::{Builtin, Ffmpeg};
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = need!(
        made(dir.path(), "a.mp4", "-c:v libx264 -pix_fmt yuv420p -movflags +faststart").ok_or("ffmpeg with libx264")
    );
    let damaged = |decoder| {
        let source = crate::open_with(&path, &Options { decoder, ..Options::default() }).expect("a video");
        let (remarks, frames) = (source.remarks(), source.count());
        (remarks.damaged(), remarks.sentences().join(" "), frames)
    };
    assert_eq!((damaged(Builtin).0, damaged(Ffmpeg).0), (0, 0));
    let mut bytes = std::fs::read(&path).expect("just made");
    let at = open(&path).movie.samples[12].offset as usize + 40;
    bytes[at..at + 100].fill(0);
    std::fs::write(&path, bytes).expect("a writable folder");
    for decoder in [Builtin, Ffmpeg] {
        let (damaged, text, frames) = damaged(decoder);
        assert!(damaged > 0 && text.contains("The video is damaged") && frames > 5, "{decoder:?}: {text}");
    }
}

/// The video, not the picture that stands before it, nor a track that is not enabled.
#[test]
fn a_cover_is_no_video() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let plain = need!(made(dir.path(), "plain.mp4", "-c:v libx264 -pix_fmt yuv420p").ok_or("ffmpeg with libx264"));
    let still = made(dir.path(), "cover.jpg", "-frames:v 1").expect("made before");
    let options = format!("-i {} -i {} -map 1 -map 2 -c copy", still.display(), plain.display());
    let cover = made(dir.path(), "cover.mp4", &options).expect("made before");
    let (wanted, found) = (decoded(&plain, crate::Decoder::Builtin), decoded(&cover, crate::Decoder::Builtin));
    assert!(wanted.1.len() == 24 && found.1 == wanted.1, "{} frames", found.1.len());
}
