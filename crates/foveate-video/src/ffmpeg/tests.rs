use super::facts::probe;
use super::*;
use foveate_testing::{ffmpeg, need};

#[test]
fn the_log_of_ffmpeg_is_parsed() {
    let read = |line: &str| {
        let mut said = Said { frames: 7, ..Said::default() };
        said.hear(line);
        (said.complaint, said.cut, said.corrupt, said.remarks.damaged())
    };
    let some = |text: &str| Some(text.to_owned());
    assert_eq!(read("[in#0 @ 0x5] [error] moov atom not found"), (some("moov atom not found"), None, None, 1));
    let cut = "[matroska,webm @ 0x5] [error] File ended prematurely";
    assert_eq!(read(cut), (None, some("File ended prematurely"), None, 0));
    let corrupt = "[warning] file:cut.avi: corrupt decoded frame in stream 0";
    assert_eq!(read(corrupt).2, Some((7, "file:cut.avi: corrupt decoded frame in stream 0".into())));
    assert_eq!(read(corrupt).3, 1);
    let nothing = (None, None, None, 0);
    assert_eq!(read("[swscaler @ 0x5] [warning] No accelerated colorspace conversion found"), nothing);
    assert_eq!(read("[info] Output #0, rawvideo, to 'pipe:1':"), nothing);
    let mut said = Said::default();
    said.hear(
        "[Parsed_scale_1 @ 0x5] [error] Error when evaluating the expression 'if(eq(iw,160)*eq(ih,120),iw,NAN)'.",
    );
    said.hear("[error] Error reinitializing filters!");
    assert!(said.resized && said.complaint.is_none() && said.remarks.damaged() == 0);
}

#[test]
fn the_output_of_ffprobe_is_parsed() {
    let video = "index=0\ncodec_name=h264\ncodec_type=video\nwidth=160\nheight=120\npix_fmt=yuv420p\ncolor_range=pc\ncolor_space=bt709\n\
                 r_frame_rate=25/1\navg_frame_rate=25/2\nduration=N/A\nnb_frames=N/A\n";
    let facts = Facts {
        stream: Some(0),
        sides: Some(Size::new(160, 120)),
        rate: Some(12.5),
        frames: Some(50),
        matrix: Some(1),
        full_range: true,
        sound: false,
    };
    let file = |streams: &str| format!("{streams}[FORMAT]\nduration=4.000\n[/FORMAT]\n");
    let plain = format!("[STREAM]\n{video}DISPOSITION:default=1\n[/STREAM]\n");
    assert_eq!(Facts::read(&file(&plain)), facts);
    // Once in a program, as in MPEG-TS, and once by itself.
    let twice = format!("[PROGRAM]\n[STREAM]\nindex=0\ncodec_type=video\n[/STREAM]\n[/PROGRAM]\n{plain}");
    assert_eq!(Facts::read(&file(&twice)), facts);
    let turned = format!("[STREAM]\n{video}[SIDE_DATA]\nrotation=-90\n[/SIDE_DATA]\n[/STREAM]\n");
    assert_eq!(Facts::read(&file(&turned)).sides, Some(Size::new(120, 160)));
    // A cover, marked or not, is no video where there is one; beside sound it is none at all.
    let other = plain.replace("index=0", "index=1");
    for cover in [
        "[STREAM]\nindex=0\ncodec_name=mjpeg\ncodec_type=video\nDISPOSITION:default=1\n[/STREAM]\n",
        "[STREAM]\nindex=0\ncodec_name=h264\ncodec_type=video\nDISPOSITION:attached_pic=1\n[/STREAM]\n",
        "[STREAM]\nindex=0\ncodec_name=h264\ncodec_type=video\nDISPOSITION:default=0\n[/STREAM]\n",
    ] {
        assert_eq!(Facts::read(&file(&format!("{cover}{other}"))).stream, Some(1), "{cover}");
        assert_eq!(Facts::read(cover).stream, Some(0));
    }
    let sound = "[STREAM]\nindex=1\ncodec_type=audio\n[/STREAM]\n";
    let cover = "[STREAM]\nindex=0\ncodec_type=video\nDISPOSITION:attached_pic=1\n[/STREAM]\n";
    assert!(Facts::read(sound).sound && Facts::read(&format!("{sound}{cover}")).sound);
    assert!(!Facts::read(&format!("{sound}{other}")).sound);
    let rgb = "[STREAM]\nindex=0\ncodec_type=video\npix_fmt=bgra\ncolor_range=pc\navg_frame_rate=0/0\n[/STREAM]\n";
    assert_eq!(Facts::read(rgb).matrix, Some(6));
    // Brightness and colours, whatever the name begins with: the matrix is unknown.
    for format in ["uyvy422", "p010le", "yuv420p", "nv12", "vuya", "xv30le", "gray"] {
        assert_eq!(Facts::read(&rgb.replace("bgra", format)).matrix, None, "{format}");
    }
    assert_eq!(Facts::read("nonsense"), Facts::default());
    assert_eq!(probe(Path::new("/a/ffmpeg-7.exe")), Path::new("/a/ffprobe-7.exe"));
}

fn make(path: &Path, options: &[&str]) {
    let made = Command::new("ffmpeg")
        .args(["-v", "error", "-f", "lavfi", "-i", "testsrc=size=160x120:rate=25:duration=4"])
        .args(["-c:v", "mpeg4", "-g", "10"])
        .args(options)
        .arg(path)
        .status();
    assert!(made.is_ok_and(|status| status.success()), "{} is made", path.display());
}

fn read(path: &Path) -> (Vec<Picture>, Option<String>) {
    let mut ffmpeg =
        Ffmpeg::open(Path::new("ffmpeg"), path, 0, &Leash::default(), &Remarks::default()).expect("it starts");
    let mut pictures = vec![];
    loop {
        match ffmpeg.picture() {
            Some(Ok(picture)) => pictures.push(picture),
            Some(Err(DecodeError::Damaged(text) | DecodeError::Unsupported(text))) => {
                return (pictures, Some(text));
            }
            None => return (pictures, None),
        }
    }
}

#[test]
fn a_file_that_was_cut_ends_with_an_error() {
    need!(ffmpeg());
    let dir = tempfile::tempdir().expect("a temporary folder");
    for name in ["a.mkv", "a.avi"] {
        let whole = dir.path().join(name);
        make(&whole, &[]);
        let bytes = std::fs::read(&whole).expect("just made");
        let cut = dir.path().join(format!("cut-{name}"));
        std::fs::write(&cut, &bytes[..bytes.len() * 3 / 5]).expect("a writable folder");
        let (pictures, error) = read(&whole);
        assert_eq!((pictures.len(), error), (100, None), "{name}");
        let (pictures, error) = read(&cut);
        assert!((30..90).contains(&pictures.len()), "{name}: {} frames are kept", pictures.len());
        assert!(error.is_some_and(|e| e.contains("breaks off")), "{name}");
    }
}

/// The log comes half a second after the program has ended: the cut is in it.
#[cfg(unix)]
#[test]
fn a_late_log_is_awaited() {
    use std::os::unix::fs::PermissionsExt;
    need!(ffmpeg());
    let dir = tempfile::tempdir().expect("a temporary folder");
    let (whole, cut, late) = (dir.path().join("a.mkv"), dir.path().join("cut.mkv"), dir.path().join("ffmpeg"));
    make(&whole, &[]);
    let bytes = std::fs::read(&whole).expect("just made");
    std::fs::write(&cut, &bytes[..bytes.len() * 3 / 5]).expect("a writable folder");
    let script = "#!/bin/bash\nexec ffmpeg \"$@\" 2> >(exec >/dev/null; sleep 0.5; cat >&2)\n";
    std::fs::write(&late, script).expect("a writable folder");
    std::fs::set_permissions(&late, std::fs::Permissions::from_mode(0o755)).expect("our own file");
    let mut ffmpeg = Ffmpeg::open(&late, &cut, 0, &Leash::default(), &Remarks::default()).expect("it runs");
    let end = std::iter::from_fn(|| ffmpeg.picture()).find_map(Result::err);
    assert!(matches!(end, Some(DecodeError::Damaged(text)) if text.contains("breaks off")));
}

/// A title, a comment or the name of a stream that looks like what ffmpeg logs of a frame, with sizes, times and rates.
#[test]
fn a_title_makes_no_frames() {
    need!(ffmpeg());
    let dir = tempfile::tempdir().expect("a temporary folder");
    let plain = dir.path().join("plain.mkv");
    make(&plain, &[]);
    let (wanted, _) = read(&plain);
    let lie = "x\n[Parsed_showinfo_1 @ 0x5] [info] n:0 pts:0 pts_time:9.5 fmt:gbrp s:16000x16000 i:P\n\
               [Parsed_showinfo_1 @ 0x5] [info] config in time_base: 1/12800, frame_rate: 99/1\n\
               [info]   Duration: 99:00:00.00, start\n#tb 0: 1/7\n0, 7, 7, 1, 1, 0x0\nFRAME\navg_frame_rate=7/1\n";
    let forged = dir.path().join("forged.mkv");
    let (title, comment) = (format!("title={lie}"), format!("comment={lie}"));
    make(&forged, &["-metadata", &title, "-metadata", &comment, "-metadata:s:v", &title, "-metadata:s:v", &comment]);
    let (found, error) = read(&forged);
    assert_eq!((found.len(), error), (100, None));
    assert!(found == wanted, "the same pictures at the same times");
    let info = crate::open(&forged).expect("a video").info().clone();
    assert_eq!((info.width, info.height, info.rate, info.frames), (160, 120, 25.0, Some(100)));
}

/// A list of other files is no video, whatever it is called.
#[test]
fn a_file_opens_no_other() {
    need!(ffmpeg());
    let dir = tempfile::tempdir().expect("a temporary folder");
    make(&dir.path().join("other.ts"), &[]);
    for (name, text) in [
        ("a.mkv", "ffconcat version 1.0\nfile other.ts\n"),
        ("b.mkv", "#EXTM3U\n#EXT-X-TARGETDURATION:4\n#EXTINF:4,\nother.ts\n#EXT-X-ENDLIST\n"),
        ("c.m3u8", "#EXTM3U\n#EXT-X-TARGETDURATION:4\n#EXTINF:4,\nother.ts\n#EXT-X-ENDLIST\n"),
        ("d.m3u8", "#EXTM3U\n#EXT-X-TARGETDURATION:4\n#EXTINF:4,\nhttp://127.0.0.1:9/other.ts\n#EXT-X-ENDLIST\n"),
        (
            "e.sdp",
            "v=0\no=- 0 0 IN IP4 127.0.0.1\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 9 RTP/AVP 96\na=rtpmap:96 H264/90000\n",
        ),
    ] {
        let path = dir.path().join(name);
        std::fs::write(&path, text).expect("a writable folder");
        let (pictures, error) = read(&path);
        assert!(pictures.is_empty(), "{name}");
        assert!(error.is_some_and(|e| e.contains("expected a video")), "{name}");
    }
}

#[test]
fn a_missing_program_is_an_error_with_the_remedy() {
    let leash = Leash::default();
    let text = Ffmpeg::open(Path::new("no-such-ffmpeg"), Path::new("x.avi"), 0, &leash, &Remarks::default())
        .err()
        .expect("no program");
    assert!(text.contains("no-such-ffmpeg") && text.contains("apt install ffmpeg"), "{text}");
    let error = std::io::Error::from(ErrorKind::NotFound);
    let said = |task| missing(Path::new("no-such-ffmpeg"), task, &error);
    assert!(said(Task::File).contains("convert") && !said(Task::File).contains("--decoder"));
    assert!(said(Task::Coded).contains("--decoder auto") && !said(Task::Coded).contains("convert"));
    assert!(said(Task::Live).contains("install") && !said(Task::Live).contains("convert"));
}

/// Of three frames that were read before, ffmpeg gives one and fails.
#[cfg(unix)]
#[test]
fn a_frame_that_cannot_be_skipped_is_an_error() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let text = "printf 'YUV4MPEG2 W2 H2 F5:1 C420jpeg\\nFRAME\\nabcdef'\necho '[error] no more' >&2\nexit 1";
    let program = crate::child::script(dir.path(), text);
    let open = |skip| {
        Ffmpeg::open(&program, Path::new("x.avi"), skip, &Leash::default(), &Remarks::default())
            .map(|found| found.frames)
    };
    assert_eq!(open(1), Ok(1));
    let error = open(2).expect_err("no second frame");
    assert!(error.contains("no more"), "{error}");
}

/// Between frames stands what is none, and more than a pipe holds, of pictures and of times. The program ends well. Grey that states no
/// range is not stretched.
#[cfg(unix)]
#[test]
fn pictures_that_cannot_be_read_are_an_error() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let times = "{ echo '#tb 0: 1/5'; seq 100000 | sed 's/.*/0, 0, &, 1/'; } >&0";
    let text = format!(
        "printf 'YUV4MPEG2 W2 H2 F5:1 Cmono\\nFRAME\\nabcdNONE\\n'\n{times}\nhead -c 1000000 /dev/zero\nexit 0"
    );
    let program = crate::child::script(dir.path(), &text);
    let mut ffmpeg =
        Ffmpeg::open(&program, Path::new("x.avi"), 0, &Leash::default(), &Remarks::default()).expect("it runs");
    let (image, _) = ffmpeg.picture().and_then(Result::ok).expect("a picture");
    assert_eq!(image.bytes(), b"abcd");
    let end = ffmpeg.picture().and_then(Result::err);
    assert!(matches!(end, Some(DecodeError::Damaged(text)) if text.contains("expected a line FRAME")));
}

/// The reader's reason, not the broken pipe of a writer that it left.
#[cfg(unix)]
#[test]
fn pictures_that_are_too_wide_are_an_error_with_the_reason() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let text = "printf 'YUV4MPEG2 W17000 H64 F5:1 Cmono\n'
echo '[error] Broken pipe' >&2
exit 1";
    let program = crate::child::script(dir.path(), text);
    let mut ffmpeg =
        Ffmpeg::open(&program, Path::new("x.avi"), 0, &Leash::default(), &Remarks::default()).expect("it runs");
    let end = ffmpeg.picture().and_then(Result::err);
    assert!(matches!(end, Some(DecodeError::Damaged(text)) if text.contains("W17000") && text.contains("smaller")));
}

/// What ffprobe reports of the frames of the first video stream, in seconds from the first.
fn stamps(path: &Path) -> Vec<f64> {
    let found = Command::new("ffprobe")
        .args([
            "-v",
            "error",
            "-select_streams",
            "v:0",
            "-show_entries",
            "frame=best_effort_timestamp_time",
            "-of",
            "csv=p=0",
        ])
        .arg(path)
        .output()
        .expect("it lies beside ffmpeg");
    let text = String::from_utf8_lossy(&found.stdout).into_owned();
    let all: Vec<f64> = text.lines().filter_map(|line| line.trim_end_matches(',').parse().ok()).collect();
    all.iter().map(|stamp| stamp - all[0]).collect()
}

/// Kinds of files of which ffmpeg alone reads frames of different lengths, their beginnings cut off or late; oracle: ffprobe.
#[test]
fn times_are_those_of_ffprobe() {
    need!(ffmpeg());
    let dir = tempfile::tempdir().expect("a temporary folder");
    let uneven = ["-vf", "select='not(eq(mod(n,7),2)+eq(mod(n,7),3))'", "-vsync", "vfr"];
    let kinds: [(&str, &[&str]); 9] = [
        ("a.mkv", &["-bf", "2"]),
        ("b.mkv", &["-output_ts_offset", "5"]),
        ("c.mp4", &["-bf", "2"]),
        ("d.mov", &["-video_track_timescale", "600"]),
        ("e.ts", &["-c:v", "mpeg2video", "-bf", "2"]),
        ("f.flv", &["-c:v", "flv1"]),
        ("g.wmv", &["-c:v", "wmv2"]),
        ("h.gif", &["-c:v", "gif"]),
        ("i.nut", &["-c:v", "mjpeg"]),
    ];
    for (name, options) in kinds {
        let path = dir.path().join(name);
        make(&path, &[&uneven[..], options].concat());
        let (pictures, error) = read(&path);
        let (times, wanted): (Vec<f64>, _) = (pictures.iter().map(|(_, time)| *time).collect(), stamps(&path));
        assert_eq!((times.len(), error), (wanted.len(), None), "{name}");
        let off = times.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // ffprobe rounds to a microsecond.
        assert!(wanted.len() > 50 && off < 2e-6, "{name}: {off} s off");
        let steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let most = steps.iter().copied().fold(0.0, f64::max);
        assert!(steps.iter().any(|step| *step < most / 2.0), "{name}: the frames last differently long");
    }
    // Two recordings one after the other: the time continues, and a message reports it.
    let once = std::fs::read(dir.path().join("e.ts")).expect("just made");
    let twice = dir.path().join("twice.ts");
    std::fs::write(&twice, once.repeat(2)).expect("a writable folder");
    let source = crate::open(&twice).expect("a video");
    let (remarks, frames) = (source.remarks(), source.map(|frame| frame.expect("a frame").time).collect::<Vec<_>>());
    assert!(frames.windows(2).all(|pair| pair[1] > pair[0]), "{frames:?}");
    assert!(remarks.sentences().iter().any(|s| s.contains("time stamps do not rise")), "{:?}", remarks.sentences());
}

/// Pictures are of square pixels, turned as players turn them.
#[test]
fn pixels_are_square() {
    need!(ffmpeg());
    let dir = tempfile::tempdir().expect("a temporary folder");
    type Kind = (&'static str, &'static str, &'static [&'static str], (usize, usize));
    let kinds: [Kind; 5] = [
        ("a.mkv", "64/45", &[], (228, 120)),
        ("b.mkv", "8/9", &[], (160, 135)),
        ("c.ts", "4/3", &["-c:v", "mpeg2video"], (213, 120)),
        ("d.y4m", "64/45", &["-c:v", "wrapped_avframe", "-pix_fmt", "yuv420p"], (228, 120)),
        ("e.mkv", "1/1", &[], (160, 120)),
    ];
    for (name, ratio, options, size) in kinds {
        let path = dir.path().join(name);
        make(&path, &[&["-vf", &format!("setsar={ratio}"), "-t", "0.2"], options].concat());
        let mut source = crate::open(&path).expect("a video");
        let (info, remarks) = (source.info().clone(), source.remarks());
        assert_eq!(info.size(), size.into(), "{name}");
        let frame = source.next().expect("a frame").expect("a good one");
        assert_eq!(frame.image.size(), info.size(), "{name}");
        assert_eq!(remarks.shape().is_some(), size != (160, 120), "{name}");
    }
}

/// The video is tracked, not the picture that lies before it.
#[test]
fn a_cover_is_no_video() {
    need!(ffmpeg());
    let dir = tempfile::tempdir().expect("a temporary folder");
    let (cover, plain, both) = (dir.path().join("cover.jpg"), dir.path().join("a.mkv"), dir.path().join("b.mkv"));
    make(&cover, &["-frames:v", "1", "-c:v", "mjpeg"]);
    make(&plain, &["-t", "1"]);
    let made = Command::new("ffmpeg")
        .args(["-v", "error", "-i"])
        .arg(&cover)
        .arg("-i")
        .arg(&plain)
        .args(["-map", "0", "-map", "1", "-c", "copy"])
        .arg(&both)
        .status();
    assert!(made.is_ok_and(|status| status.success()));
    let ((wanted, _), (found, error)) = (read(&plain), read(&both));
    assert_eq!((found.len(), error), (25, None));
    assert!(found == wanted, "the same pictures at the same times");
}

/// All frames before it are given; it is not made as large as the first picture in silence.
#[test]
fn a_change_of_size_is_an_error() {
    need!(ffmpeg());
    let dir = tempfile::tempdir().expect("a temporary folder");
    let (one, other, both) = (dir.path().join("a.mjpeg"), dir.path().join("b.mjpeg"), dir.path().join("c.mjpeg"));
    make(&one, &["-t", "1", "-c:v", "mjpeg"]);
    make(&other, &["-t", "1", "-c:v", "mjpeg", "-s", "120x160"]);
    let bytes = [&one, &other].map(|path| std::fs::read(path).expect("just made"));
    std::fs::write(&both, bytes.concat()).expect("a writable folder");
    let (pictures, error) = read(&both);
    let error = error.expect("another size");
    assert_eq!(pictures.len(), 25, "{error}");
    assert!(error.contains("160 x 120") && error.contains("size changes"), "{error}");
}

/// A hundred bytes are zeros: the frames are given, and the damage is counted.
#[test]
fn damage_that_the_decoder_conceals_is_counted() {
    need!(ffmpeg());
    let dir = tempfile::tempdir().expect("a temporary folder");
    for (name, options) in [("a.mkv", vec![]), ("b.ts", vec!["-c:v", "mpeg2video"])] {
        let path = dir.path().join(name);
        make(&path, &options);
        let all = |path: &Path| {
            let source = crate::open(path).expect("a video");
            (source.remarks(), source.filter(|frame| frame.is_ok()).count())
        };
        let (remarks, frames) = all(&path);
        assert_eq!((remarks.damaged(), frames), (0, 100), "{name}: {:?}", remarks.sentences());
        let mut bytes = std::fs::read(&path).expect("just made");
        let at = bytes.len() / 2;
        bytes[at..at + 100].fill(0);
        std::fs::write(&path, bytes).expect("a writable folder");
        let (remarks, frames) = all(&path);
        assert!(remarks.damaged() > 0 && frames > 90, "{name}: {frames} frames");
        assert!(remarks.sentences()[0].contains("The video is damaged"), "{name}: {:?}", remarks.sentences());
    }
}

/// Sound is called sound, with or without ffmpeg.
#[test]
fn sound_is_no_video() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("a.mp3");
    for head in [&b"ID3\x04\0\0\0\0\0\x21TSSE"[..], b"\xff\xfb\x90\x64\0\0\0\0\0\0\0\0", b"RIFF\x24\0\0\0WAVEfmt "] {
        std::fs::write(&path, head.repeat(9)).expect("a writable folder");
        let text = crate::open(&path).err().expect("no video").to_string();
        assert!(text.contains("a.mp3") && text.contains("sound"), "{text}");
    }
    need!(ffmpeg());
    let path = dir.path().join("b.ogg");
    let made = Command::new("ffmpeg")
        .args(["-v", "error", "-f", "lavfi", "-i", "sine=duration=1", "-c:a", "flac"])
        .arg(&path)
        .status();
    if made.is_ok_and(|status| status.success()) {
        let text = crate::open(&path).err().expect("no video").to_string();
        assert!(text.contains("b.ogg") && text.contains("sound"), "{text}");
    }
}
