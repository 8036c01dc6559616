//! `quadrille view`: the page is driven in a real browser, by mouse, by finger and by keys, and what it says is
//! compared with the motion that the images were made with.

#![cfg(feature = "cli")]

use crate::program;
use program::browser::seen;
use program::{Desk, speckle};
use quadrille::imaging::{Image, Pixels};
use quadrille::io::case::CaseDocument;
use quadrille::synth::{Affine, Depth};
use std::path::Path;

/// Drives the page: answers as lines of JSON.
const LOOK: &str = r#"<!doctype html><body style="margin:0"><iframe id="f" src="out/view.html" style="width:WIDTHpx;height:900px;border:0">
</iframe><pre id="r">waiting</pre><script>
const until = async (what, test) => {
  for (let k = 0; k < 400; k++) { if (test()) return; await new Promise(done => setTimeout(done, 25)); }
  throw new Error('waited in vain: ' + what);
};
f.onload = async () => {
  const said = {};
  try {
    const d = f.contentDocument, w = f.contentWindow, at = id => d.getElementById(id), map = at('map');
    await until('the first frame', () => at('frame-name').textContent);
    const place = ([x, y]) => {
      const b = map.getBoundingClientRect(), s = Math.min(b.width / 128, b.height / 96);
      return { clientX: b.left + b.width / 2 + (x + .5 - 64) * s, clientY: b.top + b.height / 2 + (y + .5 - 48) * s };
    };
    const send = (type, point, kind) => map.dispatchEvent(new w.PointerEvent(type, { bubbles: true, pointerId: 7, pointerType: kind, ...place(point) }));
    const tap = (point, kind) => { send('pointerdown', point, kind); send('pointerup', point, kind); };
    const key = name => d.dispatchEvent(new w.KeyboardEvent('keydown', { key: name, bubbles: true }));
    said.title = at('title').textContent;
    said.lead = at('verdict').textContent;
    at('quantity').value = [...at('quantity').options].find(o => o.textContent === 'u_x (px)').value;
    at('quantity').dispatchEvent(new w.Event('change'));
    send('pointermove', [84, 40], 'mouse');
    said.value = at('readout').textContent;
    said.name = at('frame-name').textContent;
    key('ArrowLeft');
    await until('the frame before', () => at('frame-name').textContent !== said.name);
    said.before = at('frame-name').textContent;
    said.value_before = at('readout').textContent;
    key('ArrowRight');
    await until('the frame again', () => at('frame-name').textContent === said.name);
    // A gauge by two clicks, then the same by a drag, and a profile the other way round.
    const drag = (p, q) => { send('pointerdown', p, 'mouse'); send('pointermove', q, 'mouse'); send('pointerup', q, 'mouse'); };
    key('g');
    tap([44, 48], 'touch'); tap([84, 48], 'touch');
    await until('the gauge', () => at('chart-note').textContent.includes('engineering strain'));
    said.gauge = at('chart-note').textContent;
    said.points = at('chart').querySelectorAll('path').length;
    drag([44, 40], [84, 40]);
    await until('the other gauge', () => at('chart-note').textContent.includes('y 40.'));
    said.dragged = at('chart-note').textContent;
    at('mode-profile').click();
    drag([30, 48], [90, 48]);
    said.profile = at('chart-note').textContent;
    tap([30, 56], 'mouse'); tap([90, 56], 'mouse');
    said.clicked = at('chart-note').textContent;
    w.HTMLAnchorElement.prototype.click = function () { said.saved = [this.download, this.href.slice(0, 22), this.href.length > 5000]; };
    at('save-picture').click();
    await until('a picture', () => said.saved);
    // A strain over a window: with its uncertainty, and where an edge cuts the window.
    const choose = (id, name) => { at(id).value = [...at(id).options].find(o => o.textContent === name).value; at(id).dispatchEvent(new w.Event('change')); };
    choose('quantity', 'strain e_xx over 3 x 3 nodes');
    at('mode-value').click();
    send('pointermove', [64, 48], 'mouse'); said.inside = at('readout').textContent;
    send('pointermove', [20, 48], 'mouse'); said.edge = at('readout').textContent;
    at('mode-profile').click(); drag([30, 48], [111, 48]);
    said.cut = [at('chart-note').textContent, at('chart').querySelectorAll('.cut').length];
    // The ends of the colours by number, by pointer and by key; those of a frame are its own.
    const ends = () => [at('low').value, at('high').value].map(Number), bar = at('bar');
    const pull = (from, to) => [['pointerdown', from], ['pointermove', to], ['pointerup', to]].forEach(([type, x]) => { const b = bar.getBoundingClientRect(); bar.dispatchEvent(new w.PointerEvent(type, { bubbles: true, pointerId: 8, clientX: b.left + x * b.width, clientY: b.top + 5 })); });
    const type = (id, value) => { at(id).value = value; at(id).dispatchEvent(new w.Event('change')); };
    said.ends = [ends()];
    type('low', -0.002); type('high', 0.012);
    said.ends.push(ends());
    said.steps = [at('line-figure').textContent, at('line-python').textContent];
    choose('scale', 'of this frame'); said.ends.push(ends());
    type('high', -1); said.refused = at('readout').textContent; said.ends.push(ends());
    pull(.9, .5); said.ends.push(ends());
    at('bar-high').dispatchEvent(new w.KeyboardEvent('keydown', { key: 'ArrowLeft', bubbles: true })); said.ends.push(ends());
    key('ArrowLeft'); await until('another frame', () => at('frame-name').textContent !== said.name); said.ends.push(ends());
    key('ArrowRight'); await until('the frame again', () => at('frame-name').textContent === said.name); said.ends.push(ends());
    at('automatic').click(); said.ends.push(ends());
    choose('scale', 'same for all frames'); said.ends.push(ends());
    choose('quantity', 'u_x (px)');
    send('pointermove', [2, 2], 'mouse');
    at('mode-value').click();
    tap([2, 2], 'mouse');
    said.beside = at('readout').textContent;
    said.files = [...at('frames').querySelectorAll('tbody tr')].map(row => row.children[1].textContent);
    said.foreign = d.querySelectorAll('b, img').length;
    said.ran = Boolean(w.ran);
    said.hash = w.location.hash;
    said.wide = Math.max(0, d.documentElement.scrollWidth - f.clientWidth);
    said.crowded = crowded(d);
    said.small = [...d.querySelectorAll('body *')].filter(e => e.children.length === 0 && e.textContent.trim() &&
      !['SCRIPT', 'STYLE', 'OPTION'].includes(e.tagName) && parseFloat(w.getComputedStyle(e).fontSize) < 11).length;
    const pen = map.getContext('2d').getImageData(0, 0, map.width, map.height).data;
    const colours = new Set();
    for (let k = 0; k < pen.length; k += 4 * 97) colours.add(pen[k] << 16 | pen[k + 1] << 8 | pen[k + 2]);
    said.colours = colours.size;
  } catch (error) { said.error = String(error); }
  r.textContent = JSON.stringify(said);
};
</script>"#;

/// Looks around in a report, without and with the focus on the field: answers as lines of JSON.
const REPORT: &str = r#"<!doctype html><body style="margin:0"><iframe id="f" src="out/report.html" style="width:WIDTHpx;height:900px;border:0">
</iframe><pre id="r">waiting</pre><script>
const until = async (what, test) => {
  for (let k = 0; k < 400; k++) { if (test()) return; await new Promise(done => setTimeout(done, 25)); }
  throw new Error('waited in vain: ' + what);
};
f.onload = async () => {
  const said = {};
  try {
    const d = f.contentDocument, w = f.contentWindow, at = id => d.getElementById(id), map = at('map');
    await until('the first frame', () => at('frame-name').textContent);
    said.titles = [...d.querySelectorAll('main > section > h2')].map(h => h.textContent);
    said.title = d.title;
    const box = map.getBoundingClientRect(), s = Math.min(box.width / 128, box.height / 96);
    const place = ([x, y]) => ({ clientX: box.left + box.width / 2 + (x + .5 - 64) * s, clientY: box.top + box.height / 2 + (y + .5 - 48) * s });
    at('quantity').value = [...at('quantity').options].find(o => o.textContent === 'u_x (px)').value;
    at('quantity').dispatchEvent(new w.Event('change'));
    map.dispatchEvent(new w.PointerEvent('pointermove', { bubbles: true, pointerId: 7, pointerType: 'mouse', ...place([84, 40]) }));
    said.value = at('readout').textContent;
    said.name = at('frame-name').textContent;
    const key = (on, name) => on.dispatchEvent(new w.KeyboardEvent('keydown', { key: name, bubbles: true }));
    key(d.body, 'ArrowLeft');
    await new Promise(done => setTimeout(done, 200));
    said.elsewhere = at('frame-name').textContent;
    key(map, 'ArrowLeft');
    await until('the frame before', () => at('frame-name').textContent !== said.name);
    said.before = at('frame-name').textContent;
    at('frame').value = 1;
    at('frame').dispatchEvent(new w.Event('input'));
    await until('the frame again', () => at('frame-name').textContent === said.name);
    said.files = [...at('frames').querySelectorAll('tbody tr')].map(row => row.children[1].textContent);
    said.foreign = d.querySelectorAll('b').length;
    // No other script runs, and nothing is fetched.
    const script = d.createElement('script');
    script.textContent = 'window.ran = 1';
    d.body.append(script);
    said.ran = Boolean(w.ran);
    said.loaded = w.performance.getEntriesByType('resource').filter(e => !e.name.startsWith('data:')).length;
    said.wide = Math.max(0, d.documentElement.scrollWidth - f.clientWidth);
    said.crowded = [...crowded(d), ...crowdedPictures(d)];
    said.scrolls = [...d.querySelectorAll('.explore *')].filter(e => e.scrollHeight > e.clientHeight + 1 && ['auto', 'scroll'].includes(w.getComputedStyle(e).overflowY)).length;
    said.paper = [...d.styleSheets].flatMap(sheet => [...sheet.cssRules]).filter(rule => rule.media && rule.media.mediaText === 'print')
      .some(rule => [...rule.cssRules].some(own => own.selectorText === '.explore' && own.style.display === 'none'));
    said.inside = Boolean(at('explorer').closest('section.explore')) && at('frames').closest('section.explore') !== null;
    const pen = map.getContext('2d').getImageData(0, 0, map.width, map.height).data, colours = new Set();
    for (let k = 0; k < pen.length; k += 4 * 97) colours.add(pen[k] << 16 | pen[k + 1] << 8 | pen[k + 2]);
    said.colours = colours.size;
  } catch (error) { said.error = String(error); }
  r.textContent = JSON.stringify(said);
};
</script>"#;

/// The number behind `name` in `text`.
#[track_caller]
fn after(text: &str, name: &str) -> f64 {
    let rest = text.split(name).nth(1).unwrap_or_else(|| panic!("no '{name}' in {text}"));
    let number: String = rest.trim_start().chars().take_while(|c| "+-.0123456789e".contains(*c)).collect();
    number.trim_end_matches('.').parse().unwrap_or_else(|_| panic!("no number behind '{name}' in {text}"))
}

#[test]
fn the_page_says_the_motion_of_the_images_under_mouse_finger_and_keys_and_hostile_names_stay_text() {
    let desk = Desk::new();
    let gradient = [[0.01, 0.0], [0.0, -0.004]];
    let motion = Affine::new(gradient, 128, 96);
    desk.image("ref.png", &speckle(&Affine::new([[0.0; 2]; 2], 128, 96), Depth::U16));
    let hostile = "<b><img src=x onerror='window.ran=1'>&amp;.png";
    desk.image("a.png", &speckle(&Affine::new(gradient.map(|row| row.map(|g| 0.5 * g)), 128, 96), Depth::U16));
    desk.image(hostile, &speckle(&motion, Depth::U16));
    desk.run_words(&[
        "correlate",
        "--roi",
        "16,16,112,80",
        "--element-size",
        "16",
        "--strain-window",
        "3",
        "--output",
        "out",
        "ref.png",
        "a.png",
        hostile,
    ])
    .fine();
    let ran = desk.run("view out").fine();
    assert!(ran.stderr.contains("out/view.html with 2 frames"), "{ran}");
    let page = desk.read("out/view.html");
    assert!(!page.contains("<b><img") && page.matches("<script>").count() == 1);
    for address in ["http:", "https:", "src=\"/", "url("] {
        assert!(!page.contains(address), "{address}");
    }
    for width in ["400", "1280"] {
        let Some(said) = seen(&desk.path(""), &LOOK.replace("WIDTH", width)) else { return };
        let said = said.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
        println!("{width} px: {said}");
        let said: serde_json::Value = serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}"));
        assert!(said.get("error").is_none(), "{said}");
        let text = |key: &str| said[key].as_str().unwrap().to_owned();
        assert!(text("lead").contains("2 frames: 2 converged"), "{said}");
        // Noise-free images: 0.01 px is what interpolation leaves at nodes of such a series, and half a pixel of the
        // screen moves the value by a hundredth of that.
        let u = 0.01 * (84.0 - 63.5);
        assert!((after(&text("value"), "u_x =") - u).abs() < 0.01, "{said}");
        assert!(text("value").contains("±") && text("value").ends_with("px"), "{said}");
        assert!((after(&text("value_before"), "u_x =") - 0.5 * u).abs() < 0.01, "{said}");
        assert!(
            text("name").contains("frame 2 of 2: <b><img") && text("before").contains("frame 1 of 2: a.png"),
            "{said}"
        );
        // Two displacements of 0.01 px over 40 px.
        assert!((after(&text("gauge"), "engineering strain") - 0.01).abs() < 5e-4, "{said}");
        assert!((after(&text("gauge"), ", across")).abs() < 0.02 && said["points"].as_u64() == Some(2), "{said}");
        assert!(
            text("profile").contains("Frame 2, from x 30.") && text("beside").contains("beside the mesh"),
            "{said}"
        );
        assert!(said["files"][1].as_str() == Some(hostile) && said["foreign"] == 0 && said["ran"] == false, "{said}");
        assert!(text("hash").contains("frame=2&quantity=ux"), "{said}");
        assert!((after(&text("dragged"), "engineering strain") - 0.01).abs() < 5e-4, "{said}");
        assert!(text("clicked").contains("from x 30.") && text("clicked").contains("y 56."), "{said}");
        assert_eq!(said["saved"], serde_json::json!(["quadrille-curve.png", "data:image/png;base64,", true]));
        let strain = after(&text("inside"), "3 x 3 nodes =");
        assert!((strain - 0.01).abs() < 1e-3 && text("inside").contains("±"), "{said}");
        assert!(!text("inside").contains("cuts") && text("edge").contains("an edge cuts its window"), "{said}");
        // From 30 to 111 px: the windows of the nodes in the border are cut, and so what the outermost elements, up to
        // 31.5 and from 95.5 px on, have of them.
        let n_cut = said["cut"][1].as_u64().unwrap();
        let share = 240.0 * (1.5 + 15.5) / 81.0;
        assert!((n_cut as f64 - share).abs() < 3.0 && said["cut"][0].as_str().unwrap().contains("grey:"), "{said}");
        let ends = |k: usize| [0, 1].map(|c| said["ends"][k][c].as_f64().unwrap());
        assert!(ends(0)[0] == -ends(0)[1] && ends(1) == [-0.002, 0.012], "{said}");
        let [figure, python] = [0, 1].map(|k| said["steps"][k].as_str().unwrap());
        assert_eq!(figure, "quadrille figures out --frames 2 --quantity exx-window --range=-0.002,0.012");
        assert!(
            python.starts_with(r#"quadrille.to_xarray("out").sel(frame=2, strain_component="xx").plot.scatter("#)
                && python.contains(r#"hue="strain_window", vmin=-0.002, vmax=0.012"#),
            "{python}"
        );
        assert!(ends(2) != ends(1) && ends(3) == ends(2) && text("refused").contains("below the upper one"), "{said}");
        assert!(ends(4)[1] < ends(3)[1] && ends(4)[0] == ends(3)[0] && ends(5)[1] < ends(4)[1], "{said}");
        assert!(ends(6) != ends(5) && ends(7) == ends(5) && ends(8) == ends(2) && ends(9) == ends(1), "{said}");
        assert!(said["wide"] == 0 && said["small"] == 0, "{said}");
        assert_eq!(said["crowded"], serde_json::json!([]), "{width} px");
        assert!(said["colours"].as_u64() > Some(50), "{said}");
    }
    the_report_says_the_same(&desk, hostile);
}

/// The fields within the report of the same run.
fn the_report_says_the_same(desk: &Desk, hostile: &str) {
    let page = desk.read("out/report.html");
    assert!(!page.contains("<b><img") && page.matches("<script>").count() == 1);
    for width in ["400", "1280"] {
        let Some(said) = seen(&desk.path(""), &REPORT.replace("WIDTH", width)) else { return };
        let said = said.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
        println!("{width} px: {said}");
        let said: serde_json::Value = serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}"));
        assert!(said.get("error").is_none(), "{said}");
        let text = |key: &str| said[key].as_str().unwrap().to_owned();
        // What must be known stands first, then the fields.
        assert!(
            said["titles"][0] == "Read this first" && said["titles"][1] == "The fields, to look around in",
            "{said}"
        );
        assert_eq!(text("title"), "Displacements measured on images");
        assert!((after(&text("value"), "u_x =") - 0.01 * (84.0 - 63.5)).abs() < 0.01, "{said}");
        assert!(text("value").contains("±") && text("name").contains("frame 2 of 2: <b><img"), "{said}");
        assert!(text("elsewhere") == text("name") && text("before").contains("frame 1 of 2: a.png"), "{said}");
        assert!(said["files"][1].as_str() == Some(hostile) && said["foreign"] == 0, "{said}");
        assert!(said["ran"] == false && said["loaded"] == 0, "{said}");
        assert!(said["wide"] == 0 && said["scrolls"] == 0, "{said}");
        assert_eq!(said["crowded"], serde_json::json!([]), "{width} px");
        assert!(said["paper"] == true && said["inside"] == true, "{said}");
        assert!(said["colours"].as_u64() > Some(50), "{said}");
    }
}

#[test]
fn long_series_are_thinned_to_the_size_asked_for_and_say_so() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{} --output out ref.png a.png b.png c.png", program::INSIDE)).fine();
    let all = desk.run("view out").fine();
    assert!(all.stderr.contains("with 3 frames, "), "{all}");
    // Less than what the rest of a page takes: one frame is left, and what is left out is named.
    let ran = desk.run("view out --max-mb 0.5 --output small.html").fine();
    assert!(ran.stderr.contains("small.html with 1 frame of 3, evenly"), "{ran}");
    assert!(desk.read("small.html").contains("1 of 3 frames with a field are in this page"));
    assert!(desk.bytes("small.html").len() < desk.bytes("out/view.html").len());
    // A folder of a run that has its fields in `correlation` is a run, although somebody keeps a metrology in it.
    desk.run("correlate ref.png a.png --output joint/correlation --quiet").fine();
    desk.write("joint/metrology.json", "{}");
    let ran = desk.run("view joint").fine();
    assert!(ran.stderr.contains("joint/view.html with 1 frame"), "{ran}");
    desk.run("view out --frames 7").refused(&["--frames names frame 7; the series has 3"]);
    desk.run("view nowhere").refused(&["there is no fields.zarr here"]);
    desk.run("view out --max-mb 0").refused(&["give MB from 0.1 to 10000"]);
}

/// Draws on the page: answers as lines of JSON.
const DRAW: &str = r#"<!doctype html><body style="margin:0"><iframe id="f" src="draw.html" style="width:WIDTHpx;height:900px;border:0">
</iframe><pre id="r">waiting</pre><script>
f.onload = async () => {
  const said = {};
  try {
    const d = f.contentDocument, w = f.contentWindow, at = id => d.getElementById(id), map = at('map');
    const kind = 'KIND';
    const send = (type, [x, y], more) => {
      const b = map.getBoundingClientRect(), s = Math.min(b.width / 128, b.height / 96);
      const clientX = b.left + b.width / 2 + (x + .5 - 64) * s, clientY = b.top + b.height / 2 + (y + .5 - 48) * s;
      map.dispatchEvent(new w.PointerEvent(type, { bubbles: true, pointerId: 7, pointerType: kind, clientX, clientY, ...more }));
    };
    const tap = (p, more) => { send('pointermove', p, more); send('pointerdown', p, more); send('pointerup', p, more); };
    const drag = (p, q, more) => { send('pointerdown', p, more); send('pointermove', q, more); send('pointerup', q, more); };
    const key = (name, more) => d.dispatchEvent(new w.KeyboardEvent('keydown', { key: name, bubbles: true, ...more }));
    const fill = (id, value, type) => { at(id).value = value; at(id).dispatchEvent(new w.Event(type)); };
    said.without = at('notes').textContent;
    key('r'); drag([15.5, 7.5], [111.5, 39.5]);
    fill('name', 'upper "strip"', 'change');
    key('p'); for (const p of [[16, 48], [111, 48], [111, 79], [16, 79]]) tap(p);
    key('Enter');
    key('x'); for (const p of [[40, 56], [56, 56], [56, 72]]) tap(p);
    // The first corner again ends it.
    tap([40, 56]);
    key('e'); drag([30, 20], [90, 22], { shiftKey: true });
    key('o'); tap([64, 64]);
    key('k'); drag([20, 90], [70, 90], { shiftKey: true }); fill('length', '2.5', 'input');
    key('c'); tap([20, 44]); tap([30, 44]); key('Backspace'); tap([60, 44]); key('Enter');
    said.with_crack = at('case').textContent.includes('[[crack]]');
    key('z', { ctrlKey: true });
    said.undone = !at('case').textContent.includes('[[crack]]');
    at('opening').checked = true; at('opening').dispatchEvent(new w.Event('change'));
    // A corner is moved, and put back.
    const before = at('case').textContent;
    key('s'); drag([111.5, 39.5], [101.5, 31.5]);
    said.moved = at('case').textContent.includes('roi = [16, 8, 102, 32]');
    at('undo').click();
    said.back = at('case').textContent === before;
    fill('size', '8', 'change');
    // Painted out of the upper strip, which is masked as well: a stroke with a corner, and one that is undone.
    key('s'); tap([100, 12]);
    fill('mask', 'mask.png', 'change');
    const plain = at('case').textContent;
    key('b'); fill('brush', '12', 'change');
    send('pointerdown', [20, 28]);
    for (let x = 21; x < 60; x++) send('pointermove', [x, 28]);
    for (let y = 28; y > 14; y--) send('pointermove', [60, y]);
    send('pointerup', [60, 14]);
    said.painted = at('case').textContent.split('\n').filter(line => line.startsWith('exclude')).length;
    said.unpainted = (drag([80, 20], [90, 20]), at('undo').click(), at('case').textContent !== plain);
    said.case = at('case').textContent;
    said.notes = at('notes').textContent;
    said.crowded = crowded(d);
    said.wide = Math.max(0, d.documentElement.scrollWidth - f.clientWidth);
  } catch (error) { said.error = String(error); }
  r.textContent = JSON.stringify(said);
};
</script>"#;

/// What a page says that goes on with a case file.
const AGAIN: &str = r#"<!doctype html><body style="margin:0"><iframe id="f" src="draw.html" style="width:WIDTHpx;height:900px;border:0">
</iframe><pre id="r">waiting</pre><script>
f.onload = () => {
  const at = id => f.contentDocument.getElementById(id);
  r.textContent = JSON.stringify({ case: at('case').textContent, notes: at('notes').textContent });
};
</script>"#;

/// What is written by a page that goes on with a case file: at once; after the upper zone has got another name, the
/// page another stiffness and the first extensometer another end; after all that is undone; without its joint.
const EDITED: &str = r#"<!doctype html><body style="margin:0"><iframe id="f" src="draw.html" style="width:1280px;height:900px;border:0">
</iframe><pre id="r">waiting</pre><script>
f.onload = () => {
  const said = {};
  try {
    const d = f.contentDocument, w = f.contentWindow, at = id => d.getElementById(id), map = at('map');
    const send = (type, [x, y]) => {
      const b = map.getBoundingClientRect(), s = Math.min(b.width / 128, b.height / 96);
      const clientX = b.left + b.width / 2 + (x + .5 - 64) * s, clientY = b.top + b.height / 2 + (y + .5 - 48) * s;
      map.dispatchEvent(new w.PointerEvent(type, { bubbles: true, pointerId: 7, pointerType: 'mouse', clientX, clientY }));
    };
    const drag = (p, q) => { send('pointerdown', p); send('pointermove', q); send('pointerup', q); };
    const fill = (id, value) => { at(id).value = value; at(id).dispatchEvent(new w.Event('change')); };
    const write = name => { said[name] = at('case').textContent; };
    write('read');
    said.notes = at('notes').textContent;
    said.own = ['e', 'nu', 'phi', 'dn', 'dt'].filter(key => !at(`joint-${key}`).disabled);
    d.dispatchEvent(new w.KeyboardEvent('keydown', { key: 's', bubbles: true }));
    send('pointerdown', [30, 20]); send('pointerup', [30, 20]);
    fill('name', 'top');
    fill('joint-e', '210000');
    drag([90.25, 70.125], [100, 75]);
    write('edited');
    for (let k = 0; k < 3; k++) at('undo').click();
    write('undone');
    at('joint').checked = false; at('joint').dispatchEvent(new w.Event('change'));
    write('alone');
  } catch (error) { said.error = String(error.stack); }
  r.textContent = JSON.stringify(said);
};
</script>"#;

/// A case file of which a page draws the least.
const RICH: &str = r#"[images]
reference = "ref.png"
deformed = ["a.png", "b.png"]
pixel_size_mm = 0.0019312512345
[correlation]
element_size_px = 8
noise = 1.5
[[zone]]
name = "upper"
roi = [16.0, 8.03125, 112.0, 40.5]
guard_px = { left = 1 }
exclude = [[[40.123456, 10], [48, 10], [48, 16.0625]]]
[[zone]]
name = "lower"
roi = [16.0, 48.25, 112.0, 88.96875]
[[extensometer]]
name = "gauge one"
from = [30.0625, 70.125]
to = [90.25, 70.125]
[[probe]]
name = "p"
point = [64.0001, 64.5]
[[opening]]
name = "mouth"
zones = ["lower", "upper"]
[interface]
zones = ["upper", "lower"]
guard_px = 3
[boundary]
remove_rigid_motion = "none"
[substrate]
model = "ramberg-osgood"
plane = "stress"
E_MPa = 72000.5
nu = 0.33
sigma_0_MPa = 180.0
alpha = 0.06
n = 7.0
exact = true
[cohesive]
model = "bilinear-power"
K_MPa_per_mm = 2e4
T_n0_MPa = 60.0
T_t0_MPa = 61.0
G_Ic_N_per_mm = 1.0
G_IIc_N_per_mm = 4.0
eta = 1.0
[measurement]
nodes = "free"
weights = "covariance"
boundary = "estimated"
[fit]
parameters = ["K", "G_Ic"]
exact = ["thickness"]
[fit.start]
K = 1e4
[output]
figures = []
"#;

#[test]
fn a_page_that_goes_on_with_a_case_file_changes_nothing_in_it_but_what_is_changed_there() {
    let desk = Desk::with_series();
    desk.write("mine.toml", RICH);
    desk.run("make page ref.png a.png b.png --case mine.toml").fine();
    let Some(said) = seen(&desk.path(""), EDITED) else { return };
    let said: serde_json::Value =
        serde_json::from_str(&said.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")).unwrap();
    assert!(said.get("error").is_none() && said["notes"] == "", "{said}");
    // The law has no work of separation of that name: what would not be written cannot be typed.
    assert_eq!(said["own"], serde_json::json!(["e", "nu"]));
    /// Whole numbers as others: TOML has both, a page one kind.
    fn plain(value: &serde_json::Value) -> serde_json::Value {
        match value {
            serde_json::Value::Number(number) => serde_json::json!(number.as_f64()),
            serde_json::Value::Array(values) => values.iter().map(plain).collect(),
            serde_json::Value::Object(of) => of.iter().map(|(key, value)| (key.clone(), plain(value))).collect(),
            other => other.clone(),
        }
    }
    let tables = |text: &str| {
        let tables = CaseDocument::tables(text, Path::new("case.toml"));
        plain(&tables.unwrap_or_else(|error| panic!("{error}\n{text}")))
    };
    let read = tables(RICH);
    for stage in ["read", "undone"] {
        assert_eq!(tables(said[stage].as_str().unwrap()), read, "{stage}: {said}");
    }
    let mut wanted = read.clone();
    wanted["zone"][0]["name"] = "top".into();
    wanted["opening"][0]["zones"] = serde_json::json!(["lower", "top"]);
    wanted["interface"]["zones"] = serde_json::json!(["top", "lower"]);
    wanted["substrate"]["E_MPa"] = 210000.0.into();
    let mut edited = tables(said["edited"].as_str().unwrap());
    // To the tenth of a pixel where the pointer was.
    let end: Vec<f64> = serde_json::from_value(edited["extensometer"][0]["to"].take()).unwrap();
    assert!((end[0] - 100.0).abs() < 0.6 && (end[1] - 75.0).abs() < 0.6, "{end:?}");
    edited["extensometer"][0]["to"] = wanted["extensometer"][0]["to"].clone();
    assert_eq!(plain(&edited), wanted, "{said}");
    for section in ["interface", "boundary", "substrate", "cohesive", "measurement", "fit"] {
        assert!(
            read.get(section).is_some() && tables(said["alone"].as_str().unwrap()).get(section).is_none(),
            "{section}: {said}"
        );
    }
    // What a page cannot keep is named; so is the folder of names that are meant from elsewhere.
    desk.write("far/odd.toml", RICH.replace("noise = 1.5", "noise = inf"));
    desk.run("make page ref.png --case far/odd.toml").fine();
    let Some(back) = seen(&desk.path(""), &AGAIN.replace("WIDTH", "1280")) else { return };
    assert!(back.contains("does not have these of the case file that was read: [correlation] noise"), "{back}");
    assert!(back.contains("far: file names in it are relative to that folder"), "{back}");
    assert!(back.contains(r#"deformed = [\"a.png\", \"b.png\"]"#), "{back}");
    desk.run("make page ref.png a.png --case none.toml").refused(&["none.toml: cannot be read"]);
    desk.write("wrong.toml", "[images]\nreferenc = 1\n");
    desk.run("make page ref.png a.png --case wrong.toml").refused(&["wrong.toml", "referenc"]);
}

#[test]
fn what_is_drawn_on_the_image_is_a_case_file_that_the_command_measures_by() {
    let desk = Desk::with_series();
    for (width, kind) in [("1280", "mouse"), ("400", "touch")] {
        let made = desk.run("make page ref.png a.png b.png").fine();
        assert!(made.stderr.contains("draw.html: open it in a browser"), "{made}");
        let look = DRAW.replace("WIDTH", width).replace("KIND", kind);
        let Some(said) = seen(&desk.path(""), &look) else { return };
        let said = said.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
        println!("{width} px: {said}");
        let said: serde_json::Value = serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}"));
        assert!(said.get("error").is_none(), "{said}");
        for key in ["with_crack", "undone", "moved", "back"] {
            assert_eq!(said[key], true, "{key}: {said}");
        }
        assert!(said["without"].as_str().unwrap().contains("Without a zone") && said["notes"] == "", "{said}");
        assert_eq!(said["wide"], 0, "{said}");
        assert_eq!(said["crowded"], serde_json::json!([]), "{width} px");
        let case = said["case"].as_str().unwrap();
        assert!(case.contains("roi = [16, 8, 112, 40]") && case.contains(r#"name = "upper \"strip\"""#), "{case}");
        assert!(case.contains("# 2.5 mm are 50 px") && case.contains("pixel_size_mm = 0.05"), "{case}");
        assert!(said["painted"] == 2 && said["unpainted"] == true && case.contains(r#"mask = "mask.png""#), "{said}");
        let white = (0..128 * 96).map(|k| if k % 128 < 98 { 255 } else { 0 }).collect();
        desk.image("mask.png", &Image::new(128, 96, Pixels::U8(white)).unwrap());
        let elements = |case: &str| {
            desk.write("case.toml", case);
            desk.run("correlate --case case.toml --output out --overwrite --quiet").fine();
            desk.json("out/summary.json")["n_elements"].as_u64().unwrap()
        };
        let (mask, cut) = (|line: &&str| line.starts_with("mask"), |line: &&str| line.starts_with("exclude"));
        let upper = case.lines().find(cut).unwrap();
        let bare: Vec<&str> = case.lines().filter(|line| !mask(line) && *line != upper).collect();
        // Of elements of 8 px from (16, 8) on: the mask has less than half of those from x = 96 to 112, two columns of
        // four; the stroke, 12 px wide, runs along y = 28 from x = 20 to 60 over six of them, then up to 14
        // over two more.
        assert_eq!(elements(&bare.join("\n")) - elements(case), 8 + 6 + 2, "{case}");
        // The case file drawn again says the same, but for the scale, whose line is not in it.
        let again = desk.run("make page ref.png a.png b.png --case case.toml").fine();
        assert!(again.stderr.contains("draw.html"), "{again}");
        let look = AGAIN.replace("WIDTH", width);
        let Some(back) = seen(&desk.path(""), &look) else { return };
        let back: serde_json::Value = serde_json::from_str(&back.replace("&lt;", "<").replace("&amp;", "&")).unwrap();
        let without_scale =
            |text: &str| text.lines().filter(|line| !line.starts_with("pixel_size_mm")).collect::<Vec<_>>().join("\n");
        assert_eq!(without_scale(back["case"].as_str().unwrap()), without_scale(case), "{back}");
        assert!(back["case"].as_str().unwrap().contains("pixel_size_mm = 0.05\n") && back["notes"] == "", "{back}");
        let summary = desk.json("out/summary.json");
        assert_eq!(summary["frames"].as_array().unwrap().len(), 2, "{summary}");
        for table in ["extensometers", "points", "openings"] {
            assert!(
                desk.all_files("out/quantities").iter().any(|name| name.ends_with(&format!("{table}.csv"))),
                "{table}"
            );
        }
    }
}

#[test]
fn a_page_to_draw_on_names_what_cannot_be_read() {
    let desk = Desk::with_series();
    desk.run("make page nothing.png").refused(&["nothing.png"]);
    desk.write("text.png", "no image");
    desk.run("make page text.png").refused(&["text.png"]);
    desk.run("make page ref.png --output no/folder/draw.html").refused(&["no/folder/draw.html: cannot be written"]);
    // Of one glob the first image is the reference.
    desk.run_words(&["make", "page", "?.png", "--output", "glob.html"]).fine();
    let page = desk.read("glob.html");
    assert!(
        page.contains(r#""deformed":["?.png"]"#)
            && page.contains(r#""reference":null"#)
            && page.contains(r#""shown":"a.png""#)
    );
}

/// Draws a joint: answers as lines of JSON.
const JOINT: &str = r#"<!doctype html><body style="margin:0"><iframe id="f" src="draw.html" style="width:WIDTHpx;height:900px;border:0">
</iframe><pre id="r">waiting</pre><script>
f.onload = () => {
  const said = {};
  try {
    const d = f.contentDocument, w = f.contentWindow, at = id => d.getElementById(id), map = at('map');
    const send = (type, [x, y], more) => {
      const b = map.getBoundingClientRect(), s = Math.min(b.width / 128, b.height / 96);
      const clientX = b.left + b.width / 2 + (x + .5 - 64) * s, clientY = b.top + b.height / 2 + (y + .5 - 48) * s;
      map.dispatchEvent(new w.PointerEvent(type, { bubbles: true, pointerId: 7, pointerType: 'mouse', clientX, clientY, ...more }));
    };
    const drag = (p, q, more) => { send('pointerdown', p, more); send('pointermove', q, more); send('pointerup', q, more); };
    const key = name => d.dispatchEvent(new w.KeyboardEvent('keydown', { key: name, bubbles: true }));
    const fill = (id, value, type) => { at(id).value = value; at(id).dispatchEvent(new w.Event(type)); };
    key('r'); drag([15.5, 7.5], [111.5, 39.5]);
    said.alone = at('joint-label').hidden;
    key('r'); drag([15.5, 55.5], [111.5, 87.5]);
    at('joint').checked = true; at('joint').dispatchEvent(new w.Event('change'));
    said.without_scale = at('notes').textContent;
    key('k'); drag([20, 48], [70, 48], { shiftKey: true }); fill('length', '2.5', 'input');
    said.empty = at('notes').textContent;
    for (const [id, value] of [['e', '0'], ['nu', '0.33'], ['phi', '1'], ['dn', '0.005'], ['dt', '0.05'], ['r', '1']]) fill(`joint-${id}`, value, 'change');
    said.nothing = at('notes').textContent;
    fill('joint-e', '72000', 'change'); fill('joint-phi', '1.5', 'change');
    said.case = at('case').textContent;
    said.notes = at('notes').textContent;
    // The upper zone is drawn down over the lower one.
    key('s'); drag([111.5, 39.5], [111.5, 60.5]);
    said.overlap = at('notes').textContent;
  } catch (error) { said.error = String(error); }
  r.textContent = JSON.stringify(said);
};
</script>"#;

#[test]
fn a_joint_drawn_between_two_zones_is_a_case_of_run() {
    let desk = Desk::with_series();
    for width in ["1280", "400"] {
        desk.run("make page ref.png a.png b.png").fine();
        let Some(said) = seen(&desk.path(""), &JOINT.replace("WIDTH", width)) else { return };
        let said: serde_json::Value = serde_json::from_str(&said.replace("&lt;", "<").replace("&amp;", "&")).unwrap();
        assert!(said.get("error").is_none() && said["alone"] == true && said["notes"] == "", "{said}");
        let told = |key: &str, words: &str| assert!(said[key].as_str().unwrap().contains(words), "{key}: {said}");
        told("without_scale", "The joint needs the scale");
        told("empty", "The joint needs all its values");
        told("nothing", "have to be positive");
        told("overlap", "there is no room for an adhesive");
        // The lower zone first: its normal points up to the other.
        told("case", r#"zones = ["zone2", "zone1"]"#);
        let text = said["case"].as_str().unwrap();
        let document =
            CaseDocument::parse(text, Path::new("case.toml")).unwrap_or_else(|error| panic!("{error}\n{text}"));
        assert_eq!(document.case.interface.as_ref().unwrap().zones, ["zone2", "zone1"]);
        document.run().unwrap_or_else(|error| panic!("{error}\n{text}"));
    }
}
