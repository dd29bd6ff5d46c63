//! `--sandbox`: the decoder in a child process gives the same boxes, has no rights, and is never left out in silence.

use crate::place::{Place, errors};

/// The boxes with and without the sandbox, of a folder of pictures and of a video file.
#[test]
fn the_boxes_are_the_same() {
    let place = Place::new();
    place.done(["track", "video", "-c", "c.toml", "--no-report", "-o", "film"]);
    std::fs::rename(place.path("film/annotated.mp4"), place.path("video.mp4")).expect("a film");
    let first = place.text("video/groundtruth_rect.txt");
    let first = first.lines().next().expect("a box").replace(['\t', ' '], ",");
    for source in ["video", "video.mp4"] {
        let args = [source, "--init", &first];
        let free = place.boxes("free", &args);
        assert!(place.boxes("apart", &[&args[..], &["--sandbox"]].concat()) == free, "{source}");
    }
    // A damaged file has the same error, which the child sends.
    let mut bytes = place.read("video.mp4");
    let middle = bytes.len() / 2;
    bytes[middle..].fill(0);
    place.write("bad.mp4", bytes);
    let args = ["bad.mp4", "--init", &first, "--decoder", "builtin"];
    let free = place.track("failed", &args);
    let apart = place.track("failed", &[&args[..], &["--sandbox"]].concat());
    assert_eq!((free.status, errors(&free)), (apart.status, errors(&apart)));
    assert!(!free.status.success(), "half of its bytes are missing");
}

#[test]
fn what_has_no_sandbox_is_refused() {
    let place = Place::new();
    place.write("a.y4m", "YUV4MPEG2 W4 H2 F10:1 Cmono\nFRAME\n12345678");
    for (args, word) in [
        (&["a.y4m"][..], "alone; convert it"),
        (&["-"], "alone; give a file"),
        (&["video", "--decoder", "ffmpeg"], "leave out --decoder ffmpeg"),
        (&["rtsp://127.0.0.1:9/x"], "--sandbox is for video files"),
    ] {
        let text = place.failure(&[args, &["--init", "1,1,2,1", "--sandbox"]].concat());
        assert!(text.contains(word), "{args:?}: {text}");
    }
}
