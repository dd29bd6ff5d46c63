//! A browser for tests, if one is installed: Chromium without a window, spoken to through two pipes (its DevTools protocol).
#![allow(dead_code, missing_docs)] // each test takes what it needs

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

/// How long anything may take.
const PATIENCE: Duration = Duration::from_secs(60);

/// Chromium without a window, spoken to through two pipes (its DevTools protocol).
pub(crate) struct Browser {
    child: Child,
    to: File,
    from: Receiver<Value>,
    id: u64,
    session: Option<String>,
    /// Errors of the page.
    pub complaints: Vec<String>,
}

impl Browser {
    /// `None` where none is installed, or it cannot run here.
    pub(crate) fn start(folder: &Path, more: &[&str]) -> Option<Self> {
        let named = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success());
        let program = ["chromium", "chromium-browser", "google-chrome", "chrome"].into_iter().find(named)?;
        let (to, from) = (folder.join("to"), folder.join("from"));
        if !Command::new("mkfifo").arg(&to).arg(&from).status().ok()?.success() {
            return None;
        }
        let script = r#"exec "$0" --headless=new --no-sandbox --disable-gpu --disable-dev-shm-usage --no-first-run --disable-extensions \
            --disable-background-networking --user-data-dir="$1" --window-size=1280,900 --remote-debugging-pipe "${@:4}" 3<"$2" 4>"$3""#;
        let mut command = Command::new("bash");
        command.args(["-c", script, program]).arg(folder.join("profile")).arg(&to).arg(&from).args(more);
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

    pub(crate) fn try_call(&mut self, method: &str, params: Value) -> Option<Value> {
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

    pub(crate) fn call(&mut self, method: &str, params: Value) -> Value {
        self.try_call(method, params).unwrap_or_else(|| panic!("{method}: the browser does not answer"))
    }

    /// The value of an expression in the page.
    pub(crate) fn value(&mut self, expression: &str) -> Value {
        let params = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let answer = self.call("Runtime.evaluate", params);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {}", answer["exceptionDetails"]);
        answer["result"]["value"].clone()
    }

    /// Waits until an expression is true.
    pub(crate) fn until(&mut self, expression: &str) {
        let began = Instant::now();
        while self.value(expression) != true {
            let message = self.value("document.getElementById('message')?.textContent");
            assert!(began.elapsed() < PATIENCE, "never: {expression}; the page says {message}; {:?}", self.complaints);
            std::thread::sleep(Duration::from_millis(30));
        }
    }

    pub(crate) fn mouse(&mut self, kind: &str, (x, y): (f64, f64)) {
        let button = json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", button);
    }

    pub(crate) fn click(&mut self, selector: &str) {
        let expression = format!(
            "(() => {{ const e = document.querySelector('{selector}'); e.scrollIntoView({{ block: 'center' }}); \
             const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; }})()"
        );
        let at: (f64, f64) = serde_json::from_value(self.value(&expression)).expect("it is there");
        self.mouse("mousePressed", at);
        self.mouse("mouseReleased", at);
    }

    /// Clicks, and waits until an expression is true.
    pub(crate) fn press(&mut self, selector: &str, expression: &str) {
        self.click(selector);
        self.until(expression);
    }

    /// Draws a box on the frame.
    pub(crate) fn draw(&mut self, [x, y, w, h]: [f64; 4]) {
        let place = "(() => { const e = document.getElementById('screen'); e.scrollIntoView({ block: 'center' }); \
                     const b = e.getBoundingClientRect(); return [b.x, b.y, b.width / page.video.width]; })()";
        let (left, top, k): (f64, f64, f64) = serde_json::from_value(self.value(place)).expect("a stage");
        let at = |x: f64, y: f64| (left + k * x, top + k * y);
        self.mouse("mousePressed", at(x, y));
        self.mouse("mouseMoved", at(x + w / 2.0, y + h / 2.0));
        self.mouse("mouseMoved", at(x + w, y + h));
        self.mouse("mouseReleased", at(x + w, y + h));
        let drawn = self.drawn();
        let off = drawn.iter().zip([x, y, w, h]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off <= 2.0, "{drawn:?} is not {:?}", [x, y, w, h]);
    }

    /// Presses at the first place of the frame, drags through the others and releases; in pixels from 0, at the pixels' centres.
    pub(crate) fn drag(&mut self, places: &[(f64, f64)]) {
        let screen = "(() => { const e = document.getElementById('screen'); const b = e.getBoundingClientRect(); return [b.x, b.y, b.width / page.video.width]; })()";
        let (left, top, k): (f64, f64, f64) = serde_json::from_value(self.value(screen)).expect("a stage");
        let at = |(x, y): (f64, f64)| (left + k * (x + 0.5), top + k * (y + 0.5));
        self.mouse("mousePressed", at(places[0]));
        places[1..].iter().for_each(|place| self.mouse("mouseMoved", at(*place)));
        if places.len() > 1 {
            self.picture("measure-loupe");
        }
        self.mouse("mouseReleased", at(places[places.len() - 1]));
    }

    /// Types into a field.
    pub(crate) fn fill(&mut self, id: &str, text: &str) {
        self.value(&format!(
            "byId('{id}').value = '{text}', byId('{id}').dispatchEvent(new Event('input', {{ bubbles: true }})), true"
        ));
    }

    /// The box that is drawn.
    pub(crate) fn drawn(&mut self) -> [f64; 4] {
        let drawn = self.value("[page.draft.x, page.draft.y, page.draft.w, page.draft.h]");
        serde_json::from_value(drawn).expect("a box")
    }

    /// The boxes of the track.
    pub(crate) fn boxes(&mut self) -> Vec<[f64; 4]> {
        serde_json::from_value(self.value("page.rows.map(row => row.box)")).expect("boxes")
    }

    /// Tracks to the end as fast as it goes, from wherever it is; the boxes.
    pub(crate) fn track(&mut self) -> Vec<[f64; 4]> {
        self.value("byId('pace').value = 200, true");
        self.until("!page.busy && (page.ended || page.playing || (byId('play').click(), false))");
        self.until("page.ended && !page.playing && !page.busy");
        self.boxes()
    }

    /// Shows a frame.
    pub(crate) fn show(&mut self, frame: usize) {
        self.value(&format!("byId('scrub').value = {frame}, byId('scrub').dispatchEvent(new Event('input')), true"));
        self.until(&format!("page.frame === {frame} && shown.frame === {frame}"));
    }

    pub(crate) fn key(&mut self, key: &str, modifiers: u8) {
        // Without its character Enter submits no form.
        let (text, code) = if key == "Enter" { ("\r", 13) } else { ("", 0) };
        for kind in ["keyDown", "keyUp"] {
            self.call(
                "Input.dispatchKeyEvent",
                json!({ "type": kind, "key": key, "code": key, "modifiers": modifiers, "text": text, "windowsVirtualKeyCode": code }),
            );
        }
    }

    /// Sets the colour scheme and the width; a page as narrow as a phone is pressed by fingers.
    pub(crate) fn look(&mut self, scheme: &str, width: usize) {
        let media = json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
        self.call("Emulation.setEmulatedMedia", media);
        self.call("Emulation.setTouchEmulationEnabled", json!({ "enabled": width < 500 }));
        let size = json!({ "width": width, "height": 900, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", size);
        std::thread::sleep(Duration::from_millis(250));
    }

    /// Looks at the page light and dark, on a screen and on a phone: contrast, width, the size of what fingers press, names, and
    /// where its parts come from.
    pub(crate) fn judge(&mut self, name: &str) {
        let mut grounds = vec![];
        for scheme in ["light", "dark"] {
            for width in [1280, 390] {
                self.look(scheme, width);
                let widest = self.value("document.documentElement.scrollWidth - innerWidth").as_f64();
                assert!(widest.is_some_and(|more| more <= 0.0), "{name}: wider than {width} pixels by {widest:?}");
                assert_eq!(self.value("matchMedia('(pointer: coarse)').matches"), json!(width == 390));
                if width == 390 {
                    assert_eq!(self.value(SMALL), json!([]), "{name}: fingers need 44 pixels");
                }
                self.picture(&format!("{name}-{scheme}-{width}"));
            }
            for pair in CONTRASTS {
                let contrast = self.value(&format!("{CONTRAST}({pair})")).as_f64().expect("a number");
                assert!(contrast >= 4.5, "{name}, {scheme}, {pair}: {contrast}");
            }
            // Charts take the colours of the page.
            assert_eq!(self.value(OTHER_INK), json!([]), "{name}, {scheme}: the text of charts");
            grounds.push(self.value("getComputedStyle(document.body).backgroundColor"));
        }
        assert_ne!(grounds[0], grounds[1], "{name}: dark is another colour");
        assert_eq!(self.value(UNNAMED), json!([]), "{name}: everything that is used has a name");
        assert_eq!(self.value(FOREIGN), json!([]), "{name}: everything comes with the page");
        self.look("light", 1280);
    }

    /// Opens a page that is a file, and judges it.
    pub(crate) fn judge_file(&mut self, name: &str, page: &Path) {
        is_one_document(&std::fs::read_to_string(page).expect("a page"));
        self.call("Page.navigate", json!({ "url": format!("file://{}", page.display()) }));
        self.until("document.readyState === 'complete' && !!document.querySelector('main')");
        self.judge(name);
        assert!(self.complaints.is_empty(), "{name}: {:?}", self.complaints);
    }

    /// A picture of the page, where $FOVEATE_SCREENSHOTS names a folder to put it.
    pub(crate) fn picture(&mut self, name: &str) {
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

/// Checks a page that is one file: it has both colour schemes, a policy that loads nothing, and no address but that of SVG itself.
pub(crate) fn is_one_document(page: &str) {
    assert!(page.contains("@media (prefers-color-scheme: dark)"), "a dark scheme");
    assert!(page.contains("http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'"), "a policy");
    for (at, _) in page.match_indices("http://").chain(page.match_indices("https://")) {
        let end = page.ceil_char_boundary((at + 40).min(page.len()));
        assert!(page[at..].starts_with("http://www.w3.org/2000/svg"), "{}", &page[at..end]);
    }
}

/// Colours that stand on each other.
const CONTRASTS: [&str; 8] = [
    "'ink','card'",
    "'ink','page'",
    "'soft','card'",
    "'soft','page'",
    "'soft','sunken'",
    "'ink','sunken'",
    "'target','card'",
    "'second','card'",
];

/// Contrast of two colours of the style, as WCAG counts it.
const CONTRAST: &str = r"((a, b) => {
  const light = name => { const v = getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim(); const rgb = [1, 3, 5].map(i => parseInt(v.slice(i, i + 2), 16) / 255).map(c => c <= .03928 ? c / 12.92 : ((c + .055) / 1.055) ** 2.4);
    return .2126 * rgb[0] + .7152 * rgb[1] + .0722 * rgb[2]; };
  const [x, y] = [light(a), light(b)].sort((p, q) => q - p);
  return (x + .05) / (y + .05);
})";

/// Visible controls that are smaller than a fingertip. A box to tick is pressed by its label; a link within a sentence is
/// as high as its line.
const SMALL: &str = r"[...document.querySelectorAll('button, select, summary, label:has(input[type=checkbox]), input:not([type=file], [type=checkbox]), td a, nav a, li a')]
  .map(e => [e, e.getBoundingClientRect()]).filter(([, box]) => box.width > 0 && (box.width < 43.5 || box.height < 43.5))
  .map(([e, box]) => `${e.outerHTML.slice(0, 60)}: ${box.width} x ${box.height}`)";

/// Controls without a name.
const UNNAMED: &str = "[...document.querySelectorAll('button, input:not([type=file]), select, canvas, svg[role=img]')].filter(e => !e.closest('[aria-hidden=true]') && !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length)).map(e => e.outerHTML)";

/// Texts of charts that are not in the page's ink.
const OTHER_INK: &str = "[...document.querySelectorAll('svg.drawing text')].filter(e => getComputedStyle(e).fill !== getComputedStyle(document.body).color).map(e => e.outerHTML)";

/// Parts that were fetched from elsewhere.
const FOREIGN: &str = "performance.getEntriesByType('resource').map(entry => entry.name).filter(name => !/^(data|blob):/.test(name) && new URL(name).origin !== location.origin)";
