use super::*;
use foveate_testing::{ffmpeg, need};

/// Scripts in the place of ffmpeg give frames of 2 x 2 pixels.
#[cfg(unix)]
const HEAD: &str = "printf 'YUV4MPEG2 W2 H2 F5:1 C420jpeg\\n'\n";
#[cfg(unix)]
const FRAME: &str = "printf 'FRAME\\nabcdef'\n";

#[test]
fn listening_waits_for_a_sender() {
    let asked = |address: &str, listen| {
        let address = Path::new(address);
        let found = arguments(&Scheme::of(address).expect("a scheme"), address, listen, Size::default());
        found.iter().map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
    };
    for (address, options) in [("rtsp://h/x", "-rtsp_flags listen"), ("http://h/x", "-listen 1")] {
        assert!(asked(address, true).contains(options) && !asked(address, false).contains("listen"), "{address}");
        // It throws away the frames that the analysis of a stream has read.
        assert!(!asked(address, false).contains("nobuffer"));
    }
}

#[cfg(unix)]
#[test]
fn time_stamps_are_those_of_the_stream() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let stamps = "printf '#tb 0: 1/10\\n0, 0, 70, 1, 6, 0x0\\n0, 0, 72, 1, 6, 0x0\\n0, 0, 75, 1, 6, 0x0\\n' >&0\n";
    let ffmpeg = crate::child::script(dir.path(), &format!("{HEAD}{stamps}{}", FRAME.repeat(3)));
    let options = LiveOptions { ffmpeg, ..LiveOptions::default() };
    let live = Connection::open(Path::new("http://127.0.0.1:9/x"), options, Duration::from_secs(5)).expect("a stream");
    let times: Vec<f64> = live.map(|frame| frame.expect("a frame").time).collect();
    assert!(times.len() == 3 && times[0] == 0.0 && (times[1] - 0.2).abs() + (times[2] - 0.5).abs() < 1e-9, "{times:?}");
}

/// Damage before the first frame of a connection is that of a stream joined in the middle, and what comes after its last frame is its end.
#[cfg(unix)]
#[test]
fn damage_sizes_and_jumps_of_a_stream_are_counted() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let stamp = |time: u32| format!("printf '0, 0, {time}, 1, 6, 0x0\\n' >&0\n");
    let log = |text: &str| format!("echo '[x @ 0x1] {text}' >&2\nsleep 0.3\n");
    let size = |side: u32| log(&format!("[verbose] w:{side} h:2 pixfmt:gray tb:1/10 fr:10/1 sar:1/1"));
    let text = [
        format!("{HEAD}printf '#tb 0: 1/10\\n' >&0\n{}{}", log("[error] no key frame"), size(2)),
        format!("{}{FRAME}{}{FRAME}", stamp(1), stamp(2)),
        format!("sleep 0.3\n{}{}{}{FRAME}", log("[error] overread 8"), log("[error] again"), stamp(3)),
        format!("sleep 0.3\n{}{}{FRAME}{}{FRAME}", size(4), stamp(500), stamp(501)),
        format!("sleep 0.3\n{}{}{FRAME}sleep 0.3\n{}exit 0", size(2), stamp(502), log("[error] Connection reset")),
    ];
    let options = LiveOptions { ffmpeg: crate::child::script(dir.path(), &text.concat()), ..LiveOptions::default() };
    let live = Connection::open(Path::new("http://127.0.0.1:9/x"), options, Duration::from_secs(5)).expect("a stream");
    let remarks = live.remarks.clone();
    assert_eq!((live.inspect(|frame| assert!(frame.is_ok())).count(), remarks.damaged()), (6, 1));
    let all = remarks.sentences().join(" ");
    for part in [
        "in 1 frame, first near frame 3 (overread 8)",
        "changed 2 times, first near frame 4",
        "jumped 1 time, first in frame 4",
    ] {
        assert!(all.contains(part), "{part}: {all}");
    }
}

/// How a stream ends: its ffmpeg gives two frames and ends so the first time, and hangs or fails when it is started again.
#[cfg(unix)]
fn end_of(first: &str, later: &str, listen: bool, seconds: u64) -> (usize, Option<String>, Vec<String>) {
    static NEWS: Mutex<Vec<String>> = Mutex::new(vec![]);
    static ONE: Mutex<()> = Mutex::new(());
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let dir = tempfile::tempdir().expect("a temporary folder");
    let began = dir.path().join("began");
    let (mark, two) = (began.display(), FRAME.repeat(2));
    let text = format!("if [ -e '{mark}' ]; then {later}; fi\ntouch '{mark}'\n{HEAD}{two}{first}");
    let ffmpeg = crate::child::script(dir.path(), &text);
    NEWS.lock().expect("no test panics in it").clear();
    let notify = |text: &str| NEWS.lock().expect("no test panics in it").push(text.to_owned());
    let options = LiveOptions { ffmpeg, listen, reconnect: Duration::from_secs(seconds), notify };
    let (mut frames, mut error) = (0, None);
    let stall = Duration::from_secs(1);
    for frame in Connection::open(Path::new("rtsp://127.0.0.1:9/x"), options, stall).expect("a stream") {
        match frame {
            Ok(_) => frames += 1,
            Err(e) => error = Some(e.to_string()),
        }
    }
    (frames, error, std::mem::take(&mut *NEWS.lock().expect("no test panics in it")))
}

#[cfg(unix)]
#[test]
fn the_end_of_a_stream_has_a_reason() {
    let began = Instant::now();
    // An orderly end, and no further sender is expected: no error.
    assert_eq!(end_of("exit 0", "exit 1", false, 0), (2, None, vec![]));
    // Waits for another sender, as long as given.
    let (frames, error, news) = end_of("exit 0", "exec sleep 100", true, 1);
    assert_eq!((frames, error), (2, None));
    let ["waiting for a sender", after, end] = [0, 1, 2].map(|i| news[i].trim_start_matches("rtsp://127.0.0.1:9/x: "))
    else {
        panic!("{news:?}")
    };
    assert!(after.contains("ended after frame 2; waiting for another sender, for 1 s at most"), "{after}");
    assert!(end.contains("no other sender came"), "{end}");
    // One that broke off is an error, which has the first reason.
    let bad = "echo '[rtsp @ 0x1] [error] the cable is cut' >&2; exit 1";
    for (listen, seconds) in [(false, 0), (true, 0), (true, 1)] {
        let (frames, error, news) = end_of(bad, "exec sleep 100", listen, seconds);
        let error = error.expect("it broke off");
        assert!(frames == 2 && error.contains("the cable is cut") && error.contains("broke off"), "{error}");
        assert_eq!(news.iter().any(|line| line.contains("broke off after frame 2")), seconds > 0, "{news:?}");
    }
    // Nor is it in good order where it cannot be opened again.
    let refused = "echo '[rtsp @ 0x1] [error] Connection refused' >&2; exit 1";
    let (_, error, _) = end_of("exit 0", refused, false, 2);
    assert!(error.is_some_and(|error| error.contains("ended") && error.contains("Connection refused")));
    let (_, error, _) = end_of("exec sleep 100", "exit 1", false, 1);
    assert!(error.is_some_and(|error| error.contains("nothing came for 1 s")));
    let (_, _, news) = end_of("exec sleep 100", "exit 1", false, 1);
    assert!(news[0].contains("broke off after frame 2 (nothing came for 1 s)"), "{news:?}");
    assert!(began.elapsed() < Duration::from_secs(20), "{:?}", began.elapsed());
}

/// The wait for a sender may be longer than a stream's pause.
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
    let mut live = Connection::open(address, options, Duration::from_secs(1)).expect("a stream");
    let times: Vec<f64> = live.by_ref().take(9).map(|frame| frame.expect("a frame").time).collect();
    assert_eq!((times.len(), live.reconnections().load(Ordering::Relaxed)), (8, 0));
    assert!(times[0] == 0.0 && times.is_sorted(), "{times:?}");
}

#[test]
fn unsupported_addresses_are_errors() {
    let open = |address: &str, options| {
        Connection::open(Path::new(address), options, Duration::from_secs(10)).err().expect("an error").to_string()
    };
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
    need!(ffmpeg());
    let error = open("http://127.0.0.1:9/x.ts", LiveOptions::default());
    assert!(error.contains("refused") && error.contains("check the address"), "{error}");
}
