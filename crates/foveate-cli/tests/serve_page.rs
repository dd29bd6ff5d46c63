//! The page of `foveate serve` in a real browser, where one is installed: drawing by mouse and by keys, tracking, a correction, saving.
#![cfg(unix)]

#[path = "served/mod.rs"]
mod served;

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use served::{FRAMES, Server, clip, iou, truth};

/// How long anything may take.
const PATIENCE: Duration = Duration::from_secs(60);

/// Chromium without a window, spoken to through two pipes (its DevTools protocol).
struct Browser {
    child: Child,
    to: File,
    from: Receiver<Value>,
    id: u64,
    session: Option<String>,
    /// What the page complained of.
    complaints: Vec<String>,
}

impl Browser {
    /// `None` where none is installed, or it cannot run here.
    fn start(folder: &Path) -> Option<Self> {
        let named = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success());
        let program = ["chromium", "chromium-browser", "google-chrome", "chrome"].into_iter().find(named)?;
        let (to, from) = (folder.join("to"), folder.join("from"));
        if !Command::new("mkfifo").arg(&to).arg(&from).status().ok()?.success() {
            return None;
        }
        let script = r#"exec "$0" --headless=new --no-sandbox --disable-gpu --disable-dev-shm-usage --no-first-run --disable-extensions \
            --disable-background-networking --user-data-dir="$1" --window-size=1280,900 --remote-debugging-pipe 3<"$2" 4>"$3""#;
        let mut command = Command::new("sh");
        command.args(["-c", script, program]).arg(folder.join("profile")).arg(&to).arg(&from);
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().ok()?;
        let to = File::options().write(true).open(to).ok()?;
        let mut lines = BufReader::new(File::open(from).ok()?);
        let (sender, from) = channel();
        std::thread::spawn(move || {
            let mut message = vec![];
            while lines.read_until(0, &mut message).is_ok_and(|n| n > 0) {
                message.pop();
                let Ok(value) = serde_json::from_slice(&message) else { break };
                if sender.send(value).is_err() {
                    break;
                }
                message.clear();
            }
        });
        let mut browser = Self { child, to, from, id: 0, session: None, complaints: vec![] };
        let target = browser.try_call("Target.createTarget", json!({ "url": "about:blank" }))?;
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session =
            browser.call("Target.attachToTarget", attach)["sessionId"].as_str().expect("a session").to_owned();
        browser.session = Some(session);
        for domain in ["Page.enable", "Runtime.enable", "Log.enable"] {
            browser.call(domain, json!({}));
        }
        Some(browser)
    }

    fn try_call(&mut self, method: &str, params: Value) -> Option<Value> {
        self.id += 1;
        let mut message = json!({ "id": self.id, "method": method, "params": params });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.to.write_all(format!("{message}\0").as_bytes()).ok()?;
        loop {
            let answer = self.from.recv_timeout(PATIENCE).ok()?;
            let about = &answer["params"];
            match answer["method"].as_str() {
                Some("Runtime.exceptionThrown") => self.complaints.push(about.to_string()),
                Some("Log.entryAdded") if about["entry"]["level"] == "error" => self.complaints.push(about.to_string()),
                Some("Runtime.consoleAPICalled") if about["type"] == "error" => self.complaints.push(about.to_string()),
                _ => {}
            }
            if answer["id"] == self.id {
                assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
                return Some(answer["result"].clone());
            }
        }
    }

    fn call(&mut self, method: &str, params: Value) -> Value {
        self.try_call(method, params).unwrap_or_else(|| panic!("{method}: the browser does not answer"))
    }

    /// The value of an expression in the page.
    fn value(&mut self, expression: &str) -> Value {
        let params = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let answer = self.call("Runtime.evaluate", params);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {}", answer["exceptionDetails"]);
        answer["result"]["value"].clone()
    }

    /// Waits until an expression is true.
    fn until(&mut self, expression: &str) {
        let began = Instant::now();
        while self.value(expression) != true {
            let message = self.value("document.getElementById('message')?.textContent");
            assert!(began.elapsed() < PATIENCE, "never: {expression}; the page says {message}; {:?}", self.complaints);
            std::thread::sleep(Duration::from_millis(30));
        }
    }

    fn mouse(&mut self, kind: &str, (x, y): (f64, f64)) {
        let button = json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", button);
    }

    fn click(&mut self, selector: &str) {
        let expression = format!(
            "(() => {{ const e = document.querySelector('{selector}'); e.scrollIntoView({{ block: 'center' }}); \
             const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; }})()"
        );
        let at: (f64, f64) = serde_json::from_value(self.value(&expression)).expect("it is there");
        self.mouse("mousePressed", at);
        self.mouse("mouseReleased", at);
    }

    /// Draws a box on the frame.
    fn draw(&mut self, [x, y, w, h]: [f64; 4]) {
        let place = "(() => { const e = document.getElementById('screen'); e.scrollIntoView({ block: 'center' }); \
                     const b = e.getBoundingClientRect(); return [b.x, b.y, b.width / page.video.width]; })()";
        let (left, top, k): (f64, f64, f64) = serde_json::from_value(self.value(place)).expect("a stage");
        let at = |x: f64, y: f64| (left + k * x, top + k * y);
        self.mouse("mousePressed", at(x, y));
        self.mouse("mouseMoved", at(x + w / 2.0, y + h / 2.0));
        self.mouse("mouseMoved", at(x + w, y + h));
        self.mouse("mouseReleased", at(x + w, y + h));
        let drawn: [f64; 4] =
            serde_json::from_value(self.value("[page.draft.x, page.draft.y, page.draft.w, page.draft.h]"))
                .expect("a box");
        assert!(iou(drawn, [x, y, w, h]) > 0.9, "{drawn:?}");
    }

    fn key(&mut self, key: &str, modifiers: u8) {
        for kind in ["keyDown", "keyUp"] {
            self.call(
                "Input.dispatchKeyEvent",
                json!({ "type": kind, "key": key, "code": key, "modifiers": modifiers }),
            );
        }
    }

    /// Tracks to the end as fast as it goes, from wherever it is.
    fn track(&mut self) {
        self.value("byId('pace').value = 200, true");
        self.until("!page.busy && (page.ended || page.playing || (byId('play').click(), false))");
        self.until("page.ended && !page.playing && !page.busy");
        assert_eq!(self.value("page.rows.length"), json!(FRAMES));
        let boxes: Vec<[f64; 4]> = serde_json::from_value(self.value("page.rows.map(row => row.box)")).expect("boxes");
        let overlaps: Vec<f64> = boxes.iter().enumerate().map(|(t, b)| iou(*b, truth(t))).collect();
        let (mean, least) =
            (overlaps.iter().sum::<f64>() / FRAMES as f64, overlaps.iter().copied().fold(1.0, f64::min));
        assert!(mean >= 0.7 && least >= 0.5, "{mean} {least}: {overlaps:?}");
    }

    /// A picture of the page, where $FOVEATE_SCREENSHOTS names a folder to put it.
    fn picture(&mut self, name: &str) {
        use base64::Engine as _;
        let Some(folder) = std::env::var_os("FOVEATE_SCREENSHOTS") else { return };
        let shot = self.call("Page.captureScreenshot", json!({ "format": "png", "captureBeyondViewport": true }));
        let bytes = base64::engine::general_purpose::STANDARD.decode(shot["data"].as_str().expect("a picture"));
        std::fs::write(Path::new(&folder).join(format!("{name}.png")), bytes.expect("base64"))
            .expect("a writable folder");
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.to.write_all(format!("{}\0", json!({ "id": 0, "method": "Browser.close" })).as_bytes());
        std::thread::sleep(Duration::from_millis(300));
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Contrast of two colours of the style, as WCAG counts it.
const CONTRAST: &str = r"((a, b) => {
  const light = name => { const v = colour(name); const rgb = [1, 3, 5].map(i => parseInt(v.slice(i, i + 2), 16) / 255).map(c => c <= .03928 ? c / 12.92 : ((c + .055) / 1.055) ** 2.4);
    return .2126 * rgb[0] + .7152 * rgb[1] + .0722 * rgb[2]; };
  const [x, y] = [light(a), light(b)].sort((p, q) => q - p);
  return (x + .05) / (y + .05);
})";

#[test]
fn a_box_is_drawn_tracked_corrected_and_saved_in_a_browser() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let Some(mut browser) = Browser::start(dir.path()) else {
        eprintln!("skipped: no chromium that runs here");
        return;
    };
    clip(&dir.path().join("seen/clip"));
    let server = Server::start(dir.path(), &["serve", "seen", "--address", "127.0.0.1:0", "--config", "natural-fast"]);
    browser.call("Page.navigate", json!({ "url": server.url }));
    browser.until("document.querySelectorAll('.entries button').length === 1");
    browser.click(".entries button");
    browser.until("!byId('stage').hidden && shown && shown.frame === 1");

    // By mouse; a click alone proposes a box.
    let [x, y, w, h] = truth(0);
    let centre = "(() => { const b = byId('screen').getBoundingClientRect(), k = b.width / page.video.width; return [b.x + k * 124, b.y + k * 114]; })()";
    let at = serde_json::from_value(browser.value(centre)).expect("a place");
    browser.mouse("mousePressed", at);
    browser.mouse("mouseReleased", at);
    browser.until("page.draft !== null");
    browser.draw([x, y, w, h]);
    browser.click("#go");
    browser.track();
    browser.picture("tracked");

    // By keys: the frame again from the start, a box in the middle of the picture, moved and sized.
    browser.value("byId('scrub').value = 1, byId('scrub').dispatchEvent(new Event('input')), true");
    browser.until("page.frame === 1 && shown.frame === 1");
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
    let drawn: [f64; 4] =
        serde_json::from_value(browser.value("[page.draft.x, page.draft.y, page.draft.w, page.draft.h]"))
            .expect("a box");
    assert!(iou(drawn, truth(0)) > 0.95, "{drawn:?}");
    assert_eq!(browser.value("document.activeElement.id"), "screen");
    browser.key("Enter", 0);
    browser.until("page.rows.length === 1");
    browser.track();

    // A box by keys alone on a frame without a track begins in the middle.
    // Back by the comma, a correction there, and on.
    browser.value("document.activeElement.blur(), true");
    (0..3).for_each(|_| browser.key(",", 0));
    browser.until(&format!("page.frame === {} && shown.frame === page.frame", FRAMES - 3));
    browser.value("byId('scrub').value = 15, byId('scrub').dispatchEvent(new Event('input')), true");
    browser.until("page.frame === 15 && shown.frame === 15");
    let [x, y, w, h] = truth(14);
    browser.draw([x - 2.0, y - 1.0, w + 3.0, h + 2.0]);
    assert_eq!(browser.value("byId('go').textContent"), "Correct frame 15");
    browser.click("#go");
    browser.until("page.rows.length === 15 && page.rows[14].given");
    browser.track();

    // Saved: what the page shows.
    browser.click("#save-go");
    browser.until("document.querySelectorAll('#files a').length === 3");
    let href = browser.value("document.querySelector('#files a').getAttribute('href')");
    let (status, bytes) = server.get(&format!("/{}", href.as_str().expect("a link")));
    let text = String::from_utf8(bytes).expect("text");
    assert!(status == 200 && text.lines().count() == FRAMES, "{text}");
    let boxes: Vec<[f64; 4]> = serde_json::from_value(browser.value("page.rows.map(row => row.box)")).expect("boxes");
    for (line, [x, y, w, h]) in text.lines().zip(boxes) {
        let numbers: Vec<f64> = line.split(',').map(|n| n.parse().expect("a number")).collect();
        assert!(numbers.iter().zip([x + 1.0, y + 1.0, w, h]).all(|(a, b)| (a - b).abs() < 0.01), "{line}");
    }
    browser.until("byId('command').textContent.includes('--reinit 15:')");

    // A policy that learns is shown; so is what the fovea sees.
    browser.value("byId('policy').value = 'hedge', byId('scrub').value = 1, byId('scrub').dispatchEvent(new Event('input')), true");
    browser.until("shown.frame === 1");
    browser.draw(truth(0));
    browser.click("#again");
    browser.until("page.policy === 'hedge' && page.rows.length > 30 && page.ended && !page.playing && !page.busy");
    assert_eq!(browser.value("document.querySelectorAll('.arm').length"), json!(9));
    assert_eq!(browser.value("byId('seen').width > 8"), json!(true));

    // A box drawn while it tracks pauses it, and stays where it was drawn.
    browser.value(
        "byId('pace').value = 1, byId('scrub').value = 1, byId('scrub').dispatchEvent(new Event('input')), true",
    );
    browser.until("shown.frame === 1");
    browser.draw(truth(0));
    browser.click("#again");
    browser.until("page.rows.length > 5 && page.rows.length < 30 && page.playing");
    browser.draw([150.0, 100.0, 48.0, 48.0]);
    std::thread::sleep(Duration::from_millis(300));
    let frame = browser.value("page.frame").as_u64().expect("a number") as usize;
    assert_eq!(browser.value("page.playing || !page.draft"), json!(false));
    browser.draw(truth(frame - 1));
    browser.click("#go");
    browser.until(&format!("page.rows.length === {frame} && lastRow().given"));
    browser.track();

    // So does the slider.
    browser.value("byId('scrub').value = 1, byId('scrub').dispatchEvent(new Event('input')), true");
    browser.until("shown.frame === 1");
    browser.value("byId('pace').value = 1, byId('play').click(), true");
    browser.until("page.playing && page.frame > 5");
    browser.value("byId('scrub').value = 2, byId('scrub').dispatchEvent(new Event('input')), true");
    browser.until("page.frame === 2 && shown.frame === 2 && !page.playing");

    // Both colour schemes, narrow and wide.
    for scheme in ["light", "dark"] {
        let media = json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
        browser.call("Emulation.setEmulatedMedia", media);
        for pair in
            ["'ink','card'", "'soft','card'", "'soft','page'", "'soft','sunken'", "'ink','sunken'", "'target','card'"]
        {
            let contrast = browser.value(&format!("{CONTRAST}({pair})")).as_f64().expect("a number");
            assert!(contrast >= 4.5, "{scheme}, {pair}: {contrast}");
        }
        for width in [1280, 400] {
            browser.call(
                "Emulation.setDeviceMetricsOverride",
                json!({ "width": width, "height": 900, "deviceScaleFactor": 1, "mobile": false }),
            );
            std::thread::sleep(Duration::from_millis(200));
            let widest = browser.value("document.documentElement.scrollWidth - innerWidth").as_f64();
            assert!(widest.is_some_and(|more| more <= 0.0), "nothing is wider than the page: {widest:?}");
            browser.picture(&format!("{scheme}-{width}"));
        }
    }
    let unnamed = "[...document.querySelectorAll('button, input, select, canvas')].filter(e => !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length)).map(e => e.outerHTML)";
    assert_eq!(browser.value(unnamed), json!([]), "everything that is used has a name");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}
