//! Pages looked at in a real browser without a window: Debian's package chromium.

use std::path::Path;
use std::process::Command;

/// What the element `r` of the page `look` says in the end, which lies in `folder` and may look into the files beside it; `None`, said,
/// without a browser, unless `QUADRILLE_CHROMIUM` demands one.
pub fn seen(folder: &Path, look: &str) -> Option<String> {
    let page = folder.join("look.html");
    std::fs::write(&page, look).unwrap();
    seen_at(folder, &format!("file://{}", page.display()))
}

/// The same of the page at `address`; the browser keeps its own things in `folder`.
pub fn seen_at(folder: &Path, address: &str) -> Option<String> {
    let named = std::env::var("QUADRILLE_CHROMIUM").ok();
    let program = named.clone().filter(|name| name != "require").unwrap_or_else(|| "chromium".into());
    if Command::new(&program).arg("--version").output().is_err() {
        assert!(named.is_none(), "QUADRILLE_CHROMIUM is set, and {program} does not start");
        println!("skipped: no {program} (Debian's package chromium)");
        return None;
    }
    let seen = Command::new(&program)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"])
        .args(["--disable-component-update", "--disable-sync", "--disable-quic", "--allow-file-access-from-files"])
        .args(["--window-size=1400,1000", "--virtual-time-budget=20000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", folder.join("profile").display()))
        .arg(address)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&seen.stdout).into_owned();
    let found = text.split("<pre id=\"r\">").nth(1).and_then(|rest| rest.split("</pre>").next()).map(str::to_owned);
    Some(found.unwrap_or_else(|| format!("{text}\n{}", String::from_utf8_lossy(&seen.stderr))))
}
