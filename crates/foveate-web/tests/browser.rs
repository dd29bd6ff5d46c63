//! The page without a server in a real browser, where one is installed: files, a pretended camera, drawing, corrections, saving,
//! the lesson, memory.
#![cfg(unix)]

#[path = "../../foveate-cli/tests/browser/mod.rs"]
mod browser;
mod page;

use std::path::Path;
use std::time::{Duration, Instant};

use browser::{Browser, CONTRAST};
use page::{FRAMES, NUMBER, iou, mp4, serve, truth, y4m};
use serde_json::{Value, json};

/// A browser at the page; `None`, with a word about it, where there is none.
fn open(folder: &Path, more: &[&str]) -> Option<Browser> {
    let page = page::folder()?;
    let Some(mut browser) = Browser::start_with(folder, more) else {
        eprintln!("skipped: no chromium that runs here");
        return None;
    };
    browser.call("Page.navigate", json!({ "url": serve(page) }));
    browser.until("document.readyState === 'complete' && !!byId('config').value");
    Some(browser)
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
    let Some(mut browser) = open(dir.path(), &[]) else { return };
    browser.picture("choose");
    // What is no video is refused, in words.
    let other = dir.path().join("no.mp4");
    std::fs::write(&other, "nothing").expect("a writable folder");
    give(&mut browser, &[&other]);
    browser.until("!byId('message').hidden && /no.mp4/.test(byId('message').textContent)");

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
    browser.click("#go");
    browser.until("page.rows.length === 20 && page.rows[19].given");
    track(&mut browser, FRAMES);
    browser.until("byId('command').textContent.includes('--reinit 20:')");

    // Saved: what the page shows.
    browser.click("#save-go");
    browser.until("document.querySelectorAll('#files a').length === 4");
    let text = |browser: &mut Browser, name: &str| {
        let fetched = format!(
            "new Promise(done => {{ const r = new XMLHttpRequest(); r.onload = () => done(r.responseText); \
             r.onerror = () => done(null); r.open('GET', document.querySelector('#files a[download=\"{name}\"]').href); r.send(); }})"
        );
        browser.value(&fetched).as_str().map(str::to_owned)
    };
    let shown = browser.boxes();
    // The policy of the page lets nothing be fetched but its own files: the links are for the person, so the test asks the tracker.
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

    pictures(&mut browser, "track");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// Contrast, width and names, in both colour schemes.
fn pictures(browser: &mut Browser, name: &str) {
    for scheme in ["light", "dark"] {
        let media = json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
        browser.call("Emulation.setEmulatedMedia", media);
        for pair in [
            "'ink','card'",
            "'soft','card'",
            "'soft','page'",
            "'soft','sunken'",
            "'ink','sunken'",
            "'target','card'",
            "'second','card'",
        ] {
            let contrast = browser.value(&format!("{CONTRAST}({pair})")).as_f64().expect("a number");
            assert!(contrast >= 4.5, "{scheme}, {pair}: {contrast}");
        }
        for width in [1280, 400] {
            let size = json!({ "width": width, "height": 900, "deviceScaleFactor": 1, "mobile": false });
            browser.call("Emulation.setDeviceMetricsOverride", size);
            std::thread::sleep(Duration::from_millis(250));
            let widest = browser.value("document.documentElement.scrollWidth - innerWidth").as_f64();
            assert!(widest.is_some_and(|more| more <= 0.0), "nothing is wider than the page: {widest:?}");
            browser.picture(&format!("{name}-{scheme}-{width}"));
        }
    }
    let unnamed = "[...document.querySelectorAll('button, input:not([type=file]), select, canvas')].filter(e => !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length)).map(e => e.outerHTML)";
    assert_eq!(browser.value(unnamed), json!([]), "everything that is used has a name");
}

#[test]
fn a_camera_is_followed() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let file = dir.path().join("camera.y4m");
    y4m(&file, 20);
    let capture = format!("--use-file-for-fake-video-capture={}", file.display());
    let fake = ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream", &capture];
    let Some(mut browser) = open(dir.path(), &fake) else { return };
    browser.click("#pick-camera");
    browser.until("!byId('stage').hidden && shown && page.frame > 3");
    // What is shown waits while a box is drawn on it; where it is, its number tells.
    browser.value("pause(), true");
    browser.until("!page.playing && shown.frame === page.frame");
    let number = browser.value(&format!("{NUMBER}(shown.picture)")).as_u64().expect("a number") as usize;
    browser.value("byId('config').value = 'natural-fast', true");
    browser.draw(truth(number));
    browser.click("#go");
    browser.until("page.rows.length > 1");
    // Which frame of the file each picture is: asked while pictures are kept.
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
            let size = "(async () => [page.rows.length, performance.memory.usedJSHeapSize, await tracker.size(), details.size])()";
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
        browser.value("page.rows.length"),
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
    browser.click("#go");
    browser.until("lastRow().given");
    let length = browser.value("page.rows.length").as_u64().expect("a number") as usize;
    browser.click("#save-go");
    browser.until("document.querySelectorAll('#files a').length === 3");
    let text = browser.value("tracker.text(page.video.session, 'track.jsonl')");
    let lines: Vec<Value> =
        text.as_str().expect("text").lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(lines.len(), length);
    assert_eq!(lines[length - 1]["status"], "given");
    browser.picture("camera");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// What our decoder does not know the browser decodes, moved from frame to frame, so that none is left out.
#[test]
fn a_video_that_the_browser_decodes_is_seen_frame_by_frame() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let (source, file) = (dir.path().join("a.y4m"), dir.path().join("a.webm"));
    y4m(&source, 30);
    let mut ffmpeg = std::process::Command::new("ffmpeg");
    ffmpeg.args(["-loglevel", "error", "-i"]).arg(&source).args(["-c:v", "libvpx", "-b:v", "2M"]).arg(&file);
    if !ffmpeg.status().is_ok_and(|status| status.success()) {
        eprintln!("skipped: no ffmpeg with libvpx");
        return;
    }
    let Some(mut browser) = open(dir.path(), &[]) else { return };
    give(&mut browser, &[&file]);
    browser.until("!byId('stage').hidden && shown && shown.frame === 1");
    assert_eq!(browser.value(&format!("{NUMBER}(shown.picture)")), json!(0));
    browser.value("byId('config').value = 'natural-fast', true");
    browser.draw(truth(0));
    browser.click("#go");
    // As they come: what was shown, and where.
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
    let Some(mut browser) = open(dir.path(), &[]) else { return };
    browser.click("#tab-lesson");
    browser.until("!byId('lesson').hidden && lesson.about !== null");
    browser.click("#l-play");
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
    browser.until("lesson.ended && !lesson.playing");
    let means = browser
        .value("[0, 1].map(which => lesson.rows.reduce((sum, row) => sum + row[which], 0) / lesson.rows.length)");
    eprintln!("mean error of gp-ucb and of a fixed centre on a large 0: {means}");
    pictures(&mut browser, "lesson");
    browser.key("Tab", 0);
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// A measurement: `cargo test -p foveate-web --test browser -- --ignored --nocapture`.
#[test]
#[ignore = "measures"]
fn frames_a_second() {
    let data = std::env::var_os("FOVEATE_DATA").map(std::path::PathBuf::from);
    let Some(folder) = data.map(|data| data.join("tracking/Crossing/img")).filter(|folder| folder.is_dir()) else {
        eprintln!("skipped: no data");
        return;
    };
    let dir = tempfile::tempdir().expect("a temporary folder");
    let Some(mut browser) = open(dir.path(), &[]) else { return };
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
