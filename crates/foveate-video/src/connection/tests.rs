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

#[test]
fn times_follow_time_stamps_as_long_as_they_rise_by_little() {
    let (mut clock, began) = (Clock::default(), Instant::now());
    let mut at = |stamp, seconds| clock.time(stamp, began + Duration::from_secs(seconds));
    // Frames that come at once keep the distance at which they were taken.
    let times = [at(Some(100.0), 1), at(Some(100.5), 1), at(Some(101.0), 1)];
    assert_eq!(times, [0.0, 0.5, 1.0]);
    // A step back, a leap, a frame without one: by the clock.
    assert_eq!([at(Some(3.0), 2), at(Some(300.0), 5), at(None, 6), at(Some(301.0), 8)], [2.0, 5.0, 6.0, 8.0]);
    assert_eq!(at(Some(302.0), 9), 9.0);
    clock.restart();
    assert_eq!(clock.time(Some(303.0), began + Duration::from_secs(19)), 19.0);
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
    let (_, error, _) = end_of("exit 0", refused, false, 1);
    assert!(error.is_some_and(|error| error.contains("ended") && error.contains("Connection refused")));
    let (_, error, _) = end_of("exec sleep 100", "exit 1", false, 1);
    assert!(error.is_some_and(|error| error.contains("nothing came for 1 s")));
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
