//! The page of `foveate serve` in a real browser, if one is installed: drawing by mouse and by keys, tracking, a correction, saving.
#![cfg(unix)]

#[path = "browser/mod.rs"]
mod browser;
#[path = "served/mod.rs"]
mod served;

use foveate_testing::{ffmpeg, need};
use std::path::Path;
use std::time::Duration;

use browser::Browser;
use serde_json::{Value, json};
use served::{FRAMES, Server, clip, iou, nearest, truth};

/// Tracks to the end, and compares with the truth.
fn track(browser: &mut Browser) {
    let boxes = browser.track();
    assert_eq!(boxes.len(), FRAMES);
    let overlaps: Vec<f64> = boxes.iter().enumerate().map(|(t, b)| iou(*b, truth(t))).collect();
    let (mean, least) = (overlaps.iter().sum::<f64>() / FRAMES as f64, overlaps.iter().copied().fold(1.0, f64::min));
    assert!(mean >= 0.7 && least >= 0.5, "{mean} {least}: {overlaps:?}");
}

/// The page at its list of videos, in a browser with these options, and its server.
fn open(dir: &Path, options: &[&str]) -> Result<(Browser, Server), String> {
    let mut browser = Browser::start(dir, options).ok_or("chromium that runs here")?;
    clip(&dir.join("seen/clip"));
    let server = Server::of(dir, "seen");
    browser.call("Page.navigate", json!({ "url": server.url }));
    browser.until("document.querySelectorAll('.entries button').length === 1");
    Ok((browser, server))
}

/// The page with its video open at the first frame.
fn opened(dir: &Path) -> Result<(Browser, Server), String> {
    let (mut browser, server) = open(dir, &[])?;
    browser.press(".entries button", "!byId('stage').hidden && shown && shown.frame === 1");
    Ok((browser, server))
}

/// A file by http: the page plays it, tracks it, and shows where it ended.
#[test]
fn the_end_of_a_file_by_http_is_shown() {
    need!(ffmpeg());
    let dir = tempfile::tempdir().expect("a temporary folder");
    let mut browser = need!(Browser::start(dir.path(), &[]).ok_or("chromium that runs here"));
    let address = served::by_http();
    let server = Server::of(dir.path(), &address);
    browser.call("Page.navigate", json!({ "url": server.url }));
    let end = format!("The source ended after frame {FRAMES}.");
    // The only source is opened at once, and without a box it plays to its end.
    browser.until("typeof page === 'object' && !byId('over').hidden && !page.playing");
    assert_eq!(browser.value("byId('over').textContent"), json!(end));
    browser.picture("ended");
}

#[test]
fn a_box_is_drawn_tracked_corrected_and_saved_in_a_browser() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let (mut browser, server) = need!(opened(dir.path()));
    // Configurations by purpose: real video first, digits last; what serves another one alone is not offered.
    let offered = browser.value(
        "[...byId('config').children].map(group => [group.label, ...[...group.children].map(option => option.value)])",
    );
    let offered: Vec<Vec<String>> = serde_json::from_value(offered).expect("groups of names");
    assert!(offered[0][0] == "Real video" && offered[0][1] == "natural", "{offered:?}");
    assert!(offered[offered.len() - 1][0].starts_with("Digits"), "{offered:?}");
    assert!(!offered.concat().contains(&"natural-middle".to_owned()), "{offered:?}");
    assert_eq!(browser.value("byId('config').selectedOptions[0].textContent"), "any target, fast (natural-fast)");

    // By mouse; a click alone proposes a box.
    let [x, y, w, h] = truth(0);
    let centre = "(() => { const b = byId('screen').getBoundingClientRect(), k = b.width / page.video.width; return [b.x + k * 124, b.y + k * 114]; })()";
    let at = serde_json::from_value(browser.value(centre)).expect("a place");
    browser.mouse("mousePressed", at);
    browser.mouse("mouseReleased", at);
    browser.until("page.draft !== null");
    browser.draw([x, y, w, h]);
    browser.click("#go");
    track(&mut browser);
    browser.picture("tracked");
    // The page explains the shades of the curve and the terms of a figure.
    for word in ["occluded or lost: do not use the box", "Effective particles.", "How many particles share the weight"]
    {
        assert_eq!(browser.value(&format!("document.body.innerHTML.includes('{word}')")), json!(true), "{word}");
    }
    // A message is as wide as its words.
    browser.value("complain(new Error('Short.')), true");
    assert_eq!(browser.value("byId('message').offsetWidth < innerWidth / 4"), json!(true));
    browser.value("complain(null), true");

    // By keys: the frame again from the start, a box in the middle of the picture, moved and sized.
    browser.show(1);
    browser.value("byId('screen').focus(), setDraft(fitted({ x: 136, y: 96, w: 48, h: 48 })), true");
    browser.key("Escape", 0);
    assert_eq!(browser.value("page.draft"), Value::Null);
    // At a frame that was tracked the box begins where the track has it; move away and back, larger and smaller.
    for (key, modifiers, times) in [
        ("ArrowRight", 0, 4),
        ("ArrowDown", 0, 2),
        ("ArrowLeft", 0, 3),
        ("ArrowUp", 0, 2),
        ("ArrowRight", 8, 2),
        ("ArrowLeft", 8, 2),
        ("ArrowUp", 1, 1),
        ("ArrowDown", 1, 1),
    ] {
        (0..times).for_each(|_| browser.key(key, modifiers));
    }
    let drawn = browser.drawn();
    assert!(iou(drawn, truth(0)) > 0.95, "{drawn:?}");
    assert_eq!(browser.value("document.activeElement.id"), "screen");
    browser.key("Enter", 0);
    browser.until("page.rows.length === 1");
    track(&mut browser);

    // A box by keys alone on a frame without a track begins in the middle.
    // Back by the comma, a correction there, and on.
    browser.value("document.activeElement.blur(), true");
    (0..3).for_each(|_| browser.key(",", 0));
    browser.until(&format!("page.frame === {} && shown.frame === page.frame", FRAMES - 3));
    browser.show(15);
    let [x, y, w, h] = truth(14);
    browser.draw([x - 2.0, y - 1.0, w + 3.0, h + 2.0]);
    assert_eq!(browser.value("byId('go').textContent"), "Correct frame 15");
    browser.press("#go", "page.rows.length === 15 && page.rows[14].given");
    track(&mut browser);

    // The saved results are those on the page.
    browser.press("#save-go", "document.querySelectorAll('#files a').length === 3");
    let href = browser.value("document.querySelector('#files a').getAttribute('href')");
    let (status, bytes) = server.get(&format!("/{}", href.as_str().expect("a link")));
    let text = String::from_utf8(bytes).expect("text");
    assert!(status == 200 && text.lines().count() == FRAMES, "{text}");
    let boxes = browser.boxes();
    for (line, [x, y, w, h]) in text.lines().zip(boxes) {
        let numbers: Vec<f64> = line.split(',').map(|n| n.parse().expect("a number")).collect();
        assert!(numbers.iter().zip([x + 1.0, y + 1.0, w, h]).all(|(a, b)| (a - b).abs() < 0.01), "{line}");
    }
    browser.until("byId('command').textContent.includes('--reinit 15:')");

    // A policy that learns is shown; so is the content of the fovea.
    browser.value("byId('policy').value = 'hedge', byId('scrub').value = 1, byId('scrub').dispatchEvent(new Event('input')), true");
    browser.until("shown.frame === 1");
    browser.draw(truth(0));
    browser.click("#again");
    browser.until("page.policy === 'hedge' && page.rows.length > 30 && page.ended && !page.playing && !page.busy");
    assert_eq!(browser.value("document.querySelectorAll('.arm').length"), json!(9));
    assert_eq!(browser.value("byId('seen').width > 8"), json!(true));

    // A second target on something else: followed at once, its box beside the first one's, with results of its own.
    browser.show(5);
    browser.draw([40.0, 30.0, 50.0, 40.0]);
    assert_eq!(browser.value("byId('add').hidden"), json!(false));
    browser.click("#add");
    browser.until("page.targets.length === 2 && page.target === 1 && page.ended && !page.playing && !page.busy");
    assert_eq!(
        browser.value("page.targets.map(target => [target.first, target.rows.length])"),
        json!([[1, FRAMES], [5, FRAMES - 4]])
    );
    assert_eq!(browser.value("byId('targets').hidden || byId('targets').children.length"), json!(3));
    browser.show(FRAMES);
    for (scheme, width) in [("light", 1280), ("dark", 400)] {
        browser.look(scheme, width);
        browser.picture(&format!("targets-{scheme}-{width}"));
    }
    browser.look("light", 1280);
    // By keys: the first one again; then the second one is dropped.
    browser.value("byId('targets').children[0].focus(), true");
    browser.key("Enter", 0);
    browser.value("document.activeElement.click(), true");
    browser.until("page.target === 0 && page.first === 1 && !page.busy && shown.frame === page.frame");
    browser.click("#save-go");
    // Of each boxes.txt, track.csv, report.html, and what its policy learned.
    browser.until("document.querySelectorAll('#files a').length === 8");
    browser.value("byId('targets').children[1].click(), true");
    browser.until("page.target === 1");
    browser.value("byId('targets').children[2].click(), true");
    browser.until("page.targets.length === 1 && page.target === 0 && byId('targets').hidden && !page.busy");

    // A box drawn while it tracks pauses it, and stays where it was drawn.
    browser.value(
        "byId('pace').value = 1, byId('scrub').value = 1, byId('scrub').dispatchEvent(new Event('input')), true",
    );
    browser.until("shown.frame === 1");
    browser.draw(truth(0));
    browser.press("#again", "page.rows.length > 5 && page.rows.length < 30 && page.playing");
    browser.draw([150.0, 100.0, 48.0, 48.0]);
    std::thread::sleep(Duration::from_millis(300));
    let frame = browser.value("page.frame").as_u64().expect("a number") as usize;
    assert_eq!(browser.value("page.playing || !page.draft"), json!(false));
    browser.draw(truth(frame - 1));
    browser.press("#go", &format!("page.rows.length === {frame} && lastRow().given"));
    track(&mut browser);

    // So does the slider.
    browser.value("byId('scrub').value = 1, byId('scrub').dispatchEvent(new Event('input')), true");
    browser.until("shown.frame === 1");
    browser.value("byId('pace').value = 1, byId('play').click(), true");
    browser.until("page.playing && page.frame > 5");
    browser.value("byId('scrub').value = 2, byId('scrub').dispatchEvent(new Event('input')), true");
    browser.until("page.frame === 2 && shown.frame === 2 && !page.playing");

    browser.judge("serve");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// Enter in a field of the box is the main button; a box ahead of the track corrects it there, and nothing is discarded before.
#[test]
fn enter_and_a_frame_ahead_correct_the_track() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let (mut browser, server) = need!(opened(dir.path()));
    browser.draw(truth(0));
    for seed in ["-1", "1.5", "12345678901234567"] {
        browser.fill("seed", seed);
        browser.press("#go", "byId('message').textContent.includes('must be a whole number')");
        browser.value("complain(null), true");
    }
    browser.fill("seed", "7");
    browser.value("byId('pace').value = 1, true");
    browser.press("#go", "page.rows.length > 3");
    browser.press("#play", "!page.playing && !page.busy");
    // Keys where the slider was used last.
    browser.value("byId('scrub').focus(), true");
    browser.show(2);
    browser.key(".", 0);
    browser.until("page.frame === 3 && shown.frame === 3");
    browser.show(FRAMES - 5);
    assert_eq!(browser.value("page.rows.length < 20"), json!(true));
    // Other settings are for another start.
    browser.fill("seed", "8");
    assert_eq!(
        browser.value("byId('setup-now').textContent.includes('goes on with natural-fast, seed 7;')"),
        json!(true)
    );
    browser.draw(truth(FRAMES - 6));
    assert_eq!(browser.value("byId('go').textContent"), json!(format!("Correct frame {}", FRAMES - 5)));
    browser.value("byId('box-x').focus(), true");
    browser.key("Enter", 0);
    browser.until(&format!("page.rows.length === {} && lastRow().given && !page.busy", FRAMES - 5));
    browser.show(12);
    browser.draw(truth(11));
    browser.value("byId('box-w').focus(), true");
    browser.key("Enter", 0);
    browser.until("page.first === 1 && page.rows.length === 12 && lastRow().given && !page.busy");
    track(&mut browser);

    // Who leaves is asked before anything is saved; and the server forgets what a page has left.
    let asks = "!window.dispatchEvent(new Event('beforeunload', { cancelable: true }))";
    assert_eq!(browser.value(asks), json!(true));
    browser.press("#save-go", "document.querySelectorAll('#files a').length === 3");
    assert_eq!(browser.value(asks), json!(false));
    let frame = format!("/frame?session={}&frame=1", browser.value("page.video.session"));
    assert_eq!(server.get(&frame).0, 200);
    browser.call("Page.navigate", json!({ "url": "about:blank" }));
    let began = std::time::Instant::now();
    while server.get(&frame).0 == 200 {
        assert!(began.elapsed() < Duration::from_secs(20), "the server keeps what the page has left");
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// Wrong and short settings of a measurement: no endless requests, no numbers of another target.
#[test]
fn a_measurement_follows_clumsy_settings() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let (mut browser, _server) = need!(opened(dir.path()));
    browser.draw(truth(0));
    browser.click("#go");
    track(&mut browser);
    browser.value("byId('measuring').open = true");
    let settled = "!measuring.busy && measuring.key === measureKey()";
    browser.until(&format!("measuring.answer && {settled}"));
    // A range that begins after the last frame is refused once.
    browser.value("byId('fit-curve').value = 'line', byId('fit-curve').dispatchEvent(new Event('input')), true");
    browser.fill("fit-from", "5");
    browser.until(&format!("measuring.problem.includes('fit: ') && {settled}"));
    // Recorded at 10000 frames a second: a range of some frames is shorter than a millisecond. The last frame counts.
    browser.fill("fit-from", "0.00305");
    browser.fill("fps", "10000");
    browser.until(&format!("measuring.answer?.fit?.points === 5 && {settled}"));
    browser.fill("fps", "");
    browser.click("#fit-all");
    // A click with the tool keeps the scale that is there.
    browser.click("#scale-set");
    browser.drag(&[(40.0, 200.0), (200.0, 200.0)]);
    browser.value("byId('length').value = '4', true");
    browser.drag(&[(150.0, 100.0)]);
    assert_eq!(browser.value("rulerLength() > 150"), json!(true));
    // A second finger on the frame is no part of a drag.
    browser.value(
        "drag = { id: 5, from: [0, 0], client: [0, 0], far: true, tool: page.tool }, window.finger = (kind, pointerId) => \
         byId('screen').dispatchEvent(new PointerEvent('pointer' + kind, { pointerId, clientX: 99, clientY: 99 })), true",
    );
    let shown = "JSON.stringify([scene.ruler, page.draft, drag.id])";
    let before = browser.value(shown);
    let second = format!("['down', 'move', 'up', 'cancel'].forEach(kind => finger(kind, 77)), {shown}");
    assert_eq!(browser.value(&second), before);
    assert_eq!(browser.value("finger('cancel', 5), drag"), json!(null));
    browser.click("#tool-done");
    // A ruler without length is none.
    browser.fill("length", "1");
    browser.value("scene.ruler = [[9, 9], [9, 9]], changed(), true");
    browser.until(&format!("measuring.answer?.unit === 'px' && !measuring.problem && {settled}"));
    // A second target with three frames has no numbers.
    browser.show(FRAMES - 2);
    browser.draw([40.0, 30.0, 50.0, 40.0]);
    browser.press("#add", "page.target === 1 && page.ended && !page.playing && !page.busy && !measuring.busy");
    assert_eq!(browser.value("!measuring.answer && byId('measure-files').hidden"), json!(true));
    // Another video has a rate of its own.
    browser.fill("fps", "240");
    browser.fill("fps-error", "1");
    browser.click("#choose");
    browser.value("window.confirm = () => false, true");
    browser.click(".entries button");
    assert_eq!(browser.value("page.targets.length"), json!(2));
    browser.value("window.confirm = () => true, true");
    browser.press(".entries button", "page.rows.length === 0 && shown && shown.frame === 1");
    assert_eq!(browser.value("byId('fps').value + byId('fps-error').value + byId('length').value"), json!(""));
    assert!(browser.complaints.len() == 1 && browser.complaints[0].contains("400"), "{:?}", browser.complaints);
}

/// The browser's own camera, pretended: its frames go to the server, are tracked there, and results are saved.
#[test]
fn the_browsers_camera_is_followed_by_the_server() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let camera = dir.path().join("camera.y4m");
    let (w, h) = (served::SIZE.width, served::SIZE.height);
    let mut bytes = format!("YUV4MPEG2 W{w} H{h} F15:1 Ip A1:1 C420jpeg\n").into_bytes();
    for t in (0..FRAMES).chain((0..FRAMES).rev()) {
        bytes.extend_from_slice(b"FRAME\n");
        bytes.extend_from_slice(&served::picture(t));
        bytes.resize(bytes.len() + w * h / 2, 128);
    }
    std::fs::write(&camera, bytes).expect("a writable folder");
    let capture = format!("--use-file-for-fake-video-capture={}", camera.display());
    let fake = ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream", &capture];
    let (mut browser, server) = need!(open(dir.path(), &fake));
    browser.picture("choose");
    browser.press("#pick-camera", "!byId('stage').hidden && shown && page.frame > 3");
    browser.value("pause(), true");
    browser.until("!page.playing && shown.frame === page.frame");
    // Which frame of the clip is shown.
    let at = |browser: &mut Browser| {
        let place = browser.value("[page.video.session, page.frame]");
        let (_, jpeg) = server.get(&format!("/frame?session={}&frame={}", place[0], place[1]));
        nearest(&jpeg)
    };
    let first = at(&mut browser);
    browser.draw(truth(first));
    browser.press("#go", "page.rows.length > 40");
    browser.value("pause(), true");
    browser.until("!page.playing && !page.busy && shown.frame === page.frame");
    let now = at(&mut browser);
    let shown: [f64; 4] = serde_json::from_value(browser.value("rowOf(page.frame).box")).expect("a box");
    assert!(iou(shown, truth(now)) >= 0.5, "{shown:?} is not {:?}", truth(now));
    assert_eq!(browser.value("byId('want-report').closest('label').hidden"), json!(true));
    let tracked = browser.value("page.targets[0].count").as_u64().expect("a number") as usize;
    browser.press("#save-go", "document.querySelectorAll('#files a').length === 3");
    let href = browser.value("document.querySelectorAll('#files a')[2].getAttribute('href')");
    let (status, text) = server.get(&format!("/{}", href.as_str().expect("a link")));
    assert_eq!((status, String::from_utf8_lossy(&text).lines().count()), (200, tracked));
    browser.picture("camera");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}
