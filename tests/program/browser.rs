//! Pages looked at in a real browser without a window: Debian's package chromium.

use std::path::Path;
use std::process::{Child, Command, Stdio};

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

/// `crowded` and `crowdedPictures`: what nobody can read of a page and of the pictures in it.
const TEXTS: &str = include_str!("texts.js");

/// The page `look`, whose script may ask what nobody can read.
pub fn looking(look: &str) -> String {
    look.replacen("<script>", &format!("<script>{TEXTS}"), 1)
}

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

/// A browser that stays on the page at `address`, in real time, and keeps its things in `folder`; `None` as of
/// [`seen`].
pub fn opened(folder: &Path, address: &str) -> Option<Child> {
    let mut browser = Command::new(program()?);
    browser
        .args(ALONE)
        .arg("--remote-debugging-port=0")
        .arg(format!("--user-data-dir={}", folder.display()))
        .arg(address);
    Some(browser.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
}

/// What the element `r` of the page `look` says in the end, which lies in `folder` and may look into the files beside
/// it; `None`, said, without a browser, unless `QUADRILLE_CHROMIUM` demands one.
pub fn seen(folder: &Path, look: &str) -> Option<String> {
    let program = program()?;
    let page = folder.join("look.html");
    std::fs::write(&page, looking(look)).unwrap();
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
