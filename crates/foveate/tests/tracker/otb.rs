//! Sequences in OTB's layout: the written boxes are the drawn ones.

use foveate::Error;
use foveate::lab::Digits;
use foveate::lab::synthetic::{Clutter, Drawn, NOISE};
use foveate::video::annotation;
use foveate::video::otb::write_otb;

#[test]
fn what_is_written_is_what_was_drawn() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let out = dir.path().join("three");
    let settings = Clutter { frames: 3, noise: NOISE, ..Clutter::default() };
    let video = settings.video(&Digits::drawn(1, 2)).expect("a video");
    let known: Vec<_> = video.truth().iter().copied().map(Some).collect();
    let write = || write_otb(&out, video.clone().source(), &known, &[("label.txt", "3\n".into())]);
    write().expect("a writable folder");
    for t in 0..3 {
        let read = foveate::video::read_image(out.join(format!("img/{:04}.png", t + 1))).expect("a PNG");
        assert_eq!(read.bytes(), video.render(t).bytes());
    }
    let truth = annotation::read_truth(out.join("groundtruth_rect.txt")).expect("the truth");
    assert_eq!(truth, video.truth().iter().copied().map(Some).collect::<Vec<_>>());
    assert_eq!(std::fs::read_to_string(out.join("label.txt")).expect("a label"), "3\n");
    assert!(write().expect_err("it is there").to_string().contains("is there already"));
}

#[test]
fn a_broken_source_leaves_nothing() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let video = Clutter { frames: 2, ..Clutter::default() }.video(&Digits::drawn(1, 2)).expect("a video");
    let known = [Some(video.truth()[0]); 2];
    let broken = video.clone().source().take(1).chain([Err(Error::Invalid("broke".into()))]);
    assert!(write_otb(&dir.path().join("a"), broken, &known, &[]).is_err());
    assert!(write_otb(&dir.path().join("a"), video.clone().source().take(1), &known, &[]).is_err());
    assert_eq!(dir.path().read_dir().expect("readable").count(), 0);
}
