//! Pages looked at in a real browser without a window: Debian's package chromium.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// Without a window, and without speaking to anybody.
const ALONE: [&str; 9] = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
    "--window-size=1400,1000",
];

/// The browser, where there is one; it is said when not.
fn program() -> Option<String> {
    let named = std::env::var("QUADRILLE_CHROMIUM").ok();
    let program = named.clone().filter(|name| name != "require").unwrap_or_else(|| "chromium".into());
    if Command::new(&program).arg("--version").output().is_err() {
        assert!(named.is_none(), "QUADRILLE_CHROMIUM is set, and {program} does not start");
        println!("skipped: no {program} (Debian's package chromium)");
        return None;
    }
    Some(program)
}

/// A browser that stays on the page at `address`, in real time, and keeps its things in `folder`; `None` as of [`seen`].
pub fn opened(folder: &Path, address: &str) -> Option<Child> {
    let mut browser = Command::new(program()?);
    browser
        .args(ALONE)
        .arg("--remote-debugging-port=0")
        .arg(format!("--user-data-dir={}", folder.display()))
        .arg(address);
    Some(browser.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
}

/// What the element `r` of the page `look` says in the end, which lies in `folder` and may look into the files beside it; `None`, said,
/// without a browser, unless `QUADRILLE_CHROMIUM` demands one.
pub fn seen(folder: &Path, look: &str) -> Option<String> {
    let program = program()?;
    let page = folder.join("look.html");
    std::fs::write(&page, look).unwrap();
    let seen = Command::new(program)
        .args(ALONE)
        .args(["--allow-file-access-from-files", "--virtual-time-budget=20000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", folder.join("profile").display()))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&seen.stdout).into_owned();
    let found = text.split("<pre id=\"r\">").nth(1).and_then(|rest| rest.split("</pre>").next()).map(str::to_owned);
    Some(found.unwrap_or_else(|| format!("{text}\n{}", String::from_utf8_lossy(&seen.stderr))))
}

/// With the software device of the browser for WebGPU: the same everywhere, and there without a graphics card.
const WEBGPU: [&str; 2] = ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"];
/// What a page is waited for.
const PATIENCE: Duration = Duration::from_secs(240);

/// A page in a browser that is spoken to by two pipes (Chromium's DevTools protocol): for what takes its time outside of timers, such as a
/// graphics device, which [`seen`] does not wait for.
pub struct Page {
    browser: Child,
    to: ChildStdin,
    from: Receiver<Value>,
    session: Option<String>,
    number: u64,
    /// Addresses that the page has asked for.
    pub asked: Vec<String>,
    /// What it has complained about.
    pub complaints: Vec<String>,
}

impl Page {
    /// The page at `address`, with the things of the browser in `folder`; `None` as of [`seen`].
    pub fn open(folder: &Path, address: &str) -> Option<Self> {
        // Commands come on 3, and answers go to 4.
        const PIPES: &str = "exec \"$0\" \"$@\" 3<&0 4>&1 </dev/null >/dev/null 2>/dev/null";
        let mut browser = Command::new("sh");
        browser.args(["-c", PIPES, &program()?]).args(ALONE).args(WEBGPU).arg("--remote-debugging-pipe");
        browser.arg(format!("--user-data-dir={}", folder.display()));
        let mut browser = browser.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let (to, said) = (browser.stdin.take().unwrap(), BufReader::new(browser.stdout.take().unwrap()));
        let (sender, from) = channel();
        std::thread::spawn(move || {
            for message in said.split(0) {
                let Ok(message) = message else { return };
                // Nobody listens any more once the page is closed.
                if sender.send(serde_json::from_slice(&message).unwrap()).is_err() {
                    return;
                }
            }
        });
        let (asked, complaints) = (Vec::new(), Vec::new());
        let mut page = Self { browser, to, from, session: None, number: 0, asked, complaints };
        let target = page.call("Target.createTarget", &json!({ "url": "about:blank" }))["targetId"].clone();
        let attached = page.call("Target.attachToTarget", &json!({ "targetId": target, "flatten": true }));
        page.session = attached["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page", "Runtime", "Network", "DOM"] {
            page.call(&format!("{domain}.enable"), &json!({}));
        }
        page.call("Page.navigate", &json!({ "url": address }));
        Some(page)
    }

    /// What the browser answers to a command.
    #[track_caller]
    pub fn call(&mut self, method: &str, params: &Value) -> Value {
        self.number += 1;
        let mut message = json!({ "id": self.number, "method": method, "params": params });
        if let Some(session) = &self.session {
            message["sessionId"] = session.as_str().into();
        }
        let mut bytes = message.to_string().into_bytes();
        bytes.push(0);
        self.to.write_all(&bytes).unwrap();
        loop {
            let said = self.from.recv_timeout(PATIENCE);
            let mut said = said.unwrap_or_else(|error| panic!("{method}: the browser says nothing: {error}"));
            if said["id"] == self.number {
                assert!(said["error"].is_null(), "{method}: {}", said["error"]);
                return said["result"].take();
            }
            let params = &said["params"];
            match said["method"].as_str() {
                Some("Network.requestWillBeSent") => {
                    self.asked.push(params["request"]["url"].as_str().unwrap().to_owned());
                }
                Some("Runtime.exceptionThrown") => self.complaints.push(params["exceptionDetails"].to_string()),
                Some("Runtime.consoleAPICalled") if params["type"] == "error" => {
                    self.complaints.push(params["args"].to_string());
                }
                _ => {}
            }
        }
    }

    /// The value of an expression on the page, waited for where it is a promise.
    #[track_caller]
    pub fn value(&mut self, expression: &str) -> Value {
        let params = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let mut said = self.call("Runtime.evaluate", &params);
        assert!(said["exceptionDetails"].is_null(), "{expression}: {}", said["exceptionDetails"]);
        said["result"]["value"].take()
    }

    /// What the element `id` says.
    #[track_caller]
    pub fn text(&mut self, id: &str) -> String {
        let text = self.value(&format!("document.getElementById('{id}')?.textContent ?? ''"));
        text.as_str().unwrap().to_owned()
    }

    /// Waits until the expression holds.
    #[track_caller]
    pub fn until(&mut self, expression: &str) {
        let began = Instant::now();
        while self.value(&format!("Boolean({expression})")) != true {
            assert!(began.elapsed() < PATIENCE, "waited in vain for {expression}: {:?}", self.complaints);
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Chooses a file in the input `id`.
    #[track_caller]
    pub fn choose(&mut self, id: &str, file: &Path) {
        let found = self.call("Runtime.evaluate", &json!({ "expression": format!("document.getElementById('{id}')") }));
        let object = &found["result"]["objectId"];
        self.call("DOM.setFileInputFiles", &json!({ "objectId": object, "files": [file] }));
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.browser.kill(); // it may have ended
        let _ = self.browser.wait();
    }
}
