use super::*;

#[test]
fn what_ffmpeg_says_is_understood() {
    let heard = |line: &str| {
        let mut said = Said { frames: 7, ..Said::default() };
        said.hear(line);
        (said.complaint, said.cut, said.corrupt)
    };
    let some = |text: &str| Some(text.to_owned());
    assert_eq!(heard("[in#0 @ 0x5] [error] moov atom not found"), (some("moov atom not found"), None, None));
    let cut = "[matroska,webm @ 0x5] [error] File ended prematurely";
    assert_eq!(heard(cut), (None, some("File ended prematurely"), None));
    let corrupt = "[warning] file:cut.avi: corrupt decoded frame in stream 0";
    assert_eq!(heard(corrupt).2, Some((7, "file:cut.avi: corrupt decoded frame in stream 0".into())));
    assert_eq!(heard("[swscaler @ 0x5] [warning] No accelerated colorspace conversion found"), (None, None, None));
    assert_eq!(heard("[info] Output #0, rawvideo, to 'pipe:1':"), (None, None, None));
}

#[test]
fn what_ffprobe_says_is_understood() {
    let text = "pix_fmt=yuv420p\ncolor_range=pc\ncolor_space=bt709\nr_frame_rate=25/1\navg_frame_rate=25/2\n\
                duration=N/A\nnb_frames=N/A\nduration=4.000\n";
    let facts = Facts { rate: Some(12.5), frames: Some(50), matrix: Some(1), full_range: true };
    assert_eq!(Facts::read(text), facts);
    assert_eq!(Facts::read("pix_fmt=bgra\ncolor_range=pc\navg_frame_rate=0/0\n").matrix, Some(6));
    assert_eq!(Facts::read("nonsense"), Facts::default());
    assert_eq!(probe(Path::new("/a/ffmpeg-7.exe")), Path::new("/a/ffprobe-7.exe"));
}

fn installed() -> bool {
    let there = Command::new("ffmpeg").arg("-version").output().is_ok();
    if !there {
        println!("skipped: the program ffmpeg is not installed");
    }
    there
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
    let mut ffmpeg = Ffmpeg::open(Path::new("ffmpeg"), path, 0, &Leash::default()).expect("it starts");
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
    if !installed() {
        return;
    }
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

/// A title, a comment or the name of a stream that looks like what ffmpeg logs of a frame, with sizes, times and rates.
#[test]
fn a_title_makes_no_frames() {
    if !installed() {
        return;
    }
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
    if !installed() {
        return;
    }
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
fn a_missing_program_is_named_with_what_to_do() {
    let leash = Leash::default();
    let text = Ffmpeg::open(Path::new("no-such-ffmpeg"), Path::new("x.avi"), 0, &leash).err().expect("no program");
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
    let open = |skip| Ffmpeg::open(&program, Path::new("x.avi"), skip, &Leash::default()).map(|found| found.frames);
    assert_eq!(open(1), Ok(1));
    let error = open(2).expect_err("no second frame");
    assert!(error.contains("no more"), "{error}");
}
