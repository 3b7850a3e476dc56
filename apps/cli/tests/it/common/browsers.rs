//! A headless browser, driven over its debugging pipe (JSON messages that end with a zero byte, so neither a
//! port nor a library is needed), and measurements of a page.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// A browser that sends nothing for this long is stuck.
const PATIENCE: Duration = Duration::from_secs(60);
/// Time after loading in which late messages and requests still count.
const LATE: Duration = Duration::from_millis(300);

/// Returns the browser that `ARLEQUIN_BROWSER` names, else the first of the usual programs that exists.
fn program() -> PathBuf {
    if let Some(named) = std::env::var_os("ARLEQUIN_BROWSER") {
        return named.into();
    }
    let names = [
        "chromium",
        "chromium-browser",
        "google-chrome",
        "google-chrome-stable",
    ];
    let folders: Vec<PathBuf> =
        std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()).collect();
    let candidates = names.iter().flat_map(|n| folders.iter().map(move |f| f.join(n)));
    candidates.into_iter().find(|p| p.is_file()).unwrap_or_else(|| {
        panic!(
            "no browser: install chromium (Debian: apt-get install chromium) or name one in ARLEQUIN_BROWSER"
        )
    })
}

/// A browser with one page at a time.
pub(crate) struct Browser {
    child: Child,
    input: ChildStdin,
    messages: Receiver<Value>,
    session: Option<String>,
    sent: u64,
    /// Events that arrived while an answer was awaited.
    events: Vec<Value>,
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Browser {
    /// Starts the browser with its own profile folder.
    pub(crate) fn start(profile: &Path) -> Self {
        // The browser reads commands from descriptor 3 and answers on 4.
        let mut child = Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<&0 4>&1 >/dev/null 2>&1"])
            .arg(program())
            .args([
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-quic",
                "--no-first-run",
            ])
            .args([
                "--disable-background-networking",
                "--disable-component-update",
                "--disable-sync",
            ])
            .args([
                "--disable-dev-shm-usage",
                "--hide-scrollbars",
                // Pictures in three dimensions without a graphics card.
                "--enable-unsafe-swiftshader",
                "--remote-debugging-pipe",
            ])
            .arg(format!("--user-data-dir={}", profile.display()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the browser starts");
        let input = child.stdin.take().expect("piped");
        let mut output = BufReader::new(child.stdout.take().expect("piped"));
        let (send, messages) = channel();
        std::thread::spawn(move || {
            loop {
                let mut bytes = Vec::new();
                match output.read_until(0, &mut bytes) {
                    Ok(n) if n > 1 => {}
                    _ => break,
                }
                bytes.pop();
                let message = serde_json::from_slice(&bytes).expect("the browser speaks JSON");
                if send.send(message).is_err() {
                    break;
                }
            }
        });
        Self {
            child,
            input,
            messages,
            session: None,
            sent: 0,
            events: Vec::new(),
        }
    }

    /// Sends a command and waits for its answer.
    pub(crate) fn call(&mut self, method: &str, params: &Value) -> Value {
        self.sent += 1;
        let mut message = json!({ "id": self.sent, "method": method, "params": params });
        if let Some(s) = &self.session {
            message["sessionId"] = s.as_str().into();
        }
        let mut bytes = message.to_string().into_bytes();
        bytes.push(0);
        self.input
            .write_all(&bytes)
            .and_then(|()| self.input.flush())
            .expect("the browser listens");
        loop {
            let answer = self.messages.recv_timeout(PATIENCE).expect("the browser answers");
            if answer["id"] == self.sent {
                assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
                return answer["result"].clone();
            }
            self.events.push(answer);
        }
    }

    /// Opens a fresh page of the given width and enables its events.
    fn page(&mut self, width: u32, phone: bool) {
        self.session = None;
        let target = self.call("Target.createTarget", &json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = self.call("Target.attachToTarget", &attach);
        self.session = session["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page", "Runtime", "Log", "Network"] {
            self.call(&format!("{domain}.enable"), &json!({}));
        }
        let size = json!({ "width": width, "height": 800, "deviceScaleFactor": 1, "mobile": phone });
        self.call("Emulation.setDeviceMetricsOverride", &size);
        self.events.clear();
    }

    /// Returns the value of an expression in the page.
    pub(crate) fn value(&mut self, expression: &str) -> Value {
        let asked = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let answer = self.call("Runtime.evaluate", &asked);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    /// Waits until a condition holds in the page.
    pub(crate) fn wait(&mut self, condition: &str) {
        let start = Instant::now();
        while self.value(condition) != true {
            assert!(start.elapsed() < PATIENCE, "never: {condition}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Presses the left button at one point of the page, moves to another in steps, and releases it there.
    pub(crate) fn drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        let mut send = |kind: &str, [x, y]: [f64; 2]| {
            let event =
                json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1 });
            self.call("Input.dispatchMouseEvent", &event);
        };
        send("mousePressed", from);
        for k in 1..=4 {
            let share = f64::from(k) / 4.0;
            send("mouseMoved", [0, 1].map(|c| from[c] + share * (to[c] - from[c])));
        }
        send("mouseReleased", to);
    }

    /// Writes a picture of the page, for people to look at.
    pub(crate) fn keep(&mut self, path: &Path) {
        let shot = self.call("Page.captureScreenshot", &json!({ "format": "png" }));
        let shot = shot["data"].as_str().expect("a picture");
        let bytes = base64::Engine::decode(&base64::engine::general_purpose::STANDARD, shot);
        std::fs::write(path, bytes.expect("base64")).expect("writes");
    }

    /// Opens a file, waits until it has loaded, and returns what was observed.
    pub(crate) fn visit(&mut self, path: &Path, width: u32, phone: bool) -> Seen {
        self.visit_part(path, "", width, phone)
    }

    /// Opens a file at the part that `#part` names, as [`Self::visit`].
    pub(crate) fn visit_part(&mut self, path: &Path, part: &str, width: u32, phone: bool) -> Seen {
        self.page(width, phone);
        let address = format!("file://{}", path.display());
        self.call("Page.navigate", &json!({ "url": format!("{address}{part}") }));
        while !self.events.iter().any(|e| e["method"] == "Page.loadEventFired") {
            let event = self.messages.recv_timeout(PATIENCE).expect("the page loads");
            self.events.push(event);
        }
        while let Ok(event) = self.messages.recv_timeout(LATE) {
            self.events.push(event);
        }
        self.wait("!document.getElementById('data') || !!document.body.dataset.ready");
        let page = self.value(MEASURE);
        assert!(page.is_object(), "the page could not be measured");
        let events = std::mem::take(&mut self.events);
        let page_events = events
            .iter()
            .filter(|e| e["sessionId"].as_str() == self.session.as_deref());
        let mut seen = Seen {
            width,
            page,
            complaints: Vec::new(),
            requests: Vec::new(),
        };
        for e in page_events {
            let p = &e["params"];
            match e["method"].as_str().unwrap_or_default() {
                "Runtime.exceptionThrown" => seen.complaints.push(p["exceptionDetails"].to_string()),
                "Runtime.consoleAPICalled"
                    if ["error", "warning", "assert"].iter().any(|t| p["type"] == *t) =>
                {
                    seen.complaints.push(p["args"].to_string());
                }
                // A browser without a graphics card reads pictures back to show them, and logs this.
                "Log.entryAdded"
                    if p["entry"]["text"]
                        .as_str()
                        .is_some_and(|t| t.contains("due to ReadPixels")) => {}
                "Log.entryAdded" if ["error", "warning"].iter().any(|l| p["entry"]["level"] == *l) => {
                    seen.complaints.push(p["entry"].to_string());
                }
                "Network.requestWillBeSent" => {
                    let url = p["request"]["url"].as_str().unwrap_or_default();
                    // Data within the page itself is no request.
                    if url != address && !url.starts_with("data:") {
                        seen.requests.push(url.to_owned());
                    }
                }
                _ => {}
            }
        }
        seen
    }
}

/// Script that measures a page once it is laid out. A picture must have an area, and its drawing must fill
/// most of the picture.
const MEASURE: &str = "(() => {
    const seen = q => [...document.querySelectorAll(q)].filter(e => e.getClientRects().length);
    const pictures = seen('svg, img, canvas').map(p => {
        const r = p.getBoundingClientRect();
        if (p.tagName === 'IMG') return { width: p.naturalWidth, height: p.naturalHeight, filled: p.complete ? 1 : 0, marks: 1 };
        // Whoever draws by script is looked at by a test of its own.
        if (p.tagName === 'CANVAS') return { width: r.width, height: r.height, filled: 1, marks: 1 };
        const drawn = [...p.querySelectorAll('path,line,polyline,circle,polygon,rect,text')];
        const visible = drawn.filter(d => { const q = d.getBoundingClientRect(); return q.width > 0 || q.height > 0; });
        const inside = p.getBBox ? p.getBBox() : { width: 0, height: 0 };
        const box = p.viewBox ? p.viewBox.baseVal : { width: 1, height: 1 };
        return { width: r.width, height: r.height, filled: inside.width * inside.height / (box.width * box.height),
                 marks: visible.length };
    });
    const runs = document.querySelectorAll('#runs tr');
    const text = e => e ? e.innerText.trim() : '';
    return {
        title: document.title,
        headline: text(document.querySelector('h1')),
        conclusion: [...document.querySelectorAll('h2 + ul li')].map(text),
        body: text(document.body),
        pictures,
        rows: [...runs].slice(1).map(r => text(r.cells[0])),
        cut: seen('th, td, svg').filter(e => e.getBoundingClientRect().right > innerWidth + 0.5).map(text),
        view: document.documentElement.clientWidth,
        content: Math.max(document.documentElement.scrollWidth, document.body.scrollWidth),
    };
})()";

/// Observations of a page: measurements, console messages and requests.
pub(crate) struct Seen {
    width: u32,
    pub(crate) page: Value,
    complaints: Vec<String>,
    requests: Vec<String>,
}

impl Seen {
    /// Returns all defects of a page that do not depend on its content.
    pub(crate) fn faults(&self) -> Vec<String> {
        let mut out: Vec<String> = self.complaints.iter().map(|c| format!("console: {c}")).collect();
        out.extend(self.requests.iter().map(|r| format!("request: {r}")));
        let number = |v: &Value| v.as_f64().unwrap_or_default();
        for (k, p) in self.page["pictures"].as_array().into_iter().flatten().enumerate() {
            let [w, h] = [number(&p["width"]), number(&p["height"])];
            if w < 200.0 || h < 100.0 || number(&p["filled"]) < 0.5 || number(&p["marks"]) < 1.0 {
                out.push(format!("picture {k}: {p}"));
            }
        }
        let (view, content) = (number(&self.page["view"]), number(&self.page["content"]));
        if (view - f64::from(self.width)).abs() > 0.5 {
            out.push(format!("layout: {view} px wide on a screen of {} px", self.width));
        }
        if content > view {
            out.push(format!("overflow: {content} px of content in {view} px"));
        }
        out
    }

    /// Returns a measured text.
    pub(crate) fn words(&self, key: &str) -> &str {
        self.page[key].as_str().unwrap_or_default()
    }

    /// Returns a measured list of texts.
    pub(crate) fn list(&self, key: &str) -> Vec<&str> {
        self.page[key]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .collect()
    }
}

/// Widths \[px\] of a phone and of a desktop, each with its `phone` flag.
pub(crate) const SIZES: [(u32, bool); 2] = [(390, true), (1280, false)];
