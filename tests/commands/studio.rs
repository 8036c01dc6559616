//! `quadrille studio`: who is answered and what is never given away; and the whole way in a real browser, from drawing
//! to results.

#![cfg(feature = "cli")]

use crate::program;
use program::browser::{looking, opened};
use program::{Desk, moved, speckle};
use quadrille::synth::{Depth, Translation};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// A studio that runs, and ends with its test.
struct Studio {
    child: Child,
    port: u16,
    token: String,
}

impl Drop for Studio {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A browser that ends with its test.
struct Ended(Child);

impl Ended {
    fn end(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Drop for Ended {
    fn drop(&mut self) {
        self.end();
    }
}

/// How long the whole way may take; some seconds.
const PATIENCE: Duration = Duration::from_secs(180);

/// What was answered.
#[derive(Debug)]
struct Answered {
    status: u16,
    head: String,
    body: String,
}

impl Studio {
    #[track_caller]
    fn of(desk: &Desk, words: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_quadrille"))
            .args(["studio", "--quiet"])
            .args(words)
            .env("QUADRILLE_DEVICE", "cpu")
            .current_dir(desk.path(""))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let rest = line.trim().strip_prefix("http://127.0.0.1:").unwrap_or_else(|| panic!("{line}"));
        let (port, token) = rest.trim_end_matches('/').split_once('/').unwrap();
        Self { child, port: port.parse().unwrap(), token: token.to_owned() }
    }

    /// The answer to a request line, headers and body as they are.
    #[track_caller]
    fn raw(&self, head: &str, body: &str) -> Answered {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        write!(stream, "{head}\r\nContent-Length: {}\r\n\r\n{body}", body.len()).unwrap();
        let mut text = Vec::new();
        stream.read_to_end(&mut text).unwrap();
        let text = String::from_utf8_lossy(&text).into_owned();
        let (head, body) = text.split_once("\r\n\r\n").unwrap_or_else(|| panic!("{text}"));
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        Answered { status, head: head.to_lowercase(), body: body.to_owned() }
    }

    fn get(&self, path: &str) -> Answered {
        self.raw(&format!("GET /{}/{path} HTTP/1.1\r\nHost: 127.0.0.1:{}", self.token, self.port), "")
    }

    fn post(&self, path: &str, wish: &serde_json::Value) -> Answered {
        let Self { token, port, .. } = self;
        let head =
            format!("POST /{token}/{path} HTTP/1.1\r\nHost: localhost:{port}\r\nOrigin: http://localhost:{port}");
        self.raw(&head, &wish.to_string())
    }
}

const CASE: &str = "# Drawn with quadrille\n[images]\nreference = \"ref.png\"\ndeformed = [\"a.png\", \"b.png\"]\n\
                    [[zone]]\nname = \"z\"\nroi = [16, 16, 112, 80]\n";

#[test]
fn only_who_has_the_address_is_answered_and_no_page_from_elsewhere() {
    let desk = Desk::with_series();
    let studio = Studio::of(&desk, &[]);
    let Studio { token, port, .. } = &studio;
    assert_eq!(token.len(), 32);
    let page = studio.get("");
    assert!(page.status == 200 && page.body.contains("quadrille studio") && page.body.contains(r#""name":"ref.png""#));
    for header in [
        "cache-control: no-store",
        "referrer-policy: no-referrer",
        "x-content-type-options: nosniff",
        "x-frame-options: sameorigin",
    ] {
        assert!(page.head.contains(header), "{}", page.head);
    }
    assert!(!page.head.contains("access-control"), "{}", page.head);
    let other = format!("{:032x}", 1);
    for (path, host, more, status) in [
        (format!("/{other}/"), format!("127.0.0.1:{port}"), String::new(), 404),
        ("/".into(), format!("127.0.0.1:{port}"), String::new(), 404),
        (format!("//{token}/"), format!("127.0.0.1:{port}"), String::new(), 404),
        (format!("/{token}/"), format!("localhost:{port}"), String::new(), 200),
        // A port that is forwarded under another number.
        (format!("/{token}/"), "localhost:9".into(), String::new(), 200),
        // Names that lead here by somebody's name server.
        (format!("/{token}/"), format!("evil.example:{port}"), String::new(), 403),
        (format!("/{token}/"), "127.0.0.1.evil.example".into(), String::new(), 403),
        (format!("/{token}/"), format!("127.0.0.1:{port}"), "\r\nOrigin: http://evil.example".into(), 403),
        (format!("/{token}/"), format!("127.0.0.1:{port}"), "\r\nOrigin: null".into(), 403),
        (format!("/{token}/"), format!("127.0.0.1:{port}"), "\r\nSec-Fetch-Site: cross-site".into(), 403),
        (format!("/{token}/"), format!("127.0.0.1:{port}"), "\r\nHost: localhost".into(), 403),
    ] {
        let answered = studio.raw(&format!("GET {path} HTTP/1.1\r\nHost: {host}{more}"), "");
        assert_eq!(answered.status, status, "{path} {host} {more}: {answered:?}");
        assert!(status == 200 || !answered.body.contains("ref.png"), "{answered:?}");
    }
    // What does something needs an origin, its own.
    let head = format!("POST /{token}/run HTTP/1.1\r\nHost: 127.0.0.1:{port}");
    assert_eq!(studio.raw(&head, "{}").status, 403);
    assert_eq!(studio.raw(&format!("{head}\r\nOrigin: http://127.0.0.1:1"), "{}").status, 403);
    assert_eq!(studio.raw(&format!("DELETE /{token}/ HTTP/1.1\r\nHost: 127.0.0.1:{port}"), "").status, 405);
    assert!(!desk.path("case.toml").exists() && !desk.path("out").exists());
}

#[test]
fn no_file_outside_of_the_folder_is_read_or_written() {
    let desk = Desk::with_series();
    desk.image("images/ref.png", &moved([0.0; 2]));
    desk.image("images/a.png", &moved([0.3, 0.0]));
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(desk.path("ref.png"), desk.path("images/linked.png")).unwrap();
        std::os::unix::fs::symlink(desk.path(""), desk.path("images/way")).unwrap();
    }
    let studio = Studio::of(&desk, &["images"]);
    let page = studio.get("").body;
    assert!(
        page.contains(r#""name":"a.png""#) && !page.contains("linked.png") && !page.contains("way/"),
        "what is only linked is listed"
    );
    for path in [
        "../ref.png",
        "..%2fref.png",
        "a.png",
        "%2e%2e/%2e%2e/etc/passwd",
        "/etc/passwd",
        "view/../../ref.png",
        "image?name=../ref.png",
    ] {
        let answered = studio.get(path);
        assert!(answered.status == 404 || answered.status == 400, "{path}: {answered:?}");
    }
    let wish = |images: &str| serde_json::json!({ "case": format!("# Drawn with quadrille\n[images]\n{images}\n") });
    let outside = [
        "reference = '../ref.png'\ndeformed = 'a.png'".to_owned(),
        format!("reference = '{}'\ndeformed = 'a.png'", desk.path("ref.png").display()),
        "reference = 'ref.png'\ndeformed = 'linked.png'".to_owned(),
        "reference = 'ref.png'\ndeformed = 'way/*.png'".to_owned(),
        "reference = 'ref.png'\ndeformed = 'a.png'\n[[zone]]\nmask = 'way/ref.png'".to_owned(),
    ];
    for images in &outside {
        for path in ["check", "run"] {
            let answered = studio.post(path, &wish(images));
            assert!(
                answered.status == 422 && answered.body.contains("outside of the folder"),
                "{images}: {answered:?}"
            );
        }
    }
    assert!(!desk.path("images/case.toml").exists() && !desk.path("images/out").exists());
    // A case file of somebody else stays, and a link is not written through.
    let fine =
        serde_json::json!({ "case": "# Drawn with quadrille\n[images]\nreference = 'ref.png'\ndeformed = 'a.png'\n" });
    desk.write("images/case.toml", "# mine\n");
    let answered = studio.post("case", &fine);
    assert!(answered.status == 422 && answered.body.contains("not drawn here"), "{answered:?}");
    assert_eq!(desk.read("images/case.toml"), "# mine\n");
    #[cfg(unix)]
    {
        std::fs::remove_file(desk.path("images/case.toml")).unwrap();
        desk.write("theirs.toml", "# Drawn with quadrille\n");
        std::os::unix::fs::symlink(desk.path("theirs.toml"), desk.path("images/case.toml")).unwrap();
        let answered = studio.post("case", &fine);
        assert!(answered.status == 422 && answered.body.contains("this is a link"), "{answered:?}");
        assert_eq!(desk.read("theirs.toml"), "# Drawn with quadrille\n");
    }
    desk.run("studio nowhere").refused(&["nowhere: cannot be opened"]);
    desk.run("studio ref.png").refused(&["ref.png: this is not a folder"]);
    desk.run("studio --output ../out").refused(&["--output ../out: it has to be a plain name"]);
    desk.run("studio --case a/b.toml").refused(&["--case a/b.toml: it has to be a plain name"]);
    let port = studio.port.to_string();
    desk.run_words(&["studio", "--port", &port]).refused(&["cannot be opened", "--port"]);
}

#[test]
fn checks_say_what_a_run_says_of_the_same_case() {
    let desk = Desk::with_series();
    let studio = Studio::of(&desk, &[]);
    let checked = studio.post("check", &serde_json::json!({ "case": CASE }));
    assert_eq!(checked.status, 200, "{checked:?}");
    let said: serde_json::Value = serde_json::from_str(&checked.body).unwrap();
    let zone = &said["zones"][0];
    assert_eq!(
        (zone["elements"].as_u64(), zone["nodes"].as_u64(), zone["without_texture"].as_u64()),
        (Some(24), Some(35), Some(0)),
        "{said}"
    );
    assert_eq!(said["mesh"]["nodes"].as_array().unwrap().len(), 2 * program::N_INSIDE);
    // The same noise and texture as `quadrille metrology` finds in that rectangle.
    let measured = desk.run("metrology ref.png --roi 16,16,112,80 --element-sizes 16 --output m");
    assert_eq!(measured.code, Some(0), "{measured}");
    let metrology = desk.json("m/metrology.json");
    let near = |a: &serde_json::Value, b: &serde_json::Value| {
        let [a, b] = [a, b].map(|v| v.as_f64().unwrap_or_else(|| panic!("{a} {b}")));
        assert!((a - b).abs() <= 1e-9 * b.abs(), "{a} {b}");
    };
    near(&zone["look"]["noise_grey"], &metrology["noise"]["sigma_grey"]);
    near(&zone["look"]["speckle_px"][0], &metrology["texture"]["speckle_px"][0]);
    // Of all nodes here, of the inner ones there: within a factor.
    let ratio =
        zone["sigma_px"][0].as_f64().unwrap() / metrology["sizes"][0]["sigma_predicted_px"][0].as_f64().unwrap();
    assert!((0.7..2.5).contains(&ratio), "{ratio}");
    for (wrong, why) in [
        (CASE.replace("ref.png", "no.png"), "no.png"),
        (CASE.replace("[[zone]]", "[[zoen]]"), "zone"),
        (CASE.replace("112, 80]", "20, 20]"), "zone 'z'"),
    ] {
        let answered = studio.post("check", &serde_json::json!({ "case": wrong }));
        assert!(answered.status == 422 && answered.body.contains(why), "{answered:?}");
    }
    assert!(!desk.path("out").exists() && !desk.path("case.toml").exists(), "a check writes nothing");
}

/// Goes the whole way on the page: answers as lines of JSON.
const WAY: &str = r#"<!doctype html><body style="margin:0"><iframe id="f" src="/TOKEN/" style="width:WIDTHpx;height:900px;border:0">
</iframe><script>
const until = async (what, test) => {
  for (let k = 0; k < 3000; k++) { if (test()) return; await new Promise(done => setTimeout(done, 10)); }
  throw new Error('waited in vain: ' + what);
};
let loads = 0;
f.onload = async () => {
  const d = f.contentDocument, w = f.contentWindow, at = id => d.getElementById(id);
  // The hostile name comes first: another image is the reference, and the page loads again.
  if (loads++ === 0) { [...at('images').querySelectorAll('input[type=radio]')].find(box => box.getAttribute('aria-label').startsWith('ref.png')).click(); return; }
  if (loads !== 2) return;
  const said = {};
  try {
    const map = at('map'), kind = 'KIND';
    const send = (type, [x, y]) => {
      const b = map.getBoundingClientRect(), s = Math.min(b.width / 128, b.height / 96);
      map.dispatchEvent(new w.PointerEvent(type, { bubbles: true, pointerId: 7, pointerType: kind, clientX: b.left + b.width / 2 + (x + .5 - 64) * s, clientY: b.top + b.height / 2 + (y + .5 - 48) * s }));
    };
    said.files = [...at('images').tBodies[0].rows].map(row => row.cells[3].textContent);
    said.subtitle = at('subtitle').textContent;
    said.note = at('images-note').textContent;
    send('pointerdown', [15.5, 15.5]); send('pointermove', [111.5, 79.5]); send('pointerup', [111.5, 79.5]);
    at('name').value = '<i>zone</i>'; at('name').dispatchEvent(new w.Event('change'));
    // A gauge across the zone.
    at('tool-extensometer').click(); send('pointerdown', [32, 48]); send('pointermove', [96, 48]); send('pointerup', [96, 48]);
    await until('the check', () => at('zones').tBodies[0].rows.length && at('zones').tBodies[0].rows[0].cells[0].textContent === '<i>zone</i>');
    said.checked = [...at('zones').tBodies[0].rows[0].cells].map(cell => cell.textContent);
    // Known points: 0.05 mm a pixel, the last one seen a pixel away from where a plain camera sees it.
    for (const [x, y, mmX, mmY] of [[20, 20, 0, 0], [100, 20, 4, 0], [100, 70, 4, -2.5], [20, 71, 0, -2.5]]) {
      at('tool-mark').click(); send('pointerdown', [x, y]); send('pointerup', [x, y]);
      [['mm-x', mmX], ['mm-y', mmY]].forEach(([id, mm]) => { at(id).value = mm; at(id).dispatchEvent(new w.Event('input')); });
    }
    await until('the grid', () => !at('grid-label').hidden && at('check-notes').textContent.includes('Camera: '));
    said.camera = at('check-notes').textContent;
    said.loads = [...at('loads').children].map(option => option.value);
    const fill = (key, value) => { const field = d.querySelector(`[data-key="${key}"]`); field.value = value; field.dispatchEvent(new w.Event('change')); };
    fill('correlation.strain_window', '3'); fill('correlation.noise', '2'); fill('correlation.noise', ''); fill('load.file', 'loads.csv');
    said.case = at('case').textContent;
    at('run').click();
    await until('a frame', () => at('done').tBodies[0].rows.length);
    at('stop-run').click();
    await until('the end', () => at('run-state').textContent.startsWith('stopped') || at('run-state').textContent.startsWith('done'));
    said.stopped = at('run-state').textContent;
    await until('resume', () => at('run').textContent === 'resume' && !at('run').disabled);
    await until('the curve', () => !at('gauges').hidden && at('gauge-chart').querySelector('path'));
    said.early = at('gauge-note').textContent;
    await until('the live field', () => at('readout').textContent.includes('u_y'));
    said.live = at('readout').textContent;
    at('run').click();
    await until('all', () => at('run-state').textContent.startsWith('done'));
    said.done = at('run-state').textContent;
    said.notes = at('run-notes').textContent;
    said.trust = at('trust').hidden ? 'none' : at('trust').textContent;
    await until('all of the curve', () => at('gauge-note').textContent.includes('300 frames'));
    said.gauge = [at('gauge-over').selectedOptions[0].textContent, at('gauge-what').selectedOptions[0].textContent, at('gauge-note').textContent];
    w.HTMLAnchorElement.prototype.click = function () { said.saved = [this.download, this.href.slice(0, 22), this.href.length > 5000]; };
    at('gauge-picture').click();
    await until('the picture', () => said.saved);
    at('gauge-numbers').click(); said.table = said.saved[0];
    const last = await (await fetch(new URL('gauges?from=299', w.location))).json();
    said.last = last.rows[0];
    at('gauge-what').value = 1; at('gauge-what').dispatchEvent(new w.Event('change'));
    said.strain = at('gauge-chart').textContent;
    const report = await fetch(at('report').href);
    said.report = [at('report').hidden, report.status, (await report.text()).includes('Displacements measured on images')];
    said.crowded = crowded(d);
    await until('the results', () => { const v = at('results').contentDocument; return v && v.getElementById('frame-name') && v.getElementById('frame-name').textContent.includes('frame 300 of 300'); });
    const v = at('results').contentDocument, vw = at('results').contentWindow, vmap = v.getElementById('map');
    v.getElementById('quantity').value = [...v.getElementById('quantity').options].find(o => o.textContent === 'u_x (px)').value;
    v.getElementById('quantity').dispatchEvent(new vw.Event('change'));
    const b = vmap.getBoundingClientRect(), s = Math.min(b.width / 128, b.height / 96);
    vmap.dispatchEvent(new vw.PointerEvent('pointermove', { bubbles: true, pointerId: 7, pointerType: kind, clientX: b.left + b.width / 2, clientY: b.top + b.height / 2 }));
    said.probe = v.getElementById('readout').textContent;
    said.foreign = d.querySelectorAll('b, i, img').length + v.querySelectorAll('b, i, img').length;
    said.ran = Boolean(w.ran || vw.ran);
    said.wide = Math.max(0, d.documentElement.scrollWidth - f.clientWidth);
  } catch (error) { said.error = String(error); said.state = at('run-state').textContent + at('run-notes').textContent + at('check-notes').textContent; }
  await fetch('/said', { method: 'POST', body: JSON.stringify(said) });
};
</script>"#;

/// Serves `look` under `/look.html`, hears what it has to say, and hands everything else to the studio: the page that
/// drives and the one that is driven come from one place.
fn before(studio: &Studio, look: String) -> (u16, Receiver<String>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (tell, said) = channel();
    let (own, theirs) = (listener.local_addr().unwrap().port(), studio.port);
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let (Ok(mut stream), look, tell) = (stream, look.clone(), tell.clone()) else { return };
            std::thread::spawn(move || {
                let mut reader = BufReader::new(stream.try_clone().unwrap());
                let (mut head, mut n) = (String::new(), 0);
                loop {
                    let mut line = String::new();
                    if reader.read_line(&mut line).unwrap_or(0) == 0 || line == "\r\n" {
                        break;
                    }
                    if let Some(length) = line.to_lowercase().strip_prefix("content-length:") {
                        n = length.trim().parse().unwrap();
                    }
                    head.push_str(&line);
                }
                let mut body = vec![0; n];
                reader.read_exact(&mut body).unwrap();
                let page = |text: &str| {
                    format!(
                        "HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{text}",
                        text.len()
                    )
                };
                if head.starts_with("GET /look.html") {
                    let _ = stream.write_all(page(&look).as_bytes());
                } else if head.starts_with("POST /said") {
                    let _ = tell.send(String::from_utf8(body).unwrap());
                    let _ = stream.write_all(page("").as_bytes());
                } else if let Ok(mut there) = TcpStream::connect(("127.0.0.1", theirs)) {
                    let _ = write!(there, "{head}\r\n").and_then(|()| there.write_all(&body));
                    let _ = std::io::copy(&mut there, &mut stream);
                }
            });
        }
    });
    (own, said)
}

#[test]
fn the_whole_way_from_a_folder_to_results_in_a_browser() {
    let desk = Desk::new();
    let hostile = "<b><img src=x onerror='window.ran=1'>&amp;.png";
    desk.image("ref.png", &speckle(&Translation([0.0; 2]), Depth::U8));
    desk.image(hostile, &moved([0.5, -0.25]));
    desk.write("loads.csv", format!("load_N\n{}", (1..=300).map(|k| format!("{k}\n")).collect::<String>()));
    for k in 1..300 {
        desk.image(&format!("{k}.png"), &moved([0.5 * f64::from(k) / 299.0, 0.0]));
    }
    for (width, kind) in [("1280", "mouse"), ("400", "touch")] {
        let _ = std::fs::remove_dir_all(desk.path("out"));
        // What was drawn before would be there to begin with.
        let _ = std::fs::remove_file(desk.path("case.toml"));
        let studio = Studio::of(&desk, &["--threads", "1"]);
        let look = looking(WAY).replace("WIDTH", width).replace("KIND", kind).replace("TOKEN", &studio.token);
        let (port, heard) = before(&studio, look);
        let profile = tempfile::tempdir().unwrap();
        let Some(browser) = opened(profile.path(), &format!("http://127.0.0.1:{port}/look.html")) else { return };
        let mut browser = Ended(browser);
        let said = heard.recv_timeout(PATIENCE);
        browser.end();
        let said = said.expect("the page says how it went");
        println!("{width} px: {said}");
        let said: serde_json::Value = serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}"));
        assert!(said.get("error").is_none(), "{said}");
        let text = |key: &str| said[key].as_str().unwrap().to_owned();
        let files: Vec<&str> = said["files"].as_array().unwrap().iter().filter_map(serde_json::Value::as_str).collect();
        assert!(
            files.contains(&hostile)
                && files.contains(&"ref.png")
                && files.iter().position(|f| *f == "2.png") < files.iter().position(|f| *f == "10.png"),
            "{files:?}"
        );
        assert!(
            text("subtitle").starts_with("ref.png, 128 x 96 px") && text("note").starts_with("300 deformed images"),
            "{said}"
        );
        assert_eq!(said["checked"][1], "24", "{said}");
        assert!(said["checked"][4].as_str().unwrap().ends_with("px (x, y)"), "{said}");
        let case = text("case");
        assert!(
            case.contains("reference = \"ref.png\"\ndeformed = \"*.png\"") && case.contains("roi = [16, 16, 112, 80]"),
            "{case}"
        );
        assert!(
            case.contains("[camera]\nimage_size_px = [128, 96]\npoints = [[20, 20, 0, 0], [100, 20, 4, 0]"),
            "{case}"
        );
        assert!(
            text("camera").contains("1 px = 0.0498") && text("camera").contains("it moves points by up to"),
            "{said}"
        );
        assert!(
            case.contains("strain_window = 3\n")
                && !case.contains("noise")
                && case.contains("[load]\nfile = \"loads.csv\"")
        );
        assert_eq!(said["loads"], serde_json::json!(["loads.csv"]), "{said}");
        assert_eq!(desk.read("case.toml"), case, "what is run is what is shown");
        assert!(text("stopped").starts_with("stopped") && !text("stopped").contains("300 of 300"), "{said}");
        assert!(text("live").contains("frame ") && text("live").contains("u_y"), "{said}");
        assert!(text("done").ends_with("300 of 300 frames") && text("notes").contains("done before"), "{said}");
        assert!(text("trust").starts_with("Trust: displacements of measured nodes are known to about"), "{said}");
        // A curve while it went on, and all of it in the end: over the load, in mm of the known points.
        assert!(text("early").starts_with("extensometer1: ") && !text("early").contains("300 frames"), "{said}");
        assert_eq!((&said["gauge"][0], &said["gauge"][1]), (&"load_N".into(), &"elongation (mm)".into()), "{said}");
        assert_eq!(said["saved"].as_array().unwrap().len(), 3, "{said}");
        assert!(said["table"] == "quadrille-gauges.csv" && text("strain").contains("engineering strain"), "{said}");
        let table = desk.read("out/quantities/extensometers.csv");
        let mut lines = table.lines().filter(|line| !line.starts_with('#'));
        let names: Vec<&str> = lines.next().unwrap().split(',').collect();
        let cells: Vec<&str> = lines.next_back().unwrap().split(',').collect();
        for (c, name) in [(0, "elongation_mm"), (1, "sigma_elongation_px"), (2, "strain_engineering")] {
            let written: f64 = cells[names.iter().position(|of| *of == name).unwrap()].parse().unwrap();
            let shown = said["last"]["values"][0][c].as_f64().unwrap();
            // The table has six digits, and adds to noise what the scale is known to.
            let wanted = if c == 1 { written * 0.0498 } else { written };
            assert!((shown - wanted).abs() <= 0.01 * wanted.abs() + 1e-6, "{name}: {shown} {wanted} {said}");
        }
        assert_eq!(said["report"], serde_json::json!([false, 200, true]), "{said}");
        assert_eq!(said["crowded"], serde_json::json!([]), "{width} px");
        assert!(text("probe").contains("u_x = 0.") && text("probe").contains("±"), "{said}");
        assert!(said["foreign"] == 0 && said["ran"] == false && said["wide"] == 0, "{said}");
        // What was done is a case file that the command does again: nothing is missing for it.
        let again = desk.run("correlate --case case.toml --output out").fine();
        assert!(again.stderr.contains("300 frames done before"), "{again}");
    }
}

#[test]
fn connections_that_ask_for_nothing_keep_no_one_out_for_long() {
    let desk = Desk::with_series();
    let studio = Studio::of(&desk, &[]);
    let mut open: Vec<TcpStream> = (0..64).map(|_| TcpStream::connect(("127.0.0.1", studio.port)).unwrap()).collect();
    // A byte now and then keeps no place either.
    for _ in 0..6 {
        open.iter_mut().for_each(|stream| drop(stream.write_all(b"G")));
        std::thread::sleep(Duration::from_millis(250));
    }
    assert_eq!(studio.get("").status, 200);
}

#[cfg(unix)]
#[test]
fn a_link_leads_no_result_out_of_the_folder() {
    let (desk, elsewhere) = (Desk::with_series(), Desk::new());
    // Nor is a report read that lies elsewhere.
    std::fs::create_dir(desk.path("done")).unwrap();
    elsewhere.write("report.html", "theirs");
    std::os::unix::fs::symlink(elsewhere.path("report.html"), desk.path("done/report.html")).unwrap();
    let studio = Studio::of(&desk, &["--output", "done"]);
    let answered = studio.get("report");
    assert!(answered.status == 422 && answered.body.contains("no report yet"), "{answered:?}");
    std::fs::remove_file(desk.path("done/report.html")).unwrap();
    desk.write("done/report.html", "ours");
    assert_eq!(studio.get("report").body, "ours");
    drop(studio);
    std::os::unix::fs::symlink(elsewhere.path("there"), desk.path("out")).unwrap();
    desk.run("studio --output out").refused(&["--output out", "a link that leads out of the folder"]);
}
