use super::*;

fn told(address: &str, listen: bool) -> String {
    let address = Path::new(address);
    let found = arguments(&scheme(address).expect("a scheme"), address, listen, (0, 0));
    found.iter().map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}

#[test]
fn each_scheme_has_its_own_protocols() {
    for (address, protocols) in [
        ("rtsp://host/live", "-protocol_whitelist rtsp,tcp "),
        ("RTSP://host/live", "-protocol_whitelist rtsp,tcp "),
        ("http://host/a.ts", "-protocol_whitelist http,tcp "),
        ("https://host/a.ts", "-protocol_whitelist https,tls,tcp "),
        ("/dev/video0", "-protocol_whitelist file "),
    ] {
        assert!(told(address, false).contains(protocols), "{address}");
        assert!(!told(address, false).contains("listen"));
    }
    assert!(told("rtsp://h/x", true).contains("-rtsp_flags listen") && told("http://h/x", true).contains("-listen 1"));
    // A list of files is read where the address names one.
    assert!(
        told("http://h/a.m3u8?x=1", false).contains(",hls ") && !told("http://h/a.ts?b.m3u8", false).contains("hls")
    );
    for path in [
        "a.mp4",
        "file:a",
        "concat:a|b",
        "udp://h:1",
        "ftp://h/a",
        "-",
        "/dev/zero",
        "rtsp",
        "\u{e9}\u{e9}\u{e9}\u{e9}",
    ] {
        assert!(!is_live(Path::new(path)), "{path}");
    }
}

#[test]
fn passwords_are_not_shown() {
    for (address, shown) in [
        ("rtsp://me:se@cret@host:554/live?user=a@b", "rtsp://host:554/live?user=a@b"),
        ("HTTPS://me@host#x", "HTTPS://host#x"),
        ("http://host/a@b", "http://host/a@b"),
        ("/dev/video0", "/dev/video0"),
        ("a folder/me:word@b", "a folder/me:word@b"),
        ("ftp://me:word@host", "ftp://me:word@host"),
    ] {
        assert_eq!(without_password(address), shown);
    }
}

/// Who waits for a sender may wait longer than a stream may give nothing.
#[cfg(unix)]
#[test]
fn a_first_frame_that_comes_late_is_no_stall() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let ffmpeg = crate::child::script(
        dir.path(),
        "sleep 1.5\nprintf 'YUV4MPEG2 W2 H2 F5:1 C420jpeg\\n'\n\
         for frame in 1 2 3 4 5 6 7 8; do printf 'FRAME\\nabcdef'; sleep 0.2; done",
    );
    let options = LiveOptions { ffmpeg, listen: true, ..LiveOptions::default() };
    let address = Path::new("http://127.0.0.1:9/x");
    let mut live = Live::open_within(address, options, Duration::from_secs(1)).expect("a stream");
    let times: Vec<f64> = live.by_ref().take(9).map(|frame| frame.expect("a frame").time).collect();
    assert_eq!((times.len(), live.reconnections().load(Ordering::Relaxed)), (8, 0));
    assert!(times[0] == 0.0 && times.is_sorted(), "{times:?}");
}

#[test]
fn what_cannot_be_opened_is_said() {
    let open = |address: &str, options| Live::open(Path::new(address), options).err().expect("an error").to_string();
    assert!(open("gopher://h", LiveOptions::default()).contains("rtsp://"));
    let waits = LiveOptions { listen: true, ..LiveOptions::default() };
    assert!(open("/dev/video0", waits).contains("listen at rtsp"));
    let none = LiveOptions { ffmpeg: "no-such-ffmpeg".into(), ..LiveOptions::default() };
    let error = open("rtsp://me:secret@127.0.0.1:9/x", none);
    assert!(
        error.contains("install") && error.contains("rtsp://127.0.0.1:9/x") && !error.contains("secret"),
        "{error}"
    );
    assert!(!error.contains("convert"), "{error}");
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        return println!("skipped: the program ffmpeg is not installed");
    }
    let error = open("http://127.0.0.1:9/x.ts", LiveOptions::default());
    assert!(error.contains("refused") && error.contains("check the address"), "{error}");
}
