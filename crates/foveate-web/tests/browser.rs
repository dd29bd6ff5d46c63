//! The page without a server in a real browser, if one is installed: files, a pretended camera, drawing, corrections, saving,
//! the lesson, memory.
#![cfg(unix)]

#[path = "../../foveate-cli/tests/browser/mod.rs"]
mod browser;
mod page;

use foveate_testing::{data, need, skip};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use browser::Browser;
use foveate_lab::measure::{self, Axes, Settings, Track};
use foveate_testing::fall;
use page::{FRAMES, NUMBER, iou, mp4, serve, truth, y4m};
use serde_json::{Value, json};

/// A browser at the page.
fn open(folder: &Path, more: &[&str]) -> Result<Browser, String> {
    open_at(page::folder()?, folder, more)
}

fn open_at(page: PathBuf, folder: &Path, more: &[&str]) -> Result<Browser, String> {
    let mut browser = Browser::start(folder, more).ok_or("chromium that runs here")?;
    browser.call("Page.navigate", json!({ "url": serve(page) }));
    browser.until("document.readyState === 'complete' && !!byId('config').value");
    Ok(browser)
}

/// Chooses files as a person does.
fn give(browser: &mut Browser, files: &[&Path]) {
    let root = browser.call("DOM.getDocument", json!({}))["root"]["nodeId"].clone();
    let node = browser.call("DOM.querySelector", json!({ "nodeId": root, "selector": "#file" }))["nodeId"].clone();
    browser.call("DOM.setFileInputFiles", json!({ "nodeId": node, "files": files }));
}

/// Tracks to the end, and compares with the truth.
fn track(browser: &mut Browser, frames: usize) {
    let boxes = browser.track();
    assert_eq!(boxes.len(), frames);
    let overlaps: Vec<f64> = boxes.iter().enumerate().map(|(t, b)| iou(*b, truth(t))).collect();
    let mean = overlaps.iter().sum::<f64>() / frames as f64;
    assert!(mean >= 0.7, "{mean}: {overlaps:?}");
    eprintln!("mean IoU {mean:.3} in {frames} frames");
}

#[test]
fn a_video_file_is_tracked_corrected_and_saved_by_the_page_alone() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let mut browser = need!(open(dir.path(), &[]));
    browser.picture("choose");
    // A file that is no video is refused with a message.
    let other = dir.path().join("no.mp4");
    std::fs::write(&other, "nothing").expect("a writable folder");
    give(&mut browser, &[&other]);
    browser.until("!byId('message').hidden && /no.mp4/.test(byId('message').textContent)");
    browser.judge("message");

    let file = dir.path().join("round.mp4");
    mp4(&file);
    give(&mut browser, &[&file]);
    browser.until("!byId('stage').hidden && shown && shown.frame === 1");
    assert_eq!(browser.value("page.ends"), json!(FRAMES));
    assert_eq!(browser.value(&format!("{NUMBER}(shown.picture)")), json!(0));

    // By mouse; a click alone proposes a box.
    browser.value("propose([160, 124])");
    browser.until("page.draft !== null");
    browser.draw(truth(0));
    browser.click("#go");
    track(&mut browser, FRAMES);
    browser.picture("tracked");
    assert_eq!(browser.value("byId('missed').hidden"), json!(true));
    assert_eq!(browser.value("byId('seen').width > 8"), json!(true));

    // Every frame is the one it should be.
    for frame in [9, 2, 40] {
        browser.show(frame);
        assert_eq!(browser.value(&format!("{NUMBER}(shown.picture)")), json!(frame - 1));
    }

    // By keys: a box moved and sized on the first frame, and started.
    browser.show(1);
    browser.value("byId('screen').focus(), true");
    for (key, modifiers, times) in [
        ("ArrowRight", 0, 3),
        ("ArrowDown", 0, 2),
        ("ArrowLeft", 0, 2),
        ("ArrowUp", 0, 2),
        ("ArrowRight", 8, 1),
        ("ArrowLeft", 8, 1),
    ] {
        (0..times).for_each(|_| browser.key(key, modifiers));
    }
    let drawn = browser.drawn();
    assert!(iou(drawn, truth(0)) > 0.8, "{drawn:?}");
    // By figures: the rest of the way.
    let [x, y, w, h] = truth(0);
    for (name, value) in [("x", x + 1.0), ("y", y + 1.0), ("w", w), ("h", h)] {
        browser.value(&format!(
            "byId('box-{name}').value = {value}, byId('box-{name}').dispatchEvent(new Event('input')), true"
        ));
    }
    browser.value("byId('screen').focus(), true");
    browser.key("Enter", 0);
    browser.until("page.rows.length === 1");
    track(&mut browser, FRAMES);

    // A correction, and on from there.
    browser.show(20);
    let [x, y, w, h] = truth(19);
    browser.draw([x - 2.0, y - 1.0, w + 2.0, h + 2.0]);
    assert_eq!(browser.value("byId('go').textContent"), "Correct frame 20");
    browser.press("#go", "page.rows.length === 20 && page.rows[19].given");
    track(&mut browser, FRAMES);
    browser.until("byId('command').textContent.includes('--reinit 20:')");

    // The saved results are those on the page.
    browser.click("#want-film");
    browser.press("#save-go", "document.querySelectorAll('#files a').length === 5");
    let text = |browser: &mut Browser, name: &str| {
        let fetched = format!(
            "new Promise(done => {{ const r = new XMLHttpRequest(); r.onload = () => done(r.responseText); \
             r.onerror = () => done(null); r.open('GET', document.querySelector('#files a[download=\"{name}\"]').href); r.send(); }})"
        );
        browser.value(&fetched).as_str().map(str::to_owned)
    };
    let shown = browser.boxes();
    // The policy of the page allows only its own files: the links are for users, so the test checks the tracker.
    assert_eq!(text(&mut browser, "boxes.txt"), None);
    browser.complaints.retain(|complaint| !complaint.contains("Content Security Policy"));
    for (name, lines) in [("boxes.txt", FRAMES), ("track.csv", FRAMES + 1), ("track.jsonl", FRAMES)] {
        let text = browser.value(&format!("tracker.text(page.video.session, '{name}')"));
        let text = text.as_str().expect("text");
        assert_eq!(text.lines().count(), lines, "{name}");
        if name == "boxes.txt" {
            for (line, [x, y, w, h]) in text.lines().zip(&shown) {
                let numbers: Vec<f64> = line.split(',').map(|n| n.parse().expect("a number")).collect();
                assert!(numbers.iter().zip([x + 1.0, y + 1.0, *w, *h]).all(|(a, b)| (a - b).abs() < 0.01), "{line}");
            }
        }
    }
    let report = browser.value("tracker.text(page.video.session, 'report.html')");
    assert!(report.as_str().is_some_and(|text| text.contains("<!doctype html>") && text.len() > 50_000));

    browser.value(
        "(async () => { film = new File([await tracker.blob(page.video.session, 'annotated.mp4')], 'annotated.mp4', { type: 'video/mp4' }); return film.size; })()",
    );
    browser.judge("track");
    // A second target, on the first one's heels; each has its results.
    browser.show(10);
    browser.draw(truth(9));
    browser.click("#add");
    browser.until("page.targets.length === 2 && page.target === 1 && page.targets.every(t => t.ended) && !page.playing && !page.busy");
    let boxes = "page.targets.map(({ rows }) => rows.slice(-50).map(row => row.box))";
    let [first, second]: [Vec<[f64; 4]>; 2] = serde_json::from_value(browser.value(boxes)).expect("two tracks");
    let mean = first.iter().zip(&second).map(|(a, b)| iou(*a, *b)).sum::<f64>() / 50.0;
    assert!(mean > 0.7, "both are on the target: {mean}");
    browser.picture("targets");
    browser.value("byId('want-film').checked = false, byId('want-report').checked = false, true");
    browser.press("#save-go", "document.querySelectorAll('#files a').length === 6");
    let lines = browser.value(
        "(async () => (await tracker.text(page.video.session, 'target-2-boxes.txt')).split('\\n').length - 1)()",
    );
    assert_eq!(lines, json!(FRAMES - 9));
    // The film is a video that the page itself can follow something in.
    browser.value("(async () => { await choose({ name: 'annotated.mp4', files: [film] }); return true; })()");
    browser.until("page.video.name === 'annotated.mp4' && shown && shown.frame === 1");
    assert_eq!(browser.value("page.ends"), json!(FRAMES));
    browser.picture("film");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// A lesson on free fall, by mouse: a box, the scale, the origin, a fit; g, its files, and doubtful frames.
#[test]
fn a_fall_is_measured_with_the_mouse() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let mut browser = need!(open(dir.path(), &[]));
    let file = dir.path().join("ball.mp4");
    page::falling(&file);
    give(&mut browser, &[&file]);
    browser.until("!byId('stage').hidden && shown && shown.frame === 1");
    browser.draw(fall::bbox(0));
    browser.press("#go", "page.rows.length > 1");
    // The charts grow while it tracks.
    browser.value("byId('measuring').open = true");
    browser.until("measuring.answer?.times.length > 5 && document.querySelectorAll('#plots .motion').length === 6");
    browser.track();
    browser.until(&format!("measuring.answer?.times.length === {}", fall::FRAMES));
    // The scale: dragged, an end placed finely, a length typed.
    browser.click("#scale-set");
    let [from, to] = fall::RULE;
    browser.drag(&[from, (to.0 + 3.0, to.1 - 4.0)]);
    assert_eq!(browser.value("document.activeElement.id"), "length");
    let end: (f64, f64) = serde_json::from_value(browser.value("scene.ruler[1]")).expect("an end");
    browser.drag(&[end, (end.0 + 4.0 * (to.0 - end.0), end.1 + 4.0 * (to.1 - end.1))]);
    let ruler: [(f64, f64); 2] = serde_json::from_value(browser.value("scene.ruler")).expect("two ends");
    let off = |a: (f64, f64), b: (f64, f64)| (a.0 - b.0).hypot(a.1 - b.1);
    assert!(off(ruler[0], from) < 1.0 && off(ruler[1], to) < 1.0, "{ruler:?}");
    browser.picture("measure-scale");
    browser.fill("length", "2.00");
    browser.fill("length-error", "0.002");
    browser.press("#tool-done", "measuring.answer.unit === 'm'");
    // The origin, by a click, and by keys.
    browser.click("#axes-set");
    browser.drag(&[(200.0, 42.0)]);
    browser.key("ArrowUp", 0);
    let origin: (f64, f64) = serde_json::from_value(browser.value("scene.origin")).expect("an origin");
    assert!(off(origin, (200.0, 41.0)) < 1.0, "{origin:?}");
    browser.fill("angle", "90");
    browser.picture("measure-axes");
    browser.fill("angle", "");
    browser.key("Escape", 0);
    browser.click("#tool-done");
    // A fit, and the times of it by a drag on a chart.
    browser.value("byId('fit-curve').value = 'parabola', byId('fit-curve').dispatchEvent(new Event('input')), true");
    browser.until("/^g = /.test(byId('fit-values').firstChild?.textContent) && document.querySelectorAll('#plots .motion').length === 7");
    let g = browser.value("byId('fit-values').firstChild.textContent");
    let g = g.as_str().expect("text").to_owned();
    let value: f64 = g.split(' ').nth(2).and_then(|n| n.parse().ok()).expect("a number");
    eprintln!("{g}");
    assert!((value - fall::G).abs() < 0.15 && g.contains("m/s² (95 %: "), "{g}");
    let chart = "(() => { const e = plots[1]; e.scrollIntoView({ block: 'center' }); const b = e.getBoundingClientRect(); return [b.x, b.y, b.width, b.height]; })()";
    let [x, y, w, h]: [f64; 4] = serde_json::from_value(browser.value(chart)).expect("a chart");
    for (kind, share) in [("mousePressed", 0.3), ("mouseMoved", 0.5), ("mouseMoved", 0.8), ("mouseReleased", 0.8)] {
        browser.mouse(kind, (x + share * w, y + h / 2.0));
    }
    browser.until("+byId('fit-from').value > 0.1 && +byId('fit-to').value < 0.6 && measuring.answer.fit.points < 30 && !measuring.busy");
    browser.judge("measure");
    browser.click("#fit-all");
    // A click on a chart goes to its frame.
    let [x, y, w, h]: [f64; 4] = serde_json::from_value(browser.value(chart)).expect("a chart");
    browser.mouse("mousePressed", (x + 0.6 * w, y + h / 2.0));
    browser.mouse("mouseReleased", (x + 0.6 * w, y + h / 2.0));
    browser.until("page.frame > 15 && page.frame < 32 && shown.frame === page.frame && !measuring.busy");

    // The table has the numbers of the program for this track. Native functions such as exp differ in the last bits.
    let files = browser.value("tracker.ask(measureMessage({ files: true }))");
    let ours = files["files"][0]["text"].as_str().expect("a table").to_owned();
    browser.value("byId('want-report').checked = false, true");
    browser.press("#save-go", "document.querySelectorAll('#files a').length === 3");
    let track = browser.value("tracker.text(page.video.session, 'track.csv')");
    let positions = measure::parse(track.as_str().expect("text"), Path::new("track.csv")).expect("a track");
    let options = browser.value("measureOptions()");
    let option = |name: &str| options[name].as_str().unwrap_or_else(|| panic!("{name} in {options}"));
    let axes = Axes {
        ruler: Some(option("ruler").parse().expect("a ruler")),
        origin: Some(measure::parse_point(option("origin")).expect("a point")),
        angle: 0.0,
    };
    let settings = Settings { axes, fits: vec![option("fit").parse().expect("a fit")], ..Settings::default() };
    let native = measure::measure(&[Track { name: "1".into(), positions }], None, &settings).expect("a measurement");
    let [(_, theirs), ..] = measure::tables(None, 1.0, &native);
    let mut most: f64 = 0.0;
    for (a, b) in ours.lines().zip(theirs.lines()).skip(1) {
        for (a, b) in a.split(',').zip(b.split(',')) {
            match (a.parse::<f64>(), b.parse::<f64>()) {
                (Ok(a), Ok(b)) => most = most.max((a - b).abs() / b.abs().max(1e-3)),
                _ => assert_eq!(a, b),
            }
        }
    }
    eprintln!("largest relative difference from native code: {most:.1e}");
    assert!(ours.lines().count() == theirs.lines().count() && most < 1e-6, "{most}");

    // A box beside the ball leaps; its frame is listed, leads there, and is corrected there.
    browser.show(20);
    let [x, y, w, h] = fall::bbox(19);
    browser.draw([x + 22.0, y - 6.0, w, h]);
    browser.press("#go", "page.rows.length === 20 && lastRow().given");
    browser.track();
    browser.until("document.querySelectorAll('#doubt-list button').length > 0 && !measuring.busy");
    browser.picture("measure-doubts");
    browser.press("#doubt-list button", "page.frame === measuring.answer.ask[0].frame && shown.frame === page.frame");
    browser.show(20);
    browser.draw(fall::bbox(19));
    browser.press("#go", "page.rows.length === 20 && lastRow().given");
    browser.track();
    browser.until(&format!(
        "measuring.answer?.times.length === {} && !measuring.busy && measuring.key === measureKey()",
        fall::FRAMES
    ));
    let g = browser.value("+byId('fit-values').firstChild.textContent.split(' ')[2]").as_f64().expect("g");
    assert!((g - fall::G).abs() < 0.2, "{g}");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// A video without a decoder: the message names its kind and the remedy, also on a phone.
#[test]
fn a_video_that_cannot_be_played_is_refused_with_what_to_do() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let (source, file) = (dir.path().join("a.y4m"), dir.path().join("phone.mov"));
    y4m(&source, 30);
    let mut ffmpeg = std::process::Command::new("ffmpeg");
    ffmpeg.args(["-loglevel", "error", "-i"]).arg(&source).args(["-c:v", "libx265", "-x265-params", "log-level=none"]);
    if !ffmpeg.args(["-tag:v", "hvc1"]).arg(&file).status().is_ok_and(|status| status.success()) {
        return skip("ffmpeg with libx265");
    }
    let mut browser = need!(open(dir.path(), &[]));
    if browser.value("MediaSource.isTypeSupported('video/mp4; codecs=\"hvc1.1.6.L93.B0\"')") == true {
        return skip("browser without HEVC");
    }
    give(&mut browser, &[&file]);
    browser.until("!byId('message').hidden");
    let said = browser.value("byId('message').textContent").as_str().expect("text").to_owned();
    for word in ["phone.mov", "HEVC (H.265)", "Safari", "ffmpeg -i \"phone.mov\"", "iPhone", "Most Compatible"] {
        assert!(said.contains(word), "{word}: {said}");
    }
    assert!(!said.contains("decoder auto"), "{said}");
}

/// Pauses a camera; which frame of the test's own is shown.
fn held(browser: &mut Browser) -> usize {
    browser.value("pause(), true");
    browser.until("!page.playing && shown.frame === page.frame");
    browser.value(&format!("{NUMBER}(shown.picture)")).as_u64().expect("a number") as usize
}

#[test]
fn a_camera_is_followed() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let file = dir.path().join("camera.y4m");
    y4m(&file, 20);
    let capture = format!("--use-file-for-fake-video-capture={}", file.display());
    let fake = ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream", &capture];
    let mut browser = need!(open(dir.path(), &fake));
    browser.press("#pick-camera", "!byId('stage').hidden && shown && page.frame > 3");
    // The shown frame waits while a box is drawn on it; its number shows which one it is.
    let number = held(&mut browser);
    browser.value("byId('config').value = 'natural-fast', true");
    browser.draw(truth(number));
    browser.press("#go", "page.rows.length > 1");
    // The frame of the file of each picture, while pictures are stored.
    let seconds = std::env::var("FOVEATE_WEB_SECONDS").ok().and_then(|text| text.parse().ok()).unwrap_or(20u64);
    let (began, mut overlaps) = (Instant::now(), std::collections::BTreeMap::new());
    let mut memory: Vec<[f64; 4]> = vec![];
    let mut reported = 0;
    while began.elapsed() < Duration::from_secs(seconds) {
        let seen = format!("[...pictures].filter(([f]) => rowOf(f)).map(([f, p]) => [f, {NUMBER}(p), rowOf(f).box])");
        let seen: Vec<(u64, usize, [f64; 4])> = serde_json::from_value(browser.value(&seen)).expect("pictures");
        seen.into_iter().for_each(|(frame, number, shown)| {
            overlaps.insert(frame, iou(shown, truth(number)));
        });
        if began.elapsed().as_secs() / 5 > reported {
            reported = began.elapsed().as_secs() / 5;
            browser.call("HeapProfiler.collectGarbage", json!({}));
            let size = "(async () => [page.targets[0].count, performance.memory.usedJSHeapSize, await tracker.size(), page.details.size])()";
            memory.push(serde_json::from_value(browser.value(size)).expect("figures"));
        }
        std::thread::sleep(Duration::from_millis(150));
    }
    browser.value("pause(), true");
    browser.until("!page.playing && !page.busy");
    let mean = overlaps.values().sum::<f64>() / overlaps.len() as f64;
    let missed = browser.value("byId('missed').textContent");
    eprintln!(
        "camera: {} frames tracked, {} compared, mean IoU {mean:.3}; {missed}",
        browser.value("page.targets[0].count"),
        overlaps.len()
    );
    eprintln!("rows, bytes of the page, of the tracker, details kept: {memory:?}");
    assert!(overlaps.len() > 50 && mean >= 0.7, "{mean}: {overlaps:?}");
    if let [.., first, last] = &*memory {
        // What grows is the results, a few kilobytes a frame at most.
        let frames = (last[0] - first[0]).max(1.0);
        assert!((last[1] - first[1]) / frames < 40_000.0, "the page's memory grows: {memory:?}");
    }

    // A correction of the last frame; then the results.
    let number = browser.value(&format!("{NUMBER}(shown.picture)")).as_u64().expect("a number") as usize;
    browser.draw(truth(number));
    browser.press("#go", "lastRow().given");
    let length = browser.value("page.targets[0].count").as_u64().expect("a number") as usize;
    browser.press("#save-go", "document.querySelectorAll('#files a').length === 3");
    let text = browser.value("tracker.text(page.video.session, 'track.jsonl')");
    let lines: Vec<Value> =
        text.as_str().expect("text").lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(lines.len(), length);
    assert_eq!(lines[length - 1]["status"], "given");
    browser.picture("camera");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// The browser decodes files that our decoder does not support, frame by frame, so that none is left out.
#[test]
fn a_video_that_the_browser_decodes_is_seen_frame_by_frame() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let (source, file) = (dir.path().join("a.y4m"), dir.path().join("a.webm"));
    y4m(&source, 30);
    let mut ffmpeg = std::process::Command::new("ffmpeg");
    ffmpeg.args(["-loglevel", "error", "-i"]).arg(&source).args(["-c:v", "libvpx", "-b:v", "2M"]).arg(&file);
    if !ffmpeg.status().is_ok_and(|status| status.success()) {
        return skip("ffmpeg with libvpx");
    }
    let mut browser = need!(open(dir.path(), &[]));
    give(&mut browser, &[&file]);
    browser.until("!byId('stage').hidden && shown && shown.frame === 1");
    assert_eq!(browser.value(&format!("{NUMBER}(shown.picture)")), json!(0));
    browser.value("byId('config').value = 'natural-fast', true");
    browser.draw(truth(0));
    browser.click("#go");
    // In the order of their arrival: frame and place.
    let mut seen = std::collections::BTreeMap::new();
    let began = Instant::now();
    while browser.value("page.ended && !page.playing && !page.busy") != true {
        let now = format!("[...pictures].filter(([f]) => rowOf(f)).map(([f, p]) => [f, {NUMBER}(p), rowOf(f).box])");
        let now: Vec<(usize, usize, [f64; 4])> = serde_json::from_value(browser.value(&now)).expect("pictures");
        now.into_iter().for_each(|(frame, number, shown)| {
            seen.insert(frame, (number, iou(shown, truth(number))));
        });
        assert!(began.elapsed() < Duration::from_secs(120), "never at the end");
        std::thread::sleep(Duration::from_millis(50));
    }
    let missed = browser.value("tracker.missed(page.video.session)").as_u64().expect("a number");
    let frames = browser.value("page.rows.length").as_u64().expect("a number");
    eprintln!("the browser gave {frames} of {FRAMES} frames, and says that {missed} were not seen");
    assert_eq!(frames + missed, FRAMES as u64, "no frame is left out silently");
    assert!(missed <= 2, "{missed} frames were left out");
    let mean = seen.values().map(|(_, iou)| iou).sum::<f64>() / seen.len() as f64;
    assert!(mean >= 0.7 && seen.len() > 10, "{mean}: {seen:?}");
    if missed == 0 {
        assert!(seen.iter().all(|(frame, (number, _))| frame - 1 == *number), "{seen:?}");
    }
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

#[test]
fn a_policy_learns_in_a_scene_of_digits() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let mut browser = need!(open(dir.path(), &[]));
    browser.press("#tab-lesson", "!byId('lesson').hidden && lesson.about !== null");
    // It waits, and shows for what.
    browser.until("/^Press Play/.test(byId('l-state').textContent)");
    browser.click("#l-play");
    browser.until("lesson.playing && byId('l-state').textContent === '' && byId('l-play').textContent === 'Pause'");
    browser.until("lesson.rows.length > 60");
    assert_eq!(browser.value("!!lesson.now.learning.surface && lesson.gazes.length > 50"), json!(true));
    // Another policy, another scene; noise by keys.
    for (policy, arms) in [("hedge", 9), ("random", 9), ("pool", 9)] {
        browser.value(&format!(
            "byId('l-policy').value = '{policy}', byId('l-policy').dispatchEvent(new Event('change')), true"
        ));
        browser.until(&format!("lesson.about.policy === '{policy}' && lesson.rows.length > 10"));
        assert_eq!(browser.value("byId('l-arms').children.length"), json!(arms), "{policy}");
    }
    for scene in ["clutter", "bars"] {
        browser.value(&format!(
            "byId('l-kind').value = '{scene}', byId('l-kind').dispatchEvent(new Event('change')), true"
        ));
        browser.until("lesson.rows.length > 10 && lesson.rows.length < 60");
    }
    browser.value("byId('l-noise').focus(), true");
    let noise = browser.value("byId('l-noise').value");
    browser.key("ArrowRight", 0);
    browser.until("lesson.rows.length > 5 && lesson.rows.length < 60");
    assert_ne!(browser.value("byId('l-noise').value"), noise);
    browser.value("byId('l-kind').value = 'close-up', byId('l-kind').dispatchEvent(new Event('change')), true");
    // However slow the machine is, as long as it goes on.
    for rows in (0..).step_by(20) {
        browser.until(&format!("lesson.ended && !lesson.playing || lesson.rows.length > {rows}"));
        if browser.value("lesson.ended && !lesson.playing") == json!(true) {
            break;
        }
    }
    let means = browser
        .value("[0, 1].map(which => lesson.rows.reduce((sum, row) => sum + row[which], 0) / lesson.rows.length)");
    eprintln!("mean error of gp-ucb and of a fixed centre on a large 0: {means}");
    browser.judge("lesson");
    browser.key("Tab", 0);
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// What grows while a camera is followed: a source that gives frames as fast as they are taken stands for it, and memory after a
/// third of them is compared with that at the end.
#[test]
fn a_camera_takes_no_more_memory_the_longer_it_runs() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let mut browser = need!(open(dir.path(), &["--js-flags=--expose-gc"]));
    let frames: usize = std::env::var("FOVEATE_WEB_FRAMES").ok().and_then(|n| n.parse().ok()).unwrap_or(1500);
    let pictures: Vec<Value> = (0..FRAMES)
        .map(|t| {
            use base64::Engine as _;
            json!(base64::engine::general_purpose::STANDARD.encode(page::frame(t)))
        })
        .collect();
    let (w, h) = (page::SIZE.width, page::SIZE.height);
    let source = format!(
        "(() => {{ const all = {}.map(text => Uint8Array.from(atob(text), c => c.charCodeAt(0))); let at = 0; \
         cameraSource = async () => ({{ width: {w}, height: {h}, rate: 30, reader: 'a test', live: true, missed: 0, close() {{}}, \
         async next() {{ const grey = all[at % all.length], out = new ImageData({w}, {h}); \
         for (let i = 0; i < grey.length; i++) out.data.set([grey[i], grey[i], grey[i], 255], 4 * i); \
         return {{ pixels: out, time: at++ / 30, missed: 0 }}; }} }}); return true; }})()",
        json!(pictures)
    );
    browser.value(&source);
    browser.press("#pick-camera", "!byId('stage').hidden && shown && page.frame > 2");
    let number = held(&mut browser);
    browser.value("byId('config').value = 'natural-fast', byId('pace').value = 200, true");
    browser.draw(truth(number));
    browser.click("#go");
    let measure = |browser: &mut Browser, at: usize| -> [f64; 3] {
        let began = Instant::now();
        while browser.value("page.targets[0]?.count ?? 0").as_u64().is_some_and(|count| (count as usize) < at) {
            assert!(began.elapsed() < Duration::from_secs(3600), "{at} frames do not come");
            std::thread::sleep(Duration::from_millis(200));
        }
        browser.call("HeapProfiler.collectGarbage", json!({}));
        // `gc` in the expression itself: between two calls a busy machine leaves time for megabytes of garbage.
        let size = "(async () => { gc(); const used = performance.memory.usedJSHeapSize; \
                    return [page.targets[0].count, used, await tracker.size()]; })()";
        serde_json::from_value(browser.value(size)).expect("figures")
    };
    // The page keeps rows of the last 3,000 frames: of 12,000 frames the first third is past that.
    let all: Vec<[f64; 3]> = (1..=6).map(|k| measure(&mut browser, k * frames / 6)).collect();
    eprintln!("frames, bytes of the page, of the tracker: {all:?}");
    let [third, .., last] = &all[1..] else { unreachable!("six were taken") };
    let grown = last[0] - third[0];
    // Results are kept to be saved, half a kilobyte a frame.
    assert!(last[2] - third[2] <= 600.0 * grown + f64::from(1 << 20), "the tracker's memory grows: {all:?}");
    let page = if frames >= 12_000 { 1e6 } else { 1e6 + 800.0 * grown };
    assert!(last[1] - third[1] <= page, "the page's memory grows: {all:?}");
    // Saved whole.
    browser.value("pause(), true");
    browser.until("!page.playing && !page.busy");
    browser.press("#save-go", "document.querySelectorAll('#files a').length === 3");
    let lines =
        browser.value("(async () => (await tracker.text(page.video.session, 'boxes.txt')).split('\\n').length - 1)()");
    assert_eq!(lines, browser.value("page.targets[0].count"));
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// A track of a file in the page: frames, boxes, frames decoded by the browser, seconds.
type Followed = (Vec<usize>, Vec<[f64; 4]>, Value, f64);

fn followed(browser: &mut Browser, file: &Path, init: [f64; 4], most: usize) -> Followed {
    give(browser, &[file]);
    let name = file.file_name().expect("a file").to_string_lossy();
    browser.until(&format!("!byId('stage').hidden && page.video?.name === '{name}' && shown && shown.frame === 1"));
    browser.value(&format!(
        "tracker.ask({{ op: 'start', session: page.video.session, frame: 1, box: {init:?}, config: 'natural-fast', policy: null, seed: null }})"
    ));
    let step = "(async () => { const began = performance.now(), session = page.video.session; \
         const { targets: [{ rows, ended }] } = await tracker.ask({ op: 'step', session, frames: 50 }); \
         return [rows.map(row => row.frame), rows.map(row => row.box), ended, (performance.now() - began) / 1e3]; })()";
    let (mut frames, mut boxes, mut seconds) = (vec![], vec![], 0.0);
    loop {
        let (more, at, ended, took): (Vec<usize>, Vec<[f64; 4]>, bool, f64) =
            serde_json::from_value(browser.value(step)).expect("rows");
        frames.extend(more);
        boxes.extend(at);
        seconds += took;
        if ended || frames.len() + 1 >= most {
            break;
        }
    }
    (frames, boxes, browser.value("tracker.decoded(page.video.session)"), seconds)
}

/// The browser's decoder and ours give the same frames, each once, and so the same boxes. Without WebCodecs ours works alone.
#[test]
fn what_the_browser_decodes_is_what_our_decoder_gives() {
    let clips = need!(data("clips"));
    let dir = tempfile::tempdir().expect("a temporary folder");
    let page = need!(page::folder());
    // The page as in a browser without WebCodecs, and in one whose decoder breaks off: its scripts are changed for that.
    let changed = |name: &str, from: &str, to: &str| {
        let copy = dir.path().join(name);
        std::fs::create_dir_all(copy.join("profile")).expect("a writable folder");
        for file in std::fs::read_dir(&page).expect("a folder").flatten() {
            std::fs::copy(file.path(), copy.join(file.file_name())).expect("a copy");
        }
        let codecs = std::fs::read_to_string(page.join("codecs.js")).expect("text");
        assert!(codecs.contains(from));
        std::fs::write(copy.join("codecs.js"), codecs.replacen(from, to, 1)).expect("written");
        let profile = copy.join("profile");
        open_at(copy, &profile, &[])
    };
    let none = "if (typeof VideoDecoder === 'undefined'";
    let mut with = need!(changed("with", none, none));
    let mut without = need!(changed("without", none, "if (true"));
    let call = "async frame(number) {";
    let mut breaks = need!(changed("breaks", call, &format!("{call} if (number === 50) throw new Error('broken');")));
    // One without and one with frames that are decoded before they are shown; the whole of one.
    let runs =
        [("car-detection", [340.0, 150.0, 90.0, 60.0], 377), ("bottle-detection", [250.0, 90.0, 60.0, 120.0], 400)];
    for (name, init, most) in runs {
        let file = clips.join(name).with_extension("mp4");
        let (frames, boxes, decoded, seconds) = followed(&mut with, &file, init, most);
        if with.value("page.video.reader") != "H.264 (the browser)" {
            return skip("decoder of H.264 in the browser");
        }
        assert_eq!(frames, (2..frames.len() + 2).collect::<Vec<_>>(), "each frame once, in order");
        assert!(frames.len() >= most - 1, "{} frames of {name}", frames.len());
        assert_eq!(decoded, json!({ "frames": frames.len(), "why": null }), "the browser decoded them");
        let (_, ours, none, longer) = followed(&mut without, &file, init, frames.len() + 1);
        assert_eq!(
            (none, without.value("page.video.reader") == "H.264 (the browser)"),
            (json!({ "frames": 0, "why": null }), false)
        );
        let same = boxes.iter().zip(&ours).filter(|(a, b)| a.iter().zip(*b).all(|(a, b)| (a - b).abs() < 1e-6)).count();
        let rate = |boxes: &[[f64; 4]], seconds: f64| boxes.len() as f64 / seconds;
        eprintln!(
            "{name}: {same} boxes of {} are the same; {:.0} frames a second decoded by the browser and tracked, {:.0} by our decoder",
            boxes.len(),
            rate(&boxes, seconds),
            rate(&ours, longer)
        );
        assert_eq!(same, boxes.len(), "{name}");
        // If the browser's decoder breaks off, ours continues with the next frame.
        let (more, halves, ended, _) = followed(&mut breaks, &file, init, 90);
        assert_eq!((&*more, &*halves), (&frames[..more.len()], &boxes[..more.len()]));
        assert_eq!(ended, json!({ "frames": 48, "why": "broken" }));
    }
    assert!(
        with.complaints.is_empty() && without.complaints.is_empty(),
        "{:?} {:?}",
        with.complaints,
        without.complaints
    );
}

/// A measurement: `cargo test -p foveate-web --test browser -- --ignored --nocapture`.
#[test]
#[ignore = "measures"]
fn frames_a_second() {
    let folder = need!(data("tracking/Crossing/img"));
    let dir = tempfile::tempdir().expect("a temporary folder");
    let mut browser = need!(open(dir.path(), &[]));
    let entries = std::fs::read_dir(folder).expect("pictures").map(|entry| entry.expect("an entry").path());
    let files: Vec<_> = entries.collect();
    give(&mut browser, &files.iter().map(|file| &**file).collect::<Vec<_>>());
    browser.until("!byId('stage').hidden && shown && shown.frame === 1");
    for config in ["natural", "natural-fast"] {
        let timed = format!(
            "(async () => {{ const session = page.video.session, best = []; for (let round = 0; round < 5; round++) {{ \
             await tracker.ask({{ op: 'start', session, frame: 1, box: [204, 150, 17, 50], config: '{config}', policy: null, seed: null }}); \
             for (let k = 2; k <= 120; k++) {{ const now = performance.now(); await tracker.ask({{ op: 'step', session, frames: 1 }}); \
             best[k - 2] = Math.min(best[k - 2] ?? 1e9, performance.now() - now); }} }} \
             return 119e3 / best.reduce((a, b) => a + b, 0); }})()"
        );
        eprintln!("{config}: {} frames a second, read, decoded and tracked", browser.value(&timed));
    }
}
