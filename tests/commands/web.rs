//! The page of `web/` in a real browser, on its software device: it agrees with the CPU, notices altered shaders, measures files as the
//! library does, says what it cannot do, and asks nobody for anything.

use crate::program;
use program::browser::Page;
use program::{Desk, moved, speckle};
use quadrille::backend::cpu::CpuBackend;
use quadrille::correlate::{Correlator, Options};
use quadrille::field::{Brightness, Status};
use quadrille::imaging::{Image, Levels, Pixels};
use quadrille::io::images::write_image;
use quadrille::mesh::Zone;
use quadrille::synth::{Depth, Rotation};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("web")
}

/// The page in `web`, once it has looked at its device; `None`, said, without a browser or without a device.
#[track_caller]
fn checked(desk: &Desk, web: &Path) -> Option<Page> {
    let mut page = Page::open(&desk.path("profile"), &format!("file://{}", web.join("index.html").display()))?;
    page.until("/well|wrong/.test(document.getElementById('verdict')?.className)");
    let verdict = page.text("verdict");
    if verdict.contains("offers no") {
        println!("skipped: {verdict}");
        return None;
    }
    Some(page)
}

/// What the page says of a pair once it is done with it.
#[track_caller]
fn told(page: &mut Page, reference: &Path, deformed: &Path) -> String {
    for (id, file) in [("reference", reference), ("deformed", deformed)] {
        page.choose(id, file);
        let name = file.file_name().unwrap().display();
        page.until(&format!("known.pair.{id}?.name === '{name}'"));
    }
    page.until("!document.getElementById('go').disabled");
    page.value("go()");
    page.text("status")
}

#[test]
fn the_page_agrees_with_the_cpu_and_measures_files_as_the_library_does() {
    let desk = Desk::new();
    let Some(mut page) = checked(&desk, &folder()) else { return };
    let verdict = page.text("verdict");
    assert!(verdict.starts_with("Agrees"), "{verdict}\n{}", page.text("compared"));
    let report: Value =
        serde_json::from_str(page.value("document.getElementById('report').value").as_str().unwrap()).unwrap();
    assert_eq!((&report["agrees"], &report["version"]), (&true.into(), &env!("CARGO_PKG_VERSION").into()));
    // Every kernel of the page took part.
    let kernels = page.value("Object.keys(SHADERS).sort()");
    let ran: Vec<&String> = report["kernels"].as_object().unwrap().keys().collect();
    for kernel in kernels.as_array().unwrap() {
        assert!(ran.iter().any(|name| *name == kernel), "{kernel} did not run: {ran:?}");
    }
    println!("{}: {}", report["adapter"]["architecture"], report["ms"]);

    // A pair from files: turned by 2 degrees, so that the start has to be found and every node moves otherwise.
    let images = [moved([0.0, 0.0]), speckle(&Rotation::new(2.0, program::WIDTH, program::HEIGHT), Depth::U8)];
    let files = ["reference.png", "deformed.png"].map(|name| desk.path(name));
    for (image, file) in images.iter().zip(&files) {
        write_image(file, image).unwrap();
    }
    let status = told(&mut page, &files[0], &files[1]);
    assert_eq!(status, "Converged.");
    // Grey levels arrive as they are written; colours as src/io/images.rs makes them grey.
    let greys = page.value("Array.from(known.pair.reference.grey)");
    let greys: Vec<u8> = serde_json::from_value(greys).unwrap();
    assert!(matches!(images[0].pixels(), Levels::U8(pixels) if *pixels == *greys));
    let colour = page.value(
        "(async () => { const c = new OffscreenCanvas(2, 1); const x = c.getContext('2d'); x.fillStyle = 'rgb(10, 200, 30)'; \
         x.fillRect(0, 0, 2, 1); return (await read(await c.convertToBlob())).grey[1] })()",
    );
    let luminance = 0.2126 * 10.0 + 0.7152 * 200.0 + 0.0722 * 30.0;
    assert!((colour.as_f64().unwrap() - luminance).abs() < 1e-4, "{colour}");
    let [reference, deformed] = images.map(Arc::new);
    let zone = Zone { name: "all".into(), ..Zone::default() };
    let options = Options { brightness: Brightness::Zone, ..Options::default() };
    let correlator = Correlator::new(CpuBackend::default(), reference, &[zone], options).unwrap();
    let measured = correlator.correlate(deformed, None).unwrap().measurement;
    assert_eq!(measured.status, Status::Converged);
    let field: Vec<[f64; 2]> = serde_json::from_value(page.value("known.result.displacement")).unwrap();
    assert_eq!(field.len(), measured.displacement.len());
    let nodes = field.iter().zip(&measured.displacement).zip(&measured.measured).filter(|(_, measured)| **measured);
    let difference = nodes.flat_map(|((a, b), _)| [a[0] - b[0], a[1] - b[1]]).fold(0.0, |all: f64, d| all.max(d.abs()));
    println!("a pair from files: {difference:.1e} px from the CPU");
    // Both stop where less than the tolerance of 1e-4 px is left.
    assert!(difference < 2e-4, "{difference:.1e} px");
    assert!(page.text("kernels").contains("residual_map"));
    // The cursor reads the field.
    page.value(
        "{ const b = document.getElementById('map').getBoundingClientRect(); document.getElementById('map').dispatchEvent(\
         new PointerEvent('pointermove', { clientX: b.left + b.width / 2, clientY: b.top + b.height / 2 })) }",
    );
    let readout = page.text("readout");
    assert!(
        readout.contains("u_x 0.0") || readout.contains("u_x -0.0"),
        "the middle of a rotation is still: {readout}"
    );

    // Whatever was asked for lies in the folder of the page.
    let home = format!("file://{}/", folder().display());
    let foreign: Vec<&String> = page.asked.iter().filter(|address| !address.starts_with(&home)).collect();
    assert!(foreign.is_empty() && page.asked.len() >= 7, "{:?}", page.asked);
    assert!(page.complaints.is_empty(), "{:?}", page.complaints);
    // And its policy allows nothing else.
    assert_eq!(page.value("fetch('https://example.org/').then(() => 'came', () => 'refused')"), "refused");
}

#[test]
fn the_page_says_what_it_cannot_measure() {
    let desk = Desk::new();
    let Some(mut page) = checked(&desk, &folder()) else { return };
    let grey = |level: usize| move |at: usize| ((at * level) % 7) as u8 + 100;
    let plain = |of: &dyn Fn(usize) -> u8, width, height| {
        Image::new(width, height, Pixels::U8((0..width * height).map(of).collect())).unwrap()
    };
    let (width, height) = (program::WIDTH, program::HEIGHT);
    let images = [
        ("reference.png", moved([0.0, 0.0])),
        ("small.png", plain(&grey(3), width - 1, height)),
        ("flat.png", plain(&|_| 99, width, height)),
        ("tiny.png", plain(&grey(3), 9, 9)),
        // Bars: nothing tells how far they move along themselves.
        ("bars.png", plain(&|at| (128.0 + 80.0 * (0.7 * (at % width) as f64).sin()) as u8, width, height)),
        // Another surface.
        ("noise.png", plain(&|at| ((at as u32).wrapping_mul(2_654_435_769) >> 24) as u8, width, height)),
    ];
    for (name, image) in &images {
        write_image(&desk.path(name), image).unwrap();
    }
    for (reference, deformed, wanted) in [
        ("reference.png", "small.png", "differ in size"),
        ("flat.png", "reference.png", "has no texture"),
        ("reference.png", "flat.png", "has no texture"),
        ("bars.png", "bars.png", "too little texture"),
        ("tiny.png", "tiny.png", "smaller than one element"),
        ("reference.png", "noise.png", "do not match"),
    ] {
        let status = told(&mut page, &desk.path(reference), &desk.path(deformed));
        assert!(status.contains(wanted), "{reference}, {deformed}: {status}");
        assert_eq!(page.value("document.getElementById('result').hidden"), true, "{reference}, {deformed}");
    }
    std::fs::write(desk.path("words.png"), "no image").unwrap();
    page.choose("reference", &desk.path("words.png"));
    page.until("document.getElementById('status').textContent.includes('no image that this browser reads')");
    // What ends too early has no field, nor what is too large.
    let files = ["reference.png", "reference.png"].map(|name| desk.path(name));
    assert_eq!(told(&mut page, &files[0], &files[1]), "Converged.");
    let said =
        page.value("correlate(known.device, known.pair.reference, exampleImage(false)).catch(fault => fault.message)");
    assert!(said.as_str().unwrap().contains("641 x 403 px"), "{said}");
    let early = "correlate(known.device, exampleImage(false), exampleImage(true), { max_iterations: 2 }).catch(fault => fault.message)";
    let said = page.value(early);
    assert!(said.as_str().unwrap().contains("did not converge"), "{said}");
    page.value("{ known.before = known.device.limits.maxStorageBufferBindingSize; known.device.limits.maxStorageBufferBindingSize = 1e5 }");
    let status = told(&mut page, &files[0], &files[1]);
    assert!(status.contains("which gives a kernel 0 MB at once"), "{status}");
    assert_eq!(page.value("document.getElementById('result').hidden"), true);
    page.value("{ known.device.limits.maxStorageBufferBindingSize = known.before }");
    // A device that is lost in the middle is said to be, and a check opens it anew.
    page.value("(() => { const done = go(); setTimeout(() => known.device.raw.destroy(), 20); return done })()");
    let status = page.text("status");
    assert!(status.contains("was lost"), "{status}");
    assert_eq!(page.value("document.getElementById('result').hidden"), true);
    page.until("document.getElementById('verdict').textContent.includes('was lost')");
    assert_eq!(page.value("document.getElementById('go').disabled"), true);
    page.value("check()");
    assert!(page.text("verdict").starts_with("Agrees"));
    // A browser without WebGPU.
    page.value("Object.defineProperty(navigator, 'gpu', { value: undefined, configurable: true }); known.device = null; check()");
    let verdict = page.text("verdict");
    assert!(verdict.contains("no WebGPU") && verdict.contains("Firefox"), "{verdict}");
    assert_eq!(page.value("document.getElementById('example').disabled"), true);
}

/// A copy of the page with other shaders.
fn with_shaders(desk: &Desk, shaders: String) -> PathBuf {
    let web = desk.path("web");
    std::fs::create_dir(&web).unwrap();
    for entry in std::fs::read_dir(folder()).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), web.join(entry.file_name())).unwrap();
    }
    std::fs::write(web.join("shaders.js"), shaders).unwrap();
    web
}

#[test]
fn altered_shaders_are_reported_as_wrong_and_not_used() {
    // Each takes the software device some seconds to compile; tests/correlation/device_check.rs has many more, for the same bounds.
    const ALTERED: [[&str; 3]; 2] = [
        ["a lane of the sums", "for (var i = 0u; i < LANES; i++)", "for (var i = 1u; i < LANES; i++)"],
        ["gain of the prefilter", "prefilter.own * s + dot", "prefilter.own * s + 1.01 * dot"],
    ];
    let shaders = std::fs::read_to_string(folder().join("shaders.js")).unwrap();
    for [what, from, to] in ALTERED {
        let desk = Desk::new();
        assert!(shaders.contains(from), "{what}");
        let web = with_shaders(&desk, shaders.replace(from, to));
        let Some(mut page) = checked(&desk, &web) else { return };
        let verdict = page.text("verdict");
        assert!(verdict.contains("does not compute what the program computes"), "{what}: {verdict}");
        assert_eq!(page.value("document.getElementById('example').disabled"), true, "{what}");
        assert_eq!(page.value("JSON.parse(document.getElementById('report').value).agrees"), false, "{what}");
    }
    // One that no compiler takes is named.
    let desk = Desk::new();
    let web = with_shaders(&desk, shaders.replace("fn whole_floor(u: f32)", "fn whole_floor(u: f33)"));
    let Some(mut page) = checked(&desk, &web) else { return };
    let verdict = page.text("verdict");
    assert!(verdict.contains("cannot be compiled: line"), "{verdict}");
}
